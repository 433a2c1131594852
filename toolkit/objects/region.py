"""A part of a surface that lies in the plane: which of its edges are joined, and what hangs together."""

from dataclasses import dataclass

import numpy as np

from toolkit.objects.flatten import Surface, relax

JOINED = 0.25
"""Edges whose two sides lie closer than this share of their length are joined."""


@dataclass
class Region:
    """A piece that grows.

    Attributes:
        faces: (k,) rows of the surface, in the order in which they came.
        flat: (k, 3, 2) where they lie.
        joined: (k, 3) bool, which edges are joined to their neighbour's.
    """

    faces: np.ndarray
    flat: np.ndarray
    joined: np.ndarray


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
    """Join these edges of these rows and no others; corners that are one point then lie at their mean."""
    joined = np.zeros_like(region.joined)
    joined[face, edge] = True
    region = Region(region.faces, region.flat, joined)
    point = points_of(surface, region)
    count = np.bincount(point.reshape(-1))
    pulled = [np.bincount(point.reshape(-1), region.flat[..., i].reshape(-1)) for i in range(2)]
    return Region(region.faces, (np.stack(pulled, axis=1) / count[:, None])[point], joined)


def points_of(surface: Surface, region: Region) -> np.ndarray:
    """(k, 3) numbers of the region's points: corners that joined edges make one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    face, edge = np.nonzero(region.joined)
    other = local_neighbours(surface, region)[face, edge]
    own = surface.across[region.faces[face], edge]
    one = np.concatenate([3 * face + edge, 3 * face + (edge + 1) % 3])
    two = np.concatenate([3 * other + (own + 1) % 3, 3 * other + own])
    count = 3 * len(region.faces)
    graph = coo_array((np.ones(len(one), np.int8), (one, two)), shape=(count, count))
    return connected_components(graph, directed=False)[1].reshape(-1, 3)


def relax_region(surface: Surface, region: Region, steps: int) -> Region:
    """As rigid as possible, in so many steps; see `relax`."""
    point = points_of(surface, region)
    flat = np.zeros((int(point.max()) + 1, 2))
    flat[point] = region.flat
    return Region(region.faces, relax(surface.corners[region.faces], point, flat, steps)[point], region.joined)


def hold_together(surface: Surface, region: Region, kept: np.ndarray) -> np.ndarray:
    """Rows of those kept that hang together with the first face by joined edges."""
    part = _parts_of(surface, region, kept)
    return np.flatnonzero(kept & (part == part[0]))


def largest_part(surface: Surface, region: Region, kept: np.ndarray) -> np.ndarray:
    """Rows of those kept in the largest part that joined edges hold together."""
    part = _parts_of(surface, region, kept)
    size = np.bincount(part, np.where(kept, surface.area[region.faces], 0))
    return np.flatnonzero(kept & (part == size.argmax()))


def _parts_of(surface: Surface, region: Region, kept: np.ndarray) -> np.ndarray:
    """(k,) the part of each face, of those that joined edges between kept ones hold together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    face, edge = np.nonzero(region.joined)
    other = local_neighbours(surface, region)[face, edge]
    whole = kept[face] & kept[other]
    count = len(kept)
    graph = coo_array((np.ones(int(whole.sum()), np.int8), (face[whole], other[whole])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
