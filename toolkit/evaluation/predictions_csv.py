"""`predictions.csv` and `detections.csv`: one row per image; right or wrong as 1 or 0, what is unknown left empty."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from typing import Any

from toolkit.captures.read import Capture
from toolkit.core.tables import encode_csv
from toolkit.evaluation.predict import OK, Detection, Prediction

COLUMNS: dict[str, type] = {
    "source": str, "object": str, "variant": str, "pose_id": int, "path": str, "true_index": int, "true_label": str,
    "top1_index": int, "top1_label": str, "top1_prob": float, "true_prob": float, "true_rank": int,
    "correct_top1": bool, "correct_top5": bool, "status": str, "failed_gates": str,
}  # fmt: skip
NEEDED = [name for name in COLUMNS if name != "failed_gates"]
"""Runs from before there were gates lack that one."""


def encode_predictions(predictions: Iterable[Prediction]) -> str:
    """The text of the file."""
    return encode_csv(list(COLUMNS), map(_row, predictions))


def _row(one: Prediction) -> Iterator[object]:
    capture = one.capture
    yield from (capture.source, capture.object, capture.variant, capture.pose_id, capture.path)
    yield from (one.true_index, one.true_label, one.top1_index, one.top1_label)
    # the truth's probability may be tiny: six significant digits, where the first guess's has six decimals
    yield from (f"{one.top1_prob:.6f}", f"{one.true_prob:.6g}", one.true_rank) if one.is_read else (None,) * 3
    yield from (int(one.correct_top1), int(one.correct_top5)) if one.is_read else (None,) * 2
    yield from (one.status, "; ".join(capture.failed_gates))


DETECTION_COLUMNS: dict[str, type] = {
    "source": str, "object": str, "variant": str, "pose_id": int, "path": str, "true_label": str, "true_box": tuple,
    "found": bool, "score": float, "iou": float, "box": tuple, "strongest_label": str, "strongest_score": float,
    "status": str,
}  # fmt: skip


def make_detected(capture: Capture, true_label: str, detection: Detection, status: str = OK) -> Prediction:
    """A detector's answer as a prediction, right where the object is found: what pairs and tests take.

    Nothing is ranked: a wrong answer has no rank, and no class has a number.
    """
    if status != OK:
        return Prediction(capture, -1, true_label, status=status, detection=detection)
    # the score stands where a classifier has a probability: flips are sorted by it
    strongest, score = detection.strongest_label, detection.score or 0.0
    # a wrong answer of the true class would look right: it is called not found
    wrong = strongest if strongest and strongest != true_label else "not found"
    return Prediction(
        capture, -1, true_label, top1_label=true_label if detection.found else wrong, top1_prob=score, true_prob=score,
        true_rank=1 if detection.found else None, detection=detection,
    )  # fmt: skip


def encode_detections(predictions: Iterable[Prediction]) -> str:
    """The text of the file, of predictions that have a `detection`."""
    return encode_csv(list(DETECTION_COLUMNS), map(_write_detection, predictions))


def _write_detection(one: Prediction) -> Iterator[object]:
    capture, said = one.capture, one.detection or Detection()
    yield from (capture.source, capture.object, capture.variant, capture.pose_id, capture.path)
    yield from (one.true_label, format_box(said.true_box), None if said.found is None else int(said.found))
    yield from (_round(said.score), _round(said.iou), format_box(said.box))
    yield from (said.strongest_label, _round(said.strongest_score), one.status)


def _round(share: float | None) -> str | None:
    return None if share is None else f"{share:.4f}"


def format_box(box: Iterable[float] | None) -> str | None:
    """`10.0 20.0 30.0 40.0`."""
    return None if box is None else " ".join(f"{float(side):.1f}" for side in box)


def read_detection(line: Mapping[str, str]) -> Detection:
    """What a row of the file says; a `ValueError` where a cell is no number or box."""
    return Detection(**{one.name: _parse(line[one.name], DETECTION_COLUMNS[one.name]) for one in fields(Detection)})


def _parse(cell: str, kind: type) -> Any:
    if not cell:
        return None
    if kind is bool:
        return cell == "1"
    if kind is not tuple:
        return kind(cell)
    box = tuple(map(float, cell.split()))
    if len(box) != 4 or not all(map(math.isfinite, box)):
        raise ValueError(f"'{cell}' is no box")
    return box
