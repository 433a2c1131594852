"""`toolkit world list`, `preview` and `export`, and `world-eval`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_table
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import load_json
from toolkit.core.text import count_of, kept_before, quote
from toolkit.core.workspace import open_workspace
from toolkit.engine import EngineConfig
from toolkit.rooms.worlds.conditions import ObjectInWorld, PreviewRequest
from toolkit.rooms.worlds.evaluation import WorldEvalConfig

if TYPE_CHECKING:
    from toolkit.rooms.worlds.evaluation.world_run import WorldRun
    from toolkit.rooms.worlds.world import World

WorldName = Annotated[
    str,
    typer.Argument(
        metavar="NAME|FILE", help="city, grass, apron, harbour; a name in rig/worlds; or a GLB, OBJ or TOML."
    ),
]
Scale = Annotated[float, typer.Option("--world-scale", metavar="X", help="Metres in a unit of your mesh.", min=0)]


def list_worlds(
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """List the worlds, built in and your own in rig/worlds: size, triangles, places, pads, classes."""
    from toolkit.core.console import list_skipped, progress
    from toolkit.rooms.worlds.own import WORLDS, list_own_worlds, open_world

    space = open_workspace(workspace)
    own = list_own_worlds(space)
    # the studio comes first, though it is no world of these
    rows, skipped = [describe_studio()], []
    # a name in the workspace hides the built-in world of that name
    names = [*(name for name in WORLDS if name not in own), *own]
    # a damaged world of the user's does not hide the others
    with progress("worlds", len(names)) as bar:
        for name in names:
            try:
                rows.append(describe_world(open_world(space, name, seed), own.get(name)))
            except ToolkitError as error:
                skipped.append((name, str(error)))
            bar.advance()
    if as_json:
        show_json(rows)
    else:
        cells = []
        for row in rows:
            size = " × ".join(f"{side:g}" for side in row["size_m"])
            counts = [f"{row[key]:,}" for key in ("triangles", "spots", "pads")]
            cells.append((row["name"], size, *counts, ", ".join(row["classes"])))
        show_table(("world", "size, m (x × y × z)", "triangles", "spots", "pads", "classes"), cells)
        say("see a world: 'toolkit world preview NAME'; your own: put a GLB or a kit's TOML into rig/worlds")
    list_skipped(skipped)
    if skipped:
        raise typer.Exit(1)


def describe_world(world: "World", file: Path | None) -> dict[str, Any]:
    """What `list` says of a world; its size is that of the part that is made to be looked at from within."""
    import numpy as np

    from toolkit.rooms.worlds.world import SceneClass

    # the surroundings outside the core are seen from afar only, so they do not count
    across = np.ptp(world.core, axis=0)
    return {
        "name": world.name, "file": None if file is None else str(file), "seed": world.seed,
        "size_m": [*(round(float(side), 1) for side in across), round(float(np.ptp(world.bounds[:, 2])), 1)],
        "triangles": len(world.mesh.faces), "spots": len(world.spots), "pads": len(world.pads),
        "classes": [SceneClass(kind).name.lower() for kind in np.unique(world.face_class)],
    }  # fmt: skip


def describe_studio() -> dict[str, Any]:
    """The same of the table top, which `capture-sim` shoots in."""
    from toolkit.rig.studio import make_studio

    width, depth = make_studio(0, 270.0, "oak").need_table().size_mm
    return {
        "name": "studio", "file": None, "seed": 0, "size_m": [round(width / 1000, 2), round(depth / 1000, 2), 0.0],
        "triangles": 2, "spots": 1, "pads": 0, "classes": ["table"],
    }  # fmt: skip


@from_config(request=PreviewRequest, item=ObjectInWorld)
def preview(
    world: WorldName,
    *,
    request: PreviewRequest,
    item: ObjectInWorld,
    scale: Scale = 1.0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where to. Default: rig/worlds/NAME, for an object a folder in it."),
    ] = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """See a world: pictures from street, roofs and air by day, at dusk and in fog, a map, and a flythrough film.

    The map shows where objects may stand and where the cameras are. Finished files are kept.
    """  # fmt: skip
    from toolkit.rooms.worlds.preview import preview_request

    space = open_workspace(workspace, is_needed=out is None)
    name, result = preview_request(space, world, request, item, scale=scale, out=out, seed=seed)
    if as_json:
        show_json({"folder": str(result.folder), "made": result.made, "kept": result.kept})
        return
    say(f"made {count_of(len(result.made), 'file')} of {name}{kept_before(len(result.kept))}: {result.folder}")
    say(f"next: toolkit world export {quote(world)}, or look at map.png for places")


@from_config(item=ObjectInWorld)
def export(
    world: WorldName,
    *,
    item: ObjectInWorld,
    lamps: Annotated[
        bool, typer.Option("--lamps", help="Write lamps as lit, as at dusk, by emissive textures.")
    ] = False,
    scale: Scale = 1.0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to. Default: rig/worlds/NAME/NAME.glb.")
    ] = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Write a world, and an object in it, as GLB: metres, y up, with textures, for Blender, Unreal, three.js.

    Sky and weather are not written.
    """
    from toolkit.core.files import write_bytes
    from toolkit.objects.export_mesh import to_glb
    from toolkit.objects.mesh import merge_meshes
    from toolkit.rooms.worlds.own import open_world
    from toolkit.rooms.worlds.place import stand_object
    from toolkit.rooms.worlds.sky import make_sky

    space = open_workspace(workspace, is_needed=out is None)
    if out is not None and out.suffix.lower() != ".glb":
        raise FieldError("expected a file that ends in .glb", {"out": out})
    item.check()
    opened = open_world(space, world, seed, scale)
    # without an object the world alone is written
    mesh, title = opened.mesh, opened.name
    # the sky plays no part in an export: the smallest will do
    if item.object_name is not None:
        stands = stand_object(space, opened, item, make_sky("noon", height_px=16), seed)
        mesh, title = merge_meshes([mesh, stands.in_world]), f"{title}-{item.title}"
    file = out or space.worlds_dir / opened.name / f"{title}.glb"
    content = to_glb(mesh, title, units_per_m=1.0, lamps=lamps)
    write_bytes(file, content)
    if as_json:
        show_json({"file": str(file), "bytes": len(content), "triangles": len(mesh.faces)})
        return
    say(f"wrote {len(mesh.faces):,} triangles, {len(content) / 1e6:.1f} MB, metres, y up: {file}")
    say("next: in Blender File > Import > glTF 2.0; in three.js GLTFLoader")


@from_config(config=WorldEvalConfig, engine=EngineConfig)
def world_eval(
    *,
    config: WorldEvalConfig,
    engine: EngineConfig,
    network: options.NamedNetwork,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Render an object in a world from a grid of cameras, in weather, and classify the pictures.

    Results go to eval/RUN. An answer is computed once, whatever run asks for it.
    """
    from toolkit.core.console import list_skipped
    from toolkit.models.load import load_classifier
    from toolkit.rooms.worlds.evaluation.world_run import evaluate_world

    space = open_workspace(workspace)
    classifier = load_classifier(*network, space.classifiers_dir)
    done = evaluate_world(space, classifier, config, engine)
    list_skipped(done.failed)
    if as_json:
        typer.echo(done.files.summary.read_text(encoding="utf-8"))
    else:
        show_world(done)
    if done.failed:
        raise typer.Exit(1)


def show_world(done: "WorldRun") -> None:
    """Print the weathers in numbers, the cameras, the table, the result in words, and where the report is."""
    from toolkit.core.console import console
    from toolkit.rooms.worlds.depth_weather import describe_weathers
    from toolkit.rooms.worlds.evaluation.world_results import build_world_table, judge_world

    summary = load_json(done.files.summary)
    for line in describe_weathers(done.results.weathers):
        say(line)
    cameras = summary["cameras"][-1]
    # the summary counts cameras by reason, as "left out: REASON"
    left_out = ", ".join(f"{count} {key.partition(': ')[2]}" for key, count in cameras.items() if "left out" in key)
    say(
        f"{cameras['points']} points of the grid: {cameras['standing']} can hold a camera"
        f"{f' (left out: {left_out})' if left_out else ''}; {cameras['shot']} shot, {cameras['in_view']} with the "
        f"object in view, {cameras['hidden']} with it hidden"
    )
    console.print(build_world_table(summary))
    for verdict in judge_world(summary):
        say(verdict.sentence)
    for note in summary["notes"]:
        remark(note)
    say(f"{done.computed} answers{kept_before(done.kept)}; table, figures and report: {done.files.report}")
