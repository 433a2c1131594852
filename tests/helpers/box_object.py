"""A mesh as an object that is called `box`, and poses that look at its middle."""

import numpy as np

from toolkit.objects.load import TableObject
from toolkit.objects.spec import ObjectSpec, PatchMount
from toolkit.rig.camera import orbit_pose
from toolkit.rig.plan import Pose


def as_object(mesh, **patch) -> TableObject:
    spec = ObjectSpec.model_validate({"name": "box", "class": "crate", "mesh": "builtin:racer", "length_mm": 100})
    return TableObject(spec.with_mounts([PatchMount(**patch)]), mesh)


def look(item: TableObject, *angles: tuple[float, float]) -> list[Pose]:
    """From 700 mm, at azimuth and elevation in degrees."""
    target = (0.0, 0.0, float(item.mesh.size_mm[2]) / 2)
    return [
        Pose(
            id=i, azimuth_deg=azimuth, elevation_deg=elevation, distance_mm=700, target_mm=target,
            T_world_camera=orbit_pose(np.array(target), azimuth, elevation, 700).tolist(),
        )
        for i, (azimuth, elevation) in enumerate(angles, 1)
    ]  # fmt: skip
