"""The results folder of an evaluation in a world: its figures, and `report.html`, which opens with no network."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit.captures.read import POOLED
from toolkit.core.files import write_bytes, write_text
from toolkit.evaluation.page import write_page
from toolkit.evaluation.run_files import PREDICTIONS, SUMMARY, write_run
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.read import read_image
from toolkit.imaging.style import (
    FIFTH,
    LEFT_OUT_COLOUR,
    RIGHT,
    WRONG,
    colour_of,
    name_variant,
    style_panel,
)
from toolkit.rooms.worlds.conditions import CLEAR
from toolkit.rooms.worlds.evaluation.cameras import PlaceCameras
from toolkit.rooms.worlds.evaluation.frames import WeatherKey
from toolkit.rooms.worlds.evaluation.keep import KeptFrames, name_picture
from toolkit.rooms.worlds.evaluation.world_results import (
    WorldResults,
    encode_cameras,
    encode_predictions,
    find_visibility_m,
    format_times,
    format_visibility,
    judge_world,
    pooled,
)
from toolkit.rooms.worlds.evaluation.world_rows import AXES, IN_VIEW, find_ladder, list_extinctions, summarise
from toolkit.rooms.worlds.fog import CONTRAST_LOG

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANEL_IN, HEAD_IN, TILE_IN, LETTER_IN = 3.6, 0.9, 1.35, 0.085
MOST_COLUMNS = 8
Summary = dict[str, Any]


@with_default_style
def draw_weathers(results: WorldResults, summary: Summary) -> bytes | None:
    """PNG: top-5 of each variant through each kind of weather, over its extinction; None where none was run."""
    ladders = find_ladder(results.weathers)
    if not ladders:
        return None
    figure = make_figure(1.0 + 4.2 * len(ladders), HEAD_IN + PANEL_IN)
    panels = figure.subplots(1, len(ladders), squeeze=False, sharey=True)[0]
    rows = pooled(summary)
    halves = {(row["variant"], row["weather"]): row for row in summary["half_lost"]}
    for panel, (kind, ladder) in zip(panels, ladders.items(), strict=True):
        # per kilometre, as weathers are described
        x = 1e3 * list_extinctions(ladder)
        for variant in results.variants:
            colour = colour_of(results.variants, variant)
            own = [rows[variant, name, severity] for name, severity in ladder]
            draw_line(panel, x.tolist(), own, colour, name_variant(variant))
            # the visibility that halves the accuracy, as a hollow mark with a line to the axis
            half = halves[variant, kind]["visibility_m"]
            if half is not None:
                at, level = 1e3 * CONTRAST_LOG / half, 50 * halves[variant, kind]["clear_top5"]
                panel.plot([at, at], [0, level], ls=":", lw=1.2, color=colour)
                panel.plot(at, level, marker="o", mfc="white", mec=colour, ms=7, zorder=6)
        style_panel(panel)
        panel.set_axisbelow(True)
        labels = ["clear", *(f"{find_visibility_m(step):.3g}" for step in ladder[1:])]
        panel.set_xticks(x, labels, fontsize=8, rotation=0 if len(x) < 4 else 45)
        panel.set_xlabel(f"{kind}: visibility, m (evenly by extinction)")
    panels[0].set_ylabel("top-5 correct (%), higher is better")
    panels[0].legend(frameon=False, fontsize=9)
    figure.suptitle("Through weather; hollow: half of the clear air's is lost", fontsize=11)
    return encode_figure(figure)


def draw_line(
    panel: "Axes", x: Sequence[float], rows: Sequence[Summary], colour: str, label: str, style: str = "-"
) -> None:
    """Top-5 of rows of a summary over x, with their intervals where the line is solid."""
    y = [100 * row["top5"] for row in rows]
    panel.plot(x, y, style, color=colour, marker="o", ms=4, lw=1.8, label=label, zorder=4)
    known = [(at, row["top5_ci95"]) for at, row in zip(x, rows, strict=True) if row["top5_ci95"]]
    if known and style == "-":
        places = [at for at, _ in known]
        low, high = ([100 * interval[k] for _, interval in known] for k in (0, 1))
        panel.fill_between(places, low, high, color=colour, alpha=0.15, lw=0)


def choose_weathers(weathers: Sequence[WeatherKey]) -> list[WeatherKey]:
    """Clear air and the middle severity of each kind: what curves over cameras show."""
    ladders = find_ladder(tuple(weathers))
    return [CLEAR, *(ladder[1:][(len(ladder) - 2) // 2] for ladder in ladders.values())]


@with_default_style
def draw_curves(results: WorldResults, summary: Summary) -> bytes:
    """PNG: top-5 by the camera's place; solid in clear conditions, dashed in the first weather's middle severity."""
    figure = make_figure(11, 2 * PANEL_IN)
    panels = figure.subplots(2, 3).ravel()
    # clear air, and a middle severity in dashes
    shown = choose_weathers(results.weathers)[:2]
    for panel, (axis, (title, _)) in zip(panels, AXES.items(), strict=False):
        rows = [row for row in summary["curves"] if row["axis"] == axis]
        bins = list(dict.fromkeys((row["low"], row["high"]) for row in rows))
        for variant in results.variants:
            for weather, style in zip(shown, ("-", "--"), strict=False):
                own = [row for row in rows if (row["variant"], row["weather"], row["severity"]) == (variant, *weather)]
                label = f"{name_variant(variant)}, {name_picture(weather)}"
                draw_line(panel, range(len(own)), own, colour_of(results.variants, variant), label, style)
        style_panel(panel)
        panel.set_axisbelow(True)
        panel.set_xticks(range(len(bins)), [_name_bin(axis, *interval) for interval in bins], fontsize=7.5, rotation=40)
        panel.set_xlabel(title, fontsize=9)
    # five axes in six panels: the last holds the legend
    handles, labels = panels[0].get_legend_handles_labels()
    panels[-1].axis("off")
    panels[-1].legend(handles, labels, frameon=False, loc="center", fontsize=9)
    for panel in (panels[0], panels[3]):
        panel.set_ylabel("top-5 correct (%)", fontsize=9)
    return encode_figure(figure)


def _name_bin(axis: str, low: float, high: float) -> str:
    if axis == "azimuth_deg":
        return f"{(low + high) / 2:.0f}"
    if axis in ("visible_share", "picture_share"):
        return f"{100 * low:.3g}–{100 * min(high, 1):.3g} %"
    return f"{low:.3g}–{high:.3g}"


@with_default_style
def draw_cameras(places: Sequence[PlaceCameras]) -> bytes:
    """PNG: the cameras of each place from above: in view, partly hidden, hidden, left out."""
    columns = min(len(places), 5)
    rows = -(-len(places) // columns)
    figure = make_figure(max(2.4 * columns, 4.5), 0.6 + 2.2 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, place in zip(panels, places, strict=False):
        # points without a camera, then cameras by how much of the object they see
        left = np.array([bool(reason) for reason in place.reasons])
        panel.scatter(*place.points[left, :2].T, s=9, color=LEFT_OUT_COLOUR, marker="x", lw=0.8, label="left out")
        where = np.array([camera.T_world_camera[:2, 3] for camera in place.cameras])
        share = np.array([camera.visible_share for camera in place.cameras])
        hidden = np.array([camera.is_hidden for camera in place.cameras])
        for own, colour, label in (
            (hidden, WRONG, "hidden"), (~hidden & (share < IN_VIEW), FIFTH, "partly hidden"),
            (share >= IN_VIEW, RIGHT, "in view"),
        ):  # fmt: skip
            panel.scatter(*where[own].T, s=9, color=colour, alpha=0.75, lw=0, label=label)
        # the object's footprint
        low, high = place.placed.mesh.bounds
        outline = np.array([(low[0], low[1], 0), (high[0], low[1], 0), (high[0], high[1], 0), (low[0], high[1], 0)])
        panel.fill(*place.placed.stand.to_world(outline)[:, :2].T, color="#333333", zorder=5)
        panel.set_aspect("equal")
        panel.tick_params(labelsize=7)
        panel.set_title(place.placed.spot.name, fontsize=9)
    # the last row may have empty panels
    for panel in panels[len(places) :]:
        panel.axis("off")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=8
    )
    return encode_figure(figure)


@with_default_style
def draw_sample(results: WorldResults, kept: KeptFrames) -> bytes | None:
    """Return a PNG: a camera of each place, a row for each variant, a column for each of some weathers.

    Images are cropped to the object. Green: top-1 correct; yellow: top-5 correct; red: wrong. A place of which a shown
    image failed is left out; None if all places are.
    """
    weathers = _spread(results.weathers)
    names = results.place_names
    shown = [k for k, place in enumerate(results.places) if kept.has_shown(place, results.variants, weathers)]
    rows = [(k, variant) for k in shown for variant in results.variants]
    if not rows:
        return None
    # the longest name or variant decides the margin for the labels
    label_in = 0.3 + LETTER_IN * max(map(len, names))
    label_in = max(label_in, 0.3 + LETTER_IN * max(map(len, results.variants)))
    figure = make_figure(label_in + TILE_IN * len(weathers), 0.7 + TILE_IN * len(rows), layout=None)
    panels = figure.subplots(len(rows), len(weathers), squeeze=False)
    width, height = figure.get_size_inches()
    figure.subplots_adjust(label_in / width, 0.3 / height, 0.995, 1 - 0.38 / height, wspace=0.05, hspace=0.05)
    for line, (k, variant) in zip(panels, rows, strict=True):
        camera = kept.shown[names[k]]
        # answers stand in the order of the places, and in each of its cameras
        number = int(np.flatnonzero(results.place_of == k)[0]) + results.places[k].cameras.index(camera)
        path = kept.path_of(names[k], variant, camera)
        left, top, right, bottom = kept.find_object(path)
        for panel, weather in zip(line, weathers, strict=True):
            image = read_image(kept.folder / path / f"{name_picture(weather)}.png")
            panel.imshow(image[top:bottom, left:right], interpolation="antialiased")
            # a frame in the colour of the answer
            rank = results.answers[variant, weather].true_rank[number]
            colour = RIGHT if rank == 1 else FIFTH if rank <= 5 else WRONG
            for spine in panel.spines.values():
                spine.set(color=colour, linewidth=3)
            panel.set(xticks=[], yticks=[])
        name = names[k] if variant == results.variants[0] else ""
        line[0].set_ylabel(
            f"{name}\n{name_variant(variant)}", rotation=0, ha="right", va="center", fontsize=8, labelpad=6
        )
    for panel, weather in zip(panels[0], weathers, strict=True):
        visibility = find_visibility_m(weather)
        panel.set_title(weather[0] if visibility is None else f"{weather[0]} {visibility:.3g} m", fontsize=8)
    for colour, label in ((RIGHT, "top-1 correct"), (FIFTH, "top-5 correct"), (WRONG, "wrong")):
        panels[0][0].plot([], [], "s", mfc="none", mec=colour, mew=3, ms=9, label=label)
    figure.legend(loc="lower center", ncols=3, frameon=False, fontsize=8)
    return encode_figure(figure)


def _spread(weathers: Sequence[WeatherKey]) -> list[WeatherKey]:
    """At most `MOST_COLUMNS`: clear air, and of each kind severities spread from its thinnest to its densest."""
    ladders = [ladder[1:] for ladder in find_ladder(tuple(weathers)).values()]
    chosen = [CLEAR]
    for ladder in ladders:
        count = min(len(ladder), max(1, (MOST_COLUMNS - 1) // len(ladders)))
        chosen += [ladder[round(k)] for k in np.linspace(0, len(ladder) - 1, count)] if count > 1 else [ladder[-1]]
    return chosen


@dataclass(frozen=True)
class WorldFiles:
    """What was written."""

    summary: Path
    predictions: Path
    cameras: Path
    report: Path
    figures: tuple[Path, ...]
    frames: Path


def write_results(folder: Path, results: WorldResults, kept: KeptFrames, about: Mapping[str, Any]) -> WorldFiles:
    """Write predictions, cameras, figures, the report and last `summary.json`, each whole or not at all.

    Args:
        about: further fields of the summary; its `notes` follow those of the results.

    Raises:
        ToolkitError: the disk is full or may not be written.
    """
    summary = summarise(results)
    summary = {**summary, **about, "notes": [*summary["notes"], *about.get("notes", ())]}
    figures = {
        "sample": draw_sample(results, kept), "weathers": draw_weathers(results, summary),
        "curves": draw_curves(results, summary), "cameras": draw_cameras(results.places),
    }  # fmt: skip
    # a figure without data is left out of the report
    drawn = {name: png for name, png in figures.items() if png is not None}
    files = tuple(write_bytes(folder / "figures" / f"{name}.png", png) for name, png in drawn.items())
    cameras = write_text(folder / "cameras.csv", encode_cameras(results))
    report = write_report(folder / "report.html", summary, drawn)
    # last: where it is, the rest is there as well
    write_run(folder, summary, {PREDICTIONS: encode_predictions(results)})
    return WorldFiles(folder / SUMMARY, folder / PREDICTIONS, cameras, report, files, kept.folder)


def write_report(path: Path, summary: Summary, figures: Mapping[str, bytes]) -> Path:
    """Write the report with its figures in it."""
    context = {
        "title": path.parent.name,
        "summary": summary,
        "about": summary["about"],
        "verdicts": judge_world(summary),
        "groups": list(pooled(summary).values()),
        "in_view": pooled(summary, "groups_in_view"),
        "by_place": [row for row in summary["groups"] if row["place"] != POOLED and row["weather"] == "clear"],
        "pairs": pooled(summary, "pairs"),
        "halves": [
            (row, format_visibility(row), format_times(row, "times"), format_times(row, "same_times"))
            for row in summary["half_lost"]
        ],
        "reasons": sorted({key for row in summary["cameras"] for key in row if key.startswith("left out")}),
        "figures": figures,
    }
    return write_page(path, "toolkit.rooms.worlds.evaluation", "world.html.j2", context)
