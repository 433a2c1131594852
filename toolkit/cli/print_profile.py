"""`toolkit print-profile`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.core.errors import ToolkitError

if TYPE_CHECKING:
    from toolkit.photos.prints.profile_photos import ProfileRun


def print_profile(
    photos: Annotated[list[Path], typer.Argument(help="Photographs of the printed page, or a folder of them.")],
    class_name: Annotated[str, typer.Option("--class", help="The patch on it, by file name or by class.")],
    paper: Annotated[
        str, typer.Option(help="Of the page, whose edges say at which size it was printed: a4, letter, 200x300mm.")
    ] = "a4",
    size_mm: Annotated[
        float | None, typer.Option(help="Side of the printed patch. Default: as its record says.", min=1)
    ] = None,
    name: Annotated[str | None, typer.Option(help="Of the profile: printer and paper. Default: the patch's.")] = None,
    by: Annotated[str | None, typer.Option(help="Who measured, to be recorded.")] = None,
    out: Annotated[Path | None, typer.Option(help="JSON file. Default: print/profiles/NAME.json.")] = None,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Measure what a printer makes of a patch's colours and size, from photos of its page, for 'train-patch'."""
    import json
    import re

    from toolkit.core.console import list_skipped
    from toolkit.core.workspace import open_workspace
    from toolkit.imaging.printer import write_print_profile
    from toolkit.objects.records import read_patch
    from toolkit.photos.prints.profile_photos import profile_photos
    from toolkit.printing.page import parse_paper
    from toolkit.printing.print_patches import select_patches

    if name is not None and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise ToolkitError(f"--name '{name}': expected letters, digits, '-' and '_', without a suffix")
    space = open_workspace(workspace).with_patches(patches)
    chosen = select_patches(space, [class_name])
    if len(chosen) > 1:
        names = ", ".join(file.stem for file in chosen)
        raise ToolkitError(f"--class {class_name} means {len(chosen)} patches: name one of them by its file: {names}")
    patch = read_patch(chosen[0])
    run = profile_photos(photos, patch, parse_paper(paper), size_mm, name, by, quiet or as_json)
    list_skipped(run.skipped)
    file = write_print_profile(out or space.root / "print" / "profiles" / f"{run.profile.name}.json", run.profile)
    if as_json:
        typer.echo(json.dumps(_as_json(run, file), indent=2, ensure_ascii=False))
    else:
        _report(run, file, size_mm or patch.size_mm)
    if run.skipped:
        raise typer.Exit(1)


def _as_json(run: "ProfileRun", file: Path) -> dict:
    from dataclasses import asdict

    photos = [asdict(photo) | {"colour": asdict(photo.colour)} for photo in run.photos]
    for photo in photos:
        photo["colour"]["error"] = photo["colour"]["error"].model_dump()
    return {
        "file": str(file), "profile": run.profile.model_dump(mode="json"), "photos": photos,
        "skipped": [{"path": path, "reason": reason} for path, reason in run.skipped],
        "tried": run.tried, "warnings": list(run.warnings),
    }  # fmt: skip


def _report(run: "ProfileRun", file: Path, expected_mm: float) -> None:
    from toolkit.core.console import console, errors

    def say(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    for photo in run.photos:
        size = "sheet's edges not seen"
        if photo.size_mm is not None:
            size = f"{photo.size_mm:.1f} mm of {expected_mm:.1f} mm"
        strip = "strip read" if photo.has_strip else "no strip"
        bias = ", ".join(
            f"{channel} {100 * value:+.0f} %" for channel, value in zip("RGB", photo.colour.bias, strict=True)
        )
        say(f"{photo.name}: {size}, {strip}, printed colours off by {photo.colour.error}, on average {bias}")
    for warning in run.warnings:
        errors.print(f"note: {warning}", style="yellow", markup=False, soft_wrap=True)
    profile = run.profile
    say(
        f"{file}: model '{profile.model}' of {profile.n_samples} samples; print against file {profile.without}, "
        f"against the profile, on parts it was not fitted to, {profile.held_out}"
    )
    say(f"next: toolkit train-patch --class {profile.patch} --data rig --print-profile {file}")
