"""A patch to the bytes of a print-ready PDF."""

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

from toolkit import __version__
from toolkit.patches import MM_PER_INCH, Patch
from toolkit.printing.artwork import define_patch, place_patch
from toolkit.printing.frame import Rect
from toolkit.printing.label import PatchLabel, compose_label, draw_header
from toolkit.printing.marks import draw_check_bar, draw_crop_marks, draw_front_arrow, draw_overlap_marks
from toolkit.printing.page_map import draw_map
from toolkit.printing.plan import CopiesPage, MapPage, PrintPlan, TilePage, plan_pages
from toolkit.printing.settings import PrintSettings, measure_side_mm
from toolkit.printing.text import PLAIN, register_fonts

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

POINTS_PER_MM = 72 / MM_PER_INCH


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
    side_mm = measure_side_mm(patch.record.n_px, settings)
    plan = plan_pages(side_mm, settings)
    label = compose_label(patch.record, side_mm, settings)
    register_fonts()
    buffer = BytesIO()
    canvas = _open_canvas(buffer, plan)
    _describe(canvas, patch, label, side_mm)
    define_patch(canvas, patch.pixels)
    for number, page in enumerate(plan.pages, start=1):
        _draw_page(canvas, plan, page, patch, label, number)
        canvas.showPage()
    canvas.save()
    return PrintedDocument(buffer.getvalue(), plan)


def _open_canvas(buffer: BytesIO, plan: PrintPlan) -> "Canvas":
    from reportlab.pdfgen.canvas import Canvas

    paper = plan.frame.paper
    canvas = Canvas(
        buffer,
        pagesize=(paper.width_mm * POINTS_PER_MM, paper.height_mm * POINTS_PER_MM),
        pageCompression=1,
        invariant=1,
        pdfVersion=(1, 7),
        initialFontName=PLAIN,
        lang="en",
    )
    # Print dialogs that honour these start at 100 %, one-sided, on the paper of this size.
    canvas.setViewerPreference("PrintScaling", "None")
    canvas.setViewerPreference("Duplex", "Simplex")
    canvas._doc.Catalog.ViewerPreferences.dict["PickTrayByPDFSize"] = (
        "true"  # PDF 1.7; ReportLab's own list ends at 1.6
    )
    canvas.setViewerPreference("DisplayDocTitle", "true")
    return canvas


def _describe(canvas: "Canvas", patch: Patch, label: PatchLabel, side_mm: float) -> None:
    """Fill the document's information dictionary."""
    from reportlab.pdfbase.pdfdoc import PDFDictionary, PDFInfo

    class UndatedInfo(PDFInfo):
        """ReportLab's reproducible mode writes 1 January 2000, which is false; no date is better."""

        def format(self, document: Any) -> bytes:
            from reportlab.pdfbase.pdfdoc import PDFString

            names = ("title", "author", "subject", "keywords", "creator", "producer")
            return PDFDictionary({name.title(): PDFString(getattr(self, name)) for name in names}).format(document)

    record = patch.record
    info = canvas._doc.info = UndatedInfo()
    info.title = f"{record.class_name} patch, {side_mm:.1f} mm"
    info.author = f"toolkit {__version__}"
    info.creator = f"toolkit {__version__}"
    info.producer = "ReportLab"
    info.subject = f"{label.title}: {label.size}"
    info.keywords = ", ".join(
        (
            f"class={record.class_name}",
            f"size_mm={side_mm:.3f}",
            f"n_px={record.n_px}",
            f"patch_sha256={record.png_sha256}",
        )
    )


def _draw_page(
    canvas: "Canvas",
    plan: PrintPlan,
    page: CopiesPage | TilePage | MapPage,
    patch: Patch,
    label: PatchLabel,
    number: int,
) -> None:
    frame, n_px = plan.frame, patch.record.n_px
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    which = f"{frame.paper.name} {frame.paper.orientation}, page {number} of {len(plan.pages)}"
    if isinstance(page, MapPage):
        rows, columns = plan.tiles
        which = f"{_count(rows, 'row')} × {_count(columns, 'column')}, {which}"
        draw_map(canvas, frame.content, page, n_px, plan.margin_mm)
    elif isinstance(page, TilePage):
        copies = max(other.copy for other in plan.pages if isinstance(other, TilePage))
        which = f"tile {page.tile.name}" + (f" of copy {page.copy}" if copies > 1 else "") + f", {which}"
        _draw_tile(canvas, plan, page, n_px)
    else:
        for cut in page.cuts:
            place_patch(canvas, cut.x + plan.margin_mm, cut.y + plan.margin_mm, plan.side_mm, n_px)
            draw_crop_marks(canvas, cut)
            draw_front_arrow(canvas, cut)
    draw_header(canvas, frame.header, label, which, tiled=plan.tiles != (1, 1))
    for upright in (False, True):
        draw_check_bar(canvas, *frame.bars_corner, upright=upright)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def _draw_tile(canvas: "Canvas", plan: PrintPlan, page: TilePage, n_px: int) -> None:
    """One tile's part of the patch, clipped to its window, and the marks round it."""
    window, part = page.window, page.tile.area
    patch_at = Rect(window.x - part.x + plan.margin_mm, window.y - part.y + plan.margin_mm, plan.side_mm, plan.side_mm)
    canvas.saveState()
    clip = canvas.beginPath()
    clip.rect(window.x, window.y, window.width, window.height)
    canvas.clipPath(clip, stroke=0, fill=0)
    place_patch(canvas, patch_at.x, patch_at.y, plan.side_mm, n_px)
    canvas.restoreState()
    draw_crop_marks(canvas, window)
    draw_overlap_marks(canvas, page.tile, window)
    draw_front_arrow(canvas, window, page.tile.name)
