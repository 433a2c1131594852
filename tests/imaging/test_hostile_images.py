"""Pictures made to fill the memory, or to be waited for: refused before their pixels are decoded."""

import io
import os
import struct
import zlib

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.imaging.read import UnreadableImage, decode_frame, decode_image, read_image
from toolkit.objects.records import decode_png
from toolkit.rooms.photos.photo import read_photo


def claim_png(width, height):
    """A PNG of a few bytes that says it is so large."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 99)) + chunk(b"IEND", b"")
    )


READERS = {
    "photograph": lambda file: read_image(file),
    "bytes": lambda file: decode_image(file.read_bytes(), file),
    "patch or texture": lambda file: decode_png(file.read_bytes(), file),
    "frame": lambda file: decode_frame(file.read_bytes(), file),
    "upload": lambda file: read_photo(file),
}


@pytest.mark.parametrize("size", [(14_000, 14_000), (100_000, 100_000), (1, 70_000), (70_000, 1)])
@pytest.mark.parametrize("reader", READERS)
def test_one_cap_holds_for_every_picture(tmp_path, reader, size):
    file = tmp_path / "a.png"
    file.write_bytes(claim_png(*size))
    with pytest.raises(ToolkitError, match=r"decompression bomb|no photograph's"):
        READERS[reader](file)


@pytest.mark.parametrize("reader", ["photograph", "upload"])
def test_a_pipe_is_not_waited_for(tmp_path, reader):
    os.mkfifo(tmp_path / "a.png")
    with pytest.raises(UnreadableImage, match=r"a pipe or a device|not a plain file"):
        READERS[reader](tmp_path / "a.png")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(UnreadableImage, match=r"it is a folder|not a plain file"):
        READERS[reader](tmp_path / "folder.png")


def test_a_picture_that_is_damaged_anywhere_is_one_line(tmp_path):
    from PIL import Image

    buffer = io.BytesIO()
    Image.effect_noise((40, 30), 50).convert("RGB").save(buffer, "PNG")
    whole = buffer.getvalue()
    for at in range(0, len(whole), 7):
        content = whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :]
        try:
            decode_png(content, tmp_path / "a.png")
        except ToolkitError as error:
            assert "\n" not in str(error)
