"""Find places for sheets on an object, draw them, try them by training, and keep them."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from toolkit.captures.render import ObjectPreview, preview_object
from toolkit.captures.shoot import ShootSettings, studio_for
from toolkit.core.errors import FieldError
from toolkit.core.files import write_bytes
from toolkit.core.text import join_words
from toolkit.core.workspace import Workspace
from toolkit.models.find import find_class
from toolkit.objects.add import DEFAULT_PATCH_MM, AddedObject, add_object
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import make_ray_scene
from toolkit.objects.spec import ObjectRequest, PatchMount, Side, read_spec, write_mounts
from toolkit.rig import Pattern, PlaceConfig
from toolkit.rig.camera import Camera
from toolkit.rig.fit import describe_misfit, mounted_sizes_mm
from toolkit.rig.patch_places import (
    Place,
    draw_places,
    draw_poses,
    find_places,
    find_sheets,
    judge_place,
    share_seen,
)  # fmt: skip
from toolkit.rig.plan import open_plan, plan_poses

if TYPE_CHECKING:
    from toolkit.boosters.pixels import Network
    from toolkit.boosters.validation import Validation

SIZES_TRIED = (1.0, 0.85, 0.7, 0.55, 0.4)
"""Shares of the wanted size, tried in this order."""
SMALLEST_TRIED_MM = 12.0
FEW_STEPS = 8
"""Places along a new object's length, few for speed."""
RANDOM_VIEWS = 64
"""Random views that judge several sheets."""
SMALL_SHARE = 0.1
"""Share of an object's length; a smaller sheet is a few pixels wide in an image of the whole object."""
TITLES = ("", "size, mm", "side", "offset, mm", "score, px", "seen", "area, px²", "poses", "bend")


@dataclass(frozen=True)
class SuggestedPlaces:
    """Best places for patches on an object.

    Attributes:
        n_poses: number of cameras that judged the places.
        now: places in the object's file, None for a place off the object.
        places: best places; for several sheets their places together.
        steps: training steps in each place; 0 without training.
        trained: accuracy of each network in each place.
        written: the object's file, if the best place was written.
    """

    object_name: str
    wanted: int
    n_poses: int
    now: tuple[Place | None, ...]
    places: tuple[Place, ...]
    picture: Path
    steps: int
    trained: "tuple[list[Validation], ...]"
    written: Path | None

    @property
    def is_together(self) -> bool:
        """Whether the places are for several sheets together."""
        return self.wanted > 1

    def as_json(self) -> dict[str, Any]:
        """Return the result for a script."""
        # a single place of now is not a list, as scripts of earlier versions expect
        now = [place and place.as_json() for place in self.now]
        places = []
        for k, place in enumerate(self.places):
            # sheets that go together are trained together
            answers = self.trained[0 if self.is_together else k]
            shares = {
                answer.network: {"patched": answer.patched.value, "grey": answer.bare.value, "n": answer.patched.n}
                for answer in answers
            }
            places.append(place.as_json() | {"trained": shares})
        return {
            "object": self.object_name, "poses": self.n_poses, "picture": str(self.picture),
            "written": self.written and str(self.written), "now": now[0] if len(now) == 1 else now, "places": places,
        }  # fmt: skip

    def rows(self) -> list[tuple[str, ...]]:
        """Return a row under `TITLES` for each place in the object's file, and each best place."""
        now = [("now" if place.fit.lies else "now (not flat)", place) for place in self.now if place]
        rows: list[tuple[str, ...]] = []
        for name, place in [*now, *zip(self._names(), self.places, strict=True)]:
            mount, seen = place.mount, f"{place.poses_seen} of {self.n_poses}"
            where = mount.at, "{:g}, {:g}".format(*mount.offset_mm)
            shown = f"{place.score:.1f}", f"{place.visible:.0%}", f"{place.area_px:.0f}", seen
            rows.append((name, f"{mount.size_mm:g}", *where, *shown, f"{place.fit.bend_deg:.0f}°"))
        return rows

    def lines(self) -> Iterator[str]:
        """Yield sentences on training and the picture."""
        for name, place, answers in zip(self._names(), self.places, self.trained, strict=False):
            which = f"{len(self.places)} sheets" if self.is_together else f"{name} of {place.mount.size_mm:g} mm"
            for answer in answers:
                said = f"{answer.patched} of held-out views, {answer.bare} with grey paper"
                yield f"{which}, {self.steps} steps on {answer.network}: {said}"
        if self.is_together:
            seen = f"{share_seen(self.places):.0%} of {self.n_poses} random views show half of a sheet"
            count = "1 sheet" if len(self.places) == 1 else f"{len(self.places)} sheets together"
            yield f"{self.picture}: {count}; {seen}"
        else:
            size_mm = self.places[0].mount.size_mm
            yield f"{self.picture}: the places of {size_mm:g} mm, numbered from the best"
        if self.written is not None:
            yield f"wrote {self.written}"

    def warnings(self) -> Iterator[str]:
        """Yield what is missing, and what was not done."""
        if len(self.places) < self.wanted and self.is_together:
            room = f"there is room for {len(self.places)} of {self.wanted} sheets"
            yield f"{room}: try a smaller --size-mm, or more --steps"
        if self.written is None:
            yield f"nothing was changed; --write puts the best into the file of {self.object_name}"

    def _names(self) -> list[str]:
        """Return the rank of each place among places of its size, as in the picture; for sheets their number."""
        ranks: Counter[float | None] = Counter()
        names = []
        for place in self.places:
            group = None if self.is_together else place.mount.size_mm
            ranks[group] += 1
            names.append(str(ranks[group]))
        return names


def suggest_places(
    workspace: Workspace, object_name: str, config: PlaceConfig, *, networks: "Sequence[Network]" = (), steps: int = 0,
    write: bool = False, seed: int = 0,
) -> SuggestedPlaces:  # fmt: skip
    """Score places and sizes for patches on an object by how well cameras see them, and draw the best.

    The plan's cameras judge a single sheet, random cameras several sheets.

    Args:
        config: sizes, sides and number of sheets.
        steps: training steps in each place; 0 for no training.
        write: whether to write the best place into the object's file.

    Raises:
        ToolkitError: the object is unknown, the plan is broken, or no sheet fits flat anywhere.
    """
    item = load_object(workspace.object_spec(object_name))
    plan = open_plan(workspace, [object_name])
    together = config.sheets > 1
    # the plan's few poses would put several sheets in front of these cameras
    poses = draw_poses(item, plan.camera, RANDOM_VIEWS, seed) if together else plan.objects[object_name]
    # places of today are judged beside the others, in the size of their patch
    own_mm = mounted_sizes_mm(workspace, item)
    scene = make_ray_scene(item.mesh)
    own = [mount.model_copy(update={"size_mm": size}) for mount, size in zip(item.spec.mounts, own_mm, strict=True)]
    now = tuple(judge_place(item, scene, plan.camera, poses, mount) for mount in own)
    # by default the size of now, and two thirds of it
    sizes = config.sizes_mm or (round(own_mm[0], 1), round(own_mm[0] * 2 / 3, 1))
    find = find_sheets if together else find_places
    places = find(item, plan.camera, poses, config, sorted(set(sizes), reverse=True), own)
    if not places:
        asked = " or ".join(f"{size:g}" for size in sizes)
        why = f"{object_name}: no sheet of {asked} mm fits flat anywhere: try a smaller {{sizes_mm}}, or more {{steps}}"
        raise FieldError(why, {})
    # draw the places
    picture = workspace.root / "rig" / "preview" / f"{object_name}-places.png"
    shown = [place for place in places if together or place.mount.size_mm == places[0].mount.size_mm]
    write_bytes(picture, draw_places(item, shown, plan.camera, poses, studio_for(item, ShootSettings())))
    # train a patch in each place
    choices = [[place.mount for place in places]] if together else [[place.mount] for place in places]
    trained: list[list[Validation]] = [[] for _ in choices]
    if steps:
        from toolkit.boosters.train import try_place

        trained = [try_place(workspace, object_name, networks, mounts, steps, seed) for mounts in choices]
    written = None
    if write:
        # accuracy after training decides, then the score by the cameras
        worth = [(sum(answer.patched.value for answer in trained[k]), places[k].score) for k in range(len(choices))]
        best = choices[worth.index(max(worth))]
        file = workspace.objects_dir / f"{object_name}.toml"
        # the user's own file, also for an object that is built in
        written = write_mounts(workspace.object_spec(object_name), file, best)
    return SuggestedPlaces(
        object_name, config.sheets, len(poses), now, tuple(places), picture=picture, steps=steps, written=written,
        trained=tuple(trained),
    )  # fmt: skip


@dataclass(frozen=True)
class NewObject:
    """An object that was added.

    Attributes:
        moved: sentence on a change of its sheet's place; empty without a change.
        small: sentence on a small sheet; empty if it is large enough.
    """

    added: AddedObject
    moved: str
    small: str
    drawn: ObjectPreview
    skipped: tuple[tuple[str, str], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the result for a script."""
        page, trouble = self.drawn.page, self.drawn.trouble
        drawn = {"preview": str(self.drawn.picture), "page": page and str(page), "trouble": trouble}
        return self.added.as_json() | {"moved": self.moved, "small": self.small} | drawn

    def lines(self) -> Iterator[str]:
        """Yield sentences on the object, its preview, and the next commands."""
        yield from (*self.added.lines(), *self.drawn.lines())
        for note in (self.moved, self.small, self.drawn.trouble, self.added.ask_length()):
            if note:
                yield f"note: {note}"
        name = self.added.item.name
        yield f"next: toolkit plan --object {name}, then toolkit train-patch --object {name}"


def add_and_place(workspace: Workspace, mesh_file: Path, request: ObjectRequest) -> NewObject:
    """Add an object from its mesh, move its sheet to a flat place, and draw it; raises as `add_object`."""
    label = find_class(str(request.class_name), workspace.classifiers_dir)
    added = add_object(workspace, mesh_file, request.with_overrides(class_name=label))
    sides = get_args(Side) if request.print_side is None else (request.print_side,)
    moved = move_sheet(workspace, added.item, sides)
    item = replace(added.item, spec=read_spec(added.spec_file))
    return NewObject(added, moved, describe_small_sheet(item), preview_object(workspace, item))


def move_sheet(workspace: Workspace, item: TableObject, sides: Sequence[Side]) -> str:
    """Move the sheet of a new object to a place where it fits flat, and write the object's file.

    The largest size that fits anywhere counts, and the place of this size that a plan's cameras see best.

    Returns:
        A sentence on the change; empty if the sheet stays.
    """
    camera = Camera.from_fov()
    # a new object has a single sheet
    (wanted_mm,), mount = mounted_sizes_mm(workspace, item), item.spec.mounts[0]
    if describe_misfit(item, wanted_mm) is None:
        return ""
    # a new object is in no plan yet: these are the poses that a plan will give it
    poses = plan_poses(item, camera, Pattern())
    # smaller and smaller, until a sheet fits
    for size_mm in (round(share * wanted_mm, 1) for share in SIZES_TRIED):
        if size_mm < SMALLEST_TRIED_MM:
            break
        config = PlaceConfig(sides=tuple(sides), steps=FEW_STEPS, best=1)
        for best in find_places(item, camera, poses, config, [size_mm]):
            file = workspace.object_spec(item.name)
            write_mounts(file, file, [best.mount])
            found = best.mount
            # in words: another side, or another place on the same one
            where = f"on its {mount.at}: it goes on its {found.at}"
            if found.at == mount.at:
                where = f"in the middle of its {mount.at}: it goes {_describe_offset(found)}"
            told = (
                f"a patch of {wanted_mm:.3g} mm does not lie flat {where}, {size_mm:g} mm wide, where half of it or "
                f"more shows in {best.poses_seen} of {len(poses)} poses"
            )
            more = f"; for sheets on other sides too: toolkit place --object {item.name} --sheets 3 --write"
            return told + more if 2 * best.poses_seen <= len(poses) else told
    return ""


def _describe_offset(mount: PatchMount) -> str:
    """Return the offset of a sheet from the middle of its side in words; "there" in the middle."""
    ways = (("forward", "back"), ("to the left", "to the right"))
    if mount.at != "top":
        ways = (("to the right", "to the left"), ("up", "down"))
    moves = [
        f"{abs(shift):g} mm {way[shift < 0]}"
        for shift, way in zip(mount.offset_mm, ways, strict=True)
        if round(shift, 1)
    ]
    return join_words(moves) or "there"


def describe_small_sheet(item: TableObject) -> str:
    """Return a sentence if the largest sheet of a new object is small beside it; else an empty text."""
    length_mm, size_mm = item.spec.length_mm, max(item.spec.sizes_mm(DEFAULT_PATCH_MM))
    if size_mm >= SMALL_SHARE * length_mm:
        return ""
    return (
        f"a sheet of {size_mm:.0f} mm is {size_mm / length_mm:.0%} of the object's {length_mm:.0f} mm, and few pixels "
        f"of a picture of all of it: print it larger ('--size-mm {length_mm / 3:.0f} --replace' is a third), or set "
        "length_mm if the real object is smaller"
    )
