"""What the report shows of rendered sources against photographs: rows, a chart of the poses, the wrongly predicted."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

from toolkit.evaluation.contact_sheet import Card
from toolkit.evaluation.metrics import Comparison, Pair, rank_variant
from toolkit.evaluation.pose_chart import describe_place
from toolkit.evaluation.sim_real import GainForecast, SimReal, place_of
from toolkit.evaluation.tables import pick_rows

MAX_ROWS, MAX_CARDS = 400, 40
SIDE = 200.0
LEAST_PROB = 0.001
TICKS = ((0.001, "0.1"), (0.01, "1"), (0.1, "10"), (0.5, "50"), (0.9, "90"), (0.99, "99"), (0.999, "99.9"))


@dataclass(frozen=True)
class PosePoint:
    """One pair: its place on the chart, y down; what is right, `both`, `neither`, `sim` or `real`; and its words."""

    x: float
    y: float
    kind: str
    words: str


@dataclass(frozen=True)
class SimRealView:
    """One pair of sources in the report.

    Attributes:
        found: what was found.
        rows, forecasts: those that are shown.
        charts: by variant, the true class's probability in the rig and in photographs, one point per pose.
        cards: of the wrongly predicted.
    """

    found: SimReal
    rows: list[Comparison]
    forecasts: list[GainForecast]
    charts: dict[str, list[PosePoint]]
    cards: list[Card]


def view_sim_real(comparisons: Sequence[SimReal]) -> list[SimRealView]:
    """What the report shows of each pair of sources; of many wrong predictions those that are furthest off."""
    views = []
    for one in comparisons:
        variants = sorted({place_of(pair)[1] for pair in one.pairs}, key=rank_variant)
        charts = {name: [_make_point(pair) for pair in one.pairs if place_of(pair)[1] == name] for name in variants}
        cards = [_make_card(pair) for pair in _pick_furthest(one.wrong)]
        views.append(SimRealView(one, pick_rows(one.rows, MAX_ROWS), pick_rows(one.forecasts, MAX_ROWS), charts, cards))
    return views


def place_prob(prob: float) -> float:
    """Where a probability lies on an axis of length `SIDE`: log-odds, from 0.1 % to 99.9 %."""
    end = log((1 - LEAST_PROB) / LEAST_PROB)
    inside = min(1 - LEAST_PROB, max(LEAST_PROB, prob))
    return SIDE * (log(inside / (1 - inside)) + end) / (2 * end)


def _make_point(pair: Pair) -> PosePoint:
    name, _, pose_id = place_of(pair)
    kind = "sim" if pair.is_lost else "real" if pair.is_gained else "both" if pair.first.correct_top1 else "neither"
    sim, real = pair.first.true_prob or 0.0, pair.second.true_prob or 0.0
    words = f"{name}, pose {pose_id}: {100 * sim:.3g} % in the rig, {100 * real:.3g} % in the photograph"
    return PosePoint(place_prob(sim), SIDE - place_prob(real), kind, words)


def _pick_furthest(wrong: Sequence[Pair]) -> list[Pair]:
    kept = {id(pair) for pair in sorted(wrong, key=lambda pair: -abs(pair.change))[:MAX_CARDS]}
    return [pair for pair in wrong if id(pair) in kept]


def _make_card(pair: Pair) -> Card:
    name, variant, pose_id = place_of(pair)
    return Card(f"{name} · {variant} · pose {pose_id}", describe_place(pair.second), (pair.first, pair.second))
