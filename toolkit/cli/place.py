"""`toolkit place`: where on an object is a patch best stuck?"""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, show_table, warn
from toolkit.rig.place import PlaceConfig

if TYPE_CHECKING:
    from toolkit.boosters.validation import Validation
    from toolkit.rig.place import Place


@from_config(config=PlaceConfig)
def place(
    *,
    object_name: Annotated[str, typer.Option("--object", metavar="NAME", help="Object to look for places on.")],
    config: PlaceConfig,
    train: Annotated[
        int,
        typer.Option("--train", metavar="STEPS", min=0, help="Also train a patch in each of the best, for so long."),
    ] = 0,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    write: Annotated[
        bool, typer.Option("--write", help="Put the best place into the object's file, rig/objects/NAME.toml.")
    ] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Score places and sizes for a patch by what the plan's cameras see of it, and draw the best."""
    from toolkit.captures.shoot import ShootSettings, studio_for
    from toolkit.core.errors import ToolkitError
    from toolkit.core.files import write_bytes
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.load import load_object
    from toolkit.objects.mesh import make_ray_scene
    from toolkit.objects.spec import write_mount
    from toolkit.rig.fit import mounted_size_mm
    from toolkit.rig.place import draw_places, find_places, judge_place
    from toolkit.rig.plan import open_plan

    space = open_workspace(workspace)
    item = load_object(space.object_spec(object_name))
    plan = open_plan(space, [object_name])
    poses = plan.objects[object_name]
    own_mm, longest_mm = mounted_size_mm(space, item), float(item.mesh.size_mm.max())
    own = item.spec.patch.model_copy(update={"size_mm": own_mm})
    now = judge_place(item, make_ray_scene(item.mesh), plan.camera, poses, own)
    sizes = config.sizes_mm or (round(own_mm, 1), round(longest_mm / 3, 1))
    places = find_places(item, plan.camera, poses, config, sorted(set(sizes), reverse=True))
    if not places:
        raise ToolkitError(
            f"{object_name}: no sheet of {' or '.join(f'{size:g}' for size in sizes)} mm lies anywhere on it: try a "
            "smaller --size-mm, or more --steps"
        )
    file = space.root / "rig" / "preview" / f"{object_name}-places.png"
    shown = [one for one in places if one.mount.size_mm == places[0].mount.size_mm]
    write_bytes(file, draw_places(item, shown, plan.camera, poses, studio_for(item, ShootSettings())))
    trained: list[list[Validation]] = [[] for _ in places]
    if train:
        from toolkit.boosters.for_object import try_place
        from toolkit.models.load import load_classifiers

        networks = load_classifiers(model, weights, device, space.classifiers_dir)
        trained = [try_place(space, object_name, networks, one.mount, train, seed) for one in places]
    worth = [(sum(answer.patched.value for answer in trained[k]), one.score) for k, one in enumerate(places)]
    written = None
    if write:
        best = places[worth.index(max(worth))]
        written = write_mount(space.object_spec(object_name), space.objects_dir / f"{object_name}.toml", best.mount)
    if as_json:
        found = [one.as_json() | {"trained": _as_json(trained[k])} for k, one in enumerate(places)]
        show_json({
            "object": object_name, "poses": len(poses), "picture": str(file), "written": written and str(written),
            "now": now and now.as_json(), "places": found,
        })  # fmt: skip
        return
    named = _number(places)
    tried = [("now" if now.lies else "now (does not lie)", now)] if now else []
    _show_table([*tried, *named], len(poses))
    for (name, one), answers in zip(named, trained, strict=True):
        for answer in answers:
            said = f"{answer.patched} of held-out views, {answer.bare} with grey paper"
            say(f"{name} of {one.mount.size_mm:g} mm, {train} steps on {answer.network}: {said}")
    say(f"{file}: the places of {places[0].mount.size_mm:g} mm, numbered from the best")
    _say_written(written, object_name)


def _say_written(written: Path | None, object_name: str) -> None:
    if written is not None:
        say(f"wrote {written}")
    else:
        warn(f"nothing was changed; --write puts the best into the file of {object_name}")


def _show_table(named: "list[tuple[str, Place]]", n_poses: int) -> None:
    rows = [
        (
            name, f"{one.mount.size_mm:g}", one.mount.at, f"{one.mount.offset_mm[0]:g}, {one.mount.offset_mm[1]:g}",
            f"{one.score:.1f}", f"{one.visible:.0%}", f"{one.area_px:.0f}", f"{one.poses_seen} of {n_poses}",
            f"{one.fit.bend_deg:.0f}°",
        )
        for name, one in named
    ]  # fmt: skip
    show_table(("", "size, mm", "side", "offset, mm", "score, px", "seen", "area, px²", "poses", "bend"), rows)


def _number(places: "list[Place]") -> "list[tuple[str, Place]]":
    """Each with its rank among those of its size, as the picture numbers them."""
    ranks: Counter[float | None] = Counter()
    named = []
    for one in places:
        ranks[one.mount.size_mm] += 1
        named.append((str(ranks[one.mount.size_mm]), one))
    return named


def _as_json(answers: "list[Validation]") -> dict[str, Any]:
    """Of each network the shares that it recognised on held-out views."""
    return {one.network: {"patched": one.patched.value, "grey": one.bare.value, "n": one.patched.n} for one in answers}
