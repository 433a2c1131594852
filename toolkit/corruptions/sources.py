"""Which images a folder holds, what is made of each, and which corruptions a few words stand for."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS, FAMILIES
from toolkit.corruptions.corrupt import find_corruption
from toolkit.images import is_image_name


@dataclass(frozen=True)
class Source:
    """One image: where it is, its path below the folder with forward slashes, and the path of what is made of it."""

    file: Path
    path: str
    target: str


def choose_names(names: list[str]) -> list[str]:
    """Names of corruptions from names, families, `common` (the fifteen) and `all` (the nineteen), each once.

    Raises:
        ToolkitError: one of them is none of these.
    """
    chosen: list[str] = []
    for name in names:
        if name == "all":
            chosen += CORRUPTIONS
        elif name == "common":
            chosen += COMMON
        elif name in FAMILIES:
            chosen += [known for known, corruption in CORRUPTIONS.items() if corruption.family == name]
        else:
            chosen.append(find_corruption(name, 1).name)
    return list(dict.fromkeys(chosen))


def find_sources(folder: Path, out: Path, image_format: str) -> list[Source]:
    """Every image below `folder`, sorted; hidden files, and `out` where it lies within, are passed over."""
    found = []
    for file in sorted(folder.rglob("*")):
        path = file.relative_to(folder)
        if any(part.startswith(".") for part in path.parts) or not is_image_name(file.name):
            continue
        if file.is_file() and not file.resolve().is_relative_to(out.resolve()):
            found.append((file, path))
    plain = Counter(path.with_suffix("") for _, path in found)
    # a.jpg and a.png would both become a.png
    return [
        Source(
            file,
            path.as_posix(),
            (path.with_suffix("") if plain[path.with_suffix("")] == 1 else path).as_posix() + f".{image_format}",
        )
        for file, path in found
    ]


def find_note(names: list[str]) -> str | None:
    """Where corruptions of `names` are not what was published; None where all are."""
    notes = [f"{name}: {CORRUPTIONS[name].note}" for name in names if CORRUPTIONS[name].note]
    return "; ".join(notes) or None
