"""The results folder of the corruption benchmark and its `report.html`, which opens from disk with no network."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from toolkit.core.files import write_bytes, write_json, write_text
from toolkit.core.tables import encode_csv
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.evaluation.page import write_page
from toolkit.experiments.corruptions.benchmark_config import CLEAN, NOT_CORRUPTED
from toolkit.experiments.corruptions.benchmark_figures import draw_overview, draw_variant
from toolkit.experiments.corruptions.benchmark_means import summarise
from toolkit.experiments.corruptions.benchmark_summary import (
    BenchmarkCell,
    Summary,
    VariantMean,
    judge_benchmark,
    label_row,
    name_corruption,
)
from toolkit.experiments.corruptions.grid import Benchmark
from toolkit.experiments.corruptions.recognisers import READER

MAX_FAILED = 200
TITLES = {
    "name": "Run", "data": "Data", "model": "Network", "image_px": "Side of the image, px", "seed": "Seed",
    "parameters": "Corruption parameters", "placement": "Placement of the patches", "is_imagenet": "Labels of ImageNet",
    "preprocessing": "Preprocessing", "toolkit_version": "Made by toolkit", "sha256": "SHA-256",
}  # fmt: skip


def write_report(
    path: Path, summary: Summary, overview: bytes, figures: Mapping[tuple[str, str], bytes], examples: bytes | None
) -> Path:
    """Write the report with its figures in it.

    Args:
        path: of the file.
        summary: what is reported.
        overview: PNG.
        figures: PNG of a variant and answerer; of all, or of none where nothing was corrupted.
        examples: PNG of an image in every variant.
    """
    about = dict(summary.about)
    about_variants = about.pop("variants", [])
    about.pop("toolkit_version", None)
    context = {
        "summary": summary, "title": str(summary.about.get("name", "corruptions")), "clean": NOT_CORRUPTED,
        "verdicts": judge_benchmark(summary), "max_failed": MAX_FAILED,
        "networks": [row for row in summary.variants if row.kind != READER],
        "readers": [row for row in summary.variants if row.kind == READER],
        "own": {(row.variant, row.answerer): _collect(summary, row) for row in summary.variants},
        "overview": overview, "examples": examples, "figures": figures,
        "whole": {entry["name"]: entry.get("share_whole") for entry in about_variants},
        "done": [(_title(key), _flatten(value)) for key, value in about.items()],
        "about_variants": [
            (entry["name"], _flatten({key: value for key, value in entry.items() if key != "name"}))
            for entry in about_variants
        ],
    }  # fmt: skip
    package = "toolkit.experiments.corruptions"
    return write_page(path, package, "benchmark.html.j2", context, corruption=name_corruption)


def _collect(summary: Summary, row: VariantMean) -> dict[str, Any]:
    """What the template shows of a row."""
    return {
        "name": label_row(summary, row),
        "means": summary.means_of(row),
        "cells": summary.cells_of(row),
        "differences": summary.differences_of(row),
    }


def _title(key: str) -> str:
    return TITLES.get(key, key.replace("_", " "))


def _flatten(value: Any) -> str:
    """A record of `about` in one line."""
    if isinstance(value, Mapping):
        known = {key: one for key, one in value.items() if one not in (None, [], {})}
        parts = (_flatten(one) if key == "name" else f"{_title(key)} {_flatten(one)}" for key, one in known.items())
        return "; ".join(parts) or "no patches"
    if isinstance(value, list | tuple):
        return ", ".join(" ".join(map(str, one)) if isinstance(one, list | tuple) else _flatten(one) for one in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class BenchmarkFiles:
    """What was written; `figures` has the overview first."""

    summary: Path
    cells: Path
    report: Path
    figures: tuple[Path, ...]


def write_benchmark(folder: Path, benchmark: Benchmark, examples: bytes | None = None) -> BenchmarkFiles:
    """Write `summary.json`, `cells.csv`, `figures/*.png` and `report.html`, each whole or not at all.

    Args:
        folder: of the run.
        benchmark: the finished grid.
        examples: PNG of an image in every variant.

    Raises:
        ToolkitError: the disk is full or may not be written, or two networks have one name.
    """
    folder = Path(folder)
    summary = summarise(benchmark)
    overview = draw_overview(summary)
    figures = {
        (row.variant, row.answerer): draw_variant(summary, row) for row in summary.variants if summary.corruptions
    }
    files = [write_bytes(folder / "figures" / "overview.png", overview)]
    if examples is not None:
        files.append(write_bytes(folder / "figures" / "examples.png", examples))
    taken = {"overview", "examples"}
    for (variant, answerer), png in figures.items():
        files.append(write_bytes(folder / "figures" / f"{_name_file(f'{variant}-{answerer}', taken)}.png", png))
    cells = write_cells(folder / "cells.csv", summary)
    report = write_report(folder / "report.html", summary, overview, figures, examples)
    # last: where it is, the rest is there as well
    record = write_json(folder / "summary.json", summary.as_json())
    return BenchmarkFiles(record, cells, report, tuple(files))


def write_cells(path: Path, summary: Summary) -> Path:
    """A row for each cell; fields that do not apply are empty."""
    names = [field.name for field in fields(BenchmarkCell) if field.name != "top1_ci95"]
    at = names.index("top1") + 1
    rows = []
    for cell in summary.cells:
        values = [getattr(cell, name) for name in names]
        family = None if cell.corruption == CLEAN else CORRUPTIONS[cell.corruption].family
        rows.append([*values[:at], *cell.top1_ci95, *values[at:], family])
    return write_text(path, encode_csv([*names[:at], "ci95_low", "ci95_high", *names[at:], "family"], rows))


def _name_file(words: str, taken: set[str]) -> str:
    """A file name of any variant's and network's name, each once."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", words).strip("-.")[:80] or "figure"
    name, number = plain, 1
    # some file systems do not tell `Fog` from `fog`
    while name.lower() in taken:
        number += 1
        name = f"{plain}-{number}"
    taken.add(name.lower())
    return name
