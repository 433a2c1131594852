"""Where on a page the colour strip goes, and the strip itself as vector rectangles."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from toolkit.printing.artwork import srgb_profile
from toolkit.printing.colour_strip import QUIET_MM, STRIP
from toolkit.printing.frame import Rect
from toolkit.printing.text import draw_text

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

CAPTION = "Cut out with a white border; photograph it beside the object: the kit knows these colours."
CAPTION_HEIGHT_MM = 3.5
SPACE = "StripRGB"
UNDERLAP_MM = 0.5


@dataclass(frozen=True)
class StripPlace:
    """The strip on a page: its lower left corner in millimetres, lying level or turned to read upwards."""

    x: float
    y: float
    upright: bool

    @property
    def area(self) -> Rect:
        """What it covers with its caption and the white that its markers need."""
        width, height = STRIP.size_mm
        long, short = width + 2 * QUIET_MM, height + CAPTION_HEIGHT_MM + 2 * QUIET_MM
        if self.upright:
            return Rect(self.x - height - QUIET_MM, self.y - QUIET_MM, short, long)
        return Rect(self.x - QUIET_MM, self.y - CAPTION_HEIGHT_MM - QUIET_MM, long, short)


def reserve_strip(content: Rect) -> Iterator[tuple[StripPlace, Rect]]:
    """Places for the strip and what each leaves of the page's room: along the lower edge, then up the right one."""
    width, height = STRIP.size_mm
    long, short = width + 2 * QUIET_MM, height + CAPTION_HEIGHT_MM + 2 * QUIET_MM
    if long <= content.width:
        x = content.x + (content.width - width) / 2
        place = StripPlace(x, content.y + CAPTION_HEIGHT_MM + QUIET_MM, upright=False)
        yield place, Rect(content.x, content.y + short, content.width, content.height - short)
    if long <= content.height:
        y = content.y + (content.height - width) / 2
        place = StripPlace(content.right - CAPTION_HEIGHT_MM - QUIET_MM, y, upright=True)
        yield place, Rect(content.x, content.y, content.width - short, content.height)


def draw_strip(canvas: "Canvas", place: StripPlace) -> None:
    """Draw the strip and its caption; the canvas is in millimetres. Its colours are sRGB to every reader."""
    from reportlab.pdfbase.pdfdoc import PDFArray, PDFDictionary, PDFName, PDFStream

    document = canvas._doc
    if SPACE not in document.idToObject:
        icc = PDFStream(PDFDictionary({"N": 3, "Alternate": PDFName("DeviceRGB")}), srgb_profile())
        document.Reference(PDFArray([PDFName("ICCBased"), document.Reference(icc)]), SPACE)
    # ReportLab lists a page's separation colours here; the page's resources then name this space in the same way.
    canvas._colorsUsed[SPACE] = SPACE
    width, height = STRIP.size_mm
    canvas.saveState()
    canvas.translate(place.x, place.y)
    if place.upright:
        canvas.rotate(90)
    last = max(cell.x for cell in STRIP.cells)
    for cell in STRIP.cells:
        red, green, blue = (f"{value / 255:.5g}" for value in cell.srgb)
        bottom = height - cell.y - cell.side_mm
        # It reaches under its right neighbour, so that no hairline of paper shows between them (see artwork.py).
        reach = cell.side_mm + (UNDERLAP_MM if cell.x < last else 0)
        box = f"{cell.x:g} {bottom:g} {reach:g} {cell.side_mm:g}"
        canvas._code.append(f"/{SPACE} cs {red} {green} {blue} sc {box} re f")
    canvas.setFillGray(0)
    path = canvas.beginPath()
    for left, top, right, bottom in STRIP.marker_rects_mm().tolist():
        path.rect(left, height - bottom, right - left, bottom - top)
    canvas.drawPath(path, stroke=0, fill=1, fillMode=1)
    draw_text(canvas, CAPTION, 0, -CAPTION_HEIGHT_MM + 0.6, 2.2, width)
    canvas.restoreState()
