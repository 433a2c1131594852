"""Clouds: a layer of heaps with flat bases and round tops, marched through ray by ray, and thin veils high above.

The noise that they are patterned by repeats, and serves snow on the ground as well.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.rig.textures import build_pyramid

EARTH_M = 6.371e6
BASE_M, TOP_M, VEIL_M = 1500.0, 2300.0, 8000.0
"""Heights of the heaps' bases, of the highest tops, and of the veils."""
SLICES = 32
TILE_PX = 512
TILE_M, VEIL_TILE_M = 21_000.0, 90_000.0
"""Sides of the patterns, which repeat."""
EXTINCTION = 0.02
"""1/m inside a heap; droplets of 10 µm, thinned for the few slices."""
EDGE_M = 60.0
"""How far a heap's surface is soft."""
HAZE_M = 28_000.0
"""Distance over which the air's own light covers what is far away."""
SUN_GAP_DEG = (5.0, 16.0)
"""Clouds stay this far from the sun, unless they cover all: a scene in sunlight keeps it whatever the seed."""


@dataclass(frozen=True)
class CloudLayer:
    """Effects of clouds on rays, each (n,)."""

    passed: np.ndarray  # (n,) share of the sky's light behind them that passes
    sunlit: np.ndarray  # (n,) share of a white surface's light that they send from the sun
    skylit: np.ndarray  # (n,) the same from the sky around
    distance_m: np.ndarray  # (n,) how far away they are


def reach_height(sine: np.ndarray, height_m: float | np.ndarray) -> np.ndarray:
    """Distance along rays from the ground, with the sine of their elevation, to a height above the round earth."""
    # the sphere of radius R + h met by a ray that starts at R: the positive root of d^2 + 2 R s d = 2 R h + h^2
    down = EARTH_M * sine
    return np.sqrt(down**2 + 2 * EARTH_M * height_m + height_m**2) - down


@dataclass(frozen=True)
class _Heaps:
    """The heaps that rays meet: two patterns; for each ray its bearing, cosine, and how much noise is a cloud."""

    swells: list[np.ndarray]
    tops: list[np.ndarray]
    flat: np.ndarray
    cosine: np.ndarray
    threshold: np.ndarray
    lean: np.ndarray
    cover: float
    pixel_rad: float

    @classmethod
    def draw(
        cls, directions: np.ndarray, sun: np.ndarray, cover: float, pixel_rad: float, rng: np.random.Generator
    ) -> "_Heaps":
        """Arguments are those of `march_clouds`."""
        swells, tops = (paint_levels(rng, TILE_PX, slope, 4) for slope in (2.0, 1.75))
        # a pattern lies flat above the ground: where a ray meets it is its bearing times the distance
        flat = directions[:, :2] / np.maximum(np.linalg.norm(directions[:, :2], axis=1, keepdims=True), 1e-6)
        # clouds are held away from the sun by a higher threshold there
        gap = np.degrees(np.arccos(np.clip(directions @ sun, -1, 1)))
        open_sky = np.clip((gap - SUN_GAP_DEG[0]) / (SUN_GAP_DEG[1] - SUN_GAP_DEG[0]), 0, 1)
        # metres aside per metre up, towards the light; bounded, as a sun at the horizon would move it endlessly far
        lean = np.clip(sun[:2] / max(float(sun[2]), 0.25), -2, 2)
        return cls(
            swells, tops, flat, cosine=np.sqrt(1 - np.minimum(directions[:, 2], 1) ** 2),
            threshold=(1 - cover) + cover * (1 - open_sky), lean=lean, cover=cover, pixel_rad=pixel_rad,
        )  # fmt: skip

    def find_top(self, rays: np.ndarray, distance_m: np.ndarray, step_m: np.ndarray, aside_m: float) -> np.ndarray:
        """(k,) height of the heap above its base where some rays are, moved towards the light."""
        place = (distance_m * self.cosine[rays])[:, None] * self.flat[rays] + self.lean * aside_m
        u, v = (place / TILE_M).T
        # what is finer than the next step would stand in stairs
        lod = np.log2(np.maximum(distance_m * self.pixel_rad, 0.6 * step_m) * TILE_PX / TILE_M)
        swelling = sample_noise(self.swells, u, v, lod)
        detail = sample_noise(self.tops, 5.7 * u, 5.7 * v, lod + 2.5) - 0.5
        # a heap is as high as the noise is over the threshold; the power rounds its top
        excess = np.clip((swelling + 0.1 * detail - self.threshold[rays]) / max(self.cover, 0.35), 0, 1)
        return (TOP_M - BASE_M) * excess**0.55 * (0.8 + 0.5 * detail) - EDGE_M / 2


def march_clouds(
    directions: np.ndarray, sun: np.ndarray, cover: float, pixel_rad: float, rng: np.random.Generator
) -> CloudLayer:
    """March rays from the ground through a layer of clouds.

    Args:
        directions: (n, 3) unit, above the horizon.
        sun: (3,) unit vector to the sun or to where its light comes from.
        cover: share of the sky that is covered, 0 to 1.
        pixel_rad: angle between neighbouring rays; finer detail is averaged.
    """
    heaps = _Heaps.draw(directions, sun, cover, pixel_rad, rng)
    sine, cosine = directions[:, 2], heaps.cosine
    passed, sunlit, skylit = np.ones_like(sine), np.zeros_like(sine), np.zeros_like(sine)
    slice_m = (TOP_M - BASE_M) / SLICES
    early = rng.random(len(sine))  # every ray begins elsewhere in its first slice, or the slices would show
    nearest = before = reach_height(sine, BASE_M + 0 * sine)
    for k in range(SLICES):
        above = (k + early) * slice_m
        after = reach_height(sine, BASE_M + above + slice_m / 2)
        # how far the ray is in this slice, which grows towards the horizon
        length, before = after - before, after
        # what is hidden already needs no further marching
        rays = np.flatnonzero(passed > 0.01)
        step = length[rays] * cosine[rays]
        top = heaps.find_top(rays, after[rays], step, 0.0)
        inside = top > above[rays] - EDGE_M / 2
        rays, top, step = rays[inside], top[inside], step[inside]
        height = above[rays]
        # one look 220 m towards the light stands for the march that a real shadow needs
        towards = heaps.find_top(rays, after[rays], step, 220.0) - 220 * max(float(sun[2]), 0.2)
        shaded = 0.35 * np.maximum(top - height, 0) + np.maximum(towards - height, 0)
        # shaded parts keep some: light that was scattered many times comes from everywhere
        lit = 0.15 + 0.85 * np.exp(-shaded / 300)
        # soft over EDGE_M, or tops would have hard edges
        filled = np.clip((top - height) / EDGE_M + 0.5, 0, 1)
        lost = passed[rays] * (1 - np.exp(-EXTINCTION * filled * np.minimum(length[rays], 400)))
        sunlit[rays] += lost * lit
        skylit[rays] += lost * (0.35 + 0.65 * height / (TOP_M - BASE_M))
        # front to back: what a slice takes is missing behind it
        passed[rays] -= lost
    return CloudLayer(passed, sunlit, skylit, nearest)


def lay_veils(directions: np.ndarray, amount: float, pixel_rad: float, rng: np.random.Generator) -> np.ndarray:
    """(n,) share of the sky that thin streaks of ice hide, at most 0.45."""
    levels = paint_levels(rng, TILE_PX, 1.5, 3)
    distance = reach_height(directions[:, 2], VEIL_M)
    lod = np.log2(distance * pixel_rad * TILE_PX / VEIL_TILE_M)
    # a single direction for all streaks: the wind's
    angle = rng.uniform(0, np.pi)
    x, y = directions[:, 0] * distance / VEIL_TILE_M, directions[:, 1] * distance / VEIL_TILE_M
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    # drawn out along a direction, as wind does with ice
    streaks = sample_noise(levels, 0.35 * along, 1.6 * across, lod)
    wisps = sample_noise(levels, 1.1 * x, 1.1 * y, lod)
    return 0.45 * np.clip(2.2 * (streaks * wisps - 0.75 + 0.6 * amount), 0, 1)


ROW = 1024


def paint_noise(rng: np.random.Generator, side_px: int, slope: float, coarsest: float) -> np.ndarray:
    """(side, side) float32 periodic noise, every value in [0, 1] as frequent.

    Args:
        slope: amplitudes fall as frequency^-slope.
        coarsest: waves longer than this part of the side are no stronger.
    """
    waves = np.hypot(np.fft.fftfreq(side_px)[:, None], np.fft.rfftfreq(side_px)[None]) * side_px
    # white noise, each wave weakened by its frequency; the inverse transform repeats by nature
    spectrum = np.fft.rfft2(rng.standard_normal((side_px, side_px))) / np.maximum(waves, coarsest) ** slope
    smooth = np.fft.irfft2(spectrum, s=(side_px, side_px))
    rank = np.empty(side_px**2, np.float32)
    # by rank: a threshold then covers exactly the share of the pattern that it names
    rank[np.argsort(smooth, axis=None)] = (np.arange(side_px**2) + 0.5) / side_px**2
    return rank.reshape(side_px, side_px)


def paint_levels(rng: np.random.Generator, side_px: int, slope: float, coarsest: float) -> list[np.ndarray]:
    """`paint_noise` and its averages, each half as large as the previous."""
    return build_pyramid(paint_noise(rng, side_px, slope, coarsest))


def sample_noise(levels: list[np.ndarray], u: np.ndarray, v: np.ndarray, lod: np.ndarray) -> np.ndarray:
    """(n,) values of a pattern at (u, v), averaged over 2^lod of its texels; it repeats outside [0, 1]."""
    # trilinear, as a texture unit does it: bilinear in two levels, then between these
    lod = np.clip(lod, 0, len(levels) - 1)
    below = lod.astype(np.int32)
    found = np.empty(len(u), np.float32)
    for level in np.unique(below):
        chosen = np.flatnonzero(below == level)
        values = _look_up(levels[level], u[chosen], v[chosen])
        if level + 1 < len(levels):
            values += (_look_up(levels[level + 1], u[chosen], v[chosen]) - values) * (lod[chosen] - level)
        found[chosen] = values
    return found


def _look_up(level: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n,) bilinear values; OpenCV looks rows of places up, and none of more than 32767."""
    rows = -(-len(u) // ROW)
    x, y = np.zeros(rows * ROW, np.float32), np.zeros(rows * ROW, np.float32)
    x[: len(u)] = np.mod(u, 1) * level.shape[1] - 0.5
    y[: len(v)] = np.mod(v, 1) * level.shape[0] - 0.5
    found = cv2.remap(level, x.reshape(rows, ROW), y.reshape(rows, ROW), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found, np.float32).reshape(-1)[: len(u)]
