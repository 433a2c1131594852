"""Rain: a thin veil, streaks by the size of the drops, and ground that is darker for being wet."""

from typing import Annotated

import numpy as np
from pydantic import Field

from toolkit.worlds.depth_view import AffineLight, DepthView
from toolkit.worlds.fog import find_visibility, hang_veil
from toolkit.worlds.particles import InWind, Population, draw_coverage, lay_particles

LADDER_MM_H = (5.0, 10.0, 25.0, 50.0, 100.0)
"""Rates by severity. The WMO calls it moderate from 2.5, heavy from 10, violent from 50 mm/h."""
CLOUD_BASE_M = 1500.0
"""Assumed height that the rain falls from; the sky is seen through it."""
BIN_MM = 0.1
DIAMETERS_MM = np.arange(0.5, 6.0, BIN_MM) + BIN_MM / 2
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
    return Population(DIAMETERS_MM, density * BIN_MM, 9.65 - 10.3 * np.exp(-0.6 * DIAMETERS_MM))


class Rain(InWind):
    """Rain of an even rate between camera and scene; it is best seen below an overcast sky."""

    rate_mm_h: Annotated[float, Field(ge=0, le=300)] = Field(25.0, description="Water on the ground, mm an hour.")
    wetness: Annotated[float, Field(ge=0, le=1)] | None = Field(
        None, description="Of the ground, 0 dry to 1 soaked; by default what the rate makes of it."
    )

    @classmethod
    def of_severity(cls, severity: int) -> "Rain":
        """1 (5 mm/h) to 5 (100 mm/h)."""
        return cls(rate_mm_h=LADDER_MM_H[severity - 1])

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
        """What this weather makes of a picture; see `toolkit.worlds.weather.Weather`."""
        veil = hang_veil(view.path_m(CLOUD_BASE_M), np.array([find_rain_extinction(self.rate_mm_h)]), airlight)
        coverage = draw_coverage(view, make_drops(self.rate_mm_h), self.wind, self.exposure_s, rng)
        seen = veil.then(lay_particles(coverage, DROP_LIGHT * airlight))
        if view.ground is None:
            return seen
        dry = np.asarray(view.ground, np.float32)[..., None]
        return AffineLight(seen.factor * (1 - dry * np.float32(1 - self.ground_factor)), seen.offset)
