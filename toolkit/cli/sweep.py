"""`toolkit sweep`: how far does the patch carry?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, warn
from toolkit.engine.config import EngineConfig
from toolkit.experiments.sweeps.sweep_config import SweepConfig

if TYPE_CHECKING:
    from toolkit.experiments.sweeps.sweep import SweepResult


@from_config(config=SweepConfig, engine=EngineConfig)
def sweep(
    *,
    config: SweepConfig,
    engine: EngineConfig,
    model: Annotated[
        str, typer.Option(metavar="NAME", help="Torchvision classifier, timm:NAME, rig18, or your own.")
    ] = "resnet18",
    weights: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="State dict, .pth, .ckpt or .safetensors; FILE.json may hold its labels."),
    ] = None,
    patches: options.Patches = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Vary one thing and measure where the patch still works; write table, figure and report to eval/sweeps/AXIS."""
    from toolkit.core.workspace import open_workspace
    from toolkit.experiments.sweeps.sweep import run_sweep
    from toolkit.models.load import load_classifier

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
    from toolkit.experiments.sweeps.sweep_rows import build_sweep_table

    console.print(build_sweep_table(result.sweep))
    console.print()
    skipped = [(label, reason) for label, _, reason in result.sweep.skipped]
    failed = list_lines("could not be read", result.sweep.failed)
    for line in (*list_lines("not possible", skipped), *failed):
        warn(line)
    for note in result.evaluation.notes:
        remark(note)
    say(f"{result.shot} images shot, {result.kept} kept; {result.classified} classified")
    say(f"table: {result.csv_file}")
    say(f"figure: {result.figure_file}")
    say(f"report: {result.evaluation.report_file}")
