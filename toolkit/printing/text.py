"""Words on a page: embedded fonts, and sizes that keep a line inside its room. Sizes are millimetres."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

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
