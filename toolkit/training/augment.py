"""What a camera varies, and corruptions for a share of each batch, on batches of tensors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from toolkit.core.config import Config, Expect, Flag

if TYPE_CHECKING:
    import torch

GREY_WEIGHTS = (0.299, 0.587, 0.114)


@dataclass(frozen=True)
class Augmentation:
    """Ranges, lowest and highest, and shares; each image draws its own.

    Attributes:
        crop: side of the square that is cut out, as a share of the stored image's.
        stretch: of the crop's width against its height, 1 ± this.
        shift: how far the crop may leave the image, as a share of its side; what is missing is mirrored in.
        brightness, contrast, saturation: factors.
        tint: factor of each colour channel, 1 ± this.
        blur_share, blur_sigma: how many are blurred, and by how much, as a share of the image's side.
        noise_sigma: of Gaussian noise, on values in [0, 1].
    """

    crop: tuple[float, float] = (0.55, 1.0)
    stretch: float = 0.12
    shift: float = 0.04
    brightness: tuple[float, float] = (0.6, 1.4)
    contrast: tuple[float, float] = (0.7, 1.3)
    saturation: tuple[float, float] = (0.6, 1.4)
    tint: float = 0.12
    blur_share: float = 0.25
    blur_sigma: tuple[float, float] = (0.002, 0.014)
    noise_sigma: tuple[float, float] = (0.0, 0.04)


PHOTOGRAPHS = Augmentation()
SMALL_IMAGES = Augmentation(
    crop=(0.8, 1.0), stretch=0.0, shift=0.1, brightness=(0.8, 1.2), contrast=(0.8, 1.2), saturation=(0.8, 1.2),
    tint=0.05, blur_share=0.0, noise_sigma=(0.0, 0.02),
)  # fmt: skip
"""For images of a few dozen pixels, in which every pixel counts."""


def augment_batch(
    images: "torch.Tensor", rng: np.random.Generator, image_px: int, how: Augmentation,
    overlay: Callable[["torch.Tensor"], "torch.Tensor"] = lambda batch: batch,
) -> "torch.Tensor":  # fmt: skip
    """(b, 3, s, s) uint8 sRGB to (b, 3, image_px, image_px) float32, sRGB-encoded in [0, 1], varied at random.

    What `overlay` puts on the framed images is seen by the same camera: it has their colours, focus and noise.
    """
    batch = overlay(_cut(images.float().div_(255), rng, image_px, how))
    batch = _colour(batch, rng, how)
    batch = _blur(batch, rng, how)
    return _add_noise(batch, rng, how).clamp_(0, 1)


def _draw(rng: np.random.Generator, low_high: tuple[float, float], like: "torch.Tensor") -> "torch.Tensor":
    """(b, 1, 1, 1) uniform numbers, one for each image of a batch."""
    import torch

    return torch.from_numpy(rng.uniform(*low_high, (len(like), 1, 1, 1)).astype(np.float32)).to(like.device)


def _cut(batch: "torch.Tensor", rng: np.random.Generator, image_px: int, how: Augmentation) -> "torch.Tensor":
    import torch
    from torch.nn.functional import affine_grid, grid_sample

    count = len(batch)
    side = rng.uniform(*how.crop, (count, 1)) * (1 + rng.uniform(-how.stretch, how.stretch, (count, 2)))
    side = side.clip(0, how.crop[1])
    middle = rng.uniform(-1, 1, (count, 2)) * (1 - side + 2 * how.shift)
    mirror = np.where(rng.random((count, 1)) < 0.5, -1.0, 1.0)
    theta = np.zeros((count, 2, 3), np.float32)
    theta[:, 0, 0], theta[:, 1, 1], theta[:, :, 2] = side[:, 0] * mirror[:, 0], side[:, 1], middle
    grid = affine_grid(torch.from_numpy(theta).to(batch.device), [count, 3, image_px, image_px], align_corners=False)
    return grid_sample(batch, grid, "bilinear", "reflection", align_corners=False)


def _colour(batch: "torch.Tensor", rng: np.random.Generator, how: Augmentation) -> "torch.Tensor":
    import torch

    weights = torch.tensor(GREY_WEIGHTS, device=batch.device).view(1, 3, 1, 1)
    grey = (batch * weights).sum(1, keepdim=True)
    batch = grey + (batch - grey) * _draw(rng, how.saturation, batch)
    mean = grey.mean((2, 3), keepdim=True)
    batch = mean + (batch - mean) * _draw(rng, how.contrast, batch)
    tint = 1 + rng.uniform(-how.tint, how.tint, (len(batch), 3, 1, 1)).astype(np.float32)
    return batch * (_draw(rng, how.brightness, batch) * torch.from_numpy(tint).to(batch.device))


def _blur(batch: "torch.Tensor", rng: np.random.Generator, how: Augmentation) -> "torch.Tensor":
    """One sigma for all that are blurred: a convolution each would cost more than the network's first layer."""
    import torch
    from torchvision.transforms.functional import gaussian_blur

    chosen = np.flatnonzero(rng.random(len(batch)) < how.blur_share)
    sigma = float(rng.uniform(*how.blur_sigma)) * batch.shape[-1]
    if len(chosen):
        reach = min(int(np.ceil(3 * sigma)), batch.shape[-1] - 1)
        which = torch.from_numpy(chosen).to(batch.device)
        batch[which] = gaussian_blur(batch[which], [2 * reach + 1, 2 * reach + 1], [sigma, sigma])
    return batch


def _add_noise(batch: "torch.Tensor", rng: np.random.Generator, how: Augmentation) -> "torch.Tensor":
    import torch

    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    noise = torch.randn(batch.shape, generator=generator).to(batch.device)
    return batch + noise * _draw(rng, how.noise_sigma, batch)


class Corrupting(Config):
    """What is done to which share; each image draws one of the corruptions, which are (name, severity)."""

    corruptions: Annotated[tuple[tuple[str, int], ...], Field(min_length=1)]
    share: Annotated[
        float, Field(gt=0, le=1), Expect("a share above 0 and at most 1, such as 0.5"), Flag("--corrupt-share")
    ] = Field(0.5, description="Which share of them.")


def corrupt_some(batch: "torch.Tensor", rng: np.random.Generator, how: Corrupting) -> "torch.Tensor":
    """(b, 3, s, s) float32 sRGB-encoded in [0, 1], a share of it corrupted; the batch is changed."""
    import torch

    from toolkit.corruptions.batch import corrupt, draw_corrupted

    for chosen, name, severity, seeds in draw_corrupted(rng, len(batch), how.corruptions, how.share):
        which = torch.from_numpy(chosen).to(batch.device)
        batch[which] = corrupt(batch[which], name, severity, seeds)
    return batch
