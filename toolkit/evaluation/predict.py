"""Classify captures in constant memory, each image at most once."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from toolkit.captures.capture import Capture
from toolkit.core.console import progress, quietly
from toolkit.core.files import sha256_file
from toolkit.core.records import hold_folder
from toolkit.core.work import Work
from toolkit.engine.units import WorkLog
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.read_pixels import read_ahead
from toolkit.models.network import Classifier
from toolkit.models.predict import predict_stream, read_answer


def predict_captures(
    captures: Sequence[Capture], true_classes: dict[str, int], classifier: Classifier, batch_size: int | None = None,
    look: Callable[[Capture, np.ndarray], None] | None = None,
) -> list[Prediction]:  # fmt: skip
    """Classify images, in the order of `captures`.

    Threads read a few images ahead, so memory does not grow with their number. Predictions depend neither on the batch
    nor on the threads. A pending corruption applies to the crop, see `read_pixels`.

    Args:
        batch_size: images in a batch; by default as `predict_stream` finds it.
        look: called with each image and its (crop, crop, 3) uint8 pixels.

    Raises:
        ToolkitError: as `toolkit.models.predict.predict`.
    """
    # images that cannot be read keep an empty prediction
    labels, trues = classifier.labels, [true_classes[capture.object] for capture in captures]
    found = [Prediction(capture, true, labels[true]) for capture, true in zip(captures, trues, strict=True)]
    pictures = read_ahead(captures, classifier.preprocessing)

    def show() -> Iterator[tuple[int, np.ndarray]]:
        for k, (capture, pixels) in enumerate(pictures):
            if isinstance(pixels, str):
                found[k] = replace(found[k], status=pixels)
                continue
            if look is not None:
                look(capture, pixels)
            yield k, pixels

    # closed whatever happens, as threads read ahead
    with progress("classifying", len(captures)) as ticker, closing(pictures):
        for k, logits in predict_stream(show(), classifier, batch_size, lambda k: captures[k].path):
            answer = read_answer(logits, trues[k])
            found[k] = replace(found[k], top1_label=labels[answer.top1_index], **answer._asdict())
            ticker.advance()
    return found


CHUNK = 128
"""Images between two writes: the most that a kill can cost."""
PREDICTIONS = Work("prediction", 4)
"""In the first version, the last digits depended on the batch. Until the third, some colours were misread."""


class CachedPrediction(BaseModel):
    """A line of the cache: a hash of image, weights, preprocessing and true class, and fields of `Prediction`."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    key: str = Field(pattern=r"^[0-9a-f]{64}$")
    top1_index: int = Field(ge=0)
    top1_prob: float = Field(ge=0, le=1)
    true_prob: float = Field(ge=0, le=1)
    true_rank: int = Field(ge=1)


def predict_once(
    captures: Sequence[Capture], true_classes: dict[str, int], classifier: Classifier, cache_file: Path
) -> tuple[list[Prediction], int]:  # fmt: skip
    """`predict_captures`, for images without a prediction in `cache_file`, which is written every 128 images.

    Images that cannot be read are not kept.

    Returns:
        A prediction for each capture in their order, and the number of images that were classified now.

    Raises:
        ToolkitError: as `predict_captures`, or the file cannot be written.
    """
    keys = [_key(capture, true_classes[capture.object], classifier) for capture in captures]
    # the same image may come several times: only the first is classified
    # reversed, so that the first of equal keys stays
    first = {key: at for at, key in reversed(list(enumerate(keys)))}
    unread: dict[str, Prediction] = {}
    with hold_folder(cache_file.parent):
        cache = WorkLog(cache_file, CachedPrediction, lambda row: [(row.key, row)], first)
        todo = sorted(cache.find_missing(first).values())
        with progress("classifying", len(captures), done=len(captures) - len(todo)) as bar, quietly():
            # written after every chunk: an interrupted run loses little
            for chunk in (todo[start : start + CHUNK] for start in range(0, len(todo), CHUNK)):
                predictions = predict_captures([captures[at] for at in chunk], true_classes, classifier)
                new = [(keys[at], prediction) for at, prediction in zip(chunk, predictions, strict=True)]
                unread |= {key: prediction for key, prediction in new if not prediction.is_read}
                cache.add(*(_as_line(key, prediction) for key, prediction in new if prediction.is_read))
                bar.advance(len(chunk))
    # predictions of the cache, and images that were not read
    results = [
        _recall(capture, true_classes[capture.object], classifier, cache.known[key])
        if key in cache.known
        else replace(unread[key], capture=capture)
        for capture, key in zip(captures, keys, strict=True)
    ]
    return results, len(todo)


def _key(capture: Capture, true_index: int, classifier: Classifier) -> str:
    """Return the key of a prediction: image, corruption, weights, preprocessing and true class."""
    try:
        # an image that must not be opened is known by its path, and is never kept
        image = capture.path if capture.refused is not None else sha256_file(capture.file)
    except OSError:
        image = capture.path
    # by the weights' hash, not their name: a file may be replaced under its name
    parts = [image, classifier.weights.sha256, classifier.arch, classifier.preprocessing.describe(), true_index]
    corruption = capture.pending_corruption
    if corruption is not None:  # its seed is the path
        parts += [*corruption, capture.path_in_source]
    return PREDICTIONS.key(*parts)


def _as_line(key: str, prediction: Prediction) -> CachedPrediction:
    fields = {name: getattr(prediction, name) for name in CachedPrediction.model_fields if name != "key"}
    # a sum of rounded shares may pass 1 by the last bit
    fields |= {name: min(fields[name], 1.0) for name in ("top1_prob", "true_prob")}
    return CachedPrediction(key=key, **fields)


def _recall(capture: Capture, true_index: int, classifier: Classifier, row: CachedPrediction) -> Prediction:
    labels = classifier.labels
    said = row.model_dump(exclude={"key"})
    return Prediction(capture, true_index, labels[true_index], top1_label=labels[row.top1_index], **said)
