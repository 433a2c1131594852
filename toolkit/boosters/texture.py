"""Train a texture (Algorithm 2): what `toolkit train-texture` runs."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit import __version__
from toolkit.boosters.data import choose_images, load_files
from toolkit.boosters.detectors import box_of_coverage, find_detectors, judge_detectors
from toolkit.boosters.ensemble import judge_ensemble
from toolkit.boosters.linear_view import ViewBatch, batch_views, show_texture
from toolkit.boosters.pixel_config import name_files
from toolkit.boosters.pixels import (
    Network,
    PixelTask,
    Target,
    aim,
    from_picture,
    list_networks,
    quantise,
    record_network,
)
from toolkit.boosters.preview import BoosterFiles, draw_turntable, write_preview
from toolkit.boosters.texture_config import KNOWN, METHOD_VERSION, NEAR, TextureConfig
from toolkit.boosters.texture_objects import (
    TexturedObject,
    choose_class,
    find_source,
    hash_objects,
    load_objects,
    read_keep_image,
    read_start,
)
from toolkit.boosters.texture_validation import (
    WeatherValidation,
    draw_weather,
    measure_known,
    validate_corrupted,
    validate_in_weather,
    validate_texture,
)
from toolkit.boosters.validation import list_shares
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import srgb_to_linear
from toolkit.objects.atlas import take_paint, wear
from toolkit.objects.export import to_glb
from toolkit.objects.records import Texture, glb_name, read_texture, write_texture
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio
from toolkit.rig.views import DETAIL, FOV_DEG, IN_STUDIO, PaintableObject, RenderedView, ViewStream
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import History, fit
from toolkit.worlds.views import WorldSetting, open_setting

if TYPE_CHECKING:
    import torch

CHECKPOINT_EVERY_S = 10.0
"""How much work a kill may cost, and how often the turntable is drawn."""
MAX_BACKGROUNDS = 256
TURNTABLE_VIEWS, TURNTABLE_ELEVATION_DEG, TURNTABLE_FILL, TURNTABLE_BACKDROP = 8, 30.0, 0.9, "concrete"


@dataclass(frozen=True)
class TrainedTexture:
    """What a run made.

    Attributes:
        texture: pixels and record.
        files: where it lies.
        glbs: the objects that wear it, by name.
        validations: per network, on held-out views; empty when the texture was finished before.
        skipped: (path, reason) of background photographs that could not be used.
        resumed_from: steps that an earlier run had made; all of them when the texture was finished before.
        was_finished: whether there was nothing left to do.
    """

    texture: Texture
    files: BoosterFiles
    glbs: dict[str, Path]
    validations: list[WeatherValidation]
    skipped: tuple[tuple[str, str], ...]
    resumed_from: int = 0
    was_finished: bool = False


@dataclass(frozen=True)
class Backgrounds:
    """Photographs to stand behind the object: (k, s, s, 3) uint8 sRGB, what was skipped, and their record."""

    images: np.ndarray
    skipped: tuple[tuple[str, str], ...] = ()
    record: dict[str, Any] | None = None


def train_texture(
    config: TextureConfig,
    networks: Sequence[Network],
    workspace: Workspace,
    *,
    class_name: str | int | None = None,
    name: str | None = None,
    out: Path | None = None,
    restart: bool = False,
    workers: int | None = None,
    checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> TrainedTexture:
    """Train a texture, or take it up where an interrupted run of the same settings left it.

    Args:
        config: every setting, see `make_config` and `RECIPES`.
        networks: at least one; the first one's labels and preprocessing lead.
        workspace: whose folders and objects are used.
        class_name: a label of the networks, an index, or a WordNet id; None: the class that the objects' specs name.
        name: of the texture's files; by default the object's, for several objects the class's.
        out: folder for the texture instead of the workspace's.
        restart: forget what an earlier run left.
        workers: threads that render ahead; None: one for each core; 0: none.
        checkpoint_every_s: how much work a kill may cost.

    Raises:
        ToolkitError: the settings, an object, the photographs or a checkpoint cannot be used, or the disk is full.
    """
    config.check_backgrounds()
    keep_image = None if config.keep_image is None else read_keep_image(config.keep_image)
    objects = load_objects(workspace, config, keep_image)
    label = choose_class(class_name, objects)
    targets = aim(networks, label)
    find_detectors(networks)
    config = config.for_networks(len(targets))
    if name is None and len(objects) == 1:
        name = objects[0].name
    name = name_files(name, targets[0].label, targets[0].class_index)
    files = choose_files(workspace, out, name)
    backgrounds = _load_backgrounds(config, networks[0])
    data_sha256 = hash_objects(objects) + sha256_bytes(backgrounds.images.tobytes())
    if config.weather is not None or config.world is not None:
        data_sha256 += "".join(f" {one.metres_per_mm!r}" for one in objects)
    paint = None if config.max_change is None else take_paint(objects[0].atlas, objects[0].item.mesh)
    start = None if config.start is None else read_start(config.start, objects, config.size_px)
    given = (paint if start is None else start, paint)
    data_sha256 += "".join(sha256_bytes(one.tobytes()) for one in given if one is not None)
    setting = None
    if config.world is not None:
        seed, scale = config.world_seed, config.world_scale
        setting = open_setting(workspace, config.world, config.times, seed=seed, scale=scale)
        data_sha256 += json.dumps(setting.record([one.subject(True).mesh for one in objects]))
    inputs = [
        METHOD_VERSION, name, list_networks(targets), data_sha256, config.size_px, config.objects,
        config.settings(networks[0].preprocessing.crop_px),
    ]  # fmt: skip
    inputs_sha256 = sha256_bytes(json.dumps(inputs, sort_keys=True).encode())
    task = TextureTask(config, targets, objects, backgrounds, files, inputs_sha256)
    task.keep_image, task.workers, task.setting = keep_image, workers, setting
    task.start, task.paint = start, paint
    checkpoint = Checkpoint(files.training, inputs_sha256, restart, checkpoint_every_s)
    fitted = fit(task, config.fit_config(config.optimiser), checkpoint)
    return replace(fitted.made, resumed_from=fitted.resumed_from, was_finished=fitted.was_finished)


def choose_files(workspace: Workspace, out: Path | None, name: str) -> BoosterFiles:
    """The workspace's own folder, or below `out`."""
    folder = workspace.textures_dir if out is None else Path(out)
    return BoosterFiles(folder / f"{name}.png", folder / "previews" / f"{name}.png", folder / ".training" / name)


def _load_backgrounds(config: TextureConfig, network: Network) -> Backgrounds:
    side = network.preprocessing.resize_px
    if not config.background_share or config.backgrounds is None:
        return Backgrounds(np.zeros((0, side, side, 3), np.uint8))
    found = choose_images(config.backgrounds, frozenset(), "all", "backgrounds")
    count = min(MAX_BACKGROUNDS, len(found.files))
    with progress("Reading backgrounds", count) as bar:
        rng = np.random.default_rng([config.seed, 0xBAC])
        loaded = load_files(found, count, rng, network.preprocessing, bar.advance)
    return Backgrounds(loaded.images, loaded.skipped, loaded.record)


class TextureTask(PixelTask[TrainedTexture]):
    """Algorithm 2: a texture goes down the loss of recognising its class in random views of what wears it.

    Attributes:
        keep_image: (h, w) bool mask of the only object, to be recorded.
        workers: threads that render ahead; None: one for each core; 0: none.
        setting: the world that it is trained in; None: studios.
        start: (n, n, 3) uint8 sRGB to go on from; None: from the paint where it is stayed near, else from noise.
        paint: (n, n, 3) uint8 sRGB that `config.max_change` is counted from, where there is one.
    """

    kind = "texture"

    def __init__(
        self, config: TextureConfig, targets: list[Target], objects: list[TexturedObject], backgrounds: Backgrounds,
        files: BoosterFiles, inputs_sha256: str = "",
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            config: every setting.
            targets: the networks and their classes.
            objects: that wear the texture.
            backgrounds: photographs; there may be none.
            files: where to write.
            inputs_sha256: hash of all that decides the texture.
        """
        import torch

        super().__init__(config, config.size_px, targets, config.optimiser)
        self.config, self.objects, self.files, self.inputs_sha256 = config, objects, files, inputs_sha256
        self.keep_image: np.ndarray | None = None
        self.workers: int | None = None
        self.setting: WorldSetting | None = None
        self.start: np.ndarray | None = None
        self.paint: np.ndarray | None = None
        self.title = f"Training {files.png.stem}"
        self._backgrounds = backgrounds
        self._source = torch.from_numpy(find_source(objects)).to(self.pixels.device)
        is_model = config.weather is not None and config.world is None
        self._metres = [one.metres_per_mm if is_model else 1.0 for one in objects]
        self._glbs = {one.name: files.png.parent / glb_name(files.png.stem, one.name) for one in objects}
        self._range: tuple[torch.Tensor, torch.Tensor] | None = None
        self._allowed: dict[str, Any] = {}

    def begin(self) -> None:
        """Take the start that is given, or the paint, in place of noise."""
        import torch

        start = self.paint if self.start is None and self._range is not None else self.start
        if start is not None:
            with torch.no_grad():
                self.pixels.copy_(from_picture(start, str(self.pixels.device)))
                self.constrain()

    def _stay_near(self, paint: np.ndarray) -> None:
        """Let no channel be farther from the paint than is asked, or than what the networks say of it allows."""
        near, most = from_picture(paint, str(self.pixels.device)), self.config.max_change
        if most == "auto":
            known = measure_known(near, self._stream.group(0), self.targets)  # trained on, none is held out
            most = NEAR if known >= KNOWN else None
            self._allowed = {"max_change": most, "known_bare": known}
            says = "any change" if most is None else f"no channel changes by more than {most:g}"
            notice(f"the bare object is known in {known:.0%} of the first views: {says}")
        if most is not None:
            self._range = near - most, near + most

    def constrain(self) -> None:
        """Colours are in [0, 1], and as near to the paint as is asked."""
        if self._range is not None:
            self.pixels.clamp_(*self._range)
        super().constrain()

    def describe(self) -> list[str]:
        """Every setting that acts."""
        names = [target.classifier.name for target in self.targets]
        world = None if self.setting is None else self.setting.describe([one.mesh for one in self._subjects()])
        return self.config.lines(self.targets[0].label, [one.describe() for one in self.objects], names, world)

    def _subjects(self) -> list[PaintableObject]:
        return [one.subject(at_real_size=self.setting is not None) for one in self.objects]

    def find_finished(self) -> TrainedTexture | None:
        """The texture, where its files are whole and of the same inputs."""
        if not all(file.is_file() for file in (self.files.png, self.files.preview, *self._glbs.values())):
            return None
        try:
            texture = read_texture(self.files.png)
        except ToolkitError:
            return None  # a kill between picture and record leaves a pair that does not match; it is written again
        is_same = texture.record.settings.get("inputs_sha256") == self.inputs_sha256
        return TrainedTexture(texture, self.files, self._glbs, [], self._backgrounds.skipped) if is_same else None

    @contextmanager
    def open(self) -> Iterator[None]:
        """Start the threads that render, and set the turntable up."""
        subjects, device = [one.subject() for one in self.objects], str(self.pixels.device)
        self._turntable = [plan_turntable(subject, self.image_px, device) for subject in subjects]
        views = self.config.views(self.image_px)
        self._stream = ViewStream(
            self._subjects(), views, self.config.seed, self.config.groups, self.workers,
            setting=self.setting or IN_STUDIO, with_depth=self.config.weather is not None,
        )  # fmt: skip
        with self._stream:
            if self.paint is not None:
                self._stay_near(self.paint)
            yield

    def loss(self, step: int) -> "tuple[torch.Tensor, dict[str, float]]":
        """Cross-entropy of photographs of random views; the first step of a group waits until it is rendered."""
        config, draws = self.config, Draws(self.config.seed, step)
        group, inside = divmod(step, config.steps_per_group)
        views = choose_views(self._stream.group(group), config, group, inside)
        behind = choose_backgrounds(
            self._backgrounds.images, config, draws.of("backgrounds"), len(views), self.image_px
        )
        batch = batch_views([one.view for one in views], str(self.pixels.device), behind).to(self.pixels.dtype)
        if config.weather is not None:
            rng = config.weather.rng(draws)
            batch = batch.through(*draw_weather(views, self._metres, config.weather, rng))
        photos = take_photos(self.dilated(), batch, config, draws)
        if find_detectors([target.classifier for target in self.targets]):
            boxes = np.array([box_of_coverage(one.view.coverage) for one in views], np.float32)
            loss, recognised = judge_detectors(photos, self.targets, boxes)
        else:
            loss, recognised = judge_ensemble(photos, self.targets, config, draws)
        return loss, {"accuracy": recognised}

    def dilated(self) -> "torch.Tensor":
        """(3, n, n) with the colour of the nearest seen texel on all that are not seen."""
        return self.pixels.flatten(1)[:, self._source.reshape(-1)].view(self.pixels.shape)

    def show(self) -> None:
        """Draw the turntable."""
        import torch

        with torch.inference_mode():
            photos = torch.cat([show_texture(self.dilated(), batch) for batch in self._turntable])
        write_preview(self.files.preview, draw_turntable(photos, self.targets[0]))

    def finish(self, history: History) -> TrainedTexture:
        """Validate the rounded texture; write texture, record and the objects in it."""
        config, objects = self.config, self.objects
        pixels = quantise(self.dilated())
        with progress("Validating", 1) as bar:
            held_out = self._stream.held_out(config.held_out)
            validations = validate_texture(pixels, held_out, self.targets, config.seed)
            if config.weather is not None:
                seen = validate_in_weather(
                    pixels, held_out, self.targets, config.seed, weather=config.weather, metres_per_unit=self._metres
                )
                validations = [replace(one, weather=other) for one, other in zip(validations, seen, strict=True)]
            if config.corrupted is not None:
                hard = validate_corrupted(pixels, held_out, self.targets, config.seed, config.corrupted)
                validations = [replace(one, corrupted=other) for one, other in zip(validations, hard, strict=True)]
            bar.advance()
        clear, fog = [one.clear for one in validations], [one.fog for one in validations]
        weather = [one.weather for one in validations if one.weather is not None]
        corrupted = [one.corrupted for one in validations if one.corrupted is not None]
        views = {
            "rendered": config.groups * config.studios * config.per_studio,
            "used": config.step_count * config.batch,
            "objects": [one.name for one in objects],
        }
        if self.setting is not None:
            views["world"] = self.setting.record([one.mesh for one in self._subjects()])
        record = {
            "name": self.files.png.stem,
            "class_name": self.targets[0].label,
            "class_index": self.targets[0].class_index,
            "objects": [
                {"name": one.name, "mesh_sha256": one.item.shape_sha256, "keep": list(config.keep)} for one in objects
            ],
            "networks": [record_network(target.classifier) for target in self.targets],
            "data": {"views": views, "backgrounds": self._backgrounds.record},
            "seed": config.seed,
            "settings": config.settings(self.image_px) | self._allowed | {"inputs_sha256": self.inputs_sha256},
            "final": history.recent(self.recent)
            | list_shares(clear, "held_out")
            | list_shares(fog, "held_out_fog")
            | list_shares(corrupted, "held_out_corrupted")
            | list_shares(weather, "held_out_weather"),
            "toolkit_version": __version__,
        }
        texture = write_texture(
            self.files.png.parent,
            pixels,
            record,
            corner_uv={one.name: one.atlas.corner_uv for one in objects if one.atlas.unwrapped},
            keep_images={} if self.keep_image is None else {objects[0].name: self.keep_image},
            glbs={one.name: to_glb(wear(one.atlas, pixels), one.name) for one in objects},
        )
        return TrainedTexture(texture, self.files, self._glbs, validations, self._backgrounds.skipped)


def take_photos(texture: "torch.Tensor", batch: ViewBatch, config: TextureConfig, draws: Draws) -> "torch.Tensor":
    """Photographs (b, 3, s, s) of a dilated texture as the camera of `config` gives them, sRGB-encoded in [0, 1]."""
    count = len(batch)
    light: torch.Tensor | float = 1.0
    for one in config.transforms("light"):
        light = light * one.draw(one.rng(draws), count, texture)
    photos = show_texture(texture, batch, config.gradient, light)
    for one in config.transforms("photo"):
        photos = one.change(photos, one.rng(draws))
    return photos


def choose_views(group: list[RenderedView], config: TextureConfig, number: int, inside: int) -> list[RenderedView]:
    """The views of the step `inside` a group: each comes `reuse` times before the group is left, in random order."""
    rng = np.random.default_rng([config.seed, number, 0x0DE5])
    order = np.concatenate([rng.permutation(len(group)) for _ in range(config.reuse)])
    start = inside * config.batch
    return [group[k] for k in np.resize(order, start + config.batch)[start:]]


def choose_backgrounds(
    photographs: np.ndarray, config: TextureConfig, rng: np.random.Generator, count: int, image_px: int
) -> list[np.ndarray | None]:
    """For each of `count` views a random cut of a photograph in linear light, or None where the studio stays."""
    chosen: list[np.ndarray | None] = []
    for acting in rng.random(count) < config.background_share:
        if not (acting and len(photographs)):
            chosen.append(None)
            continue
        photograph = photographs[rng.integers(len(photographs))]
        top, left = rng.integers(0, np.array(photograph.shape[:2]) - image_px + 1)
        cut = photograph[top : top + image_px, left : left + image_px]
        chosen.append(srgb_to_linear((cut[:, ::-1] if rng.random() < 0.5 else cut) / np.float32(255)))
    return chosen


def plan_turntable(subject: PaintableObject, image_px: int, device: str) -> ViewBatch:
    """Eight views around an object in studio light, of `image_px` a side."""
    mesh = subject.mesh
    studio = make_studio(0, float(mesh.size_mm.max()), TURNTABLE_BACKDROP)
    renderer = RaycastRenderer(mesh, studio, DETAIL)
    camera = Camera.from_fov(image_px, image_px, FOV_DEG)
    target = np.array([0.0, 0.0, mesh.size_mm[2] / 2])
    poses = []
    for azimuth in np.arange(TURNTABLE_VIEWS) * 360.0 / TURNTABLE_VIEWS:
        distance = distance_to_fill(camera, mesh.vertices, target, azimuth, TURNTABLE_ELEVATION_DEG, TURNTABLE_FILL)
        poses.append(orbit_pose(target, azimuth, TURNTABLE_ELEVATION_DEG, distance))
    texture = mesh.materials[subject.material].texture
    return batch_views(list(renderer.render_linear_many(camera, poses, texture)), device)
