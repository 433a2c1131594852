"""From answers to numbers: shares with intervals over places, curves, paired tests, how much fog is seen through."""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.core.statistics import Interval, PairedOutcomes, wilson_interval
from toolkit.evaluation.clusters import ClusterBootstrap
from toolkit.evaluation.metrics import describe_change
from toolkit.evaluation.summaries import begin_summary
from toolkit.experiments.worlds.answers import Answers, WeatherKey, name_weather
from toolkit.experiments.worlds.cameras import FAILED, HIDDEN, LOWEST, NEAREST, count_cameras
from toolkit.experiments.worlds.half_lost import HalfLost, find_ladder, list_extinctions, measure_half
from toolkit.experiments.worlds.world_results import SOURCE, WorldResults, find_visibility_m

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
        "half_lost": [one.as_json() for one in measure_halves(results, sampler)],
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
    """Of each place and of all: points, cameras shot, hidden, in view, left out by reason."""
    rows = []
    groups = [(place.placed.spot.name, place.placed.spot.place, [place]) for place in results.places]
    for name, kind, own in [*groups, (POOLED, POOLED, list(results.places))]:
        seeing = sum(camera.visible_share >= IN_VIEW for place in own for camera in place.cameras)
        rows.append({"place": name, "kind": kind, **count_cameras(own), "in_view": seeing})
    return rows


def list_notes(results: WorldResults) -> list[str]:
    """What a reader of the tables must know, a sentence each."""
    count = len(results.places)
    notes = [
        "The tests of pairs take the cameras as independent draws. Those of one place share light and background, so "
        "that their p values are too small; the p over places and the intervals count places alone."
    ]
    if count == 1:
        notes.append("One place says nothing about others: there are no intervals.")
    else:
        notes.append(
            f"Intervals are percentiles of a cluster bootstrap over {count} places. With so few they are too narrow, "
            f"and no p over places can be smaller than {2 / 2**count:.2g}."
        )  # fmt: skip
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


def _answers(results: WorldResults, head: dict[str, Any], variant: str | None = None) -> Answers:
    """To the pictures of a row; `variant`: instead of its own."""
    return results.answers[variant or head["variant"], (head["weather"], head["severity"])]


def _each_group(results: WorldResults, sampler: ClusterBootstrap, among: np.ndarray) -> Iterator[dict[str, Any]]:
    for head, own in _each_cell(results, results.variants):
        yield head | _count(_answers(results, head), own & among, sampler if head["place"] == POOLED else None)


def _count(found: Answers, own: np.ndarray, sampler: ClusterBootstrap | None) -> dict[str, Any]:
    """Counts and shares; intervals over places where there is a sampler, else as if cameras were independent."""
    n = int(own.sum())
    shares: dict[str, Any] = {"n": n, "failed": 0}
    for name, guesses in (("top1", 1), ("top5", 5)):
        right = found.right(guesses)
        interval: Interval | None = wilson_interval(int(right[own].sum()), n)
        if sampler is not None:
            interval = sampler.estimate(right, own)[1]
        shares[name] = float(right[own].mean()) if n else None
        shares[f"{name}_ci95"] = interval and list(interval)
    return shares | {"mean_true_prob": float(found.true_prob[own].mean()) if n else None}


def _each_pair(results: WorldResults, sampler: ClusterBootstrap) -> Iterator[dict[str, Any]]:
    for head, chosen in _each_cell(results, results.variants[1:] if UNPATCHED in results.variants else ()):
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


def measure_halves(results: WorldResults, sampler: ClusterBootstrap) -> list[HalfLost]:
    """For each kind of weather and variant, where half of its top-5 is lost."""
    rows = []
    for kind, ladder in find_ladder(results.weathers).items():
        extinctions = list_extinctions(ladder)

        def shares(variant: str, steps: list[WeatherKey] = ladder) -> np.ndarray:
            return np.stack([sampler.shares(results.answers[variant, step].right(5)) for step in steps], axis=1)

        bare = shares(UNPATCHED) if UNPATCHED in results.variants else None
        for variant in results.variants:
            against = None if variant == UNPATCHED else bare
            rows.append(measure_half(variant, kind, extinctions, shares(variant), against))
    return rows


def _each_curve(results: WorldResults, sampler: ClusterBootstrap) -> Iterator[dict[str, Any]]:
    for axis, (_, edges) in AXES.items():
        values = place_on_axis(results, axis)
        for low, high in pairwise(edges):
            own = (values >= low) & (values < high)
            if not own.any():
                continue
            for variant in results.variants:
                for weather in results.weathers:
                    found = results.answers[variant, weather]
                    top5, interval = sampler.estimate(found.right(5), own)
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
        "azimuth_deg": lambda: (results.column("azimuth_deg") + 22.5) % 360 - 22.5,
        "distance_lengths": lambda: results.column("distance_m") / results.length_m,
    }
    return special[axis]() if axis in special else results.column(axis)
