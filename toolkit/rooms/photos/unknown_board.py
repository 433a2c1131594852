"""Identify the board in photographs: kind, dictionary and layout; only its length is left to measure."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.imaging.read import UnreadableImage
from toolkit.rig.board_file import BoardSpec
from toolkit.rig.markers import DICTIONARIES, get_dictionary
from toolkit.rooms.photos.board_pose import (
    LEAST_MARKERS,
    SEARCH_SIDE_PX,
    detector_parameters,
    find_smallest,
    read_markers,
    shrink,
)
from toolkit.rooms.photos.corners import refine_marker
from toolkit.rooms.photos.photo import list_photos, load_pixels, read_photo
from toolkit.rooms.photos.prints.align import map_points

MOST_PHOTOS = 12
"""Photographs that are read, spread over the folder; every dictionary is tried in the first few."""
FIRST_PHOTOS = 3
LEAST_SHARE = 0.2
"""Share of the photographs with a board in which a marker must be found to count as the board's own."""
NEAR_SIDES = 4.0
"""Marker sides up to which the relative places of two markers are read from the frame of the smaller marker."""
REFINEMENTS = 20
LEAST_AGREE = 0.9
"""Share of the markers whose numbers must follow from their row and column."""
WORST_FIT = 0.2
"""Largest distance of a marker from its row and column, as a share of the step from marker to marker."""
CHESS_SEED = (3, 3)
FAMILIES = tuple(
    name for name in (
        "DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_16h5",
        "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11", "DICT_ARUCO_MIP_36h12",
    ) if name in DICTIONARIES
)  # fmt: skip
Markers = dict[int, np.ndarray]
"""Corners (4, 2) by number, pixels."""


@dataclass(frozen=True)
class FoundBoard:
    """A board up to its scale: `unit` has squares of 1 mm, and `photos` of the photographs that were read show it."""

    unit: BoardSpec
    photos: int
    of: int

    @property
    def name(self) -> str:
        """Such as charuco-7x5."""
        return f"{self.unit.kind}-{self.unit.columns}x{self.unit.rows}"

    @property
    def length_name(self) -> str:
        """The length to measure."""
        if self.unit.kind in ("charuco", "chessboard"):
            return "the side of a square"
        return "the distance from a marker's left edge to the next marker's"

    def describe(self) -> str:
        """Name kind, size and dictionary in a line."""
        unit = self.unit
        what = {"charuco": "ChArUco board", "chessboard": "chessboard"}.get(unit.kind, f"{unit.kind} of markers")
        line = f"{what}, {unit.columns} × {unit.rows}"
        if unit.dictionary:
            line += f", {unit.dictionary} from {unit.first_id or 0}, markers {unit.marker_mm:.3f} of a square"
        if unit.legacy:
            line += ", legacy pattern"
        return f"{line}; seen in {self.photos} of {self.of} photos"

    def measured(self, square_mm: float) -> BoardSpec:
        """The board at its true size.

        Raises:
            ToolkitError: that is no length.
        """
        marker_mm = None if self.unit.marker_mm is None else round(self.unit.marker_mm * square_mm, 2)
        spec = self.unit.model_copy(update={"square_mm": square_mm, "marker_mm": marker_mm})
        spec.make()
        return spec


def identify_board(folder: Path) -> FoundBoard:
    """Tell the board in a folder's photographs; without any, or with an unknown layout, a `ToolkitError`."""
    listed = list_photos(folder).photos
    if not listed:
        raise ToolkitError(f"{folder}: no photographs in it: expected JPEG, HEIC, PNG or DNG files of the board")
    # photographs spread evenly over the folder
    chosen = [listed[i] for i in np.unique(np.linspace(0, len(listed) - 1, MOST_PHOTOS).round().astype(int))]
    pictures = []
    with progress("reading photographs", len(chosen)) as bar:
        # videos and unreadable files are skipped: the others tell the board
        for path in chosen:
            try:
                photo = read_photo(path)
                if photo.kind != "video":
                    pictures.append(shrink(cv2.cvtColor(load_pixels(photo), cv2.COLOR_RGB2GRAY), SEARCH_SIDE_PX))
            except UnreadableImage:
                continue
            finally:
                bar.advance()
    if not pictures:
        raise ToolkitError(f"{folder}: none of its photographs can be read")
    found = tell_board(pictures)
    if found is None:
        raise ToolkitError(
            f"{folder}: no ChArUco board, grid of markers or chessboard found in {len(pictures)} photographs: show the "
            "whole board, lit evenly"
        )
    return found


def tell_board(pictures: Sequence[np.ndarray]) -> FoundBoard | None:
    """Tell the board in (h, w) uint8 pictures, or None; mirrored or unknown layouts of markers raise `ToolkitError`."""
    found = _tell_markers(pictures)
    if found is None and (mirrored := _tell_markers([picture[:, ::-1].copy() for picture in pictures])):
        raise ToolkitError(f"the photographs show a mirrored board ({mirrored.describe()}): print it unmirrored")
    return found or _tell_chessboard(pictures)


def _tell_markers(pictures: Sequence[np.ndarray]) -> FoundBoard | None:
    """The board with markers; None where fewer than `LEAST_MARKERS` are seen in any picture."""
    # all dictionaries in a few pictures tell the family; the rest are read with that dictionary alone
    few = [pictures[i] for i in np.unique(np.linspace(0, len(pictures) - 1, FIRST_PHOTOS).round().astype(int))]
    counted: Counter[str] = Counter()
    with progress("telling the board", len(few) + len(pictures)) as bar:
        for picture in few:
            read = read_markers(picture, FAMILIES, _strict_parameters(picture))
            counted.update({family: len(numbers) for family, numbers in zip(FAMILIES, read, strict=True)})
            bar.advance()
        # markers of a dictionary are seldom read in another: the dictionary with most markers is meant
        family = max(FAMILIES, key=counted.__getitem__)
        views = []
        for picture in pictures if counted[family] >= LEAST_MARKERS else ():
            views.append(_read(picture, family))
            bar.advance(note=family)
    views = [seen for seen in views if len(seen) >= LEAST_MARKERS]
    if not views:
        return None
    counts = Counter(number for seen in views for number in seen)
    # a misreading comes once, a board's own marker in most photographs
    own = {number for number, count in counts.items() if count >= LEAST_SHARE * len(views)}
    views = [{number: seen[number] for number in seen if number in own} for seen in views]
    views = [seen for seen in views if len(seen) >= LEAST_MARKERS]
    return FoundBoard(_tell_layout(family, _place(views)), len(views), len(pictures)) if views else None


def _strict_parameters(picture: np.ndarray) -> cv2.aruco.DetectorParameters:
    parameters = detector_parameters(max(picture.shape))
    parameters.errorCorrectionRate = 0.3  # a full dictionary is read into another's markers otherwise
    return parameters


def _read(picture: np.ndarray, family: str) -> Markers:
    """Markers of a dictionary that are in a picture once."""
    dictionary = get_dictionary(family)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, _strict_parameters(picture)).detectMarkers(picture)
    if ids is None:
        return {}
    counts = Counter(ids.ravel().tolist())
    return {
        number: refine_marker(picture, corner.reshape(4, 2), dictionary.markerSize + 2)
        for number, corner in zip(ids.ravel().tolist(), corners, strict=True)
        if counts[number] == 1
    }


UNIT = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def _place(views: Sequence[Markers]) -> dict[int, np.ndarray]:
    """Middle (2,) of each marker on the board, in marker sides, right and down from an arbitrary marker.

    A marker's own corners span a frame for its neighbours; least squares then place all markers roughly. After that,
    the photographs' homographies and the places are fitted in turn.
    """
    # steps between neighbouring markers, in sides of a marker, from every photograph
    steps: dict[tuple[int, int], list[np.ndarray]] = {}
    for seen in views:
        frames = {
            number: cv2.getPerspectiveTransform(c.astype(np.float32), UNIT.astype(np.float32))
            for number, c in seen.items()
        }
        middles = {number: c.mean(axis=0) for number, c in seen.items()}
        for a, b in ((a, b) for a in seen for b in seen if a < b):
            there, back = map_points(frames[a], middles[b][None])[0], map_points(frames[b], middles[a][None])[0]
            if max(np.linalg.norm(there), np.linalg.norm(back)) < NEAR_SIDES:
                steps.setdefault((a, b), []).append((there - back) / 2)  # perspective cancels to first order
    # markers that lie beside others; a marker far away cannot be placed
    numbers = sorted({number for pair in steps for number in pair})
    if not numbers:
        raise ToolkitError("markers are seen, but no two side by side: expected a board whose markers lie side by side")
    # least squares: an equation for each pair of neighbours
    index = {number: i for i, number in enumerate(numbers)}
    rows = np.zeros((len(steps) + 1, len(numbers)))
    values = np.zeros((len(steps) + 1, 2))
    for row, ((a, b), found) in enumerate(steps.items()):
        step = np.median(found, axis=0)
        # a far neighbour's place is less sure: perspective within a marker's frame grows with distance
        weight = 1 / np.linalg.norm(step) ** 2
        rows[row, index[b]], rows[row, index[a]] = weight, -weight
        values[row] = weight * step
    # the first marker is fixed at the origin: differences alone leave the place of all free
    rows[-1, 0] = 1
    places = np.linalg.lstsq(rows, values, rcond=None)[0]
    # exact places: photographs to board, board from photographs, in turn
    for _ in range(REFINEMENTS):
        told: dict[int, list[np.ndarray]] = {}
        sides: list[float] = []
        for seen in views:
            known = [number for number in seen if number in index]
            if len(known) < 2:
                continue
            board = np.concatenate([places[index[number]] + UNIT for number in known])
            to_board, _ = cv2.findHomography(np.concatenate([seen[number] for number in known]), board)
            if to_board is not None:
                for number in known:
                    corners = map_points(to_board, seen[number])
                    told.setdefault(number, []).append(corners.mean(axis=0))
                    sides.append(float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean()))
        for number, found in told.items():
            # the median over photographs: a bad homography moves nothing
            places[index[number]] = np.median(found, axis=0)
        places /= np.median(sides)  # the marker's side stays the unit
    return {number: places[index[number]] for number in numbers}


def _tell_layout(family: str, places: dict[int, np.ndarray]) -> BoardSpec:
    """The grid or the ChArUco board whose markers lie so; a `ToolkitError` without rows and columns."""
    numbers = np.array(sorted(places))
    at = np.array([places[number] for number in numbers])
    away = np.linalg.norm(at[:, None] - at[None], axis=2) + np.where(np.eye(len(at)), np.inf, 0)
    near, mates = away.min(axis=1), away.argmin(axis=1)
    slanted = np.abs(at[mates] - at).min(axis=1) > 0.3 * near  # a ChArUco board's nearest markers lie diagonally
    is_charuco = bool(np.mean(slanted) > 0.5)
    step = float(np.median(near)) / (np.sqrt(2) if is_charuco else 1.0)
    # nearest neighbours give the step roughly; all markers, the farthest most, give it exactly
    for _ in range(3):
        cells = np.round((at - at[0]) / step)
        # least squares through the origin: the slope of places over cells
        step = float(((at - at[0]) * cells).sum() / (cells**2).sum())
    cells = np.round((at - at[0]) / step)
    # the shift of the grid, since the first marker may be a little off
    shift = np.median((at - at[0]) / step - cells, axis=0)
    off = np.abs((at - at[0]) / step - cells - shift).max(axis=1)
    # columns and rows from 0
    columns_at, rows_at = (cells - cells.min(axis=0)).astype(int).T
    spec = _fit_numbers(family, numbers, columns_at, rows_at, is_charuco, marker_share=1 / step)
    if spec is None or np.mean(off < WORST_FIT) < LEAST_AGREE:
        raise ToolkitError(
            f"{len(numbers)} markers of {family} are seen, but not in the order of a ChArUco board or a grid: print a "
            "board with 'toolkit print --board'"
        )
    return spec


def _fit_numbers(
    family: str, numbers: np.ndarray, column: np.ndarray, row: np.ndarray, is_charuco: bool, *, marker_share: float
) -> BoardSpec | None:
    """The spec whose markers' numbers are those that lie at these columns and rows; None where there is none."""
    columns, rows = int(column.max()) + 1, int(row.max()) + 1
    best: tuple[float, BoardSpec] | None = None
    for starts_white in (False, True) if is_charuco else (False,):
        squares = [(r, c) for r in range(rows) for c in range(columns)]
        if is_charuco:
            squares = [(r, c) for r, c in squares if (r + c) % 2 == int(not starts_white)]
        # numbers rise along the rows: each marker's number less its place is the board's first number
        place = {square: i for i, square in enumerate(squares)}
        order = [place.get((int(r), int(c))) for r, c in zip(row, column, strict=True)]
        firsts = Counter(int(number) - i for number, i in zip(numbers, order, strict=True) if i is not None)
        if not firsts:
            continue
        first, agree = firsts.most_common(1)[0]
        # OpenCV's legacy pattern differs only where the count of rows is even
        if first < 0 or (starts_white and rows % 2):
            continue
        # dictionaries of one family share their first markers: the smallest that has all numbers
        dictionary = find_smallest(family, first + len(squares)) or None
        kind = "charuco" if is_charuco else "apriltag-grid" if "APRILTAG" in family else "aruco-grid"
        spec = BoardSpec(
            kind=kind, columns=columns, rows=rows, square_mm=1.0, marker_mm=round(marker_share, 4),
            dictionary=dictionary, first_id=first, legacy=True if starts_white else None,
        )  # fmt: skip
        if dictionary and agree >= LEAST_AGREE * len(numbers) and (best is None or agree > best[0]):
            best = agree, spec
    return best[1] if best else None


def _tell_chessboard(pictures: Sequence[np.ndarray]) -> FoundBoard | None:
    """A board without markers, whose size most pictures agree on."""
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
    sizes: Counter[tuple[int, int]] = Counter()
    with progress("looking for a chessboard", len(pictures)) as bar:
        for picture in pictures:
            found, _, meta = cv2.findChessboardCornersSBWithMeta(picture, CHESS_SEED, flags)
            if found:
                high, wide = meta.shape[:2]
                sizes[(max(wide, high), min(wide, high))] += 1
            bar.advance()
    if not sizes:
        return None
    # most pictures' size: a partly hidden board is found smaller
    (columns, rows), count = sizes.most_common(1)[0]
    # a square's side is not known yet; counts are of squares, corners are one fewer
    unit = BoardSpec(kind="chessboard", columns=columns + 1, rows=rows + 1, square_mm=1.0)
    return FoundBoard(unit, count, len(pictures))
