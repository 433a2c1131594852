"""Light that does not change with the camera, worked out once per scene and stored on the mesh.

Occlusion depends on the shape alone and is kept with it: another room or paint costs a sum.
"""

from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import cv2
import numpy as np

from toolkit.core.cache import keep_arrays
from toolkit.imaging.colour import srgb_to_linear
from toolkit.objects.mesh import Mesh, hash_triangles, load_open3d, make_ray_scene
from toolkit.rig.camera import orbit_direction
from toolkit.rig.kernel.light import gather_key, gather_light, make_shadow_rays
from toolkit.rig.scene import AT_ORIGIN, KeyLight, Scene, Stand, Table
from toolkit.rig.textures import blur_directions, pad_channels, sample_directions

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

MAX_STEPS = 48
SHEET_MM = 0.1
"""Surfaces further apart than this, along their normal, do not share samples."""


@dataclass(frozen=True)
class SampleIndex:
    """Places of the stored samples of a mesh."""

    steps: np.ndarray  # (m,) R of each triangle
    first: np.ndarray  # (m,) index of its first sample


@dataclass(frozen=True)
class SampleGrid(SampleIndex):
    """The samples of a mesh."""

    positions: np.ndarray  # (n, 3) world points of the distinct samples, mm
    normals: np.ndarray  # (n, 3) unit
    # (k,) the distinct sample behind each of the k stored samples; neighbours share those on common edges
    slot: np.ndarray


SHARED = 0.2


def index_samples(corners: np.ndarray, spacing_mm: float) -> SampleIndex:
    """How many samples about `spacing_mm` apart each of the triangles (m, 3, 3) has."""
    # a triangle is cut into R² smaller ones, R by its longest edge: long thin ones get more than they need
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(edges / spacing_mm), 1, MAX_STEPS).astype(np.int64)
    counts = _count_samples(steps)
    return SampleIndex(steps, np.cumsum(counts) - counts)


def _count_samples(steps: np.ndarray) -> np.ndarray:
    """Corners of R² small triangles: a triangular number."""
    counts: np.ndarray = (steps + 1) * (steps + 2) // 2
    return counts


def place_samples(
    corners: np.ndarray, corner_normals: np.ndarray, spacing_mm: float, shared: float = SHARED
) -> SampleGrid:
    """Spread samples about `spacing_mm` apart over triangles (m, 3, 3) with corner normals (m, 3, 3).

    Those closer than `shared` of that, on surfaces that face alike, share a value.
    """
    index = index_samples(corners, spacing_mm)
    steps, first = index.steps, index.first
    total = int(_count_samples(steps).sum())
    positions, normals = np.empty((total, 3), np.float32), np.empty((total, 3), np.float32)
    # triangles of one R share their weights, so that few large sums are made of many small ones
    for r in np.unique(steps):
        faces = np.flatnonzero(steps == r)
        weights = _barycentric_grid(int(r))
        places = (first[faces][:, None] + np.arange(len(weights))).reshape(-1)
        positions[places] = np.einsum("kc,fcx->fkx", weights, corners[faces]).reshape(-1, 3)
        normals[places] = np.einsum("kc,fcx->fkx", weights, corner_normals[faces]).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    # samples with the same cell, direction and plane share a value: seams show no step, and rays are saved
    cell = shared * spacing_mm
    # distance of the sample's plane from the origin
    depth = np.einsum("nx,nx->n", positions, normals)[:, None]  # a sheet does not share the wall's light
    key = np.concatenate([positions / cell, normals * 8, depth / SHEET_MM], axis=1).round().astype(np.int64)
    packed = (key.view(np.uint64) * _MIX).sum(axis=1, dtype=np.uint64)  # wraps: a hash of 64 bits
    _, kept, slot = np.unique(packed, return_index=True, return_inverse=True)
    order = np.argsort(kept)  # neighbours stay side by side, which rays are fastest at
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    kept, slot = kept[order], rank[slot.reshape(-1)]
    return SampleGrid(steps, first, positions[kept], normals[kept], slot)


# odd factors: multiplying by them loses no bit of a 64-bit key
_MIX = np.random.default_rng(0).integers(1, 2**63, 7, dtype=np.uint64) | np.uint64(1)


def _barycentric_grid(r: int) -> np.ndarray:
    """((r + 1)(r + 2) / 2, 3) weights, row j from 0, column i from 0."""
    # in the order in which `find_samples` counts them
    rows = [np.stack([np.arange(r + 1 - j), np.full(r + 1 - j, j)], axis=1) for j in range(r + 1)]
    ij = np.concatenate(rows) / r
    return np.column_stack([1 - ij.sum(axis=1), ij]).astype(np.float32)


MAX_TABLE_SIDE = 280
OFFSET = 0.0012
BOUNCE = 0.45
"""Share of the open table's light that a blocked direction still brings, times the albedo of what blocks it."""


@dataclass(frozen=True)
class BakeDetail:
    """How finely light is worked out."""

    key_rays: int = 24  # key_rays, room_rays: directions to the key light's disc and to the room
    room_rays: int = 96
    # surface_spacing, table_spacing: distance between samples as a share of the object's longest side
    surface_spacing: float = 0.016
    table_spacing: float = 0.015


FULL_DETAIL = BakeDetail()


class Shape:
    """A mesh's triangles as rays and light see them, whatever is painted on them; `of` keeps the last few.

    Attributes:
        mesh: the triangles.
        bounds: (2, 3) lowest and highest coordinates.
        size: its longest side.
        rays: Open3D's scene of the triangles.
    """

    MOST_KEPT = 6
    _known: ClassVar["OrderedDict[str, Shape]"] = OrderedDict()
    _keeping: ClassVar[Lock] = Lock()

    def __init__(self, mesh: Mesh) -> None:
        self.mesh, self.bounds = mesh, mesh.bounds
        self.size = float(np.ptp(self.bounds, axis=0).max())
        self.rays: RaycastingScene = make_ray_scene(mesh)
        self._lock = Lock()
        self._grids: dict[float, SampleGrid] = {}
        self._free: OrderedDict[tuple[int, bytes], np.ndarray] = OrderedDict()

    @classmethod
    def of(cls, mesh: Mesh) -> "Shape":
        """The shape of a mesh, from the known shapes if it is among them."""
        key = hash_triangles(mesh)
        with cls._keeping:
            shape = cls._known.pop(key, None) or cls(mesh)
            cls._known[key] = shape
            while len(cls._known) > cls.MOST_KEPT:
                cls._known.popitem(last=False)
        return shape

    @cached_property
    def outline(self) -> np.ndarray:
        """(k, 3) vertices that bound every picture of it: its convex hull's, or all where it is flat."""
        o3d = load_open3d()
        points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(self.mesh.vertices.astype(np.float64)))
        try:
            # a pinhole picture keeps straight lines: the picture of the hull bounds that of the mesh
            return self.mesh.vertices[points.compute_convex_hull()[1]]
        except RuntimeError:
            return self.mesh.vertices

    def grid(self, spacing: float, shared: float = SHARED) -> SampleGrid:
        """Samples about `spacing` apart; see `place_samples`."""
        with self._lock:
            if spacing not in self._grids:
                faces = self.mesh.faces
                grid = place_samples(self.mesh.vertices[faces], self.mesh.normals[faces], spacing, shared)
                # only the last is kept: grids are large
                self._grids = {spacing: grid}
            return self._grids[spacing]

    def free(self, points: np.ndarray, normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """`find_free` at points (n, 3), kept for the next light."""
        # where light is free depends on places and directions, not on the light's colour
        key = (hash(points.tobytes()), directions.tobytes())
        with self._lock:
            found = self._free.pop(key, None)
            if found is None:
                found = find_free(self.rays, self.bounds, points, normals, directions)
            self._free[key] = found
            while len(self._free) > 4:
                self._free.popitem(last=False)
        return found


def find_free(
    rays: "RaycastingScene", bounds: np.ndarray, points: np.ndarray, normals: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """(d, n) uint8 at points: 0 where they look away from a direction, 1 where it is free, 2 where it is blocked.

    Args:
        bounds: (2, 3) of the same.
        points, normals: (n, 3) float32.
        directions: (d, 3) float32 unit.
    """
    o3d = load_open3d()

    free = np.empty((len(directions), len(points)), np.uint8)
    box = np.asarray(bounds, np.float32)
    which, shadow_rays = np.empty(len(points), np.int32), np.empty((len(points), 6), np.float32)
    for of_direction, direction in zip(free, directions, strict=True):
        count = make_shadow_rays(points, normals, direction, box, of_direction, which, shadow_rays)
        if count:
            # 1 where the point faces the light, and 1 more where the ray is stopped
            of_direction[which[:count]] += rays.test_occlusions(o3d.core.Tensor(shadow_rays[:count])).numpy()
    return free


@dataclass(frozen=True)
class Lighting:
    """Baked light."""

    grid: SampleIndex
    stored: np.ndarray  # (k, 5) irradiance RGB, share of the key light seen, share of the room seen
    # (h, w, 3) irradiance of the table over a square around the origin, image right +x, up +y; out of doors the share
    # of the sky's light that the object leaves the ground
    table: np.ndarray
    table_side_mm: float  # side of that square
    open_irradiance: np.ndarray  # (3,) of the table far from the object


@dataclass(frozen=True)
class _Directions:
    """Directions of light: (n, 3) unit, spread evenly over the sphere, and over the key light's disc.

    `room_radiance` (n, 3) arrives around each of the former, `key_irradiance` (3,) from each of the latter.
    """

    room: np.ndarray
    room_radiance: np.ndarray
    key: np.ndarray
    key_irradiance: np.ndarray


def bake_studio_light(shape: Shape, albedo: np.ndarray, scene: Scene, detail: BakeDetail = FULL_DETAIL) -> Lighting:
    """`bake_lighting` of an object on its table, kept on disk for runs that light the same shape alike."""

    def bake() -> dict[str, np.ndarray]:
        made = bake_lighting(shape, albedo, scene, detail)
        return {
            "stored": made.stored, "table": made.table, "side": np.array(made.table_side_mm),
            "open": made.open_irradiance,
        }  # fmt: skip

    # of the table's picture, light that bounces off it takes the mean colour alone
    ground = _mean_colour(scene.table)
    inputs = [hash_triangles(shape.mesh), albedo, scene.key, scene.environment, ground, detail]
    kept = keep_arrays("light", inputs, bake)
    # the samples need not be placed again: their light is known
    grid = index_samples(shape.mesh.vertices[shape.mesh.faces], detail.surface_spacing * shape.size)
    return Lighting(grid, kept["stored"], kept["table"], float(kept["side"]), kept["open"])


def bake_lighting(
    shape: Shape, albedo: np.ndarray, scene: Scene, detail: BakeDetail = FULL_DETAIL, stand: Stand = AT_ORIGIN,
    around: Shape | None = None,
) -> Lighting:  # fmt: skip
    """Work out all light that reaches an object and the ground near it, in the object's own frame.

    Args:
        albedo: (3,) mean linear colour of the object, and of what stands around it, for bounce.
        around: the scene's surroundings. The map of the ground then holds by how much the object dims the sky's light.
    """
    size, is_indoors = shape.size, around is None
    lights = _find_lights(scene, detail, stand)
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    open_irradiance = _open_light(up, lights)[0]
    bounce = (BOUNCE * albedo * open_irradiance / np.pi).astype(np.float32)

    # the map of the ground ends where the object no longer changes its light
    # the lower rim of the light throws the longest shadow, height / tan(elevation); below 5 degrees it is cut off
    shadow = float(shape.bounds[1, 2]) / np.tan(np.radians(max(scene.key.elevation_deg - scene.key.radius_deg, 5)))
    side = 2 * (0.75 * size + max(0.55 * size, float(shadow) if is_indoors else 0.0))
    count = min(round(side / size / detail.table_spacing), MAX_TABLE_SIDE)
    steps = (np.arange(count) + 0.5) / count * side - side / 2
    x, y = np.meshgrid(steps, -steps)
    # lifted off the ground, or rays would start below it by rounding
    points = np.stack([x, y, np.full_like(x, OFFSET * size)], axis=-1).reshape(-1, 3).astype(np.float32)
    open_ground, of_ground = open_irradiance, lights
    if not is_indoors:
        of_ground = replace(lights, key=lights.key[:0])  # its shadow is cast for each picture
        open_ground = _open_light(up, of_ground)[0]
    shade = _gather(shape, points, np.repeat(up, len(points), 0), of_ground, bounce, NO_GROUND)
    # a soft light is made of few directions, whose edges the blur hides
    table = cv2.GaussianBlur(shade[:, :3].reshape(count, count, 3), (0, 0), 0.8)
    # towards its rim the map becomes the open ground, or its square would show
    fade = np.clip((side / 2 - np.maximum(np.abs(x), np.abs(y))) / (0.15 * side), 0, 1)[..., None].astype(np.float32)
    table = (open_ground * (1 - fade) + table * fade).astype(np.float32)

    grid = shape.grid(detail.surface_spacing * size)
    # off the surface, or it would shade itself
    origins = grid.positions + grid.normals * np.float32(OFFSET * size)
    if around is None:
        values = _gather(
            shape, origins, grid.normals, lights, bounce, _Ground(pad_channels(table), side, _mean_colour(scene.table))
        )
        return Lighting(grid, values[grid.slot], table, side, open_irradiance)
    values = _gather(shape, origins, grid.normals, lights, bounce, NO_GROUND, (around, stand))
    # a share, as the ground out of doors has its own light and only loses some of it
    share = np.divide(table, open_ground, out=np.ones_like(table), where=open_ground > 1e-6 * open_irradiance.max())
    return Lighting(grid, values[grid.slot], share, side, open_irradiance)


SURROUNDING_SAMPLES = 250_000
"""About so many places of the surroundings have their light worked out."""
SURROUNDING_RAYS, SURROUNDING_SHARED = 48, 0.7


def bake_surroundings(shape: Shape, albedo: np.ndarray, scene: Scene) -> Lighting:
    """Work out the sky's light on what stands around an object; the key light's is found for each picture.

    Args:
        albedo: (3,) their mean linear colour, for bounce.
    """
    first, second, third = (shape.mesh.vertices[shape.mesh.faces[:, k]] for k in range(3))
    # half the cross product of two edges is a triangle's area
    area = float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum()) / 2
    # as many samples for a square as for a city: light costs the same, it is coarser
    spacing = max(float(np.sqrt(area / SURROUNDING_SAMPLES)), 1e-6 * shape.size)
    lights = _find_lights(scene, BakeDetail(key_rays=1, room_rays=SURROUNDING_RAYS), AT_ORIGIN)
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    # a matt surface sends out its irradiance times albedo / pi
    bounce = (BOUNCE * albedo * _open_light(up, lights)[0] / np.pi).astype(np.float32)
    grid = shape.grid(spacing, SURROUNDING_SHARED)
    origins = grid.positions + grid.normals * np.float32(0.02 * spacing)
    without_key = replace(lights, key=lights.key[:0])
    values = _gather(shape, origins, grid.normals, without_key, bounce, NO_GROUND)
    return Lighting(grid, values[grid.slot], np.ones((2, 2, 3), np.float32), 1.0, np.zeros(3, np.float32))


def _find_lights(scene: Scene, detail: BakeDetail, stand: Stand) -> _Directions:
    """Directions in the frame of an object that stands there, and what comes from each."""
    return _Directions(
        *_room_directions(scene.environment, detail.room_rays, stand.turn),
        _key_directions(scene.key, detail.key_rays, stand.turn_deg),
        np.array(scene.key.irradiance, np.float32) / detail.key_rays,
    )


class _Ground(NamedTuple):
    """Light from below: (t, t, 4) irradiance over a square of this side, and (3,) albedo; none if the side is 0."""

    irradiance: np.ndarray
    side: float
    albedo: np.ndarray


NO_GROUND = _Ground(np.zeros((2, 2, 4), np.float32), 0.0, np.zeros(3, np.float32))


def _gather(
    shape: Shape, points: np.ndarray, normals: np.ndarray, lights: _Directions, bounce: np.ndarray, ground: _Ground,
    around: tuple[Shape, Stand] | None = None,
) -> np.ndarray:  # fmt: skip
    """(n, 5) float32 irradiance RGB, key share and room share at points; `around` blocks as the shape itself does."""

    def find(directions: np.ndarray) -> np.ndarray:
        free = shape.free(points, normals, directions)
        if around is None or not len(directions):
            return free
        other, stand = around
        turn = stand.turn.astype(np.float32)
        in_world = stand.to_world(points).astype(np.float32)
        # blocked by either is blocked, 2; what looks away stays 0
        beyond = find_free(other.rays, other.bounds, in_world, normals @ turn.T, directions @ turn.T)
        return np.where(beyond == 2, np.minimum(free * 2, 2), free).astype(np.uint8)

    # a free direction brings the room's light, a blocked direction the bounce of what blocks it
    room, key = np.zeros((2, len(points), 4), np.float32)
    total = np.zeros(len(points), np.float32)
    free = find(lights.room)
    gather_light(
        normals, points, free, directions=lights.room, radiance=lights.room_radiance, bounce=bounce,
        table=ground.irradiance, side=ground.side, albedo=ground.albedo, found=room, total=total,
    )  # fmt: skip
    gather_key(normals, find(lights.key), lights.key, lights.key_irradiance, key)
    return np.column_stack([room[:, :3] + key[:, :3], key[:, 3], room[:, 3]])


def _open_light(normals: np.ndarray, lights: _Directions) -> np.ndarray:
    above = lights.room[:, 2] > 0
    # the sum of radiance times cosine times solid angle, each direction 4 pi / n steradians
    sky = np.maximum(normals @ lights.room[above].T, 0) @ lights.room_radiance[above] * (4 * np.pi / len(lights.room))
    key = np.maximum(normals @ lights.key.T, 0).sum(axis=1, keepdims=True) * lights.key_irradiance
    return (sky + key).astype(np.float32)


def _room_directions(environment: np.ndarray, count: int, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) directions spread evenly over the sphere around an object, and the room's mean radiance around each."""
    i = np.arange(count)
    # even steps of height cut a sphere into rings of equal area (Archimedes): one direction in each
    z = 1 - (2 * i + 1) / count
    # the golden angle: no two directions of the spiral line up, however many there are
    azimuth = i * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    directions = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1).astype(np.float32)
    in_world = directions @ turn.T.astype(np.float32)
    # blurred, as each direction stands for all around it: a window would be hit or missed
    return directions, sample_directions(blur_directions(environment, environment.shape[1] / 40), in_world)


def _key_directions(key: KeyLight, count: int, turn_deg: float) -> np.ndarray:
    """(n, 3) unit directions spread evenly over the key light's disc."""
    axis = orbit_direction(key.azimuth_deg - turn_deg, key.elevation_deg)
    # two axes across the light's: a disc of unit distance, its radius the tangent of the angle
    side = np.cross([0, 0, 1.0], axis)
    side /= np.linalg.norm(side)
    i = np.arange(count)
    # a sunflower: roots of even steps spread points evenly over a disc (Vogel 1979)
    radius = np.tan(np.radians(key.radius_deg)) * np.sqrt((i + 0.5) / count)
    angle = i * np.pi * (3 - np.sqrt(5))
    directions = axis + radius[:, None] * (
        np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
    )
    return (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


def _mean_colour(table: Table | None) -> np.ndarray:
    """(3,) linear."""
    if table is None:
        return np.zeros(3, np.float32)
    # means are taken of linear light: codes are not additive
    return srgb_to_linear(table.picture[::8, ::8] / 255).reshape(-1, 3).mean(axis=0).astype(np.float32)
