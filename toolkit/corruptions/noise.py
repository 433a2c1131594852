"""Noise: Gaussian, shot, impulse and speckle."""

import torch
from torch.nn import functional

from toolkit.corruptions.draws import Draws
from toolkit.corruptions.poisson import draw_poisson

SHOT_LEVELS = 255
FAR = 1e6


def add_gaussian_noise(images: torch.Tensor, sigma: float, draws: Draws) -> torch.Tensor:
    """Add normal noise of standard deviation `sigma` to every value."""
    return draws.normal(*images.shape[1:]).mul_(sigma).add_(images)


def add_shot_noise(images: torch.Tensor, photons: float, draws: Draws) -> torch.Tensor:
    """Count photons: a Poisson variable of mean `photons` × value, over `photons`; 8 bits in, as published."""
    levels = (images * SHOT_LEVELS).round_().int()
    return draw_poisson(levels, photons, SHOT_LEVELS, draws).div_(photons)


def add_impulse_noise(images: torch.Tensor, share: float, draws: Draws) -> torch.Tensor:
    """Replace a `share` of the values, each channel on its own, with 0 or 1, as many of each."""
    # beyond the threshold a draw, centred on nought, keeps its sign; far beyond the range it is cut off at 0 or 1
    hits = functional.hardshrink(draws.uniform(*images.shape[1:]).sub_(0.5), 0.5 - share / 2)
    return hits.mul_(FAR).add_(images)


def add_speckle_noise(images: torch.Tensor, sigma: float, draws: Draws) -> torch.Tensor:
    """Add normal noise of standard deviation `sigma` × the value itself."""
    return draws.normal(*images.shape[1:]).mul_(sigma).add_(1).mul_(images)
