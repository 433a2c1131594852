"""Photographs as people have them come out upright, in sRGB, with the colours that a viewer shows."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms

from toolkit.imaging import read as images
from toolkit.imaging.read import MID_GREY, UnreadableImage, is_image_name, read_image

RED, GREEN, BLUE = (220, 40, 30), (30, 200, 60), (40, 60, 210)


def scene(width: int = 64, height: int = 48) -> Image.Image:
    """Red on the left, blue on the right, a green band on top: every turn shows."""
    image = Image.new("RGB", (width, height), RED)
    image.paste(BLUE, (width // 2, 0, width, height))
    image.paste(GREEN, (0, 0, width, height // 4))
    return image


def is_scene(pixels: np.ndarray, tolerance: int = 12) -> bool:
    height, width = pixels.shape[:2]
    spots = {(0.12, 0.5): GREEN, (0.6, 0.2): RED, (0.6, 0.8): BLUE}
    return all(
        np.abs(pixels[int(v * height), int(u * width)].astype(int) - colour).max() <= tolerance
        for (v, u), colour in spots.items()
    )


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tif", ".heic", ".bmp"])
def test_formats(tmp_path, suffix):
    scene().save(tmp_path / f"photo{suffix}", quality=95)
    pixels = read_image(tmp_path / f"photo{suffix}")
    assert pixels.shape == (48, 64, 3) and pixels.dtype == np.uint8
    assert is_scene(pixels, 25 if suffix == ".heic" else 12)  # HEIC's encoder blurs colour at this size


# what a camera stores for each orientation, so that the viewer's turn brings the scene upright
STORED = {
    1: None,
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_90,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_270,
}


@pytest.mark.parametrize("orientation", STORED)
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp"])
def test_exif_orientation(tmp_path, orientation, suffix):
    stored = scene() if STORED[orientation] is None else scene().transpose(STORED[orientation])
    exif = Image.Exif()
    exif[0x0112] = orientation
    stored.save(tmp_path / f"turned{suffix}", exif=exif, quality=95)
    pixels = read_image(tmp_path / f"turned{suffix}")
    assert pixels.shape == (48, 64, 3)
    assert is_scene(pixels)


def test_heic_orientation(tmp_path):
    """HEIF turns by a box of its own, which the writer makes of the EXIF bytes; the tag itself says nothing there."""
    images.register_heif()
    exif = Image.Exif()
    exif[0x0112] = 6
    scene().transpose(Image.Transpose.ROTATE_90).save(tmp_path / "phone.heic", exif=exif.tobytes(), quality=95)
    pixels = read_image(tmp_path / "phone.heic")
    assert pixels.shape == (48, 64, 3)
    assert is_scene(pixels, 25)


@pytest.mark.parametrize(
    ("mode", "suffix"),
    [("L", ".png"), ("L", ".jpg"), ("1", ".png"), ("I;16", ".png"), ("I;16", ".tif"), ("F", ".tif"), ("LA", ".png")],
)
def test_grey_modes(tmp_path, mode, suffix):
    grey = np.tile(np.linspace(0, 255, 64).round().astype(np.uint8), (48, 1))
    if mode == "1":
        grey = np.where(grey > 127, 255, 0).astype(np.uint8)
        image = Image.fromarray(grey).convert("1")
    elif mode == "I;16":
        image = Image.fromarray(grey.astype(np.uint16) * 257)
    elif mode == "F":
        image = Image.fromarray(grey.astype(np.float32) / 255)
    else:
        image = Image.fromarray(grey).convert(mode)
    image.save(tmp_path / f"grey{suffix}", **({"quality": 98} if suffix == ".jpg" else {}))
    pixels = read_image(tmp_path / f"grey{suffix}")
    assert pixels.shape == (48, 64, 3)
    assert np.abs(pixels.astype(int) - grey[..., None]).max() <= 2


def test_sixteen_bit_colour_png(tmp_path):
    """Written by hand, as Pillow cannot: 2 × 1 pixels, 16 bits per channel."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    row = b"\x00" + struct.pack(">6H", 65535, 32768, 0, 257 * 10, 257 * 20, 257 * 30)
    header = struct.pack(">IIBBBBB", 2, 1, 16, 2, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(row)) + chunk(b"IEND", b"")
    (tmp_path / "deep.png").write_bytes(png)
    assert read_image(tmp_path / "deep.png").tolist() == [[[255, 128, 0], [10, 20, 30]]]


def test_cmyk_and_palette(tmp_path):
    scene().convert("CMYK").save(tmp_path / "print.jpg", quality=95)
    scene().convert("CMYK").save(tmp_path / "print.tif")
    scene().quantize(8).save(tmp_path / "palette.png")
    scene().quantize(8).save(tmp_path / "palette.gif")
    for name in ("print.jpg", "print.tif", "palette.png", "palette.gif"):
        assert is_scene(read_image(tmp_path / name)), name


@pytest.mark.parametrize("suffix", [".png", ".webp", ".tif"])
def test_transparency_lies_over_mid_grey(tmp_path, suffix):
    image = scene().convert("RGBA")
    image.putalpha(Image.new("L", image.size, 0))
    image.paste((*RED, 255), (0, 0, 8, 8))
    image.paste((*RED, 128), (8, 0, 16, 8))
    image.save(tmp_path / f"cut{suffix}", **({"lossless": True} if suffix == ".webp" else {}))
    pixels = read_image(tmp_path / f"cut{suffix}").astype(int)
    assert np.abs(pixels[40, 40] - MID_GREY).max() <= 1
    assert np.abs(pixels[4, 4] - RED).max() <= 1
    assert np.abs(pixels[4, 12] - (np.array(RED) + MID_GREY) / 2).max() <= 2


def test_transparent_palette(tmp_path):
    image = Image.new("P", (8, 8), 0)
    image.putpalette([255, 0, 0, 0, 0, 255])
    image.paste(1, (0, 0, 4, 8))
    image.save(tmp_path / "p.png", transparency=0)
    pixels = read_image(tmp_path / "p.png")
    assert pixels[4, 2].tolist() == [0, 0, 255]
    assert pixels[4, 6].tolist() == [MID_GREY] * 3


def test_embedded_profile_is_converted(tmp_path):
    """A profile with swapped primaries: what is stored as red is shown as what the profile calls red."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    # rename the profile, then exchange the red and blue primaries: tags of equal length at their places in the table
    tags = {srgb[132 + 12 * i : 136 + 12 * i]: 132 + 12 * i for i in range(struct.unpack(">I", srgb[128:132])[0])}
    swapped = bytearray(srgb.replace("sRGB".encode("utf-16-be"), "ABCD".encode("utf-16-be")).replace(b"sRGB", b"ABCD"))
    red, blue = tags[b"rXYZ"], tags[b"bXYZ"]
    swapped[red + 4 : red + 12], swapped[blue + 4 : blue + 12] = srgb[blue + 4 : blue + 12], srgb[red + 4 : red + 12]
    image = Image.new("RGB", (16, 16), RED)
    image.save(tmp_path / "swapped.png", icc_profile=bytes(swapped))
    image.save(tmp_path / "srgb.png", icc_profile=srgb)
    image.save(tmp_path / "broken.png", icc_profile=b"no profile at all")
    assert np.abs(read_image(tmp_path / "swapped.png")[8, 8].astype(int) - RED[::-1]).max() <= 3
    for name in ("srgb.png", "broken.png"):
        assert read_image(tmp_path / name)[8, 8].tolist() == list(RED), name


def reason_of(path) -> str:
    with pytest.raises(UnreadableImage) as caught:
        read_image(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    return caught.value.reason


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tif", ".heic"])
def test_truncated(tmp_path, suffix):
    draw = np.random.default_rng(0)
    image = Image.fromarray(draw.integers(0, 256, (96, 128, 3), dtype=np.uint8))
    image.save(tmp_path / f"whole{suffix}")
    content = (tmp_path / f"whole{suffix}").read_bytes()
    (tmp_path / f"cut{suffix}").write_bytes(content[: len(content) // 2])
    assert len(reason_of(tmp_path / f"cut{suffix}")) > 5
    if suffix in (".jpg", ".png"):
        assert "truncated" in reason_of(tmp_path / f"cut{suffix}")


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".heic", ".webp"])
def test_empty_and_foreign(tmp_path, suffix):
    (tmp_path / f"empty{suffix}").write_bytes(b"")
    assert "empty" in reason_of(tmp_path / f"empty{suffix}")
    (tmp_path / f"text{suffix}").write_text("shopping list: milk")
    assert "not an image" in reason_of(tmp_path / f"text{suffix}")


def test_missing_file(tmp_path):
    assert "no such file" in reason_of(tmp_path / "gone.jpg")


def bomb_png(side: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    )


@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
@pytest.mark.parametrize("side", [13_300, 30_000])
def test_decompression_bomb(tmp_path, side):
    (tmp_path / "bomb.png").write_bytes(bomb_png(side))
    assert "bomb" in reason_of(tmp_path / "bomb.png")


def test_damaged_bytes_never_escape(tmp_path):
    """Whatever byte is damaged: pixels or a reason, no other exception."""
    draw = np.random.default_rng(1)
    for suffix in (".jpg", ".png", ".webp", ".tif"):
        buffer = io.BytesIO()
        scene().save(buffer, {".jpg": "JPEG", ".tif": "TIFF"}.get(suffix, suffix[1:].upper()))
        for _ in range(25):
            content = bytearray(buffer.getvalue())
            for place in draw.integers(0, len(content), 4):
                content[place] = draw.integers(0, 256)
            (tmp_path / f"x{suffix}").write_bytes(content)
            try:
                assert read_image(tmp_path / f"x{suffix}").shape[2] == 3
            except UnreadableImage as error:
                assert error.reason


@pytest.mark.slow
def test_reduced_decoding_changes_almost_nothing(tmp_path):
    """A phone's 12 megapixel JPEG at a quarter of its size, then shrunk, against shrinking it whole."""
    draw = np.random.default_rng(2)
    coarse = Image.fromarray(draw.integers(0, 256, (90, 120, 3), dtype=np.uint8))
    image = np.asarray(coarse.resize((4000, 3000), Image.Resampling.BICUBIC), np.int16)
    image = np.clip(image + draw.integers(-8, 9, image.shape), 0, 255).astype(np.uint8)
    Image.fromarray(image).save(tmp_path / "phone.jpg", quality=92)
    whole, reduced = read_image(tmp_path / "phone.jpg"), read_image(tmp_path / "phone.jpg", 256)
    assert whole.shape == (3000, 4000, 3)
    assert reduced.shape == (750, 1000, 3)
    small = [
        np.asarray(Image.fromarray(one).resize((341, 256), Image.Resampling.BILINEAR), float)
        for one in (whole, reduced)
    ]
    assert np.abs(small[0] - small[1]).mean() < 1.0
    assert np.abs(small[0] - small[1]).max() < 12


def test_small_images_are_decoded_in_full(tmp_path):
    scene(640, 480).save(tmp_path / "web.jpg")
    assert np.array_equal(read_image(tmp_path / "web.jpg"), read_image(tmp_path / "web.jpg", 256))


def test_image_names():
    assert all(is_image_name(name) for name in ("a.JPG", "b.jpeg", "c.HEIC", "d.tif", "e.webp", "f.png"))
    assert not any(is_image_name(name) for name in ("notes.txt", "manifest.jsonl", "jpg", "a.jpg.partial", "b.json"))
