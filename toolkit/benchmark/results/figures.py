"""One variant as a picture, as in the paper's Figures 12 to 20: average per corruption, and each severity."""

from typing import Any

from toolkit.benchmark.results.figure_parts import (
    FAMILY_COLOURS,
    MEAN,
    MEAN_COLOUR,
    WITHOUT_COLOUR,
    colour_of,
    is_reader,
    label_places,
    list_reader_colours,
    make_figure,
    place_corruptions,
    save_png,
    shade,
    stack_reader,
    style_panel,
)  # fmt: skip
from toolkit.benchmark.results.say import say_levels, say_percent
from toolkit.benchmark.results.summary import CorruptionMean, Summary, VariantMean
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS

BAR, GROUP, MIN_GROUP = 0.76, 0.84, 3
MIN_WIDTH_IN, MAX_WIDTH_IN, SIDE_IN, STEP_IN = 6.0, 10.0, 2.0, 0.5
HEAD_IN, PANEL_IN = 1.6, 2.7
HIDES_NUMBER, NARROW_COLUMNS = 0.07, 4


def draw_variant(summary: Summary, row: VariantMean) -> bytes:
    """PNG of two panels: the average of each corruption, and below it a bar for each severity where there are several.

    Dashed: the images without a patch, same network. A reader's bars are split into right, wrong and not decoded.
    The summary has at least one corruption.
    """
    places = place_corruptions(summary.corruptions, row.top1 is not None)
    several = len(summary.severities) > 1
    width = min(MAX_WIDTH_IN, max(MIN_WIDTH_IN, SIDE_IN + STEP_IN * len(places)))
    figure = make_figure(width, HEAD_IN + PANEL_IN * (1 + several))
    panels = list(figure.subplots(1 + several, 1, sharex=True, squeeze=False)[:, 0])
    before = summary.unpatched_of(row)
    _draw_averages(panels[0], summary, row, before, places)
    levels = say_levels(summary.severities) if summary.has_same_severities else "the severities that each was run at"
    titles = ["average of " * several + levels]
    if several:
        _draw_severities(panels[1], summary, row, before, places)
        titles.append("each severity, from mild to strong" + (" (pale to dark)" if not is_reader(row) else ""))
        panels[0].tick_params(labelbottom=False)
    for panel, title in zip(panels, titles, strict=True):
        style_panel(panel, "share of codes (%)" if is_reader(row) else "top-1 (%)")
        panel.set_title(title, fontsize=11, loc="left")
        panel.tick_params(axis="x", length=0)
    label_places(panels[-1], places, is_coloured=not is_reader(row))
    images = f"{summary.n} image{'s' if summary.n != 1 else ''}"
    figure.suptitle(f"{row.variant}, {'read' if is_reader(row) else 'seen'} by {row.answerer}, {images}", fontsize=13)
    handles = _list_colours(summary, row, before)
    columns = len(handles) if width == MAX_WIDTH_IN else NARROW_COLUMNS
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return save_png(figure)


def _draw_averages(
    panel: Any, summary: Summary, row: VariantMean, before: VariantMean | None, places: dict[str, float]
) -> None:
    own: dict[str, VariantMean | CorruptionMean] = {**summary.means_of(row), MEAN: row}
    without: dict[str, VariantMean | CorruptionMean] = {**summary.means_of(before), MEAN: before} if before else {}
    x, top1 = list(places.values()), [own[name].top1 or 0.0 for name in places]
    if is_reader(row):
        stack_reader(panel, x, BAR, top1, [own[name].wrong or 0.0 for name in places])
    else:
        panel.bar(x, [100 * share for share in top1], width=BAR, color=[colour_of(name) for name in places], zorder=2)
    intervals = [(x, own[name].top1_ci95) for name, x in places.items()]
    known = [(x, 100 * interval[0], 100 * interval[1]) for x, interval in intervals if interval]
    panel.vlines(*(zip(*known, strict=True) if known else ([], [], [])), color="#222222", lw=1.3, alpha=0.75, zorder=4)
    marks = {name: without[name].top1 or 0.0 for name in places} if without else {}
    _draw_without(panel, x, BAR, list(marks.values()), "--")
    for name, at, share, (_, interval) in zip(places, x, top1, intervals, strict=True):
        end = max(share, interval[1]) if interval else share
        if end < marks.get(name, 0.0) < end + HIDES_NUMBER:
            end = marks[name]
        behind = {"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75 if is_reader(row) else 0}
        panel.annotate(
            say_percent(share), (at, 100 * end), (0, 2), textcoords="offset points", ha="center", va="bottom",
            fontsize=9, fontweight="bold" if name == MEAN else "normal", zorder=6, bbox=behind,
        )  # fmt: skip


def _draw_severities(
    panel: Any, summary: Summary, row: VariantMean, before: VariantMean | None, places: dict[str, float]
) -> None:
    cells = summary.cells_of(row)
    without = summary.cells_of(before) if before else {}
    step = GROUP / max(len(summary.severities), MIN_GROUP)
    for i, severity in enumerate(summary.severities):
        ran = [name for name, severities in summary.corruptions.items() if severity in severities]
        members = {name: [name] for name in ran}
        if summary.has_same_severities:
            members[MEAN] = [name for name in ran if name in COMMON]
        keys = [(place, [(one, severity) for one in members.get(name, [])]) for name, place in places.items()]
        shown = [own for _, own in keys if own]
        x = [place + step * (i - (len(summary.severities) - 1) / 2) for place, own in keys if own]
        # every cell has the same images, so a mean of shares is the share of the mean
        top1 = [sum(cells[key].top1 for key in own) / len(own) for own in shown]
        if is_reader(row):
            wrong = [sum((cells[key].wrong or 0) / cells[key].n for key in own) / len(own) for own in shown]
            stack_reader(panel, x, step * 0.86, top1, wrong)
        else:
            colours = [shade(colour_of(name), severity) for name, (_, own) in zip(places, keys, strict=True) if own]
            panel.bar(x, [100 * share for share in top1], width=step * 0.94, color=colours, zorder=2)
        if without:
            _draw_without(panel, x, step, [sum(without[key].top1 for key in own) / len(own) for own in shown], "-")


def _draw_without(panel: Any, x: list[float], width: float, top1: list[float], style: str) -> None:
    if not top1:
        return
    y, left, right = [100 * one for one in top1], [at - width / 2 for at in x], [at + width / 2 for at in x]
    panel.hlines(y, left, right, color="white", lw=2.6, zorder=4)  # so that the black one shows on a dark bar
    panel.hlines(y, left, right, color=WITHOUT_COLOUR, lw=1.4, ls=style, zorder=5)


def _list_colours(summary: Summary, row: VariantMean, before: VariantMean | None) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    families = dict.fromkeys(CORRUPTIONS[name].family for name in summary.corruptions)
    handles = list_reader_colours()
    if not is_reader(row):
        handles = [
            Patch(color=FAMILY_COLOURS[family], label="extra, not in the mean" if family == "extra" else family)
            for family in families
        ]
        if row.top1 is not None:
            handles.append(Patch(color=MEAN_COLOUR, label=MEAN))
    if row.top1_ci95:
        handles.append(Line2D([], [], color="#222222", lw=1.3, label="95 % interval"))
    if before is not None:
        handles.append(Line2D([], [], color=WITHOUT_COLOUR, lw=1.4, ls="--", label="without patches"))
    return handles
