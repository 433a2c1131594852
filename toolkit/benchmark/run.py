"""The corruption benchmark from a data set to its report: what `toolkit corrupt-eval` runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit.benchmark.grid import GridRequest, GridResult, draw_examples, run_grid
from toolkit.benchmark.report import BenchmarkFiles, write_benchmark
from toolkit.benchmark.summary import read_summary
from toolkit.benchmark.text import say_benchmark
from toolkit.benchmark.variants import open_variants, share_classes
from toolkit.boosters.place_patches import Placement
from toolkit.core.workspace import Workspace
from toolkit.corruptions.request import parse_corruptions
from toolkit.evaluation.config import check_run_name
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.training.image_set import choose_classes, open_images


@dataclass(frozen=True)
class BenchmarkRun:
    """A finished benchmark.

    Attributes:
        result: the answers, and how many of them were computed now.
        files: `summary.json`, `cells.csv`, figures and report in `eval/corruptions/RUN`.
        without_images: by patch set, the labels of its patches that no image of the data is of.
    """

    result: GridResult
    files: BenchmarkFiles
    without_images: dict[str, list[str]]

    @property
    def headlines(self) -> list[str]:
        """The result in words, a sentence for each patch set and who answers."""
        return say_benchmark(read_summary(self.files.summary))


def benchmark_corruptions(
    workspace: Workspace,
    classifier: Classifier,
    data: str | Path,
    patch_sets: Sequence[str] = (),
    corruptions: Sequence[str] = ("common",),
    *,
    classes: Sequence[str] = (),
    per_class: int | None = None,
    placement: Placement | None = None,
    seed: int = 0,
    run: str | None = None,
    download: bool = False,
    load: Callable[[str], Classifier] | None = None,
) -> BenchmarkRun:
    """Corrupt the images of a data set with and without the patch of their class, and ask a classifier.

    An answer is computed once, whatever run asks for it, and an interrupted run goes on where it stopped.

    Args:
        workspace: whose `print/patches` holds the sets, and whose `eval/corruptions` is written to.
        classifier: who answers.
        data: folder with one folder of images per class, or `cifar10:FOLDER`.
        patch_sets: folders of `print/patches`; `SET@MODEL` is answered by another classifier. The images are also
            shown without.
        corruptions: `NAME`, `NAME:SEVERITY` or `NAME:FIRST-LAST`, a family, `common` (15) or `all` (19).
        classes: labels, indices or WordNet ids; all with images and patches by default.
        per_class: at most so many images of each class, drawn by the seed.
        placement: of the patches; the paper's by default.
        seed: of the placements and the corruptions.
        run: name of the results' folder; the data's and the classifier's by default.
        download: CIFAR-10 into its folder, where it is not there.
        load: the classifier of `@MODEL`.

    Raises:
        ToolkitError: no such data, set, class or corruption, none of the images can be used, or the disk is full.
    """
    plan = parse_corruptions(corruptions)
    images = choose_classes(open_images(str(data), classifier, "test", download), classes, classifier)
    if per_class is not None:
        images = images.draw(per_class, seed)
    find = load or (lambda name: load_classifier(name, folder=workspace.classifiers_dir))
    variants, notes = open_variants(workspace, patch_sets, classifier, find)
    without_images = {} if classes else {
        variant.name: [classifier.labels[k] for k in variant.patches.patches if k not in images.classes]
        for variant in variants if variant.patches is not None
    }  # fmt: skip
    name = check_run_name(run or f"{images.name.replace('/', '-')}-{classifier.name}")
    shared = images.only(share_classes(variants, images.classes))
    request = GridRequest(shared, tuple(variants), plan, placement or Placement(), seed, name)
    folder = workspace.eval_dir / "corruptions"
    result = run_grid(request, folder / "cells.jsonl", notes=notes)
    files = write_benchmark(folder / name, result.benchmark, draw_examples(request, result.benchmark))
    return BenchmarkRun(result, files, without_images)
