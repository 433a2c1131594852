"""A PDF to draw on: embedded fonts, words that keep inside their room, and pixels as vector rectangles. Millimetres."""

from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit import __version__
from toolkit.objects.printed_size import MM_PER_INCH
from toolkit.printing.page import Paper

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

PLAIN = "ToolkitSans"
BOLD = "ToolkitSansBold"
SMALLEST_MM = 1.2


def _font_file(dejavu: str, vera: str) -> str:
    """Matplotlib's DejaVu Sans, which knows most alphabets, else ReportLab's own Vera, its Latin ancestor.

    Matplotlib is looked up and not imported: that would take longer than making the page.
    """
    spec = find_spec("matplotlib")
    if spec is not None and spec.origin is not None:
        file = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / dejavu
        if file.is_file():
            return str(file)
    return vera


@cache
def register_fonts() -> None:
    """Make both fonts known to ReportLab; they are embedded, since print shops refuse PDFs whose fonts are not."""
    from reportlab.pdfbase.pdfmetrics import registerFont
    from reportlab.pdfbase.ttfonts import TTFont

    registerFont(TTFont(PLAIN, _font_file("DejaVuSans.ttf", "Vera.ttf")))
    registerFont(TTFont(BOLD, _font_file("DejaVuSans-Bold.ttf", "VeraBd.ttf")))


def measure_text_mm(text: str, font: str, size_mm: float) -> float:
    """Width of a line."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    return stringWidth(text, font, size_mm)


def drawable(text: str, font: str) -> str:
    """`text` with a question mark for each character that the font lacks; a missing glyph would print as nothing."""
    from reportlab.pdfbase.pdfmetrics import getFont

    known = getFont(font).face.charToGlyph
    return "".join(letter if ord(letter) in known else "?" for letter in text)


def draw_text(
    canvas: "Canvas",
    text: str,
    x: float,
    y: float,
    size_mm: float,
    room_mm: float,
    font: str = PLAIN,
    align: str = "left",
) -> float:
    """Draw one line with its baseline at y, made smaller until it fits `room_mm`, and cut with … below 1.2 mm.

    Args:
        canvas: in millimetres.
        text: one line.
        x: left end, middle or right end, as `align` says.
        y: baseline.
        size_mm: of the font.
        room_mm: greatest width.
        font: `PLAIN` or `BOLD`.
        align: `left`, `centre` or `right`.

    Returns:
        The width that the line takes, millimetres.
    """
    text = drawable(text, font)
    width = measure_text_mm(text, font, size_mm)
    if width > room_mm:
        size_mm = max(SMALLEST_MM, size_mm * room_mm / width)
        while measure_text_mm(text, font, size_mm) > room_mm * 1.0001 and len(text) > 1:
            text = text[:-2] + "…"
        width = measure_text_mm(text, font, size_mm)
    canvas.setFont(font, size_mm)
    canvas.drawString(x - {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * width, y, text)
    return width


FORM = "patch"
UNDERLAP_PX = 0.5


def find_runs(row: np.ndarray) -> list[tuple[int, int]]:
    """Spans [first, end) of equal colour in a row of (n, 3) pixels."""
    edges = np.flatnonzero(np.any(row[1:] != row[:-1], axis=1)) + 1
    bounds = [0, *edges.tolist(), len(row)]
    return list(pairwise(bounds))


def pixel_operators(pixels: np.ndarray) -> list[str]:
    """PDF operators that paint (n, n, 3) uint8 pixels over the square from (0, 0) to (n, n), first row on top."""
    side = len(pixels)
    operators = []
    for index, row in enumerate(pixels):
        top = side - index
        bottom = top - 1 - (UNDERLAP_PX if index < side - 1 else 0)
        for first, end in find_runs(row):
            red, green, blue = (f"{value / 255:.5g}" for value in row[first].tolist())
            right = end + (UNDERLAP_PX if end < side else 0)
            operators.append(f"{red} {green} {blue} rg {first} {bottom:g} {right - first:g} {top - bottom:g} re f")
    return operators


@cache
def srgb_profile() -> bytes:
    """An ICC profile of sRGB, the same bytes every time (LittleCMS writes the time into it)."""
    from PIL import ImageCms

    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    profile[24:36] = bytes.fromhex("07d0 0001 0001 0000 0000 0000")  # dateTimeNumber, ICC.1:2010 table 17
    profile[84:100] = bytes(16)  # profile ID, optional: it is a hash over the rest
    return bytes(profile)


def define_patch(canvas: "Canvas", pixels: np.ndarray) -> None:
    """Store the patch once in the file, for `place_patch` to show; (n, n, 3) uint8, sRGB-encoded.

    `DefaultRGB` makes its colours sRGB to every reader, not the device's own RGB (ISO 32000-1, 8.6.5.6).
    """
    from reportlab.pdfbase.pdfdoc import PDFArray, PDFDictionary, PDFName, PDFResourceDictionary, PDFStream

    document, side = canvas._doc, len(pixels)
    icc = PDFStream(PDFDictionary({"N": 3, "Alternate": PDFName("DeviceRGB")}), srgb_profile())
    space = PDFArray([PDFName("ICCBased"), document.Reference(icc)])
    # One pixel of room: a box on the very edge would smooth that edge a second time.
    canvas.beginForm(FORM, -1, -1, side + 1, side + 1)
    canvas._code.extend(pixel_operators(pixels))
    canvas.endForm(Resources=PDFResourceDictionary(ColorSpace={"DefaultRGB": space}))


def place_patch(canvas: "Canvas", x: float, y: float, side_mm: float, n_px: int) -> None:
    """Show the patch with its lower left corner at (x, y), millimetres."""
    canvas.saveState()
    canvas.translate(x, y)
    canvas.scale(side_mm / n_px, side_mm / n_px)
    canvas.doForm(FORM)
    canvas.restoreState()


POINTS_PER_MM = 72 / MM_PER_INCH


def set_paper(canvas: "Canvas", paper: Paper) -> None:
    """The size of the page that is drawn next and of those after it."""
    canvas.setPageSize((paper.width_mm * POINTS_PER_MM, paper.height_mm * POINTS_PER_MM))


def open_canvas(buffer: BytesIO, paper: Paper) -> "Canvas":
    """A canvas for pages of that paper, in points; the same drawing gives the same bytes."""
    from reportlab.pdfgen.canvas import Canvas

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


def describe_document(canvas: "Canvas", title: str, subject: str, keywords: Mapping[str, object]) -> None:
    """Fill the document's information dictionary."""
    from reportlab.pdfbase.pdfdoc import PDFDictionary, PDFInfo

    class UndatedInfo(PDFInfo):
        """ReportLab's reproducible mode writes 1 January 2000, which is false; no date is better."""

        def format(self, document: Any) -> bytes:
            from reportlab.pdfbase.pdfdoc import PDFString

            names = ("title", "author", "subject", "keywords", "creator", "producer")
            return PDFDictionary({name.title(): PDFString(getattr(self, name)) for name in names}).format(document)

    info = canvas._doc.info = UndatedInfo()
    info.title = title
    info.author = f"toolkit {__version__}"
    info.creator = f"toolkit {__version__}"
    info.producer = "ReportLab"
    info.subject = subject
    info.keywords = ", ".join(f"{name}={value}" for name, value in keywords.items())
