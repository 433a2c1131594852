"""Metrics of predictions: accuracy of groups, two variants on the same poses, changed pairs, and clusters.

Images of a place or of a class are not independent draws, so intervals and tests count their clusters.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Any, Protocol, TypeVar

import numpy as np

from toolkit.captures.capture import UNPATCHED, Capture
from toolkit.captures.read import POOLED
from toolkit.core.lazy import scipy
from toolkit.core.statistics import (
    Interval,
    PairedOutcomes,
    RankCorrelation,
    percentile_interval,
    rank_correlation,
    resample_clusters,
    sign_flip_p,
    wilson_interval,
)
from toolkit.evaluation.prediction import Prediction
from toolkit.rig.variants import CONTROLS, CONTROLS_OF, NOUNS, VARIANTS

NO_SPREAD = 1e-12
Estimate = tuple[float, Interval | None]
"""A mean over items, and its interval over clusters; None for a single cluster, or without spread."""
PATCHED, TEXTURED, WRONG, ALONE = "patched", "textured", "wrong-patch", "patch-alone"
MAX_FLIPS = 40
MOST_NAMES = 20
"""Largest number of an object's variants in a reason."""


def estimate_share(scores: np.ndarray, cluster_of: np.ndarray) -> Estimate:
    """Return the mean of `scores` in [0, 1], and a 95 % interval with clusters as independent draws.

    With total y_c and number of items x_c of cluster c, of C, the mean is the ratio p = Σ y_c / Σ x_c, and

        v = C / (C - 1) · Σ (y_c - p x_c)² / (Σ x_c)²,    p ± t(0.975, C - 1) √v

    the ratio estimator of a sample of C whole clusters (Cochran, Sampling Techniques, 3rd ed. 1977, sections 6.3 and
    9A.1, with no finite population; the same as the cluster-robust variance of a mean). If all items are right, or all
    wrong, v is 0: then it is Wilson's interval with each cluster as a trial.

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
    """Return the mean of `scores - other` on the same items, and the paired interval of `estimate_share`."""
    mean, half, n_clusters = _ratio(np.asarray(scores, float) - other, cluster_of)
    if n_clusters == 1 or half <= NO_SPREAD:
        return mean, None
    return mean, (max(-1.0, mean - half), min(1.0, mean + half))


def _ratio(scores: np.ndarray, cluster_of: np.ndarray) -> tuple[float, float, int]:
    """Return the ratio, the half width of its interval, and the number of clusters."""
    _, member = np.unique(cluster_of, return_inverse=True)
    totals, sizes = np.bincount(member, weights=scores), np.bincount(member)
    n_clusters = len(sizes)
    mean = float(totals.sum() / sizes.sum())
    if n_clusters == 1:
        return mean, 0.0, 1
    # residuals y_c - p x_c: the linearised variance of a ratio of totals
    spread = n_clusters / (n_clusters - 1) * float(((totals - mean * sizes) ** 2).sum())
    # Student's t: with few clusters the spread itself is uncertain
    return mean, float(scipy.stats.t.ppf(0.975, n_clusters - 1)) * sqrt(spread) / float(sizes.sum()), n_clusters


@dataclass(frozen=True)
class ClusterBootstrap:
    """Bootstrap over clusters of items.

    Attributes:
        cluster_of: (n,) int, the cluster of each item, from 0.
        weights: (b, count) number of times that each cluster is in each sample.
    """

    cluster_of: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, cluster_of: np.ndarray, count: int) -> "ClusterBootstrap":
        """Return samples that depend on the number of clusters alone; none for a single cluster."""
        return cls(cluster_of, resample_clusters(count) if count > 1 else np.zeros((0, 1)))

    def shares(self, values: np.ndarray, among: np.ndarray | None = None) -> np.ndarray:
        """Return (1 + b,) means of values (n,) of the items in `among` (n,) bool: observed, then of each sample."""
        own = np.ones(len(values), bool) if among is None else among
        count = self.weights.shape[1]
        total = np.bincount(self.cluster_of[own], values[own].astype(float), count)
        n = np.bincount(self.cluster_of[own], minlength=count).astype(float)
        # the first row is the observed sample: every cluster once
        weights = np.concatenate([np.ones((1, count)), self.weights])
        with np.errstate(invalid="ignore", divide="ignore"):
            return (weights @ total) / (weights @ n)

    def estimate(self, values: np.ndarray, among: np.ndarray | None = None) -> tuple[float | None, Interval | None]:
        """Return mean and 95 % interval over clusters; None without items, no interval if all are of one cluster.

        Without any spread the interval is that of `estimate_share` for truth values, and None for others.
        """
        # first the mean itself, then the means of the draws
        found = self.shares(values, among)
        if np.isnan(found[0]):
            return None, None
        # without a spread the interval would be a point, which claims too much
        clusters = len(np.unique(self.cluster_of if among is None else self.cluster_of[among]))
        mean, interval = float(found[0]), percentile_interval(found[1:]) if clusters > 1 else None
        if interval and interval[0] == interval[1]:
            is_certain = values.dtype == bool and mean in (0, 1)
            interval = wilson_interval(round(mean) * clusters, clusters) if is_certain else None
        return mean, interval

    def sign_p(self, change: np.ndarray) -> float:
        """Return the exact p of the signs of the clusters' mean changes (n,)."""
        count = self.weights.shape[1]
        n = np.bincount(self.cluster_of, minlength=count)
        return sign_flip_p((np.bincount(self.cluster_of, change, count)[n > 0] / n[n > 0]).tolist())


RIVALS = {booster: tuple(name for name in names if name != ALONE) for booster, names in CONTROLS_OF.items()}
"""Booster -> the controls that take its place on the object."""
OWNERS = {control: booster for booster, names in CONTROLS_OF.items() for control in names}
"""Control -> its booster."""
COMPARED = (
    *((booster, control) for booster, controls in CONTROLS_OF.items() for control in controls),
    (PATCHED, TEXTURED),
    (UNPATCHED, WRONG),
)
"""Variants that are compared, besides each with `unpatched`, in this order."""
Item = TypeVar("Item")
Key = TypeVar("Key", bound=Hashable)


class HasCapture(Protocol):
    """A result for an image."""

    @property
    def capture(self) -> Capture:
        """Image of the result."""


Shown = TypeVar("Shown", bound=HasCapture)
RowKey = tuple[str, str, str]
"""Source, object and variant."""
Poses = dict[tuple[str, str], dict[str, dict[int, Prediction]]]
"""(source, object) -> variant -> pose -> image."""


def rank_variant(variant: str) -> tuple[int, str]:
    """Return a sort key: `unpatched`, `patched`, `textured`, other boosters by name, controls as in `CONTROLS`."""
    if variant in CONTROLS:
        return len(VARIANTS) + CONTROLS.index(variant), variant
    return (VARIANTS.index(variant) if variant in VARIANTS else len(VARIANTS) - 1), variant


def name_booster(variant: str) -> str:
    """Return `the patch`, `the texture`, or the variant in quotes."""
    return f"the {NOUNS[variant]}" if variant in NOUNS else f"'{variant}'"


@dataclass(frozen=True)
class Group:
    """Results of an object and variant of a source; `object` is `all` for the pooled row.

    Attributes:
        n, failed: images classified, and images that could not be read.
        n_top1, n_top5: images with the true class as the first prediction, and among five.
        mean_true_prob: mean probability of the true class, None without images.
    """

    source: str
    object: str
    variant: str
    n: int
    failed: int
    n_top1: int
    n_top5: int
    mean_true_prob: float | None

    @property
    def top1(self) -> float | None:
        """Share of images with the true class as the first prediction."""
        return self.n_top1 / self.n if self.n else None

    @property
    def top5(self) -> float | None:
        """Share of images with the true class among five predictions."""
        return self.n_top5 / self.n if self.n else None

    @property
    def top1_ci95(self) -> Interval:
        """Wilson interval of `top1`."""
        return wilson_interval(self.n_top1, self.n)

    def as_json(self) -> dict[str, Any]:
        """Return the fields of `summary.json`."""
        head = {key: getattr(self, key) for key in ("source", "object", "variant", "n", "failed")}
        shares = {"top1": self.top1, "top5": self.top5, "top1_ci95": list(self.top1_ci95)}
        return head | shares | {"mean_true_prob": self.mean_true_prob}


@dataclass(frozen=True)
class Pair:
    """Two images of an object at the same pose, both read: in two variants, or of two sources."""

    first: Prediction
    second: Prediction

    @property
    def has_one_camera(self) -> bool:
        """Whether both cameras are the same, as far as they are known."""
        return self.first.capture.compare_cameras(self.second.capture) is None

    @property
    def is_alike(self) -> bool:
        """Whether both differ in the booster alone, as far as it is known."""
        return self.first.capture.explain_no_pair(self.second.capture) is None

    @property
    def is_gained(self) -> bool:
        """Whether the first is wrong and the second correct."""
        return self.second.correct_top1 and not self.first.correct_top1

    @property
    def is_lost(self) -> bool:
        """Whether the first is correct and the second wrong."""
        return self.first.correct_top1 and not self.second.correct_top1

    @property
    def change(self) -> float:
        """Probability of the true class in the second less that in the first."""
        return (self.second.true_prob or 0.0) - (self.first.true_prob or 0.0)


def describe_change(found: PairedOutcomes) -> dict[str, Any]:
    """Return `gained`, `lost` and `mcnemar_p` of the second against the first, as every summary has them."""
    return {"gained": found.only_second, "lost": found.only_first, "mcnemar_p": found.mcnemar_p}


@dataclass(frozen=True)
class Comparison:
    """Pairs that have something in common: two variants on the same poses, two sources, or two runs.

    Attributes:
        source, object: source and object of the pairs; `all` for pooled pairs.
        first, second: variants of each pair; for two sources or runs the same variant twice.
        pairs: images of the same pose, read in both; at least one pair.
    """

    source: str
    object: str
    first: str
    second: str
    pairs: tuple[Pair, ...]

    @cached_property
    def outcomes(self) -> PairedOutcomes:
        """Number of pairs with both, only the first, only the second or no image correct."""
        return PairedOutcomes.count((pair.first.correct_top1, pair.second.correct_top1) for pair in self.pairs)

    @cached_property
    def probs(self) -> tuple[list[float], list[float]]:
        """Probability of the true class in each first and second image."""
        both = [(pair.first.true_prob or 0.0, pair.second.true_prob or 0.0) for pair in self.pairs]
        return [first for first, _ in both], [second for _, second in both]

    @property
    def prob_first(self) -> float:
        """Mean probability of the true class in the first."""
        return sum(self.probs[0]) / len(self.pairs)

    @property
    def prob_second(self) -> float:
        """Mean probability of the true class in the second."""
        return sum(self.probs[1]) / len(self.pairs)

    @cached_property
    def rank(self) -> RankCorrelation:
        """Rank correlation of the true class's probability, over the pairs."""
        return rank_correlation(*self.probs)

    @cached_property
    def commonest_mistake(self) -> tuple[str | None, int]:
        """Commonest wrong prediction with `second`, and its count; None and 0 if all are correct."""
        wrong = Counter(pair.second.top1_label for pair in self.pairs if not pair.second.correct_top1)
        # of equally common classes the first by name, so that results can be repeated
        return min(wrong.items(), key=lambda item: (-item[1], item[0] or ""), default=(None, 0))

    def as_pair(self) -> dict[str, Any]:
        """Return an entry of `pairs` in `summary.json`: a variant against `unpatched`, on these pairs alone."""
        found = self.outcomes
        head = {"source": self.source, "object": self.object, "variant": self.second, "n_pairs": found.n}
        return head | {"n_first": found.n_first, "n_second": found.n_second} | describe_change(found)

    def as_json(self) -> dict[str, Any]:
        """Return an entry of `comparisons` in `summary.json`."""
        found = self.outcomes
        return {
            "source": self.source, "object": self.object, "first": self.first, "second": self.second,
            "n_pairs": found.n, "n_first": found.n_first, "n_second": found.n_second,
            "only_first": found.only_first, "only_second": found.only_second, "mcnemar_p": found.mcnemar_p,
            "prob_first": self.prob_first, "prob_second": self.prob_second,
            "says": self.commonest_mistake[0], "n_says": self.commonest_mistake[1],
            "first_ci95": list(wilson_interval(found.n_first, found.n)),
            "second_ci95": list(wilson_interval(found.n_second, found.n)),
        }  # fmt: skip


def gather(items: Iterable[Item], keys_of: Callable[[Item], Iterable[Key]]) -> dict[Key, list[Item]]:
    """Return items by key; an item counts under each of its keys, such as its object and `all`."""
    found: dict[Key, list[Item]] = defaultdict(list)
    for item in items:
        for key in keys_of(item):
            found[key].append(item)
    return found


def rank_row(source: str, name: str, variant: str) -> tuple[str, bool, str, tuple[int, str]]:
    """Return a sort key of rows: by source, object (`all` last) and variant (see `rank_variant`)."""
    return source, name == POOLED, name, rank_variant(variant)


def group_images(images: Iterable[Shown]) -> dict[RowKey, list[Shown]]:
    """Return results by source, object (and `all`) and variant, in the order of `rank_row`."""

    def keys_of(shown: Shown) -> list[RowKey]:
        return [(shown.capture.source, name, shown.capture.variant) for name in (shown.capture.object, POOLED)]

    return dict(sorted(gather(images, keys_of).items(), key=lambda item: rank_row(*item[0])))


def group_predictions(predictions: Sequence[Prediction]) -> list[Group]:
    """Return the accuracy of each group of `group_images`."""
    groups = []
    for key, members in group_images(predictions).items():
        # shares are of images that were read
        read = [prediction for prediction in members if prediction.is_read]
        n_top1, n_top5 = sum(item.correct_top1 for item in read), sum(item.correct_top5 for item in read)
        mean = sum(prediction.true_prob or 0.0 for prediction in read) / len(read) if read else None
        groups.append(Group(*key, len(read), len(members) - len(read), n_top1, n_top5, mean))
    return groups


def index_poses(predictions: Iterable[Prediction]) -> Poses:
    """Return images by source and object, variant and pose; of several images of a pose the first that was read."""
    by_pose: Poses = defaultdict(lambda: defaultdict(dict))
    for prediction in predictions:
        poses = by_pose[(prediction.capture.source, prediction.capture.object)][prediction.capture.variant]
        # images without a pose cannot be paired
        if prediction.capture.pose_id is not None:
            first = poses.get(prediction.capture.pose_id)
            if first is None or (prediction.is_read and not first.is_read):
                poses[prediction.capture.pose_id] = prediction
    return by_pose


def pair_variants(poses: Poses, first: str, second: str) -> list[Pair]:
    """Return the pairs of two variants at the same pose and camera, by source and object, poses ascending."""
    both = [variants for variants in poses.values() if first in variants and second in variants]
    return [pair for variants in both for pair in _pair_poses(variants[first], variants[second])]


def _pair_poses(first: dict[int, Prediction], other: dict[int, Prediction]) -> list[Pair]:
    shared = [Pair(first[pose], other[pose]) for pose in sorted(first.keys() & other.keys())]
    # pose 3 of two plans is not the same camera, and other light makes another image
    return [pair for pair in shared if pair.first.is_read and pair.second.is_read and pair.is_alike]


PairsOf = dict[str, list[Pair]]
"""Variant -> its pairs with `unpatched`."""


def pair_with_unpatched(poses: Poses) -> PairsOf:
    """Return the pairs of each variant with `unpatched`; variants without a pair are left out."""
    found: PairsOf = defaultdict(list)
    for variants in poses.values():  # objects may have different variants
        unpatched = variants.get(UNPATCHED, {})
        for name in variants.keys() - {UNPATCHED} if unpatched else ():
            found[name] += _pair_poses(unpatched, variants[name])
    return {name: found[name] for name in sorted(found, key=rank_variant) if found[name]}


def compare_pairs(pairs: Iterable[Pair]) -> list[Comparison]:
    """Return comparisons of two variants by source and object, `all` last."""

    def keys_of(pair: Pair) -> list[tuple[str, str, str, str]]:
        capture, variants = pair.second.capture, (pair.first.capture.variant, pair.second.capture.variant)
        return [(capture.source, name, *variants) for name in (capture.object, POOLED)]

    return [Comparison(*key, tuple(own)) for key, own in gather(pairs, keys_of).items()]


def explain_pooling(rows: Sequence[Comparison]) -> list[str]:
    """Return a line for each pooled row whose objects have unequal numbers of pairs."""
    # pairs by object, pooled rows left out
    counts: dict[tuple[str, str, str], dict[str, int]] = defaultdict(dict)
    for row in rows:
        if row.object != POOLED:
            counts[row.source, row.first, row.second][row.object] = len(row.pairs)
    lines = []
    # pooled rows count pairs, so objects with more pairs count more
    for (source, first, second), own in counts.items():
        fewest, most = min(own, key=lambda name: own[name]), max(own, key=lambda name: own[name])
        if own[fewest] < own[most]:
            which = f"{fewest} {own[fewest]}, {most} {own[most]}"
            both = second if first == second else f"{second} against {first}"
            lines.append(
                f"{source}: objects have unequal numbers of pairs ({which}); in row 'all' of {both}, and in its test, "
                "those with more count more"
            )
    return lines


def compare_unpatched(paired: PairsOf) -> list[Comparison]:
    """Compare each variant with `unpatched`, by source, object (`all` last) and variant."""
    return _sort_rows([row for pairs in paired.values() for row in compare_pairs(pairs)])


def compare_controls(poses: Poses) -> list[Comparison]:
    """Compare the variants of `COMPARED` that were shot, by source and object, `all` last."""
    return _sort_rows([row for names in COMPARED for row in compare_pairs(pair_variants(poses, *names))])


def _sort_rows(rows: list[Comparison]) -> list[Comparison]:
    return sorted(rows, key=lambda row: (row.source, row.object == POOLED, row.object))  # stable: variants keep order


def explain_unpaired(predictions: Sequence[Prediction], poses: Poses, paired: PairsOf) -> list[tuple[str, str]]:
    """Return (path, reason) of every readable image without a partner in `unpatched`, or in any other variant.

    Objects with a single variant have no pairs, and are not listed.
    """
    known = {id(prediction) for pairs in paired.values() for pair in pairs for prediction in (pair.first, pair.second)}
    left = [prediction for prediction in predictions if prediction.is_read and id(prediction) not in known]
    # possible partners: the other side, unmodified or modified, of the same pose
    partners: dict[tuple[tuple[str, str], bool, int], list[Prediction]] = defaultdict(list)
    for key, variants in poses.items() if left else ():
        for name, own in variants.items():
            for pose_id, prediction in own.items():
                partners[key, name == UNPATCHED, pose_id].append(prediction)
    unpaired = []
    for prediction in left:
        capture, key = prediction.capture, (prediction.capture.source, prediction.capture.object)
        # an object in a single variant was not meant to be paired
        if len(poses[key]) == 1:
            continue
        is_unpatched = capture.variant == UNPATCHED
        others = partners.get((key, not is_unpatched, capture.pose_id), []) if capture.pose_id is not None else []
        if reason := _why_unpaired(prediction, others, poses[key] if is_unpatched else (UNPATCHED,)):
            unpaired.append((capture.path, reason))
    return unpaired


def _why_unpaired(prediction: Prediction, partners: list[Prediction], names: Collection[str]) -> str | None:
    pose_id = prediction.capture.pose_id
    if pose_id is None:
        return "no pose number in its name: give both images of a pose the same number"
    if not partners:
        many = len(names) > MOST_NAMES
        wanted = "other" if many else " or ".join(sorted({*names} - {UNPATCHED})) or UNPATCHED
        return f"no {wanted} image of pose {pose_id}"
    if not any(partner.is_read for partner in partners):
        return f"its partner {partners[0].capture.path} could not be read"
    # a partner exists: it must differ in the booster alone
    gap = ""
    for partner in partners:
        if partner.is_read:
            found = prediction.capture.explain_no_pair(partner.capture)
            if found is None:  # a single partner that differs in the booster alone is enough
                return None
            gap = gap or found
    return f"{NO_PAIR}{gap} than {partners[0].capture.path}"


NO_PAIR = "no pair: "
"""Start of the reason for an image whose partner differs in more than the booster."""


def count_no_pairs(poses: Poses) -> list[tuple[str, int]]:
    """Return the reasons why images of a pose form no pair, such as `sim/patched: other light`, with counts."""
    reasons: Counter[str] = Counter()
    for (source, _), variants in poses.items():
        unpatched = variants.get(UNPATCHED, {})
        for name, own in variants.items():
            for pose in unpatched.keys() & own.keys() if name != UNPATCHED else ():
                first, second = unpatched[pose], own[pose]
                if first.is_read and second.is_read and (why := first.capture.explain_no_pair(second.capture)):
                    # without the angle between two cameras, which is of this pair alone
                    reasons[f"{source}/{name}: {why.partition(' (')[0]}"] += 1
    return list(reasons.items())


@dataclass(frozen=True)
class FlipList:
    """Pairs that changed in the same direction.

    Attributes:
        kind: `gained` or `lost`.
        shown: pairs to show: by variant, boosters before controls, the largest change first.
        counts: (variant, number of pairs), in the order of `rank_variant`.
    """

    kind: str
    shown: tuple[Pair, ...]
    counts: tuple[tuple[str, int], ...]

    @property
    def n(self) -> int:
        """Number of pairs."""
        return sum(count for _, count in self.counts)


def list_flips(paired: PairsOf) -> tuple[FlipList, FlipList]:
    """Return the pairs gained and lost against `unpatched`, without `patch-alone`; at most 40 of each are shown."""
    pairs = [pair for name, own in paired.items() if name != ALONE for pair in own]
    gained, lost = [pair for pair in pairs if pair.is_gained], [pair for pair in pairs if pair.is_lost]
    return _pick_flips("gained", gained), _pick_flips("lost", lost)


def _pick_flips(kind: str, flips: list[Pair]) -> FlipList:
    flips.sort(key=lambda pair: (rank_variant(pair.second.capture.variant), -abs(pair.change)))
    counts = Counter(pair.second.capture.variant for pair in flips)
    return FlipList(kind, tuple(flips[:MAX_FLIPS]), tuple(counts.items()))
