"""`toolkit train-patch`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options

if TYPE_CHECKING:
    from toolkit.boosters.patch import TrainedPatch

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
    model: options.Models = None,
    weights: options.WeightFiles = None,
    size_px: Annotated[int, typer.Option(help="Side of the patch, pixels.")] = 100,
    recipe: Annotated[
        str, typer.Option(help="default, or paper: Algorithm 1 as published; the flags below change either.")
    ] = "default",
    steps: Annotated[int | None, typer.Option(help="Gradient steps. Default: 600.")] = None,
    epochs: Annotated[
        int | None, typer.Option(help="Instead of --steps: how often each image is seen. Recipe paper: 30.")
    ] = None,
    batch: Annotated[int | None, typer.Option(help="Images per step. Default: 16; paper: 512.")] = None,
    lr: Annotated[
        float | None,
        typer.Option(help="Change of every pixel in the first step, of the full range. Default: 0.05; paper: 0.1."),
    ] = None,
    schedule: Annotated[
        str | None, typer.Option(help="How it falls: constant, linear or cosine. Default: cosine; paper: constant.")
    ] = None,
    smoothing: Annotated[
        float | None, typer.Option(help="Gaussian smoothing of the first gradient, texels. Default: 2; paper: 0.")
    ] = None,
    start_contrast: Annotated[
        float | None, typer.Option(help="Of the random first patch, about grey. Default: 0.2; paper: 1, full.")
    ] = None,
    rotation: Annotated[Range | None, typer.Option(help="Degrees, lowest and highest. Default: -180 180.")] = None,
    share: Annotated[
        Range | None, typer.Option(help="Patch side as a share of the image's. Default: 0.20 0.42.")
    ] = None,
    foreshortening: Annotated[
        Range | None, typer.Option(help="Compression by an oblique view, 1 is none. Default: 0.35 1.")
    ] = None,
    pose: Annotated[
        bool | None,
        typer.Option(
            "--pose/--no-pose", help="Place half of the patches as a camera sees them on an object. Not paper."
        ),
    ] = None,
    length_mm: Annotated[
        float | None, typer.Option(help="Longest side of that object: how large the patch looks on it. Default: 270.")
    ] = None,
    light: Annotated[
        bool | None,
        typer.Option("--light/--no-light", help="Vary exposure, contrast and tint of the patch. Not paper."),
    ] = None,
    print_process: Annotated[
        bool | None,
        typer.Option("--print-process/--no-print-process", help="Inks and paper of a desktop printer. Not paper."),
    ] = None,
    print_profile: Annotated[
        Path | None,
        typer.Option(
            help="Instead: your own printer, as 'toolkit print-profile' measured it (print/profiles/NAME.json)."
        ),
    ] = None,
    glare: Annotated[
        bool | None, typer.Option("--glare/--no-glare", help="Shine and strips of the tape. Not paper.")
    ] = None,
    camera: Annotated[
        bool | None, typer.Option("--camera/--no-camera", help="Blur, sensor noise and JPEG. Not paper.")
    ] = None,
    corrupt: Annotated[
        list[str] | None,
        typer.Option(
            help="Spoil half of the photographs by a corruption of ImageNet-C: fog:3, noise:1-3, weather, common, all; "
            "of several each draws one. Not paper."
        ),
    ] = None,
    tv_weight: Annotated[float | None, typer.Option(help="Of the patch's total variation. Default: 0.")] = None,
    printability_weight: Annotated[
        float | None, typer.Option(help="Of its colours' distance to what inks can print. Default: 0.")
    ] = None,
    mounted_share: Annotated[
        float | None,
        typer.Option(
            help="Share of each batch with the sheet mounted on the rig's object. Default: 0.875 with --data rig; "
            "paper: 0."
        ),
    ] = None,
    mounted_views: Annotated[
        int | None, typer.Option(help="Such views, a fifth of them held out. Default: 240.")
    ] = None,
    mounted_fill: Annotated[
        Range | None,
        typer.Option(help="Share of the frame that the object fills in them: its distance. Default: 0.6 0.95."),
    ] = None,
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
    from toolkit.boosters.data import DataRequest
    from toolkit.boosters.patch import train_patch as run
    from toolkit.boosters.patch_recipes import Choices, make_request
    from toolkit.core.console import errors
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifiers

    choices = Choices(
        steps, epochs, batch, lr, schedule, smoothing, start_contrast, rotation, share, foreshortening, pose, light,
        print_process, glare, camera, mounted_share, mounted_views, mounted_fill, tv_weight, printability_weight,
        length_mm, print_profile, tuple(corrupt) if corrupt else None,
    )  # fmt: skip
    request = make_request(
        recipe, choices, class_name, DataRequest(tuple(data), backgrounds, images, seed), size_px, seed, name
    )
    place = open_workspace(workspace)

    def say(line: str) -> None:
        if not quiet:
            errors.print(line, markup=False, soft_wrap=True)

    networks = load_classifiers(model, weights, device, place.classifiers_dir)
    trained = run(request, networks, place, out, restart, quiet, say)
    _report(trained, as_json)
    if trained.skipped:
        raise typer.Exit(1)


def _report(trained: "TrainedPatch", as_json: bool) -> None:
    from toolkit.core.console import console, list_skipped
    from toolkit.imaging.printer import PrintScores

    list_skipped(trained.skipped)
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
        tell(PrintScores(record.final["total_variation"], record.final["non_printability"]).describe(record.name))
        where = "held-out images" if record.data["held_out"] else "its training images"
        for answer in trained.validations:
            tell(f"{answer.network} on {where}: {answer.patched} with the patch, {answer.bare} bare")
            share = record.final.get(f"{answer.network}_corrupted_patched_top1")
            if share is not None:
                bare = record.final[f"{answer.network}_corrupted_bare_top1"]
                tell(f"{answer.network} on them corrupted: {share:.0%} with the patch, {bare:.0%} bare")
        for answer in trained.on_object:
            where = f"{answer.network} on the object, held-out views"
            tell(f"{where}: {answer.patched} with it, {answer.bare} with grey paper")
    tell(f"next: toolkit print --class {record.name}, toolkit capture-sim")
