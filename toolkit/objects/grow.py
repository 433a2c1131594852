"""Pieces that lie flat, grown over a surface: unrolled triangle by triangle, relaxed, and trimmed where they stretch.

After Sorkine et al. 2002, "Bounded-distortion piecewise mesh parameterization". What a cylinder or a cone is made of
unrolls without stretch; where the two ends of the unrolled sheet meet again, they are not joined: that is its seam.
"""

from dataclasses import dataclass

import numpy as np

from toolkit.core.console import progress
from toolkit.objects.flatten import (
    FLAT_MM2,
    Surface,
    edge_changes,
    find_overlaps,
    measure_stretch,
    relax,
    signed_areas,
    weighted_percentile,
    weld_surface,
)
from toolkit.objects.mesh import Mesh
from toolkit.objects.unwrap import cut_charts, spread
from toolkit.objects.wrap import Piece

NARROWEST_MM = 12.0
"""A hand does not place a narrower piece."""
NECK_MM = 8.0
"""What is narrower than this is cut off a piece."""
RING = 1.35
"""A piece's radius grows by this factor before it is relaxed again."""
JOINED = 0.25
"""Edges whose two sides lie closer than this share of their length are joined."""
CELL_MM = 1.0
"""Overlaps are looked for on cells of this size, or of a 128th of the piece."""
LEAST_GAIN = 0.002
"""Share of all value below which a piece is not worth a cut."""


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


@dataclass(frozen=True)
class Limits:
    """What a piece must keep to.

    Attributes:
        stretch: largest.
        sheet_mm: sides of the sheet that it is cut from.
    """

    stretch: float
    sheet_mm: tuple[float, float]


def find_pieces(mesh: Mesh, value: np.ndarray, allowed: np.ndarray, limits: Limits, count: int) -> list[Piece]:
    """At most `count` pieces with the most value, best first.

    Args:
        mesh: in mm.
        value: (m,) what each face is worth.
        allowed: (m,) faces that pieces may have.
        limits: of each piece.
        count: most pieces.
    """
    surface = weld_surface(mesh)
    free = allowed & (surface.area > 0)
    total = float(value[free].sum())
    if total <= 0:
        return []
    rows = np.flatnonzero(free)
    places = np.zeros((int(surface.faces.max()) + 1, 3))
    places[surface.faces.reshape(-1)] = surface.corners.reshape(-1, 3)
    chart = np.full(len(free), -1)
    chart[rows] = cut_charts(places, surface.faces[rows], least_area=NARROWEST_MM**2)[0]
    grown: dict[int, Region | None] = {}
    found: list[Region] = []
    with progress("looking for pieces", count) as bar:
        while len(found) < count:
            left = np.bincount(chart[free], value[free], int(chart.max()) + 1)
            for k in np.argsort(-left, kind="stable"):
                if sum(one is not None for one in grown.values()) >= TRIED or left[k] <= 0.2 * LEAST_GAIN * total:
                    break
                if k not in grown:
                    grown[k] = grow_best(surface, _middle_of(surface, value, free & (chart == k)), free, value, limits)
            best = max(grown.values(), key=lambda one: _worth(one, value), default=None)
            if best is None or _worth(best, value) < LEAST_GAIN * total:
                break
            found.append(best)
            free[best.faces] = False
            # what lost faces grows again; what did not grow before may do so from another middle
            changed = set(chart[best.faces].tolist())
            grown = {
                k: one for k, one in grown.items() if (k not in changed if one is None else bool(free[one.faces].all()))
            }
            bar.advance()
    found.sort(key=lambda one: -_worth(one, value))
    return [make_piece(surface, region, limits.sheet_mm) for region in found]


def _worth(region: Region | None, value: np.ndarray) -> float:
    return 0.0 if region is None else float(value[region.faces].sum())


TRIED = 4
"""Places that a next piece is grown from, of which the best is taken."""


def make_piece(surface: Surface, region: Region, sheet_mm: tuple[float, float]) -> Piece:
    """A region as a piece, turned so that its box is smallest and fits on the sheet, and begins at (0, 0)."""
    order = np.argsort(region.faces)
    faces, flat = region.faces[order], turn_to_fit(region.flat[order], sheet_mm)[0]
    # of the four ways round, the one on which up is most nearly upwards
    middles, height = flat.mean(axis=1), surface.corners[faces, :, 2].mean(axis=1)
    climb = (surface.area[faces] * (height - height.mean())) @ (middles - middles.mean(axis=0))
    flat = _turn(flat, np.pi / 2 * round(np.arctan2(climb[0], climb[1]) / (np.pi / 2)))
    flat -= flat.reshape(-1, 2).min(axis=0)
    return Piece(faces.astype(np.int32), flat, measure_stretch(surface.corners[faces], flat))


def turn_to_fit(flat: np.ndarray, sheet_mm: tuple[float, float]) -> tuple[np.ndarray, bool]:
    """A piece (k, 3, 2) turned so that its box is smallest, and whether that fits on the sheet, either way round."""
    from scipy.spatial import ConvexHull

    hull = flat.reshape(-1, 2)
    hull = hull[ConvexHull(hull).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    # the smallest box has a side along one of the hull's (Freeman and Shapira 1975)
    angles = np.arctan2(sides[:, 1], sides[:, 0])
    boxes = np.array([np.ptp(_turn(hull, -angle), axis=0) for angle in angles])
    fits = np.all(np.sort(boxes, axis=1) <= np.sort(np.array(sheet_mm)) + 1e-6, axis=1)
    best = int(np.argmin(boxes.prod(axis=1) + np.where(fits, 0, 1e18)))
    return _turn(flat, -angles[best]), bool(fits[best])


def _turn(flat: np.ndarray, angle: float) -> np.ndarray:
    """Points (…, 2) turned counter-clockwise by an angle in radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    return flat @ np.array([[cos, sin], [-sin, cos]])


TURNS = 12
"""Angles between 0 and 180 degrees at which a sheet is laid over what is larger than it."""


def _off_sheet(flat: np.ndarray, value: np.ndarray, sheet_mm: tuple[float, float]) -> np.ndarray:
    """(k,) bool: faces beyond the sheet, laid where it holds most value."""
    if turn_to_fit(flat, sheet_mm)[1]:
        return np.zeros(len(flat), bool)
    best, most = np.ones(len(flat), bool), 0.0
    for angle in np.pi * np.arange(TURNS) / TURNS:
        turned = _turn(flat, angle)
        middles = turned.mean(axis=1)
        low, span = middles.min(axis=0), np.ptp(middles, axis=0)
        cell = float(min(sheet_mm)) / 48
        counts = np.ceil(span / cell).astype(int) + 1
        # sums over all windows of the sheet's size, from the table of sums (Crow 1984)
        column, row = ((middles - low) / cell).astype(int).T
        table = np.bincount(column * counts[1] + row, value, int(counts.prod())).reshape(counts)
        table = np.pad(table.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        window = np.minimum((np.array(sheet_mm) / cell).astype(int), counts)
        across, up = window
        sums = table[across:, up:] - table[:-across, up:] - table[across:, :-up] + table[:-across, :-up]
        if sums.max() <= most:
            continue
        start = low + cell * np.array(np.unravel_index(sums.argmax(), sums.shape))
        inside = ((turned >= start) & (turned <= start + sheet_mm)).all(axis=(1, 2))
        if float(value[inside].sum()) > most:
            best, most = ~inside, float(value[inside].sum())
    return best


def _middle_of(surface: Surface, value: np.ndarray, chosen: np.ndarray) -> int:
    """The face nearest to the middle of what is worth most of the chosen ones."""
    rows = np.flatnonzero(chosen)
    middles = surface.corners[rows].mean(axis=1)
    weight = value[rows] + 1e-12
    centre = (weight[:, None] * middles).sum(axis=0) / weight.sum()
    return int(rows[np.linalg.norm(middles - centre, axis=1).argmin()])


def grow_best(surface: Surface, seed: int, free: np.ndarray, value: np.ndarray, limits: Limits) -> Region | None:
    """The best of the pieces that grow from a seed, round or along an axis; None where none is wide enough."""
    best: Region | None = None
    most = 0.0
    for axis in (None, np.array([0.0, 0.0, 1.0])):
        grown, is_whole = grow_piece(surface, seed, free, limits, axis)
        region = finish(surface, grown, value, limits)
        if region is not None and float(value[region.faces].sum()) > most:
            best, most = region, float(value[region.faces].sum())
        if is_whole:  # nothing was left out for its stretch: another way round finds the same
            break
    return best


ALONG = 3.0
"""A strip grows so much faster along its axis."""


def grow_piece(
    surface: Surface, seed: int, free: np.ndarray, limits: Limits, axis: np.ndarray | None = None
) -> tuple[Region, bool]:
    """Grow a piece from a face over all free faces that it can lie on.

    Returns:
        The region, and whether it stopped for want of faces alone.
    """
    distance = _measure_ways(surface, seed, free, axis)
    place = np.full(len(free), -1)  # of each face in the region
    blocked = ~free
    region = Region(np.array([seed]), _lay_first(surface, seed)[None], np.zeros((1, 3), bool))
    place[seed] = 0
    radius = 1.5 * float(np.sqrt(surface.area[seed])) + 1e-9
    reach = min(float(distance[np.isfinite(distance)].max()), float(np.hypot(*limits.sheet_mm)))
    radius = max(radius, reach / 500)
    is_whole = True
    while True:
        before = len(region.faces)
        region = _unroll(surface, region, place, blocked, distance, radius)
        if len(region.faces) > before:
            region, dropped = _settle(surface, region, limits.stretch, radius, before)
            if len(dropped):
                is_whole = False
                blocked[dropped] = True
            place[:] = -1
            place[region.faces] = np.arange(len(region.faces))
        if radius > reach:
            return region, is_whole
        radius *= RING


def _lay_first(surface: Surface, seed: int) -> np.ndarray:
    along, up = surface.apex[seed, 0]
    return np.array([[0, 0], [surface.length[seed, 0], 0], [along, up]])


def _measure_ways(surface: Surface, seed: int, free: np.ndarray, axis: np.ndarray | None) -> np.ndarray:
    """(m,) mean way along edges from the seed to each free face's corners; with an axis, shorter along it."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    rows = np.flatnonzero(free)
    start, end = surface.faces[rows].reshape(-1), np.roll(surface.faces[rows], -1, axis=1).reshape(-1)
    step = (np.roll(surface.corners[rows], -1, axis=1) - surface.corners[rows]).reshape(-1, 3)
    size = (step**2).sum(axis=1)
    if axis is not None:
        normal = np.repeat(surface.normals[rows], 3, axis=0)
        tangent = axis - normal * (normal @ axis)[:, None]
        along = ((step * tangent).sum(axis=1) / np.maximum(np.linalg.norm(tangent, axis=1), 0.3)) ** 2
        size = size - along * (1 - ALONG**-2)
    count = int(surface.faces.max()) + 1
    _, once = np.unique(np.minimum(start, end) * count + np.maximum(start, end), return_index=True)
    way = np.sqrt(np.maximum(size[once], 1e-18))
    graph = coo_array((way, (start[once], end[once])), shape=(count, count)).tocsr()
    from_seed = np.asarray(dijkstra(graph, directed=False, indices=surface.faces[seed], min_only=True))
    distance = from_seed[surface.faces].mean(axis=1)
    distance[~free] = np.inf
    return distance


SMOOTH_DEG = 20.0
"""Edges bent by less are crossed before others are: what is flat stays whole."""


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
        if not smooth.any():  # over a fold few at a time, that what is flat behind it comes from one side
            few = np.argsort(distance[face], kind="stable")[: 1 + len(face) // 50]
            parent, edge, face = parent[few], edge[few], face[few]
        # of several edges that lead to a face, the one from the face nearest to the seed
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
    """Join, relax and trim a region until it stretches no more than it may; also gives the faces that were dropped.

    Args:
        before: so many faces, the first ones, had settled.
    """
    dropped: list[np.ndarray] = []
    for attempt in range(6):
        region = join_edges(surface, region, stretch * radius)
        corners = surface.corners[region.faces]
        change = edge_changes(corners, region.flat)
        area = surface.area[region.faces]
        worst = change.max(axis=1)
        loose = np.repeat(area, 3)
        value = weighted_percentile(change.reshape(-1), loose, 0.95)
        if value > 0.2 * stretch:
            region = _relax_region(surface, region, 6)
            change = edge_changes(corners, region.flat)
            worst = change.max(axis=1)
            value = weighted_percentile(change.reshape(-1), loose, 0.95)
        bad = (signed_areas(region.flat) <= 0) & (area > FLAT_MM2)
        bad |= _lies_double(surface, region)
        is_new = np.arange(len(area)) >= before
        if value > stretch:
            # the worst of the new ones go, fewer each time as what is left relaxes
            limit = max(stretch, weighted_percentile(worst, area, 0.85))
            bad |= (worst > limit) & (is_new | (attempt > 2))
            if not bad.any():
                bad = is_new & (worst > 0.5 * stretch) if attempt < 4 else is_new
        if not bad.any():
            break
        bad[0] = False
        kept = _hold_together(region, surface, ~bad)
        dropped.append(region.faces[bad])
        before = int((kept < before).sum())
        region = _take(surface, region, kept)
    return region, np.concatenate(dropped) if dropped else np.zeros(0, np.int64)


def _take(surface: Surface, region: Region, rows: np.ndarray) -> Region:
    """A region of some of the faces."""
    part = Region(region.faces[rows], region.flat[rows], region.joined[rows])
    part.joined &= _local_neighbours(surface, part) >= 0
    return part


def _local_neighbours(surface: Surface, region: Region) -> np.ndarray:
    """(k, 3) the row in the region of the face across each edge, -1 where it is not in the region."""
    ranked = np.argsort(region.faces)
    neighbour = surface.neighbour[region.faces]
    found = np.searchsorted(region.faces, neighbour, sorter=ranked).clip(max=len(ranked) - 1)
    row = ranked[found]
    return np.where((neighbour >= 0) & (region.faces[row] == neighbour), row, -1)


def join_edges(surface: Surface, region: Region, slack_mm: float) -> Region:
    """Join edges whose two sides lie together, and let corners that are one point lie at their mean."""
    row = _local_neighbours(surface, region)
    face, edge = np.nonzero(row >= 0)
    other = row[face, edge]
    own = surface.across[region.faces[face], edge]
    flat = region.flat
    gap = np.maximum(
        np.linalg.norm(flat[face, edge] - flat[other, (own + 1) % 3], axis=1),
        np.linalg.norm(flat[face, (edge + 1) % 3] - flat[other, own], axis=1),
    )
    length = surface.length[region.faces[face], edge]
    close = gap <= np.maximum(JOINED * length, np.minimum(slack_mm, length))
    joined = np.zeros_like(region.joined)
    joined[face[close], edge[close]] = True
    region = Region(region.faces, flat, joined)
    point = points_of(surface, region)
    count = np.bincount(point.reshape(-1))
    mean = np.stack([np.bincount(point.reshape(-1), flat[..., i].reshape(-1)) for i in range(2)], 1) / count[:, None]
    return Region(region.faces, mean[point], joined)


def points_of(surface: Surface, region: Region) -> np.ndarray:
    """(k, 3) numbers of the region's points: corners that joined edges make one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    face, edge = np.nonzero(region.joined)
    other = _local_neighbours(surface, region)[face, edge]
    own = surface.across[region.faces[face], edge]
    one = np.concatenate([3 * face + edge, 3 * face + (edge + 1) % 3])
    two = np.concatenate([3 * other + (own + 1) % 3, 3 * other + own])
    count = 3 * len(region.faces)
    graph = coo_array((np.ones(len(one), np.int8), (one, two)), shape=(count, count))
    return connected_components(graph, directed=False)[1].reshape(-1, 3)


def _relax_region(surface: Surface, region: Region, steps: int) -> Region:
    point = points_of(surface, region)
    flat = np.zeros((int(point.max()) + 1, 2))
    flat[point] = region.flat
    return Region(region.faces, relax(surface.corners[region.faces], point, flat, steps)[point], region.joined)


def _hold_together(region: Region, surface: Surface, kept: np.ndarray) -> np.ndarray:
    """Rows of those kept that hang together with the first face by joined edges."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    face, edge = np.nonzero(region.joined)
    other = _local_neighbours(surface, region)[face, edge]
    whole = kept[face] & kept[other]
    count = len(kept)
    graph = coo_array((np.ones(int(whole.sum()), np.int8), (face[whole], other[whole])), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    return np.flatnonzero(kept & (part == part[0]))


def _lies_double(surface: Surface, region: Region) -> np.ndarray:
    """(k,) bool: faces in cells of the plane where another part of the surface, that came earlier, lies already."""
    area = signed_areas(region.flat)
    cell = max(CELL_MM, float(np.sqrt(np.abs(area).sum())) / 128)
    samples = np.clip(np.ceil(2 * np.abs(area) / cell**2), 1, 4096).astype(np.int64)
    face = np.repeat(np.arange(len(area)), samples)
    weights = spread(len(face))
    flat = np.einsum("kc,kci->ki", weights, region.flat[face])
    solid = np.einsum("kc,kci->ki", weights, surface.corners[region.faces[face]])
    grid = np.floor(flat / cell).astype(np.int64)
    grid -= grid.min(axis=0)
    key = grid[:, 0] * (int(grid[:, 1].max()) + 1) + grid[:, 1]
    order = np.lexsort((face, key))  # faces came in the order of their rows
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    leader = order[np.repeat(starts, np.diff(starts, append=len(order)))]
    far = np.linalg.norm(solid[order] - solid[leader], axis=1) > 4 * cell
    double = np.zeros(len(area), bool)
    double[face[order[far]]] = True
    return double


def finish(surface: Surface, region: Region, value: np.ndarray, limits: Limits) -> Region | None:
    """Cut off what is too narrow, too large or lies double, and relax for good; None where no wide part is left."""
    steps = 24
    while len(region.faces) > 0:
        region = _relax_region(surface, region, steps) if len(region.faces) > 1 else region
        change = edge_changes(surface.corners[region.faces], region.flat)
        area, worst = surface.area[region.faces], change.max(axis=1)
        bad = (signed_areas(region.flat) <= 0) & (area > FLAT_MM2)
        if weighted_percentile(change.reshape(-1), np.repeat(area, 3), 0.95) > limits.stretch:
            bad |= worst > max(limits.stretch, weighted_percentile(worst, area, 0.95))
        # worked out at ever higher cost, so only where what is cheaper has found nothing
        bad = bad if bad.any() else _off_sheet(region.flat, value[region.faces] + 1e-9 * area, limits.sheet_mm)
        bad = bad if bad.any() else _on_necks(region.flat)
        bad = bad if bad.any() else find_overlaps(region.flat, np.arange(len(area)))
        if not bad.any():
            return region if is_wide(region.flat) else None
        if bad.all():
            return None
        region = join_edges(surface, _take(surface, region, _largest_part(surface, region, ~bad)), 0.0)
        steps = 6
    return None


def _largest_part(surface: Surface, region: Region, kept: np.ndarray) -> np.ndarray:
    """Rows of those kept in the largest part that joined edges hold together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    face, edge = np.nonzero(region.joined)
    other = _local_neighbours(surface, region)[face, edge]
    whole = kept[face] & kept[other]
    count = len(kept)
    graph = coo_array((np.ones(int(whole.sum()), np.int8), (face[whole], other[whole])), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    size = np.bincount(part, np.where(kept, surface.area[region.faces], 0))
    return np.flatnonzero(kept & (part == size.argmax()))


def _draw(flat: np.ndarray) -> np.ndarray:
    """(h, w) uint8 picture of flat triangles (k, 3, 2), `PIXEL_MM` a pixel, with a border of two."""
    import cv2

    low = flat.reshape(-1, 2).min(axis=0)
    places = (flat - low) / PIXEL_MM + 2
    wide, high = np.ceil(places.reshape(-1, 2).max(axis=0)).astype(int) + 3
    picture = np.zeros((high, wide), np.uint8)
    for triangle in np.round(places * 16).astype(np.int32):
        cv2.fillConvexPoly(picture, triangle, 1, shift=4)
    return picture


PIXEL_MM = 0.5


def _on_necks(flat: np.ndarray) -> np.ndarray:
    """(k,) bool: faces of which half lies where the piece is narrower than `NECK_MM`."""
    import cv2

    picture = _draw(flat)
    side = round(NECK_MM / PIXEL_MM)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    wide = cv2.dilate(cv2.morphologyEx(picture, cv2.MORPH_OPEN, disc), np.ones((3, 3), np.uint8))
    samples = np.clip(np.ceil(np.abs(signed_areas(flat))), 4, 256).astype(np.int64)
    face = np.repeat(np.arange(len(flat)), samples)
    points = np.einsum("kc,kci->ki", spread(len(face)), flat[face]) - flat.reshape(-1, 2).min(axis=0)
    column, row = (points / PIXEL_MM + 2).round().astype(int).T
    return 2 * np.bincount(face, wide[row, column] == 0, len(flat)) > samples


def is_wide(flat: np.ndarray) -> bool:
    """Whether a circle of `NARROWEST_MM` fits into the piece."""
    import cv2

    return float(cv2.distanceTransform(_draw(flat), cv2.DIST_L2, 5).max()) * PIXEL_MM >= NARROWEST_MM / 2 - PIXEL_MM
