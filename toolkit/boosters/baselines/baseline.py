"""What all kinds of baseline have in common, and the fixed pattern: one picture for each class, at any size."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolkit.boosters.patch_config import SMALLEST_PX
from toolkit.core.draws import Draws
from toolkit.objects.records import NetworkRecord, PatchRecord

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Choice:
    """What shall stand for a class.

    Attributes:
        draw: side in pixels -> (n, n, 3) uint8 sRGB; None where there is nothing to draw.
        code: side in pixels -> how the code is drawn; None for what is no code.
        data: for the record: from which data, and which image.
        final: for the record: figures.
        passed_over: (path, reason) of images that could not be used.
    """

    draw: Callable[[int], np.ndarray] | None
    code: Callable[[int], dict[str, Any]] | None = None
    data: dict[str, Any] = field(default_factory=dict)
    final: dict[str, float] = field(default_factory=dict)
    passed_over: tuple[tuple[str, str], ...] = ()


class Baseline(ABC):
    """One kind of baseline.

    Attributes:
        method: what the records call it.
        seed: of its random draws; 0 where it draws nothing.
        settings: what decides the pictures of all classes alike.
        networks: the classifiers that had a say.
        least_px, least_because: the least side that a picture may have, and why.
    """

    method: str
    seed: int = 0
    settings: dict[str, Any]
    networks: list[NetworkRecord]
    least_px: int = SMALLEST_PX
    least_because: str = ""

    def list_inputs(self, index: int) -> Any:
        """What decides the picture of one class beside the settings, as JSON holds it."""
        return None

    def is_current(self, record: PatchRecord) -> bool:
        """Whether what a finished picture was made from is still as it was."""
        return True

    def count_work(self, index: int) -> int:
        """How far a class moves the progress bar."""
        return 1

    @abstractmethod
    def choose(self, index: int, advance: Advance) -> Choice:
        """Decide what stands for a class; `advance` is told of the work that is done."""


MEAN, DEVIATION = 0.5, 0.1
"""Of the values in [0, 1], as in the paper's release."""


class FixedPatterns(Baseline):
    """Gaussian noise, independent for each value, drawn by seed and class."""

    method = "fixed pattern of Gaussian noise"

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.networks = []
        self.settings = {"mean": MEAN, "standard_deviation": DEVIATION}

    def choose(self, index: int, advance: Advance) -> Choice:
        """The pattern of one class."""

        def draw(size_px: int) -> np.ndarray:
            noise = Draws(self.seed, index, "fixed pattern").of("noise").normal(MEAN, DEVIATION, (size_px, size_px, 3))
            return np.round(noise.clip(0, 1) * 255).astype(np.uint8)

        advance(1)
        return Choice(draw)
