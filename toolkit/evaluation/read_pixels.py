"""Pixels of captures as networks see them: read ahead by threads, and corrupted if wanted."""

import warnings
from collections.abc import Generator, Iterable

import numpy as np
from PIL import Image

from toolkit.captures.capture import Capture
from toolkit.captures.corrupted_copy import SEED
from toolkit.captures.read import read_crop
from toolkit.core.child import count_cores
from toolkit.core.threads import map_ahead
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage, read_image

MAX_DECODERS, AHEAD = 8, 32


def read_pixels(capture: Capture, how: Preprocessing | None) -> np.ndarray | str:
    """Return the pixels (h, w, 3) uint8 sRGB of an image, or why it was not read.

    A pending corruption is applied to the returned pixels, rounded to 8 bits as in ImageNet-C. Its seed is the path
    below the source, so neither order nor batch matters, and `sim` and `real` get the same fog at the same path.

    Args:
        capture: the image.
        how: preprocessing of a classifier's crop; None for the whole image, as a detector sees it.
    """
    # the reason why a file was refused when it was listed
    if capture.refused is not None:
        return capture.refused
    try:
        pixels = read_image(capture.file) if how is None else read_crop(capture, how)
    except UnreadableImage as error:
        return error.reason
    if capture.pending_corruption is None:
        return pixels
    from toolkit.core.draws import image_seed
    from toolkit.corruptions.batch import corrupt
    from toolkit.corruptions.digital import from_bytes, to_bytes

    # the seed is the path below the source: the same everywhere
    seeds = [image_seed(SEED, capture.path_in_source)]
    return to_bytes(corrupt(from_bytes(np.stack([pixels])), *capture.pending_corruption, seeds))[0]


def read_ahead(
    captures: Iterable[Capture], how: Preprocessing | None, ahead: int = AHEAD
) -> Generator[tuple[Capture, np.ndarray | str]]:
    """Yield each image with its `read_pixels`, in order; `ahead` images are read in advance, by threads."""
    with warnings.catch_warnings():
        # read_image has its own, stricter limit
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        warnings.filterwarnings("ignore", module=r"PIL\..*")
        threads = min(MAX_DECODERS, count_cores())
        yield from map_ahead(lambda capture: (capture, read_pixels(capture, how)), captures, threads, ahead)
