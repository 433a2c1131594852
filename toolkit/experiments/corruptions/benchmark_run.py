"""The corruption benchmark, from a data set to a results folder: choose, compute, summarise, write."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.core.workspace import Workspace
from toolkit.engine.config import EngineConfig
from toolkit.evaluation.eval_config import check_run_name
from toolkit.evaluation.page import RIGHT, WRONG
from toolkit.experiments.corruptions.benchmark_config import NOT_CORRUPTED, Condition, CorruptEvalConfig
from toolkit.experiments.corruptions.benchmark_report import BenchmarkFiles, write_benchmark
from toolkit.experiments.corruptions.benchmark_summary import judge_benchmark, read_summary
from toolkit.experiments.corruptions.cells import (
    Shard,
    Variant,
    apply_variant,
    corrupt_images,
    load_shard,
    open_variants,
    share_classes,
)
from toolkit.experiments.corruptions.grid import Benchmark, Grid, run_grid
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.training.images import ImageSet, choose_classes, open_images

COLUMNS = 6
TILE_IN, HEAD_IN = 1.55, 0.5
LETTER_IN = 0.085


def choose_conditions(corruptions: Sequence[Condition]) -> list[Condition]:
    """Clean, and corruptions spread over those that were run, each at its middle severity."""
    names = list(dict.fromkeys(name for name, _ in corruptions))
    picked = [names[k] for k in np.linspace(0, len(names) - 1, min(COLUMNS - 1, len(names))).round().astype(int)]
    chosen = [NOT_CORRUPTED]
    for name in picked:
        severities = sorted(severity for other, severity in corruptions if other == name)
        chosen.append((name, severities[len(severities) // 2]))
    return chosen


@with_default_style
def draw_examples(grid: Grid, benchmark: Benchmark) -> bytes:
    """PNG: a row for each variant, a column for each condition; always the image in the middle of the list.

    A green frame says that the network's first guess is right, a red one that it is not.
    """
    chosen, conditions = benchmark.ids[len(benchmark.ids) // 2], choose_conditions(grid.config.conditions[1:])
    number = benchmark.ids.index(chosen)
    image = next(one for one in grid.images.images if one.id == chosen)
    shard = Shard((image,), ("",))
    names = [_label_row(variant, grid.variants[0]) for variant in grid.variants]
    label_in = 0.3 + LETTER_IN * max(len(line) for name in names for line in name.split("\n"))
    figure = make_figure(label_in + TILE_IN * len(conditions), HEAD_IN + TILE_IN * len(grid.variants), layout=None)
    panels = figure.subplots(len(grid.variants), len(conditions), squeeze=False)
    left = label_in / figure.get_figwidth()
    top = 1 - 0.84 * HEAD_IN / figure.get_figheight()
    figure.subplots_adjust(left, bottom=0.01, right=0.995, top=top, wspace=0.06, hspace=0.06)
    ranks = {(one.variant, one.recogniser, (one.corruption, one.severity)): one.ranks for one in benchmark.cells}
    for row, variant, name in zip(panels, grid.variants, names, strict=True):
        pixels, usable = load_shard(grid.images, shard, variant.classifier.preprocessing)
        images = apply_variant(pixels, shard, usable, variant, grid.config)
        for panel, condition in zip(row, conditions, strict=True):
            shown = corrupt_images(images, slice(None), condition)[0].permute(1, 2, 0).numpy()
            panel.imshow(shown, interpolation="antialiased")
            rank = ranks[variant.name, variant.classifier.name, condition][number]
            for spine in panel.spines.values():
                spine.set(color=RIGHT if rank == 1 else WRONG, linewidth=3)
            panel.set(xticks=[], yticks=[])
        row[0].set_ylabel(name, rotation=0, ha="right", va="center", fontsize=9, labelpad=8)
    for panel, (corruption, severity) in zip(panels[0], conditions, strict=True):
        level = f"\nseverity {severity}" if severity else ""
        panel.set_title(corruption.replace("_", " ") + level, fontsize=9)
    return encode_figure(figure)


def _label_row(variant: Variant, first: Variant) -> str:
    """The variant, and below it the network where that is another one."""
    other = variant.classifier is not first.classifier
    return f"{variant.name},\n{variant.classifier.name}" if other else variant.name


@dataclass(frozen=True)
class BenchmarkRun:
    """What a run found, and where it is.

    Attributes:
        benchmark: the finished grid.
        files: what was written.
        without_images: by patch set, labels of its classes that have no images; empty where classes were named.
    """

    benchmark: Benchmark
    files: BenchmarkFiles
    without_images: dict[str, list[str]]

    @property
    def headlines(self) -> list[str]:
        """The result in words, a sentence for each patch set and who answers."""
        return [one.sentence for one in judge_benchmark(read_summary(self.files.summary))]


def evaluate_benchmark(
    workspace: Workspace,
    data: ImageSet | Path | str,
    classifier: Classifier,
    config: CorruptEvalConfig,
    load: Callable[[str], Classifier] = load_classifier,
    engine: EngineConfig | None = None,
) -> BenchmarkRun:
    """Corrupt a data set with and without patches, and ask classifiers and readers what they see.

    Results go to `eval/corruptions/RUN`. A cell is computed once, whatever run asks for it.

    Args:
        workspace: whose patches are meant, and whose `eval/` is written to.
        data: from `open_images`, or a folder with a folder of images for each class.
        classifier: who is asked where `config.patches` names no other.
        config: patches, corruptions, classes.
        load: the classifier of a name; by default of the bundled and the published ones.
        engine: where cells are computed; by default in this process.

    Raises:
        ToolkitError: an unknown class, patch set or network, no image that can be used, a network's output that is not
            finite, or a disk that is full or read-only.
    """
    found = data if isinstance(data, ImageSet) else open_images(str(data), classifier)
    images = choose_classes(found, list(config.classes), classifier)
    if config.per_class is not None:
        images = images.draw(config.per_class, config.seed)
    variants, notes = open_variants(workspace, config.patches, classifier, load)
    grid = Grid(images.only(share_classes(variants, images.classes)), tuple(variants), config)
    folder = workspace.eval_dir / "corruptions"
    run_dir = folder / check_run_name(grid.name)
    with (engine or EngineConfig()).open(gpus=int(classifier.device != "cpu")) as workers:
        benchmark = run_grid(grid, folder / "cells.jsonl", notes, workers)
    files = write_benchmark(run_dir, benchmark, draw_examples(grid, benchmark))
    patches = {variant.name: variant.patches.patches for variant in variants if variant.patches is not None}
    without_images = {
        name: [classifier.labels[index] for index in own if index not in images.classes]
        for name, own in patches.items()
        if not config.classes
    }
    return BenchmarkRun(benchmark, files, {name: labels for name, labels in without_images.items() if labels})
