"""Randomness by address: what an image gets depends on its own seed, the corruption and the severity alone."""

import hashlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch


def image_seed(seed: int, image_id: str | int) -> int:
    """The seed of one image of a run: the same for the same `seed` and `image_id`, whatever else is in the run.

    Args:
        seed: of the run.
        image_id: a name that stays with the image, such as its path below the folder, with forward slashes.
    """
    return _hash(f"{seed}/{image_id}")


def _hash(address: str) -> int:
    # 63 bits: torch's seeds are signed
    return int.from_bytes(hashlib.blake2b(address.encode(), digest_size=8).digest(), "big") >> 1


class RandomStreams:
    """The random numbers of one batch under one corruption: one stream per image.

    They are drawn on the CPU whatever the device, so that a GPU makes the same picture as a CPU, and image by image, so
    that neither the batch nor its order matters.
    """

    def __init__(self, seeds: Sequence[int], name: str, severity: int, device: "torch.device") -> None:
        import torch

        self.device = device
        self._streams = [torch.Generator().manual_seed(_hash(f"{seed}/{name}/{severity}")) for seed in seeds]

    def normal(self, *shape: int) -> "torch.Tensor":
        """(b, *shape) float32 of the standard normal distribution."""
        return self._fill(shape, lambda numbers, stream: numbers.normal_(generator=stream))

    def uniform(self, *shape: int) -> "torch.Tensor":
        """(b, *shape) float32, uniform on [0, 1) in steps of 2⁻²⁴."""
        return self._fill(shape, lambda numbers, stream: numbers.uniform_(generator=stream))

    def _fill(
        self, shape: tuple[int, ...], fill: "Callable[[torch.Tensor, torch.Generator], object]"
    ) -> "torch.Tensor":
        import torch

        numbers = torch.empty(len(self._streams), *shape)
        for row, stream in zip(numbers, self._streams, strict=True):
            fill(row, stream)
        return numbers.to(self.device)
