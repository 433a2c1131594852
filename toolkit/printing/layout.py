"""How large a patch is printed, and which page holds what."""

import math
from dataclasses import dataclass, replace
from typing import get_args

from toolkit.core.errors import FieldError, one_of
from toolkit.objects.printed_size import BASE_DPI, MM_PER_INCH, SCALE, printed_size_mm
from toolkit.printing.colour_strip import StripPlace, reserve_strip
from toolkit.printing.page import CAPTION_MM, MARK_MM, PageFrame, Paper, Rect, Tile, tile_sheet
from toolkit.printing.settings import PrintSettings

SMALLEST_SIDE_MM = 1.0
LARGEST_SIDE_MM = 5000.0


def measure_side_mm(n_px: int, settings: PrintSettings) -> float:
    """Side of an n-pixel patch on paper, millimetres, without its white margin.

    Raises:
        ToolkitError: the side is under 1 mm or over 5 m.
    """
    scale = SCALE if settings.scale_percent is None else settings.scale_percent / 100
    side_mm = settings.size_mm or printed_size_mm(n_px, settings.dpi or BASE_DPI, scale)
    if not SMALLEST_SIDE_MM <= side_mm <= LARGEST_SIDE_MM:
        raise FieldError(
            f"the patch of {n_px} px would be {side_mm:.4g} mm wide: expected {SMALLEST_SIDE_MM:g} to "
            f"{LARGEST_SIDE_MM:g} mm; change {{scale_percent}}, {{dpi}} or {{size_mm}}",
            {},
        )
    return side_mm


def effective_percent(n_px: int, side_mm: float, dpi: float) -> float:
    """The scale that gives this side: what the label states, whichever option set the size."""
    return 100 * side_mm / (n_px / dpi * MM_PER_INCH)


MOST_PAGES = 3000
NARROWEST_CELL_MM = 24.0
"""The caption under a very small patch is wider than the patch."""


@dataclass(frozen=True)
class CopiesPage:
    """A page of whole copies: each one's cut line, in the page's millimetres, and the colour strip where it fits."""

    cuts: tuple[Rect, ...]
    strip: StripPlace | None = None


@dataclass(frozen=True)
class TilePage:
    """A page with a part of one copy; `window` is where on the page the tile lies."""

    tile: Tile
    window: Rect
    copy: int


@dataclass(frozen=True)
class MapPage:
    """The first page of a tiled sheet: how its tiles go together."""

    tiles: tuple[Tile, ...]


Page = CopiesPage | TilePage | MapPage


def count_tiles(pages: tuple[Page, ...]) -> tuple[int, int]:
    """Rows and columns that one copy is split into, (1, 1) where it fits on a page."""
    first = pages[0]
    return (first.tiles[0].rows, first.tiles[0].columns) if isinstance(first, MapPage) else (1, 1)


@dataclass(frozen=True)
class PrintPlan:
    """Every page of one patch's file.

    Attributes:
        frame: what all its pages share.
        side_mm: side of the patch.
        margin_mm: white paper round it.
        pages: in the order of printing.
    """

    frame: PageFrame
    side_mm: float
    margin_mm: float
    pages: tuple[Page, ...]

    @property
    def cut_mm(self) -> float:
        """Side of the sheet that is cut out: patch and white margin."""
        return self.side_mm + 2 * self.margin_mm

    @property
    def tiles(self) -> tuple[int, int]:
        """Rows and columns that one copy is split into, (1, 1) where it fits on a page."""
        return count_tiles(self.pages)

    @property
    def has_strip(self) -> bool:
        """Whether the colour strip is on a page."""
        return any(isinstance(page, CopiesPage) and page.strip is not None for page in self.pages)


def turn_frames(paper: Paper, orientation: str) -> list[PageFrame]:
    """The page as `orientation` says; for `auto` both ways round, the paper's own first.

    Raises:
        ToolkitError: there is no such orientation.
    """
    known = get_args(PrintSettings.model_fields["orientation"].annotation)
    if orientation not in known:
        raise one_of("orientation", orientation, list(known))
    turns = [orientation]
    if orientation == "auto":
        turns = sorted(["portrait", "landscape"], key=lambda turn: turn != paper.orientation)
    return [PageFrame(paper.turn(turn)) for turn in turns]


def plan_pages(side_mm: float, settings: PrintSettings) -> PrintPlan:
    """Lay out a patch of that side; `auto` turns the paper where that saves pages.

    The colour strip goes beside the patch where that takes no further page.

    Raises:
        ToolkitError: it would take more than 3000 pages.
    """
    cut_mm = side_mm + 2 * settings.margin_mm
    frames = turn_frames(settings.paper, settings.orientation)
    layouts = [(frame, lay_out(frame, cut_mm, cut_mm, settings.copies)) for frame in frames]
    frame, pages = min(layouts, key=lambda layout: len(layout[1]))
    pages = _add_strip(frame.content, cut_mm, settings.copies, pages)
    return PrintPlan(frame, side_mm, settings.margin_mm, tuple(pages))


def lay_out(frame: PageFrame, cut_width: float, cut_height: float, copies: int = 1) -> list[Page]:
    """Pages of whole copies of a sheet, or, where it is larger than a page, a map and tiles.

    Raises:
        ToolkitError: it would take more than 3000 pages.
    """
    packed = _pack_copies(frame.content, cut_width, cut_height, copies)
    return [*packed] or _spread_tiles(frame, cut_width, cut_height, copies)


def _add_strip(content: Rect, cut_mm: float, copies: int, pages: list[Page]) -> list[Page]:
    """The same copies on as many pages with the strip on each; the pages as they are where it has no room."""
    if not isinstance(pages[0], CopiesPage):
        return pages
    for place, rest in reserve_strip(content):
        packed = _pack_copies(rest, cut_mm, cut_mm, copies)
        if packed and len(packed) == len(pages):
            return [replace(page, strip=place) for page in packed]
    return pages


def _pack_copies(content: Rect, cut_width: float, cut_height: float, copies: int) -> list[CopiesPage]:
    """As many copies on a page as fit, the group centred; none where not even one fits."""
    cell_width = max(cut_width + 2 * MARK_MM, NARROWEST_CELL_MM)
    cell_height = cut_height + 2 * MARK_MM + CAPTION_MM
    most_columns, most_rows = int(content.width // cell_width), int(content.height // cell_height)
    if not most_columns * most_rows:
        return []
    columns = min(most_columns, copies)
    rows = min(most_rows, math.ceil(copies / columns))
    group = content.centre(columns * cell_width, rows * cell_height)
    cuts = [
        Rect(
            group.x + column * cell_width + (cell_width - cut_width) / 2,
            group.top - row * cell_height - MARK_MM - cut_height,
            cut_width,
            cut_height,
        )
        for row in range(rows)
        for column in range(columns)
    ]
    return [CopiesPage(tuple(cuts[: copies - done])) for done in range(0, copies, len(cuts))]


def _spread_tiles(frame: PageFrame, cut_width: float, cut_height: float, copies: int) -> list[Page]:
    content = frame.content
    most_width, most_height = content.width - 2 * MARK_MM, content.height - 2 * MARK_MM - CAPTION_MM
    tiles = tile_sheet(cut_width, most_width, most_height, cut_height)
    if len(tiles) * copies > MOST_PAGES:
        raise FieldError(
            f"{max(cut_width, cut_height):.0f} mm on {frame.paper.name} needs {len(tiles) * copies} pages: expected at "
            f"most {MOST_PAGES}; choose a larger {{paper}}, a smaller size or fewer {{copies}}",
            {},
        )
    window_area = Rect(content.x, content.y + CAPTION_MM, content.width, content.height - CAPTION_MM)
    pages: list[Page] = [MapPage(tuple(tiles))]
    for copy in range(1, copies + 1):
        pages += [TilePage(tile, window_area.centre(tile.area.width, tile.area.height), copy) for tile in tiles]
    return pages
