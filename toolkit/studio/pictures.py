"""Photographs as the page shows them: small JPEGs, made anew from the pixels, whatever the file holds."""

import io
from functools import lru_cache
from pathlib import Path

import cv2
from PIL import Image

from toolkit.images import read_image

PREVIEW_PX, THUMB_PX = 1280, 240
QUALITY = 82
KEPT = 160


def show_photo(file: Path, longer_px: int) -> bytes:
    """A JPEG of a photograph, upright, at most `longer_px` long; remembered for as long as the file does not change.

    Raises:
        UnreadableImage: it is gone, or does not decode.
    """
    try:
        facts = file.stat()
        key = (facts.st_mtime_ns, facts.st_size)
    except OSError:
        key = (0, 0)  # `read_image` says what is wrong
    return _encode(file, key, longer_px)


@lru_cache(maxsize=KEPT)
def _encode(file: Path, key: tuple[int, int], longer_px: int) -> bytes:
    pixels = read_image(file, longer_px)
    share = longer_px / max(pixels.shape[:2])
    if share < 1:
        size = (max(1, round(pixels.shape[1] * share)), max(1, round(pixels.shape[0] * share)))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=QUALITY)
    return buffer.getvalue()
