"""Format numbers, and write tables as CSV and on the console; reports use the same functions."""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from itertools import chain, product
from typing import TYPE_CHECKING

from toolkit.core.statistics import Interval, RankCorrelation, wilson_interval
from toolkit.core.text import escape

if TYPE_CHECKING:
    from rich.table import Table

NONE = "–"
ROUNDING = 1e-9
FIRST_WIDTH, TEXT_WIDTH = 6, 12
"""Least width of the first and of other columns of text on a narrow console."""
BREAKS = re.compile(r"/(?=\w)")


def format_percent(share: float | None) -> str:
    """Return `61`, or a dash for None; with a decimal if rounding would wrongly give 0 or 100."""
    if share is None:
        return NONE
    is_hidden = ROUNDING < share <= 0.005 or 0.995 <= share < 1 - ROUNDING
    return f"{min(max(100 * share, 0.1), 99.9):.1f}" if is_hidden else f"{100 * share:.0f}"


def format_interval(interval: Interval | None) -> str:
    """Return `55–67`, in per cent; empty without an interval."""
    return f"{format_percent(interval[0])}–{format_percent(interval[1])}" if interval else ""


def format_count(count: int, n: int) -> str:
    """Return a count with its share and interval: `13 of 18 (72 %, …)`."""
    if n == 0:
        return "0 of 0"
    interval = format_interval(wilson_interval(count, n))
    return f"{count} of {n} ({format_percent(count / n)} %, 95 % interval {interval} %)"


def format_points(share: float) -> str:
    """Return a difference of shares in percentage points: `−6`, `0`, `+11`."""
    points = round(100 * share)
    return "0" if points == 0 else _minus(f"{points:+d}")


def format_points_interval(interval: Interval | None) -> str:
    """Return `−6 to +11`; empty without an interval."""
    return f"{format_points(interval[0])} to {format_points(interval[1])}" if interval else ""


def format_p(p: float | None) -> str:
    """Return `0.031` or `< 0.0001`; empty for None."""
    return "" if p is None else "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def format_test(p: float) -> str:
    """Return `exact McNemar p = 0.031` or `exact McNemar p < 0.0001`."""
    number = format_p(p)
    return f"exact McNemar p {number if number[0] == '<' else f'= {number}'}"


def format_rank(rank: RankCorrelation) -> str:
    """Return a correlation with its interval, or why there is none."""
    if rank.rho is None:
        return rank.why
    return _minus(f"{rank.rho:.2f}" + (f" ({rank.ci95[0]:.2f} to {rank.ci95[1]:.2f})" if rank.ci95 else ""))


def format_kappa(kappa: float | None) -> str:
    """Return `0.45`, or `all equal` for None."""
    return "all equal" if kappa is None else _minus(f"{kappa:.2f}")


def _minus(text: str) -> str:
    return text.replace("-", "−")


class FormattedNumber(str):
    """Formatted numbers for a CSV cell, such as those of a box."""


def encode_csv(heads: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return the text of a CSV file; None is an empty cell, and a text that a spreadsheet would run gets a `'`.

    A formula may read files and open addresses. `decode_cell` restores the text, but for `NUL`, which becomes ␀.
    Numbers stay as they are; a text of digits may be a name, such as a folder `+1`.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    quoted = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL)
    for row in chain([heads], rows):
        cells = [_encode_cell(cell) for cell in row]
        # readers end a line at a lone \r, which the module does not quote
        (quoted if any(isinstance(cell, str) and "\r" in cell for cell in cells) else table).writerow(cells)
    return text.getvalue()


FORMULA = re.compile(r"'*[=+\-@\t\r\n]")


def _encode_cell(cell: object) -> object:
    if not isinstance(cell, str) or isinstance(cell, FormattedNumber):
        return "" if cell is None else cell
    cell = cell.replace("\0", "\N{SYMBOL FOR NULL}")  # spreadsheets and Python 3.10 cannot read it
    return f"'{cell}" if FORMULA.match(cell) else cell


def decode_cell(text: str) -> str:
    """Return the text before `encode_csv`."""
    return text[1:] if text[:1] == "'" and FORMULA.match(text) else text


def share_width(columns: Sequence[Sequence[str]], room: int) -> list[int]:
    """Return the width of each column: its longest word, and more, from the left, while there is room."""
    widths = [max(map(len, " ".join(cells).split()), default=0) for cells in columns]
    left = room - sum(widths)
    for at, cells in enumerate(columns):
        more = min(max(map(len, cells), default=0) - widths[at], max(left, 0))
        widths[at], left = widths[at] + more, left - more
    return widths


def build_table(
    title: str, texts: Sequence[str], numbers: Sequence[str], rows: Iterable[Sequence[str]], bold: str | None = None
) -> "Table":
    """Return a table for the console.

    Args:
        title: text above the table.
        texts: heads of text columns on the left, which are folded on a narrow console.
        numbers: heads of columns on the right, whose cells are never cut off.
        rows: a cell for each column; a first cell equal to the cell above is left out.
        bold: first cell of bold rows.
    """
    from rich.table import Table
    from rich.text import Text

    from toolkit.core.console import console

    # as plain text: square brackets in names are no markup
    table = Table(title=Text(title), title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    cells = [[escape(cell) for cell in row] for row in rows]
    broken = [[*(BREAKS.sub("/ ", cell) for cell in row[: len(texts)]), *row[len(texts) :]] for row in cells]
    # if there is no room: break long names after a slash, and heads between words, but no number
    for heads, shown in product(([[head] for head in numbers], [head.split() for head in numbers]), (cells, broken)):
        columns = list(zip((*texts, *numbers), *shown, strict=True))
        numeric = [max(map(len, [*head, *of])) for head, (_, *of) in zip(heads, columns[len(texts) :], strict=True)]
        room = console.width - sum(numeric) - len(columns)
        widths = share_width(columns[: len(texts)], room)
        if sum(widths) <= room:
            break
    # still no room: text columns keep a least width, and numbers are folded
    fits = sum(widths) <= room
    for i, (name, width) in enumerate(zip(texts, widths, strict=True)):
        least = width if fits else min(width, TEXT_WIDTH if i else FIRST_WIDTH)
        table.add_column(name, overflow="fold", min_width=least)
    for name, width in zip(numbers, numeric, strict=True):
        table.add_column(name, justify="right", overflow="fold", width=width if fits else None)
    # repeated names in the first column are left out
    above = None
    for first, *rest in shown:
        table.add_row(Text("" if first == above else first), *map(Text, rest), style="bold" if first == bold else "")
        above = first
    return table
