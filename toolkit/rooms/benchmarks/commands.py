"""Commands of the studies: `sweep`, `corrupt-eval`, `transfer`, and the patches and codes that they compare."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from toolkit.boosters.patch_config import RECIPES as PATCH_RECIPES
from toolkit.boosters.transforms.placement import Placement
from toolkit.cli import options
from toolkit.cli.options import Only, Overrides, from_config
from toolkit.cli.output import remark, say, show_json, show_result, show_table, warn
from toolkit.core.text import count_of, kept_before, list_some, quote
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.engine import EngineConfig
from toolkit.rooms.benchmarks.corruptions import CorruptEvalConfig
from toolkit.rooms.benchmarks.patch_sets import ASKED_OF_FLAT, ClassPatchesConfig, make_flat_config
from toolkit.rooms.benchmarks.patch_sets.baselines import FIXED_PATTERN, NEED_DATA, BaselineConfig
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.transfer import TransferConfig

if TYPE_CHECKING:
    from toolkit.models.network import Classifier
    from toolkit.rooms.benchmarks.corruptions.benchmark_run import BenchmarkRun
    from toolkit.rooms.benchmarks.patch_sets.baselines.make import MadeBaseline
    from toolkit.rooms.benchmarks.sweeps.sweep import SweepResult

SHOWN_NAMES = 5


@from_config(config=SweepConfig, engine=EngineConfig)
def sweep(
    *,
    config: SweepConfig,
    engine: EngineConfig,
    network: options.NamedNetwork,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Vary a quantity and measure where the patch still works; write table, figure and report to eval/sweeps/AXIS."""
    from toolkit.models.load import load_classifier
    from toolkit.rooms.benchmarks.sweeps.sweep import run_sweep

    space = open_workspace(workspace).with_patches(patches)
    classifier = load_classifier(*network, space.classifiers_dir)
    if config.cross:
        _sweep_crossed(space, config, classifier, engine, as_json)
        return
    # a sweep of a single axis
    result = run_sweep(space, config, classifier, engine=engine)
    if as_json:
        show_json(result.sweep.as_json())
    else:
        show_sweep(result)
    if result.sweep.skipped or result.sweep.failed:
        raise typer.Exit(1)


def _sweep_crossed(
    space: Workspace, config: SweepConfig, classifier: "Classifier", engine: EngineConfig, as_json: bool
) -> None:
    from toolkit.core.console import console
    from toolkit.rooms.benchmarks.sweeps.cross import build_crossed_table, run_crossed

    crossed = run_crossed(space, config, classifier, engine)
    if as_json:
        show_json([*crossed.cells])
    else:
        console.print(build_crossed_table(crossed))
        say(f"table: {crossed.csv_file}")
    if not crossed.is_whole:
        raise typer.Exit(1)


def show_sweep(result: "SweepResult") -> None:
    """Print the table, failures, and the paths of the files."""
    from toolkit.core.console import console
    from toolkit.evaluation.tables import list_lines
    from toolkit.rooms.benchmarks.sweeps.sweep_rows import build_sweep_table

    console.print(build_sweep_table(result.sweep))
    console.print()
    # values that cannot be shot, and unreadable images
    skipped = [(label, reason) for label, _, reason in result.sweep.skipped]
    failed = list_lines("could not be read", result.sweep.failed)
    for line in (*list_lines("not possible", skipped), *failed):
        warn(line)
    for note in result.evaluation.notes:
        remark(note)
    say(f"{count_of(result.shot, 'image')} shot, {result.kept} kept; {result.classified} classified")
    say(f"table: {result.csv_file}")
    say(f"figure: {result.figure_file}")
    say(f"report: {result.evaluation.report_file}")


@from_config(config=CorruptEvalConfig, engine=EngineConfig)
def corrupt_eval(
    *,
    data: options.Data,
    config: CorruptEvalConfig,
    engine: EngineConfig,
    network: options.NamedNetwork,
    download: options.Download = False,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Classify a corrupted data set with and without patches: the benchmark of ImageNet-C, or CIFAR-10-C.

    Results go to eval/corruptions/RUN. Every answer is computed once for all runs.
    """
    from toolkit.models.load import load_classifier
    from toolkit.models.network import Classifier
    from toolkit.rooms.benchmarks.corruptions.benchmark_run import evaluate_benchmark
    from toolkit.training.images import open_images

    space = open_workspace(workspace)

    # sets of patches may name other networks, which are loaded when they are met
    def load(name: str) -> Classifier:
        return load_classifier(name, None, network.device, space.classifiers_dir)

    classifier = load_classifier(*network, space.classifiers_dir)
    images = open_images(data, classifier, "test", download)
    done = evaluate_benchmark(space, images, classifier, config, load, engine)
    if as_json:
        typer.echo(done.files.summary.read_text(encoding="utf-8"))
    else:
        show_benchmark(done)
    if done.benchmark.failed or done.without_images:
        raise typer.Exit(1)


def show_benchmark(done: "BenchmarkRun") -> None:
    """Print failures, the table, the result in words, and the path of the report."""
    from toolkit.core.console import console, list_skipped
    from toolkit.rooms.benchmarks.corruptions.benchmark_summary import (
        build_summary_table,
        judge_benchmark,
        read_summary,
    )

    list_skipped(done.benchmark.failed)
    for name, labels in done.without_images.items():
        line = f"skipped {len(labels)} patches of {name}: no images of {list_some(labels, SHOWN_NAMES)}"
        warn(f"{line}; choose classes with --class")
    summary = read_summary(done.files.summary)
    for note in summary.notes:
        remark(note)
    console.print(build_summary_table(summary))
    for verdict in judge_benchmark(summary):
        say(verdict.sentence)
    kept = kept_before(done.benchmark.kept)
    say(f"{done.benchmark.computed} answers{kept}; table, figures and report: {done.files.report}")


@from_config(config=TransferConfig)
def transfer(
    *,
    config: TransferConfig,
    networks: options.NamedNetworks,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Train on all networks but one and test on the left-out network, for each in turn. Interrupted runs resume."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.rooms.benchmarks.transfer.leave_one_out import HEADS, leave_one_out, tabulate

    space = open_workspace(workspace)
    loaded = load_networks(*networks, space.classifiers_dir, with_sets=False)
    # networks may be left out by the name that was typed
    typed = dict(zip(networks.model or (), (network.name for network in loaded), strict=False))
    config = config.with_overrides({"left_out": tuple(typed.get(name, name) for name in config.left_out)})
    result = leave_one_out(space, config, loaded)
    if as_json:
        show_json([row.model_dump() for row in result.rows])
        return
    for seen, judges in ((False, "network that was left out"), (True, "networks that it was trained on")):
        say(f"judged by the {judges}")
        show_table(HEADS, tabulate(result.rows, seen))
    say(f"matrix: {result.json_file}, {result.markdown_file}")


@from_config(
    config=ClassPatchesConfig, placement=Placement, overrides=Only(PATCH_RECIPES, ASKED_OF_FLAT), engine=EngineConfig
)
def train_patches(
    *,
    data: options.Data,
    config: ClassPatchesConfig,
    placement: Placement,
    engine: EngineConfig,
    classes: Annotated[
        list[str] | None,
        typer.Option("--class", metavar="NAME", help="Label, index or WordNet id; default: all that have images."),
    ] = None,
    network: options.NamedNetwork,
    overrides: Overrides,
    recipe: str,
    download: options.Download = False,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Train a patch for each of many classes, to be laid on images. Interrupted runs resume."""
    from toolkit.core.console import quietly
    from toolkit.models.load import load_classifier
    from toolkit.rooms.benchmarks.patch_sets.class_patches import train_class_patches
    from toolkit.training.images import choose_classes, open_images

    space = open_workspace(workspace)
    classifier = load_classifier(*network, space.classifiers_dir)
    found = open_images(data, classifier, "train", download)
    chosen = choose_classes(found, classes or [], classifier).classes
    config = config.with_overrides(seed=seed)
    patch = make_flat_config(recipe, overrides, placement, config)
    with quietly(as_json):
        made = train_class_patches(config, patch, found, chosen, classifier, space, restart=restart, engine=engine)
    # the next command, with the same network and the new sets
    flags = {"--model": network.model, "--weights": network.weights}
    typed = [f"{flag} {quote(value)}" for flag, value in flags.items() if value is not None]
    words = " ".join(["toolkit corrupt-eval --data", quote(data), *typed, *(f"--patches {name}" for name in made.sets)])
    show_result(made, as_json, [*made.lines(), f"next: {words}"])


def list_kinds(space: Workspace) -> tuple[str, ...]:
    """Return the kinds of baselines, for the shell."""
    return get_args(BaselineConfig.model_fields["kind"].annotation)


@from_config(config=BaselineConfig)
def baseline(
    config: BaselineConfig,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Classifier whose classes they are; best-image compares its losses. Default: resnet18."
        ),
    ] = None,
    weights: options.WeightsFile = None,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Make pictures to compare patches with: codes, words, training images or noise, a picture for each class."""
    from toolkit.models.load import load_classifier
    from toolkit.rooms.benchmarks.patch_sets.baselines.make import make_baseline

    place = open_workspace(workspace)
    classifier = load_classifier(model, weights, device, place.classifiers_dir)
    made = make_baseline(config.with_overrides(seed=seed), classifier, place)
    show_result(made, as_json, _describe_baseline(made, config.kind, config.data))


def _describe_baseline(made: "MadeBaseline", kind: str, data: str | None) -> Iterator[str]:
    yield from made.lines()
    names = [patch_set.name for patch_set in made.sets if patch_set.made or patch_set.found]
    if names:
        command = "train-classifier" if kind == FIXED_PATTERN else "corrupt-eval"
        others = kind in NEED_DATA
        where = "FOLDER" if others or data is None else quote(data)
        why = ": FOLDER with other images than those they were chosen from" if others else ""
        yield f"next: toolkit {command} --data {where} --patches {names[0]}{why}"
