"""Check the preprocessing of a detector: its boxes on photographs, and whether another preprocessing finds more."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
from PIL import Image

from toolkit.core.console import progress
from toolkit.core.errors import FieldError
from toolkit.core.files import write_bytes
from toolkit.evaluation.detect import LEAST_SHOWN, pen_boxes
from toolkit.imaging.read import encode_image, is_image_name, read_image
from toolkit.models.decoders import IMAGENET, LEVELS, PLAIN, Letterbox
from toolkit.models.detector import Detections, Detector, box_iou
from toolkit.models.load_detector import DenseDetector

MOST_PHOTOS, CARD_PX, COLUMNS = 12, 400, 4
MOST_COUNTED, SAME_IOU = 3, 0.7
"""The most confident boxes of a photograph count, if its mirror image has them in the same place."""
CLEARLY = 1.1
"""Factor by which the scores must rise for another preprocessing to be reported."""


@dataclass(frozen=True)
class DetectorCheck:
    """Detections in photographs with the detector's own preprocessing, and with the best other preprocessing.

    Attributes:
        boxes: number of boxes with a score of 0.25 or more.
        score: sum over photographs of the best three scores that the mirrored image confirms.
        better: lines for the TOML that raise the sum most; empty if none raises it clearly.
        better_boxes, better_score: boxes and score with these lines.
        picture: PNG of the photographs with their boxes.
    """

    model: str
    photos: int
    boxes: int
    score: float
    better: str
    better_boxes: int
    better_score: float
    picture: str

    def describe(self) -> str:
        """Return the result and the suggested change as a sentence."""
        found = f"{self.model}: {self.boxes} boxes in {self.photos} photographs, see {self.picture}"
        if not self.better:
            return f"{found}; no other preprocessing finds clearly more"
        sums = f"scores {self.better_score:.1f} in place of {self.score:.1f}"
        return f"{found}; with {self.better} it finds {self.better_boxes} ({sums}): write that into the TOML beside it"


def check_detector(model: str, detector: Detector, folder: Path, picture: Path) -> DetectorCheck:
    """Run a detector on photographs with each preprocessing, and draw the boxes with its own.

    Raises:
        ToolkitError: there is no photograph, or a photograph cannot be read.
    """
    # in the order of their names, so that the same photographs are checked again
    files = sorted(file for file in folder.rglob("*") if is_image_name(file.name)) if folder.is_dir() else []
    if not files:
        raise FieldError("expected a folder with photographs in it, found none", {"check": folder})
    photos = [read_image(file) for file in files[:MOST_PHOTOS]]
    found, boxes, score = _measure(detector, photos)
    # another preprocessing must be clearly better, or chance would advise to change it
    best = ("", boxes, CLEARLY * score + 0.25)
    others = list(_vary(detector)) if isinstance(detector, DenseDetector) else []
    with progress(f"checking {detector.name}", len(others)) as ticker:
        for words, other in others:
            _, count, total = _measure(other, photos)
            best = (words, count, total) if total > best[2] else best
            ticker.advance()
    _write_sheet(picture, photos, found, detector.labels)
    return DetectorCheck(model, len(photos), boxes, round(score, 3), best[0], best[1] if best[0] else boxes,
                         round(best[2] if best[0] else score, 3), str(picture))  # fmt: skip


def _measure(detector: Detector, photos: Sequence[np.ndarray]) -> tuple[list[Detections], int, float]:
    """Return detections, the number of confident boxes, and the summed scores that mirror images confirm.

    With wrong preprocessing a network may find many boxes, but not the same in the mirror image.
    """
    found = detector.detect(photos)
    mirrored = detector.detect([np.ascontiguousarray(photo[:, ::-1]) for photo in photos])
    boxes, score = 0, 0.0
    # boxes of the mirror image, mirrored back, must overlap the same class
    for photo, seen, other in zip(photos, found, mirrored, strict=True):
        turned = np.array([photo.shape[1], 0, photo.shape[1], 0]) - other.boxes[:, [2, 1, 0, 3]] * [1, -1, 1, -1]
        boxes += int((seen.scores >= LEAST_SHOWN).sum())
        for box, kind, sure in list(zip(seen.boxes, seen.classes, seen.scores, strict=True))[:MOST_COUNTED]:
            same = turned[(other.classes == kind) & (other.scores >= LEAST_SHOWN)]
            score += float(sure) if sure >= LEAST_SHOWN and len(same) and box_iou(same, box).max() >= SAME_IOU else 0
    return found, boxes, score


def _vary(detector: DenseDetector) -> Iterator[tuple[str, DenseDetector]]:
    """Yield every other channel order, scale and letterbox, and channel order with scale."""
    how = detector.decoder
    scales = [(words, mean, std) for words, (mean, std) in _SCALES.items() if (mean, std) != (how.mean, how.std)]
    turned = "RGB" if how.channels == "BGR" else "BGR"
    yield f'channels = "{turned}"', replace(detector, decoder=replace(how, channels=turned))
    for words, mean, std in scales:
        scaled = replace(how, mean=mean, std=std)
        yield words, replace(detector, decoder=scaled)
        both = f'{words} and channels = "{turned}"'
        yield both, replace(detector, decoder=replace(scaled, channels=turned))
    for letterbox in get_args(Letterbox):
        if letterbox != how.letterbox:
            yield f'letterbox = "{letterbox}"', replace(detector, decoder=replace(how, letterbox=letterbox))


def _round(values: Sequence[float]) -> list[float]:
    return [round(value, 6) for value in values]


_SCALES = {f"mean = {_round(mean)} and std = {_round(std)}": (mean, std) for mean, std in (PLAIN, LEVELS, IMAGENET)}


def _write_sheet(
    picture: Path, photos: Sequence[np.ndarray], found: Sequence[Detections], labels: Sequence[str]
) -> None:
    columns = min(COLUMNS, len(photos))
    rows = -(-len(photos) // columns)
    sheet = Image.new("RGB", (columns * CARD_PX, rows * CARD_PX), "#14171b")
    for k, (pixels, seen) in enumerate(zip(photos, found, strict=True)):
        image = Image.fromarray(np.ascontiguousarray(pixels))
        pen_boxes(image, seen, labels)
        image.thumbnail((CARD_PX - 8, CARD_PX - 8))
        sheet.paste(image, (k % columns * CARD_PX + 4, k // columns * CARD_PX + 4))
    write_bytes(picture, encode_image(sheet, "PNG"))
