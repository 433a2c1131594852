"""`toolkit refine-network`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import show_result
from toolkit.training.refine_config import RefineConfig


@from_config(config=RefineConfig)
def refine_network(
    config: RefineConfig,
    model: options.Model = None,
    weights: options.WeightsFile = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for the networks. Default: rig/classifiers.")
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin again; discard an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Refine a network by its own answers, so that what is trained on it carries over; goes on where it stopped."""
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifier
    from toolkit.training.refine import refine_network as run

    space = open_workspace(workspace)
    teacher = load_classifier(model, weights, device, space.classifiers_dir)
    made = run(config.with_overrides(seed=seed), space, teacher, out=out, restart=restart)
    show_result(made, as_json)
