"""What a sweep found: `sweep-MODEL.json`, `sweep-MODEL.csv`, and the table on the console."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from toolkit import __version__
from toolkit.captures.read import POOLED
from toolkit.captures.shoot import ShootSettings
from toolkit.core.files import write_json, write_text
from toolkit.evaluation.results import EvaluationResult
from toolkit.models.network import Classifier
from toolkit.rig.variants import ON_PAPER
from toolkit.sweeps.axes import Axis, Unit, Value

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class SweepRow:
    """One object in one variant at one value; `object` is `all` for the pooled row.

    Attributes:
        value, label: of the axis.
        n, failed: images classified, and images that could not be read.
        top1, top5, ci95, mean_true_prob: as in `summary.json`; None without images.
        patch_mm, patch_share: printed side of the patch, and that as a share of the object's longest side; None where
            there is no patch, or where the pooled objects differ.
    """

    value: Value
    label: str
    object: str
    variant: str
    n: int
    failed: int
    top1: float | None
    top5: float | None
    ci95: tuple[float, float]
    mean_true_prob: float | None
    patch_mm: float | None
    patch_share: float | None


@dataclass(frozen=True)
class SweepPair:
    """A variant against `unpatched` at one value, pose by pose; fields as in `summary.json`."""

    value: Value
    label: str
    object: str
    variant: str
    n_pairs: int
    gained: int
    lost: int
    mcnemar_p: float


@dataclass(frozen=True)
class Sweep:
    """A finished sweep.

    Attributes:
        axis, settings, model: what was varied, what was kept, and which network spoke.
        values: (value, label) in order, the impossible ones too.
        objects: longest side in mm of every object.
        variants: in order.
        rows, pairs: value by value, objects in order, pooled last.
        skipped: (label, object, reason) of what could not be shot.
        failed: (path, reason) of images that could not be read.
    """

    axis: Axis
    settings: ShootSettings
    model: dict[str, str]
    values: tuple[tuple[Value, str], ...]
    objects: dict[str, float]
    variants: tuple[str, ...]
    rows: tuple[SweepRow, ...]
    pairs: tuple[SweepPair, ...]
    skipped: tuple[tuple[str, str, str], ...]
    failed: tuple[tuple[str, str], ...]

    def as_json(self) -> dict[str, Any]:
        """The content of `sweep-MODEL.json`."""
        return {
            "schema_version": SCHEMA_VERSION,
            "axis": self.axis.name,
            "unit": self.axis.unit,
            "model": self.model,
            "kept": {key: value for key, value in asdict(self.settings).items() if key != self.axis.name},
            "values": [{"value": value, "label": label} for value, label in self.values],
            "objects": [{"object": name, "longest_mm": round(mm, 3)} for name, mm in self.objects.items()],
            "variants": list(self.variants),
            "rows": [asdict(row) for row in self.rows],
            "pairs": [asdict(pair) for pair in self.pairs],
            "skipped": [{"label": label, "object": name, "reason": why} for label, name, why in self.skipped],
            "failed": [{"path": path, "reason": why} for path, why in self.failed],
            "toolkit_version": __version__,
        }


def collect_rows(
    axis: Axis, units: Sequence[Unit], variants: Sequence[str], settings: ShootSettings, classifier: Classifier,
    evaluation: EvaluationResult,
) -> Sweep:  # fmt: skip
    """The rows of an evaluation, whose sources are the values, as those of a sweep."""
    value_of = {unit.label: unit.value for unit in units}
    rank = {label: i for i, label in enumerate(value_of)}
    sizes = _size_patches(units)
    rows = []
    for group in sorted(evaluation.groups, key=lambda group: rank[group.source]):
        mm, share = sizes.get((group.source, group.object), (None, None))
        has_patch = group.variant in ON_PAPER
        rows.append(
            SweepRow(
                value_of[group.source], group.source, group.object, group.variant, group.n, group.failed,
                group.top1, group.top5, group.top1_ci95, group.mean_true_prob,
                mm if has_patch else None, share if has_patch else None,
            )
        )  # fmt: skip
    pairs = [
        SweepPair(
            value_of[pair.source], pair.source, pair.object, pair.variant, pair.n_pairs, pair.gained, pair.lost,
            pair.mcnemar_p,
        )
        for pair in sorted(evaluation.pairs, key=lambda pair: rank[pair.source])
    ]  # fmt: skip
    weights = classifier.weights
    model = {"name": classifier.name, "arch": classifier.arch, "weights": weights.name, "sha256": weights.sha256}
    return Sweep(
        axis, settings, model,
        tuple((value, label) for label, value in value_of.items()),
        {unit.object: unit.longest_mm for unit in units}, tuple(variants), tuple(rows), tuple(pairs),
        tuple((unit.label, unit.object, unit.refused) for unit in units if unit.refused is not None),
        evaluation.failed,
    )  # fmt: skip


def write_sweep(folder: Path, name: str, sweep: Sweep) -> tuple[Path, Path]:
    """Write JSON and CSV."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    heads = ("top1", "top5", "ci95_low", "ci95_high", "mean_true_prob", "patch_mm", "patch_share")
    tests = ("n_pairs", "gained", "lost", "mcnemar_p")
    table.writerow((sweep.axis.name, "object", "variant", "n", "failed", *heads, *tests))
    paired = {(pair.label, pair.object, pair.variant): pair for pair in sweep.pairs}
    for row in sweep.rows:
        pair = paired.get((row.label, row.object, row.variant))
        cells = [row.value, row.object, row.variant, row.n, row.failed, row.top1, row.top5, *row.ci95]
        cells += [row.mean_true_prob, row.patch_mm, row.patch_share]
        cells += [getattr(pair, field) for field in tests] if pair else [None] * len(tests)
        table.writerow("" if cell is None else cell for cell in cells)
    json_file = write_json(folder / f"sweep-{name}.json", sweep.as_json())
    return json_file, write_text(folder / f"sweep-{name}.csv", text.getvalue())


def _size_patches(units: Sequence[Unit]) -> dict[tuple[str, str], tuple[float | None, float | None]]:
    """(label, object) -> printed side in mm and share of the longest side; pooled where all objects agree."""
    sizes: dict[tuple[str, str], tuple[float | None, float | None]] = {}
    for unit in units:
        if unit.refused is None and unit.patch_mm is not None:
            sizes[unit.label, unit.object] = (unit.patch_mm, round(unit.patch_mm / unit.longest_mm, 4))
    for label in {label for label, _ in sizes}:
        own = list(zip(*(size for (of, _), size in sizes.items() if of == label), strict=True))
        sizes[label, POOLED] = tuple(column[0] if len(set(column)) == 1 else None for column in own)  # type: ignore[assignment]
    return sizes


def build_table(sweep: Sweep) -> Table:
    """A row per value and variant: n, top-1 and its interval, McNemar's p against bare, then top-1 of each object.

    A printed size is followed by its share of the longest side, where the objects agree on it.
    """
    one = len(sweep.objects) == 1
    name = next(iter(sweep.objects)) if one else POOLED
    rows = {(row.label, row.object, row.variant): row for row in sweep.rows}
    pairs = {(pair.label, pair.object, pair.variant): pair for pair in sweep.pairs}
    title = f"{sweep.axis.name}, {sweep.model['name']}, " + (name if one else f"{len(sweep.objects)} objects")
    table = Table(title=Text(title), title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(sweep.axis.name)
    table.add_column("variant")
    for head in ("n", "top-1 %", "95 %", "top-5 %", "p", *([] if one else sweep.objects)):
        table.add_column(head, justify="right", no_wrap=True)
    for _, label in sweep.values:
        shares = [row.patch_share for row in sweep.rows if (row.label, row.object) == (label, name) and row.patch_share]
        shown = f"{label} ({100 * shares[0]:.0f} %)" if sweep.axis.name == "size" and shares else label
        for variant in sweep.variants:
            row, pair = rows.get((label, name, variant)), pairs.get((label, name, variant))
            if row is None or row.top1 is None or row.top5 is None:
                continue
            interval = f"{100 * row.ci95[0]:.0f}–{100 * row.ci95[1]:.0f}"
            p = "" if pair is None else "<0.0001" if pair.mcnemar_p < 1e-4 else f"{pair.mcnemar_p:.2g}"
            numbers = [str(row.n), f"{100 * row.top1:.0f}", interval, f"{100 * row.top5:.0f}", p]
            each = [] if one else [_share(rows.get((label, other, variant))) for other in sweep.objects]
            table.add_row(Text(shown), variant, *numbers, *each)
            shown = ""
    return table


def _share(row) -> str:
    return "–" if row is None or row.top1 is None else f"{100 * row.top1:.0f}"
