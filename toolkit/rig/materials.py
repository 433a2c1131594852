"""Table tops, painted from noise: what an object may stand on."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

PX_PER_MM = 1.0
MAX_SIDE_PX = 2400


@dataclass(frozen=True)
class TableTop:
    """A surface: a painter (rng, (w, h) mm) -> (h, w, 3) uint8 sRGB, and its roughness."""

    paint: Callable[[np.random.Generator, tuple[float, float]], np.ndarray]
    roughness: float


def _size_px(size_mm: tuple[float, float]) -> tuple[int, int]:
    scale = min(PX_PER_MM, MAX_SIDE_PX / max(size_mm))
    return max(8, round(size_mm[0] * scale)), max(8, round(size_mm[1] * scale))


def _noise(rng: np.random.Generator, shape: tuple[int, int], cell: tuple[float, float], octaves: int = 4) -> np.ndarray:
    """(h, w) float32 smooth noise about 0 with unit-ish range; `cell` is the coarsest grain in pixels (x, y)."""
    height, width = shape
    total = np.zeros(shape, np.float32)
    for octave in range(octaves):
        cells = max(2, int(width / cell[0] * 2**octave)), max(2, int(height / cell[1] * 2**octave))
        grid = rng.standard_normal((min(cells[1], height), min(cells[0], width))).astype(np.float32)
        total += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) * 0.55**octave
    return total / 1.6


def _tint(base: tuple[int, int, int], shade: np.ndarray) -> np.ndarray:
    """Base colour times (1 + shade), as uint8."""
    return (np.array(base, np.float32) * (1 + shade[..., None])).clip(0, 255).astype(np.uint8)


def _wood(light: tuple[int, int, int], dark: tuple[int, int, int], plank_mm: float):
    def paint(rng: np.random.Generator, size_mm: tuple[float, float]) -> np.ndarray:
        width, height = _size_px(size_mm)
        scale = width / size_mm[0]
        plank = max(4, round(plank_mm * scale))
        rows = []
        for top in range(0, height, plank):
            h = min(plank, height - top)
            warp = _noise(rng, (h, width), (500 * scale, 60 * scale), 3)
            y = np.arange(h, dtype=np.float32)[:, None] / scale
            rings = np.sin((y / rng.uniform(7, 13) + 1.6 * warp + rng.uniform(0, 9)) * 2 * np.pi) * 0.5 + 0.5
            fibre = _noise(rng, (h, width), (70 * scale, 1.6), 2) * 0.16
            mix = (0.42 * rings**1.5 + 0.18 * warp + fibre + rng.uniform(0.1, 0.34)).clip(0, 1)[..., None]
            board = np.array(light, np.float32) * (1 - mix) + np.array(dark, np.float32) * mix
            if top:
                board[: max(1, round(0.8 * scale))] *= 0.55
            rows.append(board)
        return np.concatenate(rows).clip(0, 255).astype(np.uint8)

    return paint


def _plain(base: tuple[int, int, int], mottle: float, grain: float):
    def paint(rng: np.random.Generator, size_mm: tuple[float, float]) -> np.ndarray:
        width, height = _size_px(size_mm)
        cloud = _noise(rng, (height, width), (260, 260), 4) * mottle
        return _tint(base, cloud + rng.standard_normal((height, width)).astype(np.float32) * grain)

    return paint


def _linen(base: tuple[int, int, int], stripe: tuple[int, int, int]):
    def paint(rng: np.random.Generator, size_mm: tuple[float, float]) -> np.ndarray:
        width, height = _size_px(size_mm)
        scale = width / size_mm[0]
        weft = _noise(rng, (height, width), (40, 1.5), 2) * 0.05
        warp = _noise(rng, (height, width), (1.5, 40), 2) * 0.05
        cloth = _tint(base, weft + warp).astype(np.float32)
        x, y = np.arange(width) / scale, np.arange(height) / scale
        bands = 0.45 * (x % 70 < 9)[None, :, None] + 0.45 * (y % 70 < 9)[:, None, None]
        return (cloth * (1 - bands) + np.array(stripe, np.float32) * bands).clip(0, 255).astype(np.uint8)

    return paint


TABLES: dict[str, TableTop] = {
    "oak": TableTop(_wood((205, 170, 126), (150, 108, 68), 140), 0.5),
    "walnut": TableTop(_wood((118, 82, 58), (70, 45, 32), 120), 0.45),
    "white": TableTop(_plain((226, 225, 222), 0.012, 0.006), 0.4),
    "concrete": TableTop(_plain((152, 150, 146), 0.07, 0.025), 0.8),
    "linen": TableTop(_linen((214, 206, 190), (150, 60, 56)), 0.95),
    "slate": TableTop(_plain((72, 78, 84), 0.08, 0.03), 0.7),
    "birch": TableTop(_wood((228, 204, 164), (200, 166, 118), 400), 0.5),
}
