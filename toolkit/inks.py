"""The colours that a desktop printer makes of its inks, sRGB-encoded as a camera with its white balance sees them.

Numbers: FOGRA29 (September 2003), measured offset print on white uncoated paper, solids and their overprints; D50 to
sRGB by Bradford's adaptation, one value (cyan's red) clipped at 0. Plain copier paper in a desktop inkjet is uncoated
paper too; it drinks the ink, so that its prints are somewhat duller (`toolkit.boosters.print_process` draws how much).
"""

from functools import lru_cache
from itertools import combinations

import numpy as np

SOLIDS = np.array(
    [
        [[[0.311, 0.289, 0.282], [0.308, 0.345, 0.562]], [[0.064, 0.560, 0.355], [0.000, 0.617, 0.850]]],
        [[[0.840, 0.296, 0.304], [0.859, 0.309, 0.554]], [[0.982, 0.870, 0.202], [0.950, 0.950, 0.969]]],
    ]
)
"""[r, g, b] -> what is printed where the file's red, green and blue are 0 or 1, in this order: black ink, blue (cyan on
magenta), green (cyan on yellow), cyan, red (magenta on yellow), magenta, yellow, bare paper."""
PAPER = SOLIDS[1, 1, 1]


def nearest_printable(colours: np.ndarray) -> np.ndarray:
    """The nearest colours that the inks can mix: halftones mix solids, so these fill the convex hull of `SOLIDS`.

    Args:
        colours: (k, 3) sRGB-encoded.

    Returns:
        (k, 3); a colour that can be printed comes back itself.
    """
    nearest = np.array(colours, float)
    triangles, normals = _hull()
    above = np.einsum("kfc,fc->kf", nearest[:, None] - triangles[None, :, 0], normals)
    outside = np.flatnonzero(above.max(axis=1) > 0)
    points, best = nearest[outside], np.full(len(outside), np.inf)
    for triangle in triangles:
        place = _nearest_on_triangle(points, triangle)
        distance = np.linalg.norm(points - place, axis=1)
        nearer = distance < best
        nearest[outside[nearer]], best[nearer] = place[nearer], distance[nearer]
    return nearest


@lru_cache(maxsize=1)
def _hull() -> tuple[np.ndarray, np.ndarray]:
    """Triangles (f, 3, 3) of the hull of `SOLIDS`, and their outward normals (f, 3): those with all points below."""
    solids, triangles, normals = SOLIDS.reshape(8, 3), [], []
    for a, b, c in combinations(range(8), 3):
        normal = np.cross(solids[b] - solids[a], solids[c] - solids[a])
        side = (solids - solids[a]) @ normal
        if side.max() < 1e-9 or side.min() > -1e-9:
            triangles.append(solids[[a, b, c]])
            normals.append(normal * (1 if side.max() < 1e-9 else -1) / np.linalg.norm(normal))
    return np.array(triangles), np.array(normals)


def _nearest_on_triangle(points: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """(k, 3) the place on a triangle that is nearest to each of (k, 3) points."""
    edges = triangle[1:] - triangle[0]
    weights = np.linalg.lstsq(edges.T, (points - triangle[0]).T, rcond=None)[0].T
    within = (weights >= 0).all(axis=1) & (weights.sum(axis=1) <= 1)
    nearest = np.where(within[:, None], triangle[0] + weights @ edges, np.nan)
    best = np.where(within, -1.0, np.inf)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = triangle[end] - triangle[start]
        along = ((points - triangle[start]) @ edge / (edge @ edge)).clip(0, 1)
        place = triangle[start] + along[:, None] * edge
        distance = np.linalg.norm(points - place, axis=1)
        nearer = distance < best
        nearest[nearer], best[nearer] = place[nearer], distance[nearer]
    return nearest
