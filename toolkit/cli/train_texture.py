"""`toolkit train-texture`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options

if TYPE_CHECKING:
    from toolkit.boosters.texture import TrainedTexture

Range = tuple[float, float]


def train_texture(
    objects: Annotated[
        list[str], typer.Option("--object", help="Object to wear it; several of one class share a universal texture.")
    ],
    class_name: Annotated[
        str | None, typer.Option("--class", help="What it shall be recognised as. Default: the objects' own class.")
    ] = None,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    size_px: Annotated[int, typer.Option(help="Side of the texture, pixels: 8 to 1024.")] = 200,
    keep: Annotated[
        list[str] | None, typer.Option(help="Material that keeps its paint, such as glass; repeat for more.")
    ] = None,
    keep_image: Annotated[
        Path | None, typer.Option(help="Picture in the object's texture coordinates: white keeps its paint.")
    ] = None,
    unwrap: Annotated[
        bool | None,
        typer.Option("--unwrap/--own-uv", help="Make new texture coordinates, or use the mesh's. Default: as needed."),
    ] = None,
    recipe: Annotated[
        str, typer.Option(help="default, or paper: Algorithm 2 as published; the flags below change either.")
    ] = "default",
    gradient: Annotated[
        str | None,
        typer.Option(help="shaded: light in the gradient; linear: the paper's approximation. Default: shaded."),
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Gradient steps. Default: 300.")] = None,
    batch: Annotated[int | None, typer.Option(help="Views per step. Default: 16.")] = None,
    reuse: Annotated[int | None, typer.Option(help="How often a rendered view is used. Default: 3; paper: 1.")] = None,
    optimiser: Annotated[str | None, typer.Option(help="sign, sgd or adam. Default: sign.")] = None,
    lr: Annotated[
        float | None,
        typer.Option(help="Change of every texel in the first step, of the full range. Default: 0.05; paper: 0.1."),
    ] = None,
    schedule: Annotated[
        str | None, typer.Option(help="How it falls: constant, linear or cosine. Default: cosine; paper: constant.")
    ] = None,
    smoothing: Annotated[
        float | None, typer.Option(help="Gaussian smoothing of the first gradient, texels. Default: 1; paper: 0.")
    ] = None,
    start_contrast: Annotated[
        float | None, typer.Option(help="Of the random first texture, about grey. Default: 0.2; paper: 1, full.")
    ] = None,
    elevation: Annotated[
        Range | None, typer.Option(help="Degrees above the table. Default: 20 70; paper: the whole sphere.")
    ] = None,
    roll: Annotated[Range | None, typer.Option(help="Of the camera, degrees. Default: -8 8; paper: -180 180.")] = None,
    fill: Annotated[
        Range | None,
        typer.Option(help="Share of the frame that the object fills. Default: 0.6 0.95; paper: 0.35 0.95."),
    ] = None,
    backgrounds: Annotated[
        Path | None, typer.Option(help="Folder of photographs to stand behind the object; the paper recipe needs one.")
    ] = None,
    background_share: Annotated[
        float | None, typer.Option(help="Of the views that they stand behind. Default: 0.5 with photographs; paper: 1.")
    ] = None,
    exposure: Annotated[
        bool | None, typer.Option("--exposure/--no-exposure", help="Vary strength and tint of the light. Not paper.")
    ] = None,
    fog: Annotated[bool | None, typer.Option("--fog/--no-fog", help="Fog over some of the views. Not paper.")] = None,
    camera: Annotated[
        bool | None, typer.Option("--camera/--no-camera", help="Blur, sensor noise and JPEG. Not paper.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="File name, without suffix. Default: the object's, or for several the class's.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the texture; default: rig/textures.")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes that render; 0: none. Default: one for each core but one.", min=0)
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin anew, forget an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a texture that makes a classifier see an object's class; an interrupted run goes on where it stopped."""
    from toolkit.boosters.texture import train_texture as run
    from toolkit.boosters.texture_recipes import Choices, make_request
    from toolkit.core.console import errors
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifiers

    choices = Choices(
        steps, batch, lr, schedule, smoothing, start_contrast, optimiser, gradient, reuse, elevation, roll, fill,
        background_share, exposure, fog, camera,
    )  # fmt: skip
    place = open_workspace(workspace)
    wanted = dict(
        class_name=class_name, size_px=size_px, keep=tuple(keep or ()), keep_image=keep_image, unwrap=unwrap, name=name
    )
    make_request(recipe, choices, tuple(objects), seed, 224, backgrounds, **wanted)  # refuses before weights are read
    networks = load_classifiers(model, weights, device, place.classifiers_dir)
    image_px = networks[0].preprocessing.crop_px
    request = make_request(recipe, choices, tuple(objects), seed, image_px, backgrounds, **wanted)

    def say(line: str) -> None:
        if not quiet:
            errors.print(line, markup=False, soft_wrap=True)

    trained = run(request, networks, place, out, restart, quiet, say, workers)
    _report(trained, as_json)
    if trained.skipped:
        raise typer.Exit(1)


def _report(trained: "TrainedTexture", as_json: bool) -> None:
    from toolkit.core.console import console, list_skipped

    list_skipped(trained.skipped)
    record, files = trained.texture.record, trained.files
    glbs = [str(files.glb(one.name)) for one in record.objects]
    if as_json:
        result = {
            "texture": str(files.png), "glb": glbs, "preview": str(files.preview),
            "was_finished": trained.was_finished, "resumed_from": trained.resumed_from,
            "skipped": [{"path": path, "reason": reason} for path, reason in trained.skipped],
            "record": record.model_dump(),
        }  # fmt: skip
        typer.echo(json.dumps(result, indent=2, ensure_ascii=False))
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
            for where, found in (("held-out views", answer.clear), ("the same in fog", answer.fog)):
                tell(f"{found.network} on {where}: {found.patched} with the texture, {found.bare} in its own paint")
    shown = " ".join(f"--object {one.name}" for one in record.objects)
    tell(f"next: toolkit capture-sim {shown} --variant unpatched --variant textured, toolkit eval captures/")
