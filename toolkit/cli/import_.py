"""`toolkit import`: photographs from a camera or phone into captures/real."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.check import show_report

SHOWN_POSES = 6
SHOWN_AGAIN = 10


def import_(
    photos: Annotated[
        list[Path], typer.Argument(metavar="PHOTOS...", help="Folders, photographs or videos; they stay as they are.")
    ],
    object_: Annotated[str | None, typer.Option("--object", help="What all of them show. Default: see below.")] = None,
    variant: Annotated[
        str | None, typer.Option("--variant", help="unpatched, patched, a control, or a booster's name.")
    ] = None,
    pose: Annotated[int | None, typer.Option("--pose", min=1, help="Pose of the one photograph that is given.")] = None,
    match: Annotated[
        str,
        typer.Option("--match", help="What tells the pose: board, name (pose_07), order (of time), render, or auto."),
    ] = "auto",
    first_shot: Annotated[
        int | None,
        typer.Option("--first-shot", min=1, help="The photographs are a part of the shot list, from this shot on."),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option("--every", help="Take a frame of a video in each so many seconds, not one per still moment."),
    ] = None,
    link: Annotated[bool, typer.Option("--link", help="Hard links instead of copies, where possible.")] = False,
    replace: Annotated[
        bool, typer.Option("--replace", help="A retake replaces the earlier photograph, which is kept aside.")
    ] = False,
    ask: Annotated[
        bool | None,
        typer.Option("--ask/--no-ask", help="Ask what is in doubt. Default: at a terminal.", show_default=False),
    ] = None,
    source: Annotated[str, typer.Option(help="Folder below captures/.")] = "real",
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Import photographs (JPEG, HEIC, PNG, TIFF, WebP, DNG, video): each finds its pose, none is taken twice.

    Object and variant come from the options, from folders OBJECT/VARIANT, or from the shot list that was followed.
    """
    from toolkit.core.workspace import open_workspace
    from toolkit.photos.gates.check_captures import check_captures, make_check
    from toolkit.photos.importing.import_photos import import_photos
    from toolkit.photos.importing.settings import ImportSettings

    space = open_workspace(workspace).with_patches(patches)
    settings = ImportSettings(object_, variant, pose, match, first_shot, link, replace, every, source)
    asking = ask if ask is not None else sys.stdin.isatty() and not (quiet or as_json)
    silent = quiet or as_json
    result = import_photos(
        space, photos, settings, check=make_check(space, source), ask=ask_person if asking else None, quiet=silent
    )
    report = check_captures(space, source, silent) if any(row.there for row in result.coverage) else None
    if as_json:
        gates = None if report is None else report.to_json()
        typer.echo(json.dumps(result.to_json() | {"gates": gates}, indent=2, ensure_ascii=False))
    else:
        show_result(result, report)
    if result.refused:
        raise typer.Exit(1)


def ask_person(question: str, answers: Sequence[str]) -> str | None:
    """Put a question on stderr until it is answered with one of `answers`, or with s or nothing to leave it out."""
    shown = "/".join(answers) if len(answers) <= SHOWN_POSES else f"{answers[0]}-{answers[-1]}"
    while True:
        answer = typer.prompt(f"{question} [{shown}, s to leave it out]", default="s", show_default=False, err=True)
        answer = answer.strip().lower()
        if answer in ("s", "n", "skip", "no"):
            return None
        if answer in answers:
            return answer
        typer.echo(f"'{answer}' is none of them", err=True)


def show_result(result, report=None) -> None:
    """Print an `ImportResult` and its `CheckReport`: what came, what is missing or to be taken again, what is next."""
    from rich.table import Table
    from rich.text import Text

    from toolkit.core.console import console, errors

    if result.coverage:
        table = Table("object", "variant", "imported", "there", "missing poses", "mean pose error")
        for row in result.coverage:
            error = "" if row.mean_error_deg is None else f"{row.mean_error_deg:.1f}°, {row.mean_error_mm:.0f} mm"
            total = f"{row.there} of {row.there + len(row.missing)}"
            missing = _shorten(row.missing)
            cells = (row.object, row.variant, str(row.imported), total, missing, error)
            table.add_row(*(Text(cell) for cell in cells))
        console.print(table)
    again = (*result.duplicates, *result.before)
    for name, reason in again[:SHOWN_AGAIN]:
        errors.print(f"not again {name}: {reason}", markup=False, soft_wrap=True)
    if len(again) > SHOWN_AGAIN:
        errors.print(f"not again {len(again) - SHOWN_AGAIN} more: --json lists them all", soft_wrap=True)
    for name, reason in result.refused:
        errors.print(f"skipped {name}: {reason}", style="yellow", markup=False, soft_wrap=True)
    for note in result.notes:
        errors.print(f"note: {note}", markup=False, soft_wrap=True)
    before = f", {len(result.before)} imported before" if result.before else ""
    skipped = f", {len(result.refused)} skipped" if result.refused else ""
    console.print(
        f"imported {len(result.imported)} photographs{before}{skipped}: {result.source_dir}",
        markup=False, soft_wrap=True,
    )  # fmt: skip
    if report is not None:
        show_report(report, str(result.source_dir))
    if any(row.there for row in result.coverage):
        console.print(f"next: toolkit eval {result.source_dir.parent}", markup=False, soft_wrap=True)


def _shorten(poses: Sequence[int]) -> str:
    """1, 2, 3, 7 as "1-3 7"."""
    runs: list[list[int]] = []
    for pose in sorted(poses):
        if runs and pose == runs[-1][1] + 1:
            runs[-1][1] = pose
        else:
            runs.append([pose, pose])
    return " ".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)
