"""Light that is stronger, weaker or tinted: a factor on all linear light of a view, before the camera's tone curve."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.boosters.ranges import Range, check_range

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class Exposure:
    """What is drawn for each photograph.

    Attributes:
        factor: on the light, evenly over its logarithm.
        tint: each channel's own factor lies within 1 ± tint.
    """

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
