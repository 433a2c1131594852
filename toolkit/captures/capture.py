"""One image of a capture folder: what is known of it, and in what two images differ besides the booster."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

UNPATCHED = "unpatched"
SAME_CAMERA = (3.0, 0.05)
"""Two renders by plan are of one pose up to here: degrees seen from the object, share of distance and focal length."""
SAME_PHOTOGRAPH = (15.0, 0.5)
"""Likewise where one camera is held by hand, of a photograph or a rehearsal: degrees and share of distance alone."""
OTHER_CAMERA = "other cameras"
SETTINGS: Mapping[str, str] = {
    "renderer": "another renderer",
    "look": "another version of the rig",
    "backdrop": "another backdrop",
    "light": "other light",
    "seed": "another seed",
    "board": "another board",
    "rehearsed": "one is a rehearsal, the other is not",
    "mesh_sha256": "another shape or length of the object",
    "scene_sha256": "another studio or rehearsal",
    "class": "another class",
    "pose_sha256": "another plan",
    "sheet_sha256": "another size or place of the sheet",
}
"""What two images of a pair must share besides the camera, each with the words for a pair that does not."""


def find_difference(first: Mapping[str, Any], second: Mapping[str, Any]) -> str | None:
    """Return the words for the first of `SETTINGS` in which two images differ; None if they differ in none.

    A setting that either image does not state does not count.
    """
    if not (first and second):  # without a manifest, as in a table of very many rows, nothing is stated
        return None
    shared = (name for name in SETTINGS if name in first and name in second)
    return next((SETTINGS[name] for name in shared if first[name] != second[name]), None)


@dataclass(frozen=True)
class Capture:
    """One image and what is known of it.

    Attributes:
        source, object, variant: the folders that it lies in.
        pose_id: from the manifest, else the number in the file's name, else one for names that are equal; else None.
        file: where it is.
        path: how it is named in results: SOURCE/OBJECT/VARIANT/FILE.
        refused: why it must not be opened, None when it may.
        T_world_camera: 4×4, OpenCV axes, millimetres, where the manifest has it.
        focal_length: of the lens as a share of the image's longer side, where the manifest has it.
        class_name: what the object should be recognised as, where the manifest says so.
        booster_sha256: of what was on the object, where the manifest has it.
        is_rendered: the manifest says that a renderer made it.
        is_by_plan: likewise, and that its camera is the plan's: no photograph's (`--like`) and no rehearsal's.
        is_retextured: by the manifest a true photograph, in which another patch was put in the printed one's place.
        corruption: (name, severity) that it has, or gets where `cut_px` is None; None for an image as it was taken.
        cut_px: side of the square that the file was cut to before it was corrupted, by the manifest; None for an image
            that is corrupted when it is read, after it was resized and cut for the network.
        failed_gates: what its photograph failed when it was judged, such as `over-exposure 64 % of the object clipped`.
        image_sha256: hash of the file's bytes, as they are; None if it cannot be opened.
        settings: how it was made, of `SETTINGS` what the manifest's line states.
    """

    source: str
    object: str
    variant: str
    pose_id: int | None
    file: Path
    path: str
    refused: str | None = None
    T_world_camera: tuple[tuple[float, ...], ...] | None = None
    focal_length: float | None = None
    class_name: str | None = None
    booster_sha256: str | None = None
    is_rendered: bool = False
    is_by_plan: bool = False
    is_retextured: bool = False
    corruption: tuple[str, int] | None = None
    cut_px: int | None = None
    failed_gates: tuple[str, ...] = ()
    image_sha256: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)

    @property
    def pending_corruption(self) -> tuple[str, int] | None:
        """(name, severity) that the image gets whenever it is read; None if its file has it, or there is none."""
        return None if self.cut_px is not None else self.corruption

    @property
    def path_in_source(self) -> str:
        """OBJECT/VARIANT/FILE."""
        return self.path.split("/", 1)[1]

    @property
    def source_dir(self) -> Path:
        """As many folders up as `path_in_source` has, absolute: where the source's manifest lies."""
        above = self.file.absolute().parents
        return above[min(self.path_in_source.count("/"), len(above) - 1)]

    def compare_cameras(self, other: "Capture") -> str | None:
        """Return how another image's camera differs, in words; None if it does not, or if one is not known.

        See `SAME_CAMERA` and `SAME_PHOTOGRAPH`. Cameras are compared as seen from the object, the world's origin.
        """
        if self.T_world_camera is None or other.T_world_camera is None:
            return None
        first, second = ([row[3] for row in rows[:3]] for rows in (self.T_world_camera, other.T_world_camera))
        far, near = math.hypot(*first), math.hypot(*second)
        if not far or not near:
            return None
        by_plan = self.is_by_plan and other.is_by_plan
        most_deg, most_share = SAME_CAMERA if by_plan else SAME_PHOTOGRAPH
        cosine = sum(a * b for a, b in zip(first, second, strict=True)) / (far * near)
        # clamped: rounding may leave a cosine just outside of [-1, 1]
        apart_deg = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
        if apart_deg > most_deg:
            return f"{apart_deg:.0f}° apart"
        if abs(far - near) > most_share * min(far, near):
            return f"{far:.0f} and {near:.0f} mm away"
        lens, other_lens = self.focal_length, other.focal_length
        if by_plan and lens and other_lens and abs(lens - other_lens) > most_share * min(lens, other_lens):
            return "with another lens"
        return None

    def explain_no_pair(self, other: "Capture") -> str | None:
        """Return why two images differ in more than the booster, in words; None if they form a pair."""
        camera = self.compare_cameras(other)
        return f"{OTHER_CAMERA} ({camera})" if camera else find_difference(self.settings, other.settings)
