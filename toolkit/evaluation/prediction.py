"""Prediction for an image: a classifier's first class and the rank of the true class, or a detector's boxes."""

from dataclasses import dataclass

from toolkit.captures.capture import Capture

OK = "ok"
Box = tuple[float, float, float, float]
"""x1, y1, x2, y2 in pixels from the image's corner."""


@dataclass(frozen=True)
class Detection:
    """A detector's result for an image; unknown values are None.

    Attributes:
        found: whether a detection of its class has enough score and an IoU of at least 0.5.
        score, iou, box: strongest detection of the class with an IoU of at least 0.5.
        strongest_label, strongest_score: strongest detection of all.
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
    """Prediction for an image; everything after `true_label` is None if the image was not read.

    Attributes:
        top1_index, top1_label, top1_prob: first predicted class.
        true_prob, true_rank: probability and rank (from 1) of the true class.
        status: `ok`, or why the image was not read.
        detection: a detector's result, see `toolkit.evaluation.predictions_csv.make_detected`; None of a classifier.
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
        """Whether the first predicted class is the true class."""
        return self.true_rank == 1

    @property
    def correct_top5(self) -> bool:
        """Whether the true class is among the first five."""
        return self.true_rank is not None and self.true_rank <= 5
