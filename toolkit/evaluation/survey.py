"""List the networks on this machine: abilities, accuracy on a folder, and speed."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from toolkit.core.cache import Arrays, keep_arrays
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import torch
from toolkit.core.statistics import wilson_interval
from toolkit.core.threads import map_ahead
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.models.architectures import list_architectures
from toolkit.models.detector import Detector
from toolkit.models.find import BUNDLED_DIR, list_own, may_be_detector
from toolkit.models.labels import read_labels_file
from toolkit.models.load import bundled_file, load_classifier
from toolkit.models.network import Classifier
from toolkit.models.predict import predict_stream
from toolkit.models.weights import cache_dir, find_local, weights_folder
from toolkit.training.images import open_images

SPEED_S = 1.0
BATCH = 8
OWN_LICENCE = "MIT"
TORCHVISION_LICENCE = "BSD-3-Clause (torchvision)"


@dataclass(frozen=True)
class SurveyedModel:
    """A row of the survey.

    Attributes:
        model: name for `--model`.
        image_px: side of the input, pixels.
        parameters: number of parameters; None if the file does not show them.
        can_train: whether boosters can be trained against the network.
        why_not: why it cannot train boosters, or could not be loaded.
        images_per_s: speed forward, in batches of 8; None if not timed.
        trained_images_per_s: speed forward and back to the image; None if not timed.
        n, correct: images of the folder; None without a folder, or if its classes differ.
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
    """Return the names of classifiers with weights on this machine: those in `folder`, bundled, torchvision's."""
    published = [name for name in list_architectures() if find_local(name) is not None]
    # a name with a colon means something else, such as code: then the path
    own = [str(file.absolute()) if ":" in name else name for name, file in list_own(folder).items()]
    return [*own, *published]


def survey_local(folder: Path | None = None) -> list[SurveyedModel]:
    """Survey all of `list_models`; rows of the last survey are used again until a file changes its size or time.

    Installed packages count too, as some networks need them. Networks that did not load are tried again.
    """
    # a survey is kept by the files and packages that it may depend on
    places = [place for place in (BUNDLED_DIR, folder, weights_folder(), cache_dir()) if place is not None]
    files = [*(file for place in places for file in place.glob("*")), *map(Path, filter(None, sys.path))]

    fresh: list[SurveyedModel] = []

    def make() -> Arrays:
        fresh.extend(survey_models(list_models(folder), folder=folder))
        return {"rows": np.frombuffer(json.dumps(list(map(asdict, fresh))).encode(), np.uint8)}

    kept = keep_arrays("models", [sys.version, *places, *map(_stamp, sorted(files))], make)
    if fresh:
        return fresh
    # networks that did not load may load now, by a package or a file
    rows = [SurveyedModel(**row) for row in json.loads(kept["rows"].tobytes())]
    broken = [row.model for row in rows if row.classes is None]
    again = {row.model: row for row in survey_models(broken, folder=folder)} if broken else {}
    return [again.get(row.model, row) for row in rows]


def _stamp(file: Path) -> tuple[str | int, ...]:
    """Return a file's path, size and time; the path alone if the others cannot be read."""
    try:
        facts = file.stat()
    except OSError:
        return (str(file),)
    return str(file), facts.st_size, facts.st_mtime_ns


def survey_models(
    models: Sequence[str], device: str = "auto", folder: Path | None = None, data: str | None = None,
    with_speed: bool = False,
) -> list[SurveyedModel]:  # fmt: skip
    """Load each network, and measure accuracy and speed if wanted; a network that does not load has a reason.

    Args:
        data: folder with a folder per class (its val/ or test/, if it exists); None: no accuracy.
    """
    from toolkit.models.load_detector import is_detector, load_detector

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
    # parameters and buffers, as published tables count them
    numbers = sum(tensor.numel() for tensor in (*module.parameters(), *module.buffers()))
    path, n, correct, why = classifier.weights.path, None, None, classifier.untrainable
    # the licence beside the weights, else that of the kit's own networks or of torchvision
    licence = read_labels_file(path).licence
    if licence is None and (path == bundled_file() or path.parent == BUNDLED_DIR):
        licence = OWN_LICENCE
    elif licence is None:
        is_published = path.parent == cache_dir() and classifier.arch in list_architectures()
        licence = TORCHVISION_LICENCE if is_published else ""
    # accuracy, if the classes of the data are those of the network
    if data is not None:
        try:
            n, correct = _count_correct(classifier, data)
        except ToolkitError as error:
            why = why or str(error)
    return SurveyedModel(
        model, classifier.weights.name, "classifier", len(classifier.labels), classifier.preprocessing.crop_px,
        parameters=numbers or None,
        licence=licence, can_train=not classifier.untrainable, why_not=why,
        images_per_s=measure_speed(classifier) if with_speed else None,
        trained_images_per_s=(
            measure_speed(classifier, backward=True) if with_speed and not classifier.untrainable else None
        ),
        n=n, correct=correct, accuracy=None if not n else (correct or 0) / n,
        ci95=None if not n else wilson_interval(correct or 0, n),
    )  # fmt: skip


def _survey_detector(model: str, detector: Detector, with_speed: bool) -> SurveyedModel:
    """Return a row with the speed from images of 640 × 480 to boxes, without accuracy."""
    images_per_s = None
    if with_speed:
        # random pictures: the time hardly depends on what they show
        pictures = list(np.random.default_rng(0).integers(0, 256, (BATCH, 480, 640, 3), np.uint8))
        # a first pass without timing sets up caches
        detector.detect(pictures)
        start = perf_counter()
        detector.detect(pictures)
        images_per_s = BATCH / (perf_counter() - start)
    return SurveyedModel(
        model, detector.weights.name, "detector", len(detector.labels), detector.image_px or None,
        licence=read_labels_file(detector.weights.path).licence or "", can_train=not detector.untrainable,
        why_not=detector.untrainable, images_per_s=images_per_s,
    )  # fmt: skip


def measure_speed(classifier: Classifier, backward: bool = False) -> float:
    """Return images per second without preprocessing; with `backward`, including the gradient of the image."""
    side = classifier.preprocessing.crop_px
    batch = torch.rand(BATCH, 3, side, side, device=classifier.device, requires_grad=backward)

    def run() -> None:
        with torch.set_grad_enabled(backward):
            logits = classifier.logits(batch)
            if backward:
                torch.autograd.grad(logits.sum(), batch)
        # a GPU's work is queued: wait for it
        if classifier.device == "cuda":
            torch.cuda.synchronize()

    # a first pass without timing sets up caches
    run()
    count, start = 0, perf_counter()
    while count == 0 or perf_counter() - start < SPEED_S:
        run()
        count += BATCH
    return count / (perf_counter() - start)


def _count_correct(classifier: Classifier, data: str) -> tuple[int, int]:
    """Return the number of images, and of correctly classified images."""
    images = open_images(data, classifier)
    correct = 0
    with progress(f"asking {classifier.name}", len(images.images)) as ticker:
        how = classifier.preprocessing
        crops = map_ahead(lambda image: (image, resize_and_crop(images.read(image), how)), images.images)
        for image, logits in predict_stream(crops, classifier):
            correct += int(logits.argmax()) == image.class_index
            ticker.advance()
    return len(images.images), correct
