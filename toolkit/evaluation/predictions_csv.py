"""`predictions.csv`: one row per image; right or wrong as 1 or 0, what is unknown left empty."""

from collections.abc import Iterable, Iterator

from toolkit.core.tables import encode_csv
from toolkit.evaluation.predict import Prediction

COLUMNS = (
    "source", "object", "variant", "pose_id", "path", "true_index", "true_label", "top1_index", "top1_label",
    "top1_prob", "true_prob", "true_rank", "correct_top1", "correct_top5", "status", "failed_gates",
)  # fmt: skip


def encode_predictions(predictions: Iterable[Prediction]) -> str:
    """The text of the file."""
    return encode_csv(COLUMNS, map(_row, predictions))


def _row(one: Prediction) -> Iterator[object]:
    capture = one.capture
    yield from (capture.source, capture.object, capture.variant, capture.pose_id, capture.path)
    yield from (one.true_index, one.true_label, one.top1_index, one.top1_label)
    yield from (f"{one.top1_prob:.6f}", f"{one.true_prob:.6g}", one.true_rank) if one.is_read else (None,) * 3
    yield from (int(one.correct_top1), int(one.correct_top5)) if one.is_read else (None,) * 2
    yield from (one.status, "; ".join(capture.failed_gates))
