"""What flights show: success with intervals per cell, paired tests, and the files that say so."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.core.files import write_json, write_text
from toolkit.core.statistics import PairedOutcomes, wilson_interval
from toolkit.core.tables import encode_csv
from toolkit.evaluation.metrics import describe_change
from toolkit.evaluation.summaries import SCHEMA_VERSION
from toolkit.landing.episodes import OUTCOMES
from toolkit.landing.flight_config import EpisodeConfig
from toolkit.landing.fly import EpisodeRecord, FlightCell, Flown
from toolkit.landing.landing_config import FlyConfig
from toolkit.worlds.depth_weather import describe_weathers


@dataclass(frozen=True)
class CellResult:
    """The episodes of one cell.

    Attributes:
        cell: which.
        records: in order of their index.
    """

    cell: FlightCell
    records: tuple[EpisodeRecord, ...]

    @property
    def n(self) -> int:
        """Episodes."""
        return len(self.records)

    def count(self, outcome: str) -> int:
        """Episodes that ended so."""
        return sum(one.outcome == outcome for one in self.records)

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
        landed = [one for one in self.records if one.error_m is not None]
        times = [one.time_s for one in self.records if one.outcome == "success"]
        paths = [one.path_m for one in self.records if one.outcome == "success"]
        return {
            **vars(self.cell), "n": self.n, "success": round(self.success, 4),
            "success_ci95": [round(value, 4) for value in self.success_ci95],
            **{outcome: self.count(outcome) for outcome in OUTCOMES if outcome != "success"},
            "median_error_m": _median([one.error_m for one in landed]), "median_time_s": _median(times),
            "median_path_m": _median(paths),
        }  # fmt: skip


def _median(values: Sequence[float | None]) -> float | None:
    some = [value for value in values if value is not None]
    return round(float(np.median(some)), 4) if some else None


@dataclass(frozen=True)
class PairResult:
    """Two cells, episode by episode.

    Attributes:
        cell, against: which.
        outcomes: successes of `against`, then of `cell`.
    """

    cell: FlightCell
    against: FlightCell
    outcomes: PairedOutcomes

    @property
    def other(self) -> str:
        """What is different in `against`: `pad plain`, or `pad plain, regressor net`."""
        names = ("pad", "regressor", "gains")
        theirs = {name: getattr(self.against, name) for name in names}
        return ", ".join(f"{name} {value}" for name, value in theirs.items() if value != getattr(self.cell, name))

    def as_json(self) -> dict[str, Any]:
        """A row of `pairs`."""
        return {"cell": self.cell.key, "against": self.against.key, **describe_change(self.outcomes)}


def group_cells(flown: Flown) -> list[CellResult]:
    """Results in the order of the cells."""
    by_cell: dict[FlightCell, list[EpisodeRecord]] = {cell: [] for cell in flown.cells}
    for one in flown.records:
        by_cell[one.cell].append(one)
    return [CellResult(cell, tuple(sorted(some, key=lambda one: one.index))) for cell, some in by_cell.items()]


def pair_cells(results: Sequence[CellResult]) -> list[PairResult]:
    """Each pad against the first, each regressor against the first on the same pad, each gains against the first.

    Where pad and regressor are both others, as with one trained again on a boosted pad, also against both first.
    """
    known = {one.cell: one for one in results}
    pairs = []
    for names in (("pad",), ("regressor",), ("gains",), ("pad", "regressor")):
        first = {name: getattr(results[0].cell, name) for name in names}
        for one in results:
            other = known.get(replace(one.cell, **first))
            if other is not None and all(getattr(one.cell, name) != value for name, value in first.items()):
                pairs.append(_compare(one, other))
    return pairs


def _compare(one: CellResult, other: CellResult) -> PairResult:
    both = zip(other.records, one.records, strict=True)
    outcomes = PairedOutcomes.count((before.outcome == "success", now.outcome == "success") for before, now in both)
    return PairResult(one.cell, other.cell, outcomes)


def write_summary(
    folder: Path, config: FlyConfig, flown: Flown, seed: int
) -> tuple[list[CellResult], list[PairResult]]:
    """Write `summary.json`, `cells.csv` and `episodes.csv`."""
    results = group_cells(flown)
    pairs = pair_cells(results)
    content = {
        "schema_version": SCHEMA_VERSION,
        "kind": "landing",
        "cells": [one.as_json() for one in results],
        "pairs": [one.as_json() for one in pairs],
        "success_is": describe_success(config.episode),
        "camera_hz": config.episode.camera_hz,
        "places": [{"name": place.name, "centre": list(place.centre)} for place in flown.places],
        "weathers": describe_weathers(config.weathers),
        "settings": config.record(),
        "seed": seed,
        "toolkit_version": __version__,
    }
    write_json(folder / "summary.json", content)
    rows = [one.as_json() for one in results]
    spread = [row | {"success_ci95": " ".join(map(str, row["success_ci95"]))} for row in rows]
    write_text(folder / "cells.csv", _to_csv(spread))
    episodes = [one.model_dump(exclude={"track", "seen", "inputs"}) for one in flown.records]
    write_text(folder / "episodes.csv", _to_csv(episodes))
    return results, pairs


def _to_csv(rows: Sequence[dict[str, Any]]) -> str:
    return encode_csv(list(rows[0]), (row.values() for row in rows))


def describe_success(config: EpisodeConfig) -> str:
    """What counts as what, and how often the camera looks."""
    return f"{config.describe()}; {config.camera_hz:g} pictures a second, {1000 * config.latency_s:g} ms late"
