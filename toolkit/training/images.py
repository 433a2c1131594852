"""Images of classes, to train on and for benchmarks: a folder with a sub-folder for each class, or CIFAR-10."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from toolkit.core.draws import image_seed
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import real_path, sha256_bytes, sha256_file
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import UnreadableImage, find_files, read_image, show_path
from toolkit.models.network import match_classes
from toolkit.models.weights import DOWNLOAD_TIMEOUT_S, socket_timeout

CIFAR_PREFIX = "cifar10:"


@dataclass(frozen=True)
class Cifar10:
    """Images of a split.

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

    Its files are pickles, which can run code when they are read: torchvision compares the MD5 of every file with the
    published MD5 before it opens any.

    Args:
        folder: holds `cifar-10-batches-py`, or is it.
        split: `train` or `test`.
        download: fetch it into `folder` if it is not there.

    Raises:
        ToolkitError: it is not there, a file of it is damaged or foreign, or the download failed.
    """
    from http.client import HTTPException

    from toolkit.models.vision import torchvision

    reader = torchvision.datasets.CIFAR10
    if split not in SPLITS:
        raise one_of("split of CIFAR-10", split, list(SPLITS))
    folder = Path(folder)
    # the folder that holds it, or itself: both are named by people
    root = folder.parent if folder.name == reader.base_folder else folder
    try:
        # torchvision sets no limit: a server that hangs would hold the command for ever
        with socket_timeout(DOWNLOAD_TIMEOUT_S):
            found = reader(str(root), train=split == "train", download=download)
    except (RuntimeError, OSError, HTTPException) as error:
        reason = str(getattr(error, "reason", "") or error).strip() or error.__class__.__name__
        if download:
            raise ToolkitError(
                f"cannot fetch CIFAR-10 from {reader.url} ({reason}): put {reader.filename} into {root} and try again"
            ) from None
        if isinstance(error, RuntimeError):
            reason = _find_wrong_file(reader, root / reader.base_folder)
        raise FieldError(
            f"{reason}: unpack {reader.filename} there, or fetch it with {{download}}",
            {"data": f"{CIFAR_PREFIX}{root}"},
        ) from None
    return Cifar10(tuple(found.classes), found.data, np.array(found.targets, np.int64))


def _find_wrong_file(reader: Any, place: Path) -> str:
    """Return why torchvision's reader cannot open it."""
    from toolkit.models.vision import torchvision

    if not place.is_dir():
        return f"no folder {place.name} in it"
    for name, md5 in (*reader.train_list, *reader.test_list, (reader.meta["filename"], reader.meta["md5"])):
        if not (place / name).is_file():
            return f"{place.name}/{name} is missing"
        if not torchvision.datasets.utils.check_integrity(str(place / name), md5):
            return f"{place.name}/{name} is damaged or not CIFAR-10's (its MD5 is not {md5}) and was not opened"
    return f"{place.name} was changed while it was read"


TRAIN_NAME, HELD_OUT_NAMES = "train", ("val", "validation", "test")
LEAST_SHARE = 0.25
"""Images with a shorter side below this share of what the network sees are left out: they would show nothing."""


@dataclass(frozen=True)
class LabelledFile:
    """An image and the class that it shows."""

    path: Path
    label: str
    shown: str


@dataclass(frozen=True)
class FolderClasses:
    """Images of a folder.

    Attributes:
        train, held_out: its images.
        skipped: (path, reason) of files that must not be opened or are in no class.
        how: how the held-out images were chosen.
    """

    train: tuple[LabelledFile, ...]
    held_out: tuple[LabelledFile, ...]
    skipped: tuple[tuple[str, str], ...]
    how: str


def find_classes(folder: Path, held_out_share: float, seed: int) -> FolderClasses:
    """The images of a folder by class.

    `train/CLASS/…` with `val/`, `validation/` or `test/` beside it is used as it is; of `train/` alone, and of
    `CLASS/…`, a share of each class is held out, drawn by the seed.

    Raises:
        ToolkitError: no such folder, no class in it, or a class without images.
    """
    folder = _check_folder(Path(folder), "'everyday', 'rig', cifar10:FOLDER, or a folder with one folder per class")
    # the split that the folder has, or a split of its own
    root = folder / TRAIN_NAME if (folder / TRAIN_NAME).is_dir() else folder
    train, skipped = _list_classes(root)
    beside = next((folder / name for name in HELD_OUT_NAMES if (folder / name).is_dir()), None)
    if root == folder or beside is None:
        return _split(train, skipped, held_out_share, seed)
    held_out, more = _list_classes(beside)
    strange = sorted({image.label for image in held_out} - {image.label for image in train})
    if strange:
        raise ToolkitError(
            f"{beside / strange[0]}: no class '{strange[0]}' in {root}: expected the same class folders in both"
        )
    return FolderClasses(tuple(train), tuple(held_out), (*skipped, *more), f"the images in {beside.name}/")


def _check_folder(folder: Path, expected: str) -> Path:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise FieldError(f"{what}: expected {expected}", {"data": folder})
    return folder


def _find_by_class(root: Path) -> tuple[list[tuple[str, ...]], list[tuple[str, str]]]:
    """The images in class folders as parts below `root`, and (path, reason) of what is left out."""
    found = find_files(root)
    refused = [(show_path((root.name, path)), reason) for path, reason in found.refused]
    loose = [parts for parts in found.images if len(parts) == 1]
    refused += [(show_path((root.name, *parts)), "in no class folder: move it into one") for parts in loose]
    images = [parts for parts in found.images if len(parts) > 1]
    if not images:
        raise FieldError("no images in it: expected CLASS/IMAGE.jpg, one folder per class", {"data": root})
    return images, refused


def _list_classes(root: Path, every_class: bool = True) -> tuple[list[LabelledFile], list[tuple[str, str]]]:
    images, skipped = _find_by_class(root)
    files = [LabelledFile(root.joinpath(*parts), parts[0], show_path((root.name, *parts))) for parts in images]
    filled = {file.label for file in files}
    folders = sorted(path.name for path in root.iterdir() if path.is_dir() and path.name[0] != ".")
    empty = [name for name in folders if name not in filled]
    if empty and every_class:
        raise ToolkitError(f"{root / empty[0]}: a class without images: put some in, or remove the folder")
    return files, [*skipped, *((show_path((root.name, name)), "a class without images") for name in empty)]


def find_photographs(folder: Path, share: float) -> FolderClasses:
    """The photographs of a folder with a folder per class, a fixed share of all held out, whatever their classes.

    Which are held out goes by their names alone: the same in every run, and where photographs are added nearly so.

    Raises:
        ToolkitError: no such folder, or no class with images in it.
    """
    files, skipped = _list_classes(_check_folder(Path(folder), "a folder with one folder per class"), False)
    order = sorted(files, key=lambda file: (crc32(f"{file.label}/{file.path.name}".encode()), file.path))
    chosen = set(order[: round(share * len(files))])
    parts = [tuple(file for file in files if (file in chosen) == wanted) for wanted in (False, True)]
    return FolderClasses(parts[0], parts[1], tuple(skipped), f"{share:.0%} of the photographs, by their names")


def _split(files: list[LabelledFile], skipped: Sequence[tuple[str, str]], share: float, seed: int) -> FolderClasses:
    """Hold out a share of each class, at least one image, but never the last image."""
    train: list[LabelledFile] = []
    held_out: list[LabelledFile] = []
    for label in sorted({file.label for file in files}):
        own = [file for file in files if file.label == label]
        # by the label, so that another class changes no other's part
        order = np.random.default_rng([seed, crc32(label.encode())]).permutation(len(own))
        count = min(max(round(share * len(own)), 1), len(own) - 1) if share > 0 else 0
        held_out += [own[k] for k in sorted(order[:count])]
        train += [own[k] for k in sorted(order[count:])]
    return FolderClasses(tuple(train), tuple(held_out), tuple(skipped), f"{share:.0%} of each class, by the seed")


def cut_square(pixels: np.ndarray, path: Path, how: Preprocessing) -> np.ndarray:
    """(crop_px, crop_px, 3) uint8 sRGB: the middle of (h, w, 3) pixels; `path` is named where they are too few.

    Raises:
        UnreadableImage: they would show nothing.
    """
    short = min(pixels.shape[:2])
    if short < LEAST_SHARE * how.crop_px:
        size = f"{pixels.shape[1]}×{pixels.shape[0]} px"
        raise UnreadableImage(path, f"{size}, too small to be shown at {how.crop_px} px")
    return resize_and_crop(pixels, how)


@dataclass(frozen=True, eq=False)
class CifarImage:
    """An image that is in memory.

    Attributes:
        pixels: (h, w, 3) uint8 sRGB.
        label: of its class.
        name: says which it is, and its pixels' hash.
    """

    pixels: np.ndarray
    label: str
    name: str


def list_cifar(folder: Path, split: str, download: bool) -> tuple[CifarImage, ...]:
    """All images of a split.

    Raises:
        ToolkitError: as `open_cifar`.
    """
    cifar = open_cifar(folder, split, download)
    # the name stands for the pixels where packs are addressed
    digest = sha256_bytes(cifar.pixels.tobytes())[:16]
    return tuple(
        CifarImage(pixels, cifar.labels[index], f"cifar10/{split}/{k:05d} {digest}")
        for k, (pixels, index) in enumerate(zip(cifar.pixels, cifar.classes, strict=True))
    )


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
        return sorted({image.class_index for image in self.images})

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
        return replace(self, images=tuple(image for image in self.images if image.class_index in wanted))

    def draw(self, per_class: int, seed: int) -> "ImageSet":
        """At most so many of each class, drawn by the seed."""
        drawn: list[LabelledImage] = []
        for index in self.classes:
            own = [image for image in self.images if image.class_index == index]
            # by each image's own number: a larger draw contains the smaller
            drawn += sorted(own, key=lambda image: image_seed(seed, image.id))[:per_class]
        return replace(self, images=tuple(sorted(drawn, key=lambda image: image.id)))


def open_images(data: str, classifier: Any, split: str = "test", download: bool = False) -> ImageSet:
    """The images of a folder with a folder per class, or of CIFAR-10.

    Args:
        data: a folder; if it has `train/` and `val/`, `validation/` or `test/`, the folder of the split. Its folders
            are called by WordNet id or by label. `cifar10:FOLDER` is CIFAR-10 as torchvision keeps it.
        classifier: whose classes are meant.
        split: `train` or `test`.
        download: CIFAR-10 into `FOLDER`, where it is not there.

    Raises:
        ToolkitError: no such folder, no images in it, or a class folder that is not a class of the classifier.
    """
    if data.startswith(CIFAR_PREFIX):
        return _open_cifar(data, classifier, split, download)
    folder = _check_folder(Path(data), "a folder with one folder per class, or cifar10:FOLDER")
    # the folder of the split if it is there, else the whole folder
    root = next((folder / name for name in SPLITS[split] if (folder / name).is_dir()), folder)
    files, refused = _find_by_class(root)
    # folders are matched with classes, by label or WordNet id
    index_of = match_classes(sorted({parts[0] for parts in files}), classifier, root)
    images = [LabelledImage("/".join(parts), index_of[parts[0]]) for parts in files]
    name = real_path(folder).name
    return ImageSet(
        show_path((name,) if root == folder else (name, root.name)),
        tuple(sorted(images, key=lambda image: image.id)),
        tuple(refused),
        lambda id, short_side_px: read_image(root / id, short_side_px),
        lambda id: sha256_file(root / id),
    )


def choose_classes(images: ImageSet, names: Sequence[str], classifier: Any) -> ImageSet:
    """The images of the classes that are named, all where none is.

    Raises:
        ToolkitError: an unknown class, or a class without images.
    """
    if not names:
        return images
    wanted = [classifier.class_index(name) for name in names]
    for name, index in zip(names, wanted, strict=True):
        if index not in images.classes:
            known = [classifier.labels[other] for other in images.classes]
            near = str(one_of("class with images", name, known)).partition(": ")[2]
            raise ToolkitError(f"class '{classifier.labels[index]}' has no images in {images.name}: {near}")
    return images.only(wanted)


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
