"""The capture plan: where the camera stands for every pose of every object, in `rig/plan.json`."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, sha256_json, write_json
from toolkit.core.text import FileName, join_words
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.spec import names_with_mesh
from toolkit.rig import MOST_POSES, Pattern
from toolkit.rig.camera import Camera, Distortion, distance_to_fill, orbit_pose, project
from toolkit.rig.fit import describe_misfits, mounted_sizes_mm, sheet_points


def spread_poses(pattern: Pattern) -> np.ndarray:
    """(count, 2) azimuth in [0, 360) and elevation in degrees."""
    low, high = pattern.elevation_deg
    angles = PATTERNS[pattern.name](pattern.count, low, high)
    if pattern.jitter_deg:
        for i in range(len(angles)):  # pose i depends on (seed, i) alone
            angles[i] += np.random.default_rng([pattern.seed, i]).normal(0, pattern.jitter_deg, 2)
        # at most three deviations below the lowest that was asked for, and never under the table
        angles[:, 1] = angles[:, 1].clip(max(low - 3 * pattern.jitter_deg, 0), 90)
    angles[:, 0] %= 360
    return angles


def _grid(count: int, low: float, high: float) -> np.ndarray:
    """Rows of equal azimuths: three elevations where the count allows (18 = 6 × 3), else two, else one.

    Rows of fewer than four are turned against each other, else 6 = 2 × 3 would see front and back alone.
    """
    rows = next(rows for rows in (3, 2, 1) if count % rows == 0) if low < high else 1
    columns = count // rows
    elevations = np.linspace(low, high, rows) if rows > 1 else [(low + high) / 2]
    # with few poses in a row, rows are turned against each other: together they still see all sides
    turn = 360 / count if columns < 4 else 0
    return np.array(
        [(360 * i / columns + row * turn, e) for row, e in enumerate(elevations) for i in range(columns)], float
    )


def _ring(count: int, low: float, high: float) -> np.ndarray:
    """A circle at the middle elevation."""
    return np.stack([np.arange(count) * 360 / count, np.full(count, (low + high) / 2)], axis=1)


def _hemisphere(count: int, low: float, high: float) -> np.ndarray:
    """Rings whose share of the poses follows their circumference, so that directions are about evenly dense."""
    rows = max(1, round(np.sqrt(count * (high - low) / 150))) if low < high else 1
    edges = np.linspace(low, high, rows + 1)
    elevations = (edges[:-1] + edges[1:]) / 2
    # a ring's circumference; the small term leaves a ring at the zenith its pose
    shares = np.cos(np.radians(elevations)) + 1e-6
    # rounded sums, not rounded parts: they add up to `count`
    ends = np.round(np.cumsum(shares) / shares.sum() * count).astype(int)
    rings = zip(elevations, np.diff(np.r_[0, ends]), strict=True)
    return np.array(
        # every other ring is turned by half a step, as bricks are laid
        [(360 * (i + 0.5 * (row % 2)) / n, e) for row, (e, n) in enumerate(rings) for i in range(n)], float
    )  # fmt: skip


def _fibonacci(count: int, low: float, high: float) -> np.ndarray:
    """A golden-angle spiral with equal area per pose between the two elevations."""
    i = np.arange(count)
    # even steps of the sine of elevation are rings of equal area (Archimedes)
    sines = np.sin(np.radians(low)) + (i + 0.5) / count * (np.sin(np.radians(high)) - np.sin(np.radians(low)))
    return np.stack([i * 180 * (3 - np.sqrt(5)), np.degrees(np.arcsin(sines))], axis=1)


PATTERNS: dict[str, Callable[[int, float, float], np.ndarray]] = {
    "grid": _grid, "ring": _ring, "hemisphere": _hemisphere, "fibonacci": _fibonacci,
}  # fmt: skip


Row = tuple[float, float, float, float]
PoseId = Annotated[int, Field(ge=1, le=99_999)]
"""Five digits are what is read from a photograph's name."""
LEAST_SIDE_PX, MOST_SIDE_PX = 16, 16384
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
"""Millimetres: a kilometre from the object."""


class _CameraFields(BaseModel):
    """A camera as a plan's file has it: how wide it sees, and what else differs from a centred lens and square pixels.

    Attributes:
        width, height: pixels.
        fov_deg: horizontal field of view.
        focal_mm, sensor_width_mm: the same as a focal length over a sensor as wide as the picture.
        fx, fy: the same as focal lengths in pixels; fy by default as fx.
        cx, cy: principal point, pixels; by default the middle.
        distortion: k1, k2, p1, p2, k3 of OpenCV.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    width: int = Field(640, ge=LEAST_SIDE_PX, le=MOST_SIDE_PX)
    height: int = Field(480, ge=LEAST_SIDE_PX, le=MOST_SIDE_PX)
    fov_deg: float | None = Field(None, gt=1, lt=170)
    focal_mm: float | None = Field(None, ge=0.1, le=1e4)
    sensor_width_mm: float | None = Field(None, ge=0.1, le=1e3)
    fx: float | None = Field(None, ge=1, le=1e6)
    fy: float | None = Field(None, ge=1, le=1e6)
    cx: float | None = Field(None, ge=0, le=MOST_SIDE_PX)
    cy: float | None = Field(None, ge=0, le=MOST_SIDE_PX)
    distortion: Distortion | None = None
    convention: Literal["opencv"] = "opencv"

    @model_validator(mode="after")
    def _agree(self) -> "_CameraFields":
        if (self.focal_mm is None) != (self.sensor_width_mm is None):
            given, lacks = ("focal_mm", "sensor_width_mm") if self.focal_mm else ("sensor_width_mm", "focal_mm")
            raise ValueError(
                f"{given} says how wide the camera sees only with {lacks}: add it, or give fov_deg instead"
            )
        lenses = self._lenses()
        if lenses and max(lenses.values()) > min(lenses.values()) * (1 + SAME_LENS):
            said = join_words(f"{name} ({focal_px:.1f} px)" for name, focal_px in lenses.items())
            raise ValueError(f"{said} are different focal lengths: keep one of them")
        return self

    @model_serializer(mode="wrap")
    def _leave_out(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A camera of a field of view alone is written, and hashed, as it was before there was more."""
        return {name: value for name, value in dump(self).items() if value is not None or name not in PIXEL_FIELDS}

    def _lenses(self) -> dict[str, float]:
        """Focal length in pixels by each way that says it."""
        found = {}
        if self.fov_deg is not None:
            found["fov_deg"] = Camera.from_fov(self.width, self.height, self.fov_deg).fx
        if self.focal_mm is not None and self.sensor_width_mm is not None:
            found["focal_mm"] = Camera.from_focal_mm(self.width, self.height, self.focal_mm, self.sensor_width_mm).fx
        if self.fx is not None:
            found["fx"] = self.fx
        return found

    @classmethod
    def of(cls, camera: Camera) -> "_CameraFields":
        """The shortest way to write a camera."""
        if is_plain(camera):
            return cls(width=camera.width, height=camera.height, fov_deg=camera.fov_deg)
        return cls(
            width=camera.width, height=camera.height, fx=camera.fx, fy=camera.fy, cx=camera.cx, cy=camera.cy,
            distortion=camera.distortion,
        )  # fmt: skip

    def camera(self) -> Camera:
        lenses = self._lenses()
        made = Camera.from_fov(self.width, self.height)
        if lenses:
            made = Camera.from_focal_px(self.width, self.height, next(iter(lenses.values())))
        given = {name: getattr(self, name) for name in PIXEL_FIELDS}
        return replace(made, **{name: value for name, value in given.items() if value is not None})


PIXEL_FIELDS = ("fx", "fy", "cx", "cy", "distortion")
SAME_LENS = 1e-3
"""Two ways to say a focal length may differ by this share: numbers in files are rounded."""


def is_plain(camera: Camera) -> bool:
    """Whether its field of view says it all: square pixels, a centred lens, no distortion."""
    plain = Camera.from_fov(camera.width, camera.height, camera.fov_deg)
    # the field of view is rounded to 12 digits
    same = np.allclose(list(camera.intrinsics.values()), list(plain.intrinsics.values()), rtol=1e-9, atol=0)
    return same and not any(camera.distortion)


class _InFile:
    """Reads and writes a `Camera` as `_CameraFields`."""

    @staticmethod
    def __get_pydantic_core_schema__(source: type[Camera], handler: GetCoreSchemaHandler) -> CoreSchema:
        fields = handler.generate_schema(_CameraFields)
        return core_schema.no_info_wrap_validator_function(
            lambda value, read: value if isinstance(value, Camera) else read(value).camera(),
            fields,
            serialization=core_schema.plain_serializer_function_ser_schema(_CameraFields.of, return_schema=fields),
        )


class Pose(BaseModel):
    """A camera position.

    Attributes:
        id: number of the pose: 1, 2, …
        azimuth_deg, elevation_deg, roll_deg: direction and roll of the camera, as in `toolkit.rig.camera`.
        distance_mm: distance from the camera to `target_mm`.
        target_mm: point at the image's centre.
        T_world_camera: 4×4 matrix. If given, it must agree with the other fields.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    id: PoseId
    azimuth_deg: float
    elevation_deg: float = Field(ge=-90, le=90)
    roll_deg: float = 0.0
    distance_mm: float = Field(gt=0, le=1e6)
    target_mm: tuple[Coordinate, Coordinate, Coordinate]
    T_world_camera: tuple[Row, Row, Row, Row] | None = None

    @model_validator(mode="after")
    def _agree(self) -> "Pose":
        if self.T_world_camera is None:
            return self
        off = np.abs(np.array(self.T_world_camera) - self._derived())
        # rounding in a file that was edited by hand is forgiven, another pose is not
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


def hash_pose(camera: Camera, pose: Pose) -> str:
    """SHA-256 of where a plan's camera stands for a pose and how it sees, 64 hex digits; the pose's number is left out.

    Numbers are rounded to a millionth of a pixel, millimetre or degree, so that every machine finds the same.
    """
    numbers = [
        *camera.intrinsics.values(), *camera.distortion, pose.azimuth_deg, pose.elevation_deg, pose.roll_deg,
        pose.distance_mm, *pose.target_mm,
    ]  # fmt: skip
    # + 0.0: no negative zero
    return sha256_json([f"{round(number, 6) + 0.0:.6f}" for number in numbers])


class CapturePlan(BaseModel):
    """Camera, and poses per object."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    camera: Annotated[Camera, _InFile]
    pattern: dict[str, object] = {}
    objects: dict[FileName, Annotated[list[Pose], Field(max_length=MOST_POSES)]]

    @model_validator(mode="after")
    def _distinct(self) -> "CapturePlan":
        for name, poses in self.objects.items():
            ids = [pose.id for pose in poses]
            if not ids or len(set(ids)) < len(ids):
                raise ValueError(f"object '{name}': expected at least one pose and ids that differ, found {ids}")
        return self


WHOLE = 0.98
"""Share of the frame that an object may fill: a sheet that reaches further out is still in the picture."""


def plan_poses(
    item: TableObject, camera: Camera, pattern: Pattern, sheet_mm: np.ndarray | None = None
) -> list[Pose]:  # fmt: skip
    """The poses of an object: the camera looks at the middle of its bounding box, which is never cropped.

    Args:
        sheet_mm: (n, 3) points of the sheet that is stuck on it, which is never cropped either.

    Raises:
        ToolkitError: a distance asked for puts the camera inside the object or crops it.
    """
    target = np.array([0.0, 0.0, item.mesh.size_mm[2] / 2])
    poses = []
    angles = spread_poses(pattern)
    for i, (azimuth, elevation) in enumerate(np.round(angles, 3)):
        distance = distance_to_fill(camera, item.mesh.vertices, target, azimuth, elevation, fill=pattern.fill)
        if sheet_mm is not None:
            # a sheet may reach out over its object: it decides only where it would be cut
            distance = max(distance, distance_to_fill(camera, sheet_mm, target, azimuth, elevation, fill=WHOLE))
        # a distance that was asked for replaces that which fills the frame; two are spread over the poses
        if pattern.distance_mm is not None:
            share = i / max(len(angles) - 1, 1)
            distance = pattern.distance_mm[0] * (1 - share) + pattern.distance_mm[1] * share
        # rounded before the matrix is made, so that the file's numbers agree with each other
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
        # inside its bounding box counts as inside the object
        if np.all(position > low) and np.all(position < high):
            raise ToolkitError(f"{where}: the camera is inside the object: expected a larger distance_mm")
        if position[2] <= 0:
            raise ToolkitError(f"{where}: the camera is below the table top: expected an elevation that keeps it above")
        # the distance at which the object fills 99.5 % of the frame
        least = distance_to_fill(
            camera, item.mesh.vertices, np.array(pose.target_mm), pose.azimuth_deg, pose.elevation_deg,
            fill=0.995, roll_deg=pose.roll_deg,
        )  # fmt: skip
        if pose.distance_mm < least:
            raise ToolkitError(
                f"{where}: the object is cropped at {pose.distance_mm:.0f} mm: expected at least {least:.0f} mm"
            )


def make_plan(
    items: list[TableObject], camera: Camera, pattern: Pattern, workspace: Workspace | None = None
) -> CapturePlan:
    """A plan for several objects.

    Args:
        workspace: whose patches are on them: its own objects are framed together with their sheets.

    Raises:
        ToolkitError: the camera cannot be, or as `plan_poses` and `spread_poses` say.
    """
    # the bounds of the file are checked first, or a plan could be written that cannot be read again
    try:
        _CameraFields.of(camera)
    except ValidationError as error:
        first = error.errors()[0]
        raise ToolkitError(f"camera: {first['loc'][0]}: {first['msg']}, found {first['input']}") from None
    return CapturePlan(
        camera=camera,
        pattern=pattern.record(),
        objects={
            item.name: plan_poses(item, camera, pattern, None if workspace is None else sheet_points(workspace, item))
            for item in items
        },
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
    # without names, a plan that is there is complete; where there is none, all objects with a mesh are planned
    wanted = names or [] if old else sorted({*names_with_mesh(workspace), *(names or [])})
    missing = [name for name in wanted if old is None or name not in old.objects]
    if old is not None and not missing:
        return old
    items = [load_object(workspace.object_spec(name)) for name in missing]
    # the plan's camera stays, as its poses were chosen for it
    plan = keep_others(old, make_plan(items, old.camera if old else Camera.from_fov(), pattern or Pattern(), workspace))
    write_plan(workspace.plan_file, plan)
    return plan


def keep_others(old: CapturePlan | None, new: CapturePlan) -> CapturePlan:
    """The new plan with those objects of the old plan that it does not name; a plan of another camera is replaced."""
    if old is None or old.camera != new.camera:
        return new
    return new.model_copy(update={"objects": {**old.objects, **new.objects}})


def scale_distance(plan: CapturePlan, factor: float) -> CapturePlan:
    """Every camera `factor` times as far from what it looks at, from the same direction.

    `T_world_camera` is worked out again where the plan has it, and left out where it has not.
    """
    if factor == 1:
        return plan
    objects = {name: [_move(pose, factor) for pose in poses] for name, poses in plan.objects.items()}
    return plan.model_copy(update={"objects": objects})


def make_camera(width: int, height: int, fov_deg: float) -> Camera:
    """A plan's camera of this horizontal field of view.

    Raises:
        ToolkitError: width or height is under 16 or over 16384 pixels.
    """
    if not all(LEAST_SIDE_PX <= side <= MOST_SIDE_PX for side in (width, height)):
        raise ToolkitError(
            f"a resolution of {width}×{height} px: expected both sides between {LEAST_SIDE_PX} and {MOST_SIDE_PX} px"
        )
    return Camera.from_fov(width, height, fov_deg)


def scale_resolution(plan: CapturePlan, width_px: int) -> CapturePlan:
    """Pictures `width_px` wide with the same field of view; the height follows, rounded to whole pixels.

    Raises:
        ToolkitError: width or height is under 16 or over 16384 pixels.
    """
    camera = plan.camera
    small = make_camera(width_px, round(camera.height * width_px / camera.width), camera.fov_deg)
    # the shape is rounded to whole pixels: of a plain camera pixels stay square
    scaled = small if is_plain(camera) else camera.scaled(small.width, small.height)
    return plan.model_copy(update={"camera": scaled})


def _move(pose: Pose, factor: float) -> Pose:
    distance_mm = round(pose.distance_mm * factor, 2)
    T_world_camera = orbit_pose(
        np.array(pose.target_mm), pose.azimuth_deg, pose.elevation_deg, distance_mm, pose.roll_deg
    )  # fmt: skip
    rows = None if pose.T_world_camera is None else np.round(T_world_camera, 6).tolist()
    return Pose.model_validate(pose.model_dump() | {"distance_mm": distance_mm, "T_world_camera": rows})


def plan_objects(
    workspace: Workspace, objects: Sequence[str] = (), pattern: Pattern | None = None, camera: Camera | None = None
) -> CapturePlan:
    """Plan the poses of objects again and write `rig/plan.json`; without names, of all that the workspace knows.

    Objects that the plan holds already and that are not named keep their poses, if the camera is the same.

    Args:
        workspace: whose objects are meant, and whose plan is written.
        pattern: how the poses are spread; 18 on a grid by default. Degrees and millimetres.
        camera: pixels and field of view; 640 × 480 px and 40 degrees by default.

    Returns:
        The whole plan as it was written.

    Raises:
        ToolkitError: an unknown object, or as `make_plan` says.
    """
    items = [load_object(workspace.object_spec(name)) for name in objects or names_with_mesh(workspace)]
    made = make_plan(items, camera or Camera.from_fov(), pattern or Pattern(), workspace)
    # a plan of all objects begins anew, a plan of named objects keeps the others
    old = read_plan(workspace.plan_file) if objects and workspace.plan_file.is_file() else None
    plan = keep_others(old, made)
    write_plan(workspace.plan_file, plan)
    return plan


def seen_share(points_mm: np.ndarray, camera: Camera, pose: Pose) -> float:
    """Share of points that fall into the frame."""
    pixels, depth = project(camera, pose.matrix(), points_mm)
    inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] <= camera.width) & (pixels[:, 1] <= camera.height)
    return float((inside & (depth > 0)).mean())


def list_misfits(workspace: Workspace, names: Sequence[str], plan: CapturePlan | None = None) -> list[str]:
    """Warnings about the sheets of objects before they are printed or shot, a line each.

    Args:
        plan: its cameras must have all sheets of the user's objects whole in the frame; built-in objects are framed
            alone.

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
        # a share of 0.001 is rounding at the border
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
