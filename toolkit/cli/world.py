"""`toolkit world list`, `preview` and `export`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.output import say, show_json, show_table
from toolkit.core.errors import FieldError, ToolkitError

if TYPE_CHECKING:
    from toolkit.core.workspace import Workspace
    from toolkit.objects.mesh import Mesh
    from toolkit.worlds.world import Spot, World

WorldName = Annotated[
    str,
    typer.Argument(metavar="NAME|FILE", help="city, grass, apron, harbour; one of rig/worlds; or a GLB, OBJ or TOML."),
]
Scale = Annotated[
    float, typer.Option("--world-scale", metavar="X", help="From the units of a mesh of your own to metres.", min=0)
]
ObjectName = Annotated[
    str | None, typer.Option("--object", metavar="NAME", help="Stand this object in it, at its real size.")
]
VariantName = Annotated[
    str | None,
    typer.Option("--variant", metavar="NAME", help="Of the object: unpatched, patched, textured, or a control."),
]
PlaceName = Annotated[
    str | None, typer.Option("--place", metavar="NAME", help="Where it stands; the map shows names. Default: by seed.")
]
Length = Annotated[
    float | None, typer.Option("--length-m", metavar="X", help="Longest side of the object. Default: its spec's.")
]


def list_worlds(
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """List the worlds, built in and your own in rig/worlds: size, triangles, places, pads, classes."""
    from toolkit.core.console import list_skipped, progress
    from toolkit.core.workspace import open_workspace
    from toolkit.worlds.catalogue import WORLDS, list_own_worlds, open_world

    space = open_workspace(workspace)
    own = list_own_worlds(space)
    rows, skipped = [describe_studio()], []
    names = [*(name for name in WORLDS if name not in own), *own]
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
        say("see one: 'toolkit world preview NAME'; your own: put a GLB or a kit's TOML into rig/worlds")
    list_skipped(skipped)
    if skipped:
        raise typer.Exit(1)


def describe_world(world: "World", file: Path | None) -> dict[str, Any]:
    """What `list` says of a world; its size is that of the part that is made to be looked at from within."""
    import numpy as np

    from toolkit.worlds.classes import SceneClass

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


def preview(
    world: WorldName,
    times: Annotated[
        list[str] | None,
        typer.Option(
            "--time",
            metavar="NAME",
            help="noon, afternoon, golden, dusk, overcast; repeat for more. Default: afternoon and dusk.",
        ),
    ] = None,
    sky: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A panorama of your own as sky, before the times.")
    ] = None,
    weathers: Annotated[
        list[str] | None,
        typer.Option(
            "--weather",
            metavar="NAME[:SEVERITY]",
            help="The first sky's view also in: fog:1, dust, rain:3-5, snow; repeat for more. Default: fog:1.",
        ),
    ] = None,
    name: ObjectName = None,
    variant: VariantName = None,
    place: PlaceName = None,
    length_m: Length = None,
    resolution: Annotated[tuple[int, int], typer.Option(metavar="WIDTH HEIGHT", help="Of the pictures, pixels.")] = (
        1280,
        720,
    ),
    film_s: Annotated[
        float, typer.Option("--film-s", metavar="X", help="Length of the film, seconds; 0 makes none.")
    ] = 12.0,
    scale: Scale = 1.0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where to. Default: rig/worlds/NAME, and in it one for an object."),
    ] = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """See a world: pictures from street, roofs and air by day, at dusk and in fog, a map, and a flythrough film.

    The map shows where objects may stand and where the cameras are. What is there already is not made again.
    """  # fmt: skip
    from toolkit.core.workspace import open_workspace
    from toolkit.worlds.conditions import CLEAR, check_times, parse_weathers
    from toolkit.worlds.panorama import load_sky
    from toolkit.worlds.preview import PreviewSettings, preview_world
    from toolkit.worlds.sky import make_sky

    seen = tuple(one for one in parse_weathers(weathers or ["fog:1"]) if one != CLEAR)
    settings = PreviewSettings(resolution, film_s=film_s, weathers=seen, seed=seed)
    space = open_workspace(workspace)
    wanted = check_times(tuple(dict.fromkeys(times or ([] if sky else ["afternoon", "dusk"]))))
    skies = [] if sky is None else [load_sky(sky)]
    opened = _open(space, world, seed, scale)
    skies += [make_sky(time) for time in wanted]
    placed = None
    folder = out or space.worlds_dir / opened.name
    if name is None:
        _refuse_without_object(variant=variant, place=place, length_m=length_m)
    else:
        from toolkit.worlds.place import place_object

        mesh, spot = _find_object(space, opened, name, variant or "unpatched", place, length_m, seed)
        placed = place_object(mesh, opened, spot, skies[0])
        folder = out or folder / f"{name}-{variant or 'unpatched'}"
    result = preview_world(opened, skies, folder, settings, placed)
    if as_json:
        show_json({"folder": str(result.folder), "made": result.made, "kept": result.kept})
        return
    kept = f", {len(result.kept)} kept from before" if result.kept else ""
    say(f"made {len(result.made)} files of {opened.name}{kept}: {result.folder}")
    say(f"next: toolkit world export {world}, or look at map.png for places")


def export(
    world: WorldName,
    name: ObjectName = None,
    variant: VariantName = None,
    place: PlaceName = None,
    length_m: Length = None,
    lamps: Annotated[
        bool, typer.Option("--lamps", help="Lit, as at dusk: what glows is written as emissive textures.")
    ] = False,
    scale: Scale = 1.0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to. Default: rig/worlds/NAME/NAME.glb.")
    ] = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Write a world, and an object in it, as GLB: metres, y up, with textures, for Blender, Unreal, three.js.

    Sky and weather are no part of it.
    """
    from toolkit.core.files import write_bytes
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.export import to_glb
    from toolkit.objects.mesh import merge_meshes

    space = open_workspace(workspace)
    if out is not None and out.suffix.lower() != ".glb":
        raise FieldError("expected a file that ends in .glb", {"out": out})
    opened = _open(space, world, seed, scale)
    mesh, title = opened.mesh, opened.name
    if name is None:
        _refuse_without_object(variant=variant, place=place, length_m=length_m)
    else:
        from toolkit.worlds.place import place_object
        from toolkit.worlds.sky import make_sky

        item, spot = _find_object(space, opened, name, variant or "unpatched", place, length_m, seed)
        stands = place_object(item, opened, spot, make_sky("noon", height_px=16))
        mesh = merge_meshes([mesh, stands.in_world])
        title = f"{title}-{name}-{variant or 'unpatched'}"
    file = out or space.worlds_dir / opened.name / f"{title}.glb"
    content = to_glb(mesh, title, units_per_m=1.0, lamps=lamps)
    write_bytes(file, content)
    if as_json:
        show_json({"file": str(file), "bytes": len(content), "triangles": len(mesh.faces)})
        return
    say(f"wrote {len(mesh.faces):,} triangles, {len(content) / 1e6:.1f} MB, metres, y up: {file}")
    say("next: in Blender File > Import > glTF 2.0; in three.js GLTFLoader")


def _open(space: "Workspace", world: str, seed: int, scale: float) -> "World":
    from toolkit.core.console import notice
    from toolkit.worlds.catalogue import open_world

    if world == "studio":
        raise ToolkitError("the studio is a table top, no world: see it with 'toolkit plan' and 'toolkit capture-sim'")
    if world == "city":
        notice("building the city: some seconds")
    return open_world(space, world, seed, scale)


def _refuse_without_object(**given: object) -> None:
    for field, value in given.items():
        if value is not None:
            raise FieldError("of which object? Say {name} with it", {field: value})


def _find_object(
    space: "Workspace", world: "World", name: str, variant: str, place: str | None, length_m: float | None, seed: int
) -> "tuple[Mesh, Spot]":  # fmt: skip
    """The object at its real size in a variant, and the spot where it stands."""
    from toolkit.objects.load import load_object
    from toolkit.rig.variants import dress, find_booster
    from toolkit.worlds.place import choose_places, find_radius, find_spot, scale_to_world

    if variant == "patch-alone":
        raise FieldError("lies on a table without its object: choose another in a world", {"variant": variant})
    item = load_object(space.object_spec(name))
    mesh = scale_to_world(dress(item, find_booster(space, item, variant)), item.spec, length_m)
    if place is not None:
        return mesh, find_spot(world, place)
    return mesh, choose_places(world, find_radius(mesh), 1, seed)[0]
