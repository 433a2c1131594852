"""Answers on disk, addressed by the hash of all that they depend on, so that none is asked for twice."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from toolkit.benchmark.answers import CLEAN
from toolkit.benchmark.images import ImageSet, LabelledImage
from toolkit.benchmark.placement import Placement
from toolkit.benchmark.variants import Answerer, Variant
from toolkit.corruptions import CORRUPTIONS, choose_parameters
from toolkit.files import append_lines, sha256_bytes

METHOD_VERSION = 1
"""Raised when the same inputs give other answers, as after a change to a corruption."""
FAILED = -1
"""The rank of an image that could not be used."""


class CellLine(BaseModel):
    """One line of `cells.jsonl`: the ranks of a shard's images in one cell."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    key: str = Field(pattern=r"^[0-9a-f]{64}$")
    ranks: list[int]


@dataclass(frozen=True)
class Shard:
    """Images that are in memory together.

    Attributes:
        images: in order.
        hashes: of their files.
    """

    images: tuple[LabelledImage, ...]
    hashes: tuple[str, ...]


@dataclass(frozen=True)
class Cell:
    """A corruption at a severity; `clean` and 0 for none."""

    corruption: str
    severity: int


def cut_shards(images: ImageSet, size: int) -> Iterable[Shard]:
    """The images in parts of `size`; files are read once for their hashes."""
    for start in range(0, len(images.images), size):
        part = images.images[start : start + size]
        yield Shard(part, tuple(images.hash_image(one.id) for one in part))


def make_key(shard: Shard, variant: Variant, answerer: Answerer, cell: Cell, placement: Placement, seed: int) -> str:
    """Hash of everything that the answers of a cell to a shard depend on."""
    how = variant.classifier.preprocessing
    patches = variant.patches
    pictures = None if patches is None else [patches.patches[one.class_index].record.png_sha256 for one in shard.images]
    given = None
    if cell.corruption != CLEAN:
        chosen = choose_parameters(how.crop_px, how.crop_px)
        given = [cell.corruption, cell.severity, CORRUPTIONS[cell.corruption].parameters[chosen][cell.severity - 1]]
    inputs = [
        METHOD_VERSION, [[one.id, one.class_index] for one in shard.images], shard.hashes, how.describe(), pictures,
        None if patches is None else asdict(placement), None if patches is given is None else seed, given,
        answerer.address,
    ]  # fmt: skip
    return sha256_bytes(json.dumps(inputs).encode())


def read_cells(file: Path, wanted: set[str]) -> dict[str, np.ndarray]:
    """Ranks by key, of the keys that are wanted; a line that a kill has cut is passed over."""
    found: dict[str, np.ndarray] = {}
    if file.is_file():
        with file.open(encoding="utf-8", errors="replace") as stream:
            for text in stream:
                if text[8:72] not in wanted:  # {"key":"…
                    continue
                try:
                    line = CellLine.model_validate_json(text)
                except ValidationError:
                    continue
                found[line.key] = np.array(line.ranks, np.int32)
    return found


def append_cells(file: Path, rows: Sequence[tuple[str, np.ndarray]]) -> None:
    """Append ranks by key, flushed to disk.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    append_lines(file, [CellLine(key=key, ranks=ranks.tolist()).model_dump_json() for key, ranks in rows])
