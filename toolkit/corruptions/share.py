"""Which images of a batch are corrupted, and by what: what training with corruptions draws."""

from collections.abc import Iterator, Sequence

import numpy as np


def draw_corrupted(
    rng: np.random.Generator, count: int, corruptions: Sequence[tuple[str, int]], share: float
) -> Iterator[tuple[np.ndarray, str, int, list[int]]]:
    """For each image whether it is corrupted, by which, and the seed of that.

    Args:
        rng: draws.
        count: images in the batch.
        corruptions: (name, severity), at least one; each is as likely.
        share: probability that an image is corrupted.

    Yields:
        (numbers of some images, name, severity, a seed for each) of every corruption that was drawn.
    """
    acting = rng.random(count) < share
    drawn = rng.integers(len(corruptions), size=count)
    seeds = rng.integers(2**62, size=count)
    for kind in np.unique(drawn[acting]):
        which = np.flatnonzero(acting & (drawn == kind))
        yield which, *corruptions[kind], seeds[which].tolist()
