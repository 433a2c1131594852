"""`toolkit corrupt-eval`: does a patch help where the weather, the camera or the transmission is bad?"""

from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, warn
from toolkit.core.text import kept_before
from toolkit.engine.config import EngineConfig
from toolkit.experiments.corruptions.benchmark_config import CorruptEvalConfig

if TYPE_CHECKING:
    from toolkit.experiments.corruptions.benchmark_run import BenchmarkRun

SHOWN_NAMES = 5


@from_config(config=CorruptEvalConfig, engine=EngineConfig)
def corrupt_eval(
    *,
    data: Annotated[
        str,
        typer.Option(
            metavar="FOLDER",
            help="Folder with one folder per class (its val/ or test/, where there is one), or cifar10:FOLDER.",
        ),
    ],
    config: CorruptEvalConfig,
    engine: EngineConfig,
    model: options.Model = None,
    weights: options.WeightsFile = None,
    download: options.Download = False,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Classify a corrupted data set with and without patches: the benchmark of ImageNet-C, or CIFAR-10-C.

    Results go to eval/corruptions/RUN. An answer is computed once, whatever run asks for it.
    """
    from toolkit.core.workspace import open_workspace
    from toolkit.experiments.corruptions.benchmark_run import evaluate_benchmark
    from toolkit.models.load import load_classifier
    from toolkit.models.network import Classifier
    from toolkit.training.images import open_images

    space = open_workspace(workspace)

    def load(name: str) -> Classifier:
        return load_classifier(name, None, device, folder=space.classifiers_dir)

    classifier = load_classifier(model, weights, device, folder=space.classifiers_dir)
    images = open_images(data, classifier, "test", download)
    done = evaluate_benchmark(space, images, classifier, config, load, engine)
    if as_json:
        typer.echo(done.files.summary.read_text(encoding="utf-8"))
    else:
        show_benchmark(done)
    if done.benchmark.failed or done.without_images:
        raise typer.Exit(1)


def show_benchmark(done: "BenchmarkRun") -> None:
    """Print what could not be used, the table, the result in words, and where the report is."""
    from toolkit.core.console import console, list_skipped
    from toolkit.experiments.corruptions.benchmark_summary import build_summary_table, judge_benchmark, read_summary

    list_skipped(done.benchmark.failed)
    for name, labels in done.without_images.items():
        more = f" and {len(labels) - SHOWN_NAMES} more" if len(labels) > SHOWN_NAMES else ""
        line = f"skipped {len(labels)} patches of {name}: no images of {', '.join(labels[:SHOWN_NAMES])}{more}"
        warn(f"{line}; --class names those that are meant")
    for note in done.benchmark.notes:
        remark(note)
    summary = read_summary(done.files.summary)
    console.print(build_summary_table(summary))
    for verdict in judge_benchmark(summary):
        say(verdict.sentence)
    kept = kept_before(done.benchmark.kept)
    say(f"{done.benchmark.computed} answers{kept}; table, figures and report: {done.files.report}")
