"""From answers to numbers: shares with intervals over places, curves, paired tests, how much fog is seen through."""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.captures.capture import UNPATCHED
from toolkit.captures.read import POOLED
from toolkit.core.statistics import Interval, PairedOutcomes, percentile_interval, wilson_interval
from toolkit.evaluation.metrics import ClusterBootstrap, describe_change
from toolkit.evaluation.summaries import begin_summary
from toolkit.rooms.worlds.conditions import CLEAR
from toolkit.rooms.worlds.depth_weather import make_weather
from toolkit.rooms.worlds.evaluation.cameras import FAILED, HIDDEN, LOWEST, NEAREST, count_cameras
from toolkit.rooms.worlds.evaluation.frames import ViewAnswers, WeatherKey, name_weather
from toolkit.rooms.worlds.evaluation.world_results import SOURCE, WorldResults, find_visibility_m
from toolkit.rooms.worlds.fog import find_extinction, find_visibility

HALF = 0.5
NOT_REACHED = np.inf
IN_VIEW = 0.5
"""A camera has the object in view that sees at least this share of it."""
AXES: dict[str, tuple[str, tuple[float, ...]]] = {
    "azimuth_deg": ("azimuth, degrees from the front", tuple(np.arange(-22.5, 360, 45))),
    "elevation_deg": ("elevation, degrees", (-90, 0, 10, 20, 30, 45, 60, 90)),
    "distance_lengths": ("distance, object lengths", (0, 1.25, 1.75, 2.25, 2.75, 3.25, 1e9)),
    "visible_share": ("visible share of the object", (0, HIDDEN, 0.25, 0.5, 0.75, 0.95, 1.01)),
    "picture_share": ("share of the picture that the object covers", (0, 0.01, 0.02, 0.04, 0.08, 0.16, 1.01)),
}
"""By name of a curve, its title and the edges of its bins."""


def find_level(extinctions: np.ndarray, shares: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """(b,) extinction at which shares first fall to a level, linear between those that were run.

    Args:
        extinctions: (m,) rising from 0.
        shares: (b, m) of b samples.
        levels: (b,) to fall to.

    Returns:
        Infinite where a level is not reached, NaN where there is nothing to lose.
    """
    below = shares <= levels[:, None]
    # the first step at or below the level; -1 where there is none
    first = np.where(below.any(axis=1), below.argmax(axis=1), -1)
    before = np.maximum(first - 1, 0)
    rows = np.arange(len(shares))
    high, low = shares[rows, before], shares[rows, first]
    # how far between the last step above the level and the first below
    step = np.where(high > low, (high - levels) / np.where(high > low, high - low, 1), 0.0)
    at = extinctions[before] + step * (extinctions[first] - extinctions[before])
    # below it in clear conditions already; or not even in the densest
    at = np.where(first == 0, 0.0, at)
    at = np.where(first < 0, NOT_REACHED, at)
    return np.where(shares[:, 0] > 0, at, np.nan)


def find_ladder(weathers: tuple[tuple[str, int], ...]) -> dict[str, list[tuple[str, int]]]:
    """By kind of weather, clear air and its severities, thinnest first; kinds with at least a severity."""
    kinds = dict.fromkeys(name for name, _ in weathers if name != CLEAR[0])
    return {kind: [CLEAR, *sorted(weather for weather in weathers if weather[0] == kind)] for kind in kinds}


def list_extinctions(ladder: list[tuple[str, int]]) -> np.ndarray:
    """(m,) 1/m of each step of a ladder; 0 in clear conditions."""
    visible = [make_weather(*weather).visibility_m for weather in ladder]
    return np.array([0.0 if np.isinf(visibility_m) else find_extinction(visibility_m) for visibility_m in visible])


def measure_half(
    variant: str, kind: str, extinctions: np.ndarray, shares: np.ndarray, bare: np.ndarray | None
) -> dict[str, Any]:
    """An entry of `half_lost` of `summary.json`: the half of a variant, alone and against the unmodified object.

    `times` compares the extinctions at which each loses its own half. `same_times` goes up to where this variant is
    recognised as often as the unmodified object is at its half. Both are None without anything to compare with.

    Args:
        extinctions: (m,) 1/m, clear air first.
        shares: (1 + b, m) of what was seen, then of bootstrap samples.
        bare: the shares of `unpatched`; None for `unpatched` itself, or if it was not evaluated.
    """
    own = find_level(extinctions, shares, HALF * shares[:, 0])
    # 0 where a level is not reached, infinite where nothing needs to be lost
    visible = np.array([0.0 if np.isinf(extinction) else find_visibility(float(extinction)) for extinction in own])
    densest = float(extinctions.max())
    half: dict[str, Any] = {
        "variant": variant, "weather": kind, "clear_top5": float(shares[0, 0]), "visibility_m": _finite(visible[0]),
        "visibility_ci95": _limits(visible), "densest_m": find_visibility(densest),
    }  # fmt: skip
    # the unmodified object loses its half nowhere, or at once: there is nothing to compare with
    reference = None if bare is None else find_level(extinctions, bare, HALF * bare[:, 0])
    if reference is not None and (not np.isfinite(reference[0]) or reference[0] == 0):
        reference = None
    same = own if bare is None else find_level(extinctions, shares, HALF * bare[:, 0])
    return half | _compare("times", own, reference, densest) | _compare("same", same, reference, densest)


def _limits(samples: np.ndarray) -> list[float | None] | None:
    """The 95 % interval of bootstrap samples, which follow what was seen; an end that is not reached is None."""
    interval = percentile_interval(samples[1:]) if len(samples) > 1 else None
    return interval and [_finite(end) for end in interval]


def _compare(name: str, own: np.ndarray, reference: np.ndarray | None, densest: float) -> dict[str, Any]:
    key = "times" if name == "times" else "same_times"
    if reference is None:
        return {key: None, f"{key}_ci95": None, f"{name}_is_bound": False}
    with np.errstate(divide="ignore", invalid="ignore"):
        # a quotient of extinctions: how much denser the fog may be
        times = own / reference
    is_bound = bool(np.isinf(own[0]))
    # not lost even in the densest fog: at least so many times
    value = densest / reference[0] if is_bound else times[0]
    shown = None if np.isnan(value) else float(value)
    return {key: shown, f"{key}_ci95": _limits(times), f"{name}_is_bound": is_bound}


def _finite(value: float) -> float | None:
    """The number; None for 0, infinity and NaN."""
    return float(value) if np.isfinite(value) and value > 0 else None


def summarise(results: WorldResults) -> dict[str, Any]:
    """What `summary.json` holds; see docs/reference/files.md."""
    sampler = ClusterBootstrap.of(results.place_of, len(results.places))
    everywhere = np.ones(len(results.cameras), bool)
    in_view = results.column("visible_share") >= IN_VIEW
    return {
        **begin_summary("world-eval", results.classifier),
        "groups": list(_each_group(results, sampler, everywhere)),
        "groups_in_view": list(_each_group(results, sampler, in_view)),
        "pairs": list(_each_pair(results, sampler)),
        "half_lost": measure_halves(results, sampler),
        "curves": list(_each_curve(results, sampler)),
        "cameras": describe_cameras(results),
        "about": describe_run(results),
        "notes": list_notes(results),
        "toolkit_version": __version__,
    }  # fmt: skip


def describe_run(results: WorldResults) -> dict[str, Any]:
    """World, object, camera and weathers, for the record."""
    stage, camera = results.stage, results.stage.camera
    return {
        "world": results.world_name, "world_sha256": stage.world.sha256, "sky": stage.sky.name,
        "object": results.item.name, "class": results.classifier.labels[results.true_index],
        "length_m": round(results.length_m, 4), "places": results.place_names,
        "camera": camera.intrinsics, "fov_deg": camera.fov_deg, "in_view": IN_VIEW, "hidden": HIDDEN,
        "grid": {
            "shape": list(results.config.grid), "extent_lengths": results.config.extent, "lowest_lengths": LOWEST,
            "nearest_lengths": NEAREST, "sample": results.config.sample,
        },
        "weathers": [name_weather(weather) for weather in results.weathers],
        "config": results.config.record(), **({"renderer": results.renderer} if results.renderer else {}),
    }  # fmt: skip


def describe_cameras(results: WorldResults) -> list[dict[str, Any]]:
    """Return counts for each place and for all: points, cameras shot, hidden, in view, left out by reason."""
    rows = []
    groups = [(place.placed.spot.name, place.placed.spot.place, [place]) for place in results.places]
    for name, kind, own in [*groups, (POOLED, POOLED, list(results.places))]:
        seeing = sum(camera.visible_share >= IN_VIEW for place in own for camera in place.cameras)
        rows.append({"place": name, "kind": kind, **count_cameras(own), "in_view": seeing})
    return rows


def list_notes(results: WorldResults) -> list[str]:
    """Notes for readers of the tables, a sentence each."""
    count = len(results.places)
    # limits of the statistics first, then what is missing from this run
    notes = [
        *results.classifier.notes,
        "The tests of pairs count cameras as independent. Cameras at a place share light and background, so these p "
        "values are too small; the p over places and the intervals count each place once.",
    ]
    if count == 1:
        notes.append("One place says nothing about others: there are no intervals.")
    else:
        notes.append(
            f"Intervals are percentiles of a cluster bootstrap over {count} places. With so few places they are "
            f"too narrow, and p over places cannot be smaller than {2 / 2**count:.2g}."
        )  # fmt: skip
    # an image that failed in a variant takes its camera out of all variants, and maybe a whole place
    lost = sum(place.reasons.count(FAILED) for place in results.places)
    gone = len(results.stage.places) - count
    if lost or gone:
        whole = f" and {gone} whole place{'s' if gone > 1 else ''}" if gone else ""
        notes.append(f"Left out in all variants, as their pictures failed: {lost} cameras{whole}. Run it again.")
    if results.renderer:
        notes.append(
            f"Pictures by {results.renderer}. Its weather is its own: for severities 1 to 5 it got 0.2 to 1, densities "
            "without a visibility; those shown are what the same severities have in our renderer, by convention."
        )
    sample = results.config.sample
    if sample is not None:
        standing = sum(place.standing for place in results.places)
        notes.append(
            f"A sample: {len(results.cameras)} of the {standing} cameras that can stand, at most {sample} at each "
            f"place, drawn by seed {results.config.seed}."
        )
    return notes


def _each_cell(results: WorldResults, variants: Sequence[str]) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
    """The fields that a row begins with, and (n,) bool, which cameras it is of: all places together, then each."""
    places = [(POOLED, np.ones(len(results.cameras), bool))]
    places += [(name, results.place_of == place) for place, name in enumerate(results.place_names)]
    for variant, weather, (place, own) in product(variants, results.weathers, places):
        yield {
            "source": SOURCE, "object": results.item.name, "variant": variant, "world": results.world_name,
            "place": place, "weather": weather[0], "severity": weather[1], "visibility_m": find_visibility_m(weather),
        }, own  # fmt: skip


def _answers(results: WorldResults, head: dict[str, Any], variant: str | None = None) -> ViewAnswers:
    """Answers to the pictures of a row, or of another variant."""
    return results.answers[variant or head["variant"], (head["weather"], head["severity"])]


def _each_group(results: WorldResults, sampler: ClusterBootstrap, among: np.ndarray) -> Iterator[dict[str, Any]]:
    for head, own in _each_cell(results, results.variants):
        yield head | _count(_answers(results, head), own & among, sampler if head["place"] == POOLED else None)


def _count(found: ViewAnswers, own: np.ndarray, sampler: ClusterBootstrap | None) -> dict[str, Any]:
    """Counts and shares; intervals over places where there is a sampler, else as if cameras were independent."""
    n = int(own.sum())
    shares: dict[str, Any] = {"n": n, "failed": 0}
    for name, guesses in (("top1", 1), ("top5", 5)):
        right = found.right(guesses)
        # for a single place, its cameras are the whole population
        interval: Interval | None = wilson_interval(int(right[own].sum()), n)
        if sampler is not None:
            interval = sampler.estimate(right, own)[1]
        shares[name] = float(right[own].mean()) if n else None
        shares[f"{name}_ci95"] = interval and list(interval)
    return shares | {"mean_true_prob": float(found.true_prob[own].mean()) if n else None}


def _each_pair(results: WorldResults, sampler: ClusterBootstrap) -> Iterator[dict[str, Any]]:
    for head, chosen in _each_cell(results, results.variants[1:] if UNPATCHED in results.variants else ()):
        # correct or not for each camera, with and without the booster
        bare, own = _answers(results, head, UNPATCHED), _answers(results, head)
        row = head | {"n_pairs": int(chosen.sum())}
        for end, guesses in (("", 1), ("_top5", 5)):
            pairs = zip(bare.right(guesses)[chosen], own.right(guesses)[chosen], strict=True)
            change = describe_change(PairedOutcomes.count(pairs))
            row |= {f"{name}{end}": value for name, value in change.items()}
        if head["place"] == POOLED:
            # the difference with its interval over places, and an exact test that counts places alone
            gain = own.right(5).astype(float) - bare.right(5)
            difference, interval = sampler.estimate(gain)
            row |= {"difference_top5": difference, "difference_top5_ci95": interval and list(interval)}
            row |= {"places_p_top5": sampler.sign_p(gain)}
        yield row


def measure_halves(results: WorldResults, sampler: ClusterBootstrap) -> list[dict[str, Any]]:
    """For each kind of weather and variant, where half of its top-5 is lost."""
    rows = []
    for kind, ladder in find_ladder(results.weathers).items():
        extinctions = list_extinctions(ladder)

        def shares(variant: str, steps: list[WeatherKey] = ladder) -> np.ndarray:
            return np.stack([sampler.shares(results.answers[variant, step].right(5)) for step in steps], axis=1)

        # the same bootstrap samples for all: quotients of two variants are taken sample by sample
        bare = shares(UNPATCHED) if UNPATCHED in results.variants else None
        for variant in results.variants:
            against = None if variant == UNPATCHED else bare
            rows.append(measure_half(variant, kind, extinctions, shares(variant), against))
    return rows


def _each_curve(results: WorldResults, sampler: ClusterBootstrap) -> Iterator[dict[str, Any]]:
    for axis, (_, edges) in AXES.items():
        values = place_on_axis(results, axis)
        # bins of the axis, each with its own cameras of all places
        for low, high in pairwise(edges):
            own = (values >= low) & (values < high)
            if not own.any():
                continue
            for variant in results.variants:
                for weather in results.weathers:
                    found = results.answers[variant, weather]
                    top5, interval = sampler.estimate(found.right(5), own)
                    # open ends of the outer bins are told as what cameras there are; azimuth goes round, and has none
                    yield {
                        "axis": axis, "low": max(low, float(values.min())) if axis != "azimuth_deg" else low,
                        "high": min(high, float(values.max())) if axis != "azimuth_deg" else high,
                        "variant": variant, "weather": weather[0], "severity": weather[1], "n": int(own.sum()),
                        "top1": float(found.right(1)[own].mean()), "top5": top5,
                        "top5_ci95": interval and list(interval),
                        "mean_true_prob": float(found.true_prob[own].mean()),
                    }  # fmt: skip


def place_on_axis(results: WorldResults, axis: str) -> np.ndarray:
    """(n,) where each camera is on the axis of a curve."""
    special: dict[str, Callable[[], np.ndarray]] = {
        # the first bin lies around 0: angles are brought into [-22.5, 337.5)
        "azimuth_deg": lambda: (results.column("azimuth_deg") + 22.5) % 360 - 22.5,
        "distance_lengths": lambda: results.column("distance_m") / results.length_m,
    }
    return special[axis]() if axis in special else results.column(axis)
