"""`toolkit check`: the gates over a folder of photographs."""

import json
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options

if TYPE_CHECKING:
    from toolkit.photos.gates.check_captures import CheckReport


def check(
    source: Annotated[str, typer.Option(help="Folder below captures/.")] = "real",
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Judge photographs: sharp, well exposed, whole, of the right variant, the patch in its place; else a retake list.

    Photographs that were imported have been judged already; those sorted into captures/real by hand are judged here.
    """
    from toolkit.core.console import console
    from toolkit.core.workspace import open_workspace
    from toolkit.photos.gates.check_captures import check_captures

    space = open_workspace(workspace).with_patches(patches)
    report = check_captures(space, source, quiet or as_json)
    if as_json:
        typer.echo(json.dumps(report.to_json(), indent=2, ensure_ascii=False))
    else:
        show_report(report, str(space.captures_dir / source))
        console.print(f"next: toolkit eval {space.captures_dir}", markup=False, soft_wrap=True)
    if report.unreadable:
        raise typer.Exit(1)


def show_report(report: "CheckReport", folder: str) -> None:
    """Print what the gates found: what to take again and why, and what could not be checked."""
    from toolkit.core.console import console, errors
    from toolkit.photos.gates.check_captures import RETAKE_FILE

    for path, reason in report.unreadable:
        errors.print(f"skipped {path}: {reason}", style="yellow", markup=False, soft_wrap=True)
    for row in report.retakes:
        errors.print(f"retake {row.describe()}", style="yellow", markup=False, soft_wrap=True)
    for gate, reason, count in report.unchecked:
        errors.print(f"note: {gate} not checked in {count} photographs: {reason}", markup=False, soft_wrap=True)
    passed = len(report.photos) - len({row.path for row in report.retakes if row.path})
    console.print(f"{passed} of {len(report.photos)} photographs pass every gate that was checked", soft_wrap=True)
    if report.retakes:
        console.print(f"to take again: {folder}/{RETAKE_FILE}", markup=False, soft_wrap=True)
