"""What a handful of images can show: an interval for a share, an exact test for pairs."""

from math import sqrt

Z_95 = 1.959963984540054


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> tuple[float, float]:
    """Wilson score interval of a proportion, 95 % by default; (0, 1) without trials.

    It keeps its coverage for a few dozen trials and for shares near 0 and 1, where the usual ± interval fails
    (Wilson 1927; Brown, Cai and DasGupta 2001).
    """
    if trials == 0:
        return 0.0, 1.0
    share = successes / trials
    centre = share + z * z / (2 * trials)
    half = z * sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    low, high = (centre - half) / scale, (centre + half) / scale
    return (0.0 if successes == 0 else max(0.0, low)), (1.0 if successes == trials else min(1.0, high))


def mcnemar_p(gained: int, lost: int) -> float:
    """Two-sided exact McNemar p of paired right-or-wrong outcomes; 1 where no pair changed.

    Under the null, each pair that changed is as likely to be gained as lost (McNemar 1947): a binomial test.
    """
    from scipy.stats import binomtest

    return float(binomtest(gained, gained + lost, 0.5).pvalue) if gained + lost else 1.0
