"""Contents of an object's pages, and its first pages: sticking the patch, the walk, camera and table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from toolkit.core.console import Ticker
from toolkit.objects.load import TableObject
from toolkit.printing.canvas import BOLD, CAMERA, INK, SHEET, SOFT, TICK_MM, WHITE, Pdf
from toolkit.printing.page import Rect
from toolkit.rig.applied.base import AppliedBooster
from toolkit.rig.board import Board, CharucoBoard
from toolkit.rig.camera import Camera
from toolkit.rig.plan import CapturePlan
from toolkit.rooms.photos.shot_list.mounting import (
    CHAINS_MM,
    MountDrawing,
    draw_mounting_plan,
    draw_mountings,
    draw_views,
    encode_jpeg,
)
from toolkit.rooms.photos.shot_list.tour import (
    CameraPlace,
    Stop,
    Surroundings,
    TourLeg,
    draw_walk,
    find_legs,
    find_stops,
    goes_round,
    name_change,
    survey,
)
from toolkit.rooms.photos.shot_order import ShotStep, hash_poses


@dataclass(frozen=True)
class Papers:
    """The board of an object, the name of its sheets' page, if it exists, and why a sheet is missing."""

    board: Board | None
    patch_pdf: str | None
    missing: str | None


@dataclass(frozen=True)
class ObjectSession:
    """An object's part of the list.

    Attributes:
        stops: its places along the tour.
        booster: on the sheets; None without sheets.
        mountings: drawings of the place of each sheet.
        around: shared by its drawings.
        views: JPEGs by (variant, pose id).
        poses_sha256: `hash_poses` of the plan.
        guide: draws where the pieces of a booster go; None without pieces.
    """

    item: TableObject
    camera: Camera
    stops: tuple[Stop, ...]
    booster: AppliedBooster | None
    mountings: tuple[MountDrawing, ...]
    papers: Papers
    around: Surroundings
    views: dict[tuple[str, int], bytes]
    poses_sha256: str
    guide: Callable[[Pdf, Rect], None] | None = None

    @property
    def sheets(self) -> int:
        """Number of sheets on the object."""
        return len(self.item.spec.mounts)

    @property
    def rounds(self) -> bool:
        """Whether the camera goes round once per variant."""
        return goes_round(find_legs(self.stops), self.stops)


def prepare_session(
    item: TableObject, plan: CapturePlan, steps: list[ShotStep], boosters: dict[str, AppliedBooster | None],
    papers: Papers, bar: Ticker,
) -> ObjectSession:  # fmt: skip
    """Render and measure an object's part of the list; a `bar` step for each picture and for the mounting."""
    poses = plan.objects[item.name]
    stops = find_stops(poses, steps)
    views = draw_views(item, plan.camera, poses, boosters, papers.board, bar=bar)
    guides = (b.draw_guide(item) for b in boosters.values() if b is not None)
    # `patched` before the others: the pages show how to stick its sheet
    stuck = [b for b in (boosters.get("patched"), *boosters.values()) if b is not None and b.sizes_mm and not b.alone]
    mountings = draw_mountings(item, stuck[0]) if stuck else []
    bar.advance(note=f"{item.name}: where the patch goes")
    return ObjectSession(
        item, plan.camera, tuple(stops), stuck[0] if stuck else None, tuple(mountings), papers,
        around=survey(item.mesh, [stop.place for stop in stops]), views=views,
        poses_sha256=hash_poses(plan, item.name), guide=next(filter(None, guides), None),
    )  # fmt: skip


FILM_DIAGONAL_MM = 43.27
"""Diagonal of a 36 × 24 mm frame, which CIPA's 35 mm equivalent uses."""
PHONE_MM = 25.0
"""Equivalent focal length of most phones' main camera, whose zoom counts from it."""


def equivalent_focal_mm(camera: Camera) -> float:
    """The 35 mm equivalent focal length with the camera's field of view, by the diagonal."""
    # f / diagonal is the same for all formats with the same diagonal angle of view
    return FILM_DIAGONAL_MM * camera.fx / float(np.hypot(camera.width, camera.height))


def advise_camera(camera: Camera, places: Sequence[CameraPlace]) -> list[str]:
    """Lens, exposure and file settings."""
    # 35 mm equivalent: what phones and cameras state
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
        "At the first pose hold a finger on the object to lock focus and exposure, and keep them for all shots.",
        "Off: flash, HDR, night and portrait mode, filters, beauty. JPEG or HEIC at full size.",
    ]


def advise_stage(board: Board | None) -> list[str]:
    """The board, the object on it, and the light."""
    lines = [
        "Azimuth 0° looks at the object's front; it grows counter-clockwise as seen from above.",
        "Lamps only, blinds shut: daylight drifts. Keep your own shadow off the object.",
    ]
    if board is None:
        return lines
    kind, (width, height) = "board" if isinstance(board, CharucoBoard) else "ring", board.size_mm
    return [
        f"Print the {kind} with 'toolkit print --{kind}' at 100 % ({width:.0f} × {height:.0f} mm, "
        f"{board.describe().split(', markers')[0]}); tape it flat to the table.",
        f"Stand the object on the middle of the {kind}, its front to the edge marked FRONT. "
        "It stays there until all its shots are taken.",
        *lines,
    ]


def advise_sticking(item: TableObject, patch_pdf: str | None, drawing: MountDrawing) -> list[str]:
    """From the printer to the object, in order."""
    # the side of the object, the sheet's turn on it, and which of several sheets
    at, rotation_deg = drawing.mount.at, drawing.mount.rotation_deg
    page = f"Print {patch_pdf}" if patch_pdf else f"Make the page with 'toolkit print --object {item.name}', print it"
    where = {"top": "on top of the object", "back": "on the object's back"}.get(at, f"on the object's {at}")
    way = "the arrow in its margin towards the object's front" if at == "top" else "the page's upper edge up"
    if abs(rotation_deg) > 0.5:
        way += f", turned {abs(rotation_deg):.0f}° {'counter-clockwise' if rotation_deg > 0 else 'clockwise'}"
    which = "" if drawing.count == 1 else f"sheet {drawing.number} "
    return [
        f"{page} at 100 %, check its bars, cut {which}at the corner marks: {drawing.cut_mm:.1f} mm square.",
        f"Lay it {where} as drawn, {way}. The numbers are millimetres from the object's outermost edges, "
        "measured straight across.",
        "Tape it by its white edge only. No bubbles, no tape over the picture.",
        "Leave it alone until its last shot: a sheet that moves spoils the pairs.",
    ]


def explain_order(legs: Sequence[TourLeg]) -> str:
    """Why the unpatched round is cut in two, if it is."""
    names = [leg.variant for leg in legs]
    if len(set(names)) > 1 and names[0] == names[-1] == "unpatched":
        return (
            "Half of the unpatched shots come before the others and half after them, so that light that drifts "
            "favours neither."
        )
    return ""


TEXT_MM = 2.75
GAP_MM = 4.0


def split_page(area: Rect, aspect: float) -> tuple[Rect, ...]:
    """Three rows of two: mounting and steps, walk and rounds, camera and stage.

    The height of the first row follows the `aspect`, width over height, of the mounting's picture.
    """
    left = 0.6 * area.width
    third = 0.23 * area.height
    # the first row is as high as the mounting's picture wants to be, within limits; the walk takes what is left
    first = float(np.clip((left - CHAINS_MM) / aspect + CHAINS_MM + GAP_MM, 0.365 * area.height, 0.42 * area.height))
    second = area.height - first - third - 2 * GAP_MM
    walk = min(second, 0.5 * area.width)
    half = (area.width - 2 * GAP_MM) / 2
    y1, y2 = area.top - first + GAP_MM, area.y + third + GAP_MM
    return (
        Rect(area.x, y1, left, first - GAP_MM),
        Rect(area.x + left + GAP_MM, y1, area.width - left - GAP_MM, first - GAP_MM),
        Rect(area.x, y2, walk, second),
        Rect(area.x + walk + 2 * GAP_MM, y2, area.width - walk - 2 * GAP_MM, second),
        Rect(area.x, area.y, half, third - GAP_MM),
        Rect(area.x + half + 2 * GAP_MM, area.y, half, third - GAP_MM),
    )


def draw_first_page(pdf: Pdf, area: Rect, session: ObjectSession) -> None:
    """Draw the whole page."""
    drawing = session.mountings[0] if session.mountings else None
    frame = drawing.frame_mm if drawing else (0.0, 0.0, 2.0, 1.0)
    # upper row: how to stick the sheet, or why there is none
    mount, steps, walk, rounds, camera, stage = split_page(area, (frame[2] - frame[0]) / (frame[3] - frame[1]))
    if session.guide is not None and drawing is None:
        room = Rect(area.x, mount.y, area.width, mount.height)
        below = pdf.heading(room, "Places of the wrap's pieces: cut and order are on the first page of its print")
        session.guide(pdf, Rect(room.x, room.y, room.width, below - room.y - 1))
    elif drawing is None or session.booster is None:
        room = Rect(area.x, mount.y, area.width, mount.height)
        pdf.panel(room)
        inside = Rect(room.x + 5, room.y + 5, room.width - 10, room.height - 10)
        y = pdf.heading(inside, "Unpatched only: there is no sheet to stick on", SHEET)
        why = session.papers.missing or "No variant with a sheet was asked for."
        pdf.write_lines(why, inside.x, y, 3.0, room_mm=inside.width)
    else:
        draw_mounting_plan(pdf, mount, drawing)
        _draw_sticking(pdf, steps, session, drawing)
    # middle and lower row: walk and rounds, camera and table
    pdf.heading(walk, "The walk")
    draw_walk(pdf, Rect(walk.x, walk.y, walk.width, walk.height - 4), session.around, session.stops)
    _draw_rounds(pdf, rounds, session)
    _draw_advice(pdf, camera, "The camera", advise_camera(session.camera, session.around.places))
    _draw_advice(pdf, stage, "The table", advise_stage(session.papers.board))


SHEETS_A_PAGE = 2


def draw_sheets_page(pdf: Pdf, area: Rect, session: ObjectSession, drawings: Sequence[MountDrawing]) -> None:
    """Draw up to `SHEETS_A_PAGE` further sheets, each as on the first page."""
    height, left = area.height / SHEETS_A_PAGE, 0.6 * area.width
    for row, drawing in enumerate(drawings):
        y = area.top - (row + 1) * height + GAP_MM
        draw_mounting_plan(pdf, Rect(area.x, y, left, height - GAP_MM), drawing)
        steps = Rect(area.x + left + GAP_MM, y, area.width - left - GAP_MM, height - GAP_MM)
        _draw_sticking(pdf, steps, session, drawing)


def _draw_sticking(pdf: Pdf, area: Rect, session: ObjectSession, drawing: MountDrawing) -> None:
    """Draw the printed sheet, and how to stick it."""
    booster = session.booster
    assert booster is not None
    pdf.panel(area)
    inside = Rect(area.x + 3, area.y + 2, area.width - 6, area.height - 3.5)
    below = pdf.heading(inside, "Stick it like this")
    # the sheet in its colours, with the patch in its white margin
    side = min(0.40 * inside.width, 0.34 * inside.height)
    sheet = Rect(inside.x, below - side + 2.5, side, side)
    pdf.ink(SHEET, 0.4, fill=WHITE)
    pdf.rect(sheet.x, sheet.y, side, side, stroke=1, fill=1)
    inner = side * drawing.size_mm / drawing.cut_mm
    # enlarged by whole repeats: texels stay crisp squares in the JPEG
    repeat = max(1, 400 // len(booster.pixels))
    enlarged = booster.pixels.repeat(repeat, 0).repeat(repeat, 1)
    pdf.picture(encode_jpeg(enlarged, 88), sheet.centre(inner, inner), None)
    # name, sizes and hash beside it, and the steps below
    beside = Rect(sheet.right + 3, sheet.y, inside.right - sheet.right - 3, side)
    pdf.write(booster.name, beside.x, beside.top - 3.0, 3.2, room_mm=beside.width, font=BOLD, colour=SHEET)
    y = beside.top - 7.4
    sizes = f"sheet {drawing.cut_mm:.1f} mm", f"patch {drawing.size_mm:.1f} mm"
    for words in (*sizes, f"sha256 {booster.sha256[:12]}"):
        pdf.write(words, beside.x, y, 2.5, room_mm=beside.width)
        y -= 3.7
    _draw_page_arrow(pdf, sheet, drawing.mount.at)
    y = sheet.y - 9.0
    for number, words in enumerate(advise_sticking(session.item, session.papers.patch_pdf, drawing), 1):
        pdf.write(str(number), inside.x, y, TEXT_MM, room_mm=4, font=BOLD, colour=SHEET)
        y = pdf.write_lines(words, inside.x + 4.4, y, TEXT_MM - 0.1, room_mm=inside.width - 4.4) - 1.0


def _draw_page_arrow(pdf: Pdf, sheet: Rect, side: str) -> None:
    """Draw the direction of the sheet's right (on top of an object) or upper edge, as on its printed page."""
    word = "front" if side == "top" else "up"
    y = sheet.y - 3.6
    end = sheet.x + pdf.write(word, sheet.x, y, 2.6, room_mm=20, font=BOLD, colour=SHEET) + 1.2
    pdf.ink(SHEET, 0.4)
    if side == "top":
        pdf.arrow((end, y + 0.9), (end + 7.5, y + 0.9), 2.2)
    else:
        pdf.arrow((end + 0.6, y - 0.6), (end + 0.6, y + 2.6), 1.8)


def _draw_rounds(pdf: Pdf, area: Rect, session: ObjectSession) -> None:
    """Draw a row with a tick box for each leg and for each change of the sheet."""
    legs = find_legs(session.stops)
    y = pdf.heading(area, "The order of the shots")
    shots = sum(len(stop.shots) for stop in session.stops)
    # without rounds all shots of a pose follow each other
    if not session.rounds:
        words = (
            f"{shots} shots at {len(session.stops)} poses. At each pose all variants are shot in turn, in the order of "
            "their numbers, without moving the camera. Put the sheet on and off each time, to the same place to the "
            "millimetre."
        )
        pdf.write_lines(words, area.x, y, TEXT_MM, room_mm=area.width)
        return
    turns = {1: "once", 2: "twice"}.get(len(session.stops[0].shots), f"{len(session.stops[0].shots)} times")
    words = f"{shots} shots at {len(session.stops)} poses; the camera goes round {turns}. {explain_order(legs)}".strip()
    y = pdf.write_lines(words, area.x, y, TEXT_MM, room_mm=area.width) - 2.6
    rows: list[tuple[str, str]] = []  # words, and the shots on the right; a change of the sheet has no shots
    before: str | None = None
    # the sheet changes between legs, where the variant does
    for leg in legs:
        if change := name_change(before, leg.variant, session.sheets):
            rows.append((change, ""))
        a, b = leg.shots
        shots_there = f"shots {a}-{b}" if a != b else f"shot {a}"
        rows.append((f"{leg.variant}, {_name_poses(session, leg.stops)}", shots_there))
        before = leg.variant
    # rows move together if there are many
    step = min(7.6, (y - area.y) / (len(rows) + 1))
    # after the last round the sheet comes off, or it would be on the next object's first shots
    if before not in (None, "unpatched"):
        rows.append((name_change(before, "unpatched", session.sheets), ""))
    for words, right in rows:
        pdf.tick_box(area.x, y - 0.8)
        taken = 0.0
        if right:
            taken = pdf.write(right, area.right, y, TEXT_MM, 0.4 * area.width, align="right", colour=SOFT)
        x, colour = area.x + TICK_MM + 2, INK if right else SHEET
        pdf.write(words, x, y, 3.0, room_mm=area.right - x - taken - 2, font=BOLD, colour=colour)
        y -= step


def _name_poses(session: ObjectSession, span: tuple[int, int]) -> str:
    """Name a stretch of the tour: `all 18 poses`, `pose 5`, `9 poses, from 1 to 14`."""
    count, (first, last) = span[1] - span[0] + 1, (session.stops[number - 1].pose.id for number in span)
    if count == len(session.stops):
        return f"all {count} poses"
    return f"pose {first}" if count == 1 else f"{count} poses, from {first} to {last}"


def _draw_advice(pdf: Pdf, area: Rect, title: str, lines: Sequence[str]) -> None:
    y = pdf.heading(area, title)
    for words in lines:
        pdf.ink(CAMERA)
        pdf.circle(area.x + 0.8, y + 0.9, 0.55, stroke=0, fill=1)
        y = pdf.write_lines(words, area.x + 3.2, y, TEXT_MM - 0.1, room_mm=area.width - 3.2) - 0.9
