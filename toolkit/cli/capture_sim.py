"""`toolkit capture-sim`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import kept_before, remark, say, show_json
from toolkit.core.errors import FieldError
from toolkit.engine.config import EngineConfig

if TYPE_CHECKING:
    from toolkit.captures.corrupt import CorruptedSource, Corruption
    from toolkit.captures.shoot import ShootResult


@from_config(engine=EngineConfig)
def capture_sim(
    *,
    engine: EngineConfig,
    objects: options.Objects = None,
    variants: options.Variants = None,
    backdrop: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Table top: oak, walnut, white, concrete, linen, slate, birch. Default: by seed."
        ),
    ] = None,
    light: Annotated[
        str | None,
        typer.Option(metavar="studio|side|warm|dim", help="Of the rig. Default: studio, with --rehearse side."),
    ] = None,
    renderer: Annotated[str, typer.Option(metavar="raycast|filament", help="What draws the images.")] = "raycast",
    board: Annotated[
        bool | None,
        typer.Option(
            "--board/--no-board",
            help="Lay the printed board under the object. Default: with --like, where the photographs show it.",
        ),
    ] = None,
    rehearse: Annotated[
        bool,
        typer.Option(
            "--rehearse",
            help="As print, tape, hand and phone will have it: inks, shine, poses missed a little, blur, noise, white "
            "balance off, JPEG 80.",
        ),
    ] = False,
    print_profile: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="With --rehearse: your printer, as 'toolkit print-profile' measured it. Default: one drawn.",
        ),
    ] = None,
    image_format: Annotated[str, typer.Option("--format", metavar="jpg|png", help="Of the images.")] = "jpg",
    source: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Folder below captures/. Default: sim, or sim-PATCHES, sim-board, sim-rehearsed, sim-like-NAME with "
            "these options.",
        ),
    ] = None,
    like: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Shoot again what these photographs show, from where each was taken, such as captures/real.",
        ),
    ] = None,
    max_px: Annotated[
        int | None, typer.Option(min=32, help="Longer side of the images with --like. Default: 1280.")
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
    a corrupted copy of them, 224² px as networks see them, in captures/SOURCE-fog-3. With --rehearse, what is to be
    expected of the printed patch before it is printed.
    """
    from toolkit.captures.like import MAX_PX, shoot_like, shows_board
    from toolkit.captures.rehearsal import make_rehearsal
    from toolkit.captures.shoot import ShootSettings, shoot_plan
    from toolkit.core.console import list_skipped
    from toolkit.core.workspace import open_workspace
    from toolkit.rig.board import read_board
    from toolkit.rig.misfits import list_misfits
    from toolkit.rig.plan import open_plan
    from toolkit.rig.requests import PAIR
    from toolkit.rig.variants import ON_PAPER

    corruptions: Sequence[Corruption] = ()
    if corrupt:  # else torch need not be loaded
        from toolkit.corruptions.request import parse_corruptions

        corruptions = parse_corruptions(corrupt)
    space = open_workspace(workspace).with_patches(patches)
    rehearsal = make_rehearsal(print_profile) if rehearse else None
    if print_profile is not None and not rehearse:
        raise FieldError("goes with {rehearse}", {"print_profile": print_profile})
    light = light or ("side" if rehearse else "studio")
    bare = ShootSettings(seed, backdrop, light, renderer, image_format, rehearsal=rehearsal)
    skipped: Sequence[tuple[str, str]] | None = None
    if like is not None:
        folder = like if like.is_dir() else space.root / like
        with_board = shows_board(folder) if board is None else board
        settings = replace(bare, board=read_board(space)) if with_board else bare
        found = shoot_like(space, folder, settings, source, objects or (), variants or (), max_px or MAX_PX, engine)
        shot, skipped = found.shoot, found.skipped
        list_skipped(skipped)
    else:
        if max_px is not None:
            raise FieldError(
                "goes with {like}: the size of the plan's images is set by 'toolkit plan --resolution'",
                {"max_px": max_px},
            )
        plan = open_plan(space, objects)
        if source == "real":
            raise FieldError("captures/real is for photographs: name another folder, such as sim-2", {"source": source})
        settings = replace(bare, board=read_board(space)) if board else bare
        if set(variants or PAIR) & set(ON_PAPER):
            for line in list_misfits(space, objects or list(plan.objects), plan):
                remark(line)
        words = ["sim", patches, "board" if board else None, "rehearsed" if rehearse else None]
        source = source or "-".join(filter(None, words))
        with engine.open() as hands:
            names = objects or list(plan.objects)
            shot = shoot_plan(space, plan, names, variants or PAIR, settings, source, engine=hands)
    list_skipped(shot.failed)
    corrupted: Sequence[CorruptedSource] = ()
    if corruptions:
        from toolkit.captures.corrupt import corrupt_source

        corrupted = corrupt_source(shot.source_dir, corruptions)
    _report(shot, corrupted, None if skipped is None else len(skipped), as_json)
    if skipped or shot.failed or any(one.failed for one in corrupted):
        raise typer.Exit(1)


def _report(result: "ShootResult", corrupted: "Sequence[CorruptedSource]", skipped: int | None, as_json: bool) -> None:
    """What was shot, and its corrupted copies; `skipped` counts photographs that could not be shot again."""
    from toolkit.core.console import list_skipped

    wanted = "this plan" if skipped is None else "these photographs"
    if result.stale:
        remark(
            f"{len(result.stale)} images are not of {wanted} and were left in {result.source_dir} "
            f"(first: {result.stale[0]}); 'toolkit eval' counts them: delete them if you do not want that"
        )
    list_skipped((f"{one.source_dir.name}/{path}", reason) for one in corrupted for path, reason in one.failed)
    if as_json:
        content: dict[str, Any] = {"folder": str(result.source_dir), "shot": result.shot, "kept": result.kept}
        copies = [{"folder": str(one.source_dir), "made": one.made, "kept": one.kept} for one in corrupted]
        content |= {"corrupted": copies} if corrupted else {}
        show_json(content if skipped is None else content | {"skipped": skipped})
        return
    left_out = f", {skipped} photograph{'s' if skipped > 1 else ''} left out" if skipped else ""
    say(f"shot {result.shot} images{kept_before(result.kept)}{left_out}: {result.source_dir}")
    for one in corrupted:
        say(f"corrupted {one.made} of them{kept_before(one.kept)}: {one.source_dir}")
    say(f"next: toolkit eval {result.source_dir.parent}")
