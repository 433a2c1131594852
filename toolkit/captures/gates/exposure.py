"""Too bright or too dark, by what is lost of the object and by the board's white paper."""

import cv2
import numpy as np

from toolkit.captures.camera.board_pose import BoardSighting
from toolkit.captures.gates.result import Gate, GateResult

CLIPPED = 252
"""sRGB value from which a channel has lost its shades; JPEG moves a clipped one by a few levels."""
OVER = Gate(
    "over-exposure", 5.0, "% of the object clipped",
    "too bright: tap on the object before the shot, turn exposure down, or take the lamp away",
)  # fmt: skip
"""5 %: of the rig's good photographs 0.03 % are clipped at most, which leaves room for highlights on real paint,
glass and metal; one stop too much clips 4 to 18 %, and the colours of a patch are then no longer those that were
printed."""
UNDER_PAPER = Gate(
    "under-exposure", 110.0, "grey level of white paper",
    "too dark: use more light, or turn exposure up", at_most=False,
)  # fmt: skip
"""110: white paper has 165 to 240 in a photograph that is exposed well, and 85 to 106 at two stops less, where noise
and coarse shades take the place of colours. The paper is the measure where a board is seen, as a black object is not
under-exposed."""
UNDER_BRIGHTEST = Gate(
    "under-exposure", 80.0, "grey level of the brightest tenth",
    "too dark: use more light, or turn exposure up", at_most=False,
)  # fmt: skip
"""80: without a board, something in the middle of nearly every picture is half as bright as paper or brighter; less
light than this by a further stop leaves nothing to see."""
MIDDLE_SHARE = 0.6
PAPER_PERCENTILE = 92
"""A quarter of a ChArUco board is white paper, markers' modules included; its darker part may lie in a shadow."""


def check_over_exposure(pixels: np.ndarray) -> GateResult:
    """Share of the object's pixels of which two channels or more are clipped: one alone is a pure colour.

    Args:
        pixels: (n, 3) uint8 sRGB, of the object's region.
    """
    second = np.sort(pixels, axis=1)[:, 1]
    return OVER.judge(100.0 * float((second >= CLIPPED).mean()))


def check_under_exposure(paper: float | None, pixels: np.ndarray) -> GateResult:
    """The grey level of the board's paper, or of the brightest tenth of the object's region where no board is seen.

    Args:
        paper: from `measure_paper`, None without a board.
        pixels: (n, 3) uint8 sRGB, of the object's region.
    """
    if paper is not None:
        return UNDER_PAPER.judge(paper)
    return UNDER_BRIGHTEST.judge(float(np.percentile(_luma(pixels), 90)))


def measure_paper(image: np.ndarray, sighting: BoardSighting) -> float | None:
    """Grey level 0 to 255 of the board's white paper, half of which is at least as bright; None for a sliver of board.

    Args:
        image: (h, w, 3) uint8 sRGB.
        sighting: of a board in it.
    """
    hull = cv2.convexHull(sighting.corners_px.astype(np.float32))
    inside = np.zeros(image.shape[:2], np.uint8)
    cv2.fillConvexPoly(inside, hull.round().astype(np.int32), 1)
    pixels = image[inside.astype(bool)]
    return float(np.percentile(_luma(pixels), PAPER_PERCENTILE)) if len(pixels) >= 100 else None


def middle_of(image: np.ndarray) -> np.ndarray:
    """(h, w) bool: the part of a picture in which an object is looked for when its place is not known."""
    h, w = image.shape[:2]
    mask = np.zeros((h, w), bool)
    top, left = round(h * (1 - MIDDLE_SHARE) / 2), round(w * (1 - MIDDLE_SHARE) / 2)
    mask[top : h - top, left : w - left] = True
    return mask


def _luma(pixels: np.ndarray) -> np.ndarray:
    return pixels.astype(np.float32) @ np.array([0.2126, 0.7152, 0.0722], np.float32)
