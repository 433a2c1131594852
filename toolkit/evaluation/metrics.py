"""What the predictions count up to: groups, two variants on the same poses, and the pairs that changed."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.core.statistics import Interval, PairedOutcomes, wilson_interval
from toolkit.evaluation.predict import Prediction
from toolkit.rig.variants import CONTROLS, CONTROLS_OF, VARIANTS

PATCHED, TEXTURED, WRONG, ALONE = "patched", "textured", "wrong-patch", "patch-alone"
NOUNS = {PATCHED: "patch", TEXTURED: "texture"}
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
    """Results of one object and variant of one source; `object` is `all` for the pooled row.

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
    """Two images of one object at one pose, both read: in two variants, or of two sources."""

    first: Prediction
    second: Prediction

    @property
    def has_one_camera(self) -> bool:
        """Both were taken from one place, as far as it is known."""
        return self.first.capture.tell_cameras_apart(self.second.capture) is None

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


def count_outcomes(pairs: Iterable[Pair]) -> PairedOutcomes:
    """Of how many pairs both images, one alone or neither is right."""
    return PairedOutcomes.count((pair.first.correct_top1, pair.second.correct_top1) for pair in pairs)


@dataclass(frozen=True)
class Comparison:
    """Two variants on the same poses; `object` is `all` for the pooled row of a source.

    Attributes:
        first, second: the variants: `unpatched` and another, a booster and its control, or `patched` and `textured`.
        outcomes: of the poses seen in both and read in both.
        prob_first, prob_second: mean probability of the true class.
        mistake, n_mistakes: the commonest wrong first guess with `second`, and how often; None and 0 where it is always
            right.
    """

    source: str
    object: str
    first: str
    second: str
    outcomes: PairedOutcomes
    prob_first: float
    prob_second: float
    mistake: str | None
    n_mistakes: int

    def as_pair(self) -> dict[str, Any]:
        """One of the `pairs` of `summary.json`: a variant against `unpatched`."""
        found = self.outcomes
        counts = {"n_pairs": found.n, "gained": found.only_second, "lost": found.only_first}
        head = {"source": self.source, "object": self.object, "variant": self.second}
        return head | counts | {"mcnemar_p": found.mcnemar_p}

    def as_json(self) -> dict[str, Any]:
        """One of the `comparisons` of `summary.json`."""
        found = self.outcomes
        return {
            "source": self.source, "object": self.object, "first": self.first, "second": self.second,
            "n_pairs": found.n, "n_first": found.n_first, "n_second": found.n_second,
            "only_first": found.only_first, "only_second": found.only_second, "mcnemar_p": found.mcnemar_p,
            "prob_first": self.prob_first, "prob_second": self.prob_second,
            "says": self.mistake, "n_says": self.n_mistakes,
            "first_ci95": list(wilson_interval(found.n_first, found.n)),
            "second_ci95": list(wilson_interval(found.n_second, found.n)),
        }  # fmt: skip


def group_predictions(predictions: Sequence[Prediction]) -> list[Group]:
    """Rows by source, object (`all` last) and variant (see `rank_variant`)."""
    members: dict[tuple[str, str, str], list[Prediction]] = defaultdict(list)
    for one in predictions:
        for name in (one.capture.object, POOLED):
            members[(one.capture.source, name, one.capture.variant)].append(one)

    def order(key: tuple[str, str, str]) -> tuple[str, bool, str, tuple[int, str]]:
        return key[0], key[1] == POOLED, key[1], rank_variant(key[2])

    return [_count_group(key, members[key]) for key in sorted(members, key=order)]


def _count_group(key: tuple[str, str, str], members: list[Prediction]) -> Group:
    read = [one for one in members if one.is_read]
    return Group(
        *key,
        n=len(read),
        failed=len(members) - len(read),
        n_top1=sum(one.correct_top1 for one in read),
        n_top5=sum(one.correct_top5 for one in read),
        mean_true_prob=sum(one.true_prob or 0.0 for one in read) / len(read) if read else None,
    )


def index_poses(predictions: Iterable[Prediction]) -> Poses:
    """Images by source and object, variant and pose: of several of one pose the first that was read."""
    by_pose: Poses = defaultdict(lambda: defaultdict(dict))
    for one in predictions:
        poses = by_pose[(one.capture.source, one.capture.object)][one.capture.variant]
        if one.capture.pose_id is not None:
            first = poses.get(one.capture.pose_id)
            if first is None or (one.is_read and not first.is_read):
                poses[one.capture.pose_id] = one
    return by_pose


def pair_variants(poses: Poses, first: str, second: str) -> list[Pair]:
    """The images of two variants at the same pose and camera, both read; by source and object, poses ascending."""
    pairs = []
    for variants in poses.values():
        one, other = variants.get(first, {}), variants.get(second, {})
        shared = [Pair(one[pose], other[pose]) for pose in sorted(one.keys() & other.keys())]
        pairs += [pair for pair in shared if pair.first.is_read and pair.second.is_read and pair.has_one_camera]
    return pairs


def pair_with_unpatched(poses: Poses) -> dict[str, list[Pair]]:
    """By variant, its images with those of `unpatched`; a variant of which none could be paired is left out."""
    names = sorted({name for variants in poses.values() for name in variants} - {UNPATCHED}, key=rank_variant)
    found = {name: pair_variants(poses, UNPATCHED, name) for name in names}
    return {name: pairs for name, pairs in found.items() if pairs}


def compare_pairs(pairs: Iterable[Pair]) -> list[Comparison]:
    """Two variants by source and object, `all` last."""
    members: dict[tuple[str, str], list[Pair]] = defaultdict(list)
    for pair in pairs:
        for name in (pair.second.capture.object, POOLED):
            members[(pair.second.capture.source, name)].append(pair)
    return [_compare(*key, own) for key, own in members.items()]


def compare_unpatched(poses: Poses) -> list[Comparison]:
    """Each variant against `unpatched`, by source, object (`all` last) and variant."""
    return _sort_rows([row for pairs in pair_with_unpatched(poses).values() for row in compare_pairs(pairs)])


def compare_controls(poses: Poses) -> list[Comparison]:
    """What `COMPARED` lists, by source and object, `all` last; what was not shot is not compared."""
    return _sort_rows([row for names in COMPARED for row in compare_pairs(pair_variants(poses, *names))])


def _sort_rows(rows: list[Comparison]) -> list[Comparison]:
    return sorted(rows, key=lambda row: (row.source, row.object == POOLED, row.object))  # stable: variants as they came


def _compare(source: str, name: str, pairs: list[Pair]) -> Comparison:
    wrong = Counter(pair.second.top1_label for pair in pairs if not pair.second.correct_top1)
    mistake, n_mistakes = min(wrong.items(), key=lambda item: (-item[1], item[0] or ""), default=(None, 0))
    return Comparison(
        source,
        name,
        first=pairs[0].first.capture.variant,
        second=pairs[0].second.capture.variant,
        outcomes=count_outcomes(pairs),
        prob_first=sum(pair.first.true_prob or 0.0 for pair in pairs) / len(pairs),
        prob_second=sum(pair.second.true_prob or 0.0 for pair in pairs) / len(pairs),
        mistake=mistake,
        n_mistakes=n_mistakes,
    )


def explain_unpaired(predictions: Sequence[Prediction], poses: Poses) -> list[tuple[str, str]]:
    """(path, reason) of every image that was read and has no partner in `unpatched`, or in any other variant.

    Where an object was seen in one variant only, nothing can be paired and nothing is listed.
    """
    unpaired = []
    for one in predictions:
        capture, variants = one.capture, poses[(one.capture.source, one.capture.object)]
        if len(variants) == 1 or not one.is_read:
            continue
        others = [UNPATCHED] if capture.variant != UNPATCHED else [name for name in variants if name != UNPATCHED]
        reason = _why_unpaired(one, [variants.get(name, {}) for name in others], " or ".join(sorted(others)))
        if reason:
            unpaired.append((capture.path, reason))
    return unpaired


def _why_unpaired(one: Prediction, others: list[dict[int, Prediction]], name: str) -> str | None:
    pose_id = one.capture.pose_id
    if pose_id is None:
        return "no pose number in its name: give both images of a pose the same number"
    partners = [poses[pose_id] for poses in others if pose_id in poses]
    if not partners:
        return f"no {name} image of pose {pose_id}"
    if not any(partner.is_read for partner in partners):
        return f"its partner {partners[0].capture.path} could not be read"
    gaps = [one.capture.tell_cameras_apart(partner.capture) for partner in partners if partner.is_read]
    if all(gaps):
        return (
            f"its camera and that of {partners[0].capture.path} differ ({gaps[0]}): another plan was in use, so take "
            "both variants again with one plan"
        )
    return None
