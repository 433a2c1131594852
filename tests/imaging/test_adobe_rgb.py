"""Colours that are not sRGB, with a profile or without, against littleCMS with a profile of that space."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import ExifTags, Image, ImageCms

from toolkit.imaging.colour import LINEAR_SRGB_OF_P3, adobe_to_srgb, linear_to_srgb, srgb_to_linear
from toolkit.imaging.read import UnreadableImage, decode_image, read_image, register_heif

COLOURS = np.array(
    [[[255, 0, 0], [0, 255, 0], [0, 0, 255]], [[128, 128, 128], [200, 100, 50], [40, 180, 90]]], np.uint8
).repeat(16, axis=0).repeat(16, axis=1)  # fmt: skip


def xyz(*values):
    return struct.pack(">4sI3i", b"XYZ ", 0, *(round(value * 65536) for value in values))


def adobe_profile() -> bytes:
    """A version 2 profile of Adobe RGB (1998), from its primaries adapted to D50 and its gamma of 563 / 256."""
    red, green, blue = (0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457)
    return make_profile(b"Adobe RGB", gamma=563 / 256, red=red, green=green, blue=blue)


def srgb_primaries(name: bytes, gamma: float) -> bytes:
    red, green, blue = (0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.71410)
    return make_profile(name, gamma=gamma, red=red, green=green, blue=blue)


def make_profile(name: bytes, *, gamma: float, **primaries) -> bytes:
    """A version 2 profile of RGB by its primaries adapted to D50, or without any of grey."""
    curve, text = struct.pack(">4sIIH", b"curv", 0, 1, round(gamma * 256)) + b"\0\0", name + b"\0"
    tags = {b"desc": struct.pack(">4sII", b"desc", 0, len(text)) + text + b"\0" * 78, b"wtpt": xyz(0.9642, 1, 0.8249)}
    tags |= {colour[:1].encode() + b"XYZ": xyz(*values) for colour, values in primaries.items()}
    tags |= dict.fromkeys((b"rTRC", b"gTRC", b"bTRC") if primaries else (b"kTRC",), curve)
    tags[b"cprt"] = struct.pack(">4sI", b"text", 0) + b"none\0"
    at, table, body = 132 + 12 * len(tags), struct.pack(">I", len(tags)), b""
    for name, content in tags.items():
        content += b"\0" * (-len(content) % 4)
        table += struct.pack(">4sII", name, at + len(body), len(content))
        body += content
    space = b"RGB " if primaries else b"GRAY"
    head = struct.pack(">I4sI4s4s4s", 132 + len(table) - 4 + len(body), b"lcms", 0x02100000, b"mntr", space, b"XYZ ")
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


def test_a_profile_called_srgb_may_be_linear(tmp_path):
    """GIMP calls one "Linear sRGB": the code 64 is a quarter of white's light there, and 137 in sRGB."""
    pixels = np.full((8, 8, 3), 64, np.uint8)
    for name, gamma, expected in ((b"GIMP built-in Linear sRGB", 1.0, 137), (b"sRGB IEC61966-2.1", 2.2, 64)):
        Image.fromarray(pixels).save(tmp_path / "a.png", icc_profile=srgb_primaries(name, gamma))
        assert np.abs(read_image(tmp_path / "a.png").astype(int) - expected).max() <= 1, name


def test_grey_with_transparency_keeps_its_profile(tmp_path):
    """Linear grey, with and without an alpha channel or a transparent value, shows the same."""
    grey = Image.new("L", (8, 8), 64)
    profile = make_profile(b"linear grey", gamma=1.0)
    for name, image, how in (
        ("plain.png", grey, {}),
        ("alpha.png", Image.merge("LA", (grey, Image.new("L", (8, 8), 255))), {}),
        ("value.png", grey, {"transparency": 7}),
    ):
        image.save(tmp_path / name, icc_profile=profile, **how)
        assert np.abs(read_image(tmp_path / name).astype(int) - 137).max() <= 1, name


def save_heic(path, **nclx) -> None:
    Image.fromarray(COLOURS).save(path, "HEIF", quality=-1, chroma=444, save_nclx_profile=True, **nclx)


def test_a_heic_may_say_display_p3_without_a_profile(tmp_path):
    register_heif()
    where = {
        "red": (0.51512, 0.24120, -0.00105),
        "green": (0.29198, 0.69225, 0.04189),
        "blue": (0.1571, 0.06657, 0.78407),
    }
    shape = {"matrix_coefficients": 1, "full_range_flag": 1, "transfer_characteristics": 13}
    save_heic(tmp_path / "srgb.heic", color_primaries=1, **shape)
    save_heic(tmp_path / "p3.heic", color_primaries=12, **shape)
    plain = read_image(tmp_path / "srgb.heic")
    # the tone curve of sRGB is near a gamma of 2.2: a few codes apart
    source = ImageCms.ImageCmsProfile(io.BytesIO(make_profile(b"Display P3", gamma=2.2, **where)))
    expected = ImageCms.profileToProfile(Image.fromarray(plain), source, srgb_primaries_as_profile())
    found = read_image(tmp_path / "p3.heic")
    assert np.abs(found.astype(int) - np.asarray(expected)).max() <= 9 < np.abs(found.astype(int) - plain).max()


def srgb_primaries_as_profile():
    """sRGB with the same gamma as the profile that it is compared with."""
    return ImageCms.ImageCmsProfile(io.BytesIO(srgb_primaries(b"sRGB", 2.2)))


@pytest.mark.parametrize("transfer", [16, 18])
def test_an_hdr_heic_is_refused(tmp_path, transfer):
    register_heif()
    save_heic(tmp_path / "hdr.heic", color_primaries=9, transfer_characteristics=transfer)
    with pytest.raises(UnreadableImage, match="HDR picture"):
        read_image(tmp_path / "hdr.heic")


def add_chunk(content: bytes, kind: bytes, data: bytes) -> bytes:
    """A PNG with another chunk after its first."""
    chunk = struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return content[:33] + chunk + content[33:]


def png_bytes(pixels, **how) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", **how)
    return buffer.getvalue()


def test_numbers_of_a_png_and_an_avif_are_those_of_a_heic(tmp_path):
    """Display P3 by number shows as by profile; linear light is encoded; BT.2020 as colour-science has it."""
    png = png_bytes(COLOURS)
    (tmp_path / "p3.png").write_bytes(add_chunk(png, b"cICP", bytes([12, 13, 0, 1])))
    found = read_image(tmp_path / "p3.png").astype(float) / 255
    light = srgb_to_linear(COLOURS / 255) @ LINEAR_SRGB_OF_P3.T
    assert np.abs(found - linear_to_srgb(light)).max() < 0.005
    # the numbers come before a profile of another kind (PNG 3, 4.3)
    linear = png_bytes(np.full((8, 8, 3), 64, np.uint8), icc_profile=srgb_primaries(b"sRGB IEC61966-2.1", 2.2))
    (tmp_path / "linear.png").write_bytes(add_chunk(linear, b"cICP", bytes([1, 8, 0, 1])))
    assert np.abs(read_image(tmp_path / "linear.png").astype(int) - 137).max() <= 1
    grey = png_bytes(np.full((8, 8, 3), 128, np.uint8))
    (tmp_path / "wide.png").write_bytes(add_chunk(grey, b"cICP", bytes([9, 13, 0, 1])))
    assert np.abs(read_image(tmp_path / "wide.png").astype(int) - 128).max() <= 1  # the white is the same
    buffer = io.BytesIO()
    Image.fromarray(COLOURS).save(buffer, "AVIF", quality=100, subsampling="4:4:4")
    avif = buffer.getvalue()
    (tmp_path / "plain.avif").write_bytes(avif)
    assert avif.count(b"colrnclx\0\1") == 1
    (tmp_path / "p3.avif").write_bytes(avif.replace(b"colrnclx\0\1", b"colrnclx\0\x0c"))
    light = srgb_to_linear(read_image(tmp_path / "plain.avif") / 255) @ LINEAR_SRGB_OF_P3.T
    assert np.abs(read_image(tmp_path / "p3.avif") / 255 - linear_to_srgb(light)).max() < 0.005


@pytest.mark.parametrize("transfer", [16, 18])
def test_an_hdr_png_or_avif_is_refused(tmp_path, transfer):
    (tmp_path / "a.png").write_bytes(add_chunk(png_bytes(COLOURS), b"cICP", bytes([9, transfer, 0, 1])))
    buffer = io.BytesIO()
    Image.fromarray(COLOURS).save(buffer, "AVIF")
    start = buffer.getvalue().index(b"colrnclx") + 10
    (tmp_path / "a.avif").write_bytes(buffer.getvalue()[:start] + bytes([0, transfer]) + buffer.getvalue()[start + 2 :])
    for name in ("a.png", "a.avif"):
        with pytest.raises(UnreadableImage, match="HDR picture"):
            read_image(tmp_path / name)


@pytest.mark.parametrize(
    ("chunks", "expected"),
    [
        ([(b"gAMA", 100000)], 137),  # linear light, as ImageMagick writes it
        ([(b"gAMA", 45455)], 64),  # sRGB's, or so
        ([(b"gAMA", 55556)], 81),  # old Macintosh: (64 / 255) ** 1.8
        ([(b"gAMA", 100000), (b"sRGB", None)], 64),
        ([(b"gAMA", 0)], 64),
    ],
)
def test_a_png_may_state_the_gamma_of_its_codes(tmp_path, chunks, expected):
    content = png_bytes(np.full((8, 8, 3), 64, np.uint8))
    for kind, value in chunks:
        content = add_chunk(content, kind, b"\0" if value is None else struct.pack(">I", value))
    (tmp_path / "a.png").write_bytes(content)
    assert np.abs(read_image(tmp_path / "a.png").astype(int) - expected).max() <= 1


def test_a_chunk_of_numbers_that_is_too_short_is_passed_over(tmp_path):
    (tmp_path / "a.png").write_bytes(add_chunk(png_bytes(COLOURS), b"cICP", b"\1"))
    assert (read_image(tmp_path / "a.png") == COLOURS).all()
