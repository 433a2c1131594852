"""`toolkit init` and `toolkit doctor`: a place to work in, and what the kit needs from the machine."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.output import say, show_json


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to make a workspace of; made if missing.")],
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make a workspace: toolkit.toml, which marks it, and rig/, print/, captures/ and eval/.

    What is there already stays as it is, so that a workspace of an older version can be marked.
    """
    from toolkit.core.workspace import make_workspace

    space = make_workspace(folder)
    if as_json:
        show_json({"workspace": str(space.root)})
        return
    say(f"made the workspace {space.root}")
    say(f"next: cd {folder} && toolkit plan && toolkit capture-sim && toolkit eval captures/")


def doctor(workspace: options.Workspace = None, as_json: options.Json = False) -> None:
    """Check what the kit needs from this machine; each thing missing comes with the line that fixes it."""
    from toolkit.core.console import console
    from toolkit.core.workspace import open_workspace
    from toolkit.training.machine import check_machine

    checks = check_machine(open_workspace(workspace).root)
    missing = [check for check in checks if check.state == "missing"]
    if as_json:
        show_json([asdict(check) for check in checks])
    else:
        marks = {"ok": ("✓", "green"), "missing": ("✗", "red"), "note": ("•", "yellow")}
        for check in checks:
            mark, colour = marks[check.state]
            console.print(f"{mark} {check.name}: {check.found}", style=colour, markup=False, soft_wrap=True)
            if check.fix:
                say(f"    {check.fix}")
        say("ready; next: toolkit demo" if not missing else f"{len(missing)} to fix, as the lines above say")
    raise typer.Exit(1 if missing else 0)
