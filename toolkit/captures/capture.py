"""An image of a capture folder, and the differences of two images besides the booster."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

UNPATCHED = "unpatched"
SAME_CAMERA = (3.0, 0.05)
"""Largest difference of two renders of a pose: degrees seen from the object, share of distance and focal length."""
SAME_PHOTOGRAPH = (15.0, 0.5)
"""Likewise for a camera held by hand, in photographs and rehearsals: degrees and share of distance."""
OTHER_CAMERA = "other cameras"
RENDERER_VERSION = "renderer_version"
SETTINGS: Mapping[str, str] = {
    "renderer": "another renderer",
    RENDERER_VERSION: "another version of the renderer",
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
"""Setting that two images of a pair must share -> words for a pair that does not share it."""


OF_RENDERER = ("renderer", RENDERER_VERSION, "scene_sha256")
"""The settings in which images of two renderers differ in any case."""


def find_difference(first: Mapping[str, Any], second: Mapping[str, Any], but: Collection[str] = ()) -> str | None:
    """Return the words for the first of `SETTINGS` in which two images differ, else None.

    A setting that either image does not state, or that is in `but`, does not count.
    """
    if not (first and second):  # without a manifest, as in a table of very many rows, nothing is stated
        return None
    shared = (name for name in SETTINGS if name in first and name in second and name not in but)
    return next((SETTINGS[name] for name in shared if first[name] != second[name]), None)


@dataclass(frozen=True)
class Capture:
    """An image and its metadata, from the manifest if there is one.

    Attributes:
        source, object, variant: folders of the image.
        pose_id: from the manifest, the number in the file's name, or equal names in several variants.
        file: path of the file.
        path: name in results: SOURCE/OBJECT/VARIANT/FILE.
        refused: why the file must not be opened; None if it may.
        T_world_camera: 4×4, OpenCV axes, millimetres.
        focal_length: focal length as a share of the image's longer side.
        class_name: class of the object.
        booster_sha256: hash of the booster on the object.
        is_rendered: whether a renderer made the image.
        is_by_plan: whether the render has the plan's camera: not a photograph's (`--like`), and no rehearsal.
        is_retextured: whether another patch replaces the printed patch in a photograph.
        corruption: (name, severity) that the image has, or gets if `cut_px` is None; None without a corruption.
        cut_px: side of the square that the file was cut to before its corruption; None for an image that is corrupted
            when it is read.
        failed_gates: gates that the photograph failed, such as `over-exposure 64 % of the object clipped`.
        image_sha256: hash of the file; None if it cannot be opened.
        settings: those of `SETTINGS` that the manifest states.
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
        """(name, severity) that the image gets when it is read; None if its file has it, or there is none."""
        return None if self.cut_px is not None else self.corruption

    @property
    def path_in_source(self) -> str:
        """OBJECT/VARIANT/FILE."""
        return self.path.split("/", 1)[1]

    @property
    def source_dir(self) -> Path:
        """Absolute folder of the source's manifest: as many folders up as `path_in_source` has."""
        above = self.file.absolute().parents
        return above[min(self.path_in_source.count("/"), len(above) - 1)]

    def compare_cameras(self, other: "Capture") -> str | None:
        """Return how another image's camera differs, in words; None if it does not, or if a camera is not known.

        Cameras are compared as seen from the object, the world's origin; see `SAME_CAMERA` and `SAME_PHOTOGRAPH`.
        """
        if self.T_world_camera is None or other.T_world_camera is None:
            return None
        # the last column of the pose is the camera's place
        first, second = ([row[3] for row in rows[:3]] for rows in (self.T_world_camera, other.T_world_camera))
        # distances from the object, at the origin
        far, near = math.hypot(*first), math.hypot(*second)
        if not far or not near:
            return None
        # a photograph is taken by hand, and need not be as near as a render of the same plan
        by_plan = self.is_by_plan and other.is_by_plan
        most_deg, most_share = SAME_CAMERA if by_plan else SAME_PHOTOGRAPH
        cosine = sum(a * b for a, b in zip(first, second, strict=True)) / (far * near)
        # clamped, as rounding may leave [-1, 1]
        apart_deg = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
        if apart_deg > most_deg:
            return f"{apart_deg:.0f}° apart"
        if abs(far - near) > most_share * min(far, near):
            return f"{far:.0f} and {near:.0f} mm away"
        # focal lengths are shares of the image's longer side, so that resolution does not count
        lens, other_lens = self.focal_length, other.focal_length
        if by_plan and lens and other_lens and abs(lens - other_lens) > most_share * min(lens, other_lens):
            return "with another lens"
        return None

    def explain_no_pair(self, other: "Capture") -> str | None:
        """Return why two images differ in more than the booster, in words; None if they form a pair."""
        camera = self.compare_cameras(other)
        return f"{OTHER_CAMERA} ({camera})" if camera else find_difference(self.settings, other.settings)
