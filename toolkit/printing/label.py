"""The words at the top of a page: what this is, how large it must be, which pixels it holds, what to do with it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from toolkit.patches import PatchRecord
from toolkit.printing.frame import Rect
from toolkit.printing.settings import PrintSettings, effective_percent
from toolkit.printing.text import BOLD, draw_text

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

HASH_DIGITS = 12


@dataclass(frozen=True)
class PatchLabel:
    """The lines that name a patch, or another sheet.

    Attributes:
        title: its class, and its file's name where that differs.
        size: its side on paper, and what gives that.
        origin: its hash, and the program and network that made it.
    """

    title: str
    size: str
    origin: str


PRINT_IT = "Print at 100 % (“actual size”), never “fit to page”. Both check bars must measure 100 mm."
CUT_IT = (
    "Cut at the corner marks, tape by the white edge: on top with the arrow to the object's front, "
    "on a side this way up."
)
JOIN_IT = (
    "Page 1 shows how the tiles are joined. The arrow points to the front of the object that the sheet is taped on."
)


def compose_label(record: PatchRecord, side_mm: float, settings: PrintSettings) -> PatchLabel:
    """The label of a patch printed at that side."""
    percent = effective_percent(record.n_px, side_mm, settings.dpi)
    n_px = record.n_px
    title = record.class_name if record.name == record.class_name else f"{record.class_name} ({record.name})"
    trained_on = ", ".join(network.arch for network in record.networks) or "no network"
    return PatchLabel(
        title,
        f"{side_mm:.1f} × {side_mm:.1f} mm   ({percent:.4g} % of {n_px} × {n_px} px at {settings.dpi:g} dpi)",
        f"patch sha256 {record.png_sha256[:HASH_DIGITS]}   ·   trained on {trained_on}   ·   "
        f"toolkit {record.toolkit_version}",
    )


def draw_header(canvas: "Canvas", area: Rect, label: PatchLabel, page: str, advice: str) -> None:
    """Draw the label into the page's header; `page` (which page, which tile) stands on the right, `advice` below."""
    taken = draw_text(canvas, page, area.right, area.top - 4.2, 3.0, area.width * 0.45, align="right")
    draw_text(canvas, label.title, area.x, area.top - 4.2, 5.0, area.width - taken - 4, BOLD)
    draw_text(canvas, label.size, area.x, area.top - 9.4, 3.2, area.width)
    draw_text(canvas, label.origin, area.x, area.top - 13.4, 2.4, area.width)
    for line, words in enumerate((PRINT_IT, advice)):
        draw_text(canvas, words, area.x, area.top - 17.0 - 3.3 * line, 2.4, area.width)
