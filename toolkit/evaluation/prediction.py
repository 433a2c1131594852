"""What a network said of one image: a classifier's first guess and the truth's place, a detector's boxes."""

from dataclasses import dataclass

from toolkit.captures.capture import Capture

OK = "ok"
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
