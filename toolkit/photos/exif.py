"""What a camera wrote into a photograph, and the JPEG preview inside a raw one (DNG)."""

import contextlib
import math
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import BinaryIO

from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from toolkit.imaging.read import UnreadableImage, explain_damage, open_image

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
        base: Mapping[int, object] = dict(exif)
        details: Mapping[int, object] = dict(exif.get_ifd(EXIF_IFD))
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


def _find_time(base: Mapping[int, object], details: Mapping[int, object]) -> datetime | None:
    # when the shutter opened comes first: a later time is when a scan or an edit was made
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
        # padded on the right: these are the digits after the decimal point, so "5" is half a second
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
    # text is cut at the first zero byte, which ends it in EXIF, and keeps no control signs that a terminal would obey
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


WIDTH, LENGTH, COMPRESSION, PHOTOMETRIC = 256, 257, 259, 262
STRIPS, STRIP_BYTES, SUB_IFDS, JPEG_START, JPEG_BYTES, DNG_VERSION = 273, 279, 330, 513, 514, 50706
JPEG_COMPRESSIONS = (6, 7)
SENSOR_DATA = (32803, 34892)
"""Colour filter array and linear raw: JPEG-compressed, too, but no picture to look at."""
MOST_DIRECTORIES = 64
MOST_BYTES = 256 << 20
JPEG_MAGIC = b"\xff\xd8\xff"
APP1 = b"\xff\xe1"


@dataclass(frozen=True)
class Preview:
    """The largest JPEG in a DNG.

    Attributes:
        offset, length: where it lies in the file, bytes.
        width, height: as stored, before any turn, pixels.
        facts: the DNG's own EXIF; its orientation is the preview's, too.
    """

    offset: int
    length: int
    width: int
    height: int
    facts: ExifFacts


def is_dng(path: Path) -> bool:
    """Whether a file is a DNG by its content: a TIFF whose first directory says which version of DNG it has."""
    try:
        with Path(path).open("rb") as file, _no_warnings():
            return any(DNG_VERSION in directory for directory in _directories(file, 1))
    except Exception:  # damaged TIFF directories raise nearly anything, and are then no DNG
        return False


def find_preview(path: Path) -> Preview:
    """Find the largest JPEG preview (DNG specification 1.7: NewSubFileType 1, in the first directory or a SubIFD).

    Raises:
        UnreadableImage: the file is damaged, or holds no preview.
    """
    path = Path(path)
    try:
        with path.open("rb") as file, _no_warnings():
            found = [one for directory in _directories(file, MOST_DIRECTORIES) if (one := _jpeg_in(directory, file))]
            file.seek(0)
            exif = Image.Exif()
            exif.load_from_fp(file)
            facts = read_exif(exif)
    except Exception as error:  # as in `is_dng`
        raise UnreadableImage(path, explain_damage(error)) from None
    if not found:
        raise UnreadableImage(path, "a DNG without a JPEG preview: export it from your raw converter as JPEG or TIFF")
    # a DNG may hold a thumbnail beside the full preview
    offset, length, width, height = max(found, key=lambda one: one[2] * one[3])
    return Preview(offset, length, width, height, facts)


def read_preview(path: Path) -> bytes:
    """The preview as a JPEG file: its bytes as the camera wrote them, with the DNG's EXIF where it has none itself.

    Raises:
        UnreadableImage: as `find_preview`.
    """
    preview = find_preview(path)
    with Path(path).open("rb") as file:
        file.seek(preview.offset)
        content = file.read(preview.length)
    if b"Exif\0\0" in content[:64]:
        return content
    block = write_exif(preview.facts)
    # a JPEG's segments follow its two bytes of start, and a segment's length counts its own two bytes
    return content[:2] + APP1 + (len(block) + 2).to_bytes(2, "big") + block + content[2:]


@contextlib.contextmanager
def _no_warnings() -> Iterator[None]:
    """Pillow warns of damaged directories; what comes of them is said by the errors here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _directories(file: BinaryIO, most: int) -> Iterator[ImageFileDirectory_v2]:
    """TIFF directories: the chain of main ones and their SubIFDs, each once, `most` in all."""
    head = file.read(8)
    if head[:4] not in (b"II*\0", b"MM\0*"):
        raise ValueError("no TIFF header")
    waiting = [ImageFileDirectory_v2(head).next]
    seen: set[int] = set()
    while waiting and len(seen) < most:
        offset = waiting.pop(0)
        # a damaged chain may point back to itself
        if not offset or offset in seen:
            continue
        seen.add(offset)
        file.seek(offset)
        directory = ImageFileDirectory_v2(head)
        with contextlib.suppress(Exception):  # a damaged directory hides itself, not those before and after it
            directory.load(file)
        yield directory
        waiting += [directory.next, *_numbers(directory.get(SUB_IFDS))[:MOST_DIRECTORIES]]


def _jpeg_in(directory: ImageFileDirectory_v2, file: BinaryIO) -> tuple[int, int, int, int] | None:
    """(offset, length, width, height) of a directory's picture, if it is one JPEG that can be looked at."""
    if directory.get(PHOTOMETRIC) in SENSOR_DATA or directory.get(COMPRESSION) not in JPEG_COMPRESSIONS:
        return None
    offsets = _numbers(directory.get(JPEG_START)) or _numbers(directory.get(STRIPS))
    lengths = _numbers(directory.get(JPEG_BYTES)) or _numbers(directory.get(STRIP_BYTES))
    # a picture in several strips is several JPEGs, none of them whole
    if len(offsets) != 1 or len(lengths) != 1 or not 0 < lengths[0] <= MOST_BYTES:
        return None
    file.seek(offsets[0])
    content = file.read(lengths[0])
    if len(content) < lengths[0] or not content.startswith(JPEG_MAGIC):
        return None
    try:
        with open_image(Path("preview"), content) as picture:
            return offsets[0], lengths[0], picture.width, picture.height
    except (OSError, ValueError, SyntaxError, UnreadableImage, Image.DecompressionBombError):
        return None


def _numbers(value: object) -> list[int]:
    values = value if isinstance(value, tuple) else (value,)
    return [one for one in values if isinstance(one, int) and one > 0]
