"""Cutting a mesh into pieces that face one way each, and laying them flat.

xatlas can cut meshes too, but takes the faces of a finely tessellated smooth surface for one plane: its pieces then
overlap or have no area, and on a sphere with 80 000 faces the process dies. So it only packs the pieces that are cut
here, in a time that grows with the number of faces and no faster.
"""

import numpy as np

from toolkit.objects.chart_overlap import find_winding

DIRECTIONS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACING = 0.45
"""A face may go to a direction that its normal leans this close to (cosine), for the sake of smooth borders."""
LEANING = 0.2
"""The same for the faces of pieces too small to stand alone."""
AGREE = 0.5
"""What it is worth, as a cosine, that all neighbours face the same way."""
MOST_CUTS = 8
"""Pieces that lie over themselves are halved so often at most."""


def cut_charts(vertices: np.ndarray, faces: np.ndarray, least_area: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut a mesh into connected pieces, each of which faces one way, and project each along its mean normal.

    Args:
        vertices: (n, 3), one per place (welded).
        faces: (m, 3).
        least_area: pieces smaller than this join a neighbour where they lean its way, in the vertices' unit squared.

    Returns:
        (m,) the piece of each face, 0 … count − 1; and (m, 3, 2) each corner's place on its piece, in the vertices'
        unit, counter-clockwise as seen from outside.
    """
    corners = vertices[faces].astype(np.float64)
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(weighted, axis=1) / 2
    unit = weighted / np.maximum(2 * area, 1e-300)[:, None]
    unit[area == 0] = 0
    pairs, length = _neighbours(vertices, faces)
    facing = _choose_directions(unit, pairs, length)
    piece, facing = _join_small(_pieces(facing, pairs), facing, unit, area, pairs, length, least_area)
    piece = _cut_winding(piece, facing, corners, area, pairs)
    return piece, _lay_flat(corners, unit, weighted, piece, facing)


def _neighbours(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k, 2) faces that share an edge, and (k,) the edge's length; of more than two at an edge, each with the next."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1).astype(np.int64)
    key = edges[:, 0] * len(vertices) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    pairs = np.stack([order[same], order[same + 1]], axis=1) // 3
    ends = vertices[edges[order[same]]].astype(np.float64)
    return pairs, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)


def _choose_directions(unit: np.ndarray, pairs: np.ndarray, length: np.ndarray) -> np.ndarray:
    """(m,) index of the direction each face belongs to: the one it faces, unless its neighbours outvote it."""
    m, count = len(unit), len(DIRECTIONS)
    cosine = unit @ DIRECTIONS.T
    facing = cosine.argmax(axis=1)
    allowed = (cosine >= FACING) | (unit == 0).all(axis=1, keepdims=True)
    allowed[np.arange(m), facing] = True
    both, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    weight = np.concatenate([length, length])
    around = np.maximum(np.bincount(both, weight, m), 1e-300)[:, None]
    for step in range(8):  # every second face at a time: two that swap with each other would never settle
        votes = np.bincount(both * count + facing[other], weight, m * count).reshape(m, count)
        better = np.where(allowed, cosine + AGREE * votes / around, -np.inf).argmax(axis=1)
        turn = np.arange(m) % 2 == step % 2
        facing = np.where(turn, better, facing)
    return facing


def _pieces(facing: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(m,) connected faces of one direction (or any other label), numbered from 0."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined = pairs[facing[pairs[:, 0]] == facing[pairs[:, 1]]]
    graph = coo_array((np.ones(len(joined), np.int8), (joined[:, 0], joined[:, 1])), shape=(len(facing),) * 2)
    return connected_components(graph, directed=False)[1]


def _join_small(piece, facing, unit, area, pairs, length, least_area) -> tuple[np.ndarray, np.ndarray]:
    """Give pieces under `least_area` to the neighbour they share the longest border with, if they lean its way."""
    for _ in range(6):
        count = int(piece.max()) + 1
        size = np.bincount(piece, area, count)
        lean = np.ones((count, len(DIRECTIONS)))
        np.minimum.at(lean, piece[area > 0], unit[area > 0] @ DIRECTIONS.T)
        way = np.zeros(count, np.int64)
        way[piece] = facing
        a, b = piece[np.concatenate([pairs, pairs[:, ::-1]])].T
        key, inverse = np.unique(a * count + b, return_inverse=True)
        border = np.bincount(inverse, np.concatenate([length, length]))
        a, b = np.divmod(key, count)
        fit = (a != b) & (size[a] < least_area) & (size[a] <= size[b]) & (lean[a, way[b]] >= LEANING)
        a, b, border = a[fit], b[fit], border[fit]
        goes, receives = np.arange(count), np.zeros(count, bool)
        for i in np.lexsort((-border, size[a])):
            if goes[a[i]] == a[i] and goes[b[i]] == b[i] and not receives[a[i]]:
                goes[a[i]] = b[i]
                receives[b[i]] = True
        if (goes == np.arange(count)).all():
            break
        facing = way[goes[piece]]
        piece = _pieces(facing, pairs)
    return piece, facing


def _cut_winding(piece, facing, corners, area, pairs) -> np.ndarray:
    """Halve pieces that lie over themselves at the middle of their height, as often as it takes."""
    across = np.array([[1, 2], [1, 2], [0, 2], [0, 2], [0, 1], [0, 1]])[facing]
    flat = np.take_along_axis(corners, np.repeat(across[:, None], 3, axis=1), axis=2)
    height = np.einsum("mci,mi->mc", corners, DIRECTIONS[facing])
    for _ in range(MOST_CUTS):
        winding = find_winding(flat, height, area, piece)[piece]
        if not winding.any():
            break
        count = int(piece.max()) + 1
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        middle = height.mean(axis=1)
        np.minimum.at(low, piece, middle)
        np.maximum.at(high, piece, middle)
        upper = winding & (middle > ((low + high) / 2)[piece])
        piece = _pieces(2 * piece + upper, pairs)
    return piece


def _lay_flat(corners, unit, weighted, piece, facing) -> np.ndarray:
    """(m, 3, 2) each corner on its piece, seen along its mean normal or its direction: what suits the worst face."""
    count = int(piece.max()) + 1
    mean = np.stack([np.bincount(piece, weighted[:, axis], count) for axis in range(3)], axis=1)
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    straight = np.zeros((count, 3))
    straight[piece] = DIRECTIONS[facing]
    real = (unit != 0).any(axis=1)
    worst_mean, worst_straight = np.ones(count), np.ones(count)
    np.minimum.at(worst_mean, piece[real], np.einsum("ij,ij->i", unit[real], mean[piece[real]]))
    np.minimum.at(worst_straight, piece[real], np.einsum("ij,ij->i", unit[real], straight[piece[real]]))
    axis = np.where((worst_mean >= worst_straight)[:, None], mean, straight)
    helper = np.eye(3)[np.abs(axis).argmin(axis=1)]
    right = np.cross(helper, axis)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-300)
    up = np.cross(axis, right)
    basis = np.stack([right, up], axis=1)[piece]
    return np.einsum("mij,mkj->mki", basis, corners)
