"""The JPEG preview inside a raw photograph (DNG), found through the TIFF directories that hold it."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from toolkit.captures.photos.exif import ExifFacts, read_exif, write_exif
from toolkit.images import UnreadableImage, explain_damage

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
    if len(offsets) != 1 or len(lengths) != 1 or not 0 < lengths[0] <= MOST_BYTES:
        return None
    file.seek(offsets[0])
    content = file.read(lengths[0])
    if len(content) < lengths[0] or not content.startswith(JPEG_MAGIC):
        return None
    try:
        with Image.open(io.BytesIO(content), formats=("JPEG",)) as picture:
            return offsets[0], lengths[0], picture.width, picture.height
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None


def _numbers(value: object) -> list[int]:
    values = value if isinstance(value, tuple) else (value,)
    return [one for one in values if isinstance(one, int) and one > 0]
