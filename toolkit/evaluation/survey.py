"""Which classifiers are at hand: what each can do, how good it is on a folder, and how fast here."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import torch

from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.statistics import wilson_interval
from toolkit.core.threads import map_ahead
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.models.architectures import list_architectures
from toolkit.models.detector import Detector
from toolkit.models.find import BUNDLED_DIR, list_own, may_be_detector
from toolkit.models.labels import read_labels_file
from toolkit.models.load import bundled_file, load_classifier
from toolkit.models.load_detector import is_detector, load_detector
from toolkit.models.network import Classifier
from toolkit.models.predict import predict_stream
from toolkit.models.weights import cache_dir, find_local
from toolkit.training.images import open_images

SPEED_S = 1.0
BATCH = 8
OWN_LICENCE = "MIT"
TORCHVISION_LICENCE = "BSD-3-Clause (torchvision)"


@dataclass(frozen=True)
class SurveyedModel:
    """One row of the survey.

    Attributes:
        model: how it is named to every command.
        kind: `classifier` or `detector`.
        weights: name of its file.
        classes: how many.
        image_px: side of what it sees.
        parameters: how many numbers it has; None where its file does not show them.
        licence: as far as it is said; else empty.
        can_train: whether boosters can be trained against it.
        why_not: why it cannot, or could not be loaded; else empty.
        images_per_s: forward, in batches of 8; None if not timed.
        trained_images_per_s: forward and back to the image; None if not timed.
        n, correct: images of the folder; None without a folder, or where its classes are others.
        accuracy, ci95: their ratio, with Wilson's interval.
    """

    model: str
    weights: str = ""
    kind: str = "classifier"
    classes: int | None = None
    image_px: int | None = None
    parameters: int | None = None
    licence: str = ""
    can_train: bool = False
    why_not: str = ""
    images_per_s: float | None = None
    trained_images_per_s: float | None = None
    n: int | None = None
    correct: int | None = None
    accuracy: float | None = None
    ci95: tuple[float, float] | None = None


def list_models(folder: Path | None = None) -> list[str]:
    """Names of the classifiers whose weights are on this machine: user's own, bundled, torchvision's.

    A file whose name would mean something else, such as code, is named by its path.

    Args:
        folder: the workspace's `rig/classifiers`.
    """
    published = [name for name in list_architectures() if find_local(name) is not None]
    own = [str(file.absolute()) if ":" in name else name for name, file in list_own(folder).items()]
    return [*own, *published]


def survey_models(
    models: Sequence[str], device: str = "auto", folder: Path | None = None, data: str | None = None,
    with_speed: bool = False,
) -> list[SurveyedModel]:  # fmt: skip
    """Load each network, and where asked time it and count what it gets right.

    One that cannot be loaded is a row that says why.

    Args:
        models: names, see `load_classifier`.
        device: `auto`, `cpu` or `cuda`.
        folder: the workspace's `rig/classifiers`.
        data: folder with a folder per class (its val/ or test/, if it exists); None: no accuracy.
        with_speed: whether to time each, some seconds a network.
    """
    rows = []
    with progress("networks", len(models)) as ticker:
        for model in models:
            try:
                if may_be_detector(model) and is_detector(model):
                    rows.append(_survey_detector(model, load_detector(model, None, device), with_speed))
                else:
                    rows.append(_survey(model, load_classifier(model, None, device, folder), data, with_speed))
            except ToolkitError as error:
                rows.append(SurveyedModel(model, why_not=str(error)))
            ticker.advance()
    return rows


def _survey(model: str, classifier: Classifier, data: str | None, with_speed: bool) -> SurveyedModel:
    module = classifier.module
    numbers = sum(tensor.numel() for tensor in (*module.parameters(), *module.buffers()))
    n, correct, why = None, None, classifier.untrainable
    if data is not None:
        try:
            n, correct = _count_correct(classifier, data)
        except ToolkitError as error:
            why = why or str(error)
    return SurveyedModel(
        model, classifier.weights.name, "classifier", len(classifier.labels), classifier.preprocessing.crop_px,
        parameters=numbers or None,
        licence=_find_licence(classifier), can_train=not classifier.untrainable, why_not=why,
        images_per_s=measure_speed(classifier) if with_speed else None,
        trained_images_per_s=(
            measure_speed(classifier, backward=True) if with_speed and not classifier.untrainable else None
        ),
        n=n, correct=correct, accuracy=None if not n else (correct or 0) / n,
        ci95=None if not n else wilson_interval(correct or 0, n),
    )  # fmt: skip


def _survey_detector(model: str, detector: Detector, with_speed: bool) -> SurveyedModel:
    """Speed from pictures of 640 × 480 to boxes; accuracy is what `toolkit eval` measures."""
    images_per_s = None
    if with_speed:
        pictures = list(np.random.default_rng(0).integers(0, 256, (BATCH, 480, 640, 3), np.uint8))
        # once unmeasured: first passes set up what later passes use
        detector.detect(pictures)
        start = perf_counter()
        detector.detect(pictures)
        images_per_s = BATCH / (perf_counter() - start)
    return SurveyedModel(
        model, detector.weights.name, "detector", len(detector.labels), detector.image_px or None,
        licence=read_labels_file(detector.weights.path).licence or "", can_train=not detector.untrainable,
        why_not=detector.untrainable, images_per_s=images_per_s,
    )  # fmt: skip


def _find_licence(classifier: Classifier) -> str:
    path = classifier.weights.path
    if (said := read_labels_file(path).licence) is not None:
        return said
    if path == bundled_file() or path.parent == BUNDLED_DIR:
        return OWN_LICENCE
    return TORCHVISION_LICENCE if path.parent == cache_dir() and classifier.arch in list_architectures() else ""


def measure_speed(classifier: Classifier, backward: bool = False) -> float:
    """Images per second on this machine, preprocessing left out; with `backward` also the gradient by the image."""
    side = classifier.preprocessing.crop_px
    batch = torch.rand(BATCH, 3, side, side, device=classifier.device, requires_grad=backward)

    def run() -> None:
        with torch.set_grad_enabled(backward):
            logits = classifier.logits(batch)
            if backward:
                torch.autograd.grad(logits.sum(), batch)
        # a GPU's work is queued: without waiting only the queueing would be timed
        if classifier.device == "cuda":
            torch.cuda.synchronize()

    # once unmeasured: first passes set up what later passes use
    run()
    count, start = 0, perf_counter()
    while count == 0 or perf_counter() - start < SPEED_S:
        run()
        count += BATCH
    return count / (perf_counter() - start)


def _count_correct(classifier: Classifier, data: str) -> tuple[int, int]:
    """Images of the folder, and how many of them the classifier gets right."""
    images = open_images(data, classifier)
    correct = 0
    with progress(f"asking {classifier.name}", len(images.images)) as ticker:
        how = classifier.preprocessing
        crops = map_ahead(lambda image: (image, resize_and_crop(images.read(image), how)), images.images)
        for image, logits in predict_stream(crops, classifier):
            correct += int(logits.argmax()) == image.class_index
            ticker.advance()
    return len(images.images), correct
