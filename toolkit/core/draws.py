"""Random draws by address: a draw depends on seed, step and part, never on earlier draws.

The draws for a corrupted image depend on its seed, the corruption and the severity.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from zlib import crc32

from toolkit.core.lazy import np, torch


@dataclass(frozen=True)
class Draws:
    """Random draws of a training step.

    Attributes:
        seed: seed of the run; several numbers if a single number is ambiguous.
        phase: phase of the step, such as `train` or `validate`, each with its own draws.
    """

    seed: int | tuple[int, ...]
    step: int
    phase: str = "train"

    def key(self, part: str) -> tuple[int, ...]:
        """Return the seed of a part; a new part does not change the draws of the others."""
        seeds = (self.seed,) if isinstance(self.seed, int) else self.seed
        return (*seeds, self.step, crc32(f"{self.phase}/{part}".encode()))

    def of(self, part: str) -> "np.random.Generator":
        """Return a fresh generator for a part, see `key`."""
        return np.random.default_rng(self.key(part))


def image_seed(seed: int, image_id: str | int) -> int:
    """Return the seed of an image, from the run's seed and a constant name, such as its path with forward slashes."""
    return _hash(f"{seed}/{image_id}")


def _hash(address: str) -> int:
    # 63 bits: torch's seeds are signed
    return int.from_bytes(hashlib.blake2b(address.encode(), digest_size=8).digest(), "big") >> 1


class RandomStreams:
    """Random numbers of a batch under a corruption, a stream for each image.

    They are drawn on the CPU, so that a GPU gives the same image, and by image, so that the batch does not matter.
    """

    def __init__(self, seeds: Sequence[int], name: str, severity: int, device: "torch.device") -> None:
        self.device = device
        self._streams = [torch.Generator().manual_seed(_hash(f"{seed}/{name}/{severity}")) for seed in seeds]

    def normal(self, *shape: int) -> "torch.Tensor":
        """Return (b, *shape) float32 of the standard normal distribution."""
        return self._fill(shape, lambda numbers, stream: numbers.normal_(generator=stream))

    def uniform(self, *shape: int) -> "torch.Tensor":
        """Return (b, *shape) float32, uniform on [0, 1) in steps of 2⁻²⁴."""
        return self._fill(shape, lambda numbers, stream: numbers.uniform_(generator=stream))

    def _fill(
        self, shape: tuple[int, ...], fill: "Callable[[torch.Tensor, torch.Generator], object]"
    ) -> "torch.Tensor":
        numbers = torch.empty(len(self._streams), *shape)
        for row, stream in zip(numbers, self._streams, strict=True):
            fill(row, stream)
        return numbers.to(self.device)
