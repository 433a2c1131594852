"""Grow flat pieces over a surface: unroll them triangle by triangle, relax, and trim where they stretch.

After Sorkine et al. 2002, "Bounded-distortion piecewise mesh parameterization". Cylinders and cones unroll without
stretch; the two ends of the unrolled sheet are not joined, but form a seam.
"""

from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.console import progress
from toolkit.objects.mesh import Mesh, load_open3d, make_triangle_scene, signed_areas
from toolkit.objects.unwrap import cut_charts, spread
from toolkit.rooms.wraps.cutting.flatten import (
    FLAT_MM2,
    Region,
    Surface,
    edge_changes,
    hold_together,
    join_edges,
    join_pairs,
    largest_part,
    lay_triangles,
    lie_together,
    local_neighbours,
    make_surface,
    points_of,
    relax_region,
    take,
    weighted_percentile,
    weld_surface,
    worth_of,
)
from toolkit.rooms.wraps.cutting.trim import NARROWEST_MM, Limits, even_border, finish, leave_hidden, make_piece
from toolkit.rooms.wraps.wrap import FlatPiece

MANY, FEW = 14_000, 8_000
"""A surface with more triangles is simplified to about so many."""
LIFT_MM = 0.3
"""Nearest places are searched from so far outside, to find the right side of a thin wall."""
LEAST_COSINE = 0.3
"""Between the normals of a triangle and the coarse triangle below it."""
RING = 1.35
"""A piece's radius grows by this factor before it is relaxed again."""
CELL_MM = 1.0
"""Overlaps are searched on cells of this size, or of a 128th of the piece."""
LEAST_GAIN = 0.002
"""Least share of all value that is worth a piece."""
SPARED = 0.85
"""Share of the stretch that a coarse piece may have: finer triangles add to it."""
TRIED = 4
"""Seeds of a next piece, of which the best is taken."""
ALONG = 3.0
"""A strip grows so much faster along its axis."""
SMOOTH_DEG = 20.0
"""Edges bent by less are crossed first, so that flat parts stay whole."""


@dataclass(frozen=True)
class Coarse:
    """A coarse surface, and (m,) the coarse triangle below each fine triangle, -1 for none."""

    surface: Surface
    parent: np.ndarray


def make_coarse(surface: Surface, allowed: np.ndarray) -> Coarse:
    """Return the coarse surface of the faces that pieces may have, (m,) bool."""
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
    # long triangles would lie badly over a curve: edges are bounded
    places, faces = halve_long_edges(places, faces, 2.5 * float(np.sqrt(4 / np.sqrt(3) * area / FEW)), FEW)
    coarse = make_surface(places, faces)
    parent = np.full(len(allowed), -1)
    parent[rows] = _find_nearest(coarse, surface.corners[rows].mean(axis=1), surface.normals[rows])
    return Coarse(coarse, parent)


def halve_long_edges(places: np.ndarray, faces: np.ndarray, longest: float, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Cut triangles (m, 3) at the middle of longer edges until there are none, or `most` faces."""
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
        if not cut.any() or len(faces) >= most:  # slivers, which decimation leaves on a flat part, take many cuts
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
    scene = make_triangle_scene(coarse.corners.reshape(-1, 3), np.arange(3 * len(coarse.faces)).reshape(-1, 3))
    lifted = load_open3d().core.Tensor((points + LIFT_MM * normals).astype(np.float32))
    nearest = scene.compute_closest_points(lifted)["primitive_ids"].numpy().astype(np.int64)
    return np.where((coarse.normals[nearest] * normals).sum(axis=1) > LEAST_COSINE, nearest, -1)


def take_back(surface: Surface, coarse: Coarse, region: Region, free: np.ndarray) -> Region | None:
    """Return the region of fine triangles, of the `free` (m,), on a region of coarse triangles."""
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
    # neighbours are joined if their coarse triangles share a point of the region
    fine = Region(faces, flat, np.zeros((len(faces), 3), bool))
    neighbour = local_neighbours(surface, fine)
    face, edge = np.nonzero(neighbour >= 0)
    point = points_of(coarse.surface, region)
    here, there = point[row[face]], point[row[neighbour[face, edge]]]
    near = (here[:, :, None] == there[:, None, :]).any(axis=(1, 2)) | lie_together(surface, fine, face, edge)
    fine = join_pairs(surface, fine, face[near], edge[near])
    return take(surface, fine, largest_part(surface, fine, np.ones(len(faces), bool)))


def find_pieces(mesh: Mesh, value: np.ndarray, allowed: np.ndarray, limits: Limits, count: int) -> list[FlatPiece]:
    """Find at most `count` pieces with the most value, best first.

    Args:
        mesh: mesh in mm.
        value: (m,) value of each face.
        allowed: (m,) faces that pieces may have.
        limits: limits of each piece.
        count: most pieces.
    """
    surface = weld_surface(mesh)
    free = allowed & (surface.area > 0)
    if float(value[free].sum()) <= 0:
        return []
    if int(free.sum()) > MANY:
        found = _find_coarsely(surface, make_coarse(surface, free), value, free, limits, count)
    else:
        found = find_regions(surface, value, free, limits, count)
    found = [leave_hidden(surface, region, value, limits) for region in found]
    found.sort(key=lambda region: -worth_of(region, value))
    return [make_piece(surface, region, limits.sheet_mm) for region in found]


def _find_coarsely(
    surface: Surface, coarse: Coarse, value: np.ndarray, free: np.ndarray, limits: Limits, count: int
) -> list[Region]:
    """Find regions on the coarse surface, and finish them on the fine surface."""
    held = coarse.parent >= 0
    worth = np.bincount(coarse.parent[held], value[held], len(coarse.surface.faces))
    tighter = replace(limits, stretch=SPARED * limits.stretch)
    found = find_regions(coarse.surface, worth, coarse.surface.area > 0, tighter, count)
    fine = [take_back(surface, coarse, region, free) for region in found]
    left, done = free.copy(), []
    for region in fine:
        left[region.faces if region is not None else []] = False
    for region in fine:
        whole = None if region is None else finish(surface, region, value, limits)
        even = None if whole is None else finish(surface, even_border(surface, whole, left), value, limits)
        if whole is not None:
            done.append(whole if even is None else even)
            left[done[-1].faces] = False
    return done


def find_regions(surface: Surface, value: np.ndarray, free: np.ndarray, limits: Limits, count: int) -> list[Region]:
    """At most `count` regions, each the best of a few that grow where most value is left; see `find_pieces`."""
    free, total = free.copy(), float(value[free].sum())
    rows = np.flatnonzero(free)
    # charts only give the start: a region grows across their borders
    places = np.zeros((int(surface.faces.max()) + 1, 3))
    places[surface.faces.reshape(-1)] = surface.corners.reshape(-1, 3)
    chart = np.full(len(free), -1)
    chart[rows] = cut_charts(places, surface.faces[rows], least_area=NARROWEST_MM**2)[0]
    grown: dict[int, Region | None] = {}
    found: list[Region] = []
    with progress("looking for pieces", count) as bar:
        while len(found) < count:
            # charts with the most value left come first, until a few regions compete or some grew in vain
            left = np.bincount(chart[free], value[free], int(chart.max()) + 1)
            in_vain = 0
            for k in np.argsort(-left, kind="stable"):
                is_enough = sum(region is not None for region in grown.values()) >= TRIED or in_vain >= TRIED
                if is_enough or left[k] <= 0.5 * LEAST_GAIN * total:
                    break
                if k not in grown:
                    grown[k] = grow_best(surface, _middle_of(surface, value, free & (chart == k)), free, value, limits)
                    in_vain += grown[k] is None
            best = max(grown.values(), key=lambda region: worth_of(region, value), default=None)
            if best is None or worth_of(best, value) < LEAST_GAIN * total:
                break
            # a straight border is easier to cut out by hand; it may not cost the piece its fit
            even = finish(surface, even_border(surface, best, free), value, limits)
            best = best if even is None else even
            found.append(best)
            free[best.faces] = False
            # regions that lost faces grow again, and charts that changed have another middle
            changed = set(chart[best.faces].tolist())
            grown = {
                k: region for k, region in grown.items()
                if (k not in changed if region is None else bool(free[region.faces].all()))
            }  # fmt: skip
            bar.advance()
    return found


def _middle_of(surface: Surface, value: np.ndarray, chosen: np.ndarray) -> int:
    """Return the face nearest to the centre of value of the chosen faces."""
    rows = np.flatnonzero(chosen)
    middles = surface.corners[rows].mean(axis=1)
    weight = value[rows] + 1e-12
    centre = (weight[:, None] * middles).sum(axis=0) / weight.sum()
    return int(rows[np.linalg.norm(middles - centre, axis=1).argmin()])


def grow_best(surface: Surface, seed: int, free: np.ndarray, value: np.ndarray, limits: Limits) -> Region | None:
    """Return the better of two pieces that grow from a seed, in all directions or along an axis, if wide enough."""
    best: Region | None = None
    most = 0.0
    for axis in (None, np.array([0.0, 0.0, 1.0])):
        grown, is_whole = grow_piece(surface, seed, free, limits, axis)
        region = finish(surface, grown, value, limits)
        if worth_of(region, value) > most:
            best, most = region, worth_of(region, value)
        if is_whole:  # no face was dropped for its stretch: growing along the axis finds the same
            break
    return best


def grow_piece(
    surface: Surface, seed: int, free: np.ndarray, limits: Limits, axis: np.ndarray | None = None
) -> tuple[Region, bool]:
    """Grow a piece from a face over the free faces; also return whether it stopped only for lack of faces."""
    distance = _measure_ways(surface, seed, free, axis)
    place = np.full(len(free), -1)  # of each face in the region
    blocked = ~free
    # the first triangle lies with an edge along x
    first = np.array([[0, 0], [surface.length[seed, 0], 0], surface.apex[seed, 0]])
    region = Region(np.array([seed]), first[None], np.zeros((1, 3), bool))
    place[seed] = 0
    # the region grows by rings, each RING times as far out as the last
    radius = 1.5 * float(np.sqrt(surface.area[seed])) + 1e-9
    reach = min(float(distance[np.isfinite(distance)].max()), float(np.hypot(*limits.sheet_mm)))
    radius = max(radius, reach / 500)
    is_whole = True
    while True:
        before = len(region.faces)
        region = _unroll(surface, region, place, blocked, distance, radius)
        if len(region.faces) > before:
            region, dropped = _settle(surface, region, limits.stretch, radius, before)
            # a face that stretched too much is never tried again
            if len(dropped):
                is_whole = False
                blocked[dropped] = True
            place[:] = -1
            place[region.faces] = np.arange(len(region.faces))
        if radius > reach:
            return region, is_whole
        radius *= RING


def _measure_ways(surface: Surface, seed: int, free: np.ndarray, axis: np.ndarray | None) -> np.ndarray:
    """(m,) mean distance along edges from the seed to each free face's corners; with an axis, shorter along it."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    rows = np.flatnonzero(free)
    # an edge is a step of its own length; with an axis, the part along the surface's projection of it counts less
    start, end = surface.faces[rows].reshape(-1), np.roll(surface.faces[rows], -1, axis=1).reshape(-1)
    step = (np.roll(surface.corners[rows], -1, axis=1) - surface.corners[rows]).reshape(-1, 3)
    size = (step**2).sum(axis=1)
    if axis is not None:
        normal = np.repeat(surface.normals[rows], 3, axis=0)
        tangent = axis - normal * (normal @ axis)[:, None]
        along = ((step * tangent).sum(axis=1) / np.maximum(np.linalg.norm(tangent, axis=1), 0.3)) ** 2
        size = size - along * (1 - ALONG**-2)
    count = int(surface.faces.max()) + 1
    # two faces share an edge: the graph needs it once
    _, once = np.unique(np.minimum(start, end) * count + np.maximum(start, end), return_index=True)
    way = np.sqrt(np.maximum(size[once], 1e-18))
    graph = coo_array((way, (start[once].astype(np.int32), end[once].astype(np.int32))), shape=(count, count)).tocsr()
    from_seed = np.asarray(dijkstra(graph, directed=False, indices=surface.faces[seed], min_only=True))
    distance = from_seed[surface.faces].mean(axis=1)
    distance[~free] = np.inf
    return distance


def _unroll(
    surface: Surface, region: Region, place: np.ndarray, blocked: np.ndarray, distance: np.ndarray, radius: float
) -> Region:
    """Add all free faces within the radius, each turned about an edge into the plane; `place` is kept up to date."""
    faces, flats = [region.faces], [region.flat]
    size = len(region.faces)
    last, last_flat = region.faces, region.flat
    is_whole = True  # whether `last` is the whole region
    while True:
        parent, edge = np.nonzero(surface.neighbour[last] >= 0)
        face = surface.neighbour[last[parent], edge]
        near = (place[face] < 0) & ~blocked[face] & (distance[face] < radius)
        parent, edge, face = parent[near], edge[near], face[near]
        bend = (surface.normals[face] * surface.normals[last[parent]]).sum(axis=1)
        smooth = bend > np.cos(np.radians(SMOOTH_DEG))
        if smooth.any():
            parent, edge, face = parent[smooth], edge[smooth], face[smooth]
        elif not is_whole:
            last, last_flat, is_whole = np.concatenate(faces), np.concatenate(flats), True
            continue
        if not len(face):
            break
        if not smooth.any():  # few at a time over a fold, so that the flat part behind it comes from one side
            few = np.argsort(distance[face], kind="stable")[: 1 + len(face) // 50]
            parent, edge, face = parent[few], edge[few], face[few]
        # of several edges that lead to a face, that of the face nearest to the seed
        order = np.lexsort((distance[last[parent]], face))
        face, first = np.unique(face[order], return_index=True)
        parent, edge = parent[order][first], edge[order][first]
        own = surface.across[last[parent], edge]
        # edges of neighbours run opposite ways
        start, end = last_flat[parent, (edge + 1) % 3], last_flat[parent, edge]
        along = (end - start) / np.maximum(np.linalg.norm(end - start, axis=1, keepdims=True), 1e-12)
        up = np.stack([-along[:, 1], along[:, 0]], axis=1)
        apex = surface.apex[face, own]
        flat = np.empty((len(face), 3, 2))
        rows = np.arange(len(face))
        flat[rows, own], flat[rows, (own + 1) % 3] = start, end
        flat[rows, (own + 2) % 3] = start + apex[:, :1] * along + apex[:, 1:] * up
        place[face] = size + rows
        size += len(face)
        faces.append(face)
        flats.append(flat)
        last, last_flat, is_whole = face, flat, False
    joined = np.zeros((size, 3), bool)
    joined[: len(region.joined)] = region.joined
    return Region(np.concatenate(faces), np.concatenate(flats), joined)


def _settle(surface: Surface, region: Region, stretch: float, radius: float, before: int) -> tuple[Region, np.ndarray]:
    """Join, relax and trim a region to the allowed stretch; return the dropped faces. The first `before` settled."""
    dropped: list[np.ndarray] = []
    for attempt in range(6):
        # stretch as the 95 % quantile over edges, by area: a few small faces may stretch more
        region = join_edges(surface, region, stretch * radius)
        corners = surface.corners[region.faces]
        change = edge_changes(corners, region.flat)
        area = surface.area[region.faces]
        worst = change.max(axis=1)
        loose = np.repeat(area, 3)
        value = weighted_percentile(change.reshape(-1), loose, 0.95)
        # relaxing costs most, and a region that hardly stretches can wait
        if value > 0.2 * stretch:
            region = relax_region(surface, region, 6)
            change = edge_changes(corners, region.flat)
            worst = change.max(axis=1)
            value = weighted_percentile(change.reshape(-1), loose, 0.95)
        # triangles that turned over, and those that lie on others, cannot be printed at all
        bad = (signed_areas(region.flat) <= 0) & (area > FLAT_MM2)
        bad |= _lies_double(surface, region)
        is_new = np.arange(len(area)) >= before
        if value > stretch:
            # the worst new faces go, fewer each time as the rest relaxes
            limit = max(stretch, weighted_percentile(worst, area, 0.85))
            bad |= (worst > limit) & (is_new | (attempt > 2))
            if not bad.any():
                bad = is_new & (worst > 0.5 * stretch) if attempt < 4 else is_new
        if not bad.any():
            break
        # the seed stays, whatever it stretches: the region would have no start
        bad[0] = False
        kept = hold_together(surface, region, ~bad)
        dropped.append(region.faces[bad])
        before = int((kept < before).sum())
        region = take(surface, region, kept)
    return region, np.concatenate(dropped) if dropped else np.zeros(0, np.int64)


def _lies_double(surface: Surface, region: Region) -> np.ndarray:
    """(k,) bool: faces in cells of the plane with an earlier face of another part of the surface."""
    area = signed_areas(region.flat)
    # two samples a cell; the plane has some 128 × 128 cells
    cell = max(CELL_MM, float(np.sqrt(np.abs(area).sum())) / 128)
    samples = np.clip(np.ceil(2 * np.abs(area) / cell**2), 1, 4096).astype(np.int64)
    face = np.repeat(np.arange(len(area)), samples)
    weights = spread(len(face))
    flat = np.einsum("kc,kci->ki", weights, region.flat[face])
    solid = np.einsum("kc,kci->ki", weights, surface.corners[region.faces[face]])
    grid = np.floor(flat / cell).astype(np.int64)
    grid -= grid.min(axis=0)
    key = grid[:, 0] * (int(grid[:, 1].max()) + 1) + grid[:, 1]
    # in each cell the first face leads; samples that lie far from it in space are of another part
    leader = np.zeros(int(key.max()) + 1, np.int64)
    leader[key[::-1]] = np.arange(len(key))[::-1]  # the last that is written stays
    far = np.linalg.norm(solid - solid[leader[key]], axis=1) > 4 * cell
    double = np.zeros(len(area), bool)
    double[face[far]] = True
    return double
