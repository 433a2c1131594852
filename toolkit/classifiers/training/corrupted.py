"""Training on corrupted images: a share of each batch, each by a corruption of its own."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.errors import ToolkitError

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class Corrupting:
    """What is done to which share.

    Attributes:
        corruptions: (name, severity), at least one; each image draws one.
        share: of the images.
    """

    corruptions: tuple[tuple[str, int], ...]
    share: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.share <= 1:
            raise ToolkitError(f"--corrupt-share {self.share:g}: expected a share above 0 and at most 1, such as 0.5")


def corrupt_some(batch: "torch.Tensor", rng: np.random.Generator, how: Corrupting) -> "torch.Tensor":
    """(b, 3, s, s) float32 sRGB-encoded in [0, 1], a share of it corrupted; the batch is changed."""
    import torch

    from toolkit.corruptions import corrupt
    from toolkit.corruptions.share import draw_corrupted

    for chosen, name, severity, seeds in draw_corrupted(rng, len(batch), how.corruptions, how.share):
        which = torch.from_numpy(chosen).to(batch.device)
        batch[which] = corrupt(batch[which], name, severity, seeds)
    return batch
