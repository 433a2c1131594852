"""Copies of a photograph, recognised by their pixels, whatever their names and bytes."""

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache

import cv2
import numpy as np

from toolkit.imaging.read import UnreadableImage
from toolkit.rooms.photos.photo import Photo, load_pixels

THUMB_PX, COPY_LEVELS = 24, 0.6
"""Mean difference in grey levels of two small pictures up to which they are one photograph, saved once more: two shots
from the same tripod differ by more wherever light or leaves move, and tell no more than one where nothing does."""


@lru_cache(maxsize=4096)
def shrink(photo: Photo) -> np.ndarray | None:
    """(n, n) grey levels of a photograph; None where it does not decode."""
    with suppress(UnreadableImage):
        grey = cv2.cvtColor(load_pixels(photo), cv2.COLOR_RGB2GRAY)
        return cv2.resize(grey, (THUMB_PX, THUMB_PX), interpolation=cv2.INTER_AREA).astype(float)
    return None


def is_copy(photo: Photo, other: Photo) -> bool:
    """Whether two files hold one photograph; a blank picture is a copy of nothing."""
    small, large = shrink(photo), shrink(other)
    if small is None or large is None:
        return False
    return bool(small.std() > COPY_LEVELS and np.abs(small - large).mean() <= COPY_LEVELS)


def find_copied(photo: Photo, others: Sequence[Photo]) -> int | None:
    """Number of the first of the others that holds the same photograph."""
    return next((number for number, other in enumerate(others) if is_copy(photo, other)), None)
