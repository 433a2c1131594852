"""Noise: Gaussian, shot, impulse and speckle."""

from functools import lru_cache

import numpy as np
import torch
from scipy.special import pdtr
from torch.nn import functional

from toolkit.core.draws import RandomStreams

BUCKETS = 4096
TAIL_SIGMAS = 10


@lru_cache(maxsize=10)
def _tables(scale: float, levels: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Distribution function (levels + 1, k) float32, and the smallest count (levels + 1, BUCKETS) in each bucket."""
    means = np.arange(levels + 1) * (scale / levels)
    # so many deviations out no number of 24 bits falls
    counts = np.arange(int(scale + TAIL_SIGMAS * np.sqrt(scale) + TAIL_SIGMAS))
    distribution = pdtr(counts, means[:, None]).astype(np.float32)
    distribution[:, -1] = 2.0  # no uniform number reaches it: the search ends here
    edges = np.arange(BUCKETS, dtype=np.float32) / BUCKETS
    # per bucket of the uniform number: where the search for its count begins
    start = np.stack([np.searchsorted(row, edges, side="right") for row in distribution])
    return torch.from_numpy(distribution), torch.from_numpy(start.astype(np.int16))


def draw_poisson(levels: torch.Tensor, scale: float, top: int, draws: RandomStreams) -> torch.Tensor:
    """Draw a Poisson count for every entry, exact to the 24 bits of its uniform number.

    The smallest possible count is looked up by the bucket of the uniform number; few need to search upwards.

    Args:
        levels: (b, ...) int32 in 0 … `top`.
        scale: mean at level `top`; the mean at level v is v × `scale` / `top`.
        top: the highest level.
        draws: a stream for each image.

    Returns:
        (b, ...) float32 whole numbers.
    """
    distribution, start = (table.to(levels.device) for table in _tables(scale, top))
    counts = distribution.shape[1]
    shape, chance, levels = levels.shape, draws.uniform(*levels.shape[1:]).flatten(), levels.flatten()
    # which bucket of its level each uniform number falls into
    bucket = (chance * BUCKETS).int().add_(levels, alpha=BUCKETS)
    # of (level, count) in the table laid out as one row
    place = start.flatten().index_select(0, bucket).int().add_(levels, alpha=counts)
    # inversion: the smallest count whose distribution function exceeds the number; most are found at once
    undecided = (chance >= distribution.flatten().index_select(0, place)).nonzero()[:, 0]
    while len(undecided):
        place[undecided] += 1
        beyond = chance[undecided] >= distribution.flatten().index_select(0, place[undecided])
        undecided = undecided[beyond]
    return place.sub_(levels, alpha=counts).float().reshape(shape)


SHOT_LEVELS = 255
FAR = 1e6


def add_gaussian_noise(images: torch.Tensor, sigma: float, draws: RandomStreams) -> torch.Tensor:
    """Add normal noise of standard deviation `sigma` to every value."""
    # in place throughout: a batch of noise is as large as the batch of images
    return draws.normal(*images.shape[1:]).mul_(sigma).add_(images)


def add_shot_noise(images: torch.Tensor, photons: float, draws: RandomStreams) -> torch.Tensor:
    """Count photons: a Poisson variable of mean `photons` × value, over `photons`; 8 bits in, as published."""
    levels = (images * SHOT_LEVELS).round_().int()
    return draw_poisson(levels, photons, SHOT_LEVELS, draws).div_(photons)


def add_impulse_noise(images: torch.Tensor, share: float, draws: RandomStreams) -> torch.Tensor:
    """Replace a `share` of the values, each channel on its own, with 0 or 1, as many of each."""
    # beyond the threshold a draw around 0 keeps its sign; far outside the range it is clipped to 0 or 1
    hits = functional.hardshrink(draws.uniform(*images.shape[1:]).sub_(0.5), 0.5 - share / 2)
    return hits.mul_(FAR).add_(images)


def add_speckle_noise(images: torch.Tensor, sigma: float, draws: RandomStreams) -> torch.Tensor:
    """Add normal noise of standard deviation `sigma` × the value itself."""
    return draws.normal(*images.shape[1:]).mul_(sigma).add_(1).mul_(images)
