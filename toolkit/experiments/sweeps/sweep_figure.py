"""The sweep as a picture: top-1 with its interval over the axis, a panel per object and one for all."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolkit.captures.read import POOLED
from toolkit.core.files import write_bytes
from toolkit.evaluation.figures import colour_of, style_panel
from toolkit.evaluation.metrics import PATCHED
from toolkit.experiments.sweeps.axes import Axis
from toolkit.experiments.sweeps.sweep_rows import Sweep
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKERS = (("o", 8.0), ("s", 5.0), ("D", 4.5), ("^", 5.5), ("v", 5.5), ("P", 5.5))
"""Shape and size: the first is the largest, so that it shows where another lies on it."""
MAX_COLUMNS = 3
DODGE, SPREAD = 0.22, 0.6
LONG_NAME, MANY_TICKS = 6, 4


@with_default_style
def draw_sweep(path: Path, sweep: Sweep) -> Path:
    """Write the figure as PNG; an axis with a scale is drawn as lines and bands, one without as dots and bars."""
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
        panel.set_ylabel("top-1 (%)")
    handles, labels = panels[0].get_legend_handles_labels()
    title = f"{sweep.model['name']}: top-1 and its 95 % Wilson interval"
    figure.legend(
        handles, labels, title=title, title_fontsize=12, loc="outside upper center", ncols=len(labels), frameon=False
    )
    missing = "; *: fewer, without an object that cannot be shot there" if sweep.skipped and len(names) > 1 else ""
    figure.supxlabel(sweep.axis.title + missing, fontsize=11)
    return write_bytes(path, encode_figure(figure))


def _draw_panel(panel: "Axes", sweep: Sweep, name: str) -> None:
    has_scale = sweep.axis.is_ordered
    places = {label: float(value) if has_scale else float(i) for i, (label, value) in enumerate(sweep.values.items())}
    shots = max((group.n for group in sweep.groups if group.object == name), default=0)
    for i, variant in enumerate(sweep.variants):
        groups = [own for own in sweep.groups if (own.object, own.variant) == (name, variant) and own.n]
        colour = colour_of((PATCHED, *sweep.variants), variant)  # in every sweep the patch has the same
        shift = 0.0 if has_scale else min(DODGE, SPREAD / len(sweep.variants)) * (i - (len(sweep.variants) - 1) / 2)
        x = [places[group.source] + shift for group in groups]
        y = [100 * (group.top1 or 0.0) for group in groups]
        low, high = ([100 * group.top1_ci95[end] for group in groups] for end in (0, 1))
        marker, side = MARKERS[i % len(MARKERS)]
        style: dict[str, Any] = {"color": colour, "marker": marker, "ms": side, "label": variant, "clip_on": False}
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
    panel.minorticks_off()
    panel.tick_params(labelsize=9)
    panel.set_xlim(*_span(list(places.values()), sweep.axis))
    style_panel(panel, 0, 100)
    title = f"all {len(sweep.objects)} objects" if name == POOLED else name
    panel.set_title(f"{title} (n = {shots} a point)" if shots else f"{title}: cannot be shot", fontsize=11)


def _span(places: list[float], axis: Axis) -> tuple[float, float]:
    """The same for every panel, also where points are missing."""
    low, high = min(places), max(places)
    if not axis.is_ordered:
        return low - 0.5, high + 0.5
    if axis.is_log:
        margin = max((high / low) ** 0.05, 1.05)
        return low / margin, high * margin
    margin = 0.05 * (high - low) or 0.05 * high
    return low - margin, high + margin


def _format_tick(sweep: Sweep, name: str, label: str) -> str:
    """`44` and below it the share of the object's longest side; `*` where objects are missing from the pooled point."""
    value = sweep.values[label]
    text = value if isinstance(value, str) else f"{value:.3g}" if isinstance(value, float) else str(value)
    missing = {skipped for own, skipped, _ in sweep.skipped if own == label}
    if name in missing or (name == POOLED and missing):
        text += "*" if name == POOLED else "\n–"
    share = sweep.sizes.get((label, name), (None, None))[1] if sweep.axis.name == "size" else None
    return text if share is None else f"{text}\n{100 * share:.0f} %"
