"""A surface with few triangles in place of one with many: pieces are looked for on it, and taken back to the many.

Simplified by quadric errors (Garland and Heckbert 1997), then long edges are halved (Rivara 1984), so that no
triangle is much larger than others.
"""

from dataclasses import dataclass

import numpy as np

from toolkit.objects.flatten import (
    Region,
    Surface,
    join_pairs,
    largest_part,
    lay_triangles,
    lie_together,
    local_neighbours,
    make_surface,
    points_of,
    take,
)
from toolkit.objects.open3d import load_open3d

MANY = 14_000
"""A surface with more triangles is made coarse."""
FEW = 8_000
"""So many are aimed at."""
LIFT_MM = 0.3
"""Nearest places are looked for from so far outside: of a thin wall's two sides the nearer is the own one."""
LEAST_COSINE = 0.3
"""Between the normals of a triangle and the coarse one that it is taken to lie on."""


@dataclass(frozen=True)
class Coarse:
    """A coarse surface.

    Attributes:
        surface: of it.
        parent: (m,) the coarse triangle that each of the many lies on, -1 where there is none.
    """

    surface: Surface
    parent: np.ndarray


def make_coarse(surface: Surface, allowed: np.ndarray) -> Coarse:
    """The coarse surface of those faces that pieces may have.

    Args:
        surface: with m faces.
        allowed: (m,) bool.
    """
    o3d = load_open3d()

    rows = np.flatnonzero(allowed)
    used, faces = np.unique(surface.faces[rows], return_inverse=True)
    places = np.zeros((len(used), 3))
    places[faces.reshape(-1)] = surface.corners[rows].reshape(-1, 3)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(places), o3d.utility.Vector3iVector(faces.reshape(-1, 3))
    )
    mesh = mesh.simplify_quadric_decimation(FEW // 2)
    places, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)
    area = float(surface.area[rows].sum())
    # an equilateral triangle's side, of which FEW would cover the whole
    places, faces = halve_long_edges(places, faces, 2.5 * float(np.sqrt(4 / np.sqrt(3) * area / FEW)))
    coarse = make_surface(places, faces)
    parent = np.full(len(allowed), -1)
    parent[rows] = _find_nearest(coarse, surface.corners[rows].mean(axis=1), surface.normals[rows])
    return Coarse(coarse, parent)


def halve_long_edges(places: np.ndarray, faces: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut triangles (m, 3) at the middle of edges that are longer, until none is; neighbours stay edge to edge."""
    while True:
        start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
        key = np.minimum(start, end) * len(places) + np.maximum(start, end)
        edges, edge = np.unique(key, return_inverse=True)
        edge = edge.reshape(-1, 3)
        ends = np.stack([edges // len(places), edges % len(places)], axis=1)
        length = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
        # equal lengths in the same order for both sides
        rank = np.empty(len(edges), np.int64)
        rank[np.argsort(length, kind="stable")] = np.arange(len(edges))
        longest_of = edge[np.arange(len(faces)), rank[edge].argmax(axis=1)]
        around = np.bincount(edge.reshape(-1), minlength=len(edges))
        # an edge is cut where it is the longest of all triangles at it (Rivara 1984): no hanging corner is left
        cut = (np.bincount(longest_of, minlength=len(edges)) == around) & (length > longest)
        if not cut.any():
            return places, faces
        middle = np.full(len(edges), -1)
        middle[cut] = len(places) + np.arange(int(cut.sum()))
        halved = np.flatnonzero(cut[longest_of])
        side = (edge[halved] == longest_of[halved, None]).argmax(axis=1)
        turned = faces[halved[:, None], (side[:, None] + np.arange(3)) % 3]
        new = middle[longest_of[halved]]
        first = np.stack([turned[:, 0], new, turned[:, 2]], axis=1)
        second = np.stack([new, turned[:, 1], turned[:, 2]], axis=1)
        places = np.concatenate([places, places[ends[cut]].mean(axis=1)])
        faces = np.concatenate([np.delete(faces, halved, axis=0), first, second])


def _find_nearest(coarse: Surface, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(k,) the coarse triangle nearest to each point that faces the same way, -1 where it does not."""
    o3d = load_open3d()

    scene = o3d.t.geometry.RaycastingScene()
    vertices = coarse.corners.reshape(-1, 3).astype(np.float32)
    scene.add_triangles(
        o3d.core.Tensor(vertices), o3d.core.Tensor(np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3))
    )
    lifted = (points + LIFT_MM * normals).astype(np.float32)
    nearest = scene.compute_closest_points(o3d.core.Tensor(lifted))["primitive_ids"].numpy().astype(np.int64)
    return np.where((coarse.normals[nearest] * normals).sum(axis=1) > LEAST_COSINE, nearest, -1)


def take_back(surface: Surface, coarse: Coarse, region: Region, free: np.ndarray) -> Region | None:
    """The region of the many triangles that lie on a region of the coarse ones, each at its place on it.

    Args:
        surface: with m faces.
        coarse: of it.
        region: of coarse triangles.
        free: (m,) faces that it may have.
    """
    where = np.full(len(coarse.surface.faces), -1)
    where[region.faces] = np.arange(len(region.faces))
    row = np.where(coarse.parent >= 0, where[coarse.parent], -1)
    faces = np.flatnonzero((row >= 0) & free)
    if not len(faces):
        return None
    row, under = row[faces], coarse.surface.corners[region.faces]
    # a corner's place in its coarse triangle's own plane, then as that triangle is turned on the piece
    x = under[:, 1] - under[:, 0]
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(coarse.surface.normals[region.faces], x)
    own = lay_triangles(under)
    onto = np.linalg.solve((own[:, 1:] - own[:, :1]), (region.flat[:, 1:] - region.flat[:, :1]))
    from_first = surface.corners[faces] - under[row, :1]
    local = np.stack([np.einsum("kci,ki->kc", from_first, axis[row]) for axis in (x, y)], axis=2)
    flat = region.flat[row, :1] + local @ onto[row]
    # neighbours are joined where their coarse triangles have a point of the region in common
    fine = Region(faces, flat, np.zeros((len(faces), 3), bool))
    neighbour = local_neighbours(surface, fine)
    face, edge = np.nonzero(neighbour >= 0)
    point = points_of(coarse.surface, region)
    one, other = point[row[face]], point[row[neighbour[face, edge]]]
    near = (one[:, :, None] == other[:, None, :]).any(axis=(1, 2)) | lie_together(surface, fine, face, edge)
    fine = join_pairs(surface, fine, face[near], edge[near])
    return take(surface, fine, largest_part(surface, fine, np.ones(len(faces), bool)))
