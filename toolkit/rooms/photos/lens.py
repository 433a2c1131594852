"""Lenses of real cameras in `rig/lens.json`, and which of them a photograph was taken with."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, write_json
from toolkit.core.text import join_words
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import UnreadableImage, open_image
from toolkit.rig.camera import NO_DISTORTION, Camera, Distortion
from toolkit.rooms.photos.photo import Photo

FULL_FRAME_DIAGONAL_MM = 43.2666
"""Diagonal of 36 × 24 mm. A 35 mm-equivalent focal length is read as the focal length with the same *diagonal*
angle of view, as CIPA's DCG-001 defines it and phones write it."""

SAME_ASPECT = 0.01
"""Relative difference of aspect ratios up to which two pictures are of the same frame at two sizes."""


def same_aspect(first: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two picture sizes (width, height) have the same shape."""
    return abs(first[0] * other[1] / (first[1] * other[0]) - 1) < SAME_ASPECT


def scale_lens(lens: Camera, width: int, height: int) -> Camera:
    """The same lens in pictures of another size and the same shape.

    Raises:
        ToolkitError: the shapes differ, so that the crop between them is unknown.
    """
    if not same_aspect((lens.width, lens.height), (width, height)):
        raise ToolkitError(
            f"a lens of {lens.width}x{lens.height} px says nothing of {width}x{height} px, another shape: "
            f"calibrate with photos of that size"
        )
    return lens.scaled(width, height)


def lens_from_focal(width: int, height: int, focal_35mm_mm: float) -> Camera:
    """Return a lens without distortion from its 35 mm-equivalent focal length.

    Phones round it to a whole millimetre (2 % at 26 mm). A cropped picture, as 16:9 mostly is, may state the full
    frame's focal length: a calibrated lens is better.
    """
    # f / diagonal is the same for all frames of the same diagonal angle of view
    focal_px = focal_35mm_mm / FULL_FRAME_DIAGONAL_MM * float(np.hypot(width, height))
    return Camera.from_focal_px(width, height, focal_px)


SAME_FOCAL = 0.02
"""Relative difference of 35 mm-equivalent focal lengths up to which two photographs are of the same lens of a phone."""
LESS_SURE = 1.1
"""Factor between two standard deviations from which a lens counts as worse: a photograph more or less changes it by
less."""
SENSOR_TURNS = {6: 1, 3: 2, 8: 3}
"""Quarter turns clockwise that bring stored pixels upright, by EXIF orientation."""


class LensRecord(BaseModel):
    """A calibrated lens, in pixels of the stored image.

    Attributes:
        camera: maker and model in EXIF; None if the camera writes none.
        focal_35mm_mm: 35 mm focal length in EXIF; it tells a phone's lenses apart.
        width, height: size of the stored image, pixels.
        fx, fy: focal lengths, pixels.
        cx, cy: principal point, pixels; the centre of pixel (0, 0) is (0.5, 0.5).
        distortion: OpenCV's k1, k2, p1, p2, k3.
        reprojection_px: root mean square error of the calibration.
        focal_sigma_px: standard deviation of fx, from leaving photographs out.
        views: number of photographs used.
        coverage: share of the frame with board corners.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    camera: str | None = None
    focal_35mm_mm: float | None = Field(None, gt=0)
    width: int = Field(ge=16, le=65535)
    height: int = Field(ge=16, le=65535)
    fx: float = Field(gt=0)
    fy: float = Field(gt=0)
    cx: float
    cy: float
    distortion: Distortion = NO_DISTORTION
    reprojection_px: float | None = None
    focal_sigma_px: float | None = None
    views: int | None = None
    coverage: float | None = None

    def lens(self) -> Camera:
        """The lens, for pictures as the sensor stores them."""
        return Camera.from_intrinsics(self.model_dump(), self.distortion)

    def same_lens(self, other: "LensRecord") -> bool:
        """Whether both have the same camera, focal length and size, so that the newer lens replaces the older."""
        sizes = (self.width, self.height) == (other.width, other.height)
        return sizes and self.camera == other.camera and _same_focal(self.focal_35mm_mm, other.focal_35mm_mm)

    def is_surer_than(self, other: "LensRecord") -> bool:
        """Whether its focal length is known better, by more than a tenth; False if either is unknown."""
        if self.focal_sigma_px is None or other.focal_sigma_px is None:
            return False
        # relative to fx, since the two may be of pictures of other sizes
        return LESS_SURE * self.focal_sigma_px / self.fx < other.focal_sigma_px / other.fx


class LensFile(BaseModel):
    """`rig/lens.json`."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    lenses: list[LensRecord] = []


@dataclass(frozen=True)
class LensChoice:
    """The lens of an upright photograph, None if unknown; `note` tells a person where it comes from, or what to do."""

    lens: Camera | None
    source: Literal["calibrated", "exif", "none"]
    note: str


def lens_file(workspace: Workspace) -> Path:
    """Path of the calibrated lenses."""
    return workspace.root / "rig" / "lens.json"


def read_lenses(workspace: Workspace) -> list[LensRecord]:
    """Return the calibrated lenses, none without a file; a broken file is a `ToolkitError`."""
    file = lens_file(workspace)
    return read_json(file, LensFile).lenses if file.is_file() else []


def write_lenses(
    workspace: Workspace, records: list[LensRecord], replace: bool = False
) -> tuple[Path, list[tuple[LensRecord, LensRecord]]]:
    """Add lenses to `rig/lens.json`, in place of older lenses of the same camera, focal length and size.

    A less certain lens does not replace the stored lens, unless `replace`.

    Returns:
        The file, and (old, new) of the old lenses that were kept instead.
    """
    there = read_lenses(workspace)
    kept = []
    for new in records:
        # a lens that is known better stays, unless it shall be replaced
        better = next((old for old in there if old.same_lens(new) and old.is_surer_than(new)), None)
        if better is not None and not replace:
            kept.append((better, new))
    added = [new for new in records if not any(new is worse for _, worse in kept)]
    # lenses of other cameras and settings stay
    others = [old for old in there if not any(old.same_lens(new) for new in added)]
    made = LensFile(lenses=[*others, *added])
    return write_json(lens_file(workspace), made.model_dump(mode="json", exclude_none=True)), kept


def choose_lens(photo: Photo, records: list[LensRecord]) -> LensChoice:
    """Return the lens of a photograph: the calibrated lens, else by EXIF, else none and why."""
    # the lens belongs to the sensor, whose rows may run along the photograph's columns
    turns = turns_upright(photo.path)
    stored = (photo.width, photo.height) if turns % 2 == 0 else (photo.height, photo.width)
    same_camera = [record for record in records if record.camera == photo.camera]
    usable = [record for record in same_camera if _same_focal(record.focal_35mm_mm, photo.focal_35mm_mm)]
    turned = turns
    fitting = [record for record in usable if same_aspect((record.width, record.height), stored)]
    if not fitting and turns % 2 == 0:
        # turned without saying so, by an editor or as videos are: which way round is not known, and nearly the same
        fitting = [record for record in usable if same_aspect((record.height, record.width), stored)]
        turned = turns + 1
    focals = {record.focal_35mm_mm for record in fitting}
    # a phone has several lenses: without a focal length the lens is not known
    if photo.focal_35mm_mm is None and len(focals) > 1:
        said = join_words(
            f"{focal:g} mm" if focal else "no focal length" for focal in sorted(focals, key=lambda f: f or 0)
        )
        return LensChoice(
            None, "none", f"{photo.camera or 'the camera'} was calibrated at {said}, the photo names none"
        )
    if fitting:
        record = min(fitting, key=lambda record: abs(record.width * record.height - stored[0] * stored[1]))
        lens = scale_lens(record.lens().rotated(turned), photo.width, photo.height)
        return LensChoice(lens, "calibrated", f"calibrated lens of {record.camera or 'a camera without a name'}")
    why = _why_not_calibrated(photo, records, same_camera, usable)
    if photo.focal_35mm_mm:
        lens = lens_from_focal(photo.width, photo.height, photo.focal_35mm_mm)
        return LensChoice(lens, "exif", f"focal length from EXIF, good to about 2 %; {why}")
    return LensChoice(None, "none", f"no focal length in the photo's EXIF, and {why}")


def turns_upright(path: Path) -> int:
    """Quarter turns clockwise that EXIF asks for to bring stored pixels upright; 0 where it is silent."""
    try:
        with open_image(path) as image:
            # pillow-heif turns the picture itself and keeps the orientation here
            orientation = image.info.get("original_orientation") or image.getexif().get(0x0112, 1)
    # a video, a raw photograph, damaged EXIF: nothing is known then, and the pixels are read elsewhere
    except UnreadableImage:
        return 0
    return SENSOR_TURNS.get(orientation, 0) if isinstance(orientation, int) else 0


def _why_not_calibrated(
    photo: Photo, records: list[LensRecord], same_camera: list[LensRecord], usable: list[LensRecord]
) -> str:
    camera = photo.camera or "a camera without a name"
    if not records:
        return "no lens is calibrated: run 'toolkit calibrate PHOTOS/' with photos of the board"
    if not same_camera:
        return f"no calibrated lens is of {camera}: run 'toolkit calibrate PHOTOS/' with its photos of the board"
    if not usable:
        return f"{camera} was calibrated at another focal length: run 'toolkit calibrate PHOTOS/' with such photos"
    shape = f"pictures of another shape than {photo.width}x{photo.height}"
    return f"{camera} was calibrated with {shape}: run 'toolkit calibrate PHOTOS/' with pictures of this shape"


def _same_focal(first: float | None, other: float | None) -> bool:
    return first is None or other is None or abs(first / other - 1) < SAME_FOCAL
