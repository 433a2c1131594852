"""Trim a piece that has grown, so that it can be printed, cut out and stuck on."""

from dataclasses import dataclass

import numpy as np

from toolkit.core.lazy import cv2, scipy
from toolkit.objects.mesh import signed_areas
from toolkit.objects.unwrap import spread
from toolkit.rooms.wraps.cutting.flatten import (
    FLAT_MM2,
    Region,
    Surface,
    edge_changes,
    find_overlaps,
    join_edges,
    largest_part,
    measure_stretch,
    parts_of,
    relax_region,
    take,
    weighted_percentile,
    worth_of,
)
from toolkit.rooms.wraps.wrap import FlatPiece

NARROWEST_MM = 12.0
"""Narrowest piece that a hand places."""
NECK_MM = 8.0
"""Narrower parts are cut off a piece."""
PIXEL_MM = 0.5
SAME_MM = 1e-3
"""Corners closer than this are the same."""
TURNS, LONGEST, CORNERS = 12, 6, 64
"""Tries of a sheet over a larger piece: angles in half a turn, longest edges to lie along, and places each way."""


@dataclass(frozen=True)
class Limits:
    """Limits of a piece: the largest stretch, and the sides of its sheet."""

    stretch: float
    sheet_mm: tuple[float, float]


def finish(surface: Surface, region: Region, value: np.ndarray, limits: Limits) -> Region | None:
    """Cut off parts that are too narrow, too large or overlap, and relax; None if no wide part is left."""
    steps = 40
    while len(region.faces) > 0:
        region = relax_region(surface, region, steps) if len(region.faces) > 1 else region
        # faces to lose: turned over, and the most stretched 5 % if the whole stretches too much
        change = edge_changes(surface.corners[region.faces], region.flat)
        area, worst = surface.area[region.faces], change.max(axis=1)
        bad = (signed_areas(region.flat) <= 0) & (area > FLAT_MM2)
        if weighted_percentile(change.reshape(-1), np.repeat(area, 3), 0.95) > limits.stretch:
            bad |= worst > max(limits.stretch, weighted_percentile(worst, area, 0.95))
        # each check costs more than those before, so it runs only if they found nothing
        bad = bad if bad.any() else _off_sheet(region.flat, value[region.faces] + 1e-9 * area, limits.sheet_mm)
        bad = bad if bad.any() else _on_necks(region.flat)
        bad = bad if bad.any() else find_overlaps(region.flat, np.arange(len(area)))
        if not bad.any():
            return region if is_wide(region.flat) else None
        if bad.all():
            return None
        region = join_edges(surface, take(surface, region, largest_part(surface, region, ~bad)), 0.0)
        # the rest lay well before: few steps even out the cut
        steps = 6
    return None


EVEN_MM = 12.0
"""A tooth in a piece's edge is removed if its area is under so many millimetres times the saved cut."""
EVEN_DEG = 30.0
"""A piece should end at edges bent by more."""
PASSES = 4


def even_border(surface: Surface, region: Region, free: np.ndarray) -> Region:
    """Fill notches in a finished piece's edge with `free` faces (m,), and remove teeth, for scissors."""
    for _ in range(PASSES):
        before = len(region.faces)
        region = _fill_notches(surface, region, free)
        is_cut = ~region.joined & _is_smooth(surface, region.faces)
        length = surface.length[region.faces]
        saved = np.where(is_cut, length, 0).sum(axis=1) - np.where(region.joined, length, 0).sum(axis=1)
        teeth = (region.joined.sum(axis=1) == 1) & (is_cut.sum(axis=1) == 2)
        teeth &= EVEN_MM * saved > surface.area[region.faces]
        if teeth.any() and not teeth.all():
            region = take(surface, region, largest_part(surface, region, ~teeth))
        elif len(region.faces) == before:
            break
    return region


def _is_smooth(surface: Surface, faces: np.ndarray) -> np.ndarray:
    """(k, 3) bool: edges of faces across which the surface does not bend."""
    other = surface.neighbour[faces]
    bend = (surface.normals[faces][:, None] * surface.normals[other]).sum(axis=2)
    return (other >= 0) & (bend > np.cos(np.radians(EVEN_DEG)))


def _fill_notches(surface: Surface, region: Region, free: np.ndarray) -> Region:
    """Add the free faces that two joined neighbours hold by all three corners."""
    place = np.full(len(surface.faces), -1)
    place[region.faces] = np.arange(len(region.faces))
    # free faces with two or more smooth neighbours in the region
    face, count = np.unique(surface.neighbour[region.faces][_is_smooth(surface, region.faces)], return_counts=True)
    face = face[(count >= 2) & free[face] & (place[face] < 0)]
    rows = np.where(surface.neighbour[face] >= 0, place[surface.neighbour[face]], -1)
    flat, gap = np.full((len(face), 3, 2), np.nan), np.zeros(len(face))
    # each neighbour gives the place of two corners; the largest disagreement is the gap
    for edge in range(3):
        own = surface.across[face, edge]
        for corner, theirs in ((edge, (own + 1) % 3), ((edge + 1) % 3, own)):
            there = np.where((rows[:, edge] >= 0)[:, None], region.flat[rows[:, edge], theirs], np.nan)
            apart = np.linalg.norm(there - flat[:, corner], axis=1)
            gap = np.fmax(gap, apart)
            flat[:, corner] = np.where(np.isnan(flat[:, corner]), there, flat[:, corner])
    # neighbours must agree, and the face keep its side
    fits = (gap < SAME_MM) & (signed_areas(flat) > FLAT_MM2)
    face, flat = face[fits], flat[fits]
    if not len(face):
        return region
    grown = Region(
        np.concatenate([region.faces, face]), np.concatenate([region.flat, flat]),
        np.concatenate([region.joined, np.zeros((len(face), 3), bool)]),
    )  # fmt: skip
    return join_edges(surface, grown, 0.0)


HIDDEN_MM2 = 100.0
"""Larger hidden parts are removed from a piece."""
LOST = 0.01
"""Share of a piece's value that it may lose by that."""


def leave_hidden(surface: Surface, region: Region, value: np.ndarray, limits: Limits) -> Region:
    """Remove faces without value (m,), such as the ground of a pot, but for those that hold the rest together."""
    hidden, area = value[region.faces] <= 0, surface.area[region.faces]
    part = parts_of(surface, region, hidden)
    size = np.bincount(part, np.where(hidden, area, 0))
    least = (1 - LOST) * worth_of(region, value)
    rows = np.arange(len(area))
    for number in np.flatnonzero(size >= HIDDEN_MM2):
        kept = np.zeros(len(area), bool)
        kept[rows] = part[rows] != number
        trial = largest_part(surface, region, kept)
        rows = trial if float(value[region.faces[trial]].sum()) >= least else rows
    if len(rows) == len(area):
        return region
    free = np.zeros(len(value), bool)
    free[region.faces] = True
    cut = finish(surface, even_border(surface, take(surface, region, rows), free), value, limits)
    return region if cut is None or worth_of(cut, value) < least else cut


def _off_sheet(flat: np.ndarray, value: np.ndarray, sheet_mm: tuple[float, float]) -> np.ndarray:
    """(k,) bool: faces beyond the sheet in the place with most value on it."""
    if turn_to_fit(flat, sheet_mm)[1]:
        return np.zeros(len(flat), bool)
    best, most = np.ones(len(flat), bool), 0.0
    for angle in _list_turns(flat):
        turned = turn(flat, -angle)
        low, high = turned.min(axis=1), turned.max(axis=1)
        # the best sheet can be moved until its left and lower sides each touch a face: such corners are tried
        corners = [_thin_out(np.unique(low[:, axis])) for axis in range(2)]
        sums = np.zeros((len(corners[0]) + 1, len(corners[1]) + 1))
        # each face counts at all corners whose sheets hold it, a rectangle of them (summed as a table, Crow 1984)
        first, last = (
            np.stack([np.searchsorted(corners[axis], side[:, axis], "left" if side is not low else "right")
                      for axis in range(2)])
            for side in (high - sheet_mm - 1e-6, low)
        )  # fmt: skip
        held = (first < last).all(axis=0)
        for (x, y), sign in (((first[0], first[1]), 1), ((last[0], first[1]), -1), ((first[0], last[1]), -1),
                             ((last[0], last[1]), 1)):  # fmt: skip
            np.add.at(sums, (x[held], y[held]), sign * value[held])
        sums = sums.cumsum(axis=0).cumsum(axis=1)[:-1, :-1]
        if sums.max() <= most:
            continue
        # the corner with most value; faces that are not wholly on that sheet go
        column, row = np.unravel_index(sums.argmax(), sums.shape)
        start = np.array([corners[0][column], corners[1][row]])
        inside = ((low >= start - 1e-9) & (high <= start + sheet_mm + 1e-6)).all(axis=1)
        best, most = ~inside, float(sums.max())
    return best


def _list_turns(flat: np.ndarray) -> np.ndarray:
    """Return the angles of a sheet to try, radians: a fan of them, and along the longest edges."""
    edges = (np.roll(flat, -1, axis=1) - flat).reshape(-1, 2)
    longest = edges[np.argsort(-np.linalg.norm(edges, axis=1), kind="stable")[:LONGEST]]
    along = np.arctan2(longest[:, 1], longest[:, 0])
    fan = np.pi * np.arange(TURNS) / TURNS
    return np.unique(np.round(np.concatenate([fan, along % np.pi, (along + np.pi / 2) % np.pi]), 6))


def _thin_out(places: np.ndarray) -> np.ndarray:
    """At most `CORNERS` of sorted places, evenly."""
    return places if len(places) <= CORNERS else places[np.linspace(0, len(places) - 1, CORNERS).astype(int)]


def make_piece(surface: Surface, region: Region, sheet_mm: tuple[float, float]) -> FlatPiece:
    """Make a piece of a region, turned so that its box is smallest and fits on the sheet, and begins at (0, 0)."""
    order = np.argsort(region.faces)
    faces, flat = region.faces[order], turn_to_fit(region.flat[order], sheet_mm)[0]
    # of the four quarter turns, that with up most nearly upwards
    middles, height = flat.mean(axis=1), surface.corners[faces, :, 2].mean(axis=1)
    climb = (surface.area[faces] * (height - height.mean())) @ (middles - middles.mean(axis=0))
    flat = turn(flat, np.pi / 2 * round(np.arctan2(climb[0], climb[1]) / (np.pi / 2)))
    flat -= flat.reshape(-1, 2).min(axis=0)
    return FlatPiece(faces.astype(np.int32), flat, measure_stretch(surface.corners[faces], flat))


def turn_to_fit(flat: np.ndarray, sheet_mm: tuple[float, float]) -> tuple[np.ndarray, bool]:
    """Turn a piece (k, 3, 2) so that its box is smallest, and return whether it fits on the sheet, either way round."""
    hull = flat.reshape(-1, 2)
    hull = hull[scipy.spatial.ConvexHull(hull).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    # the smallest box has a side along a side of the hull (Freeman and Shapira 1975)
    angles = np.arctan2(sides[:, 1], sides[:, 0])
    boxes = np.ptp(np.stack([turn(hull, -angle) for angle in angles]), axis=1)
    fits = np.all(np.sort(boxes, axis=1) <= np.sort(np.array(sheet_mm)) + 1e-6, axis=1)
    best = int(np.argmin(boxes.prod(axis=1) + np.where(fits, 0, 1e18)))
    return turn(flat, -angles[best]), bool(fits[best])


def turn(flat: np.ndarray, angle: float) -> np.ndarray:
    """Points (…, 2) turned counter-clockwise by an angle in radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    return flat @ np.array([[cos, sin], [-sin, cos]])


def _draw(flat: np.ndarray) -> np.ndarray:
    """(h, w) uint8 picture of flat triangles (k, 3, 2), `PIXEL_MM` a pixel, with a border of two."""
    low = flat.reshape(-1, 2).min(axis=0)
    places = (flat - low) / PIXEL_MM + 2
    wide, high = np.ceil(places.reshape(-1, 2).max(axis=0)).astype(int) + 3
    picture = np.zeros((high, wide), np.uint8)
    fill = cv2.fillConvexPoly
    for triangle in np.round(places * 16).astype(np.int32):
        fill(picture, triangle, 1, shift=4)
    return picture


def _on_necks(flat: np.ndarray) -> np.ndarray:
    """(k,) bool: faces of which half lies where the piece is narrower than `NECK_MM`."""
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
    return float(cv2.distanceTransform(_draw(flat), cv2.DIST_L2, 5).max()) * PIXEL_MM >= NARROWEST_MM / 2 - PIXEL_MM
