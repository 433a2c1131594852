"""A patch to the bytes of a print-ready PDF."""

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

from toolkit.patches import Patch
from toolkit.printing.artwork import define_patch, place_patch
from toolkit.printing.canvas import POINTS_PER_MM, describe_document, open_canvas
from toolkit.printing.frame import Rect
from toolkit.printing.label import CUT_IT, JOIN_IT, PatchLabel, compose_label, draw_header
from toolkit.printing.marks import draw_check_bars, draw_crop_marks, draw_front_arrow
from toolkit.printing.page_map import draw_map
from toolkit.printing.plan import CopiesPage, MapPage, Page, PrintPlan, TilePage, plan_pages
from toolkit.printing.settings import PrintSettings, measure_side_mm
from toolkit.printing.strip_place import draw_strip
from toolkit.printing.text import register_fonts
from toolkit.printing.tile_page import count_things, draw_tile

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas


@dataclass(frozen=True)
class PrintedDocument:
    """A finished PDF and how it is laid out."""

    content: bytes
    plan: PrintPlan


def build_pdf(patch: Patch, settings: PrintSettings) -> PrintedDocument:
    """Lay out a patch on pages at true physical size.

    The same patch, settings and toolkit version give the same bytes: the file holds no time and no random id.

    Raises:
        ToolkitError: the patch would be under 1 mm or over 5 m wide.
    """
    record = patch.record
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
        _draw_page(canvas, plan, page, patch, label, number)
        canvas.showPage()
    canvas.save()
    return PrintedDocument(buffer.getvalue(), plan)


def _draw_page(canvas: "Canvas", plan: PrintPlan, page: Page, patch: Patch, label: PatchLabel, number: int) -> None:
    frame, n_px = plan.frame, patch.record.n_px

    def draw_sheet(canvas: "Canvas") -> None:
        place_patch(canvas, plan.margin_mm, plan.margin_mm, plan.side_mm, n_px)

    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    which = f"{frame.paper.name} {frame.paper.orientation}, page {number} of {len(plan.pages)}"
    if isinstance(page, MapPage):
        rows, columns = plan.tiles
        which = f"{count_things(rows, 'row')} × {count_things(columns, 'column')}, {which}"
        picture = draw_map(canvas, frame.content, page, draw_sheet)
        draw_front_arrow(canvas, Rect(picture.x, picture.y + 4, picture.width, picture.height))
    elif isinstance(page, TilePage):
        copies = max(other.copy for other in plan.pages if isinstance(other, TilePage))
        which = f"tile {page.tile.name}" + (f" of copy {page.copy}" if copies > 1 else "") + f", {which}"
        draw_tile(canvas, page, draw_sheet)
        draw_front_arrow(canvas, page.window, page.tile.name)
    else:
        _draw_copies(canvas, plan, page, n_px)
    draw_header(canvas, frame.header, label, which, CUT_IT if plan.tiles == (1, 1) else JOIN_IT)
    draw_check_bars(canvas, frame)


def _draw_copies(canvas: "Canvas", plan: PrintPlan, page: CopiesPage, n_px: int) -> None:
    """Whole copies with their marks, and the colour strip."""
    for cut in page.cuts:
        place_patch(canvas, cut.x + plan.margin_mm, cut.y + plan.margin_mm, plan.side_mm, n_px)
        draw_crop_marks(canvas, cut)
        draw_front_arrow(canvas, cut)
    if page.strip is not None:
        draw_strip(canvas, page.strip)
