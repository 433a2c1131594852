"""Triangles of a surface laid flat: as-rigid-as-possible relaxation, stretch and overlaps.

A `Region` is a part of a surface in the plane, with the edges that are joined.
"""

from dataclasses import dataclass

import numpy as np

from toolkit.core.lazy import scipy, shapely
from toolkit.objects.mesh import Mesh, connected_parts, cross_products, group_places, signed_areas

THINNEST = 1e-3
"""Triangles flatter than this share of their base are taken to be this high: their angles are rounding."""
FLAT_MM2 = 1e-9
"""Smaller triangles have no side to be seen from."""


@dataclass(frozen=True)
class Surface:
    """A mesh welded by place, with the neighbours of triangles. Edge i runs from a triangle's corner i to the next.

    Attributes:
        corners: (m, 3, 3) in mm, float64.
        faces: (m, 3) numbers of places.
        area: (m,) in mm².
        normals: (m, 3) unit, 0 for triangles without area.
        neighbour: (m, 3) triangle across each edge; -1 for none, several, or a triangle that is turned over.
        across: (m, 3) edge of that neighbour.
        length: (m, 3) lengths of the edges.
        apex: (m, 3, 2) third corner as seen from each edge: distance along it, and from it.
    """

    corners: np.ndarray
    faces: np.ndarray
    area: np.ndarray
    normals: np.ndarray
    neighbour: np.ndarray
    across: np.ndarray
    length: np.ndarray
    apex: np.ndarray


def weld_surface(mesh: Mesh) -> Surface:
    """Return the surface of a mesh, its vertices at the same place joined."""
    first, place = group_places(mesh.vertices)
    return make_surface(mesh.vertices[first], place[mesh.faces])


def make_surface(places: np.ndarray, faces: np.ndarray) -> Surface:
    """Make the surface of triangles (m, 3) between places (n, 3)."""
    faces = faces.astype(np.int64)
    corners = places.astype(np.float64)[faces]
    weighted = cross_products(corners)
    area = np.linalg.norm(weighted, axis=1) / 2
    normals = weighted / np.maximum(2 * area, 1e-300)[:, None]
    neighbour, across = _match_edges(faces, len(places))
    edges = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(edges, axis=2)
    base = np.maximum(length, 1e-9)
    to_apex = np.roll(corners, -2, axis=1) - corners
    along = (to_apex * edges).sum(axis=2) / base
    # area = base * height / 2
    up = np.maximum(2 * area[:, None] / base, THINNEST * base)
    return Surface(corners, faces, area, normals, neighbour, across, length, apex=np.stack([along, up], axis=2))


def _match_edges(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3) triangle across each edge, and the edge of it; -1 unless exactly two meet in opposite directions."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    ranked = key[order]
    starts = np.flatnonzero(np.r_[True, ranked[1:] != ranked[:-1]])
    two = np.diff(starts, append=len(ranked)) == 2
    edge, other = order[starts[two]], order[starts[two] + 1]
    fits = (start[edge] == end[other]) & (start[edge] != end[edge])  # they run opposite ways: both face the same side
    edge, other = edge[fits], other[fits]
    partner = np.full(len(start), -1)
    partner[edge], partner[other] = other, edge
    return np.where(partner >= 0, partner // 3, -1).reshape(-1, 3), (partner % 3).reshape(-1, 3)


def relax(corners: np.ndarray, points_of: np.ndarray, flat: np.ndarray, steps: int) -> np.ndarray:
    """As-rigid-as-possible places of points: local and global steps (Liu et al. 2008, "A local/global approach").

    Args:
        corners: (k, 3, 3) of triangles in space.
        points_of: (k, 3) their points on the plane, each used.
        flat: (n, 2) where those begin.
        steps: number of steps.

    Returns:
        (n, 2).
    """
    own = lay_triangles(corners)
    edges = np.roll(own, -1, axis=1) - own
    twice = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    # the cotangent of the angle that faces an edge, half of it: its weight in the Dirichlet energy
    facing = np.stack([-(edges[:, (i + 1) % 3] * edges[:, (i + 2) % 3]).sum(axis=1) for i in range(3)], axis=1)
    # cot = cosine / sine = dot product / twice the area
    weight = facing / (2 * twice[:, None])
    start, end = points_of.reshape(-1), np.roll(points_of, -1, axis=1).reshape(-1)
    w, n = weight.reshape(-1), len(flat)
    rows, columns = np.concatenate([start, end, start, end]), np.concatenate([start, end, end, start])
    laplacian = scipy.sparse.coo_array((np.concatenate([w, w, -w, -w]), (rows, columns)), shape=(n, n)).tocsc()
    # a touch on the diagonal holds the whole where it is, which no edge does
    held = 1e-8 * float(np.abs(laplacian.diagonal()).mean())
    diagonal = scipy.sparse.coo_array((np.full(n, held), (np.arange(n), np.arange(n))), shape=(n, n))
    # factorised once: each global step is then two triangular solves
    solver = scipy.sparse.linalg.splu(
        scipy.sparse.csc_array(laplacian + diagonal), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
    )
    # x and y apart: sums over an axis of two or three numbers take most of the time
    along, up = (edges[..., axis].flatten() for axis in range(2))
    for _ in range(steps):
        right, rise = (side[end] - side[start] for side in flat.T)
        # the rotation that brings a triangle's own edges closest to where they lie
        dot = (w * (along * right + up * rise)).reshape(-1, 3)
        cross = (w * (along * rise - up * right)).reshape(-1, 3)
        dot, cross = (terms[:, 0] + terms[:, 1] + terms[:, 2] for terms in (dot, cross))
        size = np.maximum(np.hypot(dot, cross), 1e-30)
        cos, sin = np.repeat(dot / size, 3), np.repeat(cross / size, 3)
        pulls = w * (cos * along - sin * up), w * (sin * along + cos * up)
        pulled = [np.bincount(end, pull, n) - np.bincount(start, pull, n) for pull in pulls]
        flat = solver.solve(np.stack(pulled, axis=1) + held * flat)
    return flat


def lay_triangles(corners: np.ndarray) -> np.ndarray:
    """Lay triangles (k, 3, 3) flat, each separately: (k, 3, 2) with the first corner at 0, the second on the x axis."""
    a, b, c = np.moveaxis(corners, 1, 0)
    base = np.maximum(np.linalg.norm(b - a, axis=1), 1e-9)
    along = ((c - a) * (b - a)).sum(axis=1) / base
    up = np.maximum(np.linalg.norm(np.cross(b - a, c - a), axis=1) / base, THINNEST * base)
    zero = np.zeros(len(base))
    return np.stack([np.stack([zero, zero], 1), np.stack([base, zero], 1), np.stack([along, up], 1)], axis=1)


def edge_changes(corners: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """(k, 3) absolute relative change of edge lengths of triangles (k, 3, 3) laid flat as (k, 3, 2)."""
    solid = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    lying = np.linalg.norm(flat - np.roll(flat, -1, axis=1), axis=2)
    return np.abs(lying / np.maximum(solid, 1e-9) - 1)


def measure_stretch(corners: np.ndarray, flat: np.ndarray) -> float:
    """95th percentile, weighted by area, of the relative change of the edges' lengths; corners (k, 3, 3) and flat."""
    area = np.linalg.norm(cross_products(corners), axis=1) / 2
    return weighted_percentile(edge_changes(corners, flat).reshape(-1), np.repeat(area, 3), 0.95)


def weighted_percentile(values: np.ndarray, weights: np.ndarray, share: float) -> float:
    """Return the least value that this share of the weight does not exceed."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][min(int(np.searchsorted(total, share * total[-1])), len(values) - 1)])


def find_overlaps(flat: np.ndarray, later: np.ndarray) -> np.ndarray:
    """(k,) bool: triangles (k, 3, 2) that overlap another; of each two, that which comes `later`."""
    over = np.zeros(len(flat), bool)
    # drawn in by a hair, so that neighbours do not touch
    middle = flat.mean(axis=1, keepdims=True)
    real = np.flatnonzero(signed_areas(flat) > FLAT_MM2)
    shrunk = shapely.polygons(middle[real] + (flat[real] - middle[real]) * (1 - 1e-6))
    row, other = shapely.STRtree(shrunk).query(shrunk, predicate="intersects")
    row, other = real[row[row < other]], real[other[row < other]]
    over[np.where(later[row] > later[other], row, other)] = True
    return over


JOINED = 0.25
"""Edges whose two sides lie closer than this share of their length are joined."""


@dataclass
class Region:
    """A piece that grows.

    Attributes:
        faces: (k,) rows of the surface, in the order in which they came.
        flat: (k, 3, 2) where they lie.
        joined: (k, 3) bool, which edges are joined to their neighbour's.
        points: (k, 3), see `points_of`; None until it is called.
    """

    faces: np.ndarray
    flat: np.ndarray
    joined: np.ndarray
    points: np.ndarray | None = None


def worth_of(region: Region | None, value: np.ndarray) -> float:
    """Return the sum of the values (m,) of a region's faces; 0 without a region."""
    return 0.0 if region is None else float(value[region.faces].sum())


def take(surface: Surface, region: Region, rows: np.ndarray) -> Region:
    """A region of some of the faces."""
    part = Region(region.faces[rows], region.flat[rows], region.joined[rows])
    part.joined &= local_neighbours(surface, part) >= 0
    return part


def local_neighbours(surface: Surface, region: Region) -> np.ndarray:
    """(k, 3) the row in the region of the face across each edge, -1 where it is not in the region."""
    row = np.full(len(surface.faces) + 1, -1, np.int32)  # the last is for edges without a neighbour
    row[region.faces] = np.arange(len(region.faces))
    return row[surface.neighbour[region.faces]]


def join_edges(surface: Surface, region: Region, slack_mm: float) -> Region:
    """Join edges whose two sides lie together."""
    face, edge = np.nonzero(local_neighbours(surface, region) >= 0)
    close = lie_together(surface, region, face, edge, slack_mm)
    return join_pairs(surface, region, face[close], edge[close])


def lie_together(
    surface: Surface, region: Region, face: np.ndarray, edge: np.ndarray, slack_mm: float = 0.0
) -> np.ndarray:
    """(k,) bool: whether the two sides of edges inside a region lie within the slack, or nearly so for their length."""
    other = local_neighbours(surface, region)[face, edge]
    own = surface.across[region.faces[face], edge]
    flat = region.flat
    gap = np.maximum(
        np.linalg.norm(flat[face, edge] - flat[other, (own + 1) % 3], axis=1),
        np.linalg.norm(flat[face, (edge + 1) % 3] - flat[other, own], axis=1),
    )
    length = surface.length[region.faces[face], edge]
    return gap <= np.maximum(JOINED * length, np.minimum(slack_mm, length))


def join_pairs(surface: Surface, region: Region, face: np.ndarray, edge: np.ndarray) -> Region:
    """Join these edges of these rows and no others; joined corners move to their mean."""
    joined = np.zeros_like(region.joined)
    joined[face, edge] = True
    region = Region(region.faces, region.flat, joined)
    point = points_of(surface, region)
    count = np.bincount(point.reshape(-1))
    pulled = [np.bincount(point.reshape(-1), region.flat[..., i].reshape(-1)) for i in range(2)]
    return Region(region.faces, (np.stack(pulled, axis=1) / count[:, None])[point], joined, point)


def points_of(surface: Surface, region: Region) -> np.ndarray:
    """(k, 3) numbers of the region's points: joined corners have the same number."""
    if region.points is not None:
        return region.points
    face, edge = np.nonzero(region.joined)
    other = local_neighbours(surface, region)[face, edge]
    own = surface.across[region.faces[face], edge]
    first = np.concatenate([3 * face + edge, 3 * face + (edge + 1) % 3])
    second = np.concatenate([3 * other + (own + 1) % 3, 3 * other + own])
    region.points = connected_parts(3 * len(region.faces), first, second).reshape(-1, 3)
    return region.points


def relax_region(surface: Surface, region: Region, steps: int) -> Region:
    """As rigid as possible, in so many steps; see `relax`."""
    point = points_of(surface, region)
    flat = np.zeros((int(point.max()) + 1, 2))
    flat[point] = region.flat
    flat = relax(surface.corners[region.faces], point, flat, steps)[point]
    return Region(region.faces, flat, region.joined, point)


def hold_together(surface: Surface, region: Region, kept: np.ndarray) -> np.ndarray:
    """Rows of those kept that hang together with the first face by joined edges."""
    part = parts_of(surface, region, kept)
    return np.flatnonzero(kept & (part == part[0]))


def largest_part(surface: Surface, region: Region, kept: np.ndarray) -> np.ndarray:
    """Rows of those kept in the largest part that joined edges hold together."""
    part = parts_of(surface, region, kept)
    size = np.bincount(part, np.where(kept, surface.area[region.faces], 0))
    return np.flatnonzero(kept & (part == size.argmax()))


def parts_of(surface: Surface, region: Region, kept: np.ndarray) -> np.ndarray:
    """(k,) the part of each face, of those that joined edges between kept ones hold together."""
    face, edge = np.nonzero(region.joined)
    other = local_neighbours(surface, region)[face, edge]
    whole = kept[face] & kept[other]
    return connected_parts(len(kept), face[whole], other[whole])
