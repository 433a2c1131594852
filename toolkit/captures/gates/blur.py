"""How blurred a photograph is, as a classifier would notice: the spread of edges, in the pixels that it looks at.

Two measures that know nothing of what is photographed. Where the board is seen, its printed squares: across an edge
black ink, white paper of known width and black ink follow each other, and the width of the blur is fitted to that.
Elsewhere, any edges: each is blurred a little more, and the loss of slope tells how blurred it was before (Zhuo and
Sim, "Defocus map estimation from a single image", 2011). Blur by a shaken camera has a direction, so edges of all
directions are asked, and the worst counts.
"""

from itertools import pairwise

import cv2
import numpy as np

from toolkit.captures.camera.board_pose import BoardSighting
from toolkit.captures.gates.result import Gate, GateResult
from toolkit.colour import srgb_to_linear
from toolkit.rig.board import BoardSpec

NETWORK_SIDE_PX = 256
"""Pixels of the photograph's shorter side once it is shrunk for a classifier."""
BLUR = Gate("blur", 0.7, "px at the classifier's size", "hold still or use more light, and tap on the object to focus")
"""0.7 px, as a Gaussian's standard deviation: shrinking blurs by 0.4 px itself, and the mildest defocus of
ImageNet-C, which costs a ResNet some accuracy, is a disc of 1.5 px. Up to here the board can be read as well: one
that fills the frame has modules of 1.5 such pixels or more. A sharp photograph of 640 × 360
has 0.36 px, one of 1280 × 960 about 0.2 px."""
LEAST_EDGES = 6
ALONG = np.linspace(0.25, 0.75, 9)
"""Places along a square's edge that are averaged: a marker's black border lies beside all of them."""
MARKER_MODULES = 7
MOST_EDGES = 30
"""Of one direction, those that are seen widest."""
NARROWEST_PX, WIDEST_MARGINS = 0.3, 1.8
"""Widths of the blur that are tried: in pixels, and in white margins of the board."""
LEAST_MARGIN_PX = 1.2
LEAST_FIT = 0.8
"""Share of an edge's variation that the fitted bar must explain: noise and what lies on the board are no edges."""
BINS = 4
LEAST_BIN = 40
SMOOTH_PX = 0.8
SHARP_PERCENTILE = 35
Edge = tuple[np.ndarray, np.ndarray, np.ndarray]


def check_blur(width_px: float | None, size: tuple[int, int]) -> GateResult:
    """Judge a blur's width.

    Args:
        width_px: standard deviation in pixels of a photograph of that size; None where there were no edges.
        size: (width, height).
    """
    if width_px is None:
        return BLUR.skip("no edges are seen, neither of a board nor of anything else")
    return BLUR.judge(width_px * NETWORK_SIDE_PX / min(size))


def measure_board_blur(grey: np.ndarray, sighting: BoardSighting, board: BoardSpec) -> float | None:
    """Standard deviation of the blur in pixels, from the edges of a ChArUco board's squares.

    Args:
        grey: (h, w) uint8, sRGB-encoded.
        sighting: of the board in that picture.
        board: which.

    Returns:
        The median over the edges of one direction, the worse of the two; None where too few edges are seen.
    """
    light = srgb_to_linear(np.arange(256) / 255.0)[grey]
    places = zip(sighting.ids.tolist(), sighting.corners_px - 0.5, strict=True)
    found = {divmod(number, board.columns - 1): place for number, place in places}
    worst = None
    for step in ((0, 1), (1, 0)):
        edges = sorted(_list_edges(found, step), key=lambda edge: -_width_over(edge))[:MOST_EDGES]
        widths = [width for edge in edges if (width := _fit_edge(light, board, *edge)) is not None]
        if len(widths) >= LEAST_EDGES:
            worst = max(worst or 0.0, float(np.median(widths)))
    return worst


def _list_edges(found: dict[tuple[int, int], np.ndarray], step: tuple[int, int]) -> list[Edge]:
    """Both ends (2,) of each edge between corners that lie `step` apart, and the vector (2,) over its white square.

    Args:
        found: corners (2,) by row and column of the inner corners.
        step: rows and columns from one end of an edge to the other.
    """
    edges: list[Edge] = []
    for (row, column), start in found.items():
        end = found.get((row + step[0], column + step[1]))
        if end is None:
            continue
        sides = []
        for r, c in ((row, column), (row + step[0], column + step[1])):
            line = [found.get((r + sign * step[1], c + sign * step[0])) for sign in (-1, 0, 1)]
            sides += [after - before for before, after in pairwise(line) if before is not None and after is not None]
        if sides:
            # the upper left square is black, so the one to the lower right of a corner is white where their sum is odd
            after_is_white = (row + column) % 2 == 1
            edges.append((start, end, np.mean(sides, axis=0) * (1 if after_is_white else -1)))
    return edges


def _normal_of(start: np.ndarray, end: np.ndarray, over_white: np.ndarray) -> np.ndarray:
    """(2,) unit vector across an edge, towards its white side."""
    along = end - start
    normal = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    return normal if normal @ over_white >= 0 else -normal


def _width_over(edge: Edge) -> float:
    return float(_normal_of(*edge) @ edge[2])


def _fit_edge(light: np.ndarray, board: BoardSpec, start, end, over_white) -> float | None:
    """Standard deviation in pixels of the blur across one edge; None where it is too slanted, cut or faint."""
    normal = _normal_of(start, end, over_white)
    margin = (board.square_mm - board.marker_mm) / 2 / board.square_mm * float(normal @ over_white)
    if margin < LEAST_MARGIN_PX:
        return None
    border = margin * 2 * board.marker_mm / MARKER_MODULES / (board.square_mm - board.marker_mm)
    steps = np.arange(-1.5 * margin, margin + 0.6 * border, 0.35)
    places = (start + ALONG[:, None] * (end - start))[:, None] + steps[None, :, None] * normal
    h, w = light.shape
    if places.min() < 1 or places[..., 0].max() > w - 2 or places[..., 1].max() > h - 2:
        return None
    at = places.astype(np.float32)
    profile = cv2.remap(light, at[..., 0], at[..., 1], cv2.INTER_LINEAR).mean(axis=0)
    return _fit_bar(steps, profile, margin)


def _fit_bar(steps: np.ndarray, profile: np.ndarray, margin: float) -> float | None:
    """Fit a white bar from 0 to `margin` on black, blurred; its offset, brightness and blur are free."""
    from scipy.special import ndtr

    widths = np.geomspace(NARROWEST_PX, max(WIDEST_MARGINS * margin, 2 * NARROWEST_PX), 32)[:, None]
    seen = profile - profile.mean()
    best, found = np.inf, None
    for shift in (-0.4, 0.0, 0.4):
        bars = ndtr((steps - shift) / widths) - ndtr((steps - shift - margin) / widths)
        bars -= bars.mean(axis=1, keepdims=True)
        contrast = bars @ seen / np.maximum((bars * bars).sum(axis=1), 1e-9)
        misses = ((seen - contrast[:, None] * bars) ** 2).sum(axis=1)
        misses[contrast <= 0] = np.inf
        if misses.min() < best:
            best, found = float(misses.min()), float(widths[misses.argmin(), 0])
    return found if best <= (1 - LEAST_FIT) * float((seen * seen).sum()) else None


def measure_edge_blur(grey: np.ndarray, mask: np.ndarray) -> float | None:
    """Standard deviation of the blur in pixels, from whatever edges there are.

    Args:
        grey: (h, w) uint8, sRGB-encoded.
        mask: (h, w) bool: where edges count.

    Returns:
        Of the sharper edges of each direction the width, the worst direction's; None with too few edges.
    """
    more = 0.5 * BLUR.threshold * min(grey.shape) / NETWORK_SIDE_PX + 0.7
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTH_PX)
    x, y = _slopes(smooth)
    again_x, again_y = _slopes(cv2.GaussianBlur(smooth, (0, 0), more))
    slope, again = np.hypot(x, y), np.hypot(again_x, again_y)
    peaks = mask & _is_ridge(slope, x, y)
    values = slope[peaks]
    if len(values) < LEAST_BIN:
        return None
    peaks &= slope >= max(3.0, 0.25 * float(np.percentile(values, 98)))
    ratio = slope[peaks] / np.maximum(again[peaks], 1e-6)
    width = np.sqrt(np.maximum(more**2 / np.maximum(ratio**2 - 1, 1e-3) - SMOOTH_PX**2, 0))
    direction = (np.arctan2(y[peaks], x[peaks]) % np.pi * BINS / np.pi + 0.5).astype(int) % BINS
    bins = [width[direction == i] for i in range(BINS)]
    found = [float(np.percentile(one, SHARP_PERCENTILE)) for one in bins if len(one) >= LEAST_BIN]
    return max(found) if found else None


def _slopes(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return cv2.Scharr(picture, cv2.CV_32F, 1, 0) / 32, cv2.Scharr(picture, cv2.CV_32F, 0, 1) / 32


def _is_ridge(slope: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(h, w) bool: steeper than both neighbours along the steepest direction, as Canny thins edges."""
    level = np.abs(x) >= np.abs(y)
    left_right = (slope >= np.roll(slope, 1, 1)) & (slope >= np.roll(slope, -1, 1))
    up_down = (slope >= np.roll(slope, 1, 0)) & (slope >= np.roll(slope, -1, 0))
    return np.where(level, left_right, up_down)
