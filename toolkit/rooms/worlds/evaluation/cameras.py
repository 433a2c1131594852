"""The grid of cameras around an object in a world: where they stand, which of them can, and what they see of it."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import cast_rays, load_open3d
from toolkit.rig.camera import Camera, look_at, pixel_rays, project
from toolkit.rig.lighting import Shape
from toolkit.rooms.worlds.evaluation import GridShape
from toolkit.rooms.worlds.place import Placed
from toolkit.rooms.worlds.world import World

LOWEST = 0.1
"""Height of the lowest cameras above the object's ground, in object lengths."""
NEAREST = 0.75
"""A camera nearer to the object's middle than so many lengths is inside it, or sees a part of it at best."""
CLEARANCE_M, CLEARANCE = 0.3, 0.08
"""Nearer to any surface, in metres or object lengths, whichever is less, a camera would touch it."""
IN_WALL, BELOW, OUTSIDE, TOO_NEAR, TOUCHING, FAILED = (
    "inside a building", "below the ground", "outside the world", "inside the object or too near it",
    "touching something", "its pictures failed",
)  # fmt: skip
REASONS = (IN_WALL, BELOW, OUTSIDE, TOO_NEAR, TOUCHING, FAILED)
LATTICE = 48
"""Rays along each side of the object's outline that tell how much of it is seen."""
HIDDEN = 0.01
"""A smaller share of the object counts as hidden."""


@dataclass(frozen=True)
class GridCamera:
    """A camera of the grid."""

    number: int  # of its point in the grid, from 1; up changes first, then across
    T_world_camera: np.ndarray  # (4, 4) pose, metres; it looks at the middle of the object
    azimuth_deg: float  # around the object, 0 at its front, counter-clockwise from above, [0, 360)
    elevation_deg: float  # above the object's middle
    distance_m: float  # from the object's middle
    visible_share: float  # of the object's outline that nothing hides, in [0, 1]
    picture_share: float  # of the picture that the object would cover if nothing hid it, in [0, 1]

    @property
    def is_hidden(self) -> bool:
        """Whether nothing of the object is to be seen."""
        return self.visible_share < HIDDEN


@dataclass(frozen=True)
class PlaceCameras:
    """The cameras at a place."""

    placed: Placed
    cameras: tuple[GridCamera, ...]  # those that are shot, by number
    points: np.ndarray  # (n, 3) positions of the whole grid, metres
    reasons: tuple[str, ...]  # of each point, why no camera stands there; empty if a camera can

    def without(self, failed: Collection[int]) -> "PlaceCameras":
        """Without the cameras of these numbers, whose pictures failed."""
        reasons = [FAILED if k + 1 in failed else reason for k, reason in enumerate(self.reasons)]
        return replace(
            self,
            cameras=tuple(camera for camera in self.cameras if camera.number not in failed),
            reasons=tuple(reasons),
        )

    @property
    def left_out(self) -> dict[str, int]:
        """How many points of the grid have no camera, by reason."""
        counts = Counter(self.reasons)
        return {reason: counts[reason] for reason in REASONS if counts[reason]}

    @property
    def standing(self) -> int:
        """How many points of the grid a camera can stand at."""
        return self.reasons.count("")


def lay_grid(shape: GridShape, extent_m: float, lowest_m: float) -> np.ndarray:
    """(n, 3) points around an object in its own frame, metres: x along it, y across, z up from its ground.

    Args:
        shape: how many along, across and up; a single point stands in the middle.
        extent_m: x and y from minus to plus this, z up to it.
        lowest_m: least z.
    """
    along, across, up = shape
    x, y = (np.linspace(-extent_m, extent_m, count) if count > 1 else np.zeros(1) for count in (along, across))
    z = np.linspace(lowest_m, extent_m, up) if up > 1 else np.array([lowest_m])
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)


def plan_cameras(
    world: World, placed: Placed, camera: Camera, shape: GridShape, extent: float, sample: int | None,
    rng: np.random.Generator,
) -> PlaceCameras:  # fmt: skip
    """Every camera of the grid that can stand, or a sample of them.

    Args:
        camera: its pixels and field of view.
        shape, extent: of the grid; `extent` in object lengths.
        sample: how many are drawn from those that can stand; a larger sample contains the smaller. None takes all.

    Raises:
        ToolkitError: none can stand; the message counts why.
    """
    # distances are in object lengths, so a small and a large object get the same grid
    length = float(np.ptp(placed.mesh.bounds, axis=0).max())
    points = placed.stand.to_world(lay_grid(shape, extent * length, LOWEST * length))
    reasons = find_reasons(world, placed, points, NEAREST * length, min(CLEARANCE_M, CLEARANCE * length))
    standing = np.flatnonzero([not reason for reason in reasons])
    if not len(standing):
        counts = Counter(reasons)
        why = ", ".join(f"{counts[reason]} {reason}" for reason in REASONS if counts[reason])
        raise ToolkitError(
            f"no camera of the {len(points)} around '{placed.spot.name}' can stand: {why}: widen the extent, or "
            "draw other places with another seed"
        )
    # a prefix of a permutation: a larger sample contains a smaller sample of the same seed
    chosen = standing if sample is None else np.sort(rng.permutation(standing)[:sample])
    seen = Shape.of(placed.mesh)
    cameras = tuple(_aim(world, placed, seen, camera, int(k), points[k]) for k in chosen)
    return PlaceCameras(placed, cameras, points, tuple(reasons))


def find_reasons(
    world: World, placed: Placed, points: np.ndarray, nearest_m: float, clearance_m: float = CLEARANCE_M
) -> list[str]:
    """Return for each point (n, 3) why no camera can stand there; empty if a camera can."""
    o3d = load_open3d()

    ground = world.ground_height(points)
    gap = world.shape.rays.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()
    # in the object's own frame: its triangles stay where they are
    local = (points - placed.stand.place) @ placed.stand.turn
    to_object = Shape.of(placed.mesh).rays.compute_distance(o3d.core.Tensor(local.astype(np.float32))).numpy()
    near = np.linalg.norm(points - placed.centre, axis=1) < nearest_m
    low, high = world.bounds[:, :2]
    outside = ((points[:, :2] < low) | (points[:, :2] > high)).any(axis=1)
    checks = (
        (IN_WALL, world.inside_building(points)), (BELOW, points[:, 2] < ground), (OUTSIDE, outside),
        (TOO_NEAR, near | (to_object < clearance_m)), (TOUCHING, gap < clearance_m),
    )  # fmt: skip
    reasons = np.full(len(points), "", object)
    # last the first: of several reasons the first of `checks` is told
    for reason, holds in reversed(checks):
        reasons[holds] = reason
    return reasons.tolist()


def _aim(world: World, placed: Placed, shape: Shape, camera: Camera, index: int, position: np.ndarray) -> GridCamera:
    centre = placed.centre
    # rounded, as it goes into hashes and files
    pose = np.round(look_at(position, centre), 9)
    away = (position - centre) @ placed.stand.turn
    distance = float(np.linalg.norm(away))
    visible, covered = measure_sight(world, placed, shape, camera, pose)
    return GridCamera(
        number=index + 1,
        T_world_camera=pose,
        azimuth_deg=round(float(np.degrees(np.arctan2(away[1], away[0]))) % 360, 3),
        elevation_deg=round(float(np.degrees(np.arcsin(np.clip(away[2] / distance, -1, 1)))), 3),
        distance_m=round(distance, 4),
        visible_share=round(visible, 4),
        picture_share=round(covered, 5),
    )


def measure_sight(
    world: World, placed: Placed, shape: Shape, camera: Camera, T_world_camera: np.ndarray
) -> tuple[float, float]:
    """Share of the object in the picture that nothing hides, and share of the picture that its outline covers."""
    pixels, depth = project(camera, T_world_camera, placed.stand.to_world(shape.outline))
    frame = np.array([camera.width, camera.height], float)
    ahead = pixels[depth > 0]
    # rays only over the object's box: a small object gets as many as a large object
    low, high = (np.clip(corner, 0, frame) for corner in (ahead.min(axis=0), ahead.max(axis=0)))
    if not len(ahead) or (high - low).min() <= 0:
        return 0.0, 0.0
    # a lattice of rays over the box of the object's outline in the picture
    steps = (np.arange(LATTICE) + 0.5) / LATTICE
    x, y = np.meshgrid(low[0] + steps * (high[0] - low[0]), low[1] + steps * (high[1] - low[1]))
    rays = pixel_rays(camera, T_world_camera, np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float32))
    # rays are turned into the object's frame, not its mesh into the world: a single ray scene serves all places
    local = np.concatenate(
        [(rays[:, :3] - placed.stand.place) @ placed.stand.turn, rays[:, 3:] @ placed.stand.turn], axis=1
    ).astype(np.float32)
    way = cast_rays(shape.rays, local)
    met = np.isfinite(way)
    if not met.any():
        return 0.0, 0.0
    # hidden where the world is met before the object
    before = cast_rays(world.shape.rays, rays[met]) < way[met]
    return float(1 - before.mean()), float(met.mean() * (high - low).prod() / frame.prod())


def count_cameras(places: Sequence[PlaceCameras]) -> dict[str, int]:
    """Return counts over all places: grid points, cameras shot, cameras without the object in view, left out."""
    left_out: Counter[str] = Counter()
    for place in places:
        left_out.update(place.left_out)
    return {
        "points": sum(len(place.points) for place in places),
        "standing": sum(place.standing for place in places),
        "shot": sum(len(place.cameras) for place in places),
        "hidden": sum(camera.is_hidden for place in places for camera in place.cameras),
        **{f"left out: {reason}": left_out[reason] for reason in REASONS if left_out[reason]},
    }
