"""The grid: every variant under every corruption, shard by shard: what `toolkit corrupt-eval` runs."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.benchmark.answers import CLEAN, Answers, Benchmark
from toolkit.benchmark.cells import (
    FAILED,
    Cell,
    Shard,
    append_cells,
    ask,
    corrupt_shown,
    cut_shards,
    load_shard,
    make_key,
    read_cells,
    show_variant,
)
from toolkit.benchmark.variants import Answerer, Variant
from toolkit.boosters.place_patches import Placement, is_whole
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.corruptions import choose_parameters, image_seed
from toolkit.corruptions.request import find_note
from toolkit.imaging.read import UnreadableImage
from toolkit.training.image_set import ImageSet

SHARD_IMAGES = 256
"""Images in memory at once; also what a kill may cost, in one cell."""


@dataclass(frozen=True)
class GridRequest:
    """What is evaluated.

    Attributes:
        images: all of classes that every variant has a picture of.
        variants: see `toolkit.benchmark.variants`.
        corruptions: (name, severity) of each.
        placement, seed: of the pictures; the seed also of the corruptions.
        name: of the run.
    """

    images: ImageSet
    variants: tuple[Variant, ...]
    corruptions: tuple[tuple[str, int], ...]
    placement: Placement = field(default_factory=Placement)
    seed: int = 0
    name: str = ""

    @property
    def cells(self) -> list[Cell]:
        """`clean`, then the corruptions."""
        return [Cell(CLEAN, 0), *(Cell(*one) for one in self.corruptions)]


@dataclass(frozen=True)
class GridResult:
    """A finished grid, and how many answers to single images were computed now, and taken from before."""

    benchmark: Benchmark
    computed: int
    kept: int


Address = tuple[int, Cell, int]
"""Number of the variant, cell, number of the answerer."""


def run_grid(request: GridRequest, cells_file: Path, quiet: bool = False, notes: Sequence[str] = ()) -> GridResult:
    """Ask for every answer that is not in `cells_file` yet, and add it there.

    Memory holds one shard's images, whatever the size of the data set. A killed run goes on with the next cell.

    Args:
        request: what is evaluated.
        cells_file: where answers are kept, for this run and for others.
        quiet: no progress bar.
        notes: what a reader of the tables must know besides.

    Raises:
        ToolkitError: no image can be used, a network's output is not finite, or the disk is full.
    """
    shards = _hash_shards(request, quiet)
    keys = [
        {
            (v, cell, a): make_key(shard, variant, answerer, cell, request.placement, request.seed)
            for v, variant in enumerate(request.variants)
            for a, answerer in enumerate(variant.answerers)
            for cell in request.cells
        }
        for shard in shards
    ]
    found = read_cells(cells_file, {key for own in keys for key in own.values()})
    missing = [[address for address, key in own.items() if key not in found] for own in keys]
    total, todo = _count_answers(shards, keys), _count_answers(shards, missing)
    with progress("Evaluating (answers to images)", total, quiet, total - todo) as bar:
        for shard, own, wanted in zip(shards, keys, missing, strict=True):
            for variant, cell, rows in _answer_shard(request, shard, wanted):
                append_cells(cells_file, [(own[address], ranks) for address, ranks in rows])
                found |= {own[address]: ranks for address, ranks in rows}
                bar.advance(len(shard.images) * len(rows), f"{variant.name} {cell.corruption} {cell.severity or ''}")
    return GridResult(_collect(request, shards, keys, found, notes), todo, total - todo)


def _count_answers(shards: list[Shard], addresses: Sequence[Any]) -> int:
    return sum(len(shard.images) * len(own) for shard, own in zip(shards, addresses, strict=True))


def _hash_shards(request: GridRequest, quiet: bool) -> list[Shard]:
    shards = []
    with progress("Reading images", len(request.images.images), quiet) as bar:
        for shard in cut_shards(request.images, SHARD_IMAGES):
            shards.append(shard)
            bar.advance(len(shard.images))
    if not shards:
        raise ToolkitError(f"{request.images.name} has no images of these classes: name other classes, or other data")
    return shards


def _answer_shard(request: GridRequest, shard: Shard, wanted: Sequence[Address]):
    """(variant, cell, [(address, (n,) ranks)]) of what is wanted; images are decoded once for each preprocessing."""
    groups: dict[Any, dict[int, dict[Cell, list[int]]]] = defaultdict(lambda: defaultdict(lambda: defaultdict(list)))
    for v, cell, a in wanted:
        groups[request.variants[v].classifier.preprocessing][v][cell].append(a)
    for how, of_variants in groups.items():
        pixels, usable = load_shard(request.images, shard, how)
        for v, of_cells in of_variants.items():
            variant = request.variants[v]
            shown = show_variant(pixels, shard, usable, variant, request.placement, request.seed)
            for cell, numbers in of_cells.items():
                answerers: list[Answerer] = [variant.answerers[a] for a in numbers]
                rows = []
                for a, given in zip(numbers, ask(shown, cell, answerers, variant.classifier.device), strict=True):
                    ranks = np.full(len(shard.images), FAILED, np.int32)
                    ranks[usable] = given
                    rows.append(((v, cell, a), ranks))
                yield variant, cell, rows


def _collect(request: GridRequest, shards: list[Shard], keys, found, notes: Sequence[str]) -> Benchmark:
    images = [one for shard in shards for one in shard.images]
    joined = {address: np.concatenate([found[own[address]] for own in keys]) for address in keys[0]}
    usable = np.all([ranks != FAILED for ranks in joined.values()], axis=0)
    failed = [
        *request.images.refused,
        *_explain(request, [one for one, ok in zip(images, usable, strict=True) if not ok]),
    ]
    if not usable.any():
        path, reason = failed[-1]
        raise ToolkitError(f"{request.images.name}: none of its {len(images)} images can be used; {path}: {reason}")
    answers = [
        Answers(variant.name, answerer.name, answerer.kind, cell.corruption, cell.severity, joined[v, cell, a][usable])
        for v, variant in enumerate(request.variants)
        for a, answerer in enumerate(variant.answerers)
        for cell in request.cells
    ]
    classes = np.array([one.class_index for one in images])[usable]
    ids = tuple(one.id for one, ok in zip(images, usable, strict=True) if ok)
    labels = {int(index): request.variants[0].classifier.labels[index] for index in np.unique(classes)}
    note = find_note(list(dict.fromkeys(name for name, _ in request.corruptions)))
    return Benchmark(
        describe(request, ids), ids, classes, labels, tuple(answers), tuple(failed), (*notes, *([note] if note else []))
    )


def _explain(request: GridRequest, images) -> list[tuple[str, str]]:
    lines = []
    for image in images:
        try:
            for how in {variant.classifier.preprocessing for variant in request.variants}:
                request.images.load(image, how)
        except UnreadableImage as error:
            lines.append((image.id, error.reason))
        else:
            lines.append((image.id, "could not be read when it was evaluated, though it can be now: copy it anew"))
    return lines


def describe(request: GridRequest, ids: Sequence[str]) -> dict[str, Any]:
    """What was done, for `summary.json` and the report."""
    main = request.variants[0].classifier
    image_px = main.preprocessing.crop_px
    return {
        "name": request.name or request.images.name,
        "data": request.images.name,
        "model": _describe_network(main),
        "is_imagenet": main.is_imagenet,
        "image_px": image_px,
        "preprocessing": main.preprocessing.describe(),
        "parameters": choose_parameters(image_px, image_px),
        "placement": request.placement.model_dump(),
        "seed": request.seed,
        "variants": [_describe_variant(variant, request, ids) for variant in request.variants],
        "toolkit_version": __version__,
    }


def _describe_network(network: Any) -> dict[str, str]:
    weights = network.weights
    return {"name": network.name, "arch": network.arch, "weights": weights.name, "sha256": weights.sha256}


def _describe_variant(variant: Variant, request: GridRequest, ids: Sequence[str]) -> dict[str, Any]:
    patches = variant.patches
    about = {"name": variant.name, "model": _describe_network(variant.classifier), "patch_px": None, "method": None}
    if patches is None:
        return about
    image_px = variant.classifier.preprocessing.crop_px
    seeds = [image_seed(request.seed, id) for id in ids]
    whole = is_whole(request.placement.place_seeded(seeds, patches.n_px, image_px), patches.n_px, image_px)
    return about | {
        "patch_px": patches.n_px, "method": patches.method, "sha256": patches.sha256,
        "share_whole": float(whole.mean()), "readers": [[one.name, one.version] for one in variant.readers],
    }  # fmt: skip


COLUMNS = 6
TILE_IN, HEAD_IN = 1.55, 0.5
LETTER_IN = 0.085
RIGHT, WRONG = "#009e73", "#d55e00"


def choose_cells(request: GridRequest) -> list[Cell]:
    """Clean, and corruptions spread over those that were run, each at its middle severity."""
    names = list(dict.fromkeys(name for name, _ in request.corruptions))
    picked = [names[k] for k in np.linspace(0, len(names) - 1, min(COLUMNS - 1, len(names))).round().astype(int)]
    chosen = [request.cells[0]]
    for name in picked:
        severities = sorted(severity for other, severity in request.corruptions if other == name)
        chosen.append(Cell(name, severities[len(severities) // 2]))
    return chosen


def draw_examples(request: GridRequest, benchmark: Benchmark) -> bytes:
    """PNG: a row for each variant, a column for each cell; always the image in the middle of the list.

    A green frame says that the network's first guess is right, a red one that it is not.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    chosen, cells = benchmark.ids[len(benchmark.ids) // 2], choose_cells(request)
    number = benchmark.ids.index(chosen)
    image = next(one for one in request.images.images if one.id == chosen)
    shard = Shard((image,), ("",))
    names = [_name(variant, request.variants[0]) for variant in request.variants]
    label_in = 0.3 + LETTER_IN * max(len(line) for name in names for line in name.split("\n"))
    figure = Figure(figsize=(label_in + TILE_IN * len(cells), HEAD_IN + TILE_IN * len(request.variants)))
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(request.variants), len(cells), squeeze=False)
    left = label_in / figure.get_figwidth()
    figure.subplots_adjust(left, 0.01, 0.995, 1 - 0.84 * HEAD_IN / figure.get_figheight(), 0.06, 0.06)
    ranks = {(one.variant, one.answerer, one.corruption, one.severity): one.ranks for one in benchmark.answers}
    for row, variant, name in zip(panels, request.variants, names, strict=True):
        pixels, usable = load_shard(request.images, shard, variant.classifier.preprocessing)
        shown = show_variant(pixels, shard, usable, variant, request.placement, request.seed)
        for panel, cell in zip(row, cells, strict=True):
            panel.imshow(
                corrupt_shown(shown, slice(None), cell)[0].permute(1, 2, 0).numpy(), interpolation="antialiased"
            )
            answer = ranks[variant.name, variant.classifier.name, cell.corruption, cell.severity][number]
            for spine in panel.spines.values():
                spine.set(color=RIGHT if answer == 1 else WRONG, linewidth=3)
            panel.set(xticks=[], yticks=[])
        row[0].set_ylabel(name, rotation=0, ha="right", va="center", fontsize=9, labelpad=8)
    for panel, cell in zip(panels[0], cells, strict=True):
        level = f"\nseverity {cell.severity}" if cell.severity else ""
        panel.set_title(cell.corruption.replace("_", " ") + level, fontsize=9)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=120, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _name(variant: Variant, first: Variant) -> str:
    """The variant, and below it who answers where that is another network."""
    other = variant.classifier is not first.classifier
    return f"{variant.name},\n{variant.classifier.name}" if other else variant.name
