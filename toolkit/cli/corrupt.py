"""`toolkit corrupt`: images as bad weather, bad cameras and bad transmission leave them."""

import json
from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options

SHOWN_FAILURES = 20


def corrupt(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Folder of images, in any layout, or one image.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to write to; for one image also a .png or .jpg.")],
    names: Annotated[
        list[str],
        typer.Option(
            "--name",
            help="Corruption, or noise, blur, weather, digital, extra, common (15), all (19); may be repeated.",
        ),
    ],
    severities: Annotated[
        list[int] | None,
        typer.Option("--severity", min=1, max=5, help="1 (slight) to 5 (severe); may be repeated. Default: all five."),
    ] = None,
    seed: options.Seed = 0,
    size: Annotated[
        int | None,
        typer.Option("--size", help="Resize and cut to SIZE×SIZE px first, as published (224). Default: as they are."),
    ] = None,
    image_format: Annotated[
        str, typer.Option("--format", help="png, or jpg of quality 85 as ImageNet-C was saved.")
    ] = "png",
    device: options.Device = "auto",
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Corrupt images as ImageNet-C and CIFAR-10-C do: 15 corruptions and 4 more, at 5 severities.

    One corruption at one severity mirrors IN in OUT; several lie in OUT/NAME/SEVERITY.
    """
    from toolkit.corruptions.folder import corrupt_file, corrupt_folder
    from toolkit.corruptions.request import choose_names, find_note
    from toolkit.models.network import choose_device

    levels = severities or [1, 2, 3, 4, 5]
    chosen = choose_names(names)
    device = choose_device(device)
    if source.is_file() and out.suffix.lower() in (".png", ".jpg", ".jpeg"):
        result = corrupt_file(source, out, chosen, levels, seed, size, device)
    else:
        result = corrupt_folder(source, out, chosen, levels, seed, size, image_format, device)
    if as_json:
        failed = [{"path": path, "reason": reason} for path, reason in result.failed]
        typer.echo(json.dumps({"out": str(out), "made": result.made, "kept": result.kept, "failed": failed}, indent=2))
    else:
        show_result(result, out, find_note(chosen))
    if result.failed:
        raise typer.Exit(1)


def show_result(result, out: Path, note: str | None) -> None:
    """Print a `CorruptResult`: what was made with which parameters, and what could not be."""
    from toolkit.core.console import console, errors

    for line in (*result.describe_scale(), *([note] if note else [])):
        errors.print(f"note: {line}", markup=False, soft_wrap=True)
    for path, reason in result.failed[:SHOWN_FAILURES]:
        errors.print(f"failed: {path}: {reason}", style="yellow", markup=False, soft_wrap=True)
    if len(result.failed) > SHOWN_FAILURES:
        more = len(result.failed) - SHOWN_FAILURES
        errors.print(f"failed: {more} more, --json lists them all", style="yellow", markup=False, soft_wrap=True)
    kept = f", {result.kept} kept from before" if result.kept else ""
    console.print(f"made {result.made} images{kept}: {out}", markup=False, soft_wrap=True)
