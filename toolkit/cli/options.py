"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Workspace = Annotated[
    Path | None, typer.Option("--workspace", help="Folder to work in; default: the nearest upwards with rig/.")
]


def _be_quiet(context: typer.Context, quiet: bool) -> bool:
    """Until the command has ended: progress and notices ask for it themselves, nobody passes it on."""
    if quiet:
        from toolkit.core.console import quietly

        context.with_resource(quietly())
    return quiet


Quiet = Annotated[bool, typer.Option("--quiet", "-q", callback=_be_quiet, help="No progress bar.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Seed = Annotated[int, typer.Option("--seed", help="Same seed, same bytes on the same machine.", min=0)]
Patches = Annotated[
    str | None, typer.Option("--patches", help="Folder of patches below print/patches; default: that one itself.")
]
Models = Annotated[
    list[str] | None,
    typer.Option(
        "--model",
        help="Torchvision classifier, timm:NAME, rig18, or your own; several add their losses. Default: resnet18.",
    ),
]
WeightFiles = Annotated[
    list[Path] | None, typer.Option("--weights", help="State dict (.pth, .safetensors), one for each --model.")
]
WeightsFile = Annotated[Path | None, typer.Option("--weights", help="State dict (.pth, .safetensors) of --model.")]
Rotation = Annotated[float, typer.Option(help="Largest turn of a patch, degrees. The paper's release: 45.")]
Scale = Annotated[tuple[float, float], typer.Option(help="Smallest and largest, of its own pixels. Release: 0.9 1.1.")]
Translate = Annotated[
    float, typer.Option(help="Largest move from the middle, of the image's side; it may be cut off. Release: 0.3.")
]
Download = Annotated[bool, typer.Option("--download", help="Fetch CIFAR-10 into the folder of cifar10:FOLDER.")]
Corrupt = Annotated[
    list[str] | None,
    typer.Option(
        "--corrupt",
        help="Under this corruption of ImageNet-C: fog:3, noise:1-3, weather, common (15), all (19); without a "
        "severity under all five; may be repeated.",
    ),
]
Device = Annotated[str, typer.Option("--device", help="auto, cpu or cuda.")]
