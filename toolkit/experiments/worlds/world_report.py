"""The results folder of an evaluation in a world, and its `report.html`, which opens from disk with no network."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.captures.read import POOLED
from toolkit.core.files import write_bytes, write_json, write_text
from toolkit.evaluation.page import write_page
from toolkit.experiments.worlds.keep import KeptFrames
from toolkit.experiments.worlds.world_figures import draw_cameras, draw_curves, draw_sample, draw_weathers
from toolkit.experiments.worlds.world_results import WorldResults, encode_cameras, encode_predictions
from toolkit.experiments.worlds.world_rows import summarise
from toolkit.experiments.worlds.world_verdict import format_times, format_visibility, judge_world, pooled


@dataclass(frozen=True)
class WorldFiles:
    """What was written."""

    summary: Path
    predictions: Path
    cameras: Path
    report: Path
    figures: tuple[Path, ...]
    frames: Path


def write_results(folder: Path, results: WorldResults, kept: KeptFrames) -> WorldFiles:
    """Write predictions, cameras, figures, the report and last `summary.json`, each whole or not at all.

    Raises:
        ToolkitError: the disk is full or may not be written.
    """
    summary = summarise(results)
    figures = {
        "sample": draw_sample(results, kept), "weathers": draw_weathers(results, summary),
        "curves": draw_curves(results, summary), "cameras": draw_cameras(results.places),
    }  # fmt: skip
    drawn = {name: png for name, png in figures.items() if png is not None}
    files = tuple(write_bytes(folder / "figures" / f"{name}.png", png) for name, png in drawn.items())
    predictions = write_text(folder / "predictions.csv", encode_predictions(results))
    cameras = write_text(folder / "cameras.csv", encode_cameras(results))
    report = write_report(folder / "report.html", summary, drawn)
    # last: where it is, the rest is there as well
    record = write_json(folder / "summary.json", summary)
    return WorldFiles(record, predictions, cameras, report, files, kept.folder)


def write_report(path: Path, summary: Mapping[str, Any], figures: Mapping[str, bytes]) -> Path:
    """Write the report with its figures in it."""
    groups = pooled(dict(summary))
    context = {
        "title": path.parent.name,
        "summary": summary,
        "about": summary["about"],
        "verdicts": judge_world(dict(summary)),
        "groups": list(groups.values()),
        "in_view": {_key(row): row for row in summary["groups_in_view"] if row["place"] == POOLED},
        "by_place": [row for row in summary["groups"] if row["place"] != POOLED and row["weather"] == "clear"],
        "pairs": {_key(row): row for row in summary["pairs"] if row["place"] == POOLED},
        "halves": [
            (row, format_visibility(row), format_times(row, "times"), format_times(row, "same_times"))
            for row in summary["half_lost"]
        ],
        "reasons": sorted({key for row in summary["cameras"] for key in row if key.startswith("left out")}),
        "figures": figures,
    }
    return write_page(path, "toolkit.experiments.worlds", "world.html.j2", context)


def _key(row: Mapping[str, Any]) -> tuple[str, str, int]:
    return row["variant"], row["weather"], row["severity"]
