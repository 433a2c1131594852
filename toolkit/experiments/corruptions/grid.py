"""The grid: every variant under every corruption, shard by shard, each cell computed once."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.boosters.place_patches import is_whole
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.locks import hold_folder
from toolkit.corruptions import choose_parameters, image_seed
from toolkit.corruptions.request import find_note
from toolkit.engine.local import InProcess
from toolkit.engine.units import Engine, Outcome, Shared, Unit, check_hope, list_failures
from toolkit.experiments.corruptions.cells import (
    FAILED,
    Shard,
    ShardImages,
    append_cells,
    apply_variant,
    cut_shards,
    load_shard,
    make_key,
    rank_images,
    read_cells,
)
from toolkit.experiments.corruptions.config import CLEAN, Condition, CorruptEvalConfig
from toolkit.experiments.corruptions.recognisers import Recogniser
from toolkit.experiments.corruptions.variants import Variant
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage
from toolkit.models.network import Classifier
from toolkit.training.image_set import ImageSet, LabelledImage

SHARD_IMAGES = 256
"""Images in memory at once; also what a kill may cost, in one cell."""


@dataclass(frozen=True)
class Grid:
    """What is evaluated.

    Attributes:
        images: all of classes that every variant has a picture of.
        variants: see `open_variants`.
        config: corruptions, placement and seed.
    """

    images: ImageSet
    variants: tuple[Variant, ...]
    config: CorruptEvalConfig

    @property
    def name(self) -> str:
        """Of the run."""
        return self.config.run or f"{self.images.name.replace('/', '-')}-{self.variants[0].classifier.name}"


@dataclass(frozen=True)
class CellRanks:
    """What one recogniser said of all images in one cell.

    Attributes:
        variant: what lies on the images: `unpatched`, or the name of a patch set.
        recogniser: name of the network or of the reader.
        kind: `network` or `reader`.
        corruption, severity: of the images; `clean` and 0 where they are not corrupted.
        ranks: (n,) int32, see `Recogniser`.
    """

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
        about: data, model, placement, seed and what the variants are; goes into `summary.json` as it is.
        ids: of the images, in the order of every `ranks`.
        classes: (n,) int, index of each image's class.
        labels: of the classes that are there, by index.
        cells: one for each variant, recogniser and condition.
        failed: (path, reason) of images that could not be used.
        notes: what a reader of the tables must know, a sentence each.
        computed, kept: ranks of single images that were computed now, and taken from before.
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


Address = tuple[int, Condition, int]
"""Number of the variant, condition, number of the recogniser."""


def run_grid(grid: Grid, cells_file: Path, notes: Sequence[str] = (), engine: Engine | None = None) -> Benchmark:
    """Compute every cell that is not in `cells_file` yet, and add it there.

    Memory holds a few shards' images, whatever the size of the data set. A killed run goes on with the next cell. Where
    a cell fails, its condition is left out of the result, and is tried again by the next run.

    Args:
        grid: what is evaluated.
        cells_file: where ranks are kept, for this run and for others.
        notes: what a reader of the tables must know besides.
        engine: where cells are computed; by default in this process.

    Raises:
        ToolkitError: no image can be used, every cell failed, or the disk is full.
    """
    with hold_folder(cells_file.parent):
        return _run_grid(grid, cells_file, notes, engine or InProcess())


def _run_grid(grid: Grid, cells_file: Path, notes: Sequence[str], engine: Engine) -> Benchmark:
    shards = _hash_shards(grid)
    keys = [
        {
            (v, condition, r): make_key(shard, variant, recogniser, condition, grid.config)
            for v, variant in enumerate(grid.variants)
            for r, recogniser in enumerate(variant.recognisers)
            for condition in grid.config.conditions
        }
        for shard in shards
    ]
    found = read_cells(cells_file, {key for own in keys for key in own.values()})
    missing = [[address for address, key in own.items() if key not in found] for own in keys]
    total, todo = _count_ranks(shards, keys), _count_ranks(shards, missing)
    failures: list[Outcome[Task, list[np.ndarray]]] = []
    n_done = 0
    with progress("Evaluating (answers to images)", total, done=total - todo) as bar:
        units = (
            unit
            for shard, own, wanted in zip(shards, keys, missing, strict=True)
            for unit in _list_units(grid, shard, own, wanted, engine)
        )
        for outcome in engine.run(units):
            task = outcome.unit.tag
            if outcome.result is None:
                failures.append(outcome)
                check_hope(failures, n_done)
                continue
            n_done += 1
            rows = list(zip(task.keys, map(task.spread, outcome.result), strict=True))
            append_cells(cells_file, rows)
            found |= dict(rows)
            bar.advance(len(task.usable) * len(rows), outcome.unit.name)
    lost = {outcome.unit.tag.condition for outcome in failures}
    left = [condition for condition in grid.config.conditions if condition not in lost]
    if not left:
        raise ToolkitError(failures[0].reason)
    joined = {
        address: np.concatenate([found[own[address]] for own in keys]) for address in keys[0] if address[1] in left
    }
    images = [one for shard in shards for one in shard.images]
    computed = todo - sum(len(one.unit.tag.usable) * len(one.unit.tag.keys) for one in failures)
    done = _collect(grid, images, joined, notes, conditions=left, computed=computed, kept=total - todo)
    return replace(done, failed=(*done.failed, *list_failures(failures)))


def _count_ranks(shards: list[Shard], addresses: Sequence[Sized]) -> int:
    return sum(len(shard.images) * len(own) for shard, own in zip(shards, addresses, strict=True))


def _hash_shards(grid: Grid) -> list[Shard]:
    shards = []
    with progress("Reading images", len(grid.images.images)) as bar:
        for shard in cut_shards(grid.images, SHARD_IMAGES):
            shards.append(shard)
            bar.advance(len(shard.images))
    if not shards:
        raise ToolkitError(f"{grid.images.name} has no images of these classes: name other classes, or other data")
    return shards


@dataclass(frozen=True)
class Task:
    """What the driver knows of a unit: a variant of a shard's images in one condition.

    Attributes:
        condition: that the images are in.
        keys: of the cell of each recogniser that is asked.
        usable: (n,) bool, which of the shard's images are there.
    """

    condition: Condition
    keys: list[str]
    usable: np.ndarray

    def spread(self, given: np.ndarray) -> np.ndarray:
        """(n,) int32 ranks of all images of the shard, from those of the usable ones."""
        ranks = np.full(len(self.usable), FAILED, np.int32)
        ranks[self.usable] = given
        return ranks


def _list_units(
    grid: Grid, shard: Shard, keys: Mapping[Address, str], wanted: Sequence[Address], engine: Engine
) -> Iterator[Unit[Task, list[np.ndarray]]]:
    """A unit for each variant and condition that is wanted; images are decoded once per preprocessing."""
    by_variant: dict[int, dict[Condition, list[int]]] = defaultdict(lambda: defaultdict(list))
    for v, condition, r in wanted:
        by_variant[v][condition].append(r)
    by_how: dict[Preprocessing, list[int]] = defaultdict(list)
    for v in by_variant:
        by_how[grid.variants[v].classifier.preprocessing].append(v)
    for how, numbers in by_how.items():
        pixels, usable = load_shard(grid.images, shard, how)
        for v in numbers:
            variant = grid.variants[v]
            images = engine.share(apply_variant(pixels, shard, usable, variant, grid.config))
            asked: dict[tuple[int, ...], Shared[list[Recogniser]]] = {}
            for condition, chosen in by_variant[v].items():
                if tuple(chosen) not in asked:
                    asked[tuple(chosen)] = engine.share([variant.recognisers[r] for r in chosen])
                cells = [keys[v, condition, r] for r in chosen]
                name = f"{variant.name} {condition[0]} {condition[1] or ''}".rstrip()
                inputs = (images, condition, asked[tuple(chosen)], variant.classifier.device)
                yield Unit("+".join(cells), rank_cell, inputs, name, Task(condition, cells, usable))


def rank_cell(
    images: Shared[ShardImages], condition: Condition, recognisers: Shared[list[Recogniser]], device: str
) -> Iterator[list[np.ndarray]]:
    """The work of a unit: `rank_images`."""
    yield rank_images(images.get(), condition, recognisers.get(), device)


def _collect(
    grid: Grid,
    images: Sequence[LabelledImage],
    joined: Mapping[Address, np.ndarray],
    notes: Sequence[str],
    *,
    conditions: Sequence[Condition],
    computed: int,
    kept: int,
) -> Benchmark:
    """The ranks of the images that could be used in every cell."""
    usable = np.all([ranks != FAILED for ranks in joined.values()], axis=0)
    unusable = [one for one, ok in zip(images, usable, strict=True) if not ok]
    failed = [*grid.images.refused, *_explain(grid, unusable)]
    if not usable.any():
        path, reason = failed[-1]
        raise ToolkitError(f"{grid.images.name}: none of its {len(images)} images can be used; {path}: {reason}")
    cells = [
        CellRanks(variant.name, recogniser.name, recogniser.kind, *condition, ranks=joined[v, condition, r][usable])
        for v, variant in enumerate(grid.variants)
        for r, recogniser in enumerate(variant.recognisers)
        for condition in conditions
    ]
    classes = np.array([one.class_index for one in images])[usable]
    ids = tuple(one.id for one, ok in zip(images, usable, strict=True) if ok)
    note = find_note(list(dict.fromkeys(name for name, _ in conditions if name != CLEAN)))
    return Benchmark(
        about=describe(grid, ids),
        ids=ids,
        classes=classes,
        labels={int(index): grid.variants[0].classifier.labels[index] for index in np.unique(classes)},
        cells=tuple(cells),
        failed=tuple(failed),
        notes=(*notes, *([note] if note else [])),
        computed=computed,
        kept=kept,
    )


def _explain(grid: Grid, images: Sequence[LabelledImage]) -> list[tuple[str, str]]:
    lines = []
    for image in images:
        try:
            for how in {variant.classifier.preprocessing for variant in grid.variants}:
                grid.images.load(image, how)
        except UnreadableImage as error:
            lines.append((image.id, error.reason))
        else:
            lines.append((image.id, "could not be read when it was evaluated, though it can be now: copy it anew"))
    return lines


def describe(grid: Grid, ids: Sequence[str]) -> dict[str, Any]:
    """What was done, for `summary.json` and the report."""
    main = grid.variants[0].classifier
    image_px = main.preprocessing.crop_px
    return {
        "name": grid.name,
        "data": grid.images.name,
        "model": _describe_network(main),
        "is_imagenet": main.is_imagenet,
        "image_px": image_px,
        "preprocessing": main.preprocessing.describe(),
        "parameters": choose_parameters(image_px, image_px),
        "placement": grid.config.placement.model_dump(),
        "seed": grid.config.seed,
        "variants": [_describe_variant(variant, grid, ids) for variant in grid.variants],
        "toolkit_version": __version__,
    }


def _describe_network(network: Classifier) -> dict[str, str]:
    weights = network.weights
    return {"name": network.name, "arch": network.arch, "weights": weights.name, "sha256": weights.sha256}


def _describe_variant(variant: Variant, grid: Grid, ids: Sequence[str]) -> dict[str, Any]:
    patches = variant.patches
    about = {"name": variant.name, "model": _describe_network(variant.classifier), "patch_px": None, "method": None}
    if patches is None:
        return about
    image_px = variant.classifier.preprocessing.crop_px
    seeds = [image_seed(grid.config.seed, id) for id in ids]
    whole = is_whole(grid.config.placement.place_seeded(seeds, patches.n_px, image_px), patches.n_px, image_px)
    return about | {
        "patch_px": patches.n_px, "method": patches.method, "sha256": patches.sha256,
        "share_whole": float(whole.mean()), "readers": [[one.name, one.version] for one in variant.readers],
    }  # fmt: skip
