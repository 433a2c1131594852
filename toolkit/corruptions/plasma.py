"""Clouds by the diamond-square algorithm, on a square that repeats."""

import torch

from toolkit.corruptions.draws import Draws

FIRST_WIBBLE = 100.0


def draw_clouds(side_px: int, decay: float, draws: Draws) -> torch.Tensor:
    """(b, side, side) float32 in [0, 1], 0 and 1 both reached.

    Points half-way between known ones get their mean and a uniform random shift, whose bound falls with every halving.
    The published code multiplies its bound by itself, so that the shift falls with the square of `decay`; so it does
    here.

    Args:
        side_px: a power of two.
        decay: larger is smoother.
        draws: one stream per image.
    """
    shifts = draws.uniform(side_px**2 - 1).mul_(2).sub_(1)
    clouds = torch.zeros(len(shifts), side_px, side_px, device=shifts.device)
    step, bound, used = side_px, FIRST_WIBBLE**2, 0

    def settle(total: torch.Tensor) -> torch.Tensor:
        nonlocal used
        count = total.shape[1] ** 2
        shift = shifts[:, used : used + count].reshape(total.shape)
        used += count
        return total / 4 + bound * shift

    while step >= 2:
        half = step // 2
        corners = clouds[:, ::step, ::step]
        pairs = corners + corners.roll(-1, 1)
        middles = settle(pairs + pairs.roll(-1, 2))
        clouds[:, half::step, half::step] = middles
        clouds[:, ::step, half::step] = settle(middles + middles.roll(1, 1) + corners + corners.roll(-1, 2))
        clouds[:, half::step, ::step] = settle(middles + middles.roll(1, 2) + corners + corners.roll(-1, 1))
        step, bound = half, bound / decay**2
    low = clouds.amin((1, 2), keepdim=True)
    return (clouds - low) / (clouds.amax((1, 2), keepdim=True) - low)
