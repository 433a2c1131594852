"""`report.html`: one file that opens from disk with no network."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from typing import Any

from toolkit.captures.read import POOLED
from toolkit.evaluation.contact_sheet import (
    MANY_SHEETS,
    Card,
    chart_poses,
    describe_place,
    lay_out,
    lay_out_flips,
    make_thumbnails,
)
from toolkit.evaluation.flips import MAX_FLIPS
from toolkit.evaluation.metrics import NOUNS, OWNERS, Comparison, Pair, rank_variant
from toolkit.evaluation.page import write_page
from toolkit.evaluation.results import Findings, list_corrupted
from toolkit.evaluation.saliency import HEAT_COLOURS, HEAT_LEVELS, Saliency
from toolkit.evaluation.seen import describe_unseen, mark_seen
from toolkit.evaluation.sim_real import GainForecast, SimReal, SimRealRow, place_of
from toolkit.evaluation.tables import count_gated, pick_rows
from toolkit.models.network import Classifier

MAX_ROWS, MAX_CARDS = 400, 40


def write_report(
    path: Path, classifier: Classifier, findings: Findings, notes: Sequence[str], saliency: Saliency
) -> Path:
    """Write the report; thumbnails are embedded, long contact sheets thinned, and the report says so."""
    predictions = findings.predictions
    sheets, n_hidden = lay_out(predictions)
    flips = [(one.kind, lay_out_flips(one), one.n, one.counts) for one in findings.flips]
    views = view_sim_real(findings.sim_real)
    decks = [*(one.cards for one in sheets), *(one.cards for one in views), *(cards for _, cards, _, _ in flips)]
    shown = [one for cards in decks for card in cards for one in card.cells]
    context = {
        "title": path.parent.name,
        "network": classifier.name,
        "description": classifier.describe(),
        "weights": classifier.weights,
        "how": classifier.preprocessing.describe(),
        "is_imagenet": classifier.is_imagenet,
        "headlines": findings.headlines,
        "tables": _build_tables(findings),
        "comparisons": _build_comparisons(findings.comparisons),
        "compared": {row.second for row in findings.comparisons},
        "controlled": _name_controlled(findings.comparisons),
        "charts": chart_poses(predictions),
        "sim_real": views,
        "side": SIDE,
        "ticks": [(place_prob(prob), label) for prob, label in TICKS],
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
        "unseen": describe_unseen(classifier.name, findings.training),
        "corrupted": list_corrupted(one.capture for one in predictions),
        "failed": findings.failed,
        "unpaired": findings.unpaired,
        "gated": findings.gated,
        "gate_lines": findings.gate_lines,
        "gated_counts": count_gated(findings),
        "notes": notes,
    }
    return write_page(path, "toolkit.evaluation", "report.html.j2", context)


def _build_tables(findings: Findings) -> list[dict[str, Any]]:
    paired = {(pair.source, pair.object, pair.second): pair for pair in findings.pairs}
    found = []
    for source in dict.fromkeys(group.source for group in findings.groups):
        own = [group for group in findings.groups if group.source == source]
        rows = [
            (
                group, paired.get((source, group.object, group.variant)),
                mark_seen(findings.training, source, group.object, group.variant),
            )
            for group in pick_rows(own, MAX_ROWS)
        ]  # fmt: skip
        n_objects = len({group.object for group in own} - {POOLED})
        is_cut = n_objects > len({group.object for group, *_ in rows})
        found.append({"source": source, "rows": rows, "n_objects": n_objects, "is_cut": is_cut})
    return found


def _build_comparisons(comparisons: Sequence[Comparison]) -> list[tuple[str, list[Comparison]]]:
    """(source, rows)."""
    sources = dict.fromkeys(row.source for row in comparisons)
    return [(source, pick_rows([row for row in comparisons if row.source == source], MAX_ROWS)) for source in sources]


def _name_controlled(comparisons: Sequence[Comparison]) -> list[str]:
    """`patch`, `texture` or both: the boosters of which a control was shot."""
    owners = {OWNERS.get(row.second) for row in comparisons}
    return [noun for booster, noun in NOUNS.items() if booster in owners]


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
    rows: list[SimRealRow]
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
