"""A random piece of a frosted pane for each image."""

from functools import lru_cache

import torch

from toolkit.corruptions.draws import Draws
from toolkit.corruptions.frost_texture import draw_panes


@lru_cache(maxsize=4)
def _panes_on(device: torch.device, scale: float) -> torch.Tensor:
    """(panes, 3, side, side) float32."""
    return torch.from_numpy(draw_panes(scale)).permute(0, 3, 1, 2).contiguous().to(device)


def cut_frost(height: int, width: int, scale: float, draws: Draws) -> list[torch.Tensor]:
    """One (3, height, width) float32 sRGB-encoded piece per image, not to be written into.

    Args:
        height: of the piece, px.
        width: of the piece, px.
        scale: of the texture: 1 for photographs, 0.2 for CIFAR's images, as published.
        draws: one stream per image: which pane, and where on it. A pane smaller than the piece repeats.
    """
    panes = _panes_on(draws.device, scale)
    pieces = []
    for which, *corner in draws.uniform(3).tolist():
        piece = panes[int(which * len(panes))]
        for axis, (start, length) in enumerate(zip(corner, (height, width), strict=True), 1):
            side = piece.shape[axis]
            if length <= side:
                piece = piece.narrow(axis, int(start * (side - length + 1)), length)
            else:
                places = torch.arange(length, device=piece.device) + int(start * side)
                piece = piece.index_select(axis, places % side)
        pieces.append(piece)
    return pieces
