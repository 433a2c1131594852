"""`toolkit init`."""

from pathlib import Path
from typing import Annotated

import typer


def init(folder: Annotated[Path, typer.Argument(help="Folder to make a workspace of; made if missing.")]) -> None:
    """Make a workspace: rig/, print/, captures/ and eval/, with an example object spec to start from."""
    from toolkit.core.console import console
    from toolkit.core.workspace import make_workspace

    space = make_workspace(folder)
    console.print(f"made the workspace {space.root}", soft_wrap=True)
    console.print(f"next: cd {folder} && toolkit plan && toolkit capture-sim && toolkit eval captures/", soft_wrap=True)
