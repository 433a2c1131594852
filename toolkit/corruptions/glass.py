"""Pixels moved about, as seen through frosted glass."""

import torch

from toolkit.corruptions.draws import Draws


def shuffle_near(images: torch.Tensor, reach_px: int, rounds: int, draws: Draws) -> torch.Tensor:
    """Take every pixel of (b, c, h, w) from a random place nearby, row by row from the bottom right.

    The published images come from a loop that goes from the bottom right to the top left and means to swap each pixel
    with a neighbour at an offset drawn from -reach … reach - 1 in both axes. Both sides of its swap are views of one
    array, so that only the first half happens: the pixel becomes a copy of the neighbour as it is at that moment. That
    is what is done here, for all pixels at once, by following each copy back to the pixel that it came from.
    """
    height, width = images.shape[-2:]
    flat = images.flatten(2)
    for _ in range(rounds):
        origin = trace_copies(draw_neighbours(height, width, reach_px, draws), height, width, reach_px)
        flat = flat.gather(2, origin[:, None].expand_as(flat))
    return flat.reshape(images.shape)


def draw_neighbours(height: int, width: int, reach_px: int, draws: Draws) -> torch.Tensor:
    """(b, h × w) int64: the pixel that each one copies; those near the border copy themselves."""
    side = 2 * reach_px
    pick = (draws.uniform(height * width) * side**2).long()
    down, across = pick // side - reach_px, pick % side - reach_px
    own = torch.arange(height * width, device=pick.device)
    return torch.where(_may_move(height, width, reach_px).to(pick.device), own + down * width + across, own)


def trace_copies(neighbours: torch.Tensor, height: int, width: int, reach_px: int) -> torch.Tensor:
    """(b, h × w) int64: where each pixel's value was before the round, given which pixel it copies.

    A pixel that copies one which the loop has passed, and so changed, holds what that one has copied, and so on. Every
    step of this search goes twice as far as the one before.
    """
    own = torch.arange(height * width, device=neighbours.device)
    passed = _may_move(height, width, reach_px).to(neighbours.device)[neighbours] & (neighbours > own)
    origin = neighbours
    while passed.any():
        further = origin.gather(1, origin)
        origin, passed = torch.where(passed, further, origin), passed & passed.gather(1, origin)
    return origin


def _may_move(height: int, width: int, reach_px: int) -> torch.Tensor:
    """(h × w,) bool: the pixels that the published loop visits."""
    inside = torch.zeros(height, width, dtype=torch.bool)
    inside[reach_px + 1 : height - reach_px + 1, reach_px + 1 : width - reach_px + 1] = True
    return inside.flatten()
