"""Weather between a camera and what it sees, laid over a finished render by its depth: one render serves all.

Rain and snow are here, fog and dust in `toolkit.rooms.worlds.fog`. `toolkit.rooms.worlds.particles` draws drops and
flakes.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Protocol

import cv2
import numpy as np
from pydantic import Field

from toolkit.core.config import align_rows
from toolkit.core.draws import Draws
from toolkit.rooms.worlds.clouds import paint_noise
from toolkit.rooms.worlds.conditions import check_weather, name_weather
from toolkit.rooms.worlds.fog import DepthFog, Dust, find_visibility, hang_veil
from toolkit.rooms.worlds.particles import AffineLight, DepthView, InWind, Population, draw_coverage, lay_particles

RAIN_MM_H = (5.0, 10.0, 25.0, 50.0, 100.0)
"""Rates by severity. The WMO calls it moderate from 2.5, heavy from 10, violent from 50 mm/h."""
CLOUD_BASE_M = 1500.0
"""Assumed height that the rain falls from; the sky is seen through it."""
RAIN_BIN_MM = 0.1
DIAMETERS_MM = np.arange(0.5, 6.0, RAIN_BIN_MM) + RAIN_BIN_MM / 2
"""Larger drops break up."""
MARSHALL_PALMER_PER_M3_MM = 8000.0
DROP_LIGHT = 0.94
"""A drop sends on 94 % of what it gathers from a field of 165° (Garg and Nayar 2007); most of that is sky."""
WETTING_MM_H, DARKENING = 10.0, 0.4
"""Assumed: ground gets wet with the rate as 1 - exp(-R / 10 mm/h), and wet it keeps 60 % of its light: water in its
pores traps light (Ångström 1925; Twomey et al. 1986)."""


def find_rain_extinction(rate_mm_h: float) -> float:
    """β in 1/m: 0.312 R^0.67 per km (Weber et al. 2015, as in Halder et al. 2019)."""
    return 0.312e-3 * rate_mm_h**0.67


def make_drops(rate_mm_h: float) -> Population:
    """Drops of Marshall and Palmer (1948), N(D) = 8000 exp(-4.1 R^-0.21 D) per m³ and mm; none without rain.

    They fall at 9.65 - 10.3 exp(-0.6 D) m/s (Atlas et al. 1973, after Gunn and Kinzer 1949).
    """
    decay = 4.1 * max(rate_mm_h, 1e-3) ** -0.21
    density = MARSHALL_PALMER_PER_M3_MM * np.exp(-decay * DIAMETERS_MM) * (rate_mm_h > 0)
    return Population(DIAMETERS_MM, density * RAIN_BIN_MM, 9.65 - 10.3 * np.exp(-0.6 * DIAMETERS_MM))


class Rain(InWind):
    """Rain of an even rate between camera and scene; it is best seen below an overcast sky."""

    rate_mm_h: Annotated[float, Field(ge=0, le=300)] = Field(25.0, description="Water on the ground, mm an hour.")
    wetness: Annotated[float, Field(ge=0, le=1)] | None = Field(
        None, description="Of the ground, 0 dry to 1 soaked; by default what the rate makes of it."
    )

    @classmethod
    def of_severity(cls, severity: int) -> "Rain":
        """1 (5 mm/h) to 5 (100 mm/h)."""
        return cls(rate_mm_h=RAIN_MM_H[severity - 1])

    @property
    def wetted(self) -> float:
        """How wet the ground is, 0 to 1: as the rate makes it where nothing else is said."""
        return 1 - float(np.exp(-self.rate_mm_h / WETTING_MM_H)) if self.wetness is None else self.wetness

    @property
    def ground_factor(self) -> float:
        """Share of its light that wet ground keeps."""
        return 1 - DARKENING * self.wetted

    @property
    def visibility_m(self) -> float:
        """At 5 % contrast; inf without rain."""
        return find_visibility(find_rain_extinction(self.rate_mm_h))

    def describe(self) -> str:
        """`25 mm/h, extinction 2.7 /km (visibility 1111 m), wind 3 m/s, ground × 0.63`."""
        per_km = 1e3 * find_rain_extinction(self.rate_mm_h)
        veil = f"extinction {per_km:.3g} /km (visibility {self.visibility_m:.0f} m)"
        return f"{self.rate_mm_h:g} mm/h, {veil}, wind {self.wind_m_s:g} m/s, ground × {self.ground_factor:.2f}"

    def change_light(self, view: DepthView, airlight: np.ndarray, rng: np.random.Generator) -> AffineLight:
        """Effect of this weather on a picture; see `toolkit.rooms.worlds.depth_weather.Weather`."""
        veil = hang_veil(view.path_m(CLOUD_BASE_M), np.array([find_rain_extinction(self.rate_mm_h)]), airlight)
        coverage = draw_coverage(view, make_drops(self.rate_mm_h), self.wind, self.exposure_s, rng)
        # drops that are drawn are near: the veil lies behind them
        seen = veil.then(lay_particles(coverage, DROP_LIGHT * airlight))
        if view.ground is None:
            return seen
        dry = np.asarray(view.ground, np.float32)[..., None]
        return AffineLight(seen.factor * (1 - dry * np.float32(1 - self.ground_factor)), seen.offset)


SNOW_MM_H = (1.0, 2.0, 4.0, 6.0, 10.0)
"""Rates by severity, as melted water: visibilities of 2350, 905, 348, 199 and 98 m. The US weather service calls it
light from 1000 m, heavy below 400 m."""
LADDER_COVER = (0.15, 0.35, 0.6, 0.8, 0.95)
"""Assumed: share of an even surface that is white; it depends on how long it has been snowing, not on the rate."""
SNOW_BIN_MM = 0.2
MELTED_MM = np.arange(0.3, 5.0, SNOW_BIN_MM) + SNOW_BIN_MM / 2
"""Diameters of the drops that flakes melt to."""
FLAKE_DENSITY = 0.1
"""Density of a flake as a share of the density of water."""
FLAKE_LIGHT, COVER_LIGHT = 0.9, 0.85
"""Assumed: light of flakes over the mean of the air's and white ground's, and the albedo of lying snow; fresh snow has
0.8 to 0.9."""
FLAT, STEEP = 0.8, 0.4
"""Assumed: snow covers a surface whose normal's z is above 0.8 (37°), and none of it below 0.4 (66°)."""
TILE_M, TILE_PX, COARSEST = 40.0, 512, 10
"""The pattern in which the cover lies repeats after 40 m; its largest patches are a tenth of that."""
SOFT = 0.08
"""Softness of the edge of a patch of snow, in steps of that order."""
BLENDED_M = 1.0
"""Ground below a pixel across which patches are no longer told apart."""


def find_snow_extinction(rate_mm_h: float) -> float:
    """β in 1/m of dry snow in green light: 5.53 S^1.38 dB/km (ITU-R P.1817)."""
    return np.log(10) / 10 * (5.42e-5 * 550 + 5.4958776) * rate_mm_h**1.38 / 1e3


def make_flakes(rate_mm_h: float) -> Population:
    """Flakes of Gunn and Marshall (1958), N(D) = 3800 R^-0.87 exp(-2.55 R^-0.48 D) per m³ and mm of melted diameter.

    They fall at 1.6 D^0.3 m/s with D in cm (Langleben 1954, dendrites). At a tenth of water's density they are larger
    than their drops by the cube root of ten.
    """
    rate = max(rate_mm_h, 1e-3)
    density = 3800 * rate**-0.87 * np.exp(-2.55 * rate**-0.48 * MELTED_MM) * (rate_mm_h > 0)
    return Population(MELTED_MM * FLAKE_DENSITY ** (-1 / 3), density * SNOW_BIN_MM, 1.6 * (MELTED_MM / 10) ** 0.3)


@lru_cache(maxsize=1)
def _cover_pattern() -> np.ndarray:
    """(n, n) float32: the order in which places turn white."""
    return paint_noise(np.random.default_rng(0x5E0), TILE_PX, 1.6, COARSEST)


class Snow(InWind):
    """Snow of an even rate between camera and scene, some of which lies; it is best seen below an overcast sky."""

    rate_mm_h: Annotated[float, Field(ge=0, le=50)] = Field(4.0, description="Snow as melted water, mm an hour.")
    cover: Annotated[float, Field(ge=0, le=1)] = Field(0.6, description="Share of an even surface that is white.")
    exposure_s: Annotated[float, Field(gt=0, le=1)] = Field(1 / 250, description="How long the shutter is open.")

    @classmethod
    def of_severity(cls, severity: int) -> "Snow":
        """1 (1 mm/h) to 5 (10 mm/h)."""
        return cls(rate_mm_h=SNOW_MM_H[severity - 1], cover=LADDER_COVER[severity - 1])

    @property
    def visibility_m(self) -> float:
        """At 5 % contrast; inf without snow in the air."""
        return find_visibility(find_snow_extinction(self.rate_mm_h))

    def describe(self) -> str:
        """`4 mm/h of water, extinction 8.62 /km (visibility 348 m), wind 3 m/s, cover 60 %`."""
        per_km = 1e3 * find_snow_extinction(self.rate_mm_h)
        veil = f"extinction {per_km:.3g} /km (visibility {self.visibility_m:.0f} m)"
        return f"{self.rate_mm_h:g} mm/h of water, {veil}, wind {self.wind_m_s:g} m/s, cover {100 * self.cover:g} %"

    def change_light(self, view: DepthView, airlight: np.ndarray, rng: np.random.Generator) -> AffineLight:
        """Effect of this weather on a picture; see `toolkit.rooms.worlds.depth_weather.Weather`."""
        veil = hang_veil(view.path_m(CLOUD_BASE_M), np.array([find_snow_extinction(self.rate_mm_h)]), airlight)
        coverage = draw_coverage(view, make_flakes(self.rate_mm_h), self.wind, self.exposure_s, rng)
        white = airlight if view.white is None else view.white
        falling = veil.then(lay_particles(coverage, FLAKE_LIGHT * (airlight + white) / 2))
        lying = self._cover(view)
        return falling if lying is None else lay_particles(lying, COVER_LIGHT * white).then(falling)

    def _cover(self, view: DepthView) -> np.ndarray | None:
        """(h, w) share of each pixel that is white; the same from everywhere, for it lies in the world."""
        if view.normals is not None:
            flat = np.clip((view.normals[..., 2] - STEEP) / (FLAT - STEEP), 0, 1).astype(np.float32)
        elif view.ground is not None:
            flat = np.asarray(view.ground, np.float32)
        else:
            return None
        # the sky has no place in the world
        reach = np.where(np.isfinite(view.depth_m), view.depth_m, 0)
        x, y = (
            ((view.directions[..., axis] * reach + view.position_m[axis]) / TILE_M % 1 * TILE_PX).astype(np.float32)
            for axis in (0, 1)
        )
        # looked up by place in the world: snow lies where it lay, from wherever it is seen
        order = cv2.remap(_cover_pattern(), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        # places turn white in their order until the cover's share is reached
        patches = np.clip((self.cover * (1 + SOFT) - order) / SOFT, 0, 1)
        # far off a pixel holds many patches, and shows their mean
        pixel_m = reach / view.camera.fx / np.maximum(np.abs(view.directions[..., 2]), 0.02)
        blended = np.clip(pixel_m / BLENDED_M, 0, 1)
        return (flat * (patches + (self.cover - patches) * blended)).astype(np.float32)


class Weather(Protocol):
    """`DepthFog`, `Dust`, `Rain`, `Snow` and `Clear`: frozen settings that know what they do to light."""

    @property
    def visibility_m(self) -> float:
        """Metres at which a black target keeps 5 % of its contrast; inf in clear conditions."""
        ...

    def describe(self) -> str:
        """The numbers behind it, in words."""
        ...

    def change_light(self, view: DepthView, airlight: np.ndarray, rng: np.random.Generator) -> AffineLight:
        """Its effect on a picture, whatever the picture's light.

        Args:
            view: depth, camera, and where ground and surfaces that face up are.
            airlight: (3,) linear light that an endless depth of fog sends, in the picture's unit: `Sky.airlight`.
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
        shape = view.depth_m.shape
        return AffineLight(np.ones((*shape, 1), np.float32), np.zeros((*shape, 3), np.float32))


WEATHERS: dict[str, type[DepthFog] | type[Dust] | type[Rain] | type[Snow]] = {
    "fog": DepthFog, "dust": Dust, "rain": Rain, "snow": Snow,
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
        (name_weather(name, severity), make_weather(name, severity).describe())
        for name, severity in weathers
    ])  # fmt: skip


def weather_rng(seed: int, item: int, name: str, severity: int) -> np.random.Generator:
    """The draws of a picture in a weather: they depend on these four alone."""
    return Draws(seed, item, "weather").of(f"{name}:{severity}")


def add_weather(
    light: np.ndarray, view: DepthView, weather: Weather, airlight: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(h, w, 3) float32 linear light of a render, seen through weather; before tone mapping.

    Args:
        light: (h, w, 3) float32 linear light in clear conditions.
    """
    return weather.change_light(view, airlight, rng).apply(light)


TO_AIRSIM = {"fog": "Fog", "dust": "Dust", "rain": "Rain", "snow": "Snow"}
"""AirSim's `WeatherParameter` of each weather. A convention: its numbers are densities of particles with no visibility
behind them. Severities 1 to 5 are 0.2, 0.4, … 1."""


def to_airsim(name: str, severity: int) -> dict[str, float]:
    """AirSim's parameters, each 0 to 1, that stand for a weather; none for clear air. See `TO_AIRSIM`.

    Rain brings its wet ground with it, snow its cover.

    Raises:
        ToolkitError: as `make_weather`.
    """
    weather = make_weather(name, severity)
    numbers = {TO_AIRSIM[name]: severity / 5} if name in TO_AIRSIM else {}
    # lying water and lying snow are parameters of their own in AirSim
    match weather:
        case Rain():
            numbers["Roadwetness"] = round(weather.wetted, 6)
        case Snow():
            numbers["RoadSnow"] = weather.cover
    return numbers
