"""Weather between a camera and what it sees, laid over a finished render: one render serves them all."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from toolkit.core.config import align_rows
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.severities import SEVERITIES
from toolkit.worlds.conditions import check_weather
from toolkit.worlds.depth_view import AffineLight, DepthView
from toolkit.worlds.fog import CONTRAST_LOG, LADDER_M, Dust, Fog
from toolkit.worlds.rain import LADDER_MM_H, Rain
from toolkit.worlds.snow import LADDER_MM_H as SNOW_MM_H
from toolkit.worlds.snow import Snow


class Weather(Protocol):
    """`Fog`, `Dust`, `Rain`, `Snow` and `Clear`: frozen settings that know what they do to light."""

    @property
    def visibility_m(self) -> float:
        """Metres at which a black target keeps 5 % of its contrast; inf in clear air."""
        ...

    def describe(self) -> str:
        """The numbers behind it, in words."""
        ...

    def change_light(self, view: DepthView, airlight: np.ndarray, rng: np.random.Generator) -> AffineLight:
        """What it makes of a picture, whatever the picture's light.

        Args:
            view: depth, camera, and where ground and surfaces that face up are.
            airlight: (3,) linear light that an endless depth of fog sends, in the picture's unit: `Sky.airlight`.
            rng: draws drops, flakes, grains and patches.
        """
        ...


class Clear:
    """Air that hides nothing."""

    visibility_m = float("inf")

    def describe(self) -> str:
        """`clear`."""
        return "clear"

    def change_light(self, view: DepthView, airlight: np.ndarray, rng: np.random.Generator) -> AffineLight:
        """Leaves all light as it is."""
        return AffineLight.of_nothing(*view.depth_m.shape)


WEATHERS: dict[str, type[Fog] | type[Dust] | type[Rain] | type[Snow]] = {
    "fog": Fog, "dust": Dust, "rain": Rain, "snow": Snow,
}  # fmt: skip


def make_weather(name: str, severity: int) -> Weather:
    """The weather called `name`: `clear` at 0, the others at severities 1 (slight) to 5 (severe).

    Raises:
        ToolkitError: there is none of that name.
        FieldError: there is no such severity.
    """
    check_weather(name, severity)
    return Clear() if name == "clear" else WEATHERS[name].of_severity(severity)


def describe_weathers(weathers: Sequence[tuple[str, int]]) -> list[str]:
    """A line for each (name, severity) with the numbers behind it, to be printed with results."""
    return align_rows([
        (name if name == "clear" else f"{name}:{severity}", make_weather(name, severity).describe())
        for name, severity in weathers
    ])  # fmt: skip


def weather_rng(seed: int, item: int, name: str, severity: int) -> np.random.Generator:
    """The draws of one picture in one weather: they depend on these four alone."""
    return Draws(seed, item, "weather").of(f"{name}:{severity}")


def add_weather(
    light: np.ndarray, view: DepthView, weather: Weather, airlight: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(h, w, 3) float32 linear light of a render, seen through weather; before tone mapping.

    Args:
        light: (h, w, 3) float32 linear light in clear air.
        view, airlight, rng: see `Weather.change_light`.
        weather: which.
    """
    return weather.change_light(view, airlight, rng).apply(light)


def _on_ladder(value: float, ladder: Sequence[float]) -> float:
    """What a ladder holds at severity 5 · value: between rungs by the logarithm, below the first in proportion."""
    severity = 5 * value
    if severity < 1:
        return ladder[0] * severity
    return float(np.exp(np.interp(severity, SEVERITIES, np.log(ladder))))


def _fog_from_airsim(value: float, kind: type[Fog] | type[Dust]) -> Weather:
    extinction = _on_ladder(value, [CONTRAST_LOG / one for one in LADDER_M])
    return kind(visibility_m=CONTRAST_LOG / extinction)


AIRSIM = {
    "Fog": lambda value: _fog_from_airsim(value, Fog),
    "Dust": lambda value: _fog_from_airsim(value, Dust),
    "Rain": lambda value: Rain(rate_mm_h=_on_ladder(value, LADDER_MM_H), wetness=0),
    "Roadwetness": lambda value: Rain(rate_mm_h=0, wetness=value),
    "Snow": lambda value: Snow(rate_mm_h=_on_ladder(value, SNOW_MM_H), cover=0),
    "RoadSnow": lambda value: Snow(rate_mm_h=0, cover=value),
}
"""What each of AirSim's `WeatherParameter`s is here, as a function of its 0 to 1. A convention: AirSim's numbers are
densities of particles with no visibility behind them. 0.2, 0.4, … 1 are our severities 1 to 5."""
AIRSIM_MISSING = ("MapleLeaf", "RoadLeaf")


def from_airsim(name: str, value: float) -> Weather:
    """The weather that stands here for one of AirSim's parameters, see `AIRSIM`; 0 is clear air.

    Raises:
        ToolkitError: AirSim has no such parameter, or it has no counterpart here.
        FieldError: the value is not in [0, 1].
    """
    if name in AIRSIM_MISSING:
        raise ToolkitError(f"AirSim's {name}: leaves have no counterpart; known: {', '.join(AIRSIM)}")
    if name not in AIRSIM:
        raise one_of("weather of AirSim's", name, list(AIRSIM))
    if not 0 <= value <= 1:
        raise FieldError(f"AirSim's {name}: expected 0 to 1", {"value": value})
    return AIRSIM[name](value) if value else Clear()
