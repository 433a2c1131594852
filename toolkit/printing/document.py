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
    set_paper,
)
from toolkit.printing.colour_strip import draw_strip
from toolkit.printing.layout import MapPage, Page, PrintPlan, TilePage, measure_side_mm, plan_pages
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
from toolkit.printing.wearers import SAME_MM, Wearer, say_sizes

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
    """A finished PDF and how it is laid out: a plan for each sheet of the object, one after the other."""

    content: bytes
    plans: tuple[PrintPlan, ...]

    @property
    def plan(self) -> PrintPlan:
        """Of the only sheet, or the first."""
        return self.plans[0]


def build_pdf(patch: Patch, settings: PrintSettings, wearer: Wearer | None = None) -> PrintedDocument:
    """Lay out a patch on pages at true physical size, once for each sheet of the object that it is printed for.

    The same arguments and toolkit version give the same bytes: the file holds no time and no random id.

    Args:
        patch: the patch.
        settings: paper and size; where they state no size, the wearer's count, else the record's.
        wearer: the object that it is printed for: its name, and of several sheets which one it is, stand in the margin.

    Raises:
        ToolkitError: the patch would be under 1 mm or over 5 m wide.
    """
    record = patch.record
    trained_mm = record.size_mm if abs(record.size_mm - printed_size_mm(record.n_px)) > SAME_MM else None
    sizes = (trained_mm,) if wearer is None else wearer.sizes_mm
    states = settings.states_size
    settled = [settings if states or size is None else settings.with_overrides(size_mm=size) for size in sizes]
    sides_mm = [measure_side_mm(record.n_px, one) for one in settled]
    plans = [plan_pages(side_mm, one) for side_mm, one in zip(sides_mm, settled, strict=True)]
    labels = [compose_label(record, side_mm, one) for side_mm, one in zip(sides_mm, settled, strict=True)]
    register_fonts()
    buffer = BytesIO()
    canvas = open_canvas(buffer, plans[0].frame.paper)
    keywords = {
        "class": record.class_name,
        "size_mm": "+".join(f"{side_mm:.3f}" for side_mm in sides_mm),
        "n_px": record.n_px,
        "patch_sha256": record.png_sha256,
    }
    title = f"{record.class_name} patch, {say_sizes(sides_mm)}"
    describe_document(canvas, title, f"{labels[0].title}: {' and '.join(one.size for one in labels)}", keywords)
    define_patch(canvas, patch.pixels)
    number, total = 0, sum(len(plan.pages) for plan in plans)
    for index, (plan, label) in enumerate(zip(plans, labels, strict=True)):
        name = record.name if wearer is None else wearer.name_sheet(index)
        at: Side = "top" if wearer is None else wearer.sides[index]
        which = f"sheet {index + 1} of {len(plans)}, " if len(plans) > 1 else ""
        for page in plan.pages:
            number += 1
            if len(plans) > 1:
                set_paper(canvas, plan.frame.paper)
            _draw_page(
                canvas, plan, page, record.n_px, label, name=name, at=at, which=f"{which}page {number} of {total}"
            )
            canvas.showPage()
    canvas.save()
    return PrintedDocument(buffer.getvalue(), tuple(plans))


def _draw_page(
    canvas: "Canvas", plan: PrintPlan, page: Page, n_px: int, label: PatchLabel, *, name: str, at: Side, which: str
) -> None:
    frame = plan.frame

    def draw_sheet(canvas: "Canvas", x: float = 0.0, y: float = 0.0) -> None:
        place_patch(canvas, x + plan.margin_mm, y + plan.margin_mm, plan.side_mm, n_px)
        draw_margin_words(canvas, Rect(x, y, plan.cut_mm, plan.cut_mm), plan.margin_mm, name, at)

    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    which = f"{frame.paper.name} {frame.paper.orientation}, {which}"
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
