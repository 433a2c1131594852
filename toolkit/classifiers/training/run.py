"""Train a classifier from request to files: what `toolkit train-classifier` runs."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

from toolkit.classifiers.architectures import build_network
from toolkit.classifiers.network import choose_device, load_classifier
from toolkit.classifiers.record import ClassifierRecord
from toolkit.classifiers.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from toolkit.classifiers.training.classes import TrainingClasses, keep_classes, list_classes
from toolkit.classifiers.training.data import TrainingSet, load_training_set, store_preprocessing
from toolkit.classifiers.training.finish import RECENT, summarise_history, write_classifier
from toolkit.classifiers.training.fit import Fit
from toolkit.classifiers.training.half_precision import choose_precision
from toolkit.classifiers.training.norms import are_folded
from toolkit.classifiers.training.overlay import Lay
from toolkit.classifiers.training.request import ClassifierRequest, check_fit, hash_inputs
from toolkit.classifiers.training.sources import RenderCounts, Source, open_source
from toolkit.classifiers.training.start import start_network
from toolkit.classifiers.weights import WeightsFile, find_weights
from toolkit.console import progress
from toolkit.errors import ToolkitError
from toolkit.files import read_json, sha256_file
from toolkit.workspace import Workspace

CHECKPOINT_EVERY_S = 30.0


@dataclass(frozen=True)
class TrainedClassifier:
    """What a run made.

    Attributes:
        file: the weights; the record lies beside them.
        record: how they came to be.
        skipped: (path, reason) of images that could not be used.
        resumed_from: steps that an earlier run had made.
        was_finished: whether there was nothing left to do.
    """

    file: Path
    record: ClassifierRecord
    skipped: tuple[tuple[str, str], ...]
    resumed_from: int
    was_finished: bool


@dataclass(frozen=True)
class RunOptions:
    """What does not decide the result: device, processes, and what is shown and kept.

    Attributes:
        out: folder for the classifier instead of the workspace's `rig/classifiers`.
        device: `auto`, `cpu` or `cuda`.
        workers: processes that render.
        download: fetch CIFAR-10 where it is named and not there.
        restart: forget what an earlier run left.
        keep_data: keep the rendered and decoded images afterwards, for another training.
        quiet: no progress bars.
        checkpoint_every_s: how much work a kill may cost.
    """

    out: Path | None = None
    device: str = "auto"
    workers: int = 1
    download: bool = False
    restart: bool = False
    keep_data: bool = False
    quiet: bool = False
    checkpoint_every_s: float = CHECKPOINT_EVERY_S


def train_classifier(
    request: ClassifierRequest,
    workspace: Workspace,
    options: RunOptions | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> TrainedClassifier:
    """Train a classifier, or take it up where an interrupted run of the same request left it.

    Args:
        request: what to train.
        workspace: whose objects are rendered and whose `rig/classifiers` is written.
        options: where and how it runs.
        say: told what the user should know along the way.

    Raises:
        ToolkitError: the request, the data or a checkpoint cannot be used, or the disk is full.
    """
    options = options or RunOptions()
    device = choose_device(options.device)
    folder = options.out or workspace.classifiers_dir
    training = folder / ".training" / request.name
    if options.restart:
        shutil.rmtree(training, ignore_errors=True)
    init = None if request.init is None else find_weights(request.arch, request.init)
    sources = _open_sources(request, workspace, options.download)
    classes = _choose_classes(request, sources)
    check_fit(request.arch, len(classes.labels), request.image_px)
    overlay = request.overlay
    lay = None if overlay is None else overlay.fit(classes.labels, classes.used, request.image_px)
    stored = store_preprocessing(request.preprocessing(), request.stored_px)
    data = load_training_set(sources, classes, stored, training, options.workers, options.quiet)
    _describe_data(data, sources, say)
    key = hash_inputs(request, data.labels, data.train.sha256, "" if init is None else init.sha256)
    file = folder / f"{request.name}.safetensors"
    if not options.restart and (record := find_finished(file, key)) is not None:
        _clear(training, options.keep_data)
        return TrainedClassifier(file, record, data.skipped, 0, True)
    precision = choose_precision(request.arch, request.image_px, device)
    fit, resumed_from, losses, accuracies = _fit(
        request, data, lay, init, key, training, device, precision, options, say
    )  # fmt: skip
    record = write_classifier(
        request, data, lay, fit.module.state_dict(), _say_data(request, sources, init),
        summarise_history(losses, accuracies), {"precision": precision, "inputs_sha256": key}, folder, fit.module,
        device, options.quiet,
    )  # fmt: skip
    _clear(training, options.keep_data)
    return TrainedClassifier(file, record, data.skipped, resumed_from, False)


def find_finished(file: Path, inputs_sha256: str) -> ClassifierRecord | None:
    """The record of a classifier that was trained with these inputs before and is whole; else None."""
    if not (file.is_file() and file.with_suffix(".json").is_file()):
        return None
    try:
        record = read_json(file.with_suffix(".json"), ClassifierRecord)
    except ToolkitError:
        return None  # another kind of labels file, or of another version: it is replaced
    same = record.settings.get("inputs_sha256") == inputs_sha256 and record.sha256 == sha256_file(file)
    return record if same else None


def _open_sources(request: ClassifierRequest, workspace: Workspace, download: bool) -> list[Source]:
    counts = RenderCounts(
        request.per_class, request.views, request.held_out, request.recipe.seed, request.stored_px
    )  # fmt: skip
    if not request.data:
        raise ToolkitError(
            "no --data: expected 'everyday', 'rig', cifar10:FOLDER, or a folder with one folder per class"
        )
    return [open_source(data, workspace, counts, download) for data in dict.fromkeys(request.data)]


def _choose_classes(request: ClassifierRequest, sources: list[Source]) -> TrainingClasses:
    if request.keep_labels:
        return keep_classes(sources, load_classifier(request.arch, request.init, "cpu"))
    return list_classes(sources)


def _describe_data(data: TrainingSet, sources: list[Source], say: Callable[[str], None]) -> None:
    for source in sources:
        say(f"data: {source.words}")
    say(
        f"data: {len(data.train.images)} images of {len(data.labels)} classes to train on, "
        f"{len(data.held_out.images)} held out ({'; '.join(dict.fromkeys(s.held_out_words for s in sources))})"
    )


def _say_data(request: ClassifierRequest, sources: list[Source], init: WeightsFile | None) -> tuple[str, str]:
    words = " and ".join(source.words for source in sources)
    held_out = "; ".join(dict.fromkeys(source.held_out_words for source in sources))
    if request.overlay is not None:
        words, held_out = (f"{each}, each with {request.overlay.words}" for each in (words, held_out))
    if request.recipe.corrupting is not None:
        words += f", {request.recipe.corrupting.share:.0%} of them corrupted"
    return words + (f", from the weights {init.name}" if init else ""), held_out


def _fit(
    request: ClassifierRequest, data: TrainingSet, lay: Lay | None, init: WeightsFile | None, key: str, training: Path,
    device: str, precision: str, options: RunOptions, say: Callable[[str], None],
) -> tuple[Fit, int, list[float], list[float]]:  # fmt: skip
    """Make the steps that are left; a checkpoint is written every half minute and at the end.

    Not on Ctrl-C: it may come in the middle of a step, when half of the weights have moved.
    """
    recipe = request.recipe
    checkpoint_file = training / f"{key[:16]}.safetensors"
    state = read_checkpoint(checkpoint_file, key)
    module = build_network(request.arch, len(data.labels)) if state else start_network(request, len(data.labels), init)
    fit = Fit(module, recipe, device, request.preprocessing(), precision, lay)
    losses: list[float] = []
    accuracies: list[float] = []
    if state is not None:
        fit.load(state.tensors)
        losses, accuracies = list(state.losses), list(state.accuracies)
    elif init is not None and are_folded(fit.module):
        say(f"the batch normalisation of {init.name} is folded for evaluation: measuring its statistics again")
        fit.unfold(data.train.images, data.train.classes)
    start, steps = len(losses), recipe.count_steps(len(data.train.images))
    if start:
        say(f"going on after step {start} of {steps}; --restart begins anew")
    written, saved = monotonic(), start

    def save() -> None:
        write_checkpoint(checkpoint_file, Checkpoint(key, fit.state(), tuple(losses), tuple(accuracies)))

    with progress(
        f"Training {request.name} ({steps} steps)", steps * recipe.batch, options.quiet, start * recipe.batch
    ) as bar:
        for step in fit.run(data.train.images, data.train.classes, start):
            losses.append(step.loss)
            accuracies.append(step.accuracy)
            recent = slice(-RECENT, None)
            mean_loss, mean_accuracy = _mean(losses[recent]), _mean(accuracies[recent])
            bar.advance(recipe.batch, f"loss {mean_loss:.2f}  recognised {mean_accuracy:.0%}")
            if monotonic() - written >= options.checkpoint_every_s:
                save()
                written, saved = monotonic(), len(losses)
    if saved < len(losses):
        save()
    return fit, start, losses, accuracies


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def _clear(training: Path, keep_data: bool) -> None:
    """Forget the checkpoints of a finished run, and its images unless they shall be kept."""
    if not keep_data:
        shutil.rmtree(training, ignore_errors=True)
    for pattern in ("*.safetensors", ".*.partial"):
        for file in training.glob(pattern):
            file.unlink(missing_ok=True)
    parent: Any = training.parent
    if parent.is_dir() and not any(parent.iterdir()):
        parent.rmdir()
