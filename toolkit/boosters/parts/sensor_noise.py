"""Noise of the camera's sensor: photons are counted (shot noise), and the counter itself is unsteady (read noise)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from toolkit.boosters.parts.base import Range, as_factors, change_some, check_probability, check_range, count_images

if TYPE_CHECKING:
    import torch

DARKEST = 0.1
"""Encoded value below which sRGB's curve is near to straight, so that read noise grows no further."""


@dataclass(frozen=True)
class SensorNoise:
    """What is drawn, uniformly, for each photograph.

    In linear light L the variance is shot² L + read². sRGB's curve is close to a square root, whose slope at the
    encoded value v is 1 / 2v, so that the standard deviation of v is ½ √(shot² + read² / v²): nearly the same from the
    shadows to the lights, as in a photograph. The gradient takes it as given: a patch gains nothing by quieter grain.

    Attributes:
        shot: standard deviation of white, linear; 0.02 is 2500 photoelectrons per pixel of the network's image.
        read: standard deviation of black, linear.
        probability: that a photograph has noise.
    """

    stage: ClassVar = "photo"
    shot: Range = (0.005, 0.04)
    read: Range = (0.0, 0.006)
    probability: float = 0.3

    def __post_init__(self) -> None:
        check_range("shot noise", self.shot, 0, 0.5)
        check_range("read noise", self.read, 0, 0.2)
        check_probability("noise", self.probability)

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Add noise to some of (b, 3, h, w) sRGB-encoded photographs, within [0, 1]; differentiable."""
        import torch

        count = count_images(pixels)
        acting = rng.random(count) < self.probability
        shot, read = rng.uniform(*self.shot, count), rng.uniform(*self.read, count)
        generator = torch.Generator(pixels.device).manual_seed(int(rng.integers(1 << 62)))

        def add(some: torch.Tensor, which: np.ndarray) -> torch.Tensor:
            grain = torch.randn(some.shape, generator=generator, dtype=some.dtype, device=some.device)
            deviation = some.detach().clamp_min(DARKEST).reciprocal_().mul_(as_factors(read[which] / 2, some)).square_()
            deviation.add_(as_factors(shot[which] ** 2 / 4, some)).sqrt_()
            return (some + grain.mul_(deviation)).clamp(0, 1)

        return change_some(pixels, acting, add)
