"""Commands that make classifiers of encoders: a head for a folder of images, classes from prompts."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import show_result
from toolkit.cli.trainings import describe_classifier
from toolkit.core.child import count_cores
from toolkit.core.workspace import open_workspace
from toolkit.training.head_config import HeadConfig

Out = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Folder for the classifier. Default: rig/classifiers.")
]


@from_config(config=HeadConfig)
def head(
    encoder: Annotated[
        str,
        typer.Argument(
            metavar="ENCODER", help="timm:NAME, a torchvision classifier, onnx:FILE, a .pt2, python:MODULE:FUNCTION."
        ),
    ],
    config: HeadConfig,
    weights: Annotated[
        Path | None,
        typer.Option("--weights", metavar="FILE", help="State dict (.pth, .ckpt, .safetensors) of the encoder."),
    ] = None,
    download: options.Download = False,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", help="Processes that render. Default: one per core.", min=1, show_default=False),
    ] = None,
    out: Out = None,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Make a classifier of an encoder and a folder of images. Interrupted runs resume."""
    from toolkit.models.encoders import load_encoder
    from toolkit.models.heads import AsEncoder
    from toolkit.training.head import train_head

    space = open_workspace(workspace)
    loaded = load_encoder(encoder, weights, device, space.classifiers_dir, how=AsEncoder(config.tokens))
    made = train_head(
        config.with_overrides(seed=seed), space, loaded, out=out, workers=workers or count_cores(), download=download,
        restart=restart,
    )  # fmt: skip
    show_result(made, as_json, describe_classifier(made, out))
