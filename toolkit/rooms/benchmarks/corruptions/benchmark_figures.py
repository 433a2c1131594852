"""The benchmark's figures: a variant as in the paper's Figures 12 to 20, and all variants in a picture."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from toolkit.captures.capture import UNPATCHED
from toolkit.core.tables import format_percent
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.style import (
    BLUE,
    CORRECT,
    GREEN,
    LEFT_OUT_COLOUR,
    ORANGE,
    PINK,
    UNPATCHED_COLOUR,
    name_network,
    name_variant,
    style_panel,
)
from toolkit.rooms.benchmarks.corruptions.benchmark_summary import (
    CorruptionMean,
    Summary,
    VariantMean,
    label_row,
    name_corruption,
    name_levels,
)
from toolkit.rooms.benchmarks.corruptions.recognisers import READER

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

FAMILY_COLOURS = {"noise": ORANGE, "blur": BLUE, "weather": GREEN, "digital": PINK, "extra": "#b08000"}
MEAN_COLOUR, WITHOUT_COLOUR = "#4a4f57", "#111111"
RIGHT_COLOUR, WRONG_COLOUR, NOT_DECODED_COLOUR = BLUE, ORANGE, LEFT_OUT_COLOUR
FAMILY_GAP, MEAN_GAP = 0.5, 1.0
FEW_PLACES, MIN_PLACES = 4, 6
MEAN = "mean"
BAR, GROUP, MIN_GROUP = 0.76, 0.84, 3
MIN_WIDTH_IN, MAX_WIDTH_IN, SIDE_IN, STEP_IN = 6.0, 10.0, 2.0, 0.5
HEAD_IN, PANEL_IN = 1.6, 2.7
HIDES_NUMBER, NARROW_COLUMNS = 0.07, 4
WRONG_HATCHED = "#2b2f36"
OVERVIEW_BAR = 0.62
ROW_IN, OVERVIEW_HEAD_IN = 0.34, 1.5
SMALL_COLUMNS, SMALL_IN, SMALL_LABELS_IN, SMALL_LABEL = 4, 1.9, 1.6, 8
SMALL_TITLE_CHARACTERS = 28
OVERVIEW_MIN_WIDTH_IN, OVERVIEW_MAX_WIDTH_IN, TITLE_CHARACTERS = 7.0, 10.0, 64


def place_corruptions(names: Iterable[str], has_mean: bool) -> dict[str, float]:
    """Place corruptions along the axis: a step each, a gap between families, and the mean last."""
    places: dict[str, float] = {}
    x, family = 0.0, None
    for name in names:
        if family not in (None, CORRUPTIONS[name].family):
            x += FAMILY_GAP
        places[name], family = x, CORRUPTIONS[name].family
        x += 1
    if has_mean:
        places[MEAN] = x + (MEAN_GAP if places else 0)
    return places


def label_places(panel: "Axes", places: dict[str, float], is_coloured: bool, size: float = 10) -> None:
    """Write the names of corruptions below a panel, tilted if they are many and in their family's colour if wanted."""
    names = [MEAN if name == MEAN else name_corruption(name) for name in places]
    is_tilted = len(places) > FEW_PLACES
    tilt: dict[str, Any] = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"} if is_tilted else {}
    panel.set_xticks(list(places.values()), names, **tilt)
    panel.tick_params(axis="x", length=0, labelsize=size)
    for tick, name in zip(panel.get_xticklabels(), places, strict=True):
        tick.set_color(colour_of(name) if is_coloured else MEAN_COLOUR)
        tick.set_fontweight("bold" if name == MEAN else "normal")
    # a few bars do not fill the panel
    centre = max(places.values()) / 2
    half = max(centre + 0.7, MIN_PLACES / 2)
    panel.set_xlim(centre - half, centre + half)


def colour_of(name: str) -> str:
    """Return the colour of a corruption's family, or of the mean."""
    return MEAN_COLOUR if name == MEAN else FAMILY_COLOURS[CORRUPTIONS[name].family]


def shade(colour: str, severity: int) -> tuple[float, float, float]:
    """Pale for severity 1 to full for 4, and a little darker for 5."""
    from matplotlib.colors import to_rgb

    white, black = (0.62, 0.45, 0.25, 0.0, 0.0)[severity - 1], 0.35 if severity == 5 else 0.0
    red, green, blue = ((part * (1 - white) + white) * (1 - black) for part in to_rgb(colour))
    return red, green, blue


def style_shares(panel: "Axes", ylabel: str) -> None:
    """Per cent with room for a number above the bars, which hide the grid."""
    style_panel(panel, 0, 108)
    panel.set_ylabel(ylabel)
    panel.set_axisbelow(True)
    panel.spines["left"].set_bounds(0, 100)


def stack_reader(
    panel: "Axes", x: Sequence[float], width: float, right: Sequence[float], wrong: Sequence[float]
) -> None:
    """Draw a reader's bars: right, then wrong, then not decoded, up to 100."""
    base = [0.0] * len(x)
    parts = (right, wrong, [1 - a - b for a, b in zip(right, wrong, strict=True)])
    for shares, colour in zip(parts, (RIGHT_COLOUR, WRONG_COLOUR, NOT_DECODED_COLOUR), strict=True):
        panel.bar(x, [100 * share for share in shares], bottom=base, width=width, color=colour, zorder=2)
        base = [low + 100 * share for low, share in zip(base, shares, strict=True)]


def list_reader_colours() -> "list[Artist]":
    """Legend entries of `stack_reader`."""
    from matplotlib.patches import Patch

    return [
        Patch(color=RIGHT_COLOUR, label="read right"),
        Patch(color=WRONG_COLOUR, label="read wrong"),
        Patch(color=NOT_DECODED_COLOUR, label="not decoded"),
    ]


def is_reader(row: VariantMean) -> bool:
    """Whether a row is of a reader of codes."""
    return row.kind == READER


def save_png(figure: "Figure") -> bytes:
    """The figure as PNG, the same bytes for the same picture."""
    for panel in figure.axes:
        # they are inside the panel anyway, and measuring hundreds of bars takes most of a layout's time
        for artist in (*panel.patches, *panel.collections, *panel.lines):
            artist.set_in_layout(False)
    return encode_figure(figure)


@with_default_style
def draw_variant(summary: Summary, row: VariantMean, title: str = "") -> bytes:
    """PNG of two panels: the average of each corruption, and below it a bar for each severity if there are several.

    Dashed: the images without a patch, same network. A reader's bars are split into right, wrong and not decoded.
    The summary has at least one corruption; `title` is the variant's display name.
    """
    # the figure grows with the number of corruptions, within the width of a page
    places = place_corruptions(summary.corruptions, row.top1 is not None)
    several = len(summary.severities) > 1
    width = min(MAX_WIDTH_IN, max(MIN_WIDTH_IN, SIDE_IN + STEP_IN * len(places)))
    figure = make_figure(width, HEAD_IN + PANEL_IN * (1 + several))
    panels = list(figure.subplots(1 + several, 1, sharex=True, squeeze=False)[:, 0])
    before = summary.unpatched_of(row)
    _draw_averages(panels[0], summary, row, before, places)
    levels = name_levels(summary.severities) if summary.has_same_severities else "the severities that each was run at"
    # below the averages, a bar for each severity
    titles = ["average of " * several + levels]
    if several:
        _draw_severities(panels[1], summary, row, before, places)
        titles.append("each severity, from mild to strong" + (" (pale to dark)" if not is_reader(row) else ""))
        panels[0].tick_params(labelbottom=False)
    for panel, title in zip(panels, titles, strict=True):
        style_shares(panel, "codes read (%)" if is_reader(row) else CORRECT)
        panel.set_title(title, fontsize=11, loc="left")
        panel.tick_params(axis="x", length=0)
    label_places(panels[-1], places, is_coloured=not is_reader(row))
    images = f"{summary.n} image{'s' if summary.n != 1 else ''}"
    who = f"{'read' if is_reader(row) else 'judged'} by {name_network(row.answerer)}, n = {images}"
    figure.suptitle(f"{title or name_variant(row.variant)}, {who}", fontsize=13)
    # a narrow figure wraps its legend
    handles = _list_colours(summary, row, before)
    columns = len(handles) if width == MAX_WIDTH_IN else NARROW_COLUMNS
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return save_png(figure)


def _draw_averages(
    panel: "Axes", summary: Summary, row: VariantMean, before: VariantMean | None, places: dict[str, float]
) -> None:
    own: dict[str, VariantMean | CorruptionMean] = {**summary.means_of(row), MEAN: row}
    without: dict[str, VariantMean | CorruptionMean] = {**summary.means_of(before), MEAN: before} if before else {}
    x, top1 = list(places.values()), [own[name].top1 or 0.0 for name in places]
    if is_reader(row):
        stack_reader(panel, x, BAR, top1, [own[name].wrong or 0.0 for name in places])
    else:
        panel.bar(x, [100 * share for share in top1], width=BAR, color=[colour_of(name) for name in places], zorder=2)
    # intervals of the averages, and marks of the images without patches
    intervals = [(x, own[name].top1_ci95) for name, x in places.items()]
    known = [(x, 100 * interval[0], 100 * interval[1]) for x, interval in intervals if interval]
    places_x, low, high = zip(*known, strict=True) if known else ((), (), ())
    panel.vlines(places_x, low, high, color="#222222", lw=1.3, alpha=0.75, zorder=4)
    marks = {name: without[name].top1 or 0.0 for name in places} if without else {}
    _draw_without(panel, x, BAR, list(marks.values()), "--")
    for name, at, share, (_, interval) in zip(places, x, top1, intervals, strict=True):
        end = max(share, interval[1]) if interval else share
        # a number stands above the mark of the images without patches
        if end < marks.get(name, 0.0) < end + HIDES_NUMBER:
            end = marks[name]
        # a reader's bars have two colours: its numbers need a background
        behind = {"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75 if is_reader(row) else 0}
        panel.annotate(
            format_percent(share), (at, 100 * end), (0, 2), textcoords="offset points", ha="center", va="bottom",
            fontsize=9, fontweight="bold" if name == MEAN else "normal", zorder=6, bbox=behind,
        )  # fmt: skip


def _draw_severities(
    panel: "Axes", summary: Summary, row: VariantMean, before: VariantMean | None, places: dict[str, float]
) -> None:
    cells = summary.cells_of(row)
    without = summary.cells_of(before) if before else {}
    # each severity has a bar beside the others, about the place of its corruption
    step = GROUP / max(len(summary.severities), MIN_GROUP)
    for i, severity in enumerate(summary.severities):
        # corruptions that were run at this severity, and their mean
        ran = [name for name, severities in summary.corruptions.items() if severity in severities]
        members = {name: [name] for name in ran}
        if summary.has_same_severities:
            members[MEAN] = [name for name in ran if name in COMMON]
        keys = {name: [(corruption, severity) for corruption in members.get(name, [])] for name in places}
        names = [name for name in places if keys[name]]
        shown = [keys[name] for name in names]
        x = [places[name] + step * (i - (len(summary.severities) - 1) / 2) for name in names]
        # every cell has the same images, so a mean of shares is the share of the mean
        top1 = [sum(cells[key].top1 for key in own) / len(own) for own in shown]
        if is_reader(row):
            wrong = [sum((cells[key].wrong or 0) / cells[key].n for key in own) / len(own) for own in shown]
            stack_reader(panel, x, step * 0.86, top1, wrong)
        else:
            colours = [shade(colour_of(name), severity) for name in names]
            panel.bar(x, [100 * share for share in top1], width=step * 0.94, color=colours, zorder=2)
        # the same without patches, as a line over each bar
        if without:
            _draw_without(panel, x, step, [sum(without[key].top1 for key in own) / len(own) for own in shown], "-")


def _draw_without(panel: "Axes", x: list[float], width: float, top1: list[float], style: str) -> None:
    if not top1:
        return
    y, left, right = [100 * share for share in top1], [at - width / 2 for at in x], [at + width / 2 for at in x]
    panel.hlines(y, left, right, color="white", lw=2.6, zorder=4)  # shows the black line on a dark bar
    panel.hlines(y, left, right, color=WITHOUT_COLOUR, lw=1.4, ls=style, zorder=5)


def _list_colours(summary: Summary, row: VariantMean, before: VariantMean | None) -> "list[Artist]":
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


@with_default_style
def draw_overview(summary: Summary, names: Mapping[str, str] = MappingProxyType({})) -> bytes:
    """PNG: a bar for each variant and answerer, its mean and interval; then a panel for each with every corruption.

    A panel's black marks are the same answerer without patches. Without a mean the bars are those of clean images. A
    reader's bar is split into right, wrong and not decoded.

    Args:
        summary: of the benchmark.
        names: display names of variants and answerers; others are shown as they are called.
    """
    titles = [_name_row(summary, row, names) for row in summary.variants]
    # without any patches the rows of `unpatched`
    lined = [row for row in summary.variants if row.variant != UNPATCHED] or list(summary.variants)
    columns = min(SMALL_COLUMNS, len(lined))
    bands = -(-len(lined) // columns) if len(summary.corruptions) > 1 else 0
    # above the means, a line each; below them small panels by corruption, if there are several
    rows_in = OVERVIEW_HEAD_IN + ROW_IN * len(summary.variants)
    small_in = bands * SMALL_IN + SMALL_LABELS_IN if bands else 0
    width = OVERVIEW_MAX_WIDTH_IN if len(summary.corruptions) > FEW_PLACES else OVERVIEW_MIN_WIDTH_IN
    figure = make_figure(width, rows_in + small_in)
    if bands:
        halves = figure.subfigures(2, 1, height_ratios=[rows_in, small_in], squeeze=False)[:, 0]
        panel = halves[0].subplots()
        _draw_corruptions(halves[1], summary, lined, names)
    else:
        panel = figure.subplots()
    handles = _draw_means(panel, summary, titles)
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=9)
    return save_png(figure)


def _colour_of_row(row: VariantMean) -> str:
    """Grey without patches, else a colour for networks and another for readers of codes."""
    if row.variant == UNPATCHED:
        return UNPATCHED_COLOUR
    return GREEN if is_reader(row) else BLUE


def _draw_means(panel: "Axes", summary: Summary, titles: Sequence[str]) -> "list[Artist]":
    """Draw the bars; returns the legend's entries."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    has_mean = any(row.top1 is not None for row in summary.variants)
    for y, row in enumerate(summary.variants):
        # without a mean over the common corruptions, clean images are shown
        share, wrong = (row.top1, row.wrong) if has_mean else (row.clean_top1, row.clean_wrong)
        if share is None:
            continue
        end = 100 * share
        panel.barh(y, end, height=OVERVIEW_BAR, color=_colour_of_row(row), alpha=0.85, zorder=2)
        # a reader's bar is whole: read, another code read, no code read
        if is_reader(row):
            end = 100 * (share + (wrong or 0.0))
            misread = 100 * (wrong or 0.0)
            panel.barh(y, misread, left=100 * share, height=OVERVIEW_BAR, color=WRONG_HATCHED, hatch="////", ec="w")
            panel.barh(y, 100 - end, left=end, height=OVERVIEW_BAR, color=NOT_DECODED_COLOUR, zorder=1)
        # interval, and a diamond for clean images
        if has_mean and row.top1_ci95:
            panel.hlines(y, 100 * row.top1_ci95[0], 100 * row.top1_ci95[1], color="#111111", lw=1.6, zorder=4)
        if has_mean and row.clean_top1 is not None:
            panel.plot(100 * row.clean_top1, y, marker="d", ms=7, mfc="white", mec="#111111", zorder=5, clip_on=False)
        # the share beside the bar
        panel.annotate(f"{format_percent(share)} %", (101.5, y), va="center", fontsize=10, annotation_clip=False)
    panel.set_yticks(range(len(titles)), titles, fontsize=10)
    panel.tick_params(axis="y", length=0, pad=6)
    # the first variant on top
    panel.set_ylim(len(summary.variants) - 0.5, -0.5)
    panel.set_xlim(0, 100)
    panel.grid(axis="x", alpha=0.3)
    panel.set_axisbelow(True)
    panel.spines[["top", "right", "left"]].set_visible(False)
    lines = textwrap.wrap(summary.mean_of if has_mean else "clean images", TITLE_CHARACTERS)
    panel.set_title("\n".join([f"{CORRECT}; n = {summary.n} images", *lines]), fontsize=11, loc="left")
    has_clean = any(row.clean_top1 is not None for row in summary.variants)
    # the legend explains only what is drawn
    handles: list[Artist] = []
    if has_mean:
        handles.append(Line2D([], [], color="#111111", lw=1.6, label="95 % interval"))
    if has_mean and has_clean:
        handles.append(Line2D([], [], lw=0, marker="d", ms=7, mfc="white", mec="#111111", label="clean images"))
    if any(map(is_reader, summary.variants)):
        handles.append(Patch(fc=WRONG_HATCHED, ec="w", hatch="////", label="another code read"))
        handles.append(Patch(color=NOT_DECODED_COLOUR, label="no code read"))
    return handles


def _draw_corruptions(
    figure: "SubFigure", summary: Summary, rows: Sequence[VariantMean], names: Mapping[str, str]
) -> None:
    """A panel of bars for each row, on a shared scale; a black mark is the same answerer without patches."""
    places, columns = place_corruptions(summary.corruptions, False), min(SMALL_COLUMNS, len(rows))
    x, colours = list(places.values()), [colour_of(name) for name in places]
    # small multiples: labels only below and at the left, as all panels share their axes
    panels = figure.subplots(-(-len(rows) // columns), columns, sharey=True, squeeze=False)
    for k, panel in enumerate(panels.flat):
        if k >= len(rows):
            panel.set_visible(False)
            continue
        row = rows[k]
        before, means = summary.unpatched_of(row), summary.means_of(row)
        panel.bar(x, [100 * means[name].top1 for name in places], width=BAR, color=colours, zorder=2)
        if before is not None and before is not row:
            without = summary.means_of(before)
            _draw_without(panel, x, BAR, [without[name].top1 for name in places], "-")
        style_panel(panel, 0, 104)
        panel.set_title(textwrap.fill(_name_row(summary, row, names), SMALL_TITLE_CHARACTERS), fontsize=10, loc="left")
        label_places(panel, places, is_coloured=True, size=SMALL_LABEL)
        panel.tick_params(axis="x", labelbottom=k + columns >= len(rows), labelrotation=60)
        if k % columns == 0:
            panel.set_ylabel("correct (%)", fontsize=9)
    if any(row.variant != UNPATCHED and summary.unpatched_of(row) for row in rows):
        figure.suptitle(
            "Each corruption; black marks: the same network without patches", fontsize=11, x=0.01, ha="left"
        )


def _name_row(summary: Summary, row: VariantMean, names: Mapping[str, str]) -> str:
    label = label_row(summary, row)
    variant, answerer = (names.get(one, name_network(name_variant(one))) for one in (row.variant, row.answerer))
    return variant if label == row.variant else f"{variant}, {answerer}"
