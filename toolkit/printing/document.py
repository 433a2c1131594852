"""A patch to the bytes of a print-ready PDF, tiles and their map included."""

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

from toolkit.objects.records import Patch, printed_size_mm
from toolkit.objects.spec import Side
from toolkit.printing.canvas import (
    BOLD,
    POINTS_PER_MM,
    define_patch,
    describe_document,
    draw_text,
    open_canvas,
    place_patch,
    register_fonts,
)
from toolkit.printing.colour_strip import draw_strip
from toolkit.printing.layout import (
    MapPage,
    Page,
    PrintPlan,
    TilePage,
    measure_side_mm,
    plan_pages,
)
from toolkit.printing.marks import (
    CUT_IT,
    JOIN_IT,
    PatchLabel,
    compose_label,
    draw_check_bars,
    draw_crop_marks,
    draw_front_arrow,
    draw_header,
    draw_margin_words,
    draw_overlap_marks,
)
from toolkit.printing.page import OVERLAP_MM, Rect
from toolkit.printing.settings import PrintSettings
from toolkit.printing.wearers import SAME_MM, Wearer

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

DrawSheet = Callable[["Canvas"], None]
"""Draws a whole sheet in its own millimetres: origin at its lower left corner, y upwards."""


def draw_tile(canvas: "Canvas", page: TilePage, draw_sheet: DrawSheet) -> None:
    """One tile's part of a sheet, clipped to its window, and the marks round it; the canvas is in millimetres."""
    window, part = page.window, page.tile.area
    canvas.saveState()
    clip = canvas.beginPath()
    clip.rect(window.x, window.y, window.width, window.height)
    canvas.clipPath(clip, stroke=0, fill=0)
    canvas.translate(window.x - part.x, window.y - part.y)
    draw_sheet(canvas)
    canvas.restoreState()
    draw_crop_marks(canvas, window)
    draw_overlap_marks(canvas, page.tile, window)


def count_things(number: int, thing: str) -> str:
    """`1 row`, `2 rows`."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


STEPS = (
    "1  Print every page at 100 % and measure both check bars on each.",
    f"2  Rows: cut a tile's left edge, from long mark to long mark; lay it {OVERLAP_MM:g} mm over its left neighbour.",
    "    Its edge meets the short marks, the ringed crosses lie on each other (hold it against the light). Tape.",
    "3  Cut the upper edge of each finished row and lay it over the row above in the same way. Tape.",
    "4  Cut the whole sheet along its four sides: the long marks at its outer corners, the outline of this map.",
)
LINE_HEIGHT_MM = 4.0


def draw_map(canvas: "Canvas", area: Rect, page: MapPage, draw_sheet: DrawSheet) -> Rect:
    """The whole sheet made small, each tile outlined and named, over the steps to put it together.

    Args:
        canvas: in millimetres.
        area: the page's room for it.
        page: the tiles.
        draw_sheet: draws the sheet at its full size.

    Returns:
        Where on the page the small sheet is.
    """
    sheet_width, sheet_height = (max(getattr(tile.area, end) for tile in page.tiles) for end in ("right", "top"))
    steps_mm = LINE_HEIGHT_MM * len(STEPS) + 4
    small = min((area.width - 8) / sheet_width, (area.height - steps_mm - 14) / sheet_height)
    room = Rect(area.x, area.y + steps_mm + 10, area.width, area.height - steps_mm - 14)
    picture = room.centre(sheet_width * small, sheet_height * small)
    canvas.saveState()
    canvas.translate(picture.x, picture.y)
    canvas.scale(small, small)
    draw_sheet(canvas)
    canvas.restoreState()
    for tile in page.tiles:
        here = tile.area
        box = Rect(picture.x + here.x * small, picture.y + here.y * small, here.width * small, here.height * small)
        _draw_tile(canvas, box, tile.name)
    for line, words in enumerate(STEPS):
        draw_text(
            canvas, words, area.x + 4, area.y + steps_mm - LINE_HEIGHT_MM * (line + 1), 2.6, room_mm=area.width - 4
        )
    return picture


def _draw_tile(canvas: "Canvas", box: Rect, name: str) -> None:
    """Outline in white under black, so that it shows on any colour, and the tile's name on a white plate."""
    for width, grey in ((0.7, 1), (0.25, 0)):
        canvas.setLineWidth(width)
        canvas.setStrokeGray(grey)
        canvas.rect(box.x, box.y, box.width, box.height, stroke=1, fill=0)
    size = min(5.0, box.width / 4, box.height / 3)
    plate = box.centre(size * 2.6, size * 1.5)
    canvas.setFillGray(1)
    canvas.roundRect(plate.x, plate.y, plate.width, plate.height, size * 0.3, stroke=0, fill=1)
    canvas.setFillGray(0)
    draw_text(
        canvas,
        name,
        plate.x + plate.width / 2,
        plate.y + size * 0.39,
        size,
        room_mm=plate.width * 0.9,
        font=BOLD,
        align="centre",
    )


@dataclass(frozen=True)
class PrintedDocument:
    """A finished PDF and how it is laid out."""

    content: bytes
    plan: PrintPlan


def build_pdf(patch: Patch, settings: PrintSettings, wearer: Wearer | None = None) -> PrintedDocument:
    """Lay out a patch on pages at true physical size.

    The same arguments and toolkit version give the same bytes: the file holds no time and no random id.

    Args:
        patch: the patch.
        settings: paper and size; where they state no size, the wearer's counts, else the record's.
        wearer: the object that it is printed for: its name stands in the margin.

    Raises:
        ToolkitError: the patch would be under 1 mm or over 5 m wide.
    """
    record = patch.record
    if wearer is not None and not settings.states_size:
        settings = settings.with_overrides(size_mm=wearer.size_mm)
    elif not settings.states_size and abs(record.size_mm - printed_size_mm(record.n_px)) > SAME_MM:
        settings = settings.with_overrides(size_mm=record.size_mm)  # that it was trained for
    side_mm = measure_side_mm(record.n_px, settings)
    plan = plan_pages(side_mm, settings)
    label = compose_label(record, side_mm, settings)
    register_fonts()
    buffer = BytesIO()
    canvas = open_canvas(buffer, plan.frame.paper)
    keywords = {
        "class": record.class_name,
        "size_mm": f"{side_mm:.3f}",
        "n_px": record.n_px,
        "patch_sha256": record.png_sha256,
    }
    title = f"{record.class_name} patch, {side_mm:.1f} mm"
    describe_document(canvas, title, f"{label.title}: {label.size}", keywords)
    define_patch(canvas, patch.pixels)
    for number, page in enumerate(plan.pages, start=1):
        _draw_page(canvas, plan, page, patch, label, wearer, number=number)
        canvas.showPage()
    canvas.save()
    return PrintedDocument(buffer.getvalue(), plan)


def _draw_page(
    canvas: "Canvas", plan: PrintPlan, page: Page, patch: Patch, label: PatchLabel, wearer: Wearer | None, number: int
) -> None:
    frame, n_px = plan.frame, patch.record.n_px
    at: Side = wearer.at if wearer else "top"

    def draw_sheet(canvas: "Canvas", x: float = 0.0, y: float = 0.0) -> None:
        place_patch(canvas, x + plan.margin_mm, y + plan.margin_mm, plan.side_mm, n_px)
        cut, name = Rect(x, y, plan.cut_mm, plan.cut_mm), wearer.object if wearer else patch.record.name
        draw_margin_words(canvas, cut, plan.margin_mm, name, at)

    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    which = f"{frame.paper.name} {frame.paper.orientation}, page {number} of {len(plan.pages)}"
    if isinstance(page, MapPage):
        rows, columns = plan.tiles
        which = f"{count_things(rows, 'row')} × {count_things(columns, 'column')}, {which}"
        picture = draw_map(canvas, frame.content, page, draw_sheet)
        draw_front_arrow(canvas, Rect(picture.x, picture.y + 4, picture.width, picture.height), at=at)
    elif isinstance(page, TilePage):
        copies = max(other.copy for other in plan.pages if isinstance(other, TilePage))
        which = f"tile {page.tile.name}" + (f" of copy {page.copy}" if copies > 1 else "") + f", {which}"
        draw_tile(canvas, page, draw_sheet)
        draw_front_arrow(canvas, page.window, page.tile.name, at)
    else:
        for cut in page.cuts:
            draw_sheet(canvas, cut.x, cut.y)
            draw_crop_marks(canvas, cut)
        if page.strip is not None:
            draw_strip(canvas, page.strip)
    draw_header(canvas, frame.header, label, which, CUT_IT if plan.tiles == (1, 1) else JOIN_IT)
    draw_check_bars(canvas, frame)
