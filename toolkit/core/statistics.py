"""Statistics of few images: intervals of shares, exact tests and intervals of pairs, bootstrap, ranks."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import atanh, sqrt, tanh

from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import np, scipy

Z_95 = 1.959963984540054
SIGNIFICANT = 0.05
Interval = tuple[float, float]


def wilson_interval(successes: int, trials: int) -> Interval:
    """Return the 95 % Wilson score interval of a proportion; (0, 1) without trials.

    It keeps its coverage for few trials and for shares near 0 and 1 (Wilson 1927; Brown, Cai and DasGupta 2001).

    Raises:
        ToolkitError: there are more successes than trials, or fewer than 0.
    """
    if not 0 <= successes <= trials:
        raise ToolkitError(f"{successes} successes of {trials} trials: expected 0 to {trials} of them")
    if trials == 0:
        return 0.0, 1.0
    share, z = successes / trials, Z_95
    # the roots p of (share - p)^2 = z^2 p (1 - p) / trials; SciPy's `proportion_ci` takes 400 times as long, for the
    # same but the last bit
    centre = share + z * z / (2 * trials)
    half = z * sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    low, high = (centre - half) / scale, (centre + half) / scale
    # with no or only successes the bound is exact, without rounding
    return (0.0 if successes == 0 else max(0.0, low)), (1.0 if successes == trials else min(1.0, high))


@lru_cache(maxsize=1 << 14)  # many groups have the same small numbers
def mcnemar_p(gained: int, lost: int) -> float:
    """Return the two-sided exact McNemar p of paired binary outcomes; 1 if no pair changed.

    Under the null, a changed pair is as likely gained as lost (McNemar 1947): a binomial test of the changed pairs.
    """
    # unchanged pairs do not count; half of the changed pairs would change either way by chance
    fewest, most, n = min(gained, lost), max(gained, lost), gained + lost
    if fewest == most:
        return 1.0
    try:
        # the functions behind `binomtest`, so equal to the bit; SciPy's statistics take a second to load
        from scipy.special._ufuncs import _binom_cdf, _binom_sf
    except ImportError:  # an earlier SciPy
        return float(scipy.stats.binomtest(gained, n, 0.5).pvalue)
    return min(1.0, float(_binom_cdf(fewest, n, 0.5) + _binom_sf(most - 1, n, 0.5)))


def mcnemar_mid_p(gained: int, lost: int) -> float:
    """Return the two-sided mid-p of McNemar: the exact p less half the probability of the observed counts.

    It is less conservative than the exact test, and nearly always keeps its level (Fagerland, Lydersen and Laake, BMC
    Medical Research Methodology 13, 2013). It is 1 if no pair changed.
    """
    n, fewest = gained + lost, min(gained, lost)
    if not n:
        return 1.0
    return float(min(1.0, 2 * (scipy.stats.binom.cdf(fewest, n, 0.5) - 0.5 * scipy.stats.binom.pmf(fewest, n, 0.5))))


def adjust_holm(ps: Sequence[float]) -> list[float]:
    """Return p values after Holm's step-down correction (Scandinavian Journal of Statistics 6, 1979), in order."""
    # SciPy has corrections of the false discovery rate alone
    adjusted, highest = [0.0] * len(ps), 0.0
    for rank, k in enumerate(sorted(range(len(ps)), key=lambda k: ps[k])):
        # the smallest p counts for all tests, the next for one test less; never below an earlier value
        highest = max(highest, min(1.0, (len(ps) - rank) * ps[k]))
        adjusted[k] = highest
    return adjusted


@dataclass(frozen=True)
class PairedOutcomes:
    """2 × 2 table of pairs: both, only the first, only the second, or neither correct."""

    both: int
    only_first: int
    only_second: int
    neither: int

    @classmethod
    def count(cls, outcomes: Iterable[tuple[bool, bool]]) -> "PairedOutcomes":
        """Return the table of (first is correct, second is correct) of every pair."""
        seen = Counter(outcomes)
        return cls(*(seen[cell] for cell in ((True, True), (True, False), (False, True), (False, False))))

    @property
    def n(self) -> int:
        """Number of pairs."""
        return self.both + self.only_first + self.only_second + self.neither

    @property
    def n_first(self) -> int:
        """Number of pairs with the first correct."""
        return self.both + self.only_first

    @property
    def n_second(self) -> int:
        """Number of pairs with the second correct."""
        return self.both + self.only_second

    @property
    def gain(self) -> float:
        """Accuracy of the second less that of the first."""
        return (self.only_second - self.only_first) / self.n

    @property
    def gain_ci95(self) -> Interval:
        """Interval of `gain`, see `paired_difference_interval`."""
        return paired_difference_interval(self.both, self.only_second, self.only_first, self.neither)

    @property
    def mcnemar_p(self) -> float:
        """Exact and two-sided, of `only_second` against `only_first`."""
        return mcnemar_p(self.only_second, self.only_first)

    @property
    def kappa(self) -> float | None:
        """See `cohen_kappa`."""
        return cohen_kappa(self.both, self.only_first, self.only_second, self.neither)

    @property
    def second_is_better(self) -> bool:
        """Whether the second is correct significantly more often."""
        return self.only_second > self.only_first and self.mcnemar_p < SIGNIFICANT

    @property
    def first_is_better(self) -> bool:
        """Whether the first is correct significantly more often."""
        return self.only_first > self.only_second and self.mcnemar_p < SIGNIFICANT


def paired_difference_interval(both: int, first_only: int, second_only: int, neither: int) -> Interval:
    """Return the 95 % interval of (first's share - second's share) on the same trials; (-1, 1) without trials.

    Method 10 of Newcombe (Statistics in Medicine 17, 2635-2650, 1998) combines the Wilson intervals of both shares with
    their phi correlation, corrected for continuity. It keeps its coverage for a dozen pairs, and without differences.
    """
    n = both + first_only + second_only + neither
    if n == 0:
        # nothing is known without pairs
        return -1.0, 1.0
    share_1, share_2 = (both + first_only) / n, (both + second_only) / n
    # each share's own interval, which Newcombe combines
    low_1, high_1 = wilson_interval(both + first_only, n)
    low_2, high_2 = wilson_interval(both + second_only, n)
    phi = _corrected_phi(both, first_only, second_only, neither)

    # √(a² - 2 φ a b + b²): two correlated deviations
    def reach(a: float, b: float) -> float:
        return sqrt(max(0.0, a * a - 2 * phi * a * b + b * b))

    # pairs with the same outcome twice count in n alone
    difference = (first_only - second_only) / n
    low = difference - reach(share_1 - low_1, high_2 - share_2)
    high = difference + reach(high_1 - share_1, share_2 - low_2)
    return max(-1.0, low), min(1.0, high)


def _corrected_phi(both: int, first_only: int, second_only: int, neither: int) -> float:
    """Return Newcombe's phi: a positive correlation is moved half a pair per cell to 0; 0 with an empty margin."""
    margins = (both + first_only) * (second_only + neither) * (both + second_only) * (first_only + neither)
    if margins == 0:
        return 0.0
    n = both + first_only + second_only + neither
    product = float(both * neither - first_only * second_only)
    if product > 0:
        product = max(product - n / 2, 0.0)
    return product / sqrt(margins)


def cohen_kappa(both: int, first_only: int, second_only: int, neither: int) -> float | None:
    """Return Cohen's kappa (1960) of two binary judges: 1 full agreement, 0 as by chance.

    None without trials, or if both judges give the same answer to everything.
    """
    n = both + first_only + second_only + neither
    yes_1, yes_2 = both + first_only, both + second_only
    # agreement of independent judges with these shares of yes
    by_chance = yes_1 * yes_2 + (n - yes_1) * (n - yes_2)  # times n², in whole numbers
    if by_chance == n * n:
        return None
    return ((both + neither) * n - by_chance) / (n * n - by_chance)


BOOTSTRAP_DRAWS = 4000


def resample_clusters(count: int) -> "np.ndarray":
    """Return (BOOTSTRAP_DRAWS, count) float: the number of times that each cluster is in each bootstrap sample.

    Trials of a cluster, such as images of a place, are drawn together (Field and Welsh 2007). With very few clusters
    the percentile intervals are too narrow: five clusters have 126 different samples.
    """
    # counts, not samples: `scipy.stats.bootstrap` would recompute each statistic from drawn rows
    rng = np.random.default_rng([0, count])
    return rng.multinomial(count, np.full(count, 1 / count), BOOTSTRAP_DRAWS).astype(float)


def percentile_interval(values: "np.ndarray") -> Interval | None:
    """Return the 2.5 and 97.5 % quantiles of bootstrapped values without NaN; None if over half are NaN."""
    known = values[~np.isnan(values)]
    if 2 * len(known) < len(values) or not len(known):
        return None
    # drawn values, never between two values: these may be infinite
    low, high = np.quantile(known, [0.025, 0.975], method="inverted_cdf")
    return float(low), float(high)


def sign_flip_p(differences: Sequence[float]) -> float:
    """Return the two-sided exact p of a sign-flip test of the mean of paired differences of clusters.

    The smallest p of k clusters is 2 / 2^k. For more than 16 clusters 65,536 patterns of signs are drawn.
    """
    found = np.asarray(differences, float)
    count = len(found)
    if count <= 16:
        # every pattern of signs, from the bits of its number: `scipy.stats.permutation_test` takes 18 times as long
        signs = 1 - 2 * ((np.arange(2**count)[:, None] >> np.arange(count)) & 1)
    else:
        # too many to list: drawn with a fixed seed
        signs = np.random.default_rng(count).choice([-1, 1], (2**16, count))
        # with the observed value among them, so that p is never 0
        signs[0] = 1
    means = np.abs(signs @ found)
    # tolerance for sums in another order
    return float((means >= abs(found.sum()) - 1e-12).mean())


FEWEST_RANKS, FEWEST_FOR_INTERVAL = 3, 5


@dataclass(frozen=True)
class RankCorrelation:
    """Spearman's rank correlation.

    Attributes:
        ci95: None for fewer than five pairs, or if all are in the same or opposite order.
        why: why `rho` is None.
    """

    n: int
    rho: float | None
    ci95: Interval | None = None
    why: str = ""


def rank_correlation(first: Sequence[float], second: Sequence[float]) -> RankCorrelation:
    """Return Spearman's rho of paired values, ties at their mean rank, with a 95 % interval.

    The interval is Fisher's z with the standard error √((1 + ρ²/2) / (n − 3)) of Bonett and Wright (Psychometrika 65,
    2000), which suits ranks better than 1/√(n − 3).
    """
    n = len(first)
    if n < FEWEST_RANKS:
        return RankCorrelation(n, None, why="too few")
    # ranks that are all equal have no order to compare
    if min(first) == max(first) or min(second) == max(second):
        return RankCorrelation(n, None, why="all equal")
    # rounding may leave [-1, 1]
    rho = max(-1.0, min(1.0, float(scipy.stats.spearmanr(first, second).statistic)))
    # an interval needs a finite z
    if n < FEWEST_FOR_INTERVAL or abs(rho) > 1 - 1e-12:
        return RankCorrelation(n, rho)
    # on Fisher's scale, z = atanh(rho)
    half = Z_95 * sqrt((1 + rho * rho / 2) / (n - 3))
    return RankCorrelation(n, rho, (tanh(atanh(rho) - half), tanh(atanh(rho) + half)))
