"""`report.html`: one file that opens from disk with no network."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.captures.read import POOLED
from toolkit.classifiers.network import Classifier
from toolkit.evaluation.contact_sheet import MANY_SHEETS, lay_out, lay_out_flips
from toolkit.evaluation.controls import Comparison
from toolkit.evaluation.corrupted import list_corrupted
from toolkit.evaluation.findings import Findings
from toolkit.evaluation.flips import MAX_FLIPS
from toolkit.evaluation.metrics import Group, Pair
from toolkit.evaluation.order import NOUNS, OWNERS
from toolkit.evaluation.poses import chart_poses
from toolkit.evaluation.saliency import HEAT_COLOURS, HEAT_LEVELS, Saliency
from toolkit.evaluation.sim_real_report import view_sim_real
from toolkit.evaluation.sim_real_say import say_interval, say_kappa, say_points, say_rank
from toolkit.evaluation.tables import pick_rows
from toolkit.evaluation.thumbnails import make_thumbnails
from toolkit.files import write_text
from toolkit.statistics import wilson_interval

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
