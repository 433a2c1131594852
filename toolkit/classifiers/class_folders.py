"""Which class a folder of images is of, by its name."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from toolkit.classifiers.labels import imagenet_wnids
from toolkit.errors import ToolkitError


def match_classes(names: Sequence[str], classifier: Any, root: Path, flag: str = "--model") -> dict[str, int]:
    """The class index of each folder's name: a WordNet id, or a label in any case, with `_` or `-` for spaces.

    Raises:
        ToolkitError: a name is none of the classifier's, or two folders are of one class.
    """
    by_name: dict[str, list[int]] = {}
    for index, label in enumerate(classifier.labels):
        by_name.setdefault(_plain(label), []).append(index)
    if classifier.is_imagenet:
        by_name |= {wnid: [index] for index, wnid in enumerate(imagenet_wnids())}
    unknown = [name for name in names if _plain(name) not in by_name]
    if unknown:
        more = f" ({len(unknown)} of {len(names)} folders)" if len(unknown) > 1 else ""
        raise ToolkitError(
            f"{root / unknown[0]}: '{unknown[0]}' is no class of {classifier.describe()}{more}: name the classifier of "
            f"this data with {flag}, or rename the folder"
        )
    index_of = {}
    for name in names:
        indices = by_name[_plain(name)]
        exact = [index for index in indices if classifier.labels[index] == name]
        indices = exact if len(exact) == 1 else indices  # ImageNet has a dog 'Cardigan' and a jacket 'cardigan'
        if len(indices) > 1:
            raise ToolkitError(
                f"{root / name}: {len(indices)} classes are called '{name}' ({', '.join(map(str, indices))}): call the "
                "folder by its WordNet id"
            )
        index_of[name] = indices[0]
    for name in names:
        same = [other for other in names if index_of[other] == index_of[name]]
        if len(same) > 1:
            raise ToolkitError(f"{root}: {' and '.join(same)} are one class: join the folders")
    return index_of


def _plain(name: str) -> str:
    return name.lower().replace("_", " ").replace("-", " ").strip()
