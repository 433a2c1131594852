"""Holes of `alphaMode: MASK`: triangles are cut along the line where alpha falls below the cutoff."""

import numpy as np

from toolkit.core.lazy import cv2

MOST_SIDE = 2048
"""Most texels a side of alpha."""
MOST_PIECES = 300_000
"""Most triangles of a part; then the rest is cut as coarse as it is."""
MOST_LEVELS = 14


def cut_corners(alpha: np.ndarray, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut triangles where the alpha of their corners (m, 3), blended between them, reaches the cutoff."""
    return _cut(np.arange(len(alpha)), np.tile(np.eye(3), (len(alpha), 1, 1)), alpha - cutoff)


def cut_holes(
    corner_uv: np.ndarray, alpha: np.ndarray, corner_alpha: np.ndarray, cutoff: float
) -> tuple[np.ndarray, np.ndarray]:
    """Cut triangles where a repeating picture's alpha, times that of their corners, reaches the cutoff.

    Triangles with both kinds of texels are split in four until they are as small as half a texel, and cut there.

    Args:
        corner_uv: (m, 3, 2) look-ups of the corners, v down.
        alpha: (h, w) in [0, 1].
        corner_alpha: (m, 3) in [0, 1], of the colours of the corners.
        cutoff: least alpha that is solid.

    Returns:
        (k,) triangle of each remaining piece; (k, 3, 3) its corners as weights of that triangle's corners.
    """
    if max(alpha.shape) > MOST_SIDE:
        scale = MOST_SIDE / max(alpha.shape)
        alpha = cv2.resize(alpha.astype(np.float32), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    alpha = alpha.astype(np.float64)
    # sums over rectangles from the corner of a picture that repeats twice along each axis
    counts = np.pad(np.tile(alpha >= cutoff, (2, 2)).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    # whole turns of a repeating picture are taken off, so that a face begins in its first copy
    texels = corner_uv.astype(np.float64) * alpha.shape[::-1] - 0.5
    texels -= np.floor(texels.min(axis=1, keepdims=True) / alpha.shape[::-1]) * alpha.shape[::-1]
    # corners as weights of the triangle's own corners, so that all attributes can be cut alike
    owner, weights = np.arange(len(texels)), np.tile(np.eye(3), (len(texels), 1, 1))
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    done = 0
    for level in range(MOST_LEVELS + 1):
        corners = weights @ texels[owner]
        solid = _share_solid(corners, counts)
        clear = (weights @ corner_alpha[owner][:, :, None])[:, :, 0]
        # where corners are clear, fewer texels are solid than were counted
        whole = (solid == 1) & (clear.min(axis=1) == 1)
        mixed = (solid > 0) & (clear.max(axis=1) >= cutoff) & ~whole
        kept.append((owner[whole], weights[whole]))
        done += len(kept[-1][0])
        owner, weights, corners, clear = owner[mixed], weights[mixed], corners[mixed], clear[mixed]
        # small enough for a straight cut, or out of levels or pieces
        small = np.ptp(corners, axis=1).max(axis=1) <= 0.5
        if level == MOST_LEVELS or done + 4 * len(owner) > MOST_PIECES:
            small[:] = True
        kept.append(_cut(owner[small], weights[small], _blend(alpha, corners[small]) * clear[small] - cutoff))
        owner, weights = _split(owner[~small], weights[~small])
        if not len(owner):
            break
    owners, parts = zip(*kept, strict=True)
    return np.concatenate(owners), np.concatenate(parts)


def _share_solid(corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """(k,) solid share of the texels that look-ups in triangles (k, 3, 2) can reach."""
    low, behind = np.floor(corners.min(axis=1)).astype(np.int64), np.floor(corners.max(axis=1)).astype(np.int64) + 2
    size = np.array(counts.shape[::-1]) // 2
    extent = np.minimum(behind - low, size)
    (x, y), (right, bottom) = (low % size).T, (low % size + extent).T
    found = counts[bottom, right] - counts[y, right] - counts[bottom, x] + counts[y, x]
    return found / extent.prod(axis=1)


def _blend(alpha: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Alpha at texel coordinates (..., 2), blended between texels."""
    base = np.floor(places).astype(np.int64)
    # the texture repeats at its borders
    (fx, fy), (x, y) = np.moveaxis(places - base, -1, 0), np.moveaxis(base, -1, 0)
    height, width = alpha.shape
    x0, x1, y0, y1 = x % width, (x + 1) % width, y % height, (y + 1) % height
    return (alpha[y0, x0] * (1 - fx) + alpha[y0, x1] * fx) * (1 - fy) + (
        alpha[y1, x0] * (1 - fx) + alpha[y1, x1] * fx
    ) * fy


def _split(owner: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Four triangles of each, between the middles of its edges."""
    a, b, c = np.moveaxis(weights, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.tile(owner, 4), np.concatenate(parts)


def _cut(owner: np.ndarray, weights: np.ndarray, excess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keep the side of triangles on which a value (k, 3) at their corners, linear between them, is not negative."""
    solid = excess >= 0
    owners, parts = [owner[solid.all(axis=1)]], [weights[solid.all(axis=1)]]
    for first in range(3):  # turned so that the corner unlike the others comes first
        turn = [first, (first + 1) % 3, (first + 2) % 3]
        for alone in (True, False):
            # cases: a lone solid corner leaves a triangle, a lone clear corner leaves a quadrilateral
            chosen = (solid[:, turn] == [alone, not alone, not alone]).all(axis=1)
            a, b, c = np.moveaxis(weights[chosen][:, turn], 1, 0)
            at_a, at_b, at_c = excess[chosen][:, turn].T[:, :, None]
            # where the value is 0 on both edges from that corner, linear between their ends
            ab, ac = a + (b - a) * (at_a / (at_a - at_b)), a + (c - a) * (at_a / (at_a - at_c))
            pieces = ((a, ab, ac),) if alone else ((ab, b, c), (ab, c, ac))
            for piece in pieces:
                owners.append(owner[chosen])
                parts.append(np.stack(piece, axis=1))
    return np.concatenate(owners), np.concatenate(parts)
