"""CIFAR-10 (Krizhevsky 2009) as torchvision keeps it."""

import http.client
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.classifiers.weights import DOWNLOAD_TIMEOUT_S, socket_timeout
from toolkit.errors import ToolkitError, one_of

CIFAR_PREFIX = "cifar10:"
SPLITS = ("train", "test")


@dataclass(frozen=True)
class Cifar10:
    """Images of one split.

    Attributes:
        labels: of the classes.
        pixels: (n, 32, 32, 3) uint8 sRGB.
        classes: (n,) int64.
    """

    labels: tuple[str, ...]
    pixels: np.ndarray
    classes: np.ndarray


def open_cifar(folder: Path, split: str, download: bool = False) -> Cifar10:
    """The 50000 images of CIFAR-10's `train` or the 10000 of its `test`.

    Its files are pickles, which can run code when they are read: torchvision compares the MD5 of every one with the
    published one before it opens any.

    Args:
        folder: holds `cifar-10-batches-py`, or is it.
        split: `train` or `test`.
        download: fetch it into `folder` if it is not there.

    Raises:
        ToolkitError: it is not there, a file of it is damaged or foreign, or the download failed.
    """
    from torchvision.datasets import CIFAR10

    if split not in SPLITS:
        raise one_of("split of CIFAR-10", split, list(SPLITS))
    folder = Path(folder)
    root = folder.parent if folder.name == CIFAR10.base_folder else folder
    try:
        with socket_timeout(DOWNLOAD_TIMEOUT_S):
            found = CIFAR10(str(root), train=split == "train", download=download)
    except (RuntimeError, OSError, http.client.HTTPException) as error:
        reason = str(getattr(error, "reason", "") or error).strip() or error.__class__.__name__
        if download:
            raise ToolkitError(
                f"--download: cannot fetch CIFAR-10 from {CIFAR10.url} ({reason}): put {CIFAR10.filename} into {root} "
                "and try again"
            ) from None
        if isinstance(error, RuntimeError):
            reason = _find_wrong_file(CIFAR10, root / CIFAR10.base_folder)
        raise ToolkitError(
            f"--data {CIFAR_PREFIX}{root}: {reason}: unpack {CIFAR10.filename} there, or fetch it with --download"
        ) from None
    return Cifar10(tuple(found.classes), found.data, np.array(found.targets, np.int64))


def _find_wrong_file(reader: Any, place: Path) -> str:
    """What keeps torchvision's reader from it."""
    from torchvision.datasets.utils import check_integrity

    if not place.is_dir():
        return f"no folder {place.name} in it"
    for name, md5 in (*reader.train_list, *reader.test_list, (reader.meta["filename"], reader.meta["md5"])):
        if not (place / name).is_file():
            return f"{place.name}/{name} is missing"
        if not check_integrity(str(place / name), md5):
            return f"{place.name}/{name} is damaged or not CIFAR-10's (its MD5 is not {md5}) and was not opened"
    return f"{place.name} was changed while it was read"
