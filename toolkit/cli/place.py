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

RANDOM_VIEWS = 64
"""That judge sheets which go on together."""


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
    """Score places and sizes for a patch by what cameras see of it, and draw the best.

    One sheet is scored by the plan's cameras; with --sheets 2 or more, those that go on together by random ones.
    """
    from toolkit.captures.shoot import ShootSettings, studio_for
    from toolkit.core.errors import ToolkitError
    from toolkit.core.files import write_bytes
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.load import load_object
    from toolkit.objects.mesh import make_ray_scene
    from toolkit.objects.spec import write_mounts
    from toolkit.rig.fit import mounted_sizes_mm
    from toolkit.rig.place import draw_places, draw_poses, find_places, find_sheets, judge_place
    from toolkit.rig.plan import open_plan

    space = open_workspace(workspace)
    item = load_object(space.object_spec(object_name))
    plan = open_plan(space, [object_name])
    together = config.sheets > 1
    poses = draw_poses(item, plan.camera, RANDOM_VIEWS, seed) if together else plan.objects[object_name]
    own_mm = mounted_sizes_mm(space, item)
    scene, stated = make_ray_scene(item.mesh), item.spec.mounts
    own = [mount.model_copy(update={"size_mm": size}) for mount, size in zip(stated, own_mm, strict=True)]
    now = [judge_place(item, scene, plan.camera, poses, mount) for mount in own]
    sizes = config.sizes_mm or (round(own_mm[0], 1), round(own_mm[0] * 2 / 3, 1))
    find = find_sheets if together else find_places
    places = find(item, plan.camera, poses, config, sorted(set(sizes), reverse=True))
    if not places:
        raise ToolkitError(
            f"{object_name}: no sheet of {' or '.join(f'{size:g}' for size in sizes)} mm lies anywhere on it: try a "
            "smaller --size-mm, or more --steps"
        )
    file = space.root / "rig" / "preview" / f"{object_name}-places.png"
    shown = [one for one in places if together or one.mount.size_mm == places[0].mount.size_mm]
    write_bytes(file, draw_places(item, shown, plan.camera, poses, studio_for(item, ShootSettings())))
    choices = [[one.mount for one in places]] if together else [[one.mount] for one in places]
    trained: list[list[Validation]] = [[] for _ in choices]
    if train:
        from toolkit.boosters.for_object import try_place
        from toolkit.models.load import load_classifiers

        networks = load_classifiers(model, weights, device, space.classifiers_dir)
        trained = [try_place(space, object_name, networks, mounts, train, seed) for mounts in choices]
    worth = [(sum(answer.patched.value for answer in trained[k]), places[k].score) for k in range(len(choices))]
    written = None
    if write:
        best = choices[worth.index(max(worth))]
        written = write_mounts(space.object_spec(object_name), space.objects_dir / f"{object_name}.toml", best)
    if as_json:
        found = [one.as_json() | {"trained": _as_json(trained[0 if together else k])} for k, one in enumerate(places)]
        were = [one and one.as_json() for one in now]
        show_json({
            "object": object_name, "poses": len(poses), "picture": str(file), "written": written and str(written),
            "now": were[0] if len(were) == 1 else were, "places": found,
        })  # fmt: skip
        return
    named = [(str(k), one) for k, one in enumerate(places, 1)] if together else _number(places)
    tried = [("now" if one.lies else "now (does not lie)", one) for one in now if one]
    _show_table([*tried, *named], len(poses))
    for k, answers in enumerate(trained):
        which = f"{len(places)} sheets" if together else f"{named[k][0]} of {places[k].mount.size_mm:g} mm"
        for answer in answers:
            said = f"{answer.patched} of held-out views, {answer.bare} with grey paper"
            say(f"{which}, {train} steps on {answer.network}: {said}")
    if together:
        _say_together(file, places, config.sheets, len(poses))
    else:
        say(f"{file}: the places of {places[0].mount.size_mm:g} mm, numbered from the best")
    _say_written(written, object_name)


def _say_together(file: Path, places: "list[Place]", wanted: int, n_poses: int) -> None:
    from toolkit.rig.place import share_seen

    seen = f"{share_seen(places):.0%} of {n_poses} random views show half of one"
    say(f"{file}: {'1 sheet' if len(places) == 1 else f'{len(places)} sheets that go on together'}; {seen}")
    if len(places) < wanted:
        warn(f"there is room for {len(places)} of {wanted} sheets: try a smaller --size-mm, or more --steps")


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
