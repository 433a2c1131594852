"""The results folder of the corruption benchmark."""

import csv
import io
import re
from dataclasses import dataclass, fields
from pathlib import Path

from toolkit.benchmark.answers import CLEAN, Benchmark
from toolkit.benchmark.results.figures import draw_variant
from toolkit.benchmark.results.metrics import summarise
from toolkit.benchmark.results.overview import draw_overview
from toolkit.benchmark.results.report import write_report
from toolkit.benchmark.results.summary import Cell, Summary
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.files import write_bytes, write_json, write_text


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
        benchmark: what was answered.
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
    record = write_json(folder / "summary.json", summary.model_dump(mode="json"))
    return BenchmarkFiles(record, cells, report, tuple(files))


def write_cells(path: Path, summary: Summary) -> Path:
    """A row for each cell; fields that do not apply are empty."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(Cell) if field.name != "top1_ci95"]
    at = names.index("top1") + 1
    table.writerow([*names[:at], "ci95_low", "ci95_high", *names[at:], "family"])
    for cell in summary.cells:
        values = ["" if value is None else value for value in (getattr(cell, name) for name in names)]
        family = "" if cell.corruption == CLEAN else CORRUPTIONS[cell.corruption].family
        table.writerow([*values[:at], *cell.top1_ci95, *values[at:], family])
    return write_text(path, text.getvalue())


def _name_file(words: str, taken: set[str]) -> str:
    """A file name of any variant's and network's name, each once."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", words).strip("-.")[:80] or "figure"
    name, number = plain, 1
    while name.lower() in taken:
        number += 1
        name = f"{plain}-{number}"
    taken.add(name.lower())
    return name
