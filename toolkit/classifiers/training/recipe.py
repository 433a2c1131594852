"""How a classifier is trained: stochastic gradient descent with one rise and fall of the learning rate."""

from dataclasses import dataclass
from math import cos, pi

from toolkit.classifiers.training.augment import PHOTOGRAPHS, Augmentation
from toolkit.classifiers.training.corrupted import Corrupting
from toolkit.errors import ToolkitError

FIRST_SHARE, LAST_SHARE = 0.04, 1e-4


@dataclass(frozen=True)
class Recipe:
    """Hyper-parameters.

    Attributes:
        epochs: passes over the training images.
        batch: images per step.
        lr: highest learning rate.
        warm_up: share of the steps in which it rises to that.
        momentum: Nesterov's.
        weight_decay: of weights, not of biases and normalisation.
        label_smoothing: share of each target that is spread over all classes.
        seed: of every random draw.
        augmentation: of the images.
        corrupting: of some of them, after that.
    """

    epochs: int = 24
    batch: int = 64
    lr: float = 0.1
    warm_up: float = 0.2
    momentum: float = 0.9
    weight_decay: float = 5e-4
    label_smoothing: float = 0.1
    seed: int = 0
    augmentation: Augmentation = PHOTOGRAPHS
    corrupting: Corrupting | None = None

    def __post_init__(self) -> None:
        if self.epochs < 1:
            raise ToolkitError(f"--epochs {self.epochs}: expected at least 1")
        if self.batch < 2:
            raise ToolkitError(f"--batch {self.batch}: expected at least 2, batch normalisation needs company")
        if not 0 < self.lr <= 10:
            raise ToolkitError(f"--lr {self.lr:g}: expected a number above 0 and at most 10, such as 0.1")
        if not 0 <= self.label_smoothing < 1:
            raise ToolkitError(f"--label-smoothing {self.label_smoothing:g}: expected 0 to below 1")
        if not 0 <= self.weight_decay < 1:
            raise ToolkitError(f"--weight-decay {self.weight_decay:g}: expected 0 to below 1, such as 0.0005")

    def count_steps(self, images: int) -> int:
        """Steps of the whole training; what does not fill a batch is left to the next epoch's order."""
        return self.epochs * max(images // self.batch, 1)

    def lr_at(self, step: int, steps: int) -> float:
        """Learning rate of a step, counted from 0: two half cosines, up and down (Smith and Topin 2017)."""
        peak = max(self.warm_up * steps - 1, 1e-9)
        last = max(steps - 1, 1)
        if step <= peak:
            low, high, done = FIRST_SHARE, 1.0, step / peak
        else:
            low, high, done = 1.0, FIRST_SHARE * LAST_SHARE, (step - peak) / max(last - peak, 1e-9)
        return self.lr * (high + (low - high) * (1 + cos(pi * done)) / 2)
