"""The photograph saved as JPEG: 4:2:0 chroma, the standard tables, and a gradient that passes through the rounding.

Source: ITU-T T.81 (1992), annex K.1 for the tables; their scaling by quality is the Independent JPEG Group's, as in
Pillow. Forward, coefficients are rounded as a camera rounds them; backward, rounding counts as the identity ("straight
through"; Bengio et al. 2013), since its true gradient is zero everywhere.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from toolkit.boosters.parts.base import change_some, check_probability, check_range, count_images

if TYPE_CHECKING:
    import torch

LUMA = np.array([
    [16, 11, 10, 16, 24, 40, 51, 61], [12, 12, 14, 19, 26, 58, 60, 55], [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62], [18, 22, 37, 56, 68, 109, 103, 77], [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101], [72, 92, 95, 98, 112, 100, 103, 99],
])  # fmt: skip
CHROMA = np.full((8, 8), 99)
CHROMA[:4, :4] = [[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]]
YCC_FROM_RGB = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])
MIDDLE = 128.0
"""Taken off luma before it is transformed; chroma is about 0 already."""


@dataclass(frozen=True)
class JpegFile:
    """What is drawn, uniformly, for each photograph.

    Attributes:
        quality: lowest and highest, whole numbers on the IJG's scale; messengers and web pages use about 60 to 85.
        probability: that a photograph is saved so.
    """

    stage: ClassVar = "photo"
    quality: tuple[int, int] = (40, 95)
    probability: float = 0.3

    def __post_init__(self) -> None:
        check_range("JPEG quality", self.quality, 1, 100)
        check_probability("JPEG", self.probability)

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Save and read again some of (b, 3, h, w) sRGB-encoded photographs; differentiable."""
        count = count_images(pixels)
        acting = rng.random(count) < self.probability
        quality = rng.integers(int(self.quality[0]), int(self.quality[1]) + 1, count)
        return change_some(pixels, acting, lambda some, which: compress(some, quality[which]))


def round_straight(values: "torch.Tensor") -> "torch.Tensor":
    """Round; the gradient is the identity's."""
    import torch

    class Round(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, exact: torch.Tensor) -> torch.Tensor:
            return exact.round()

        @staticmethod
        def backward(ctx: Any, *gradients: torch.Tensor) -> torch.Tensor:
            return gradients[0]

    return Round.apply(values)


def compress(
    pixels: "torch.Tensor",
    quality: np.ndarray,
    rounding: Callable[["torch.Tensor"], "torch.Tensor"] = round_straight,
) -> "torch.Tensor":
    """What (b, 3, h, w) sRGB-encoded pixels in [0, 1] become in JPEG files of the qualities (b,); within [0, 1]."""
    import torch
    from torch.nn.functional import avg_pool2d, interpolate, pad

    h, w = pixels.shape[-2:]
    full = pad(pixels, (0, -w % 16, 0, -h % 16), mode="replicate")
    to_ycc, from_ycc = (
        torch.as_tensor(matrix, dtype=pixels.dtype, device=pixels.device)
        for matrix in (YCC_FROM_RGB * 255, np.linalg.inv(YCC_FROM_RGB) / 255)
    )
    ycc = (to_ycc @ full.flatten(2)).view(full.shape)
    luma = _code_blocks(ycc[:, :1], quantise_tables(LUMA, quality), MIDDLE, rounding)
    chroma = _code_blocks(avg_pool2d(ycc[:, 1:], 2), quantise_tables(CHROMA, quality), 0, rounding)
    chroma = interpolate(chroma, scale_factor=2, mode="bilinear", align_corners=False)  # libjpeg's "fancy upsampling"
    decoded = from_ycc @ (torch.cat([luma, chroma], 1).flatten(2))
    return decoded.view(full.shape)[..., :h, :w].clamp(0, 1)


def quantise_tables(table: np.ndarray, quality: np.ndarray) -> np.ndarray:
    """(b, 64) steps between coefficients, the table scaled as the IJG scales it."""
    quality = np.asarray(quality)
    percent = np.where(quality < 50, 5000 // quality.clip(1), 200 - 2 * quality)
    return ((table.reshape(1, 64) * percent[:, None] + 50) // 100).clip(1, 255).astype(float)


@lru_cache(maxsize=1)
def _cosines() -> np.ndarray:
    """(64, 64) the two-dimensional DCT of a block of 8 × 8 as one orthonormal matrix."""
    frequency, place = np.mgrid[:8, :8]
    rows = np.cos((2 * place + 1) * frequency * np.pi / 16) / 2
    rows[0] /= np.sqrt(2)
    return np.kron(rows, rows)


def _code_blocks(planes: "torch.Tensor", steps: np.ndarray, middle: float, rounding: Callable) -> "torch.Tensor":
    """Transform, divide, round, multiply, transform back; one matrix product each way holds all but the rounding."""
    import torch

    def place(matrix: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(matrix, dtype=planes.dtype, device=planes.device)

    b, c, h, w = planes.shape
    forward, back = _cosines().T[None] / steps[:, None, :], _cosines()[None] * steps[:, :, None]
    shift = np.full((b, 1, 64), -middle) @ forward
    blocks = planes.reshape(b, c, h // 8, 8, w // 8, 8).transpose(3, 4).reshape(b, -1, 64)
    coefficients = rounding(torch.baddbmm(place(shift), blocks, place(forward)))
    decoded = torch.baddbmm(place(np.full((b, 1, 64), middle)), coefficients, place(back))
    return decoded.view(b, c, h // 8, w // 8, 8, 8).transpose(3, 4).reshape(b, c, h, w)
