"""Read tables of other programs: usual encodings, commas, semicolons or tabs, decimal points or commas."""

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_bytes
from toolkit.core.tables import decode_cell

MOST_BYTES = 256 << 20
MARKS = (";", "\t", ",")
"""Separators of cells. The commonest in the heading counts, else the first: a comma may be a decimal sign."""
SEPARATOR_LINE = re.compile(r"sep=([;,|\t])\r?\n", re.IGNORECASE)
"""Line of spreadsheets before the heading."""
BYTE_ORDER_MARKS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True)
class ForeignTable:
    """A table with a heading.

    Attributes:
        heads: names of the columns, in lower case and stripped.
        lines: number of each line in the file, and its stripped cells, without empty lines.
    """

    file: Path
    heads: tuple[str, ...]
    mark: str
    lines: tuple[tuple[int, tuple[str, ...]], ...]

    def find(self, names: Sequence[str]) -> int | None:
        """Return the column with the first of these names that exists; a `ToolkitError` if two columns have it."""
        name = next((name for name in names if name in self.heads), None)
        if name is None:
            return None
        if self.heads.count(name) > 1:
            raise ToolkitError(f"{self.file}: two columns are called '{name}': rename one of them")
        return self.heads.index(name)

    def plain(self, cell: str) -> str:
        """Return a cell's text; a decimal comma becomes a point."""
        is_decimal = self.mark != "," and DECIMAL_COMMA.fullmatch(cell)
        return cell.replace(",", ".") if is_decimal else cell

    def number(self, cell: str) -> float | None:
        """Return the number in a cell; None for other text."""
        text = self.plain(cell)
        # `float` would also read 1_0, infinity and the digits of other scripts
        return float(text) if NUMBER.fullmatch(text) else None


def read_foreign_table(file: Path, most_bytes: int = MOST_BYTES) -> ForeignTable:
    """Read a table of any program: UTF-8 or UTF-16, with commas, semicolons or tabs.

    Raises:
        ToolkitError: the file is missing, too large, in another encoding, or no table.
    """
    content = read_bytes(file, most_bytes)
    # -sig: spreadsheets begin UTF-8 with a byte order mark
    code = next((code for mark, code in BYTE_ORDER_MARKS if content.startswith(mark)), "utf-8-sig")
    try:
        text = content.decode(code)
    except UnicodeDecodeError:
        raise ToolkitError(f"{file}: not a readable CSV table: expected UTF-8: save it as CSV UTF-8") from None
    given = SEPARATOR_LINE.match(text)
    body = text[given.end() :] if given else text
    heading = re.sub(r'"[^"]*"', "", body.partition("\n")[0])
    mark = given[1] if given else max(MARKS, key=heading.count)
    # a blank may stand between a comma and a quote
    lines = csv.reader(io.StringIO(body, newline=""), delimiter=mark, strict=True, skipinitialspace=mark != "\t")
    try:
        heads = tuple(head.strip().lower() for head in next(lines, []))
        above = int(bool(given))
        # spreadsheets write lines of empty cells below the last row
        cleaned = (tuple(decode_cell(cell.strip()) for cell in cells) for cells in lines)
        rows = tuple((lines.line_num + above, cells) for cells in cleaned if any(cells))
        return ForeignTable(file, heads, mark, rows)
    except csv.Error as error:
        number = lines.line_num + bool(given)
        raise ToolkitError(f"{file}, line {number}: not a readable CSV table ({error}): save it as CSV again") from None
