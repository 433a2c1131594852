"""Photographs of an object with a texture on it, differentiable in the texture: Algorithm 2, forward and backward."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from toolkit.boosters.mounted import develop, srgb_to_linear
from toolkit.rig.raycast import TexturedView

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


GRADIENTS = ("shaded", "linear")


@dataclass(frozen=True)
class ViewBatch:
    """Views as tensors; see `toolkit.rig.raycast.TexturedView` for their meaning.

    Attributes:
        still: (b, 3, h, w) linear light of all but the texture.
        pixel: (k,) int64 pixel among all b · h · w of the batch.
        uv, lod, gain: (k, 2), (k,), (k, 3) of the samples.
        share: (k,) share of its pixel that a sample stands for.
    """

    still: "torch.Tensor"
    pixel: "torch.Tensor"
    uv: "torch.Tensor"
    lod: "torch.Tensor"
    gain: "torch.Tensor"
    share: "torch.Tensor"


def batch_views(views: list[TexturedView], device: str, behind: "list[np.ndarray | None] | None" = None) -> ViewBatch:
    """Put views of one size together.

    Args:
        views: at least one.
        device: where the tensors go.
        behind: per view, (h, w, 3) float32 linear light of a photograph in place of table and room, or None.
    """
    import torch

    backs = [
        view.behind if other is None else other
        for view, other in zip(views, behind or [None] * len(views), strict=True)
    ]
    still = np.stack(
        [
            view.dark + (1 - view.coverage[..., None]) * back.astype(np.float32)
            for view, back in zip(views, backs, strict=True)
        ]
    )
    area = still.shape[1] * still.shape[2]
    parts = {
        "pixel": [view.pixel.astype(np.int64) + i * area for i, view in enumerate(views)],
        "uv": [view.uv for view in views],
        "lod": [view.lod for view in views],
        "gain": [view.gain for view in views],
        "share": [_share_pixels(view) for view in views],
    }
    arrays = {name: np.concatenate(rows) for name, rows in parts.items()}
    tensors = {
        name: torch.from_numpy(rows if name == "pixel" else rows.astype(np.float32)).to(device)
        for name, rows in arrays.items()
    }
    return ViewBatch(torch.from_numpy(still.transpose(0, 3, 1, 2)).contiguous().to(device), **tensors)


def _share_pixels(view: TexturedView) -> np.ndarray:
    """(k,) share of its pixel that each sample stands for: those of a pixel divide what the object covers of it."""
    counts = np.bincount(view.pixel, minlength=view.coverage.size)
    return view.coverage.reshape(-1)[view.pixel] / counts[view.pixel]


def show_texture(
    texture: "torch.Tensor", batch: ViewBatch, gradient: str = "shaded", light: "torch.Tensor | float" = 1.0
) -> "torch.Tensor":
    """Photographs of the objects with a texture on them.

    Both gradients give the same picture, the rig's. `shaded` differentiates that picture: texture × light, developed.
    `linear` is the seed's `x_drend - detach(x_drend) + x_rend`, where `x_drend` is the texture itself at the place
    that each pixel sees, without light.

    Args:
        texture: θ, (3, n, n) sRGB-encoded in [0, 1], dilated.
        batch: of the views.
        gradient: one of `GRADIENTS`.
        light: factor on all light, broadcast to (b, 3, 1, 1).

    Returns:
        (b, 3, h, w) sRGB-encoded in [0, 1].
    """
    import torch

    if gradient == "shaded":
        return _develop_light(srgb_to_linear(texture), batch, light)
    with torch.no_grad():
        rendered = _develop_light(srgb_to_linear(texture), batch, light)
    flat = look_up(build_levels(texture), batch.uv, batch.lod) * batch.share[:, None]
    linear = _spread(torch.zeros_like(batch.still), batch.pixel, flat)
    return linear - linear.detach() + rendered


def _develop_light(linear: "torch.Tensor", batch: ViewBatch, light: "torch.Tensor | float") -> "torch.Tensor":
    colour = look_up(build_levels(linear), batch.uv, batch.lod) * batch.gain
    return develop(_spread(batch.still, batch.pixel, colour) * light)


def _spread(picture: "torch.Tensor", pixel: "torch.Tensor", values: "torch.Tensor") -> "torch.Tensor":
    """Add (k, 3) values to the pixels of (b, 3, h, w)."""
    count, _, height, width = picture.shape
    flat = picture.permute(0, 2, 3, 1).reshape(-1, 3).index_add(0, pixel, values)
    return flat.view(count, height, width, 3).permute(0, 3, 1, 2)
