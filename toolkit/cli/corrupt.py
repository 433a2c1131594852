"""`toolkit corrupt`: images as bad weather, bad cameras and bad transmission leave them."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.output import remark, say, show_json, warn
from toolkit.core.text import kept_before

SHOWN_FAILURES = 20


def corrupt(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Folder of images, in any layout, or one image.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to write to; for one image also a .png or .jpg.")],
    names: Annotated[
        list[str],
        typer.Option(
            "--corrupt",
            metavar="NAME[:SEVERITY]",
            help="Corruption, or noise, blur, weather, digital, extra, common (15), all; fog:3 or noise:1-3 for "
            "some severities; may be repeated.",
        ),
    ],
    severities: Annotated[
        list[int] | None,
        typer.Option(
            "--severity",
            metavar="N",
            min=1,
            max=5,
            help="Severity where --corrupt names none: 1 (slight) to 5 (severe); may be repeated. Default: all five.",
        ),
    ] = None,
    image_px: Annotated[
        int | None,
        typer.Option(metavar="N", help="First resize and crop to N×N pixels (published: 224). Default: as they are."),
    ] = None,
    image_format: Annotated[
        str, typer.Option("--format", metavar="png|jpg", help="jpg: of quality 85, as ImageNet-C was saved.")
    ] = "png",
    seed: options.Seed = 0,
    device: options.Device = "auto",
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Corrupt images as ImageNet-C and CIFAR-10-C do: 15 corruptions and 4 more, at 5 severities.

    One corruption at one severity mirrors IN in OUT; several lie in OUT/NAME/SEVERITY.
    """
    from toolkit.core.severities import SEVERITIES
    from toolkit.corruptions.catalogue import find_note, parse_corruptions
    from toolkit.corruptions.folder import corrupt_images
    from toolkit.models.network import choose_device

    chosen = parse_corruptions(names, severities or SEVERITIES)
    result = corrupt_images(
        source, out, chosen, seed=seed, size_px=image_px, image_format=image_format, device=choose_device(device)
    )
    if as_json:
        show_json({"out": str(out)} | result.as_json())
    else:
        note = find_note(list(dict.fromkeys(name for name, _ in chosen)))
        for line in (*result.describe_scale(), *([note] if note else [])):
            remark(line)
        for path, reason in result.failed[:SHOWN_FAILURES]:
            warn(f"failed: {path}: {reason}")
        if len(result.failed) > SHOWN_FAILURES:
            warn(f"failed: {len(result.failed) - SHOWN_FAILURES} more, --json lists them all")
        say(f"made {result.made} images{kept_before(result.kept)}: {out}")
    if result.failed:
        raise typer.Exit(1)
