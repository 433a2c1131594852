"""The sheet that an object stands on, as vector shapes: a ChArUco board or a ring, and what is written on its edge.

What is needed once the sheet is cut out and joined is printed on the sheet itself: which edge is the front, where the
middle is, and the spec. Millimetres from the sheet's lower left corner, y upwards.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from toolkit.printing.text import BOLD, draw_text, measure_text_mm
from toolkit.rig.board import BoardSpec, Sheet
from toolkit.rig.markers import black_rects, marker_modules
from toolkit.rig.ring import RingSpec

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

EDGE_MM = 3.0
"""White paper round a board; the colours of the table then never touch a square."""
FRONT_EDGE_MM = 8.0
"""The lower edge holds the word FRONT and the spec."""
TICK_MM = 2.0
LINE_MM = 0.15
FRONT = "FRONT"
FRONT_SIZE_MM = 4.0


def measure_sheet(spec: Sheet) -> tuple[float, float]:
    """Width and height of what is cut out."""
    width, height = spec.size_mm
    if isinstance(spec, RingSpec):
        return width, height
    return width + 2 * EDGE_MM, height + EDGE_MM + FRONT_EDGE_MM


def draw_table_sheet(canvas: "Canvas", spec: Sheet) -> None:
    """Draw a board or a ring at full size; its ink is the printer's own black, not a mixture of colours."""
    canvas.saveState()
    canvas.setFillGray(0)
    canvas.setStrokeGray(0)
    if isinstance(spec, BoardSpec):
        canvas.translate(EDGE_MM, FRONT_EDGE_MM)
        canvas.setFillGray(1 - spec.ink_percent / 100)
        _fill(canvas, spec.black_squares(), spec.size_mm[1])
        _draw_markers(canvas, spec)
        canvas.setFillGray(0)
        _write_on_board(canvas, spec)
    else:
        canvas.setFillGray(1 - spec.ink_percent / 100)
        _draw_markers(canvas, spec)
        canvas.setFillGray(0)
        _write_in_ring(canvas, spec)
    canvas.restoreState()


def _fill(canvas: "Canvas", rects: np.ndarray, top: float) -> None:
    """Fill (k, 4) rectangles, counted downwards from `top`, as one shape: no seams where they touch."""
    path = canvas.beginPath()
    for left, upper, right, lower in rects.tolist():
        path.rect(left, top - lower, right - left, lower - upper)
    canvas.drawPath(path, stroke=0, fill=1, fillMode=1)


def _draw_markers(canvas: "Canvas", spec: Sheet) -> None:
    half = spec.marker_mm / 2
    for marker_id, middle, turn in spec.placements():
        canvas.saveState()
        canvas.translate(middle[0], spec.size_mm[1] - middle[1])
        if turn:
            canvas.rotate(math.degrees(turn))
        _fill(canvas, black_rects(marker_modules(spec.dictionary, marker_id)) * spec.marker_mm - half, 0)
        canvas.restoreState()


def _draw_front(canvas: "Canvas", x: float, baseline: float) -> float:
    """The word FRONT about x between two arrows that point down the page; returns its half width."""
    half = measure_text_mm(FRONT, BOLD, FRONT_SIZE_MM) / 2
    draw_text(canvas, FRONT, x, baseline, FRONT_SIZE_MM, 4 * half, BOLD, "centre")
    for side in (-1, 1):
        at, head = x + side * (half + 3), canvas.beginPath()
        head.moveTo(at - 1.6, baseline + 3)
        head.lineTo(at + 1.6, baseline + 3)
        head.lineTo(at, baseline - 0.2)
        head.close()
        canvas.drawPath(head, stroke=0, fill=1)
    return half + 6


def _write_on_board(canvas: "Canvas", spec: BoardSpec) -> None:
    """Below the squares the front and the spec; a short line in the middle of every edge, to stand the object by."""
    width, height = spec.size_mm
    canvas.setLineWidth(2 * LINE_MM)
    gap = (EDGE_MM - TICK_MM) / 2
    for y in (-gap - TICK_MM, height + gap):
        canvas.line(width / 2, y, width / 2, y + TICK_MM)
    for x in (-gap - TICK_MM, width + gap):
        canvas.line(x, height / 2, x + TICK_MM, height / 2)
    taken = _draw_front(canvas, width / 2, -FRONT_EDGE_MM + 1.2)
    draw_text(canvas, spec.describe(), 0, -FRONT_EDGE_MM + 1.4, 2.2, width / 2 - taken - 2)


def _write_in_ring(canvas: "Canvas", spec: RingSpec) -> None:
    """In the free disc its two axes, the front and the spec; round it all the line to cut along."""
    middle, radius = spec.outer_mm / 2, spec.inner_mm / 2
    canvas.setLineWidth(LINE_MM)
    canvas.setStrokeGray(0.6)
    canvas.circle(middle, middle, middle - LINE_MM, stroke=1, fill=0)
    canvas.circle(middle, middle, radius - 1, stroke=1, fill=0)
    canvas.line(middle - radius + 1, middle, middle + radius - 1, middle)
    canvas.line(middle, middle - radius + 1 + 2 * FRONT_SIZE_MM, middle, middle + radius - 1)
    front = middle - radius + FRONT_SIZE_MM
    _draw_front(canvas, middle, front)
    canvas.setFillGray(0)
    draw_text(canvas, spec.describe(), middle + 3, middle - 4, 2.2, radius - 8)
