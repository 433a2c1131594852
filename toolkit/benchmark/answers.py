"""What was answered to every image of the benchmark, cell by cell: what the tables are made from."""

from dataclasses import dataclass
from typing import Any

import numpy as np

CLEAN = "clean"
UNPATCHED = "unpatched"
NETWORK, READER = "network", "reader"
RIGHT, WRONG, NOT_DECODED = 1, 2, 0
"""A reader's answers, as ranks."""


@dataclass(frozen=True)
class Answers:
    """The answers to all images in one cell.

    Attributes:
        variant: what lies on the images: `unpatched`, or the name of a patch set.
        answerer: name of the network or of the reader.
        kind: `network` or `reader`.
        corruption, severity: of the images; `clean` and 0 where they are not corrupted.
        ranks: (n,) int32, place of the true class among the network's guesses, from 1. A reader's are 1 where it reads
            the code, 2 where it reads another, 0 where it decodes none.
    """

    variant: str
    answerer: str
    kind: str
    corruption: str
    severity: int
    ranks: np.ndarray


@dataclass(frozen=True)
class Benchmark:
    """A finished grid.

    Attributes:
        about: data, model, placement, seed and what the variants are; goes into `summary.json` as it is.
        ids: of the images, in the order of every `ranks`.
        classes: (n,) int, index of each image's class.
        labels: of the classes that are there, by index.
        answers: one for each cell.
        failed: (path, reason) of images that could not be used.
        notes: what a reader of the tables must know, a sentence each.
    """

    about: dict[str, Any]
    ids: tuple[str, ...]
    classes: np.ndarray
    labels: dict[int, str]
    answers: tuple[Answers, ...]
    failed: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
