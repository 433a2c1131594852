"""`transforms.json` in nerfstudio's format, so that a capture opens in the field's own viewers."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from toolkit.core.errors import ToolkitError
from toolkit.core.files import explain_write_error, inside, sha256_file, write_json
from toolkit.rig.camera import Camera

MANIFEST = "manifest.jsonl"


class CaptureRecord(BaseModel):
    """What is known of one image.

    Attributes:
        path: of the image, relative to the source's folder (captures/SOURCE), with forward slashes.
        object, variant, pose_id: what it shows, and from which pose of the plan.
        T_world_camera: 4×4, OpenCV axes, millimetres.
        intrinsics: width, height in pixels, fx, fy, cx, cy in pixels (pixel centres at half integers).
        booster_sha256: of the PNG that was stuck or painted on, None without one.
        image_sha256: of the image file.
        made: how: renderer, studio, seed, program version.
        inputs_sha256: hash of everything the image depends on; another hash means it must be shot again.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    path: str
    object: str
    variant: str
    pose_id: int | None = None
    T_world_camera: list[list[float]] | None = None
    intrinsics: dict[str, float] | None = None
    booster_sha256: str | None = None
    image_sha256: str | None = None
    made: dict[str, Any] = {}
    inputs_sha256: str | None = None

    @property
    def camera(self) -> Camera | None:
        """The camera that `intrinsics` and a photograph's `distortion` describe; None where they are not known."""
        if not self.intrinsics:
            return None
        found = self.made.get("distortion")
        return Camera.from_intrinsics(self.intrinsics, [float(k) for k in found] if isinstance(found, list) else [])


def read_manifest(source_dir: Path) -> dict[str, CaptureRecord]:
    """Records by path; the last line for a path wins; a half-written last line (a kill while appending) is dropped.

    Raises:
        ToolkitError: a line in the middle is broken, or a path leaves the folder.
    """
    file = Path(source_dir) / MANIFEST
    if not file.is_file():
        return {}
    records: dict[str, CaptureRecord] = {}
    text = file.read_text(encoding="utf-8", errors="replace")
    lines = text.split("\n")  # and not at what else Unicode calls a line's end: file names may hold it
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            record = CaptureRecord.model_validate(json.loads(line))
        except (json.JSONDecodeError, ValidationError) as error:
            if number == len(lines):
                break
            raise ToolkitError(
                f"{file}: line {number} is broken ({error.__class__.__name__}): delete that line"
            ) from None
        inside(source_dir, record.path)
        records[record.path] = record
    return records


def append_record(source_dir: Path, record: CaptureRecord) -> None:
    """Append one line and flush it to disk; a half-written line before it is ended first."""
    file = Path(source_dir) / MANIFEST
    try:
        with file.open("a+b") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)
                if stream.read(1) != b"\n":
                    _end_last_line(stream)
            stream.write(json.dumps(record.model_dump(), ensure_ascii=False).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise explain_write_error(file, error) from error


def _end_last_line(stream) -> None:
    """End a last line that is whole, as an editor may leave it; drop one that a kill cut short."""
    stream.seek(0)
    content = stream.read()
    start = content.rfind(b"\n") + 1
    try:
        json.loads(content[start:])
        stream.write(b"\n")
    except ValueError:
        stream.truncate(start)


def is_finished(source_dir: Path, record: CaptureRecord | None, inputs_sha256: str) -> bool:
    """Whether an image was made from the same inputs before and its file is still whole."""
    if record is None or record.inputs_sha256 != inputs_sha256:
        return False
    file = Path(source_dir) / record.path
    return file.is_file() and sha256_file(file) == record.image_sha256


MM_PER_M = 1000.0


def to_opengl(T_world_camera: np.ndarray) -> np.ndarray:
    """(4, 4) with OpenCV camera axes in mm -> OpenGL camera axes (y up, z back) in metres, as nerfstudio has it."""
    flipped = np.array(T_world_camera, float) @ np.diag([1.0, -1.0, -1.0, 1.0])
    flipped[:3, 3] /= MM_PER_M
    return flipped


def describe_transforms(records: list[CaptureRecord]) -> dict[str, Any]:
    """The content of `transforms.json` for the records that know their camera; all must share its intrinsics."""
    known = [(record, record.camera) for record in records if record.T_world_camera]
    cameras = [(record, camera) for record, camera in known if camera is not None]
    if not cameras:
        return {"camera_model": "OPENCV", "frames": []}
    first = cameras[0][1]
    frames = []
    for record, camera in cameras:
        frame: dict[str, Any] = {
            "file_path": record.path, "transform_matrix": to_opengl(np.array(record.T_world_camera)).tolist(),
            "object": record.object, "variant": record.variant,
        }  # fmt: skip
        if camera.intrinsics != first.intrinsics:
            frame |= _describe_camera(camera)
        frames.append(frame)
    distortion = {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}
    return {"camera_model": "OPENCV", **_describe_camera(first), **distortion, "frames": frames}


def write_transforms(source_dir: Path, records: list[CaptureRecord]) -> Path:
    """Write `captures/SOURCE/transforms.json`."""
    return write_json(Path(source_dir) / "transforms.json", describe_transforms(records))


def _describe_camera(camera: Camera) -> dict[str, float]:
    return {
        "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy, "w": camera.width, "h": camera.height,
    }  # fmt: skip
