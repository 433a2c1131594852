"""Find the printed board or ring under the object in a photograph, and the camera's pose from it."""

from collections import Counter
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.rig.board import Board, CharucoBoard, Chessboard
from toolkit.rig.camera import Camera
from toolkit.rig.markers import DICTIONARIES, get_dictionary
from toolkit.rooms.photos.corners import STOP, grow_corners, refine_marker
from toolkit.rooms.photos.lens import scale_lens
from toolkit.rooms.photos.posed_camera import PhotoPose, fit_plane_pose

SEARCH_SIDE_PX = 1600
"""Longer side of the picture in which markers are first searched; the full picture then refines their corners."""
COARSE_SIDE_PX = 800
LEAST_OTHERS = 4
SMALL_SIDE_PX = 1000
"""Pictures up to this size are also searched enlarged: a module of 2 px is too small for the detector's threshold."""
ENOUGH_CORNERS = 24
ENOUGH_SHARE = 0.4
"""With so many corners, or this share of the board's, no further search is made in other sizes of the picture."""
LEAST_CORNERS = 6
# all of OpenCV's helps: an exhaustive search, contrast evened first, corners to a part of a pixel
CHESS_FLAGS = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
CHESS_REACH = 0.35
"""Radius of the window that refines a corner, as a share of a square's shortest side."""
SMALLEST_MARKER_SHARE = 0.006
SMALLEST_MARKER_PX = 6
"""Side of the smallest marker that counts: a share of the picture's longer side, and at least so many pixels. A marker
has six modules or more, and noise in a small picture is full of smaller squares."""
TWICE_SHARE = 0.2
"""Largest share of the read markers that may be there twice; above it, the picture shows two boards."""


@dataclass(frozen=True)
class BoardSighting:
    """Corners of a board that were found in a picture.

    Attributes:
        ids: (n,) number of each corner on its board.
        corners_px: (n, 2) in the picture.
        world_mm: (n, 3) in the world, z = 0.
        width, height: of the picture, pixels.
    """

    ids: np.ndarray
    corners_px: np.ndarray
    world_mm: np.ndarray
    width: int
    height: int

    def pixels(self, image: np.ndarray) -> np.ndarray:
        """(n, …) pixels of a picture (height, width, …) within the outermost corners."""
        inside = np.zeros((self.height, self.width), np.uint8)
        cv2.fillConvexPoly(inside, cv2.convexHull(self.corners_px.astype(np.float32)).round().astype(np.int32), 1)
        return image[inside > 0]

    def keep(self, mask: np.ndarray) -> "BoardSighting":
        """The same with some of its corners: (n,) bool."""
        return replace(self, ids=self.ids[mask], corners_px=self.corners_px[mask], world_mm=self.world_mm[mask])


def find_board(image: np.ndarray, board: Board) -> BoardSighting | None:
    """Find a board's corners, to a fraction of a pixel, however much of it the object covers.

    Large photographs are searched at a reduced size first. If little is found, a larger size follows, a coarser size
    (against blur), and evened-out contrast (against uneven light and over-exposure).

    Args:
        image: (h, w, 3) uint8 sRGB, upright.
        board: to look for; the user's is `toolkit.rig.board_file.read_board`.

    Returns:
        None with fewer than `LEAST_CORNERS` corners, or if the picture shows the board twice.
    """
    # colour carries nothing: a board is black on white
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    finder = _make_finder(board)
    # enough for a sure pose; a small board has fewer corners in all
    enough = min(ENOUGH_CORNERS, ENOUGH_SHARE * len(finder.world_mm))
    best: tuple[np.ndarray, np.ndarray] | None = None
    # the likeliest version of the picture first; the search ends once enough of the board shows
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


FAMILIES = ("DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000")
OTHERS = ("DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h11")
"""Without `DICT_APRILTAG_16h5`, which is seen in any texture."""
LEAST_MARKERS = 4
"""Different markers of a dictionary that must be read before it counts as seen; any clutter yields fewer."""


def find_dictionary(image: np.ndarray) -> str | None:
    """Return the smallest dictionary of the markers in a picture (h, w, 3) uint8 sRGB, such as `DICT_4X4_50`."""
    grey = shrink(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), SEARCH_SIDE_PX)
    # nearly every board begins with the first markers of its family
    first = [*(find_smallest(family, 1) for family in FAMILIES), *OTHERS]
    counts = {name: len(numbers) for name, numbers in zip(first, read_markers(grey, first), strict=True)}
    best = max(counts, key=lambda name: counts[name])
    if counts[best] < LEAST_MARKERS:
        return None
    if best in OTHERS:
        return best
    family = FAMILIES[first.index(best)]
    return find_smallest(family, 1 + max(read_markers(grey, [family])[0]))


def find_smallest(family: str, count: int) -> str:
    """The smallest dictionary of a family with so many markers, or none; larger ones begin with the smaller."""
    stem = family.removesuffix("1000")
    fit = [name for name, known in DICTIONARIES.items() if name.startswith(stem) and known >= count]
    return min(fit, key=DICTIONARIES.__getitem__, default="")


def read_markers(
    grey: np.ndarray, names: Sequence[str], parameters: cv2.aruco.DetectorParameters | None = None
) -> list[set[int]]:
    """Return the numbers of the markers of each dictionary; the picture is searched once for all of them."""
    dictionaries = [cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)) for name in names]
    # markers of a few pixels are noise; OpenCV states its limit as a share of the picture's larger side
    if parameters is None:
        parameters = cv2.aruco.DetectorParameters()
        least = 4 * SMALLEST_MARKER_PX / max(grey.shape)
        parameters.minMarkerPerimeterRate = max(parameters.minMarkerPerimeterRate, least)
    _, ids, _, of = cv2.aruco.ArucoDetector(dictionaries, parameters).detectMarkersMultiDict(grey)
    read: list[set[int]] = [set() for _ in names]
    # the picture is searched once, and each marker comes with the dictionary that it belongs to
    for number, k in zip(*(np.ravel(array) for array in (ids, of)), strict=True) if ids is not None else ():
        read[int(k)].add(int(number))
    return read


def measure_ink(image: np.ndarray, sighting: BoardSighting) -> float:
    """Light of the board's ink as a share of its paper's, 0 to 1, in a picture (h, w, 3) uint8 sRGB.

    Ink and paper meet at every corner; the median over the visible corners ignores shadows and glare.
    """
    light = LINEAR_OF_CODE[cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)]
    # a part of the distance to the next corner, so that both ink and paper lie within
    apart = np.linalg.norm(sighting.corners_px[:, None] - sighting.corners_px, axis=-1)
    reach = max(2, int(CHESS_REACH * np.median(np.sort(apart, axis=1)[:, 1])))
    # the darker and the brighter tenth around each corner: ink and paper
    shares = []
    for x, y in sighting.corners_px.round().astype(int):
        dark, bright = np.percentile(
            light[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1], (10, 90)
        )
        shares.append(dark / max(bright, 1e-6))
    return float(np.median(shares))


def explain_absence(image: np.ndarray, board: Board) -> str:
    """Return why `find_board` finds no board: twice there, mirrored, or another board; else "no board is seen"."""
    # common slips are tested first, each by a search of its own
    grey = shrink(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), SEARCH_SIDE_PX)
    finder = _make_finder(board)
    if finder.sees_two(grey):
        return "the board is seen twice: keep a single board in the picture"
    # a marker in a mirror is no marker, so the picture is mirrored back
    mirrored = finder.find(grey[:, ::-1].copy(), grey[:, ::-1].copy()) if board.marker_ids else None
    if mirrored is not None and len(mirrored[0]) >= LEAST_CORNERS:
        return "the board is seen mirrored: print it unmirrored, or switch off the front camera's mirror"
    there = find_dictionary(image)
    if there is not None and there.rpartition("_")[0] != board.dictionary.rpartition("_")[0]:
        return f"no board is seen, but markers of {there}: this board has {board.dictionary or 'no markers'}"
    others = finder.list_others(grey)
    if len(others) >= LEAST_OTHERS:
        shown = ", ".join(map(str, others[:3]))
        return f"no board is seen, but markers {shown}… of {board.dictionary} that are not on it: is it another board?"
    return "no board is seen"


def solve_pose(sighting: BoardSighting, lens: Camera) -> PhotoPose | None:
    """Return the camera of a sighting; None if its corners fit no camera above the table.

    `lens` is for pictures of the same shape, and scaled if their size differs.

    Raises:
        ToolkitError: the lens is of pictures of another shape.
    """
    if (lens.width, lens.height) != (sighting.width, sighting.height):
        lens = scale_lens(lens, sighting.width, sighting.height)
    return fit_plane_pose(sighting.world_mm, sighting.corners_px, lens)


def _versions(grey: np.ndarray) -> Iterator[np.ndarray]:
    """The picture at the sizes and contrasts in which markers are searched, the likeliest first."""
    longer = max(grey.shape)
    first = shrink(grey, SEARCH_SIDE_PX)
    yield first
    # markers of a few pixels are found in a larger picture
    if longer <= SMALL_SIDE_PX:
        yield cv2.resize(grey, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    if longer > SEARCH_SIDE_PX:
        yield shrink(grey, 2 * SEARCH_SIDE_PX)
    if longer > COARSE_SIDE_PX:
        yield shrink(grey, COARSE_SIDE_PX)
    # blurred before its contrast is raised, which would raise the noise as well
    yield cv2.createCLAHE(4.0, (8, 8)).apply(cv2.GaussianBlur(first, (0, 0), 1.0))


def shrink(grey: np.ndarray, side_px: int) -> np.ndarray:
    """(h, w) uint8 whose longer side is so many pixels at most, and whose shorter side has at least a pixel."""
    share = side_px / max(grey.shape)
    if share >= 1:
        return grey
    if min(grey.shape) * share < 1:  # a line
        size = (1, side_px) if grey.shape[0] > grey.shape[1] else (side_px, 1)
        return cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return cv2.resize(grey, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)


class _MarkerFinder:
    """Outer corners of markers that lie apart."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self.world_mm = board.object_points()
        self._places = {marker_id: place for place, marker_id in enumerate(board.marker_ids)}
        dictionary = get_dictionary(board.dictionary)
        # the black border adds a module on each side of the `markerSize` modules that hold bits
        self._modules = dictionary.markerSize + 2
        self._markers = cv2.aruco.ArucoDetector(dictionary, detector_parameters())

    def find(self, full: np.ndarray, searched: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Corner numbers (n,) and pixels (n, 2) in the full picture, from markers found in the searched picture.

        Corner 4 k + i is corner i of the board's marker k.
        """
        markers = self._read(full, searched)
        if not markers:
            return None
        numbers = np.concatenate([4 * self._places[marker_id] + np.arange(4) for marker_id in markers])
        # OpenCV puts pixel centres at integers, the kit's cameras at halves
        return numbers, np.concatenate(list(markers.values())) + 0.5

    def sees_two(self, grey: np.ndarray) -> bool:
        """Whether many of the board's markers are in the picture twice."""
        return _are_two(_find_markers(self._markers, self._places, grey, grey)[1])

    def list_others(self, grey: np.ndarray) -> list[int]:
        """Numbers of the markers of its dictionary that are seen and not on it."""
        ids = _detect(self._markers, grey)[1]
        return sorted({int(number) for number in ids.ravel()} - set(self._places)) if ids is not None else []

    def _read(self, full: np.ndarray, searched: np.ndarray) -> dict[int, np.ndarray]:
        """Corners (4, 2) of the board's markers by number; none where the board is there twice."""
        corners, ids = _find_markers(self._markers, self._places, full, searched)
        if _are_two(ids):
            return {}
        counts = Counter(ids.tolist())
        return {
            int(marker_id): refine_marker(full, marker, self._modules)
            for marker_id, marker in zip(ids, corners, strict=True)
            if counts[int(marker_id)] == 1  # a marker that is there twice is ambiguous
        }


class _CharucoFinder(_MarkerFinder):
    """Inner corners of a chessboard, each between two white squares whose markers name it."""

    def __init__(self, board: CharucoBoard) -> None:
        super().__init__(board)
        self._squares = board
        self._corners = cv2.aruco.CharucoDetector(board.to_cv(), cv2.aruco.CharucoParameters(), detector_parameters())

    def find(self, full: np.ndarray, searched: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """As `_MarkerFinder.find`; corners are numbered from the upper left, row by row."""
        markers = self._read(full, searched)
        if not markers:
            return None
        # markers that were found already: OpenCV only adds the chess corners between them
        corners = [marker.astype(np.float32) for marker in markers.values()]
        ids = np.array(list(markers), np.int32).reshape(-1, 1)
        found, numbers, _, _ = self._corners.detectBoard(full, markerCorners=corners, markerIds=ids)
        named = {}
        if found is not None and len(found):
            named = dict(zip(numbers.reshape(-1).tolist(), found.reshape(-1, 2), strict=True))
        # markers and corners found so far predict where the others are
        places = grow_corners(full, self._squares, named, markers)
        if not places:
            return None
        order = sorted(places)
        # half a pixel: OpenCV counts from the middle of the first pixel, we from its corner
        return np.array(order), np.array([places[number] for number in order], float) + 0.5


class _ChessFinder:
    """Inner corners of a chessboard without markers, all of them or none."""

    def __init__(self, board: Chessboard) -> None:
        self._board = board
        self.world_mm = board.object_points()

    def find(self, full: np.ndarray, searched: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """As `_CharucoFinder.find`."""
        grid = self._find_grid(searched)
        if grid is None or self._find_grid(_blank(searched, grid)) is not None:
            return None
        scale = np.array([full.shape[1] / searched.shape[1], full.shape[0] / searched.shape[0]])
        # by halves to edges and back: pixel centres of two sizes do not meet at integers
        places = (grid + 0.5) * scale - 0.5
        steps = [np.linalg.norm(np.diff(places, axis=axis), axis=2).min() for axis in (0, 1)]
        # a wider window would reach the next corner, a smaller window sees nothing but the blur of this corner
        reach = int(np.clip(CHESS_REACH * min(steps), 2, 10))
        start = np.ascontiguousarray(places.reshape(-1, 1, 2), np.float32)
        places = cv2.cornerSubPix(full, start, (reach, reach), (-1, -1), STOP).reshape(grid.shape).astype(float)
        places = self._orient(full, places)
        return np.arange(self._board.corner_count), places.reshape(-1, 2) + 0.5

    def sees_two(self, grey: np.ndarray) -> bool:
        """Whether a second board is left when the first is painted over."""
        grid = self._find_grid(grey)
        return grid is not None and self._find_grid(_blank(grey, grid)) is not None

    def list_others(self, grey: np.ndarray) -> list[int]:
        """It has no markers."""
        return []

    def _find_grid(self, grey: np.ndarray) -> np.ndarray | None:
        """(rows, columns, 2) corners as OpenCV orders them."""
        size = (self._board.columns - 1, self._board.rows - 1)
        found, corners = cv2.findChessboardCornersSB(grey, size, flags=CHESS_FLAGS)
        return corners.reshape(size[1], size[0], 2).astype(float) if found else None

    def _orient(self, grey: np.ndarray, grid: np.ndarray) -> np.ndarray:
        """The same corners from the board's upper left corner, which is known by the black square beyond it."""
        right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if right[0] * down[1] - right[1] * down[0] < 0:  # a board is never seen from behind
            grid = grid[:, ::-1]
        turned = grid[::-1, ::-1]
        if self._board.looks_the_same_turned:
            # either reading is right: the reading whose first corner lies upper left is at least always the same
            return grid if grid[0, 0].sum() <= turned[0, 0].sum() else turned
        return grid if _starts_black(grey, grid) else turned


def _blank(grey: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """The picture with a board painted over in its own mean."""
    hull = cv2.convexHull(grid.reshape(-1, 2).astype(np.float32)).round().astype(np.int32)
    return cv2.fillConvexPoly(grey.copy(), hull, float(grey[tuple(hull[:, 0, ::-1].mean(axis=0).astype(int))]))


def _starts_black(grey: np.ndarray, grid: np.ndarray) -> bool:
    """Whether the squares on the diagonal of the first inner corner, which are like the upper left square, are dark."""
    at = ((grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4).astype(np.float32)
    light = cv2.remap(grey, at[..., 0].copy(), at[..., 1].copy(), cv2.INTER_LINEAR).astype(float)
    rows, columns = np.indices(light.shape)
    like_first = (rows + columns) % 2 == 0
    return bool(light[like_first].mean() < light[~like_first].mean())


def _make_finder(board: Board) -> _MarkerFinder | _ChessFinder:
    if isinstance(board, CharucoBoard):
        return _CharucoFinder(board)
    return _ChessFinder(board) if isinstance(board, Chessboard) else _MarkerFinder(board)


def _are_two(ids: np.ndarray) -> bool:
    """Whether so many markers are there twice that there must be two boards."""
    twice = sum(count > 1 for count in Counter(ids.tolist()).values())
    # a single marker twice may be a misreading of texture; a share of them all twice is a board
    return twice > 1 and twice > TWICE_SHARE * len(set(ids.tolist()))


def _find_markers(
    detector: cv2.aruco.ArucoDetector, known: Container[int], full: np.ndarray, searched: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Corners (4, 2) float32 in the full picture, pixel centres at integers, and numbers of the known markers."""
    corners, ids = _detect(detector, searched)
    if ids is None or len(ids) == 0:
        return [], np.empty(0, np.int32)
    scale = np.array([full.shape[1] / searched.shape[1], full.shape[0] / searched.shape[0]], np.float32)
    numbers = np.asarray(ids, np.int32).reshape(-1)
    mine = [i for i, number in enumerate(numbers) if int(number) in known]
    # the edges of a picture scale, and OpenCV counts from the centre of the first pixel
    half = np.float32(0.5)
    return [((corners[i].reshape(4, 2) + half) * scale - half).astype(np.float32) for i in mine], numbers[mine]


def _detect(detector: cv2.aruco.ArucoDetector, grey: np.ndarray) -> tuple[Sequence[np.ndarray], np.ndarray | None]:
    """OpenCV's corners and numbers of markers, none of them smaller than a marker can be."""
    detector.setDetectorParameters(detector_parameters(max(grey.shape)))
    return detector.detectMarkers(grey)[:2]


def detector_parameters(side_px: int = SEARCH_SIDE_PX) -> cv2.aruco.DetectorParameters:
    """How markers are looked for in a picture whose longer side is so many pixels."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = 4 * max(SMALLEST_MARKER_SHARE, SMALLEST_MARKER_PX / side_px)
    parameters.adaptiveThreshWinSizeMax = 43  # large squares in a soft picture
    # OpenCV's 7 grey levels are lost on pale ink, which is some 20 darker than paper; 2 and less pass sensor noise on
    parameters.adaptiveThreshConstant = 3
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return parameters
