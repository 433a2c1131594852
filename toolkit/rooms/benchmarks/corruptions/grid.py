"""The grid: every variant under every corruption, shard by shard, each cell computed once."""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from toolkit import __version__
from toolkit.boosters.apply import is_whole
from toolkit.captures.capture import UNPATCHED
from toolkit.core.console import progress
from toolkit.core.draws import image_seed
from toolkit.core.errors import ToolkitError
from toolkit.core.records import hold_folder
from toolkit.corruptions.catalogue import choose_parameters, find_note
from toolkit.engine.local import InProcess
from toolkit.engine.units import Engine, Ran, Shared, Unit, WorkLog, run_resumable
from toolkit.imaging.read import UnreadableImage
from toolkit.models.identity import describe_network
from toolkit.rooms.benchmarks.corruptions import CLEAN, Condition, CorruptEvalConfig
from toolkit.rooms.benchmarks.corruptions.cells import (
    FAILED,
    CellLine,
    Shard,
    ShardImages,
    Variant,
    apply_variant,
    cut_shards,
    load_shard,
    name_cell,
    rank_images,
)
from toolkit.rooms.benchmarks.corruptions.doubts import find_misnamed, list_doubts
from toolkit.rooms.benchmarks.corruptions.recognisers import RIGHT, Recogniser
from toolkit.training.images import ImageSet, LabelledImage

GroupKey = TypeVar("GroupKey", bound=Hashable)
SHARD_IMAGES = 256
"""Largest number of images in memory, and of answers that a kill loses."""


@dataclass(frozen=True)
class Grid:
    """Images of classes in every variant, the variants (`open_variants`), and corruptions, placement and seed."""

    images: ImageSet
    variants: tuple[Variant, ...]
    config: CorruptEvalConfig

    @property
    def name(self) -> str:
        """Name of the run."""
        return self.config.run or f"{self.images.name.replace('/', '-')}-{self.variants[0].classifier.name}"


@dataclass(frozen=True)
class CellRanks:
    """Ranks (n,) int32 of all images of a cell by a recogniser of a kind, see `Recogniser`."""

    variant: str
    recogniser: str
    kind: str
    corruption: str
    severity: int
    ranks: np.ndarray


@dataclass(frozen=True)
class Benchmark:
    """A finished grid.

    Attributes:
        about: data, model, placement, seed and variants, for `summary.json`.
        ids: of the images, in the order of every `ranks`.
        classes: (n,) int, index of each image's class.
        labels: of these classes, by index.
        cells: a cell for each variant, recogniser and condition.
        failed: (path, reason) of images that could not be used.
        notes: for readers of the tables, a sentence each.
        computed, kept: numbers of new and of earlier ranks of single images.
    """

    about: dict[str, Any]
    ids: tuple[str, ...]
    classes: np.ndarray
    labels: dict[int, str]
    cells: tuple[CellRanks, ...]
    failed: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    computed: int = 0
    kept: int = 0


def run_grid(grid: Grid, cells_file: Path, notes: Sequence[str] = (), engine: Engine | None = None) -> Benchmark:
    """Compute every cell that is not in `cells_file` yet, and add it there.

    Memory holds a few shards' images. A killed run resumes with the next cell. A failed cell excludes its condition
    from the result, and the next run tries it again.

    Args:
        grid: images, variants and conditions.
        cells_file: keeps ranks for all runs.
        notes: for readers of the tables.
        engine: computes the cells; by default this process.

    Raises:
        ToolkitError: no image can be used, every cell failed, or the disk is full.
    """
    with hold_folder(cells_file.parent):
        return _run_grid(grid, cells_file, notes, engine or InProcess())


class Cell(NamedTuple):
    """Numbers of a shard, a variant and a recogniser, and a condition."""

    shard: int
    variant: int
    condition: Condition
    recogniser: int


def _run_grid(grid: Grid, cells_file: Path, notes: Sequence[str], engine: Engine) -> Benchmark:
    shards = _hash_shards(grid)
    keys = {
        Cell(s, v, condition, r): name_cell(shard, variant, recogniser, condition, grid.config)
        for s, shard in enumerate(shards)
        for v, variant in enumerate(grid.variants)
        for r, recogniser in enumerate(variant.recognisers)
        for condition in grid.config.conditions
    }
    # cells of equal inputs share a key, and are computed once
    wanted = {key: cell for cell, key in keys.items()}
    cache = WorkLog(cells_file, CellLine, lambda line: [(line.key, np.array(line.ranks, np.int32))], wanted)
    missing = cache.find_missing(wanted)

    def keep(key: str, cell: Cell, ranks: np.ndarray) -> None:
        cache.add(CellLine(key=key, ranks=ranks.tolist()))

    title, units = "Evaluating (answers to images)", _list_units(grid, shards, missing, engine)
    ran = run_resumable(
        title, wanted, missing, units, keep, engine, cells_file.parent, lambda cell: len(shards[cell.shard].images)
    )
    # a condition that lacks a cell is left out for all: variants are compared under the same conditions
    lost = {cell.condition for cell in cache.find_missing(wanted).values()}
    if lost >= set(grid.config.conditions):
        raise ToolkitError(ran.failed[0][1])
    # ranks of all shards, in their order
    cells = [
        CellRanks(
            variant.name, recogniser.name, recogniser.kind, *condition,
            ranks=np.concatenate([cache.known[keys[Cell(s, v, condition, r)]] for s in range(len(shards))]),
        )
        for v, variant in enumerate(grid.variants)
        for r, recogniser in enumerate(variant.recognisers)
        for condition in grid.config.conditions
        if condition not in lost
    ]  # fmt: skip
    # doubts about the data, and classes that no network recognises
    doubts = list_doubts(grid.images, shards, grid.variants)
    done = _collect(grid, [image for shard in shards for image in shard.images], cells, (*notes, *doubts), ran)
    clean = [cell.ranks == RIGHT for cell in done.cells if (cell.variant, cell.corruption) == (UNPATCHED, CLEAN)]
    misnamed = find_misnamed(clean[0], done.classes, done.labels) if clean else ()
    return replace(done, notes=(*done.notes, *misnamed))


def _hash_shards(grid: Grid) -> list[Shard]:
    shards = []
    with progress("Reading images", len(grid.images.images)) as bar:
        for shard in cut_shards(grid.images, SHARD_IMAGES):
            shards.append(shard)
            bar.advance(len(shard.images))
    if not shards:
        raise ToolkitError(f"{grid.images.name} has no images of these classes: name other classes, or other data")
    return shards


def _list_units(
    grid: Grid, shards: Sequence[Shard], missing: Mapping[str, Cell], engine: Engine
) -> Iterator[Unit[np.ndarray]]:
    """A unit for each variant and condition of a shard; images are decoded once per shard and preprocessing."""
    hows = [variant.classifier.preprocessing for variant in grid.variants]
    for (s, how), in_shard in _group(missing, lambda cell: (cell.shard, hows[cell.variant])).items():
        # sorted so that images are decoded once, patches laid once, and only then corrupted
        pixels, usable = load_shard(grid.images, shards[s], how)
        for v, in_variant in _group(in_shard, lambda cell: cell.variant).items():
            variant = grid.variants[v]
            images = engine.share(apply_variant(pixels, shards[s], usable, variant, grid.config))
            # recognisers go to the workers once, not with every condition
            asked: dict[tuple[int, ...], Shared[list[Recogniser]]] = {}
            for condition, cells in _group(in_variant, lambda cell: cell.condition).items():
                chosen = tuple(cell.recogniser for cell in cells.values())
                if chosen not in asked:
                    asked[chosen] = engine.share([variant.recognisers[r] for r in chosen])
                name = f"{variant.name} {condition[0]} {condition[1] or ''}".rstrip()
                inputs = (images, condition, asked[chosen], variant.classifier.device)
                yield Unit(tuple(cells), rank_cells, inputs, name)


def _group(cells: Mapping[str, Cell], by: Callable[[Cell], GroupKey]) -> dict[GroupKey, dict[str, Cell]]:
    groups: dict[GroupKey, dict[str, Cell]] = defaultdict(dict)
    for key, cell in cells.items():
        groups[by(cell)][key] = cell
    return groups


def rank_cells(
    images: Shared[ShardImages], condition: Condition, recognisers: Shared[list[Recogniser]], device: str
) -> Iterator[np.ndarray]:
    """Do the work of a unit: (n,) int32 ranks of all images of the shard by each recogniser, see `rank_images`."""
    usable = images.get().usable
    for given in rank_images(images.get(), condition, recognisers.get(), device):
        ranks = np.full(len(usable), FAILED, np.int32)
        ranks[usable] = given
        yield ranks


def _collect(
    grid: Grid, images: Sequence[LabelledImage], cells: Sequence[CellRanks], notes: Sequence[str], ran: Ran
) -> Benchmark:
    """Keep the ranks of the images that could be used in every cell."""
    # an image that failed in any cell is left out of all: pairs need the same images
    usable = np.all([cell.ranks != FAILED for cell in cells], axis=0)
    # reasons of unusable images
    unusable = [image for image, ok in zip(images, usable, strict=True) if not ok]
    refused = [*grid.images.refused, *_explain(grid, unusable)]
    if not usable.any():
        path, reason = refused[-1]
        raise ToolkitError(f"{grid.images.name}: none of its {len(images)} images can be used; {path}: {reason}")
    classes = np.array([image.class_index for image in images])[usable]
    ids = tuple(image.id for image, ok in zip(images, usable, strict=True) if ok)
    note = find_note(list(dict.fromkeys(cell.corruption for cell in cells if cell.corruption != CLEAN)))
    return Benchmark(
        about=describe(grid, ids), ids=ids, classes=classes,
        labels={int(index): grid.variants[0].classifier.labels[index] for index in np.unique(classes)},
        cells=tuple(replace(cell, ranks=cell.ranks[usable]) for cell in cells), failed=(*refused, *ran.failed),
        notes=(*notes, *([note] if note else [])), computed=ran.made, kept=ran.kept,
    )  # fmt: skip


def _explain(grid: Grid, images: Sequence[LabelledImage]) -> list[tuple[str, str]]:
    lines = []
    for image in images:
        try:
            for how in {variant.classifier.preprocessing for variant in grid.variants}:
                grid.images.load(image, how)
        except UnreadableImage as error:
            lines.append((image.id, error.reason))
        else:
            lines.append((image.id, "could not be read when it was evaluated, though it can be now: copy it again"))
    return lines


def describe(grid: Grid, ids: Sequence[str]) -> dict[str, Any]:
    """Inputs of the run, for `summary.json` and the report."""
    main = grid.variants[0].classifier
    image_px = main.preprocessing.crop_px
    return {
        "name": grid.name, "data": grid.images.name, "model": describe_network(main), "is_imagenet": main.is_imagenet,
        "image_px": image_px, "preprocessing": main.preprocessing.describe(),
        "parameters": choose_parameters(image_px, image_px), "placement": grid.config.placement.model_dump(),
        "seed": grid.config.seed, "variants": [_describe_variant(variant, grid, ids) for variant in grid.variants],
        "toolkit_version": __version__,
    }  # fmt: skip


def _describe_variant(variant: Variant, grid: Grid, ids: Sequence[str]) -> dict[str, Any]:
    patches = variant.patches
    about = {"name": variant.name, "model": describe_network(variant.classifier), "patch_px": None, "method": None}
    if patches is None:
        return about
    image_px = variant.classifier.preprocessing.crop_px
    # the place of each patch, drawn once more from the same seeds
    seeds = [image_seed(grid.config.seed, id) for id in ids]
    whole = is_whole(grid.config.placement.place_seeded(seeds, patches.n_px, image_px), patches.n_px, image_px)
    return about | {
        "patch_px": patches.n_px, "method": patches.method, "sha256": patches.sha256,
        "share_whole": float(whole.mean()), "readers": [[reader.name, reader.version] for reader in variant.readers],
    }  # fmt: skip
