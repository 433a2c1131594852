"""A pattern of noise for each class; a classifier is then trained on images that carry them (seed, D.2.4)."""

import numpy as np

from toolkit.benchmark.baselines.baseline import Advance, Baseline, Choice
from toolkit.draws import Draws

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
