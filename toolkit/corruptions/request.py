"""Corruptions as they are asked for: which, at which severities, of which images, and for which share of a batch."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.core.severities import SEVERITIES, parse_severities
from toolkit.core.tables import list_spans
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS, FAMILIES
from toolkit.corruptions.corrupt import find_corruption
from toolkit.imaging.folder import find_files


def draw_corrupted(
    rng: np.random.Generator, count: int, corruptions: Sequence[tuple[str, int]], share: float
) -> Iterator[tuple[np.ndarray, str, int, list[int]]]:
    """For each image whether it is corrupted, by which, and the seed of that.

    Args:
        rng: draws.
        count: images in the batch.
        corruptions: (name, severity), at least one; each is as likely.
        share: probability that an image is corrupted.

    Yields:
        (numbers of some images, name, severity, a seed for each) of every corruption that was drawn.
    """
    acting = rng.random(count) < share
    drawn = rng.integers(len(corruptions), size=count)
    seeds = rng.integers(2**62, size=count)
    for kind in np.unique(drawn[acting]):
        which = np.flatnonzero(acting & (drawn == kind))
        yield which, *corruptions[kind], seeds[which].tolist()


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


@dataclass(frozen=True)
class FoundSources:
    """The images of a folder, sorted, and (path, reason) of those that are links to somewhere else."""

    sources: tuple[Source, ...]
    refused: tuple[tuple[str, str], ...]


def find_sources(folder: Path, out: Path, image_format: str) -> FoundSources:
    """Every image below `folder`; hidden files, and `out` where it lies within, are passed over.

    Raises:
        ToolkitError: the folder does not exist or may not be read.
    """
    real_out = out.resolve()

    def is_made(path: Path) -> bool:
        file = folder / path
        return any(place.is_relative_to(real_out) for place in (file.resolve(), file.parent.resolve() / file.name))

    found = find_files(folder)
    paths = [Path(*parts) for parts in found.images]
    paths = [path for path in paths if (folder / path).is_file() and not is_made(path)]
    plain = Counter(path.with_suffix("") for path in paths)
    # a.jpg and a.png would both become a.png
    sources = [
        Source(
            folder / path,
            path.as_posix(),
            (path.with_suffix("") if plain[path.with_suffix("")] == 1 else path).as_posix() + f".{image_format}",
        )
        for path in paths
    ]
    return FoundSources(tuple(sources), tuple(line for line in found.refused if not is_made(Path(line[0]))))


def find_note(names: list[str]) -> str | None:
    """Where corruptions of `names` are not what was published; None where all are."""
    notes = [f"{name}: {CORRUPTIONS[name].note}" for name in names if CORRUPTIONS[name].note]
    return "; ".join(notes) or None


def parse_corruptions(words: Sequence[str], severities: Sequence[int] = SEVERITIES) -> tuple[tuple[str, int], ...]:
    """Names with severities from words such as `fog:3`, `noise:1-3` and `common`, in their order, each once.

    Args:
        words: a corruption, a family, `common` (the fifteen) or `all` (the nineteen), with `:SEVERITY` or
            `:FIRST-LAST`.
        severities: of a word that has none.

    Returns:
        (name, severity) of each.

    Raises:
        ToolkitError: there is no such corruption or severity.
    """
    pairs = [
        (name, severity)
        for word in words
        for name in choose_names([word.partition(":")[0]])
        for severity in parse_severities("corruption", word, severities)
    ]
    return tuple(dict.fromkeys(pairs))


def name_corruptions(pairs: Sequence[tuple[str, int]]) -> str:
    """(name, severity) pairs in the words that `parse_corruptions` takes: `common:1-5`, or `fog:3, noise:1-2`."""
    levels: dict[str, set[int]] = {}
    for name, severity in pairs:
        levels.setdefault(name, set()).add(severity)
    alike: dict[frozenset[int], list[str]] = {}
    for name, found in levels.items():
        alike.setdefault(frozenset(found), []).append(name)
    said = []
    for severities, names in alike.items():
        whole = [word for word in ("all", "common", *FAMILIES) if set(choose_names([word])) == set(names)]
        said += [f"{name}:{span}" for name in whole[:1] or names for span in list_spans(severities)]
    return ", ".join(said)
