"""Receive a photograph from the network, check its content, and hold it until somebody accepts it."""

import asyncio
import secrets
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from threading import Lock

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import delete_file, inside, make_folder, move_file, open_whole, write_bytes
from toolkit.imaging.read import UnreadableImage
from toolkit.rooms.photos.photo import SUFFIXES, Photo, load_pixels, read_photo
from toolkit.rooms.photos.shot_order import ShotStep


class Refused(ToolkitError):
    """A refused request, with a line that says why and an HTTP `status`.

    404: no such shot. 408: it stopped coming. 409: the page is out of date. 413: too large. 415: no photograph.
    """

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


FOLDER = ".studio"
HASH_DIGITS = 32
"""Number of digits of a photograph's SHA-256 in its file name; 128 bits."""
PART = ".part"


@dataclass(frozen=True)
class UploadFolders:
    """Folders of a workspace's studio."""

    root: Path

    @property
    def incoming_dir(self) -> Path:
        """Uploads that are not whole yet."""
        return inside(self.root, f"{FOLDER}/incoming")

    def waiting_dir(self, step: ShotStep) -> Path:
        """Folder of the waiting photograph of a shot."""
        return self._place("waiting", step)

    def skip_mark(self, step: ShotStep) -> Path:
        """An empty file for a skipped shot."""
        return self._place("skipped", step)

    def _place(self, what: str, step: ShotStep) -> Path:
        return inside(self.root, f"{FOLDER}/{what}/{step.object}/{step.variant}/pose_{step.pose_id:02d}")

    def new_incoming(self) -> Path:
        """Return a name for the next upload; a `ToolkitError` if its folder cannot be made."""
        # a random name: nothing from the network becomes a path
        return make_folder(self.incoming_dir, self.root) / f"{secrets.token_hex(16)}{PART}"

    def find_waiting(self, step: ShotStep) -> Path | None:
        """The waiting photograph of a shot, if any."""
        return max(self._list_waiting(step), default=None)  # the names begin with the time

    def put_waiting(self, step: ShotStep, upload: Path, photo: Photo) -> Path:
        """Move an upload to its shot, and delete the upload that waited there before."""
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S-%f")
        file = self.waiting_dir(step) / f"{stamp}-{photo.sha256[:HASH_DIGITS]}{SUFFIXES[photo.kind]}"
        # listed before the move: the new upload is not among those deleted
        old = list(self._list_waiting(step))
        move_file(upload, file, self.root)
        for earlier in old:
            delete_file(earlier)
        return file

    def drop_waiting(self, step: ShotStep) -> None:
        """Delete the waiting photograph of a shot."""
        for waiting in list(self._list_waiting(step)):
            delete_file(waiting)

    def set_skipped(self, step: ShotStep, skipped: bool) -> None:
        """Put a shot off, or call it back."""
        mark = self.skip_mark(step)
        if skipped:
            write_bytes(mark, b"", self.root)
        else:
            delete_file(mark)

    def sweep(self) -> None:
        """Delete uploads that a stopped server never finished."""
        if self.incoming_dir.is_dir():
            for file in self.incoming_dir.iterdir():
                delete_file(file)

    def _list_waiting(self, step: ShotStep) -> Iterator[Path]:
        folder = self.waiting_dir(step)
        if folder.is_dir():
            yield from (file for file in folder.iterdir() if file.is_file() and not file.name.startswith("."))


def hash_in_name(file: Path) -> str:
    """The first digits of a waiting photograph's SHA-256."""
    return file.stem.rpartition("-")[2]


def check_writable(folders: UploadFolders) -> None:
    """Raise `ToolkitError` if no upload could be written, before anybody takes a photograph."""
    delete_file(write_bytes(folders.new_incoming(), b"", folders.root))


MOST_BYTES = 40 << 20
"""A phone's largest JPEG or HEIC is half of it."""
KINDS = ("jpeg", "heif", "avif", "png", "webp", "tiff")
HTTP_LATE, HTTP_TOO_LARGE, HTTP_NO_PHOTO = 408, 413, 415
BLOCK_S = 30.0
MOST_MEGAPIXELS = 64
"""Decoding takes up to 18 bytes a pixel, 1.2 GB; a phone's 50 megapixels are within."""
_decoding = Lock()  # uploads are decoded in turn, however many phones send at once
LEAST_SIDE_PX, MOST_ASPECT = 32, 20
"""Smallest side and longest shape of a picture that could be measured."""


async def receive_file(blocks: AsyncIterator[bytes], folders: UploadFolders, announced: int | None, limit: int) -> Path:
    """Write an upload to a new file of the incoming folder; an upload that breaks off leaves nothing.

    Args:
        blocks: of the request's body.
        folders: of the workspace.
        announced: its Content-Length, which may be wrong, or None.
        limit: most bytes.

    Raises:
        Refused: larger than the limit (413), empty (415), or the disk is full (507).
    """
    if announced is not None and announced > limit:
        raise _too_large(limit)
    file = folders.new_incoming()
    size = 0
    with open_whole(file, folders.root) as stream:  # gone when a phone goes away, or the server is stopped
        async for block in _in_time(blocks):
            size += len(block)
            # counted on arrival: the announced length may be wrong
            if size > limit:
                raise _too_large(limit)
            stream.write(block)
        if size == 0:
            raise Refused(HTTP_NO_PHOTO, "nothing arrived: the file is empty")
    return file


async def _in_time(blocks: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """The blocks, each of which must come within `BLOCK_S`."""
    while True:
        try:
            yield await asyncio.wait_for(anext(blocks), BLOCK_S)
        except StopAsyncIteration:
            return
        except asyncio.TimeoutError:
            late = f"no more data of the photograph came for {BLOCK_S:.0f} s: send it again"
            raise Refused(HTTP_LATE, late) from None


def open_upload(file: Path) -> tuple[Photo, np.ndarray]:
    """Describe and decode an upload by its content alone; also returns its pixels (h, w, 3) uint8.

    Raises:
        Refused: it is no photograph, damaged, or of an unsuitable kind.
    """
    try:
        # described before it is decoded: a huge picture is refused before it takes memory
        photo = read_photo(file)
        if photo.kind not in KINDS:
            raise Refused(HTTP_NO_PHOTO, _explain_kind(photo.kind))
        # sides, aspect and size are in the header
        short, long = sorted((photo.width, photo.height))
        if short < LEAST_SIDE_PX or long > MOST_ASPECT * short:
            size = f"{photo.width}×{photo.height} px"
            raise Refused(HTTP_NO_PHOTO, f"a picture of {size} is too small to be measured: take another")
        megapixels = photo.width * photo.height / 1e6
        if megapixels > MOST_MEGAPIXELS:
            why = f"the photograph has {megapixels:.0f} megapixels: set the camera to {MOST_MEGAPIXELS} or fewer"
            raise Refused(HTTP_TOO_LARGE, why)
        with _decoding:
            return photo, load_pixels(photo)
    except UnreadableImage as error:
        raise Refused(HTTP_NO_PHOTO, f"this photograph cannot be read: {error.reason}") from None
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
