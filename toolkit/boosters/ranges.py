"""What the random parts of a recipe share: checked ranges, a probability, and acting on some images of a batch."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from toolkit.errors import ToolkitError

if TYPE_CHECKING:
    import torch

Range = tuple[float, float]


def check_range(name: str, values: Range, lowest: float, highest: float) -> None:
    """Refuse a range that does not rise, or leaves what is possible."""
    low, high = values
    if not lowest <= low <= high <= highest:
        raise ToolkitError(
            f"{name} range {low:g} to {high:g}: expected two rising numbers between {lowest:g} and {highest:g}"
        )


def check_probability(part: str, probability: float) -> None:
    """Refuse what is no probability."""
    if not 0 <= probability <= 1:
        raise ToolkitError(f"{part} probability {probability:g}: expected 0 to 1")


def change_some(
    images: "torch.Tensor",
    acting: np.ndarray,
    change: Callable[["torch.Tensor", np.ndarray], "torch.Tensor"],
) -> "torch.Tensor":
    """Change the images where `acting`; the others come back bit for bit, and cost nothing.

    Args:
        images: (b, ...), or a single (3, h, w).
        acting: (b,) bool, or (1,) for a single one.
        change: (those images, (k,) their numbers) -> as many, changed; differentiable.

    Returns:
        As `images`, differentiable in them.
    """
    import torch

    batch = images[None] if images.ndim == 3 else images
    which = np.flatnonzero(acting)
    if len(which) == 0:
        return images
    if len(which) == len(batch):
        return change(batch, which).reshape(images.shape)
    index = torch.as_tensor(which, device=batch.device)
    return batch.index_copy(0, index, change(batch[index], which))


def count_images(images: "torch.Tensor") -> int:
    """How many (b, 3, h, w) or (3, h, w) holds."""
    return 1 if images.ndim == 3 else len(images)


def as_factors(values: np.ndarray, like: "torch.Tensor") -> "torch.Tensor":
    """(k,) or (k, c) numbers to (k, 1 or c, 1, 1), of `like`'s type and device."""
    import torch

    return torch.as_tensor(values.reshape(len(values), -1, 1, 1), dtype=like.dtype, device=like.device)
