"""`rig/lens.json`: the lenses that `toolkit calibrate` measured, and which of them a photograph was taken with.

Lenses are kept for pictures as the sensor stores them, before EXIF's orientation turns them upright, because that is
how the lens sits before the sensor; the lens of a portrait photograph follows by turning.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from toolkit.captures.camera.lens import Lens, lens_from_exif, same_aspect
from toolkit.captures.photos.photo import Photo
from toolkit.files import read_json, write_json
from toolkit.workspace import Workspace

SAME_FOCAL = 0.02
"""Relative difference of 35 mm-equivalent focal lengths up to which two photographs are of one lens of a phone."""
SENSOR_TURNS = {6: 1, 3: 2, 8: 3}
"""Quarter turns clockwise that bring stored pixels upright, by EXIF orientation."""


class LensRecord(BaseModel):
    """One calibrated lens.

    Attributes:
        camera: maker and model as EXIF has them, None for a camera that writes none.
        focal_35mm_mm: what it writes for this lens; phones have several.
        width, height, fx, fy, cx, cy: pixels, as the sensor stores them; pixel (0, 0)'s centre at (0.5, 0.5).
        distortion: OpenCV's k1, k2, p1, p2, k3.
        reprojection_px: root mean square error of the calibration.
        focal_sigma_px: standard deviation of fx.
        views: photographs used.
        coverage: share of the frame that held corners of the board.
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
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    reprojection_px: float | None = None
    focal_sigma_px: float | None = None
    views: int | None = None
    coverage: float | None = None

    def lens(self) -> Lens:
        """The lens, for pictures as the sensor stores them."""
        return Lens(self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.distortion)

    def same_lens(self, other: "LensRecord") -> bool:
        """Whether both are of one camera, focal length and size, so that the newer one replaces the older."""
        sizes = (self.width, self.height) == (other.width, other.height)
        return sizes and self.camera == other.camera and _same_focal(self.focal_35mm_mm, other.focal_35mm_mm)


class LensFile(BaseModel):
    """`rig/lens.json`."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    lenses: list[LensRecord] = []


@dataclass(frozen=True)
class LensChoice:
    """The lens of one photograph, upright as its pixels are read.

    Attributes:
        lens: None where it is not known.
        source: `calibrated`, `exif`, or `none`.
        note: for a person: where it comes from, or what to do.
    """

    lens: Lens | None
    source: Literal["calibrated", "exif", "none"]
    note: str


def lens_file(workspace: Workspace) -> Path:
    """Where calibrated lenses are."""
    return workspace.root / "rig" / "lens.json"


def read_lenses(workspace: Workspace) -> list[LensRecord]:
    """The calibrated lenses, none where there is no file.

    Raises:
        ToolkitError: the file is broken.
    """
    file = lens_file(workspace)
    return read_json(file, LensFile).lenses if file.is_file() else []


def write_lenses(workspace: Workspace, records: list[LensRecord]) -> Path:
    """Add lenses to `rig/lens.json`; older ones of the same camera, focal length and size are replaced."""
    kept = [old for old in read_lenses(workspace) if not any(old.same_lens(new) for new in records)]
    made = LensFile(lenses=[*kept, *records])
    return write_json(lens_file(workspace), made.model_dump(mode="json", exclude_none=True))


def lens_for(photo: Photo, workspace: Workspace, sensor_width_mm: float | None = None) -> LensChoice:
    """The lens that a photograph was taken with: a calibrated one, else what EXIF says, else none and why.

    Raises:
        ToolkitError: `rig/lens.json` is broken.
    """
    return choose_lens(photo, read_lenses(workspace), sensor_width_mm)


def choose_lens(photo: Photo, records: list[LensRecord], sensor_width_mm: float | None = None) -> LensChoice:
    """`lens_for` with lenses that were read before, so that many photographs need one reading."""
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
    if photo.focal_35mm_mm is None and len(focals) > 1:
        said = " and ".join(
            f"{focal:g} mm" if focal else "no focal length" for focal in sorted(focals, key=lambda f: f or 0)
        )
        return LensChoice(
            None, "none", f"{photo.camera or 'the camera'} was calibrated at {said}, the photo names none"
        )
    if fitting:
        record = min(fitting, key=lambda record: abs(record.width * record.height - stored[0] * stored[1]))
        lens = record.lens().rotated(turned).scaled(photo.width, photo.height)
        return LensChoice(lens, "calibrated", f"calibrated lens of {record.camera or 'a camera without a name'}")
    from_exif = lens_from_exif(photo, sensor_width_mm)
    why = _why_not_calibrated(photo, records, same_camera, usable)
    if from_exif is not None:
        return LensChoice(from_exif, "exif", f"focal length from EXIF, good to about 2 %; {why}")
    return LensChoice(None, "none", f"no focal length in the photo's EXIF, and {why}")


def turns_upright(path: Path) -> int:
    """Quarter turns clockwise that EXIF asks for to bring stored pixels upright; 0 where it is silent."""
    from PIL import Image

    from toolkit.images import register_heif

    register_heif()
    try:
        with Image.open(path) as image:
            # pillow-heif obeys the orientation itself and keeps here what it was
            orientation = image.info.get("original_orientation") or image.getexif().get(0x0112, 1)
    # a video, a raw photograph, damaged EXIF: nothing is known then, and the pixels are read elsewhere
    except Exception:
        return 0
    return SENSOR_TURNS.get(orientation, 0) if isinstance(orientation, int) else 0


def _why_not_calibrated(photo: Photo, records, same_camera, usable) -> str:
    camera = photo.camera or "a camera without a name"
    if not records:
        return "no lens is calibrated: run 'toolkit calibrate PHOTOS/' with photos of the board"
    if not same_camera:
        return f"no calibrated lens is of {camera}: run 'toolkit calibrate PHOTOS/' with its photos of the board"
    if not usable:
        return (
            f"{camera} was calibrated at another focal length: run 'toolkit calibrate PHOTOS/' with photos at this one"
        )
    return (
        f"{camera} was calibrated with pictures of another shape than {photo.width}x{photo.height}: run "
        "'toolkit calibrate PHOTOS/' with pictures of this one"
    )


def _same_focal(one: float | None, other: float | None) -> bool:
    return one is None or other is None or abs(one / other - 1) < SAME_FOCAL
