"""What is laid on every image, by its class: patches, for a network that learns to read them."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    import torch

Lay = Callable[["torch.Tensor", np.ndarray, Sequence[int]], "torch.Tensor"]
"""(images (b, 3, m, m) float32 sRGB-encoded in [0, 1], classes (b,), a seed for each) -> images with their overlay."""


class Overlay(Protocol):
    """Pictures of classes, before it is known which classes there are."""

    @property
    def record(self) -> dict[str, Any]:
        """All that decides what is laid on, for the classifier's record and the hash of its inputs."""

    @property
    def words(self) -> str:
        """What an image carries, in a few words, after `each with`."""

    def fit(self, labels: Sequence[str], used: Sequence[int], image_px: int) -> Lay:
        """For a network of these labels whose data has the classes `used`.

        Raises:
            ToolkitError: there is no picture for one of them, or they do not fit into the image.
        """
