"""Which page holds what: copies packed side by side, or one copy spread over several pages."""

import math
from dataclasses import dataclass

from toolkit.errors import ToolkitError
from toolkit.printing.frame import CAPTION_MM, MARK_MM, PageFrame, Rect
from toolkit.printing.settings import PrintSettings
from toolkit.printing.tiling import Tile, tile_sheet

MOST_PAGES = 3000
NARROWEST_CELL_MM = 24.0
"""The caption under a very small patch is wider than the patch."""


@dataclass(frozen=True)
class CopiesPage:
    """A page of whole copies: each one's cut line, in the page's millimetres."""

    cuts: tuple[Rect, ...]


@dataclass(frozen=True)
class TilePage:
    """A page with a part of one copy; `window` is where on the page the tile lies."""

    tile: Tile
    window: Rect
    copy: int


@dataclass(frozen=True)
class MapPage:
    """The first page of a tiled patch: how its tiles go together."""

    tiles: tuple[Tile, ...]


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
    pages: tuple[CopiesPage | TilePage | MapPage, ...]

    @property
    def cut_mm(self) -> float:
        """Side of the sheet that is cut out: patch and white margin."""
        return self.side_mm + 2 * self.margin_mm

    @property
    def tiles(self) -> tuple[int, int]:
        """Rows and columns that one copy is split into, (1, 1) where it fits on a page."""
        first = self.pages[0]
        return (first.tiles[0].rows, first.tiles[0].columns) if isinstance(first, MapPage) else (1, 1)


def plan_pages(side_mm: float, settings: PrintSettings) -> PrintPlan:
    """Lay out a patch of that side; `auto` turns the paper where that saves pages.

    Raises:
        ToolkitError: it would take more than 3000 pages.
    """
    turns = [settings.orientation]
    if settings.orientation == "auto":
        turns = sorted(["portrait", "landscape"], key=lambda turn: turn != settings.paper.orientation)
    plans = [_plan_on(PageFrame(settings.paper.turn(turn)), side_mm, settings) for turn in turns]
    return min(plans, key=lambda plan: len(plan.pages))


def _plan_on(frame: PageFrame, side_mm: float, settings: PrintSettings) -> PrintPlan:
    cut_mm = side_mm + 2 * settings.margin_mm
    pages = _pack_copies(frame.content, cut_mm, settings.copies) or _spread_tiles(frame, cut_mm, settings.copies)
    return PrintPlan(frame, side_mm, settings.margin_mm, tuple(pages))


def _pack_copies(content: Rect, cut_mm: float, copies: int) -> list[CopiesPage | TilePage | MapPage]:
    """As many copies on a page as fit, the group centred; none where not even one fits."""
    cell_width = max(cut_mm + 2 * MARK_MM, NARROWEST_CELL_MM)
    cell_height = cut_mm + 2 * MARK_MM + CAPTION_MM
    most_columns, most_rows = int(content.width // cell_width), int(content.height // cell_height)
    if not most_columns * most_rows:
        return []
    columns = min(most_columns, copies)
    rows = min(most_rows, math.ceil(copies / columns))
    group = content.centre(columns * cell_width, rows * cell_height)
    cuts = [
        Rect(
            group.x + column * cell_width + (cell_width - cut_mm) / 2,
            group.top - row * cell_height - MARK_MM - cut_mm,
            cut_mm,
            cut_mm,
        )
        for row in range(rows)
        for column in range(columns)
    ]
    return [CopiesPage(tuple(cuts[: copies - done])) for done in range(0, copies, len(cuts))]


def _spread_tiles(frame: PageFrame, cut_mm: float, copies: int) -> list[CopiesPage | TilePage | MapPage]:
    content = frame.content
    tiles = tile_sheet(cut_mm, content.width - 2 * MARK_MM, content.height - 2 * MARK_MM - CAPTION_MM)
    if len(tiles) * copies > MOST_PAGES:
        raise ToolkitError(
            f"{cut_mm:.0f} mm on {frame.paper.name} needs {len(tiles) * copies} pages: expected at most {MOST_PAGES}; "
            "choose a larger --paper, a smaller size or fewer --copies"
        )
    window_area = Rect(content.x, content.y + CAPTION_MM, content.width, content.height - CAPTION_MM)
    pages: list[CopiesPage | TilePage | MapPage] = [MapPage(tuple(tiles))]
    for copy in range(1, copies + 1):
        pages += [TilePage(tile, window_area.centre(tile.area.width, tile.area.height), copy) for tile in tiles]
    return pages
