"""Light that does not change with the camera, worked out once per scene: soft shadow, skylight, bounce, contact shade.

Every direction of a fixed set (a disc for the key light, a sphere for the room) is tested against the object with
exact rays, for all surface samples at once. The same directions everywhere make smooth shade instead of noise.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.rig.camera import orbit_direction
from toolkit.rig.lightmap import SampleGrid, place_samples
from toolkit.rig.studio import Studio
from toolkit.rig.textures import sample, sample_directions

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


def bake_lighting(
    scene,
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
    room, room_light = _room_directions(studio, detail.room_rays)
    key = _key_directions(studio, detail.key_rays)
    key_light = np.array(studio.key.irradiance, np.float32) / detail.key_rays
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    open_irradiance = _open_light(up, room, room_light, key, key_light)[0]
    bounce = BOUNCE * albedo * open_irradiance / np.pi

    side = 2 * _shadow_reach(size, float(corners[..., 2].max()), studio)
    count = min(round(side / size / detail.table_spacing), MAX_TABLE_SIDE)
    steps = (np.arange(count) + 0.5) / count * side - side / 2
    x, y = np.meshgrid(steps, -steps)
    points = np.stack([x, y, np.full_like(x, OFFSET * size)], axis=-1).reshape(-1, 3).astype(np.float32)
    shade = _gather(scene, points, np.repeat(up, len(points), 0), room, room_light, key, key_light, bounce)
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

    values = _gather(scene, origins, grid.normals, room, room_light, key, key_light, bounce, from_table)
    return Lighting(grid, values[grid.slot], table.astype(np.float32), side, open_irradiance)


def _shadow_reach(size: float, height: float, studio: Studio) -> float:
    """Distance from the origin within which the table's light can differ from the open table's, mm."""
    lowest = np.radians(max(studio.key.elevation_deg - studio.key.radius_deg, 5))
    return 0.75 * size + max(0.55 * size, height / float(np.tan(lowest)))


def _gather(scene, points, normals, room, room_light, key, key_light, bounce, from_table=None) -> np.ndarray:
    """(n, 5) irradiance, key share and room share at points."""
    values = np.zeros((len(points), 5), np.float32)
    facing_total = np.zeros(len(points), np.float32)
    solid_angle = np.float32(4 * np.pi / len(room))
    for direction, radiance in zip(room, room_light, strict=True):
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
    for direction in key:
        cosine = normals @ direction
        facing = np.flatnonzero(cosine > 0)
        free = ~_blocked(scene, points[facing], direction)
        values[facing, :3] += (cosine[facing] * free)[:, None] * key_light
        values[facing, 3] += free / np.float32(len(key))
    values[:, 4] /= np.maximum(facing_total, 1e-6)
    return values


def _blocked(scene, points: np.ndarray, direction: np.ndarray) -> np.ndarray:
    import open3d as o3d

    rays = np.empty((len(points), 6), np.float32)
    rays[:, :3], rays[:, 3:] = points, direction
    return scene.test_occlusions(o3d.core.Tensor(rays)).numpy()


def _open_light(normals, room, room_light, key, key_light) -> np.ndarray:
    above = room[:, 2] > 0
    sky = np.maximum(normals @ room[above].T, 0) @ room_light[above] * (4 * np.pi / len(room))
    return (sky + np.maximum(normals @ key.T, 0).sum(axis=1, keepdims=True) * key_light).astype(np.float32)


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
    from toolkit.colour import srgb_to_linear

    return srgb_to_linear(studio.table[::8, ::8] / 255).reshape(-1, 3).mean(axis=0)
