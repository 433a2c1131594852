"""Contents of the page, as plain values for JSON."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from toolkit.core.files import sha256_bytes
from toolkit.objects.spec import read_spec
from toolkit.rooms.photos.gates import GateResult
from toolkit.rooms.photos.locate import PoseMatch
from toolkit.rooms.photos.shot_list.session import PHONE_MM, equivalent_focal_mm
from toolkit.rooms.photos.shot_list.tour import measure_place, name_change
from toolkit.rooms.photos.shot_order import ShotStep
from toolkit.rooms.photos.studio.inspection import Inspection
from toolkit.rooms.photos.studio.predictor import Predictor
from toolkit.rooms.photos.studio.session import Session, ShotState
from toolkit.rooms.photos.studio.upload import MOST_BYTES

NEAR_DEG = 6.0
"""Least error for which the page advises a move; a few degrees do no harm."""


def describe_session(session: Session, predictor: Predictor) -> dict[str, Any]:
    """All shots with their state, what comes next, and the predictions so far."""
    shots = session.list_shots()
    camera, state = session.plan.camera, predictor.state
    focal_mm = equivalent_focal_mm(camera)
    return {
        "shots": [describe_shot(shot) for shot in shots],
        "next": find_next(shots),
        # the page opens at the first missing, waiting or failed shot
        "first": next((shot.step.number for shot in shots if shot.status in ("waiting", "open") or shot.retake), None),
        "done": sum(1 for shot in shots if shot.path),
        "lens": {"focal_mm": round(focal_mm), "zoom": round(focal_mm / PHONE_MM, 1)},
        "limit_mb": MOST_BYTES >> 20,
        # in the address of each ghost, so that no cache shows the drawings of an older list
        "list": sha256_bytes(session.shots.model_dump_json().encode())[:12],
        "network": {"status": state.status, "message": state.message, "notes": list(state.notes)},
        "predictions": predictor.list_rows(),
        "captures": str(session.source_dir),
    }


def find_next(shots: Sequence[ShotState]) -> int | None:
    """Return the shot to take now: a waiting shot, else the next open shot, else a skipped shot."""
    by_status = (shot for wanted in ("waiting", "open", "skipped") for shot in shots if shot.status == wanted)
    return next((shot.step.number for shot in by_status), None)


def describe_shot(shot: ShotState) -> dict[str, Any]:
    """A step of the list in brief."""
    step = shot.step
    return {
        "number": step.number, "object": step.object, "variant": step.variant, "pose_id": step.pose_id,
        "status": shot.status, "there": shot.path is not None, "retake": shot.retake,
    }  # fmt: skip


def describe_place(session: Session, shot: ShotState) -> dict[str, Any]:
    """A shot with all that helps to take it, and facts on the photograph that is there."""
    place = measure_place(session.find_pose(shot.step))
    record = session.find_record(shot)
    return {
        # centimetres, as a tape measure has them
        **describe_shot(shot),
        "place": {
            "azimuth_deg": round(place.azimuth_deg, 1), "tilt_deg": round(place.tilt_deg, 1),
            "distance_cm": round(place.distance_mm / 10, 1), "height_cm": round(place.height_mm / 10, 1),
            "out_cm": round(place.out_mm / 10, 1), "roll_deg": round(place.roll_deg, 1),
        },
        "change": say_change(session, shot.step),
        "advice": list(record.made.get("retake") or []) if record else [],
        "path": shot.path,
    }  # fmt: skip


def say_change(session: Session, step: ShotStep) -> str:
    """Say what to do with object and sheets before this shot; empty if nothing changes."""
    sheets = len(read_spec(session.workspace.object_spec(step.object)).mounts)
    before = session.find_step(step.number - 1) if step.number > 1 else None
    if before is None or before.object != step.object:
        words = name_change(None, step.variant, sheets)
        start = f"put the {step.object} on the board's middle, its front to FRONT"
        return f"{start}, {words}" if words else start
    return name_change(before.variant, step.variant, sheets)


def describe_inspection(inspection: Inspection) -> dict[str, Any]:
    """The verdict on a photograph."""
    match = inspection.match
    return {
        "sha256": inspection.sha256,
        "good": inspection.good,
        "gates": [describe_gate(result) for result in inspection.results],
        "board": None if inspection.located is None else "seen",
        "no_board": inspection.no_board,
        "pose": None if match is None else {
            "error_deg": round(match.error_deg, 1), "error_mm": round(match.error_mm),
            "moves": say_moves(match), "wrong": inspection.wrong_pose,
        },
        "ghost_scale": inspection.ghost_scale,
    }  # fmt: skip


def describe_gate(result: GateResult) -> dict[str, Any]:
    """The verdict of a gate; numbers that are not finite become null."""
    # JSON has neither NaN nor infinity
    value = result.value if result.value is not None and math.isfinite(result.value) else None
    return asdict(result) | {"value": value}


def say_moves(match: PoseMatch) -> list[str]:
    """Tell a person who looks at the object how to come nearer to the pose; empty if it is near enough."""
    moves = []
    if abs(match.azimuth_deg) > NEAR_DEG:
        # azimuth grows counter-clockwise from above: towards the right of a person who looks at the object
        moves.append(f"go {abs(match.azimuth_deg):.0f}° round to the {'left' if match.azimuth_deg > 0 else 'right'}")
    if abs(match.elevation_deg) > NEAR_DEG:
        moves.append(f"go {abs(match.elevation_deg):.0f}° {'lower' if match.elevation_deg > 0 else 'higher'}")
    if abs(match.roll_deg) > NEAR_DEG:
        moves.append(f"turn the camera {abs(match.roll_deg):.0f}° level")
    return moves
