"""Texture look-ups that do not alias: a pyramid of averages, linear between texels and between levels."""

import cv2
import numpy as np

from toolkit.imaging.colour import srgb_to_linear

ROW = 1024


def build_pyramid(linear: np.ndarray) -> list[np.ndarray]:
    """Halve (h, w, 3) float32 linear values by area average until one side is 4; level 0 is the input."""
    levels: list[np.ndarray] = [np.ascontiguousarray(linear, np.float32)]
    while min(levels[-1].shape[:2]) > 4:
        h, w = levels[-1].shape[:2]
        levels.append(cv2.resize(levels[-1], (max(w // 2, 1), max(h // 2, 1)), interpolation=cv2.INTER_AREA))
    return levels


def texture_pyramid(encoded: np.ndarray) -> list[np.ndarray]:
    """`build_pyramid` of an sRGB-encoded uint8 texture, in linear light."""
    return build_pyramid(srgb_to_linear(np.arange(256) / 255)[encoded])


def sample(image: np.ndarray, u: np.ndarray, v: np.ndarray, border: int = cv2.BORDER_WRAP) -> np.ndarray:
    """Bilinear values (n, 3) at u right, v up in [0, 1]; texel centres at half integers; repeats outside."""
    h, w = image.shape[:2]
    count = len(u)
    rows = -(-count // ROW)
    x, y = np.zeros(rows * ROW, np.float32), np.zeros(rows * ROW, np.float32)
    np.multiply(u, np.float32(w), out=x[:count], casting="unsafe")
    np.multiply(1 - v, np.float32(h), out=y[:count], casting="unsafe")
    x -= np.float32(0.5)
    y -= np.float32(0.5)
    found = cv2.remap(image, x.reshape(rows, ROW), y.reshape(rows, ROW), cv2.INTER_LINEAR, borderMode=border)
    return found.reshape(-1, image.shape[2])[:count]


def sample_pyramid(
    levels: list[np.ndarray], u: np.ndarray, v: np.ndarray, lod: np.ndarray, border: int = cv2.BORDER_WRAP
) -> np.ndarray:
    """Trilinear values (n, 3); `lod` is the base-2 logarithm of level-0 texels per pixel."""
    lod = np.clip(lod, 0, len(levels) - 1)
    below = lod.astype(np.int32)
    share = (lod - below)[:, None].astype(np.float32)
    result = np.zeros((len(u), levels[0].shape[2]), np.float32)
    for level in np.unique(below):
        chosen = np.flatnonzero(below == level)
        cu, cv_, cs = u[chosen], v[chosen], share[chosen]
        fine = sample(levels[level], cu, cv_, border)
        if level + 1 < len(levels):
            fine += (sample(levels[level + 1], cu, cv_, border) - fine) * cs
        result[chosen] = fine
    return result


def equirectangular(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(u, v) in [0, 1] of directions (n, 3) on a picture of all directions: see `Studio.environment`."""
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    elevation = np.arcsin(np.clip(directions[:, 2], -1, 1))
    return 0.5 - azimuth / np.float32(2 * np.pi), 0.5 + elevation / np.float32(np.pi)


def sample_directions(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Bilinear values (n, 3) of a picture of all directions at unit `directions` (n, 3); its poles do not wrap."""
    u, v = equirectangular(directions)
    half_row = np.float32(0.5 / picture.shape[0])
    return sample(picture, u, np.clip(v, half_row, 1 - half_row))
