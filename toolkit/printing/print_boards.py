"""A board, a ring or the colour strip, on a single page or tiled over several, at true size."""

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from toolkit import __version__
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import write_bytes
from toolkit.core.text import count_of
from toolkit.core.workspace import Workspace
from toolkit.printing import PrintSettings, SheetSettings
from toolkit.printing.canvas import BOLD, Pdf, measure_text_mm
from toolkit.printing.marks import (
    STRIP,
    PatchLabel,
    SheetDrawing,
    draw_crop_marks,
    draw_frame,
    draw_pages,
    draw_strip,
    reserve_strip,
    strip_area,
)
from toolkit.printing.page import MARK_MM, CopiesPage, PagePlan, Paper, StripPlace, plan_sheet, turn_frames
from toolkit.printing.print_patches import name_pdf, shorten
from toolkit.rig.board import DEFAULT_BOARD, MARKER_SHARE, Board, CharucoBoard
from toolkit.rig.board_file import DEFAULT_RING, MarkerRing, board_file, choose_ring, read_board, write_board
from toolkit.rig.markers import PALE_PERCENT, black_rects, marker_modules

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


def draw_board(pdf: Pdf, spec: Board) -> None:
    """Draw a board or a ring at full size; its ink is the printer's own black, not a mixture of colours."""
    pdf.saveState()
    pdf.grey(0)
    # the board lies inside the sheet's edges; the front edge is wider, for its words
    if isinstance(spec, CharucoBoard):
        pdf.translate(EDGE_MM, FRONT_EDGE_MM)
    # squares and markers in the grey of the spec, the words after them in black
    pdf.setFillGray(1 - spec.ink_percent / 100)
    if isinstance(spec, CharucoBoard):
        pdf.rects(spec.black_squares(), spec.size_mm[1])
    # the board counts downwards, the page upwards
    for marker_id, middle, turn in spec.place_markers():
        with pdf.moved(middle[0], spec.size_mm[1] - middle[1], math.degrees(turn) if turn else None):
            # modules are drawn about the middle, since a ring turns each marker by its own angle
            modules = black_rects(marker_modules(spec.dictionary, marker_id))
            pdf.rects(modules * spec.marker_mm - spec.marker_mm / 2, 0)
    pdf.setFillGray(0)
    if isinstance(spec, CharucoBoard):
        _write_on_board(pdf, spec)
    elif isinstance(spec, MarkerRing):
        _write_in_ring(pdf, spec)
    pdf.restoreState()


def _draw_front(pdf: Pdf, x: float, baseline: float) -> float:
    """The word FRONT about x between two arrows that point down the page; returns its half width."""
    half = measure_text_mm(FRONT, BOLD, FRONT_SIZE_MM) / 2
    pdf.text(FRONT, x, baseline, FRONT_SIZE_MM, room_mm=4 * half, font=BOLD, align="centre")
    for side in (-1, 1):
        at = x + side * (half + 3)
        pdf.shape([(at - 1.6, baseline + 3), (at + 1.6, baseline + 3), (at, baseline - 0.2)])
    return half + 6


def _write_on_board(pdf: Pdf, spec: CharucoBoard) -> None:
    """Write the front and the spec below the squares, and a short line in the middle of every edge."""
    width, height = spec.size_mm
    pdf.setLineWidth(2 * LINE_MM)
    gap = (EDGE_MM - TICK_MM) / 2
    for y in (-gap - TICK_MM, height + gap):
        pdf.line(width / 2, y, width / 2, y + TICK_MM)
    for x in (-gap - TICK_MM, width + gap):
        pdf.line(x, height / 2, x + TICK_MM, height / 2)
    taken = _draw_front(pdf, width / 2, -FRONT_EDGE_MM + 1.2)
    pdf.text(spec.describe(), 0, -FRONT_EDGE_MM + 1.4, 2.2, room_mm=width / 2 - taken - 2)


def _write_in_ring(pdf: Pdf, spec: MarkerRing) -> None:
    """Draw axes, front and spec in the free disc, and the line to cut along."""
    middle, radius = spec.outer_mm / 2, spec.inner_mm / 2
    # the outer circle is cut along, the inner circle bounds the disc that the object stands on
    pdf.setLineWidth(LINE_MM)
    pdf.setStrokeGray(0.6)
    pdf.circle(middle, middle, middle - LINE_MM, stroke=1, fill=0)
    pdf.circle(middle, middle, radius - 1, stroke=1, fill=0)
    pdf.line(middle - radius + 1, middle, middle + radius - 1, middle)
    # the line down ends above FRONT
    pdf.line(middle, middle - radius + 1 + 2 * FRONT_SIZE_MM, middle, middle + radius - 1)
    front = middle - radius + FRONT_SIZE_MM
    # the words at the front edge, as on a board
    _draw_front(pdf, middle, front)
    pdf.setFillGray(0)
    pdf.text(spec.describe(), middle + 3, middle - 4, 2.2, room_mm=radius - 8)


MOST_SHEET_PAGES = 40
"""More tiles than that are not joined to a tenth of a millimetre by anyone."""
SMALLEST_SQUARE_MM = 12.0
"""Least side that is chosen automatically: smaller squares are hard to detect in a phone's photograph of an object."""
STAND_IT = "Lay it flat. Stand the object on its middle, the front to the edge marked FRONT."


@dataclass(frozen=True)
class BoardDocument:
    """A finished PDF and how it is laid out."""

    content: bytes
    plan: PagePlan


def plan_board_pages(spec: Board, paper: Paper, orientation: str = "auto") -> PagePlan:
    """Lay out a board or a ring on as few pages as can be.

    Raises:
        ToolkitError: it would take more than `MOST_SHEET_PAGES`.
    """
    width, height = measure_board(spec)
    plan = plan_sheet(paper, orientation, width, height)
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
    """Return the board that options ask for; None is chosen.

    Args:
        paper, orientation: page that it is printed on.
        squares: columns and rows; None: the default board's.
        square_mm: None: the default board's; with `squares`, a smaller whole number, from `SMALLEST_SQUARE_MM`, if the
            board then fits on a page.
        marker_mm: None: three quarters of the square.

    Raises:
        ToolkitError: as `CharucoBoard`.
    """
    # what options leave open comes from the default board
    columns, rows = squares or (DEFAULT_BOARD.columns, DEFAULT_BOARD.rows)
    side = DEFAULT_BOARD.square_mm if square_mm is None else square_mm
    # whole millimetres, which a ruler checks; the default board may take several pages, your own only if it must
    if squares is not None and square_mm is None:
        for smaller in range(int(side), int(SMALLEST_SQUARE_MM) - 1, -1):
            board = CharucoBoard(columns, rows, float(smaller), smaller * MARKER_SHARE)
            if len(plan_sheet(paper, orientation, *measure_board(board)).pages) == 1:
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
    keywords = {"kind": "board" if isinstance(spec, CharucoBoard) else "ring", "dictionary": spec.dictionary}
    pdf = Pdf(plan.frame.paper, f"{label.title}, {label.size}", spec.describe(), keywords)

    def draw(x: float, y: float) -> None:
        with pdf.moved(x, y) if x or y else nullcontext():
            draw_board(pdf, spec)

    draw_pages(pdf, plan, SheetDrawing(label, STAND_IT, draw), 1, len(plan.pages))
    return BoardDocument(pdf.finish(), plan)


def label_board(spec: Board) -> PatchLabel:
    """Return the words at the top of every page of a sheet."""
    if isinstance(spec, CharucoBoard):
        title, kind, (width, height) = "camera board", "ChArUco, OpenCV's current pattern", spec.size_mm
        size, parts = f"{width:.1f} × {height:.1f} mm", f"{spec.columns} × {spec.rows} squares of {spec.square_mm:g} mm"
        parts += f", markers {spec.marker_mm:g} mm"
    elif isinstance(spec, MarkerRing):
        title, kind = "turntable ring", "ArUco markers"
        size = f"{spec.inner_mm:.1f} mm inside, {spec.outer_mm:.1f} mm outside"
        parts = f"{spec.count} markers of {spec.marker_mm:g} mm"
    first, last = spec.marker_ids[0], spec.marker_ids[-1]
    origin = f"{kind}, {spec.dictionary}, numbers {first} to {last}   ·   toolkit {__version__}"
    return PatchLabel(title, f"{size}   ({parts})", origin)


USE_IT = "Print it on the paper and with the settings of the patches. Photograph it beside the object."


def build_strip_pdf(paper: Paper, orientation: str = "auto") -> BoardDocument:
    """Draw the strip in the middle of a page, with check bars and, if they fit, crop marks."""
    # the strip needs a single page, so no plan chooses the orientation
    frame = turn_frames(paper, orientation)[0]
    width, height = STRIP.size_mm
    size = f"{width:g} × {height:g} mm"
    label = PatchLabel(
        "colour strip",
        f"{size}   ({len(STRIP.swatches)} cells of {STRIP.swatches[0].side_mm:g} mm)",
        f"sRGB, markers of {STRIP.dictionary}   ·   toolkit {__version__}",
    )
    # the strip's own place is at an edge, so it is moved to the middle of the content
    place, _ = next(reserve_strip(frame.content))
    area = strip_area(place)
    room = frame.content.centre(area.width, area.height)
    middle = StripPlace(place.x - area.x + room.x, place.y - area.y + room.y, place.upright)
    pdf = Pdf(frame.paper, f"colour strip, {size}", label.size, {"dictionary": STRIP.dictionary})
    with pdf.page():
        draw_strip(pdf, middle)
        # crop marks need room that a small page may not have; the strip is cut by its white border then
        if room.width + 2 * MARK_MM <= frame.content.width:
            draw_crop_marks(pdf, room)
        draw_frame(pdf, frame, label, frame.paper.describe(), USE_IT)
    return BoardDocument(pdf.finish(), PagePlan(frame, (CopiesPage((room,), middle),)))


@dataclass(frozen=True)
class PrintedBoard:
    """A PDF that was written.

    Attributes:
        kind: `board`, `ring`, `colour-strip`, `tags` or `picture`.
        file: the PDF.
        spec_file: spec for readers of photographs, of a board or ring.
        description: the pattern in words.
        size_mm: width and height of the pattern.
        paper, orientation, pages: paper and number of pages.
        tiles: rows and columns of pages, (1, 1) if it fits on a page.
        note: a remark for the user.
    """

    kind: str
    file: str
    spec_file: str | None
    description: str
    size_mm: tuple[float, float]
    paper: str
    orientation: str
    pages: int
    tiles: tuple[int, int]
    note: str | None = None

    def describe(self) -> str:
        """Return the file, size and number of pages in a line."""
        rows, columns = self.tiles
        width, height = self.size_mm
        tiles = "" if rows * columns == 1 else f" (a map and {rows} × {columns} tiles)"
        pages = f"{count_of(self.pages, 'page')} of {self.paper} {self.orientation}{tiles}"
        return f"{shorten(self.file)}: {self.description}; {width:.1f} × {height:.1f} mm, {pages}"


def write_print(
    kind: str, folder: Path, name: str, content: bytes, plans: Sequence[PagePlan], size_mm: tuple[float, float],
    description: str, note: str | None = None,
) -> PrintedBoard:  # fmt: skip
    """Write a PDF into a folder under that name, or to `folder` if that is a PDF; see `PrintedBoard`."""
    file, paper = name_pdf(folder, name), plans[0].frame.paper
    write_bytes(file, content)
    return PrintedBoard(
        kind=kind, file=str(file), spec_file=None, description=description,
        size_mm=(round(size_mm[0], 3), round(size_mm[1], 3)), paper=paper.name, orientation=paper.orientation,
        pages=sum(len(plan.pages) for plan in plans), tiles=plans[0].tiles, note=note,
    )  # fmt: skip


def print_board(
    workspace: Workspace, wanted: SheetSettings, page: PrintSettings | None = None, out: Path | None = None
) -> PrintedBoard:
    """Print a board, a ring or the colour strip.

    The spec of a board or ring is written to `rig/board.json`, where readers of photographs find it.

    Args:
        workspace: its `print/` is the default folder.
        wanted: the sheet.
        page: paper and orientation.
        out: a folder, or the PDF.

    Raises:
        ToolkitError: no sheet is named, a measure is out of range, the sheet is too large for its paper, or a file
            cannot be written.
    """
    if wanted.kind is None:
        raise FieldError("no sheet named: give {board}, {ring} or {colour_strip}", {})
    page = page or PrintSettings()
    spec = None if wanted.colour_strip else _choose_sheet(wanted, page)
    build = build_strip_pdf if spec is None else partial(build_board_pdf, spec)
    # the strip has no spec, as its readers know its measures
    document = build(page.paper, page.orientation)
    note = _compare(workspace, spec) if spec else None  # before the spec that it is compared with is replaced
    printed = write_print(
        wanted.kind, out or workspace.root / "print", f"{wanted.kind.replace('-', '_')}.pdf", document.content,
        [document.plan], spec.size_mm if spec else STRIP.size_mm,
        spec.describe() if spec else f"colour strip of {len(STRIP.swatches)} cells", note=note,
    )  # fmt: skip
    return replace(printed, spec_file=str(write_board(workspace, spec))) if spec else printed


def _choose_sheet(wanted: SheetSettings, page: PrintSettings) -> Board:
    spec: Board
    if wanted.ring:
        spec = choose_ring(DEFAULT_RING.inner_mm if wanted.ring_mm is None else wanted.ring_mm, wanted.marker_mm)
    else:
        spec = choose_board(page.paper, page.orientation, wanted.squares, wanted.square_mm, wanted.marker_mm)
    return replace(spec, ink_percent=PALE_PERCENT if wanted.ink_percent is None else wanted.ink_percent)


def _compare(workspace: Workspace, spec: Board) -> str | None:
    """Return a note if another sheet's spec, or a broken spec, is about to be replaced."""
    if not board_file(workspace).is_file():
        return None
    try:
        old = read_board(workspace)
    except ToolkitError as error:
        return f"replaced a spec that could not be read: {error}"
    if old == spec:
        return None
    return f"this sheet now gives the camera poses of photographs; before, it was a {old.describe()}"
