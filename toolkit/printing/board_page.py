"""A board or a ring to the bytes of a print-ready PDF, at true size, on one page or tiled over several."""

import math
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from toolkit import __version__
from toolkit.core.errors import FieldError
from toolkit.printing.canvas import (
    BOLD,
    POINTS_PER_MM,
    describe_document,
    draw_text,
    measure_text_mm,
    open_canvas,
    register_fonts,
)
from toolkit.printing.document import count_things, draw_map, draw_tile
from toolkit.printing.layout import MapPage, Page, TilePage, count_tiles, lay_out, turn_frames
from toolkit.printing.marks import PatchLabel, draw_check_bars, draw_crop_marks, draw_header
from toolkit.printing.page import MARK_MM, PageFrame, Paper, Rect
from toolkit.rig.board import DEFAULT_BOARD, MARKER_SHARE, Board, CharucoBoard, MarkerRing
from toolkit.rig.markers import black_rects, marker_modules

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

EDGE_MM = 3.0
"""White paper round a board; the colours of the table then never touch a square."""
FRONT_EDGE_MM = 8.0
"""The lower edge holds the word FRONT and the spec."""
TICK_MM = 2.0
LINE_MM = 0.15
FRONT = "FRONT"
FRONT_SIZE_MM = 4.0


def measure_board(spec: Board) -> tuple[float, float]:
    """Width and height of what is cut out."""
    width, height = spec.size_mm
    if isinstance(spec, MarkerRing):
        return width, height
    return width + 2 * EDGE_MM, height + EDGE_MM + FRONT_EDGE_MM


def draw_board(canvas: "Canvas", spec: Board) -> None:
    """Draw a board or a ring at full size; its ink is the printer's own black, not a mixture of colours."""
    canvas.saveState()
    canvas.setFillGray(0)
    canvas.setStrokeGray(0)
    if isinstance(spec, CharucoBoard):
        canvas.translate(EDGE_MM, FRONT_EDGE_MM)
        canvas.setFillGray(1 - spec.ink_percent / 100)
        _fill(canvas, spec.black_squares(), spec.size_mm[1])
        _draw_markers(canvas, spec)
        canvas.setFillGray(0)
        _write_on_board(canvas, spec)
    elif isinstance(spec, MarkerRing):
        canvas.setFillGray(1 - spec.ink_percent / 100)
        _draw_markers(canvas, spec)
        canvas.setFillGray(0)
        _write_in_ring(canvas, spec)
    canvas.restoreState()


def _fill(canvas: "Canvas", rects: np.ndarray, top: float) -> None:
    """Fill (k, 4) rectangles, counted downwards from `top`, as one shape: no seams where they touch."""
    path = canvas.beginPath()
    for left, upper, right, lower in rects.tolist():
        path.rect(left, top - lower, right - left, lower - upper)
    canvas.drawPath(path, stroke=0, fill=1, fillMode=1)


def _draw_markers(canvas: "Canvas", spec: Board) -> None:
    half = spec.marker_mm / 2
    for marker_id, middle, turn in spec.place_markers():
        canvas.saveState()
        canvas.translate(middle[0], spec.size_mm[1] - middle[1])
        if turn:
            canvas.rotate(math.degrees(turn))
        _fill(canvas, black_rects(marker_modules(spec.dictionary, marker_id)) * spec.marker_mm - half, 0)
        canvas.restoreState()


def _draw_front(canvas: "Canvas", x: float, baseline: float) -> float:
    """The word FRONT about x between two arrows that point down the page; returns its half width."""
    half = measure_text_mm(FRONT, BOLD, FRONT_SIZE_MM) / 2
    draw_text(canvas, FRONT, x, baseline, FRONT_SIZE_MM, room_mm=4 * half, font=BOLD, align="centre")
    for side in (-1, 1):
        at, head = x + side * (half + 3), canvas.beginPath()
        head.moveTo(at - 1.6, baseline + 3)
        head.lineTo(at + 1.6, baseline + 3)
        head.lineTo(at, baseline - 0.2)
        head.close()
        canvas.drawPath(head, stroke=0, fill=1)
    return half + 6


def _write_on_board(canvas: "Canvas", spec: CharucoBoard) -> None:
    """Below the squares the front and the spec; a short line in the middle of every edge, to stand the object by."""
    width, height = spec.size_mm
    canvas.setLineWidth(2 * LINE_MM)
    gap = (EDGE_MM - TICK_MM) / 2
    for y in (-gap - TICK_MM, height + gap):
        canvas.line(width / 2, y, width / 2, y + TICK_MM)
    for x in (-gap - TICK_MM, width + gap):
        canvas.line(x, height / 2, x + TICK_MM, height / 2)
    taken = _draw_front(canvas, width / 2, -FRONT_EDGE_MM + 1.2)
    draw_text(canvas, spec.describe(), 0, -FRONT_EDGE_MM + 1.4, 2.2, room_mm=width / 2 - taken - 2)


def _write_in_ring(canvas: "Canvas", spec: MarkerRing) -> None:
    """In the free disc its two axes, the front and the spec; round it all the line to cut along."""
    middle, radius = spec.outer_mm / 2, spec.inner_mm / 2
    canvas.setLineWidth(LINE_MM)
    canvas.setStrokeGray(0.6)
    canvas.circle(middle, middle, middle - LINE_MM, stroke=1, fill=0)
    canvas.circle(middle, middle, radius - 1, stroke=1, fill=0)
    canvas.line(middle - radius + 1, middle, middle + radius - 1, middle)
    canvas.line(middle, middle - radius + 1 + 2 * FRONT_SIZE_MM, middle, middle + radius - 1)
    front = middle - radius + FRONT_SIZE_MM
    _draw_front(canvas, middle, front)
    canvas.setFillGray(0)
    draw_text(canvas, spec.describe(), middle + 3, middle - 4, 2.2, room_mm=radius - 8)


MOST_SHEET_PAGES = 40
"""More tiles than that are not joined to a tenth of a millimetre by anyone."""
SMALLEST_SQUARE_MM = 12.0
"""Chosen on its own; smaller ones are hard to read on a phone's photograph of a whole object."""
STAND_IT = (
    "Lay it flat. Stand the object on its middle, the front to the edge marked FRONT; the camera is found from the "
    "pattern round it."
)


@dataclass(frozen=True)
class BoardPages:
    """Every page of a sheet's file: what all have in common, and the pages in the order of printing."""

    frame: PageFrame
    pages: tuple[Page, ...]

    @property
    def tiles(self) -> tuple[int, int]:
        """Rows and columns of pages, (1, 1) where the sheet fits on one."""
        return count_tiles(self.pages)


@dataclass(frozen=True)
class BoardDocument:
    """A finished PDF and how it is laid out."""

    content: bytes
    plan: BoardPages


def plan_board_pages(spec: Board, paper: Paper, orientation: str = "auto") -> BoardPages:
    """Lay out a board or a ring on as few pages as can be.

    Raises:
        ToolkitError: it would take more than `MOST_SHEET_PAGES`.
    """
    width, height = measure_board(spec)
    plans = [BoardPages(frame, tuple(lay_out(frame, width, height))) for frame in turn_frames(paper, orientation)]
    plan = min(plans, key=lambda plan: len(plan.pages))
    if len(plan.pages) > MOST_SHEET_PAGES:
        smaller = "fewer or smaller squares" if isinstance(spec, CharucoBoard) else "a smaller ring"
        raise FieldError(
            f"a sheet of {width:.0f} × {height:.0f} mm needs {len(plan.pages)} pages of {paper.name}: expected at most "
            f"{MOST_SHEET_PAGES}; choose {smaller} or a larger {{paper}}",
            {},
        )
    return plan


def choose_board(
    paper: Paper, orientation: str = "auto", squares: tuple[int, int] | None = None, square_mm: float | None = None,
    marker_mm: float | None = None,
) -> CharucoBoard:  # fmt: skip
    """The board that options ask for; what they leave open is chosen.

    Args:
        paper, orientation: what it is printed on.
        squares: columns and rows; None: the default board's.
        square_mm: None: the default board's, or, with `squares`, the largest whole number up to it for one page, where
            that is at least `SMALLEST_SQUARE_MM`.
        marker_mm: None: three quarters of the square.

    Raises:
        ToolkitError: as `CharucoBoard` says.
    """
    columns, rows = squares or (DEFAULT_BOARD.columns, DEFAULT_BOARD.rows)
    side = DEFAULT_BOARD.square_mm if square_mm is None else square_mm
    if squares is not None and square_mm is None:
        for smaller in range(int(side), int(SMALLEST_SQUARE_MM) - 1, -1):
            board = CharucoBoard(columns, rows, float(smaller), smaller * MARKER_SHARE)
            frames = turn_frames(paper, orientation)
            if any(len(lay_out(frame, *measure_board(board))) == 1 for frame in frames):
                side = float(smaller)
                break
    return CharucoBoard(columns, rows, side, round(side * MARKER_SHARE, 2) if marker_mm is None else marker_mm)


def build_board_pdf(spec: Board, paper: Paper, orientation: str = "auto") -> BoardDocument:
    """A board or a ring as PDF; the same spec, paper and toolkit version give the same bytes.

    Raises:
        ToolkitError: it is too large to be tiled sensibly.
    """
    plan = plan_board_pages(spec, paper, orientation)
    label = label_board(spec)
    register_fonts()
    buffer = BytesIO()
    canvas = open_canvas(buffer, plan.frame.paper)
    keywords = {"kind": "board" if isinstance(spec, CharucoBoard) else "ring", "dictionary": spec.dictionary}
    describe_document(canvas, f"{label.title}, {label.size}", spec.describe(), keywords)
    for number, page in enumerate(plan.pages, start=1):
        _draw_page(canvas, plan, page, spec, label, number=number)
        canvas.showPage()
    canvas.save()
    return BoardDocument(buffer.getvalue(), plan)


def label_board(spec: Board) -> PatchLabel:
    """The words at the top of every page of a sheet."""
    if isinstance(spec, CharucoBoard):
        width, height = spec.size_mm
        size = (
            f"{width:.1f} × {height:.1f} mm   ({spec.columns} × {spec.rows} squares of {spec.square_mm:g} mm, markers "
            f"{spec.marker_mm:g} mm)"
        )
        kind = "ChArUco, OpenCV's current pattern"
    elif isinstance(spec, MarkerRing):
        size = (
            f"{spec.inner_mm:.1f} mm inside, {spec.outer_mm:.1f} mm outside   ({spec.count} markers of "
            f"{spec.marker_mm:g} mm)"
        )
        kind = "ArUco markers"
    first, last = spec.marker_ids[0], spec.marker_ids[-1]
    origin = f"{kind}, {spec.dictionary}, numbers {first} to {last}   ·   toolkit {__version__}"
    return PatchLabel("camera board" if isinstance(spec, CharucoBoard) else "turntable ring", size, origin)


def _draw_page(canvas: "Canvas", plan: BoardPages, page: Page, spec: Board, label: PatchLabel, number: int) -> None:
    frame = plan.frame

    def draw_sheet(canvas: "Canvas") -> None:
        draw_board(canvas, spec)

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
    draw_text(
        canvas, words, window.x + window.width / 2, window.y - MARK_MM - 2.6, 2.4, room_mm=window.width, align="centre"
    )
