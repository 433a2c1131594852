"""Parts of a surface that lie flat with little stretch."""

import numpy as np

from toolkit.objects.grouping import group_places
from toolkit.objects.mesh import Mesh, cross_products
from toolkit.objects.unwrap import cut_charts
from toolkit.objects.wrap import Piece

NARROWEST_MM = 12.0
"""A hand does not place a narrower piece."""


def find_pieces(mesh: Mesh, value: np.ndarray, stretch: float, count: int) -> list[Piece]:
    """At most `count` pieces with the most value, best first.

    Args:
        mesh: in mm.
        value: (m,) what each face is worth; faces worth nothing are left out.
        stretch: largest of each piece.
        count: most pieces.
    """
    first, place = group_places(mesh.vertices)
    points, faces = mesh.vertices[first].astype(np.float64), place[mesh.faces]
    kept = np.flatnonzero(value > 0)
    chart, _ = cut_charts(points, faces[kept], least_area=NARROWEST_MM**2)
    order = np.argsort(-np.bincount(chart, value[kept]), kind="stable")
    found: list[Piece] = []
    for number in order[: 4 * count]:
        rows = kept[chart == number]
        flat = lay_flat(points, faces[rows])
        if flat is None:
            continue
        piece = make_piece(points[faces[rows]], rows, flat)
        if piece.stretch <= stretch and min(piece.width_mm, piece.height_mm) >= NARROWEST_MM:
            found.append(piece)
        if len(found) == count:
            break
    return found


def make_piece(corners: np.ndarray, rows: np.ndarray, flat: np.ndarray) -> Piece:
    """A piece of faces `rows` with corners (k, 3, 3) that lie at (k, 3, 2)."""
    flat = flat - flat.reshape(-1, 2).min(axis=0)
    return Piece(rows.astype(np.int32), flat, measure_stretch(corners, flat))


def measure_stretch(corners: np.ndarray, flat: np.ndarray) -> float:
    """95th percentile, weighted by area, of the relative change of the edges' lengths; corners (k, 3, 3) and flat."""
    solid = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    lying = np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2)
    change = np.abs(lying / np.maximum(solid, 1e-12) - 1)
    area = np.linalg.norm(cross_products(corners), axis=1) / 2
    return weighted_percentile(change.reshape(-1), np.repeat(area, 3), 0.95)


def weighted_percentile(values: np.ndarray, weights: np.ndarray, share: float) -> float:
    """The least value that values of this share of the weight do not exceed."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][min(int(np.searchsorted(total, share * total[-1])), len(values) - 1)])


def lay_flat(points: np.ndarray, faces: np.ndarray, steps: int = 20) -> np.ndarray | None:
    """Flatten a disc, as rigidly as possible: (k, 3, 2), None where it has no boundary or turns triangles over.

    Least squares conformal maps (Lévy et al. 2002), then local and global steps (Liu et al. 2008), from libigl.
    """
    import igl

    used, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3).astype(np.int64)
    V = points[used]
    loop = igl.boundary_loop(local)
    if len(loop) < 3:
        return None
    ends = np.array([loop[0], loop[len(loop) // 2]])
    gap = float(np.linalg.norm(V[ends[0]] - V[ends[1]]))
    flat, _ = igl.lscm(V, local, ends, np.array([[0.0, 0.0], [gap, 0.0]]))
    if not np.isfinite(flat).all():
        return None
    flat = relax(V[local], local, flat, steps)
    a, b, c = np.moveaxis(flat[local], 1, 0)
    turned = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]) <= 0
    return None if turned.any() or not np.isfinite(flat).all() else flat[local]


THINNEST = 1e-3
"""Triangles flatter than this share of their base are taken to be this high: their angles are rounding."""


def lay_triangles(corners: np.ndarray) -> np.ndarray:
    """(k, 3, 2) triangles (k, 3, 3) each on a plane of its own: the first corner at 0, the second on the x axis."""
    a, b, c = np.moveaxis(corners, 1, 0)
    base = np.maximum(np.linalg.norm(b - a, axis=1), 1e-9)
    along = ((c - a) * (b - a)).sum(axis=1) / base
    up = np.maximum(np.linalg.norm(np.cross(b - a, c - a), axis=1) / base, THINNEST * base)
    zero = np.zeros(len(base))
    return np.stack([np.stack([zero, zero], 1), np.stack([base, zero], 1), np.stack([along, up], 1)], axis=1)


def relax(corners: np.ndarray, faces: np.ndarray, flat: np.ndarray, steps: int) -> np.ndarray:
    """As-rigid-as-possible places of points: local and global steps (Liu et al. 2008, "A local/global approach").

    Args:
        corners: (k, 3, 3) of the faces in space.
        faces: (k, 3) their points.
        flat: (n, 2) to begin with.
        steps: how many.
    """
    from scipy.sparse import coo_array, csc_array
    from scipy.sparse.linalg import splu

    own = lay_triangles(corners)
    edges = np.roll(own, -1, axis=1) - own  # (k, 3, 2): edge i runs from corner i to the next
    twice = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    # the cotangent of the angle that faces an edge, half of it: its weight in the Dirichlet energy
    facing = np.stack([-(edges[:, (i + 1) % 3] * edges[:, (i + 2) % 3]).sum(axis=1) for i in range(3)], axis=1)
    weight = facing / (2 * twice[:, None])
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    w, n = weight.reshape(-1), len(flat)
    rows, columns = np.concatenate([start, end, start, end]), np.concatenate([start, end, end, start])
    laplacian = coo_array((np.concatenate([w, w, -w, -w]), (rows, columns)), shape=(n, n)).tocsc()
    # a touch on the diagonal holds the whole where it is, which no edge does
    held = 1e-8 * laplacian.diagonal().mean()
    solver = splu(csc_array(laplacian + held * coo_array((np.ones(n), (np.arange(n),) * 2), shape=(n, n))))
    for _ in range(steps):
        lying = flat[end.reshape(-1, 3)] - flat[start.reshape(-1, 3)]
        # the rotation that brings a triangle's own edges closest to where they lie
        dot = (weight * (edges * lying).sum(axis=2)).sum(axis=1)
        cross = (weight * (edges[..., 0] * lying[..., 1] - edges[..., 1] * lying[..., 0])).sum(axis=1)
        size = np.maximum(np.hypot(dot, cross), 1e-30)
        cos, sin = (dot / size)[:, None], (cross / size)[:, None]
        turned = np.stack(
            [cos * edges[..., 0] - sin * edges[..., 1], sin * edges[..., 0] + cos * edges[..., 1]], axis=2
        )
        pull = (weight[..., None] * turned).reshape(-1, 2)
        right = np.stack([
            np.bincount(end, pull[:, i], n) - np.bincount(start, pull[:, i], n) for i in range(2)
        ], axis=1)  # fmt: skip
        flat = solver.solve(right + held * flat)
    return flat
