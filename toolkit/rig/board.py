"""Sheets from which a photograph's camera is found: ChArUco boards, grids of markers, chessboards."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from pydantic import ConfigDict

from toolkit.core.errors import ToolkitError
from toolkit.rig.markers import (
    DICTIONARY,
    PALE_PERCENT,
    RING_FIRST_ID,
    add_rects,
    add_turned,
    black_rects,
    count_markers,
    get_dictionary,
    ink_to_picture,
    marker_modules,
    require_ids,
    require_ink,
    require_mm,
    sheet_to_world,
)

MARKER_SHARE = 0.75
"""Share of a square's side that a marker takes: the white around it is then wider than a module."""
FEWEST_SQUARES = 3
MOST_SQUARES = 200


class Board(ABC):
    """A sheet whose markers or squares tell a photograph's camera; our own, and those that others printed.

    Sheet positions (2,) are millimetres to the right and down from the upper left corner as printed. In the world the
    sheet's middle is the origin, down the sheet is +x and to its right +y.

    Attributes:
        marker_mm: side of a marker, its black border included; 0 where there are none.
        dictionary: OpenCV's name of it; empty if there are no markers.
        ink_percent: how dark it is printed, 100 is black.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)  # where a file is read
    marker_mm: float
    dictionary: str
    ink_percent: float

    @property
    @abstractmethod
    def marker_ids(self) -> tuple[int, ...]:
        """Numbers of the markers, in the order of `place_markers`."""

    @property
    @abstractmethod
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the sheet."""

    @abstractmethod
    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """Per marker its number, its middle (2,) on the sheet, and how far it is turned, radians counter-clockwise."""

    @abstractmethod
    def object_points(self, ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(k, 3) world positions of what is found in a photograph, all by default: what `cv2.solvePnP` asks for."""

    @abstractmethod
    def draw(self, px_per_mm: float) -> np.ndarray:
        """(h, w) float share of each pixel that is inked; rows down the page."""

    @abstractmethod
    def describe(self) -> str:
        """A line: what it is made of."""

    @property
    def looks_the_same_turned(self) -> bool:
        """Whether it looks the same turned by 180°, so that two opposite cameras are possible."""
        return False

    def sheet_corners(self, marker_ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(k, 4, 2) corners of markers on the sheet, in OpenCV's order: upper left, upper right, lower right, left."""
        half = self.marker_mm / 2
        square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        corners = {}
        for marker_id, middle, turn in self.place_markers():
            right, down = (math.cos(turn), -math.sin(turn)), (math.sin(turn), math.cos(turn))
            corners[marker_id] = middle + square @ np.array([right, down])
        wanted = self.marker_ids if marker_ids is None else marker_ids
        return np.array([corners[int(marker_id)] for marker_id in wanted]).reshape(-1, 4, 2)

    def marker_points(self, marker_ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(k, 4, 3) world positions of the corners of markers (all by default), in OpenCV's order."""
        return sheet_to_world(self.sheet_corners(marker_ids), self.size_mm)

    def paint(self, px_per_mm: float) -> np.ndarray:
        """(h, w) uint8 sRGB grey picture of the printed sheet, rows down the page."""
        return ink_to_picture(self.draw(px_per_mm), self.ink_percent)


class SquareBoard(Board):
    """A chessboard, with or without markers in its white squares; `columns` × `rows` squares of `square_mm`."""

    columns: int
    rows: int
    square_mm: float

    @property
    def starts_white(self) -> bool:
        """Whether the upper left square is white."""
        return False

    def is_black(self, row: int, column: int) -> bool:
        """Whether a square is black; (0, 0) is the upper left square."""
        return (row + column) % 2 == int(self.starts_white)

    def list_squares(self, black: bool) -> list[tuple[int, int]]:
        """(row, column) of the black or of the white squares, row by row."""
        return [(r, c) for r in range(self.rows) for c in range(self.columns) if self.is_black(r, c) == black]

    @property
    def corner_count(self) -> int:
        """Inner corners, numbered from the upper left, row by row."""
        return (self.columns - 1) * (self.rows - 1)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height on the page; the printed sheet has white paper round that."""
        return self.columns * self.square_mm, self.rows * self.square_mm

    def black_squares(self) -> np.ndarray:
        """(k, 4) left, top, right, bottom of the black squares on the sheet, millimetres."""
        return np.array([(c, r, c + 1, r + 1) for r, c in self.list_squares(black=True)]) * self.square_mm

    def object_points(self, ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(k, 3) world positions of inner corners, all by default."""
        numbers = np.arange(self.corner_count) if ids is None else np.asarray(ids, int).ravel()
        rows, columns = np.divmod(numbers, self.columns - 1)
        return sheet_to_world(np.stack([columns + 1, rows + 1], axis=1) * self.square_mm, self.size_mm)

    def draw(self, px_per_mm: float) -> np.ndarray:
        """(h, w) float share of each pixel that is inked, of exactly `size_mm`; edges are shared between pixels."""
        width, height = (round(side * px_per_mm) for side in self.size_mm)
        scale = np.array([width / self.size_mm[0], height / self.size_mm[1]] * 2)
        ink = np.zeros((height, width))
        add_rects(ink, self.black_squares() * scale)
        for marker_id, middle, _ in self.place_markers():
            rects = black_rects(marker_modules(self.dictionary, marker_id)) * self.marker_mm
            add_rects(ink, (rects + np.tile(middle - self.marker_mm / 2, 2)) * scale)
        return ink

    def _check_squares(self) -> None:
        require_ink("board", self.ink_percent)
        _check_counts(self.columns, self.rows, FEWEST_SQUARES, "squares")
        require_mm("board: square_mm", self.square_mm)


def _check_counts(columns: int, rows: int, fewest: int, what: str) -> None:
    for name, count in (("columns", columns), ("rows", rows)):
        if not fewest <= count <= MOST_SQUARES:
            raise ToolkitError(f"board: {name}: expected {fewest} to {MOST_SQUARES} {what}, found {count}")


@dataclass(frozen=True)
class CharucoBoard(SquareBoard):
    """A ChArUco board as OpenCV has them; checked when it is made.

    Raises:
        ToolkitError: the marker does not fit its square with white round it, or the dictionary has too few.
    """

    columns: int  # columns, rows: squares across and down the page
    rows: int
    square_mm: float  # side of a square
    marker_mm: float  # side of a marker, its black border included
    dictionary: str = DICTIONARY  # OpenCV's name of it
    ink_percent: float = 100.0  # how dark squares and markers are, 100 is black
    first_id: int = 0  # number of the first marker
    # whether it is of the pattern before OpenCV 4.6, whose upper left square is white where `rows` is even
    legacy: bool = False

    def __post_init__(self) -> None:
        self._check_squares()
        require_mm("board: marker_mm", self.marker_mm)
        if self.marker_mm > 0.9 * self.square_mm:
            raise ToolkitError(
                f"board: a marker of {self.marker_mm:g} mm in a square of {self.square_mm:g} mm: expected at most "
                f"{0.9 * self.square_mm:g} mm, so that white paper is left round it; {MARKER_SHARE * self.square_mm:g} "
                "mm is good"
            )
        # numbers from here on are the rings': a photograph must tell a board's markers from a ring's
        known = count_markers(self.dictionary)
        most = min(known, RING_FIRST_ID) if self.dictionary == DICTIONARY else known
        # a board that starts elsewhere is checked against the dictionary alone, with its numbers, below
        if self.first_id == 0 and self.marker_count > most:
            raise ToolkitError(
                f"board: {self.columns}x{self.rows} squares need {self.marker_count} different markers, "
                f"{self.dictionary} has {most}: choose fewer, larger squares"
            )
        require_ids("board", self.dictionary, self.first_id, self.marker_count)

    @property
    def starts_white(self) -> bool:
        """Whether the upper left square is white, as in some legacy boards."""
        return self.legacy and self.rows % 2 == 0

    @property
    def marker_count(self) -> int:
        """A marker in every white square."""
        # rounded down: an odd number of squares has a black square more
        return self.columns * self.rows // 2

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """Numbers of the markers, from the upper left, row by row."""
        return tuple(range(self.first_id, self.first_id + self.marker_count))

    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """As `Board` has it; none is turned."""
        return [
            (self.first_id + number, (np.array([column, row]) + 0.5) * self.square_mm, 0.0)
            for number, (row, column) in enumerate(self.list_squares(black=False))
        ]

    def to_cv(self) -> "cv2.aruco.CharucoBoard":
        """OpenCV's board; its points are sheet positions with z = 0."""
        made = cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square_mm, self.marker_mm, get_dictionary(self.dictionary),
            np.array(self.marker_ids),
        )  # fmt: skip
        made.setLegacyPattern(self.legacy)
        return made

    def describe(self) -> str:
        """A line: what it is made of."""
        return (
            f"ChArUco board of {self.columns} × {self.rows} squares, {self.square_mm:g} mm, markers "
            f"{self.marker_mm:g} mm, {self.dictionary} {self.marker_ids[0]}-{self.marker_ids[-1]}, "
            f"{self.ink_percent:g} % ink{', legacy pattern' if self.legacy else ''}"
        )


@dataclass(frozen=True)
class Chessboard(SquareBoard):
    """A plain chessboard; checked when it is made.

    Raises:
        ToolkitError: too few squares, or sizes that cannot be.
    """

    # columns, rows: squares across and down the page: OpenCV counts inner corners, which are 1 fewer
    columns: int
    rows: int
    square_mm: float  # side of a square
    ink_percent: float = 100.0  # how dark the black squares are, 100 is black
    marker_mm = 0.0
    dictionary = ""

    def __post_init__(self) -> None:
        self._check_squares()
        if min(self.columns, self.rows) == FEWEST_SQUARES:  # OpenCV's finder wants three corners each way
            raise ToolkitError(
                f"board: a chessboard of {self.columns}x{self.rows} squares: expected at least {FEWEST_SQUARES + 1} "
                "each way"
            )

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """None."""
        return ()

    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """None."""
        return []

    @property
    def looks_the_same_turned(self) -> bool:
        """Turned by 180°, the upper left square is where the lower right square was."""
        return (self.columns + self.rows) % 2 == 0

    def describe(self) -> str:
        """A line: what it is made of."""
        return f"chessboard of {self.columns} × {self.rows} squares, {self.square_mm:g} mm"


class MarkerBoard(Board):
    """Markers that lie apart, whose own corners are what is found."""

    def object_points(self, ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(4 k, 3) world positions of the corners of markers, four by four: what `cv2.solvePnP` asks for."""
        return self.marker_points(ids).reshape(-1, 3)

    def to_cv(self) -> "cv2.aruco.Board":
        """OpenCV's board of these markers; its points are sheet positions with z = 0."""
        corners = self.sheet_corners()
        points = np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=2).astype(np.float32)
        return cv2.aruco.Board(list(points), get_dictionary(self.dictionary), np.array(self.marker_ids))

    def draw(self, px_per_mm: float) -> np.ndarray:
        """(h, w) float share of each pixel that is inked."""
        width, height = (round(side * px_per_mm) for side in self.size_mm)
        ink = np.zeros((height, width))
        for marker_id, corners in zip(self.marker_ids, self.sheet_corners(), strict=True):
            add_turned(ink, marker_modules(self.dictionary, marker_id), corners * (width / self.size_mm[0]))
        return ink


@dataclass(frozen=True)
class MarkerGrid(MarkerBoard):
    """Markers in rows and columns, as OpenCV's `GridBoard` has them; checked when it is made.

    Raises:
        ToolkitError: the markers touch, or the dictionary has too few.
    """

    columns: int  # columns, rows: markers across and down the page
    rows: int
    square_mm: float  # from a marker's left edge to its right neighbour's, the same downwards
    marker_mm: float  # side of a marker, its black border included
    dictionary: str  # OpenCV's name of it; AprilTag's are among them
    ink_percent: float = 100.0  # how dark the markers are, 100 is black
    first_id: int = 0  # number of the upper left marker; the others follow row by row

    def __post_init__(self) -> None:
        require_ink("board", self.ink_percent)
        _check_counts(self.columns, self.rows, 1, "markers")
        if self.columns * self.rows < 2:
            raise ToolkitError(
                "board: a single marker: expected at least 2, a lens and a pose need more than 4 corners"
            )
        require_mm("board: square_mm", self.square_mm)
        require_mm("board: marker_mm", self.marker_mm)
        if self.marker_mm >= self.square_mm:
            raise ToolkitError(
                f"board: markers of {self.marker_mm:g} mm every {self.square_mm:g} mm touch: square_mm is from a "
                "marker's left edge to the left edge of the next"
            )
        require_ids("board", self.dictionary, self.first_id, self.columns * self.rows)

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """Numbers of the markers, from the upper left, row by row."""
        return tuple(range(self.first_id, self.first_id + self.columns * self.rows))

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height from the first marker's edge to the last marker's."""
        gap = self.square_mm - self.marker_mm
        return self.columns * self.square_mm - gap, self.rows * self.square_mm - gap

    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """As `Board` has it; none is turned."""
        places = [(column, row) for row in range(self.rows) for column in range(self.columns)]
        middles = np.array(places) * self.square_mm + self.marker_mm / 2
        return [(self.first_id + number, middle, 0.0) for number, middle in enumerate(middles)]

    def describe(self) -> str:
        """A line: what it is made of."""
        return (
            f"grid of {self.columns} × {self.rows} markers, {self.marker_mm:g} mm every {self.square_mm:g} mm, "
            f"{self.dictionary} {self.marker_ids[0]}-{self.marker_ids[-1]}"
        )


DEFAULT_BOARD = CharucoBoard(columns=12, rows=15, square_mm=26.0, marker_mm=19.5, ink_percent=PALE_PERCENT)
"""312 × 390 mm, four pages of A4 or letter: two rows of squares are left round a built-in object of 270 mm."""
