"""Sheets of paper in millimetres, with copies packed on them, or a copy cut into tiles that overlap."""

import math
import re
from dataclasses import dataclass
from typing import Literal, get_args

from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.text import name_letter

Orientation = Literal["auto", "portrait", "landscape"]

PAPERS_MM = {
    "a0": (841.0, 1189.0), "a1": (594.0, 841.0), "a2": (420.0, 594.0), "a3": (297.0, 420.0), "a4": (210.0, 297.0),
    "a5": (148.0, 210.0), "b3": (353.0, 500.0), "b4": (250.0, 353.0), "b5": (176.0, 250.0),
    "letter": (215.9, 279.4), "legal": (215.9, 355.6), "tabloid": (279.4, 431.8),
}  # fmt: skip
"""Portrait width and height: ISO 216, and ANSI/ASME Y14.1 for the American sizes."""
SMALLEST_MM = 135.0
"""Room for a 100 mm check bar, its numbers and the margins that no printer reaches."""
LARGEST_MM = 5000.0
"""A PDF page ends at 14400 points, 5080 mm (ISO 32000-1, Annex C)."""
CUSTOM = re.compile(r"^\s*(\d+(?:\.\d+)?)\s*[x×]\s*(\d+(?:\.\d+)?)\s*(?:mm)?\s*$", re.IGNORECASE)


@dataclass(frozen=True)
class Paper:
    """A sheet as it lies in the printer: its name and its width and height in millimetres."""

    name: str
    width_mm: float
    height_mm: float

    def __str__(self) -> str:
        return self.name

    @property
    def orientation(self) -> str:
        """`portrait` or `landscape`; a square is portrait."""
        return "landscape" if self.width_mm > self.height_mm else "portrait"

    def describe(self) -> str:
        """`a4 portrait`."""
        return f"{self.name} {self.orientation}"

    def turn(self, orientation: str) -> "Paper":
        """Turn this sheet to `portrait` or `landscape`."""
        if orientation == self.orientation or self.width_mm == self.height_mm:
            return self
        return Paper(self.name, self.height_mm, self.width_mm)


def parse_paper(text: str) -> Paper:
    """Return a paper by name (`a4`, `letter`), or by width × height (`200x300mm`).

    Raises:
        ToolkitError: the name is unknown, or the sheet is smaller than 135 mm or larger than 5 m on a side.
    """
    name = text.strip().lower()
    # papers with a name first, since any other text must be two numbers
    if name in PAPERS_MM:
        return Paper(name, *PAPERS_MM[name])
    custom = CUSTOM.match(name)
    if custom is None:
        raise one_of("paper", text, [*PAPERS_MM, "WIDTHxHEIGHTmm"])
    width_mm, height_mm = float(custom[1]), float(custom[2])
    # a number of many digits may be infinite as a float
    if not all(math.isfinite(side) and SMALLEST_MM <= side <= LARGEST_MM for side in (width_mm, height_mm)):
        raise ToolkitError(
            f"paper '{text}': expected sides of {SMALLEST_MM:g} to {LARGEST_MM:g} mm (a 100 mm check bar must fit): "
            "choose another paper"
        )
    return Paper(f"{width_mm:g}x{height_mm:g}mm", width_mm, height_mm)


UNPRINTABLE_MM = 10.0
"""Nearly every desktop printer reaches this far; many stop at 6 mm, a few at 12 mm on one end of the sheet only."""
HEADER_MM = 23.0
BAR_STRIP_MM = 5.5
INSET_MM = BAR_STRIP_MM + 2
"""The strip of a check bar and 2 mm of paper, so that neither words nor marks touch the bar."""
BAR_MM = 100.0
BARS_MM = UNPRINTABLE_MM + BAR_STRIP_MM
"""Zero of both check bars, from the left and from below."""
MARK_MM = 6.0
"""Width of the zone round a cut line that holds crop marks and registration marks."""
CAPTION_MM = 4.5
"""Height of the line below it that holds the front arrow and a tile's name."""


@dataclass(frozen=True)
class Rect:
    """A rectangle in millimetres, from its lower left corner, y upwards."""

    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Greatest x."""
        return self.x + self.width

    @property
    def top(self) -> float:
        """Greatest y."""
        return self.y + self.height

    def centre(self, width: float, height: float) -> "Rect":
        """A rectangle of that size about the same centre."""
        return Rect(self.x + (self.width - width) / 2, self.y + (self.height - height) / 2, width, height)


@dataclass(frozen=True)
class PageFrame:
    """Areas of a page; the origin is the paper's lower left corner."""

    paper: Paper

    @property
    def printable(self) -> Rect:
        """Page without the margins that a printer does not reach."""
        sides = 2 * UNPRINTABLE_MM
        return Rect(UNPRINTABLE_MM, UNPRINTABLE_MM, self.paper.width_mm - sides, self.paper.height_mm - sides)

    @property
    def header(self) -> Rect:
        """Label, clear of the upright check bar, which on a low page reaches as high."""
        area = self.printable
        return Rect(area.x + INSET_MM, area.top - HEADER_MM, area.width - INSET_MM, HEADER_MM)

    @property
    def content(self) -> Rect:
        """Area for patches, their marks and captions."""
        area = self.printable
        return Rect(area.x + INSET_MM, area.y + INSET_MM, area.width - INSET_MM, area.height - INSET_MM - HEADER_MM)


OVERLAP_MM = 10.0


@dataclass(frozen=True)
class SheetTile:
    """A page's part of a sheet.

    Attributes:
        row, column: from the top left, zero-based.
        area: place on the sheet in mm, from its lower left corner, y upwards.
        rows, columns: size of the grid.
    """

    row: int
    column: int
    area: Rect
    rows: int
    columns: int

    @property
    def name(self) -> str:
        """`A1` at the top left, letters downwards, numbers to the right."""
        return f"{name_letter(self.row)}{self.column + 1}"

    @property
    def joins(self) -> dict[str, bool]:
        """By side, whether another tile is joined on there; where none is, the side is the sheet's cut line."""
        return {
            "left": self.column > 0, "right": self.column < self.columns - 1, "top": self.row > 0,
            "bottom": self.row < self.rows - 1,
        }  # fmt: skip


def split_length(length_mm: float, most_mm: float) -> list[tuple[float, float]]:
    """Equal spans (start, length) of at most `most_mm` that cover a length and overlap by `OVERLAP_MM`."""
    if length_mm <= most_mm:
        return [(0.0, length_mm)]
    # count · span - (count - 1) · overlap = length
    count = math.ceil((length_mm - OVERLAP_MM) / (most_mm - OVERLAP_MM))
    span = (length_mm + (count - 1) * OVERLAP_MM) / count
    return [(index * (span - OVERLAP_MM), span) for index in range(count)]


def tile_sheet(width_mm: float, height_mm: float, most_width_mm: float, most_height_mm: float) -> list[SheetTile]:
    """Split a sheet into tiles, row by row from the top left, none larger than stated."""
    across, down = split_length(width_mm, most_width_mm), split_length(height_mm, most_height_mm)
    return [
        SheetTile(row, column, Rect(x, height_mm - y - height, width, height), len(down), len(across))
        for row, (y, height) in enumerate(down)
        for column, (x, width) in enumerate(across)
    ]


MOST_PAGES = 3000
NARROWEST_CELL_MM = 24.0
"""The caption under a very small patch is wider than the patch."""


@dataclass(frozen=True)
class StripPlace:
    """The colour strip on a page: its lower left corner in millimetres, lying level or turned to read upwards."""

    x: float
    y: float
    upright: bool


@dataclass(frozen=True)
class CopiesPage:
    """A page of whole copies: the cut line of each, in the page's millimetres, and the colour strip where it fits."""

    cuts: tuple[Rect, ...]
    strip: StripPlace | None = None


@dataclass(frozen=True)
class TilePage:
    """A page with a part of one copy; `window` is where on the page the tile lies."""

    tile: SheetTile
    window: Rect
    copy: int


@dataclass(frozen=True)
class MapPage:
    """The first page of a tiled sheet, a map of its tiles."""

    tiles: tuple[SheetTile, ...]


Page = CopiesPage | TilePage | MapPage


@dataclass(frozen=True)
class PagePlan:
    """Every page of a sheet's file, in the order of printing, and what they share."""

    frame: PageFrame
    pages: tuple[Page, ...]

    @property
    def tiles(self) -> tuple[int, int]:
        """Rows and columns that one copy is split into, (1, 1) where it fits on a page."""
        first = self.pages[0]
        return (first.tiles[0].rows, first.tiles[0].columns) if isinstance(first, MapPage) else (1, 1)


def turn_frames(paper: Paper, orientation: str) -> list[PageFrame]:
    """Return the page in this orientation; for `auto` both, the paper's own first; a `ToolkitError` for others."""
    known = get_args(Orientation)
    if orientation not in known:
        raise one_of("orientation", orientation, list(known))
    turns = [orientation]
    if orientation == "auto":
        # the paper's own orientation first: it wins if both need as many pages
        turns = sorted(["portrait", "landscape"], key=lambda turn: turn != paper.orientation)
    return [PageFrame(paper.turn(turn)) for turn in turns]


def plan_sheet(paper: Paper, orientation: str, cut_width: float, cut_height: float, copies: int = 1) -> PagePlan:
    """Lay out whole copies of a sheet, or a map and tiles if it is larger than a page; `auto` takes fewer pages.

    Raises:
        ToolkitError: it would take more than 3000 pages, or as `turn_frames`.
    """
    plans = []
    for frame in turn_frames(paper, orientation):
        packed = pack_copies(frame.content, cut_width, cut_height, copies)
        plans.append(PagePlan(frame, tuple(packed or _spread_tiles(frame, cut_width, cut_height, copies))))
    return min(plans, key=lambda plan: len(plan.pages))


def pack_copies(content: Rect, cut_width: float, cut_height: float, copies: int) -> list[CopiesPage]:
    """Pack as many copies on a page as fit, the group centred; none if no copy fits."""
    # a cell holds the sheet, its crop marks and its caption
    cell_width = max(cut_width + 2 * MARK_MM, NARROWEST_CELL_MM)
    cell_height = cut_height + 2 * MARK_MM + CAPTION_MM
    most_columns, most_rows = int(content.width // cell_width), int(content.height // cell_height)
    if not most_columns * most_rows:
        return []
    columns = min(most_columns, copies)
    rows = min(most_rows, math.ceil(copies / columns))
    group = content.centre(columns * cell_width, rows * cell_height)
    # rows fill from the top of the page
    cuts = [
        Rect(group.x + column * cell_width + (cell_width - cut_width) / 2,
             group.top - row * cell_height - MARK_MM - cut_height, cut_width, cut_height)
        for row in range(rows)
        for column in range(columns)
    ]  # fmt: skip
    # the last page may be left with fewer
    return [CopiesPage(tuple(cuts[: copies - done])) for done in range(0, copies, len(cuts))]


def _spread_tiles(frame: PageFrame, cut_width: float, cut_height: float, copies: int) -> list[Page]:
    content = frame.content
    # tiles leave room on all sides for their marks, and below for the caption
    most_width, most_height = content.width - 2 * MARK_MM, content.height - 2 * MARK_MM - CAPTION_MM
    tiles = tile_sheet(cut_width, cut_height, most_width, most_height)
    # thousands of pages are a slip in the size, not a wish
    if len(tiles) * copies > MOST_PAGES:
        raise FieldError(
            f"{max(cut_width, cut_height):.0f} mm on {frame.paper.name} needs {len(tiles) * copies} pages: expected at "
            f"most {MOST_PAGES}; choose a larger {{paper}}, a smaller size or fewer {{copies}}",
            {},
        )
    window_area = Rect(content.x, content.y + CAPTION_MM, content.width, content.height - CAPTION_MM)
    # the map comes first, as it says how the tiles are joined
    pages: list[Page] = [MapPage(tuple(tiles))]
    for copy in range(1, copies + 1):
        pages += [TilePage(tile, window_area.centre(tile.area.width, tile.area.height), copy) for tile in tiles]
    return pages
