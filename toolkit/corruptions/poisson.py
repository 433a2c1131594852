"""Poisson variables for the few means that an 8-bit image has: the distribution function inverted by table."""

from functools import lru_cache

import numpy as np
import torch
from scipy.special import pdtr

from toolkit.corruptions.draws import Draws

BUCKETS = 4096
TAIL_SIGMAS = 10


@lru_cache(maxsize=10)
def _tables(scale: float, levels: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Distribution function (levels + 1, k) float32, and the smallest count (levels + 1, BUCKETS) in each bucket."""
    means = np.arange(levels + 1) * (scale / levels)
    counts = np.arange(int(scale + TAIL_SIGMAS * np.sqrt(scale) + TAIL_SIGMAS))
    distribution = pdtr(counts, means[:, None]).astype(np.float32)
    distribution[:, -1] = 2.0  # no uniform number reaches it: the search ends here
    edges = np.arange(BUCKETS, dtype=np.float32) / BUCKETS
    start = np.stack([np.searchsorted(row, edges, side="right") for row in distribution])
    return torch.from_numpy(distribution), torch.from_numpy(start.astype(np.int16))


def draw_poisson(levels: torch.Tensor, scale: float, top: int, draws: Draws) -> torch.Tensor:
    """A Poisson count for every entry, exact to the 24 bits of the uniform numbers behind it.

    Each uniform number falls into a bucket, whose smallest possible count is looked up; few have to go on from there.

    Args:
        levels: (b, ...) int32 in 0 … `top`.
        scale: mean at level `top`; the mean at level v is v × `scale` / `top`.
        top: the highest level.
        draws: one stream per image.

    Returns:
        (b, ...) float32 whole numbers.
    """
    distribution, start = (table.to(levels.device) for table in _tables(scale, top))
    counts = distribution.shape[1]
    shape, chance, levels = levels.shape, draws.uniform(*levels.shape[1:]).flatten(), levels.flatten()
    bucket = (chance * BUCKETS).int().add_(levels, alpha=BUCKETS)
    # of (level, count) in the table laid out as one row
    place = start.flatten().index_select(0, bucket).int().add_(levels, alpha=counts)
    undecided = (chance >= distribution.flatten().index_select(0, place)).nonzero()[:, 0]
    while len(undecided):
        place[undecided] += 1
        beyond = chance[undecided] >= distribution.flatten().index_select(0, place[undecided])
        undecided = undecided[beyond]
    return place.sub_(levels, alpha=counts).float().reshape(shape)
