"""Is the object in the photograph, whole and where it should be; is it too bright, too dark, or blurred?"""

from itertools import pairwise

import cv2
import numpy as np

from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.rig.board import Board, CharucoBoard
from toolkit.rooms.photos.board_pose import BoardSighting
from toolkit.rooms.photos.gates import Gate, GateResult
from toolkit.rooms.photos.gates.objects import Solid
from toolkit.rooms.photos.posed_camera import PosedCamera

CUT_OFF = Gate(
    "cut off", 2.0, "% of the object", "the object reaches over the picture's edge: step back, or aim at its middle"
)
"""2 %: a classifier does not miss the tip of an aerial. The predicted silhouette is about as sure: an object of 270 mm
that stands 5 mm off is cut by as much."""
CROP_SHARE = 0.875
"""Classifiers look at the middle square of a photograph, 224 of 256 pixels of its shorter side."""
OFF_CENTRE = Gate(
    "off centre", 10.0, "% of the object",
    "a part of the object lies outside the middle square that classifiers look at: aim at its middle, or step back",
)  # fmt: skip
"""10 %: an aim that is 3 % of the frame off loses nothing at the plan's size. A lost tenth of the object may be what it
is recognised by."""
MISSING = Gate(
    "object missing", 25.0, "% of the board's corners that it should hide",
    "the board is seen where the object should stand: put the object on the board's middle, its front to FRONT",
)  # fmt: skip
"""25 %: none is seen with the object in place, at most 12 % if it stands 14 mm and 6° off, and all without it."""
PLACE_SLACK_MM = 10.0
"""A corner counts as hidden if it stays hidden when the object moves by so much."""
LEAST_HIDDEN = 4


def measure_outside(pixels: np.ndarray, low: tuple[float, float], high: tuple[float, float]) -> float:
    """Share in % of points (n, 2) that lie outside a rectangle given by two corners; NaN counts as outside."""
    # written as "not inside", so that a point behind the camera, which is NaN, counts as outside
    inside = ((pixels >= low) & (pixels < high)).all(axis=1)
    return 100.0 * float((~inside).mean())


def check_cut_off(silhouette: np.ndarray, size: tuple[int, int]) -> GateResult:
    """Share of the object's silhouette, (n, 2) pixels from `silhouette_px`, outside a frame (width, height)."""
    if len(silhouette) == 0:
        return CUT_OFF.judge(100.0, "the object is behind the camera: check that the board lies under the object")
    return CUT_OFF.judge(measure_outside(silhouette, (0, 0), size))


def check_centred(silhouette: np.ndarray, size: tuple[int, int]) -> GateResult:
    """Share of the object's silhouette outside the middle square that classifiers see, as `check_cut_off`."""
    side = CROP_SHARE * min(size)
    low = ((size[0] - side) / 2, (size[1] - side) / 2)
    return OFF_CENTRE.judge(measure_outside(silhouette, low, (low[0] + side, low[1] + side)))


def check_there(solid: Solid, view: PosedCamera, board: Board, sighting: BoardSighting) -> GateResult:
    """Share of the board's corners behind the object that are seen nevertheless."""
    hidden = find_hidden_corners(solid, view, board)
    if len(hidden) < LEAST_HIDDEN:
        return MISSING.skip("from here the object hides too little of the board to tell")
    seen = np.isin(hidden, sighting.ids)
    return MISSING.judge(100.0 * float(seen.mean()))


def find_hidden_corners(solid: Solid, view: PosedCamera, board: Board) -> np.ndarray:
    """(k,) numbers of the board's corners that are in the frame and behind the object, safely so."""
    points = board.object_points()
    hidden = view.sees(points)
    for x, y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        # hidden from five places: a corner near the silhouette may show where the object stands a little off
        hidden = hidden & solid.hides(view, points + PLACE_SLACK_MM * np.array([x, y, 0.0]))
    return np.flatnonzero(hidden)


CLIPPED = 252
"""sRGB value of a clipped channel; JPEG moves it by a few levels."""
OVER = Gate(
    "over-exposure", 5.0, "% of the object clipped",
    "too bright: tap on the object before the shot, turn exposure down, or take the lamp away",
)  # fmt: skip
"""5 %: at most 0.03 % is clipped in the rig's good photographs, which leaves room for highlights on real paint and
metal. A stop too much clips 4 to 18 %, and changes the colours of a patch."""
UNDER_PAPER = Gate(
    "under-exposure", 110.0, "grey level of white paper",
    "too dark: use more light, or turn exposure up", at_most=False,
)  # fmt: skip
"""110: white paper has 165 to 240 in a good photograph. At two stops less it has 85 to 106, and colours drown in noise.
The paper is the measure, if a board is seen, because a black object is not under-exposed."""
UNDER_BRIGHTEST = Gate(
    "under-exposure", 80.0, "grey level of the brightest tenth",
    "too dark: use more light, or turn exposure up", at_most=False,
)  # fmt: skip
"""80: without a board, something in the middle of nearly every picture is half as bright as paper or brighter."""
BRIGHT = 140.0
"""Grey level above which the unclipped half of an over-exposed picture lies; some 120 where it is exposed well."""
MIDDLE_SHARE = 0.6
PAPER_PERCENTILE = 92
"""A quarter of a ChArUco board is white paper; its darker part may lie in a shadow."""


def check_over_exposure(pixels: np.ndarray, is_object: bool = True) -> GateResult:
    """Share of pixels (n, 3) uint8 sRGB with two clipped channels or more: a single clipped channel is a pure colour.

    Pixels that are not known to be the object's may show a bright window. Then a photograph is too bright only if all
    else in it is bright as well.
    """
    clipped = np.sort(pixels, axis=1)[:, 1] >= CLIPPED
    result = OVER.judge(100.0 * float(clipped.mean()))
    if is_object or result.passed or clipped.all():
        return result
    if float(np.median(_luma(pixels[~clipped]))) < BRIGHT:
        return OVER.skip("a part is clipped, a window or a lamp perhaps, and the object's place is not known")
    return result


def check_under_exposure(paper: float | None, pixels: np.ndarray) -> GateResult:
    """Judge the board's `paper` (`measure_paper`), or without a board the object's pixels (n, 3) uint8 sRGB."""
    if paper is not None:
        return UNDER_PAPER.judge(paper)
    return UNDER_BRIGHTEST.judge(float(np.percentile(_luma(pixels), 90)))


def measure_paper(image: np.ndarray, sighting: BoardSighting) -> float | None:
    """Median grey level, 0 to 255, of the board's white paper; None if too little of the board shows."""
    pixels = sighting.pixels(image)
    return float(np.percentile(_luma(pixels), PAPER_PERCENTILE)) if len(pixels) >= 100 else None


def middle_of(image: np.ndarray) -> np.ndarray:
    """(h, w) bool: the middle of a picture, where an object is looked for if its place is not known."""
    h, w = image.shape[:2]
    mask = np.zeros((h, w), bool)
    top, left = round(h * (1 - MIDDLE_SHARE) / 2), round(w * (1 - MIDDLE_SHARE) / 2)
    mask[top : h - top, left : w - left] = True
    return mask


def _luma(pixels: np.ndarray) -> np.ndarray:
    # Rec. 709's weights of red, green and blue
    return pixels.astype(np.float32) @ np.array([0.2126, 0.7152, 0.0722], np.float32)


NETWORK_SIDE_PX = 256
"""Pixels of the photograph's shorter side once it is shrunk for a classifier."""
BLUR = Gate("blur", 0.7, "px at the classifier's size", "hold still or use more light, and tap on the object to focus")
"""0.7 px, as a Gaussian's standard deviation: shrinking itself blurs by 0.4 px. The mildest defocus of ImageNet-C, a
disc of 1.5 px, costs a ResNet some accuracy. The board can be read up to here: its modules are then 1.5 px or more.
Sharp photographs have 0.2 to 0.36 px."""
BLUR_OF_EDGES = Gate("blur", 0.55, BLUR.unit, BLUR.advice)
"""0.55 px without a board: sharp photographs among 97 by phones and webcams have 0.2 to 0.54."""
LEAST_EDGES = 6
ALONG = np.linspace(0.25, 0.75, 9)
"""Places along a square's edge that are averaged: a marker's black border lies beside all of them."""
MARKER_MODULES = 7
MOST_EDGES = 30
"""Largest number of edges of a direction; the widest are kept."""
NARROWEST_PX, WIDEST_MARGINS = 0.3, 1.8
"""Widths of the blur that are tried: in pixels, and in white margins of the board."""
LEAST_MARGIN_PX = 1.2
LEAST_FIT = 0.8
"""Share of an edge's variation that the fitted bar must explain: noise and clutter are no edges."""
EDGE_SIDE_PX = 2 * NETWORK_SIDE_PX
"""Shorter side of the picture in which edges are measured: what is finer than half of a classifier's pixel is noise."""
COARSE_PX, FINE_PX = 2.0, 0.7
STRONG = 0.3
"""Least slope of an edge that counts, as a share of the steepest slope."""
BINS = 6
LEAST_BIN = 40
SHARP_PERCENTILE = 33
Edge = tuple[np.ndarray, np.ndarray, np.ndarray]


def check_blur(grey: np.ndarray, mask: np.ndarray, sighting: BoardSighting | None, board: Board | None) -> GateResult:
    """Judge the blur by the board's edges, which are known to be sharp; else by whatever edges lie in a mask.

    `grey` is (h, w) uint8, sRGB-encoded, `mask` (h, w) bool.
    """
    # blur counts in pixels of the classifier, where it harms
    to_network = NETWORK_SIDE_PX / min(grey.shape)
    if sighting is not None and isinstance(board, CharucoBoard):
        width_px = measure_board_blur(grey, sighting, board)
        if width_px is not None:
            return BLUR.judge(width_px * to_network)
    # without a board, edges of unknown sharpness
    width_px = measure_edge_blur(grey, mask)
    if width_px is None:
        return BLUR.skip("no edges are seen, neither of a board nor of anything else")
    return BLUR_OF_EDGES.judge(width_px * to_network)


def measure_board_blur(grey: np.ndarray, sighting: BoardSighting, board: CharucoBoard) -> float | None:
    """Standard deviation of the blur in pixels, from the edges of a ChArUco board's squares.

    It is the median over the edges of the worse direction; None if too few edges are seen.
    """
    light = LINEAR_OF_CODE[grey]
    places = zip(sighting.ids.tolist(), sighting.corners_px - 0.5, strict=True)
    # corners are numbered row by row; there is a corner less each way than squares
    found = {divmod(number, board.columns - 1): place for number, place in places}
    worst = None
    for step in ((0, 1), (1, 0)):
        edges = _list_edges(found, step, board)
        edges = sorted(edges, key=lambda edge: -float(_normal_of(*edge) @ edge[2]))[:MOST_EDGES]
        widths = [width for edge in edges if (width := _fit_edge(light, board, edge)) is not None]
        if len(widths) >= LEAST_EDGES:
            # shake blurs a single direction, and the picture is as blurred as its worse direction
            worst = max(worst or 0.0, float(np.median(widths)))
    return worst


def _list_edges(found: dict[tuple[int, int], np.ndarray], step: tuple[int, int], board: CharucoBoard) -> list[Edge]:
    """Both ends (2,) of each edge between corners that lie `step` apart, and the vector (2,) over its white square."""
    edges: list[Edge] = []
    # neighbouring corners in the given direction form an edge
    for (row, column), start in found.items():
        end = found.get((row + step[0], column + step[1]))
        if end is None:
            continue
        sides = []
        for r, c in ((row, column), (row + step[0], column + step[1])):
            line = [found.get((r + sign * step[1], c + sign * step[0])) for sign in (-1, 0, 1)]
            # differences over squares on both sides of the edge, at both of its ends; perspective then averages out
            sides += [after - before for before, after in pairwise(line) if before is not None and after is not None]
        if sides:
            after_is_white = not board.is_black(row + 1, column + 1)
            edges.append((start, end, np.mean(sides, axis=0) * (1 if after_is_white else -1)))
    return edges


def _normal_of(start: np.ndarray, end: np.ndarray, over_white: np.ndarray) -> np.ndarray:
    """(2,) unit vector across an edge, towards its white side."""
    along = end - start
    normal = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    return normal if normal @ over_white >= 0 else -normal


def _fit_edge(light: np.ndarray, board: CharucoBoard, edge: Edge) -> float | None:
    """Standard deviation in pixels of the blur across an edge; None if it is too slanted, cut or faint."""
    start, end, over_white = edge
    normal = _normal_of(*edge)
    margin = (board.square_mm - board.marker_mm) / 2 / board.square_mm * float(normal @ over_white)
    if margin < LEAST_MARGIN_PX:
        return None
    # two margins are a square less a marker, so this is the width of a module of the marker's border, in pixels
    border = margin * 2 * board.marker_mm / MARKER_MODULES / (board.square_mm - board.marker_mm)
    # from inside the black square, over the white margin, a little into the marker's border, which is black again
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

    # geometric steps: a blur counts by its ratio to others
    widths = np.geomspace(NARROWEST_PX, max(WIDEST_MARGINS * margin, 2 * NARROWEST_PX), 32)[:, None]
    seen = profile - profile.mean()
    best, found = np.inf, None
    for shift in (-0.4, 0.0, 0.4):
        # a blurred step is the normal distribution's integral; a bar is a step up and a step down
        bars = ndtr((steps - shift) / widths) - ndtr((steps - shift - margin) / widths)
        bars -= bars.mean(axis=1, keepdims=True)
        contrast = bars @ seen / np.maximum((bars * bars).sum(axis=1), 1e-9)
        misses = ((seen - contrast[:, None] * bars) ** 2).sum(axis=1)
        misses[contrast <= 0] = np.inf
        if misses.min() < best:
            best, found = float(misses.min()), float(widths[misses.argmin(), 0])
    # 1 - R²: what the best bar leaves may be a fifth of the edge's variation
    return found if best <= (1 - LEAST_FIT) * float((seen * seen).sum()) else None


def measure_edge_blur(grey: np.ndarray, mask: np.ndarray) -> float | None:
    """Standard deviation of the blur in pixels, from the edges in a mask (h, w) bool, in the most blurred direction.

    Edges are places where the blurred picture is steep, which noise and a phone's sharpening are not. A Gaussian edge
    of width w has the slope 1 / sqrt(w^2 + s^2) behind a blur of s, so two blurs give its width. Camera shake widens
    the edges across its path alone, so directions are judged apart, each by its sharper edges. None with too few.
    """
    share = min(1.0, EDGE_SIDE_PX / min(grey.shape))
    if share < 1:
        grey = cv2.resize(grey, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        mask = cv2.resize(mask.astype(np.uint8), grey.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0
    coarse_px, light = COARSE_PX * max(0.5, min(grey.shape) / EDGE_SIDE_PX), grey.astype(np.float32)
    # where the blurred picture is steepest: the middle of each edge
    x, y = _slopes(cv2.GaussianBlur(light, (0, 0), coarse_px))
    slope = np.hypot(x, y)
    peaks = mask & _is_ridge(slope, x, y)
    # at the rim `np.roll` compares with the opposite side, and slopes use mirrored pixels
    peaks[[0, 1, -1, -2]] = peaks[:, [0, 1, -1, -2]] = False
    if peaks.sum() < LEAST_BIN:
        return None
    # weak edges may be soft in themselves; only strong ones are measured
    peaks &= slope >= max(1.0, STRONG * float(np.percentile(slope[peaks], 98)))
    rows, columns = np.nonzero(peaks)
    normal = np.stack([x[peaks], y[peaks]], axis=1) / slope[peaks, None]
    # the same edges behind a finer blur
    fine_x, fine_y = _slopes(cv2.GaussianBlur(light, (0, 0), FINE_PX))
    steepest = np.zeros(len(rows), np.float32)
    for step in (-2, -1, 0, 1, 2):  # the steepest place of the unblurred edge lies a little beside
        at = np.stack([columns, rows], axis=1) + (step * normal).round().astype(int)
        column, row = at[:, 0].clip(0, grey.shape[1] - 1), at[:, 1].clip(0, grey.shape[0] - 1)
        across = fine_x[row, column] * normal[:, 0] + fine_y[row, column] * normal[:, 1]
        steepest = np.maximum(steepest, across)
    # slopes are 1 / sqrt(w² + s²), so the squared ratio is (w² + coarse²) / (w² + fine²), which solves for w
    ratio = np.maximum((steepest / slope[peaks]) ** 2, 1 + 1e-3)
    width = np.sqrt(np.maximum((coarse_px**2 - ratio * FINE_PX**2) / (ratio - 1), 0)) / share
    # the direction of each edge, in bins over half a turn
    direction = (np.arctan2(normal[:, 1], normal[:, 0]) % np.pi * BINS / np.pi + 0.5).astype(int) % BINS
    bins = [width[direction == i] for i in range(BINS)]
    # the sharper third of a direction: soft shadows and round shapes are not the camera's blur
    found = [float(np.percentile(widths, SHARP_PERCENTILE)) for widths in bins if len(widths) >= LEAST_BIN]
    return max(found) if found else None


def _slopes(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Scharr's weights sum to 32: the slope is then in grey levels a pixel
    return cv2.Scharr(picture, cv2.CV_32F, 1, 0) / 32, cv2.Scharr(picture, cv2.CV_32F, 0, 1) / 32


def _is_ridge(slope: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(h, w) bool: steeper than both neighbours along the steepest direction, as Canny thins edges."""
    level = np.abs(x) >= np.abs(y)
    left_right = (slope >= np.roll(slope, 1, 1)) & (slope >= np.roll(slope, -1, 1))
    up_down = (slope >= np.roll(slope, 1, 0)) & (slope >= np.roll(slope, -1, 0))
    return np.where(level, left_right, up_down)
