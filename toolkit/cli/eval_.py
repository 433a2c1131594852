"""`toolkit eval`: does a classifier recognise the object, with the booster and without?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_table, warn
from toolkit.evaluation.eval_config import EvalConfig

if TYPE_CHECKING:
    from toolkit.core.workspace import Workspace
    from toolkit.evaluation.evaluate import Evaluation


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
            help="Any torchvision classifier, timm:NAME, onnx:FILE, a .pt2, python:MODULE:FUNCTION, rig18, your own; "
            "default: resnet18, or what the record of --weights says.",
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="State dict, .pth, .ckpt or .safetensors; FILE.json may hold its labels."),
    ] = None,
    config: EvalConfig,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Classify every image of a capture folder; write predictions.csv, summary.json and report.html to eval/RUN.

    With a detector (torchvision:NAME, onnx:FILE) look for the object instead: detections.csv.

    With --corrupt, also classify each image with ImageNet-C's fog, blur, noise ...: in sources SOURCE-fog-3.
    """
    from toolkit.captures.read import find_captured
    from toolkit.core.workspace import open_workspace
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
    if done.failed:
        raise typer.Exit(1)


def _detect(
    captures: Path, space: "Workspace", named: tuple[str, Path | None, str], config: EvalConfig, as_json: bool
) -> None:
    """The same with a detector."""
    from toolkit.evaluation.detect import evaluate_detector
    from toolkit.evaluation.detection_report import describe_pairs
    from toolkit.evaluation.tables import format_interval, format_percent, list_lines
    from toolkit.models.load_detector import load_detector

    detector = load_detector(*named)
    done = evaluate_detector(captures, space, detector, config)
    if as_json:
        show_json(done.summary)
    else:
        say(f"detector: {detector.name} ({detector.arch}, weights {detector.weights.name})")
        rows = [
            (
                one.source, one.object, one.variant, one.n, format_percent(one.found), format_interval(one.found_ci95),
                format_percent(one.recall50), *("" if ap is None else f"{ap:.2f}" for ap in (one.ap50, one.ap50_95)),
            )
            for one in done.groups
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
    for line in (*list_lines("could not be read", done.failed), *list_unpaired(done.unpaired)):
        warn(line)
    for note in done.notes:
        remark(note)
    say(f"report: {done.report_file}")
