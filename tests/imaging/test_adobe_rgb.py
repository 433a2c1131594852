"""Adobe RGB that the EXIF alone tells of, against littleCMS with a profile of that space."""

import io
import struct

import numpy as np
import pytest
from PIL import ExifTags, Image, ImageCms

from toolkit.imaging.colour import adobe_to_srgb
from toolkit.imaging.read import decode_image

COLOURS = np.array(
    [[[255, 0, 0], [0, 255, 0], [0, 0, 255]], [[128, 128, 128], [200, 100, 50], [40, 180, 90]]], np.uint8
).repeat(16, axis=0).repeat(16, axis=1)  # fmt: skip


def adobe_profile() -> bytes:
    """A version 2 profile of Adobe RGB (1998), from its primaries adapted to D50 and its gamma of 563 / 256."""

    def xyz(*values):
        return struct.pack(">4sI3i", b"XYZ ", 0, *(round(value * 65536) for value in values))

    curve = struct.pack(">4sIIH", b"curv", 0, 1, 563) + b"\0\0"
    text = b"Adobe RGB\0"
    tags = {
        b"desc": struct.pack(">4sII", b"desc", 0, len(text)) + text + b"\0" * 78,
        b"wtpt": xyz(0.9642, 1, 0.8249), b"rXYZ": xyz(0.60974, 0.31111, 0.01947),
        b"gXYZ": xyz(0.20528, 0.62567, 0.06087), b"bXYZ": xyz(0.14919, 0.06322, 0.74457),
        b"rTRC": curve, b"gTRC": curve, b"bTRC": curve, b"cprt": struct.pack(">4sI", b"text", 0) + b"none\0",
    }  # fmt: skip
    at, table, body = 132 + 12 * len(tags), struct.pack(">I", len(tags)), b""
    for name, content in tags.items():
        content += b"\0" * (-len(content) % 4)
        table += struct.pack(">4sII", name, at + len(body), len(content))
        body += content
    head = struct.pack(">I4sI4s4s4s", 132 + len(table) - 4 + len(body), b"lcms", 0x02100000, b"mntr", b"RGB ", b"XYZ ")
    head += struct.pack(">6H4s", 2020, 1, 1, 0, 0, 0, b"acsp") + b"\0" * 28 + struct.pack(">3i", 63190, 65536, 54061)
    return head.ljust(128, b"\0") + table + body


def encode(space=None, index=None, profile=None) -> bytes:
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "camera"
    if space is not None:
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ColorSpace] = space
    if index is not None:
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.IFD.Interop] = {ExifTags.Interop.InteropIndex: index}
    out = io.BytesIO()
    Image.fromarray(COLOURS).save(out, "PNG", exif=exif, icc_profile=profile)
    return out.getvalue()


def test_the_conversion_is_that_of_littlecms():
    source = ImageCms.ImageCmsProfile(io.BytesIO(adobe_profile()))
    expected = ImageCms.profileToProfile(Image.fromarray(COLOURS), source, ImageCms.createProfile("sRGB"))
    assert np.abs(adobe_to_srgb(COLOURS).astype(int) - np.asarray(expected)).max() <= 2


def test_exif_alone_says_adobe_rgb(tmp_path):
    told = decode_image(encode(65535, "R03"), tmp_path / "a.png")
    assert np.array_equal(told, adobe_to_srgb(COLOURS)) and np.abs(told.astype(int) - COLOURS).max() >= 40
    assert np.array_equal(decode_image(encode(2), tmp_path / "a.png"), told)
    embedded = decode_image(encode(65535, "R03", adobe_profile()), tmp_path / "a.png")
    assert np.abs(embedded.astype(int) - told).max() <= 2  # the profile counts, and is not applied twice


@pytest.mark.parametrize(("space", "index"), [(None, None), (1, "R98"), (65535, None), (65535, "R98"), (1, "R03")])
def test_any_other_exif_leaves_the_colours(tmp_path, space, index):
    assert np.array_equal(decode_image(encode(space, index), tmp_path / "a.png"), COLOURS)
