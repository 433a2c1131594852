"""Images of classes from a folder: a sub-folder for each class, held-out images in a folder beside it or split off."""

from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from toolkit.classifiers.preprocessing import Preprocessing, resize_and_crop
from toolkit.errors import ToolkitError
from toolkit.image_folder import find_files, show_path
from toolkit.images import UnreadableImage, read_image

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
    """What a folder offers.

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
    folder = Path(folder)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise ToolkitError(
            f"--data {folder} {what}: expected 'everyday', 'rig', cifar10:FOLDER, or a folder with one folder per class"
        )
    root = folder / TRAIN_NAME if (folder / TRAIN_NAME).is_dir() else folder
    train, skipped = _list_classes(root)
    if root == folder:
        return _split(train, skipped, held_out_share, seed)
    beside = next((folder / name for name in HELD_OUT_NAMES if (folder / name).is_dir()), None)
    if beside is None:
        return _split(train, skipped, held_out_share, seed)
    held_out, more = _list_classes(beside)
    strange = sorted({one.label for one in held_out} - {one.label for one in train})
    if strange:
        raise ToolkitError(
            f"{beside / strange[0]}: no class '{strange[0]}' in {root}: expected the same class folders in both"
        )
    return FolderClasses(tuple(train), tuple(held_out), (*skipped, *more), f"the images in {beside.name}/")


def _list_classes(root: Path) -> tuple[list[LabelledFile], list[tuple[str, str]]]:
    found = find_files(root)
    skipped = [(show_path((root.name, path)), reason) for path, reason in found.refused]
    files = []
    for parts in found.images:
        shown = show_path((root.name, *parts))
        if len(parts) == 1:
            skipped.append((shown, "in no class folder: move it into one"))
        else:
            files.append(LabelledFile(root.joinpath(*parts), parts[0], shown))
    filled = {one.label for one in files}
    empty = [
        path.name
        for path in sorted(root.iterdir())
        if path.is_dir() and path.name[0] != "." and path.name not in filled
    ]
    if not files:
        raise ToolkitError(f"--data {root}: no images in it: expected CLASS/IMAGE.jpg, one folder per class")
    if empty:
        raise ToolkitError(f"{root / empty[0]}: a class without images: put some in, or remove the folder")
    return files, skipped


def _split(files: list[LabelledFile], skipped, share: float, seed: int) -> FolderClasses:
    """Hold out a share of each class, at least one image, but never the last one."""
    train: list[LabelledFile] = []
    held_out: list[LabelledFile] = []
    for label in sorted({one.label for one in files}):
        own = [one for one in files if one.label == label]
        order = np.random.default_rng([seed, crc32(label.encode())]).permutation(len(own))
        count = min(max(round(share * len(own)), 1), len(own) - 1) if share > 0 else 0
        held_out += [own[k] for k in sorted(order[:count])]
        train += [own[k] for k in sorted(order[count:])]
    return FolderClasses(tuple(train), tuple(held_out), tuple(skipped), f"{share:.0%} of each class, by the seed")


def load_square(path: Path, how: Preprocessing) -> np.ndarray:
    """(crop_px, crop_px, 3) uint8 sRGB: the middle of a photograph.

    Raises:
        UnreadableImage: it cannot be decoded, or is too small to show anything.
    """
    return cut_square(read_image(path, how.resize_px), path, how)


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
