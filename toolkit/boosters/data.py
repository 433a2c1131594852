"""All training images of a run, in memory, with a part held out."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.boosters.folder_data import Loaded, choose_files, load_files
from toolkit.boosters.rig_data import choose_object, is_rig_source, load_renders
from toolkit.classifiers.preprocessing import Preprocessing
from toolkit.console import progress
from toolkit.draws import Draws
from toolkit.errors import ToolkitError
from toolkit.files import sha256_bytes
from toolkit.workspace import Workspace

HELD_OUT = 0.2


@dataclass(frozen=True)
class DataRequest:
    """Which images are wanted.

    Attributes:
        sources: folders, `rig` or `rig:OBJECT`.
        backgrounds: see `toolkit.boosters.folder_data.choose_files`.
        images: how many at most, over all sources, those held out among them.
        seed: chooses.
    """

    sources: tuple[str, ...]
    backgrounds: str = "auto"
    images: int = 256
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.sources:
            raise ToolkitError("no training images: name a folder with --data FOLDER, or --data rig for renders")
        if self.images < 2 * len(self.sources):
            raise ToolkitError(f"--images {self.images}: expected at least 2 for each of {len(self.sources)} sources")


@dataclass(frozen=True)
class TrainingData:
    """What a run trains on.

    Attributes:
        train, held_out: (k, s, s, 3) uint8 sRGB.
        skipped: (path, reason) of files that could not be used.
        record: for the patch's record: sources with counts, and the hash of all pixels.
        is_held_out: False where there was but one image, which then serves for both.
    """

    train: np.ndarray
    held_out: np.ndarray
    skipped: tuple[tuple[str, str], ...]
    record: dict[str, Any]
    is_held_out: bool

    @property
    def sha256(self) -> str:
        """Of all pixels in their order."""
        return self.record["sha256"]


def load_data(
    request: DataRequest, names: frozenset[str], how: Preprocessing, workspace: Workspace, keep: Path, quiet: bool
) -> TrainingData:
    """Load every source and hold out a fifth of each.

    Args:
        request: which.
        names: what a folder or an object of the class may be called.
        how: the network's preprocessing.
        workspace: whose objects `rig` renders.
        keep: folder for renders until the run is finished.
        quiet: no progress bar.

    Raises:
        ToolkitError: a source has no images that can be used.
    """
    shares = [len(part) for part in np.array_split(np.arange(request.images), len(request.sources))]
    loaded: list[Loaded] = []
    for k, (source, count) in enumerate(zip(request.sources, shares, strict=True)):
        if is_rig_source(source):
            name = choose_object(workspace, source, names)
            loaded.append(load_renders(workspace, name, count, request.seed, how, keep, quiet))
            continue
        choice = choose_files(Path(source), names, request.backgrounds)
        rng = Draws(request.seed, k, "data").of("files")
        with progress(f"Reading {choice.folder.name}", min(count, len(choice.files)), quiet) as bar:
            loaded.append(load_files(choice, count, rng, how, bar.advance))
    return divide_images(loaded)


def divide_images(loaded: list[Loaded]) -> TrainingData:
    """Join the images of all sources and hold out a fifth of each."""
    train: list[np.ndarray] = []
    held_out: list[np.ndarray] = []
    for source in loaded:
        count = round(len(source.images) * HELD_OUT) or int(len(source.images) > 1)
        held_out.append(source.images[:count])
        train.append(source.images[count:])
    images, rest = np.concatenate(train), np.concatenate(held_out)
    sha256 = sha256_bytes(np.concatenate([images, rest]).tobytes())
    record: dict[str, Any] = {
        "sources": [source.record for source in loaded],
        "train": len(images),
        "held_out": len(rest),
        "skipped": sum(len(source.skipped) for source in loaded),
        "sha256": sha256,
    }
    skipped = tuple(line for source in loaded for line in source.skipped)
    return TrainingData(images, rest if len(rest) else images, skipped, record, len(rest) > 0)
