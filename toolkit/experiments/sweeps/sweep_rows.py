"""What a sweep found: `sweep-MODEL.json`, `sweep-MODEL.csv`, and the table on the console."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolkit import __version__
from toolkit.captures.read import POOLED
from toolkit.captures.shoot import ShootSettings
from toolkit.core.files import write_json, write_text
from toolkit.core.tables import NONE, build_table, encode_csv, format_interval, format_p, format_percent
from toolkit.evaluation.metrics import Comparison, Group
from toolkit.evaluation.results import Findings
from toolkit.evaluation.summaries import SCHEMA_VERSION, list_reasons
from toolkit.experiments.sweeps.axes import Axis, SweepPoint, Value
from toolkit.rig.variants import ON_PAPER

if TYPE_CHECKING:
    from rich.table import Table

PatchSize = tuple[float | None, float | None]
"""Printed side in mm, and that as a share of the object's longest side."""


@dataclass(frozen=True)
class Sweep:
    """A finished sweep.

    Attributes:
        axis, settings, model: what was varied, what was kept, and which network spoke.
        points: every object at every value, the impossible ones too; the label of a value is the source of its images.
        variants: in order.
        findings: of all images.
    """

    axis: Axis
    settings: ShootSettings
    model: dict[str, str]
    points: tuple[SweepPoint, ...]
    variants: tuple[str, ...]
    findings: Findings

    @cached_property
    def values(self) -> dict[str, Value]:
        """Label -> value, in order."""
        return {point.label: point.value for point in self.points}

    @cached_property
    def objects(self) -> dict[str, float]:
        """Longest side in mm of every object."""
        return {point.object: point.longest_mm for point in self.points}

    @cached_property
    def groups(self) -> list[Group]:
        """As an evaluation has them, value by value."""
        return sorted(self.findings.groups, key=lambda group: list(self.values).index(group.source))

    @cached_property
    def pairs(self) -> list[Comparison]:
        """As an evaluation has them, value by value."""
        return sorted(self.findings.pairs, key=lambda pair: list(self.values).index(pair.source))

    @cached_property
    def sizes(self) -> dict[tuple[str, str], PatchSize]:
        """(label, object) -> size of its patch; pooled where all objects agree, nothing where there is no patch."""
        sizes: dict[tuple[str, str], PatchSize] = {}
        for one in self.points:
            if one.refused is None and one.patch_mm is not None:
                sizes[one.label, one.object] = (one.patch_mm, round(one.patch_mm / one.longest_mm, 4))
        for label in {label for label, _ in sizes}:
            sides, shares = zip(*(size for (of, _), size in sizes.items() if of == label), strict=True)
            sizes[label, POOLED] = (_agreed(sides), _agreed(shares))
        return sizes

    @cached_property
    def skipped(self) -> list[tuple[str, str, str]]:
        """(label, object, reason) of what could not be shot."""
        return [(one.label, one.object, one.refused) for one in self.points if one.refused is not None]

    @property
    def failed(self) -> tuple[tuple[str, str], ...]:
        """(path, reason) of images that could not be read."""
        return self.findings.failed

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A row of the files for each group: what `summary.json` has of it, its value and the size of its patch."""
        return [self._row(group) for group in self.groups]

    def _row(self, group: Group) -> dict[str, Any]:
        found = group.as_json()
        label = found.pop("source")
        size = self.sizes.get((label, group.object), (None, None)) if group.variant in ON_PAPER else (None, None)
        found["ci95"] = found.pop("top1_ci95")
        order = ("object", "variant", "n", "failed", "top1", "top5", "ci95", "mean_true_prob")
        row = {"value": self.values[label], "label": label} | {name: found[name] for name in order}
        return row | {"patch_mm": size[0], "patch_share": size[1]}

    @property
    def pair_rows(self) -> list[dict[str, Any]]:
        """What `summary.json` has of each pair, and its value."""
        found = [pair.as_pair() for pair in self.pairs]
        return [{"value": self.values[row["source"]], "label": row.pop("source")} | row for row in found]

    def as_json(self) -> dict[str, Any]:
        """The content of `sweep-MODEL.json`."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "sweep",
            "axis": self.axis.name,
            "unit": self.axis.unit,
            "model": self.model,
            "kept": {key: value for key, value in asdict(self.settings).items() if key != self.axis.name},
            "values": [{"value": value, "label": label} for label, value in self.values.items()],
            "objects": [{"object": name, "longest_mm": round(mm, 3)} for name, mm in self.objects.items()],
            "variants": list(self.variants),
            "rows": self.rows,
            "pairs": self.pair_rows,
            "skipped": [{"label": label, "object": name, "reason": why} for label, name, why in self.skipped],
            "failed": list_reasons(self.failed),
            "toolkit_version": __version__,
        }


def write_sweep(folder: Path, name: str, sweep: Sweep) -> tuple[Path, Path]:
    """Write JSON and CSV."""
    heads = ("top1", "top5", "ci95_low", "ci95_high", "mean_true_prob", "patch_mm", "patch_share")
    tests = ("n_pairs", "gained", "lost", "mcnemar_p")
    who = ("label", "object", "variant")
    paired = {tuple(pair[key] for key in who): pair for pair in sweep.pair_rows}
    cells = []
    for row in sweep.rows:
        pair = paired.get(tuple(row[key] for key in who), {})
        row["ci95_low"], row["ci95_high"] = row["ci95"]
        own = [row[key] for key in ("value", "object", "variant", "n", "failed", *heads)]
        cells.append([*own, *(pair.get(key) for key in tests)])
    text = encode_csv((sweep.axis.name, "object", "variant", "n", "failed", *heads, *tests), cells)
    json_file = write_json(folder / f"sweep-{name}.json", sweep.as_json())
    return json_file, write_text(folder / f"sweep-{name}.csv", text)


def _agreed(values: Sequence[float | None]) -> float | None:
    return values[0] if len(set(values)) == 1 else None


def build_sweep_table(sweep: Sweep) -> "Table":
    """A row per value and variant: n, top-1 and its interval, McNemar's p against bare, then top-1 of each object.

    A printed size is followed by its share of the longest side, where the objects agree on it.
    """
    one = len(sweep.objects) == 1
    name = next(iter(sweep.objects)) if one else POOLED
    others = [] if one else list(sweep.objects)
    groups = {(group.source, group.object, group.variant): group for group in sweep.groups}
    pairs = {(pair.source, pair.object, pair.second): pair for pair in sweep.pairs}
    rows = []
    for label in sweep.values:
        share = sweep.sizes.get((label, name), (None, None))[1]
        shown = f"{label} ({format_percent(share)} %)" if sweep.axis.name == "size" and share else label
        for variant in sweep.variants:
            group, pair = groups.get((label, name, variant)), pairs.get((label, name, variant))
            if group is None or group.top1 is None:
                continue
            numbers = [str(group.n), format_percent(group.top1), format_interval(group.top1_ci95)]
            numbers += [format_percent(group.top5), format_p(pair.outcomes.mcnemar_p if pair else None)]
            each = [groups.get((label, other, variant)) for other in others]
            rows.append([shown, variant, *numbers, *(format_percent(own.top1) if own else NONE for own in each)])
    title = f"{sweep.axis.name}, {sweep.model['name']}, " + (name if one else f"{len(sweep.objects)} objects")
    heads = ("n", "top-1 %", "95 %", "top-5 %", "p", *others)
    return build_table(title, (sweep.axis.name, "variant"), heads, rows)
