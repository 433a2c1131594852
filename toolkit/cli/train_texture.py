"""`toolkit train-texture`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.boosters.texture_config import RECIPES, make_config
from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import show_result


@from_config(overrides=RECIPES)
def train_texture(
    overrides: Overrides,
    recipe: str,
    class_name: Annotated[
        str | None,
        typer.Option(
            "--class", metavar="NAME", help="What it should be recognised as. Default: the objects' own class."
        ),
    ] = None,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="File name, without suffix. Default: the object's, or for several the class's."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for the texture. Default: rig/textures.")
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
    """Train a texture that makes a network see an object's class; an interrupted run goes on where it stopped."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.boosters.texture import train_texture as run
    from toolkit.core.workspace import open_workspace

    config = make_config(recipe, {**overrides, "seed": seed})
    place = open_workspace(workspace)
    networks = load_networks(model, weights, device, place.classifiers_dir)
    trained = run(config, networks, place, class_name=class_name, name=name, out=out, restart=restart, workers=workers)
    show_result(trained, as_json)
