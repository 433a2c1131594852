"""What makes a booster carry over to other networks: parts of it hidden, photographs in blocks."""

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from toolkit.boosters.transforms.base import ImageTransform, Probability

if TYPE_CHECKING:
    import numpy as np
    import torch

GREY = 0.5
OVERHANG = 0.05
"""How far outside the patch the middle of a hidden square may lie, share of its side."""


class Cutout(ImageTransform):
    """A square of the patch hidden by grey, so that no part of it alone has to be seen.

    Patch cutout of T-SEA (Huang et al. 2023, section 3.3), with the size, the grey and the probability of its release;
    the square's middle lies anywhere in the patch.

    Attributes:
        share: side of the square against the patch's.
        probability: that a step hides one.
    """

    stage = "print"
    share: Annotated[float, Field(gt=0, le=1)] = 0.4
    probability: Probability = 0.9

    def draw(self, rng: "np.random.Generator", count: int) -> tuple["np.ndarray", ...]:
        """(count, 2) middle of the square, right and down, shares of the side."""
        return (rng.uniform(-OVERHANG, 1 + OVERHANG, (count, 2)),)

    def apply(self, some: "torch.Tensor", drawn: tuple["np.ndarray", ...]) -> "torch.Tensor":
        """Hide it; texels are hidden by their middles."""
        import numpy as np
        import torch

        n = some.shape[-1]
        away = np.abs((np.arange(n) + 0.5) / n - drawn[0][:, :, None]) < self.share / 2
        hidden = torch.as_tensor(away[:, 0, None, None, :] & away[:, 1, None, :, None], device=some.device)
        return some.masked_fill(hidden, GREY)


class BlockShuffle(ImageTransform):
    """The photograph cut into blocks, which are shuffled and turned: the object's parts leave their places.

    Block shuffle and rotation (BSR; Wang et al. 2024, section 3.2): blocks of random sizes, each turned about its
    middle by an angle of its own; what turns in is black. As in its release, the photograph is cut into strips, along
    either axis, and each strip into blocks.

    Attributes:
        blocks: along each axis.
        max_angle_deg: to either side.
        probability: that a photograph is cut.
    """

    stage = "network"
    blocks: Annotated[int, Field(ge=1, le=8)] = 2
    max_angle_deg: Annotated[float, Field(ge=0, le=180)] = 24.0
    probability: Probability = 0.5

    def draw(self, rng: "np.random.Generator", count: int) -> tuple["np.ndarray", ...]:
        """Axis of the strips; sizes and order of strips and of the blocks in each; angles."""
        import numpy as np

        n = self.blocks
        sizes = rng.uniform(size=(count, 1 + n, n))
        orders = rng.permuted(np.tile(np.arange(n), (count, 1 + n, 1)), axis=2)
        angles = rng.uniform(-self.max_angle_deg, self.max_angle_deg, (count, n, n))
        return rng.integers(2, size=count), sizes, orders, angles

    def apply(self, some: "torch.Tensor", drawn: tuple["np.ndarray", ...]) -> "torch.Tensor":
        """Cut, turn, shuffle, and join."""
        import torch

        return torch.stack([_shuffle(photo, *one) for photo, *one in zip(some, *drawn, strict=True)])


def _shuffle(
    photo: "torch.Tensor", axis: int, sizes: "np.ndarray", orders: "np.ndarray", angles: "np.ndarray"
) -> "torch.Tensor":
    """(3, h, w) with its strips along `axis` (0: down, 1: right), and the blocks of each, in other places."""
    import torch
    from torchvision.transforms.functional import InterpolationMode, rotate

    along, across = 1 + int(axis), 2 - int(axis)
    strips = photo.split(divide(photo.shape[along], sizes[0]), along)
    joined = []
    for k in orders[0]:
        blocks = strips[k].split(divide(photo.shape[across], sizes[1 + k]), across)
        turned = [
            rotate(block, float(angle), InterpolationMode.BILINEAR) if block.numel() else block
            for block, angle in zip(blocks, angles[k], strict=True)
        ]
        joined.append(torch.cat([turned[j] for j in orders[1 + k]], across))
    return torch.cat(joined, along)


def divide(length: int, sizes: "np.ndarray") -> list[int]:
    """A length in whole parts that are to each other as `sizes`, to rounding; the largest takes what is left."""
    import numpy as np

    parts = np.round(sizes / sizes.sum() * length).astype(int)
    parts[parts.argmax()] += length - parts.sum()
    return parts.tolist()
