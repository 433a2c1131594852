"""Randomness by address: what step i draws depends on (seed, i) and on who draws, never on what was drawn before."""

from dataclasses import dataclass
from typing import TYPE_CHECKING
from zlib import crc32

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Draws:
    """The random draws of one step.

    Attributes:
        seed: of the run; where one number does not say which, several.
        step: which step of it.
        phase: what the steps are of, such as `train` or `validate`; the same step of another draws something else.
    """

    seed: int | tuple[int, ...]
    step: int
    phase: str = "train"

    def key(self, part: str) -> tuple[int, ...]:
        """The seed of one part: adding a part to a recipe leaves the draws of the others as they were."""
        seeds = (self.seed,) if isinstance(self.seed, int) else self.seed
        return (*seeds, self.step, crc32(f"{self.phase}/{part}".encode()))

    def of(self, part: str) -> "np.random.Generator":
        """A fresh generator for one part, see `key`."""
        import numpy as np

        return np.random.default_rng(self.key(part))
