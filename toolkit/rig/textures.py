"""Textures for look-ups that do not alias: a pyramid of averages, linear between texels and between levels."""

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.rig.kernel.textures import Texels

WHITE = 65535
SMALLEST = 4
"""Shorter side of the coarsest level, texels."""


def build_pyramid(linear: np.ndarray) -> list[np.ndarray]:
    """Halve linear (h, w) or (h, w, 3), float32 or uint16, by area average until a side is 4; level 0 is the input."""
    sizes = _level_sizes(*linear.shape[:2])
    levels = [np.ascontiguousarray(linear), *(np.empty((*size, *linear.shape[2:]), linear.dtype) for size in sizes[1:])]
    _fill_coarser(levels)
    return levels


def _fill_coarser(levels: Sequence[np.ndarray]) -> None:
    """Make each level of the level before, in linear light: averages of codes would be too dark."""
    for finer, coarser in pairwise(levels):
        cv2.resize(finer, coarser.shape[1::-1], coarser, interpolation=cv2.INTER_AREA)


def _level_sizes(height: int, width: int) -> list[tuple[int, int]]:
    """(h, w) of each level of a pyramid, the finest first."""
    sizes = [(height, width)]
    while min(sizes[-1]) > SMALLEST:
        height, width = sizes[-1]
        sizes.append((max(height // 2, 1), max(width // 2, 1)))
    return sizes


def pack_textures(textures: list[np.ndarray]) -> Texels:
    """Pyramids of sRGB-encoded uint8 textures (h, w, 3) for the kernel, in linear light, uint16: 65535 is 1."""
    shapes = [_level_sizes(*texture.shape[:2]) for texture in textures]
    sizes = np.array([size for levels in shapes for size in levels], np.int32)
    counts = np.array([len(levels) for levels in shapes], np.int32)
    texels = sizes.astype(np.int64).prod(axis=1)
    start, first = np.cumsum(texels) - texels, (np.cumsum(counts) - counts).astype(np.int32)
    # one texel more: the kernel reads four numbers at once, past the last texel's three
    values = np.zeros((int(texels.sum()) + 1, 3), np.uint16)
    # each level is made where it belongs: pictures are large, and copies of them take longer than the work
    places = [
        values[begin : begin + count].reshape(*size, 3) for begin, count, size in zip(start, texels, sizes, strict=True)
    ]
    for texture, at, count in zip(textures, first, counts, strict=True):
        cv2.LUT(texture, _LINEAR, places[at])
        _fill_coarser(places[at : at + count])
    return Texels(values, start, sizes[:, 1].copy(), sizes[:, 0].copy(), first, counts)


def pad_channels(picture: np.ndarray) -> np.ndarray:
    """(h, w, 4) float32 of (h, w, 3), as the kernel reads pictures: four numbers at once."""
    padded = np.zeros((*picture.shape[:2], 4), np.float32)
    padded[..., :3] = picture
    return padded


_LINEAR = np.round(LINEAR_OF_CODE * WHITE).astype(np.uint16)


def equirectangular(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(u, v) in [0, 1] of directions (n, 3) on a picture of all directions: see `Scene.environment`."""
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    elevation = np.arcsin(np.clip(directions[:, 2], -1, 1))
    return 0.5 - azimuth / np.float32(2 * np.pi), 0.5 + elevation / np.float32(np.pi)


def sample_directions(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Bilinear values (n, 3) of a picture of all directions at unit `directions` (n, 3); its poles do not wrap."""
    u, v = equirectangular(directions)
    h, w = picture.shape[:2]
    x, y = u * w - 0.5, ((1 - v) * h - 0.5).clip(0, h - 1)
    # columns wrap around, rows end at the poles
    left, top = np.floor(x).astype(int), np.minimum(y.astype(int), h - 2)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    upper = picture[top, left % w] * (1 - fx) + picture[top, (left + 1) % w] * fx
    lower = picture[top + 1, left % w] * (1 - fx) + picture[top + 1, (left + 1) % w] * fx
    return (upper * (1 - fy) + lower * fy).astype(np.float32)


def blur_directions(picture: np.ndarray, sigma_px: float) -> np.ndarray:
    """A picture of all directions (h, w, 3), blurred across its seam; smaller where what is left fits fewer pixels."""
    shrink = 1
    # a wide blur leaves no fine detail: on a smaller picture it costs the square of `shrink` less
    while sigma_px / shrink >= 8 and min(picture.shape[:2]) // (2 * shrink) >= 16:
        shrink *= 2
    h, w = (side // shrink for side in picture.shape[:2])
    small = cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA) if shrink > 1 else picture
    # azimuth runs round: what lies beyond an edge is copied to the other before the blur; 4 sigma hold all of it
    margin = min(w, int(np.ceil(4 * sigma_px / shrink)))
    wide = np.concatenate([small[:, w - margin :], small, small[:, :margin]], axis=1)
    blurred = cv2.GaussianBlur(wide, (0, 0), sigma_px / shrink)[:, margin : margin + w]
    return np.ascontiguousarray(blurred, np.float32)
