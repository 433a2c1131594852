"""Training images from a folder: of the class where it has its own sub-folder, else every image as a background."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.classifiers.labels import imagenet_wnids
from toolkit.classifiers.preprocessing import Preprocessing, resize_and_crop
from toolkit.errors import ToolkitError, one_of
from toolkit.image_folder import find_files, show_path
from toolkit.images import UnreadableImage, read_image

BACKGROUNDS = ("auto", "all", "class")


@dataclass(frozen=True)
class Choice:
    """The files that a folder offers.

    Attributes:
        folder: where they lie.
        files: parts relative to the folder, sorted.
        use: `class` when all show the class, `backgrounds` when they may show anything.
        refused: (path, reason) of files that must not be opened.
    """

    folder: Path
    files: tuple[tuple[str, ...], ...]
    use: str
    refused: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Loaded:
    """Images of one source.

    Attributes:
        images: (k, s, s, 3) uint8 sRGB.
        skipped: (path, reason) of what could not be used.
        record: for the patch's record: source, use, how many were found and used.
    """

    images: np.ndarray
    skipped: tuple[tuple[str, str], ...]
    record: dict[str, Any]


def names_of_class(classifier: Any, index: int, typed: str) -> frozenset[str]:
    """What a folder of this class may be called, in lower case: the WordNet id, the label, what the user typed."""
    names = {typed, classifier.labels[index]}
    if classifier.is_imagenet:
        names.add(imagenet_wnids()[index])
    return frozenset(_plain(name) for name in names)


def _plain(name: str) -> str:
    return name.lower().replace("_", " ").replace("-", " ").strip()


def choose_files(folder: Path, names: frozenset[str], backgrounds: str = "auto", flag: str = "--data") -> Choice:
    """The images in a folder that train a class.

    Args:
        folder: an ImageFolder (`n04552348/…`, `warplane/…`, at any depth), or any folder with images.
        names: what a folder of the class may be called, see `names_of_class`.
        backgrounds: `class` takes images of the class only, `all` takes every image, `auto` those of the class where
            there are any and else every image. The paper samples y = C_targ; the patch learns from both.
        flag: which names the folder, for errors.

    Raises:
        ToolkitError: no such folder, no images in it, or with `class` none of the class.
    """
    if backgrounds not in BACKGROUNDS:
        raise one_of("choice of --backgrounds", backgrounds, list(BACKGROUNDS))
    folder = Path(folder)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        renders = ", or 'rig' for renders of the object" if flag == "--data" else ""
        raise ToolkitError(f"{flag} {folder} {what}: expected a folder of images{renders}")
    found = find_files(folder)
    if not found.images:
        others = f" ({len(found.others)} other files)" if found.others else ""
        raise ToolkitError(f"{flag} {folder}: no images in it{others}: expected .jpg, .png, .webp, .tif or .heic files")
    inside_class = _plain(folder.resolve().name) in names
    own = tuple(parts for parts in found.images if inside_class or any(_plain(part) in names for part in parts[:-1]))
    if backgrounds == "class" and not own:
        raise ToolkitError(
            f"{flag} {folder}: no sub-folder called {' or '.join(sorted(names))}: name one so, or use --backgrounds all"
        )
    if own and backgrounds != "all":
        return Choice(folder, own, "class", found.refused)
    use = "class" if len(own) == len(found.images) else "backgrounds"
    return Choice(folder, found.images, use, found.refused)


def load_files(
    choice: Choice, count: int, rng: np.random.Generator, how: Preprocessing, advance: Callable[[], None]
) -> Loaded:
    """Decode up to `count` images, chosen at random; one that cannot be read is skipped and another takes its place.

    Args:
        choice: the files.
        count: at most so many.
        rng: chooses.
        how: the network's preprocessing; images are kept square at its `resize_px`, so that training can cut at random.
        advance: called after each image.

    Raises:
        ToolkitError: none of them can be read.
    """
    square = replace(how, crop_px=how.resize_px)
    images: list[np.ndarray] = []
    skipped = list(choice.refused)
    for k in rng.permutation(len(choice.files)):
        if len(images) == count:
            break
        parts = choice.files[k]
        try:
            pixels = read_image(choice.folder.joinpath(*parts), how.resize_px)
        except UnreadableImage as error:
            skipped.append((show_path((choice.folder.name, *parts)), error.reason))
            continue
        images.append(resize_and_crop(pixels, square))
        advance()
    if not images:
        path, reason = skipped[-1]
        raise ToolkitError(f"{choice.folder}: none of its {len(choice.files)} images can be read; {path}: {reason}")
    record = {"source": choice.folder.name, "use": choice.use, "found": len(choice.files), "used": len(images)}
    return Loaded(np.stack(images), tuple(skipped), record)
