"""The images of a benchmark and what they show: a folder with a folder per class, or CIFAR-10."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import sha256_bytes, sha256_file
from toolkit.corruptions.draws import image_seed
from toolkit.imaging.folder import find_files, show_path
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import read_image
from toolkit.models.network import match_classes
from toolkit.training.folder import CIFAR_PREFIX, HELD_OUT_NAMES, TRAIN_NAME, cut_square, open_cifar

SPLITS = {"train": (TRAIN_NAME,), "test": HELD_OUT_NAMES}


@dataclass(frozen=True)
class LabelledImage:
    """One image.

    Attributes:
        id: path below the data set's folder, with forward slashes; what its random draws depend on.
        class_index: in the classifier's labels.
    """

    id: str
    class_index: int


@dataclass(frozen=True)
class ImageSet:
    """A data set.

    Attributes:
        name: of its folder, for records.
        images: sorted by id.
        refused: (path, reason) of files that are not used.
        read_pixels: (id, short side that is needed or None) -> (h, w, 3) uint8 sRGB.
        hash_image: id -> SHA-256 of its file or pixels.
    """

    name: str
    images: tuple[LabelledImage, ...]
    refused: tuple[tuple[str, str], ...]
    read_pixels: Callable[[str, int | None], np.ndarray]
    hash_image: Callable[[str], str]

    @property
    def classes(self) -> list[int]:
        """Class indices that have images, sorted."""
        return sorted({one.class_index for one in self.images})

    def read(self, image: LabelledImage) -> np.ndarray:
        """(h, w, 3) uint8 sRGB, whole.

        Raises:
            UnreadableImage: it cannot be decoded.
        """
        return self.read_pixels(image.id, None)

    def load(self, image: LabelledImage, how: Preprocessing) -> np.ndarray:
        """(crop_px, crop_px, 3) uint8 sRGB, as the network is shown it.

        Raises:
            UnreadableImage: it cannot be decoded, or is too small to show anything.
        """
        return cut_square(self.read_pixels(image.id, how.resize_px), Path(image.id), how)

    def only(self, classes: Sequence[int]) -> "ImageSet":
        """Its images of some classes."""
        wanted = set(classes)
        return replace(self, images=tuple(one for one in self.images if one.class_index in wanted))

    def draw(self, per_class: int, seed: int) -> "ImageSet":
        """At most so many of each class, drawn by the seed."""
        drawn: list[LabelledImage] = []
        for index in self.classes:
            own = [one for one in self.images if one.class_index == index]
            drawn += sorted(own, key=lambda one: image_seed(seed, one.id))[:per_class]
        return replace(self, images=tuple(sorted(drawn, key=lambda one: one.id)))


def open_images(data: str, classifier: Any, split: str = "test", download: bool = False) -> ImageSet:
    """The images of a folder with one folder per class, or of CIFAR-10.

    Args:
        data: a folder; where it holds `train/` and `val/`, `validation/` or `test/`, the one of the split. Its folders
            are called by WordNet id or by label. `cifar10:FOLDER` is CIFAR-10 as torchvision keeps it.
        classifier: whose classes are meant.
        split: `train` or `test`.
        download: CIFAR-10 into `FOLDER`, where it is not there.

    Raises:
        ToolkitError: no such folder, no images in it, or a class folder that is no class of the classifier.
    """
    if data.startswith(CIFAR_PREFIX):
        return _open_cifar(data, classifier, split, download)
    folder = Path(data)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise FieldError(f"{what}: expected a folder with one folder per class, or cifar10:FOLDER", {"data": folder})
    root = next((folder / name for name in SPLITS[split] if (folder / name).is_dir()), folder)
    found = find_files(root)
    refused = [(show_path((root.name, path)), reason) for path, reason in found.refused]
    loose = [parts for parts in found.images if len(parts) == 1]
    refused += [(show_path((root.name, *parts)), "in no class folder: move it into one") for parts in loose]
    names = sorted({parts[0] for parts in found.images if len(parts) > 1})
    if not names:
        raise FieldError("no images in it: expected CLASS/IMAGE.jpg, one folder per class", {"data": root})
    index_of = match_classes(names, classifier, root)
    images = [LabelledImage("/".join(parts), index_of[parts[0]]) for parts in found.images if len(parts) > 1]
    return ImageSet(
        show_path((*((folder.resolve().name,) if root == folder else (folder.resolve().name, root.name)),)),
        tuple(sorted(images, key=lambda one: one.id)),
        tuple(refused),
        lambda id, short_side_px: read_image(root / id, short_side_px),
        lambda id: sha256_file(root / id),
    )


def choose_classes(images: ImageSet, names: Sequence[str], classifier: Any) -> ImageSet:
    """The images of the classes that are named, all where none is.

    Raises:
        ToolkitError: an unknown class, or one without images.
    """
    if not names:
        return images
    wanted = [classifier.class_index(name) for name in names]
    for name, index in zip(names, wanted, strict=True):
        if index not in images.classes:
            known = [classifier.labels[other] for other in images.classes]
            raise ToolkitError(
                f"class '{classifier.labels[index]}' has no images in {images.name}: {_say_known(known, name)}"
            )
    return images.only(wanted)


def _say_known(known: list[str], name: str) -> str:
    return str(one_of("class with images", name, known)).partition(": ")[2]


def _open_cifar(data: str, classifier: Any, split: str, download: bool) -> ImageSet:
    folder = Path(data.removeprefix(CIFAR_PREFIX))
    cifar = open_cifar(folder, split, download)
    index_of = match_classes(cifar.labels, classifier, folder)
    places = {f"cifar10/{split}/{k:05d}": k for k in range(len(cifar.pixels))}
    images = tuple(
        LabelledImage(id, index_of[cifar.labels[int(label)]]) for id, label in zip(places, cifar.classes, strict=True)
    )
    return ImageSet(
        f"cifar10/{split}", images, (),
        lambda id, short_side_px: cifar.pixels[places[id]],
        lambda id: sha256_bytes(cifar.pixels[places[id]].tobytes()),
    )  # fmt: skip
