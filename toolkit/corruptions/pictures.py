"""Pictures in files: read, corrupted in batches of one size, and encoded."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from toolkit.classifiers.preprocessing import Preprocessing, resize_and_crop
from toolkit.corruptions.corrupt import MIN_SIDE_PX, corrupt
from toolkit.corruptions.digital import from_bytes, to_bytes
from toolkit.corruptions.draws import image_seed
from toolkit.corruptions.parallel import run_each
from toolkit.corruptions.sources import Source
from toolkit.images import UnreadableImage, read_image

BATCH_PIXELS = 16 * 256**2
MARGIN = (8, 7)
"""Published: the short side to 256, then the middle 224."""
FORMATS = ("png", "jpg")
JPEG_QUALITY = 85
"""Of ImageNet-C's own files."""


@dataclass(frozen=True)
class Loaded:
    """A source, its pixels (h, w, 3) uint8, the hash of its file, and where each corruption of it goes."""

    source: Source
    pixels: np.ndarray
    sha256: str
    wanted: dict[tuple[str, int], str]


def read_picture(file: Path, size_px: int | None) -> np.ndarray:
    """(h, w, 3) uint8 sRGB, resized so that its short side is 8/7 of `size_px` and cut to `size_px`², None as it is.

    Raises:
        UnreadableImage: it does not decode, or is smaller than 16 px.
    """
    pixels = read_image(file)
    if size_px is not None and pixels.shape[:2] != (size_px, size_px):
        grown, kept = MARGIN
        how = Preprocessing(round(size_px * grown / kept), size_px, (0, 0, 0), (1, 1, 1))
        pixels = resize_and_crop(pixels, how)
    if min(pixels.shape[:2]) < MIN_SIDE_PX:
        size = f"{pixels.shape[1]}×{pixels.shape[0]} px"
        raise UnreadableImage(file, f"{size}: too small to corrupt, {MIN_SIDE_PX} px each way are needed")
    return pixels


def split_batches(loaded: list[Loaded]) -> Iterator[list[Loaded]]:
    """Batches of images of one size, none of more than a million pixels but those of one image."""
    sizes: dict[tuple[int, ...], list[Loaded]] = {}
    for one in loaded:
        sizes.setdefault(one.pixels.shape, []).append(one)
    for shape, same in sizes.items():
        count = max(1, BATCH_PIXELS // (shape[0] * shape[1]))
        for start in range(0, len(same), count):
            yield same[start : start + count]


def render(batch: list[Loaded], name: str, severity: int, seed: int, image_format: str, device: str) -> list[bytes]:
    """Corrupt pictures of one size; the bytes of their files."""
    images = from_bytes(np.stack([one.pixels for one in batch]), device)
    seeds = [image_seed(seed, one.source.path) for one in batch]
    pixels = to_bytes(corrupt(images, name, severity, seeds))
    files = [b""] * len(batch)

    def encode(index: int) -> None:
        files[index] = encode_picture(pixels[index], image_format)

    run_each(encode, len(batch))
    return files


def encode_picture(pixels: np.ndarray, image_format: str) -> bytes:
    """(h, w, 3) uint8 as the bytes of a `png`, or of a `jpg` of the quality of ImageNet-C's files."""
    stream = io.BytesIO()
    if image_format == "png":
        Image.fromarray(pixels).save(stream, "PNG", compress_level=3)
    else:
        Image.fromarray(pixels).save(stream, "JPEG", quality=JPEG_QUALITY, optimize=True)
    return stream.getvalue()
