"""Copies of a photograph, recognised by their pixels, whatever their names and bytes."""

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache

import cv2
import numpy as np

from toolkit.imaging.read import UnreadableImage
from toolkit.rooms.photos.photo import Photo, load_pixels

THUMB_PX, COPY_LEVELS = 24, 0.6
"""Largest mean difference in grey levels of two small pictures of the same photograph. Two shots from the same tripod
differ by more if light or leaves move, and add no information if nothing does."""


@lru_cache(maxsize=4096)
def shrink(photo: Photo) -> np.ndarray | None:
    """(n, n) grey levels of a photograph; None if it does not decode."""
    with suppress(UnreadableImage):
        grey = cv2.cvtColor(load_pixels(photo), cv2.COLOR_RGB2GRAY)
        return cv2.resize(grey, (THUMB_PX, THUMB_PX), interpolation=cv2.INTER_AREA).astype(float)
    return None


def find_copied(photo: Photo, others: Sequence[Photo]) -> int | None:
    """Return the number of the first of the others with the same picture; a blank picture is a copy of nothing."""
    own = shrink(photo)
    if own is None or own.std() <= COPY_LEVELS:
        return None
    for number, other in enumerate(map(shrink, others)):
        if other is not None and np.abs(own - other).mean() <= COPY_LEVELS:
            return number
    return None
