"""Take a photograph in from the network: in blocks to a temporary file, never more than allowed, checked by content."""

from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np

from toolkit.captures.photos.photo import Photo, load_pixels, read_photo
from toolkit.errors import ToolkitError
from toolkit.files import explain_write_error
from toolkit.images import UnreadableImage
from toolkit.studio.errors import Refused
from toolkit.studio.places import Places

MOST_BYTES = 40 << 20
"""A phone's largest JPEG or HEIC is half of it."""
KINDS = ("jpeg", "heif", "avif", "png", "webp", "tiff")
HTTP_FULL, HTTP_TOO_LARGE, HTTP_NO_PHOTO = 507, 413, 415


async def receive_file(blocks: AsyncIterator[bytes], places: Places, announced: int | None, limit: int) -> Path:
    """Write an upload to a new file of the incoming folder; what breaks off leaves nothing behind.

    Args:
        blocks: of the request's body.
        places: of the workspace.
        announced: its Content-Length, None where it has none; a wrong one is not believed.
        limit: most bytes.

    Raises:
        Refused: larger than the limit (413), empty (415), or the disk is full (507).
    """
    if announced is not None and announced > limit:
        raise _too_large(limit)
    file = places.new_incoming()
    size = 0
    try:
        with file.open("xb") as stream:
            async for block in blocks:
                size += len(block)
                if size > limit:
                    raise _too_large(limit)
                stream.write(block)
    except BaseException as error:  # also a phone that went away, and a server that is stopped
        file.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise Refused(HTTP_FULL, str(explain_write_error(file.parent, error))) from error
        raise
    if size == 0:
        file.unlink(missing_ok=True)
        raise Refused(HTTP_NO_PHOTO, "nothing arrived: the file is empty")
    return file


def open_upload(file: Path) -> tuple[Photo, np.ndarray]:
    """Describe and decode an upload by its content alone.

    Returns:
        The photograph, and its pixels (h, w, 3) uint8.

    Raises:
        Refused: it is no photograph, a damaged one, or of a kind that a page cannot take.
    """
    try:
        photo = read_photo(file)
        if photo.kind not in KINDS:
            raise Refused(HTTP_NO_PHOTO, _explain_kind(photo.kind))
        return photo, load_pixels(photo)
    except UnreadableImage as error:
        raise Refused(HTTP_NO_PHOTO, f"this is no photograph that can be read: {error.reason}") from None
    except Refused:
        raise
    except ToolkitError as error:
        raise Refused(HTTP_NO_PHOTO, str(error)) from None


def _explain_kind(kind: str) -> str:
    if kind == "video":
        return "this is a video: take a photograph, or bring videos in with 'toolkit import'"
    if kind == "dng":
        return "this is a raw photograph: set the camera to JPEG or HEIC, or bring it in with 'toolkit import'"
    return f"this is a {kind.upper()} picture: expected a photograph as JPEG, HEIC, AVIF, PNG, WebP or TIFF"


def _too_large(limit: int) -> Refused:
    return Refused(HTTP_TOO_LARGE, f"the file is larger than {limit >> 20} MB: set the camera to JPEG or HEIC")
