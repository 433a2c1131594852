"""Normals of the corners of triangles: smooth over flat edges, sharp over creases, for meshes of any size."""

from itertools import pairwise

import numpy as np

from toolkit.objects.grouping import group_places, group_rows, rising_order

ORDINARY_FAN = 256
"""Where more triangles than this meet, their normals are compared by cells of directions, not one by one."""
CELLS = 64
"""Cells of directions along each axis, each about 2 degrees wide."""
AT_ONCE = 1_000_000
"""Corners that are worked on at once; bounds the memory."""


def corner_normals(vertices: np.ndarray, faces: np.ndarray, crease_deg: float = 40.0) -> np.ndarray:
    """(m, 3, 3) unit normals per triangle corner: smooth across edges flatter than `crease_deg`, sharp across the rest.

    Each corner averages the area-weighted normals of the triangles that share its position and lie within the crease
    angle of its own triangle. Where more than `ORDINARY_FAN` meet, those that face one way within about 2 degrees
    count as one, so that time and memory grow with the number of triangles. A triangle without area takes the mean of
    all that meet there, and points up where there is none.
    """
    weighted = np.empty((len(faces), 3))
    for first in range(0, len(faces), AT_ONCE):
        a, b, c = np.moveaxis(vertices[faces[first : first + AT_ONCE]].astype(np.float64), 1, 0)
        weighted[first : first + AT_ONCE] = np.cross(b - a, c - a)
    place = group_places(vertices)[1][faces.reshape(-1)]
    order = rising_order(place)  # corners, place by place
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    counts = np.diff(starts, append=len(order))

    normals = np.empty((len(order), 3))
    for first, last in _split(counts):
        corners = order[starts[first] : starts[first] + int(counts[first:last].sum())]
        total = _sum_fans(weighted[corners // 3], counts[first:last], crease_deg)
        total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)
        total[~total.any(axis=1)] = (0, 0, 1)
        normals[corners] = total
    return normals.reshape(-1, 3, 3)


def _split(counts: np.ndarray) -> list[tuple[int, int]]:
    """Runs of fans, first and behind the last, of about `AT_ONCE` corners each."""
    part = np.cumsum(counts) // AT_ONCE
    edges = [0, *(np.flatnonzero(np.diff(part)) + 1).tolist(), len(counts)]
    return list(pairwise(edges))


def _sum_fans(weighted: np.ndarray, counts: np.ndarray, crease_deg: float) -> np.ndarray:
    """(n, 3) the sum for each corner of fans that lie one behind the other, of `counts` corners each."""
    unit = weighted / np.maximum(np.linalg.norm(weighted, axis=1, keepdims=True), 1e-20)
    starts = np.cumsum(counts) - counts
    fan = np.repeat(np.arange(len(counts)), counts)
    whole = np.add.reduceat(weighted, starts, axis=0)
    total = whole[fan]
    # where all lie within half the angle of their mean, any two lie within the whole angle
    mean = whole / np.maximum(np.linalg.norm(whole, axis=1, keepdims=True), 1e-20)
    near = np.einsum("ij,ij->i", unit, mean[fan]) > np.cos(np.radians(crease_deg / 2)) + 1e-9
    flat = ~unit.any(axis=1)
    creased = np.flatnonzero(np.bincount(fan, ~near & ~flat, len(counts)))
    ordinary = creased[counts[creased] <= ORDINARY_FAN]
    cosine = np.cos(np.radians(crease_deg))
    if len(ordinary):
        rows, sums = _compare_all(unit, weighted, starts[ordinary], counts[ordinary], cosine)
        total[rows] = np.where(flat[rows, None], total[rows], sums)
    for huge in creased[counts[creased] > ORDINARY_FAN]:
        part = slice(starts[huge], starts[huge] + counts[huge])
        sums = _compare_cells(unit[part], weighted[part], cosine)
        total[part] = np.where(flat[part, None], total[part], sums)
    return total


def _compare_all(
    unit: np.ndarray, weighted: np.ndarray, starts: np.ndarray, counts: np.ndarray, cosine: float
) -> tuple[np.ndarray, np.ndarray]:
    """The corners of some fans, and for each the sum of those of its fan that lie within the angle."""
    largest_first = np.argsort(-counts, kind="stable")
    starts, counts = starts[largest_first], counts[largest_first]
    ends = np.cumsum(counts)
    first = np.repeat(starts, counts)
    rows = first + np.arange(len(first)) - np.repeat(ends - counts, counts)
    total = np.zeros((len(rows), 3))
    for step in range(int(counts[0])):  # compare each corner with the step-th of its fan
        upto = ends[np.searchsorted(-counts, -step, "left") - 1]
        other = first[:upto] + step
        smooth = np.flatnonzero(np.einsum("ij,ij->i", unit[rows[:upto]], unit[other]) >= cosine)
        total[smooth] += weighted[other[smooth]]
    return rows, total


def _compare_cells(unit: np.ndarray, weighted: np.ndarray, cosine: float) -> np.ndarray:
    """(n, 3) as `_compare_all` for one fan: each corner with the means of cells of directions."""
    first, cell = group_rows(list(np.round((unit.T + 1) * (CELLS / 2)).astype(np.int64)))
    sums = np.stack([np.bincount(cell, axis, len(first)) for axis in weighted.T], axis=1)
    mean = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-20)
    parts = np.array_split(unit, -(-unit.shape[0] * len(first) // AT_ONCE))
    return np.concatenate([(part @ mean.T >= cosine) @ sums for part in parts])
