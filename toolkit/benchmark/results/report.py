"""`report.html` of the corruption benchmark: one file that opens from disk with no network."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from toolkit.benchmark.answers import CLEAN, READER
from toolkit.benchmark.results.say import (
    judge_benchmark,
    name_row,
    say_corruption,
    say_interval,
    say_percent,
    say_points,
    say_points_interval,
)
from toolkit.benchmark.results.summary import Summary, VariantMean
from toolkit.files import write_text

TEMPLATE = "benchmark.html.j2"
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
    networks = [row for row in summary.variants if row.kind != READER]
    readers = [row for row in summary.variants if row.kind == READER]
    context = {
        "summary": summary,
        "title": str(summary.about.get("name", "corruptions")),
        "verdicts": judge_benchmark(summary),
        "networks": networks,
        "readers": readers,
        "own": {(row.variant, row.answerer): _collect(summary, row) for row in summary.variants},
        "overview": _embed(overview),
        "examples": None if examples is None else _embed(examples),
        "figures": {key: _embed(png) for key, png in figures.items()},
        "whole": {entry["name"]: entry.get("share_whole") for entry in summary.about.get("variants", [])},
        "done": [
            (_title(key), _flatten(value))
            for key, value in summary.about.items()
            if key not in ("variants", "toolkit_version")
        ],
        "about_variants": [
            (entry["name"], _flatten({key: value for key, value in entry.items() if key != "name"}))
            for entry in summary.about.get("variants", [])
        ],
        "clean": (CLEAN, 0),
        "max_failed": MAX_FAILED,
    }
    return write_text(path, _render(context))


def _render(context: dict[str, Any]) -> str:
    """The HTML; everything that comes from files or names is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("toolkit.benchmark.results", package_path="")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "percent": say_percent, "interval": say_interval, "points": say_points, "corruption": say_corruption,
        "points_interval": say_points_interval, "p_value": lambda p: "< 0.0001" if p < 1e-4 else f"{p:.2g}",
    }  # fmt: skip
    return environment.get_template(TEMPLATE).render(context)


def _collect(summary: Summary, row: VariantMean) -> dict[str, Any]:
    """What the template shows of a row."""
    return {
        "name": name_row(summary, row),
        "means": summary.means_of(row),
        "cells": summary.cells_of(row),
        "differences": summary.differences_of(row),
    }


def _embed(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


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
