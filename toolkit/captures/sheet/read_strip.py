"""The colour strip of a printed page, read from a photograph."""

from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.captures.sheet.align_patch import sample_image
from toolkit.captures.sheet.patch_placement import map_points
from toolkit.colour import srgb_to_linear
from toolkit.printing.colour_strip import STRIP

INSET = 0.2
"""Share of a cell's side that is left out at each edge: camera blur mixes neighbours there."""
SAMPLE_PX = 9
LEAST_CELL_PX = 6.0
CLIPPED = 253
LARGEST_MISS_MM = 0.8


@dataclass(frozen=True)
class StripReading:
    """Colours of the strip's cells as a photo shows them.

    Attributes:
        names: of the cells.
        file_srgb: (k, 3) uint8, as the file states them.
        seen_linear: (k, 3) float, linear light of the photo: median over the cell's middle.
        clipped: (k,) bool, whether the photo is over-exposed there.
        homography: (3, 3) from millimetres on the strip, x right and y down, to pixels.
    """

    names: tuple[str, ...]
    file_srgb: np.ndarray
    seen_linear: np.ndarray
    clipped: np.ndarray
    homography: np.ndarray

    @property
    def white_linear(self) -> np.ndarray:
        """(3,) linear light of bare paper: mean of the cells that the file leaves white."""
        return self.seen_linear[(self.file_srgb == 255).all(axis=1)].mean(axis=0)


def read_strip(image: np.ndarray) -> StripReading | None:
    """Find the strip by its two markers and read every cell.

    Args:
        image: (h, w, 3) uint8 sRGB.

    Returns:
        The colours, or None where both markers are not seen, or the cells are under 6 pixels wide.
    """
    H = _find_strip(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    if H is None:
        return None
    side = STRIP.cells[0].side_mm
    corners = map_points(H, STRIP.cell_corners_mm().reshape(-1, 2)).reshape(-1, 4, 2)
    if np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).min() < LEAST_CELL_PX:
        return None
    steps = ((np.arange(SAMPLE_PX) + 0.5) / SAMPLE_PX - 0.5) * (1 - 2 * INSET) * side
    offsets = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    places = map_points(H, (STRIP.centres_mm[:, None] + offsets).reshape(-1, 2))
    at = places.reshape(len(STRIP.cells), -1, 2)
    if (at < 0).any() or (at[..., 0] > image.shape[1]).any() or (at[..., 1] > image.shape[0]).any():
        return None
    seen = sample_image(image, at)
    linear = np.median(srgb_to_linear(seen / 255.0), axis=1)
    clipped = (np.median(seen, axis=1) >= CLIPPED).any(axis=1)
    return StripReading(STRIP.names, STRIP.srgb, linear, clipped, H)


def _find_strip(grey: np.ndarray) -> np.ndarray | None:
    """(3, 3) from millimetres on the strip to pixels; None where its two markers are not both there."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, STRIP.dictionary))
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary, settings).detectMarkers(grey)
    if ids is None:
        return None
    corners = {int(number): corner.reshape(4, 2) + 0.5 for number, corner in zip(ids.ravel(), found, strict=True)}
    wanted = list(STRIP.marker_corners)
    if not all(number in corners for number in wanted):
        return None
    printed = STRIP.marker_corners_mm(wanted).reshape(-1, 2)
    pixels = np.concatenate([corners[number] for number in wanted])
    H, _ = cv2.findHomography(printed, pixels)
    if H is None:
        return None
    # a marker of something else, or a strip that is bent: its own corners must come back where they are
    back = map_points(np.linalg.inv(H), pixels)
    return H if np.abs(back - printed).max() < LARGEST_MISS_MM else None
