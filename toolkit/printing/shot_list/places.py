"""Where a camera stands in words and numbers, and the places of a tour with the shots to take at each."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from toolkit.rig.plan import Pose
from toolkit.rig.shot_order import ShotStep


@dataclass(frozen=True)
class CameraPlace:
    """A camera's place as one measures it with a tape and a phone's level.

    Attributes:
        azimuth_deg: round the object from its front, counter-clockwise from above, in [0, 360).
        tilt_deg: how far the line of sight looks down.
        roll_deg: as the plan has it.
        distance_mm: to the point that is seen at the picture's middle.
        height_mm: above the table.
        out_mm: along the table from the object's middle.
        target_height_mm: of that point above the table.
    """

    azimuth_deg: float
    tilt_deg: float
    roll_deg: float
    distance_mm: float
    height_mm: float
    out_mm: float
    target_height_mm: float


def measure_place(pose: Pose) -> CameraPlace:
    """The numbers of a pose, from its `T_world_camera`."""
    T_world_camera = pose.matrix()
    x, y, z = (float(v) for v in T_world_camera[:3, 3])
    out_mm = float(np.hypot(x, y))
    azimuth = np.degrees(np.arctan2(y, x)) if out_mm > 0.01 else pose.azimuth_deg
    target = np.array(pose.target_mm)
    return CameraPlace(
        azimuth_deg=round(float(azimuth), 3) % 360,
        tilt_deg=float(np.degrees(np.arcsin(np.clip(-T_world_camera[2, 2], -1, 1)))),
        roll_deg=pose.roll_deg,
        distance_mm=float(np.linalg.norm(T_world_camera[:3, 3] - target)),
        height_mm=z,
        out_mm=out_mm,
        target_height_mm=float(target[2]),
    )


@dataclass(frozen=True)
class Stop:
    """One place of the tour: its number on the tour, its pose, and its shots in the order of shooting."""

    number: int
    pose: Pose
    place: CameraPlace
    shots: tuple[ShotStep, ...]


@dataclass(frozen=True)
class Stretch:
    """Shots in a row of one variant at places in a row."""

    variant: str
    shots: tuple[int, int]
    stops: tuple[int, int]


def find_stops(poses: Sequence[Pose], steps: Sequence[ShotStep]) -> list[Stop]:
    """The places of one object in the order in which the camera first comes there."""
    by_id = {pose.id: pose for pose in poses}
    walk = dict.fromkeys(step.pose_id for step in steps)
    return [
        Stop(number, by_id[id_], measure_place(by_id[id_]), tuple(step for step in steps if step.pose_id == id_))
        for number, id_ in enumerate(walk, 1)
    ]


def find_stretches(stops: Sequence[Stop]) -> list[Stretch]:
    """The rounds of one object as stretches without a change; a round's end at the last place ends one too."""
    visits = sorted((shot.number, shot.variant, stop.number) for stop in stops for shot in stop.shots)
    starts = [0]
    for i, ((_, variant, stop), (_, next_variant, next_stop)) in enumerate(pairwise(visits), 1):
        if next_variant != variant or next_stop != stop + 1:
            starts.append(i)
    return [
        Stretch(visits[a][1], (visits[a][0], visits[b - 1][0]), (visits[a][2], visits[b - 1][2]))
        for a, b in pairwise([*starts, len(visits)])
    ]


def goes_round(stretches: Sequence[Stretch], stops: Sequence[Stop]) -> bool:
    """Whether the camera goes round once per variant, with few changes; false where variants alternate."""
    return len(stretches) <= 2 * max(len(stop.shots) for stop in stops)


def name_change(before: str | None, after: str, sheets: int) -> str:
    """What to do with an object and its sheets between two stretches; empty where nothing changes."""
    if before == after or (before is None and after == "unpatched"):
        return ""
    steps = [] if before is None else [_name_leaving(before, sheets)]
    return ", ".join(words for words in (*steps, _name_entering(before, after, sheets)) if words)


def _name_leaving(variant: str, sheets: int) -> str:
    if variant == "unpatched" or _is_painted(variant):
        return ""
    if variant == "patch-alone":
        return "take the patch away"
    return f"take the {_name_sheets(variant, sheets)} off"


def _name_entering(before: str | None, after: str, sheets: int) -> str:
    if _is_painted(after):
        return f"put the object as {after.replace('-', ' ')} in its place"
    if after == "patch-alone":
        return "take the object away, lay the patch flat on the board's middle"
    bare = "put the bare object back" if before == "patch-alone" or (before and _is_painted(before)) else ""
    stuck = "" if after == "unpatched" else f"stick the {_name_sheets(after, sheets)} on"
    return ", ".join(words for words in (bare, stuck) if words)


def _is_painted(variant: str) -> bool:
    return variant == "textured" or variant.endswith("-texture")


def _name_sheets(variant: str, sheets: int) -> str:
    name = "patch" if variant == "patched" else variant.replace("-", " ")
    return name if sheets == 1 else f"{sheets} sheets of the {name}"
