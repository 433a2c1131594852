"""All variants of the benchmark in one picture: their means, and below these their corruptions one by one."""

import textwrap
from typing import TYPE_CHECKING, Any

from toolkit.captures.read import UNPATCHED
from toolkit.core.tables import format_percent
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.evaluation.figures import COLOURS, MARKERS, UNPATCHED_COLOUR
from toolkit.experiments.corruptions.benchmark_figures import (
    FEW_PLACES,
    MEAN_COLOUR,
    NOT_DECODED_COLOUR,
    is_reader,
    label_places,
    place_corruptions,
    save_png,
    style_shares,
)
from toolkit.experiments.corruptions.benchmark_summary import Summary
from toolkit.experiments.corruptions.benchmark_verdict import label_row
from toolkit.imaging.plots import make_figure, with_default_style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

WRONG_HATCHED = "#2b2f36"
OVERVIEW_BAR = 0.62
ROW_IN, OVERVIEW_PANEL_IN, OVERVIEW_HEAD_IN = 0.34, 4.2, 1.5
OVERVIEW_MIN_WIDTH_IN, OVERVIEW_MAX_WIDTH_IN, TITLE_CHARACTERS = 7.0, 10.0, 64


@with_default_style
def draw_overview(summary: Summary) -> bytes:
    """PNG: above a bar for each variant and answerer, its mean and interval; below their corruptions one by one.

    Without a mean the bars are those of clean images. A reader's bar is split into right, wrong and not decoded, and
    its marks are hollow.
    """
    several = len(summary.corruptions) > 1
    rows_in = ROW_IN * len(summary.variants)
    width = OVERVIEW_MAX_WIDTH_IN if len(summary.corruptions) > FEW_PLACES else OVERVIEW_MIN_WIDTH_IN
    figure = make_figure(width, OVERVIEW_HEAD_IN + rows_in + (OVERVIEW_PANEL_IN if several else 0))
    if several:
        above, below = figure.subplots(2, 1, height_ratios=[rows_in + 0.4, OVERVIEW_PANEL_IN])
        _draw_corruptions(below, summary)
    else:
        above = figure.subplots()
    handles = _draw_means(above, summary)
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=9)
    return save_png(figure)


def _style(summary: Summary) -> list[dict[str, Any]]:
    """Colour and mark of each row, by its place."""
    styles = []
    for i, row in enumerate(summary.variants):
        colour = UNPATCHED_COLOUR if row.variant == UNPATCHED else COLOURS[(i - 1) % len(COLOURS)]
        # a turn further with every round of the colours, so that no two rows look alike
        marker = MARKERS[(i + i // len(COLOURS)) % len(MARKERS)]
        styles.append({"color": colour, "marker": marker, "mfc": "white" if is_reader(row) else colour})
    return styles


def _draw_means(panel: "Axes", summary: Summary) -> "list[Artist]":
    """Draw the bars; returns what the legend must say."""
    has_mean = any(row.top1 is not None for row in summary.variants)
    styles = _style(summary)
    for y, (row, style) in enumerate(zip(summary.variants, styles, strict=True)):
        share, wrong = (row.top1, row.wrong) if has_mean else (row.clean_top1, row.clean_wrong)
        if share is None:
            continue
        end = 100 * share
        panel.barh(y, end, height=OVERVIEW_BAR, color=style["color"], alpha=0.85, zorder=2)
        if is_reader(row):
            end = 100 * (share + (wrong or 0.0))
            panel.barh(
                y,
                100 * (wrong or 0.0),
                left=100 * share,
                height=OVERVIEW_BAR,
                color=WRONG_HATCHED,
                hatch="////",
                ec="w",
            )
            panel.barh(y, 100 - end, left=end, height=OVERVIEW_BAR, color=NOT_DECODED_COLOUR, zorder=1)
        if has_mean and row.top1_ci95:
            panel.hlines(y, 100 * row.top1_ci95[0], 100 * row.top1_ci95[1], color="#111111", lw=1.6, zorder=4)
        if has_mean and row.clean_top1 is not None:
            panel.plot(100 * row.clean_top1, y, marker="d", ms=7, mfc="white", mec="#111111", zorder=5, clip_on=False)
        panel.plot(-1.6, y, ms=7, clip_on=False, lw=0, zorder=6, mec=style["color"], **style)
        panel.annotate(f"{format_percent(share)} %", (101.5, y), va="center", fontsize=10, annotation_clip=False)
    panel.set_yticks(range(len(summary.variants)), [label_row(summary, row) for row in summary.variants], fontsize=10)
    panel.tick_params(axis="y", length=0, pad=16)
    panel.set_ylim(len(summary.variants) - 0.5, -0.5)
    panel.set_xlim(0, 100)
    panel.grid(axis="x", alpha=0.3)
    panel.set_axisbelow(True)
    panel.spines[["top", "right", "left"]].set_visible(False)
    lines = textwrap.wrap(summary.mean_of if has_mean else "clean images", TITLE_CHARACTERS)
    panel.set_title("\n".join(["Right at the first guess (%)", *lines]), fontsize=11, loc="left")
    has_clean = any(row.clean_top1 is not None for row in summary.variants)
    return _list_marks(has_mean, has_mean and has_clean, any(map(is_reader, summary.variants)))


def _list_marks(has_mean: bool, has_clean: bool, has_reader: bool) -> "list[Artist]":
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = []
    if has_mean:
        handles.append(Line2D([], [], color="#111111", lw=1.6, label="95 % interval"))
    if has_clean:
        handles.append(Line2D([], [], lw=0, marker="d", ms=7, mfc="white", mec="#111111", label="clean images"))
    if has_reader:
        handles.append(Patch(fc=WRONG_HATCHED, ec="w", hatch="////", label="another code read"))
        handles.append(Patch(color=NOT_DECODED_COLOUR, label="no code read"))
    return handles


def _draw_corruptions(panel: "Axes", summary: Summary) -> None:
    places = place_corruptions(summary.corruptions, False)
    families = dict.fromkeys(CORRUPTIONS[name].family for name in summary.corruptions)
    for row, style in zip(summary.variants, _style(summary), strict=True):
        means = summary.means_of(row)
        for family in families:
            names = [name for name in summary.corruptions if CORRUPTIONS[name].family == family]
            x, y = [places[name] for name in names], [100 * means[name].top1 for name in names]
            line = "--" if is_reader(row) else "-"
            panel.plot(x, y, ms=6, lw=1.3, ls=line, mec=style["color"], alpha=0.9, zorder=3, clip_on=False, **style)
    style_shares(panel, "top-1 (%)")
    label_places(panel, places, is_coloured=False)
    for family in families:
        own = [places[name] for name in summary.corruptions if CORRUPTIONS[name].family == family]
        panel.annotate(
            family if family != "extra" else "extra, not in the mean", (sum(own) / len(own), 103), ha="center",
            va="bottom", fontsize=10, color=MEAN_COLOUR, annotation_clip=False,
        )  # fmt: skip
