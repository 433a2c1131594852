"""What `toolkit train-classifier` is asked for, and the hash that says whether two requests are the same run."""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from math import cos, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import sha256_bytes
from toolkit.imaging.preprocessing import Preprocessing, published_preprocessing
from toolkit.models.architectures import build_network, list_architectures, published_weights
from toolkit.training.augment import PHOTOGRAPHS, Augmentation, Corrupting

if TYPE_CHECKING:
    import torch

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


SMALL_PX = 96
"""Networks that see less are shown whole images; larger ones the middle 7/8 of the shorter side, as usual."""
LEAST_PX, MOST_PX = 16, 1024
STORED_SHARE = 1.375
"""Side of the stored images against what the network sees: crops of them are enlarged little."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
LATER_SETTINGS = ("corrupting", "keep_labels", "patches")
METHOD_VERSION = 1
"""Raised when the same request gives other numbers: an older checkpoint is then another run's."""


@dataclass(frozen=True)
class ClassifierRequest:
    """One classifier to train.

    Attributes:
        name: of its files.
        data: sources, see `open_source`.
        arch: name of the network, see `list_architectures`.
        init: weights to start from.
        image_px: side of what the network sees.
        per_class, views: of renders, see `RenderCounts`.
        held_out: share of the images that is held out where the source does not say.
        recipe: how it is trained.
        keep_labels: the new network answers with all classes of `init`, not only with those of the data.
        overlay: what every image carries by its class.
    """

    name: str
    data: tuple[str, ...]
    arch: str = "resnet18"
    init: Path | None = None
    image_px: int = 128
    per_class: int = 480
    views: int = 12
    held_out: float = 0.1
    recipe: Recipe = field(default_factory=Recipe)
    keep_labels: bool = False
    overlay: Overlay | None = None

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name) or self.name.endswith(".safetensors"):
            raise ToolkitError(
                f"--name '{self.name}': expected letters, digits, '.', '-' and '_', no folder and no suffix"
            )
        known = list_architectures()
        if self.arch not in known:
            raise one_of("network (--arch)", self.arch, known)
        if self.name in known:
            raise ToolkitError(f"--name {self.name}: there is a network of that name (--arch): choose another")
        if not LEAST_PX <= self.image_px <= MOST_PX:
            raise ToolkitError(f"--image-px {self.image_px}: expected {LEAST_PX} to {MOST_PX}")
        if self.keep_labels and self.init is None:
            raise ToolkitError("--keep-labels keeps those of --init: name its weights, or leave it out")

    @property
    def is_small(self) -> bool:
        """Whether the network sees small images, which are shown whole."""
        return self.image_px < SMALL_PX

    @property
    def stored_px(self) -> int:
        """Side of the images that are kept for training."""
        return self.image_px if self.is_small else round(self.image_px * STORED_SHARE)

    def preprocessing(self) -> Preprocessing:
        """How the trained network wants its images: the published normalisation of its architecture."""
        published = published_preprocessing(published_weights(self.arch).transforms())
        resize_px = self.image_px if self.is_small else round(self.image_px * 8 / 7)
        return Preprocessing(resize_px, self.image_px, published.mean, published.std)

    def settings(self) -> dict[str, Any]:
        """Every hyper-parameter, as recorded."""
        settings = {
            "method": "cross-entropy, SGD with Nesterov momentum, one cycle of the learning rate",
            "image_px": self.image_px, "per_class": self.per_class, "views": self.views,
            "held_out": self.held_out, **asdict(self.recipe), "keep_labels": self.keep_labels,
            "patches": None if self.overlay is None else self.overlay.record,
        }  # fmt: skip
        # left out where they are not used: what was trained before there were such settings keeps its hash
        settings = {name: value for name, value in settings.items() if value or name not in LATER_SETTINGS}
        return json.loads(json.dumps(settings))  # as it is read back, lists for pairs


def hash_inputs(request: ClassifierRequest, labels: tuple[str, ...], data_sha256: str, init_sha256: str) -> str:
    """Hash of all that decides the weights, so that a checkpoint is never continued under other settings."""
    inputs = [METHOD_VERSION, request.name, request.arch, request.settings(), labels, data_sha256, init_sha256]
    return sha256_bytes(json.dumps(inputs, sort_keys=True).encode())


def check_fit(arch: str, classes: int, image_px: int) -> None:
    """Pass shapes, without numbers, through the network as it is trained.

    Raises:
        ToolkitError: images of this size are too small, or not the one size that it takes.
    """
    import torch

    try:
        with torch.device("meta"):
            build_network(arch, classes).train()(torch.zeros(2, 3, image_px, image_px))
    except (RuntimeError, ValueError, AssertionError) as error:
        usual = published_weights(arch).transforms().crop_size[0]
        reason = " ".join(str(error).split())[:160]
        raise ToolkitError(
            f"--arch {arch} cannot be trained with --image-px {image_px} ({reason}): try --image-px {usual}, its usual "
            "size, or another network"
        ) from None
