"""The same plan from farther away, or with a camera of other pixels."""

import numpy as np
from pydantic import ValidationError

from toolkit.errors import ToolkitError
from toolkit.rig.camera import orbit_pose
from toolkit.rig.plan import CameraModel, CapturePlan, Pose


def scale_distance(plan: CapturePlan, factor: float) -> CapturePlan:
    """Every camera `factor` times as far from what it looks at, from the same direction.

    `T_world_camera` is worked out again where the plan has it, and left out where it has not.
    """
    if factor == 1:
        return plan
    objects = {name: [_move(pose, factor) for pose in poses] for name, poses in plan.objects.items()}
    return plan.model_copy(update={"objects": objects})


def scale_resolution(plan: CapturePlan, width_px: int) -> CapturePlan:
    """Pictures `width_px` wide with the same field of view; the height follows, rounded to whole pixels.

    Raises:
        ToolkitError: width or height is under 16 or over 16384 pixels.
    """
    old = plan.camera
    height_px = round(old.height * width_px / old.width)
    try:
        camera = CameraModel.model_validate(old.model_dump() | {"width": width_px, "height": height_px})
    except ValidationError:
        raise ToolkitError(
            f"a resolution of {width_px}×{height_px} px: expected both sides between 16 and 16384 px"
        ) from None
    return plan.model_copy(update={"camera": camera})


def _move(pose: Pose, factor: float) -> Pose:
    distance_mm = round(pose.distance_mm * factor, 2)
    T_world_camera = orbit_pose(
        np.array(pose.target_mm), pose.azimuth_deg, pose.elevation_deg, distance_mm, pose.roll_deg
    )  # fmt: skip
    rows = None if pose.T_world_camera is None else np.round(T_world_camera, 6).tolist()
    return Pose.model_validate(pose.model_dump() | {"distance_mm": distance_mm, "T_world_camera": rows})
