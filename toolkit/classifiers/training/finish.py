"""From the last step to files: round the weights as they are written, test those, and write them with their record."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit import __version__
from toolkit.classifiers.network import Classifier
from toolkit.classifiers.record import ClassifierRecord, ClassShare, HeldOut
from toolkit.classifiers.training.data import Pack, TrainingSet
from toolkit.classifiers.training.overlay import Lay
from toolkit.classifiers.training.request import ClassifierRequest
from toolkit.classifiers.training.start import load_tensors
from toolkit.classifiers.weights import WeightsFile
from toolkit.console import progress
from toolkit.corruptions.draws import image_seed
from toolkit.files import sha256_bytes, write_bytes, write_json
from toolkit.statistics import wilson_interval

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
