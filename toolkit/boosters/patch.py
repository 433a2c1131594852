"""Train a patch from request to files: what `toolkit train-patch` runs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from toolkit.boosters.data import TrainingData, choose_object, is_rig_source, load_data, names_of_class
from toolkit.boosters.mounted import MountedViews, load_mounted_views
from toolkit.boosters.patch_config import PatchRequest, check_size, hash_inputs, name_files
from toolkit.boosters.patch_finish import PatchFiles, finish_patch
from toolkit.boosters.patch_loop import CHECKPOINT_EVERY_S, make_steps, read_checkpoint
from toolkit.boosters.patch_recipes import list_settings
from toolkit.boosters.patch_steps import Target
from toolkit.boosters.validation import Validation
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.records import Patch, printed_size_mm, read_patch
from toolkit.rig.views import ViewRanges
from toolkit.training.checkpoint import forget_run, say_start

FEW_IMAGES = 32
RENDERS = ("renders-*.npy", ".renders-*.partial")
"""Files beside the checkpoints that other runs may need."""


@dataclass(frozen=True)
class TrainedPatch:
    """What a run made.

    Attributes:
        patch: pixels and record.
        files: where it lies.
        validations: per network; empty when the patch was finished before.
        on_object: per network, on held-out views of the object: with the patch, and with grey paper for `bare`.
        skipped: (path, reason) of training images that could not be used.
        resumed_from: steps that an earlier run had made; all of them when the patch was finished before.
        was_finished: whether there was nothing left to do.
    """

    patch: Patch
    files: PatchFiles
    validations: list[Validation]
    on_object: list[Validation]
    skipped: tuple[tuple[str, str], ...]
    resumed_from: int
    was_finished: bool


def choose_files(workspace: Workspace, out: Path | None, name: str) -> PatchFiles:
    """The workspace's own folders, or below `out`. Previews never lie among the patches: each PNG there is a patch."""
    patches = workspace.patches_dir if out is None else Path(out)
    previews = workspace.print_dir / "previews" if out is None else patches / "previews"
    return PatchFiles(patches / f"{name}.png", previews / f"{name}.png", patches / ".training" / name)


def train_patch(
    request: PatchRequest,
    classifiers: list,
    workspace: Workspace,
    out: Path | None = None,
    restart: bool = False,
    quiet: bool = False,
    say: Callable[[str], None] = lambda line: None,
    checkpoint_every_s: float = CHECKPOINT_EVERY_S,
    data: TrainingData | None = None,
) -> TrainedPatch:
    """Train a patch, or take it up where an interrupted run of the same request left it.

    Args:
        request: what to train.
        classifiers: the networks, at least one; the first one's labels and preprocessing lead.
        workspace: whose folders and objects are used.
        out: folder for the patch instead of the workspace's.
        restart: forget what an earlier run left.
        quiet: no progress bars.
        say: told what the user should know along the way.
        checkpoint_every_s: how much work a kill may cost.
        data: images that are in memory already, instead of those that the request names.

    Raises:
        ToolkitError: the request, the data or a checkpoint cannot be used, or the disk is full.
    """
    targets = [Target(classifier, classifier.class_index(request.class_name)) for classifier in classifiers]
    first, index = classifiers[0], targets[0].class_index
    check_size(request.size_px, first.preprocessing.crop_px)
    name = name_files(request.name, first.labels[index], index)
    files = choose_files(workspace, out, name)
    class_names = names_of_class(first, index, str(request.class_name))
    if data is None:
        data = load_data(request.data, class_names, first.preprocessing, workspace, files.training, quiet)
        _describe_data(data, say)
    request = request.count_steps(len(data.train))
    views = _load_views(request, workspace, class_names, first, quiet)
    key = hash_inputs(request, name, targets, data.sha256 + ("" if views is None else views.sha256))
    checkpoint_file = files.training / f"{key[:16]}.safetensors"
    if restart:
        checkpoint_file.unlink(missing_ok=True)
    elif (finished := _find_finished(files, key)) is not None:
        forget_run(files.training, key, RENDERS)
        return TrainedPatch(finished, files, [], [], data.skipped, request.descent.steps, True)

    for line in list_settings(request, [classifier.name for classifier in classifiers]):
        say(line)
    state = read_checkpoint(checkpoint_file, key)
    resumed_from = 0 if state is None else state.done
    say_start(say, resumed_from, request.descent.steps, files.training)
    train_views, held_out_views = (None, None) if views is None else views.divide()
    state = make_steps(
        request, targets, data.train, state, key, checkpoint_file, checkpoint_every_s, quiet, train_views
    )  # fmt: skip
    patch, validations, on_object = finish_patch(request, targets, data, state, files, quiet, held_out_views)
    forget_run(files.training, key, RENDERS)
    return TrainedPatch(patch, files, validations, on_object, data.skipped, resumed_from, False)


def _load_views(request: PatchRequest, workspace: Workspace, names, classifier, quiet: bool) -> MountedViews | None:
    """Views of the object with its sheet, for the first `rig` source; None where none are wanted."""
    if not request.mounted_share:
        return None
    source = next((source for source in request.data.sources if is_rig_source(source)), None)
    if source is None:
        raise ToolkitError("--mounted-share needs the object in the rig: add --data rig, or set it to 0")
    return load_mounted_views(
        workspace, choose_object(workspace, source, names), printed_size_mm(request.size_px), request.size_px,
        request.mounted_views, seed=request.data.seed, image_px=classifier.preprocessing.resize_px,
        device=classifier.device, quiet=quiet, ranges=ViewRanges(fill=request.mounted_fill),
    )  # fmt: skip


def _describe_data(data: TrainingData, say: Callable[[str], None]) -> None:
    for source in data.record["sources"]:
        what = "of the class" if source["use"] == "class" else "as backgrounds, whatever they show"
        say(f"data: {source['used']} of {source['found']} images from {source['source']}, {what}")
    if not data.is_held_out:
        say("data: one image is too few to hold any out: it is trained on and validated on")
    elif len(data.train) < FEW_IMAGES and any(source["use"] == "class" for source in data.record["sources"]):
        say(f"data: {len(data.train)} images to train on are few: --backgrounds all takes every image")


def _find_finished(files: PatchFiles, key: str) -> Patch | None:
    if not (files.png.is_file() and files.preview.is_file()):
        return None
    try:
        patch = read_patch(files.png)
    except ToolkitError:
        return None  # a kill between picture and record leaves a pair that does not match; it is written again
    return patch if patch.record.settings.get("inputs_sha256") == key else None
