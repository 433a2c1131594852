"""COCO's average precision of a detector where every image shows one object."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

IOU_LEVELS = np.linspace(0.5, 0.95, 10)
RECALL_LEVELS = np.linspace(0, 1, 101)


@dataclass(frozen=True)
class ScoredBoxes:
    """The detections of the true class in one image.

    Attributes:
        scores: (n,) by falling score.
        ious: (n,) overlap of each with the object's box.
    """

    scores: np.ndarray
    ious: np.ndarray


def average_precision(images: Sequence[ScoredBoxes], iou: float) -> float | None:
    """Mean precision at 101 levels of recall, as pycocotools counts it; None without images.

    A detection is right where it overlaps the object by `iou` at least, and no stronger one was; the others are
    wrong.
    """
    if not images:
        return None
    scores, right = [], []
    for one in images:
        is_right = np.zeros(len(one.scores), bool)
        # of the stronger first; the object goes to the first that fits
        # pycocotools' bound: an IoU of 1 by rounding still counts
        fits = np.flatnonzero(one.ious >= min(iou, 1 - 1e-10))
        if len(fits):
            is_right[fits[0]] = True
        scores.append(one.scores)
        right.append(is_right)
    # stable, as in pycocotools: of equal scores the one that came first stays first
    order = np.argsort(-np.concatenate(scores), kind="mergesort")
    hits = np.cumsum(np.concatenate(right)[order])
    if not len(hits):
        return 0.0
    recall = hits / len(images)
    precision = hits / np.arange(1, len(hits) + 1)
    # precision at a recall is the best at that recall or above: the curve's envelope
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    # levels of recall that are never reached count as precision 0
    places = np.searchsorted(recall, RECALL_LEVELS, side="left")
    reached = places < len(precision)
    return float(np.where(reached, precision[np.minimum(places, len(precision) - 1)], 0).mean())


def mean_average_precision(images: Sequence[ScoredBoxes]) -> float | None:
    """Mean of `average_precision` over IoU 0.50, 0.55 … 0.95."""
    found = [average_precision(images, iou) for iou in IOU_LEVELS]
    return None if not images else float(np.mean([one for one in found if one is not None]))


def recall_at(images: Sequence[ScoredBoxes], iou: float = 0.5) -> float | None:
    """Share of the images where some detection of the class overlaps the object so far, however weak."""
    return None if not images else float(np.mean([bool((one.ious >= iou).any()) for one in images]))
