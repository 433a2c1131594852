"""The first pages of an object: how to stick the patch, the walk round the object, the camera, the board."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.objects.load import TableObject
from toolkit.printing.canvas import BOLD
from toolkit.printing.page import Rect
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
)
from toolkit.printing.shot_list.mounting import CHAINS_MM, MountDrawing, draw_mounting_plan, encode_jpeg
from toolkit.printing.shot_list.places import CameraPlace, Stretch, find_stretches, goes_round, name_change
from toolkit.printing.shot_list.session import draw_walk
from toolkit.rig.board import Board, CharucoBoard
from toolkit.rig.camera import Camera
from toolkit.rig.variants import Print

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

    from toolkit.printing.shot_list.session import ObjectSession

FILM_DIAGONAL_MM = 43.27
"""Of a 36 × 24 mm frame: CIPA's 35 mm equivalent is by the diagonal, which matters for frames of 4:3."""
PHONE_MM = 25.0
"""Equivalent focal length of most phones' main camera, whose zoom counts from it."""


def equivalent_focal_mm(camera: Camera) -> float:
    """The 35 mm equivalent focal length with the camera's field of view, by the diagonal."""
    return FILM_DIAGONAL_MM * camera.fx / float(np.hypot(camera.width, camera.height))


def advise_camera(camera: Camera, places: Sequence[CameraPlace]) -> list[str]:
    """Lens, exposure and file settings."""
    focal = equivalent_focal_mm(camera)
    zoom = focal / PHONE_MM
    near, far = min(p.distance_mm for p in places) / 10, max(p.distance_mm for p in places) / 10
    held = "level, the long side across" if camera.width >= camera.height else "upright, the long side up"
    divisor = int(np.gcd(camera.width, camera.height))
    frame = f"{camera.width // divisor}:{camera.height // divisor}"
    return [
        f"Frame {frame}, held {held}. Zoom until the picture looks like the card's: {focal:.0f} mm (35 mm equivalent), "
        f"on a phone's main camera about {zoom:.1f}×. Do not touch the zoom again.",
        f"The lens stands {near:.0f} to {far:.0f} cm from the object; aim the cross at the middle of the picture. "
        "A tripod and the 2 s timer keep it still; a few degrees or centimetres off do no harm.",
        "At the first place hold a finger on the object to lock focus and exposure, and keep them for all shots.",
        "Off: flash, HDR, night and portrait mode, filters, beauty. JPEG or HEIC at full size.",
    ]


def advise_stage(board: Board | None, item: TableObject) -> list[str]:
    """The board, the object on it, and the light."""
    lines = []
    if board is not None:
        kind = "board" if isinstance(board, CharucoBoard) else "ring"
        width, height = board.size_mm
        lines.append(
            f"Print the {kind} with 'toolkit print --{kind}' at 100 % ({width:.0f} × {height:.0f} mm, "
            f"{board.describe().split(', markers')[0]}); tape it flat to the table."
        )
        lines.append(
            f"Stand the object on the middle of the {kind}, its front to the edge marked FRONT. "
            "It stays there until all its shots are taken."
        )
    lines.append("Azimuth 0° looks at the object's front; it grows counter-clockwise as seen from above.")
    lines.append("Lamps only, blinds shut: daylight drifts. Keep your own shadow off the object.")
    return lines


def advise_sticking(item: TableObject, booster: Print, patch_pdf: str | None, drawing: MountDrawing) -> list[str]:
    """From the printer to the object, in order."""
    at, rotation_deg = drawing.mount.at, drawing.mount.rotation_deg
    turned = abs(rotation_deg) > 0.5
    page = f"Print {patch_pdf}" if patch_pdf else f"Make the page with 'toolkit print --object {item.name}', print it"
    where = {"top": "on top of the object", "back": "on the object's back"}.get(at, f"on the object's {at}")
    way = "the arrow in its margin towards the object's front" if at == "top" else "the page's upper edge up"
    if turned:
        way += f", turned {abs(rotation_deg):.0f}° {_hand(rotation_deg)}"
    which = "" if drawing.count == 1 else f"sheet {drawing.number} "
    return [
        f"{page} at 100 %, check its bars, cut {which}at the corner marks: {drawing.cut_mm:.1f} mm square.",
        f"Lay it {where} as drawn, {way}. The numbers are millimetres from the object's outermost edges, "
        "measured straight across.",
        "Tape it by its white edge only. No bubbles, no tape over the picture.",
        "Leave it alone until its last shot: a sheet that moves spoils the pairs.",
    ]


def explain_order(stretches: Sequence[Stretch]) -> str:
    """Why the rounds are cut in two, where they are: half of the unpatched shots before the others, half after."""
    names = [stretch.variant for stretch in stretches]
    if len(set(names)) > 1 and names[0] == names[-1] == "unpatched":
        return (
            "Half of the unpatched shots come before the others and half after them, so that light that drifts "
            "favours neither."
        )
    return ""


def _hand(rotation_deg: float) -> str:
    return "counter-clockwise" if rotation_deg > 0 else "clockwise"


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
    drawing = session.mountings[0] if session.mountings else None
    frame = drawing.frame_mm if drawing else (0.0, 0.0, 2.0, 1.0)
    parts = split_page(area, (frame[2] - frame[0]) / (frame[3] - frame[1]))
    if drawing is None or session.booster is None:
        _draw_missing(canvas, Rect(area.x, parts.mount.y, area.width, parts.mount.height), session)
    else:
        draw_mounting_plan(canvas, parts.mount, drawing)
        _draw_sticking(canvas, parts.steps, session, session.booster, drawing)
    draw_title(canvas, parts.walk, "The walk")
    draw_walk(canvas, Rect(parts.walk.x, parts.walk.y, parts.walk.width, parts.walk.height - 4), session.around,
              session.stops)  # fmt: skip
    _draw_rounds(canvas, parts.rounds, session)
    _draw_advice(canvas, parts.camera, "The camera", advise_camera(session.camera, session.places))
    _draw_advice(canvas, parts.stage, "The table", advise_stage(session.board, session.item))


SHEETS_A_PAGE = 2


def draw_sheets_page(canvas: "Canvas", area: Rect, session: "ObjectSession", drawings: Sequence[MountDrawing]) -> None:
    """Up to `SHEETS_A_PAGE` further sheets, each drawn as the first page draws the first."""
    assert session.booster is not None
    height, left = area.height / SHEETS_A_PAGE, 0.6 * area.width
    for row, drawing in enumerate(drawings):
        y = area.top - (row + 1) * height + GAP_MM
        draw_mounting_plan(canvas, Rect(area.x, y, left, height - GAP_MM), drawing)
        steps = Rect(area.x + left + GAP_MM, y, area.width - left - GAP_MM, height - GAP_MM)
        _draw_sticking(canvas, steps, session, session.booster, drawing)


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
    write(canvas, booster.name, beside.x, beside.top - 3.0, 3.2, room_mm=beside.width, font=BOLD, colour=SHEET)
    y = beside.top - 7.4
    for words in (
        f"sheet {drawing.cut_mm:.1f} mm", f"patch {drawing.size_mm:.1f} mm", f"sha256 {booster.sha256[:12]}",
    ):  # fmt: skip
        write(canvas, words, beside.x, y, 2.5, room_mm=beside.width)
        y -= 3.7
    _draw_page_arrow(canvas, sheet, drawing.mount.at)
    y = sheet.y - 9.0
    for number, words in enumerate(advise_sticking(session.item, booster, session.patch_pdf, drawing), 1):
        write(canvas, str(number), inside.x, y, TEXT_MM, room_mm=4, font=BOLD, colour=SHEET)
        y = write_lines(canvas, words, inside.x + 4.4, y, TEXT_MM - 0.1, room_mm=inside.width - 4.4) - 1.0


def _draw_page_arrow(canvas: "Canvas", sheet: Rect, side: str) -> None:
    """The way that the sheet's right (on top of an object) or upper edge must point, as on its printed page."""
    word = "front" if side == "top" else "up"
    y = sheet.y - 3.6
    end = sheet.x + write(canvas, word, sheet.x, y, 2.6, room_mm=20, font=BOLD, colour=SHEET) + 1.2
    set_ink(canvas, SHEET, 0.4)
    if side == "top":
        draw_arrow(canvas, (end, y + 0.9), (end + 7.5, y + 0.9), 2.2)
    else:
        draw_arrow(canvas, (end + 0.6, y - 0.6), (end + 0.6, y + 2.6), 1.8)


def _draw_missing(canvas: "Canvas", area: Rect, session: "ObjectSession") -> None:
    draw_panel(canvas, area)
    inside = Rect(area.x + 5, area.y + 5, area.width - 10, area.height - 10)
    y = draw_title(canvas, inside, "Unpatched only: there is no sheet to stick on", SHEET)
    write_lines(
        canvas, session.note or "No variant with a sheet was asked for.", inside.x, y, 3.0, room_mm=inside.width
    )


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
        write_lines(canvas, words, area.x, y, TEXT_MM, room_mm=area.width)
        return
    turns = {1: "once", 2: "twice"}.get(len(session.stops[0].shots), f"{len(session.stops[0].shots)} times")
    words = f"{shots} shots at {len(session.stops)} places, {turns} round. {explain_order(stretches)}".strip()
    y = write_lines(canvas, words, area.x, y, TEXT_MM, room_mm=area.width) - 2.6
    step = min(7.6, (y - area.y) / max(_count_rows(stretches, session.sheets), 1))
    before: str | None = None
    for stretch in stretches:
        if change := name_change(before, stretch.variant, session.sheets):
            y = _draw_row(canvas, area, y, step, change, right="", colour=SHEET)
        a, b = stretch.stops
        where = f"places {a}-{b}" if a != b else f"place {a}"
        y = _draw_row(canvas, area, y, step, f"{stretch.variant}, {where}", right=_name_shots(stretch), colour=INK)
        before = stretch.variant
    if before not in (None, "unpatched"):
        _draw_row(canvas, area, y, step, name_change(before, "unpatched", session.sheets), right="", colour=SHEET)


def _count_rows(stretches: Sequence[Stretch], sheets: int) -> int:
    before: str | None = None
    rows = 1
    for stretch in stretches:
        rows += 2 if name_change(before, stretch.variant, sheets) else 1
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
    taken = (
        write(canvas, right, area.right, y, TEXT_MM, room_mm=0.4 * area.width, align="right", colour=SOFT)
        if right
        else 0.0
    )
    write(canvas, words, text, y, 3.0, room_mm=area.right - text - taken - 2, font=BOLD, colour=colour)
    return y - step


def _draw_advice(canvas: "Canvas", area: Rect, title: str, lines: Sequence[str]) -> None:
    y = draw_title(canvas, area, title)
    for words in lines:
        set_ink(canvas, CAMERA)
        canvas.circle(area.x + 0.8, y + 0.9, 0.55, stroke=0, fill=1)
        y = write_lines(canvas, words, area.x + 3.2, y, TEXT_MM - 0.1, room_mm=area.width - 3.2) - 0.9
