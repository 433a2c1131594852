"""`toolkit plan`."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, show_table, warn
from toolkit.rig.pattern import Pattern

if TYPE_CHECKING:
    from toolkit.core.workspace import Workspace
    from toolkit.objects.load import TableObject
    from toolkit.printing.shot_list.job import WrittenShotList
    from toolkit.rig.plan import CapturePlan

LIST = "The shot list"
POSES = (*Pattern.model_fields, "resolution", "fov", "preview")
"""Options that are about the poses; `--shot-list` without any of them keeps those that are planned."""


@from_config(pattern=Pattern)
def plan(
    *,
    context: typer.Context,
    objects: options.Objects = None,
    pattern: Pattern,
    resolution: Annotated[
        tuple[int, int], typer.Option(metavar="WIDTH HEIGHT", help="Of the camera's images, pixels.")
    ] = (640, 480),
    fov: Annotated[
        float, typer.Option(metavar="DEGREES", help="The camera's horizontal field of view.", min=5, max=120)
    ] = 40.0,
    preview: Annotated[bool, typer.Option("--preview", help="Also draw the positions and what each sees.")] = False,
    patches: options.Patches = None,
    shot_list: Annotated[
        bool,
        typer.Option(
            "--shot-list",
            rich_help_panel=LIST,
            help="Also make print/shot_list.pdf, to photograph by, and rig/shots.json.",
        ),
    ] = False,
    paper: Annotated[str, typer.Option(metavar="SIZE", rich_help_panel=LIST, help="a4, letter, or larger.")] = "a4",
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variant",
            metavar="NAME",
            rich_help_panel=LIST,
            help="As in capture-sim; repeat for more. Default: unpatched and patched.",
        ),
    ] = None,
    order: Annotated[
        str,
        typer.Option(
            metavar="aba|blocks|alternate",
            rich_help_panel=LIST,
            help="aba: half of the unpatched shots before the patched ones, half after; blocks: one variant after the "
            "other; alternate: all variants at each place.",
        ),
    ] = "aba",
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
    from toolkit.printing.page import parse_paper
    from toolkit.rig.camera import Camera
    from toolkit.rig.misfits import list_misfits
    from toolkit.rig.plan import keep_others, make_plan, open_plan, read_plan, write_plan

    space = open_workspace(workspace).with_patches(patches)
    sources = [context.get_parameter_source(name) for name in POSES]
    is_about_poses = any(source is not None and source.name != "DEFAULT" for source in sources)
    if shot_list and space.plan_file.is_file() and not is_about_poses:
        made = open_plan(space, list(objects or []))
        names = list(dict.fromkeys(objects or made.objects))
    else:
        names = objects or sorted(space.object_specs())
        items = [load_object(space.object_spec(name)) for name in names]
        new = make_plan(items, Camera.from_fov(*resolution, fov), pattern.with_overrides(seed=seed), space)
        old = read_plan(space.plan_file) if objects and space.plan_file.is_file() else None
        made = keep_others(old, new)
        file = write_plan(space.plan_file, made)
        drawn = _draw(space, items, new, seed) if preview else None
        if as_json and not shot_list:
            show_json(new.model_dump(mode="json"))
        elif not as_json:
            if not quiet:
                _show_poses(new)
            if drawn:
                say(f"drew the positions and contact sheets into {drawn}")
            say(what_pairs_can_show(pattern.count))
            say(f"wrote {file}{'' if shot_list else '; next: toolkit capture-sim'}")
    for line in list_misfits(space, names, made):
        warn(f"note: {line}")
    if shot_list:
        from toolkit.printing.shot_list.job import write_shot_list
        from toolkit.rig.shot_order import parse_order
        from toolkit.rig.variants import PAIR

        sheet = parse_paper(paper)
        _report_list(write_shot_list(space, made, names, sheet, variants or PAIR, seed, parse_order(order)), as_json)


def _report_list(made: "WrittenShotList", as_json: bool) -> None:
    for name, reason in made.without_patch.items():
        warn(f"{name}: unpatched only: {reason}")
    if as_json:
        show_json(asdict(made))
        return
    if made.replaced:
        say("note: rig/shots.json held other shots, or another order, before")
    for note in made.notes:
        warn(f"note: {note}")
    say(f"{made.shots} shots of {', '.join(made.objects)}; the camera moves {made.travel_m:.1f} m in all")
    wrote = f"wrote {made.pdf_file} ({made.pages} pages) and {made.shots_file}"
    say(f"{wrote}; next: print it, shoot in its order, then toolkit import PHOTOS/")


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


def _show_poses(made: "CapturePlan") -> None:
    rows = []
    for name, poses in made.objects.items():
        elevations, azimuths = ({pose.elevation_deg for pose in poses}, {pose.azimuth_deg for pose in poses})
        near, far = (pick(pose.distance_mm for pose in poses) for pick in (min, max))
        rows.append((name, len(poses), _listed(elevations), _listed(azimuths), f"{near:.0f}-{far:.0f}"))
    show_table(("object", "poses", "elevations", "azimuths", "distance, mm"), rows)


def _listed(some: set[float]) -> str:
    degrees = sorted(some)
    if len(degrees) > 8:
        return f"{degrees[0]:.0f}-{degrees[-1]:.0f}° ({len(degrees)})"
    return " ".join(f"{value:.0f}°" for value in degrees)


def _draw(space: "Workspace", items: Sequence["TableObject"], made: "CapturePlan", seed: int) -> Path:
    """Write both pictures of every object; returns their folder."""
    from toolkit.captures.shoot import ShootSettings, studio_for
    from toolkit.core.console import progress
    from toolkit.core.files import write_bytes
    from toolkit.rig.preview import draw_contact_sheet, draw_positions

    camera, folder = made.camera, space.root / "rig" / "preview"
    with progress("drawing previews", len(items)) as bar:
        for item in items:
            poses = made.objects[item.name]
            write_bytes(folder / f"{item.name}-positions.png", draw_positions(item, camera, poses))
            studio = studio_for(item, ShootSettings(seed=seed))
            write_bytes(folder / f"{item.name}-sheet.png", draw_contact_sheet(item, camera, poses, studio))
            bar.advance(note=item.name)
    return folder
