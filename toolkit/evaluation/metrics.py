"""What the predictions count up to: groups, two variants on the same poses, and the pairs that changed.

Items that are no independent draws (pictures of a place, images of a class) share what is seen: their clusters are
what intervals and tests count.
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
"""A mean over items, and its interval over clusters; None if it cannot be told: a single cluster, or no spread."""
PATCHED, TEXTURED, WRONG, ALONE = "patched", "textured", "wrong-patch", "patch-alone"
MAX_FLIPS = 40
MOST_NAMES = 20
"""Largest number of an object's variants in a reason."""


def estimate_share(scores: np.ndarray, cluster_of: np.ndarray) -> Estimate:
    """Mean of `scores` in [0, 1], with a 95 % interval that takes clusters, not items, as the independent draws.

    With total y_c and number of items x_c of cluster c, of C, the mean is the ratio p = Σ y_c / Σ x_c, and

        v = C / (C - 1) · Σ (y_c - p x_c)² / (Σ x_c)²,    p ± t(0.975, C - 1) √v

    the ratio estimator of a sample of C whole clusters (Cochran, Sampling Techniques, 3rd ed. 1977, sections 6.3 and
    9A.1, with no finite population; the same as the cluster-robust variance of a mean). Where all clusters are wholly
    right, or wholly wrong, v is 0 and says nothing: then it is Wilson's interval with each cluster as a single trial.

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
        """The same samples whenever there are as many clusters; none of a single cluster."""
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
        """Mean and its 95 % interval over clusters; None without items, and no interval for a single cluster."""
        found = self.shares(values, among)
        if np.isnan(found[0]):
            return None, None
        return float(found[0]), percentile_interval(found[1:]) if len(self.weights) else None

    def sign_p(self, change: np.ndarray) -> float:
        """Exact p of the signs of the clusters' mean changes (n,): a test that counts clusters alone."""
        count = self.weights.shape[1]
        n = np.bincount(self.cluster_of, minlength=count)
        return sign_flip_p((np.bincount(self.cluster_of, change, count)[n > 0] / n[n > 0]).tolist())


RIVALS = {booster: tuple(name for name in names if name != ALONE) for booster, names in CONTROLS_OF.items()}
"""By booster, the controls that are on the object where the booster was."""
OWNERS = {control: booster for booster, names in CONTROLS_OF.items() for control in names}
"""By control, the booster that it belongs to."""
COMPARED = (
    *((booster, control) for booster, controls in CONTROLS_OF.items() for control in controls),
    (PATCHED, TEXTURED),
    (UNPATCHED, WRONG),
)
"""The variants that are compared besides each with `unpatched`, in this order."""
Item = TypeVar("Item")
Key = TypeVar("Key", bound=Hashable)


class HasCapture(Protocol):
    """What was said of an image."""

    @property
    def capture(self) -> Capture:
        """The image."""


Shown = TypeVar("Shown", bound=HasCapture)
RowKey = tuple[str, str, str]
"""Source, object and variant."""
Poses = dict[tuple[str, str], dict[str, dict[int, Prediction]]]
"""(source, object) -> variant -> pose -> image."""


def rank_variant(variant: str) -> tuple[int, str]:
    """Sort key: `unpatched`, `patched`, `textured`, other boosters by name, controls as `CONTROLS` has them."""
    if variant in CONTROLS:
        return len(VARIANTS) + CONTROLS.index(variant), variant
    return (VARIANTS.index(variant) if variant in VARIANTS else len(VARIANTS) - 1), variant


def name_booster(variant: str) -> str:
    """`the patch`, `the texture`, or the variant in quotes."""
    return f"the {NOUNS[variant]}" if variant in NOUNS else f"'{variant}'"


@dataclass(frozen=True)
class Group:
    """Results of an object and variant of a source; `object` is `all` for the pooled row.

    Attributes:
        n, failed: images classified, and images that could not be read.
        n_top1, n_top5: how many are right at the first guess, and within five.
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
        """Share of images right at the first guess."""
        return self.n_top1 / self.n if self.n else None

    @property
    def top5(self) -> float | None:
        """Share of images with the truth among five guesses."""
        return self.n_top5 / self.n if self.n else None

    @property
    def top1_ci95(self) -> Interval:
        """Wilson interval of `top1`."""
        return wilson_interval(self.n_top1, self.n)

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
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
        """Whether both were taken from the same place, as far as it is known."""
        return self.first.capture.compare_cameras(self.second.capture) is None

    @property
    def is_alike(self) -> bool:
        """Both differ in the booster alone, as far as it is known."""
        return self.first.capture.explain_no_pair(self.second.capture) is None

    @property
    def is_gained(self) -> bool:
        """The first is wrong, the second right."""
        return self.second.correct_top1 and not self.first.correct_top1

    @property
    def is_lost(self) -> bool:
        """The first is right, the second wrong."""
        return self.first.correct_top1 and not self.second.correct_top1

    @property
    def change(self) -> float:
        """Probability of the true class in the second less that in the first."""
        return (self.second.true_prob or 0.0) - (self.first.true_prob or 0.0)


def describe_change(found: PairedOutcomes) -> dict[str, Any]:
    """`gained`, `lost` and `mcnemar_p` of pairs, as the summary of every experiment has them; the second is judged."""
    return {"gained": found.only_second, "lost": found.only_first, "mcnemar_p": found.mcnemar_p}


@dataclass(frozen=True)
class Comparison:
    """Pairs that have something in common: two variants on the same poses, two sources, or two runs.

    Attributes:
        source, object: of the pairs; `all` for those of all together.
        first, second: the variants of each pair; `unpatched` and another, a booster and its control, or twice the same.
        pairs: images of the same pose, read in both; at least a single pair.
    """

    source: str
    object: str
    first: str
    second: str
    pairs: tuple[Pair, ...]

    @cached_property
    def outcomes(self) -> PairedOutcomes:
        """Number of pairs of which both images, only the first, only the second or neither is correct."""
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
        """The commonest wrong first guess with `second`, and how often; None and 0 where it is always right."""
        wrong = Counter(pair.second.top1_label for pair in self.pairs if not pair.second.correct_top1)
        # of equally common classes the first by name, so that the same run says the same
        return min(wrong.items(), key=lambda item: (-item[1], item[0] or ""), default=(None, 0))

    def as_pair(self) -> dict[str, Any]:
        """One of the `pairs` of `summary.json`: a variant against `unpatched`, on the images of these pairs alone."""
        found = self.outcomes
        head = {"source": self.source, "object": self.object, "variant": self.second, "n_pairs": found.n}
        return head | {"n_first": found.n_first, "n_second": found.n_second} | describe_change(found)

    def as_json(self) -> dict[str, Any]:
        """One of the `comparisons` of `summary.json`."""
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
    """Return items by key; an item with several keys, as its object and `all`, counts under each."""
    found: dict[Key, list[Item]] = defaultdict(list)
    for item in items:
        for key in keys_of(item):
            found[key].append(item)
    return found


def rank_row(source: str, name: str, variant: str) -> tuple[str, bool, str, tuple[int, str]]:
    """Sort key of a table's rows: by source, object (`all` last) and variant (see `rank_variant`)."""
    return source, name == POOLED, name, rank_variant(variant)


def group_images(images: Iterable[Shown]) -> dict[RowKey, list[Shown]]:
    """What was said of images by source, object (`all` for all of them) and variant, in the order of `rank_row`."""

    def keys_of(shown: Shown) -> list[RowKey]:
        return [(shown.capture.source, name, shown.capture.variant) for name in (shown.capture.object, POOLED)]

    return dict(sorted(gather(images, keys_of).items(), key=lambda item: rank_row(*item[0])))


def group_predictions(predictions: Sequence[Prediction]) -> list[Group]:
    """The rows of `group_images`."""
    return [_count_group(key, members) for key, members in group_images(predictions).items()]


def _count_group(key: RowKey, members: list[Prediction]) -> Group:
    read = [prediction for prediction in members if prediction.is_read]
    return Group(
        *key,
        n=len(read),
        failed=len(members) - len(read),
        n_top1=sum(prediction.correct_top1 for prediction in read),
        n_top5=sum(prediction.correct_top5 for prediction in read),
        mean_true_prob=sum(prediction.true_prob or 0.0 for prediction in read) / len(read) if read else None,
    )


def index_poses(predictions: Iterable[Prediction]) -> Poses:
    """Images by source and object, variant and pose: of several of the same pose the first that was read."""
    by_pose: Poses = defaultdict(lambda: defaultdict(dict))
    for prediction in predictions:
        poses = by_pose[(prediction.capture.source, prediction.capture.object)][prediction.capture.variant]
        if prediction.capture.pose_id is not None:
            first = poses.get(prediction.capture.pose_id)
            if first is None or (prediction.is_read and not first.is_read):
                poses[prediction.capture.pose_id] = prediction
    return by_pose


def pair_variants(poses: Poses, first: str, second: str) -> list[Pair]:
    """The images of two variants at the same pose and camera, both read; by source and object, poses ascending."""
    found = (_pair_poses(variants[first], variants[second]) for variants in poses.values()
             if first in variants and second in variants)  # fmt: skip
    return [pair for pairs in found for pair in pairs]


def _pair_poses(first: dict[int, Prediction], other: dict[int, Prediction]) -> list[Pair]:
    shared = [Pair(first[pose], other[pose]) for pose in sorted(first.keys() & other.keys())]
    # pose 3 of two plans is not the same camera, and two lights do not give the same picture
    return [pair for pair in shared if pair.first.is_read and pair.second.is_read and pair.is_alike]


def pair_with_unpatched(poses: Poses) -> dict[str, list[Pair]]:
    """By variant, its images with those of `unpatched`; a variant of which none could be paired is left out."""
    found: dict[str, list[Pair]] = defaultdict(list)
    for variants in poses.values():  # each with its own: of many objects each may have variants that no other has
        bare = variants.get(UNPATCHED, {})
        for name in variants.keys() - {UNPATCHED} if bare else ():
            found[name] += _pair_poses(bare, variants[name])
    return {name: found[name] for name in sorted(found, key=rank_variant) if found[name]}


def compare_pairs(pairs: Iterable[Pair]) -> list[Comparison]:
    """Two variants by source and object, `all` last."""

    def keys_of(pair: Pair) -> list[tuple[str, str, str, str]]:
        capture, variants = pair.second.capture, (pair.first.capture.variant, pair.second.capture.variant)
        return [(capture.source, name, *variants) for name in (capture.object, POOLED)]

    return [Comparison(*key, tuple(own)) for key, own in gather(pairs, keys_of).items()]


def explain_pooling(rows: Sequence[Comparison]) -> list[str]:
    """A line for each source and variants whose pooled row has objects with unequal numbers of pairs."""
    counts: dict[tuple[str, str, str], dict[str, int]] = defaultdict(dict)
    for row in rows:
        if row.object != POOLED:
            counts[row.source, row.first, row.second][row.object] = len(row.pairs)
    lines = []
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


def compare_unpatched(poses: Poses) -> list[Comparison]:
    """Each variant against `unpatched`, by source, object (`all` last) and variant."""
    return _sort_rows([row for pairs in pair_with_unpatched(poses).values() for row in compare_pairs(pairs)])


def compare_controls(poses: Poses) -> list[Comparison]:
    """What `COMPARED` lists, by source and object, `all` last; what was not shot is not compared."""
    return _sort_rows([row for names in COMPARED for row in compare_pairs(pair_variants(poses, *names))])


def _sort_rows(rows: list[Comparison]) -> list[Comparison]:
    return sorted(rows, key=lambda row: (row.source, row.object == POOLED, row.object))  # stable: variants as they came


def explain_unpaired(predictions: Sequence[Prediction], poses: Poses) -> list[tuple[str, str]]:
    """(path, reason) of every image that was read and has no partner in `unpatched`, or in any other variant.

    Where an object was seen in a single variant, nothing can be paired and nothing is listed.
    """
    partners: dict[tuple[tuple[str, str], bool, int], list[Prediction]] = defaultdict(list)
    for key, variants in poses.items():
        for name, own in variants.items():
            for pose_id, prediction in own.items():
                partners[key, name == UNPATCHED, pose_id].append(prediction)
    unpaired = []
    for prediction in predictions:
        capture, key = prediction.capture, (prediction.capture.source, prediction.capture.object)
        if len(poses[key]) == 1 or not prediction.is_read:
            continue
        is_bare = capture.variant == UNPATCHED
        others = partners.get((key, not is_bare, capture.pose_id), []) if capture.pose_id is not None else []
        if reason := _why_unpaired(prediction, others, poses[key] if is_bare else (UNPATCHED,)):
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
    gap = ""
    for partner in partners:
        if partner.is_read:
            found = prediction.capture.explain_no_pair(partner.capture)
            if found is None:  # a partner that differs in the booster alone is enough
                return None
            gap = gap or found
    return f"{NO_PAIR}{gap} than {partners[0].capture.path}"


NO_PAIR = "no pair: "
"""Begins the reason of an image whose partner differs from it in more than the booster."""


def count_no_pairs(poses: Poses) -> list[tuple[str, int]]:
    """Return why pairs with `unpatched` were not formed, such as `sim/patched: other light`, and how many of each.

    Counted are images of one pose that were both read and differ in more than the booster.
    """
    reasons: Counter[str] = Counter()
    for (source, _), variants in poses.items():
        bare = variants.get(UNPATCHED, {})
        for name, own in variants.items():
            for pose in bare.keys() & own.keys() if name != UNPATCHED else ():
                first, second = bare[pose], own[pose]
                if first.is_read and second.is_read and (why := first.capture.explain_no_pair(second.capture)):
                    # the angle between two cameras is of this pair alone
                    reasons[f"{source}/{name}: {why.partition(' (')[0]}"] += 1
    return list(reasons.items())


@dataclass(frozen=True)
class FlipList:
    """Pairs that changed in the same direction.

    Attributes:
        kind: `gained` or `lost`.
        shown: the pairs that are shown: by variant, boosters before controls, the surest of each first.
        counts: (variant, how many there are), in the order of `rank_variant`.
    """

    kind: str
    shown: tuple[Pair, ...]
    counts: tuple[tuple[str, int], ...]

    @property
    def n(self) -> int:
        """How many there are."""
        return sum(count for _, count in self.counts)


def list_flips(poses: Poses) -> tuple[FlipList, FlipList]:
    """The pairs that were gained and those that were lost against `unpatched`, at most 40 of each shown.

    `patch-alone` is left out: without the object its images are no before and after of the same object.
    """
    pairs = [pair for name, own in pair_with_unpatched(poses).items() if name != ALONE for pair in own]
    gained, lost = [pair for pair in pairs if pair.is_gained], [pair for pair in pairs if pair.is_lost]
    return _pick_flips("gained", gained), _pick_flips("lost", lost)


def _pick_flips(kind: str, flips: list[Pair]) -> FlipList:
    flips.sort(key=lambda pair: (rank_variant(pair.second.capture.variant), -abs(pair.change)))
    counts = Counter(pair.second.capture.variant for pair in flips)
    return FlipList(kind, tuple(flips[:MAX_FLIPS]), tuple(counts.items()))
