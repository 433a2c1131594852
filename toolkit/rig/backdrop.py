"""What is behind the object: the lit table top and the room, found for every pixel in closed form."""

from threading import Lock

import cv2
import numpy as np

from toolkit.imaging.colour import srgb_to_linear
from toolkit.rig.camera import Camera
from toolkit.rig.lighting import Lighting
from toolkit.rig.shading import ROUGHNESS_LEVELS
from toolkit.rig.studio import Studio
from toolkit.rig.textures import build_pyramid, sample, sample_directions


class Backdrop:
    """Table and room of one studio, lit as `Lighting` says."""

    def __init__(self, studio: Studio, lighting: Lighting) -> None:
        self._studio = studio
        self._lit = build_pyramid(_light_table(studio, lighting))
        self._size = np.array(studio.table_mm, np.float32)
        self._blurring = Lock()

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear radiance without the object."""
        rotation = T_world_camera[:3, :3].astype(np.float32)
        origin = T_world_camera[:3, 3].astype(np.float32)
        fx, fy, cx, cy = np.float32(camera.fx), np.float32(camera.fy), camera.cx, camera.cy
        x = (np.arange(camera.width, dtype=np.float32) + 0.5 - cx) / fx
        y = (np.arange(camera.height, dtype=np.float32) + 0.5 - cy) / fy
        direction = [
            (x * rotation[i, 0])[None, :] + (y * rotation[i, 1] + rotation[i, 2])[:, None] for i in range(3)
        ]  # not of unit length: z is 1 in the camera's axes
        falling = np.minimum(direction[2], np.float32(-1e-4))
        reach = -origin[2] / falling
        ground_x, ground_y = origin[0] + reach * direction[0], origin[1] + reach * direction[1]
        footprint = reach / np.float32(camera.fx)
        cosine = -falling / np.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
        picture = self._table_picture(ground_x, ground_y, footprint / np.sqrt(np.maximum(cosine, 0.05)))
        picture += self._table_gloss(direction, cosine)
        cover = np.clip(self._pixels_inside(direction, origin, rotation[:, :2] / np.array([fx, fy])) + 0.5, 0, 1)
        open_room = np.flatnonzero(cover.reshape(-1) < 1)
        if len(open_room):
            flat = picture.reshape(-1, 3)
            rays = np.stack([axis.reshape(-1)[open_room] for axis in direction], axis=1)
            room = self._room(rays / np.linalg.norm(rays, axis=1, keepdims=True), 0)
            share = cover.reshape(-1)[open_room, None]
            flat[open_room] = flat[open_room] * share + room * (1 - share)
        return picture

    def reflect(self, points: np.ndarray, direction: np.ndarray, roughness: np.ndarray) -> np.ndarray:
        """(n, 3) radiance that arrives at points (n, 3) from unit directions (n, 3), blurred by roughness (n,)."""
        level = np.searchsorted((0.21, 0.42, 0.72), roughness)
        down = direction[:, 2] < -0.02
        radiance = np.empty_like(direction)
        for index in np.unique(level):
            up = np.flatnonzero((level == index) & ~down)
            if len(up):
                radiance[up] = self._room(direction[up], int(index))
        low = np.flatnonzero(down)
        if len(low):
            radiance[low] = self._table_in_mirror(points[low], direction[low], level[low])
        return radiance

    def _room(self, direction: np.ndarray, level: int) -> np.ndarray:
        rooms = self._studio.blurred_rooms
        with self._blurring:  # parts of a picture are shaded side by side; few of the levels are met in it
            if level not in rooms:
                rooms[level] = _blur_room(self._studio.environment, ROUGHNESS_LEVELS[level])
        return sample_directions(rooms[level], direction)

    def _table_in_mirror(self, points: np.ndarray, direction: np.ndarray, level: np.ndarray) -> np.ndarray:
        reach = points[:, 2] / -direction[:, 2]
        u = (points[:, 0] + reach * direction[:, 0]) / self._size[0] + 0.5
        v = (points[:, 1] + reach * direction[:, 1]) / self._size[1] + 0.5
        on_table = (np.abs(u - 0.5) < 0.5) & (np.abs(v - 0.5) < 0.5)
        radiance = np.empty_like(direction)
        for index in np.unique(level):
            chosen = np.flatnonzero(level == index)
            picture = self._lit[min(2 + int(index), len(self._lit) - 1)]
            seen = sample(picture, u[chosen].clip(0, 1), v[chosen].clip(0, 1), cv2.BORDER_REPLICATE)
            radiance[chosen] = np.where(on_table[chosen, None], seen, self._room(direction[chosen], int(index)))
        return radiance

    def _pixels_inside(self, direction: list[np.ndarray], origin: np.ndarray, step: np.ndarray) -> np.ndarray:
        """(h, w) distance in pixels from the table's nearest edge, positive inside.

        Each edge is a straight line in the picture, so that its distance is linear in the pixel: a ray meets the table
        on the inner side of x = half where (half - x₀)·(-d_z) - z₀·d_x > 0, and likewise for the others.
        """
        nearest = np.full_like(direction[0], np.inf)
        for axis in (0, 1):
            for sign in (np.float32(1), np.float32(-1)):
                along, down = -sign * origin[2], sign * origin[axis] - self._size[axis] / 2
                slope = np.hypot(*(along * step[axis] + down * step[2]))
                distance = (along * direction[axis] + down * direction[2]) / np.maximum(slope, np.float32(1e-9))
                np.minimum(nearest, distance, out=nearest)
        return nearest

    def _table_picture(self, x: np.ndarray, y: np.ndarray, footprint: np.ndarray) -> np.ndarray:
        """Bilinear in the two pyramid levels around each pixel's footprint."""
        lod = np.log2(np.maximum(footprint * np.float32(self._lit[0].shape[1] / self._size[0]), 1e-3))
        lod = np.clip(lod, 0, len(self._lit) - 1)
        u, v = x / self._size[0] + np.float32(0.5), np.float32(0.5) - y / self._size[1]
        picture = np.zeros((*lod.shape, 3), np.float32)
        finest = int(lod.min())
        for level in range(finest, min(int(np.ceil(lod.max())), len(self._lit) - 1) + 1):
            h, w = self._lit[level].shape[:2]
            values = cv2.remap(
                self._lit[level], u * w - np.float32(0.5), v * h - np.float32(0.5), cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
            if level == finest:
                picture = np.asarray(values, np.float32)
            else:
                picture += (values - picture) * np.clip(lod - (level - 1), 0, 1)[..., None]
        return picture

    def _table_gloss(self, direction: list[np.ndarray], cosine: np.ndarray) -> np.ndarray:
        """The table's own sheen, smooth enough to be worked out at an eighth of the resolution."""
        h, w = cosine.shape
        step = 8
        coarse = [axis[::step, ::step] for axis in direction]
        mirrored = np.stack([coarse[0], coarse[1], np.abs(coarse[2])], axis=-1).reshape(-1, 3)
        mirrored /= np.linalg.norm(mirrored, axis=1, keepdims=True)
        roughness = self._studio.table_roughness
        level = int(np.searchsorted((0.21, 0.42, 0.72), roughness))
        fresnel = 0.04 + (1 - roughness) * 0.5 * (1 - cosine[::step, ::step].reshape(-1)) ** 5
        sheen = self._room(mirrored, level) * fresnel[:, None] * (1 - 0.6 * roughness)
        sheen = sheen.reshape(*coarse[0].shape, 3).astype(np.float32)
        return cv2.resize(sheen, (sheen.shape[1] * step, sheen.shape[0] * step), interpolation=cv2.INTER_LINEAR)[:h, :w]


def _blur_room(environment: np.ndarray, roughness: float) -> np.ndarray:
    """The (h, w, 3) room as a surface of that roughness mirrors it."""
    w = environment.shape[1]
    tiled = np.concatenate([environment] * 3, axis=1)
    blurred = cv2.GaussianBlur(tiled, (0, 0), w * (0.004 + 0.13 * roughness**1.5))
    return np.ascontiguousarray(blurred[:, w : 2 * w])


def _light_table(studio: Studio, lighting: Lighting) -> np.ndarray:
    """(h, w, 3) radiance of the table top: its colour times the baked light."""
    colour = srgb_to_linear(np.arange(256) / 255)[studio.table]
    h, w = colour.shape[:2]
    x = (np.arange(w, dtype=np.float32) + 0.5) / w * studio.table_mm[0] - studio.table_mm[0] / 2
    y = studio.table_mm[1] / 2 - (np.arange(h, dtype=np.float32) + 0.5) / h * studio.table_mm[1]
    count = lighting.table.shape[0]
    to_map = count / lighting.table_side_mm
    column = np.broadcast_to(x * to_map + count / 2 - 0.5, (h, w)).astype(np.float32)
    row = np.broadcast_to((count / 2 - 0.5 - y * to_map)[:, None], (h, w)).astype(np.float32)
    light = cv2.remap(lighting.table, column, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return (colour * light / np.float32(np.pi)).astype(np.float32)
