"""The colour strip on a page of its own, for patches whose page has no room for it."""

from io import BytesIO

from toolkit import __version__
from toolkit.printing.canvas import POINTS_PER_MM, describe_document, open_canvas
from toolkit.printing.colour_strip import STRIP
from toolkit.printing.frame import MARK_MM, PageFrame
from toolkit.printing.label import PatchLabel, draw_header
from toolkit.printing.marks import draw_check_bars, draw_crop_marks
from toolkit.printing.paper import Paper
from toolkit.printing.plan import turn_frames
from toolkit.printing.strip_place import StripPlace, draw_strip, reserve_strip
from toolkit.printing.text import register_fonts

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
        f"{size}   ({len(STRIP.cells)} cells of {STRIP.cells[0].side_mm:g} mm)",
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
