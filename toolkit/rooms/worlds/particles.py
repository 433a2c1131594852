"""Particles before a camera with depth, drop by drop: rain, flakes, grains of sand.

A particle of diameter D at distance z, in focus or not, moving while the shutter is open, shades π/4 (fD/z)² pixels in
full. That is spread over the streak it draws. Those too faint to be told from the veil of all the others are not drawn.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field

from toolkit.core.config import Config
from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, orbit_direction, pixel_rays

LOWEST_RISE = 1e-3
"""Smallest rise of a ray. Its path through a layer is at most 1000 times the height, because the earth is round."""
FAINTEST = 0.015
"""Share of a pixel's light below which a particle is not drawn."""
APERTURE_MM = 2.0
"""Aperture of the lens, mm: a phone's 4 mm at f/2, focused far away. It blurs near drops into discs of f · 2 mm / z."""
NEAREST_M = 0.25
MOST = 30_000
"""Particles in a picture; the farthest are left out where there would be more."""


@dataclass(frozen=True)
class DepthView:
    """How far away everything in a picture of h × w pixels is. The world is in metres, z up."""

    depth_m: np.ndarray  # (h, w) float32 distance along each pixel's ray, inf for the sky
    camera: Camera  # of h × w pixels; its distortion is left out
    T_world_camera: np.ndarray  # (4, 4) camera's pose, metres
    # (h, w) bool, or share of the pixel in [0, 1], where the ground is seen, which rain wets and snow covers
    ground: np.ndarray | None = None
    normals: np.ndarray | None = None  # (h, w, 3) unit, in the world, 0 for the sky; snow lies where they point up
    # (3,) linear light of a white surface that lies in the open, which snow has; by default the airlight
    white: np.ndarray | None = None

    def __post_init__(self) -> None:
        shape = (self.camera.height, self.camera.width)
        for name in ("depth_m", "ground", "normals"):
            found = getattr(self, name)
            if found is not None and found.shape[:2] != shape:
                expected = f"expected the camera's {shape[1]} × {shape[0]}"
                raise ToolkitError(f"{name} of {found.shape[1]} × {found.shape[0]} pixels: {expected}")

    @cached_property
    def directions(self) -> np.ndarray:
        """(h, w, 3) float32 unit rays through the pixels' centres, in the world."""
        height, width = self.depth_m.shape
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2) + np.float32(0.5)
        return pixel_rays(self.camera, self.T_world_camera, pixels)[:, 3:].reshape(height, width, 3)

    def path_m(self, layer_m: float) -> np.ndarray:
        """(h, w) float32 metres of air that light comes through, in a layer of even height above the camera.

        Up to the surface, or where there is only sky up to the layer's top.
        """
        sky = np.isinf(self.depth_m)
        if not sky.any():
            return self.depth_m
        rise = np.maximum(self.directions[sky][:, 2], LOWEST_RISE)
        path = self.depth_m.copy()
        path[sky] = layer_m / rise
        return path

    @property
    def position_m(self) -> np.ndarray:
        """(3,) float32 where the camera is."""
        return self.T_world_camera[:3, 3].astype(np.float32)


@dataclass(frozen=True)
class AffineLight:
    """Effect of weather on linear light: `factor · light + offset`, whatever the light; so a gradient is `factor`."""

    factor: np.ndarray  # (h, w, 1 or 3) float32 in [0, 1]
    offset: np.ndarray  # (h, w, 3) float32, in the unit of the airlight that it was made with

    def apply(self, light: np.ndarray) -> np.ndarray:
        """(h, w, 3) float32 linear light through this weather."""
        return light * self.factor + self.offset

    def then(self, later: "AffineLight") -> "AffineLight":
        """Both in turn; what is `later` is nearer to the camera."""
        return AffineLight(self.factor * later.factor, self.offset * later.factor + later.offset)


class InWind(Config):
    """Settings of whatever is carried by the wind past a camera."""

    wind_m_s: Annotated[float, Field(ge=0, le=60)] = Field(3.0, description="Wind, metres a second.")
    wind_from_deg: float = Field(0.0, description="Azimuth in the world that the wind comes from.")
    exposure_s: Annotated[float, Field(gt=0, le=1)] = Field(1 / 500, description="How long the shutter is open.")

    @property
    def wind(self) -> np.ndarray:
        """(3,) m/s in the world."""
        return -self.wind_m_s * orbit_direction(self.wind_from_deg, 0)


@dataclass(frozen=True)
class Population:
    """Particles by size, an entry of (k,) for each."""

    diameter_mm: np.ndarray  # size
    per_m3: np.ndarray  # how many there are in a cubic metre
    fall_m_s: np.ndarray  # how fast they fall in still air

    def reach_m(self, focal_px: float, wind_m_s: float, exposure_s: float) -> np.ndarray:
        """(k,) distance at which a particle gets too faint to be drawn; 0 for those that always are."""
        size, blurred = self.diameter_mm / 1e3, (self.diameter_mm + APERTURE_MM) / 1e3
        trail = blurred + np.hypot(self.fall_m_s, wind_m_s) * exposure_s
        # the area over which the light of a particle may be spread before it is too faint
        area = np.pi / 4 * size**2 / FAINTEST
        # too faint by its size alone, or because its light is spread along its trail
        reach = np.minimum(focal_px * np.sqrt(area), focal_px * area / trail)
        return np.where(area < blurred * trail, np.minimum(reach, focal_px * blurred), reach)

    def count_seen(self, camera: Camera, reach_m: np.ndarray) -> np.ndarray:
        """(k,) mean number between `NEAREST_M` and `reach_m` in the picture's pyramid."""
        # the pyramid's cross-section at 1 m; its volume up to r is opening r^3 / 3
        opening = camera.width * camera.height / (camera.fx * camera.fy)
        return self.per_m3 * opening / 3 * np.maximum(reach_m**3 - NEAREST_M**3, 0)


@dataclass(frozen=True)
class _Streaks:
    """Particles as the picture shows them, a row of (n,) for each; lengths in pixels."""

    x: np.ndarray
    y: np.ndarray
    along_x: np.ndarray
    along_y: np.ndarray
    length: np.ndarray
    width: np.ndarray
    area: np.ndarray
    range_m: np.ndarray


def draw_coverage(
    view: DepthView, particles: Population, wind: np.ndarray, exposure_s: float, rng: np.random.Generator
) -> np.ndarray:
    """(h, w) float32 share of each pixel's light that particles in front of the surface take, in [0, 1].

    Args:
        wind: (3,) m/s in the world.
    """
    streaks = _scatter(view, particles, wind, exposure_s, rng)
    height, width = view.depth_m.shape
    x, y, share, owner = _dot(streaks)
    column, row = np.floor(x).astype(np.int32), np.floor(y).astype(np.int32)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    x, y, share, owner, column, row = (array[inside] for array in (x, y, share, owner, column, row))
    # what is behind the surface is not seen
    free = view.depth_m[row, column] > streaks.range_m[owner]
    x, y, share = x[free] + np.float32(0.5), y[free] + np.float32(0.5), share[free]
    # an empty rim takes what would fall outside
    left, top = x.astype(np.int32), y.astype(np.int32)
    right_share, low_share = x - left, y - top
    cell = top * (width + 2) + left
    total = np.zeros((height + 2) * (width + 2))
    for step, weight in (
        (0, (1 - right_share) * (1 - low_share)), (1, right_share * (1 - low_share)),
        (width + 2, (1 - right_share) * low_share), (width + 3, right_share * low_share),
    ):  # fmt: skip
        # each dot is shared by the four pixels around it
        total += np.bincount(cell + step, weight * share, minlength=len(total))
    return np.minimum(total.reshape(height + 2, width + 2)[1:-1, 1:-1], 1).astype(np.float32)


def lay_particles(coverage: np.ndarray, radiance: np.ndarray) -> AffineLight:
    """Particles that cover (h, w) shares and send (3,) linear light."""
    cover = coverage[..., None]
    return AffineLight(1 - cover, cover * radiance.astype(np.float32))


def _scatter(
    view: DepthView, particles: Population, wind: np.ndarray, exposure_s: float, rng: np.random.Generator
) -> _Streaks:
    """Particles at random places of the picture's pyramid, evenly by volume."""
    camera = view.camera
    reach = particles.reach_m(camera.fx, float(np.linalg.norm(wind)), exposure_s)
    mean = particles.count_seen(camera, reach)
    # the number grows with the cube of the reach
    if mean.sum() > MOST:
        reach *= (MOST / mean.sum()) ** (1 / 3)
        mean = particles.count_seen(camera, reach)
    kind = np.repeat(np.arange(len(mean)), rng.poisson(mean))
    u, x, y = rng.random((3, len(kind)))
    # even by volume: the cube of the distance is drawn evenly
    z = np.cbrt(NEAREST_M**3 + u * (reach[kind] ** 3 - NEAREST_M**3))
    x, y = x * camera.width, y * camera.height
    across, down = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy
    velocity = np.tile(wind, (len(mean), 1))
    velocity[:, 2] -= particles.fall_m_s
    # their velocity in the camera's axes
    right, below, ahead = (velocity @ view.T_world_camera[:3, :3])[kind].T
    # the derivative of the projection: what comes towards the lens moves outward
    along_x = camera.fx * (right - across * ahead) * exposure_s / z
    along_y = camera.fy * (below - down * ahead) * exposure_s / z
    length = np.hypot(along_x, along_y)
    size = particles.diameter_mm[kind] / 1e3
    values = (
        x, y, along_x / np.maximum(length, 1e-6), along_y / np.maximum(length, 1e-6), length,
        camera.fx * (size + APERTURE_MM / 1e3) / z, np.pi / 4 * (camera.fx * size / z) ** 2,
        z * np.sqrt(1 + across**2 + down**2),
    )  # fmt: skip
    return _Streaks(*(array.astype(np.float32) for array in values))


def _dot(streaks: _Streaks) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Streaks as dots no more than a pixel apart: x, y, share of a pixel, and whose each is."""
    # a dot in every pixel of the streak's length and width: each becomes a row of the arrays below
    whole = streaks.length + streaks.width
    steps = np.ceil(np.maximum(whole, 1)).astype(np.int64)
    rows = np.ceil(np.maximum(streaks.width, 1)).astype(np.int64)
    # a streak is a strip of dots, as wide as its blur
    counts = steps * rows
    owner = np.repeat(np.arange(len(counts)), counts)
    # each dot's number within its own streak
    number = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    step, row = np.divmod(number, rows[owner])
    # dots lie evenly about the streak's middle
    along = (((step + 0.5) / steps[owner] - 0.5) * whole[owner]).astype(np.float32)
    aside = (((row + 0.5) / rows[owner] - 0.5) * streaks.width[owner]).astype(np.float32)
    # beyond the straight part, the ends are round
    end = np.maximum(np.abs(along) - streaks.length[owner] / 2, 0)
    away = (end**2 + aside**2) / (streaks.width[owner] / 2) ** 2
    weight = np.where(rows[owner] > 2, np.maximum(1 - away, 0), 1)  # a disc that is soft at its edge
    # the dots of a streak share its area, whatever their number
    weight *= (streaks.area / np.bincount(owner, weight, minlength=len(counts)))[owner]
    x = streaks.x[owner] + streaks.along_x[owner] * along - streaks.along_y[owner] * aside
    y = streaks.y[owner] + streaks.along_y[owner] * along + streaks.along_x[owner] * aside
    return x, y, weight, owner
