"""What to know of the sheets of objects before they are printed or shot."""

from collections.abc import Sequence

import numpy as np

from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.rig.camera import Camera, project
from toolkit.rig.fit import describe_misfits, mounted_sizes_mm, sheet_points
from toolkit.rig.plan import CapturePlan, Pose


def seen_share(points_mm: np.ndarray, camera: Camera, pose: Pose) -> float:
    """Share of points that fall into the frame."""
    pixels, depth = project(camera, pose.matrix(), points_mm)
    inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] <= camera.width) & (pixels[:, 1] <= camera.height)
    return float((inside & (depth > 0)).mean())


def list_misfits(workspace: Workspace, names: Sequence[str], plan: CapturePlan | None = None) -> list[str]:
    """What to know of the sheets of objects before they are printed or shot, one line each.

    Args:
        workspace: whose objects and patches are meant.
        names: of objects.
        plan: its cameras must have all sheets of one's own objects whole in the frame; built-in ones are framed alone.

    Raises:
        ToolkitError: an object or a patch cannot be read.
    """
    lines = []
    for name in names:
        item = load_object(workspace.object_spec(name))
        lines += describe_misfits(item, mounted_sizes_mm(workspace, item))
        points = sheet_points(workspace, item) if plan is not None and name in plan.objects else None
        if points is None or plan is None:
            continue
        seen = {pose.id: seen_share(points, plan.camera, pose) for pose in plan.objects[name]}
        cut = {pose: share for pose, share in seen.items() if share < 0.999}
        if cut:
            worst = min(cut, key=lambda pose: cut[pose])
            is_one = len(item.spec.mounts) == 1
            a_sheet, sheets, them = ("the sheet", "sheet", "it") if is_one else ("a sheet", "sheets", "them")
            lines.append(
                f"{name}: {a_sheet} leaves the frame in {len(cut)} of {len(seen)} poses ({1 - cut[worst]:.0%} of "
                f"{them} in pose {worst}): 'toolkit plan --object {name}' frames object and {sheets} together"
            )
    return lines
