"""Triangles of polygons: fans where they are convex, else by cutting off ears."""

import numpy as np


def triangulate(vertices: np.ndarray, corner_vertex: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Triangulate a mesh's polygons: triangles first, then quadrilaterals, then all others.

    Args:
        vertices: (n, 3).
        corner_vertex: (c,) the vertex of each corner, polygon by polygon.
        counts: (f,) number of corners of each polygon; with less than 3 it has no surface.

    Returns:
        (m, 3) numbers of corners.
    """
    starts = np.cumsum(counts) - counts
    if (counts == 3).all():
        return np.asarray(starts[:, None] + np.arange(3))
    pieces = [starts[counts == 3][:, None] + np.arange(3)]
    quads = starts[counts == 4][:, None] + np.arange(4)
    # a quadrilateral that is no fan from its first corner is one from its second
    turned = ~is_fan(vertices[corner_vertex[quads]])
    quads[turned] = np.roll(quads[turned], -1, axis=1)  # the other diagonal
    pieces += [quads[:, :3], quads[:, [2, 3, 0]]]
    large = np.flatnonzero(counts > 4)
    pieces += [
        start + triangulate_polygon(vertices[corner_vertex[start : start + count]])
        for start, count in zip(starts[large], counts[large], strict=True)
    ]
    return np.concatenate(pieces)


def is_fan(places: np.ndarray) -> np.ndarray:
    """(f,) whether the fan from the first corner covers polygons (f, k, 3): no triangle of it is turned over."""
    first = places[:, :1]
    edges = places[:, 1:] - first
    normals = np.cross(edges[:, :-1], edges[:, 1:])
    whole = normals.sum(axis=1)
    along = np.einsum("fkd,fd->fk", normals, whole)
    # rounding turns triangles without an area over
    return np.asarray((along >= -1e-9 * np.einsum("fd,fd->f", whole, whole)[:, None]).all(axis=1))


def triangulate_polygon(places: np.ndarray) -> np.ndarray:
    """(k - 2, 3) corners of the triangles of a polygon (k, 3), in its direction."""
    count = len(places)
    if is_fan(places[None])[0]:
        return np.stack([np.zeros(count - 2, np.int64), *(np.arange(1, count - 1) + step for step in (0, 1))], axis=1)
    # Newell's normal: the polygon may be bent and not convex
    edges = places[1:] - places[0]
    normal = np.cross(edges[:-1], edges[1:]).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    # seen along the axis that it faces most, counter-clockwise
    flat = places[:, [(axis + 1) % 3, (axis + 2) % 3]] * [1, 1 if normal[axis] > 0 else -1]
    # an ear is cut off until a triangle is left
    left = np.arange(count)
    triangles = []
    while len(left) > 3:
        ear = _find_ear(flat[left])
        triangles.append(left[[ear - 1, ear, (ear + 1) % len(left)]])
        left = np.delete(left, ear)
    return np.array([*triangles, left])


def _find_ear(ring: np.ndarray) -> int:
    """Find a corner of a counter-clockwise polygon (k, 2) that can be cut off: convex, and without others inside."""
    before, behind = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    turn = _cross(ring - before, behind - ring)
    hollow = ring[turn <= 0]
    for corner in np.flatnonzero(turn > 0):
        a, b, c = before[corner], ring[corner], behind[corner]
        sides = np.stack([_cross(q - p, hollow - p) for p, q in ((a, b), (b, c), (c, a))])
        if not (sides > 0).all(axis=0).any():
            return int(corner)
    return int(turn.argmax())  # the polygon crosses itself


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
