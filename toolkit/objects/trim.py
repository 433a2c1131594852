"""A piece that has grown, trimmed to what can be printed, cut out and stuck on."""

from dataclasses import dataclass

import numpy as np

from toolkit.objects.flatten import (
    FLAT_MM2,
    Surface,
    edge_changes,
    find_overlaps,
    measure_stretch,
    signed_areas,
    weighted_percentile,
)
from toolkit.objects.region import Region, join_edges, largest_part, relax_region, take
from toolkit.objects.unwrap import spread
from toolkit.objects.wrap import FlatPiece

NARROWEST_MM = 12.0
"""A hand does not place a narrower piece."""
NECK_MM = 8.0
"""What is narrower than this is cut off a piece."""
PIXEL_MM = 0.5
TURNS = 12
"""Angles between 0 and 180 degrees at which a sheet is laid over what is larger than it."""


@dataclass(frozen=True)
class Limits:
    """What a piece must keep to.

    Attributes:
        stretch: largest.
        sheet_mm: sides of the sheet that it is cut from.
    """

    stretch: float
    sheet_mm: tuple[float, float]


def finish(surface: Surface, region: Region, value: np.ndarray, limits: Limits) -> Region | None:
    """Cut off what is too narrow, too large or lies double, and relax for good; None where no wide part is left."""
    steps = 40
    while len(region.faces) > 0:
        region = relax_region(surface, region, steps) if len(region.faces) > 1 else region
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
        region = join_edges(surface, take(surface, region, largest_part(surface, region, ~bad)), 0.0)
        steps = 6
    return None


def _off_sheet(flat: np.ndarray, value: np.ndarray, sheet_mm: tuple[float, float]) -> np.ndarray:
    """(k,) bool: faces beyond the sheet, laid where it holds most value."""
    if turn_to_fit(flat, sheet_mm)[1]:
        return np.zeros(len(flat), bool)
    best, most = np.ones(len(flat), bool), 0.0
    for angle in np.pi * np.arange(TURNS) / TURNS:
        turned = turn(flat, angle)
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


def make_piece(surface: Surface, region: Region, sheet_mm: tuple[float, float]) -> FlatPiece:
    """A region as a piece, turned so that its box is smallest and fits on the sheet, and begins at (0, 0)."""
    order = np.argsort(region.faces)
    faces, flat = region.faces[order], turn_to_fit(region.flat[order], sheet_mm)[0]
    # of the four ways round, the one on which up is most nearly upwards
    middles, height = flat.mean(axis=1), surface.corners[faces, :, 2].mean(axis=1)
    climb = (surface.area[faces] * (height - height.mean())) @ (middles - middles.mean(axis=0))
    flat = turn(flat, np.pi / 2 * round(np.arctan2(climb[0], climb[1]) / (np.pi / 2)))
    flat -= flat.reshape(-1, 2).min(axis=0)
    return FlatPiece(faces.astype(np.int32), flat, measure_stretch(surface.corners[faces], flat))


def turn_to_fit(flat: np.ndarray, sheet_mm: tuple[float, float]) -> tuple[np.ndarray, bool]:
    """A piece (k, 3, 2) turned so that its box is smallest, and whether that fits on the sheet, either way round."""
    from scipy.spatial import ConvexHull

    hull = flat.reshape(-1, 2)
    hull = hull[ConvexHull(hull).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    # the smallest box has a side along one of the hull's (Freeman and Shapira 1975)
    angles = np.arctan2(sides[:, 1], sides[:, 0])
    boxes = np.array([np.ptp(turn(hull, -angle), axis=0) for angle in angles])
    fits = np.all(np.sort(boxes, axis=1) <= np.sort(np.array(sheet_mm)) + 1e-6, axis=1)
    best = int(np.argmin(boxes.prod(axis=1) + np.where(fits, 0, 1e18)))
    return turn(flat, -angles[best]), bool(fits[best])


def turn(flat: np.ndarray, angle: float) -> np.ndarray:
    """Points (…, 2) turned counter-clockwise by an angle in radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    return flat @ np.array([[cos, sin], [-sin, cos]])


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
