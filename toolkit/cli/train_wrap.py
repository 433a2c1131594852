"""`toolkit train-wrap`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.boosters.pixel_config import AUGMENTATION
from toolkit.boosters.wrap_config import RECIPES, make_config
from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import show_result


@from_config(overrides=RECIPES)
def train_wrap(
    overrides: Overrides,
    recipe: str,
    class_name: Annotated[
        str | None,
        typer.Option(
            "--class", metavar="NAME", help="What it should be recognised as. Default: the object's own class."
        ),
    ] = None,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    print_profile: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            rich_help_panel=AUGMENTATION,
            help="In place of --print-process: your own printer, as 'toolkit print-profile' measured it.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=0, help="Threads that render ahead; 0: none. Default: one for each core."),
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin again; discard an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train what is on the pieces of a wrap, planning them first where there are none; goes on where it stopped."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.boosters.patch_config import use_printer
    from toolkit.boosters.wrap_task import train_wrap as run
    from toolkit.core.workspace import open_workspace

    if print_profile is not None:
        overrides = use_printer(overrides, print_profile)
    config = make_config(recipe, {**overrides, "seed": seed})
    place = open_workspace(workspace)
    networks = load_networks(model, weights, device, place.classifiers_dir)
    trained = run(config, networks, place, class_name=class_name, restart=restart, workers=workers)
    show_result(trained, as_json)
