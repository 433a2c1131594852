"""The picture of what was shown: one image in every variant, clean and corrupted, framed by what was said of it."""

from collections.abc import Sequence

import numpy as np

from toolkit.evaluation.figures import RIGHT, WRONG
from toolkit.experiments.corruptions.cells import Shard, apply_variant, corrupt_images, load_shard
from toolkit.experiments.corruptions.config import NOT_CORRUPTED, Condition
from toolkit.experiments.corruptions.grid import Benchmark, Grid
from toolkit.experiments.corruptions.variants import Variant
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style

COLUMNS = 6
TILE_IN, HEAD_IN = 1.55, 0.5
LETTER_IN = 0.085


def choose_conditions(corruptions: Sequence[Condition]) -> list[Condition]:
    """Clean, and corruptions spread over those that were run, each at its middle severity."""
    names = list(dict.fromkeys(name for name, _ in corruptions))
    picked = [names[k] for k in np.linspace(0, len(names) - 1, min(COLUMNS - 1, len(names))).round().astype(int)]
    chosen = [NOT_CORRUPTED]
    for name in picked:
        severities = sorted(severity for other, severity in corruptions if other == name)
        chosen.append((name, severities[len(severities) // 2]))
    return chosen


@with_default_style
def draw_examples(grid: Grid, benchmark: Benchmark) -> bytes:
    """PNG: a row for each variant, a column for each condition; always the image in the middle of the list.

    A green frame says that the network's first guess is right, a red one that it is not.
    """
    chosen, conditions = benchmark.ids[len(benchmark.ids) // 2], choose_conditions(grid.config.conditions[1:])
    number = benchmark.ids.index(chosen)
    image = next(one for one in grid.images.images if one.id == chosen)
    shard = Shard((image,), ("",))
    names = [_label_row(variant, grid.variants[0]) for variant in grid.variants]
    label_in = 0.3 + LETTER_IN * max(len(line) for name in names for line in name.split("\n"))
    figure = make_figure(label_in + TILE_IN * len(conditions), HEAD_IN + TILE_IN * len(grid.variants), layout=None)
    panels = figure.subplots(len(grid.variants), len(conditions), squeeze=False)
    left = label_in / figure.get_figwidth()
    top = 1 - 0.84 * HEAD_IN / figure.get_figheight()
    figure.subplots_adjust(left, bottom=0.01, right=0.995, top=top, wspace=0.06, hspace=0.06)
    ranks = {(one.variant, one.recogniser, (one.corruption, one.severity)): one.ranks for one in benchmark.cells}
    for row, variant, name in zip(panels, grid.variants, names, strict=True):
        pixels, usable = load_shard(grid.images, shard, variant.classifier.preprocessing)
        images = apply_variant(pixels, shard, usable, variant, grid.config)
        for panel, condition in zip(row, conditions, strict=True):
            shown = corrupt_images(images, slice(None), condition)[0].permute(1, 2, 0).numpy()
            panel.imshow(shown, interpolation="antialiased")
            rank = ranks[variant.name, variant.classifier.name, condition][number]
            for spine in panel.spines.values():
                spine.set(color=RIGHT if rank == 1 else WRONG, linewidth=3)
            panel.set(xticks=[], yticks=[])
        row[0].set_ylabel(name, rotation=0, ha="right", va="center", fontsize=9, labelpad=8)
    for panel, (corruption, severity) in zip(panels[0], conditions, strict=True):
        level = f"\nseverity {severity}" if severity else ""
        panel.set_title(corruption.replace("_", " ") + level, fontsize=9)
    return encode_figure(figure)


def _label_row(variant: Variant, first: Variant) -> str:
    """The variant, and below it the network where that is another one."""
    other = variant.classifier is not first.classifier
    return f"{variant.name},\n{variant.classifier.name}" if other else variant.name
