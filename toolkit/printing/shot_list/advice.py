"""The words of the first page: the camera's settings, the table and its board, how to stick the sheet."""

from collections.abc import Sequence

import numpy as np

from toolkit.captures.variants import Print
from toolkit.objects.load import TableObject
from toolkit.printing.shot_list.mounting import MountDrawing
from toolkit.printing.shot_list.places import CameraPlace, Stretch
from toolkit.rig.board import BoardSpec, Sheet
from toolkit.rig.camera import Camera

FILM_DIAGONAL_MM = 43.27
"""Of a 36 × 24 mm frame: CIPA's 35 mm equivalent is by the diagonal, which matters for frames of 4:3."""
PHONE_MM = 25.0
"""Equivalent focal length of most phones' main camera, whose zoom counts from it."""


def equivalent_focal_mm(camera: Camera) -> float:
    """The 35 mm equivalent focal length with the camera's field of view, by the diagonal."""
    return FILM_DIAGONAL_MM * camera.focal_px / float(np.hypot(camera.width, camera.height))


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


def advise_stage(board: Sheet | None, item: TableObject) -> list[str]:
    """The board, the object on it, and the light."""
    lines = []
    if board is not None:
        kind = "board" if isinstance(board, BoardSpec) else "ring"
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
    at = item.spec.patch.at
    turned = abs(item.spec.patch.rotation_deg) > 0.5
    page = f"Print {patch_pdf}" if patch_pdf else f"Print it at {booster.size_mm:.1f} mm"
    where = {"top": "on top of the object", "back": "on the object's back"}.get(at, f"on the object's {at}")
    way = "the arrow printed below it towards the object's front" if at == "top" else "the page's upper edge up"
    if turned:
        way += f", turned {abs(item.spec.patch.rotation_deg):.0f}° {_hand(item.spec.patch.rotation_deg)}"
    return [
        f"{page} at 100 %, check its bars, cut at the corner marks: {drawing.cut_mm:.1f} mm square.",
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
