"""What the pages are drawn with: colours, arrows, dimension lines, tick boxes, paragraphs. Millimetres."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from toolkit.printing.canvas import BOLD, PLAIN, draw_text, drawable, measure_text_mm
from toolkit.printing.page import Rect

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

Colour = tuple[float, float, float]
Point = tuple[float, float]
INK: Colour = (0.10, 0.12, 0.15)
SOFT: Colour = (0.42, 0.45, 0.49)
FAINT: Colour = (0.80, 0.82, 0.84)
WASH: Colour = (0.945, 0.95, 0.957)
WHITE: Colour = (1.0, 1.0, 1.0)
CAMERA: Colour = (0.05, 0.36, 0.62)
SHEET: Colour = (0.80, 0.25, 0.10)
OBJECT: Colour = (0.70, 0.72, 0.75)
"""Camera blue, sheet vermilion: apart in print without colour too, by their darkness."""
TICK_MM = 3.6


def set_ink(canvas: "Canvas", colour: Colour, line_mm: float | None = None) -> None:
    """Both fill and stroke colour, and the width of lines."""
    canvas.setFillColorRGB(*colour)
    canvas.setStrokeColorRGB(*colour)
    if line_mm is not None:
        canvas.setLineWidth(line_mm)


def write(
    canvas: "Canvas", text: str, x: float, y: float, size_mm: float, room_mm: float, font: str = PLAIN,
    align: str = "left", colour: Colour = INK,
) -> float:  # fmt: skip
    """`draw_text` in a colour; returns the line's width."""
    set_ink(canvas, colour)
    return draw_text(canvas, text, x, y, size_mm, room_mm=room_mm, font=font, align=align)


def write_lines(
    canvas: "Canvas", text: str, x: float, y: float, size_mm: float, room_mm: float, colour: Colour = INK
) -> float:
    """A paragraph broken at blanks, first baseline at y; returns the baseline that a next line would have."""
    line = ""
    words = drawable(text, PLAIN).split(" ")
    for i, word in enumerate(words):
        line = f"{line} {word}".strip()
        following = f"{line} {words[i + 1]}" if i + 1 < len(words) else None
        if following is None or measure_text_mm(following, PLAIN, size_mm) > room_mm:
            write(canvas, line, x, y, size_mm, room_mm=room_mm, colour=colour)
            y -= 1.38 * size_mm
            line = ""
    return y


def write_on_white(
    canvas: "Canvas", text: str, x: float, y: float, size_mm: float, font: str = PLAIN, colour: Colour = INK,
    plate: Colour = WHITE,
) -> None:  # fmt: skip
    """A line centred at (x, y) on a plate, so that lines below do not cross it."""
    width = measure_text_mm(text, font, size_mm)
    set_ink(canvas, plate)
    canvas.rect(x - width / 2 - 0.4, y - 0.55 * size_mm, width + 0.8, 1.1 * size_mm, stroke=0, fill=1)
    write(canvas, text, x, y - 0.36 * size_mm, size_mm, room_mm=width + 1, font=font, align="centre", colour=colour)


def draw_shape(canvas: "Canvas", points: Iterable[Point], fill: bool = True, close: bool = True) -> None:
    """A polygon, filled, or a line through points."""
    path = canvas.beginPath()
    for i, (x, y) in enumerate(points):
        (path.lineTo if i else path.moveTo)(float(x), float(y))
    if close:
        path.close()
    canvas.drawPath(path, stroke=0 if fill else 1, fill=1 if fill else 0)


def draw_shapes(canvas: "Canvas", outlines: Iterable[np.ndarray], scale: float, x: float, y: float) -> None:
    """Outlines (k, 2) in the object's millimetres, made small about (x, y), filled by the even-odd rule."""
    path = canvas.beginPath()
    for outline in outlines:
        for i, (u, v) in enumerate(np.asarray(outline) * scale + (x, y)):
            (path.lineTo if i else path.moveTo)(float(u), float(v))
        path.close()
    canvas.drawPath(path, stroke=0, fill=1, fillMode=0)


def draw_head(canvas: "Canvas", tip: Point, angle_deg: float, length: float = 1.6) -> None:
    """An arrow's head whose tip is there, pointing along the angle (counter-clockwise from the right)."""
    canvas.saveState()
    canvas.translate(*tip)
    canvas.rotate(angle_deg)
    draw_shape(canvas, [(0, 0), (-length, 0.36 * length), (-length, -0.36 * length)])
    canvas.restoreState()


def draw_arrow(canvas: "Canvas", start: Point, end: Point, head: float = 1.6) -> None:
    """A line with a head at its end."""
    way = np.subtract(end, start)
    length = float(np.hypot(*way))
    if length < 1e-6:
        return
    stop = np.asarray(end) - way / length * min(0.8 * head, length)
    canvas.line(*start, float(stop[0]), float(stop[1]))
    draw_head(canvas, end, float(np.degrees(np.arctan2(way[1], way[0]))), head)


def draw_block_arrow(canvas: "Canvas", start: Point, end: Point, width: float, colour: Colour) -> None:
    """A broad arrow with a white rim, which shows on any picture."""
    way = np.subtract(end, start)
    length = float(np.hypot(*way))
    head, half = min(1.9 * width, 0.6 * length), width / 2
    canvas.saveState()
    canvas.translate(*start)
    canvas.rotate(float(np.degrees(np.arctan2(way[1], way[0]))))
    path = canvas.beginPath()
    path.moveTo(0, half)
    for x, y in ((length - head, half), (length - head, 2.3 * half), (length, 0), (length - head, -2.3 * half),
                 (length - head, -half), (0, -half)):  # fmt: skip
        path.lineTo(x, y)
    path.close()
    canvas.setFillColorRGB(*colour)
    canvas.setStrokeColorRGB(*WHITE)
    canvas.setLineWidth(0.5)
    canvas.drawPath(path, stroke=1, fill=1)
    canvas.restoreState()


def draw_dimension(
    canvas: "Canvas", start: Point, end: Point, text: str, size_mm: float = 2.7, colour: Colour = INK
) -> None:
    """A dimension line with heads at both ends and its number on a white plate in the middle, upright."""
    set_ink(canvas, colour, 0.18)
    way = np.subtract(end, start)
    length, angle = float(np.hypot(*way)), float(np.degrees(np.arctan2(way[1], way[0])))
    canvas.line(*start, *end)
    if length > 3.0:
        draw_head(canvas, end, angle, 1.3)
        draw_head(canvas, start, angle + 180, 1.3)
    write_on_white(canvas, text, (start[0] + end[0]) / 2, (start[1] + end[1]) / 2, size_mm, colour=colour)


def draw_tick_box(canvas: "Canvas", x: float, y: float, side: float = TICK_MM) -> None:
    """An empty box whose lower left corner is (x, y)."""
    canvas.setFillColorRGB(*WHITE)
    canvas.setStrokeColorRGB(*INK)
    canvas.setLineWidth(0.3)
    canvas.roundRect(x, y, side, side, 0.5, stroke=1, fill=1)


def draw_panel(canvas: "Canvas", area: Rect, colour: Colour = WASH, radius: float = 1.6) -> None:
    """A rounded, tinted rectangle."""
    set_ink(canvas, colour)
    canvas.roundRect(area.x, area.y, area.width, area.height, radius, stroke=0, fill=1)


def draw_camera(canvas: "Canvas", at: Point, angle_deg: float, size: float = 3.4) -> None:
    """A camera whose lens is at `at` and looks along the angle."""
    canvas.saveState()
    canvas.translate(*at)
    canvas.rotate(angle_deg)
    set_ink(canvas, CAMERA)
    canvas.roundRect(-1.25 * size, -0.5 * size, 0.9 * size, size, 0.14 * size, stroke=0, fill=1)
    draw_shape(canvas, [(-0.4 * size, -0.18 * size), (0, -0.34 * size), (0, 0.34 * size), (-0.4 * size, 0.18 * size)])
    canvas.restoreState()


def draw_arc(canvas: "Canvas", centre: Point, radius: float, start_deg: float, extent_deg: float) -> None:
    """An arc, counter-clockwise from `start_deg`."""
    x, y = centre
    canvas.arc(x - radius, y - radius, x + radius, y + radius, start_deg, extent_deg)


def place_picture(canvas: "Canvas", jpeg: bytes, area: Rect, frame: Colour | None = FAINT) -> None:
    """A JPEG stretched over an area, with a thin frame."""
    from io import BytesIO

    from reportlab.lib.utils import ImageReader

    canvas.drawImage(ImageReader(BytesIO(jpeg)), area.x, area.y, area.width, area.height)
    if frame is not None:
        canvas.setStrokeColorRGB(*frame)
        canvas.setLineWidth(0.2)
        canvas.rect(area.x, area.y, area.width, area.height, stroke=1, fill=0)


def fit_grid(count: int, room: tuple[float, float], aspect: float, gap: float, below: float) -> Sequence[Rect]:
    """Cells of pictures, as large as fit a room (width, height) with `below` millimetres of words under each.

    The rectangles are those of the pictures, counted from the room's upper left corner, y upwards and so negative.
    """
    best: tuple[float, int] = (0.0, 1)
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        width = (room[0] - (columns - 1) * gap) / columns
        height = (room[1] - (rows - 1) * gap) / rows - below
        best = max(best, (min(width, height * aspect), columns), key=lambda pair: round(pair[0], 6))
    width, columns = best
    height = width / aspect
    return [
        Rect(i % columns * (width + gap), -height - i // columns * (height + below + gap), width, height)
        for i in range(count)
    ]


def draw_title(canvas: "Canvas", area: Rect, words: str, colour: Colour = INK) -> float:
    """A part's heading; returns the baseline of the line below."""
    write(canvas, words, area.x, area.top - 3.2, 3.7, room_mm=area.width, font=BOLD, colour=colour)
    return area.top - 9.2
