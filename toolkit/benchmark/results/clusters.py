"""A mean over images, and how sure it is where the images of a class share one patch."""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from toolkit.statistics import wilson_interval

NO_SPREAD = 1e-12


@dataclass(frozen=True)
class Estimate:
    """A mean over images.

    Attributes:
        mean: over all images.
        ci95: its interval over classes; None where it cannot be told: one class, or classes without any spread.
    """

    mean: float
    ci95: tuple[float, float] | None


def estimate_share(scores: np.ndarray, classes: np.ndarray) -> Estimate:
    """Mean of `scores` in [0, 1], with a 95 % interval that takes classes, not images, as the independent draws.

    An image's score is the share of the cells (corruptions and severities) in which it was right: cells share images,
    and the images of a class share its patch, so neither cells nor images are independent draws. With total y_c and
    number of images x_c of class c, the mean is the ratio p = Σ y_c / Σ x_c, and

        v = C / (C - 1) · Σ (y_c - p x_c)² / (Σ x_c)²,    p ± t(0.975, C - 1) √v

    the ratio estimator of a sample of C whole clusters (Cochran, Sampling Techniques, 3rd ed. 1977, sections 6.3 and
    9A.1, with no finite population; the same as the cluster-robust variance of a mean). Where all classes are wholly
    right, or wholly wrong, v is 0 and says nothing: then it is Wilson's interval with each class as one trial.

    Args:
        scores: (n,) float.
        classes: (n,) int, the class of each image.
    """
    mean, half, n_classes = _ratio(scores, classes)
    if n_classes == 1:
        return Estimate(mean, None)
    if half > NO_SPREAD:
        return Estimate(mean, (max(0.0, mean - half), min(1.0, mean + half)))
    if min(mean, 1 - mean) < NO_SPREAD:
        return Estimate(mean, wilson_interval(round(mean) * n_classes, n_classes))
    return Estimate(mean, None)


def estimate_difference(scores: np.ndarray, other: np.ndarray, classes: np.ndarray) -> Estimate:
    """Mean of `scores` less that of `other` on the same images; the interval is that of `estimate_share`, paired."""
    mean, half, n_classes = _ratio(np.asarray(scores, float) - other, classes)
    if n_classes == 1 or half <= NO_SPREAD:
        return Estimate(mean, None)
    return Estimate(mean, (max(-1.0, mean - half), min(1.0, mean + half)))


def _ratio(scores: np.ndarray, classes: np.ndarray) -> tuple[float, float, int]:
    """(ratio, half width of its interval, number of classes)."""
    from scipy.stats import t

    _, member = np.unique(classes, return_inverse=True)
    totals, sizes = np.bincount(member, weights=scores), np.bincount(member)
    n_classes = len(sizes)
    mean = float(totals.sum() / sizes.sum())
    if n_classes == 1:
        return mean, 0.0, 1
    spread = n_classes / (n_classes - 1) * float(((totals - mean * sizes) ** 2).sum())
    return mean, float(t.ppf(0.975, n_classes - 1)) * sqrt(spread) / float(sizes.sum()), n_classes
