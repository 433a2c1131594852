"""Several quantities varied together: a sweep for each combination of the crossed values, and a table of all."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolkit.captures.read import POOLED
from toolkit.core.files import write_text
from toolkit.core.tables import build_table, encode_csv, format_interval, format_percent
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.models.network import Classifier
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.sweeps.sweep import SweepResult, base_setup, run_sweep

if TYPE_CHECKING:
    from rich.table import Table

COLUMNS = ("variant", "n", "correct", "top1", "top1_low", "top1_high")


@dataclass(frozen=True)
class Crossed:
    """Result of a crossed sweep.

    Attributes:
        axes: names of the crossed axes, then of the swept axis.
        cells: a row for each combination of values and each variant, all objects together, also in `csv_file`.
        sweeps: the sweep of each combination.
    """

    axes: tuple[str, ...]
    cells: tuple[dict[str, Any], ...]
    csv_file: Path
    sweeps: tuple[SweepResult, ...]

    @property
    def is_whole(self) -> bool:
        """Whether everything could be shot and read."""
        return not any(result.sweep.skipped or result.sweep.failed for result in self.sweeps)


def run_crossed(
    workspace: Workspace, config: SweepConfig, classifier: Classifier, engine: EngineConfig | None = None
) -> Crossed:
    """Run `run_sweep` for each combination of the values of `config.cross`; raises as it does.

    Combinations have separate captures and reports below `eval/sweeps/AXIS`, and the table is
    `eval/sweeps/AXIS/cross-MODEL.csv`.
    """
    axis, _ = config.parse()
    crossed = config.parse_cross()
    axes = (*(other.name for other, _ in crossed), axis.name)
    cells, made = list[dict[str, Any]](), list[SweepResult]()
    # every combination is a sweep of its own, with captures and a report of its own
    for values in product(*(values for _, values in crossed)):
        base, labels = base_setup(workspace, config), []
        for (other, _), value in zip(crossed, values, strict=True):
            base = other.change(base, value)
            labels.append(other.label(value))
        made.append(run_sweep(workspace, config, classifier, base, engine, apart="-".join(labels)))
        cells += _list_cells(made[-1], axes, labels)
    name = config.run or classifier.name
    table = encode_csv((*axes, *COLUMNS), ([cell[column] for column in (*axes, *COLUMNS)] for cell in cells))
    file = write_text(workspace.eval_dir / "sweeps" / axis.name / f"cross-{name}.csv", table)
    return Crossed(axes, tuple(cells), file, tuple(made))


def _list_cells(result: SweepResult, axes: Sequence[str], labels: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of a sweep for all objects together, or for a single object."""
    sweep = result.sweep
    name = next(iter(sweep.objects)) if len(sweep.objects) == 1 else POOLED
    return [
        dict(zip(axes, (*labels, group.source), strict=True))
        | {
            "variant": group.variant, "n": group.n, "correct": round((group.top1 or 0.0) * group.n),
            **{name: None if share is None else round(share, 4)
               for name, share in zip(COLUMNS[3:], (group.top1, *group.top1_ci95), strict=True)},
        }
        for group in sweep.groups if group.object == name
    ]  # fmt: skip


def build_crossed_table(crossed: Crossed) -> "Table":
    """A row for each combination, and two columns for each variant."""
    variants = list(dict.fromkeys(cell["variant"] for cell in crossed.cells))
    rows: dict[tuple[str, ...], dict[str, dict[str, Any]]] = {}
    for cell in crossed.cells:
        rows.setdefault(tuple(cell[axis] for axis in crossed.axes), {})[cell["variant"]] = cell
    heads = [head for variant in variants for head in (f"{variant} %", "95 %")]
    lines = []
    for key, found in rows.items():
        shares = (_write_share(found.get(variant)) for variant in variants)
        lines.append([*key, *(text for pair in shares for text in pair)])
    count = max(cell["n"] for cell in crossed.cells)
    return build_table(f"{' × '.join(crossed.axes)}, {count} images a cell", list(crossed.axes), heads, lines)


def _write_share(cell: dict[str, Any] | None) -> tuple[str, str]:
    if cell is None or cell["top1"] is None:
        return "", ""
    return format_percent(cell["top1"]), format_interval((cell["top1_low"], cell["top1_high"]))
