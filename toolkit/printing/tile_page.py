"""One tile of a sheet that is larger than the paper."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from toolkit.printing.marks import draw_crop_marks, draw_overlap_marks
from toolkit.printing.plan import TilePage

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
