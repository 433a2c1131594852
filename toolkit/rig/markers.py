"""ArUco markers as shapes, and how they are printed."""

import math
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear

if TYPE_CHECKING:
    import cv2

DICTIONARY = "DICT_5X5_1000"
"""The dictionary of everything that is printed: markers of a board, a ring and a colour strip never share a number."""
DICTIONARIES = {f"DICT_{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)} | {
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_ARUCO_MIP_36h12": 250,
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
sees: "crossword puzzle" and "scoreboard" instead of the object (docs/results.md). Cameras find the pale board as
well."""
LEAST_INK_PERCENT = 5.0
MOST_MM = 5000.0


def require_mm(what: str, value: float) -> None:
    """Check a length; raises a `ToolkitError` if it is not above 0, or over `MOST_MM`."""
    if not (math.isfinite(value) and 0 < value <= MOST_MM):
        raise ToolkitError(f"{what}: expected millimetres above 0 and up to {MOST_MM:g}, found {value:g}")


def sheet_to_world(points_mm: np.ndarray, size_mm: tuple[float, float]) -> np.ndarray:
    """(..., 2) positions on a sheet to (..., 3) in the world: down the sheet is +x, to its right +y, its middle 0."""
    points = np.asarray(points_mm, float)
    width, height = size_mm
    return np.stack([points[..., 1] - height / 2, points[..., 0] - width / 2, np.zeros(points.shape[:-1])], axis=-1)


def count_markers(dictionary: str) -> int:
    """How many markers an OpenCV dictionary has; raises a `ToolkitError` if there is none of that name."""
    if dictionary not in DICTIONARIES:
        raise one_of("dictionary of markers", dictionary, list(DICTIONARIES))
    return DICTIONARIES[dictionary]


def find_family(name: str) -> str:
    """OpenCV's name of a family of tags: `36h11` is `DICT_APRILTAG_36h11`, `4x4_50` is `DICT_4X4_50`.

    Raises:
        ToolkitError: there is none of that name.
    """
    by_short = {
        dictionary.removeprefix("DICT_").removeprefix("APRILTAG_").lower(): dictionary for dictionary in DICTIONARIES
    }
    short = name.strip().lower().removeprefix("dict_").removeprefix("apriltag_").removeprefix("tag")
    if short not in by_short:
        raise FieldError(f"no family of tags called '{name}': expected one of {', '.join(by_short)}", {})
    return by_short[short]


def require_ids(what: str, dictionary: str, first_id: int, count: int) -> None:
    """Check that a dictionary has the markers of a sheet.

    Raises:
        ToolkitError: there is none of that name, or it ends before them.
    """
    known = count_markers(dictionary)
    if not 0 <= first_id <= known - count:
        raise ToolkitError(
            f"{what}: markers {first_id} to {first_id + count - 1} of {dictionary}: it has 0 to {known - 1}; choose "
            "another dictionary or first_id"
        )


def get_dictionary(name: str) -> "cv2.aruco.Dictionary":
    """An OpenCV dictionary by name; raises a `ToolkitError` if there is none of that name."""
    import cv2

    count_markers(name)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def find_markers(dictionary: str, grey: np.ndarray, *, refined: bool = False) -> list[tuple[int, np.ndarray]]:
    """Number and corners (4, 2), pixels, of each marker of a dictionary that OpenCV reads in a picture (h, w) uint8.

    Corners are in OpenCV's order; `refined` ones lie between pixels.
    """
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    if refined:
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    try:
        corners, ids, _ = cv2.aruco.ArucoDetector(get_dictionary(dictionary), parameters).detectMarkers(grey)
    except cv2.error:  # a shape that it takes for a marker can fail its own checks
        return []
    # OpenCV says None where it finds no marker
    numbers = [] if ids is None else ids.ravel().tolist()
    return [(number, corner.reshape(4, 2)) for number, corner in zip(numbers, corners, strict=True)]


@lru_cache(maxsize=2048)
def marker_modules(dictionary: str, marker_id: int) -> np.ndarray:
    """(m, m) bool, true where a marker is black, its border included; first row on top."""
    import cv2

    known = get_dictionary(dictionary)
    # a black module of border all round
    side = known.markerSize + 2
    return cv2.aruco.generateImageMarker(known, marker_id, side, borderBits=1) == 0


def black_rects(modules: np.ndarray) -> np.ndarray:
    """(k, 4) left, top, right, bottom of the black runs of (m, m) modules, in shares of the marker's side.

    They do not overlap; equal runs of neighbouring rows are joined.
    """
    side = len(modules)
    open_runs: dict[tuple[int, int], int] = {}
    rects = []
    # a row more than there are, which ends all runs
    for row in range(side + 1):
        runs = set(_find_runs(modules[row])) if row < side else set()
        # a run that the next row has as well grows down: fewer, larger rectangles, and no seams between rows
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
    """Check how dark a sheet is printed; raises a `ToolkitError` if it is below `LEAST_INK_PERCENT`, or over 100."""
    if not LEAST_INK_PERCENT <= percent <= 100:
        raise ToolkitError(
            f"{what}: ink_percent: expected {LEAST_INK_PERCENT:g} (paler is not found) to 100, found {percent:g}"
        )


def ink_to_picture(ink: np.ndarray, percent: float = 100.0) -> np.ndarray:
    """(h, w) uint8 sRGB grey of paper that is covered to the given share, 0 to 1, by a grey of so many percent ink.

    Half-covered pixels are encoded from linear light, as a camera or a scaled print would show them.
    """
    # ink and paper mix as light within a pixel
    grey = float(srgb_to_linear(np.array(1 - percent / 100)))
    return np.round(255 * linear_to_srgb(1 - np.clip(ink, 0, 1) * (1 - grey))).astype(np.uint8)


SAMPLES = 5
"""Per pixel and axis, where a turned marker is painted."""


def add_turned(ink: np.ndarray, modules: np.ndarray, corners_px: np.ndarray) -> None:
    """Add to (h, w) `ink` the share of each pixel that a turned marker covers, from `SAMPLES`² points in each."""
    # the pixels round the marker, each with a grid of points
    x0, y0 = np.maximum(np.floor(corners_px.min(axis=0)).astype(int), 0)
    x1, y1 = np.minimum(np.ceil(corners_px.max(axis=0)).astype(int), ink.shape[::-1])
    at = (np.arange(SAMPLES * max(x1 - x0, y1 - y0)) + 0.5) / SAMPLES
    x, y = np.meshgrid(x0 + at[: SAMPLES * (x1 - x0)], y0 + at[: SAMPLES * (y1 - y0)])
    # the marker's axes: a point's place along them, in modules
    right, down = corners_px[1] - corners_px[0], corners_px[3] - corners_px[0]
    offset = np.stack([x, y], axis=-1) - corners_px[0]
    side = len(modules)
    column, row = (np.floor(offset @ axis / (axis @ axis) * side).astype(int) for axis in (right, down))
    within = (column >= 0) & (column < side) & (row >= 0) & (row < side)
    black = within & modules[np.where(within, row, 0), np.where(within, column, 0)]
    ink[y0:y1, x0:x1] += black.reshape(y1 - y0, SAMPLES, x1 - x0, SAMPLES).mean(axis=(1, 3))
