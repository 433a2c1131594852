"""`toolkit init`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli.output import say


def init(folder: Annotated[Path, typer.Argument(help="Folder to make a workspace of; made if missing.")]) -> None:
    """Make a workspace: toolkit.toml, which marks it, and rig/, print/, captures/ and eval/.

    What is there already stays as it is, so that a workspace of an older version can be marked.
    """
    from toolkit.core.workspace import make_workspace

    space = make_workspace(folder)
    say(f"made the workspace {space.root}")
    say(f"next: cd {folder} && toolkit plan && toolkit capture-sim && toolkit eval captures/")
