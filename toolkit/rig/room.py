"""The room around the table, out of focus: what lights the object from all sides and shines back from its gloss."""

import cv2
import numpy as np

from toolkit.colour import srgb_to_linear

WALLS = ((226, 221, 210), (205, 212, 214), (222, 214, 196), (196, 201, 190), (214, 205, 205))
FLOORS = ((120, 92, 66), (98, 96, 94), (150, 128, 100), (74, 62, 54))
BOOKS = ((148, 48, 42), (38, 70, 104), (196, 160, 80), (54, 92, 66), (212, 206, 190), (60, 52, 60), (180, 96, 48))


def paint_room(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) float32 linear radiance, equirectangular: ceiling, walls with windows, shelves and pictures, floor.

    A white wall in the room's even light has radiance near 0.5; windows are several times brighter.
    """
    height, width = shape
    room = np.empty((height, width, 3), np.float32)
    wall = srgb_to_linear(np.array(WALLS[rng.integers(len(WALLS))]) / 255)
    floor = srgb_to_linear(np.array(FLOORS[rng.integers(len(FLOORS))]) / 255)
    horizon, ceiling, skirting = height // 2, round(height * 0.27), round(height * 0.62)
    room[:ceiling] = 0.85 * np.array([1.0, 0.99, 0.97])
    room[ceiling:skirting] = 0.8 * wall
    room[skirting:] = 0.6 * floor
    room[ceiling:skirting] *= np.linspace(1.15, 0.8, skirting - ceiling)[:, None, None]
    for azimuth in rng.permutation(np.arange(0, 360, 60))[:4] + rng.uniform(-12, 12, 4):
        furnish = (_window, _shelf, _picture)[rng.integers(3)]
        furnish(room, rng, int(azimuth / 360 * width), horizon)
    _window(room, rng, int(rng.uniform(0.30, 0.44) * width), horizon)  # a room has a window
    tiled = np.concatenate([room, room, room], axis=1)  # blur across the seam
    blurred = cv2.GaussianBlur(tiled, (0, 0), width / 110)[:, width : 2 * width]
    return np.ascontiguousarray(blurred, np.float32)


def _rectangle(room: np.ndarray, x: int, y: int, w: int, h: int, colour) -> None:
    """Fill a rectangle that may cross the seam."""
    columns = np.arange(x, x + w) % room.shape[1]
    room[max(y, 0) : y + h, columns] = colour


def _window(room: np.ndarray, rng: np.random.Generator, x: int, horizon: int) -> None:
    w, h = int(rng.integers(40, 64)), int(rng.integers(36, 48))
    top = horizon - h - 4
    _rectangle(room, x - 2, top - 2, w + 4, h + 4, [0.5, 0.49, 0.47])
    pane = w // 2 - 2
    for left in (x, x + w - pane):
        _rectangle(room, left, top, pane, h, np.array([2.5, 2.65, 2.9]) * rng.uniform(0.9, 1.3))


def _shelf(room: np.ndarray, rng: np.random.Generator, x: int, horizon: int) -> None:
    _rectangle(room, x, horizon - 46, 54, 72, [0.13, 0.09, 0.06])
    for row in range(4):
        left = x + 2
        while left < x + 48:
            w, h = int(rng.integers(2, 6)), int(rng.integers(10, 15))
            colour = srgb_to_linear(np.array(BOOKS[rng.integers(len(BOOKS))]) / 255) * 0.5
            _rectangle(room, left, horizon - 44 + 17 * row + (15 - h), w, h, colour)
            left += w


def _picture(room: np.ndarray, rng: np.random.Generator, x: int, horizon: int) -> None:
    w, h = int(rng.integers(18, 34)), int(rng.integers(18, 30))
    _rectangle(room, x - 2, horizon - 40, w + 4, h + 4, [0.06, 0.05, 0.05])
    for band in range(4):
        _rectangle(room, x, horizon - 38 + band * h // 4, w, h // 4, srgb_to_linear(rng.uniform(0.2, 0.8, 3)) * 0.6)
