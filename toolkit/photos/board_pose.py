"""Where a photograph's camera stood, from the printed board or ring that the object stands on."""

from collections.abc import Container, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.photos.lens import scale_lens
from toolkit.photos.plane_pose import PhotoPose, fit_plane_pose
from toolkit.rig.board import Board, CharucoBoard
from toolkit.rig.camera import Camera
from toolkit.rig.markers import get_dictionary

ANCHORS = 16
"""Known points nearest to a corner, from which it is predicted; so few that a lens's distortion matters little."""
REACH_SQUARES = 3.0
"""A corner is predicted from no farther than this."""
MOST_SHIFT = 0.15
"""How far a corner may lie from its prediction, in squares."""
LEAST_CONTRAST_SHARE = 0.35
LEAST_CONTRAST = 8.0
"""Grey levels between the darker of two light squares and the lighter of two dark ones, and the share of what is usual
on the board, that a corner must have."""
PASSES = 3
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)


def grow_corners(
    grey: np.ndarray, board: CharucoBoard, found: dict[int, np.ndarray], markers: dict[int, np.ndarray]
) -> dict[int, np.ndarray]:
    """Corners (2,) by number: those `found`, and all others of the board that can be seen near them.

    Args:
        grey: (h, w) uint8.
        board: that is in the picture.
        found: corners that are known.
        markers: corners (4, 2) of the markers that were read, by number.
    """
    world = board.object_points()[:, :2]
    marker_mm = board.marker_points(sorted(markers))[..., :2].reshape(-1, 2)
    marker_px = np.concatenate([markers[number] for number in sorted(markers)]).reshape(-1, 2)
    corners = dict(found)
    for _ in range(PASSES):
        known = sorted(corners)
        anchors_mm = np.concatenate([marker_mm, world[known]])
        anchors_px = np.concatenate([marker_px, np.array([corners[i] for i in known]).reshape(-1, 2)])
        tried = {
            i: _see_corner(grey, board, i, anchors_mm, anchors_px) for i in range(len(world))
        }  # those known before too: they tell what contrast is usual
        seen = {i: one for i, one in tried.items() if one is not None}
        if not seen:
            break
        usual = float(np.percentile([contrast for _, contrast in seen.values()], 75))
        limit = max(LEAST_CONTRAST, LEAST_CONTRAST_SHARE * usual)
        new = {i: place for i, (place, contrast) in seen.items() if contrast >= limit and i not in corners}
        corners |= new
        if not new:
            break
    return corners


def _see_corner(
    grey: np.ndarray, board: CharucoBoard, number: int, anchors_mm: np.ndarray, anchors_px: np.ndarray
) -> tuple[np.ndarray, float] | None:
    """Where a corner is, and the contrast of its squares; None where it cannot be predicted or is no crossing."""
    at_mm = board.object_points([number])[0, :2]
    away = np.linalg.norm(anchors_mm - at_mm, axis=1)
    near = np.argsort(away, kind="stable")[:ANCHORS]
    if len(near) < 4 or away[near[0]] > REACH_SQUARES * board.square_mm:
        return None
    homography, _ = cv2.findHomography(anchors_mm[near], anchors_px[near])
    if homography is None:
        return None
    square, gap = board.square_mm, (board.square_mm - board.marker_mm) / 2
    around = np.array([[0, 0], [square, 0], [0, square], [-square, 0], [0, -square]]) + at_mm
    places = cv2.perspectiveTransform(around[None], homography)[0]
    if not np.isfinite(places).all():
        return None
    side = float(np.linalg.norm(places[1:] - places[0], axis=1).min())
    window = int(np.clip(0.9 * side * gap / square, 2, 10))
    rim = window + 3
    h, w = grey.shape
    if side < 6 or not (rim <= places[0, 0] < w - rim and rim <= places[0, 1] < h - rim):
        return None
    start = places[:1].astype(np.float32).reshape(1, 1, 2)
    place = cv2.cornerSubPix(grey, start, (window, window), (-1, -1), STOP).reshape(2)
    if np.linalg.norm(place - places[0]) > max(MOST_SHIFT * side, 1.0):
        return None
    return place, _contrast(grey, board, number, homography, place - places[0])


def _contrast(grey: np.ndarray, board: CharucoBoard, number: int, homography: np.ndarray, shift: np.ndarray) -> float:
    """Grey levels by which the light squares round a corner are lighter than the dark ones, the worst pair."""
    at_mm, gap = board.object_points([number])[0, :2], (board.square_mm - board.marker_mm) / 2
    steps = np.array([(s, t) for s in (0.35, 0.8) for t in (0.35, 0.8)]) * gap
    # by world axes: down the page is +x, to its right +y
    quadrants = np.array([(-1, -1), (1, 1), (-1, 1), (1, -1)])
    points = (quadrants[:, None] * steps[None] + at_mm).reshape(1, -1, 2)
    places = (cv2.perspectiveTransform(points, homography)[0] + shift).astype(np.float32)
    values = cv2.remap(
        grey, places[:, 0].copy(), places[:, 1].copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    means = values.reshape(4, len(steps)).astype(float).mean(axis=1)
    row, column = divmod(number, board.columns - 1)
    # the square to the upper left of a corner is black where row and column are both even or both odd
    black, white = (means[:2], means[2:]) if (row + column) % 2 == 0 else (means[2:], means[:2])
    return float(white.min() - black.max())


SEARCH_SIDE_PX = 1600
"""Longer side of the picture in which markers are searched first; their corners are then refined in the full one."""
COARSE_SIDE_PX = 800
SMALL_SIDE_PX = 1000
"""Pictures up to this size are also searched enlarged: a module of 2 px is too small for the detector's threshold."""
ENOUGH_CORNERS = 24
ENOUGH_SHARE = 0.4
"""With so many corners, or this share of the board's, no further search is made in other sizes of the picture."""
LEAST_CORNERS = 6
SMALLEST_MARKER_SHARE = 0.006
"""Side of the smallest marker that is searched, as a share of the picture's longer side."""
MARKER_MODULES = 7
MODULES_IN_WINDOW = 0.8


@dataclass(frozen=True)
class BoardSighting:
    """Corners of a board that were found in a picture.

    Attributes:
        ids: (n,) number of each corner on its board.
        corners_px: (n, 2) where they are in the picture.
        world_mm: (n, 3) where they are in the world, z = 0.
        width, height: of the picture, pixels.
    """

    ids: np.ndarray
    corners_px: np.ndarray
    world_mm: np.ndarray
    width: int
    height: int


def find_board(image: np.ndarray, board: Board) -> BoardSighting | None:
    """Find a board's corners, to a fraction of a pixel, however much of it the object covers.

    Large photographs are searched at a reduced size first. Where little is found, a larger size, a coarser one (blur)
    and one with evened-out contrast (light that falls unevenly, over-exposure) follow.

    Args:
        image: (h, w, 3) uint8 sRGB, upright.
        board: which board; the user's own is `toolkit.rig.board.read_board`.

    Returns:
        What was found, or None with fewer than `LEAST_CORNERS` corners.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    finder = _CharucoFinder(board) if isinstance(board, CharucoBoard) else _RingFinder(board)
    enough = min(ENOUGH_CORNERS, ENOUGH_SHARE * len(finder.world_mm))
    best: tuple[np.ndarray, np.ndarray] | None = None
    for searched in _versions(grey):
        found = finder.find(grey, searched)
        if found is not None and (best is None or len(found[0]) > len(best[0])):
            best = found
        if best is not None and len(best[0]) >= enough:
            break
    if best is None or len(best[0]) < LEAST_CORNERS:
        return None
    ids, corners_px = best
    return BoardSighting(ids, corners_px, finder.world_mm[ids], grey.shape[1], grey.shape[0])


FAMILIES = ("DICT_4X4", "DICT_5X5", "DICT_6X6", "DICT_7X7")
SIZES = (50, 100, 250, 1000)
"""Markers in each size of a family: a smaller one is the larger one's beginning, where nearly every board begins."""
OTHERS = ("DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h11")
"""Without `DICT_APRILTAG_16h5`, which is seen in any texture."""
LEAST_MARKERS = 4
"""Different ones of a dictionary that must be read before it is believed to be there."""


def find_dictionary(image: np.ndarray) -> str | None:
    """The dictionary whose markers a picture (h, w, 3) uint8 sRGB shows, such as `DICT_4X4_50`; None without any.

    Of a family's sizes it is the smallest that has all the numbers that were read.
    """
    grey = _shrink(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), SEARCH_SIDE_PX)

    def read(name: str) -> np.ndarray:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        _, ids, _ = cv2.aruco.ArucoDetector(dictionary, cv2.aruco.DetectorParameters()).detectMarkers(grey)
        return np.unique(ids) if ids is not None else np.empty(0, int)

    counts = {name: len(read(name)) for name in (*(f"{family}_{SIZES[0]}" for family in FAMILIES), *OTHERS)}
    best = max(counts, key=lambda name: counts[name])
    if counts[best] < LEAST_MARKERS:
        return None
    if best in OTHERS:
        return best
    family = best.rpartition("_")[0]
    return f"{family}_{next(size for size in SIZES if read(f'{family}_{SIZES[-1]}').max() < size)}"


def measure_ink(image: np.ndarray, sighting: BoardSighting) -> float:
    """Light of the board's ink as a share of its paper's, 0 to 1, in a picture (h, w, 3) uint8 sRGB."""
    inside = np.zeros(image.shape[:2], np.uint8)
    cv2.fillConvexPoly(inside, cv2.convexHull(sighting.corners_px.astype(np.float32)).round().astype(np.int32), 1)
    light = LINEAR_OF_CODE[cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[inside > 0]]
    dark, bright = np.percentile(light, (15, 85)) if len(light) else (1.0, 1.0)
    return float(dark / max(bright, 1e-6))


def solve_pose(sighting: BoardSighting, lens: Camera) -> PhotoPose | None:
    """The camera of a sighting; None where its corners fit no camera above the table.

    Args:
        sighting: from `find_board`.
        lens: of a picture of the same shape; scaled where its size differs.

    Raises:
        ToolkitError: the lens is of pictures of another shape.
    """
    if (lens.width, lens.height) != (sighting.width, sighting.height):
        lens = scale_lens(lens, sighting.width, sighting.height)
    return fit_plane_pose(sighting.world_mm, sighting.corners_px, lens)


def _versions(grey: np.ndarray) -> Iterator[np.ndarray]:
    """The picture at the sizes and contrasts in which markers are searched, the likeliest first."""
    longer = max(grey.shape)
    first = _shrink(grey, SEARCH_SIDE_PX)
    yield first
    if longer <= SMALL_SIDE_PX:
        yield cv2.resize(grey, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    if longer > SEARCH_SIDE_PX:
        yield _shrink(grey, 2 * SEARCH_SIDE_PX)
    if longer > COARSE_SIDE_PX:
        yield _shrink(grey, COARSE_SIDE_PX)
    yield cv2.createCLAHE(4.0, (8, 8)).apply(cv2.GaussianBlur(first, (0, 0), 1.0))


def _shrink(grey: np.ndarray, side_px: int) -> np.ndarray:
    share = side_px / max(grey.shape)
    return grey if share >= 1 else cv2.resize(grey, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)


class _CharucoFinder:
    """Inner corners of a chessboard, each between two white squares whose markers name it."""

    def __init__(self, board: CharucoBoard) -> None:
        self._board = board
        self.world_mm = board.object_points()
        self._known = frozenset(board.marker_ids)
        self._markers = cv2.aruco.ArucoDetector(get_dictionary(board.dictionary), _detector_parameters())
        self._corners = cv2.aruco.CharucoDetector(board.to_cv(), cv2.aruco.CharucoParameters(), _detector_parameters())

    def find(self, full: np.ndarray, searched: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Corner numbers (n,) and pixels (n, 2) in the full picture, from markers found in the searched one."""
        corners, ids = _find_markers(self._markers, self._known, full, searched)
        if len(ids) == 0:
            return None
        found, numbers, _, _ = self._corners.detectBoard(full, markerCorners=corners, markerIds=ids.reshape(-1, 1))
        named = {}
        if found is not None and len(found):
            named = dict(zip(numbers.reshape(-1).tolist(), found.reshape(-1, 2), strict=True))
        markers = dict(zip(ids.tolist(), corners, strict=True))
        places = grow_corners(full, self._board, named, markers)
        if not places:
            return None
        order = sorted(places)
        return np.array(order), np.array([places[number] for number in order], float) + 0.5


class _RingFinder:
    """Outer corners of markers that lie apart."""

    def __init__(self, ring: Board) -> None:
        self.world_mm = ring.object_points()
        self._places = {marker_id: place for place, marker_id in enumerate(ring.marker_ids)}
        self._markers = cv2.aruco.ArucoDetector(get_dictionary(ring.dictionary), _detector_parameters())

    def find(self, full: np.ndarray, searched: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """As `_CharucoFinder.find`; corner 4 k + i is corner i of the ring's marker k."""
        corners, ids = _find_markers(self._markers, self._places, full, searched)
        if len(ids) == 0:
            return None
        numbers = np.concatenate([4 * self._places[int(marker_id)] + np.arange(4) for marker_id in ids])
        return numbers, np.concatenate([_refine_marker(full, marker) for marker in corners]).astype(float) + 0.5


def _find_markers(
    detector: cv2.aruco.ArucoDetector, known: Container[int], full: np.ndarray, searched: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Corners (4, 2) float32 in the full picture, pixel centres at integers, and numbers of the known markers."""
    corners, ids, _ = detector.detectMarkers(searched)
    if ids is None or len(ids) == 0:
        return [], np.empty(0, np.int32)
    scale = np.array([full.shape[1] / searched.shape[1], full.shape[0] / searched.shape[0]], np.float32)
    numbers = np.asarray(ids, np.int32).reshape(-1)
    mine = [i for i, number in enumerate(numbers) if int(number) in known]
    half = np.float32(0.5)
    return [((corners[i].reshape(4, 2) + half) * scale - half).astype(np.float32) for i in mine], numbers[mine]


def _refine_marker(full: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(4, 2) corners moved to where the picture's gradients meet, in a window of less than a module of the marker."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    window = int(np.clip(MODULES_IN_WINDOW * sides.min() / MARKER_MODULES, 2, 12))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
    refined = cv2.cornerSubPix(full, corners.reshape(4, 1, 2).copy(), (window, window), (-1, -1), stop)
    return refined.reshape(4, 2)


def _detector_parameters() -> cv2.aruco.DetectorParameters:
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = 4 * SMALLEST_MARKER_SHARE
    parameters.adaptiveThreshWinSizeMax = 43  # large squares in a soft picture
    # OpenCV's 7 grey levels are lost on pale ink, which is some 20 darker than paper; 2 and less pass sensor noise on
    parameters.adaptiveThreshConstant = 3
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return parameters
