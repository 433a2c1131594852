"""`toolkit place`: where on an object is a patch best stuck?"""

from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, show_table, warn
from toolkit.rig.requests import PlaceConfig


@from_config(config=PlaceConfig)
def place(
    *,
    object_name: Annotated[str, typer.Option("--object", metavar="NAME", help="Object to look for places on.")],
    config: PlaceConfig,
    train: Annotated[
        int,
        typer.Option(
            "--train",
            metavar="STEPS",
            min=0,
            help="Also train a patch in each of the best places, for this many steps.",
        ),
    ] = 0,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    write: Annotated[
        bool, typer.Option("--write", help="Put the best place into the object's file, rig/objects/NAME.toml.")
    ] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Score places and sizes for a patch by what cameras see of it, and draw the best.

    One sheet is scored by the plan's cameras; with --sheets 2 or more, those that go on together by random ones.
    """
    from toolkit.captures.suggest_places import TITLES, suggest_places
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifiers

    space = open_workspace(workspace)
    networks = load_classifiers(model, weights, device, space.classifiers_dir) if train else []
    found = suggest_places(space, object_name, config, networks=networks, steps=train, write=write, seed=seed)
    if as_json:
        show_json(found.as_json())
        return
    show_table(TITLES, found.rows())
    for line in found.lines():
        say(line)
    for line in found.warnings():
        warn(line)
