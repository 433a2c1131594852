"""Photographs as a camera leaves them: found in a folder, described without decoding, decoded upright."""

import contextlib
import re
import warnings
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.text import escape
from toolkit.imaging.read import (
    UnreadableImage,
    decode_image,
    explain_damage,
    find_files,
    is_image_name,
    open_image,
    read_image,
    show_path,
)
from toolkit.photos import video
from toolkit.photos.exif import ExifFacts, is_dng, read_exif, read_preview

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
"""Limit on one photograph's file: the largest raw files are half of it."""
QUARTER_TURNED = (5, 6, 7, 8)
TIFF_WIDTH, TIFF_HEIGHT = 256, 257


@dataclass(frozen=True)
class Photo:
    """What is known of one photograph without decoding it.

    Attributes:
        path: the file.
        sha256: of the file.
        kind: by content: jpeg, heif, avif, png, tiff, webp, bmp, gif, dng or video.
        width, height: pixels, upright.
        taken: when, with the offset from UTC where the camera wrote one; None where it did not say.
        camera: maker and model, or None.
        focal_mm, focal_35mm_mm: true and 35 mm-equivalent focal length, or None.
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
        """The file's name, and the frame where it is one of a video, as text that can be printed on one line."""
        shown = show_name(self.path.name)
        return shown if self.frame is None else f"{shown} frame {self.frame}"


@dataclass(frozen=True)
class FoundPhotos:
    """What a folder of photographs holds.

    Attributes:
        photos: files that are photographs or videos by name, sorted by name with numbers in their order.
        refused: (path, reason) of links that lead out of the folder.
        others: names of files that are neither.
    """

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


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sorts names as people do: IMG_9 before IMG_10."""
    parts = re.split(r"([0-9]+)", name.lower())
    return [(0, int(part), "") if part.isascii() and part.isdecimal() else (1, 0, part) for part in parts if part]


def show_name(name: str) -> str:
    """A file name on one line: what cannot be printed, such as a line's end, is written as an escape."""
    return escape(show_path((name,)))


def read_photo(path: Path, frame: int | None = None) -> Photo:
    """Describe a photograph, or one frame of a video; its pixels are not decoded.

    The kind goes by the content, whatever the name says.

    Raises:
        UnreadableImage: the file is missing, empty, no photograph or video, or far too large.
    """
    path = Path(path)
    check_file(path)
    if video.is_video(path):
        facts = video.read_video(path)
        taken = None if frame is None else facts.taken_at(frame)
        return Photo(path, sha256_file(path), "video", facts.width, facts.height, taken=taken, frame=frame)
    if path.stat().st_size > MOST_BYTES:
        raise UnreadableImage(path, f"more than {MOST_BYTES >> 20} MB: no photograph, or scale it down")
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
    """Check that a file is there, is a plain one and holds something, before anything opens it.

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
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's on damaged EXIF, which is no news to the photographer
            with open_image(path, content) as image:
                facts = read_exif(image.getexif())
                kind, size = KINDS.get(image.format or ""), image.size
                if kind == "tiff":
                    # some versions of Pillow turn a TIFF's size, some do not: the tags do not change
                    with contextlib.suppress(AttributeError, KeyError):
                        size = (image.tag_v2[TIFF_WIDTH], image.tag_v2[TIFF_HEIGHT])  # type: ignore[attr-defined]
    except UnreadableImage:
        raise
    except Exception as error:  # decoders raise nearly every built-in exception on hostile files
        raise UnreadableImage(path, explain_damage(error)) from None
    if kind is None:
        raise UnreadableImage(path, "this kind of photograph cannot be read here: export it as JPEG, PNG or TIFF")
    width, height = size[::-1] if facts.orientation in QUARTER_TURNED else size
    return width, height, kind, facts
