"""Means over items that are no independent draws: pictures of one place, images of one class share what is seen.

An experiment says in which cluster each item is, `cluster_of`; intervals and tests count clusters alone.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from toolkit.core.statistics import Interval, percentile_interval, resample_clusters, sign_flip_p, wilson_interval

NO_SPREAD = 1e-12
Estimate = tuple[float, Interval | None]
"""A mean over items, and its interval over clusters; None where it cannot be told: one cluster, or no spread."""


def estimate_share(scores: np.ndarray, cluster_of: np.ndarray) -> Estimate:
    """Mean of `scores` in [0, 1], with a 95 % interval that takes clusters, not items, as the independent draws.

    With total y_c and number of items x_c of cluster c, of C, the mean is the ratio p = Σ y_c / Σ x_c, and

        v = C / (C - 1) · Σ (y_c - p x_c)² / (Σ x_c)²,    p ± t(0.975, C - 1) √v

    the ratio estimator of a sample of C whole clusters (Cochran, Sampling Techniques, 3rd ed. 1977, sections 6.3 and
    9A.1, with no finite population; the same as the cluster-robust variance of a mean). Where all clusters are wholly
    right, or wholly wrong, v is 0 and says nothing: then it is Wilson's interval with each cluster as one trial.

    Args:
        scores: (n,) float.
        cluster_of: (n,) int, the cluster of each item.
    """
    mean, half, n_clusters = _ratio(scores, cluster_of)
    if n_clusters == 1:
        return mean, None
    if half > NO_SPREAD:
        return mean, (max(0.0, mean - half), min(1.0, mean + half))
    # all right or all wrong: no spread to measure, but clusters can be counted
    if min(mean, 1 - mean) < NO_SPREAD:
        return mean, wilson_interval(round(mean) * n_clusters, n_clusters)
    return mean, None


def estimate_difference(scores: np.ndarray, other: np.ndarray, cluster_of: np.ndarray) -> Estimate:
    """Mean of `scores` less that of `other` on the same items; the interval is that of `estimate_share`, paired."""
    mean, half, n_clusters = _ratio(np.asarray(scores, float) - other, cluster_of)
    if n_clusters == 1 or half <= NO_SPREAD:
        return mean, None
    return mean, (max(-1.0, mean - half), min(1.0, mean + half))


def _ratio(scores: np.ndarray, cluster_of: np.ndarray) -> tuple[float, float, int]:
    """(ratio, half width of its interval, number of clusters)."""
    from scipy.stats import t

    _, member = np.unique(cluster_of, return_inverse=True)
    totals, sizes = np.bincount(member, weights=scores), np.bincount(member)
    n_clusters = len(sizes)
    mean = float(totals.sum() / sizes.sum())
    if n_clusters == 1:
        return mean, 0.0, 1
    # residuals y_c - p x_c of `estimate_share`
    # linearised variance of a ratio of totals (Cochran, Sampling Techniques, 1977, chapter 11)
    spread = n_clusters / (n_clusters - 1) * float(((totals - mean * sizes) ** 2).sum())
    # Student's t: with few clusters the spread itself is uncertain
    return mean, float(t.ppf(0.975, n_clusters - 1)) * sqrt(spread) / float(sizes.sum()), n_clusters


@dataclass(frozen=True)
class ClusterBootstrap:
    """Shares of items, and of bootstrap samples of their clusters.

    Attributes:
        cluster_of: (n,) int, the cluster of each item, from 0.
        weights: (b, count) how often each cluster is in each sample.
    """

    cluster_of: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, cluster_of: np.ndarray, count: int) -> "ClusterBootstrap":
        """The same samples whenever there are as many clusters; none of one cluster."""
        return cls(cluster_of, resample_clusters(count) if count > 1 else np.zeros((0, 1)))

    def shares(self, values: np.ndarray, among: np.ndarray | None = None) -> np.ndarray:
        """(1 + b,) mean of values (n,) of the items in `among` (n,) bool: seen, then of each bootstrap sample."""
        own = np.ones(len(values), bool) if among is None else among
        count = self.weights.shape[1]
        total = np.bincount(self.cluster_of[own], values[own].astype(float), count)
        n = np.bincount(self.cluster_of[own], minlength=count).astype(float)
        # first what was seen: every cluster once
        weights = np.concatenate([np.ones((1, count)), self.weights])
        with np.errstate(invalid="ignore", divide="ignore"):
            return (weights @ total) / (weights @ n)

    def estimate(self, values: np.ndarray, among: np.ndarray | None = None) -> tuple[float | None, Interval | None]:
        """Mean and its 95 % interval over clusters; None without items, and no interval for one cluster."""
        found = self.shares(values, among)
        if np.isnan(found[0]):
            return None, None
        return float(found[0]), percentile_interval(found[1:]) if len(self.weights) else None

    def sign_p(self, change: np.ndarray) -> float:
        """Exact p of the signs of the clusters' mean changes (n,): a test that counts clusters alone."""
        count = self.weights.shape[1]
        n = np.bincount(self.cluster_of, minlength=count)
        return sign_flip_p((np.bincount(self.cluster_of, change, count)[n > 0] / n[n > 0]).tolist())
