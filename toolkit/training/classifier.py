"""Train a classifier from request to files: what `toolkit train-classifier` runs."""

import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit import __version__
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, sha256_bytes, sha256_file, write_bytes, write_json
from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import Workspace
from toolkit.corruptions.draws import image_seed
from toolkit.models.architectures import build_network
from toolkit.models.find import ClassifierRecord, ClassShare, HeldOut
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier, choose_device
from toolkit.models.precision import choose_precision
from toolkit.models.weights import WeightsFile, find_weights
from toolkit.training.classifier_config import ClassifierRequest, Lay, check_fit, hash_inputs
from toolkit.training.classifier_steps import (
    Checkpoint,
    Fit,
    are_folded,
    load_tensors,
    read_checkpoint,
    start_network,
    write_checkpoint,
)
from toolkit.training.data import (
    Pack,
    RenderCounts,
    Source,
    TrainingClasses,
    TrainingSet,
    keep_classes,
    list_classes,
    load_training_set,
    open_source,
    store_preprocessing,
)

if TYPE_CHECKING:
    import torch

TEST_BATCH = 64
MOST_CONFUSIONS = 12
RECENT = 50
"""Steps whose mean is shown and recorded: one batch alone is noise."""


def halve_weights(state: dict[str, "torch.Tensor"]) -> dict[str, "torch.Tensor"]:
    """Half precision, but for whole numbers and for tensors that would leave its range."""
    halved = {}
    for name, value in state.items():
        half = value.detach().cpu().half() if value.is_floating_point() else value.detach().cpu()
        fits = bool(half.isfinite().all()) if half.is_floating_point() else True
        halved[name] = (half if fits else value.detach().cpu()).contiguous()
    return halved


def write_classifier(
    request: ClassifierRequest, data: TrainingSet, lay: Lay | None, state: dict[str, Any], words: tuple[str, str],
    final: dict[str, float], more_settings: dict[str, Any], folder: Path, module: Any, device: str, quiet: bool,
) -> ClassifierRecord:  # fmt: skip
    """Test the rounded weights on the held-out images and write `NAME.safetensors`, then `NAME.json`.

    Args:
        request: what was trained.
        data: on what.
        lay: what the images carry.
        state: the trained network's tensors.
        words: what it was trained on, and how the held-out images differ, in a few words each.
        final: end of the history.
        more_settings: what is recorded beside the request: precision, and the hash of the inputs.
        folder: where to.
        module: the network, which is left with the rounded weights, in eval mode.
        device: where it runs.
        quiet: no progress bar.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    from safetensors.torch import save

    halved = halve_weights(state)
    content = save(halved)
    load_tensors(module, halved)
    module.eval()
    file = folder / f"{request.name}.safetensors"
    weights = WeightsFile(file, sha256_bytes(content), file.name)
    how, labels = request.preprocessing(), list(data.labels)
    classifier = Classifier(request.arch, module, labels, how, weights, device, False, request.name)
    record = ClassifierRecord(
        name=request.name, arch=request.arch, trained_on=words[0], labels=labels, resize_px=how.resize_px,
        crop_px=how.crop_px, mean=how.mean, std=how.std, filter_name=how.filter_name, data=data.record,
        seed=request.recipe.seed, settings=request.settings() | more_settings, final=final,
        held_out=measure_held_out(classifier, data.held_out, lay, request.recipe.seed, words[1], quiet),
        sha256=weights.sha256, toolkit_version=__version__,
    )  # fmt: skip
    write_bytes(file, content)
    write_json(folder / f"{request.name}.json", record.model_dump(mode="json"))
    return record


def measure_held_out(classifier: Classifier, pack: Pack, lay: Lay | None, seed: int, what: str, quiet: bool) -> HeldOut:
    """Classify the held-out images through the classifier's own preprocessing, in single precision.

    What they carry lies where their number and the seed say.
    """
    import torch

    answers = np.zeros(len(pack.images), np.int64)
    with progress("Testing on held-out images", len(pack.images), quiet) as bar, torch.no_grad():
        for start in range(0, len(pack.images), TEST_BATCH):
            part = slice(start, start + TEST_BATCH)
            images = pack.images[part]
            batch = torch.stack([classifier.preprocess(image) for image in images])
            if lay is not None:
                seeds = [image_seed(seed, f"held-out/{start + k}") for k in range(len(images))]
                batch = lay(batch.to(classifier.device), pack.classes[part], seeds)
            answers[part] = classifier.logits(batch).argmax(1).cpu().numpy()
            bar.advance(len(images))
    return summarise_answers(classifier.labels, pack.classes, answers, what)


def summarise_answers(labels: list[str], truth: np.ndarray, answers: np.ndarray, what: str) -> HeldOut:
    """Accuracy overall and by class, and the commonest mistakes, of class numbers (n,) and (n,)."""
    right = truth == answers
    per_class = {
        label: ClassShare(n=int((truth == k).sum()), correct=int(right[truth == k].sum()))
        for k, label in enumerate(labels)
    }
    wrong = Counter(zip(truth[~right].tolist(), answers[~right].tolist(), strict=True))
    commonest = sorted(wrong.items(), key=lambda one: (-one[1], one[0]))[:MOST_CONFUSIONS]
    n, correct = len(truth), int(right.sum())
    return HeldOut(
        n=n,
        correct=correct,
        accuracy=correct / n if n else None,
        ci95=wilson_interval(correct, n),
        per_class=per_class,
        confusions=[(labels[true], labels[answer], count) for (true, answer), count in commonest],
        what=what,
    )


def summarise_history(losses: list[float], accuracies: list[float]) -> dict[str, float]:
    """Mean loss and accuracy of the last steps, on augmented training images."""
    return {"loss": float(np.mean(losses[-RECENT:])), "accuracy": float(np.mean(accuracies[-RECENT:]))}


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
