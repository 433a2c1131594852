"""Which pairs became right or wrong, and which of them are shown."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.core.statistics import mcnemar_p, wilson_interval
from toolkit.evaluation.predict import Prediction
from toolkit.rig.variants import CONTROLS, CONTROLS_OF, VARIANTS

PATCHED, TEXTURED, WRONG, ALONE = "patched", "textured", "wrong-patch", "patch-alone"
NOUNS = {PATCHED: "patch", TEXTURED: "texture"}
RIVALS = {booster: tuple(name for name in names if name != ALONE) for booster, names in CONTROLS_OF.items()}
"""By booster, the controls that are on the object where the booster was."""
OWNERS = {control: booster for booster, names in CONTROLS_OF.items() for control in names}
"""By control, the booster that it belongs to."""


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
    def top1_ci95(self) -> tuple[float, float]:
        """Wilson interval of `top1`."""
        return wilson_interval(self.n_top1, self.n)

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        head = {key: getattr(self, key) for key in ("source", "object", "variant", "n", "failed")}
        shares = {"top1": self.top1, "top5": self.top5, "top1_ci95": list(self.top1_ci95)}
        return head | shares | {"mean_true_prob": self.mean_true_prob}


@dataclass(frozen=True)
class Pair:
    """A variant against `unpatched`, pose by pose.

    Attributes:
        n_pairs: poses seen in both and read in both.
        gained: wrong before, right with the booster.
        lost: right before, wrong with the booster.
        mcnemar_p: of gained against lost.
    """

    source: str
    object: str
    variant: str
    n_pairs: int
    gained: int
    lost: int
    mcnemar_p: float

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        return asdict(self)


@dataclass(frozen=True)
class Match:
    """The two images of one pose, both read."""

    before: Prediction
    after: Prediction

    @property
    def is_gained(self) -> bool:
        """Wrong before, right after."""
        return self.after.correct_top1 and not self.before.correct_top1

    @property
    def is_lost(self) -> bool:
        """Right before, wrong after."""
        return self.before.correct_top1 and not self.after.correct_top1


def group_predictions(predictions: Sequence[Prediction]) -> list[Group]:
    """Rows by source, object (`all` last) and variant (see `rank_variant`)."""
    members: dict[tuple[str, str, str], list[Prediction]] = defaultdict(list)
    for one in predictions:
        for name in (one.capture.object, POOLED):
            members[(one.capture.source, name, one.capture.variant)].append(one)
    return [_group(key, members[key]) for key in sorted(members, key=_row_order)]


def index_poses(predictions: Iterable[Prediction]) -> dict[tuple[str, str], dict[str, dict[int, Prediction]]]:
    """(source, object) -> variant -> pose -> image: of several of one pose the first that was read."""
    by_pose: dict[tuple[str, str], dict[str, dict[int, Prediction]]] = defaultdict(lambda: defaultdict(dict))
    for one in predictions:
        poses = by_pose[(one.capture.source, one.capture.object)][one.capture.variant]
        if one.capture.pose_id is not None:
            first = poses.get(one.capture.pose_id)
            if first is None or (one.is_read and not first.is_read):
                poses[one.capture.pose_id] = one
    return by_pose


def match_pairs(predictions: Sequence[Prediction]) -> tuple[list[Match], list[tuple[str, str]]]:
    """Pair each variant's images with `unpatched` by pose.

    Of several images of one pose the first that was read is taken.

    Returns:
        The matches, and (path, reason) of every image that was read and has no partner. Where an object was seen in one
        variant only, nothing can be paired and nothing is listed.
    """
    by_pose = index_poses(predictions)
    matches: list[Match] = []
    unpaired: list[tuple[str, str]] = []
    for one in predictions:
        capture, variants = one.capture, by_pose[(one.capture.source, one.capture.object)]
        if len(variants) == 1 or not one.is_read:
            continue
        others = [UNPATCHED] if capture.variant != UNPATCHED else [name for name in variants if name != UNPATCHED]
        pose_id = capture.pose_id
        reason = _why_unpaired(one, [variants.get(name, {}) for name in others], " or ".join(sorted(others)))
        if reason:
            unpaired.append((capture.path, reason))
        elif capture.variant != UNPATCHED and pose_id is not None and variants[capture.variant][pose_id] is one:
            matches.append(Match(variants[UNPATCHED][pose_id], one))
    return matches, unpaired


def compare_variants(matches: Iterable[Match]) -> list[Pair]:
    """Rows by source, object (`all` last) and variant."""
    members: dict[tuple[str, str, str], list[Match]] = defaultdict(list)
    for match in matches:
        capture = match.after.capture
        for name in (capture.object, POOLED):
            members[(capture.source, name, capture.variant)].append(match)
    rows = []
    for key in sorted(members, key=_row_order):
        gained, lost = sum(one.is_gained for one in members[key]), sum(one.is_lost for one in members[key])
        rows.append(Pair(*key, len(members[key]), gained, lost, mcnemar_p(gained, lost)))
    return rows


def _row_order(key: tuple[str, str, str]) -> tuple:
    source, name, variant = key
    return source, name == POOLED, name, rank_variant(variant)


def _group(key: tuple[str, str, str], members: list[Prediction]) -> Group:
    read = [one for one in members if one.is_read]
    mean = sum(one.true_prob or 0.0 for one in read) / len(read) if read else None
    return Group(
        *key,
        len(read),
        len(members) - len(read),
        sum(one.correct_top1 for one in read),
        sum(one.correct_top5 for one in read),
        mean,
    )


def _why_unpaired(one: Prediction, others: list[dict[int, Prediction]], name: str) -> str | None:
    pose_id = one.capture.pose_id
    if pose_id is None:
        return "no pose number in its name: give both images of a pose the same number"
    partners = [poses[pose_id] for poses in others if pose_id in poses]
    if not partners:
        return f"no {name} image of pose {pose_id}"
    if not any(partner.is_read for partner in partners):
        return f"its partner {partners[0].capture.path} could not be read"
    return None


MAX_FLIPS = 40


@dataclass(frozen=True)
class FlipList:
    """Pairs that changed one way.

    Attributes:
        kind: `gained` or `lost`.
        shown: the pairs that are shown: by variant, boosters before controls, the surest of each first.
        counts: (variant, how many there are), in the order of `rank_variant`.
    """

    kind: str
    shown: tuple[Match, ...]
    counts: tuple[tuple[str, int], ...]

    @property
    def n(self) -> int:
        """How many there are."""
        return sum(count for _, count in self.counts)


def list_flips(matches: Sequence[Match]) -> tuple[FlipList, FlipList]:
    """The pairs that were gained and those that were lost, at most 40 of each shown.

    `patch-alone` is left out: without the object its images are no before and after of one thing.
    """
    pairs = [match for match in matches if match.after.capture.variant != ALONE]
    return _pick("gained", [match for match in pairs if match.is_gained]), _pick(
        "lost", [match for match in pairs if match.is_lost]
    )


def _pick(kind: str, flips: list[Match]) -> FlipList:
    flips.sort(
        key=lambda match: (
            rank_variant(match.after.capture.variant),
            -abs((match.after.true_prob or 0) - (match.before.true_prob or 0)),
        )
    )
    counts = Counter(match.after.capture.variant for match in flips)
    return FlipList(
        kind, tuple(flips[:MAX_FLIPS]), tuple((name, counts[name]) for name in sorted(counts, key=rank_variant))
    )
