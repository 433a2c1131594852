"""`report.html`: one file that opens from disk with no network."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.captures.read import POOLED
from toolkit.core.files import write_text
from toolkit.core.statistics import wilson_interval
from toolkit.evaluation.contact_sheet import (
    MANY_SHEETS,
    Card,
    chart_poses,
    lay_out,
    lay_out_flips,
    make_thumbnails,
    say_place,
)
from toolkit.evaluation.metrics import MAX_FLIPS, NOUNS, OWNERS, Group, Pair, rank_variant
from toolkit.evaluation.predict import list_corrupted
from toolkit.evaluation.results import Findings
from toolkit.evaluation.saliency import HEAT_COLOURS, HEAT_LEVELS, Saliency
from toolkit.evaluation.sim_real import Couple, FlipForecast, SimReal, SimRealRow
from toolkit.evaluation.sim_real_text import pick_own, say_interval, say_kappa, say_points, say_rank
from toolkit.evaluation.tables import pick_rows
from toolkit.evaluation.verdict import Comparison
from toolkit.models.network import Classifier

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


TEMPLATE = "report.html.j2"
MAX_TABLE_ROWS = 400


def write_report(
    path: Path, title: str, classifier: Classifier, findings: Findings, notes: Sequence[str], saliency: Saliency
) -> Path:
    """Write the report; thumbnails are embedded, long contact sheets thinned, and the report says so."""
    predictions = findings.predictions
    sheets, n_hidden = lay_out(predictions)
    flips = [(one.kind, lay_out_flips(one), one.n, one.counts) for one in findings.flips]
    shown = [one for sheet in sheets for card in sheet.cards for one in card.cells]
    views = view_sim_real(findings.sim_real)
    shown += [one for view in views for card in view.cards for one in card.cells]
    shown += [one for _, cards, _, _ in flips for card in cards for one in card.cells]
    context = {
        "title": title,
        "network": classifier.name,
        "description": classifier.describe(),
        "weights": classifier.weights,
        "how": classifier.preprocessing.describe(),
        "is_imagenet": classifier.is_imagenet,
        "headlines": findings.headlines,
        "tables": _tables(findings.groups, findings.pairs),
        "comparisons": _compare_tables(findings.comparisons),
        "compared": {row.second for row in findings.comparisons},
        "controlled": _name_controlled(findings.comparisons),
        "charts": chart_poses(predictions),
        "sim_real": views,
        "sources": sorted({one.capture.source for one in predictions}),
        "sheets": sheets,
        "n_hidden": n_hidden,
        "open_sheets": MANY_SHEETS,
        "flips": flips,
        "saliency": saliency,
        "heat_stops": ", ".join(
            f"rgb{colour} {100 * level:.0f}%" for level, colour in zip(HEAT_LEVELS, HEAT_COLOURS, strict=True)
        ),
        "max_flips": MAX_FLIPS,
        "has_pairs": bool(findings.pairs),
        "n_images": len(predictions),
        "thumbnails": make_thumbnails((one.capture for one in shown if one.is_read), classifier),
        "corrupted": list_corrupted(one.capture for one in predictions),
        "failed": findings.failed,
        "unpaired": findings.unpaired,
        "notes": notes,
        "version": __version__,
    }
    return write_text(path, render(context))


def render(context: dict[str, Any]) -> str:
    """The HTML of a report; everything that comes from files or names is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("toolkit.evaluation", package_path="")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["percent"] = lambda share: "–" if share is None else f"{100 * share:.0f}"
    environment.filters["p_value"] = lambda p: "< 0.0001" if p < 1e-4 else f"{p:.2g}"
    environment.filters |= {"points": say_points, "interval": say_interval, "rank": say_rank, "kappa": say_kappa}
    environment.globals["wilson"] = wilson_interval
    return environment.get_template(TEMPLATE).render(context)


def _tables(groups: Sequence[Group], pairs: Sequence[Pair]) -> list[dict[str, Any]]:
    paired = {(pair.source, pair.object, pair.variant): pair for pair in pairs}
    tables = []
    for source in dict.fromkeys(group.source for group in groups):
        own = [group for group in groups if group.source == source]
        rows = [(group, paired.get((source, group.object, group.variant))) for group in pick_rows(own, MAX_TABLE_ROWS)]
        n_objects = len({group.object for group in own} - {POOLED})
        is_cut = n_objects > len({group.object for group, _ in rows})
        tables.append({"source": source, "rows": rows, "n_objects": n_objects, "is_cut": is_cut})
    return tables


def _name_controlled(comparisons: Sequence[Comparison]) -> list[str]:
    """`patch`, `texture` or both: the boosters of which a control was shot."""
    owners = {OWNERS.get(row.second) for row in comparisons}
    return [noun for booster, noun in NOUNS.items() if booster in owners]


def _compare_tables(comparisons: Sequence[Comparison]) -> list[tuple[str, list[Comparison]]]:
    """(source, rows); the pooled rows alone where there are many, none pooled for one object."""
    tables = []
    for source in dict.fromkeys(row.source for row in comparisons):
        own = [row for row in comparisons if row.source == source]
        single = [row for row in own if row.object != POOLED]
        if len({row.object for row in single}) == 1:
            own = single
        elif len(single) > MAX_TABLE_ROWS:
            own = [row for row in own if row.object == POOLED]
        tables.append((source, own))
    return tables
