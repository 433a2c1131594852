"""`toolkit plan`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options

if TYPE_CHECKING:
    from toolkit.core.workspace import Workspace

ShotList = Annotated[
    bool, typer.Option("--shot-list", help="Also make print/shot_list.pdf, to photograph by, and rig/shots.json.")
]
ListPaper = Annotated[str, typer.Option("--paper", help="Of the shot list: a4, letter, or larger.")]
ListVariants = Annotated[
    list[str] | None,
    typer.Option("--variant", help="On the shot list; repeat for more. Default: unpatched and patched."),
]
ListOrder = Annotated[
    str,
    typer.Option(
        "--order",
        help="Of the shot list: aba (half of the unpatched shots before the patched ones, half after), blocks "
        "(one variant after the other) or alternate (all variants at each place).",
    ),
]


def make_list(
    space: "Workspace", objects: Sequence[str] | None, paper: str, variants: Sequence[str] | None, order: str,
    seed: int, quiet: bool, as_json: bool,
) -> None:  # fmt: skip
    """Write both files of the shot list and say what was made; without objects, those of the plan."""
    from toolkit.core.console import console, errors
    from toolkit.printing.page import parse_paper
    from toolkit.printing.shot_list.job import write_shot_list
    from toolkit.rig.plan import open_plan
    from toolkit.rig.shot_order import parse_order
    from toolkit.rig.variants import PAIR

    sheet, chosen = parse_paper(paper), parse_order(order)
    made = open_plan(space, list(objects or []))
    names = list(dict.fromkeys(objects or made.objects))
    result = write_shot_list(space, made, names, sheet, variants or PAIR, seed, chosen)
    for name, reason in result.without_patch.items():
        errors.print(f"{name}: unpatched only: {reason}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(json.dumps(asdict(result), indent=2, ensure_ascii=False))
        return
    if result.replaced:
        console.print("note: rig/shots.json held other shots, or another order, before", soft_wrap=True)
    console.print(
        f"{result.shots} shots of {', '.join(result.objects)}; the camera moves {result.travel_m:.1f} m in all",
        markup=False,
        soft_wrap=True,
    )
    console.print(
        f"wrote {result.pdf_file} ({result.pages} pages) and {result.shots_file}; next: print it, shoot in its order, "
        "then toolkit import PHOTOS/",
        markup=False,
        soft_wrap=True,
    )


PLANNING = ("pattern", "count", "elevation", "distance", "fill", "jitter", "size", "fov", "preview")
"""Options that are about the poses; `--shot-list` without any of them keeps those that are planned."""


def plan(
    context: typer.Context,
    objects: Annotated[
        list[str] | None, typer.Option("--object", help="Object to plan for; repeat for more. Default: all known.")
    ] = None,
    pattern: Annotated[str, typer.Option(help="grid, ring, hemisphere or fibonacci.")] = "grid",
    count: Annotated[int, typer.Option(help="Poses per object.")] = 18,
    elevation: Annotated[tuple[float, float], typer.Option(help="Lowest and highest elevation in degrees.")] = (
        25.0,
        65.0,
    ),
    distance: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Nearest and farthest distance in mm, spread over the poses; default: as --fill says."),
    ] = None,
    fill: Annotated[float, typer.Option(help="Share of the frame's shorter side that the object reaches.")] = 0.8,
    jitter: Annotated[float, typer.Option(help="Random change of azimuth and elevation, degrees.", min=0)] = 0.0,
    size: Annotated[tuple[int, int], typer.Option(help="Width and height in pixels.")] = (640, 480),
    fov: Annotated[float, typer.Option(help="Horizontal field of view in degrees.", min=5, max=120)] = 40.0,
    preview: Annotated[bool, typer.Option("--preview", help="Also draw the positions and what each sees.")] = False,
    shot_list: ShotList = False,
    paper: ListPaper = "a4",
    variants: ListVariants = None,
    order: ListOrder = "aba",
    patches: options.Patches = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Plan the camera poses per object and write rig/plan.json.

    With --shot-list, and without an option about the poses, those that are planned stay as they are.
    """
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.load import load_object
    from toolkit.rig.camera import Camera
    from toolkit.rig.plan import Pattern, keep_others, make_plan, read_plan, write_plan

    space = open_workspace(workspace).with_patches(patches)
    if shot_list and space.plan_file.is_file() and not _is_about_poses(context):
        make_list(space, objects, paper, variants, order, seed, quiet, as_json)
        return
    names = objects or sorted(space.object_specs())
    items = [load_object(space.object_spec(name)) for name in names]
    spread = Pattern(pattern, count, elevation, fill, distance, jitter, seed)
    made = make_plan(items, Camera.from_fov(*size, fov), spread)
    old = read_plan(space.plan_file) if objects and space.plan_file.is_file() else None
    file = write_plan(space.plan_file, keep_others(old, made))
    drawn = _draw(space, items, made, seed, quiet or as_json) if preview else None
    if not as_json:
        _say(made, file, drawn, count, quiet, "" if shot_list else "; next: toolkit capture-sim")
    elif not shot_list:
        typer.echo(made.model_dump_json(indent=2))
    if shot_list:
        make_list(space, names, paper, variants, order, seed, quiet, as_json)


def _say(made, file: Path, drawn: Path | None, count: int, quiet: bool, onward: str) -> None:
    from toolkit.core.console import console

    if not quiet:
        _print_table(made)
    if drawn:
        console.print(f"drew the positions and contact sheets into {drawn}", soft_wrap=True)
    console.print(what_pairs_can_show(count), soft_wrap=True)
    console.print(f"wrote {file}{onward}", soft_wrap=True)


def _is_about_poses(context: typer.Context) -> bool:
    sources = (context.get_parameter_source(name) for name in PLANNING)
    return any(source is not None and source.name != "DEFAULT" for source in sources)


def what_pairs_can_show(count: int) -> str:
    """What `count` pairs can prove, worked out with the same statistics as the report."""
    from toolkit.core.statistics import mcnemar_p, wilson_interval

    low, high = wilson_interval(count // 2, count)
    enough = next((flips for flips in range(1, count + 1) if mcnemar_p(flips, 0) < 0.05), None)
    flips = f"{enough} flips one way and none back reach p < 0.05" if enough else "no number of flips reaches p < 0.05"
    return (
        f"{count} pairs: a top-1 of {count // 2}/{count} is known to {low:.0%}-{high:.0%} (95 % Wilson interval); "
        f"{flips} in an exact McNemar test"
    )


def _print_table(made) -> None:
    from rich.table import Table

    from toolkit.core.console import console

    table = Table("object", "poses", "elevations", "azimuths", "distance, mm")
    for name, poses in made.objects.items():
        elevations = sorted({pose.elevation_deg for pose in poses})
        azimuths = sorted({pose.azimuth_deg for pose in poses})
        near, far = (f(pose.distance_mm for pose in poses) for f in (min, max))
        table.add_row(name, str(len(poses)), _listed(elevations), _listed(azimuths), f"{near:.0f}-{far:.0f}")
    console.print(table)


def _listed(degrees: list[float]) -> str:
    if len(degrees) > 8:
        return f"{degrees[0]:.0f}-{degrees[-1]:.0f}° ({len(degrees)})"
    return " ".join(f"{value:.0f}°" for value in degrees)


def _draw(space, items, made, seed: int, quiet: bool) -> Path:
    """Write both pictures of every object; returns their folder."""
    from toolkit.captures.shoot import ShootSettings, studio_for
    from toolkit.core.console import progress
    from toolkit.core.files import write_bytes
    from toolkit.rig.preview import draw_contact_sheet, draw_positions

    camera, folder = made.camera, space.root / "rig" / "preview"
    with progress("drawing previews", len(items), quiet) as bar:
        for item in items:
            poses = made.objects[item.name]
            write_bytes(folder / f"{item.name}-positions.png", draw_positions(item, camera, poses))
            studio = studio_for(item, ShootSettings(seed=seed))
            write_bytes(folder / f"{item.name}-sheet.png", draw_contact_sheet(item, camera, poses, studio))
            bar.advance(note=item.name)
    return folder
