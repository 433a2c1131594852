"""ArUco markers as shapes, and the ring of them: the sheet for a turntable or an object that would cover a board."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.errors import ToolkitError, one_of

if TYPE_CHECKING:
    import cv2

DICTIONARY = "DICT_5X5_1000"
"""One dictionary for everything that is printed: markers of a board, a ring and a colour strip never share a number."""
DICTIONARIES = {f"DICT_{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)} | {
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
}
"""Markers in each of OpenCV's dictionaries, so that a spec is checked without loading OpenCV."""
RING_FIRST_ID = 800
STRIP_FIRST_ID = 990


PALE_PERCENT = 10.0
"""Ink of a board for photographs that a network shall judge. A black board under the object is what the network then
sees: "crossword puzzle" and "scoreboard" instead of the object (docs/results.md). Cameras find the pale one as well."""
LEAST_INK_PERCENT = 5.0


def require_mm(what: str, value: float, most: float = 5000.0) -> None:
    """Check a length.

    Raises:
        ToolkitError: it is not above 0, or over `most`.
    """
    if not (math.isfinite(value) and 0 < value <= most):
        raise ToolkitError(f"{what}: expected millimetres above 0 and up to {most:g}, found {value:g}")


def sheet_to_world(points_mm: np.ndarray, size_mm: tuple[float, float]) -> np.ndarray:
    """(..., 2) positions on a sheet to (..., 3) in the world: down the sheet is +x, to its right +y, its middle 0."""
    points = np.asarray(points_mm, float)
    width, height = size_mm
    return np.stack([points[..., 1] - height / 2, points[..., 0] - width / 2, np.zeros(points.shape[:-1])], axis=-1)


def count_markers(dictionary: str) -> int:
    """How many markers one of OpenCV's dictionaries has.

    Raises:
        ToolkitError: there is none of that name.
    """
    if dictionary not in DICTIONARIES:
        raise one_of("dictionary of markers", dictionary, list(DICTIONARIES))
    return DICTIONARIES[dictionary]


def get_dictionary(name: str) -> "cv2.aruco.Dictionary":
    """One of OpenCV's dictionaries.

    Raises:
        ToolkitError: there is none of that name.
    """
    import cv2

    count_markers(name)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


@lru_cache(maxsize=2048)
def marker_modules(dictionary: str, marker_id: int) -> np.ndarray:
    """(m, m) bool, true where a marker is black, its border included; first row on top."""
    import cv2

    known = get_dictionary(dictionary)
    side = known.markerSize + 2
    return cv2.aruco.generateImageMarker(known, marker_id, side, borderBits=1) == 0


def black_rects(modules: np.ndarray) -> np.ndarray:
    """(k, 4) left, top, right, bottom of the black runs of (m, m) modules, in shares of the marker's side.

    They do not overlap; equal runs of neighbouring rows are one rectangle.
    """
    side = len(modules)
    open_runs: dict[tuple[int, int], int] = {}
    rects = []
    for row in range(side + 1):
        runs = set(_find_runs(modules[row])) if row < side else set()
        for run in [run for run in open_runs if run not in runs]:
            rects.append((run[0], open_runs.pop(run), run[1], row))
        for run in runs:
            open_runs.setdefault(run, row)
    return np.array(sorted(rects, key=lambda rect: (rect[1], rect[0])), float) / side


def _find_runs(row: np.ndarray) -> list[tuple[int, int]]:
    padded = np.concatenate([[False], row, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1]).tolist()
    return [run for run in pairwise(edges) if row[run[0]]]


def add_rects(ink: np.ndarray, rects: np.ndarray) -> None:
    """Add to (h, w) float `ink` the share of each pixel that rectangles (k, 4), in pixels, cover, exactly."""
    height, width = ink.shape
    for left, top, right, bottom in rects:
        x0, y0 = max(int(left), 0), max(int(top), 0)
        x1, y1 = min(int(np.ceil(right)), width), min(int(np.ceil(bottom)), height)
        columns, rows = np.arange(x0, x1), np.arange(y0, y1)
        across = np.minimum(columns + 1, right) - np.maximum(columns, left)
        down = np.minimum(rows + 1, bottom) - np.maximum(rows, top)
        ink[y0:y1, x0:x1] += np.outer(down, across)


def require_ink(what: str, percent: float) -> None:
    """Check how dark a sheet is printed.

    Raises:
        ToolkitError: it is below `LEAST_INK_PERCENT`, or over 100.
    """
    if not LEAST_INK_PERCENT <= percent <= 100:
        raise ToolkitError(
            f"{what}: ink_percent: expected {LEAST_INK_PERCENT:g} (paler is not found) to 100, found {percent:g}"
        )


def ink_to_picture(ink: np.ndarray, percent: float = 100.0) -> np.ndarray:
    """(h, w) uint8 sRGB grey of paper that is covered to the given share, 0 to 1, by a grey of so many percent ink.

    Half-covered pixels are encoded from linear light, as a camera or a scaled print would show them.
    """
    from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear

    grey = float(srgb_to_linear(np.array(1 - percent / 100)))
    return np.round(255 * linear_to_srgb(1 - np.clip(ink, 0, 1) * (1 - grey))).astype(np.uint8)


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
