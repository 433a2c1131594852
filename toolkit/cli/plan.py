"""`toolkit plan`."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_table, warn
from toolkit.rig.requests import SHOT_LIST, Pattern, ShotListConfig

if TYPE_CHECKING:
    from toolkit.printing.shot_list.job import WrittenShotList
    from toolkit.rig.plan import CapturePlan, Pose

POSES = (*(name for name in Pattern.model_fields if name != "seed"), "resolution", "fov", "preview")
"""Options that are about the poses; `--shot-list` without any of them keeps those that are planned, whatever seed
orders the shots."""


@from_config(pattern=Pattern, listing=ShotListConfig)
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
            rich_help_panel=SHOT_LIST,
            help="Also make print/shot_list.pdf, to photograph by, and rig/shots.json.",
        ),
    ] = False,
    listing: ShotListConfig,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Plan the camera poses per object and write rig/plan.json.

    With --shot-list, and without an option about the poses, those that are planned stay as they are.
    """
    from toolkit.captures.render import preview_plan
    from toolkit.core.workspace import open_workspace
    from toolkit.printing.shot_list.job import write_shot_list
    from toolkit.rig.plan import list_misfits, make_camera, open_plan, plan_objects

    space = open_workspace(workspace, is_needed=True).with_patches(patches)
    sources = [context.get_parameter_source(name) for name in POSES]
    is_about_poses = any(source is not None and source.name != "DEFAULT" for source in sources)
    if shot_list and space.plan_file.is_file() and not is_about_poses:
        made = open_plan(space, objects)
        names = list(dict.fromkeys(objects or made.objects))
    else:
        names = objects or sorted(space.object_specs())
        camera = make_camera(*resolution, fov)
        made = plan_objects(space, objects or (), pattern.with_overrides(seed=seed), camera)
        planned = made.model_copy(update={"objects": {name: made.objects[name] for name in names}})
        drawn = preview_plan(space, planned, seed) if preview else None
        if as_json and not shot_list:
            show_json(planned.model_dump(mode="json"))
        elif not as_json:
            _report_plan(planned, drawn, quiet)
            say(f"wrote {space.plan_file}{'' if shot_list else '; next: toolkit capture-sim'}")
    for line in list_misfits(space, names, made):
        remark(line)
    if shot_list:
        _report_list(write_shot_list(space, made, names, listing, seed), as_json)


def _report_plan(planned: "CapturePlan", drawn: Path | None, quiet: bool) -> None:
    if not quiet:
        rows = [_as_row(name, poses) for name, poses in planned.objects.items()]
        show_table(("object", "poses", "elevations", "azimuths", "distance, mm"), rows)
    if drawn:
        say(f"drew the positions and contact sheets into {drawn}")
    say(what_pairs_can_show(max(map(len, planned.objects.values()))))


def _report_list(made: "WrittenShotList", as_json: bool) -> None:
    for name, reason in made.without_patch.items():
        warn(f"{name}: unpatched only: {reason}")
    if as_json:
        show_json(asdict(made))
        return
    if made.replaced:
        say("note: rig/shots.json was replaced; it held other shots or another order")
    for note in made.notes:
        remark(note)
    say(f"{made.shots} shots of {', '.join(made.objects)}; the camera moves {made.travel_m:.1f} m in all")
    wrote = f"wrote {made.pdf_file} ({made.pages} pages) and {made.shots_file}"
    say(f"{wrote}; next: print it, shoot in its order, then toolkit import PHOTOS/")


def what_pairs_can_show(count: int) -> str:
    """What `count` pairs can prove, worked out with the same statistics as the report."""
    from toolkit.core.statistics import mcnemar_p, wilson_interval

    low, high = wilson_interval(count // 2, count)
    enough = next((flips for flips in range(1, count + 1) if mcnemar_p(flips, 0) < 0.05), None)
    flips = "no number of changes can reach p < 0.05"
    if enough is not None:
        flips = f"{enough} changes for the better and none for the worse reach p < 0.05"
    return (
        f"with {count} pairs, {count // 2} right means {low * 100:.0f}–{high * 100:.0f} % (95 % Wilson interval); "
        f"{flips} in an exact McNemar test"
    )


def _as_row(name: str, poses: "Sequence[Pose]") -> tuple[str, int, str, str, str]:
    elevations, azimuths = ({pose.elevation_deg for pose in poses}, {pose.azimuth_deg for pose in poses})
    near, far = (pick(pose.distance_mm for pose in poses) for pick in (min, max))
    return name, len(poses), _listed(elevations), _listed(azimuths), f"{near:.0f}-{far:.0f}"


def _listed(some: set[float]) -> str:
    degrees = sorted(some)
    if len(degrees) > 8:
        return f"{degrees[0]:.0f}-{degrees[-1]:.0f}° ({len(degrees)})"
    return " ".join(f"{value:.0f}°" for value in degrees)
