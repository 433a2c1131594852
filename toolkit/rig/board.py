"""The printed sheet that an object stands on, from which a photograph's camera is found: a ChArUco board, or a ring."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, ValidatorFunctionWrapHandler, field_validator

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, write_json
from toolkit.core.workspace import Workspace
from toolkit.rig.markers import (
    DICTIONARY,
    PALE_PERCENT,
    RING_FIRST_ID,
    STRIP_FIRST_ID,
    add_rects,
    add_turned,
    black_rects,
    count_markers,
    get_dictionary,
    ink_to_picture,
    marker_modules,
    require_ink,
    require_mm,
    sheet_to_world,
)

MARKER_SHARE = 0.75
"""Of a square's side: the white round a marker is then wider than one of its modules."""
FEWEST_SQUARES = 3
MOST_SQUARES = 200
FEWEST_MARKERS = 8
"""At a low camera the object hides the half of the ring behind it; four markers are left."""


class Board(ABC):
    """The sheet that an object stands on, whose markers tell a photograph's camera.

    Sheet positions (2,) are millimetres to the right of and down from its upper left corner as printed; in the world,
    down the sheet is +x, to its right +y, and its middle the origin.

    Attributes:
        marker_mm: side of a marker, its black border included.
        dictionary: one of OpenCV's, by name.
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
    def to_cv(self) -> "cv2.aruco.Board":
        """OpenCV's board; its points are sheet positions with z = 0."""

    @abstractmethod
    def draw(self, px_per_mm: float) -> np.ndarray:
        """(h, w) float share of each pixel that is inked; rows down the page."""

    @abstractmethod
    def describe(self) -> str:
        """One line: what it is made of."""

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


@dataclass(frozen=True)
class CharucoBoard(Board):
    """A ChArUco board of OpenCV's current pattern (not legacy): upper left square black; checked when it is made.

    Attributes:
        columns, rows: squares across and down the page.
        square_mm: side of a square.
        marker_mm: side of a marker, its black border included.
        dictionary: one of OpenCV's, by name; the markers' numbers start at 0.
        ink_percent: how dark squares and markers are, 100 is black.

    Raises:
        ToolkitError: the marker does not fit its square with white round it, or the dictionary has too few.
    """

    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str = DICTIONARY
    ink_percent: float = 100.0

    def __post_init__(self) -> None:
        require_ink("board", self.ink_percent)
        for name, count in (("columns", self.columns), ("rows", self.rows)):
            if not FEWEST_SQUARES <= count <= MOST_SQUARES:
                raise ToolkitError(f"board: {name}: expected {FEWEST_SQUARES} to {MOST_SQUARES} squares, found {count}")
        require_mm("board: square_mm", self.square_mm)
        require_mm("board: marker_mm", self.marker_mm)
        if self.marker_mm > 0.9 * self.square_mm:
            raise ToolkitError(
                f"board: a marker of {self.marker_mm:g} mm in a square of {self.square_mm:g} mm: expected at most "
                f"{0.9 * self.square_mm:g} mm, so that white paper is left round it; {MARKER_SHARE * self.square_mm:g} "
                "mm is good"
            )
        known = count_markers(self.dictionary)
        most = min(known, RING_FIRST_ID) if self.dictionary == DICTIONARY else known
        if self.marker_count > most:
            raise ToolkitError(
                f"board: {self.columns}x{self.rows} squares need {self.marker_count} different markers, "
                f"{self.dictionary} has {most}: choose fewer, larger squares"
            )

    @property
    def marker_count(self) -> int:
        """One in every white square."""
        return self.columns * self.rows // 2

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """Numbers of the markers, from the upper left, row by row."""
        return tuple(range(self.marker_count))

    @property
    def corner_count(self) -> int:
        """Inner corners of the chessboard, numbered from the upper left, row by row."""
        return (self.columns - 1) * (self.rows - 1)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height on the page; the printed sheet has white paper round that."""
        return self.columns * self.square_mm, self.rows * self.square_mm

    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """As `Board` has it; none is turned."""
        white = [(row, column) for row in range(self.rows) for column in range(self.columns) if (row + column) % 2]
        return [
            (number, (np.array([column, row]) + 0.5) * self.square_mm, 0.0)
            for number, (row, column) in enumerate(white)
        ]

    def black_squares(self) -> np.ndarray:
        """(k, 4) left, top, right, bottom of the chessboard's black squares on the sheet, millimetres."""
        black = [(row, column) for row in range(self.rows) for column in range(self.columns) if (row + column) % 2 == 0]
        return np.array([(column, row, column + 1, row + 1) for row, column in black]) * self.square_mm

    def object_points(self, ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(k, 3) world positions of inner corners of the chessboard, all by default."""
        numbers = np.arange(self.corner_count) if ids is None else np.asarray(ids, int).ravel()
        rows, columns = np.divmod(numbers, self.columns - 1)
        return sheet_to_world(np.stack([columns + 1, rows + 1], axis=1) * self.square_mm, self.size_mm)

    def to_cv(self) -> "cv2.aruco.CharucoBoard":
        """OpenCV's board; its points are sheet positions with z = 0."""
        squares = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(squares, self.square_mm, self.marker_mm, get_dictionary(self.dictionary))

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

    def describe(self) -> str:
        """One line: what it is made of."""
        return (
            f"ChArUco board of {self.columns} × {self.rows} squares, {self.square_mm:g} mm, markers "
            f"{self.marker_mm:g} mm, {self.dictionary} 0-{self.marker_count - 1}, {self.ink_percent:g} % ink"
        )


@dataclass(frozen=True)
class MarkerRing(Board):
    """Markers in a ring round a free disc, upright towards the middle as seen from outside; checked when it is made.

    The first marker lies at the front (the lower edge of the page), the others follow counter-clockwise from above.
    Sheet positions are counted from the corner of the square round the ring.

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

    inner_mm: float
    marker_mm: float
    count: int
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

    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """As `Board` has it; each is upright towards the middle."""
        turns = [2 * math.pi * index / self.count for index in range(self.count)]
        radius, middle = self.middle_radius_mm, self.outer_mm / 2
        return [
            (marker_id, middle + radius * np.array([math.sin(turn), math.cos(turn)]), turn)
            for marker_id, turn in zip(self.marker_ids, turns, strict=True)
        ]

    def object_points(self, ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(4 k, 3) world positions of the corners of markers, four by four: what `cv2.solvePnP` asks for."""
        return self.marker_points(ids).reshape(-1, 3)

    def to_cv(self) -> "cv2.aruco.Board":
        """OpenCV's board of these markers; its points are sheet positions with z = 0."""
        corners = self.sheet_corners()
        points = np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=2).astype(np.float32)
        return cv2.aruco.Board(list(points), get_dictionary(self.dictionary), np.array(self.marker_ids))

    def draw(self, px_per_mm: float) -> np.ndarray:
        """(h, w) float share of each pixel that is inked, of the square round the ring."""
        side = round(self.outer_mm * px_per_mm)
        ink = np.zeros((side, side))
        for marker_id, corners in zip(self.marker_ids, self.sheet_corners(), strict=True):
            add_turned(ink, marker_modules(self.dictionary, marker_id), corners * (side / self.outer_mm))
        return ink

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


def choose_ring(inner_mm: float, marker_mm: float | None = None) -> MarkerRing:
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
    return MarkerRing(inner_mm, side, min(max(roomy, FEWEST_MARKERS), STRIP_FIRST_ID - RING_FIRST_ID))


DEFAULT_BOARD = CharucoBoard(columns=12, rows=15, square_mm=26.0, marker_mm=19.5, ink_percent=PALE_PERCENT)
"""312 × 390 mm, four pages of A4 or letter: two rows of squares are left round a built-in object of 270 mm."""
DEFAULT_RING = MarkerRing(inner_mm=300.0, marker_mm=24.0, count=30)


class BoardFile(BaseModel):
    """`rig/board.json`: the sheet that is printed and photographed, either a board or a ring."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    board: CharucoBoard | None = None
    ring: MarkerRing | None = None

    @field_validator("board", "ring", mode="wrap")
    @classmethod
    def _explain(cls, value: object, read: ValidatorFunctionWrapHandler) -> Board | None:
        try:
            return read(value)
        except ToolkitError as error:
            raise ValueError(str(error)) from None


def board_file(workspace: Workspace) -> Path:
    """Where the printed sheet's spec is."""
    return workspace.root / "rig" / "board.json"


def write_board(workspace: Workspace, board: Board) -> Path:
    """Write `rig/board.json`, for `read_board`; returns the file."""
    kind = "board" if isinstance(board, CharucoBoard) else "ring"
    return write_json(board_file(workspace), {"schema_version": 1, kind: dict(vars(board))})


def read_board(workspace: Workspace) -> Board:
    """The sheet that `toolkit print --board` or `--ring` printed last; the default board where there is no file.

    Raises:
        ToolkitError: the file is broken, names both or neither, or its sizes cannot be.
    """
    file = board_file(workspace)
    if not file.is_file():
        return DEFAULT_BOARD
    found = read_json(file, BoardFile)
    if (found.board is None) == (found.ring is None):
        raise ToolkitError(f"{file}: expected either 'board' or 'ring': print the sheet again, or delete the file")
    return found.board or found.ring or DEFAULT_BOARD
