"""Air that hides: fog, and the dust of a storm."""

from typing import Annotated

import numpy as np
from pydantic import Field

from toolkit.core.config import Config
from toolkit.rooms.worlds.daylight import LUMINANCE, WAVELENGTHS_UM
from toolkit.rooms.worlds.particles import AffineLight, DepthView, InWind, Population, draw_coverage, lay_particles

CONTRAST_LOG = 2.996
"""-ln 0.05: at the visibility a black target keeps 5 % of its contrast (Koschmieder 1924; WMO-No. 8)."""
LADDER_M = (100.0, 70.0, 40.0, 20.0, 10.0)
"""Visibilities by severity, for objects that are seen from 20 to 60 m. WMO calls it fog below 1000 m; British
forecasters thick fog below 200 m, dense below 50 m."""
FOG_LAYER_M, DUST_LAYER_M = 200.0, 1000.0
"""Assumed heights above the camera; the sky is seen through them."""
THINNEST, DENSEST = 0.65, 1.45
"""Bounds of the extinction's factor in patchy fog."""
PATCHES_M = (60.0, 37.0, 22.0, 13.0)
"""Wavelengths of patchy fog."""


def find_extinction(visibility_m: float) -> float:
    """Extinction coefficient β, 1/m."""
    return CONTRAST_LOG / visibility_m


def find_visibility(extinction_per_m: float) -> float:
    """Metres at which a black target keeps 5 % of its contrast; inf in clear conditions."""
    return CONTRAST_LOG / extinction_per_m if extinction_per_m else float("inf")


def hang_veil(path: np.ndarray, extinction: np.ndarray, airlight: np.ndarray) -> AffineLight:
    """Koschmieder's veil: `t · light + (1 - t) · airlight`, with t = exp(-β path).

    Args:
        path: (h, w) float32 metres of air.
        extinction: (1,) or (3,) β, 1/m; one number, or red, green and blue.
        airlight: (3,) linear light that an endless path sends.
    """
    passed = np.exp(path[..., None] * -extinction.astype(np.float32))
    return AffineLight(passed, (1 - passed) * airlight.astype(np.float32))


def stretch_path(view: DepthView, patchiness: float, farthest_m: float, rng: np.random.Generator) -> np.ndarray:
    """(h, w) float32 length of even fog that takes as much light as the patchy fog up to `depth_m`.

    The extinction's factor is 1.05 plus four waves through the world in random directions. Their amplitudes add up to
    0.4. A wave's integral along a ray has a closed form.

    Args:
        patchiness: 0 even … 1 all of those bounds.
        farthest_m: where nothing is seen any more, and the integral ends.
    """
    # normal numbers in three axes point evenly all around
    towards = rng.normal(size=(len(PATCHES_M), 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    phases = rng.uniform(0, 2 * np.pi, len(PATCHES_M))
    # wave vectors, 1/m
    waves = (2 * np.pi / np.array(PATCHES_M))[:, None] * towards
    # longer waves swing more; together they stay within the bounds
    swing = (DENSEST - THINNEST) / 2 * np.array(PATCHES_M) / sum(PATCHES_M)
    depth = np.minimum(view.depth_m, np.float32(farthest_m))
    factor = np.full_like(depth, (DENSEST + THINNEST) / 2)
    starts = (waves @ view.position_m + phases) % (2 * np.pi)
    for wave, start, amplitude in zip(waves.astype(np.float32), starts, swing, strict=True):
        half = view.directions @ wave * depth / 2
        # sin(x) / x, the mean of a wave along the ray; 1 where the ray runs across it
        slope = np.where(np.abs(half) < 1e-3, np.float32(1), np.sin(half) / np.where(half == 0, 1, half))
        # sin(start + k t) has the mean sin(start + k d / 2) sin(k d / 2) / (k d / 2) over t from 0 to d
        factor += np.sin(half + np.float32(start)) * slope * np.float32(amplitude)
    stretched = depth * (1 + np.float32(patchiness) * (factor - 1))
    # the sky's path is cut by the layer, and long enough to be even
    return np.where(np.isinf(view.depth_m), view.path_m(FOG_LAYER_M), stretched)


class DepthFog(Config):
    """Water droplets: every colour is lost alike, and light from all around comes in its place."""

    visibility_m: Annotated[float, Field(gt=0)] = Field(40.0, description="At 5 % contrast, metres.")
    patchiness: Annotated[float, Field(ge=0, le=1)] = Field(
        0.0, description="0: even; 1: the extinction varies from 0.65 to 1.45 times its value."
    )

    @classmethod
    def of_severity(cls, severity: int) -> "DepthFog":
        """1 (100 m) to 5 (10 m)."""
        return cls(visibility_m=LADDER_M[severity - 1])

    def describe(self) -> str:
        """`visibility 40 m, extinction 74.9 /km`."""
        per_km = 1e3 * find_extinction(self.visibility_m)
        patches = f", patchy {self.patchiness:g}" if self.patchiness else ""
        return f"visibility {self.visibility_m:.4g} m, extinction {per_km:.3g} /km{patches}"

    def change_light(self, view: DepthView, airlight: np.ndarray, rng: np.random.Generator) -> AffineLight:
        """Effect of this weather on a picture; see `toolkit.rooms.worlds.depth_weather.Weather`."""
        beta = find_extinction(self.visibility_m)
        patchy = self.patchiness > 0
        # at 20 optical depths exp(-20) of the light is left: nothing further is seen
        path = stretch_path(view, self.patchiness, 20 / beta, rng) if patchy else view.path_m(FOG_LAYER_M)
        return hang_veil(path, np.array([beta]), airlight)


ANGSTROM = 0.5
"""Assumed: Ångström's exponent of the extinction, β ~ λ^-0.5. Desert dust has 0 to 0.6 (Dubovik et al. 2002), a storm
near 0. Blue is lost 9 % faster than green."""
TAN = np.array([1.0, 0.68, 0.38])
"""Assumed: colour of the airlight in linear RGB: quartz and clay with iron oxide swallow blue."""
DUST_LIGHT = 0.65
"""Assumed: luminance of the dust's airlight over fog's."""
GRAIN_SHARE = 0.05
"""Assumed: share of the dust's mass in grains large enough to be seen individually."""
GRAIN_MM, GRAIN_KG_PER_M3, GRAIN_FALL_M_S, GRAIN_LIGHT = np.linspace(0.3, 1.5, 13), 2650.0, 4.0, 0.5
"""Sand's diameters, density, rate of fall, and light over the dust's (assumed: its shaded side is seen)."""


def tan_airlight(airlight: np.ndarray) -> np.ndarray:
    """(3,) linear airlight of dust where fog would have (3,) `airlight`."""
    # the tint at luminance 1, times the luminance of fog's airlight
    return TAN / (TAN @ LUMINANCE) * (airlight @ LUMINANCE) * DUST_LIGHT


class Dust(InWind):
    """A dust storm: tan airlight, more extinction in blue than in red, grains before the lens."""

    visibility_m: Annotated[float, Field(gt=0)] = Field(40.0, description="In green light, metres.")
    wind_m_s: Annotated[float, Field(ge=0, le=60)] = Field(12.0, description="Metres a second; lifts the dust.")

    @classmethod
    def of_severity(cls, severity: int) -> "Dust":
        """1 (100 m) to 5 (10 m), the ladder of fog, so that curves compare."""
        return cls(visibility_m=LADDER_M[severity - 1])

    @property
    def extinction(self) -> np.ndarray:
        """(3,) β of red, green and blue, 1/m."""
        # visibility is told in green light, 0.55 um
        return find_extinction(self.visibility_m) * (WAVELENGTHS_UM / 0.55) ** -ANGSTROM

    @property
    def mass_mg_per_m3(self) -> float:
        """Mass of dust in the air, mg/m³: 56 / V^1.25 with V in km (Chepil and Woodruff 1957)."""
        return 56.0 / (self.visibility_m / 1000) ** 1.25

    def describe(self) -> str:
        """`visibility 40 m, extinction 71.1 74.9 81.5 /km in red, green, blue, 3131 mg/m³`."""
        colours = " ".join(f"{1e3 * value:.3g}" for value in self.extinction)
        return (
            f"visibility {self.visibility_m:.4g} m, extinction {colours} /km in red, green, blue, "
            f"{self.mass_mg_per_m3:.0f} mg/m³"
        )

    def change_light(self, view: DepthView, airlight: np.ndarray, rng: np.random.Generator) -> AffineLight:
        """Effect of this weather on a picture; see `toolkit.rooms.worlds.depth_weather.Weather`."""
        tan = tan_airlight(airlight)
        # a sphere's volume in mm^3; 1 kg/m^3 is 1e-3 mg/mm^3
        grain_mg = np.pi / 6 * GRAIN_MM**3 * GRAIN_KG_PER_M3 * 1e-3
        per_m3 = GRAIN_SHARE * self.mass_mg_per_m3 / len(GRAIN_MM) / grain_mg
        grains = Population(GRAIN_MM, per_m3, np.full(len(GRAIN_MM), GRAIN_FALL_M_S))
        coverage = draw_coverage(view, grains, self.wind, self.exposure_s, rng)
        return hang_veil(view.path_m(DUST_LAYER_M), self.extinction, tan).then(
            lay_particles(coverage, GRAIN_LIGHT * tan)
        )
