"""`toolkit wrap`: an object's surface as flat pieces that are printed and stuck on it."""

from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, show_table
from toolkit.rig.requests import WrapConfig


@from_config(config=WrapConfig)
def wrap(
    *,
    object_name: Annotated[str, typer.Option("--object", metavar="NAME", help="Object to find pieces on.")],
    config: WrapConfig,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Cut an object's surface into few flat pieces that lie on it, by what random cameras see; draw and keep them."""
    from toolkit.captures.suggest_places import PIECE_TITLES, suggest_wrap
    from toolkit.core.workspace import open_workspace

    found = suggest_wrap(open_workspace(workspace, is_needed=True), object_name, config, seed)
    if as_json:
        show_json(found.as_json())
        return
    show_table(PIECE_TITLES, found.rows())
    for line in found.lines():
        say(line)
