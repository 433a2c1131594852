"""`toolkit doctor`."""

import json
from dataclasses import asdict

import typer

from toolkit.cli import options


def doctor(workspace: options.Workspace = None, as_json: options.Json = False) -> None:
    """Check what the kit needs from this machine; each thing missing comes with the line that mends it."""
    from toolkit.console import console
    from toolkit.health import check_machine
    from toolkit.workspace import open_workspace

    checks = check_machine(open_workspace(workspace).root)
    missing = [check for check in checks if check.state == "missing"]
    if as_json:
        typer.echo(json.dumps([asdict(check) for check in checks], indent=2))
    else:
        marks = {"ok": ("✓", "green"), "missing": ("✗", "red"), "note": ("•", "yellow")}
        for check in checks:
            mark, colour = marks[check.state]
            console.print(f"{mark} {check.name}: {check.found}", style=colour, markup=False, soft_wrap=True)
            if check.mend:
                console.print(f"    {check.mend}", markup=False, soft_wrap=True)
        ready = "ready; next: toolkit demo" if not missing else f"{len(missing)} to mend, in the lines above"
        console.print(ready)
    raise typer.Exit(1 if missing else 0)
