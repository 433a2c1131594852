"""Train a texture (Algorithm 2): what `toolkit train-texture` runs."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from toolkit.boosters.booster import (
    BoosterFiles,
    BoosterTask,
    Trained,
    TrainedBooster,
    draw_turntable,
    introduce,
    read_finished,
    train_booster,
    write_preview,
)
from toolkit.boosters.detectors import (
    box_of_coverage,
    is_detector_target,
    judge_detectors,
    meet_networks,
    needs_unmodified,
)
from toolkit.boosters.linear_view import ViewBatch, batch_views, show_texture
from toolkit.boosters.pixel_config import name_files
from toolkit.boosters.pixels import (
    Network,
    Target,
    choose_targets,
    from_picture,
    judge_ensemble,
    list_networks,
    quantise,
)
from toolkit.boosters.texture_config import KNOWN, NEAR, TextureConfig
from toolkit.boosters.texture_objects import (
    TextureInputs,
    choose_class,
    find_source,
    load_inputs,
    load_objects,
    read_keep_image,
    read_start,
)
from toolkit.boosters.transforms.transfer import GREY
from toolkit.boosters.validation import (
    WeatherValidation,
    compare_shares,
    draw_weather,
    measure_known,
    validate_texture,
)
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import srgb_to_linear
from toolkit.objects.atlas import apply_texture
from toolkit.objects.export_mesh import to_glb
from toolkit.objects.records import Texture, glb_name, read_texture, write_texture
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
from toolkit.rig.renderers import RAYCAST, check_starts, describe_cost, make_renderer
from toolkit.rig.studio import make_studio
from toolkit.rig.views import DETAIL, FOV_DEG, IN_STUDIO, PaintableObject, RenderedView, ViewStream
from toolkit.training.loop import History

CHECKPOINT_EVERY_S = 10.0
"""How much work a kill may cost, and how often the turntable is drawn."""
TURNTABLE_VIEWS, TURNTABLE_ELEVATION_DEG, TURNTABLE_FILL, TURNTABLE_BACKDROP = 8, 30.0, 0.9, "concrete"


@dataclass(frozen=True, kw_only=True)
class TrainedTexture(TrainedBooster):
    """Result of a run.

    Attributes:
        texture: pixels and record.
        glbs: the objects that wear it, by name.
        validations: per network, on held-out views; empty when the texture was finished before.
    """

    texture: Texture
    glbs: dict[str, Path]
    validations: list[WeatherValidation] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        return {
            "texture": str(self.files.png), "glb": [str(file) for file in self.glbs.values()],
            "preview": str(self.files.preview), **self.describe_run(), "record": self.texture.record.model_dump(),
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        """Lines on the texture, its accuracy, and the next command."""
        record, files = self.texture.record, self.files
        if self.was_finished:
            yield self.was_there(self.files.png)
        else:
            yield f"{files.png}: {record.n_px} × {record.n_px} px; the object turning: {files.preview}"
            for glb in self.glbs.values():
                yield f"{glb}: the object in it, for Blender, Unreal, three.js"
            yield from say_held_out(self.validations, "texture")
        shown = " ".join(f"--object {item.name}" for item in record.objects)
        yield f"next: toolkit capture-sim {shown} --variant unpatched --variant textured, toolkit eval captures/"


def say_held_out(validations: Sequence[WeatherValidation], booster: str) -> Iterator[str]:
    """Yield a line for each kind of held-out views: accuracy in the object's own paint, and with the booster."""
    kinds = {"clear": "", "fog": " in fog", "weather": " in its weather", "corrupted": " with corruptions"}
    for kind, where in kinds.items():
        found = [answer for one in validations if (answer := getattr(one, kind)) is not None]
        if found:
            yield compare_shares(f"correct{where}", found, ("own paint", booster))


def train_texture(
    config: TextureConfig, networks: Sequence[Network], workspace: Workspace, *, class_name: str | int | None = None,
    name: str | None = None, out: Path | None = None, restart: bool = False, workers: int | None = None,
    checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> TrainedTexture:  # fmt: skip
    """Train a texture, or take it up where an interrupted run of the same settings left it.

    Args:
        config: every setting, see `make_config` and `RECIPES`.
        networks: their labels and preprocessing; the first classifier's lead.
        workspace: whose folders and objects are used.
        class_name: a label of the networks, an index, or a WordNet id; None: the class that the objects' specs name.
        name: of the texture's files; by default the object's, for several objects the class's.
        out: folder for the texture instead of the workspace's.
        restart: forget what an earlier run left.
        workers: threads that render ahead; None: a thread for each core; 0: none.
        checkpoint_every_s: how much work a kill may cost.

    Raises:
        ToolkitError: the settings, an object, the photographs or a checkpoint cannot be used, or the disk is full.
    """
    # what can fail fails before anything is rendered
    config.check_backgrounds()
    check_starts(config.renderer)
    keep_image = None if config.keep_image is None else read_keep_image(config.keep_image)
    objects = load_objects(workspace, config, keep_image)
    config, targets = meet_networks(config, networks, choose_class(class_name, objects))
    # an object's own name makes the texture its own
    if name is None and len(objects) == 1:
        name = objects[0].name
    name = name_files(name, targets[0].label, targets[0].class_index)
    start = None if config.start is None else read_start(config.start, objects, config.size_px)
    inputs = load_inputs(config, objects, keep_image, targets[0].classifier, workspace, start)
    task = TextureTask(config, targets, inputs, choose_files(workspace, out, name), workers)
    return train_booster(task, restart=restart, checkpoint_every_s=checkpoint_every_s)


def choose_files(workspace: Workspace, out: Path | None, name: str) -> BoosterFiles:
    """The workspace's own folder, or below `out`."""
    folder = workspace.textures_dir if out is None else Path(out)
    return BoosterFiles(folder / f"{name}.png", folder / "previews" / f"{name}.png", folder / ".training" / name)


class SurfaceTask(BoosterTask[Trained]):
    """Algorithm 2: what is on a surface goes down the loss of recognising its class in random views of what wears it.

    A subclass says what of it is written, and where.
    """

    work: Work = Work("texture", 6, old_at=0)

    def __init__(
        self, config: TextureConfig, targets: list[Target], inputs: TextureInputs, files: BoosterFiles,
        workers: int | None = None,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            config, targets, files: see `BoosterTask`.
            inputs: what it is trained on.
            workers: threads that render ahead; None: a thread for each core; 0: none.
        """
        super().__init__(config, config.size_px, targets, files, config.optimiser)
        self.config, self.inputs, self._workers = config, inputs, workers
        self.title = f"Training {files.training.name}"
        # texels that the object does not show are filled from the nearest texel that it shows
        self._source = torch.from_numpy(find_source(inputs.objects)).to(self.pixels.device)
        # at model size, weather needs to know how large the object really is
        is_model = config.weather is not None and config.world is None
        self._metres = [item.metres_per_mm if is_model else 1.0 for item in inputs.objects]
        self._range: tuple[torch.Tensor, torch.Tensor] | None = None
        self._allowed: dict[str, Any] = {}

    def hash_pixels(self) -> str:
        """Hash of what the surface is trained on; real sizes count where there is weather or a world."""
        return self.inputs.sha256(needs_size=self.config.weather is not None or self.config.world is not None)

    def begin(self) -> None:
        """Take the start that is given, or the paint, in place of noise."""
        start, paint = self.inputs.start, self.inputs.paint
        # a texture that stays near its paint cannot begin at noise: it would be clamped to the range's ends
        start = paint if start is None and self._range is not None else start
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
            notice(f"the networks recognise the unmodified object in {known:.0%} of the first views: {says}")
        if most is not None:
            self._range = near - most, near + most

    def constrain(self) -> None:
        """Colours are in [0, 1], and as near to the paint as is asked."""
        if self._range is not None:
            self.pixels.clamp_(*self._range)
        super().constrain()

    def describe(self) -> list[str]:
        """What is trained, and on which objects."""
        inputs = self.inputs
        world = None if inputs.setting is None else inputs.setting.describe([item.mesh for item in inputs.at_real_size])
        more = [("object", item.describe()) for item in inputs.objects] + ([] if world is None else [("world", world)])
        lines = introduce(self.work.kind, self.config, self.config.size_px, self.targets, more)
        cost = describe_cost(self.config.renderer, [self.image_px**2] * self.config.step_count * self.config.batch)
        return [*lines, cost] if cost else lines

    @contextmanager
    def open(self) -> Iterator[None]:
        """Start the threads that render, and set the turntable up."""
        # subjects of the turntable are shown at every checkpoint
        subjects, device = [item.subject() for item in self.inputs.objects], str(self.pixels.device)
        self._turntable = [plan_turntable(subject, self.image_px, device) for subject in subjects]
        views = self.config.views(self.image_px)
        # views are rendered ahead, in threads, while the network is asked
        self._stream = ViewStream(
            self.inputs.at_real_size, views, self.config.seed, self.config.groups, self._workers,
            setting=self.inputs.setting or IN_STUDIO, with_depth=self.config.weather is not None,
            renderer=self.config.renderer,
        )  # fmt: skip
        with self._stream:
            if self.inputs.paint is not None:
                self._stay_near(self.inputs.paint)
            yield

    def loss(self, step: int) -> tuple[torch.Tensor, dict[str, float]]:
        """Cross-entropy of photographs of random views; the first step of a group waits until it is rendered."""
        config, draws = self.config, Draws(self.config.seed, step)
        # the views of the step, with photographs behind them
        group, inside = divmod(step, config.steps_per_group)
        views = choose_views(self._stream.group(group), config, group, inside)
        behind = choose_backgrounds(
            self.inputs.backgrounds.images, config, draws.of("backgrounds"), len(views), self.image_px
        )
        batch = batch_views([view.view for view in views], str(self.pixels.device), behind).to(self.pixels.dtype)
        # weather acts on the light of the render, by its depth
        if config.weather is not None:
            rng = config.weather.rng(draws)
            batch = batch.through(*draw_weather(views, self._metres, config.weather, rng))
        photos = take_photos(self._dilate(self.pixels), batch, config, draws)
        asked, clean, unmodified = choose_targets(self.targets, config, step), None, None
        with torch.no_grad():
            if needs_unmodified(config, asked):
                each = torch.stack([take_photos(paint, batch, config, draws) for paint in self._paints])
                unmodified = each[[view.subject for view in views], list(range(len(views)))]
            # feature mixup needs the same views with a grey object
            if config.feature_mixup is not None:
                clean = take_photos(torch.full_like(self.pixels, GREY), batch, config, draws)
        if is_detector_target(asked[0]):
            boxes = np.array([box_of_coverage(view.view.coverage) for view in views], np.float32)
            loss, recognised = judge_detectors(photos, asked, boxes, unmodified, config.lost_weight)
        else:
            loss, recognised = judge_ensemble(photos, self.targets, config, draws, clean, unmodified)
        return loss, {"accuracy": recognised}

    @cached_property
    def _paints(self) -> list[torch.Tensor]:
        """Each object's own paint as a texture, (3, n, n)."""
        device = str(self.pixels.device)
        return [self._dilate(from_picture(item.paint(), device)).to(self.pixels.dtype) for item in self.inputs.objects]

    def _dilate(self, pixels: torch.Tensor) -> torch.Tensor:
        """(3, n, n) with the colour of the nearest seen texel on all that are not seen."""
        return pixels.flatten(1)[:, self._source.reshape(-1)].view(pixels.shape)

    def show(self) -> None:
        """Draw the turntable."""
        with torch.inference_mode():
            photos = torch.cat([show_texture(self._dilate(self.pixels), batch) for batch in self._turntable])
        write_preview(self.files.preview, draw_turntable(photos, self.targets[0]))

    def finish(self, history: History) -> Trained:
        """Validate the rounded pixels, and write them."""
        # what is judged is what is written: 8-bit codes
        config, inputs, pixels = self.config, self.inputs, self.reduce(quantise(self._dilate(self.pixels)))
        with progress("Validating", 1) as bar:
            validations = validate_texture(
                pixels, self._stream.held_out(config.held_out), self.targets, config.seed,
                corrupted=config.corrupted, weather=config.weather, metres_per_unit=self._metres,
            )  # fmt: skip
            bar.advance()
        # the record: what was rendered, and the shares by condition
        views: dict[str, Any] = {
            "rendered": config.groups * config.studios * config.per_studio,
            "used": config.step_count * config.batch,
            "objects": [item.name for item in inputs.objects],
        }
        if inputs.setting is not None:
            views["world"] = inputs.setting.record([item.mesh for item in inputs.at_real_size])
        shares = {
            "held_out": [validation.clear for validation in validations],
            "held_out_fog": [validation.fog for validation in validations],
            "held_out_corrupted": [
                validation.corrupted for validation in validations if validation.corrupted is not None
            ],
            "held_out_weather": [validation.weather for validation in validations if validation.weather is not None],
        }
        record = self.record(
            history, {"views": views, "backgrounds": inputs.backgrounds.record},
            config.settings(self.image_px) | self._allowed, {}, shares,
        )  # fmt: skip
        return self.write(pixels, record, validations)

    def reduce(self, pixels: np.ndarray) -> np.ndarray:
        """(n, n, 3) uint8 sRGB trained pixels without what adds nothing; by default all of them."""
        return pixels

    @abstractmethod
    def write(self, pixels: np.ndarray, record: dict[str, Any], validations: list[WeatherValidation]) -> Trained:
        """Write (n, n, 3) uint8 sRGB pixels with the fields of their record, see `BoosterTask.record`."""


class TextureTask(SurfaceTask[TrainedTexture]):
    """Training of a texture all over its objects."""

    def list_inputs(self) -> list[Any]:
        """Name, networks, objects and photographs, and every setting."""
        config = self.config
        return [
            self.files.png.stem, list_networks(self.targets), self.hash_pixels(), config.size_px, config.objects,
            config.settings(self.image_px),
        ]  # fmt: skip

    @cached_property
    def _glbs(self) -> dict[str, Path]:
        folder, name = self.files.png.parent, self.files.png.stem
        return {item.name: folder / glb_name(name, item.name) for item in self.inputs.objects}

    def find_finished(self) -> TrainedTexture | None:
        """The texture, where its files are whole and of the same inputs."""
        texture = read_finished(read_texture, self.files, self.key, self._glbs.values())
        skipped = self.inputs.backgrounds.skipped
        return None if texture is None else TrainedTexture(
            texture=texture, files=self.files, glbs=self._glbs, skipped=skipped
        )  # fmt: skip

    def write(self, pixels: np.ndarray, record: dict[str, Any], validations: list[WeatherValidation]) -> TrainedTexture:
        """Write texture, record and the objects in it."""
        # the record holds, for each object, the mesh that the texture fits
        config, inputs = self.config, self.inputs
        worn = [
            {"name": item.name, "mesh_sha256": item.item.shape_sha256, "keep": list(config.keep)}
            for item in inputs.objects
        ]
        texture = write_texture(
            self.files.png.parent,
            pixels,
            record | {"objects": worn},
            corner_uv={item.name: item.atlas.corner_uv for item in inputs.objects if item.atlas.unwrapped},
            keep_images={} if inputs.keep_image is None else {inputs.objects[0].name: inputs.keep_image},
            glbs={item.name: to_glb(apply_texture(item.atlas, pixels), item.name) for item in inputs.objects},
        )
        skipped = inputs.backgrounds.skipped
        return TrainedTexture(
            texture=texture, files=self.files, glbs=self._glbs, validations=validations, skipped=skipped
        )


def take_photos(texture: torch.Tensor, batch: ViewBatch, config: TextureConfig, draws: Draws) -> torch.Tensor:
    """Photographs (b, 3, s, s) of a dilated texture as the camera of `config` gives them, sRGB-encoded in [0, 1]."""
    count = len(batch)
    # in the order in which they happen: ink, light, and the camera
    for printer in config.transforms("print"):
        texture = printer.change(texture, printer.rng(draws))
    light: torch.Tensor | float = 1.0
    for transform in config.transforms("light"):
        light = light * transform.draw(transform.rng(draws), count, texture)
    photos = show_texture(texture, batch, config.gradient, light)
    for transform in config.transforms("photo"):
        photos = transform.change(photos, transform.rng(draws))
    return photos


def choose_views(group: list[RenderedView], config: TextureConfig, number: int, inside: int) -> list[RenderedView]:
    """The views of the step `inside` a group: each comes `reuse` times before the group is left, in random order."""
    # 0x0DE5 tells these draws from others of the same seed and group
    rng = np.random.default_rng([config.seed, number, 0x0DE5])
    order = np.concatenate([rng.permutation(len(group)) for _ in range(config.reuse)])
    start = inside * config.batch
    return [group[k] for k in np.resize(order, start + config.batch)[start:]]


def choose_backgrounds(
    photographs: np.ndarray, config: TextureConfig, rng: np.random.Generator, count: int, image_px: int
) -> list[np.ndarray | None]:
    """For each of `count` views a random cut of a photograph in linear light, or None where the studio stays."""
    # some views keep the studio behind the object
    chosen: list[np.ndarray | None] = []
    for acting in rng.random(count) < config.background_share:
        if not (acting and len(photographs)):
            chosen.append(None)
            continue
        # a random cut, mirrored half of the time, in linear light
        photograph = photographs[rng.integers(len(photographs))]
        top, left = rng.integers(0, np.array(photograph.shape[:2]) - image_px + 1)
        cut = photograph[top : top + image_px, left : left + image_px]
        chosen.append(srgb_to_linear((cut[:, ::-1] if rng.random() < 0.5 else cut) / np.float32(255)))
    return chosen


def plan_turntable(subject: PaintableObject, image_px: int, device: str) -> ViewBatch:
    """Eight views around an object in studio light, of `image_px` a side."""
    mesh = subject.mesh
    studio = make_studio(0, float(mesh.size_mm.max()), TURNTABLE_BACKDROP)
    # baked once: the turntable is shown again at every checkpoint, and only the texture differs
    renderer = make_renderer(RAYCAST, mesh, studio, DETAIL)
    camera = Camera.from_fov(image_px, image_px, FOV_DEG)
    # cameras look at the middle of the object's height
    target = np.array([0.0, 0.0, mesh.size_mm[2] / 2])
    poses = []
    for azimuth in np.arange(TURNTABLE_VIEWS) * 360.0 / TURNTABLE_VIEWS:
        distance = distance_to_fill(camera, mesh.vertices, target, azimuth, TURNTABLE_ELEVATION_DEG, TURNTABLE_FILL)
        poses.append(orbit_pose(target, azimuth, TURNTABLE_ELEVATION_DEG, distance))
    texture = mesh.materials[subject.material].texture
    return batch_views(list(renderer.render_linear_many(camera, poses, texture)), device)
