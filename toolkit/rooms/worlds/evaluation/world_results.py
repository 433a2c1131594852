"""The answers of a run beside what they were given to, its CSV files, and its summary in words and on the console."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from rich.table import Table

from toolkit.captures.capture import UNPATCHED
from toolkit.captures.read import POOLED
from toolkit.core.statistics import SIGNIFICANT
from toolkit.core.tables import (
    NONE,
    build_table,
    encode_csv,
    format_interval,
    format_p,
    format_percent,
    format_points,
    format_test,
)
from toolkit.evaluation.metrics import name_booster, rank_variant
from toolkit.evaluation.prediction import OK
from toolkit.evaluation.predictions_csv import NEEDED
from toolkit.evaluation.verdict import Verdict, find_tone
from toolkit.models.network import Classifier
from toolkit.objects.load import TableObject
from toolkit.rooms.worlds.conditions import CLEAR
from toolkit.rooms.worlds.depth_weather import make_weather
from toolkit.rooms.worlds.evaluation import ABSENT, WorldEvalConfig
from toolkit.rooms.worlds.evaluation.cameras import GridCamera, PlaceCameras
from toolkit.rooms.worlds.evaluation.frames import Stage, ViewAnswers, WeatherKey
from toolkit.rooms.worlds.evaluation.keep import name_picture

SOURCE = "sim"
SEEN = ("azimuth_deg", "elevation_deg", "distance_m", "visible_share", "picture_share")
"""The values of every camera."""
COLUMNS = (*NEEDED, "world", "place", "weather", "severity", "visibility_m", *SEEN)
CAMERA_COLUMNS = ("place", "pose_id", "x_m", "y_m", "z_m", "left_out", *SEEN)
Summary = dict[str, Any]
Row = dict[str, Any]


@dataclass(frozen=True)
class WorldResults:
    """Frames of an evaluation, and the guesses of its network."""

    config: WorldEvalConfig
    classifier: Classifier  # who was asked
    item: TableObject
    true_index: int  # its class
    stage: Stage  # world, sky, camera, places and variants
    places: tuple[PlaceCameras, ...]  # cameras at each place
    answers: dict[tuple[str, WeatherKey], ViewAnswers]  # by variant and weather, of all cameras of all places, in order
    renderer: str | None = None  # the simulator that made the pictures; None for our renderers

    @cached_property
    def variants(self) -> list[str]:
        """Names, `unpatched` first."""
        return sorted(self.stage.variants, key=lambda name: (name != UNPATCHED, rank_variant(name)))

    @property
    def weathers(self) -> tuple[WeatherKey, ...]:
        """Clear air first."""
        return self.config.weathers

    @cached_property
    def cameras(self) -> list[GridCamera]:
        """Cameras of all places, in the order of the answers."""
        return [camera for place in self.places for camera in place.cameras]

    @cached_property
    def place_of(self) -> np.ndarray:
        """(n,) int, number of the place of each camera."""
        return np.repeat(np.arange(len(self.places)), [len(place.cameras) for place in self.places])

    @cached_property
    def place_names(self) -> list[str]:
        """Names of the places, in order."""
        return [place.placed.spot.name for place in self.places]

    def column(self, name: str) -> np.ndarray:
        """Return (n,) float, an attribute of every camera, such as `distance_m`."""
        return np.array([getattr(camera, name) for camera in self.cameras], float)

    @property
    def length_m(self) -> float:
        """Longest side of the object."""
        return float(np.ptp(self.stage.places[0].mesh.bounds, axis=0).max())

    @property
    def world_name(self) -> str:
        """Name of the world with its seed, such as `city/0`."""
        return f"{self.stage.world.name}/{self.stage.world.seed}"


def find_visibility_m(weather: WeatherKey) -> float | None:
    """At 5 % contrast, metres; None in clear conditions."""
    visibility = make_weather(*weather).visibility_m
    return None if np.isinf(visibility) else round(visibility, 3)


def encode_predictions(results: WorldResults) -> str:
    """The text of `predictions.csv`: a row per picture."""
    return encode_csv(COLUMNS, _list_predictions(results))


def _list_predictions(results: WorldResults) -> Iterator[list[object]]:
    labels, name = results.classifier.labels, results.item.name
    for variant in results.variants:
        for weather in results.weathers:
            found, visibility = results.answers[variant, weather], find_visibility_m(weather)
            for k, camera in enumerate(results.cameras):
                place = results.place_names[results.place_of[k]]
                rank, first = int(found.true_rank[k]), int(found.top1_index[k])
                path = f"{place}/{variant}/{camera.number:04d}/{name_picture(weather)}.png"
                yield [
                    SOURCE, name, variant, camera.number, path, results.true_index, labels[results.true_index], first,
                    labels[first], f"{found.top1_prob[k]:.6f}", f"{found.true_prob[k]:.6g}", rank, int(rank == 1),
                    int(rank <= 5), OK, results.world_name, place, *weather, visibility, *_describe_camera(camera),
                ]  # fmt: skip


def encode_cameras(results: WorldResults) -> str:
    """The text of `cameras.csv`: a row per point of the grid, whether a camera stands there and what it sees."""
    rows: list[list[object]] = []
    for place in results.places:
        shot = {camera.number: camera for camera in place.cameras}
        for k, (point, reason) in enumerate(zip(place.points, place.reasons, strict=True)):
            camera = shot.get(k + 1)
            left_out = reason or ("" if camera else "not in the sample")
            own = _describe_camera(camera) if camera else [""] * 5
            rows.append([place.placed.spot.name, k + 1, *np.round(point, 4).tolist(), left_out, *own])
    return encode_csv(CAMERA_COLUMNS, rows)


def _describe_camera(camera: GridCamera) -> list[object]:
    return [getattr(camera, name) for name in SEEN]


def pooled(summary: Summary, rows: str = "groups") -> dict[tuple[str, str, int], Row]:
    """Rows over all places, `groups`, `groups_in_view` or `pairs`, by variant, weather and severity."""
    return {(row["variant"], row["weather"], row["severity"]): row for row in summary[rows] if row["place"] == POOLED}


def judge_world(summary: Summary) -> list[Verdict]:
    """A sentence on every variant in clear conditions, then on each in each kind of weather.

    `good` and `bad` where both the interval over places and the paired test say so, else `open`.
    """
    groups, pairs = pooled(summary), pooled(summary, "pairs")
    found = []
    for variant in dict.fromkeys(row["variant"] for row in summary["groups"]):
        row = groups[variant, CLEAR[0], CLEAR[1]]
        who = f"{summary['model']['name']} has the {summary['about']['class']} among its first five guesses"
        sentence = f"In clear air {who} on {_share(row)} of {row['n']} pictures {_name(variant)}."
        # without the object there is nothing that could help or harm
        tone, why = ("open", "") if variant == ABSENT else _judge_pair(pairs.get((variant, *CLEAR)))
        found.append(Verdict(tone, f"{sentence}{why}"))
    return found + [_judge_half(row) for row in summary["half_lost"] if row["variant"] != ABSENT]


def _name(variant: str) -> str:
    if variant == ABSENT:
        return "of the places without it"
    return "without a booster" if variant == UNPATCHED else f"with {name_booster(variant)}"


def _share(row: Row) -> str:
    interval = f" ({format_interval(row['top5_ci95'])})" if row["top5_ci95"] else ""
    return f"{format_percent(row['top5'])} %{interval}"


def _judge_pair(pair: Row | None) -> tuple[str, str]:
    if pair is None:
        return "open", ""
    interval, p = pair["difference_top5_ci95"], pair["mcnemar_p_top5"]
    points = format_points(pair["difference_top5"])
    limits = f" ({format_points(interval[0])} to {format_points(interval[1])})" if interval else ""
    tone = find_tone(interval) if p < SIGNIFICANT else "open"
    tests = f"{pair['gained_top5']} gained, {pair['lost_top5']} lost, {format_test(pair['mcnemar_p_top5'])}"
    places = f"over places p {format_p(pair['places_p_top5'])}"
    return tone, f" That is {points} points{limits} against the baseline: {tests}; {places}."


def _judge_half(row: Row) -> Verdict:
    what = f"In {row['weather']}, {_name(row['variant'])}: "
    # without a recognition in clear conditions there is no half
    if not row["clear_top5"]:
        return Verdict("open", f"{what}nothing was recognised in clear conditions, so nothing can be lost.")
    half = f"half of the recognitions are lost at a visibility of {format_visibility(row)}"
    # the ladder may end before half is lost: the report then gives a bound
    if row["visibility_m"] is None:
        half = f"even at {row['densest_m']:.3g} m, the thickest {row['weather']} tested, more than half remain"
    if row["times"] is None:
        return Verdict("open", f"{what}{half}.")
    times, same_times = format_times(row, "times"), format_times(row, "same_times")
    sentence = (
        f"{what}{half}; that is {times} the {row['weather']} that halves the baseline. As many as the "
        f"baseline then keeps are still recognised in {same_times} that {row['weather']}."
    )
    # a ratio of 1 is no effect
    return Verdict(find_tone(row["same_times_ci95"], none=1), sentence)


def format_visibility(row: Row) -> str:
    """`42 m (95 % 35–51)`; `not reached` where half was not lost."""
    if row["visibility_m"] is None:
        return "not reached" if row["clear_top5"] else "–"
    interval = row["visibility_ci95"]
    if interval is None:
        return f"{row['visibility_m']:.3g} m"
    low, high = ("not reached" if bound is None else f"{bound:.3g}" for bound in interval)
    return f"{row['visibility_m']:.3g} m (95 % {low}–{high})"


def format_times(row: Row, key: str) -> str:
    """A ratio of `half_lost`, `times` or `same_times`: `2.1 times (1.5–3.0)`."""
    value, interval = row[key], row[f"{key}_ci95"]
    if value is None:
        return NONE
    if row["times_is_bound" if key == "times" else "same_is_bound"]:
        return f"at least {value:.1f} times"
    if interval is None:
        return f"{value:.1f} times"
    low, high = ("?" if bound is None else f"{bound:.1f}" for bound in interval)
    return f"{value:.1f} times ({low}{'–' + high if high != '?' else ' or more'})"


def build_world_table(summary: Summary) -> Table:
    """A line for each variant and weather, over all places."""
    pairs, cells = pooled(summary, "pairs"), []
    for key, row in pooled(summary).items():
        # the unmodified object has no pair: it is what the others are paired with
        pair = pairs.get(key)
        visibility = "" if row["visibility_m"] is None else f"{row['visibility_m']:.4g}"
        change = (
            [str(pair["gained_top5"]), str(pair["lost_top5"]), format_p(pair["mcnemar_p_top5"])] if pair else [""] * 3
        )
        name = row["weather"] if not row["severity"] else f"{row['weather']} {row['severity']}"
        cells.append([
            row["variant"], name, visibility, str(row["n"]), format_percent(row["top1"]), format_percent(row["top5"]),
            format_interval(row["top5_ci95"]), f"{row['mean_true_prob']:.2f}", *change,
        ])  # fmt: skip
    about = summary["about"]
    count = len(about["places"])
    title = f"{about['object']} in {about['world']}, {about['sky']}: {count} place{'s' if count > 1 else ''}"
    heads = ("vis. m", "n", "top-1 %", "top-5 %", "95 %", "prob", "gained", "lost", "p")
    return build_table(title, ("variant", "weather"), heads, cells)
