"""`toolkit.rig.textures`, differentiable: a pyramid of averages, linear between texels and between levels."""

from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    import torch

SMALLEST = 4
"""Side of the coarsest level."""


def build_levels(linear: "torch.Tensor") -> list["torch.Tensor"]:
    """Halve (3, n, n) by area average until a side is 4; level 0 is the input, as `build_pyramid` does."""
    import torch

    levels = [linear]
    while levels[-1].shape[-1] > SMALLEST:
        halve = torch.from_numpy(_halving(levels[-1].shape[-1])).to(linear)
        levels.append(halve @ levels[-1] @ halve.T)
    return levels


def look_up(levels: list["torch.Tensor"], uv: "torch.Tensor", lod: "torch.Tensor") -> "torch.Tensor":
    """Trilinear colours (k, 3) at (k, 2) places, u right and v up; the texture repeats outside [0, 1].

    Args:
        levels: of `build_levels`.
        uv: places.
        lod: (k,) base-2 logarithm of level-0 texels per pixel.
    """
    lod = lod.clamp(0, len(levels) - 1)
    found = levels[0].new_zeros((len(uv), 3))
    for number, level in enumerate(levels):
        weight = (1 - (lod - number).abs()).clamp_min(0)
        chosen = weight.nonzero()[:, 0]
        if len(chosen):
            found = found.index_add(0, chosen, _look_up_level(level, uv[chosen]) * weight[chosen, None])
    return found


def _look_up_level(level: "torch.Tensor", uv: "torch.Tensor") -> "torch.Tensor":
    from torch.nn.functional import grid_sample, pad

    side = level.shape[-1]
    wrapped = pad(level[None], (1, 1, 1, 1), mode="circular")
    u, v = uv[:, 0] - uv[:, 0].floor(), uv[:, 1] - uv[:, 1].floor()
    inner = side / (side + 2)  # the ring of repeated texels makes the picture a little larger
    grid = uv.new_empty((1, 1, len(uv), 2))
    grid[0, 0, :, 0], grid[0, 0, :, 1] = (u * 2 - 1) * inner, (1 - v * 2) * inner
    return grid_sample(wrapped, grid, mode="bilinear", align_corners=False)[0, :, 0].T


@lru_cache(maxsize=32)
def _halving(side: int) -> np.ndarray:
    """(side // 2, side) weights of OpenCV's area average, which also serve odd sides."""
    return cv2.resize(np.eye(side, dtype=np.float32), (side, side // 2), interpolation=cv2.INTER_AREA)
