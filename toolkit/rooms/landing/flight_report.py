"""Results of flights: success with intervals per cell and paired tests, as files, figures, a page and a film."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from PIL import Image

from toolkit import __version__
from toolkit.core.console import notice
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_bytes
from toolkit.core.statistics import PairedOutcomes, wilson_interval
from toolkit.core.tables import encode_csv
from toolkit.core.threads import map_ahead
from toolkit.core.work import INPUTS, NOWHERE, Work
from toolkit.core.workspace import Workspace
from toolkit.evaluation.metrics import describe_change
from toolkit.evaluation.page import write_page
from toolkit.evaluation.run_files import (
    CELLS,
    EPISODES,
    explain_run_dir,
    find_run_dir,
    lacks_other_inputs,
    write_run,
)
from toolkit.evaluation.summaries import SCHEMA_VERSION
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.style import AMBER, COLOURS, GREEN, ORANGE, PINK, UNPATCHED_COLOUR, style_panel
from toolkit.rooms.landing.config import EpisodeConfig, FlyConfig
from toolkit.rooms.landing.episodes import OUTCOMES, Flights
from toolkit.rooms.landing.fly import FLIGHTS, TICKS, EpisodeRecord, FlightCell, Flown, load_predictors
from toolkit.rooms.landing.regressor import list_regressors, load_regressor
from toolkit.rooms.landing.site import PadSite, SiteView, find_pad, find_sky, find_world
from toolkit.rooms.worlds.depth_weather import describe_weathers

LINE_COLOURS = (UNPATCHED_COLOUR, *COLOURS, "#f0e442")
OUTCOME_COLOURS = {
    "success": GREEN, "missed": AMBER, "crashed": ORANGE, "lost": PINK, "timed_out": UNPATCHED_COLOUR,
    "diverged": "#000000",
}  # fmt: skip
FILM_PX, TRACK_COLUMNS, MOST_TRACKED = 480, 3, 9
LOOP_PX, LOOP_QUALITY = 640, 60


@dataclass(frozen=True)
class CellResult:
    """The episodes of a cell."""

    cell: FlightCell
    records: tuple[EpisodeRecord, ...]  # in order of their index

    @property
    def n(self) -> int:
        """Episodes."""
        return len(self.records)

    def count(self, outcome: str) -> int:
        """Episodes that ended so."""
        return sum(record.outcome == outcome for record in self.records)

    @property
    def success(self) -> float:
        """Share of successes."""
        return self.count("success") / self.n

    @property
    def success_ci95(self) -> tuple[float, float]:
        """Wilson's interval of it."""
        return wilson_interval(self.count("success"), self.n)

    def as_json(self) -> dict[str, Any]:
        """A row of `cells`."""
        landed = [record for record in self.records if record.error_m is not None]
        times = [record.time_s for record in self.records if record.outcome == "success"]
        paths = [record.path_m for record in self.records if record.outcome == "success"]
        return {
            **vars(self.cell), "n": self.n, "success": round(self.success, 4),
            "success_ci95": [round(value, 4) for value in self.success_ci95],
            **{outcome: self.count(outcome) for outcome in OUTCOMES if outcome != "success"},
            "median_error_m": _median([record.error_m for record in landed]), "median_time_s": _median(times),
            "median_path_m": _median(paths),
        }  # fmt: skip


def _median(values: Sequence[float | None]) -> float | None:
    some = [value for value in values if value is not None]
    return round(float(np.median(some)), 4) if some else None


@dataclass(frozen=True)
class PairResult:
    """Two cells, episode by episode."""

    cell: FlightCell  # cell, against: which
    against: FlightCell
    outcomes: PairedOutcomes  # successes of `against`, then of `cell`

    @property
    def other(self) -> str:
        """Differences of `against`: `pad plain`, or `pad plain, regressor net`."""
        names = ("pad", "regressor", "gains")
        theirs = {name: getattr(self.against, name) for name in names}
        return ", ".join(f"{name} {value}" for name, value in theirs.items() if value != getattr(self.cell, name))

    def as_json(self) -> dict[str, Any]:
        """A row of `pairs`."""
        return {"cell": self.cell.key, "against": self.against.key, **describe_change(self.outcomes)}


def group_cells(flown: Flown) -> list[CellResult]:
    """Results in the order of the cells."""
    by_cell: dict[FlightCell, list[EpisodeRecord]] = {cell: [] for cell in flown.cells}
    for episode in flown.records:
        by_cell[episode.cell].append(episode)
    return [CellResult(cell, tuple(sorted(some, key=lambda record: record.index))) for cell, some in by_cell.items()]


def pair_cells(results: Sequence[CellResult]) -> list[PairResult]:
    """Each pad against the first, each regressor against the first on the same pad, each gains against the first.

    If pad and regressor both differ, as for a regressor trained on a boosted pad, also against both first.
    """
    known = {result.cell: result for result in results}
    pairs = []
    for names in (("pad",), ("regressor",), ("gains",), ("pad", "regressor")):
        # a cell's partner is the cell that differs in these settings only
        first = {name: getattr(results[0].cell, name) for name in names}
        for cell_result in results:
            other = known.get(replace(cell_result.cell, **first))
            if other is not None and all(getattr(cell_result.cell, name) != value for name, value in first.items()):
                pairs.append(_compare(cell_result, other))
    return pairs


def _compare(result: CellResult, other: CellResult) -> PairResult:
    both = zip(other.records, result.records, strict=True)
    outcomes = PairedOutcomes.count((before.outcome == "success", now.outcome == "success") for before, now in both)
    return PairResult(result.cell, other.cell, outcomes)


def place_results(config: FlyConfig, flown: Flown, seed: int) -> Flown:
    """The flights with the folder of their results: beside that of another result of the same name."""
    folder = find_run_dir(flown.folder, lacks_other_inputs(_name_run(config, flown, seed)))
    for line in explain_run_dir(flown.folder, folder):
        notice(line)
    return replace(flown, folder=folder)


def _name_run(config: FlyConfig, flown: Flown, seed: int) -> str:
    # an episode's own hash stands for the world, the pads and the regressors' weights
    asked = {name: value for name, value in config.record().items() if name != "name"}
    episodes = sorted({record.inputs for record in flown.records})
    return Work("landing", FLIGHTS.version, old_at=NOWHERE).key(asked, seed, episodes)


def write_summary(
    folder: Path, config: FlyConfig, flown: Flown, seed: int
) -> tuple[list[CellResult], list[PairResult]]:
    """Write `summary.json`, `cells.csv` and `episodes.csv`."""
    results = group_cells(flown)
    pairs = pair_cells(results)
    content = {
        "schema_version": SCHEMA_VERSION,
        "kind": "landing",
        "cells": [result.as_json() for result in results],
        "pairs": [pair.as_json() for pair in pairs],
        "success_is": describe_success(config.episode),
        "camera_hz": config.episode.camera_hz,
        "places": [{"name": place.name, "centre": list(place.centre)} for place in flown.places],
        "weathers": describe_weathers(config.weathers),
        "settings": config.record(),
        "seed": seed,
        INPUTS: _name_run(config, flown, seed),
        "toolkit_version": __version__,
    }
    rows = [result.as_json() for result in results]
    # an interval takes a single column of the CSV
    spread = [row | {"success_ci95": " ".join(map(str, row["success_ci95"]))} for row in rows]
    episodes = [record.model_dump(exclude={"track", "seen", "inputs"}) for record in flown.records]
    write_run(folder, content, {CELLS: _to_csv(spread), EPISODES: _to_csv(episodes)})
    return results, pairs


def _to_csv(rows: Sequence[dict[str, Any]]) -> str:
    return encode_csv(list(rows[0]), (row.values() for row in rows))


def describe_success(config: EpisodeConfig) -> str:
    """The definitions of outcomes, and how often the camera looks."""
    return f"{config.describe()}; {config.camera_hz:g} pictures a second, {1000 * config.latency_s:g} ms late"


@with_default_style
def draw_success(results: Sequence[CellResult]) -> bytes:
    """PNG: success with its interval over severity, a panel for each weather, clear air at 0 in all."""
    weathers = list(dict.fromkeys(result.cell.weather for result in results if result.cell.weather != "clear")) or [
        "clear"
    ]
    # a line for each combination that is flown, a panel for each weather
    lines: dict[tuple[str, str, str], list[CellResult]] = {}
    for result in results:
        lines.setdefault((result.cell.pad, result.cell.regressor, result.cell.gains), []).append(result)
    figure = make_figure(2 + 3.6 * len(weathers), 4.4)
    panels = figure.subplots(1, len(weathers), sharey=True, squeeze=False)[0]
    for panel, weather in zip(panels, weathers, strict=True):
        for number, (line, flown) in enumerate(lines.items()):
            # clear air is severity 0 of every weather
            own = [result for result in flown if result.cell.weather in (weather, "clear")]
            own.sort(key=lambda result: result.cell.severity)
            if not own:
                continue
            # lines are moved apart a little, so that their intervals do not cover each other
            x = [result.cell.severity + 0.05 * (number - (len(lines) - 1) / 2) for result in own]
            low, high = ([100 * result.success_ci95[end] for result in own] for end in (0, 1))
            colour = LINE_COLOURS[number % len(LINE_COLOURS)]
            panel.vlines(x, low, high, color=colour, lw=1.4, alpha=0.6)
            panel.plot(
                x, [100 * result.success for result in own], "o-", color=colour, lw=1.6, ms=5, label=" · ".join(line)
            )
        panel.set_title(weather, fontsize=11)
        panel.set_xlabel("severity")
        panel.set_xticks(
            sorted({result.cell.severity for result in results if result.cell.weather in (weather, "clear")})
        )
        style_panel(panel, -2, 102)
    # a shared legend above the panels
    panels[0].set_ylabel("success (%)")
    handles, labels = panels[0].get_legend_handles_labels()
    title = f"landings that succeed, 95 % Wilson intervals (n = {results[0].n} a point)"
    figure.legend(handles, labels, title=title, loc="outside upper center", ncols=min(len(labels), 3), frameon=False)
    return encode_figure(figure)


@with_default_style
def draw_tracks(results: Sequence[CellResult], radius_m: float) -> bytes:
    """PNG: the first episodes of some cells from above and from aside, coloured by their end.

    Args:
        radius_m: of the circle that a success is in.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle

    # two rows of panels for each band: from above, and height over distance
    some = pick_cells(results, MOST_TRACKED)
    columns = min(len(some), TRACK_COLUMNS)
    bands = -(-len(some) // columns)
    figure = make_figure(1 + 3.2 * columns, 0.6 + 6.2 * bands)
    panels = figure.subplots(2 * bands, columns, squeeze=False)
    for panel in panels.flat:
        panel.set_visible(False)
    # the same range for all, so that a wide track looks wide
    flown = [np.array(record.track) for result in some for record in result.records if record.track] or [
        np.zeros((1, 3))
    ]
    reach_m = 1.05 * max(radius_m, *(float(np.abs(track[:, :2]).max()) for track in flown))
    away_m = 1.05 * max(radius_m, *(float(np.hypot(track[:, 0], track[:, 1]).max()) for track in flown))
    top_m = 1.05 * max(1.0, *(float(track[:, 2].max()) for track in flown))
    # tracks, coloured by outcome
    for k, cell_result in enumerate(some):
        above, aside = (panels[2 * (k // columns) + row][k % columns] for row in (0, 1))
        above.set_visible(True)
        aside.set_visible(True)
        for record in cell_result.records:
            if record.track:
                track, colour = np.array(record.track), OUTCOME_COLOURS[record.outcome]
                above.plot(track[:, 0], track[:, 1], color=colour, lw=0.9)
                aside.plot(np.hypot(track[:, 0], track[:, 1]), track[:, 2], color=colour, lw=0.9)
        title = (
            f"pad {cell_result.cell.pad}, regressor {cell_result.cell.regressor}\n"
            f"{cell_result.cell.air}, {cell_result.cell.gains} gains: {cell_result.success:.0%} land"
        )
        above.add_patch(Circle((0, 0), radius_m, fill=False, color="#1b1f24", lw=1.2))
        above.set_aspect("equal", adjustable="box")
        above.set_title(title, fontsize=9)
        above.set_xlabel("east (m)", fontsize=9)
        above.grid(alpha=0.3)
        above.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m))
        aside.set_xlabel("aside (m)")
        aside.set(xlim=(0, away_m), ylim=(-0.3, top_m))
        aside.grid(alpha=0.3)
        if k % columns == 0:
            above.set_ylabel("north of the pad (m)")
            aside.set_ylabel("height (m)")
    met = {record.outcome for result in some for record in result.records if record.track}
    lines = [
        Line2D([], [], color=colour, label=name.replace("_", " "))
        for name, colour in OUTCOME_COLOURS.items()
        if name in met
    ]
    figure.legend(handles=lines, loc="outside lower center", ncols=len(lines), frameon=False)
    return encode_figure(figure)


def pick_cells(results: Sequence[CellResult], most: int) -> list[CellResult]:
    """So many cells at most: the first, the last and some between, so that no pad is passed over."""
    if len(results) <= most:
        return list(results)
    return [results[k] for k in np.linspace(0, len(results) - 1, most).round().astype(int)]


def draw_map(record: EpisodeRecord, upto: int, config: FlyConfig, size_px: int = FILM_PX) -> np.ndarray:
    """(size, size, 3) uint8: the way from above up to a picture, what was said of the pad, height at the side."""
    # the map fits the whole track; its scale does not change during the film
    canvas = np.full((size_px, size_px, 3), 246, np.uint8)
    track = np.array(record.track)
    reach = max(1.5, float(np.abs(track[:, :2]).max()) * 1.15)
    scale, middle = size_px * 0.44 / reach, np.array([size_px * 0.45, size_px * 0.5])

    def at(point: np.ndarray) -> tuple[int, int]:
        return round(float(middle[0] + scale * point[0])), round(float(middle[1] - scale * point[1]))

    # a grid of metres, and the circle that counts as a landing
    for metres in range(-int(reach), int(reach) + 1):
        cv2.line(canvas, at(np.array([metres, -reach])), at(np.array([metres, reach])), (226, 228, 232), 1)
        cv2.line(canvas, at(np.array([-reach, metres])), at(np.array([reach, metres])), (226, 228, 232), 1)
    radius_m = config.episode.radius_m
    cv2.circle(canvas, at(np.zeros(2)), round(radius_m * scale), (0, 122, 90), 2, cv2.LINE_AA)
    # the track so far, and where the regressor sees the pad
    for k in range(min(upto, len(track) - 1)):
        cv2.line(canvas, at(track[k]), at(track[k + 1]), (36, 87, 166), 2, cv2.LINE_AA)
    now = track[min(upto, len(track) - 1)]
    said = record.seen[min(upto, len(record.seen) - 1)] if record.seen else None
    if said is not None and now[2] >= config.descent.blind_m:  # lower down it does not look
        cv2.drawMarker(canvas, at(now[:2] + np.array(said)), (194, 65, 12), cv2.MARKER_TILTED_CROSS, 14, 2)
    cv2.circle(canvas, at(now), 6, (20, 24, 28), -1, cv2.LINE_AA)
    # a height scale at the right edge
    top = max(float(track[:, 2].max()), 1.0)
    left, high = round(size_px * 0.93), round(size_px * (0.92 - 0.84 * max(now[2], 0) / top))
    cv2.line(canvas, (left, round(size_px * 0.08)), (left, round(size_px * 0.92)), (160, 166, 174), 2)
    cv2.circle(canvas, (left, high), 7, (20, 24, 28), -1, cv2.LINE_AA)
    legend = f"circle: {radius_m:g} m around the pad   x: where the regressor sees it"
    _write(canvas, legend, (12, size_px - 10), 0.42)
    height = round(float(now[2]), 1) + 0.0  # no -0.0
    _write(canvas, f"{height:.1f} m", (left - 66, high + 5), 0.5)
    return canvas


def _write(
    canvas: np.ndarray, words: str, place: tuple[int, int], size: float, colour: tuple[int, int, int] = (60, 66, 74)
) -> None:
    cv2.putText(canvas, words, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, thickness=1, lineType=cv2.LINE_AA)


@dataclass(frozen=True)
class Film:
    """An episode: the drone's view beside the map, at the pace of the flight."""

    title: str  # of what
    frames: np.ndarray  # (n, h, w, 3) uint8 sRGB; the last frame stays for a second
    hz: float  # frames a second

    def encode_webp(self) -> bytes:
        """A small animated picture that goes round and round, with every second frame."""
        size = (LOOP_PX, LOOP_PX * self.frames.shape[1] // self.frames.shape[2])
        shown = [Image.fromarray(frame).resize(size, Image.Resampling.BOX) for frame in self.frames[::2]]
        file = BytesIO()
        some = {"save_all": True, "append_images": shown[1:], "loop": 0, "quality": LOOP_QUALITY}
        shown[0].save(file, "webp", duration=round(2000 / self.hz), **some)
        return file.getvalue()

    def write(self, path: Path) -> Path:
        """Write an MP4; raises a `ToolkitError` if this build of OpenCV writes no MP4."""
        height, width = self.frames.shape[1:3]
        with TemporaryDirectory() as folder:
            made = Path(folder) / "film.mp4"
            film = cv2.VideoWriter(str(made), cv2.VideoWriter.fourcc(*"mp4v"), self.hz, (width, height))
            if not film.isOpened():
                raise ToolkitError(f"cannot write {path}: this build of OpenCV writes no MP4: leave the film out")
            for frame in self.frames:
                film.write(frame[..., ::-1])
            film.release()
            return write_bytes(path, made.read_bytes())


def _compose(
    pictures: Sequence[np.ndarray], record: EpisodeRecord, k: int, title: str, config: FlyConfig
) -> np.ndarray:
    view = cv2.resize(pictures[min(k, len(pictures) - 1)], (FILM_PX, FILM_PX), interpolation=cv2.INTER_CUBIC)
    both = np.hstack([view, draw_map(record, k, config)])
    bar = np.full((40, both.shape[1], 3), 255, np.uint8)
    end = f": {record.outcome.replace('_', ' ')}" if k == len(record.track) - 1 else ""
    _write(bar, title + end, (12, 26), 0.55, (27, 31, 36))
    return np.vstack([bar, both])


def write_report(
    config: FlyConfig, flown: Flown, results: Sequence[CellResult], pairs: Sequence[PairResult], space: Workspace,
    films: Sequence[Film] = (),
) -> Path:  # fmt: skip
    """Write `report.html`, with the films in it, `success.png` and `tracks.png`; the path of the first."""
    folder, success, tracks = flown.folder, draw_success(results), draw_tracks(results, config.episode.radius_m)
    # classical finders have no record of errors
    own = list_regressors(space)
    errors = [
        load_regressor(space, name).record
        for name in dict.fromkeys(result.cell.regressor for result in results)
        if name in own
    ]
    context = {
        "title": folder.name, "results": results, "pairs": pairs, "outcomes": OUTCOMES[1:],
        "success_is": describe_success(config.episode), "weathers": describe_weathers(config.weathers),
        "settings": [row for row in config.rows() if row[0] != "weathers"], "records": errors, "places": flown.places,
        "success": success, "tracks": tracks, "films": [(film.title, film.encode_webp()) for film in films],
    }  # fmt: skip
    write_bytes(folder / "success.png", success)
    write_bytes(folder / "tracks.png", tracks)
    return write_page(folder / "report.html", "toolkit.rooms.landing", "flights.html.j2", context)


def film_episode(space: Workspace, config: FlyConfig, flown: Flown, record: EpisodeRecord, seed: int) -> Film:
    """Film an episode whose track was kept: what its camera saw is rendered again along the track."""
    number = record.index % len(flown.places)
    _, optics, size_m = load_predictors(space, config, "cpu")
    pad = next(pad for pad in (find_pad(space, word, size_m, seed) for word in config.pads) if pad.name == record.pad)
    world = find_world(config.world, config.world_seed)
    site = PadSite(world, flown.places[number], find_sky(config.time), pad, optics)
    flights = Flights(config.episode, site.centre, site.ground, seed=seed, indices=[record.index])
    views = []
    # the drone is set on its track tick by tick: camera, weather and grain are those of the flight
    for tick, place in enumerate(record.track[:-1]):
        flights.tick, flights.state.position[:, 0] = tick, site.centre + np.array(place)
        pose = flights.camera_poses(np.array([0]))[0]
        views.append(SiteView(pose, seed, record.index * TICKS + tick, (record.weather, record.severity)))
    pictures = list(map_ahead(site.photograph, views))
    title = f"{record.cell.words}, episode {record.index}"
    # the last picture stands for a second
    last, hz = len(record.track) - 1, config.episode.camera_hz
    order = [*range(len(record.track)), *[last] * round(hz)]
    return Film(title, np.stack([_compose(pictures, record, k, title, config) for k in order]), hz)
