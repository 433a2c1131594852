"""A board, a ring or the colour strip from what is asked for to its PDF, and what there is to say of it."""

from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

from toolkit import __version__
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.printing.board_page import build_board_pdf, choose_board
from toolkit.printing.canvas import POINTS_PER_MM, describe_document, open_canvas, register_fonts
from toolkit.printing.colour_strip import STRIP, StripPlace, draw_strip, reserve_strip
from toolkit.printing.layout import turn_frames
from toolkit.printing.marks import PatchLabel, draw_check_bars, draw_crop_marks, draw_header
from toolkit.printing.page import MARK_MM, PageFrame, Paper
from toolkit.printing.print_patches import shorten
from toolkit.printing.settings import PrintSettings, SheetSettings
from toolkit.rig.board import DEFAULT_RING, Board, board_file, choose_ring, read_board, write_board
from toolkit.rig.markers import PALE_PERCENT

USE_IT = "Print it on the paper and with the settings of the patches; photograph it beside the object."


def build_strip_pdf(paper: Paper, orientation: str = "auto") -> tuple[bytes, PageFrame]:
    """The strip in the middle of a page, with check bars and, where they fit, crop marks, and the page's frame."""
    frame = turn_frames(paper, orientation)[0]
    register_fonts()
    buffer = BytesIO()
    canvas = open_canvas(buffer, frame.paper)
    width, height = STRIP.size_mm
    size = f"{width:g} × {height:g} mm"
    label = PatchLabel(
        "colour strip",
        f"{size}   ({len(STRIP.swatches)} cells of {STRIP.swatches[0].side_mm:g} mm)",
        f"sRGB, markers of {STRIP.dictionary}   ·   toolkit {__version__}",
    )
    describe_document(canvas, f"colour strip, {size}", label.size, {"dictionary": STRIP.dictionary})
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    place, _ = next(reserve_strip(frame.content))
    room = frame.content.centre(place.area.width, place.area.height)
    middle = StripPlace(place.x - place.area.x + room.x, place.y - place.area.y + room.y, place.upright)
    draw_strip(canvas, middle)
    if middle.area.width + 2 * MARK_MM <= frame.content.width:
        draw_crop_marks(canvas, middle.area)
    draw_header(canvas, frame.header, label, f"{frame.paper.name} {frame.paper.orientation}", USE_IT)
    draw_check_bars(canvas, frame)
    canvas.showPage()
    canvas.save()
    return buffer.getvalue(), frame


@dataclass(frozen=True)
class PrintedBoard:
    """A PDF that was written.

    Attributes:
        kind: `board`, `ring` or `colour-strip`.
        file: the PDF.
        spec_file: where readers of photographs find the spec; None for the strip, which is always the same.
        description: the spec in words.
        size_mm: width and height of the pattern.
        paper, orientation, pages: what it is printed on.
        tiles: rows and columns of pages, (1, 1) where it fits on one.
        note: what else there is to know.
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
        """One line: what was made, how large, on how many pages."""
        rows, columns = self.tiles
        width, height = self.size_mm
        tiles = "" if rows * columns == 1 else f" (a map and {rows} × {columns} tiles)"
        pages = f"{self.pages} page{'s' if self.pages > 1 else ''} of {self.paper} {self.orientation}{tiles}"
        return f"{shorten(self.file)}: {self.description}; {width:.1f} × {height:.1f} mm, {pages}"


def print_board(
    workspace: Workspace, wanted: SheetSettings, page: PrintSettings | None = None, out: Path | None = None
) -> PrintedBoard:
    """Print a board, a ring or the colour strip.

    The spec of a board or ring is written to `rig/board.json`, where readers of photographs find it.

    Args:
        workspace: into whose `print/` it is printed by default.
        wanted: which sheet.
        page: paper and orientation.
        out: a folder, or the PDF.

    Raises:
        ToolkitError: no sheet is wanted, it cannot be, it is too large for its paper, or a file cannot be written.
    """
    if wanted.kind is None:
        raise FieldError("no sheet named: expected one of {board}, {ring} and {colour_strip}", {})
    page, folder = page or PrintSettings(), out or workspace.root / "print"
    is_file = folder.suffix.lower() == ".pdf"
    pdf_file = folder if is_file else folder / f"{wanted.kind.replace('-', '_')}.pdf"
    if wanted.colour_strip:
        return _print_strip(page, pdf_file)
    spec = choose_sheet(wanted, page)
    document = build_board_pdf(spec, page.paper, page.orientation)
    write_bytes(pdf_file, document.content)
    note = _compare(workspace, spec)
    plan = document.plan
    return PrintedBoard(
        kind=wanted.kind,
        file=str(pdf_file),
        spec_file=str(write_board(workspace, spec)),
        description=spec.describe(),
        size_mm=(round(spec.size_mm[0], 3), round(spec.size_mm[1], 3)),
        paper=plan.frame.paper.name,
        orientation=plan.frame.paper.orientation,
        pages=len(plan.pages),
        tiles=plan.tiles,
        note=note,
    )


def choose_sheet(wanted: SheetSettings, page: PrintSettings) -> Board:
    """The board or ring that is asked for; what is left open is chosen.

    Raises:
        ToolkitError: there can be no such sheet.
    """
    spec: Board
    if wanted.ring:
        spec = choose_ring(DEFAULT_RING.inner_mm if wanted.ring_mm is None else wanted.ring_mm, wanted.marker_mm)
    else:
        spec = choose_board(page.paper, page.orientation, wanted.squares, wanted.square_mm, wanted.marker_mm)
    return replace(spec, ink_percent=PALE_PERCENT if wanted.ink_percent is None else wanted.ink_percent)


def _compare(workspace: Workspace, spec: Board) -> str | None:
    """What to know where another sheet's spec, or a broken one, is about to be replaced."""
    if not board_file(workspace).is_file():
        return None
    try:
        old = read_board(workspace)
    except ToolkitError as error:
        return f"replaced a spec that could not be read: {error}"
    if old == spec:
        return None
    return f"photographs are now read by this sheet; the one before was a {old.describe()}"


def _print_strip(page: PrintSettings, pdf_file: Path) -> PrintedBoard:
    content, frame = build_strip_pdf(page.paper, page.orientation)
    write_bytes(pdf_file, content)
    return PrintedBoard(
        kind="colour-strip",
        file=str(pdf_file),
        spec_file=None,
        description=f"colour strip of {len(STRIP.swatches)} cells",
        size_mm=STRIP.size_mm,
        paper=frame.paper.name,
        orientation=frame.paper.orientation,
        pages=1,
        tiles=(1, 1),
    )
