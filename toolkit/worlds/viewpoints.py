"""Where a camera sees much of a world: from the street, from the height of roofs, from the air; of any world.

Places are drawn by the seed, what is seen from each is found with few rays, and the best are taken.
"""

from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, look_at, orbit_direction, pixel_rays
from toolkit.worlds.classes import STANDING, SceneClass
from toolkit.worlds.world import World

FOV_DEG = 68.0
PROBE = Camera.from_fov(32, 18, FOV_DEG)
"""What each place is judged by."""
YAWS = 8
HEADROOM_M = 1.2
"""A camera keeps so far from everything."""


@dataclass(frozen=True)
class Level:
    """A height to look from.

    Attributes:
        height_m: above the ground, lowest and highest.
        pitch_deg: of the look, lowest and highest; below 0 it looks down.
        sky: share of the picture that is best sky.
        close_m: what is nearer, ground aside, stands in the way.
        places: how many are tried.
        full_m: side of a world below which it is lower in proportion; 0 is never.
    """

    height_m: tuple[float, float]
    pitch_deg: tuple[float, float]
    sky: float
    close_m: float
    places: int = 160
    full_m: float = 0.0

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
    """A camera's place that was chosen.

    Attributes:
        name: `street`, `roof`, `air`, or `street-2` and so on.
        T_world_camera: (4, 4) its pose, metres.
    """

    name: str
    T_world_camera: np.ndarray

    @property
    def position(self) -> np.ndarray:
        """(3,) metres."""
        return self.T_world_camera[:3, 3]


def choose_viewpoints(world: World, seed: int = 0, each: int = 1) -> tuple[Viewpoint, ...]:
    """The best view of each of `LEVELS`, and further ones from elsewhere where more than one is asked for.

    Raises:
        ToolkitError: nowhere in the world is there room for a camera.
    """
    chosen: list[Viewpoint] = []
    for number, (name, level) in enumerate(LEVELS.items()):
        level = level.within(world)
        rng = np.random.default_rng([seed, 60, number])
        places = find_places(world, level, rng)
        if not len(places):
            continue
        poses, score = _judge(world, level, places, rng)
        found: list[Viewpoint] = []
        for k in np.argsort(-score, kind="stable"):
            apart = 0.25 * float(np.ptp(world.core, axis=0).max())
            if all(np.linalg.norm(poses[k][:3, 3] - one.position) > apart for one in found):
                found.append(Viewpoint(name if not found else f"{name}-{len(found) + 1}", poses[k]))
            if len(found) == each:
                break
        chosen += found
    if not chosen:
        raise ToolkitError(f"{world.name}: nowhere is there room for a camera: is the world one closed block?")
    return tuple(chosen)


def find_places(world: World, level: Level, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) up to `level.places` places at its height over the world's core, clear of everything."""
    middle, half = world.core.mean(axis=0), np.ptp(world.core, axis=0) / 2
    at = middle + rng.uniform(-0.92, 0.92, (4 * level.places, 2)) * half
    points = np.column_stack([at, world.ground_height(at) + rng.uniform(*level.height_m, len(at))])
    points = points[np.isfinite(points[:, 2])]
    points = points[~world.inside_building(points)]
    return points[clearance(world, points) > HEADROOM_M][: level.places]


def clearance(world: World, points: np.ndarray) -> np.ndarray:
    """(n,) distance of points (n, 3) from the nearest surface, metres."""
    import open3d as o3d

    return world.shape.rays.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def _judge(
    world: World, level: Level, places: np.ndarray, rng: np.random.Generator
) -> tuple[list[np.ndarray], np.ndarray]:
    """The best pose at each place, and (n,) how good it is."""
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
    return best, score


def rate_views(world: World, poses: list[np.ndarray], level: Level) -> np.ndarray:
    """(n,) how much views show: many classes and looks at many distances, some sky, nothing right before the lens."""
    import open3d as o3d

    x, y = np.meshgrid(np.arange(PROBE.width) + 0.5, np.arange(PROBE.height) + 0.5)
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
    rays = np.stack([pixel_rays(PROBE, pose, pixels) for pose in poses])
    hit = world.shape.rays.cast_rays(o3d.core.Tensor(rays))
    way, face = hit["t_hit"].numpy(), hit["primitive_ids"].numpy()
    return np.array([_rate(world, *one, level) for one in zip(rays, way, face, strict=True)])


def _rate(world: World, rays: np.ndarray, way: np.ndarray, face: np.ndarray, level: Level) -> float:
    met = np.isfinite(way)
    if not met.any():
        return -np.inf
    kinds, total = world.face_class[face[met]], len(way)
    share = np.bincount(kinds, minlength=len(SceneClass)) / total
    standing = [int(one) for one in STANDING]
    things = np.delete(share, standing)
    seen = things[things > 0.01]
    variety = -float((seen * np.log(seen)).sum())
    look = np.unique(
        world.mesh.face_material[face[met & ~np.isin(world.face_class[np.where(met, face, 0)], standing)]],
        return_counts=True,
    )[1]
    looks = 0.35 * float(np.log(max(len(look), 1))) - 2.0 * max(float(look.max(initial=0)) / total - 0.2, 0.0)
    spread = min(float(np.log(way[met]).std()), 1.5)
    places = rays[met, :2] + way[met, None] * rays[met, 3:5]
    home = float(((places > world.core[0]) & (places < world.core[1])).all(axis=1).sum()) / total
    close = float(((way[met] < level.close_m) & ~np.isin(kinds, standing)).sum()) / total
    bare = max(float(share[standing].sum()) - 0.45, 0.0)
    sky = abs(1 - float(met.mean()) - level.sky)
    return variety + looks + 0.5 * spread + home - 2.0 * sky - 1.5 * bare - 6.0 * close
