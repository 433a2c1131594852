"""A camera that is not held still: each network sees the photograph a little larger or smaller, and moved."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from toolkit.boosters.parts.base import Range, change_some, check_probability, check_range, count_images

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class Jitter:
    """What is drawn, uniformly, for each photograph and each network that looks at it.

    Diverse inputs (DI; Xie et al. 2019, section 3.2) resize and pad; here what leaves the frame is cut, and what comes
    in repeats the edge.

    Attributes:
        scale: factor on the size of what is seen.
        shift: to either side, share of the photograph's side.
        probability: that a photograph is changed.
    """

    stage: ClassVar = "network"
    scale: Range = (0.8, 1.15)
    shift: float = 0.08
    probability: float = 0.7

    def __post_init__(self) -> None:
        check_range("jitter's scale", self.scale, 0.25, 4)
        check_range("jitter's shift", (0, self.shift), 0, 0.5)
        check_probability("jitter", self.probability)

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Resize and move some of (b, 3, h, w) photographs by bilinear look-up; differentiable."""
        count = count_images(pixels)
        acting = rng.random(count) < self.probability
        scale, shift = rng.uniform(*self.scale, count), rng.uniform(-self.shift, self.shift, (count, 2))
        return change_some(pixels, acting, lambda some, which: _zoom(some, scale[which], shift[which]))


def _zoom(photos: "torch.Tensor", scale: np.ndarray, shift: np.ndarray) -> "torch.Tensor":
    """(k, 3, h, w) about the middle by (k,) `scale`, then right and down by (k, 2) `shift` shares of the side."""
    import torch
    from torch.nn.functional import affine_grid, grid_sample

    T_from_to = np.zeros((len(photos), 2, 3))
    T_from_to[:, 0, 0] = T_from_to[:, 1, 1] = 1 / scale
    T_from_to[:, :, 2] = -2 * shift / scale[:, None]
    matrices = torch.as_tensor(T_from_to, dtype=photos.dtype, device=photos.device)
    grid = affine_grid(matrices, list(photos.shape), align_corners=False)
    return grid_sample(photos, grid, mode="bilinear", padding_mode="border", align_corners=False)
