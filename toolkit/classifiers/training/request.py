"""What `toolkit train-classifier` is asked for, and the hash that says whether two requests are the same run."""

import json
import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from toolkit.classifiers.architectures import build_network, list_architectures, published_weights
from toolkit.classifiers.preprocessing import Preprocessing, published_preprocessing
from toolkit.classifiers.training.overlay import Overlay
from toolkit.classifiers.training.recipe import Recipe
from toolkit.errors import ToolkitError, one_of
from toolkit.files import sha256_bytes

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
