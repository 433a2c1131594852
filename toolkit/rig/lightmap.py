"""Values stored on a mesh's surface without texture coordinates: a triangular grid of samples in every triangle.

Each triangle with side up to R spacings holds (R + 1)(R + 2) / 2 samples at barycentric steps of 1 / R and is read
back with linear interpolation between the three nearest (Yuksel, Keyser, House: Mesh Colors, 2010).
"""

from dataclasses import dataclass

import numpy as np

MAX_STEPS = 48
SHEET_MM = 0.1
"""Surfaces further apart than this, along their normal, do not share samples."""


@dataclass(frozen=True)
class SampleGrid:
    """Where the samples of a mesh lie.

    Attributes:
        steps: (m,) R of each triangle.
        first: (m,) index of its first sample.
        positions: (n, 3) world points of the distinct samples, mm.
        normals: (n, 3) unit.
        slot: (k,) the distinct sample behind each of the k stored ones; neighbours share those on common edges.
    """

    steps: np.ndarray
    first: np.ndarray
    positions: np.ndarray
    normals: np.ndarray
    slot: np.ndarray


def place_samples(corners: np.ndarray, corner_normals: np.ndarray, spacing_mm: float) -> SampleGrid:
    """Spread samples about `spacing_mm` apart over triangles (m, 3, 3) with corner normals (m, 3, 3)."""
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(edges / spacing_mm), 1, MAX_STEPS).astype(np.int64)
    counts = (steps + 1) * (steps + 2) // 2
    first = np.cumsum(counts) - counts
    total = int(counts.sum())
    positions, normals = np.empty((total, 3), np.float32), np.empty((total, 3), np.float32)
    for r in np.unique(steps):
        faces = np.flatnonzero(steps == r)
        weights = _barycentric_grid(int(r))
        index = (first[faces][:, None] + np.arange(len(weights))).reshape(-1)
        positions[index] = np.einsum("kc,fcx->fkx", weights, corners[faces]).reshape(-1, 3)
        normals[index] = np.einsum("kc,fcx->fkx", weights, corner_normals[faces]).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    cell = 0.2 * spacing_mm  # samples closer than this, on surfaces that face alike, share one value
    depth = np.einsum("nx,nx->n", positions, normals)[:, None]  # a sheet on a wall keeps light of its own
    key = np.concatenate([positions / cell, normals * 8, depth / SHEET_MM], axis=1).round().astype(np.int32)
    packed = np.ascontiguousarray(key).view(np.dtype((np.void, key.dtype.itemsize * 7))).reshape(-1)
    _, kept, slot = np.unique(packed, return_index=True, return_inverse=True)
    return SampleGrid(steps, first, positions[kept], normals[kept], slot.reshape(-1))


def read_samples(grid: SampleGrid, stored: np.ndarray, triangle: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Interpolate stored values (k, c) at points: triangle (n,), barycentric weights (n, 2) of corners 1 and 2."""
    r = grid.steps[triangle]
    x, y = uv[:, 0] * r, uv[:, 1] * r
    i = np.clip(x.astype(np.int64), 0, r - 1)
    j = np.clip(y.astype(np.int64), 0, r - 1 - i)
    fx, fy = (x - i).astype(np.float32), (y - j).astype(np.float32)
    upper = (fx + fy > 1) & (i + j < r - 1)
    start = grid.first[triangle]
    row, row_above = j * (r + 1) - j * (j - 1) // 2, (j + 1) * (r + 1) - (j + 1) * j // 2
    corner = start + np.where(upper, row_above + i + 1, row + i)
    weight_x, weight_y = np.where(upper, 1 - fy, fx), np.where(upper, 1 - fx, fy)
    value = stored[corner] * (1 - weight_x - weight_y)[:, None]
    value += stored[start + row + i + 1] * weight_x[:, None]
    value += stored[start + row_above + i] * weight_y[:, None]
    return value


def _barycentric_grid(r: int) -> np.ndarray:
    """((r + 1)(r + 2) / 2, 3) weights, row j from 0, column i from 0."""
    rows = [np.stack([np.arange(r + 1 - j), np.full(r + 1 - j, j)], axis=1) for j in range(r + 1)]
    ij = np.concatenate(rows) / r
    return np.column_stack([1 - ij.sum(axis=1), ij]).astype(np.float32)
