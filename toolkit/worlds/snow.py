"""Snow: a veil, flakes, and a white cover on what faces up."""

from functools import lru_cache
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from toolkit.worlds.depth_view import AffineLight, DepthView
from toolkit.worlds.fog import find_visibility, hang_veil
from toolkit.worlds.noise import paint_noise
from toolkit.worlds.particles import InWind, Population, draw_coverage, lay_particles
from toolkit.worlds.rain import CLOUD_BASE_M

LADDER_MM_H = (1.0, 2.0, 4.0, 6.0, 10.0)
"""Rates by severity, as melted water: visibilities of 2350, 905, 348, 199 and 98 m. The US weather service calls it
light from 1000 m, heavy below 400 m."""
LADDER_COVER = (0.15, 0.35, 0.6, 0.8, 0.95)
"""Assumed: share of an even surface that is white; it depends on how long it has been snowing, not on the rate."""
BIN_MM = 0.2
MELTED_MM = np.arange(0.3, 5.0, BIN_MM) + BIN_MM / 2
"""Diameters of the drops that flakes melt to."""
FLAKE_DENSITY = 0.1
"""Of water's."""
FLAKE_LIGHT, COVER_LIGHT = 0.9, 0.85
"""Assumed: light of flakes over the mean of the air's and white ground's, and the albedo of lying snow; fresh snow has
0.8 to 0.9."""
FLAT, STEEP = 0.8, 0.4
"""Assumed: snow lies on all of a surface whose normal's z is above 0.8 (37°) and on none below 0.4 (66°)."""
TILE_M, TILE_PX, COARSEST = 40.0, 512, 10
"""The pattern in which the cover lies repeats after 40 m; its largest patches are a tenth of that."""
SOFT = 0.08
"""Of a patch's edge, in steps of that order."""
BLENDED_M = 1.0
"""Ground below a pixel across which patches are no longer told apart."""


def find_snow_extinction(rate_mm_h: float) -> float:
    """β in 1/m of dry snow in green light: 5.53 S^1.38 dB/km (ITU-R P.1817)."""
    return np.log(10) / 10 * (5.42e-5 * 550 + 5.4958776) * rate_mm_h**1.38 / 1e3


def make_flakes(rate_mm_h: float) -> Population:
    """Flakes of Gunn and Marshall (1958), N(D) = 3800 R^-0.87 exp(-2.55 R^-0.48 D) per m³ and mm of melted diameter.

    They fall at 1.6 D^0.3 m/s with D in cm (Langleben 1954, dendrites), and are larger than their drops by the cube
    root of ten, their density being a tenth of water's.
    """
    rate = max(rate_mm_h, 1e-3)
    density = 3800 * rate**-0.87 * np.exp(-2.55 * rate**-0.48 * MELTED_MM) * (rate_mm_h > 0)
    return Population(MELTED_MM * FLAKE_DENSITY ** (-1 / 3), density * BIN_MM, 1.6 * (MELTED_MM / 10) ** 0.3)


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
        return cls(rate_mm_h=LADDER_MM_H[severity - 1], cover=LADDER_COVER[severity - 1])

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
        """What this weather makes of a picture; see `toolkit.worlds.weather.Weather`."""
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
        reach = np.where(np.isfinite(view.depth_m), view.depth_m, 0)
        x, y = (
            ((view.directions[..., axis] * reach + view.position_m[axis]) / TILE_M % 1 * TILE_PX).astype(np.float32)
            for axis in (0, 1)
        )
        order = cv2.remap(_cover_pattern(), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        patches = np.clip((self.cover * (1 + SOFT) - order) / SOFT, 0, 1)
        pixel_m = reach / view.camera.fx / np.maximum(np.abs(view.directions[..., 2]), 0.02)
        blended = np.clip(pixel_m / BLENDED_M, 0, 1)
        return (flat * (patches + (self.cover - patches) * blended)).astype(np.float32)
