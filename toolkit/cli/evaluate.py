"""Commands that ask networks: about captures, corrupted data, other networks' boosters, worlds; and `corrupt`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_table, warn
from toolkit.core.files import load_json
from toolkit.core.text import count_of, kept_before, list_some
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.corruptions.catalogue import SEVERITIES, find_note, parse_corruptions
from toolkit.engine import EngineConfig
from toolkit.evaluation import EvalConfig
from toolkit.rooms.benchmarks.corruptions import CorruptEvalConfig
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.transfer import TransferConfig
from toolkit.rooms.worlds.evaluation import WorldEvalConfig

if TYPE_CHECKING:
    from toolkit.evaluation.evaluate import Evaluation
    from toolkit.rooms.benchmarks.corruptions.benchmark_run import BenchmarkRun
    from toolkit.rooms.benchmarks.sweeps.sweep import SweepResult
    from toolkit.rooms.worlds.evaluation.world_run import WorldRun

SHOWN_FAILURES = 20
SHOWN_NAMES = 5


@from_config(config=EvalConfig)
def evaluate(
    *,
    captures: Annotated[
        Path | None,
        typer.Argument(help="Folder of images, SOURCE/OBJECT/VARIANT/FILE, or one source; default: captures/."),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Any torchvision classifier, timm:NAME, onnx:FILE, a .pt2, hf:ORG/NAME, python:MODULE:FUNCTION, "
            "rig18, your own; default: resnet18, or what the record of --weights says.",
        ),
    ] = None,
    weights: options.WeightsFile = None,
    config: EvalConfig,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Classify every image of a capture folder; write predictions.csv, summary.json and report.html to eval/RUN.

    With a detector (torchvision:NAME, onnx:FILE) look for the object instead: detections.csv.

    With --corrupt, also classify each image with ImageNet-C's fog, blur, noise ...: in sources SOURCE-fog-3.
    """
    from toolkit.captures.read import find_captured
    from toolkit.models.find import may_be_detector

    space = open_workspace(workspace)
    folder = captures or space.captures_dir
    find_captured(folder)  # before a network is loaded
    if may_be_detector(model):
        from toolkit.models.load_detector import is_detector

        if is_detector(model):
            _detect(folder, space, (str(model), weights, device), config, as_json)
            return
    from toolkit.evaluation.evaluate import evaluate_captures
    from toolkit.models.load import load_classifier

    classifier = load_classifier(model, weights, device, folder=space.classifiers_dir)
    done = evaluate_captures(folder, space, classifier, config)
    if as_json:
        show_json(done.summary)
    else:
        show_evaluation(done)
    if done.failed or (done.origin and done.origin.faults):
        raise typer.Exit(1)


def _detect(
    captures: Path, space: Workspace, named: tuple[str, Path | None, str], config: EvalConfig, as_json: bool
) -> None:
    """The same with a detector."""
    from toolkit.evaluation.detect import describe_pairs, evaluate_detector
    from toolkit.evaluation.tables import format_interval, format_percent, list_lines
    from toolkit.models.load_detector import load_detector

    detector = load_detector(*named)
    done = evaluate_detector(captures, space, detector, config)
    if as_json:
        show_json(done.summary)
    else:
        say(f"detector: {detector.name} ({detector.arch}, weights {detector.weights.name})")
        for heading, text in done.origin.lines():
            say(f"  {heading}: {text}")
        rows = [
            (
                group.source, group.object, group.variant, group.n, format_percent(group.found),
                format_interval(group.found_ci95), format_percent(group.recall50),
                *("" if ap is None else f"{ap:.2f}" for ap in (group.ap50, group.ap50_95)),
            )
            for group in done.groups
        ]  # fmt: skip
        show_table(("source", "object", "variant", "n", "found, %", "95 %", "recall, %", "AP50", "AP50:95"), rows)
        for line in describe_pairs(done):
            say(line)
        for line in list_lines("left out", done.left_out):
            warn(line)
        for note in done.notes:
            remark(note)
        say(f"report: {done.run_dir / 'report.html'}")
    if done.left_out:
        raise typer.Exit(1)


def show_evaluation(done: "Evaluation") -> None:
    """Print the tables, what could not be used, the result in words, and where the report is."""
    from toolkit.core.console import console
    from toolkit.evaluation.tables import list_lines, list_unpaired, print_tables

    say(f"network: {done.summary['model']['description']}")
    print_tables(console, done, done.summary["model"]["name"])
    faults = list_lines("set aside", done.origin.faults if done.origin else [])
    for line in (*faults, *list_lines("could not be read", done.failed), *list_unpaired(done.unpaired, done.no_pairs)):
        warn(line)
    for note in done.notes:
        remark(note)
    say(f"report: {done.report_file}")


@from_config(config=SweepConfig, engine=EngineConfig)
def sweep(
    *,
    config: SweepConfig,
    engine: EngineConfig,
    model: options.Model = None,
    weights: options.WeightsFile = None,
    patches: options.Patches = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Vary one thing and measure where the patch still works; write table, figure and report to eval/sweeps/AXIS."""
    from toolkit.models.load import load_classifier
    from toolkit.rooms.benchmarks.sweeps.sweep import run_sweep

    space = open_workspace(workspace).with_patches(patches)
    classifier = load_classifier(model, weights, device, folder=space.classifiers_dir)
    result = run_sweep(space, config, classifier, engine=engine)
    if as_json:
        show_json(result.sweep.as_json())
    else:
        show_sweep(result)
    if result.sweep.skipped or result.sweep.failed:
        raise typer.Exit(1)


def show_sweep(result: "SweepResult") -> None:
    """Print the table, what could not be shot or read, and where the files are."""
    from toolkit.core.console import console
    from toolkit.evaluation.tables import list_lines
    from toolkit.rooms.benchmarks.sweeps.sweep_rows import build_sweep_table

    console.print(build_sweep_table(result.sweep))
    console.print()
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


def corrupt(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Folder of images, in any layout, or one image.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to write to; for one image also a .png or .jpg.")],
    names: Annotated[
        list[str],
        typer.Option(
            "--corrupt",
            metavar="NAME[:SEVERITY]",
            help="Corruption, or noise, blur, weather, digital, extra, common (15), all; fog:3 or noise:1-3 for "
            "some severities; may be repeated.",
        ),
    ],
    severities: Annotated[
        list[int] | None,
        typer.Option(
            "--severity",
            metavar="N",
            min=1,
            max=5,
            help="Severity where --corrupt names none: 1 (slight) to 5 (severe); may be repeated. Default: all five.",
        ),
    ] = None,
    image_px: Annotated[
        int | None,
        typer.Option(metavar="N", help="First resize and crop to N×N pixels (published: 224). Default: as they are."),
    ] = None,
    image_format: Annotated[
        str, typer.Option("--format", metavar="png|jpg", help="jpg: of quality 85, as ImageNet-C was saved.")
    ] = "png",
    seed: options.Seed = 0,
    device: options.Device = "auto",
    as_json: options.Json = False,
) -> None:
    """Corrupt images as ImageNet-C and CIFAR-10-C do: 15 corruptions and 4 more, at 5 severities.

    One corruption at one severity mirrors IN in OUT; several lie in OUT/NAME/SEVERITY.
    """
    from toolkit.captures.read import find_faults
    from toolkit.corruptions.folder import corrupt_images
    from toolkit.models.network import choose_device

    chosen = parse_corruptions(names, severities or SEVERITIES)
    result = corrupt_images(
        source, out, chosen, seed=seed, size_px=image_px, image_format=image_format, device=choose_device(device),
        skip=find_faults(source),
    )  # fmt: skip
    if as_json:
        show_json({"out": str(out)} | result.as_json())
    else:
        # corruptions that differ from the published definitions are named
        note = find_note(list(dict.fromkeys(name for name, _ in chosen)))
        for line in (*result.describe_scale(), *([note] if note else [])):
            remark(line)
        for path, reason in result.failed[:SHOWN_FAILURES]:
            warn(f"failed: {path}: {reason}")
        if len(result.failed) > SHOWN_FAILURES:
            warn(f"failed: {len(result.failed) - SHOWN_FAILURES} more, --json lists them all")
        say(f"made {count_of(result.made, 'image')}{kept_before(result.kept)}: {out}")
    if result.failed:
        raise typer.Exit(1)


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
    as_json: options.Json = False,
) -> None:
    """Classify a corrupted data set with and without patches: the benchmark of ImageNet-C, or CIFAR-10-C.

    Results go to eval/corruptions/RUN. An answer is computed once, whatever run asks for it.
    """
    from toolkit.models.load import load_classifier
    from toolkit.models.network import Classifier
    from toolkit.rooms.benchmarks.corruptions.benchmark_run import evaluate_benchmark
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
    from toolkit.rooms.benchmarks.corruptions.benchmark_summary import (
        build_summary_table,
        judge_benchmark,
        read_summary,
    )

    list_skipped(done.benchmark.failed)
    for name, labels in done.without_images.items():
        line = f"skipped {len(labels)} patches of {name}: no images of {list_some(labels, SHOWN_NAMES)}"
        warn(f"{line}; --class names those that are meant")
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
    model: options.Models = None,
    weights: options.WeightFiles = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Train on all networks but one and test on that one, for each in turn; a stopped run goes on where it was."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.rooms.benchmarks.transfer.leave_one_out import HEADS, leave_one_out, tabulate

    space = open_workspace(workspace)
    networks = load_networks(model, weights, device, space.classifiers_dir, may_mix=True)
    typed = dict(zip(model or (), (network.name for network in networks), strict=False))
    config = config.with_overrides({"left_out": tuple(typed.get(name, name) for name in config.left_out)})
    result = leave_one_out(space, config, networks)
    if as_json:
        show_json([row.model_dump() for row in result.rows])
        return
    for seen, judges in ((False, "network that was left out"), (True, "networks that it was trained on")):
        say(f"judged by the {judges}")
        show_table(HEADS, tabulate(result.rows, seen))
    say(f"matrix: {result.json_file}, {result.markdown_file}")


@from_config(config=WorldEvalConfig, engine=EngineConfig)
def world_eval(
    *,
    config: WorldEvalConfig,
    engine: EngineConfig,
    model: options.Model = None,
    weights: options.WeightsFile = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Render an object in a world from a grid of cameras, in weather, and classify the pictures.

    Results go to eval/RUN. An answer is computed once, whatever run asks for it.
    """
    from toolkit.core.console import list_skipped
    from toolkit.models.load import load_classifier
    from toolkit.rooms.worlds.evaluation.world_run import evaluate_world

    space = open_workspace(workspace)
    classifier = load_classifier(model, weights, device, folder=space.classifiers_dir)
    done = evaluate_world(space, classifier, config, engine)
    list_skipped(done.failed)
    if as_json:
        typer.echo(done.files.summary.read_text(encoding="utf-8"))
    else:
        show_world(done)
    if done.failed:
        raise typer.Exit(1)


def show_world(done: "WorldRun") -> None:
    """Print the weathers in numbers, the cameras, the table, the result in words, and where the report is."""
    from toolkit.core.console import console
    from toolkit.rooms.worlds.depth_weather import describe_weathers
    from toolkit.rooms.worlds.evaluation.world_results import build_world_table, judge_world

    summary = load_json(done.files.summary)
    for line in describe_weathers(done.results.weathers):
        say(line)
    cameras = summary["cameras"][-1]
    left_out = ", ".join(f"{count} {key.partition(': ')[2]}" for key, count in cameras.items() if "left out" in key)
    say(
        f"{cameras['points']} points of the grid: {cameras['standing']} can hold a camera"
        f"{f' (left out: {left_out})' if left_out else ''}; {cameras['shot']} shot, {cameras['in_view']} with the "
        f"object in view, {cameras['hidden']} with it hidden"
    )
    console.print(build_world_table(summary))
    for verdict in judge_world(summary):
        say(verdict.sentence)
    for note in summary["notes"]:
        remark(note)
    say(f"{done.computed} answers{kept_before(done.kept)}; table, figures and report: {done.files.report}")
