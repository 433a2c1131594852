"""Find the camera of a photograph from the printed board, and the pose of the plan that is nearest to it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.rig.board_file import read_board
from toolkit.rig.camera import look_at
from toolkit.rig.plan import Pose
from toolkit.rooms.photos.board_pose import BoardSighting, explain_absence, find_board, measure_ink, solve_pose
from toolkit.rooms.photos.lens import LensRecord, choose_lens, read_lenses
from toolkit.rooms.photos.photo import Photo
from toolkit.rooms.photos.posed_camera import PosedCamera

Locate = Callable[[Photo, np.ndarray], PosedCamera | str]
"""(photo, its pixels (h, w, 3) uint8) -> its camera, or in words why that is not known."""


def locate_by_board(workspace: Workspace) -> Locate:
    """Return a function that finds the camera of a photograph from the workspace's board; broken files raise."""
    board, lenses = read_board(workspace), read_lenses(workspace)

    def locate(photo: Photo, pixels: np.ndarray) -> PosedCamera | str:
        # such a board gives two cameras that fit equally well
        if board.looks_the_same_turned:
            return f"a {board.describe()} looks the same upside down: use a board with an odd and an even count"
        sighting = find_board(pixels, board)
        if sighting is None:
            return explain_absence(pixels, board)
        found = locate_sighting(photo, sighting, lenses)
        if isinstance(found, str):
            return found
        # how dark the board's ink is, for a note on boards that are printed in full black
        details = {**found.details, "board_ink": round(measure_ink(pixels, sighting), 3)}
        if workspace.board is not None:
            details["board"] = workspace.board.stem
        return replace(found, details=details)

    return locate


def locate_sighting(photo: Photo, sighting: BoardSighting | None, lenses: list[LensRecord]) -> PosedCamera | str:
    """Return a photograph's camera from the board that was found in it, or in words why that is not known."""
    if sighting is None:
        return "no board is seen"
    choice = choose_lens(photo, lenses)
    if choice.lens is None:
        return f"a board is seen, but the lens is not known: {choice.note}"
    pose = solve_pose(sighting, choice.lens)
    if pose is None:
        return "a board is seen, but its corners fit no camera above the table"
    if reason := pose.doubt():
        return reason
    details = {
        "lens": choice.source, "board_corners": pose.n_corners, "reprojection_px": round(pose.reprojection_px, 3),
    }  # fmt: skip
    return PosedCamera(pose.T_world_camera, choice.lens, details)


AMBIGUOUS_MARGIN_DEG = 3.0
"""Largest lead of the best pose's cost over the next pose's at which the intended pose is unknown."""
FAR_DEG = 10.0
"""A photograph farther off stands for no pose of the plan: half the way between two elevations of the default grid."""
FAR_ROLL_DEG = 20.0
ROLL_COST = 0.1
DISTANCE_COST_DEG = 5.0
"""Poses are ranked by the angle between their views. Roll, in degrees times `ROLL_COST`, and the logarithm of the ratio
of distances, times this, decide between poses that look from the same side."""
STEEP_DEG = 80.0
"""Above this elevation azimuth and roll turn into each other."""


@dataclass(frozen=True)
class CameraAngles:
    """A camera seen from the middle of the object; roll as in `toolkit.rig.camera.look_at`."""

    azimuth_deg: float
    elevation_deg: float
    distance_mm: float
    roll_deg: float


@dataclass(frozen=True)
class PoseMatch:
    """The nearest pose of a plan. Signed values are the photograph's less the plan's.

    Attributes:
        error_deg: angle between the two directions from the object to the camera.
        error_mm: distance of the two camera positions.
        roll_deg: difference in roll, -180 to 180.
        distance_mm: difference of the distances from the object.
        runner_up: id of the next pose, and `runner_up_deg` its angle; None in a plan with a single pose.
        margin_deg: how much dearer the next pose is; infinite in a plan with a single pose.
    """

    pose_id: int
    error_deg: float
    error_mm: float
    roll_deg: float
    azimuth_deg: float
    elevation_deg: float
    distance_mm: float
    runner_up: int | None = None
    runner_up_deg: float | None = None
    margin_deg: float = float("inf")

    @property
    def ambiguous(self) -> bool:
        """Whether another pose is about as near."""
        return self.margin_deg < AMBIGUOUS_MARGIN_DEG

    @property
    def far(self) -> bool:
        """Whether the photograph is too far from every pose to show any of them."""
        return self.error_deg > FAR_DEG or abs(self.roll_deg) > FAR_ROLL_DEG

    def describe(self) -> str:
        """One line for a person: what is off, and which way to move."""
        nearer = "farther" if self.distance_mm > 0 else "nearer"
        words = (
            f"pose {self.pose_id}: {self.error_deg:.1f}° and {self.error_mm:.0f} mm off (azimuth "
            f"{self.azimuth_deg:+.1f}°, elevation {self.elevation_deg:+.1f}°, roll {self.roll_deg:+.1f}°, "
            f"{abs(self.distance_mm):.0f} mm {nearer})"
        )
        if self.ambiguous:
            words += f"; ambiguous: pose {self.runner_up} is {self.runner_up_deg:.1f}° off"
        return words + ("; far from every pose of the plan" if self.far else "")


def view_of(T_world_camera: np.ndarray, target_mm: np.ndarray) -> CameraAngles:
    """Angles, distance and roll of a camera (4, 4) about a point (3,)."""
    position, target = T_world_camera[:3, 3], np.asarray(target_mm, float)
    offset = position - target
    distance = float(np.linalg.norm(offset))
    if distance < 1e-6:
        raise ToolkitError("a camera in the middle of the object has no view of it: its pose is wrong")
    azimuth = float(np.degrees(np.arctan2(offset[1], offset[0])) % 360)
    elevation = float(np.degrees(np.arcsin(np.clip(offset[2] / distance, -1, 1))))
    # the same place without roll, to measure the camera's roll against
    upright = look_at(position, target, 0.0, azimuth)
    return CameraAngles(azimuth, elevation, distance, _roll_between(upright, T_world_camera))


def match_pose(T_world_camera: np.ndarray, poses: Sequence[Pose]) -> PoseMatch:
    """Return the pose of a plan that a camera (4, 4) is nearest to.

    Both are in the object's frame, whether the camera went round the object or a turntable turned it.
    """
    if not poses:
        raise ToolkitError("no poses to match with: make a plan with 'toolkit plan'")
    matches = [_compare(T_world_camera, pose) for pose in poses]
    # by the cost, not by the angle alone: two poses may look from the same side at other distances
    order = sorted(range(len(poses)), key=lambda i: matches[i][0])
    cost, best = matches[order[0]]
    if len(order) == 1:
        return best
    # how much dearer the second pose is tells how sure the first is
    next_cost, runner_up = matches[order[1]]
    return replace(best, runner_up=runner_up.pose_id, runner_up_deg=runner_up.error_deg, margin_deg=next_cost - cost)


def _compare(T_world_camera: np.ndarray, pose: Pose) -> tuple[float, PoseMatch]:
    """Return the cost of taking the camera for this pose, and the differences."""
    target, planned = np.array(pose.target_mm), pose.matrix()
    seen, wanted = view_of(T_world_camera, target), view_of(planned, target)
    # arctan2 of sine and cosine: arccos alone loses digits where the directions are nearly parallel
    first, other = T_world_camera[:3, 3] - target, planned[:3, 3] - target
    error = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, other)), first @ other)))
    if max(seen.elevation_deg, wanted.elevation_deg) > STEEP_DEG:
        roll = _roll_between(planned, T_world_camera)
    else:
        roll = _wrap(seen.roll_deg - wanted.roll_deg)
    # the logarithm makes twice as far and half as far equally wrong
    ratio = abs(float(np.log(seen.distance_mm / wanted.distance_mm)))
    cost = error + ROLL_COST * abs(roll) + DISTANCE_COST_DEG * ratio
    return cost, PoseMatch(
        pose.id, error, float(np.linalg.norm(T_world_camera[:3, 3] - planned[:3, 3])), roll_deg=roll,
        azimuth_deg=_wrap(seen.azimuth_deg - wanted.azimuth_deg),
        elevation_deg=seen.elevation_deg - wanted.elevation_deg, distance_mm=seen.distance_mm - wanted.distance_mm,
    )  # fmt: skip


def _roll_between(first: np.ndarray, other: np.ndarray) -> float:
    """Degrees that `other` is turned about its line of sight against `first`, their difference in aim taken out."""
    turn = first[:3, :3].T @ other[:3, :3]
    # the angle of the nearest turn about z, which is the line of sight: the polar part of the upper 2 × 2 block
    return float(np.degrees(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])))


def _wrap(degrees: float) -> float:
    return (degrees + 180) % 360 - 180
