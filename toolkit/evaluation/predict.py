"""Images in, one prediction each out, in constant memory; no network is asked about an image twice."""

import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field

from toolkit.captures.capture import Capture
from toolkit.captures.corrupted_copy import SEED, Corruption
from toolkit.captures.read import read_crop
from toolkit.core.child import count_cores
from toolkit.core.console import progress, quietly
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.records import hold_folder
from toolkit.core.work import Work
from toolkit.engine.units import WorkLog
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage
from toolkit.models.network import BadAnswer, Classifier, check_finite

OK = "ok"
CUDA_BATCH = 128
MAX_DECODERS = 8
CPU_PART = 4
"""Images that one thread classifies at once. Passes of one shape on one thread give the same numbers whatever else is
classified, however many threads there are."""
Tag = TypeVar("Tag")
Box = tuple[float, float, float, float]
"""x1, y1, x2, y2 in pixels from the image's corner."""


@dataclass(frozen=True)
class Detection:
    """What a detector said of one image; what is not known is None.

    Attributes:
        true_box: where the object is.
        found: whether a detection of its class is strong enough and overlaps by half.
        score, iou, box: of the strongest one of the class that overlaps by half.
        strongest_label, strongest_score: of the strongest detection of all.
    """

    true_box: Box | None = None
    found: bool | None = None
    score: float | None = None
    iou: float | None = None
    box: Box | None = None
    strongest_label: str | None = None
    strongest_score: float | None = None


@dataclass(frozen=True)
class Prediction:
    """What the network said of one image; everything after `true_label` is None where the image was not read.

    Attributes:
        capture: the image.
        true_index, true_label: what it shows.
        top1_index, top1_label, top1_prob: the network's first guess.
        true_prob, true_rank: probability of the truth, and its place among the guesses, from 1.
        status: `ok`, or why the image was not read.
        detection: what a detector said, see `toolkit.evaluation.predictions_csv.make_detected`; None of a classifier.
    """

    capture: Capture
    true_index: int
    true_label: str
    top1_index: int | None = None
    top1_label: str | None = None
    top1_prob: float | None = None
    true_prob: float | None = None
    true_rank: int | None = None
    status: str = OK
    detection: Detection | None = None

    @property
    def is_read(self) -> bool:
        """Whether the image was read and classified."""
        return self.status == OK

    @property
    def correct_top1(self) -> bool:
        """Whether the first guess is right."""
        return self.true_rank == 1

    @property
    def correct_top5(self) -> bool:
        """Whether the truth is among the first five guesses."""
        return self.true_rank is not None and self.true_rank <= 5


def predict_captures(
    captures: Sequence[Capture], true_classes: dict[str, int], classifier: Classifier, batch_size: int | None = None,
    look: Callable[[Capture, np.ndarray], None] | None = None,
) -> list[Prediction]:  # fmt: skip
    """Classify images; the order of the result is that of `captures`.

    Decoding runs in threads beside the network: Pillow and torch both release the interpreter's lock. At most one batch
    is decoded ahead, so memory does not grow with the number of images. On a CPU the numbers depend neither on the
    batch nor on the threads; on a GPU their last digits may depend on the batch.

    Args:
        captures: the images.
        true_classes: class index of each object.
        classifier: answers.
        batch_size: images per pass; by default as `choose_batch_size` finds it.
        look: called with each image and its (crop, crop, 3) uint8 pixels.

    Raises:
        ToolkitError: the network's output is not finite, or a batch does not fit the GPU.
    """
    predictions: list[Prediction] = []
    with progress("classifying", len(captures)) as ticker:
        for batch in batch_pixels(captures, classifier, choose_batch_size(classifier, batch_size)):
            read = [(one.path, pixels) for one, pixels in batch if not isinstance(pixels, str)]
            outputs = iter(classify_parts([pixels for _, pixels in read], classifier, [path for path, _ in read]))
            for capture, pixels in batch:
                true = true_classes[capture.object]
                if isinstance(pixels, str):
                    predictions.append(Prediction(capture, true, classifier.labels[true], status=pixels))
                else:
                    if look is not None:
                        look(capture, pixels)
                    predictions.append(_rank(capture, true, classifier, *next(outputs)))
            ticker.advance(len(batch))
    return predictions


def choose_batch_size(classifier: Classifier, batch_size: int | None = None) -> int:
    """Images that are gathered before the network is asked: as asked for, else what suits its device.

    On a CPU these are whole parts: a part that is not full is filled up with copies, which would be work for nothing.
    """
    import torch

    if classifier.device == "cpu":
        # a pass for each thread: what more are held costs memory alone
        return CPU_PART * (-(-batch_size // CPU_PART) if batch_size else torch.get_num_threads())
    return batch_size or CUDA_BATCH


def classify_images(images: list[np.ndarray], classifier: Classifier) -> list[tuple[np.ndarray, np.ndarray]]:
    """(classes by falling probability, probability of each class) of each (crop, crop, 3) uint8 image."""
    import torch

    batch = torch.from_numpy(np.stack(images)).to(classifier.device).permute(0, 3, 1, 2)
    try:
        with torch.inference_mode():
            logits = classifier.logits(batch.float().div_(255)).double().cpu()
    except torch.cuda.OutOfMemoryError:
        raise ToolkitError(f"{len(images)} images do not fit the GPU's memory: make batch_size smaller") from None
    check_finite(logits, classifier.arch, classifier.weights)
    # stable, so that ties go to the lower index everywhere and rank 1 always is the first guess
    order = torch.sort(logits, dim=1, descending=True, stable=True).indices.numpy()
    return list(zip(order, logits.softmax(dim=1).numpy(), strict=True))


def classify_stream(
    images: Iterable[tuple[Tag, np.ndarray]], classifier: Classifier, batch_size: int | None = None
) -> Iterator[tuple[Tag, np.ndarray, np.ndarray]]:
    """Each image's tag, its classes by falling probability, and the probability of each class, in order.

    At most one batch is held, so memory does not grow with the number of images. On a CPU the numbers depend neither on
    the batch nor on the threads; on a GPU their last digits may depend on the batch.

    Args:
        images: each with whatever shall come back with its answer, (crop, crop, 3) uint8 sRGB.
        classifier: answers.
        batch_size: images that are gathered before the network is asked.

    Raises:
        ToolkitError: as `predict_captures`.
    """
    size, rest = choose_batch_size(classifier, batch_size), iter(images)
    while batch := list(islice(rest, size)):
        found = classify_parts([pixels for _, pixels in batch], classifier)
        for (tag, _), (order, probabilities) in zip(batch, found, strict=True):
            yield tag, order, probabilities


def classify_parts(
    images: Sequence[np.ndarray], classifier: Classifier, names: Sequence[str] = ()
) -> list[tuple[np.ndarray, np.ndarray]]:
    """`classify_images` of any number; on a CPU an image's numbers depend on that image alone.

    There every pass has one shape and runs on one thread.

    Args:
        images: (crop, crop, 3) uint8 sRGB each.
        classifier: answers.
        names: of the images, for errors.

    Raises:
        ToolkitError: as `predict_captures`.
    """
    from toolkit.corruptions.batch import run_each

    on_cpu = classifier.device == "cpu"
    side = CPU_PART if on_cpu else max(len(images), 1)
    parts = [slice(start, start + side) for start in range(0, len(images), side)]
    found: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in parts]

    def work(index: int) -> None:
        own = images[parts[index]]
        # the last part is filled up with copies: a pass of another shape may give other last digits
        whole = [*own, *[own[-1]] * (side - len(own))]
        try:
            found[index] = classify_images(whole, classifier)[: len(own)]
        except BadAnswer as error:
            raise (error.at(names[parts[index]]) if names else error) from None

    if on_cpu:
        run_each(work, len(parts))
    else:
        for index in range(len(parts)):
            work(index)
    return [one for part in found for one in part]


def _rank(
    capture: Capture, true: int, classifier: Classifier, order: np.ndarray, probabilities: np.ndarray
) -> Prediction:
    first = int(order[0])
    return Prediction(
        capture,
        true_index=true,
        true_label=classifier.labels[true],
        top1_index=first,
        top1_label=classifier.labels[first],
        top1_prob=float(probabilities[first]),
        true_prob=float(probabilities[true]),
        true_rank=int(np.flatnonzero(order == true)[0]) + 1,
    )


def batch_pixels(
    captures: Sequence[Capture], classifier: Classifier, size: int
) -> Iterator[list[tuple[Capture, np.ndarray | str]]]:
    """Batches with at most `size` images that can be read: each with its `decode_ahead`."""
    batch: list[tuple[Capture, np.ndarray | str]] = []
    n_read = 0
    for capture, pixels in zip(captures, decode_ahead(captures, classifier, size), strict=True):
        batch.append((capture, pixels))
        n_read += not isinstance(pixels, str)
        if n_read == size:
            yield batch
            batch, n_read = [], 0
    if batch:
        yield batch


def decode_ahead(captures: Sequence[Capture], classifier: Classifier, ahead: int) -> Iterator[np.ndarray | str]:
    """(crop, crop, 3) uint8 pixels of each image in order, corrupted where it shall be, or why there are none.

    `ahead` images, and one per worker, are decoded in advance. Neighbours under one corruption are corrupted together,
    at most `ahead` at a time.
    """
    batch: list[tuple[Capture, np.ndarray | str]] = []
    for capture, pixels in zip(captures, _decode_files(captures, classifier.preprocessing, ahead), strict=True):
        # a batch is corrupted in one way: another corruption begins another batch
        if batch and (len(batch) == ahead or find_pending(capture) != find_pending(batch[0][0])):
            yield from _corrupt_batch(batch, classifier.device)
            batch.clear()
        batch.append((capture, pixels))
    yield from _corrupt_batch(batch, classifier.device)


def _decode_files(captures: Sequence[Capture], how: Preprocessing, ahead: int) -> Iterator[np.ndarray | str]:
    def decode(capture: Capture) -> np.ndarray | str:
        if capture.refused is not None:
            return capture.refused
        try:
            return read_crop(capture, how)
        except UnreadableImage as error:
            return error.reason

    return read_ahead(captures, decode, ahead)


def read_ahead(
    captures: Sequence[Capture], read: Callable[[Capture], np.ndarray | str], ahead: int
) -> Generator[np.ndarray | str]:
    """What `read` makes of each image in order, by threads; `ahead` images, and one per thread, in advance."""
    workers = min(MAX_DECODERS, count_cores())
    pool = ThreadPoolExecutor(workers, thread_name_prefix="decode")
    rest = iter(captures)
    with warnings.catch_warnings():
        # read_image has its own, stricter limit; other decoders' warnings end in `status` when they matter
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        warnings.filterwarnings("ignore", module=r"PIL\..*")
        try:
            queue: deque[Future] = deque(pool.submit(read, capture) for capture in islice(rest, ahead + workers))
            while queue:
                result = queue.popleft().result()
                queue.extend(pool.submit(read, capture) for capture in islice(rest, 1))
                yield result
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def find_pending(capture: Capture) -> Corruption | None:
    """The corruption that an image gets whenever it is read: none that its file has already."""
    return None if capture.cut_px is not None else capture.corruption


def _corrupt_batch(batch: Sequence[tuple[Capture, np.ndarray | str]], device: str) -> list[np.ndarray | str]:
    read = [(capture, pixels) for capture, pixels in batch if not isinstance(pixels, str)]
    corrupted = iter(corrupt_images([capture for capture, _ in read], [pixels for _, pixels in read], device))
    return [pixels if isinstance(pixels, str) else next(corrupted) for _, pixels in batch]


def corrupt_images(captures: Sequence[Capture], crops: Sequence[np.ndarray], device: str) -> list[np.ndarray]:
    """Images under the corruption that their captures have pending; of a classifier what it sees, resized and cut.

    As ImageNet-C's own images, the result is rounded to 8 bits. An image's seed is its path below the source, so that
    neither its place nor its batch matters, and `sim` and `real` get the same fog at the same path.

    Args:
        captures: all with the same corruption pending.
        crops: (h, w, 3) uint8 sRGB of each, all of one size.
        device: cpu or cuda; the same but for float rounding.
    """
    from toolkit.core.draws import image_seed
    from toolkit.corruptions.batch import corrupt
    from toolkit.corruptions.digital import from_bytes, to_bytes

    corruption = find_pending(captures[0]) if captures else None
    if corruption is None:
        return list(crops)
    seeds = [image_seed(SEED, one.path_in_source) for one in captures]
    return list(to_bytes(corrupt(from_bytes(np.stack(crops), device), *corruption, seeds)))


CHUNK = 128
"""Images between two writes: what a kill may cost."""


PREDICTIONS = Work("prediction", 2, old_at=5)
"""In the first version, the last digits depended on the batch."""


class CachedPrediction(BaseModel):
    """One line of the file.

    Attributes:
        key: hash of image, weights, preprocessing and true class.
        top1_index, top1_prob, true_prob, true_rank: as in `Prediction`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    key: str = Field(pattern=r"^[0-9a-f]{64}$")
    top1_index: int = Field(ge=0)
    top1_prob: float = Field(ge=0, le=1)
    true_prob: float = Field(ge=0, le=1)
    true_rank: int = Field(ge=1)


def predict_once(
    captures: Sequence[Capture], true_classes: dict[str, int], classifier: Classifier, cache_file: Path
) -> tuple[list[Prediction], int]:  # fmt: skip
    """`predict_captures`, asking the network only about images it has not seen.

    What it says is appended to `cache_file` every 128 images. Images that cannot be read are not kept: they may be
    mended.

    Returns:
        One prediction per capture in their order, and how many images the network was asked about.

    Raises:
        ToolkitError: as `predict_captures`, or the file cannot be written.
    """
    keys = [_key(capture, true_classes[capture.object], classifier) for capture in captures]
    # the same image may stand for several values: the first to come is asked about
    first = {key: at for at, key in reversed(list(enumerate(keys)))}
    unread: dict[str, Prediction] = {}
    with hold_folder(cache_file.parent):
        cache = WorkLog(cache_file, CachedPrediction, lambda row: [(row.key, row)], first)
        todo = sorted(cache.find_missing(first).values())
        with progress("classifying", len(captures), done=len(captures) - len(todo)) as bar, quietly():
            for chunk in (todo[start : start + CHUNK] for start in range(0, len(todo), CHUNK)):
                predictions = predict_captures([captures[at] for at in chunk], true_classes, classifier)
                new = [(keys[at], one) for at, one in zip(chunk, predictions, strict=True)]
                unread |= {key: one for key, one in new if not one.is_read}
                cache.add(*(_as_line(key, one) for key, one in new if one.is_read))
                bar.advance(len(chunk))
    results = [
        _recall(capture, true_classes[capture.object], classifier, cache.known[key])
        if key in cache.known
        else replace(unread[key], capture=capture)
        for capture, key in zip(captures, keys, strict=True)
    ]
    return results, len(todo)


def _key(capture: Capture, true_index: int, classifier: Classifier) -> str:
    """Key of a prediction: of image, corruption, weights, preprocessing and truth."""
    try:
        # one that must not be opened is known by its path alone, and is never kept
        image = capture.path if capture.refused is not None else sha256_file(capture.file)
    except OSError:
        image = capture.path
    # by the weights' hash, not their name: a file may be replaced under its name
    parts = [image, classifier.weights.sha256, classifier.arch, classifier.preprocessing.describe(), true_index]
    corruption = find_pending(capture)
    if corruption is not None:  # whose seed is the path
        parts += [*corruption, capture.path_in_source]
    return PREDICTIONS.key(*parts)


def _as_line(key: str, one: Prediction) -> CachedPrediction:
    fields = {name: getattr(one, name) for name in CachedPrediction.model_fields if name != "key"}
    # a sum of rounded shares may pass 1 by the last bit
    fields |= {name: min(fields[name], 1.0) for name in ("top1_prob", "true_prob")}
    return CachedPrediction(key=key, **fields)


def _recall(capture: Capture, true_index: int, classifier: Classifier, row: CachedPrediction) -> Prediction:
    labels = classifier.labels
    said = row.model_dump(exclude={"key"})
    return Prediction(capture, true_index, labels[true_index], top1_label=labels[row.top1_index], **said)
