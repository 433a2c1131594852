"""Find the images of a folder safely: nothing hidden, nothing half-written, nothing outside it."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.imaging.read import is_image_name

BY_DESIGN = frozenset(
    ("manifest.jsonl", "transforms.json", "retake.txt", "gates.jsonl", "corruption.json", "corrupted.jsonl")
)


@dataclass(frozen=True)
class FoundFiles:
    """What a folder holds.

    Attributes:
        images: files that are images by name, as parts relative to the folder, sorted.
        refused: (path, reason) of image files and folders that are links to somewhere else.
        others: paths of files that are no images by name and no files of the toolkit.
    """

    images: tuple[tuple[str, ...], ...]
    refused: tuple[tuple[str, str], ...]
    others: tuple[str, ...]


def find_files(root: Path, is_wanted: Callable[[str], bool] = is_image_name) -> FoundFiles:
    """Walk a folder; hidden and `.partial` files are passed over.

    Args:
        root: the folder.
        is_wanted: whether a file of that name counts as an image.

    Raises:
        ToolkitError: the folder does not exist, is a file, or may not be read.
    """
    root = Path(root)
    if not root.is_dir():
        what = "is a file, not a folder" if root.exists() else "does not exist"
        raise ToolkitError(f"{root} {what}: expected a folder of images sorted as SOURCE/OBJECT/VARIANT/FILE")
    real_root = root.resolve()
    images: list[tuple[str, ...]] = []
    refused: list[tuple[str, str]] = []
    others: list[str] = []
    for folder, folders, names in os.walk(root, onerror=_raise_unreadable):
        here = Path(folder)
        parts = here.relative_to(root).parts
        for name in sorted(folders):
            if not _is_passed_over(name) and (here / name).is_symlink():
                refused.append((show_path((*parts, name)), "a linked folder: copy its images here instead"))
        folders[:] = sorted(name for name in folders if not _is_passed_over(name))
        for name in sorted(names):
            if _is_passed_over(name) or name in BY_DESIGN:
                continue
            path = here / name
            if not is_wanted(name):
                others.append(show_path((*parts, name)))
            elif path.is_symlink() and not path.resolve().is_relative_to(real_root):
                refused.append(
                    (show_path((*parts, name)), "a link that leaves the folder: copy the image here instead")
                )
            else:
                images.append((*parts, name))
    return FoundFiles(tuple(sorted(images)), tuple(refused), tuple(others))


def show_path(parts: tuple[str, ...]) -> str:
    """Parts of a path joined by slashes, as text that can be written anywhere, whatever bytes the name holds."""
    return os.fsencode("/".join(parts)).decode("utf-8", errors="replace")


def _is_passed_over(name: str) -> bool:
    return name.startswith(".") or name.endswith(".partial") or name == "__MACOSX"


def _raise_unreadable(error: OSError) -> None:
    raise ToolkitError(f"cannot read the folder {error.filename}: {error.strerror}")
