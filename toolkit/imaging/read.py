"""Find photographs in a folder, and decode them to a common form: upright (h, w, 3) uint8, sRGB-encoded."""

import contextlib
import io
import os
import re
import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from PIL import ExifTags, Image, ImageCms, ImageOps

from toolkit.core.errors import ToolkitError, foreign_code
from toolkit.core.files import open_plain, real_path, walk_folders
from toolkit.core.lazy import cv2
from toolkit.imaging.colour import PRIMARIES, SAME_PRIMARIES, adobe_to_srgb, rgb_to_srgb

IMAGE_SUFFIXES = frozenset(
    (".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".webp", ".tif", ".tiff", ".heic", ".heif", ".avif", ".bmp", ".gif")
)
FORMATS = ("JPEG", "PNG", "WEBP", "TIFF", "HEIF", "AVIF", "BMP", "GIF")
"""Pillow's readers in use for files of any name; the EPS reader would start Ghostscript."""
TEXTURE_FORMATS = (*FORMATS, "TGA", "DDS", "PPM", "JPEG2000")
"""With the formats of modelling programs."""
AVIF_HEAD = 65_536
"""Bytes at the start of an AVIF that hold the boxes about its colours."""
PNG_START, RADIANCE_START, EXR_START = b"\x89PNG\r\n\x1a\n", b"#?", b"v/1\1"
MAX_MEGAPIXELS = 175
"""Most pixels of photographs and textures: they take 0.7 GB, just below Pillow's own limit."""
MAX_TEXTURE_PX = 8192
"""Longest side of a texture: a larger texture is shrunk, as no picture shows its texels."""
MAX_SIDE_PX = 65_535
"""Longest side of a photograph: JPEG allows no more, and a line of a million pixels is no photograph."""
MID_GREY = 128
LINEAR_TRANSFER, HDR_TRANSFERS = 8, (16, 18)
"""Numbers of tone curves (ITU-T H.273): linear, PQ and HLG. The others are near sRGB's."""
SRGB_GAMMA, SAME_GAMMA = 1 / 2.2, 0.03
"""What a PNG of sRGB states as gamma, and differences from it that do not count."""
SAME_CODES = 3
"""Rounding of a profile's tables, in 8-bit codes."""
DRAFT_MARGIN = 2


class UnreadableImage(ToolkitError):
    """A file that does not decode; `reason` says why in a few words."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.reason = reason


def is_image_name(name: str) -> bool:
    """Whether a file is an image by its suffix."""
    return Path(name).suffix.lower() in IMAGE_SUFFIXES


def read_image(path: Path, short_side_px: int | None = None) -> np.ndarray:
    """Decode a photograph to (h, w, 3) uint8, sRGB-encoded.

    EXIF orientation is applied; an embedded ICC profile, or Adobe RGB by the EXIF alone, is converted to sRGB. Images
    of 16 bits, grey, CMYK or with a palette become 8-bit RGB, transparency is laid over mid grey. The first of several
    frames is taken.

    Args:
        path: JPEG, PNG, WebP, TIFF, HEIC, AVIF, BMP or GIF.
        short_side_px: length to which the image will be shrunk; a JPEG may then be decoded at a fraction of its size,
            not under twice this length. None decodes in full.

    Raises:
        UnreadableImage: the file is empty, no image, truncated, of a kind that cannot be shown, or far too large.
    """
    return _decode(Path(path), None, short_side_px)


def read_opaque(path: Path) -> np.ndarray:
    """`read_image` of a picture to print, an `UnreadableImage` also if a part of it is transparent."""
    pixels = read_image(path)
    with open_image(path) as image:
        alpha = np.asarray(image.convert("RGBA").getchannel("A")) if image.has_transparency_data else None
    if alpha is not None and (alpha < 255).any():
        share = (alpha < 255).mean()
        raise UnreadableImage(path, f"{max(share, 0.01):.0%} of it is transparent: fill that with a colour first")
    return pixels


def decode_image(content: bytes, name: Path) -> np.ndarray:
    """`read_image` of bytes in memory; `name` stands for them in errors."""
    return _decode(Path(name), content, None)


@contextlib.contextmanager
def open_image(path: Path, content: bytes | None = None) -> Iterator[Image.Image]:
    """Open an image of a plain file, or of `content`, without decoding its pixels.

    Raises:
        UnreadableImage: the file is empty, a pipe or a device, far too large, or damaged, also when decoded within.
    """
    with decoding(path), open_plain(path) if content is None else io.BytesIO(content) as stream:
        if not stream.read(1):
            raise UnreadableImage(path, "the file is empty")
        stream.seek(0)
        with Image.open(stream, formats=_list_readers(FORMATS)) as image:
            _check_size(path, *image.size)
            _note_colour_numbers(image, stream)
            if _colour_numbers(image)[1] in HDR_TRANSFERS:
                raise UnreadableImage(path, "an HDR picture (PQ or HLG): save it as JPEG, or photograph without HDR")
            yield image


def _note_colour_numbers(image: Image.Image, stream: BinaryIO) -> None:
    """Note the numbers of primaries and tone curve of a PNG or AVIF as those of a HEIC are: Pillow passes over them."""
    # the stream is left where it was, as Pillow goes on reading there
    place, found = stream.tell(), None
    if image.format == "PNG":
        stream.seek(len(PNG_START))
        # chunks before the pixels: length, name, content, checksum
        while len(head := stream.read(8)) == 8 and head[4:] != b"IDAT" and found is None:
            found = struct.unpack("BBxx", stream.read(4)) if head == b"\0\0\0\4cICP" else None
            stream.seek(int.from_bytes(head[:4], "big") + 4, io.SEEK_CUR)
    elif image.format == "AVIF":
        stream.seek(0)
        # boxes lie in boxes: that of colours is found by its name
        if box := re.search(rb"colrnclx(.{4})", stream.read(AVIF_HEAD), re.DOTALL):
            found = struct.unpack(">HH", box[1])
    stream.seek(place)
    if found is not None:
        image.info["nclx_profile"] = {"color_primaries": found[0], "transfer_characteristics": found[1]}


def _colour_numbers(image: Image.Image) -> tuple[int, int]:
    """Numbers of an image's primaries and tone curve (ITU-T H.273); 1 and 13 are sRGB's, also of one with a profile."""
    numbers = image.info.get("nclx_profile") or {}
    # a profile tells more; in a PNG the numbers come first (PNG 3, 4.3)
    if image.info.get("icc_profile") and image.format != "PNG":
        numbers = {}
    return numbers.get("color_primaries", 1), numbers.get("transfer_characteristics", 13)


def decoding(path: Path, what: str = "{}") -> contextlib.AbstractContextManager[None]:
    """Turn every error of a decoder into `UnreadableImage` of `path`; in the reason `what`, `{}` is the damage."""
    return foreign_code(lambda error: UnreadableImage(path, what.format(explain_damage(error))))


def _check_size(path: Path, width: int, height: int) -> None:
    megapixels = width * height / 1e6
    if megapixels > MAX_MEGAPIXELS:
        raise UnreadableImage(
            path, f"{megapixels:.0f} megapixels, more than {MAX_MEGAPIXELS}: a decompression bomb, or scale it down"
        )
    if max(width, height) > MAX_SIDE_PX:
        size = f"{width}×{height} px"
        raise UnreadableImage(path, f"{size}: a side of more than {MAX_SIDE_PX} px is no photograph's")


def decode_frame(content: bytes, name: Path, grey: bool = False, size_px: tuple[int, int] | None = None) -> np.ndarray:
    """(h, w, 3) uint8 RGB of a program's PNG, or (h, w) if `grey`, by OpenCV, which takes half of Pillow's time.

    Args:
        content: the file's bytes.
        name: its name in errors.
        grey: whether it is a mask.
        size_px: width and height that it must have, checked before it is decoded; None: any.

    Raises:
        UnreadableImage: it is no PNG, damaged, far too large, or of another size.
    """
    pixels = None
    # the head of a PNG states its size, which is checked before anything is decoded
    if content.startswith(PNG_START) and len(content) >= 24:
        width, height = struct.unpack(">II", content[16:24])
        if size_px is not None and (width, height) != size_px:
            raise UnreadableImage(name, f"{width} × {height} px, expected {size_px[0]} × {size_px[1]}")
        _check_size(name, width, height)
        with contextlib.suppress(cv2.error):
            flag = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR
            pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flag)
    if pixels is None:
        raise UnreadableImage(name, "expected a picture as PNG, found another kind or a damaged one")
    # OpenCV has blue first
    return np.asarray(pixels) if grey else np.ascontiguousarray(pixels[..., ::-1])


def read_linear(path: Path) -> np.ndarray:
    """(h, w, 3) float32 linear light of a Radiance or OpenEXR picture, else an `UnreadableImage`."""
    try:
        with open_plain(path) as file:
            head = file.read(4096)
    except (OSError, ValueError) as error:
        raise UnreadableImage(path, explain_damage(error)) from None
    if head.startswith(RADIANCE_START):
        # Radiance writes its size as text
        size = re.search(rb"\n[-+]Y (\d+) [-+]X (\d+)", head)
        if size is None:
            raise UnreadableImage(path, "not a Radiance picture, whatever its name says")
        _check_size(path, int(size[2]), int(size[1]))
    elif not head.startswith(EXR_START):
        raise UnreadableImage(path, "not a Radiance picture, nor OpenEXR, whatever its name says")
    os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")  # OpenCV keeps its reader of EXR off without
    found = None
    with contextlib.suppress(cv2.error):
        found = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
    if found is None and head.startswith(EXR_START):
        raise UnreadableImage(path, "this OpenCV reads no EXR, or the file is damaged: save the panorama as .hdr")
    if found is None:
        raise UnreadableImage(path, "a damaged Radiance picture")
    # OpenCV has blue first
    return np.ascontiguousarray(found[..., ::-1], np.float32)


def _decode(path: Path, content: bytes | None, short_side_px: int | None) -> np.ndarray:
    with open_image(path, content) as image:
        if short_side_px is not None:
            # JPEG decodes fractions cheaply; twice the wanted side keeps the quality of the resampling
            image.draft(image.mode, (DRAFT_MARGIN * short_side_px, DRAFT_MARGIN * short_side_px))
        image.load()
        return np.asarray(_to_rgb(_turn_upright(image)))


def decode_texture(image: Image.Image, name: str) -> np.ndarray:
    """Decode an opened picture as it lies to (h, w, 3) uint8, sRGB-encoded, without transparency.

    A picture with a side over `MAX_TEXTURE_PX` is shrunk by a whole factor, with a notice.

    Args:
        image: opened, best not decoded yet.
        name: its name in messages.

    Raises:
        UnreadableImage: it is damaged, or far too large.
    """
    size = f"a texture of {image.width} × {image.height} pixels"
    if image.width * image.height / 1e6 > MAX_MEGAPIXELS:
        raise UnreadableImage(Path(name), f"{size}, more than {MAX_MEGAPIXELS} megapixels: scale it down")
    # a whole factor, rounded up
    factor = -(-max(image.size) // MAX_TEXTURE_PX)
    with decoding(Path(name), f"{size}: {{}}"):
        if factor > 1:
            from toolkit.core.console import notice

            # a JPEG can be decoded at a fraction of its size
            image.draft(image.mode, (image.width // factor, image.height // factor))
            full, image = image, image.reduce(-(-max(image.size) // MAX_TEXTURE_PX))
            full.close()  # frees what was decoded
            notice(f"{name}: {size} is shrunk to {image.width} × {image.height}")
        return np.asarray(_to_eight_bits(image).convert("RGB"))


def decode_texture_file(content: bytes, name: str, with_alpha: bool) -> tuple[np.ndarray, np.ndarray | None]:
    """`decode_texture` of a file's bytes, and its alpha, (h, w) uint8, if it has any and `with_alpha`."""
    if not content:
        raise UnreadableImage(Path(name), "a texture that is empty: save it again as PNG")
    with _any_size():
        with decoding(Path(name), "a texture that cannot be read ({}): save it as PNG"):
            image = Image.open(io.BytesIO(content), formats=_list_readers(TEXTURE_FORMATS))
        pixels, alpha = decode_texture(image, name), None
        if with_alpha and (image.has_transparency_data or image.mode in ("RGBA", "LA", "PA")):
            image = Image.open(io.BytesIO(content), formats=_list_readers(TEXTURE_FORMATS))
            alpha = np.asarray(image.convert("RGBA").getchannel("A").resize(pixels.shape[1::-1]))
    return pixels, alpha


def read_texture(path: Path) -> np.ndarray:
    """`decode_texture` of a file that a mesh names; an `UnreadableImage` if it is no picture, or damaged."""
    try:
        with open_plain(path) as file:
            content = file.read()
    except (OSError, ValueError) as error:
        raise UnreadableImage(path, explain_damage(error)) from None
    return decode_texture_file(content, str(path), with_alpha=False)[0]


_one_at_a_time = threading.RLock()


@contextlib.contextmanager
def _any_size() -> Iterator[None]:
    """Let Pillow open pictures of any size: the decoder within keeps to `MAX_MEGAPIXELS`."""
    with _one_at_a_time:
        limit = Image.MAX_IMAGE_PIXELS
        Image.MAX_IMAGE_PIXELS = None
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def explain_damage(error: Exception) -> str:
    """Describe the damage of an image by its decoder's exception."""
    if isinstance(error, Image.UnidentifiedImageError):
        return "not an image, whatever its name says"
    if isinstance(error, Image.DecompressionBombError):
        return "a decompression bomb: far more pixels than any photograph"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    text = " ".join(str(error).split())
    if "truncated" in text.lower() or isinstance(error, EOFError):
        return "truncated: the end of the file is missing"
    return f"damaged ({text[:100] or error.__class__.__name__})"


@lru_cache(maxsize=1)
def register_heif() -> None:
    """Teach Pillow to open HEIC files, once."""
    try:
        from pillow_heif import register_heif_opener
    except ImportError:
        return  # HEIC files are then reported as no image; the package depends on pillow-heif
    register_heif_opener()


@lru_cache(maxsize=2)
def _list_readers(formats: tuple[str, ...]) -> tuple[str, ...]:
    """Return the `formats` that this Pillow has."""
    register_heif()
    Image.init()
    return tuple(format_name for format_name in formats if format_name in Image.OPEN)


def _turn_upright(image: Image.Image) -> Image.Image:
    # the pixels may be whole though the EXIF is damaged: keep the image as it lies
    with contextlib.suppress(Exception):
        if image.getexif().get(ExifTags.Base.Orientation, 1) != 1:  # else it would be copied
            return ImageOps.exif_transpose(image)
    return image


def _to_rgb(image: Image.Image) -> Image.Image:
    # read first: conversions drop them
    profile, is_adobe = image.info.get("icc_profile"), _is_adobe_rgb(image)
    (primaries, transfer), gamma = _colour_numbers(image), _gamma_of(image)
    image = _to_eight_bits(image)
    # palettes become plain RGB, and transparency a channel
    if image.mode in ("P", "PA", "RGBa", "La") or "transparency" in image.info:
        has_alpha = image.mode != "P" or "transparency" in image.info
        # grey stays grey, as a profile of grey fits nothing else
        image = image.convert("LA" if image.mode in ("L", "La") else "RGBA" if has_alpha else "RGB")
    alpha = image.getchannel("A") if image.mode in ("LA", "RGBA") else None
    if alpha is not None:
        image = image.convert("L" if image.mode == "LA" else "RGB")
    # colours become sRGB, by the numbers of a PNG, HEIC or AVIF, the embedded profile, Adobe's mark or a PNG's gamma
    if primaries in PRIMARIES or transfer == LINEAR_TRANSFER:
        matrix, curve = PRIMARIES.get(primaries, SAME_PRIMARIES), 1.0 if transfer == LINEAR_TRANSFER else None
        image = Image.fromarray(rgb_to_srgb(np.asarray(image.convert("RGB")), matrix, curve))
    elif profile:
        image = _to_srgb(image, profile)
    elif is_adobe and image.mode == "RGB":
        image = Image.fromarray(adobe_to_srgb(np.asarray(image)))
    elif gamma is not None:
        image = Image.fromarray(rgb_to_srgb(np.asarray(image.convert("RGB")), gamma=1 / gamma))
    image = image if image.mode == "RGB" else image.convert("RGB")
    # transparent pixels show a mid grey
    if alpha is None:
        return image
    return Image.composite(image, Image.new("RGB", image.size, (MID_GREY,) * 3), alpha)


def _gamma_of(image: Image.Image) -> float | None:
    """The exponent that a PNG states for its codes, such as 1 of linear light; None where it is sRGB's, or unknown."""
    gamma = image.info.get("gamma")
    # 13 and a rendering intent say sRGB, whatever the gamma beside them (PNG 3, 4.3)
    if not gamma or "srgb" in image.info or "nclx_profile" in image.info or abs(gamma - SRGB_GAMMA) < SAME_GAMMA:
        return None
    return float(gamma)


def _is_adobe_rgb(image: Image.Image) -> bool:
    """Whether the EXIF declares Adobe RGB, as of cameras that embed no profile (DCF 2.0: "uncalibrated", and R03)."""
    with contextlib.suppress(Exception):  # the pixels may be whole though the EXIF is damaged
        exif = image.getexif()
        if not exif:
            return False
        space = exif.get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.ColorSpace)
        if space != 65535:
            return space == 2  # some programs write 2 for it
        # Pillow 12 raises a KeyError if the EXIF has no such part
        return str(exif.get_ifd(ExifTags.IFD.Interop).get(ExifTags.Interop.InteropIndex)).startswith("R03")
    return False


def _to_eight_bits(image: Image.Image) -> Image.Image:
    if not (image.mode.startswith("I") or image.mode == "F"):
        return image
    values = np.asarray(image, np.float64)
    if image.mode == "F":
        full = 1.0 if values.max(initial=0) <= 1.0 else 255.0
    else:
        # Pillow opens 16-bit PNGs as 32-bit integers: only the values differ from 8 bits
        full = 65535.0 if image.mode.startswith("I;16") or values.max(initial=0) > 255 else 255.0
    return Image.fromarray(np.round(np.clip(np.nan_to_num(values) / full, 0, 1) * 255).astype(np.uint8))


def _to_srgb(image: Image.Image, profile: bytes) -> Image.Image:
    # a broken or foreign profile is common in shared photographs, and no reason to refuse the pixels
    with contextlib.suppress(ImageCms.PyCMSError, OSError, ValueError, TypeError):
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        target = ImageCms.createProfile("sRGB")
        if "sRGB" in ImageCms.getProfileDescription(source) and image.mode == "RGB":
            # "Linear sRGB" is called so as well: the profile must leave a mid grey as it is
            grey = ImageCms.profileToProfile(Image.new("RGB", (1, 1), (MID_GREY,) * 3), source, target)
            if grey is None or max(abs(code - MID_GREY) for code in np.asarray(grey).ravel().tolist()) <= SAME_CODES:
                return image
        converted = ImageCms.profileToProfile(image, source, target, outputMode="RGB")
        return image if converted is None else converted
    return image


BY_DESIGN = frozenset((
    "manifest.jsonl", "transforms.json", "retake.txt", "gates.jsonl", "corruption.json", "corrupted.jsonl",
    "instances.json",
))  # fmt: skip


@dataclass(frozen=True)
class FoundFiles:
    """Files of a folder.

    Attributes:
        images: files that are images by name, as parts relative to the folder, sorted.
        refused: (path, reason) of image files and folders that are links to somewhere else.
        others: paths of files that are no images by name and no files of the toolkit.
    """

    images: tuple[tuple[str, ...], ...]
    refused: tuple[tuple[str, str], ...]
    others: tuple[str, ...]


def find_files(root: Path, is_wanted: Callable[[str], bool] = is_image_name) -> FoundFiles:
    """Find the files of a folder, images by `is_wanted` of their names; hidden and `.partial` files are ignored.

    Raises:
        ToolkitError: the folder does not exist, is a file, or may not be read.
    """
    root = Path(root)
    if not root.is_dir():
        what = "is a file, not a folder" if root.exists() else "does not exist"
        raise ToolkitError(f"{root} {what}: expected a folder of images sorted as SOURCE/OBJECT/VARIANT/FILE")
    # every file is an image, refused with a reason, or other; hidden files are ignored
    real_root = real_path(root)
    images: list[tuple[str, ...]] = []
    refused: list[tuple[str, str]] = []
    others: list[str] = []
    for here, folders, names in walk_folders(root, _raise_unreadable):
        parts = here.parts[len(root.parts) :]  # `relative_to` of Python 3.12 takes seconds for deep folders
        for name in folders:
            if not _is_passed_over(name) and (here / name).is_symlink():
                refused.append((show_path((*parts, name)), "a linked folder: copy its images here instead"))
        # in place: the walk follows the folders that are left in the list
        folders[:] = [name for name in folders if not _is_passed_over(name)]
        for name in names:
            if _is_passed_over(name) or name in BY_DESIGN:
                continue
            path = here / name
            if not is_wanted(name):
                others.append(show_path((*parts, name)))
            elif path.is_symlink() and not real_path(path).is_relative_to(real_root):
                refused.append(
                    (show_path((*parts, name)), "a link that leaves the folder: copy the image here instead")
                )
            else:
                images.append((*parts, name))
    return FoundFiles(tuple(sorted(images)), tuple(refused), tuple(others))


def encode_image(picture: np.ndarray | Image.Image, kind: str, **how: Any) -> bytes:
    """Encode a picture, (h, w), (h, w, 3) or (h, w, 4) uint8, as a file of Pillow's `kind`; `how` is Pillow's too."""
    buffer = io.BytesIO()
    (picture if isinstance(picture, Image.Image) else Image.fromarray(picture)).save(buffer, kind, **how)
    return buffer.getvalue()


def show_path(parts: tuple[str, ...]) -> str:
    """Join parts of a path by slashes; bytes of a name that are no text are replaced."""
    return os.fsencode("/".join(parts)).decode("utf-8", errors="replace")


def _is_passed_over(name: str) -> bool:
    return name.startswith(".") or name.endswith(".partial") or name == "__MACOSX"


def _raise_unreadable(error: OSError) -> None:
    raise ToolkitError(f"cannot read the folder {error.filename}: {error.strerror}")
