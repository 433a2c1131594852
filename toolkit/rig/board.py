"""The printed sheet that an object stands on, from which a photograph's camera is found: a ChArUco board, or a ring."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, write_json
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear
from toolkit.rig.markers import (
    DICTIONARY,
    PALE_PERCENT,
    RING_FIRST_ID,
    RingSpec,
    add_rects,
    black_rects,
    count_markers,
    get_dictionary,
    ink_to_picture,
    marker_modules,
    require_ink,
    require_mm,
    sheet_to_world,
)
from toolkit.rig.studio import Studio

MARKER_SHARE = 0.75
"""Of a square's side: the white round a marker is then wider than one of its modules."""
FEWEST_SQUARES = 3
MOST_SQUARES = 200


@dataclass(frozen=True)
class BoardSpec:
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

    columns: int = 12
    rows: int = 15
    square_mm: float = 26.0
    marker_mm: float = 19.5
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

    def placements(self) -> list[tuple[int, np.ndarray, float]]:
        """Per marker its number, its middle (2,) on the sheet, and its turn, which is 0; as `RingSpec` has it."""
        white = [(row, column) for row in range(self.rows) for column in range(self.columns) if (row + column) % 2]
        return [
            (number, (np.array([column, row]) + 0.5) * self.square_mm, 0.0)
            for number, (row, column) in enumerate(white)
        ]

    def black_squares(self) -> np.ndarray:
        """(k, 4) left, top, right, bottom of the chessboard's black squares on the sheet, millimetres."""
        black = [(row, column) for row in range(self.rows) for column in range(self.columns) if (row + column) % 2 == 0]
        return np.array([(column, row, column + 1, row + 1) for row, column in black]) * self.square_mm

    def object_points(self, corner_ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(k, 3) world positions of inner corners of the chessboard, all by default."""
        ids = np.arange(self.corner_count) if corner_ids is None else np.asarray(corner_ids, int).ravel()
        rows, columns = np.divmod(ids, self.columns - 1)
        return sheet_to_world(np.stack([columns + 1, rows + 1], axis=1) * self.square_mm, self.size_mm)

    def marker_points(self, marker_ids: Sequence[int] | np.ndarray | None = None) -> np.ndarray:
        """(k, 4, 3) world positions of the corners of markers (all by default), in OpenCV's order."""
        half = self.marker_mm / 2
        square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        middles = np.array([middle for _, middle, _ in self.placements()])
        ids = np.arange(self.marker_count) if marker_ids is None else np.asarray(marker_ids, int).ravel()
        return sheet_to_world(middles[ids][:, None] + square, self.size_mm)

    def to_cv(self) -> "cv2.aruco.CharucoBoard":
        """OpenCV's board; its points are sheet positions with z = 0."""
        import cv2

        squares = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(squares, self.square_mm, self.marker_mm, get_dictionary(self.dictionary))

    def paint(self, px_per_mm: float) -> np.ndarray:
        """(h, w) uint8 sRGB grey picture of exactly `size_mm`, rows down the page; edges are shared between pixels."""
        width, height = (round(side * px_per_mm) for side in self.size_mm)
        scale = np.array([width / self.size_mm[0], height / self.size_mm[1]] * 2)
        ink = np.zeros((height, width))
        add_rects(ink, self.black_squares() * scale)
        for marker_id, middle, _ in self.placements():
            rects = black_rects(marker_modules(self.dictionary, marker_id)) * self.marker_mm
            add_rects(ink, (rects + np.tile(middle - self.marker_mm / 2, 2)) * scale)
        return ink_to_picture(ink, self.ink_percent)

    def describe(self) -> str:
        """One line: what it is made of."""
        return (
            f"ChArUco board of {self.columns} × {self.rows} squares, {self.square_mm:g} mm, markers "
            f"{self.marker_mm:g} mm, {self.dictionary} 0-{self.marker_count - 1}, {self.ink_percent:g} % ink"
        )


Sheet = BoardSpec | RingSpec
DEFAULT_BOARD = BoardSpec(ink_percent=PALE_PERCENT)
"""312 × 390 mm, four pages of A4 or letter: two rows of squares are left round a built-in object of 270 mm."""


class _BoardFields(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str = DICTIONARY
    ink_percent: float = 100.0


class _RingFields(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    inner_mm: float
    marker_mm: float
    count: int
    dictionary: str = DICTIONARY
    first_id: int = RING_FIRST_ID
    ink_percent: float = 100.0


class BoardFile(BaseModel):
    """`rig/board.json`: the sheet that is printed and photographed, either a board or a ring."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    board: _BoardFields | None = None
    ring: _RingFields | None = None


def board_file(workspace: Workspace) -> Path:
    """Where the printed sheet's spec is."""
    return workspace.root / "rig" / "board.json"


def write_board(workspace: Workspace, sheet: Sheet) -> Path:
    """Write `rig/board.json`, for `read_board`; returns the file."""
    kind = "board" if isinstance(sheet, BoardSpec) else "ring"
    return write_json(board_file(workspace), {"schema_version": 1, kind: asdict(sheet)})


def read_board(workspace: Workspace) -> Sheet:
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
    try:
        return BoardSpec(**found.board.model_dump()) if found.board else RingSpec(**dict(found.ring or ()))
    except ToolkitError as error:
        raise ToolkitError(f"{file}: {error}") from None


INK, PAPER = 28, 236
"""sRGB of a laser printer's black and of office paper."""
PAPER_EDGE_MM = 9.0
"""White paper round the board."""
FINE_PX_PER_MM = 3.0
MOST_PX = 4200
"""Longer side of the table's picture at most: it is kept in float while a scene is shot."""


def lay_board(studio: Studio, board: Sheet, px_per_mm: float | None = None) -> Studio:
    """The same studio with a board in the middle of its table, its edge marked FRONT to +x, its right to +y.

    Args:
        studio: whose table is large enough for the board.
        board: as it was printed.
        px_per_mm: of the table's picture; by default as fine as the markers need and the memory allows.
    """
    wide_mm, high_mm = studio.table_mm
    fine = px_per_mm or min(FINE_PX_PER_MM, MOST_PX / max(wide_mm, high_mm))
    page = np.pad(board.paint(fine), round(PAPER_EDGE_MM * fine), constant_values=255)
    sheet = np.rot90(page)  # rows run down the page, which is +x; in the table's picture x runs right and y up
    # an even margin on both sides keeps the sheet's middle in the picture's
    wide, high = (
        side + 2 * max(0, round((mm * fine - side) / 2))
        for mm, side in zip(studio.table_mm, sheet.shape[::-1], strict=True)
    )
    table = cv2.resize(studio.table, (wide, high), interpolation=cv2.INTER_CUBIC)
    ink, paper = srgb_to_linear(np.array([INK, PAPER]) / 255)
    shades = np.round(linear_to_srgb(ink + srgb_to_linear(np.arange(256) / 255) * (paper - ink)) * 255).astype(np.uint8)
    top, left = (high - sheet.shape[0]) // 2, (wide - sheet.shape[1]) // 2
    table[top : top + sheet.shape[0], left : left + sheet.shape[1]] = shades[sheet][..., None]
    return replace(studio, name=f"{studio.name}/board", table=table, table_mm=(wide / fine, high / fine))
