"""Make a new picture face by face, for colours that no look-up in the old picture gives."""

from collections.abc import Callable

import numpy as np

from toolkit.imaging.colour import linear_to_srgb

MOST_TEXELS = 1 << 24
"""Largest number of texels of a picture that is made."""
MOST_LEVEL = 8
"""A face has up to 2^8 texels a side."""
AT_ONCE = 1 << 20


def bake_faces(
    sides: np.ndarray, colour_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Make a square block of texels for each face, whose corners lie in the middles of three of its corner texels.

    Args:
        sides: (m,) texels a side that each face asks for.
        colour_at: (n,) faces, (n, 3) weights of their corners -> (n, 3) linear light. Weights beyond the face's long
            side are negative.

    Returns:
        (m, 3, 2) float32 texture coordinates, v up; and the picture, (h, w, 3) uint8, sRGB-encoded.
    """
    level = np.ceil(np.log2(np.maximum(sides, 2))).astype(np.int64).clip(1, MOST_LEVEL)
    # too many texels: every block is halved until they fit
    while level.max() > 1 and int((4**level).sum()) > MOST_TEXELS:
        level = np.maximum(level - 1, 1)
    order = np.argsort(-level, kind="stable")  # the largest first: then a Z-order curve leaves no gaps
    starts = np.empty(len(level), np.int64)
    starts[order] = np.cumsum(4 ** level[order]) - 4 ** level[order]
    depth = int(np.ceil(np.log2(max(int((4**level).sum()), 4)) / 2))
    # the place on the Z-order curve gives column and row: every second bit (Morton 1966)
    column, row = unfold(starts, depth)
    width, height = 1 << depth, int((row + 2**level).max())
    texture = np.zeros((height, width, 3), np.uint8)
    # blocks of one size are coloured together, as many at once as memory allows
    for size in np.unique(level):
        side = 1 << int(size)
        chosen = np.flatnonzero(level == size)
        y, x = np.divmod(np.arange(side * side), side)
        weights = np.stack([1 - (x + y) / (side - 1), x / (side - 1), y / (side - 1)], axis=1)
        step = max(AT_ONCE // len(x), 1)
        for first in range(0, len(chosen), step):
            faces = chosen[first : first + step]
            light = colour_at(np.repeat(faces, len(x)), np.tile(weights, (len(faces), 1)))
            places = (row[faces, None] + y).reshape(-1), (column[faces, None] + x).reshape(-1)
            texture[places] = np.round(linear_to_srgb(light) * 255)
    # corners lie in the middles of texels, so bilinear look-ups never leave the block
    far = 2.0**level - 0.5
    half = np.full_like(far, 0.5)
    corners = np.stack([np.stack([half, half], 1), np.stack([far, half], 1), np.stack([half, far], 1)], axis=1)
    corners += np.stack([column, row], axis=1)[:, None]
    return (corners / [width, -height] + [0, 1]).astype(np.float32), texture


def unfold(index: np.ndarray, level: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of numbers along a Z-order curve through a square of 2^level."""
    column, row = np.zeros_like(index), np.zeros_like(index)
    for bit in range(level):
        column |= (index >> (2 * bit) & 1) << bit
        row |= (index >> (2 * bit + 1) & 1) << bit
    return column, row
