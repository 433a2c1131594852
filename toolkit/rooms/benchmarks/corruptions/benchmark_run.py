"""The corruption benchmark, from a data set to a results folder and its report: choose, compute, summarise, write."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.files import write_bytes
from toolkit.core.tables import encode_csv
from toolkit.core.work import INPUTS, NOWHERE, Work
from toolkit.core.workspace import Workspace
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.engine import EngineConfig
from toolkit.evaluation import check_run_name
from toolkit.evaluation.page import write_page
from toolkit.evaluation.run_files import CELLS as CELLS_CSV
from toolkit.evaluation.run_files import SUMMARY, explain_run_dir, find_run_dir, lacks_other_inputs, write_run
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.style import RIGHT, WRONG, name_network, name_variant
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.rooms.benchmarks.corruptions import CLEAN, NOT_CORRUPTED, Condition, CorruptEvalConfig
from toolkit.rooms.benchmarks.corruptions.benchmark_figures import draw_overview, draw_variant
from toolkit.rooms.benchmarks.corruptions.benchmark_means import summarise
from toolkit.rooms.benchmarks.corruptions.benchmark_summary import (
    BenchmarkCell,
    Summary,
    judge_benchmark,
    label_row,
    name_corruption,
    read_summary,
)
from toolkit.rooms.benchmarks.corruptions.cells import (
    CELLS,
    Shard,
    Variant,
    apply_variant,
    corrupt_images,
    load_shard,
    open_variants,
    share_classes,
)
from toolkit.rooms.benchmarks.corruptions.grid import Benchmark, Grid, run_grid
from toolkit.rooms.benchmarks.corruptions.recognisers import READER
from toolkit.training.images import ImageSet, choose_classes, open_images

MAX_FAILED = 200
TITLES = {
    "name": "Run", "data": "Data", "model": "Network", "image_px": "Side of the image, px", "seed": "Seed",
    "parameters": "Corruption parameters", "placement": "Placement of the patches", "is_imagenet": "Labels of ImageNet",
    "preprocessing": "Preprocessing", "toolkit_version": "Made by toolkit", "sha256": "SHA-256",
}  # fmt: skip
COLUMNS = 6
TILE_IN, HEAD_IN = 1.55, 0.5
LETTER_IN = 0.085


def write_report(
    path: Path, summary: Summary, overview: bytes, figures: Mapping[tuple[str, str], bytes], examples: bytes | None
) -> Path:
    """Write the report with its figures, which are PNG; `figures` are by variant and answerer, or none."""
    # the record of the run, and of each variant
    about = dict(summary.about)
    about_variants = about.pop("variants", [])
    about.pop("toolkit_version", None)
    context = {
        "summary": summary, "title": str(summary.about.get("name", "corruptions")), "clean": NOT_CORRUPTED,
        "verdicts": judge_benchmark(summary), "max_failed": MAX_FAILED,
        "networks": [row for row in summary.variants if row.kind != READER],
        "readers": [row for row in summary.variants if row.kind == READER],
        "own": {
            (row.variant, row.answerer): {
                "name": label_row(summary, row), "means": summary.means_of(row), "cells": summary.cells_of(row),
                "differences": summary.differences_of(row),
            }
            for row in summary.variants
        },
        "overview": overview, "examples": examples, "figures": figures,
        "whole": {entry["name"]: entry.get("share_whole") for entry in about_variants},
        "done": [(_title(key), _flatten(value)) for key, value in about.items()],
        "about_variants": [
            (entry["name"], _flatten({key: value for key, value in entry.items() if key != "name"}))
            for entry in about_variants
        ],
    }  # fmt: skip
    package = "toolkit.rooms.benchmarks.corruptions"
    return write_page(path, package, "benchmark.html.j2", context, corruption=name_corruption)


def _title(key: str) -> str:
    return TITLES.get(key, key.replace("_", " "))


def _flatten(value: Any) -> str:
    """Return a record of `about` as a single line."""
    if isinstance(value, Mapping):
        known = {key: part for key, part in value.items() if part not in (None, [], {})}
        parts = (_flatten(part) if key == "name" else f"{_title(key)} {_flatten(part)}" for key, part in known.items())
        return "; ".join(parts) or "no patches"
    if isinstance(value, list | tuple):
        parts = (" ".join(map(str, part)) if isinstance(part, list | tuple) else _flatten(part) for part in value)
        return ", ".join(parts)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class BenchmarkFiles:
    """Paths of the written files; `figures` has the overview first."""

    summary: Path
    cells: Path
    report: Path
    figures: tuple[Path, ...]


def write_benchmark(folder: Path, benchmark: Benchmark, examples: bytes | None = None) -> BenchmarkFiles:
    """Write `summary.json`, `cells.csv`, `figures/*.png` and `report.html`, each whole or not at all.

    `examples` is a PNG of an image in every variant. Networks of the same name are a `ToolkitError`.
    """
    wanted, key = Path(folder), _name_run(benchmark)
    folder = find_run_dir(wanted, lacks_other_inputs(key))
    summary = summarise(replace(benchmark, notes=(*benchmark.notes, *explain_run_dir(wanted, folder))))
    # figures under names that any disk can hold
    overview = draw_overview(summary)
    drawn = summary.variants if summary.corruptions else ()
    figures = {(row.variant, row.answerer): draw_variant(summary, row) for row in drawn}
    files = [write_bytes(folder / "figures" / "overview.png", overview)]
    if examples is not None:
        files.append(write_bytes(folder / "figures" / "examples.png", examples))
    taken = {"overview", "examples"}
    for (variant, answerer), png in figures.items():
        files.append(write_bytes(folder / "figures" / f"{_name_file(f'{variant}-{answerer}', taken)}.png", png))
    report = write_report(folder / "report.html", summary, overview, figures, examples)
    # last, as proof that the rest is there
    write_run(folder, summary.model_dump(mode="json") | {INPUTS: key}, {CELLS_CSV: encode_cells(summary)})
    return BenchmarkFiles(folder / SUMMARY, folder / CELLS_CSV, report, tuple(files))


def _name_run(benchmark: Benchmark) -> str:
    """Return the key of a run: of its data, networks, patches and conditions, without the toolkit's version."""
    about = {key: value for key, value in benchmark.about.items() if key != "toolkit_version"}
    conditions = sorted({(cell.corruption, cell.severity) for cell in benchmark.cells})
    return Work("corruption benchmark", CELLS.version, old_at=NOWHERE).key(about, benchmark.ids, conditions)


def encode_cells(summary: Summary) -> str:
    """The text of `cells.csv`: a row for each cell; fields that do not apply are empty."""
    names = [field.name for field in fields(BenchmarkCell) if field.name != "top1_ci95"]
    at = names.index("top1") + 1
    rows = []
    for cell in summary.cells:
        values = [getattr(cell, name) for name in names]
        family = None if cell.corruption == CLEAN else CORRUPTIONS[cell.corruption].family
        rows.append([*values[:at], *cell.top1_ci95, *values[at:], family])
    return encode_csv([*names[:at], "ci95_low", "ci95_high", *names[at:], "family"], rows)


def _name_file(words: str, taken: set[str]) -> str:
    """A unique file name of any variant's and network's name."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", words).strip("-.")[:80] or "figure"
    name, number = plain, 1
    # some file systems do not tell `Fog` from `fog`
    while name.lower() in taken:
        number += 1
        name = f"{plain}-{number}"
    taken.add(name.lower())
    return name


def choose_conditions(corruptions: Sequence[Condition]) -> list[Condition]:
    """Choose clean, and some of the corruptions of the run, each at its middle severity."""
    names = list(dict.fromkeys(name for name, _ in corruptions))
    picked = [names[k] for k in np.linspace(0, len(names) - 1, min(COLUMNS - 1, len(names))).round().astype(int)]
    chosen = [NOT_CORRUPTED]
    for name in picked:
        severities = sorted(severity for other, severity in corruptions if other == name)
        chosen.append((name, severities[len(severities) // 2]))
    return chosen


@with_default_style
def draw_examples(grid: Grid, benchmark: Benchmark) -> bytes:
    """PNG of the middle image: a row for each variant, a column for each condition, a frame green if top-1 is right."""
    chosen, conditions = benchmark.ids[len(benchmark.ids) // 2], choose_conditions(grid.config.conditions[1:])
    number = benchmark.ids.index(chosen)
    image = next(image for image in grid.images.images if image.id == chosen)
    # drawn and not recorded, so that its hash is not needed
    shard = Shard((image,), ("",))
    names = [_label_row(variant, grid.variants[0]) for variant in grid.variants]
    label_in = 0.3 + LETTER_IN * max(len(line) for name in names for line in name.split("\n"))
    # a square for each picture, beside room for the labels
    figure = make_figure(label_in + TILE_IN * len(conditions), HEAD_IN + TILE_IN * len(grid.variants), layout=None)
    panels = figure.subplots(len(grid.variants), len(conditions), squeeze=False)
    left = label_in / figure.get_figwidth()
    top = 1 - 0.84 * HEAD_IN / figure.get_figheight()
    figure.subplots_adjust(left, bottom=0.01, right=0.995, top=top, wspace=0.06, hspace=0.06)
    ranks = {(cell.variant, cell.recogniser, (cell.corruption, cell.severity)): cell.ranks for cell in benchmark.cells}
    for row, variant, name in zip(panels, grid.variants, names, strict=True):
        # each variant is shown as its own network sees it
        pixels, usable = load_shard(grid.images, shard, variant.classifier.preprocessing)
        images = apply_variant(pixels, shard, usable, variant, grid.config)
        for panel, condition in zip(row, conditions, strict=True):
            shown = corrupt_images(images, [0], condition)[0].permute(1, 2, 0).numpy()
            panel.imshow(shown, interpolation="antialiased")
            rank = ranks[variant.name, variant.classifier.name, condition][number]
            for spine in panel.spines.values():
                spine.set(color=RIGHT if rank == 1 else WRONG, linewidth=3)
            panel.set(xticks=[], yticks=[])
        row[0].set_ylabel(name, rotation=0, ha="right", va="center", fontsize=9, labelpad=8)
    for panel, (corruption, severity) in zip(panels[0], conditions, strict=True):
        level = f"\nseverity {severity}" if severity else ""
        panel.set_title((name_corruption(corruption) if severity else corruption) + level, fontsize=9)
    return encode_figure(figure)


def _label_row(variant: Variant, first: Variant) -> str:
    """The variant, and below it the network if it differs."""
    other = variant.classifier is not first.classifier
    name = name_variant(variant.name)
    return f"{name},\n{name_network(variant.classifier.name)}" if other else name


@dataclass(frozen=True)
class BenchmarkRun:
    """A finished grid and its files; `without_images` has the labels without images by patch set."""

    benchmark: Benchmark
    files: BenchmarkFiles
    without_images: dict[str, list[str]]

    @property
    def headlines(self) -> list[str]:
        """The result in words, a sentence for each patch set and who answers."""
        return [verdict.sentence for verdict in judge_benchmark(read_summary(self.files.summary))]


def evaluate_benchmark(
    workspace: Workspace, data: ImageSet | Path | str, classifier: Classifier, config: CorruptEvalConfig,
    load: Callable[[str], Classifier] = load_classifier, engine: EngineConfig | None = None,
) -> BenchmarkRun:  # fmt: skip
    """Corrupt a data set with and without patches, and let classifiers and readers answer.

    Results go to `eval/corruptions/RUN`. Each cell is computed once for all runs.

    Args:
        workspace: has the patches, and gets the results.
        data: from `open_images`, or a folder with a folder of images for each class.
        classifier: answers, unless `config.patches` names another.
        config: patches, corruptions, classes.
        load: returns the classifier of a name.
        engine: computes the cells; by default this process.

    Raises:
        ToolkitError: an unknown class, patch set or network, no image that can be used, a network's output that is not
            finite, or a disk that is full or read-only.
    """
    found = data if isinstance(data, ImageSet) else open_images(str(data), classifier)
    images = choose_classes(found, list(config.classes), classifier)
    if config.per_class is not None:
        images = images.draw(config.per_class, config.seed)
    # patch sets with their networks
    variants, notes = open_variants(workspace, config.patches, classifier, load)
    # only classes of which every set has a picture: all variants see the same images
    grid = Grid(images.only(share_classes(variants, images.classes)), tuple(variants), config)
    # the cells, then report and files
    folder = workspace.eval_dir / "corruptions"
    run_dir = folder / check_run_name(grid.name)
    with (engine or EngineConfig()).open(gpus=int(classifier.device != "cpu")) as workers:
        # notes on the networks belong to the result as well, each once
        doubts = dict.fromkeys(note for variant in variants for note in variant.classifier.notes)
        benchmark = run_grid(grid, folder / "cells.jsonl", (*doubts, *notes), workers)
    files = write_benchmark(run_dir, benchmark, draw_examples(grid, benchmark))
    # classes that a set has pictures of, but no images: reported unless classes were chosen
    without_images: dict[str, list[str]] = {}
    for variant in variants if not config.classes else ():
        own = variant.patches.patches if variant.patches is not None else ()
        if labels := [classifier.labels[index] for index in own if index not in images.classes]:
            without_images[variant.name] = labels
    return BenchmarkRun(benchmark, files, without_images)
