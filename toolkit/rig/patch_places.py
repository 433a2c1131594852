"""The best places for a patch on an object: places and sizes scored by what cameras see of the sheet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.text import join_words
from toolkit.core.threads import map_ahead
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import cast_rays, make_ray_scene
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.objects.spec import PatchMount, Side
from toolkit.rig import PlaceConfig
from toolkit.rig.camera import Camera, distance_to_fill, project
from toolkit.rig.fit import ACROSS, SheetFit, measure_fit
from toolkit.rig.mount import SAMPLES, SIDES, MountedSheet, attach, do_overlap, mount_patch
from toolkit.rig.plan import Pose
from toolkit.rig.plan_pictures import draw_contact_sheet
from toolkit.rig.scene import Scene
from toolkit.rig.views import NEAR_VIEWS

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

CELLS = 10
"""Across the sheet: what a camera sees is asked at the corners of so many squares each way."""
LIFT_MM = 1.0
SEEN = 0.5
COLOURS = ((214, 40, 40), (36, 98, 196), (28, 140, 60), (220, 140, 0), (130, 50, 160), (0, 140, 150))


@dataclass(frozen=True)
class Place:
    """A place for a sheet, and what the cameras see of it."""

    mount: PatchMount  # side, size and offset
    fit: SheetFit  # how the sheet lies there
    shares: np.ndarray  # (poses,) share of the sheet that each sees
    areas_px: np.ndarray  # (poses,) what it covers of each picture, square pixels
    # mean over the poses of the side, in pixels, of a square as large as what is seen, times the share of the sheet
    # that lies on the surface. A large view does not outweigh many in which nothing is seen.
    score: float

    @property
    def visible(self) -> float:
        """Share of the sheet that is seen, mean over the poses."""
        return float(self.shares.mean())

    @property
    def poses_seen(self) -> int:
        """Poses in which half of it is seen or more."""
        return int((self.shares >= SEEN).sum())

    @property
    def area_px(self) -> float:
        """Area in the picture, square pixels, mean over the poses."""
        return float(self.areas_px.mean())

    def as_json(self) -> dict[str, Any]:
        """Mount, fit and score, rounded."""
        numbers = {name: round(getattr(self.fit, name), 3) for name in ("floating", "loose", "overhang", "relief_mm")}
        seen = {"visible": round(self.visible, 4), "area_px": round(self.area_px, 1), "poses_seen": self.poses_seen}
        mount = self.mount.model_dump(include={"at", "size_mm", "offset_mm"})
        judged = {"lies": self.fit.lies, "score": round(self.score, 2), **seen, "bend_deg": round(self.fit.bend_deg, 1)}
        return {**mount, **judged, **numbers}


def find_places(
    item: TableObject, camera: Camera, poses: Sequence[Pose], config: PlaceConfig, sizes_mm: Sequence[float],
    today: Sequence[PatchMount] = (),
) -> list[Place]:  # fmt: skip
    """The best places for each size, best first; of two that overlap only the better.

    A place where a sheet does not fit flat is left out, see `SheetFit.lies`.

    Args:
        today: places that are tried at each size beside those of the grid.
    """
    found = _judge_all(item, camera, poses, config, sizes_mm, today)
    return [place for size in sizes_mm for place in _pick(found, size, config.best)]


def find_sheets(
    item: TableObject, camera: Camera, poses: Sequence[Pose], config: PlaceConfig, sizes_mm: Sequence[float],
    today: Sequence[PatchMount] = (),
) -> list[Place]:  # fmt: skip
    """Places for `config.sheets` sheets together, the best alone first; fewer if no more fit.

    Each next sheet is where it adds most to the score of all: the mean over the poses of the root of the area seen.
    None overlap.

    Args:
        camera, poses: what looks at it: `draw_poses` for a choice that no plan decides.
        today: places that are tried at each size beside those of the grid.
    """
    found = _judge_all(item, camera, poses, config, sizes_mm, today)
    # squared, as the score is a length: the root of an area times the share that lies
    areas = np.array([place.areas_px * (1 - place.fit.floating) ** 2 for place in found]).reshape(len(found), -1)
    chosen: list[Place] = []
    sheets: list[MountedSheet] = []
    seen = np.zeros(len(poses))
    while len(chosen) < config.sheets:
        # greedy; the root has each further square pixel count less, so that poses that see nothing yet win
        for k in np.argsort(-np.sqrt(seen + areas).mean(axis=1), kind="stable"):
            sheet = _mount(item, found[k].mount)
            if not any(do_overlap(sheet, other) for other in sheets):
                chosen, sheets, seen = [*chosen, found[k]], [*sheets, sheet], seen + areas[k]
                break
        else:
            break
    return chosen


def share_seen(sheets: Sequence[Place]) -> float:
    """Share of the poses in which half of a sheet is seen or more, whichever it is."""
    return float((np.max([sheet.shares for sheet in sheets], axis=0) >= SEEN).mean())


def draw_poses(item: TableObject, camera: Camera, count: int, seed: int) -> list[Pose]:
    """Random poses in the ranges of training views, none of a plan; pose i depends on (seed, i) alone."""
    target = np.array([0.0, 0.0, float(item.mesh.size_mm[2]) / 2])
    poses = []
    for i in range(count):
        rng = np.random.default_rng([seed, i, 3])
        azimuth, elevation, roll, fill = NEAR_VIEWS.draw(rng)
        distance = distance_to_fill(camera, item.mesh.vertices, target, azimuth, elevation, fill=fill, roll_deg=roll)
        poses.append(Pose(
            id=i + 1, azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=roll, distance_mm=distance,
            target_mm=tuple(target),
        ))  # fmt: skip
    return poses


def _judge_all(
    item: TableObject, camera: Camera, poses: Sequence[Pose], config: PlaceConfig, sizes_mm: Sequence[float],
    today: Sequence[PatchMount],
) -> list[Place]:  # fmt: skip
    """Every place where a sheet lies, best first."""
    scene = make_ray_scene(item.mesh)
    # the grid is as coarse as the object is long
    step_mm = float(item.mesh.size_mm.max()) / config.steps
    # the places of today come first: of equal scores the first wins
    tried = [
        *(spot.model_copy(update={"size_mm": size}) for size in sizes_mm for spot in today if spot.at in config.sides),
        *(mount for size, at in product(sizes_mm, config.sides) for mount in _spread(item, at, size, step_mm)),
    ]
    found: list[Place] = []
    sides = join_words(f"{size:g}" for size in sizes_mm)
    with progress(f"trying places of {sides} mm on {item.name}", len(tried)) as bar:
        judge = partial(judge_place, item, scene, camera, poses, only_lying=True)
        for place in map_ahead(judge, tried):
            if place is not None:
                found.append(place)
            bar.advance()
    found.sort(key=lambda place: -place.score)
    return found


def judge_place(
    item: TableObject, scene: "RaycastingScene", camera: Camera, poses: Sequence[Pose], mount: PatchMount,
    only_lying: bool = False,
) -> Place | None:  # fmt: skip
    """The score of a sheet in a place; None if it cannot be mounted, or should fit flat and does not."""
    assert mount.size_mm is not None
    try:
        fit = measure_fit(item, mount.size_mm, mount, scene)
    except ToolkitError:
        return None
    if only_lying and not fit.lies:
        return None
    points, normals = _grid(fit, mount.at)
    # what each pose sees of the sheet: the share that nothing hides, and its area in the image
    seen = [_see(scene, camera, pose.matrix(), points, normals) for pose in poses]
    shares, areas = np.array(seen).T
    # a length in pixels: the root of the area seen, less the share that floats
    return Place(mount, fit, shares, areas, float(np.sqrt(areas).mean() * (1 - fit.floating)))


def draw_places(
    item: TableObject, places: Sequence[Place], camera: Camera, poses: Sequence[Pose], studio: Scene
) -> bytes:
    """PNG of the object with numbered sheets on the places, from poses all round."""
    mesh = attach(item.mesh, *(_mount(item, place.mount, number) for number, place in enumerate(places, 1)))
    chosen = [poses[k] for k in np.unique(np.linspace(0, len(poses) - 1, min(8, len(poses))).round().astype(int))]
    return draw_contact_sheet(replace(item, mesh=mesh), camera, chosen, studio, columns=4)


def _mount(item: TableObject, mount: PatchMount, number: int = 1) -> MountedSheet:
    """A sheet of the mount's own size with a number on it."""
    assert mount.size_mm is not None
    return mount_patch(item.mesh, _number(number), mount.size_mm, mount, item.name)


def _number(number: int, side: int = 96) -> np.ndarray:
    """(side, side, 3) uint8: a white number on its own colour."""
    image = Image.new("RGB", (side, side), COLOURS[(number - 1) % len(COLOURS)])
    font = ImageFont.load_default(size=side * 3 // 4)
    ImageDraw.Draw(image).text((side / 2, side / 2), str(number), fill="white", font=font, anchor="mm")
    return np.asarray(image)


def _spread(item: TableObject, at: Side, size_mm: float, step_mm: float) -> Iterator[PatchMount]:
    """Mounts on a grid over a side, as far as the patch's middle stays on the object's outline."""
    low, high = item.mesh.bounds
    reach = [float(np.abs(np.array(axis)) @ (high - low)) / 2 for axis in SIDES[at]]
    counts = [int(max(0.0, half - size_mm / 4) // step_mm) for half in reach]
    for right, up in product(*(range(-count, count + 1) for count in counts)):
        yield PatchMount(at=at, size_mm=size_mm, offset_mm=(round(right * step_mm, 1), round(up * step_mm, 1)))


def _grid(fit: SheetFit, at: Side) -> tuple[np.ndarray, np.ndarray]:
    """(c, c, 3) points of the sheet, lifted off it, and the unit normals there, outward."""
    along, across = (np.linspace(0, count - 1, CELLS + 1).round().astype(int) for count in (SAMPLES, ACROSS))
    points = fit.points_mm.reshape(SAMPLES, ACROSS, 3)[np.ix_(along, across)]
    normals = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    right, up = (np.array(axis, float) for axis in SIDES[at])
    # a cross product may point inward: outward is where the side faces
    normals *= np.sign((normals @ np.cross(right, up)).mean()) or 1.0
    return points + LIFT_MM * normals, normals


def _see(
    scene: "RaycastingScene", camera: Camera, T_world_camera: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> tuple[float, float]:
    """Share of the sheet that a camera sees, and the square pixels that this covers."""
    towards = T_world_camera[:3, 3] - points
    distance = np.linalg.norm(towards, axis=2, keepdims=True)
    rays = np.concatenate([points, towards / distance], axis=2)
    # nothing is met on the way to the camera
    is_free = cast_rays(scene, rays) >= distance[..., 0]
    pixels, depth = project(camera, T_world_camera, points.reshape(-1, 3))
    inside = ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1) & (depth > 0)
    seen = is_free & ((normals * towards).sum(axis=2) > 0) & inside.reshape(is_free.shape)
    x, y = pixels.reshape(*is_free.shape, 2).transpose(2, 0, 1)
    fall, rise = (x[1:, 1:] - x[:-1, :-1], y[1:, 1:] - y[:-1, :-1]), (x[1:, :-1] - x[:-1, 1:], y[1:, :-1] - y[:-1, 1:])
    cells = np.abs(fall[0] * rise[1] - fall[1] * rise[0]) / 2  # a quadrilateral, by its diagonals
    # a square counts by how many of its corners are seen
    corners = np.stack([seen[:-1, :-1], seen[1:, :-1], seen[:-1, 1:], seen[1:, 1:]]).mean(axis=0)
    return float(seen.mean()), float((cells * corners).sum())


def _pick(places: Sequence[Place], size_mm: float, count: int) -> list[Place]:
    """The best of a size whose sheets do not overlap."""
    chosen: list[Place] = []
    for place in (found for found in places if found.mount.size_mm == size_mm):
        middle = place.fit.points_mm.mean(axis=0)
        apart = [np.linalg.norm(middle - other.fit.points_mm.mean(axis=0)) for other in chosen]
        if len(chosen) < count and all(distance >= size_mm + 2 * TAPE_MARGIN_MM for distance in apart):
            chosen.append(place)
    return chosen
