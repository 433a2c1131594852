"""Images in, one prediction each out, at the speed of the network and in constant memory."""

import os
import warnings
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from toolkit.captures.corrupt import SEED, Corruption, name_source
from toolkit.captures.read import Capture, CaptureFolder
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import UnreadableImage, read_image
from toolkit.models.network import Classifier
from toolkit.objects.spec import read_spec


def add_corrupted(folder: CaptureFolder, corruptions: Sequence[Corruption]) -> CaptureFolder:
    """The folder with each source once more under each corruption: `sim` in fog of severity 3 is source `sim-fog-3`.

    Nothing is read here: an image is corrupted whenever it is read, see `corrupt_crops`. A source of the folder that
    has the name already keeps it, and the other gets a `+`. Files that are corrupted already, by the manifest, are not
    corrupted again; a note says so.

    Args:
        folder: what is evaluated.
        corruptions: (name, severity) of each.
    """
    if not corruptions:
        return folder
    from toolkit.corruptions.request import find_note

    clean = [one for one in folder.captures if one.corruption is None]
    taken = {one.source for one in folder.captures}
    spoilt = sorted(taken - {one.source for one in clean})
    made: list[Capture] = []
    for source in dict.fromkeys(one.source for one in clean):
        for corruption in corruptions:
            name = name_source(source, corruption)
            while name in taken:
                name += "+"
            taken.add(name)
            made += [
                replace(one, source=name, path=f"{name}/{_below_source(one)}", corruption=corruption)
                for one in clean
                if one.source == source
            ]
    notes = [f"corrupted already, and not once more: {', '.join(spoilt)}"] if spoilt else []
    notes += [note] if (note := find_note(list(dict.fromkeys(name for name, _ in corruptions)))) else []
    captures = sorted((*folder.captures, *made), key=lambda one: (one.source, one.object, one.variant, one.path))
    return replace(folder, captures=tuple(captures), notes=(*folder.notes, *notes))


def laid_on(capture: Capture) -> Corruption | None:
    """The corruption that an image gets whenever it is read: none that its file has already."""
    return None if capture.cut_px is not None else capture.corruption


def corrupt_crops(captures: Sequence[Capture], crops: Sequence[np.ndarray], device: str) -> list[np.ndarray]:
    """What a network sees of images, corrupted: after they were resized and cut, before they are normalised.

    As ImageNet-C's own images, the result is rounded to 8 bits. An image's seed is its path below the source, so that
    neither its place nor its batch matters, and `sim` and `real` get the same fog at the same path.

    Args:
        captures: all alike in what is `laid_on` them.
        crops: (s, s, 3) uint8 sRGB of each.
        device: cpu or cuda; the same but for float rounding.
    """
    from toolkit.corruptions import corrupt, image_seed
    from toolkit.corruptions.digital import from_bytes, to_bytes

    corruption = laid_on(captures[0]) if captures else None
    if corruption is None:
        return list(crops)
    seeds = [image_seed(SEED, _below_source(one)) for one in captures]
    return list(to_bytes(corrupt(from_bytes(np.stack(crops), device), *corruption, seeds)))


def list_corrupted(captures: Iterable[Capture]) -> list[dict[str, Any]]:
    """Source, corruption and severity of each source that is corrupted, sorted, as `summary.json` has them."""
    found = sorted({(one.source, *one.corruption) for one in captures if one.corruption is not None})
    return [{"source": source, "corruption": name, "severity": severity} for source, name, severity in found]


def _below_source(capture: Capture) -> str:
    return capture.path.split("/", 1)[1]


def find_true_classes(folder: CaptureFolder, workspace: Workspace, classifier: Classifier) -> dict[str, int]:
    """Class index of every object of a capture folder: from its spec, else from the name of its folder.

    A folder's name may be a class name, with spaces or underscores, or a WordNet id as in ImageNet's own folders.

    Raises:
        ToolkitError: an object is neither known nor named for a class, or its spec's class is none of the network's.
    """
    specs = workspace.object_specs()
    classes = {}
    for name in folder.objects:
        if name in specs:
            classes[name] = class_of_spec(specs[name], classifier)
        else:
            classes[name] = _class_of_folder(name, folder, sorted(specs), classifier)
    return classes


def leave_out_unknown(folder: CaptureFolder, workspace: Workspace, classifier: Classifier) -> CaptureFolder:
    """The folder without the objects whose spec names a class that the network does not have; a note tells of each.

    Raises:
        ToolkitError: the network knows the class of none of the objects, or a spec is broken.
    """
    specs = workspace.object_specs()
    reasons = {}
    for name in folder.objects:
        if name in specs:
            wanted = read_spec(specs[name]).class_name
            try:
                classifier.class_index(wanted)
            except ToolkitError as error:
                reasons[name] = f"{specs[name]}: {error}"
    if not reasons:
        return folder
    if len(reasons) == len(folder.objects):
        raise ToolkitError(
            f"{next(iter(reasons.values()))}: {classifier.name} knows none of the objects in {folder.root}"
        )
    counts = Counter(one.object for one in folder.captures)
    notes = [
        f"{counts[name]} image{'s' if counts[name] > 1 else ''} of '{name}' left out, {classifier.name} does not know "
        f"its class: {reason}"
        for name, reason in reasons.items()
    ]
    kept = tuple(one for one in folder.captures if one.object not in reasons)
    return replace(folder, captures=kept, notes=(*folder.notes, *notes))


def class_of_spec(spec_file: Path, classifier: Classifier) -> int:
    """Class index of an object by its spec.

    Raises:
        ToolkitError: the spec is broken, or its class is none of the network's.
    """
    name = read_spec(spec_file).class_name
    try:
        return classifier.class_index(name)
    except ToolkitError as error:
        raise ToolkitError(f"{spec_file}: {error}") from None


def _class_of_folder(name: str, folder: CaptureFolder, specs: list[str], classifier: Classifier) -> int:
    why = ""
    # a folder called `12` is a name, not an index: only a spec may give a class by its number
    for spelling in dict.fromkeys((name, name.replace("_", " "))) if not name.isdecimal() else ():
        try:
            return classifier.class_index(spelling)
        except ToolkitError as error:
            why = str(error) if str(error).startswith("several") else why
    where = next(capture.path for capture in folder.captures if capture.object == name)
    near = get_close_matches(name, [*specs, *classifier.labels], n=3)
    hint = why or (f"did you mean {' or '.join(near)}?" if near else f"known objects: {', '.join(specs)}")
    raise ToolkitError(
        f"{folder.root}: no object or class called '{name}' ({where}): {hint} Rename the folder, "
        f'or say what it shows with class = "..." in rig/objects/{name}.toml'
    )


OK = "ok"
CPU_BATCH, CUDA_BATCH = 32, 128
MAX_DECODERS = 8


@dataclass(frozen=True)
class Prediction:
    """What the network said of one image; everything after `true_label` is None where the image was not read.

    Attributes:
        capture: the image.
        true_index, true_label: what it shows.
        top1_index, top1_label, top1_prob: the network's first guess.
        true_prob, true_rank: probability of the truth, and its place among the guesses, from 1.
        status: `ok`, or why the image was not read.
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
    captures: Sequence[Capture],
    true_classes: dict[str, int],
    classifier: Classifier,
    batch_size: int | None = None,
    quiet: bool = False,
) -> list[Prediction]:
    """Classify images; the order of the result is that of `captures`.

    Decoding runs in threads beside the network: Pillow and torch both release the interpreter's lock. At most one batch
    is decoded ahead, so memory does not grow with the number of images.

    Raises:
        ToolkitError: the network's output is not finite, or a batch does not fit the GPU.
    """
    size = batch_size or (CUDA_BATCH if classifier.device == "cuda" else CPU_BATCH)
    predictions: dict[int, Prediction] = {}
    waiting: list[tuple[int, np.ndarray]] = []

    def flush() -> None:
        for (index, _), guess in zip(waiting, _classify([pixels for _, pixels in waiting], classifier), strict=True):
            predictions[index] = _judge(captures[index], true_classes, classifier, guess)
        ticker.advance(len(waiting))
        waiting.clear()

    with progress("classifying", len(captures), quiet) as ticker:
        for index, pixels in enumerate(decode_ahead(captures, classifier, size)):
            if isinstance(pixels, str):
                true = true_classes[captures[index].object]
                predictions[index] = Prediction(captures[index], true, classifier.labels[true], status=pixels)
                ticker.advance()
                continue
            waiting.append((index, pixels))
            if len(waiting) == size:
                flush()
        if waiting:
            flush()
    return [predictions[index] for index in range(len(captures))]


def decode_ahead(captures: Sequence[Capture], classifier: Classifier, ahead: int) -> Iterator[np.ndarray | str]:
    """(crop, crop, 3) uint8 pixels of each image in order, corrupted where it shall be, or why there are none.

    `ahead` images, and one per worker, are decoded in advance. Neighbours under one corruption are corrupted together,
    at most `ahead` at a time.
    """
    batch: list[tuple[Capture, np.ndarray | str]] = []
    for capture, pixels in zip(captures, _decode_ahead(captures, classifier.preprocessing, ahead), strict=True):
        if batch and (len(batch) == ahead or laid_on(capture) != laid_on(batch[0][0])):
            yield from _lay_on(batch, classifier.device)
            batch.clear()
        batch.append((capture, pixels))
    yield from _lay_on(batch, classifier.device)


def _lay_on(batch: Sequence[tuple[Capture, np.ndarray | str]], device: str) -> list[np.ndarray | str]:
    read = [(capture, pixels) for capture, pixels in batch if not isinstance(pixels, str)]
    corrupted = iter(corrupt_crops([capture for capture, _ in read], [pixels for _, pixels in read], device))
    return [pixels if isinstance(pixels, str) else next(corrupted) for _, pixels in batch]


def _decode_ahead(captures: Sequence[Capture], how: Preprocessing, ahead: int) -> Iterator[np.ndarray | str]:
    def decode(capture: Capture) -> np.ndarray | str:
        if capture.refused is not None:
            return capture.refused
        try:
            pixels = read_image(capture.file, how.resize_px)
        except UnreadableImage as error:
            return error.reason
        is_cut = capture.cut_px == how.crop_px and pixels.shape[:2] == (how.crop_px, how.crop_px)
        return pixels if is_cut else resize_and_crop(pixels, how)

    workers = max(1, min(MAX_DECODERS, os.cpu_count() or 1))
    pool = ThreadPoolExecutor(workers, thread_name_prefix="decode")
    rest = iter(captures)
    with warnings.catch_warnings():
        # read_image has its own, stricter limit; other decoders' warnings end in `status` when they matter
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        warnings.filterwarnings("ignore", module=r"PIL\..*")
        try:
            queue: deque[Future] = deque(pool.submit(decode, capture) for capture in islice(rest, ahead + workers))
            while queue:
                result = queue.popleft().result()
                queue.extend(pool.submit(decode, capture) for capture in islice(rest, 1))
                yield result
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@dataclass(frozen=True)
class _Guess:
    order: np.ndarray
    probabilities: np.ndarray


def _classify(images: list[np.ndarray], classifier: Classifier) -> list[_Guess]:
    import torch

    batch = torch.from_numpy(np.stack(images)).to(classifier.device).permute(0, 3, 1, 2)
    try:
        with torch.inference_mode():
            logits = classifier.logits(batch.float().div_(255)).double().cpu()
    except torch.cuda.OutOfMemoryError:
        raise ToolkitError(f"{len(images)} images do not fit the GPU's memory: make --batch-size smaller") from None
    if not torch.isfinite(logits).all():
        raise ToolkitError(f"{classifier.weights.name}: the network's output is not a number: its weights are damaged")
    # stable, so that ties go to the lower index everywhere and rank 1 always is the first guess
    order = torch.sort(logits, dim=1, descending=True, stable=True).indices.numpy()
    return [_Guess(*pair) for pair in zip(order, logits.softmax(dim=1).numpy(), strict=True)]


def _judge(capture: Capture, true_classes: dict[str, int], classifier: Classifier, guess: _Guess) -> Prediction:
    true, first = true_classes[capture.object], int(guess.order[0])
    return Prediction(
        capture,
        true,
        classifier.labels[true],
        first,
        classifier.labels[first],
        float(guess.probabilities[first]),
        float(guess.probabilities[true]),
        int(np.flatnonzero(guess.order == true)[0]) + 1,
    )
