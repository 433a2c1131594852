"""Results of a sweep: `sweep-MODEL.json`, `sweep-MODEL.csv`, the table on the console, and the figure."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolkit import __version__
from toolkit.captures.read import POOLED
from toolkit.captures.shoot import ShootSettings
from toolkit.core.console import console
from toolkit.core.files import write_bytes, write_json, write_text
from toolkit.core.tables import NONE, build_table, encode_csv, format_interval, format_p, format_percent
from toolkit.evaluation.metrics import PATCHED, Comparison, Group
from toolkit.evaluation.results import Findings
from toolkit.evaluation.summaries import SCHEMA_VERSION, list_reasons
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.style import CORRECT, colour_of, name_network, name_variant, style_panel
from toolkit.rig.applied.tag import parse_tag
from toolkit.rig.variants import IN_PIECES, ON_PAPER
from toolkit.rooms.benchmarks.sweeps.axes import Axis, SweepPoint, Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.table import Table

PatchSize = tuple[float | None, float | None]
"""Printed side in mm, and that as a share of the object's longest side."""
MARKERS = (("o", 8.0), ("s", 5.0), ("D", 4.5), ("^", 5.5), ("v", 5.5), ("P", 5.5))
"""Shape and size: the first is the largest, so that it shows below others."""
NEAR_POINTS = 2
MAX_COLUMNS = 3
DODGE, SPREAD = 0.22, 0.6
LONG_NAME, MANY_TICKS = 6, 4


@dataclass(frozen=True)
class Sweep:
    """A finished sweep.

    Attributes:
        points: every object at every value, even if it cannot be shot; a value's label is the source of its images.
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
        """Groups of the evaluation, value by value."""
        # stable: within a value the order stays the evaluation's
        return sorted(self.findings.groups, key=lambda group: list(self.values).index(group.source))

    @cached_property
    def pairs(self) -> list[Comparison]:
        """Pairs of the evaluation, value by value."""
        return sorted(self.findings.pairs, key=lambda pair: list(self.values).index(pair.source))

    @cached_property
    def sizes(self) -> dict[tuple[str, str], PatchSize]:
        """(label, object) -> size of its patch; pooled if all objects agree.

        If a wrap's coverage is varied, the share is that of the visible surface under it; pooled their mean.
        """
        sizes: dict[tuple[str, str], PatchSize] = {}
        for point in self.points:
            if point.refused is None and point.covered is not None:
                sizes[point.label, point.object] = (None, point.covered)
            elif point.refused is None and point.patch_mm is not None:
                sizes[point.label, point.object] = (point.patch_mm, round(point.patch_mm / point.longest_mm, 4))
        # pooled: a size that all objects share, the mean share of a wrap
        for label in {label for label, _ in sizes}:
            sides, shares = zip(*(size for (of, _), size in sizes.items() if of == label), strict=True)
            mean = round(sum(shares) / len(shares), 4)
            sizes[label, POOLED] = (_agreed(sides), mean if self.axis.name == "coverage" else _agreed(shares))
        return sizes

    @cached_property
    def skipped(self) -> list[tuple[str, str, str]]:
        """(label, object, reason) of what could not be shot."""
        return [(point.label, point.object, point.refused) for point in self.points if point.refused is not None]

    @property
    def failed(self) -> tuple[tuple[str, str], ...]:
        """(path, reason) of images that could not be read."""
        return self.findings.failed

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A row of the files for each group: as in `summary.json`, with its value and the size of its patch."""
        return [self._row(group) for group in self.groups]

    def _row(self, group: Group) -> dict[str, Any]:
        found = group.as_json()
        label = found.pop("source")
        size = self.sizes.get((label, group.object), (None, None)) if self._is_sized(group.variant) else (None, None)
        found["ci95"] = found.pop("top1_ci95")
        order = ("object", "variant", "n", "failed", "top1", "top5", "ci95", "mean_true_prob")
        row = {"value": self.values[label], "label": label} | {name: found[name] for name in order}
        return row | {"patch_mm": size[0], "patch_share": size[1]}

    def _is_sized(self, variant: str) -> bool:
        """Whether a variant has a size, or a share that it covers."""
        if self.axis.name == "coverage":
            return variant in IN_PIECES
        return variant in ON_PAPER or parse_tag(variant) is not None

    @cached_property
    def note(self) -> str:
        """Words on the variants without a network's answers, if any."""
        tags = [variant for variant in self.variants if parse_tag(variant) is not None]
        return f"; {', '.join(tags)}: read by OpenCV" if tags else ""

    @property
    def pair_rows(self) -> list[dict[str, Any]]:
        """Pairs as in `summary.json`, with their values."""
        found = [pair.as_pair() for pair in self.pairs]
        return [{"value": self.values[row["source"]], "label": row.pop("source")} | row for row in found]

    def as_json(self) -> dict[str, Any]:
        """The content of `sweep-MODEL.json`."""
        return {
            "schema_version": SCHEMA_VERSION, "kind": "sweep", "axis": self.axis.name, "unit": self.axis.unit,
            "model": self.model,
            "kept": {key: value for key, value in asdict(self.settings).items() if key != self.axis.name},
            "values": [{"value": value, "label": label} for label, value in self.values.items()],
            "objects": [{"object": name, "longest_mm": round(mm, 3)} for name, mm in self.objects.items()],
            "variants": list(self.variants), "rows": self.rows, "pairs": self.pair_rows,
            "skipped": [{"label": label, "object": name, "reason": why} for label, name, why in self.skipped],
            "failed": list_reasons(self.failed), "toolkit_version": __version__,
        }  # fmt: skip


def write_sweep(folder: Path, name: str, sweep: Sweep) -> tuple[Path, Path]:
    """Write JSON and CSV."""
    heads = ("top1", "top5", "ci95_low", "ci95_high", "mean_true_prob", "patch_mm", "patch_share")
    tests = ("n_pairs", "gained", "lost", "mcnemar_p")
    who = ("label", "object", "variant")
    # each row with the tests of its pair
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
    """A row per value and variant: n, top-1 and its interval, McNemar's p against `unpatched`, top-1 of each object.

    The objects need room on the console. A printed size is followed by its share of the longest side, a coverage by
    the share that was reached.
    """
    has_single_object = len(sweep.objects) == 1
    name = next(iter(sweep.objects)) if has_single_object else POOLED
    others = [] if has_single_object else list(sweep.objects)
    # a row for each value and variant that was shot
    groups = {(group.source, group.object, group.variant): group for group in sweep.groups}
    pairs = {(pair.source, pair.object, pair.second): pair for pair in sweep.pairs}
    rows = []
    for label in sweep.values:
        share = _find_share(sweep, name, label)
        shown = f"{label} ({format_percent(share)} %)" if share else label
        for variant in sweep.variants:
            group, pair = groups.get((label, name, variant)), pairs.get((label, name, variant))
            if group is None or group.top1 is None:
                continue
            numbers = [str(group.n), format_percent(group.top1), format_interval(group.top1_ci95)]
            numbers += [format_percent(group.top5), format_p(pair.outcomes.mcnemar_p if pair else None)]
            each = [groups.get((label, other, variant)) for other in others]
            rows.append([shown, variant, *numbers, *(format_percent(own.top1) if own else NONE for own in each)])
    # objects only if they fit the console
    texts, heads = [sweep.axis.name, "variant"], ["n", "top-1 %", "95 %", "top-5 %", "p"]
    columns = zip([*texts, *heads, *others], *rows, strict=True)
    if sum(max(map(len, column)) + 1 for column in columns) > console.width:
        # without the objects, which are in figure and CSV
        others, rows = [], [row[: len(texts) + len(heads)] for row in rows]
    shown = name if has_single_object else f"{len(sweep.objects)} objects"
    title = f"{sweep.axis.name}, {sweep.model['name']}, {shown}{sweep.note}"
    return build_table(title, texts, [*heads, *others], rows)


@with_default_style
def draw_sweep(path: Path, sweep: Sweep) -> Path:
    """Write the figure as PNG; an axis with a scale has lines and bands, other axes dots and bars."""
    names = [*sweep.objects] if len(sweep.objects) == 1 else [POOLED, *sweep.objects]
    columns = min(MAX_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure = make_figure(2 + 3.4 * columns, 1.4 + 2.8 * rows)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).reshape(-1)
    for panel, name in zip(panels, names, strict=False):
        _draw_panel(panel, sweep, name)
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    for panel in panels[: len(names) : columns]:
        panel.set_ylabel("correct (%)")
    # legend and axis title are those of all panels
    handles, labels = panels[0].get_legend_handles_labels()
    title = f"{name_network(sweep.model['name'])}: {CORRECT}, with 95 % Wilson interval{sweep.note}"
    figure.legend(
        handles, labels, title=title, title_fontsize=11, loc="outside upper center", ncols=len(labels), frameon=False
    )
    missing = "; *: fewer, without an object that cannot be shot there" if sweep.skipped and len(names) > 1 else ""
    figure.supxlabel(sweep.axis.title + missing, fontsize=11)
    return write_bytes(path, encode_figure(figure))


def _draw_panel(panel: "Axes", sweep: Sweep, name: str) -> None:
    has_scale = sweep.axis.is_ordered
    # a scale places values by their number, else they stand side by side
    places = {label: float(value) if has_scale else float(i) for i, (label, value) in enumerate(sweep.values.items())}
    shots = max((group.n for group in sweep.groups if group.object == name), default=0)
    for i, variant in enumerate(sweep.variants):
        groups = [own for own in sweep.groups if (own.object, own.variant) == (name, variant) and own.n]
        colour = colour_of((PATCHED, *sweep.variants), variant)  # in every sweep the patch has the same
        # without a scale the variants stand side by side, so that their bars show
        shift = 0.0 if has_scale else min(DODGE, SPREAD / len(sweep.variants)) * (i - (len(sweep.variants) - 1) / 2)
        x = [places[group.source] + shift for group in groups]
        y = [100 * (group.top1 or 0.0) for group in groups]
        low, high = ([100 * group.top1_ci95[end] for group in groups] for end in (0, 1))
        marker, side = MARKERS[i % len(MARKERS)]
        style: dict[str, Any] = {
            "color": colour,
            "marker": marker,
            "ms": side,
            "label": name_variant(variant),
            "clip_on": False,
        }
        if has_scale:
            panel.fill_between(x, low, high, color=colour, alpha=0.18, lw=0)
            panel.plot(x, y, lw=1.8, zorder=3, **style)
        else:
            panel.vlines(x, low, high, color=colour, lw=1.6, alpha=0.6)
            panel.plot(x, y, lw=0, zorder=3, **style)
    if has_scale and sweep.axis.is_log:
        panel.set_xscale("log")
    ticks = [_format_tick(sweep, name, label) for label in sweep.values]
    tilted = not has_scale and max(map(len, ticks)) > LONG_NAME and len(ticks) > MANY_TICKS
    panel.set_xticks(list(places.values()), ticks, rotation=30 if tilted else 0, ha="right" if tilted else "center")
    # a logarithmic axis adds ticks at other values
    panel.minorticks_off()
    panel.tick_params(labelsize=9)
    panel.set_xlim(*_span(list(places.values()), sweep.axis))
    style_panel(panel, 0, 100)
    title = f"all {len(sweep.objects)} objects" if name == POOLED else name
    panel.set_title(f"{title} (n = {shots} per point)" if shots else f"{title}: cannot be shot", fontsize=11)


def _span(places: list[float], axis: Axis) -> tuple[float, float]:
    """Limits of every panel, also without all points."""
    low, high = min(places), max(places)
    if not axis.is_ordered:
        return low - 0.5, high + 0.5
    if axis.is_log:
        # in proportion: the axis is logarithmic
        margin = max((high / low) ** 0.05, 1.05)
        return low / margin, high * margin
    # a single value has no span to take a share of
    margin = 0.05 * (high - low) or 0.05 * high
    return low - margin, high + margin


def _format_tick(sweep: Sweep, name: str, label: str) -> str:
    """Value and the share of the object's longest side; `*` if objects are missing from the pooled point."""
    value = sweep.values[label]
    text = value if isinstance(value, str) else f"{value:.3g}" if isinstance(value, float) else str(value)
    missing = {skipped for own, skipped, _ in sweep.skipped if own == label}
    if name in missing or (name == POOLED and missing):
        text += "*" if name == POOLED else "\n–"
    share = _find_share(sweep, name, label)
    return text if share is None else f"{text}\n{100 * share:.0f} %"


def _find_share(sweep: Sweep, name: str, label: str) -> float | None:
    """Share of a size in the longest side; share that a wrap covers, if that differs from the value."""
    share, asked = sweep.sizes.get((label, name), (None, None))[1], sweep.values[label]
    if sweep.axis.name == "coverage" and share is not None and isinstance(asked, float | int):
        return share if abs(100 * share - asked) > NEAR_POINTS else None
    return share if sweep.axis.name == "size" else None
