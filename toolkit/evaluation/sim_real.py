"""The rig against photographs, pose by pose: how far off it is, and whether it knows the hard poses."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.evaluation.agreement import RankCorrelation, cohen_kappa, paired_difference_interval, rank_correlation
from toolkit.evaluation.couples import Couple, couple_images
from toolkit.evaluation.order import rank_variant
from toolkit.evaluation.predict import Prediction
from toolkit.statistics import mcnemar_p, wilson_interval

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
