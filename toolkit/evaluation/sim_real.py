"""The rig against photographs, pose by pose: how far off it is, and whether it knows the hard poses."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import atanh, sqrt, tanh
from pathlib import PurePosixPath
from typing import Any

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.core.statistics import Z_95, mcnemar_p, wilson_interval
from toolkit.evaluation.metrics import rank_variant
from toolkit.evaluation.predict import Prediction

Poses = dict[tuple[str, str, int], list[Prediction]]
Reasons = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Couple:
    """A rendered image and a photograph of the same object, variant and pose, both read."""

    sim: Prediction
    real: Prediction

    @property
    def differs(self) -> bool:
        """Whether one is right and the other wrong: the rig predicted this pose wrongly."""
        return self.sim.correct_top1 != self.real.correct_top1

    @property
    def place(self) -> tuple[str, str, int | None]:
        """Object, variant and pose."""
        return self.real.capture.object, self.real.capture.variant, self.real.capture.pose_id

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        name, variant, pose_id = self.place
        head: dict[str, Any] = {"object": name, "variant": variant, "pose_id": pose_id}
        for key, one in (("sim", self.sim), ("real", self.real)):
            head |= {
                f"{key}_path": one.capture.path, f"{key}_right": one.correct_top1, f"{key}_says": one.top1_label,
                f"{key}_true_prob": one.true_prob,
            }  # fmt: skip
        return head


def couple_images(
    sims: Sequence[Prediction], reals: Sequence[Prediction]
) -> tuple[tuple[Couple, ...], Reasons, Reasons]:
    """Couple the images of two sources by object, variant and pose.

    Images whose manifests name different boosters are no couple. Of several images of one pose, those of one name are
    coupled, each once; where none are, the first that fit.

    Returns:
        The couples by object, variant and pose; and (path, reason) of the images of either source that were read and
        are in none.
    """
    sim_poses, real_poses = _index(sims), _index(reals)
    couples: list[Couple] = []
    for key in sorted(sim_poses.keys() & real_poses.keys(), key=lambda key: (key[0], rank_variant(key[1]), key[2])):
        fitting = [
            Couple(one, other) for one in sim_poses[key] for other in real_poses[key] if _same_booster(one, other)
        ]  # fmt: skip
        couples += _take_once(fitting) or fitting[:1]
    used = {id(one) for couple in couples for one in (couple.sim, couple.real)}
    return tuple(couples), _explain(sims, used, reals, real_poses), _explain(reals, used, sims, sim_poses)


def _index(members: Iterable[Prediction]) -> Poses:
    poses: Poses = defaultdict(list)
    for one in members:
        capture = one.capture
        if one.is_read and capture.pose_id is not None:
            poses[(capture.object, capture.variant, capture.pose_id)].append(one)
    return poses


def _same_booster(one: Prediction, other: Prediction) -> bool:
    known = {one.capture.booster_sha256, other.capture.booster_sha256} - {None}
    return len(known) < 2


def _take_once(candidates: Iterable[Couple]) -> list[Couple]:
    """Those that name each other, by their files, each image once."""
    taken: set[int] = set()
    chosen = []
    # pose_01.heic.jpg is the image like pose_01.heic, where there is a pose_01.jpg beside it
    for kind in ("name", "stem"):
        for couple in candidates:
            sim, real = PurePosixPath(couple.sim.capture.path), PurePosixPath(couple.real.capture.path)
            ids = {id(couple.sim), id(couple.real)}
            if sim.stem == getattr(real, kind) and not ids & taken:
                taken |= ids
                chosen.append(couple)
    return chosen


def _explain(
    members: Sequence[Prediction], used: set[int], others: Sequence[Prediction], poses: Poses
) -> tuple[tuple[str, str], ...]:
    """(path, reason) of the images of one source that were read and are in no couple."""
    other, left = others[0].capture.source if others else "the other", []
    for one in members:
        capture = one.capture
        if id(one) in used or not one.is_read:
            continue
        if capture.pose_id is None:
            left.append((capture.path, "no pose number in its name"))
            continue
        partners = poses.get((capture.object, capture.variant, capture.pose_id), [])
        reason = f"another image of pose {capture.pose_id} is compared"
        if not partners:
            reason = f"{other} has no image of {capture.object}, {capture.variant}, pose {capture.pose_id}"
        elif not any(_same_booster(one, partner) for partner in partners):
            reason = f"{other} has another patch or texture there, by the manifests' SHA-256"
        left.append((capture.path, reason))
    return tuple(left)


FEWEST_RANKS, FEWEST_FOR_INTERVAL = 3, 5


@dataclass(frozen=True)
class RankCorrelation:
    """Spearman's rank correlation.

    Attributes:
        n: pairs of values.
        rho: None where there is none.
        ci95: None where it cannot be given: fewer than five pairs, or all in the same or the opposite order.
        why: why `rho` is None, else empty.
    """

    n: int
    rho: float | None
    ci95: tuple[float, float] | None = None
    why: str = ""


def rank_correlation(first: Sequence[float], second: Sequence[float]) -> RankCorrelation:
    """Spearman's rho of paired values, ties at their mean rank, with a 95 % interval.

    The interval is Fisher's z with the standard error √((1 + ρ²/2) / (n − 3)) of Bonett and Wright (Psychometrika 65,
    2000), which keeps its coverage better than 1/√(n − 3) does for ranks.
    """
    from scipy.stats import spearmanr

    n = len(first)
    if n < FEWEST_RANKS:
        return RankCorrelation(n, None, why="too few")
    if min(first) == max(first) or min(second) == max(second):
        return RankCorrelation(n, None, why="all equal")
    rho = max(-1.0, min(1.0, float(spearmanr(first, second).statistic)))
    if n < FEWEST_FOR_INTERVAL or abs(rho) > 1 - 1e-12:
        return RankCorrelation(n, rho)
    half = Z_95 * sqrt((1 + rho * rho / 2) / (n - 3))
    return RankCorrelation(n, rho, (tanh(atanh(rho) - half), tanh(atanh(rho) + half)))


def paired_difference_interval(both: int, first_only: int, second_only: int, neither: int) -> tuple[float, float]:
    """95 % interval of (first's share - second's share) on the same trials; (-1, 1) without trials.

    Method 10 of Newcombe (Statistics in Medicine 17, 2635-2650, 1998): the Wilson intervals of both shares, squared and
    added, less twice their product with the phi correlation, which is corrected for continuity. It stays within ±1 and
    keeps its coverage for a dozen pairs and where none of them differ.
    """
    n = both + first_only + second_only + neither
    if n == 0:
        return -1.0, 1.0
    share_1, share_2 = (both + first_only) / n, (both + second_only) / n
    low_1, high_1 = wilson_interval(both + first_only, n)
    low_2, high_2 = wilson_interval(both + second_only, n)
    phi = _corrected_phi(both, first_only, second_only, neither)

    def reach(a: float, b: float) -> float:
        return sqrt(max(0.0, a * a - 2 * phi * a * b + b * b))

    difference = (first_only - second_only) / n
    low = difference - reach(share_1 - low_1, high_2 - share_2)
    high = difference + reach(high_1 - share_1, share_2 - low_2)
    return max(-1.0, low), min(1.0, high)


def _corrected_phi(both: int, first_only: int, second_only: int, neither: int) -> float:
    """Newcombe's: a positive one is brought half a pair per cell nearer to 0; 0 where a margin is empty."""
    margins = (both + first_only) * (second_only + neither) * (both + second_only) * (first_only + neither)
    if margins == 0:
        return 0.0
    n = both + first_only + second_only + neither
    product = float(both * neither - first_only * second_only)
    if product > 0:
        product = max(product - n / 2, 0.0)
    return product / sqrt(margins)


def cohen_kappa(both: int, first_only: int, second_only: int, neither: int) -> float | None:
    """Agreement of two yes-or-no judges beyond chance: 1 full, 0 as by chance (Cohen 1960); None where undefined.

    It is undefined without trials, and where both judges say the same thing of everything: there is nothing to tell
    apart.
    """
    n = both + first_only + second_only + neither
    yes_1, yes_2 = both + first_only, both + second_only
    by_chance = yes_1 * yes_2 + (n - yes_1) * (n - yes_2)  # times n², in whole numbers
    if by_chance == n * n:
        return None
    return ((both + neither) * n - by_chance) / (n * n - by_chance)


LIKE = "sim-like-"
"""Start of the names of sources that were shot with the cameras of photographs."""


@dataclass(frozen=True)
class SimRealRow:
    """One object and variant, or all objects: the couples counted.

    Attributes:
        n: couples.
        both, sim_only, real_only: right in both, in the rig alone, in the photograph alone.
        rank: rank correlation over the couples of the true class's probability.
    """

    object: str
    variant: str
    n: int
    both: int
    sim_only: int
    real_only: int
    rank: RankCorrelation

    @property
    def n_sim(self) -> int:
        """Right in the rig."""
        return self.both + self.sim_only

    @property
    def n_real(self) -> int:
        """Right in the photographs."""
        return self.both + self.real_only

    @property
    def gap(self) -> float:
        """Share right in the photographs less that in the rig: below 0, the rig promises too much."""
        return (self.real_only - self.sim_only) / self.n

    @property
    def gap_ci95(self) -> tuple[float, float]:
        """Newcombe's interval for paired shares."""
        return paired_difference_interval(
            self.both, self.real_only, self.sim_only, self.n - self.both - self.sim_only - self.real_only
        )

    @property
    def mcnemar_p(self) -> float:
        """Exact and two-sided, of `real_only` against `sim_only`."""
        return mcnemar_p(self.real_only, self.sim_only)

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        return {
            "object": self.object, "variant": self.variant, "n": self.n,
            "sim_top1": self.n_sim / self.n, "sim_top1_ci95": list(wilson_interval(self.n_sim, self.n)),
            "real_top1": self.n_real / self.n, "real_top1_ci95": list(wilson_interval(self.n_real, self.n)),
            "both": self.both, "sim_only": self.sim_only, "real_only": self.real_only, "gap": self.gap,
            "gap_ci95": list(self.gap_ci95), "mcnemar_p": self.mcnemar_p, "rank_correlation": self.rank.rho,
            "rank_correlation_ci95": list(self.rank.ci95) if self.rank.ci95 else None,
            "rank_correlation_note": self.rank.why or None,
        }  # fmt: skip


@dataclass(frozen=True)
class FlipForecast:
    """Whether the rig tells which poses a booster gains: poses with all four images, unpatched and not, of both kinds.

    Attributes:
        n: such poses.
        both, sim_only, real_only: gained (wrong before, right after) in both, in the rig alone, in photographs alone.
        sim_lost, real_lost: right before and wrong after.
    """

    object: str
    variant: str
    n: int
    both: int
    sim_only: int
    real_only: int
    sim_lost: int
    real_lost: int

    @property
    def neither(self) -> int:
        """Gained in neither."""
        return self.n - self.both - self.sim_only - self.real_only

    @property
    def kappa(self) -> float | None:
        """Cohen's kappa of gained or not; None where it is the same everywhere in both."""
        return cohen_kappa(self.both, self.sim_only, self.real_only, self.neither)

    @property
    def sim_gain(self) -> float:
        """Change of the share right in the rig, the booster's effect."""
        return (self.both + self.sim_only - self.sim_lost) / self.n

    @property
    def real_gain(self) -> float:
        """Change of the share right in photographs."""
        return (self.both + self.real_only - self.real_lost) / self.n

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        names = ("object", "variant", "n", "both", "sim_only", "real_only", "neither", "sim_lost", "real_lost")
        fields = {name: getattr(self, name) for name in (*names, "sim_gain", "real_gain", "kappa")}
        return fields | {"agreement": (self.both + self.neither) / self.n}


@dataclass(frozen=True)
class SimReal:
    """One rendered source against one of photographs.

    Attributes:
        sim, real: their names.
        couples: images of both that show the same object, variant and pose.
        unmatched_sim, unmatched_real: (path, reason) of images of either that were read and are in no couple.
    """

    sim: str
    real: str
    couples: tuple[Couple, ...]
    unmatched_sim: tuple[tuple[str, str], ...]
    unmatched_real: tuple[tuple[str, str], ...]

    @cached_property
    def rows(self) -> tuple[SimRealRow, ...]:
        """By object (`all` last) and variant."""
        members = _by_row(self.couples)
        return tuple(_count(key, members[key]) for key in sorted(members, key=_row_order))

    @cached_property
    def forecasts(self) -> tuple[FlipForecast, ...]:
        """By object (`all` last) and variant, `unpatched` left out."""
        first: dict[tuple[str, str, int | None], Couple] = {}
        for couple in self.couples:
            first.setdefault(couple.place, couple)
        pairs: dict[tuple[str, str], list[tuple[Couple, Couple]]] = defaultdict(list)
        for (name, variant, pose_id), after in first.items():
            before = first.get((name, UNPATCHED, pose_id))
            if variant != UNPATCHED and before is not None:
                for owner in (name, POOLED):
                    pairs[(owner, variant)].append((before, after))
        return tuple(_forecast(key, pairs[key]) for key in sorted(pairs, key=_row_order))

    @cached_property
    def wrong(self) -> tuple[Couple, ...]:
        """Couples of which one is right and the other wrong, by object, variant and pose."""
        return tuple(couple for couple in self.couples if couple.differs)

    def as_json(self) -> dict[str, Any]:
        """One entry of `sim_real` in `summary.json`."""
        return {
            "sim": self.sim, "real": self.real, "n": len(self.couples),
            "rows": [row.as_json() for row in self.rows],
            "gains": [forecast.as_json() for forecast in self.forecasts],
            "wrong": [couple.as_json() for couple in self.wrong],
            "unmatched_sim": [{"path": path, "reason": reason} for path, reason in self.unmatched_sim],
            "unmatched_real": [{"path": path, "reason": reason} for path, reason in self.unmatched_real],
        }  # fmt: skip


def compare_sim_real(predictions: Sequence[Prediction]) -> list[SimReal]:
    """Every rendered source against every one of photographs that shows some of the same objects, variants and poses.

    A source is rendered if its manifest says so or its name is `sim` or starts with `sim-`. One that was shot with the
    cameras of photographs (`sim-like-real`) is compared with those alone. Images whose manifests name different
    boosters are no couple. Of several images of one pose those of one name are coupled, else the first of each. Sources
    are compared under the same corruption alone.
    """
    by_source: dict[str, list[Prediction]] = defaultdict(list)
    for one in predictions:
        by_source[one.capture.source].append(one)
    rendered = [name for name in by_source if _is_rendered(name, by_source[name])]
    made = []
    for real in by_source:
        for sim in rendered:
            shot_for = sim.removeprefix(LIKE) if sim.startswith(LIKE) else real
            alike = by_source[sim][0].capture.corruption == by_source[real][0].capture.corruption
            if alike and real not in rendered and shot_for == real:
                made.append(SimReal(sim, real, *couple_images(by_source[sim], by_source[real])))
    return [one for one in made if one.couples]


def _is_rendered(source: str, members: Iterable[Prediction]) -> bool:
    return source == "sim" or source.startswith("sim-") or any(one.capture.is_rendered for one in members)


def _by_row(couples: Iterable[Couple]) -> dict[tuple[str, str], list[Couple]]:
    members: dict[tuple[str, str], list[Couple]] = defaultdict(list)
    for couple in couples:
        name, variant, _ = couple.place
        for owner in (name, POOLED):
            members[(owner, variant)].append(couple)
    return members


def _row_order(key: tuple[str, str]) -> tuple:
    name, variant = key
    return name == POOLED, name, rank_variant(variant)


def _count(key: tuple[str, str], couples: Sequence[Couple]) -> SimRealRow:
    both = sum(couple.sim.correct_top1 and couple.real.correct_top1 for couple in couples)
    n_sim = sum(couple.sim.correct_top1 for couple in couples)
    n_real = sum(couple.real.correct_top1 for couple in couples)
    rank = rank_correlation(
        [couple.sim.true_prob or 0.0 for couple in couples], [couple.real.true_prob or 0.0 for couple in couples]
    )
    return SimRealRow(*key, len(couples), both, n_sim - both, n_real - both, rank)


def _forecast(key: tuple[str, str], pairs: Sequence[tuple[Couple, Couple]]) -> FlipForecast:
    sim_gained = [after.sim.correct_top1 and not before.sim.correct_top1 for before, after in pairs]
    real_gained = [after.real.correct_top1 and not before.real.correct_top1 for before, after in pairs]
    both = sum(one and other for one, other in zip(sim_gained, real_gained, strict=True))
    return FlipForecast(
        *key, len(pairs), both, sum(sim_gained) - both, sum(real_gained) - both,
        sum(before.sim.correct_top1 and not after.sim.correct_top1 for before, after in pairs),
        sum(before.real.correct_top1 and not after.real.correct_top1 for before, after in pairs),
    )  # fmt: skip
