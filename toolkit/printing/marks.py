"""The words at the top of a page, and what is measured, cut and aligned by. Millimetres."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from toolkit.objects.printed_size import BASE_DPI
from toolkit.objects.records import PatchRecord
from toolkit.objects.spec import Side
from toolkit.printing.canvas import BOLD, PLAIN, draw_text, measure_text_mm
from toolkit.printing.layout import effective_percent
from toolkit.printing.page import BAR_MM, MARK_MM, OVERLAP_MM, PageFrame, Rect, Tile
from toolkit.printing.settings import PrintSettings

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
    n_px, dpi = record.n_px, settings.dpi or BASE_DPI
    percent = effective_percent(n_px, side_mm, dpi)
    title = record.class_name if record.name == record.class_name else f"{record.class_name} ({record.name})"
    trained_on = ", ".join(network.arch for network in record.networks) or "no network"
    return PatchLabel(
        title,
        f"{side_mm:.1f} × {side_mm:.1f} mm   ({percent:.4g} % of {n_px} × {n_px} px at {dpi:g} dpi)",
        f"patch sha256 {record.png_sha256[:HASH_DIGITS]}   ·   trained on {trained_on}   ·   "
        f"toolkit {record.toolkit_version}",
    )


def draw_header(canvas: "Canvas", area: Rect, label: PatchLabel, page: str, advice: str) -> None:
    """Draw the label into the page's header; `page` (which page, which tile) stands on the right, `advice` below."""
    taken = draw_text(canvas, page, area.right, area.top - 4.2, 3.0, room_mm=area.width * 0.45, align="right")
    draw_text(canvas, label.title, area.x, area.top - 4.2, 5.0, room_mm=area.width - taken - 4, font=BOLD)
    draw_text(canvas, label.size, area.x, area.top - 9.4, 3.2, room_mm=area.width)
    draw_text(canvas, label.origin, area.x, area.top - 13.4, 2.4, room_mm=area.width)
    for line, words in enumerate((PRINT_IT, advice)):
        draw_text(canvas, words, area.x, area.top - 17.0 - 3.3 * line, 2.4, room_mm=area.width)


LINE_MM = 0.15
MARK_GAP_MM = 1.0
"""Bare paper between cut line and mark, so that a cut a little off leaves no ink on the sheet."""
MARK_LENGTH_MM = 4.0
SHORT_MARK_MM = 2.0
RING_MM = 1.5
BAR_THICKNESS_MM = 0.8
SMALLEST_WORDS_MM = 1.3


def draw_check_bar(canvas: "Canvas", x: float, y: float, upright: bool) -> None:
    """A ruler from (x, y) to the right or upwards whose outer edges are 100 mm apart, with ticks each 10 mm.

    Bar, ticks and numbers lie on the side away from the page's content: below a level bar, left of an upright one.
    """
    canvas.saveState()
    canvas.translate(x, y)
    outwards = -1
    if upright:
        canvas.rotate(90)
        outwards = 1
    canvas.rect(0, min(0, outwards * BAR_THICKNESS_MM), BAR_MM, BAR_THICKNESS_MM, stroke=0, fill=1)
    for tick in range(0, 101, 10):
        # The end ticks stay inside the bar's 100 mm, the others are centred on their place.
        left = min(max(tick - LINE_MM, 0), BAR_MM - 2 * LINE_MM)
        canvas.rect(left, min(0, outwards * 2.4), 2 * LINE_MM, 2.4, stroke=0, fill=1)
        baseline = 3.0 if upright else -4.7
        label = "100 mm" if tick == 100 else str(tick)
        draw_text(canvas, label, tick, baseline, 2.2, room_mm=10, align="centre")
    canvas.restoreState()


def draw_check_bars(canvas: "Canvas", frame: PageFrame) -> None:
    """Both check bars of a page."""
    for upright in (False, True):
        draw_check_bar(canvas, *frame.bars_corner, upright=upright)


def _tick(canvas: "Canvas", x: float, y: float, dx: int, dy: int, length: float = MARK_LENGTH_MM) -> None:
    """A line that starts a gap away from (x, y) and leads away from it."""
    end = MARK_GAP_MM + length
    canvas.line(x + dx * MARK_GAP_MM, y + dy * MARK_GAP_MM, x + dx * end, y + dy * end)


def draw_crop_marks(canvas: "Canvas", cut: Rect) -> None:
    """Two marks at each corner, outside the rectangle and in line with its sides."""
    canvas.setLineWidth(LINE_MM)
    for x, outwards_x in ((cut.x, -1), (cut.right, 1)):
        for y, outwards_y in ((cut.y, -1), (cut.top, 1)):
            _tick(canvas, x, y, outwards_x, 0)
            _tick(canvas, x, y, 0, outwards_y)


def _draw_ring(canvas: "Canvas", x: float, y: float) -> None:
    """A registration mark: two that lie on each other, held against the light, show as one."""
    canvas.circle(x, y, RING_MM * 0.6, stroke=1, fill=0)
    canvas.line(x - RING_MM, y, x + RING_MM, y)
    canvas.line(x, y - RING_MM, x, y + RING_MM)


def draw_overlap_marks(canvas: "Canvas", tile: Tile, window: Rect) -> None:
    """At both ends of every overlap: a short mark where the neighbour's edge comes to lie, and a registration mark.

    They are outside the tile's window, in line with the overlap: no mark is ever printed on the patch.
    """
    canvas.setLineWidth(LINE_MM)
    half, away = OVERLAP_MM / 2, MARK_GAP_MM + RING_MM + 1
    joins = tile.joins
    for side, edge, inwards in (("left", window.x, 1), ("right", window.right, -1)):
        if joins[side]:
            for y, outwards in ((window.y, -1), (window.top, 1)):
                _tick(canvas, edge + inwards * OVERLAP_MM, y, 0, outwards, length=SHORT_MARK_MM)
                _draw_ring(canvas, edge + inwards * half, y + outwards * away)
    for side, edge, inwards in (("bottom", window.y, 1), ("top", window.top, -1)):
        if joins[side]:
            for x, outwards in ((window.x, -1), (window.right, 1)):
                _tick(canvas, x, edge + inwards * OVERLAP_MM, outwards, 0, length=SHORT_MARK_MM)
                _draw_ring(canvas, x + outwards * away, edge + inwards * half)


def draw_front_arrow(canvas: "Canvas", area: Rect, note: str = "", at: Side = "top") -> None:
    """Below a cut line's marks: `note`, then which way the sheet goes, see `_draw_way`."""
    _draw_way(canvas, note, area.x + area.width / 2, area.y - MARK_MM - 2.6, 2.4, area.width + 2 * MARK_MM, at)


def draw_margin_words(canvas: "Canvas", cut: Rect, margin_mm: float, name: str, at: Side) -> None:
    """In the white margin below the patch, which is cut out with it: the object's name, and which way the sheet goes.

    A margin under 3 mm has no room for them: then they stand below the cut line.
    """
    size = min(2.2, 0.44 * margin_mm)
    if size < SMALLEST_WORDS_MM:
        draw_front_arrow(canvas, cut, name, at)
        return
    canvas.setFillGray(0.25)  # what is taped on is seen by a camera: no blacker than it must be
    canvas.setStrokeGray(0.25)
    y = cut.y + (margin_mm - 0.7 * size) / 2
    _draw_way(canvas, name, cut.x + cut.width / 2, y, size, cut.width - 2 * size, at)
    canvas.setFillGray(0)
    canvas.setStrokeGray(0)


def _draw_way(
    canvas: "Canvas", note: str, middle_x: float, y: float, size: float, room_mm: float, at: Side
) -> None:  # fmt: skip
    """Words and an arrow: on top of an object `front` to the right, on its sides `up`, as the rig mounts the sheet."""
    shaft = 7.0 / 2.4 * size if at == "top" else 0.9 * size
    word = "   ".join(filter(None, [note, "front" if at == "top" else "up"]))
    width = min(measure_text_mm(word, PLAIN, size), room_mm - 1 - shaft) + 1 + shaft
    x = middle_x - width / 2
    end = x + draw_text(canvas, word, x, y, size, room_mm=width - 1 - shaft) + 1
    canvas.saveState()
    canvas.setLineWidth(2 * LINE_MM)
    if at == "top":
        canvas.translate(end, y + 0.35 * size)
    else:
        canvas.translate(end + 0.4 * size, y - 0.1 * size)
        canvas.rotate(90)
    canvas.line(0, 0, shaft - 0.6 * size, 0)
    head = canvas.beginPath()
    head.moveTo(shaft, 0)
    head.lineTo(shaft - 0.9 * size, 0.38 * size)
    head.lineTo(shaft - 0.9 * size, -0.38 * size)
    head.close()
    canvas.drawPath(head, stroke=0, fill=1)
    canvas.restoreState()
