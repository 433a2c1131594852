"""What a camera wrote into a photograph: when, with which camera, at which focal length, which way up."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

from PIL import Image

EXIF_IFD = 0x8769
MAKE, MODEL, ORIENTATION, CHANGED = 0x010F, 0x0110, 0x0112, 0x0132
TAKEN, DIGITISED = 0x9003, 0x9004
SUBSECONDS = {TAKEN: 0x9291, DIGITISED: 0x9292, CHANGED: 0x9290}
OFFSETS = {TAKEN: 0x9011, DIGITISED: 0x9012, CHANGED: 0x9010}
FOCAL, FOCAL_35MM = 0x920A, 0xA405
LONGEST_TEXT = 80
LONGEST_FOCAL_MM = 5000.0


@dataclass(frozen=True)
class ExifFacts:
    """The part of EXIF that matters here; what is missing or makes no sense is None.

    Attributes:
        taken: when the shutter opened, with the camera's offset from UTC where it wrote one.
        camera: maker and model.
        focal_mm: true focal length.
        focal_35mm_mm: of a 35 mm camera with the same angle of view.
        orientation: 1 to 8, how the stored pixels lie.
    """

    taken: datetime | None = None
    camera: str | None = None
    focal_mm: float | None = None
    focal_35mm_mm: float | None = None
    orientation: int = 1


def read_exif(exif: Image.Exif) -> ExifFacts:
    """The facts in a photograph's EXIF; damaged EXIF says nothing and is no error."""
    try:
        base: Mapping = dict(exif)
        details: Mapping = dict(exif.get_ifd(EXIF_IFD))
    # the block may hold anything, and Pillow's reader raises struct, key, type and value errors on it
    except Exception:
        return ExifFacts()
    orientation = base.get(ORIENTATION)
    return ExifFacts(
        taken=_find_time(base, details),
        camera=_name_camera(_text(base.get(MAKE)), _text(base.get(MODEL))),
        focal_mm=_length(details.get(FOCAL)),
        focal_35mm_mm=_length(details.get(FOCAL_35MM)),
        orientation=orientation if isinstance(orientation, int) and 1 <= orientation <= 8 else 1,
    )


def write_exif(facts: ExifFacts) -> bytes:
    """The same facts as an EXIF block, as Pillow's writers take it."""
    exif = Image.Exif()
    exif[ORIENTATION] = facts.orientation
    if facts.camera:
        exif[MODEL] = facts.camera
    details = exif.get_ifd(EXIF_IFD)
    if facts.taken is not None:
        details[TAKEN] = facts.taken.strftime("%Y:%m:%d %H:%M:%S")
        details[SUBSECONDS[TAKEN]] = f"{facts.taken.microsecond:06d}"
        if offset := facts.taken.strftime("%z"):
            details[OFFSETS[TAKEN]] = f"{offset[:3]}:{offset[3:5]}"
    if facts.focal_mm:
        details[FOCAL] = facts.focal_mm
    if facts.focal_35mm_mm:
        details[FOCAL_35MM] = round(facts.focal_35mm_mm)
    if details:
        exif[EXIF_IFD] = dict(details)  # Pillow writes a sub-directory that stands here
    return exif.tobytes()


def _find_time(base: Mapping, details: Mapping) -> datetime | None:
    for tag, value in ((TAKEN, details.get(TAKEN)), (DIGITISED, details.get(DIGITISED)), (CHANGED, base.get(CHANGED))):
        if taken := _parse_time(_text(value), _text(details.get(SUBSECONDS[tag])), _text(details.get(OFFSETS[tag]))):
            return taken
    return None


def _parse_time(text: str | None, subseconds: str | None, offset: str | None) -> datetime | None:
    match = re.match(r"(\d{4})[:-](\d\d)[:-](\d\d)[ T](\d\d):(\d\d):(\d\d)", text or "", re.ASCII)
    if match is None:
        return None
    try:
        taken = datetime(*map(int, match.groups()))  # type: ignore[arg-type, misc]
    except ValueError:  # cameras with an unset clock write 0000:00:00
        return None
    if subseconds and subseconds.isdecimal() and subseconds.isascii():
        taken = taken.replace(microsecond=int(subseconds[:6].ljust(6, "0")))
    zone = re.fullmatch(r"([+-])(\d\d):(\d\d)", offset or "", re.ASCII)
    if zone and (minutes := int(zone[2]) * 60 + int(zone[3])) < 24 * 60:
        taken = taken.replace(tzinfo=timezone(timedelta(minutes=minutes if zone[1] == "+" else -minutes)))
    return taken


def _text(value: object) -> str | None:
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    if not isinstance(value, str):
        return None
    clean = "".join(sign for sign in value.split("\0")[0] if sign.isprintable()).strip()
    return clean[:LONGEST_TEXT] or None


def _name_camera(make: str | None, model: str | None) -> str | None:
    """Maker and model, without the maker twice ("Canon", "Canon EOS R5")."""
    if make and model and model.lower().startswith(make.lower().split()[0]):
        return model
    return " ".join(part for part in (make, model) if part) or None


def _length(value: object) -> float | None:
    try:
        length = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return length if math.isfinite(length) and 0 < length < LONGEST_FOCAL_MM else None
