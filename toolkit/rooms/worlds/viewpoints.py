"""Cameras that see much of a world: in the street, at roofs and in the air, and a flight through it.

Places of still cameras are drawn by the seed, what is seen from each is found with few rays, and the best are taken.
The flight goes down from the air, along the streets, and up again. Its way is found on a grid of places and heights
with known distances from surfaces.
"""

from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import load_open3d
from toolkit.rig.camera import Camera, look_at, orbit_direction, pixel_rays
from toolkit.rooms.worlds.world import STANDING, SceneClass, World

FOV_DEG = 68.0
PROBE = Camera.from_fov(32, 18, FOV_DEG)
"""The camera that judges each place."""
YAWS = 8
HEADROOM_M = 1.2
"""A camera keeps so far from everything."""


@dataclass(frozen=True)
class Level:
    """A height to look from."""

    height_m: tuple[float, float]  # above the ground, lowest and highest
    pitch_deg: tuple[float, float]  # of the look, lowest and highest; below 0 it looks down
    sky: float  # share of the picture that is best sky
    close_m: float  # what is nearer, ground aside, stands in the way
    places: int = 160  # how many are tried
    full_m: float = 0.0  # side of a world below which it is lower in proportion; 0 is never

    def within(self, world: World) -> "Level":
        """The same for a world that is smaller than `full_m`: lower in proportion."""
        share = min(1.0, float(np.ptp(world.core, axis=0).max()) / self.full_m) if self.full_m else 1.0
        low, high = self.height_m
        return replace(self, height_m=(share * low, share * high), close_m=share * self.close_m)


LEVELS = {
    "street": Level((1.6, 1.8), (0.0, 6.0), 0.25, 6.0),
    "roof": Level((11.0, 22.0), (-13.0, -6.0), 0.2, 16.0),
    "air": Level((55.0, 85.0), (-22.0, -16.0), 0.15, 40.0, 80, 200.0),
}


@dataclass(frozen=True)
class Viewpoint:
    """A camera's place that was chosen."""

    name: str  # `street`, `roof` or `air`
    T_world_camera: np.ndarray  # (4, 4) its pose, metres

    @property
    def position(self) -> np.ndarray:
        """(3,) metres."""
        return self.T_world_camera[:3, 3]


def choose_viewpoints(world: World, seed: int = 0) -> tuple[Viewpoint, ...]:
    """The best view of each of `LEVELS` that has room for a camera.

    Raises:
        ToolkitError: nowhere in the world is there room for a camera.
    """
    chosen: list[Viewpoint] = []
    for number, (name, level) in enumerate(LEVELS.items()):
        level = level.within(world)
        rng = np.random.default_rng([seed, 60, number])
        places = find_places(world, level, rng)
        if len(places):
            chosen.append(Viewpoint(name, _choose_pose(world, level, places, rng)))
    if not chosen:
        raise ToolkitError(f"{world.name}: nowhere is there room for a camera: does the world have open space?")
    return tuple(chosen)


def find_places(world: World, level: Level, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) up to `level.places` places at its height over the world's core, clear of everything."""
    middle, half = world.core.mean(axis=0), np.ptp(world.core, axis=0) / 2
    at = middle + rng.uniform(-0.92, 0.92, (4 * level.places, 2)) * half
    points = np.column_stack([at, world.ground_height(at) + rng.uniform(*level.height_m, len(at))])
    points = points[np.isfinite(points[:, 2])]
    # inside a wall nothing is near, so that distance alone would not find it out
    points = points[~world.inside_building(points)]
    return points[clearance(world, points) > HEADROOM_M][: level.places]


def clearance(world: World, points: np.ndarray) -> np.ndarray:
    """(n,) distance of points (n, 3) from the nearest surface, metres."""
    o3d = load_open3d()

    return world.shape.rays.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def _choose_pose(world: World, level: Level, places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The best pose (4, 4) at any of the places."""
    # each place looks in its own random direction and slope, then in seven others around
    turn = rng.uniform(0, 360, len(places))
    pitch = rng.uniform(*level.pitch_deg, len(places))
    best: list[np.ndarray] = []
    score = np.full(len(places), -np.inf)
    for k, place in enumerate(places):
        poses = [
            look_at(place, place + orbit_direction(turn[k] + 360 * j / YAWS, pitch[k])) for j in range(YAWS)
        ]  # fmt: skip
        marks = rate_views(world, poses, level)
        best.append(poses[int(marks.argmax())])
        score[k] = marks.max()
    return best[int(score.argmax())]


def rate_views(world: World, poses: list[np.ndarray], level: Level) -> np.ndarray:
    """(n,) how much views show: many classes and looks at many distances, some sky, nothing right before the lens."""
    o3d = load_open3d()

    x, y = np.meshgrid(np.arange(PROBE.width) + 0.5, np.arange(PROBE.height) + 0.5)
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
    rays = np.stack([pixel_rays(PROBE, pose, pixels) for pose in poses])
    hit = world.shape.rays.cast_rays(o3d.core.Tensor(rays))
    way, face = hit["t_hit"].numpy(), hit["primitive_ids"].numpy()
    return np.array([_rate(world, *view, level) for view in zip(rays, way, face, strict=True)])


def _rate(world: World, rays: np.ndarray, way: np.ndarray, face: np.ndarray, level: Level) -> float:
    met = np.isfinite(way)
    if not met.any():
        return -np.inf
    kinds, total = world.face_class[face[met]], len(way)
    share = np.bincount(kinds, minlength=len(SceneClass)) / total
    standing = [int(kind) for kind in STANDING]
    things = np.delete(share, standing)
    seen = things[things > 0.01]
    # entropy of the classes in the picture: many, in even shares
    variety = -float((seen * np.log(seen)).sum())
    # how many materials show, ground aside; a material that fills over a fifth is a wall before the lens
    look = np.unique(
        world.mesh.face_material[face[met & ~np.isin(world.face_class[np.where(met, face, 0)], standing)]],
        return_counts=True,
    )[1]
    looks = 0.35 * float(np.log(max(len(look), 1))) - 2.0 * max(float(look.max(initial=0)) / total - 0.2, 0.0)
    # near and far together make depth
    spread = min(float(np.log(way[met]).std()), 1.5)
    places = rays[met, :2] + way[met, None] * rays[met, 3:5]
    # what lies beyond the core is a backdrop
    home = float(((places > world.core[0]) & (places < world.core[1])).all(axis=1).sum()) / total
    close = float(((way[met] < level.close_m) & ~np.isin(kinds, standing)).sum()) / total
    bare = max(float(share[standing].sum()) - 0.45, 0.0)
    sky = abs(1 - float(met.mean()) - level.sky)
    # what stands right before the lens costs most
    return variety + looks + 0.5 * spread + home - 2.0 * sky - 1.5 * bare - 6.0 * close


HEIGHTS_M = (2.6, 4.0, 6.0, 9.0, 13.0, 19.0, 28.0, 40.0, 55.0, 75.0)
ACROSS = 120
"""Places of the grid along the longer side of a world's core."""
ROOM_M = (0.9, 2.5)
"""A camera's distance from everything: at least, and what it likes."""
LOW_IS_DEAR = 0.05
SMOOTH_M = (9.0, 6.0, 4.0, 2.5, 1.5, 0.0)
AHEAD_M = 24.0
STEEPEST = 0.55
"""Most that a camera looks up or down, as a slope."""


@dataclass(frozen=True)
class Flight:
    """A path through the air."""

    points: np.ndarray  # (n, 3) about a metre apart

    @property
    def length_m(self) -> float:
        """Length of the path, metres."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def poses(self, count: int) -> list[np.ndarray]:
        """`count` cameras (4, 4) along it, slower where it is low, each looking along what lies ahead."""
        step = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        at = np.concatenate([[0.0], np.cumsum(step)])
        height = self.points[:, 2] - self.points[:, 2].min()
        # high up the ground moves slowly, so that the camera may fly faster
        pace = 1 + height / 15
        moment = np.concatenate([[0.0], np.cumsum(step / ((pace[1:] + pace[:-1]) / 2))])
        ease = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0, 1, count))
        time = (0.75 * np.linspace(0, 1, count) + 0.25 * ease) * moment[-1]
        way = np.interp(time, moment, at)
        places = self.on(way)
        # the look ahead is smoothed in time, the path itself in space
        onwards = smooth(self.on(way + AHEAD_M) - places, count / 30)
        flat = np.linalg.norm(onwards[:, :2], axis=1)
        onwards[:, 2] = np.clip(onwards[:, 2], -STEEPEST * flat, 0.35 * STEEPEST * flat)
        return [look_at(place, place + towards) for place, towards in zip(places, onwards, strict=True)]

    def on(self, way: np.ndarray) -> np.ndarray:
        """(n, 3) points after so many metres; beyond the end straight on."""
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])
        found = np.stack([np.interp(way, at, self.points[:, k]) for k in range(3)], axis=1)
        end = self.points[-1] - self.points[-min(8, len(self.points))]
        end /= max(float(np.linalg.norm(end)), 1e-9)
        return found + np.maximum(way - at[-1], 0)[:, None] * end


def smooth(values: np.ndarray, sigma: float) -> np.ndarray:
    """(n, c) values along a line, blurred; both ends stay where they are."""
    from scipy.ndimage import gaussian_filter1d

    if sigma <= 0:
        return values.copy()
    line = np.linspace(values[0], values[-1], len(values))
    return line + gaussian_filter1d(values - line, sigma, axis=0, mode="constant")


def plan_flight(world: World, viewpoints: tuple[Viewpoint, ...], seed: int = 0) -> Flight:
    """From the air over the places of street views and up again, the last place first seen from far away.

    Raises:
        ToolkitError: there is no way from a place to the next.
    """
    grid = _Grid.over(world)
    streets = [viewpoint for viewpoint in viewpoints if viewpoint.name.startswith("street")] or list(viewpoints)
    middle = np.append(world.core.mean(axis=0), 0.0)
    half = np.append(np.ptp(world.core, axis=0) / 2, 0.0)
    rng = np.random.default_rng([seed, 61])
    # high over a corner of the core at the start, and over the opposite corner at the end
    corner = half * [*rng.choice([-0.55, 0.55], 2), 0]
    rise = min(HEIGHTS_M[-2], 0.35 * float(half.max()) + 12)
    stops = [
        middle + corner + [0, 0, rise],
        *(street.position for street in streets),
        middle - corner + [0, 0, 0.7 * rise],
    ]
    # streets by their distance from the start: the film does not fly back and forth
    order = [0, *sorted(range(1, len(stops) - 1), key=lambda k: float(np.linalg.norm(stops[k] - stops[0]))), -1]
    # from stop to stop through free cells, then a point a metre
    nodes = [grid.nearest(stops[k]) for k in order]
    way = [nodes[0]]
    for goal in nodes[1:]:
        way += grid.lead(way[-1], goal)
    points = grid.points[way]
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(step)])
    fine = np.linspace(0, at[-1], max(int(at[-1]), 2))
    line = np.stack([np.interp(fine, at, points[:, k]) for k in range(3)], axis=1)
    # as smooth as leaves the camera room: a smoother path cuts corners
    for sigma in SMOOTH_M:
        path = smooth(line, sigma)
        if clearance(world, path).min() > 0.6 * ROOM_M[0]:
            break
    return Flight(path)


@dataclass(frozen=True)
class _Grid:
    """Places (n, 3) where a camera fits, and the ways between neighbours."""

    points: np.ndarray
    ways: object

    @classmethod
    def over(cls, world: World) -> "_Grid":
        """Return the grid over a world's core, at `HEIGHTS_M` above its ground."""
        from scipy.sparse import coo_array

        low, high = world.core
        step = max(float((high - low).max()) / ACROSS, 1.0)
        x, y = (np.arange(low[k] + step / 2, high[k], step) for k in (0, 1))
        flat = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
        ground = np.nan_to_num(world.ground_height(flat), nan=0.0)
        points = np.concatenate([np.column_stack([flat, ground + height]) for height in HEIGHTS_M])
        room = clearance(world, points)
        free = (room > ROOM_M[0]) & ~world.inside_building(points)
        shape = (len(HEIGHTS_M), len(x), len(y))
        number = np.arange(len(points)).reshape(shape)
        # air near walls costs more, and so does height: the film shall be among the houses
        cost_at = (1 + 2 * np.maximum(ROOM_M[1] - room, 0) ** 2) * (1 + LOW_IS_DEAR * (points[:, 2] - ground.min()))
        starts, ends, costs = [], [], []
        # half of the 26 neighbours: each way serves both directions
        for move in [(a, b, c) for a in (0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1) if (a, b, c) > (0, 0, 0)]:
            near, other = (number[_shifted(move, shape, side)].reshape(-1) for side in (0, 1))
            usable = free[near] & free[other]
            near, other = near[usable], other[usable]
            length = np.linalg.norm(points[near] - points[other], axis=1)
            starts.append(near)
            ends.append(other)
            costs.append(length * (cost_at[near] + cost_at[other]) / 2)
        # graphs of SciPy 1.13 take no numbers of 64 bits
        pairs = tuple(np.concatenate(indices).astype(np.int32) for indices in (starts, ends))
        ways = coo_array((np.concatenate(costs), pairs), (len(points), len(points))).tocsr()
        points = np.where(free[:, None], points, np.inf)
        return cls(points, ways)

    def nearest(self, place: np.ndarray) -> int:
        """Return the number of the nearest free place to a point."""
        gap = np.linalg.norm(np.where(np.isfinite(self.points), self.points, 1e9) - place, axis=1)
        return int(gap.argmin())

    def lead(self, start: int, goal: int) -> list[int]:
        """Numbers of the places on the cheapest way, `start` left out."""
        from scipy.sparse.csgraph import dijkstra

        _, before = dijkstra(self.ways, directed=False, indices=start, return_predecessors=True)
        way, at = [], goal
        while at != start:
            if at < 0:
                raise ToolkitError("no free flight path was found between two of the cameras")
            way.append(at)
            at = int(before[at])
        return way[::-1]


def _shifted(move: tuple[int, int, int], shape: tuple[int, int, int], side: int) -> tuple[slice, ...]:
    """The part of a grid that has a neighbour in a direction, or those neighbours."""
    return tuple(
        slice(max(-m, 0) if side == 0 else max(m, 0), n - max(m, 0) if side == 0 else n - max(-m, 0))
        for m, n in zip(move, shape, strict=True)
    )
