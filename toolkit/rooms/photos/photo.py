"""Photographs as a camera leaves them: found in a folder, described by what is written into them, decoded upright."""

import contextlib
import math
import re
import unicodedata
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path, PurePosixPath
from typing import BinaryIO

import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.text import escape
from toolkit.imaging.read import (
    UnreadableImage,
    decode_image,
    decoding,
    explain_damage,
    find_files,
    is_image_name,
    open_image,
    read_image,
    show_path,
)
from toolkit.rooms.photos import video

EXIF_IFD = 0x8769
MAKE, MODEL, ORIENTATION, CHANGED = 0x010F, 0x0110, 0x0112, 0x0132
TAKEN, DIGITISED = 0x9003, 0x9004
SUBSECONDS = {TAKEN: 0x9291, DIGITISED: 0x9292, CHANGED: 0x9290}
OFFSETS = {TAKEN: 0x9011, DIGITISED: 0x9012, CHANGED: 0x9010}
FOCAL, FOCAL_35MM = 0x920A, 0xA405
LONGEST_TEXT = 80
LONGEST_FOCAL_MM = 5000.0
WIDTH, LENGTH, COMPRESSION, PHOTOMETRIC = 256, 257, 259, 262
STRIPS, STRIP_BYTES, SUB_IFDS, JPEG_START, JPEG_BYTES, DNG_VERSION = 273, 279, 330, 513, 514, 50706
JPEG_COMPRESSIONS = (6, 7)
SENSOR_DATA = (32803, 34892)
"""Colour filter array and linear raw: JPEG-compressed as well, but not a picture to look at."""
MOST_DIRECTORIES = 64
MOST_EMBEDDED_BYTES = 256 << 20
JPEG_MAGIC = b"\xff\xd8\xff"
APP1 = b"\xff\xe1"
KINDS = {
    "JPEG": "jpeg", "MPO": "jpeg", "HEIF": "heif", "AVIF": "avif", "PNG": "png", "TIFF": "tiff", "WEBP": "webp",
    "BMP": "bmp", "GIF": "gif",
}  # fmt: skip
SUFFIXES = {
    "jpeg": ".jpg", "heif": ".heic", "avif": ".avif", "png": ".png", "tiff": ".tif", "webp": ".webp", "bmp": ".bmp",
    "gif": ".gif", "dng": ".jpg", "video": ".jpg",
}  # fmt: skip
"""The suffix of a photograph of each kind in a capture folder; what has no viewer there is kept as JPEG."""
RAW_SUFFIX = ".dng"
MOST_BYTES = 512 << 20
"""Limit on a photograph's file: the largest raw files are half of it."""
QUARTER_TURNED = (5, 6, 7, 8)


@dataclass(frozen=True)
class ExifFacts:
    """The part of EXIF that matters here; what is missing or makes no sense is None.

    Attributes:
        taken: when the shutter opened, with the camera's offset from UTC if the camera wrote it.
        camera: maker and model.
        focal_35mm_mm: focal length of a 35 mm camera with the same angle of view.
        orientation: 1 to 8, as EXIF numbers it.
    """

    taken: datetime | None = None
    camera: str | None = None
    focal_mm: float | None = None
    focal_35mm_mm: float | None = None
    orientation: int = 1


def read_exif(exif: Image.Exif) -> ExifFacts:
    """Read the facts in a photograph's EXIF; damaged EXIF has none and is no error."""
    try:
        with decoding(Path("EXIF")):
            base: Mapping[int, object] = dict(exif)
            details: Mapping[int, object] = dict(exif.get_ifd(EXIF_IFD))
    except UnreadableImage:
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
    # time and focal lengths stand in a sub-directory
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
    # without a zone the time is that of the camera's clock
    zone = re.fullmatch(r"([+-])(\d\d):(\d\d)", offset or "", re.ASCII)
    if zone and (minutes := int(zone[2]) * 60 + int(zone[3])) < 24 * 60:
        taken = taken.replace(tzinfo=timezone(timedelta(minutes=minutes if zone[1] == "+" else -minutes)))
    return taken


def align_times(times: Sequence[datetime]) -> list[datetime]:
    """Return times that can be compared: in UTC if all have an offset, else by the camera's wall clock."""
    # offsets tell apart the hour that comes twice when summer time ends
    zoned = all(taken.tzinfo is not None for taken in times)
    return [taken.astimezone(timezone.utc) if zoned else taken.replace(tzinfo=None) for taken in times]


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


@dataclass(frozen=True)
class Preview:
    """The largest JPEG in a DNG.

    Attributes:
        offset, length: in the file, bytes.
        width, height: as stored, before any turn, pixels.
        facts: the DNG's own EXIF, which also has the preview's orientation.
    """

    offset: int
    length: int
    width: int
    height: int
    facts: ExifFacts


def is_dng(path: Path) -> bool:
    """Whether a file is a DNG by its content: a TIFF whose first directory has a version of DNG."""
    try:
        with decoding(path), Path(path).open("rb") as file, _no_warnings():
            return any(DNG_VERSION in directory for directory in _directories(file, 1))
    except UnreadableImage:
        return False


def find_preview(path: Path) -> Preview:
    """Find the largest JPEG preview (DNG specification 1.7: NewSubFileType 1, in the first directory or a SubIFD).

    Raises:
        UnreadableImage: the file is damaged, or holds no preview.
    """
    path = Path(path)
    with decoding(path), path.open("rb") as file, _no_warnings():
        # every directory may hold a preview
        found = [
            preview for directory in _directories(file, MOST_DIRECTORIES) if (preview := _jpeg_in(directory, file))
        ]
        file.seek(0)
        exif = Image.Exif()
        exif.load_from_fp(file)
        facts = read_exif(exif)
    if not found:
        raise UnreadableImage(path, "a DNG without a JPEG preview: export it from your raw converter as JPEG or TIFF")
    # a DNG may hold a thumbnail beside the full preview
    offset, length, width, height = max(found, key=lambda preview: preview[2] * preview[3])
    return Preview(offset, length, width, height, facts)


def read_preview(path: Path) -> bytes:
    """Return the preview as a JPEG file, with the DNG's EXIF if it has none itself; raises as `find_preview`."""
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
    """Silence Pillow's warnings of damaged directories; the errors here name the damage that matters."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _directories(file: BinaryIO, most: int) -> Iterator[ImageFileDirectory_v2]:
    """TIFF directories: the chain of main directories and their SubIFDs, each once, `most` in all."""
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
    """(offset, length, width, height) of a directory's picture, if it is a single JPEG that can be viewed."""
    if directory.get(PHOTOMETRIC) in SENSOR_DATA or directory.get(COMPRESSION) not in JPEG_COMPRESSIONS:
        return None
    # an old-style JPEG has separate tags, a newer JPEG is a strip
    offsets = _numbers(directory.get(JPEG_START)) or _numbers(directory.get(STRIPS))
    lengths = _numbers(directory.get(JPEG_BYTES)) or _numbers(directory.get(STRIP_BYTES))
    # a picture in several strips is several JPEGs, none of them whole
    if len(offsets) != 1 or len(lengths) != 1 or not 0 < lengths[0] <= MOST_EMBEDDED_BYTES:
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
    return [value for value in values if isinstance(value, int) and value > 0]


@dataclass(frozen=True)
class Photo:
    """Facts of a photograph that need no decoding; the others are as in `ExifFacts`.

    Attributes:
        sha256: of the file.
        kind: by content: jpeg, heif, avif, png, tiff, webp, bmp, gif, dng or video.
        width, height: pixels, upright.
        frame: number of a video's frame, from 0; None for a photograph.
    """

    path: Path
    sha256: str
    kind: str
    width: int
    height: int
    taken: datetime | None = None
    camera: str | None = None
    focal_mm: float | None = None
    focal_35mm_mm: float | None = None
    frame: int | None = None

    @property
    def identity(self) -> tuple[str, int | None]:
        """The same for the same picture: the file's hash, and the frame."""
        return self.sha256, self.frame

    @property
    def name(self) -> str:
        """The file's name, and the frame number for a video, as text that can be printed on a line."""
        shown = show_name(self.path.name)
        return shown if self.frame is None else f"{shown} frame {self.frame}"


@dataclass(frozen=True)
class FoundPhotos:
    """Photographs and videos of a folder by name, (path, reason) of links out of it, and other files' names."""

    photos: tuple[Path, ...]
    refused: tuple[tuple[str, str], ...]
    others: tuple[str, ...]


def is_photo_name(name: str) -> bool:
    """Whether a file is a photograph, a raw photograph or a video by its suffix."""
    return is_image_name(name) or Path(name).suffix.lower() in (RAW_SUFFIX, *video.VIDEO_SUFFIXES)


def list_photos(folder: Path) -> FoundPhotos:
    """The photographs and videos in a folder and those below it.

    Raises:
        ToolkitError: the folder does not exist, is a file, or may not be read.
    """
    folder = Path(folder)
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "does not exist"
        raise ToolkitError(f"{folder} {what}: expected a folder of photographs")
    found = find_files(folder, is_photo_name)
    paths = sorted(found.images, key=lambda parts: [natural_key(part) for part in parts])
    return FoundPhotos(tuple(folder / Path(*parts) for parts in paths), found.refused, found.others)


Numbered = list[tuple[int, int, str]]
SortKey = tuple[Numbered, Numbered, Numbered]
COPY_TAIL = re.compile(r"(?:( - copy| copy)(?: ?\((\d{1,4})\)| (\d{1,4}))?| ?\((\d{1,4})\)|~(\d{1,4}))$")
"""End of a copy's name, as in `IMG (1)`, `IMG~2`, `IMG copy 2` and `IMG - Copy (2)`."""


def split_copy(stem: str) -> tuple[str, str]:
    """Split a file's stem, in lower case, from the end of a copy's name: `img_1` and ` (2)`."""
    plain = unicodedata.normalize("NFC", stem).lower()
    found = COPY_TAIL.search(plain)
    return (plain[: found.start()], plain[found.start() :]) if found and found.start() else (plain, "")


def natural_key(name: str) -> SortKey:
    """Sorts names as people do: IMG_9 before IMG_10, and IMG_9 before IMG_9 (1)."""
    path = PurePosixPath(name)
    base, tail = split_copy(path.stem)
    return _split_numbers(base), _split_numbers(tail), _split_numbers(path.suffix.lower())


def _split_numbers(text: str) -> Numbered:
    parts = re.split(r"([0-9]+)", text)
    return [(0, int(part), "") if part.isascii() and part.isdecimal() else (1, 0, part) for part in parts if part]


def show_name(name: str) -> str:
    """Return a file name on a line, as text is typed (NFC); what cannot be printed becomes an escape."""
    return escape(unicodedata.normalize("NFC", show_path((name,))))


def read_photo(path: Path) -> Photo:
    """Describe a photograph, or a video; its pixels are not decoded.

    The kind goes by the content, whatever the name says.

    Raises:
        UnreadableImage: the file is missing, empty, no photograph or video, or far too large.
    """
    path = Path(path)
    check_file(path)
    if video.is_video(path):
        facts = video.read_video(path)
        return Photo(path, sha256_file(path), "video", facts.width, facts.height)
    if path.stat().st_size > MOST_BYTES:
        raise UnreadableImage(path, f"more than {MOST_BYTES >> 20} MB: no photograph, or scale it down")
    # of a raw photograph the preview is described
    raw = is_dng(path)
    width, height, kind, facts_ = _open_header(path, read_preview(path) if raw else None)
    return Photo(
        path, sha256_file(path), "dng" if raw else kind, width, height,
        taken=facts_.taken, camera=facts_.camera, focal_mm=facts_.focal_mm, focal_35mm_mm=facts_.focal_35mm_mm,
    )  # fmt: skip


def load_pixels(photo: Photo) -> np.ndarray:
    """Decode a photograph to (h, w, 3) uint8, sRGB-encoded, upright; of a DNG its preview.

    Raises:
        UnreadableImage: the file is gone, truncated, or otherwise does not decode.
    """
    if photo.kind == "video":
        return video.load_frame(photo.path, photo.frame or 0)
    if photo.kind == "dng":
        return decode_image(read_preview(photo.path), photo.path)
    return read_image(photo.path)


def check_file(path: Path) -> None:
    """Check that a plain file exists and is not empty, before anything opens it.

    Raises:
        UnreadableImage: says which of these it is not.
    """
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise UnreadableImage(path, "not a plain file" if path.exists() else "no such file")
        if path.stat().st_size == 0:
            raise UnreadableImage(path, "the file is empty")
    except (OSError, ValueError) as error:
        raise UnreadableImage(path, explain_damage(error)) from None


def _open_header(path: Path, content: bytes | None) -> tuple[int, int, str, ExifFacts]:
    """Upright width and height, kind and EXIF."""
    with _no_warnings(), open_image(path, content) as image:
        facts = read_exif(image.getexif())
        kind, size = KINDS.get(image.format or ""), image.size
        if kind == "tiff":
            # some versions of Pillow turn a TIFF's size, some do not: the tags do not change
            with contextlib.suppress(AttributeError, KeyError):
                size = (image.tag_v2[WIDTH], image.tag_v2[LENGTH])  # type: ignore[attr-defined]
    if kind is None:
        raise UnreadableImage(path, "this kind of photograph cannot be read here: export it as JPEG, PNG or TIFF")
    width, height = size[::-1] if facts.orientation in QUARTER_TURNED else size
    return width, height, kind, facts
