"""Smooth noise that repeats: the pattern of clouds, and of snow on the ground."""

import cv2
import numpy as np

from toolkit.rig.textures import build_pyramid

ROW = 1024


def paint_noise(rng: np.random.Generator, side_px: int, slope: float, coarsest: float) -> np.ndarray:
    """(side, side) float32 periodic noise, every value in [0, 1] as frequent.

    Args:
        rng: draws it.
        side_px: of the pattern.
        slope: amplitudes fall as frequency^-slope.
        coarsest: waves longer than this part of the side are no stronger.
    """
    waves = np.hypot(np.fft.fftfreq(side_px)[:, None], np.fft.rfftfreq(side_px)[None]) * side_px
    spectrum = np.fft.rfft2(rng.standard_normal((side_px, side_px))) / np.maximum(waves, coarsest) ** slope
    smooth = np.fft.irfft2(spectrum, s=(side_px, side_px))
    rank = np.empty(side_px**2, np.float32)
    rank[np.argsort(smooth, axis=None)] = (np.arange(side_px**2) + 0.5) / side_px**2
    return rank.reshape(side_px, side_px)


def paint_levels(rng: np.random.Generator, side_px: int, slope: float, coarsest: float) -> list[np.ndarray]:
    """`paint_noise` and its averages, each half as large as the one before."""
    return build_pyramid(paint_noise(rng, side_px, slope, coarsest))


def sample_noise(levels: list[np.ndarray], u: np.ndarray, v: np.ndarray, lod: np.ndarray) -> np.ndarray:
    """(n,) values of a pattern at (u, v), averaged over 2^lod of its texels; it repeats outside [0, 1]."""
    lod = np.clip(lod, 0, len(levels) - 1)
    below = lod.astype(np.int32)
    found = np.empty(len(u), np.float32)
    for level in np.unique(below):
        chosen = np.flatnonzero(below == level)
        values = _look_up(levels[level], u[chosen], v[chosen])
        if level + 1 < len(levels):
            values += (_look_up(levels[level + 1], u[chosen], v[chosen]) - values) * (lod[chosen] - level)
        found[chosen] = values
    return found


def _look_up(level: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n,) bilinear values; OpenCV looks rows of places up, and none of more than 32767."""
    rows = -(-len(u) // ROW)
    x, y = np.zeros(rows * ROW, np.float32), np.zeros(rows * ROW, np.float32)
    x[: len(u)] = np.mod(u, 1) * level.shape[1] - 0.5
    y[: len(v)] = np.mod(v, 1) * level.shape[0] - 0.5
    found = cv2.remap(level, x.reshape(rows, ROW), y.reshape(rows, ROW), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found, np.float32).reshape(-1)[: len(u)]
