"""A sheet larger than the paper, cut into tiles that overlap."""

import math
from dataclasses import dataclass

from toolkit.printing.frame import Rect

OVERLAP_MM = 10.0


@dataclass(frozen=True)
class Tile:
    """One page's part of a sheet.

    Attributes:
        row, column: from the top left, zero-based.
        area: in the sheet's own millimetres: origin at its lower left corner, y upwards.
        rows, columns: of the whole grid.
    """

    row: int
    column: int
    area: Rect
    rows: int
    columns: int

    @property
    def name(self) -> str:
        """`A1` at the top left, letters downwards, numbers to the right."""
        return f"{_letters(self.row)}{self.column + 1}"

    @property
    def joins(self) -> dict[str, bool]:
        """By side, whether another tile is joined on there; where none is, the side is the sheet's cut line."""
        return {
            "left": self.column > 0,
            "right": self.column < self.columns - 1,
            "top": self.row > 0,
            "bottom": self.row < self.rows - 1,
        }


def _letters(row: int) -> str:
    """A … Z, AA, AB …, as columns are named in a spreadsheet."""
    letters = ""
    row += 1
    while row:
        row, digit = divmod(row - 1, 26)
        letters = chr(ord("A") + digit) + letters
    return letters


def split_length(length_mm: float, most_mm: float, overlap_mm: float = OVERLAP_MM) -> list[tuple[float, float]]:
    """Equal spans (start, length) of at most `most_mm` that cover a length and overlap by `overlap_mm`."""
    if length_mm <= most_mm:
        return [(0.0, length_mm)]
    count = math.ceil((length_mm - overlap_mm) / (most_mm - overlap_mm))
    span = (length_mm + (count - 1) * overlap_mm) / count
    return [(index * (span - overlap_mm), span) for index in range(count)]


def tile_sheet(
    side_mm: float, most_width_mm: float, most_height_mm: float, height_mm: float | None = None
) -> list[Tile]:
    """Tiles of a sheet, row by row from the top left, none larger than stated.

    Args:
        side_mm: width of the sheet.
        most_width_mm, most_height_mm: of a tile.
        height_mm: of the sheet; None: a square one.
    """
    sheet_height = side_mm if height_mm is None else height_mm
    across = split_length(side_mm, most_width_mm)
    down = split_length(sheet_height, most_height_mm)
    return [
        Tile(row, column, Rect(x, sheet_height - y - height, width, height), len(down), len(across))
        for row, (y, height) in enumerate(down)
        for column, (x, width) in enumerate(across)
    ]
