"""`toolkit train-texture`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.boosters.texture_config import RECIPES, make_config
from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import show_json

if TYPE_CHECKING:
    from toolkit.boosters.texture import TrainedTexture


@from_config(overrides=RECIPES)
def train_texture(
    overrides: Overrides,
    recipe: str,
    class_name: Annotated[
        str | None,
        typer.Option(
            "--class", metavar="NAME", help="What it shall be recognised as. Default: the objects' own class."
        ),
    ] = None,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="File name, without suffix. Default: the object's, or for several the class's."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="For the texture. Default: rig/textures.")] = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=0, help="Threads that render ahead; 0: none. Default: one for each core."),
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin anew, forget an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a texture that makes a network see an object's class; an interrupted run goes on where it stopped."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.boosters.texture import train_texture as run
    from toolkit.core.workspace import open_workspace

    config = make_config(recipe, {**overrides, "seed": seed})
    place = open_workspace(workspace)
    networks = load_networks(model, weights, device, place.classifiers_dir)
    trained = run(config, networks, place, class_name=class_name, name=name, out=out, restart=restart, workers=workers)
    _report(trained, as_json)
    if trained.skipped:
        raise typer.Exit(1)


def _report(trained: "TrainedTexture", as_json: bool) -> None:
    from toolkit.core.console import console, list_skipped

    list_skipped(trained.skipped)
    record, files = trained.texture.record, trained.files
    glbs = [str(file) for file in trained.glbs.values()]
    if as_json:
        result = {
            "texture": str(files.png), "glb": glbs, "preview": str(files.preview),
            "was_finished": trained.was_finished, "resumed_from": trained.resumed_from,
            "skipped": [{"path": path, "reason": reason} for path, reason in trained.skipped],
            "record": record.model_dump(),
        }  # fmt: skip
        show_json(result)
        return

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    if trained.was_finished:
        tell(f"{files.png} was trained with these inputs before: nothing to do; --restart trains it again")
    else:
        tell(f"{files.png}: {record.n_px} × {record.n_px} px")
        for glb in glbs:
            tell(f"{glb}: the object in it, for Blender, Unreal, three.js")
        tell(f"{files.preview}: the object turning, with the network's first guess")
        for answer in trained.validations:
            held_out = [("held-out views", answer.clear), ("the same in fog", answer.fog)]
            held_out += [] if answer.weather is None else [("the same in its weather", answer.weather)]
            held_out += [] if answer.corrupted is None else [("the same corrupted", answer.corrupted)]
            for where, found in held_out:
                tell(f"{found.network} on {where}: {found.patched} with the texture, {found.bare} in its own paint")
    shown = " ".join(f"--object {one.name}" for one in record.objects)
    tell(f"next: toolkit capture-sim {shown} --variant unpatched --variant textured, toolkit eval captures/")
