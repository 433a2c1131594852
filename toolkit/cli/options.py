"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Workspace = Annotated[
    Path | None, typer.Option("--workspace", help="Folder to work in; default: the nearest upwards with rig/.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.")]
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
Device = Annotated[str, typer.Option("--device", help="auto, cpu or cuda.")]
