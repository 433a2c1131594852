"""`toolkit wrap` and `train-wrap`, and the printing of pieces for `toolkit print`."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import say, show_json, show_result, show_table
from toolkit.cli.print_ import AT_TRUE_SIZE
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.printing import PrintSettings, WrapSettings
from toolkit.rooms.wraps.config import WrapConfig
from toolkit.rooms.wraps.wrap_config import WRAP_RECIPES, make_wrap_config


@from_config(config=WrapConfig)
def wrap(
    *,
    object_name: Annotated[str, typer.Option("--object", metavar="NAME", help="Object to find pieces on.")],
    config: WrapConfig,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Cut the visible surface of an object into a few flat pieces. Draw them, and write the plan."""
    from toolkit.rooms.wraps.suggest_wrap import PIECE_TITLES, suggest_wrap

    found = suggest_wrap(open_workspace(workspace, is_needed=True), object_name, config, seed)
    if as_json:
        show_json(found.as_json())
        return
    show_table(PIECE_TITLES, found.rows())
    for line in found.lines():
        say(line)


@from_config(overrides=WRAP_RECIPES)
def train_wrap(
    *,
    overrides: Overrides,
    recipe: str,
    class_name: options.TrueClass = None,
    networks: options.NamedNetworks,
    print_profile: options.PrintProfile = None,
    workers: options.RenderThreads = None,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    verbose: options.Verbose = False,
    as_json: options.Json = False,
) -> None:
    """Train the pictures on the pieces of a wrap, and plan the pieces if there are none. Interrupted runs resume."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.rooms.wraps.wrap_task import train_wrap as run

    config = make_wrap_config(recipe, {**overrides, "seed": seed}, print_profile)
    place = open_workspace(workspace)
    loaded = load_networks(*networks, place.classifiers_dir)
    trained = run(config, loaded, place, class_name=class_name, restart=restart, workers=workers)
    show_result(trained, as_json)


def print_pieces(
    space: Workspace, name: str, settings: PrintSettings, cut: WrapSettings, out: Path | None, as_json: bool
) -> None:
    """Print a wrap's pieces, and report the files."""
    from toolkit.printing.print_patches import shorten
    from toolkit.rooms.wraps.printing.print_wrap import print_wrap

    printed = print_wrap(space, name, settings, cut, out)
    if as_json:
        show_json({"printed": [asdict(printed)], "failed": [], "notes": []})
        return
    say(printed.describe())
    if printed.cut_files:
        say(f"{', '.join(map(shorten, printed.cut_files))}: the outlines alone")
    tiled = any(sheet.tiles != (1, 1) for sheet in printed.placed)
    join = ["join the tiles as each map shows"] if tiled else []
    say(f"next: {', '.join([AT_TRUE_SIZE, *join, 'cut along the line and stick the pieces on as page 1 says'])}")
