"""Commands of the rig: where patch and camera go, the photographs that it takes, and the objects in them."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.captures.simulate import SimulateConfig, simulate_captures
from toolkit.cli import options
from toolkit.cli.app import Quiet
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_result, show_table, warn
from toolkit.core.rooms import ask_room
from toolkit.core.text import count_of, list_some
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.engine import EngineConfig
from toolkit.objects.spec import read_spec
from toolkit.rig import SHOT_LIST, Pattern, PlaceConfig, ShotListConfig

if TYPE_CHECKING:
    from toolkit.rig.plan import Pose

MOST_NAMED, MOST_LINES = 6, 4
"""Objects that a line names, and lines on poses."""


@from_config(config=PlaceConfig)
def place(
    *,
    object_name: Annotated[str, typer.Option("--object", metavar="NAME", help="Object to look for places on.")],
    config: PlaceConfig,
    train: Annotated[
        int, typer.Option("--train", metavar="STEPS", min=0, help="Also train a patch in each of the best places.")
    ] = 0,
    networks: options.NamedNetworks,
    write: Annotated[bool, typer.Option("--write", help="Put the best place into rig/objects/NAME.toml.")] = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Score places and sizes for a patch by how well cameras see it, and draw the best.

    A single sheet is scored by the plan's cameras, several sheets (--sheets) by random cameras.
    """
    from toolkit.captures.suggest_places import TITLES, suggest_places
    from toolkit.models.load import load_classifiers

    space = open_workspace(workspace)
    # networks load only if places are tried by training
    loaded = load_classifiers(*networks, space.classifiers_dir) if train else []
    found = suggest_places(space, object_name, config, networks=loaded, steps=train, write=write, seed=seed)
    if as_json:
        show_json(found.as_json())
        return
    show_table(TITLES, found.rows())
    for line in found.lines():
        say(line)
    for line in found.warnings():
        warn(line)


POSES = (*(name for name in Pattern.model_fields if name != "seed"), "resolution", "fov", "preview")
"""Options about the poses. `--shot-list` without them keeps the planned poses, whatever seed orders the shots."""


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
    quiet: Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Plan the camera poses of every object, and write rig/plan.json.

    With --shot-list, and without an option about the poses, planned poses stay as they are.
    """
    from toolkit.captures.render import preview_plan
    from toolkit.rig.plan import list_misfits, make_camera, open_plan, plan_objects

    space = open_workspace(workspace, is_needed=True).with_patches(patches)
    if shot_list and space.plan_file.is_file() and not _asks_for_poses(context):
        made = open_plan(space, objects)
        names = list(dict.fromkeys(objects or made.objects))
    else:
        camera = make_camera(*resolution, fov)
        made = plan_objects(space, objects or (), pattern.with_overrides(seed=seed), camera)
        names = objects or list(made.objects)
        planned = made.model_copy(update={"objects": {name: made.objects[name] for name in names}})
        drawn = preview_plan(space, planned, seed) if preview else None
        if as_json and not shot_list:
            show_json(planned.model_dump(mode="json"))
        elif not as_json:
            for line in [] if quiet else list_poses(planned.objects):
                say(line)
            say(what_pairs_can_show(max(map(len, planned.objects.values()))))
            if drawn:
                say(f"pictures of the positions, and of what each shows: {drawn}")
            say(f"plan: {space.plan_file}")
            if not shot_list:
                say(_what_follows(space, list(planned.objects)))
    # sheets that do not fit, and the shot list
    for line in list_misfits(space, names, made):
        remark(line)
    if shot_list:
        ask_room("shot list")(space, made, names, listing, seed, as_json)


def _asks_for_poses(context: typer.Context) -> bool:
    # options at their defaults do not ask for new poses
    sources = [context.get_parameter_source(name) for name in POSES]
    return any(source is not None and source.name != "DEFAULT" for source in sources)


def _what_follows(space: Workspace, names: list[str]) -> str:
    from toolkit.objects.find_patch import find_patch_file

    unpatched = [name for name in names if find_patch_file(space, read_spec(space.object_spec(name))) is None]
    trained = f"toolkit train-patch --object {unpatched[0]}, then " if unpatched else ""
    return f"next: {trained}toolkit capture-sim"


def what_pairs_can_show(count: int) -> str:
    """Return in words what `count` pairs can show, by the same statistics as the report."""
    from toolkit.core.statistics import SIGNIFICANT, mcnemar_p

    enough = next((flips for flips in range(1, count + 1) if mcnemar_p(flips, 0) < SIGNIFICANT), None)
    changes = "no number of changes reaches"
    if enough is not None:
        changes = f"at least {enough} images must improve and none get worse for"
    return f"with {count_of(count, 'pose')} of an object, {changes} p < {SIGNIFICANT} (exact McNemar test)"


def list_poses(objects: "Mapping[str, Sequence[Pose]]") -> list[str]:
    """Return a line for the objects that have the same poses: how many, their angles, and all distances."""
    # objects with the same angles share a line
    alike: dict[str, list[str]] = {}
    for name, poses in objects.items():
        angles = [_listed({getattr(pose, angle) for pose in poses}) for angle in ("elevation_deg", "azimuth_deg")]
        each = f"{count_of(len(poses), 'pose')}, elevations {angles[0]}, azimuths {angles[1]}"
        alike.setdefault(each, []).append(name)
    lines = []
    for each, names in alike.items():
        # distances follow the object's size, so each object has its own
        distances = [pose.distance_mm for name in names for pose in objects[name]]
        away = f"{min(distances):.0f} to {max(distances):.0f} mm away"
        lines.append(f"{list_some(names, MOST_NAMED)}: {each}, {away}")
    more = len(lines) - MOST_LINES
    return lines if more <= 0 else [*lines[:MOST_LINES], f"and {more} more lines, all in the plan"]


def _listed(some: set[float]) -> str:
    degrees = sorted(some)
    if len(degrees) > 8:
        return f"{degrees[0]:.0f} to {degrees[-1]:.0f}° ({len(degrees)})"
    return " ".join(f"{value:.0f}°" for value in degrees)


@from_config(config=SimulateConfig, engine=EngineConfig)
def capture_sim(
    *,
    engine: EngineConfig,
    objects: options.Objects = None,
    variants: options.Variants = None,
    config: SimulateConfig,
    corrupt: options.Corrupt = None,
    patches: options.Patches = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Shoot every object at every pose of the plan, without and with its patch, in the virtual rig.

    With --like, shoot from the measured camera of every photograph of a folder instead. With --corrupt, also write a
    corrupted copy of the images (224² px, as networks see them) to captures/SOURCE-fog-3. With --rehearse, simulate the
    printed patch before you print it.
    """
    space = open_workspace(workspace, is_needed=True).with_patches(patches)
    made = simulate_captures(space, config, objects or (), variants or (), corrupt or (), seed=seed, engine=engine)
    # remarks before results, on the error stream
    for line in made.all_remarks:
        remark(line)
    show_result(made, as_json)


def write_boxes(
    captures: Annotated[
        Path | None, typer.Argument(help="Capture folder, or one source of it; default: captures/.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write; default: instances.json in the folder.")
    ] = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Write box and mask of the object in every image as COCO's instances.json, from mesh and camera.

    The category is COCO's for an object of a COCO class (airplane, car, bottle, cup), else the class of its spec.
    """
    from toolkit.captures.read import read_captures
    from toolkit.captures.truth import write_coco
    from toolkit.evaluation.tables import list_lines
    from toolkit.models.detector import coco_names

    space = open_workspace(workspace)
    folder = read_captures(captures or space.captures_dir)
    specs = space.object_specs()
    # categories are those of COCO, or the class of the spec
    names = {name: coco_names(str(read_spec(specs[name]).class_name))[-1] for name in folder.objects if name in specs}
    file = out or folder.root / "instances.json"
    count, left_out = write_coco(file, folder.captures, space, names)
    # images that contradict their manifest have no box either
    left_out += folder.faults
    if as_json:
        show_json({"file": str(file), "images": count, "left_out": left_out})
    else:
        say(f"{file}: {count_of(count, 'image')}")
        for line in list_lines("left out", left_out):
            warn(line)
    if left_out:
        raise typer.Exit(1)


def view(
    object_name: Annotated[
        str | None, typer.Option("--object", metavar="NAME", help="Object to show. Default: the plan's first.")
    ] = None,
    sources: Annotated[
        list[str] | None, typer.Option("--source", metavar="NAME", help="Only images of this; repeat for more.")
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=65535, help="Default: 8770, or a free one.", show_default=False),
    ] = None,
    workspace: options.Workspace = None,
) -> None:
    """Show an object with planned cameras, pictures and the pieces of its wrap in a browser; stop with Ctrl-C.

    Only this machine can open the viewer. It changes no file.
    """
    from toolkit.captures.view_3d import gather_view, open_viewer, show_view
    from toolkit.evaluation.tables import list_lines

    # all is read before a port is opened
    shown = gather_view(open_workspace(workspace), object_name, sources or ())
    server = open_viewer(port)
    show_view(server, shown)
    for line in list_lines("not shown", shown.left_out):
        warn(line)
    for line in shown.lines():
        say(line)
    say(f"open http://127.0.0.1:{server.get_port()} in a browser; Ctrl-C stops")
    with contextlib.suppress(KeyboardInterrupt):  # that is how it is stopped
        server.sleep_forever()
    server.stop()
