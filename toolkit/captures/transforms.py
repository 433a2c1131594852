"""`transforms.json` in nerfstudio's format, so that a capture opens in the field's own viewers."""

from pathlib import Path
from typing import Any

import numpy as np

from toolkit.captures.manifest import CaptureRecord
from toolkit.files import write_json

MM_PER_M = 1000.0


def to_opengl(T_world_camera: np.ndarray) -> np.ndarray:
    """(4, 4) with OpenCV camera axes in mm -> OpenGL camera axes (y up, z back) in metres, as nerfstudio has it."""
    flipped = np.array(T_world_camera, float) @ np.diag([1.0, -1.0, -1.0, 1.0])
    flipped[:3, 3] /= MM_PER_M
    return flipped


def describe_transforms(records: list[CaptureRecord]) -> dict[str, Any]:
    """The content of `transforms.json` for the records that know their camera; all must share its intrinsics."""
    known = [record for record in records if record.T_world_camera and record.intrinsics]
    if not known:
        return {"camera_model": "OPENCV", "frames": []}
    lens = known[0].intrinsics or {}
    frames = []
    for record in known:
        own = record.intrinsics or {}
        frame: dict[str, Any] = {
            "file_path": record.path, "transform_matrix": to_opengl(np.array(record.T_world_camera)).tolist(),
            "object": record.object, "variant": record.variant,
        }  # fmt: skip
        if own != lens:
            frame |= _lens(own)
        frames.append(frame)
    return {"camera_model": "OPENCV", **_lens(lens), "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "frames": frames}


def write_transforms(source_dir: Path, records: list[CaptureRecord]) -> Path:
    """Write `captures/SOURCE/transforms.json`."""
    return write_json(Path(source_dir) / "transforms.json", describe_transforms(records))


def _lens(intrinsics: dict[str, float]) -> dict[str, float]:
    return {
        "fl_x": intrinsics["fx"], "fl_y": intrinsics["fy"], "cx": intrinsics["cx"], "cy": intrinsics["cy"],
        "w": int(intrinsics["width"]), "h": int(intrinsics["height"]),
    }  # fmt: skip
