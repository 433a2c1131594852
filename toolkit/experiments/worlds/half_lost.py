"""How much fog a network sees through: the visibility at which half of its recognitions are lost."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from toolkit.core.statistics import Interval, percentile_interval
from toolkit.worlds.conditions import CLEAR
from toolkit.worlds.fog import find_extinction, find_visibility
from toolkit.worlds.weather import make_weather

HALF = 0.5
NOT_REACHED = np.inf


@dataclass(frozen=True)
class HalfLost:
    """Of one variant in one kind of weather.

    Attributes:
        variant, weather: which.
        clear_top5: share with the truth among five guesses in clear air.
        visibility_m: at which half of that is left; None where more is left in the densest that was run, or nothing
            was recognised.
        visibility_ci95: None at its lower end: not reached.
        densest_m: least visibility that was run.
        times: how many times the extinction of `unpatched` at its own half this variant stands before its half is
            lost; a lower bound where `visibility_m` is None. None for `unpatched`, and where that has none.
        times_ci95: infinite ends are None.
        same_times: the same, up to where this variant is recognised as often as `unpatched` is at its half.
        same_times_ci95: likewise.
        same_is_bound, times_is_bound: whether the number is a lower bound.
    """

    variant: str
    weather: str
    clear_top5: float
    visibility_m: float | None
    visibility_ci95: tuple[float | None, float | None] | None
    densest_m: float
    times: float | None = None
    times_ci95: tuple[float | None, float | None] | None = None
    times_is_bound: bool = False
    same_times: float | None = None
    same_times_ci95: tuple[float | None, float | None] | None = None
    same_is_bound: bool = False

    def as_json(self) -> dict[str, Any]:
        """An entry of `half_lost` of `summary.json`."""
        return {key: list(one) if isinstance(one, tuple) else one for key, one in vars(self).items()}


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
    first = np.where(below.any(axis=1), below.argmax(axis=1), -1)
    before = np.maximum(first - 1, 0)
    rows = np.arange(len(shares))
    high, low = shares[rows, before], shares[rows, first]
    step = np.where(high > low, (high - levels) / np.where(high > low, high - low, 1), 0.0)
    at = extinctions[before] + step * (extinctions[first] - extinctions[before])
    at = np.where(first == 0, 0.0, at)
    at = np.where(first < 0, NOT_REACHED, at)
    return np.where(shares[:, 0] > 0, at, np.nan)


def find_ladder(weathers: tuple[tuple[str, int], ...]) -> dict[str, list[tuple[str, int]]]:
    """By kind of weather, clear air and its severities, thinnest first; kinds that have at least one."""
    kinds = dict.fromkeys(name for name, _ in weathers if name != CLEAR[0])
    return {kind: [CLEAR, *sorted(one for one in weathers if one[0] == kind)] for kind in kinds}


def list_extinctions(ladder: list[tuple[str, int]]) -> np.ndarray:
    """(m,) 1/m of each step of a ladder; 0 in clear air."""
    visible = [make_weather(*weather).visibility_m for weather in ladder]
    return np.array([0.0 if np.isinf(one) else find_extinction(one) for one in visible])


def measure_half(
    variant: str, kind: str, extinctions: np.ndarray, shares: np.ndarray, bare: np.ndarray | None
) -> HalfLost:
    """The half of one variant, alone and against the bare object.

    Args:
        variant, kind: names.
        extinctions: (m,) 1/m, clear air first.
        shares: (1 + b, m) of what was seen, then of bootstrap samples.
        bare: the same of `unpatched`; None for itself, or without it.
    """
    own = find_level(extinctions, shares, HALF * shares[:, 0])
    visible = _as_visibility(own)
    half = HalfLost(
        variant, kind, float(shares[0, 0]), _finite(visible[0]), _visible_interval(visible[1:]),
        find_visibility(float(extinctions.max())),
    )  # fmt: skip
    if bare is None:
        return half
    reference = find_level(extinctions, bare, HALF * bare[:, 0])
    if not np.isfinite(reference[0]) or reference[0] == 0:
        return half
    same = find_level(extinctions, shares, HALF * bare[:, 0])
    densest = float(extinctions.max())
    return HalfLost(
        **{**vars(half), **_compare("times", own, reference, densest), **_compare("same", same, reference, densest)}
    )


def _compare(name: str, own: np.ndarray, reference: np.ndarray, densest: float) -> dict[str, Any]:
    with np.errstate(divide="ignore", invalid="ignore"):
        times = own / reference
    is_bound = bool(np.isinf(own[0]))
    value = densest / reference[0] if is_bound else times[0]
    interval = percentile_interval(times[1:]) if len(times) > 1 else None
    key = "times" if name == "times" else "same_times"
    return {
        key: None if np.isnan(value) else float(value),
        f"{key}_ci95": None if interval is None else (_finite(interval[0]), _finite(interval[1])),
        f"{name}_is_bound": is_bound,
    }


def _as_visibility(extinctions: np.ndarray) -> np.ndarray:
    """Metres; 0 where a level is not reached, infinite where nothing needs to be lost."""
    return np.array([0.0 if np.isinf(one) else find_visibility(float(one)) for one in extinctions])


def _visible_interval(visible: np.ndarray) -> tuple[float | None, float | None] | None:
    interval: Interval | None = percentile_interval(visible) if len(visible) else None
    return None if interval is None else (_finite(interval[0]), _finite(interval[1]))


def _finite(value: float) -> float | None:
    """The number; None for 0, infinity and NaN."""
    return float(value) if np.isfinite(value) and value > 0 else None
