"""Train a patch (Algorithm 1): what `toolkit train-patch` runs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from toolkit.boosters.booster import (
    COLUMNS,
    ROWS,
    BoosterFiles,
    BoosterTask,
    TrainedBooster,
    draw_patch_preview,
    introduce,
    read_finished,
    train_booster,
    write_preview,
)
from toolkit.boosters.data import (
    TrainingData,
    choose_object,
    cut_centres,
    describe_data,
    draw_batch,
    load_data,
    names_of_class,
    stack_on_device,
)
from toolkit.boosters.detectors import (
    is_detector_target,
    judge_detectors,
    meet_networks,
    needs_unmodified,
)
from toolkit.boosters.mounted import (
    MountedViews,
    draw_mounted,
    grey_paper,
    make_sheet_subject,
    recognise_mounted,
    render_mounted_views,
    stack_views,
    validate_mounted,
)
from toolkit.boosters.patch_config import PATCHES, PatchConfig, check_size, list_patch_inputs
from toolkit.boosters.pixel_config import WORLD_ELEVATION_DEG, DataConfig, name_files
from toolkit.boosters.pixels import (
    Network,
    Target,
    choose_targets,
    from_picture,
    judge_ensemble,
    judge_photos,
    list_networks,
    quantise,
)
from toolkit.boosters.transforms.show import Appearance, Mounted, show_patch, take_photos
from toolkit.boosters.validation import MOST_NAMED, Validation, compare_shares, count_placements, validate_patch
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError
from toolkit.core.text import list_some, quote
from toolkit.core.workspace import Workspace
from toolkit.imaging.printer import score_print
from toolkit.objects.load import load_object
from toolkit.objects.records import Patch, PatchRecord, printed_size_mm, read_patch, write_patch
from toolkit.rig.views import ViewRanges
from toolkit.training.loop import History

Penalty = Callable[["torch.Tensor"], "torch.Tensor"]
"""θ -> a loss of the patch itself, a scalar."""
Judge = Callable[["torch.Tensor", list[Target]], tuple["torch.Tensor", float]]
"""(b, 3, m, m) photographs, networks -> the loss, a scalar, and the share recognised."""
CHECKPOINT_EVERY_S = 5.0
UNKNOWN = (
    "note: without a patch the object is never recognised, and a sheet is then often too small; "
    "'toolkit train-texture' paints the whole object"
)
# renders are named by their own inputs, so that runs with other settings share them
RENDERS = ("renders-*.npy", ".renders-*.partial")
"""Files beside the checkpoints that other runs may need."""
NEAR = (0.6, 0.95)
"""Share of the frame for objects that are hardly recognised without a patch. Smaller views teach their patch little."""


@dataclass(frozen=True, kw_only=True)
class TrainedPatch(TrainedBooster):
    """Result of a run.

    Attributes:
        patch: pixels and record.
        validations: per network; empty when the patch was finished before.
        on_object: per network, on held-out views of the object; grey paper stands in for `bare`.
        corrupted, in_weather: the same under the corruptions and in the weather of the training; empty without them.
    """

    patch: Patch
    validations: list[Validation] = field(default_factory=list)
    on_object: list[Validation] = field(default_factory=list)
    corrupted: list[Validation] = field(default_factory=list)
    in_weather: list[Validation] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        files = {"patch": str(self.files.png), "preview": str(self.files.preview)}
        return {**files, **self.describe_run(), "record": self.patch.record.model_dump()}

    def lines(self, object_name: str | None = None) -> Iterator[str]:
        """Lines on the patch, its accuracy, and the next command."""
        record, files = self.patch.record, self.files
        if self.was_finished:
            yield self.was_there(self.files.png)
        else:
            yield f"{files.png}: {record.n_px} px, {record.size_mm:.0f} mm on paper; preview: {files.preview}"
            yield from self._list_accuracy(record)
        if object_name == record.name:
            yield f"next: toolkit print --object {object_name}, toolkit capture-sim --object {object_name}"
            return
        yield f"next: toolkit print --patch-file {quote(files.png)}"
        if object_name is not None:
            yield f"note: the rig puts a patch called '{object_name}' on {object_name}: leave out --name for that"

    def _list_accuracy(self, record: PatchRecord) -> Iterator[str]:
        """On the object if it was put on an object: that is what a camera sees. The record has the rest."""
        on_object, flat = ("grey paper", "patch"), ("without", "with the patch")
        if self.on_object:
            # a patch that was mounted is judged there, any other where it was pasted
            yield compare_shares("correct on the object", self.on_object, on_object)
            if self.in_weather:
                yield compare_shares("correct in its weather", self.in_weather, on_object)
            return
        what = "held-out" if record.data["held_out"] else "training"
        yield compare_shares("correct, pasted flat", self.validations, flat, f"placements in {what} images")
        if self.corrupted:
            yield compare_shares("correct with corruptions", self.corrupted, flat, "placements")

    def warnings(self) -> Iterator[str]:
        """Warnings before printing."""
        # told where the patch is not shown to help: printing it would be in vain
        if any(answer.falls_short for answer in self.on_object):
            is_far = self.patch.record.settings["mounted_fill"][0] < NEAR[0]
            nearer = f"views from nearer (--mounted-fill {NEAR[0]} {NEAR[1]}), " if is_far else ""
            yield (
                "note: on the object the patch is not shown to do better than grey paper: before you print it, try "
                f"{nearer}a larger sheet or another place ('toolkit place'), more --steps, or paint all of the object "
                "('toolkit train-texture')"
            )


def train_patch(
    config: PatchConfig, class_name: str | int, networks: Sequence[Network], data: DataConfig | TrainingData,
    workspace: Workspace, *, name: str | None = None, views: MountedViews | None = None, out: Path | None = None,
    restart: bool = False, checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> TrainedPatch:  # fmt: skip
    """Train a patch, or take it up where an interrupted run of the same settings left it.

    Args:
        config: every setting, see `make_config` and `RECIPES`.
        class_name: a label of the networks, an index, or a WordNet id.
        networks: at least one network; the labels and preprocessing of the first lead.
        data: which images, or images that are in memory already.
        workspace: whose folders and objects are used.
        name: of the patch's files; by default from the label.
        views: with the patch's place in them, instead of renders of an object.
        out: folder for the patch instead of the workspace's.
        restart: forget what an earlier run left.
        checkpoint_every_s: how much work a kill may cost.

    Raises:
        ToolkitError: the settings, the data or a checkpoint cannot be used, or the disk is full.
    """
    config, targets = meet_networks(config, networks, class_name)
    # the first network leads: its labels name the class, its crop bounds the patch
    first, index = targets[0].classifier, targets[0].class_index
    if is_detector_target(targets[0]):
        config = config.model_copy(update={"mounted_share": 1.0})
    check_size(config.size_px, first.preprocessing.crop_px)
    # files and data: names from the label, images of the class from the sources
    name = name_files(name, targets[0].label, index)
    files = choose_files(workspace, out, name)
    class_names = names_of_class(first, index, str(class_name))
    rig_source = data.rig_source if isinstance(data, DataConfig) else None
    if isinstance(data, DataConfig):
        data = load_data(data, class_names, first.preprocessing, workspace, files.training)
        describe_data(data)
    config = config.count_steps(len(data.train))
    seen_world = None
    has_detectors = any(map(is_detector_target, targets))
    # views with the patch in place, as given or rendered now; some settings need the object itself
    if views is not None:
        of_object = (config.weather, config.world, config.lost_weight > 1, config.margin != "white")
        if has_detectors or any(of_object):
            needs = (
                "detectors, {weather}, {world}, {lost_weight} and {margin} need the object itself: add {sources} rig"
            )
            raise FieldError(needs, {})
    else:
        if has_detectors and not config.mounted_share:
            needs = "detectors need views of the object: add {sources} rig, and {mounted_share} above 0"
            raise FieldError(needs, {})
        with_bare = needs_unmodified(config, targets)
        views, seen_world = _render_views(config, workspace, rig_source, class_names, first, data, with_bare)
    task = PatchTask(config, targets, data, views, files, seen_world)
    return train_booster(task, restart=restart, checkpoint_every_s=checkpoint_every_s, shared=RENDERS)


def hash_patch(
    config: PatchConfig, class_name: str | int, networks: Sequence[Network], data: TrainingData, name: str
) -> str:
    """Key of a patch that is trained on images in memory alone."""
    config, targets = meet_networks(config, networks, class_name)
    config = config.count_steps(len(data.train))
    return PATCHES.key(*list_patch_inputs(config, name, list_networks(targets), data.sha256))


def choose_files(workspace: Workspace, out: Path | None, name: str) -> BoosterFiles:
    """The workspace's own folders, or below `out`. Previews never lie among the patches: each PNG there is a patch."""
    patches = workspace.patches_dir if out is None else Path(out)
    previews = workspace.print_dir / "previews" if out is None else patches / "previews"
    return BoosterFiles(patches / f"{name}.png", previews / f"{name}.png", patches / ".training" / name)


def _render_views(
    config: PatchConfig, workspace: Workspace, rig_source: str | None, class_names: frozenset[str], network: Network,
    data: TrainingData, with_bare: bool,
) -> tuple[MountedViews | None, dict[str, Any] | None]:  # fmt: skip
    """Views of the object with its sheets, where any are wanted, and where in a world they were taken."""
    if not config.mounted_share:
        if config.weather is not None or config.world is not None:
            needs = "{weather} and {world} need the object itself: add {sources} rig, {mounted_share} above 0"
            raise FieldError(needs, {})
        return None, None
    # views of the object are shared out with flat placements, and need an object
    if rig_source is None:
        found = {"mounted_share": config.mounted_share}
        raise FieldError("needs the object in the rig: add {sources} rig, or set it to 0", found)
    # the object, with sheets of the size at which the patch is printed
    object_name = choose_object(workspace, rig_source, class_names)
    # in a world the object has its real size, and cameras look from lower down
    ranges, setting, seen = ViewRanges(fill=config.mounted_fill), config.open_world(workspace), None
    item = load_object(workspace.object_spec(object_name))
    spec = item.spec if config.size_mm is None else item.spec.with_patch_size(config.size_mm)
    sizes_mm = spec.sizes_mm(printed_size_mm(config.size_px))
    if setting is not None:
        subject = make_sheet_subject(item, sizes_mm, config.size_px, at_real_size=True, margin=config.margin)
        meshes = [subject.mesh]
        seen = setting.record(meshes)
        notice(f"world: {setting.describe(meshes)}")
        ranges = replace(ranges, elevation_deg=WORLD_ELEVATION_DEG)
    # weather acts over metres: the rig's millimetres are converted, a world has metres already
    with_depth = config.weather is not None
    metres_per_unit = item.spec.metres_per_mm if with_depth and setting is None else 1.0
    views = render_mounted_views(
        item, sizes_mm, config.size_px, config.mounted_views,
        seed=data.record["seed"], image_px=network.preprocessing.resize_px,
        ranges=ranges, with_depth=with_depth, with_bare=with_bare, setting=setting,
        margin=config.margin,
    )  # fmt: skip
    return stack_views(views, sizes_mm, network.device, metres_per_unit, config.margin), seen


class PatchTask(BoosterTask[TrainedPatch]):
    """Algorithm 1: a patch in random placements goes down the loss of recognising its class.

    Detectors are shown the object with its sheet alone, whose box is known; their loss is that of the object's place
    (Angelic Patches, 2023).
    """

    work = PATCHES

    def __init__(
        self, config: PatchConfig, targets: list[Target], data: TrainingData, views: MountedViews | None,
        files: BoosterFiles, seen_world: dict[str, Any] | None = None,
    ) -> None:  # fmt: skip
        """Prepare the images.

        Args:
            config, targets, files: see `BoosterTask`.
            data: images to train and to validate on.
            views: of the object with its sheet mounted on it, a part of them held out; None where none are wanted.
            seen_world: for the record, where in a world the views of the object were taken.
        """
        super().__init__(config, config.size_px, targets, files)
        self.config, self._data, self._seen_world = config, data, seen_world
        self.title = f"Training {targets[0].label}"
        self._appearance, self._penalty = config.appearance(), config.penalty()
        # all images lie on the device: a step only cuts them
        self._images = stack_on_device(data.train, self._device)
        self._views: MountedViews | None = None
        self._held_out_views: MountedViews | None = None
        self._views_sha256 = "" if views is None else views.sha256
        if views is not None:
            self._views, self._held_out_views = views.divide()

    def list_inputs(self) -> list[Any]:
        """See `list_patch_inputs`."""
        data_sha256 = self._data.sha256 + self._views_sha256
        return list_patch_inputs(self.config, self.files.png.stem, list_networks(self.targets), data_sha256)

    @property
    def _device(self) -> str:
        return self.targets[0].classifier.device

    def describe(self) -> list[str]:
        """What is trained, and how the networks know the object before there is a patch."""
        lines, views = introduce("patch", self.config, self.config.size_px, self.targets), self._held_out_views
        if views is None:
            return lines
        # grey paper shows what the sheet alone does
        (known,) = recognise_mounted([grey_paper(self.pixels)], views, self.targets, self.image_px)
        pairs = zip(self.targets, known, strict=True)
        before = [f"{target.classifier.name} {share.hits} of {share.n} held-out views" for target, share in pairs]
        lines.append(f"correct before training, with grey paper on the object: {list_some(before, MOST_NAMED)}")
        return lines if any(share.hits for share in known) else [*lines, UNKNOWN]

    def find_finished(self) -> TrainedPatch | None:
        """The patch, where its files are whole and of the same inputs."""
        patch = read_finished(read_patch, self.files, self.key)
        return None if patch is None else TrainedPatch(patch=patch, files=self.files, skipped=self._data.skipped)

    def loss(self, step: int) -> tuple[torch.Tensor, dict[str, float]]:
        """The networks' losses of photographs with the patch, and the patch's own losses."""
        config, draws, theta = self.config, Draws(self.config.seed, step), self.pixels
        asked = choose_targets(self.targets, config, step)
        # pictures in which the patch is pasted flat, and views of the object with its sheet; detectors see views alone
        share = 1.0 if is_detector_target(asked[0]) else config.mounted_share
        count = 0 if self._views is None else round(config.batch * share)
        batch = draw_batch(self._images, draws.of("images"), config.batch - count, self.image_px)
        views = self._views if count else None
        drawn = None if views is None else draw_mounted(views, draws, count, self.image_px, config.weather)
        # the same photographs without the booster: grey paper for mixed features, the unmodified object for lost
        # answers
        clean, unmodified = None, None
        with torch.no_grad():
            if config.feature_mixup is not None:
                clean = show_patch(grey_paper(theta), batch, self._appearance, draws, drawn)
            if needs_unmodified(config, asked):
                scenes = [batch] if drawn is None else [batch, drawn.show_bare(theta)]
                unmodified = take_photos(torch.cat(scenes), self._appearance, draws)
        judge: Judge = partial(judge_ensemble, config=config, draws=draws, clean=clean, unmodified=unmodified)
        if drawn is not None and is_detector_target(asked[0]):
            judge = partial(judge_detectors, boxes=drawn.boxes, unmodified=unmodified, lost_weight=config.lost_weight)
        else:
            asked = self.targets
        loss, recognised = patch_loss(
            theta, batch, asked, self._appearance, draws, mounted=drawn, penalty=self._penalty, judge=judge
        )
        return loss, {"accuracy": recognised}

    def finish(self, history: History) -> TrainedPatch:
        """Validate the rounded patch, draw the preview, and last, as the mark that all is done, write patch and record.

        Results under the corruptions of the training are in the record alone.
        """
        config, pixels, data = self.config, quantise(self.pixels), self._data
        printed = from_picture(pixels, self._device)
        # on held-out photographs: as printed, without the corruptions of the training
        held_out = stack_on_device(data.held_out, self._device)
        clear = config.model_copy(update={"corrupted": None, "cutout": None}).appearance()
        with progress("Validating", count_placements(len(held_out))) as bar:
            validations = validate_patch(printed, held_out, self.targets, clear, config.seed, advance=bar.advance)
        # again with every photograph corrupted, if the training had corruptions
        corrupted: list[Validation] = []
        if config.corrupted is not None:
            always = config.corrupted.with_overrides(probability=1.0)
            corrupted = validate_patch(printed, held_out, self.targets, clear, config.seed, corrupted=always)
        # mounted on the object: in clear conditions, then in weather
        views = self._held_out_views
        on_object = [] if views is None else validate_mounted(printed, views, self.targets, self.image_px)
        weathered: list[Validation] = []
        if views is not None and config.weather is not None:
            weathered = validate_mounted(
                printed, views, self.targets, self.image_px, weather=config.weather, seed=config.seed
            )
        self._draw_preview(printed, pixels, validations)
        # the record: what was seen, how well it is recognised, at which size it is printed
        seen: dict[str, Any] = {} if views is None else {"mounted_views_sha256": views.sha256}
        if views is not None and len(views.sizes_mm) > 1:
            seen["sheets_mm"] = list(views.sizes_mm)
        if self._seen_world is not None:
            seen["world"] = self._seen_world
        record = self.record(
            history, data.record | seen, config.record() | {"image_px": self.image_px}, asdict(score_print(pixels)),
            {"held_out": validations, "mounted": on_object, "corrupted": corrupted, "mounted_weather": weathered},
        )  # fmt: skip
        size_mm = config.size_mm if views is None else views.sizes_mm[0]
        sized = {"margin": config.margin} | ({} if size_mm is None else {"size_mm": round(size_mm, 3)})
        patch = write_patch(self.files.png.parent, pixels, record | sized)
        return TrainedPatch(
            patch=patch, files=self.files, validations=validations, on_object=on_object, skipped=data.skipped,
            corrupted=corrupted, in_weather=weathered,
        )  # fmt: skip

    def _draw_preview(self, printed: torch.Tensor, pixels: np.ndarray, validations: list[Validation]) -> None:
        """Sixteen training images; they repeat, in other placements, where there are fewer."""
        config, where = self.config, "held-out" if self._data.is_held_out else "training"
        answers = [
            f"{a.network}, {where} images: {a.patched.value:.0%} with patch, {a.bare.value:.0%} without"
            for a in validations
        ]
        size = f"{config.size_px} x {config.size_px} px, {config.steps} steps, seed {config.seed}"
        lines = [size, *answers[:3], "Below: training images, new placements, the network's first answer"]
        with torch.inference_mode():
            # new placements, drawn apart from those of the training
            images = self._images[: COLUMNS * ROWS]
            which = torch.arange(COLUMNS * ROWS, device=images.device) % len(images)
            centres = cut_centres(images, self.image_px)[which]
            photos = show_patch(printed, centres, self._appearance, Draws(config.seed, 0, "preview"))
        sheet = draw_patch_preview(pixels, photos, self.targets[0], self.targets[0].label, lines)
        write_preview(self.files.preview, sheet)


def patch_loss(
    theta: torch.Tensor, images: torch.Tensor, targets: list[Target], appearance: Appearance, draws: Draws, *,
    mounted: Mounted | None = None, penalty: "Penalty | None" = None, judge: "Judge" = judge_photos,
) -> tuple[torch.Tensor, float]:  # fmt: skip
    """The loss of a patch in a batch, a scalar, and the share recognised.

    Args:
        theta: θ, (3, n, n) sRGB-encoded in [0, 1].
        images: (b, 3, m, m) sRGB-encoded in [0, 1], in which it is placed.
        targets: the networks.
        appearance: what happens to the patch.
        draws: of this step.
        mounted: photographs of the object that wait for the patch on it; they join the batch.
        penalty: a loss of the patch itself, added to the networks'.
        judge: what the networks say; by default their cross-entropies, mean over the batch, are summed.
    """
    loss, recognised = judge(show_patch(theta, images, appearance, draws, mounted), targets)
    return (loss if penalty is None else loss + penalty(theta)), recognised
