"""Texture coordinates for meshes that have none: flat pieces, packed by xatlas."""

import numpy as np

from toolkit.errors import ToolkitError
from toolkit.objects.flat_charts import cut_charts

PADDING_PX = 2
"""Texels between pieces."""
FAIR_SCALE = 0.4
"""With texels smaller than this share of the ideal, the space between pieces goes first."""
SMALL_PX = 4
"""Pieces under so many texels squared join a neighbour where they can."""


def unwrap(vertices: np.ndarray, faces: np.ndarray, n: int) -> np.ndarray:
    """Lay every triangle flat on a square texture, at one scale.

    The same input gives the same coordinates. Pieces lie 2 texels apart, less where there are so many of them that
    little else would be left of the texture.

    Args:
        vertices: (v, 3) positions; those at one place count as one.
        faces: (m, 3).
        n: side of the texture in texels.

    Returns:
        (m, 3, 2) float32 in [0, 1], u right and v up.

    Raises:
        ToolkitError: xatlas is not installed.
    """
    extent = max(float(np.ptp(vertices, axis=0).max()), 1e-9)
    grid = np.round(vertices / (extent * 1e-6)).astype(np.int64)
    _, first, inverse = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    places, welded = vertices[first].astype(np.float64), inverse.reshape(-1)[faces]
    corners = places[welded]
    surface = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    texel = np.sqrt(surface / (0.6 * n * n))
    chart, flat = cut_charts(places, welded, least_area=(SMALL_PX * texel) ** 2)
    key = (chart.astype(np.int64)[:, None] * len(places) + welded).reshape(-1)
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    points, triangles = flat.reshape(-1, 2)[first], inverse.reshape(-1, 3)
    packed = _pack(points, triangles, chart, n)
    return np.clip(packed[triangles] / n, 0, 1).astype(np.float32)


def _pack(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, n: int) -> np.ndarray:
    """(k, 2) where each point lies on an n × n sheet, in texels: the largest scale at which the pieces fit."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    ideal = n / np.sqrt(max(np.abs(doubled).sum() / 2, 1e-30))
    best, best_scale = None, 0.0
    for padding in range(PADDING_PX, -1, -1):
        low, high = best_scale, 1.0
        for _ in range(7):
            scale = (low + high) / 2
            placed, size = _try_pack(points * ideal * scale, triangles, chart, padding)
            if size <= n:
                best, low = placed, scale
            else:
                high = scale
        best_scale = low
        if best_scale >= FAIR_SCALE:
            break
    if best is None:
        placed, size = _try_pack(points * ideal, triangles, chart, 0)
        best = placed * (n / size)
    return best


def _try_pack(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, padding: int) -> tuple[np.ndarray, int]:
    """Pieces in texels, moved and turned into one sheet, and that sheet's side."""
    try:
        import xatlas
    except ImportError:
        raise ToolkitError(
            "this mesh needs new texture coordinates, which need xatlas: install it with 'pip install xatlas'"
        ) from None
    atlas = xatlas.Atlas()
    uv, index = np.ascontiguousarray(points, np.float32), np.ascontiguousarray(triangles, np.uint32)
    atlas.add_uv_mesh(uv, index, np.ascontiguousarray(chart[:, None], np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bilinear = 1.0, padding, True
    atlas.generate(pack_options=options)
    origin, _, placed = atlas.get_mesh(0)
    result = np.zeros(points.shape)
    result[np.asarray(origin)] = np.asarray(placed, np.float64) * [atlas.width, atlas.height]
    return result, max(atlas.width, atlas.height)
