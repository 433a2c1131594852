"""Markers in a ring: the sheet for a turntable, or for an object that would cover a board."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.errors import ToolkitError
from toolkit.rig.markers import (
    DICTIONARY,
    RING_FIRST_ID,
    STRIP_FIRST_ID,
    count_markers,
    get_dictionary,
    ink_to_picture,
    marker_modules,
    require_ink,
    require_mm,
    sheet_to_world,
)

if TYPE_CHECKING:
    import cv2

FEWEST_MARKERS = 8
"""At a low camera the object hides the half of the ring behind it; four markers are left."""
SAMPLES = 5
"""Per pixel and axis, where a turned marker is painted."""


@dataclass(frozen=True)
class RingSpec:
    """Markers in a ring round a free disc, upright towards the middle as seen from outside; checked when it is made.

    The first marker lies at the front (the lower edge of the page), the others follow counter-clockwise from above.
    The frame is that of `toolkit.rig.board`: sheet positions are counted from the corner of the square round the ring.

    Attributes:
        inner_mm: diameter of the free disc that the object stands on.
        marker_mm: side of a marker, its black border included.
        count: of the markers.
        dictionary: one of OpenCV's, by name.
        first_id: number of the marker at the front.
        ink_percent: how dark the markers are, 100 is black.

    Raises:
        ToolkitError: the markers do not fit side by side, or the dictionary has too few.
    """

    inner_mm: float = 300.0
    marker_mm: float = 24.0
    count: int = 30
    dictionary: str = DICTIONARY
    first_id: int = RING_FIRST_ID
    ink_percent: float = 100.0

    def __post_init__(self) -> None:
        require_ink("ring", self.ink_percent)
        require_mm("ring: inner_mm", self.inner_mm)
        require_mm("ring: marker_mm", self.marker_mm)
        if self.count < FEWEST_MARKERS:
            raise ToolkitError(f"ring: {self.count} markers: expected at least {FEWEST_MARKERS}")
        if self.count > (most := count_that_fit(self.inner_mm, self.marker_mm)):
            raise ToolkitError(
                f"ring: {self.count} markers of {self.marker_mm:g} mm round {self.inner_mm:g} mm: at most {most} fit; "
                "choose a larger ring or smaller markers"
            )
        known = count_markers(self.dictionary)
        if not 0 <= self.first_id <= known - self.count:
            raise ToolkitError(
                f"ring: markers {self.first_id} to {self.first_id + self.count - 1} of {self.dictionary}: it has 0 to "
                f"{known - 1}; choose another dictionary or first_id"
            )

    @property
    def quiet_mm(self) -> float:
        """White paper inside and outside the markers, one module."""
        return self.marker_mm / 7

    @property
    def middle_radius_mm(self) -> float:
        """From the ring's middle to a marker's."""
        return self.inner_mm / 2 + self.quiet_mm + self.marker_mm / 2

    @property
    def outer_mm(self) -> float:
        """Diameter of the sheet."""
        half = self.marker_mm / 2
        return 2 * (math.hypot(self.middle_radius_mm + half, half) + self.quiet_mm)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the square round the sheet."""
        return self.outer_mm, self.outer_mm

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """Numbers of the markers, the front one first."""
        return tuple(range(self.first_id, self.first_id + self.count))

    def placements(self) -> list[tuple[int, np.ndarray, float]]:
        """Per marker its number, its middle (2,) on the sheet, and how far it is turned, radians counter-clockwise."""
        turns = [2 * math.pi * index / self.count for index in range(self.count)]
        radius, middle = self.middle_radius_mm, self.outer_mm / 2
        return [
            (marker_id, middle + radius * np.array([math.sin(turn), math.cos(turn)]), turn)
            for marker_id, turn in zip(self.marker_ids, turns, strict=True)
        ]

    def sheet_corners(self, marker_ids: Sequence[int] | None = None) -> np.ndarray:
        """(k, 4, 2) corners of markers on the sheet, in OpenCV's order: upper left, upper right, lower right, left."""
        half = self.marker_mm / 2
        square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        corners = {}
        for marker_id, middle, turn in self.placements():
            right, down = (math.cos(turn), -math.sin(turn)), (math.sin(turn), math.cos(turn))
            corners[marker_id] = middle + square @ np.array([right, down])
        wanted = self.marker_ids if marker_ids is None else marker_ids
        return np.array([corners[int(marker_id)] for marker_id in wanted]).reshape(-1, 4, 2)

    def marker_points(self, marker_ids: Sequence[int] | None = None) -> np.ndarray:
        """(k, 4, 3) world positions of the corners of markers (all by default), in OpenCV's order."""
        return sheet_to_world(self.sheet_corners(marker_ids), self.size_mm)

    def object_points(self, marker_ids: Sequence[int] | None = None) -> np.ndarray:
        """(4 k, 3) world positions of the corners of markers, four by four: what `cv2.solvePnP` asks for."""
        return self.marker_points(marker_ids).reshape(-1, 3)

    def to_cv(self) -> "cv2.aruco.Board":
        """OpenCV's board of these markers; its points are sheet positions with z = 0."""
        import cv2

        corners = self.sheet_corners()
        points = np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=2).astype(np.float32)
        return cv2.aruco.Board(list(points), get_dictionary(self.dictionary), np.array(self.marker_ids))

    def paint(self, px_per_mm: float) -> np.ndarray:
        """(h, w) uint8 sRGB grey picture of the square round the ring, white outside; rows down the page."""
        side = round(self.outer_mm * px_per_mm)
        ink = np.zeros((side, side))
        for marker_id, corners in zip(self.marker_ids, self.sheet_corners(), strict=True):
            _add_turned(ink, marker_modules(self.dictionary, marker_id), corners * (side / self.outer_mm))
        return ink_to_picture(ink, self.ink_percent)

    def describe(self) -> str:
        """One line: what it is made of."""
        last = self.first_id + self.count - 1
        return (
            f"ring of {self.count} ArUco markers, {self.marker_mm:g} mm, round {self.inner_mm:g} mm, "
            f"{self.dictionary} {self.first_id}-{last}, {self.ink_percent:g} % ink"
        )


def count_that_fit(inner_mm: float, marker_mm: float) -> int:
    """The most markers round a free disc that have a module of white paper between them."""
    apothem = inner_mm / 2 + marker_mm / 7  # of the polygon of the markers' inner sides
    return int(math.pi / math.atan(marker_mm * 8 / 7 / 2 / apothem))


def choose_ring(inner_mm: float, marker_mm: float | None = None) -> RingSpec:
    """A ring of that free diameter, its markers evenly spread with room of a third of their side between them.

    Args:
        inner_mm: diameter of the free disc.
        marker_mm: side of the markers; None: about a twelfth of the disc, 12 to 40 mm.

    Raises:
        ToolkitError: too few markers fit.
    """
    require_mm("ring: inner_mm", inner_mm)
    side = float(min(max(round(inner_mm / 12.5), 12), 40)) if marker_mm is None else marker_mm
    require_mm("ring: marker_mm", side)
    most = count_that_fit(inner_mm, side)
    if most < FEWEST_MARKERS:
        least = 2 * (side * 8 / 14 / math.tan(math.pi / FEWEST_MARKERS) - side / 7)
        raise ToolkitError(
            f"a ring of {inner_mm:g} mm takes {most} markers of {side:g} mm, expected at least {FEWEST_MARKERS}: "
            f"choose a ring of at least {math.ceil(least)} mm or smaller markers"
        )
    apothem = inner_mm / 2 + side / 7
    roomy = int(math.pi / math.atan(side * 4 / 3 / 2 / apothem))
    return RingSpec(inner_mm, side, min(max(roomy, FEWEST_MARKERS), STRIP_FIRST_ID - RING_FIRST_ID))


def _add_turned(ink: np.ndarray, modules: np.ndarray, corners_px: np.ndarray) -> None:
    """Add to (h, w) `ink` the share of each pixel that a turned marker covers, from `SAMPLES`² points in each."""
    x0, y0 = np.maximum(np.floor(corners_px.min(axis=0)).astype(int), 0)
    x1, y1 = np.minimum(np.ceil(corners_px.max(axis=0)).astype(int), ink.shape[::-1])
    at = (np.arange(SAMPLES * max(x1 - x0, y1 - y0)) + 0.5) / SAMPLES
    x, y = np.meshgrid(x0 + at[: SAMPLES * (x1 - x0)], y0 + at[: SAMPLES * (y1 - y0)])
    right, down = corners_px[1] - corners_px[0], corners_px[3] - corners_px[0]
    offset = np.stack([x, y], axis=-1) - corners_px[0]
    side = len(modules)
    column, row = (np.floor(offset @ axis / (axis @ axis) * side).astype(int) for axis in (right, down))
    within = (column >= 0) & (column < side) & (row >= 0) & (row < side)
    black = within & modules[np.where(within, row, 0), np.where(within, column, 0)]
    ink[y0:y1, x0:x1] += black.reshape(y1 - y0, SAMPLES, x1 - x0, SAMPLES).mean(axis=(1, 3))
