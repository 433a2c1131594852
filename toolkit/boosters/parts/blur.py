"""The photograph out of focus, and shaken: a Gaussian drawn out along a short line."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from toolkit.boosters.parts.base import Range, change_some, check_probability, check_range, count_images

if TYPE_CHECKING:
    import torch


LEAST_DEFOCUS_PX = 0.05
"""So little changes no pixel; none at all has no closed form."""


@dataclass(frozen=True)
class CameraBlur:
    """What is drawn, uniformly, for each photograph; pixels are those that the network sees.

    A telephone's photograph of 12 megapixels is sampled down tenfold on its way to 224 pixels: what is left of focus
    and shake is about a pixel.

    Attributes:
        defocus_px: standard deviation of the Gaussian.
        motion_px: how far the image moved while the shutter was open, in any direction.
        probability: that a photograph is blurred.
    """

    stage: ClassVar = "photo"
    defocus_px: Range = (0.3, 1.0)
    motion_px: Range = (0.0, 2.5)
    probability: float = 0.3

    def __post_init__(self) -> None:
        check_range("defocus", self.defocus_px, LEAST_DEFOCUS_PX, 8)
        check_range("motion", self.motion_px, 0, 16)
        check_probability("blur", self.probability)

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Blur some of (b, 3, h, w) sRGB-encoded photographs; differentiable."""
        count = count_images(pixels)
        acting = rng.random(count) < self.probability
        sigma, length = rng.uniform(*self.defocus_px, count), rng.uniform(*self.motion_px, count)
        angle = rng.uniform(0, np.pi, count)
        return change_some(
            pixels, acting, lambda some, which: blur(some, make_kernels(sigma[which], length[which], angle[which]))
        )


def make_kernels(sigma_px: np.ndarray, length_px: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(k, s, s) kernels that sum to 1: a Gaussian convolved with a line, in closed form at the pixel centres.

    Args:
        sigma_px: (k,) of the Gaussian.
        length_px: (k,) of the line; 0 leaves the Gaussian alone.
        angle: (k,) of the line, radians from x (right) towards y (down).
    """
    from scipy.special import ndtr

    reach = int(np.ceil((3 * sigma_px + length_px / 2).max()))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1][:, None].astype(float)
    sigma, half = sigma_px[:, None, None], length_px[:, None, None] / 2
    cosine, sine = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    along, across = x * cosine + y * sine, y * cosine - x * sine
    line = ndtr((along + half) / sigma) - ndtr((along - half) / sigma)
    kernels = np.exp(-((across / sigma) ** 2) / 2) * np.where(half < 1e-3, np.exp(-((along / sigma) ** 2) / 2), line)
    return kernels / kernels.sum(axis=(1, 2), keepdims=True)


def blur(pixels: "torch.Tensor", kernels: np.ndarray) -> "torch.Tensor":
    """Convolve each of (b, 3, h, w) with its own kernel of (b, s, s); the edges repeat."""
    import torch
    from torch.nn.functional import conv2d, pad

    b, c, h, w = pixels.shape
    reach = kernels.shape[-1] // 2
    weight = torch.as_tensor(kernels[:, ::-1, ::-1].copy(), dtype=pixels.dtype, device=pixels.device)
    weight = weight[:, None].repeat_interleave(c, 0)
    padded = pad(pixels, (reach, reach, reach, reach), mode="replicate").reshape(1, b * c, h + 2 * reach, w + 2 * reach)
    return conv2d(padded, weight, groups=b * c).reshape(b, c, h, w)
