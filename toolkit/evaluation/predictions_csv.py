"""`predictions.csv`: one row per image; right or wrong as 1 or 0, what is unknown left empty."""

from collections.abc import Iterable, Iterator

from toolkit.core.tables import encode_csv
from toolkit.evaluation.predict import Prediction

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
    yield from (f"{one.top1_prob:.6f}", f"{one.true_prob:.6g}", one.true_rank) if one.is_read else (None,) * 3
    yield from (int(one.correct_top1), int(one.correct_top5)) if one.is_read else (None,) * 2
    yield from (one.status, "; ".join(capture.failed_gates))
