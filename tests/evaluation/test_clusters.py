"""Intervals over classes: the formula in a loop, a bootstrap over classes, and their coverage."""

import numpy as np
import pytest
from scipy.stats import binomtest, t

from toolkit.evaluation.metrics import ClusterBootstrap, estimate_difference, estimate_share


def draw(rng, n_classes, sizes=(1, 12), spread=1.2):
    """Images of classes that differ in how hard they are; scores are shares of ten cells."""
    counts = rng.integers(*sizes, n_classes)
    classes = np.repeat(rng.permutation(n_classes) * 3, counts)
    ease = np.repeat(rng.normal(0, spread, n_classes), counts)
    return rng.binomial(10, 1 / (1 + np.exp(-ease))) / 10, classes


def test_formula_in_a_loop():
    scores, classes = draw(np.random.default_rng(1), 9)
    p, total = sum(scores) / len(scores), 0.0
    for one in set(classes):
        own = [score for score, k in zip(scores, classes, strict=True) if k == one]
        total += (sum(own) - p * len(own)) ** 2
    half = t.ppf(0.975, 8) * (9 / 8 * total) ** 0.5 / len(scores)
    found = estimate_share(scores, classes)
    assert found == (pytest.approx(p), pytest.approx((p - half, p + half)))


def test_agrees_with_a_bootstrap_over_classes():
    rng = np.random.default_rng(2)
    scores, classes = draw(rng, 60)
    other = np.clip(scores - rng.uniform(0, 0.4, len(scores)), 0, 1)
    members = [np.flatnonzero(classes == one) for one in np.unique(classes)]
    means, gaps = [], []
    for _ in range(3000):
        drawn = np.concatenate([members[i] for i in rng.integers(0, len(members), len(members))])
        means.append(scores[drawn].mean())
        gaps.append((scores[drawn] - other[drawn]).mean())
    for found, sample in (
        (estimate_share(scores, classes)[1], means),
        (estimate_difference(scores, other, classes)[1], gaps),
    ):
        low, high = np.percentile(sample, (2.5, 97.5))
        assert found[1] - found[0] == pytest.approx(high - low, rel=0.12)
        assert found == pytest.approx((low, high), abs=0.12 * (high - low))


def test_covers_the_truth_where_images_as_draws_do_not():
    rng = np.random.default_rng(3)
    clustered = naive = 0
    for _ in range(400):
        scores, classes = draw(rng, 20, sizes=(10, 11))
        low, high = estimate_share(scores, classes)[1]
        clustered += low <= 0.5 <= high
        half = 1.96 * scores.std(ddof=1) / len(scores) ** 0.5
        naive += abs(scores.mean() - 0.5) <= half
    assert 0.92 <= clustered / 400 <= 0.98
    assert naive / 400 < 0.7


def test_where_nothing_can_be_told():
    two = np.array([0, 0, 1, 1])
    assert estimate_share(np.array([1.0, 0.5]), np.array([4, 4]))[1] is None
    assert estimate_share(np.full(4, 0.5), two)[1] is None
    assert estimate_difference(np.ones(4), np.full(4, 0.25), two)[1] is None
    for value, right in ((1.0, 6), (0.0, 0)):
        exact = binomtest(right, 6).proportion_ci(method="wilson")
        found = estimate_share(np.full(12, value), np.repeat(np.arange(6), 2))
        assert found == (value, pytest.approx((exact.low, exact.high)))
    assert estimate_share(np.array([1, 1, 1, 0.0]), two)[1] == (0.0, 1.0)  # two classes: far outside, cut off


@pytest.mark.parametrize("scale", [1, 7])
def test_bootstrap_without_spread_is_not_certain(scale):
    """Three places, of which the last is apart: what a bin of one place, or of equal answers, may say."""
    places = np.repeat([0, 1, 2], 4 * scale)
    bootstrap = ClusterBootstrap.of(places, 3)
    mixed, right = np.arange(len(places)) % 4 > 0, np.ones(len(places), bool)
    # a single place says nothing of others
    assert bootstrap.estimate(mixed, places == 2) == (0.75, None)
    # all right or all wrong: each place is a trial, as in `estimate_share`
    assert bootstrap.estimate(right) == estimate_share(right.astype(float), places)
    assert bootstrap.estimate(~right) == (0.0, pytest.approx((0.0, 0.5615), abs=1e-4))
    # equal shares of all places, and differences that are all 0, have no interval
    assert bootstrap.estimate(mixed) == (0.75, None)
    assert bootstrap.estimate(np.zeros(len(places))) == (0.0, None)
    low, high = bootstrap.estimate(places > 0)[1]
    assert low < 2 / 3 <= high
