"""Places for words round the pieces of a wrap, and the line that scissors follow."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.lazy import shapely
from toolkit.printing.canvas import Point
from toolkit.rooms.wraps.wrap import BLEED_MM

if TYPE_CHECKING:
    from shapely import Polygon

APART_MM = 0.5
"""Paper between pieces on a page is at least twice this, beyond their bleeds."""
NUMBER_HIGH_MM = 4.3
"""Height of a number's digits, with a hair of paper."""
STEPS_MM = (1.0, 0.25)
"""Between places that are tried, the second if the first finds none."""
NEAR_MM = 25.0
"""Distance from a piece in which a number is placed, before the rest of the page."""
TEETH_MM = (0.4, 0.8, 1.2, 1.5)
"""Half the widths of teeth and slits that scissors do not follow, the finest first, as they may line a wider slit."""
LONGEST_TOOTH_MM = 6.0
"""Longer teeth and slits stay: they are darts, which let the piece bend, or strips of it."""
STRAIGHT_MM = 0.3
"""Largest distance of the line from an outline in small steps."""


class PlaceFinder:
    """Finds paper for words round a piece: off its bleed, off other words, and on its own part of the page."""

    def __init__(self, size_mm: Point, outline: "Polygon", room_mm: tuple[float, float]) -> None:
        self._size, self._room = np.array(size_mm), np.array(room_mm)
        self._bleed = outline.buffer(BLEED_MM + 0.2, quad_segs=4).simplify(0.1)
        shapely.prepare(self._bleed)
        self._words: list[Polygon] = []

    def footprint(self) -> "Polygon":
        """Return the area of the piece with its bleed, a little paper and its words."""
        whole = shapely.union_all([self._bleed.buffer(APART_MM), *(word.buffer(APART_MM) for word in self._words)])
        # out and in again closes gaps narrower than twice the distance
        return whole.buffer(APART_MM).buffer(-APART_MM)

    def _take_first(self, places: np.ndarray, width: float, height: float) -> Point | None:
        """Take the first of places (k, 2) about which a box is free."""
        half = np.array([width / 2 + 0.2, height / 2 + 0.1])
        low, high = places - half, places + half
        spare = self._room - 0.2
        inside = ((low >= -spare) & (high <= self._size + spare)).all(axis=1)
        places, low, high = places[inside], low[inside], high[inside]
        boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
        free = ~shapely.intersects(self._bleed, boxes)
        for word in self._words:
            free &= ~shapely.intersects(word, boxes)
        if not free.any():
            return None
        first = int(free.argmax())
        self._words.append(boxes[first])
        return float(places[first, 0]), float(places[first, 1])

    def beside(self, point: Point, width: float, height: float) -> Point | None:
        """Return the middle of free paper nearest to a point of the edge, if any."""
        away, angle = np.meshgrid(np.arange(BLEED_MM + 0.5, 16.0, 0.5), np.arange(0, 2 * np.pi, np.pi / 12))
        way = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(-1, 2)
        places = point + way * away.reshape(-1, 1) + way * [width / 2, height / 2]
        # nearest first; stable, so that the first angle wins ties
        order = np.argsort(away.reshape(-1), kind="stable")
        return self._take_first(places[order], width, height)

    def anywhere(self, width: float, height: float) -> Point | None:
        """Return the middle of the free paper nearest to the piece, above and left first, if any."""
        (left, low), (right, high) = -self._room, self._size + self._room
        # fine steps only where needed: room beside a straight edge may be hardly wider than the words
        for step in STEPS_MM:
            x, y = np.meshgrid(
                np.arange(left + width / 2 + 0.4, right, step), np.arange(low + height / 2 + 0.3, high, step)
            )
            places = np.stack([x, y], axis=-1).reshape(-1, 2)
            away = shapely.distance(self._bleed, shapely.points(places))
            # the small weights break ties
            order = np.argsort(away + 0.02 * (high - places[:, 1]) + 0.01 * places[:, 0], kind="stable")
            found = self._take_first(places[order], width, height)
            if found is not None:
                return found
        return None


def place_numbers(
    room: "Polygon", solids: "Sequence[Polygon]", widths: Sequence[float], others: "Sequence[Polygon]" = ()
) -> list[Point | None]:
    """Return the middle of free paper nearest to each piece for a row of words; None if the page is full.

    Args:
        room: area of the page.
        solids: area of each piece.
        widths: width of each row; all are `NUMBER_HIGH_MM` high.
        others: other areas in use.
    """
    taken = [*solids, *others]
    found: list[Point | None] = []
    for solid, width in zip(solids, widths, strict=True):
        tries = ((step, near) for near in (NEAR_MM, None) for step in STEPS_MM if near or step == STEPS_MM[0])
        at = next((at for step, near in tries if (at := _find_free(room, solid, taken, width, step, near))), None)
        if at is not None:
            taken.append(box_about(at, width))
        found.append(at)
    return found


def box_about(at: Point, width: float) -> "Polygon":
    """Return the paper of a row of words of this width about its middle."""
    half_w, half_h = width / 2 + 0.3, NUMBER_HIGH_MM / 2 + 0.2
    return shapely.box(at[0] - half_w, at[1] - half_h, at[0] + half_w, at[1] + half_h)


def _find_free(
    room: "Polygon", solid: "Polygon", taken: "Sequence[Polygon]", width: float, step: float, near_mm: float | None
) -> Point | None:
    left, low, right, high = room.bounds
    if near_mm is not None:
        x0, y0, x1, y1 = solid.bounds
        left, low = max(left, x0 - near_mm), max(low, y0 - near_mm)
        right, high = min(right, x1 + near_mm), min(high, y1 + near_mm)
    half_w, half_h = width / 2 + 0.3, NUMBER_HIGH_MM / 2 + 0.2
    # boxes on a grid over the page, or over the surroundings of the piece
    columns, rows = np.arange(left + half_w, right - half_w, step), np.arange(low + half_h, high - half_h, step)
    x, y = np.tile(columns, len(rows)), np.repeat(rows, len(columns))
    boxes = shapely.box(x - half_w, y - half_h, x + half_w, y + half_h)
    free = np.ones(len(boxes), bool)
    for box in taken:
        shapely.prepare(box)
        free[free] = ~shapely.intersects(box, boxes[free])
    if not free.any():
        return None
    x, y = x[free], y[free]
    # above and left first if equally near
    away = shapely.distance(solid.simplify(0.5), boxes[free])
    best = int(np.argmin(away - 0.02 * y + 0.01 * x))
    return float(x[best]), float(y[best])


def smooth_outline(outline: "Polygon") -> "Polygon":
    """Remove teeth and slits from an outline that are too narrow for scissors; longer slits and strips stay."""

    def widen(shape: "Polygon", by_mm: float) -> "Polygon":
        return shape.buffer(by_mm, join_style="mitre", mitre_limit=3)

    def short(parts: "Polygon") -> list["Polygon"]:
        return [
            part for part in shapely.get_parts(parts)
            if part.geom_type == "Polygon" and shapely.minimum_bounding_radius(part) < LONGEST_TOOTH_MM / 2
        ]  # fmt: skip

    smooth = outline
    # closing fills narrow slits, opening takes narrow teeth off (Serra 1982), the finest first
    for half_mm in TEETH_MM:
        slits = short(widen(widen(smooth, half_mm), -half_mm).difference(smooth))
        smooth = shapely.union_all([smooth, *slits])
        teeth = short(smooth.difference(widen(widen(smooth, -half_mm), half_mm)))
        smooth = smooth.difference(shapely.union_all(teeth)) if teeth else smooth
    smooth = max(shapely.get_parts(smooth.simplify(STRAIGHT_MM)), key=lambda part: part.area)
    return smooth if smooth.is_valid and smooth.area > 0 else outline
