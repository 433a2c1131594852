"""The rig against photographs, as the report shows it: a scatter of poses, and the wrongly predicted side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

from toolkit.evaluation.contact_sheet import Card, say_place
from toolkit.evaluation.couples import Couple
from toolkit.evaluation.order import rank_variant
from toolkit.evaluation.sim_real import FlipForecast, SimReal, SimRealRow
from toolkit.evaluation.sim_real_table import pick_own

SIDE = 200.0
LEAST_PROB = 0.001
TICKS = ((0.001, "0.1"), (0.01, "1"), (0.1, "10"), (0.5, "50"), (0.9, "90"), (0.99, "99"), (0.999, "99.9"))
MAX_CARDS, MAX_ROWS = 40, 400


@dataclass(frozen=True)
class PosePoint:
    """One couple: its place on the chart, y down; what it is, `both`, `neither`, `sim` or `real`; and its words."""

    x: float
    y: float
    kind: str
    words: str


@dataclass(frozen=True)
class Scatter:
    """The true class's probability in the rig and in photographs, one point per pose of one variant.

    Attributes:
        ticks: (place, label) along x; y has the same, upwards.
    """

    variant: str
    points: tuple[PosePoint, ...]
    ticks: tuple[tuple[float, str], ...]
    side: float = SIDE


@dataclass(frozen=True)
class SimRealView:
    """One pair of sources in the report: the rows that are shown, charts, and cards of the wrongly predicted."""

    found: SimReal
    rows: list[SimRealRow]
    forecasts: list[FlipForecast]
    charts: list[Scatter]
    cards: list[Card]


def view_sim_real(comparisons: Sequence[SimReal]) -> list[SimRealView]:
    """What the report shows of each pair of sources; of many wrong predictions those that are furthest off."""
    views = []
    for one in comparisons:
        variants = sorted({couple.place[1] for couple in one.couples}, key=rank_variant)
        charts = [_scatter(name, [couple for couple in one.couples if couple.place[1] == name]) for name in variants]
        rows, forecasts = pick_own(one.rows, MAX_ROWS), pick_own(one.forecasts, MAX_ROWS)
        views.append(SimRealView(one, rows, forecasts, charts, [_card(couple) for couple in _pick(one.wrong)]))
    return views


def place_prob(prob: float) -> float:
    """Where a probability lies on an axis of length `SIDE`: log-odds, from 0.1 % to 99.9 %."""
    end = log((1 - LEAST_PROB) / LEAST_PROB)
    inside = min(1 - LEAST_PROB, max(LEAST_PROB, prob))
    return SIDE * (log(inside / (1 - inside)) + end) / (2 * end)


def _scatter(variant: str, couples: Sequence[Couple]) -> Scatter:
    ticks = tuple((place_prob(prob), label) for prob, label in TICKS)
    return Scatter(variant, tuple(_point(couple) for couple in couples), ticks)


def _point(couple: Couple) -> PosePoint:
    sim, real = couple.sim, couple.real
    name, _, pose_id = couple.place
    kind = ("both" if sim.correct_top1 else "neither") if not couple.differs else "sim" if sim.correct_top1 else "real"
    probs = [one.true_prob or 0.0 for one in (sim, real)]
    words = f"{name}, pose {pose_id}: {100 * probs[0]:.3g} % in the rig, {100 * probs[1]:.3g} % in the photograph"
    return PosePoint(place_prob(probs[0]), SIDE - place_prob(probs[1]), kind, words)


def _pick(wrong: Sequence[Couple]) -> list[Couple]:
    if len(wrong) <= MAX_CARDS:
        return list(wrong)
    furthest = sorted(wrong, key=lambda one: -abs((one.sim.true_prob or 0.0) - (one.real.true_prob or 0.0)))
    kept = {id(couple) for couple in furthest[:MAX_CARDS]}
    return [couple for couple in wrong if id(couple) in kept]


def _card(couple: Couple) -> Card:
    name, variant, pose_id = couple.place
    return Card(f"{name} · {variant} · pose {pose_id}", say_place(couple.real), (couple.sim, couple.real))
