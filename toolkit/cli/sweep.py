"""`toolkit sweep`: how far does the patch carry?"""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options

Names = list[str]


def sweep(
    axis: Annotated[str, typer.Argument(help="light, backdrop, distance, resolution, size or seed.")],
    values: Annotated[
        Names | None,
        typer.Option(
            "--values",
            help="Values to try; repeat, or separate by commas. Names of lights or backdrops, factors of the plan's "
            "distance, widths of the picture in px, sides of the printed patch in mm, or seeds.",
        ),
    ] = None,
    objects: Annotated[
        Names | None, typer.Option("--object", help="Object to shoot; repeat for more. Default: all in the plan.")
    ] = None,
    variants: Annotated[
        Names | None,
        typer.Option("--variant", help="As in capture-sim; repeat for more. Default: unpatched and patched."),
    ] = None,
    model: Annotated[
        str, typer.Option("--model", help="Torchvision classifier, timm:NAME, rig18, or your own.")
    ] = "resnet18",
    weights: Annotated[
        Path | None, typer.Option("--weights", help="State dict, .pth or .safetensors; FILE.json may hold its labels.")
    ] = None,
    patches: Annotated[
        str | None, typer.Option("--patches", help="Folder of patches below print/patches; default: that one itself.")
    ] = None,
    run: Annotated[
        str | None, typer.Option("--run", help="Name in the results' file names; default: the model's.")
    ] = None,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Vary one thing and see how far the patch carries; write table, figure and report to eval/sweeps/AXIS."""
    import json

    from toolkit.captures.shoot import ShootSettings
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifier
    from toolkit.rig.plan import open_plan
    from toolkit.rig.variants import PAIR
    from toolkit.sweeps.axes import Setup, find_axis, parse_values
    from toolkit.sweeps.sweep import run_sweep

    chosen = find_axis(axis)
    wanted = parse_values(chosen, values)
    space = open_workspace(workspace).with_patches(patches)
    plan = open_plan(space, objects)
    classifier = load_classifier(model, weights, device, quiet or as_json, space.classifiers_dir)
    base = Setup(plan, ShootSettings(seed))
    result = run_sweep(
        space, chosen, wanted, base, objects or list(plan.objects), classifier, variants or PAIR, run, quiet or as_json
    )
    if as_json:
        typer.echo(json.dumps(result.sweep.as_json(), indent=2, ensure_ascii=False))
    else:
        show_sweep(result)
    if result.sweep.skipped or result.sweep.failed:
        raise typer.Exit(1)


def show_sweep(result) -> None:
    """Print a `SweepResult`: the table, what could not be shot or read, and where the files are."""
    from toolkit.core.console import console, errors
    from toolkit.evaluation.tables import list_lines
    from toolkit.sweeps.result import build_sweep_table

    console.print(build_sweep_table(result.sweep))
    console.print()
    skipped = [(label, reason) for label, _, reason in result.sweep.skipped]
    trouble = list_lines("not possible", skipped)
    trouble += list_lines("could not be read", result.sweep.failed)
    for line in (*trouble, *(f"note: {note}" for note in result.evaluation.notes)):
        errors.print(line, style="yellow", markup=False, soft_wrap=True)
    console.print(f"{result.shot} images shot, {result.kept} kept; {result.classified} classified", soft_wrap=True)
    for kind, file in (
        ("table", result.csv_file), ("figure", result.figure_file), ("report", result.evaluation.report_file)
    ):  # fmt: skip
        console.print(f"{kind}: {file}", markup=False, soft_wrap=True)
