"""Randomness by address: what step i draws depends on (seed, i) and on who draws, never on what was drawn before."""

from dataclasses import dataclass
from zlib import crc32

import numpy as np


@dataclass(frozen=True)
class Draws:
    """The random draws of one step.

    Attributes:
        seed: of the run.
        step: which step of it.
        phase: what the steps are of, `train` or `validate`; the same step of another phase draws something else.
    """

    seed: int
    step: int
    phase: str = "train"

    def of(self, part: str) -> np.random.Generator:
        """A fresh generator for one part: adding a part to a recipe leaves the draws of the others as they were."""
        return np.random.default_rng([self.seed, self.step, crc32(f"{self.phase}/{part}".encode())])
