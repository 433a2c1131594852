"""`report.html`: one file that opens from disk with no network."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from toolkit.evaluation.contact_sheet import MANY_SHEETS, lay_out, lay_out_flips, make_thumbnails
from toolkit.evaluation.flips import MAX_FLIPS
from toolkit.evaluation.metrics import NOUNS, OWNERS, Comparison
from toolkit.evaluation.page import write_page
from toolkit.evaluation.pose_chart import chart_poses
from toolkit.evaluation.results import Findings, list_corrupted
from toolkit.evaluation.saliency import HEAT_COLOURS, HEAT_LEVELS, Saliency
from toolkit.evaluation.seen import describe_unseen, mark_seen
from toolkit.evaluation.sim_real_view import MAX_ROWS, SIDE, TICKS, place_prob, view_sim_real
from toolkit.evaluation.tables import count_gated, pick_rows, rows_by_source
from toolkit.models.network import Classifier


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
        **vars(findings), "classifier": classifier, "title": path.parent.name, "notes": notes,
        "tables": _build_tables(findings), "comparisons": _build_comparisons(findings.comparisons),
        "compared": {row.second for row in findings.comparisons},
        "controlled": _name_controlled(findings.comparisons), "charts": chart_poses(predictions),
        "sim_real": views, "side": SIDE, "ticks": [(place_prob(prob), label) for prob, label in TICKS],
        "sources": sorted({one.capture.source for one in predictions}),
        "sheets": sheets, "n_hidden": n_hidden, "open_sheets": MANY_SHEETS,
        "flips": flips, "max_flips": MAX_FLIPS, "saliency": saliency, "heat_stops": _list_heat_stops(),
        "thumbnails": make_thumbnails((one.capture for one in shown if one.is_read), classifier),
        "unseen": describe_unseen(classifier.name, findings.training),
        "corrupted": list_corrupted(one.capture for one in predictions),
        "gated": findings.gated, "gate_lines": findings.gate_lines, "gated_counts": count_gated(findings),
    }  # fmt: skip
    return write_page(path, "toolkit.evaluation", "report.html.j2", context)


def _list_heat_stops() -> str:
    """The colours of saliency maps as stops of a CSS gradient."""
    stops = zip(HEAT_LEVELS, HEAT_COLOURS, strict=True)
    return ", ".join(f"rgb{colour} {100 * level:.0f}%" for level, colour in stops)


def _build_tables(findings: Findings) -> list[dict[str, Any]]:
    found = []
    for source, n_objects, pairs in rows_by_source(findings.groups, findings.pairs, MAX_ROWS):
        rows = [(one, pair, mark_seen(findings.training, source, one.object, one.variant)) for one, pair in pairs]
        is_cut = n_objects > len({one.object for one, _ in pairs})
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
