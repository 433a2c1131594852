"""`toolkit eval`: does a classifier recognise the object, with the booster and without?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, warn
from toolkit.evaluation.config import EvalConfig

if TYPE_CHECKING:
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
        typer.Option(metavar="FILE", help="State dict, .pth or .safetensors; FILE.json may hold its labels."),
    ] = None,
    config: EvalConfig,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Classify every image of a capture folder; write predictions.csv, summary.json and report.html to eval/RUN.

    With --corrupt, each image also as fog, blur, noise ... of ImageNet-C leave it: in sources SOURCE-fog-3.
    """
    from toolkit.core.workspace import open_workspace
    from toolkit.evaluation.evaluate import evaluate_captures
    from toolkit.models.load import load_classifier

    space = open_workspace(workspace)
    classifier = load_classifier(model, weights, device, folder=space.classifiers_dir)
    done = evaluate_captures(captures or space.captures_dir, space, classifier, config)
    if as_json:
        show_json(done.summary)
    else:
        show_evaluation(done)
    if done.failed:
        raise typer.Exit(1)


def show_evaluation(done: "Evaluation") -> None:
    """Print the tables, what could not be used, the result in words, and where the report is."""
    from toolkit.core.console import console
    from toolkit.evaluation.tables import list_lines, print_tables

    say(f"network: {done.summary['model']['description']}")
    print_tables(console, done, done.summary["model"]["name"])
    for line in (*list_lines("could not be read", done.failed), *list_lines("without a partner", done.unpaired)):
        warn(line)
    for note in done.notes:
        remark(note)
    say(f"report: {done.report_file}")
