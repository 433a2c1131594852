"""One camera place on a card: its pictures with tick boxes, its drawings and numbers, a line for notes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from toolkit.printing.frame import Rect
from toolkit.printing.shot_list.drawings import (
    CAMERA,
    FAINT,
    INK,
    SHEET,
    SOFT,
    TICK_MM,
    WHITE,
    draw_panel,
    draw_tick_box,
    fit_grid,
    place_picture,
    set_ink,
    write,
)  # fmt: skip
from toolkit.printing.shot_list.place_drawings import Surroundings, draw_from_above, draw_from_side
from toolkit.printing.shot_list.places import Stop
from toolkit.printing.text import BOLD

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

NUMBER_MM = 14.0
ABOVE_MM = 35.0
NOTES_MM = 5.5
PAD_MM = 1.6
CAPTION_MM = 5.2


def draw_card(
    canvas: "Canvas", area: Rect, stop: Stop, views: Mapping[tuple[str, int], bytes], aspect: float,
    around: Surroundings, rounds: bool, last: bool,
) -> None:  # fmt: skip
    """Draw one place into its area.

    Args:
        canvas: in millimetres.
        area: of the card.
        stop: the place and its shots.
        views: JPEGs by (variant, pose id).
        aspect: width over height of the pictures.
        around: what the object's drawings share.
        rounds: name the round of each shot, for orders in which the camera goes round once per variant.
        last: no line below it.
    """
    if not last:
        set_ink(canvas, FAINT, 0.2)
        canvas.line(area.x, area.y, area.right, area.y)
    inside = Rect(area.x, area.y + PAD_MM, area.width, area.height - 2 * PAD_MM)
    _draw_number(canvas, inside, stop)
    side_mm = min(0.285 * area.width, 56.0)
    pictures = Rect(
        inside.x + NUMBER_MM, inside.y, inside.width - NUMBER_MM - ABOVE_MM - side_mm - 2, inside.height
    )  # fmt: skip
    _draw_pictures(canvas, pictures, stop, views, aspect, rounds)
    drawn = inside.height - NOTES_MM
    draw_from_above(canvas, Rect(pictures.right + 2, inside.top - drawn, ABOVE_MM, drawn), around, stop.place)
    draw_from_side(canvas, Rect(area.right - side_mm, inside.top - drawn, side_mm, drawn), around, stop.place)
    taken = write(canvas, "notes", pictures.right + 3, inside.y + 1.0, 2.3, 12, colour=SOFT)
    set_ink(canvas, FAINT, 0.2)
    canvas.line(pictures.right + 4.5 + taken, inside.y + 0.6, area.right, inside.y + 0.6)


def _draw_number(canvas: "Canvas", inside: Rect, stop: Stop) -> None:
    middle = inside.x + NUMBER_MM / 2 - 1.0
    write(canvas, "place", middle, inside.top - 3.2, 2.3, NUMBER_MM, align="centre", colour=SOFT)
    write(canvas, str(stop.number), middle, inside.top - 12.0, 9.5, NUMBER_MM - 2.5, BOLD, "centre", INK)
    write(canvas, f"pose {stop.pose.id}", middle, inside.top - 16.6, 2.7, NUMBER_MM - 2, align="centre")
    if abs(stop.place.roll_deg) > 0.05:
        words = f"roll {stop.place.roll_deg:+.0f}°"
        write(canvas, words, middle, inside.top - 20.6, 2.5, NUMBER_MM - 2, align="centre", colour=CAMERA)


def _draw_pictures(canvas: "Canvas", room: Rect, stop: Stop, views, aspect: float, rounds: bool) -> None:
    """A picture per variant, always in the same places; under each its tick box and the number of its shot."""
    shots = {shot.variant: (turn, shot) for turn, shot in enumerate(stop.shots, 1)}
    order = sorted(shots, key=lambda variant: (variant != "unpatched", variant))
    cells = fit_grid(len(order), (room.width, room.height), aspect, 2.0, CAPTION_MM)
    if len(order) == 1:  # one picture keeps the size that it has beside another
        cells = fit_grid(2, (room.width, room.height), aspect, 2.0, CAPTION_MM)[:1]
    for variant, cell in zip(order, cells, strict=True):
        turn, shot = shots[variant]
        picture = Rect(room.x + cell.x, room.top + cell.y, cell.width, cell.height)
        place_picture(canvas, views[variant, stop.pose.id], picture)
        _draw_cross(canvas, picture)
        row = picture.y - CAPTION_MM + 0.7
        draw_tick_box(canvas, picture.x, row)
        text = picture.x + TICK_MM + 1.2
        colour = INK if variant == "unpatched" else SHEET
        words = f"shot {shot.number}" + (f", round {turn}" if rounds and 1 < len(stop.shots) < 3 else "")
        told = write(canvas, words, picture.right, row + 0.8, 2.4, 0.6 * picture.width, align="right")
        write(canvas, variant, text, row + 0.8, 2.7, picture.right - text - told - 1, BOLD, colour=colour)


def _draw_cross(canvas: "Canvas", picture: Rect) -> None:
    """A small cross at the picture's middle, to aim with: white under dark, so that it shows on both."""
    x, y = picture.x + picture.width / 2, picture.y + picture.height / 2
    for colour, line in ((WHITE, 0.45), (INK, 0.15)):
        set_ink(canvas, colour, line)
        canvas.line(x - 1.3, y, x + 1.3, y)
        canvas.line(x, y - 1.3, x, y + 1.3)


def draw_band(canvas: "Canvas", area: Rect, words: str) -> None:
    """A line between two cards that says what changes there, and in which round."""
    draw_panel(canvas, Rect(area.x, area.y + 0.6, area.width, area.height - 1.2), (0.985, 0.925, 0.895))
    write(canvas, words, area.x + area.width / 2, area.y + area.height / 2 - 1.0, 2.8, area.width - 6, BOLD, "centre",
          SHEET)  # fmt: skip
