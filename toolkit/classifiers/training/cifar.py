"""CIFAR-10's images, to train on."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.classifiers.cifar10 import open_cifar
from toolkit.files import sha256_bytes


@dataclass(frozen=True, eq=False)
class StoredImage:
    """An image that is in memory.

    Attributes:
        pixels: (h, w, 3) uint8 sRGB.
        label: of its class.
        name: says which it is, and its pixels' hash.
    """

    pixels: np.ndarray
    label: str
    name: str


def list_cifar(folder: Path, split: str, download: bool) -> tuple[StoredImage, ...]:
    """All images of a split.

    Raises:
        ToolkitError: as `open_cifar`.
    """
    cifar = open_cifar(folder, split, download)
    digest = sha256_bytes(cifar.pixels.tobytes())[:16]
    return tuple(
        StoredImage(pixels, cifar.labels[index], f"cifar10/{split}/{k:05d} {digest}")
        for k, (pixels, index) in enumerate(zip(cifar.pixels, cifar.classes, strict=True))
    )
