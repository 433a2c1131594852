"""Photographs of a bare board for the tests: its picture through a camera, quick, with corners that are known."""

from functools import lru_cache

import cv2
import numpy as np

from toolkit.rig.camera import Camera, look_at, orbit_direction

PX_PER_MM = 6.0
EDGE_MM = 12.0
"""White paper round the board."""
FINE = 3
"""Times the camera's pixels that are painted, and then averaged."""


def viewpoints(count, seed=4, reach_mm=60.0, away_mm=(480.0, 560.0)):
    """Cameras round the board, at a slant, that look at different parts of it."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        azimuth = 360 * i / count + rng.uniform(-20, 20)
        aim = np.array([rng.uniform(-reach_mm, reach_mm), rng.uniform(-reach_mm, reach_mm), 0])
        place = 0.5 * aim + rng.uniform(*away_mm) * orbit_direction(azimuth, rng.uniform(35, 75))
        yield look_at(place, aim, rng.uniform(-10, 10), azimuth)


@lru_cache(maxsize=2)
def paint_page(board) -> np.ndarray:
    """Its picture with the paper round it; a second's work, for all photographs of the board."""
    return np.pad(board.paint(PX_PER_MM), round(EDGE_MM * PX_PER_MM), constant_values=255)


def shoot_flat(board, camera: Camera, T_world_camera: np.ndarray, seed: int = 0, noise: float = 2.0) -> np.ndarray:
    """(h, w, 3) uint8 picture of a board on a grey table; the camera has no distortion."""
    page = paint_page(board)
    width, height = board.size_mm
    sheet = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    world = np.c_[sheet[:, 1] - height / 2, sheet[:, 0] - width / 2, np.zeros(4)]
    # pixel (0, 0)'s centre is at (0.5, 0.5) of the camera, and at (0, 0) of OpenCV's pictures
    on_page = (sheet + EDGE_MM) * PX_PER_MM - 0.5
    in_picture = FINE * camera.project(T_world_camera, world) - 0.5
    homography = cv2.getPerspectiveTransform(on_page.astype(np.float32), in_picture.astype(np.float32))
    size = (FINE * camera.width, FINE * camera.height)
    fine = cv2.warpPerspective(page, homography, size, flags=cv2.INTER_AREA, borderValue=110)
    small = cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA).astype(float)
    small = 30 + 0.8 * small + np.random.default_rng(seed).normal(0, noise, small.shape)
    return np.repeat(small.clip(0, 255).round().astype(np.uint8)[..., None], 3, axis=2)
