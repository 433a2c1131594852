"""Light that does not change with the camera, worked out once per scene and stored on the mesh."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from toolkit.imaging.colour import srgb_to_linear
from toolkit.rig.camera import orbit_direction
from toolkit.rig.studio import Studio
from toolkit.rig.textures import sample, sample_directions

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

MAX_STEPS = 48
SHEET_MM = 0.1
"""Surfaces further apart than this, along their normal, do not share samples."""


@dataclass(frozen=True)
class SampleGrid:
    """Where the samples of a mesh lie.

    Attributes:
        steps: (m,) R of each triangle.
        first: (m,) index of its first sample.
        positions: (n, 3) world points of the distinct samples, mm.
        normals: (n, 3) unit.
        slot: (k,) the distinct sample behind each of the k stored ones; neighbours share those on common edges.
    """

    steps: np.ndarray
    first: np.ndarray
    positions: np.ndarray
    normals: np.ndarray
    slot: np.ndarray


def place_samples(corners: np.ndarray, corner_normals: np.ndarray, spacing_mm: float) -> SampleGrid:
    """Spread samples about `spacing_mm` apart over triangles (m, 3, 3) with corner normals (m, 3, 3)."""
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(edges / spacing_mm), 1, MAX_STEPS).astype(np.int64)
    counts = (steps + 1) * (steps + 2) // 2
    first = np.cumsum(counts) - counts
    total = int(counts.sum())
    positions, normals = np.empty((total, 3), np.float32), np.empty((total, 3), np.float32)
    for r in np.unique(steps):
        faces = np.flatnonzero(steps == r)
        weights = _barycentric_grid(int(r))
        index = (first[faces][:, None] + np.arange(len(weights))).reshape(-1)
        positions[index] = np.einsum("kc,fcx->fkx", weights, corners[faces]).reshape(-1, 3)
        normals[index] = np.einsum("kc,fcx->fkx", weights, corner_normals[faces]).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    cell = 0.2 * spacing_mm  # samples closer than this, on surfaces that face alike, share one value
    depth = np.einsum("nx,nx->n", positions, normals)[:, None]  # a sheet on a wall keeps light of its own
    key = np.concatenate([positions / cell, normals * 8, depth / SHEET_MM], axis=1).round().astype(np.int32)
    packed = np.ascontiguousarray(key).view(np.dtype((np.void, key.dtype.itemsize * 7))).reshape(-1)
    _, kept, slot = np.unique(packed, return_index=True, return_inverse=True)
    return SampleGrid(steps, first, positions[kept], normals[kept], slot.reshape(-1))


def read_samples(grid: SampleGrid, stored: np.ndarray, triangle: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Interpolate stored values (k, c) at points: triangle (n,), barycentric weights (n, 2) of corners 1 and 2."""
    r = grid.steps[triangle]
    x, y = uv[:, 0] * r, uv[:, 1] * r
    i = np.clip(x.astype(np.int64), 0, r - 1)
    j = np.clip(y.astype(np.int64), 0, r - 1 - i)
    fx, fy = (x - i).astype(np.float32), (y - j).astype(np.float32)
    upper = (fx + fy > 1) & (i + j < r - 1)
    start = grid.first[triangle]
    row, row_above = j * (r + 1) - j * (j - 1) // 2, (j + 1) * (r + 1) - (j + 1) * j // 2
    corner = start + np.where(upper, row_above + i + 1, row + i)
    weight_x, weight_y = np.where(upper, 1 - fy, fx), np.where(upper, 1 - fx, fy)
    value = stored[corner] * (1 - weight_x - weight_y)[:, None]
    value += stored[start + row + i + 1] * weight_x[:, None]
    value += stored[start + row_above + i] * weight_y[:, None]
    return value


def _barycentric_grid(r: int) -> np.ndarray:
    """((r + 1)(r + 2) / 2, 3) weights, row j from 0, column i from 0."""
    rows = [np.stack([np.arange(r + 1 - j), np.full(r + 1 - j, j)], axis=1) for j in range(r + 1)]
    ij = np.concatenate(rows) / r
    return np.column_stack([1 - ij.sum(axis=1), ij]).astype(np.float32)


MAX_TABLE_SIDE = 280
OFFSET = 0.0012
BOUNCE = 0.45
"""Share of the open table's light that a blocked direction still brings, times the albedo of what blocks it."""


@dataclass(frozen=True)
class BakeDetail:
    """How finely light is worked out.

    Attributes:
        key_rays, room_rays: directions to the key light's disc and to the room.
        surface_spacing, table_spacing: distance between samples as a share of the object's longest side.
    """

    key_rays: int = 24
    room_rays: int = 96
    surface_spacing: float = 0.016
    table_spacing: float = 0.015


FULL_DETAIL = BakeDetail()


@dataclass(frozen=True)
class Lighting:
    """Baked light.

    Attributes:
        grid: where the object's samples lie.
        stored: (k, 5) irradiance RGB, share of the key light seen, share of the room seen.
        table: (h, w, 3) irradiance of the table over a square around the origin, image right +x, up +y.
        table_side_mm: side of that square.
        open_irradiance: (3,) of the table far from the object.
    """

    grid: SampleGrid
    stored: np.ndarray
    table: np.ndarray
    table_side_mm: float
    open_irradiance: np.ndarray


@dataclass(frozen=True)
class _Directions:
    """Where light comes from: (n, 3) unit directions spread evenly over the sphere, and over the key light's disc.

    `room_radiance` (n, 3) arrives around each of the former, `key_irradiance` (3,) from each of the latter.
    """

    room: np.ndarray
    room_radiance: np.ndarray
    key: np.ndarray
    key_irradiance: np.ndarray


def bake_lighting(
    scene: "RaycastingScene",
    corners: np.ndarray,
    corner_normals: np.ndarray,
    albedo: np.ndarray,
    studio: Studio,
    detail: BakeDetail = FULL_DETAIL,
) -> Lighting:
    """Work out all light that reaches an object and its table.

    Args:
        scene: Open3D ray-casting scene of the object.
        corners, corner_normals: (m, 3, 3) triangles and normals, mm.
        albedo: (3,) mean linear colour of the object, for bounce.
        studio: light, room and table.
        detail: how finely.
    """
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    lights = _Directions(
        *_room_directions(studio, detail.room_rays), _key_directions(studio, detail.key_rays),
        np.array(studio.key.irradiance, np.float32) / detail.key_rays,
    )  # fmt: skip
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    open_irradiance = _open_light(up, lights)[0]
    bounce = BOUNCE * albedo * open_irradiance / np.pi

    side = 2 * _shadow_reach(size, float(corners[..., 2].max()), studio)
    count = min(round(side / size / detail.table_spacing), MAX_TABLE_SIDE)
    steps = (np.arange(count) + 0.5) / count * side - side / 2
    x, y = np.meshgrid(steps, -steps)
    points = np.stack([x, y, np.full_like(x, OFFSET * size)], axis=-1).reshape(-1, 3).astype(np.float32)
    shade = _gather(scene, points, np.repeat(up, len(points), 0), lights, bounce)
    table = cv2.GaussianBlur(shade[:, :3].reshape(count, count, 3), (0, 0), 0.8)
    fade = np.clip((side / 2 - np.maximum(np.abs(x), np.abs(y))) / (0.15 * side), 0, 1)[..., None].astype(np.float32)
    table = open_irradiance * (1 - fade) + table * fade

    grid = place_samples(corners, corner_normals, detail.surface_spacing * size)
    origins = grid.positions + grid.normals * np.float32(OFFSET * size)
    table_albedo = _mean_table_colour(studio)

    def from_table(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        reach = origin[:, 2] / -direction[2]
        u = (origin[:, 0] + reach * direction[0]) / side + 0.5
        v = (origin[:, 1] + reach * direction[1]) / side + 0.5
        return sample(table, u.clip(0, 1), v.clip(0, 1), cv2.BORDER_REPLICATE) * (table_albedo / np.pi)

    values = _gather(scene, origins, grid.normals, lights, bounce, from_table=from_table)
    return Lighting(grid, values[grid.slot], table.astype(np.float32), side, open_irradiance)


def _shadow_reach(size: float, height: float, studio: Studio) -> float:
    """Distance from the origin within which the table's light can differ from the open table's, mm."""
    lowest = np.radians(max(studio.key.elevation_deg - studio.key.radius_deg, 5))
    return 0.75 * size + max(0.55 * size, height / float(np.tan(lowest)))


def _gather(
    scene: "RaycastingScene", points: np.ndarray, normals: np.ndarray, lights: _Directions, bounce: np.ndarray,
    from_table: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:  # fmt: skip
    """(n, 5) irradiance, key share and room share at points."""
    values = np.zeros((len(points), 5), np.float32)
    facing_total = np.zeros(len(points), np.float32)
    solid_angle = np.float32(4 * np.pi / len(lights.room))
    for direction, radiance in zip(lights.room, lights.room_radiance, strict=True):
        if from_table is None and direction[2] <= 0:
            continue
        cosine = normals @ direction
        facing = np.flatnonzero(cosine > 0)
        if not len(facing):
            continue
        free = ~_blocked(scene, points[facing], direction)
        weight = cosine[facing] * solid_angle
        light = np.broadcast_to(radiance, (len(facing), 3))
        if direction[2] < -1e-3 and from_table is not None:
            light = from_table(points[facing], direction)
        values[facing, :3] += np.where(free[:, None], light, bounce) * weight[:, None]
        values[facing, 4] += free * weight
        facing_total[facing] += weight
    for direction in lights.key:
        cosine = normals @ direction
        facing = np.flatnonzero(cosine > 0)
        free = ~_blocked(scene, points[facing], direction)
        values[facing, :3] += (cosine[facing] * free)[:, None] * lights.key_irradiance
        values[facing, 3] += free / np.float32(len(lights.key))
    values[:, 4] /= np.maximum(facing_total, 1e-6)
    return values


def _blocked(scene: "RaycastingScene", points: np.ndarray, direction: np.ndarray) -> np.ndarray:
    import open3d as o3d

    rays = np.empty((len(points), 6), np.float32)
    rays[:, :3], rays[:, 3:] = points, direction
    return scene.test_occlusions(o3d.core.Tensor(rays)).numpy()


def _open_light(normals: np.ndarray, lights: _Directions) -> np.ndarray:
    above = lights.room[:, 2] > 0
    sky = np.maximum(normals @ lights.room[above].T, 0) @ lights.room_radiance[above] * (4 * np.pi / len(lights.room))
    key = np.maximum(normals @ lights.key.T, 0).sum(axis=1, keepdims=True) * lights.key_irradiance
    return (sky + key).astype(np.float32)


def _room_directions(studio: Studio, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) directions spread evenly over the sphere and the room's mean radiance around each."""
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    azimuth = i * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    directions = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1).astype(np.float32)
    w = studio.environment.shape[1]
    tiled = np.concatenate([studio.environment] * 3, axis=1)
    blurred = cv2.GaussianBlur(tiled, (0, 0), w / 40)[:, w : 2 * w]
    return directions, sample_directions(np.ascontiguousarray(blurred), directions)


def _key_directions(studio: Studio, count: int) -> np.ndarray:
    """(n, 3) unit directions spread evenly over the key light's disc."""
    axis = orbit_direction(studio.key.azimuth_deg, studio.key.elevation_deg)
    side = np.cross([0, 0, 1.0], axis)
    side /= np.linalg.norm(side)
    i = np.arange(count)
    radius = np.tan(np.radians(studio.key.radius_deg)) * np.sqrt((i + 0.5) / count)
    angle = i * np.pi * (3 - np.sqrt(5))
    directions = axis + radius[:, None] * (
        np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
    )
    return (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


def _mean_table_colour(studio: Studio) -> np.ndarray:
    return srgb_to_linear(studio.table[::8, ::8] / 255).reshape(-1, 3).mean(axis=0)
