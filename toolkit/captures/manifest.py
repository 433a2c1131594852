"""Metadata of the images of a source: `manifest.jsonl`, and `transforms.json` for other viewers."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from toolkit.core.files import delete_file, inside, sha256_file, write_json
from toolkit.core.records import RecordLog
from toolkit.rig.camera import Camera

MANIFEST = "manifest.jsonl"
GATES_FILE = "gates.jsonl"
"""File beside the manifest with the gates of each photograph."""
LEFT_OUT = "left_out"
"""Field of `made`: why an image no longer counts, such as a pose that the plan does not have."""
# a file that a user edits: NaN, infinity and absurd lengths are refused on reading
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Row = Annotated[list[Number], Field(min_length=4, max_length=4)]
INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
MOST_COEFFICIENTS = 5
"""Number of coefficients of OpenCV's longest lens model."""


class CaptureRecord(BaseModel):
    """A line of the manifest.

    Attributes:
        path: path of the image inside the source's folder (captures/SOURCE), with forward slashes.
        object, variant: object and variant in the image.
        pose_id: number of its pose in the plan.
        T_world_camera: 4×4 matrix, OpenCV axes, millimetres.
        intrinsics: width, height, fx, fy, cx and cy in pixels (pixel centres at half integers).
        booster_sha256: hash of the booster's PNG, None without a booster.
        image_sha256: hash of the image file.
        made: renderer, studio, seed and program version.
        inputs_sha256: hash of all inputs of the image. If it changes, the image must be shot again.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    path: str
    object: str
    variant: str
    pose_id: Annotated[int, Field(ge=0, le=99_999)] | None = None
    T_world_camera: Annotated[list[Row], Field(min_length=4, max_length=4)] | None = None
    intrinsics: dict[str, Number] | None = None
    booster_sha256: str | None = None
    image_sha256: str | None = None
    made: dict[str, Any] = {}
    inputs_sha256: str | None = None

    @field_validator("intrinsics")
    @classmethod
    def _is_camera(cls, found: dict[str, float] | None) -> dict[str, float] | None:
        if found and not (set(INTRINSICS) <= found.keys() and all(found[name] > 0 for name in INTRINSICS[:4])):
            raise ValueError(f"expected {', '.join(INTRINSICS)} in pixels, the first four above 0")
        return found

    @field_validator("made")
    @classmethod
    def _is_lens(cls, made: dict[str, Any]) -> dict[str, Any]:
        found = made.get("distortion")
        if isinstance(found, list) and not (
            len(found) <= MOST_COEFFICIENTS and all(isinstance(k, int | float) and abs(k) < 1e9 for k in found)
        ):
            raise ValueError("expected distortion as up to five numbers: OpenCV's k1, k2, p1, p2 and k3")
        return made

    @property
    def camera(self) -> Camera | None:
        """Camera of `intrinsics` and a photograph's `distortion`; None if they are not known."""
        if not self.intrinsics:
            return None
        found = self.made.get("distortion")
        return Camera.from_intrinsics(self.intrinsics, [float(k) for k in found] if isinstance(found, list) else [])


def open_manifest(source_dir: Path) -> RecordLog[CaptureRecord]:
    """Return the log of a source's images."""
    return RecordLog(Path(source_dir) / MANIFEST, CaptureRecord)


def read_manifest(source_dir: Path) -> dict[str, CaptureRecord]:
    """Return records by path; the last line of a path counts, and a half-written last line is dropped.

    Raises:
        ToolkitError: a line in the middle is broken, or a path leaves the folder.
    """
    records = open_manifest(source_dir).read_last(lambda record: record.path)
    for path in records:
        inside(source_dir, path)  # a manifest may come from elsewhere
    return records


def append_record(source_dir: Path, record: CaptureRecord) -> None:
    """Append a line and flush it to disk; raises as `RecordLog.append`."""
    open_manifest(source_dir).append(record)


def is_finished(source_dir: Path, record: CaptureRecord | None, key: str) -> bool:
    """Whether an image was made with the same key before, and its file is unchanged."""
    if record is None or record.inputs_sha256 != key:
        return False
    file = Path(source_dir) / record.path
    # by content: a file that was edited is shot again
    return file.is_file() and sha256_file(file) == record.image_sha256


MM_PER_M = 1000.0


def to_opengl(T_world_camera: np.ndarray) -> np.ndarray:
    """Convert (4, 4) from OpenCV camera axes in mm to OpenGL camera axes (y up, z back) in metres, as in nerfstudio."""
    # from the right: the camera's own y and z are turned, not the world's
    flipped = np.array(T_world_camera, float) @ np.diag([1.0, -1.0, -1.0, 1.0])
    flipped[:3, 3] /= MM_PER_M
    return flipped


def describe_transforms(records: list[CaptureRecord]) -> dict[str, Any]:
    """Return the content of a folder's `transforms.json`, of records with a camera.

    Lenses that differ stand in the frames alone: nerfstudio passes over those of frames where the file has one.
    """
    known = [(record, record.camera) for record in records if record.T_world_camera]
    lenses = [(record, _describe_lens(camera)) for record, camera in known if camera is not None]
    # no camera, no frames: viewers read such a file
    if not lenses:
        return {"camera_model": "OPENCV", "frames": []}
    is_shared = all(lens == lenses[0][1] for _, lens in lenses)
    frames = [
        {
            "file_path": Path(record.path).name,
            "transform_matrix": to_opengl(np.array(record.T_world_camera)).tolist(),
            "object": record.object, "variant": record.variant, **({} if is_shared else lens),
        }
        for record, lens in lenses
    ]  # fmt: skip
    return {"camera_model": "OPENCV", **(lenses[0][1] if is_shared else {}), "frames": frames}


TRANSFORMS = "transforms.json"


def write_transforms(source_dir: Path, records: list[CaptureRecord]) -> list[Path]:
    """Write `transforms.json` into each folder of images: all objects stand at the same origin, and would overlap.

    The file of an earlier version, `captures/SOURCE/transforms.json`, is deleted.
    """
    source_dir = Path(source_dir)
    groups: dict[Path, list[CaptureRecord]] = {}
    for record in records:
        groups.setdefault(Path(record.path).parent, []).append(record)
    delete_file(source_dir / TRANSFORMS)
    files = {source_dir / folder / TRANSFORMS: describe_transforms(own) for folder, own in groups.items()}
    return [write_json(file, content, source_dir) for file, content in files.items()]


def _describe_lens(camera: Camera) -> dict[str, float]:
    k1, k2, p1, p2, k3 = camera.distortion
    lens = {
        "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy, "w": camera.width, "h": camera.height,
        "k1": k1, "k2": k2, "p1": p1, "p2": p2,
    }  # fmt: skip
    # only where there is one: not every viewer knows a sixth power
    return lens | ({"k3": k3} if k3 else {})
