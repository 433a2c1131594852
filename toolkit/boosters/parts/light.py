"""Random light: on the paper alone, or on the whole view before the camera's tone curve."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from toolkit.boosters.parts.base import Range, check_probability, check_range
from toolkit.core.errors import ToolkitError

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class LightRanges:
    """What is drawn, uniformly, for each image; mild, since the booster is to learn the class first.

    Attributes:
        exposure: factor on sRGB-encoded values.
        contrast: factor on their distance from middle grey, below 1 for print and haze.
        tint: each channel's own factor lies within 1 ± tint.
        probability: that an image's patch is lit apart from it.
    """

    stage: ClassVar = "paper"
    exposure: tuple[float, float] = (0.65, 1.2)
    contrast: tuple[float, float] = (0.75, 1.0)
    tint: float = 0.06
    probability: float = 1.0

    def __post_init__(self) -> None:
        for name, (low, high) in (("exposure", self.exposure), ("contrast", self.contrast)):
            if not 0 < low <= high:
                raise ToolkitError(f"{name} range {low:g} to {high:g}: expected two rising numbers above 0")
        if not 0 <= self.tint < 1:
            raise ToolkitError(f"tint {self.tint:g}: expected at least 0 and less than 1")
        check_probability("light", self.probability)

    def light(self, paper: "torch.Tensor", mask: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Light a drawn patch.

        Args:
            paper: (b, 3, m, m), sRGB-encoded, already multiplied by the mask.
            mask: (b, 1, m, m), the share of each pixel that the patch covers.
            rng: draws one light per image.

        Returns:
            As `paper`, values may leave [0, 1].
        """
        import torch

        count = len(paper)
        gain = rng.uniform(*self.exposure, (count, 1)) * rng.uniform(1 - self.tint, 1 + self.tint, (count, 3))
        contrast = rng.uniform(*self.contrast, (count, 1))
        acting = rng.random((count, 1)) < self.probability
        slope = np.where(acting, gain * contrast, 1)
        offset = np.where(acting, gain * (1 - contrast) / 2, 0)
        slope_offset = torch.as_tensor(np.stack([slope, offset]), dtype=paper.dtype, device=paper.device)
        return paper * slope_offset[0, :, :, None, None] + mask * slope_offset[1, :, :, None, None]


@dataclass(frozen=True)
class Exposure:
    """What is drawn for each photograph.

    Attributes:
        factor: on the light, evenly over its logarithm.
        tint: each channel's own factor lies within 1 ± tint.
    """

    stage: ClassVar = "light"
    drawn_as: ClassVar = "exposure"
    factor: Range = (0.6, 1.5)
    tint: float = 0.05

    def __post_init__(self) -> None:
        check_range("exposure", self.factor, 0.05, 20)
        check_range("tint", (0, self.tint), 0, 0.9)

    def draw(self, rng: np.random.Generator, count: int, like: "torch.Tensor") -> "torch.Tensor":
        """(count, 3, 1, 1) factors, of `like`'s type and device."""
        import torch

        low, high = np.log(self.factor)
        factor = np.exp(rng.uniform(low, high, (count, 1, 1, 1)))
        tint = rng.uniform(1 - self.tint, 1 + self.tint, (count, 3, 1, 1))
        return torch.as_tensor(factor * tint, dtype=like.dtype, device=like.device)
