"""The corruption benchmark, from a data set to a results folder: choose, compute, summarise, write."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.workspace import Workspace
from toolkit.engine.config import EngineConfig
from toolkit.evaluation.config import check_run_name
from toolkit.experiments.corruptions.benchmark_report import BenchmarkFiles, write_benchmark
from toolkit.experiments.corruptions.benchmark_summary import read_summary
from toolkit.experiments.corruptions.benchmark_verdict import judge_benchmark
from toolkit.experiments.corruptions.config import CorruptEvalConfig
from toolkit.experiments.corruptions.examples import draw_examples
from toolkit.experiments.corruptions.grid import Benchmark, Grid, run_grid
from toolkit.experiments.corruptions.variants import open_variants, share_classes
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.training.images import ImageSet, choose_classes, open_images


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
