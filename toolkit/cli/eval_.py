"""`toolkit eval`: does a classifier recognise the object, with the booster and without?"""

import json
from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options

Names = list[str]


def evaluate(
    captures: Annotated[
        Path | None,
        typer.Argument(help="Folder of images, SOURCE/OBJECT/VARIANT/FILE, or one source; default: captures/."),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            help="Any torchvision classifier, timm:NAME, rig18, or your own; default: resnet18, or what the record of "
            "--weights says.",
        ),
    ] = None,
    weights: Annotated[
        Path | None, typer.Option("--weights", help="State dict, .pth or .safetensors; FILE.json may hold its labels.")
    ] = None,
    run: Annotated[
        str | None, typer.Option("--run", help="Name of the folder under eval/; default: the model's.")
    ] = None,
    source: Annotated[Names | None, typer.Option("--source", help="Only this source; may be repeated.")] = None,
    object_: Annotated[Names | None, typer.Option("--object", help="Only this object; may be repeated.")] = None,
    variant: Annotated[Names | None, typer.Option("--variant", help="Only this variant; may be repeated.")] = None,
    corrupt: options.Corrupt = None,
    batch_size: Annotated[
        int | None, typer.Option("--batch-size", min=1, help="Images per pass; default: 32, on a GPU 128.")
    ] = None,
    saliency: Annotated[
        bool | None,
        typer.Option(
            "--saliency/--no-saliency",
            help="Grad-CAM maps of the flips in the report; default: when there are at most 200.",
            show_default=False,
        ),
    ] = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Classify every image of a capture folder; write predictions.csv, summary.json and report.html to eval/RUN.

    With --corrupt, each image also as fog, blur, noise ... of ImageNet-C leave it: in sources SOURCE-fog-3.
    """
    from toolkit.captures.read import Selection
    from toolkit.core.workspace import open_workspace
    from toolkit.corruptions.request import parse_corruptions
    from toolkit.evaluation.evaluate import evaluate_captures
    from toolkit.models.load import load_classifier

    corruptions = parse_corruptions(corrupt or ())
    here = open_workspace(workspace)
    classifier = load_classifier(model, weights, device, quiet, here.classifiers_dir)
    selection = Selection(tuple(source or ()), tuple(object_ or ()), tuple(variant or ()))
    folder = captures or here.captures_dir
    result = evaluate_captures(folder, here, classifier, run, quiet, selection, batch_size, saliency, corruptions)
    if as_json:
        typer.echo(json.dumps(result.summary, indent=2, ensure_ascii=False))
    else:
        show_result(result)
    if result.failed:
        raise typer.Exit(1)


def show_result(result) -> None:
    """Print an `EvaluationResult`: tables, what could not be used, the result in words, and where the report is."""
    from toolkit.core.console import console, errors
    from toolkit.evaluation.tables import list_lines, print_tables

    console.print(f"network: {result.summary['model']['description']}", markup=False, soft_wrap=True)
    print_tables(console, result)
    trouble = list_lines("could not be read", result.failed)
    trouble += list_lines("without a partner", result.unpaired)
    for line in (*trouble, *(f"note: {note}" for note in result.notes)):
        errors.print(line, style="yellow", markup=False, soft_wrap=True)
    console.print(f"report: {result.report_file}", markup=False, soft_wrap=True)
