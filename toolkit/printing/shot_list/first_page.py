"""The first page of an object: how to stick the patch, the walk round the object, the camera, the board."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.captures.variants import Print
from toolkit.printing.frame import Rect
from toolkit.printing.shot_list.advice import advise_camera, advise_stage, advise_sticking, explain_order
from toolkit.printing.shot_list.drawings import (
    CAMERA,
    INK,
    SHEET,
    SOFT,
    TICK_MM,
    WHITE,
    Colour,
    draw_arrow,
    draw_panel,
    draw_tick_box,
    draw_title,
    place_picture,
    set_ink,
    write,
    write_lines,
)  # fmt: skip
from toolkit.printing.shot_list.mounting import MountDrawing
from toolkit.printing.shot_list.mounting_plan import CHAINS_MM, draw_mounting_plan
from toolkit.printing.shot_list.place_drawings import draw_walk
from toolkit.printing.shot_list.places import Stretch, find_stretches, goes_round, name_change
from toolkit.printing.shot_list.views import encode_jpeg
from toolkit.printing.text import BOLD

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

    from toolkit.printing.shot_list.session import ObjectSession

TEXT_MM = 2.75
GAP_MM = 4.0


@dataclass(frozen=True)
class Columns:
    """Where the first page's parts go."""

    mount: Rect
    steps: Rect
    walk: Rect
    rounds: Rect
    camera: Rect
    stage: Rect


def split_page(area: Rect, aspect: float) -> Columns:
    """Three rows of two: mounting and steps, walk and rounds, camera and stage.

    Args:
        area: the page without header and footer.
        aspect: width over height of the mounting's picture; the first row is as high as it needs.
    """
    left = 0.6 * area.width
    third = 0.23 * area.height
    first = float(np.clip((left - CHAINS_MM) / aspect + CHAINS_MM + GAP_MM, 0.365 * area.height, 0.42 * area.height))
    second = area.height - first - third
    right_x, right = area.x + left + GAP_MM, area.width - left - GAP_MM
    walk = min(second - 2 * GAP_MM, 0.5 * area.width)
    half = (area.width - 2 * GAP_MM) / 2
    y1, y2 = area.top - first + GAP_MM, area.y + third + GAP_MM
    return Columns(
        mount=Rect(area.x, y1, left, first - GAP_MM),
        steps=Rect(right_x, y1, right, first - GAP_MM),
        walk=Rect(area.x, y2, walk, second - 2 * GAP_MM),
        rounds=Rect(area.x + walk + 2 * GAP_MM, y2, area.width - walk - 2 * GAP_MM, second - 2 * GAP_MM),
        camera=Rect(area.x, area.y, half, third - GAP_MM),
        stage=Rect(area.x + half + 2 * GAP_MM, area.y, half, third - GAP_MM),
    )


def draw_first_page(canvas: "Canvas", area: Rect, session: "ObjectSession") -> None:
    """Draw the whole page."""
    drawing = session.mounting
    frame = drawing.frame_mm if drawing else (0.0, 0.0, 2.0, 1.0)
    parts = split_page(area, (frame[2] - frame[0]) / (frame[3] - frame[1]))
    if session.mounting is None or session.booster is None:
        _draw_missing(canvas, Rect(area.x, parts.mount.y, area.width, parts.mount.height), session)
    else:
        draw_mounting_plan(canvas, parts.mount, session.mounting, session.item.spec.patch.at)
        _draw_sticking(canvas, parts.steps, session, session.booster, session.mounting)
    draw_title(canvas, parts.walk, "The walk")
    draw_walk(canvas, Rect(parts.walk.x, parts.walk.y, parts.walk.width, parts.walk.height - 4), session.around,
              session.stops)  # fmt: skip
    _draw_rounds(canvas, parts.rounds, session)
    _draw_advice(canvas, parts.camera, "The camera", advise_camera(session.camera, session.places))
    _draw_advice(canvas, parts.stage, "The table", advise_stage(session.board, session.item))


def _draw_sticking(
    canvas: "Canvas", area: Rect, session: "ObjectSession", booster: Print, drawing: MountDrawing
) -> None:
    """The sheet as it comes out of the printer, and how to stick it."""
    draw_panel(canvas, area)
    inside = Rect(area.x + 3, area.y + 2, area.width - 6, area.height - 3.5)
    below = draw_title(canvas, inside, "Stick it like this")
    side = min(0.40 * inside.width, 0.34 * inside.height)
    sheet = Rect(inside.x, below - side + 2.5, side, side)
    canvas.setFillColorRGB(*WHITE)
    canvas.setStrokeColorRGB(*SHEET)
    canvas.setLineWidth(0.4)
    canvas.rect(sheet.x, sheet.y, side, side, stroke=1, fill=1)
    inner = sheet.centre(side * drawing.size_mm / drawing.cut_mm, side * drawing.size_mm / drawing.cut_mm)
    repeat = max(1, 400 // len(booster.pixels))
    place_picture(canvas, encode_jpeg(booster.pixels.repeat(repeat, 0).repeat(repeat, 1), 88), inner, None)
    beside = Rect(sheet.right + 3, sheet.y, inside.right - sheet.right - 3, side)
    write(canvas, booster.name, beside.x, beside.top - 3.0, 3.2, beside.width, BOLD, colour=SHEET)
    y = beside.top - 7.4
    for words in (
        f"sheet {drawing.cut_mm:.1f} mm", f"patch {drawing.size_mm:.1f} mm", f"sha256 {booster.sha256[:12]}",
    ):  # fmt: skip
        write(canvas, words, beside.x, y, 2.5, beside.width)
        y -= 3.7
    _draw_page_arrow(canvas, sheet, session.item.spec.patch.at)
    y = sheet.y - 9.0
    for number, words in enumerate(advise_sticking(session.item, booster, session.patch_pdf, drawing), 1):
        write(canvas, str(number), inside.x, y, TEXT_MM, 4, BOLD, colour=SHEET)
        y = write_lines(canvas, words, inside.x + 4.4, y, TEXT_MM - 0.1, inside.width - 4.4) - 1.0


def _draw_page_arrow(canvas: "Canvas", sheet: Rect, side: str) -> None:
    """The way that the sheet's right (on top of an object) or upper edge must point, as on its printed page."""
    word = "front" if side == "top" else "up"
    y = sheet.y - 3.6
    end = sheet.x + write(canvas, word, sheet.x, y, 2.6, 20, BOLD, colour=SHEET) + 1.2
    set_ink(canvas, SHEET, 0.4)
    if side == "top":
        draw_arrow(canvas, (end, y + 0.9), (end + 7.5, y + 0.9), 2.2)
    else:
        draw_arrow(canvas, (end + 0.6, y - 0.6), (end + 0.6, y + 2.6), 1.8)


def _draw_missing(canvas: "Canvas", area: Rect, session: "ObjectSession") -> None:
    draw_panel(canvas, area)
    inside = Rect(area.x + 5, area.y + 5, area.width - 10, area.height - 10)
    y = draw_title(canvas, inside, "Unpatched only: there is no sheet to stick on", SHEET)
    write_lines(canvas, session.note or "No variant with a sheet was asked for.", inside.x, y, 3.0, inside.width)


def _draw_rounds(canvas: "Canvas", area: Rect, session: "ObjectSession") -> None:
    """What is shot in which stretch, with a box to tick for each and for each change of the sheet."""
    stretches = find_stretches(session.stops)
    rounds = goes_round(stretches, session.stops)
    y = draw_title(canvas, area, "The rounds" if rounds else "At each place")
    shots = sum(len(stop.shots) for stop in session.stops)
    if not rounds:
        words = (
            f"{shots} shots at {len(session.stops)} places. At each place all variants are shot one after the other, "
            "in the order of their numbers, without moving the camera: the sheet goes on and off each time, to the "
            "same place to the millimetre."
        )
        write_lines(canvas, words, area.x, y, TEXT_MM, area.width)
        return
    turns = {1: "once", 2: "twice"}.get(len(session.stops[0].shots), f"{len(session.stops[0].shots)} times")
    words = f"{shots} shots at {len(session.stops)} places, {turns} round. {explain_order(stretches)}".strip()
    y = write_lines(canvas, words, area.x, y, TEXT_MM, area.width) - 2.6
    step = min(7.6, (y - area.y) / max(_count_rows(stretches), 1))
    before: str | None = None
    for stretch in stretches:
        if change := name_change(before, stretch.variant):
            y = _draw_row(canvas, area, y, step, change, "", SHEET)
        a, b = stretch.stops
        where = f"places {a}-{b}" if a != b else f"place {a}"
        y = _draw_row(canvas, area, y, step, f"{stretch.variant}, {where}", _name_shots(stretch), INK)
        before = stretch.variant
    if before not in (None, "unpatched"):
        _draw_row(canvas, area, y, step, name_change(before, "unpatched"), "", SHEET)


def _count_rows(stretches: Sequence[Stretch]) -> int:
    before: str | None = None
    rows = 1
    for stretch in stretches:
        rows += 2 if name_change(before, stretch.variant) else 1
        before = stretch.variant
    return rows


def _name_shots(stretch: Stretch) -> str:
    a, b = stretch.shots
    return f"shots {a}-{b}" if a != b else f"shot {a}"


def _draw_row(
    canvas: "Canvas", area: Rect, y: float, step: float, words: str, right: str, colour: Colour
) -> float:  # fmt: skip
    draw_tick_box(canvas, area.x, y - 0.8)
    text = area.x + TICK_MM + 2
    taken = write(canvas, right, area.right, y, TEXT_MM, 0.4 * area.width, align="right", colour=SOFT) if right else 0.0
    write(canvas, words, text, y, 3.0, area.right - text - taken - 2, BOLD, colour=colour)
    return y - step


def _draw_advice(canvas: "Canvas", area: Rect, title: str, lines: Sequence[str]) -> None:
    y = draw_title(canvas, area, title)
    for words in lines:
        set_ink(canvas, CAMERA)
        canvas.circle(area.x + 0.8, y + 0.9, 0.55, stroke=0, fill=1)
        y = write_lines(canvas, words, area.x + 3.2, y, TEXT_MM - 0.1, area.width - 3.2) - 0.9
