"""`toolkit capture-sim`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options


def capture_sim(
    objects: Annotated[
        list[str] | None, typer.Option("--object", help="Object to shoot; repeat for more. Default: all in the plan.")
    ] = None,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variant",
            help="unpatched, patched, textured; controls of the patch: wrong-patch, random-patch, grey-patch, "
            "patch-alone; of the texture: random-texture, grey-texture; repeat for more. "
            "Default: unpatched and patched.",
        ),
    ] = None,
    backdrop: Annotated[
        str | None, typer.Option(help="Table top: oak, walnut, white, concrete, linen, slate, birch. Default: by seed.")
    ] = None,
    light: Annotated[str, typer.Option(help="studio, side, warm or dim.")] = "studio",
    renderer: Annotated[str, typer.Option(help="raycast or filament.")] = "raycast",
    board: Annotated[
        bool | None,
        typer.Option(
            "--board/--no-board",
            help="Lay the printed board under the object. Default: with --like, where the photographs show it.",
        ),
    ] = None,
    image_format: Annotated[str, typer.Option("--format", help="jpg or png.")] = "jpg",
    source: Annotated[
        str | None,
        typer.Option(
            help="Folder below captures/. Default: sim, or sim-PATCHES, sim-board, sim-like-NAME with these options."
        ),
    ] = None,
    like: Annotated[
        Path | None,
        typer.Option(help="Shoot again what these photographs show, from where each was taken, such as captures/real."),
    ] = None,
    max_px: Annotated[
        int | None, typer.Option("--max-px", min=32, help="Longer side of the images with --like. Default: 1280.")
    ] = None,
    corrupt: options.Corrupt = None,
    patches: options.Patches = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Shoot every object at every pose of the plan, unpatched and patched, in the virtual rig.

    With --like, every photograph of a folder from its own measured camera instead. With --corrupt, besides the images,
    a corrupted copy of them, 224² px as networks see them, in captures/SOURCE-fog-3.
    """
    from toolkit.captures.corrupt import corrupt_source
    from toolkit.captures.like import shows_board
    from toolkit.captures.shoot import ShootSettings, shoot_plan
    from toolkit.core.errors import ToolkitError
    from toolkit.core.workspace import open_workspace
    from toolkit.corruptions.request import parse_corruptions
    from toolkit.rig.board import read_board
    from toolkit.rig.plan import open_plan
    from toolkit.rig.variants import PAIR

    corruptions = parse_corruptions(corrupt or ())
    space = open_workspace(workspace).with_patches(patches)
    if like is not None:
        folder = like if like.is_dir() else space.root / like
        with_board = shows_board(folder) if board is None else board
        laid = read_board(space) if with_board else None
        settings = ShootSettings(seed, backdrop, light, renderer, image_format, laid)
        _shoot_like(space, folder, settings, source, objects or (), variants or (), max_px, quiet, as_json, corruptions)
        return
    if max_px is not None:
        raise ToolkitError("--max-px goes with --like: the size of the plan's images is set by 'toolkit plan --size'")
    plan = open_plan(space, objects)
    settings = ShootSettings(seed, backdrop, light, renderer, image_format, read_board(space) if board else None)
    if source == "real":
        raise ToolkitError("--source real: captures/real is for photographs: name another folder, such as sim-2")
    source = source or "-".join(["sim", *([patches] if patches else []), *(["board"] if board else [])])
    result = shoot_plan(
        space, plan, objects or list(plan.objects), variants or PAIR, settings, source
    )  # fmt: skip
    corrupted = corrupt_source(result.source_dir, corruptions)
    _show(space, result, as_json, corrupted)
    if any(one.failed for one in corrupted):
        raise typer.Exit(1)


def _shoot_like(
    space, folder: Path, settings, source, objects, variants, max_px, quiet: bool, as_json: bool, corruptions
) -> None:
    from toolkit.captures.corrupt import corrupt_source
    from toolkit.captures.like import MAX_PX, shoot_like
    from toolkit.core.console import list_skipped

    found = shoot_like(space, folder, settings, source, objects, variants, max_px or MAX_PX)
    list_skipped(found.skipped)
    corrupted = corrupt_source(found.shoot.source_dir, corruptions)
    _show(space, found.shoot, as_json, corrupted, len(found.skipped))
    if found.skipped or any(one.failed for one in corrupted):
        raise typer.Exit(1)


def _show(space, result, as_json: bool, corrupted, skipped: int | None = None) -> None:
    """Print a `ShootResult` and its corrupted copies; `skipped` counts photographs that could not be shot again."""
    import json

    from toolkit.core.console import console, errors, list_skipped

    wanted = "this plan" if skipped is None else "these photographs"
    if result.stale:
        errors.print(
            f"note: {len(result.stale)} images are not of {wanted} and were left in {result.source_dir} "
            f"(first: {result.stale[0]}); 'toolkit eval' counts them: delete them if you do not want that",
            soft_wrap=True,
        )
    list_skipped([(f"{one.source_dir.name}/{path}", reason) for one in corrupted for path, reason in one.failed])
    if as_json:
        content = {"folder": str(result.source_dir), "shot": result.shot, "kept": result.kept}
        copies = [{"folder": str(one.source_dir), "made": one.made, "kept": one.kept} for one in corrupted]
        content |= {"corrupted": copies} if corrupted else {}
        typer.echo(json.dumps(content if skipped is None else content | {"skipped": skipped}))
        return
    kept = f", {result.kept} kept from before" if result.kept else ""
    left_out = f", {skipped} photograph{'s' if skipped > 1 else ''} left out" if skipped else ""
    console.print(f"shot {result.shot} images{kept}{left_out}: {result.source_dir}", soft_wrap=True)
    for one in corrupted:
        kept = f", {one.kept} kept from before" if one.kept else ""
        console.print(f"corrupted {one.made} of them{kept}: {one.source_dir}", soft_wrap=True)
    console.print(f"next: toolkit eval {space.captures_dir}", soft_wrap=True)
