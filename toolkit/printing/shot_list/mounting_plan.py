"""The drawing of where the sheet goes: its outline on the object, millimetres from the edges, and its arrow."""

from typing import TYPE_CHECKING

from toolkit.printing.frame import Rect
from toolkit.printing.shot_list.drawings import (
    SHEET,
    SOFT,
    WHITE,
    draw_block_arrow,
    draw_dimension,
    draw_shape,
    draw_title,
    place_picture,
    set_ink,
    write,
)
from toolkit.printing.shot_list.mounting import MountDrawing
from toolkit.printing.text import BOLD

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

CHAINS_MM = 18.0
"""Room beside and below the picture for its dimensions, and above it for the title."""


def draw_mounting_plan(canvas: "Canvas", area: Rect, drawing: MountDrawing, side: str) -> None:
    """The object's side with the sheet's outline, its distances from the object's edges, and its arrow."""
    seen = {"top": "seen from above", "back": "seen from behind"}.get(side, f"seen from the {side}")
    draw_title(canvas, area, f"Where the patch goes, {seen}")
    left, bottom, right, top = drawing.frame_mm
    room = Rect(area.x + 9.0, area.y + 8.0, area.width - CHAINS_MM, area.height - CHAINS_MM + 2)
    scale = min(room.width / (right - left), room.height / (top - bottom))
    picture = room.centre((right - left) * scale, (top - bottom) * scale)
    place_picture(canvas, drawing.jpeg, picture, None)

    def at(point) -> tuple[float, float]:
        return picture.x + (float(point[0]) - left) * scale, picture.y + (float(point[1]) - bottom) * scale

    for colour, line in ((WHITE, 0.9), (SHEET, 0.45)):
        set_ink(canvas, colour, line)
        draw_shape(canvas, [at(p) for p in drawing.outline_mm], fill=False)
    canvas.setDash(1.0, 0.8)
    canvas.setLineWidth(0.2)
    draw_shape(canvas, [at(p) for p in drawing.patch_mm], fill=False)
    canvas.setDash()
    _draw_sheet_arrow(canvas, at, drawing)
    _draw_chains(canvas, at, picture, drawing)
    if side == "top":
        write(canvas, "front", picture.right + 0.6, picture.y + picture.height / 2 - 1, 2.8, 9, BOLD, colour=SOFT)


def _draw_sheet_arrow(canvas: "Canvas", at, drawing: MountDrawing) -> None:
    """Across the sheet's middle to where the page's arrow, or its upper edge, must point."""
    reach = 0.34 * drawing.size_mm * drawing.arrow_mm
    draw_block_arrow(canvas, at(drawing.centre_mm - reach), at(drawing.centre_mm + reach), 2.6, SHEET)


def _draw_chains(canvas: "Canvas", at, picture: Rect, drawing: MountDrawing) -> None:
    """Chains of dimensions below and on the left: edge of the object, sheet, other edge."""
    b, gaps = drawing.sheet_mm, drawing.gaps_mm
    left, low, right, high = drawing.extremes_mm
    level, upright = picture.y - 4.5, picture.x - 4.5
    corners = [at(left), at((b[0], b[1])), at((b[2], b[1])), at(right)]
    for x, y in corners:
        _extend(canvas, (x, y), (x, level - 1.0))
    for start, end, mm in zip(corners[:-1], corners[1:], (gaps[0], b[2] - b[0], gaps[2]), strict=True):
        _chain_link(canvas, (start[0], level), (end[0], level), mm)
    corners = [at(low), at((b[0], b[1])), at((b[0], b[3])), at(high)]
    for x, y in corners:
        _extend(canvas, (x, y), (upright - 1.0, y))
    for start, end, mm in zip(corners[:-1], corners[1:], (gaps[1], b[3] - b[1], gaps[3]), strict=True):
        _chain_link(canvas, (upright, start[1]), (upright, end[1]), mm)


def _extend(canvas: "Canvas", start: tuple[float, float], end: tuple[float, float]) -> None:
    set_ink(canvas, SOFT, 0.12)
    canvas.setDash(0.5, 0.6)
    canvas.line(*start, *end)
    canvas.setDash()


def _chain_link(canvas: "Canvas", start: tuple[float, float], end: tuple[float, float], mm: float) -> None:
    words = f"{mm:.0f}" if mm >= 0.5 else (f"over {-mm:.0f}" if mm <= -0.5 else "0")
    draw_dimension(canvas, start, end, words)
