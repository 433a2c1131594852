"""Pieces of a mesh that lie over themselves when seen from their side, as a winding ramp does: cut by height."""

import numpy as np

FINE = 32
"""A piece is looked at on a grid of about so many cells a side."""
JUMP = 4.0
"""Heights in one cell that differ by more cells than this are two surfaces: the steepest faces climb 5 in 1, but two
samples in a cell are mostly closer than its side."""
WORTH_A_LOOK = 1e-3
"""Smaller pieces, as a share of the surface, stay whole."""
TOLERATED = 0.02
"""Share of a piece's cells that may hold two surfaces."""


def find_winding(flat: np.ndarray, height: np.ndarray, area: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Which pieces cover themselves.

    Args:
        flat: (m, 3, 2) the corners' places as seen along the piece's direction.
        height: (m, 3) the corners' heights along it.
        area: (m,) of the faces, in the unit of `flat` squared.
        piece: (m,) the piece of each face.

    Returns:
        (count,) bool per piece.
    """
    count = int(piece.max()) + 1
    size = np.bincount(piece, area, count)
    cell = np.sqrt(np.maximum(size, 1e-300)) / FINE
    samples = np.clip(np.ceil(2 * area / cell[piece] ** 2), 1, 4096).astype(np.int64)
    samples[size[piece] < WORTH_A_LOOK * size.sum()] = 0
    face = np.repeat(np.arange(len(piece)), samples)
    if not len(face):
        return np.zeros(count, bool)
    weights = _spread(len(face))
    places = np.einsum("kc,kci->ki", weights, flat[face])
    level = np.einsum("kc,kc->k", weights, height[face])
    of = piece[face]
    grid = np.floor(places / cell[of][:, None]).astype(np.int64)
    low, width = grid.min(axis=0), np.ptp(grid, axis=0) + 1
    if float(count) * float(width[0]) * float(width[1]) > 2**62:  # pieces of wildly different sizes: leave them whole
        return np.zeros(count, bool)
    key = (of * width[0] + grid[:, 0] - low[0]) * width[1] + grid[:, 1] - low[1]
    order = np.lexsort((level, key))
    key, level, of = key[order], level[order], of[order]
    gap = (np.diff(key) == 0) & (np.diff(level) > JUMP * cell[of[1:]])
    starts = np.r_[True, np.diff(key) != 0]
    cell_index = np.cumsum(starts) - 1
    double = np.zeros(int(cell_index[-1]) + 1, bool)
    double[cell_index[1:][gap]] = True
    cells = np.bincount(of[starts], minlength=count)
    return np.bincount(of[starts], double, count) > TOLERATED * cells


def _spread(count: int) -> np.ndarray:
    """(count, 3) barycentric coordinates that fill a triangle evenly (the R2 sequence, folded)."""
    golden = 1.32471795724474602596
    i = np.arange(1, count + 1)[:, None]
    a, b = ((0.5 + i / golden ** np.array([1, 2])) % 1).T
    folded = a + b > 1
    a, b = np.where(folded, 1 - a, a), np.where(folded, 1 - b, b)
    return np.column_stack([a, b, 1 - a - b])
