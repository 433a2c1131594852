"""`eval/index.html`: all runs of a workspace on one page, with filters, and their flips side by side."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.evaluation.contact_sheet import make_thumbnails
from toolkit.evaluation.metrics import Pair, index_poses, list_flips
from toolkit.evaluation.page import write_page
from toolkit.evaluation.predictions_csv import find_captures_dir, read_predictions
from toolkit.evaluation.summaries import Run, describe_condition

THUMBNAIL_PX = 144
MAX_FLIPS_OF_RUN, MAX_FLIPS = 16, 320
"""Gained and lost alike of one run; and of all, so that the page stays below 5 MB."""
FILTERS = {
    "kind": "experiment", "run": "run", "network": "network", "object": "object", "variant": "variant",
    "condition": "weather or corruption", "source": "source",
}  # fmt: skip


def write_index(path: Path, workspace: Workspace, runs: Sequence[Run]) -> list[tuple[str, str]]:
    """Write the page: one file that opens from disk, without a network.

    Each picture is in it once, however many runs saw it.

    Args:
        path: of the page; links to reports are relative to its folder.
        workspace: that the runs are of.
        runs: from `find_runs`.

    Returns:
        (run, reason) of each run whose flips could not be read; its rows are shown all the same.
    """
    pairs, refused = _gather_flips(workspace, runs)
    shown = pairs[:MAX_FLIPS]
    captures = [one.capture for _, pair in shown for one in (pair.first, pair.second)]
    # by the whole path: two runs may call two images the same
    made = make_thumbnails((replace(one, path=str(one.file)) for one in captures), None, THUMBNAIL_PX)
    pictures = {uri: number for number, uri in enumerate(dict.fromkeys(made.values()))}
    numbers = {file: pictures[uri] for file, uri in made.items()}
    rows = [row for run in runs for row in run.rows]
    context = {
        "runs": runs,
        "rows": rows,
        "reports": {run.name: report for run in runs if (report := _find_report(path, run))},
        "filters": {
            name: (words, sorted({str(getattr(row, name)) for row in rows})) for name, words in FILTERS.items()
        },
        "flips": [_describe_flip(run, pair, numbers) for run, pair in shown],
        "n_flips": len(pairs),
        "pictures": list(pictures),
        "conditions": {row: describe_condition(row) for row in rows},
    }
    write_page(path, "toolkit.evaluation", "index.html.j2", context)
    return refused


def _gather_flips(workspace: Workspace, runs: Sequence[Run]) -> tuple[list[tuple[Run, Pair]], list[tuple[str, str]]]:
    """The flips of each run that are shown: in turns, so that no run crowds out the others."""
    refused, decks = [], []
    for run in runs:
        if not run.has_predictions:
            continue
        try:
            predictions = read_predictions(run, find_captures_dir(workspace, run))
        except ToolkitError as error:
            refused.append((run.name, str(error)))
            continue
        flips = [pair for some in list_flips(index_poses(predictions)) for pair in some.shown[:MAX_FLIPS_OF_RUN]]
        decks.append([(run, pair) for pair in flips])
    longest = max(map(len, decks), default=0)
    return [deck[at] for at in range(longest) for deck in decks if at < len(deck)], refused


def _describe_flip(run: Run, pair: Pair, numbers: dict[str, int]) -> dict[str, Any]:
    """What the page shows of a pair that changed; a picture is its number on the page, None where the image is gone."""
    capture = pair.second.capture
    row = next((row for row in run.rows if (row.source, row.variant) == (capture.source, capture.variant)), run.rows[0])
    cells = (pair.first, pair.second)
    return {
        "run": run.name, "network": row.network, "kind": "gained" if pair.is_gained else "lost", "cells": cells,
        "condition": capture.corruption[0] if capture.corruption else row.condition,
        "pictures": [numbers.get(str(one.capture.file)) for one in cells],
    }  # fmt: skip


def _find_report(path: Path, run: Run) -> str | None:
    """Where its report is, as seen from the page."""
    report, home = (run.folder / "report.html").resolve(), path.resolve().parent
    # a report elsewhere has no relative link that opens from disk
    return report.relative_to(home).as_posix() if report.is_file() and report.is_relative_to(home) else None
