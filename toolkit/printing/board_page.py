"""A board or a ring to the bytes of a print-ready PDF, at true size, on one page or tiled over several."""

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

from toolkit import __version__
from toolkit.errors import ToolkitError
from toolkit.printing.board_art import draw_table_sheet, measure_sheet
from toolkit.printing.canvas import POINTS_PER_MM, describe_document, open_canvas
from toolkit.printing.frame import MARK_MM, PageFrame, Rect
from toolkit.printing.label import PatchLabel, draw_header
from toolkit.printing.marks import draw_check_bars, draw_crop_marks
from toolkit.printing.page_map import draw_map
from toolkit.printing.paper import Paper
from toolkit.printing.plan import MapPage, Page, TilePage, count_tiles, lay_out, turn_frames
from toolkit.printing.text import draw_text, register_fonts
from toolkit.printing.tile_page import count_things, draw_tile
from toolkit.rig.board import DEFAULT_BOARD, MARKER_SHARE, BoardSpec, Sheet

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

MOST_SHEET_PAGES = 40
"""More tiles than that are not joined to a tenth of a millimetre by anyone."""
SMALLEST_SQUARE_MM = 12.0
"""Chosen on its own; smaller ones are hard to read on a phone's photograph of a whole object."""
STAND_IT = (
    "Lay it flat. Stand the object on its middle, the front to the edge marked FRONT; the camera is found from the "
    "pattern round it."
)


@dataclass(frozen=True)
class SheetPlan:
    """Every page of a sheet's file: what all have in common, and the pages in the order of printing."""

    frame: PageFrame
    pages: tuple[Page, ...]

    @property
    def tiles(self) -> tuple[int, int]:
        """Rows and columns of pages, (1, 1) where the sheet fits on one."""
        return count_tiles(self.pages)


@dataclass(frozen=True)
class SheetDocument:
    """A finished PDF and how it is laid out."""

    content: bytes
    plan: SheetPlan


def plan_sheet(spec: Sheet, paper: Paper, orientation: str = "auto") -> SheetPlan:
    """Lay out a board or a ring on as few pages as can be.

    Raises:
        ToolkitError: it would take more than `MOST_SHEET_PAGES`.
    """
    width, height = measure_sheet(spec)
    plans = [SheetPlan(frame, tuple(lay_out(frame, width, height))) for frame in turn_frames(paper, orientation)]
    plan = min(plans, key=lambda plan: len(plan.pages))
    if len(plan.pages) > MOST_SHEET_PAGES:
        smaller = "fewer or smaller squares" if isinstance(spec, BoardSpec) else "a smaller ring"
        raise ToolkitError(
            f"a sheet of {width:.0f} × {height:.0f} mm needs {len(plan.pages)} pages of {paper.name}: expected at most "
            f"{MOST_SHEET_PAGES}; choose {smaller} or a larger --paper"
        )
    return plan


def choose_board(
    paper: Paper, orientation: str = "auto", squares: tuple[int, int] | None = None, square_mm: float | None = None,
    marker_mm: float | None = None,
) -> BoardSpec:  # fmt: skip
    """The board that options ask for; what they leave open is chosen.

    Args:
        paper, orientation: what it is printed on.
        squares: columns and rows; None: the default board's.
        square_mm: None: the default board's, or, with `squares`, the largest whole number up to it for one page, where
            that is at least `SMALLEST_SQUARE_MM`.
        marker_mm: None: three quarters of the square.

    Raises:
        ToolkitError: as `BoardSpec` says.
    """
    columns, rows = squares or (DEFAULT_BOARD.columns, DEFAULT_BOARD.rows)
    side = DEFAULT_BOARD.square_mm if square_mm is None else square_mm
    if squares is not None and square_mm is None:
        for smaller in range(int(side), int(SMALLEST_SQUARE_MM) - 1, -1):
            board = BoardSpec(columns, rows, float(smaller), smaller * MARKER_SHARE)
            frames = turn_frames(paper, orientation)
            if any(len(lay_out(frame, *measure_sheet(board))) == 1 for frame in frames):
                side = float(smaller)
                break
    return BoardSpec(columns, rows, side, round(side * MARKER_SHARE, 2) if marker_mm is None else marker_mm)


def build_sheet_pdf(spec: Sheet, paper: Paper, orientation: str = "auto") -> SheetDocument:
    """A board or a ring as PDF; the same spec, paper and toolkit version give the same bytes.

    Raises:
        ToolkitError: it is too large to be tiled sensibly.
    """
    plan = plan_sheet(spec, paper, orientation)
    label = label_sheet(spec)
    register_fonts()
    buffer = BytesIO()
    canvas = open_canvas(buffer, plan.frame.paper)
    keywords = {"kind": "board" if isinstance(spec, BoardSpec) else "ring", "dictionary": spec.dictionary}
    describe_document(canvas, f"{label.title}, {label.size}", spec.describe(), keywords)
    for number, page in enumerate(plan.pages, start=1):
        _draw_page(canvas, plan, page, spec, label, number)
        canvas.showPage()
    canvas.save()
    return SheetDocument(buffer.getvalue(), plan)


def label_sheet(spec: Sheet) -> PatchLabel:
    """The words at the top of every page of a sheet."""
    if isinstance(spec, BoardSpec):
        width, height = spec.size_mm
        size = (
            f"{width:.1f} × {height:.1f} mm   ({spec.columns} × {spec.rows} squares of {spec.square_mm:g} mm, markers "
            f"{spec.marker_mm:g} mm)"
        )
        kind = "ChArUco, OpenCV's current pattern"
    else:
        size = (
            f"{spec.inner_mm:.1f} mm inside, {spec.outer_mm:.1f} mm outside   ({spec.count} markers of "
            f"{spec.marker_mm:g} mm)"
        )
        kind = "ArUco markers"
    first, last = spec.marker_ids[0], spec.marker_ids[-1]
    origin = f"{kind}, {spec.dictionary}, numbers {first} to {last}   ·   toolkit {__version__}"
    return PatchLabel("camera board" if isinstance(spec, BoardSpec) else "turntable ring", size, origin)


def _draw_page(canvas: "Canvas", plan: SheetPlan, page: Page, spec: Sheet, label: PatchLabel, number: int) -> None:
    frame = plan.frame

    def draw_sheet(canvas: "Canvas") -> None:
        draw_table_sheet(canvas, spec)

    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    which = f"{frame.paper.name} {frame.paper.orientation}, page {number} of {len(plan.pages)}"
    if isinstance(page, MapPage):
        rows, columns = plan.tiles
        which = f"{count_things(rows, 'row')} × {count_things(columns, 'column')}, {which}"
        draw_map(canvas, frame.content, page, draw_sheet)
    elif isinstance(page, TilePage):
        which = f"tile {page.tile.name}, {which}"
        draw_tile(canvas, page, draw_sheet)
        _draw_caption(canvas, page.window, page.tile.name)
    else:
        (cut,) = page.cuts
        canvas.saveState()
        canvas.translate(cut.x, cut.y)
        draw_sheet(canvas)
        canvas.restoreState()
        draw_crop_marks(canvas, cut)
    draw_header(canvas, frame.header, label, which, STAND_IT)
    draw_check_bars(canvas, frame)


def _draw_caption(canvas: "Canvas", window: Rect, words: str) -> None:
    draw_text(canvas, words, window.x + window.width / 2, window.y - MARK_MM - 2.6, 2.4, window.width, align="centre")
