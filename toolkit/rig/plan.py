"""The capture plan: every pose of every object, in `rig/plan.json`."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from toolkit.errors import ToolkitError
from toolkit.files import read_json, write_json
from toolkit.objects.load import TableObject, load_object
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
from toolkit.rig.poses import Pattern, spread_poses
from toolkit.workspace import Workspace

Row = tuple[float, float, float, float]


class CameraModel(BaseModel):
    """The camera of a plan: pixels, and the horizontal field of view or the focal length and sensor width in mm."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    width: int = Field(640, ge=16, le=16384)
    height: int = Field(480, ge=16, le=16384)
    fov_deg: float | None = Field(None, gt=1, lt=170)
    focal_mm: float | None = Field(None, gt=0)
    sensor_width_mm: float | None = Field(None, gt=0)
    convention: Literal["opencv"] = "opencv"

    def camera(self) -> Camera:
        """The pinhole camera that these numbers describe."""
        fov = self.fov_deg
        if fov is None and self.focal_mm and self.sensor_width_mm:
            fov = 2 * float(np.degrees(np.arctan(self.sensor_width_mm / 2 / self.focal_mm)))
        return Camera(self.width, self.height, fov or Camera.fov_deg)


class Pose(BaseModel):
    """One camera position.

    Attributes:
        id: 1, 2, …
        azimuth_deg, elevation_deg, roll_deg: as in `toolkit.rig.camera`.
        distance_mm: from the camera to `target_mm`.
        target_mm: the point at the image's centre.
        T_world_camera: 4×4; left out, it follows from the other fields; given, it must agree with them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    id: int = Field(ge=1)
    azimuth_deg: float
    elevation_deg: float = Field(ge=-90, le=90)
    roll_deg: float = 0.0
    distance_mm: float = Field(gt=0)
    target_mm: tuple[float, float, float]
    T_world_camera: tuple[Row, Row, Row, Row] | None = None

    @model_validator(mode="after")
    def _agree(self) -> "Pose":
        if self.T_world_camera is None:
            return self
        off = np.abs(np.array(self.T_world_camera) - self._derived())
        if off[:3, 3].max() > 0.05 or off[:, :3].max() > 1e-3 or off[3, 3] > 1e-3:  # mm; 0.06 degrees
            raise ValueError(
                f"pose {self.id}: T_world_camera does not agree with azimuth, elevation, roll, distance and target; "
                "delete T_world_camera where you changed the others"
            )
        return self

    def _derived(self) -> np.ndarray:
        return orbit_pose(
            np.array(self.target_mm), self.azimuth_deg, self.elevation_deg, self.distance_mm, self.roll_deg
        )

    def matrix(self) -> np.ndarray:
        """(4, 4) `T_world_camera`."""
        return self._derived() if self.T_world_camera is None else np.array(self.T_world_camera)


class CapturePlan(BaseModel):
    """Camera, and poses per object."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    camera: CameraModel
    pattern: dict[str, object] = {}
    objects: dict[str, list[Pose]]

    @model_validator(mode="after")
    def _distinct(self) -> "CapturePlan":
        for name, poses in self.objects.items():
            ids = [pose.id for pose in poses]
            if not ids or len(set(ids)) < len(ids):
                raise ValueError(f"object '{name}': expected at least one pose and ids that differ, found {ids}")
        return self


def plan_poses(item: TableObject, camera: Camera, pattern: Pattern) -> list[Pose]:
    """The poses of one object: the camera looks at the middle of its bounding box, which is never cropped.

    Raises:
        ToolkitError: a distance asked for puts the camera inside the object or crops it.
    """
    target = np.array([0.0, 0.0, item.mesh.size_mm[2] / 2])
    poses = []
    angles = spread_poses(pattern)
    for i, (azimuth, elevation) in enumerate(np.round(angles, 3)):
        distance = distance_to_fill(camera, item.mesh.vertices, target, azimuth, elevation, pattern.fill)
        if pattern.distance_mm is not None:
            share = i / max(len(angles) - 1, 1)
            distance = pattern.distance_mm[0] * (1 - share) + pattern.distance_mm[1] * share
        distance = round(distance, 2)
        T_world_camera = np.round(orbit_pose(target, azimuth, elevation, distance), 6)
        fields = {
            "id": i + 1, "azimuth_deg": azimuth, "elevation_deg": elevation, "distance_mm": distance,
            "target_mm": np.round(target, 4).tolist(), "T_world_camera": T_world_camera.tolist(),
        }  # fmt: skip
        poses.append(Pose.model_validate(fields))
    check_poses(item, camera, poses)
    return poses


def check_poses(item: TableObject, camera: Camera, poses: list[Pose]) -> None:
    """Check that every camera stands outside the object, above the table, and sees the object whole.

    Raises:
        ToolkitError: names object, pose and what to change.
    """
    low, high = item.mesh.bounds
    for pose in poses:
        position = pose.matrix()[:3, 3]
        where = f"plan: object '{item.name}', pose {pose.id}"
        if np.all(position > low) and np.all(position < high):
            raise ToolkitError(f"{where}: the camera is inside the object: expected distance_mm over its extent")
        if position[2] <= 0:
            raise ToolkitError(f"{where}: the camera is below the table top: expected an elevation that keeps it above")
        least = distance_to_fill(
            camera, item.mesh.vertices, np.array(pose.target_mm), pose.azimuth_deg, pose.elevation_deg, 0.995,
            pose.roll_deg,
        )  # fmt: skip
        if pose.distance_mm < least:
            raise ToolkitError(
                f"{where}: the object is cropped at {pose.distance_mm:.0f} mm: expected at least {least:.0f} mm"
            )


def make_plan(items: list[TableObject], camera: Camera, pattern: Pattern) -> CapturePlan:
    """One plan for several objects.

    Raises:
        ToolkitError: the camera cannot be, or as `plan_poses` and `spread_poses` say.
    """
    from dataclasses import asdict

    try:
        model = CameraModel(width=camera.width, height=camera.height, fov_deg=camera.fov_deg)
    except ValidationError as error:
        first = error.errors()[0]
        raise ToolkitError(f"camera: {first['loc'][0]}: {first['msg']}, found {first['input']}") from None
    return CapturePlan(
        camera=model,
        pattern=asdict(pattern),
        objects={item.name: plan_poses(item, camera, pattern) for item in items},
    )


def read_plan(file: Path) -> CapturePlan:
    """Read and validate `rig/plan.json`."""
    return read_json(file, CapturePlan)


def write_plan(file: Path, plan: CapturePlan) -> Path:
    """Write `rig/plan.json`."""
    return write_json(file, plan.model_dump(mode="json", exclude_none=True))


def open_plan(workspace: Workspace, names: list[str] | None = None, pattern: Pattern | None = None) -> CapturePlan:
    """The workspace's plan; objects of `names` that it lacks, or all known where there is none, are planned and added.

    Those that are planned follow `pattern`; poses that are there stay as they are.

    Raises:
        ToolkitError: the plan is broken, or an object is unknown.
    """
    old = read_plan(workspace.plan_file) if workspace.plan_file.is_file() else None
    wanted = names or [] if old else sorted({*workspace.object_specs(), *(names or [])})
    missing = [name for name in wanted if old is None or name not in old.objects]
    if old is not None and not missing:
        return old
    items = [load_object(workspace.object_spec(name)) for name in missing]
    plan = keep_others(old, make_plan(items, old.camera.camera() if old else Camera(), pattern or Pattern()))
    write_plan(workspace.plan_file, plan)
    return plan


def keep_others(old: CapturePlan | None, new: CapturePlan) -> CapturePlan:
    """The new plan with those objects of the old one that it does not name; a plan of another camera is replaced."""
    if old is None or old.camera != new.camera:
        return new
    return new.model_copy(update={"objects": {**old.objects, **new.objects}})
