"""What the images look like: one of them in every variant, clean and corrupted, framed by the answer."""

from io import BytesIO

import numpy as np

from toolkit.benchmark.answers import Benchmark
from toolkit.benchmark.cells import Cell, Shard
from toolkit.benchmark.run import GridRequest
from toolkit.benchmark.show import corrupt_shown, load_shard, show_variant
from toolkit.benchmark.variants import Variant

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
