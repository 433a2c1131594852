"""Batches from images that are held in memory, cut and mirrored at random."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import torch


def stack_on_device(images: np.ndarray, device: str) -> "torch.Tensor":
    """(k, s, s, 3) uint8 to a (k, 3, s, s) uint8 tensor on `device`: a batch is then cut without another copy."""
    import torch

    return torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2))).to(device)


def draw_batch(images: "torch.Tensor", rng: np.random.Generator, count: int, image_px: int) -> "torch.Tensor":
    """Random images, each cut to `image_px` at a random place and mirrored half of the time.

    Args:
        images: (k, 3, s, s) uint8 sRGB.
        rng: draws which, where and whether.
        count: how many; none comes twice where there are enough.
        image_px: side of the result, at most s.

    Returns:
        (count, 3, image_px, image_px) float32 sRGB-encoded in [0, 1].
    """
    import torch

    if count == 0:
        return torch.empty(0, 3, image_px, image_px, device=images.device)
    which = rng.choice(len(images), count, replace=count > len(images))
    corners = rng.integers(0, images.shape[-1] - image_px + 1, (count, 2))
    mirrored = rng.random(count) < 0.5
    cuts = [images[k, :, y : y + image_px, x : x + image_px] for k, (y, x) in zip(which, corners, strict=True)]
    cuts = [cut.flip(-1) if flip else cut for cut, flip in zip(cuts, mirrored, strict=True)]
    return torch.stack(cuts).float().div_(255)


def cut_centres(images: "torch.Tensor", image_px: int) -> "torch.Tensor":
    """The middle of each image, as the network's own preprocessing cuts it: float32 sRGB-encoded in [0, 1]."""
    start = round((images.shape[-1] - image_px) / 2)
    return images[:, :, start : start + image_px, start : start + image_px].float().div_(255)
