"""What a 3D printer asks of a surface: whether it is closed, and how thick its walls are."""

from dataclasses import dataclass

import numpy as np

from toolkit.objects.grouping import group_places, group_rows
from toolkit.objects.mesh import Mesh, cross_products, make_ray_scene

SAMPLES = 20_000
THIN_MM = 1.0
"""What services for colour printing in gypsum, resin or nylon ask of a wall at least."""
EDGE_DEG = 45.0
"""Sides that stand to each other at more than this are an edge of the object, not the two sides of a wall."""
STEP_MM = 1e-3
"""A ray starts this far below the surface, so that it does not meet the triangle that it comes from."""


def join_places(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices at one place joined into one: (n, 3) float32 places, (k, 3) int32 faces of them, (k,) rows of `faces`.

    Triangles two of whose corners fall together are left out.
    """
    first, place = group_places(mesh.vertices)
    joined = place[mesh.faces]
    kept = np.flatnonzero((joined != np.roll(joined, 1, axis=1)).all(axis=1))
    return mesh.vertices[first], joined[kept].astype(np.int32), kept


@dataclass(frozen=True)
class Soundness:
    """How a surface stands to being printed in 3D.

    Attributes:
        open_edges: edges of one triangle alone, where the surface has a border.
        tangled_edges: edges of more than two triangles, or that two run through in one direction.
        thinnest_mm: thickness that one place of a thousand falls below; None for a surface without an inside.
        thin_share: share of the surface whose wall is under `THIN_MM`.
    """

    open_edges: int
    tangled_edges: int
    thinnest_mm: float | None
    thin_share: float

    @property
    def is_watertight(self) -> bool:
        """Whether every edge joins two triangles that face one way."""
        return self.open_edges == self.tangled_edges == 0

    def describe(self) -> str:
        """One line for people."""
        if self.is_watertight:
            closed = "watertight"
        else:
            parts = [(self.open_edges, "open"), (self.tangled_edges, "tangled")]
            counted = " and ".join(f"{count:,} {word} edges" for count, word in parts if count)
            closed = f"not watertight ({counted}): let the printer's program repair it"
        if self.thinnest_mm is None:
            return f"{closed}; no walls to measure"
        thin = f", {100 * self.thin_share:.2g} % of them under {THIN_MM:g} mm" if self.thin_share else ""
        return f"{closed}; walls from {self.thinnest_mm:.2g} mm{thin}"


def examine_solid(mesh: Mesh, seed: int = 0) -> Soundness:
    """Count the edges that are not closed, and measure the walls.

    A wall's thickness at a place is the way of a ray from it straight inwards to where it leaves the object; parts that
    overlap count as one. Rays are cast from `SAMPLES` places spread by area.

    Args:
        mesh: in millimetres.
        seed: of the places.
    """
    faces = join_places(mesh)[1]
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    first, index = group_rows([low, high])
    count = np.bincount(index, minlength=len(first))
    # two triangles that face one way run along their edge in opposite directions: the sum is 0
    balance = np.bincount(index, np.where(edges[:, 0] == low, 1, -1), minlength=len(first))
    open_edges = int((count == 1).sum())
    tangled = int(((count > 2) | ((count == 2) & (balance != 0))).sum())
    walls = _measure_walls(mesh, np.random.default_rng(seed))
    if not len(walls):
        return Soundness(open_edges, tangled, None, 0.0)
    return Soundness(open_edges, tangled, float(np.quantile(walls, 0.001)), float((walls < THIN_MM).mean()))


def _measure_walls(mesh: Mesh, rng: np.random.Generator) -> np.ndarray:
    """Thickness in mm of the wall below places drawn by area.

    Places inside other parts, and those whose ray never leaves, are left out.
    """
    import open3d as o3d

    cross = cross_products(mesh.vertices[mesh.faces])
    length = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(length, 1e-20)[:, None]
    face = rng.choice(len(length), SAMPLES, p=length / length.sum())
    # uniform over a triangle: Osada et al. 2002, equation 1
    root, along = np.sqrt(rng.random((SAMPLES, 1))), rng.random((SAMPLES, 1))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[face]].astype(np.float64), 1, 0)
    start = (1 - root) * a + root * (1 - along) * b + root * along * c
    rays = np.concatenate([start - STEP_MM * normal[face], -normal[face]], axis=1).astype(np.float32)
    found = make_ray_scene(mesh).list_intersections(o3d.core.Tensor(rays))
    ray, way, met = (found[key].numpy() for key in ("ray_ids", "t_hit", "primitive_ids"))
    order = np.lexsort([way, ray])
    ray, way, met = ray[order].astype(np.int64), way[order], met[order].astype(np.int64)
    # one deep at the start; each surface met leaves a part (+1) or enters another (-1)
    facing = np.einsum("ij,ij->i", normal[met], -normal[face[ray]])
    leaves = np.where(facing > 0, 1, -1)
    # a ray that starts one deep leaves once more than it enters; others start in another part, or leave by a hole
    net = np.bincount(ray, leaves, SAMPLES)
    sound = net[ray] == 1
    ray, way, facing, leaves = ray[sound], way[sound], facing[sound], leaves[sound]
    total = np.cumsum(leaves)
    starts = np.flatnonzero(np.diff(ray, prepend=-1))
    before = np.repeat(total[starts] - leaves[starts], np.diff(starts, append=len(ray)))
    out = np.flatnonzero(total - before == 1)
    last = out[np.unique(ray[out], return_index=True)[1]]
    is_wall = facing[last] > np.cos(np.radians(EDGE_DEG))
    return way[last][is_wall] + STEP_MM
