"""Fog in front of the camera: ImageNet-C's, of any strength, and differentiable."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from toolkit.boosters.parts.base import Range, change_some, check_probability, check_range, count_images

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class Fog:
    """What is drawn, uniformly, for each photograph; see `toolkit.corruptions.weather.add_fog`.

    Attributes:
        strength: of the clouds, in units of the image's full range; ImageNet-C's severities 1 to 5 have 1.5 to 3.
        smoothness: how fast the clouds' detail fades; ImageNet-C's have 2 to 1.4.
        probability: that a photograph is foggy.
    """

    stage: ClassVar = "photo"
    strength: Range = (0.5, 3.0)
    smoothness: Range = (1.4, 2.0)
    probability: float = 0.3

    def __post_init__(self) -> None:
        check_range("fog", self.strength, 0, 5)
        check_range("fog's smoothness", self.smoothness, 1.1, 4)
        check_probability("fog", self.probability)

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Lay fog over some of (b, 3, h, w) sRGB-encoded photographs, within [0, 1]; differentiable."""
        import torch

        from toolkit.corruptions.draws import RandomStreams
        from toolkit.corruptions.weather import add_fog

        count = count_images(pixels)
        acting = rng.random(count) < self.probability
        strength, smoothness = rng.uniform(*self.strength, count), rng.uniform(*self.smoothness, count)
        seeds = rng.integers(1 << 62, size=count)

        def cover(some: torch.Tensor, which: np.ndarray) -> torch.Tensor:
            foggy = [
                add_fog(
                    photo[None], (strength[k], smoothness[k]), RandomStreams([int(seeds[k])], "fog", 0, photo.device)
                )
                for photo, k in zip(some, which, strict=True)
            ]
            return torch.cat(foggy).clamp(0, 1)

        return change_some(pixels, acting, cover)
