"""All variants in one picture: the mean of each with its interval, and each corruption."""

import textwrap
from typing import Any

from toolkit.benchmark.answers import UNPATCHED
from toolkit.benchmark.results.figure_parts import (
    FEW_PLACES,
    MEAN_COLOUR,
    NOT_DECODED_COLOUR,
    is_reader,
    label_places,
    make_figure,
    place_corruptions,
    save_png,
    style_panel,
)  # fmt: skip
from toolkit.benchmark.results.say import name_row, say_percent
from toolkit.benchmark.results.summary import Summary
from toolkit.corruptions.catalogue import CORRUPTIONS

UNPATCHED_COLOUR, WRONG_HATCHED = "#6b6f76", "#2b2f36"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKERS = ("o", "s", "D", "^", "v", "P")
BAR = 0.62
ROW_IN, PANEL_IN, HEAD_IN = 0.34, 4.2, 1.5
MIN_WIDTH_IN, MAX_WIDTH_IN, TITLE_CHARACTERS = 7.0, 10.0, 64


def draw_overview(summary: Summary) -> bytes:
    """PNG: above a bar for each variant and answerer, its mean and interval; below their corruptions one by one.

    Without a mean the bars are those of clean images. A reader's bar is split into right, wrong and not decoded, and
    its marks are hollow.
    """
    several = len(summary.corruptions) > 1
    rows_in = ROW_IN * len(summary.variants)
    width = MAX_WIDTH_IN if len(summary.corruptions) > FEW_PLACES else MIN_WIDTH_IN
    figure = make_figure(width, HEAD_IN + rows_in + (PANEL_IN if several else 0))
    if several:
        above, below = figure.subplots(2, 1, height_ratios=[rows_in + 0.4, PANEL_IN])
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


def _draw_means(panel: Any, summary: Summary) -> list[Any]:
    """Draw the bars; returns what the legend must say."""
    has_mean = any(row.top1 is not None for row in summary.variants)
    styles = _style(summary)
    for y, (row, style) in enumerate(zip(summary.variants, styles, strict=True)):
        share, wrong = (row.top1, row.wrong) if has_mean else (row.clean_top1, row.clean_wrong)
        if share is None:
            continue
        end = 100 * share
        panel.barh(y, end, height=BAR, color=style["color"], alpha=0.85, zorder=2)
        if is_reader(row):
            end = 100 * (share + (wrong or 0.0))
            panel.barh(y, 100 * (wrong or 0.0), left=100 * share, height=BAR, color=WRONG_HATCHED, hatch="////", ec="w")
            panel.barh(y, 100 - end, left=end, height=BAR, color=NOT_DECODED_COLOUR, zorder=1)
        if has_mean and row.top1_ci95:
            panel.hlines(y, 100 * row.top1_ci95[0], 100 * row.top1_ci95[1], color="#111111", lw=1.6, zorder=4)
        if has_mean and row.clean_top1 is not None:
            panel.plot(100 * row.clean_top1, y, marker="d", ms=7, mfc="white", mec="#111111", zorder=5, clip_on=False)
        panel.plot(-1.6, y, ms=7, clip_on=False, lw=0, zorder=6, mec=style["color"], **style)
        panel.annotate(f"{say_percent(share)} %", (101.5, y), va="center", fontsize=10, annotation_clip=False)
    panel.set_yticks(range(len(summary.variants)), [name_row(summary, row) for row in summary.variants], fontsize=10)
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


def _list_marks(has_mean: bool, has_clean: bool, has_reader: bool) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    if has_mean:
        handles.append(Line2D([], [], color="#111111", lw=1.6, label="95 % interval"))
    if has_clean:
        handles.append(Line2D([], [], lw=0, marker="d", ms=7, mfc="white", mec="#111111", label="clean images"))
    if has_reader:
        handles.append(Patch(fc=WRONG_HATCHED, ec="w", hatch="////", label="another code read"))
        handles.append(Patch(color=NOT_DECODED_COLOUR, label="no code read"))
    return handles


def _draw_corruptions(panel: Any, summary: Summary) -> None:
    places = place_corruptions(summary.corruptions, False)
    families = dict.fromkeys(CORRUPTIONS[name].family for name in summary.corruptions)
    for row, style in zip(summary.variants, _style(summary), strict=True):
        means = summary.means_of(row)
        for family in families:
            names = [name for name in summary.corruptions if CORRUPTIONS[name].family == family]
            x, y = [places[name] for name in names], [100 * means[name].top1 for name in names]
            line = "--" if is_reader(row) else "-"
            panel.plot(x, y, ms=6, lw=1.3, ls=line, mec=style["color"], alpha=0.9, zorder=3, clip_on=False, **style)
    style_panel(panel, "top-1 (%)")
    label_places(panel, places, is_coloured=False)
    for family in families:
        own = [places[name] for name in summary.corruptions if CORRUPTIONS[name].family == family]
        panel.annotate(
            family if family != "extra" else "extra, not in the mean", (sum(own) / len(own), 103), ha="center",
            va="bottom", fontsize=10, color=MEAN_COLOUR, annotation_clip=False,
        )  # fmt: skip
