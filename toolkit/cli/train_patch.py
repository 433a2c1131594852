"""`toolkit train-patch`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.errors import ToolkitError

if TYPE_CHECKING:
    from toolkit.boosters.patch_run import TrainedPatch

Range = tuple[float, float]


def train_patch(
    class_name: Annotated[
        str, typer.Option("--class", help="What it shall be recognised as: a label, index or WordNet id.")
    ],
    data: Annotated[
        list[str],
        typer.Option(
            help="ImageFolder, any folder of images, or 'rig' (or rig:OBJECT) for renders; several may be given."
        ),
    ],
    backgrounds: Annotated[
        str,
        typer.Option(help="class: images of the class only; all: every image; auto: of the class where there are any."),
    ] = "auto",
    images: Annotated[int, typer.Option(help="Images kept in memory at most, a fifth of them held out.", min=2)] = 256,
    model: Annotated[
        list[str] | None, typer.Option(help="Torchvision classifier; several add their losses. Default: resnet18.")
    ] = None,
    weights: Annotated[
        list[Path] | None, typer.Option(help="State dict (.pth, .safetensors), one for each --model.")
    ] = None,
    size_px: Annotated[int, typer.Option(help="Side of the patch, pixels.")] = 100,
    steps: Annotated[int, typer.Option(help="Gradient steps.")] = 300,
    batch: Annotated[int, typer.Option(help="Images per step.")] = 16,
    lr: Annotated[float, typer.Option(help="Change of every pixel in the first step, of the range 0 to 1.")] = 0.1,
    schedule: Annotated[str, typer.Option(help="How it falls: constant, linear or cosine.")] = "cosine",
    smoothing: Annotated[
        float, typer.Option(help="Gaussian smoothing of the first step's gradient, texels; 0 is the plain algorithm.")
    ] = 2.0,
    start_contrast: Annotated[float, typer.Option(help="Of the random first patch, about grey; 1 is full.")] = 0.2,
    rotation: Annotated[Range, typer.Option(help="Degrees, lowest and highest.")] = (-180.0, 180.0),
    share: Annotated[Range, typer.Option(help="Patch side as a share of the image's, lowest and highest.")] = (
        0.20,
        0.42,
    ),
    foreshortening: Annotated[Range, typer.Option(help="Compression by an oblique view, 1 is none.")] = (0.35, 1.0),
    light: Annotated[bool, typer.Option(help="Vary exposure, contrast and tint of the patch.")] = True,
    mounted_share: Annotated[
        float | None,
        typer.Option(
            help="Share of each batch with the sheet mounted on the rig's object. Default: 0.75 with --data rig."
        ),
    ] = None,
    mounted_views: Annotated[int, typer.Option(help="Such views, a fifth of them held out.")] = 144,
    name: Annotated[
        str | None, typer.Option(help="File name of the patch, without suffix. Default: its class.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the patch; default: print/patches.")] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin anew, forget an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a patch that makes a classifier see a class; an interrupted run goes on where it stopped."""
    from toolkit.boosters.affine import AffineRanges
    from toolkit.boosters.data import DataRequest
    from toolkit.boosters.light import LightRanges
    from toolkit.boosters.patch_run import train_patch as run
    from toolkit.boosters.request import PatchRequest
    from toolkit.boosters.training import Descent
    from toolkit.console import errors
    from toolkit.workspace import open_workspace

    request = PatchRequest(
        class_name=class_name,
        data=DataRequest(tuple(data), backgrounds, images, seed),
        size_px=size_px,
        descent=Descent(steps, batch, lr, schedule, seed, smoothing, start_contrast),
        placement=AffineRanges(rotation, share, foreshortening),
        light=LightRanges() if light else None,
        name=name,
        mounted_share=_choose_share(mounted_share, data),
        mounted_views=mounted_views,
    )
    place = open_workspace(workspace)

    def say(line: str) -> None:
        if not quiet:
            errors.print(line, markup=False, soft_wrap=True)

    trained = run(request, _load_networks(model, weights, device, quiet), place, out, restart, quiet, say)
    _report(trained, as_json)
    if trained.skipped:
        raise typer.Exit(1)


def _choose_share(share: float | None, data: list[str]) -> float:
    from toolkit.boosters.rig_data import is_rig_source

    if share is not None:
        return share
    return 0.75 if any(is_rig_source(source) for source in data) else 0.0


def _load_networks(models: list[str] | None, weights: list[Path] | None, device: str, quiet: bool) -> list:
    from toolkit.classifiers.network import load_classifier

    archs = models or ["resnet18"]
    files: list[Path | None] = list(weights) if weights else [None] * len(archs)
    if len(files) != len(archs):
        raise ToolkitError(f"{len(archs)} --model and {len(files)} --weights: expected one --weights for each --model")
    return [load_classifier(arch, file, device, quiet) for arch, file in zip(archs, files, strict=True)]


def _report(trained: "TrainedPatch", as_json: bool) -> None:
    from toolkit.console import console, errors

    for path, reason in trained.skipped:
        errors.print(f"skipped {path}: {reason}", style="yellow", markup=False, soft_wrap=True)
    record = trained.patch.record
    if as_json:
        result = {
            "patch": str(trained.files.png),
            "preview": str(trained.files.preview),
            "was_finished": trained.was_finished,
            "resumed_from": trained.resumed_from,
            "skipped": [{"path": path, "reason": reason} for path, reason in trained.skipped],
            "record": record.model_dump(),
        }
        typer.echo(json.dumps(result, indent=2, ensure_ascii=False))
        return

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    if trained.was_finished:
        tell(f"{trained.files.png} was trained with these inputs before: nothing to do; --restart trains it again")
    else:
        tell(f"{trained.files.png}: {record.n_px} px, {record.size_mm:.0f} mm on paper at 250 %")
        tell(f"{trained.files.preview}: the patch on training images")
        where = "held-out images" if record.data["held_out"] else "its training images"
        for answer in trained.validations:
            tell(f"{answer.arch} on {where}: {answer.patched} with the patch, {answer.bare} bare")
        for answer in trained.on_object:
            tell(
                f"{answer.arch} on the object, held-out views: {answer.patched} with it, {answer.bare} with grey paper"
            )
    tell(f"next: toolkit print --class {record.name}, toolkit capture-sim")
