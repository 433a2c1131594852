"""A sky for a world: a panorama, the sun as a light of its own, and the exposure of a camera below them.

Luminances are in kcd/m², illuminances in klx, both as linear sRGB; the exposure brings them to picture values.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.imaging.colour import LINEAR_OF_CODE, XYZ_OF_LINEAR_SRGB
from toolkit.imaging.read import read_image, read_linear
from toolkit.rig.camera import orbit_direction
from toolkit.rig.scene import KeyLight, illuminate
from toolkit.rig.textures import build_pyramid, sample_directions
from toolkit.worlds.conditions import TIMES, TimeOfDay, check_time

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
    """What clouds do to rays, a row of (n,) for each.

    Attributes:
        passed: (n,) share of the sky's light behind them that passes.
        sunlit: (n,) share of a white surface's light that they send from the sun.
        skylit: (n,) the same from the sky around.
        distance_m: (n,) how far away they are.
    """

    passed: np.ndarray
    sunlit: np.ndarray
    skylit: np.ndarray
    distance_m: np.ndarray


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
        rng: draws the clouds.
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
    angle = rng.uniform(0, np.pi)
    x, y = directions[:, 0] * distance / VEIL_TILE_M, directions[:, 1] * distance / VEIL_TILE_M
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    # drawn out along one direction, as wind does with ice
    streaks = sample_noise(levels, 0.35 * along, 1.6 * across, lod)
    wisps = sample_noise(levels, 1.1 * x, 1.1 * y, lod)
    return 0.45 * np.clip(2.2 * (streaks * wisps - 0.75 + 0.6 * amount), 0, 1)


ROW = 1024


def paint_noise(rng: np.random.Generator, side_px: int, slope: float, coarsest: float) -> np.ndarray:
    """(side, side) float32 periodic noise, every value in [0, 1] as frequent.

    Args:
        rng: draws it.
        side_px: of the pattern.
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
    """`paint_noise` and its averages, each half as large as the one before."""
    return build_pyramid(paint_noise(rng, side_px, slope, coarsest))


def sample_noise(levels: list[np.ndarray], u: np.ndarray, v: np.ndarray, lod: np.ndarray) -> np.ndarray:
    """(n,) values of a pattern at (u, v), averaged over 2^lod of its texels; it repeats outside [0, 1]."""
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


LUMINANCE = XYZ_OF_LINEAR_SRGB[1]
LOWEST_SUN_DEG = 2.0
"""Below it the sky keeps this sun's shape; the model has no night."""
SUN_KLX = 133.8
"""Outside the air, on a surface that faces it."""
SUN_COLOUR = np.array([1.118, 0.974, 0.911])
"""Outside the air: a black body of 5800 K, of luminance 1."""
WAVELENGTHS_UM = np.array([0.61, 0.55, 0.465])
"""Of red, green and blue."""
OZONE_CM, OZONE_PER_CM = 0.35, np.array([0.128, 0.085, 0.008])

PEREZ = np.array([
    # slope and intercept in turbidity of A, B, C, D, E, for luminance Y and chromaticities x and y
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
    [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
])  # fmt: skip
ZENITH_X = np.array([
    [0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886],
])  # fmt: skip
ZENITH_Y = np.array([
    [0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688],
])  # fmt: skip


def find_zenith(sun_elevation_deg: float, turbidity: float) -> tuple[float, float, float]:
    """Luminance in kcd/m² and chromaticity x, y of the zenith, by Preetham."""
    theta = np.radians(90 - sun_elevation_deg)
    # Preetham et al. 1999, appendix A.2: zenith luminance, and chromaticities as cubics of the sun's angle
    chi = (4 / 9 - turbidity / 120) * (np.pi - 2 * theta)
    luminance = (4.0453 * turbidity - 4.9710) * np.tan(chi) - 0.2155 * turbidity + 2.4192
    powers = np.array([turbidity**2, turbidity, 1]), np.array([theta**3, theta**2, theta, 1])
    return luminance, float(powers[0] @ ZENITH_X @ powers[1]), float(powers[0] @ ZENITH_Y @ powers[1])


def clear_sky(directions: np.ndarray, sun: np.ndarray, turbidity: float) -> np.ndarray:
    """(..., 3) linear sRGB of a clear sky, kcd/m², by Preetham alone; below the horizon as at it.

    Args:
        directions: (..., 3) unit vectors.
        sun: (3,) unit vector to the sun, above the horizon.
        turbidity: 2 very clear to 8 hazy.
    """
    cosine = np.clip(directions[..., 2], 0.01, 1)
    cos_gamma = np.clip(directions @ sun, -1, 1)
    gamma = np.arccos(cos_gamma)
    zenith_angle = float(np.arccos(sun[2]))

    def perez(row: np.ndarray, cosine: np.ndarray | float, gamma: np.ndarray | float) -> np.ndarray:
        a, b, c, d, e = row @ (turbidity, 1)
        # Perez et al. 1993: a term of the angle from the zenith times one of the angle from the sun
        return (1 + a * np.exp(b / cosine)) * (1 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)

    zenith = find_zenith(90 - np.degrees(zenith_angle), turbidity)
    luminance, x, y = (
        high * perez(row, cosine, gamma) / perez(row, 1.0, zenith_angle)
        for high, row in zip(zenith, PEREZ, strict=True)
    )
    # xyY to XYZ
    xyz = np.stack([luminance * x / y, luminance, luminance * (1 - x - y) / y], axis=-1)
    # deep blues lie outside sRGB, where a channel is negative
    return np.maximum(xyz @ np.linalg.inv(XYZ_OF_LINEAR_SRGB).T, 0)


def find_air_mass(elevation_deg: float) -> float:
    """Of the path to the sun, 1 at the zenith (Kasten 1965); from 0° up."""
    elevation_deg = max(elevation_deg, 0.0)
    return 1 / (np.sin(np.radians(elevation_deg)) + 0.15 * (elevation_deg + 3.885) ** -1.253)


def sunlight(elevation_deg: float, turbidity: float) -> np.ndarray:
    """(3,) linear sRGB of the sun's illuminance on a surface that faces it, klx; 0 once its disc has set."""
    mass = find_air_mass(elevation_deg)
    # Angstrom's beta from turbidity, as in Preetham's appendix
    haze = 0.04608 * turbidity - 0.04586
    # Rayleigh's scattering, Ångström's haze and ozone, as in Preetham's appendix
    lost = 0.008735 * WAVELENGTHS_UM**-4.08 + haze * WAVELENGTHS_UM**-1.3 + OZONE_PER_CM * OZONE_CM
    # the disc is 0.53° across
    above = np.clip(elevation_deg / 0.53 + 0.5, 0, 1)  # share of the disc above the horizon
    return SUN_KLX * SUN_COLOUR * np.exp(-lost * mass) * above


def diffuse_klx(sun_elevation_deg: float) -> float:
    """Illuminance of level ground by a clear sky without its sun.

    By day 0.8 + 15.5 √sin h (IES, 1984), but near the horizon and below it no more than sun and sky bring together.
    """
    by_day = 0.8 + 15.5 * float(np.sqrt(max(np.sin(np.radians(sun_elevation_deg)), 0.0)))
    return min(by_day, twilight_klx(sun_elevation_deg))


TWILIGHT = (
    (20.0, (3.74, 3.97, -4.07, 1.47)), (5.0, (3.05, 13.28, -45.98, 64.33)), (-0.8, (2.88, 22.26, -207.64, 1034.30)),
    (-5.0, (2.88, 21.81, -258.11, -858.36)), (-12.0, (2.70, 12.17, -431.69, -1899.83)),
)  # fmt: skip


def twilight_klx(sun_elevation_deg: float) -> float:
    """Illuminance of level ground by sun and sky together, from 90° to -12°.

    Janiczek and DeYoung 1987, US Naval Observatory circular 171.
    """
    x = max(sun_elevation_deg, -12.0) / 90
    terms = next((terms for low, terms in TWILIGHT if 90 * x >= low), TWILIGHT[-1][1])
    return float(10 ** sum(term * x**power for power, term in enumerate(terms))) / 1e3


def overcast_klx(sun_elevation_deg: float) -> float:
    """Illuminance of level ground below an overcast sky: 0.3 + 21 sin h (IES, 1984)."""
    return 0.3 + 21 * max(float(np.sin(np.radians(sun_elevation_deg))), 0.0)


def overcast_shape(sine: np.ndarray) -> np.ndarray:
    """Luminance over the zenith's at the sine of an elevation: (1 + 2 sin h) / 3 (Moon and Spencer 1942; CIE)."""
    return (1 + 2 * np.clip(sine, 0, 1)) / 3


SUN_RADIUS_DEG = 0.27
GROUND_ALBEDO = np.array([0.19, 0.18, 0.16])
"""Of the panorama's lower half: asphalt, concrete, earth and leaves, from afar."""


LAMPS = 0.06
"""Luminance of the brightest lit windows, kcd/m² (assumed); lamps, which are far brighter, are white anyway."""


@dataclass(frozen=True)
class Sky:
    """All light that comes from far away.

    Attributes:
        name: for records.
        panorama: (h, w, 3) float32 linear radiance, kcd/m², as `Studio.environment`: row 0 is straight up, the middle
            column azimuth 0, azimuth grows to the left. The sun's glow is in it, its disc is not.
        sun: the sun; its irradiance in klx is (0, 0, 0) where it is hidden or has set.
        exposure: factor from radiance to the picture's linear values.
        lamps_on: whether street lamps are lit.
    """

    name: str
    panorama: np.ndarray
    sun: KeyLight
    exposure: float
    lamps_on: bool = False

    @property
    def lamps(self) -> float:
        """Radiance of a surface whose `Material.emission` is 1, kcd/m²; 0 where lamps are off: see `Scene.lamps`."""
        return LAMPS if self.lamps_on else 0.0

    @cached_property
    def airlight(self) -> np.ndarray:
        """(3,) linear light that fog sends, in the picture's values.

        The mean of what comes from all directions, ground and sun included: droplets that scatter evenly send that.
        """
        height = self.panorama.shape[0]
        elevation = np.pi / 2 - (np.arange(height) + 0.5) * np.pi / height
        # rows of a panorama shrink towards the poles
        weight = np.cos(elevation) / np.cos(elevation).sum()
        around = (self.panorama.mean(axis=1) * weight[:, None]).sum(axis=0)
        return (around + np.array(self.sun.irradiance) / (4 * np.pi)) * self.exposure

    @cached_property
    def white(self) -> np.ndarray:
        """(3,) linear light of a white surface that lies in the open, in the picture's values."""
        return illuminate(self.panorama, self.sun) / np.pi * self.exposure

    def render(self, directions: np.ndarray) -> np.ndarray:
        """(n, 3) linear light in the picture's values along unit directions (n, 3); without the sun's disc."""
        return sample_directions(self.panorama, directions) * np.float32(self.exposure)


def find_directions(height: int) -> np.ndarray:
    """(height, 2 · height, 3) float32 unit vectors of an equirectangular panorama's pixels."""
    elevation = np.pi / 2 - (np.arange(height) + 0.5) * np.pi / height
    azimuth = np.pi - (np.arange(2 * height) + 0.5) * np.pi / height
    ring = np.cos(elevation)[:, None]
    return np.stack(
        [ring * np.cos(azimuth), ring * np.sin(azimuth), np.repeat(np.sin(elevation)[:, None], 2 * height, axis=1)], -1
    ).astype(np.float32)


BALANCE = 0.5
"""Share of the light's colour that white balance takes out: evenings stay warm."""
METERED_ALBEDO, METERED_VALUE = 0.18, 0.22
"""A grey card on open ground, and the linear value it gets in daylight."""
SKY_SHARE, METERED_SKY_DEG = 0.45, 40.0
"""A camera's meter sees as much of the sky below 40° as of the ground, and takes it for less than half as bright."""
DIM_KLX, DIM_POWER = 2.0, 0.18
"""Below it pictures get a bit darker, as photographs of the evening are."""


def meter_exposure(panorama: np.ndarray, sun: KeyLight) -> float:
    """Factor from radiance to linear picture values: the mean of a grey card on open ground and of the low sky."""
    irradiance = float(illuminate(panorama, sun) @ LUMINANCE)
    if irradiance <= 0:
        return 1.0
    height = panorama.shape[0]
    low_sky = panorama[round(height / 2 * (1 - METERED_SKY_DEG / 90)) : height // 2].mean(axis=(0, 1)) @ LUMINANCE
    metered = (METERED_ALBEDO * irradiance / np.pi + SKY_SHARE * float(low_sky)) / 2
    return METERED_VALUE / metered


@lru_cache(maxsize=4)
def make_sky(time: str | TimeOfDay = "noon", seed: int = 0, height_px: int = 512) -> Sky:
    """A sky of a time of day; equal arguments give equal bytes.

    Args:
        time: one of `TIMES`, or one's own.
        seed: of the clouds.
        height_px: of the panorama, which is twice as wide; 512 is 3 pixels a degree.

    Raises:
        ToolkitError: there is no such time of day.
        FieldError: the height is odd or too small.
    """
    if height_px < 16 or height_px % 2:
        raise FieldError("expected an even number from 16 up", {"height_px": height_px})
    if isinstance(time, str):
        name, when = time, TIMES[check_time(time)]
    else:
        name, when = f"sun {time.sun_elevation_deg:g}°", time
    directions = find_directions(height_px)
    above = directions[: height_px // 2].reshape(-1, 3)
    direct = sunlight(when.sun_elevation_deg, when.turbidity)
    grey = np.clip((when.cloud_cover - 0.85) / 0.15, 0, 1)
    rng = np.random.default_rng([seed, 0x5C1])
    upper = np.zeros_like(above)
    if grey < 1:
        upper = _light_sky(above, when, direct, np.pi / height_px, rng) * (1 - grey)
    if grey > 0:
        upper = upper + _overcast(above, when, np.pi / height_px, rng) * grey
    panorama = np.zeros_like(directions)
    panorama[: height_px // 2] = upper.reshape(height_px // 2, -1, 3)
    sun = _make_sun(when.sun_azimuth_deg, when.sun_elevation_deg, direct * (1 - grey))
    if when.sun_elevation_deg >= 0:  # twilight's blue is left as it is
        panorama, sun = _balance(panorama, sun)
    _lay_ground(panorama, directions, illuminate(panorama, sun))
    dim = min(1.0, float(illuminate(panorama, sun) @ LUMINANCE) / DIM_KLX) ** DIM_POWER
    return Sky(f"{name}/{seed}", panorama, sun, meter_exposure(panorama, sun) * dim, when.lamps_on)


def _make_sun(azimuth_deg: float, elevation_deg: float, irradiance: np.ndarray) -> KeyLight:
    red, green, blue = irradiance.tolist()
    return KeyLight(azimuth_deg, elevation_deg, SUN_RADIUS_DEG, (red, green, blue))


def _balance(panorama: np.ndarray, sun: KeyLight) -> tuple[np.ndarray, KeyLight]:
    """Both as a camera's white balance leaves them: without half of the light's colour on open ground."""
    irradiance = illuminate(panorama, sun)
    # a gain for each channel, then one for all, so that open ground stays as bright as it was
    # the power leaves the rest of the colour
    gain = (irradiance / (irradiance @ LUMINANCE)) ** -BALANCE
    gain *= (irradiance @ LUMINANCE) / (irradiance * gain @ LUMINANCE)
    return panorama * gain.astype(np.float32), _make_sun(sun.azimuth_deg, sun.elevation_deg, sun.irradiance * gain)


def _light_source(when: TimeOfDay) -> np.ndarray:
    """(3,) where the sky's light comes from: the sun, or just above where it has set."""
    return orbit_direction(when.sun_azimuth_deg, max(when.sun_elevation_deg, LOWEST_SUN_DEG))


GLOW, NIGHT_BLUE, AFTERGLOW = np.array([1.4, 0.85, 0.6]), np.array([0.6, 0.75, 1.2]), np.array([3.2, 1.3, 0.7])
"""Assumed colours of twilight over those of the sky with the sun at 2°: dust's scatter low in the west, ozone's blue
above, and on clouds that still see the sun."""
PALE = 0.5
"""Assumed: share of its colour that the sky at the horizon loses by then; the model's is a pure yellow."""


def _clear(directions: np.ndarray, when: TimeOfDay) -> np.ndarray:
    """(n, 3) clear sky of the measured brightness; at twilight bluer above, and a glow where the sun went."""
    light = _light_source(when)
    sky = clear_sky(directions, light, when.turbidity)
    set_by = np.clip((LOWEST_SUN_DEG - when.sun_elevation_deg) / 6, 0, 1)
    if set_by > 0:
        elevation = np.degrees(np.arcsin(np.clip(directions[:, 2], 0, 1)))
        facing = (1 + directions[:, :2] @ light[:2] / np.linalg.norm(light[:2])) / 2
        glow = (np.exp(-elevation / 9) * facing**2)[:, None]
        tint = GLOW * glow + NIGHT_BLUE * (1 - glow)
        pale = PALE * set_by * np.exp(-elevation / 15)[:, None]
        # towards grey of the same luminance first, then towards twilight's tint
        sky = (sky + pale * (sky @ LUMINANCE[:, None] - sky)) * (1 + set_by * (tint - 1))
    # Lambert's cosine law, times the area of a row's pixels
    weight = directions[:, 2] * np.sqrt(1 - directions[:, 2] ** 2)  # rows of a panorama shrink towards the zenith
    # the illuminance that this sky brings: shape is the model's, brightness that of the measured fits
    found = np.pi * (sky @ LUMINANCE * weight).sum() / weight.sum()
    return sky * (diffuse_klx(when.sun_elevation_deg) / found)


def _light_sky(
    directions: np.ndarray, when: TimeOfDay, direct: np.ndarray, pixel_rad: float, rng: np.random.Generator
) -> np.ndarray:
    """(n, 3) clear sky with clouds before it."""
    clear = _clear(directions, when)
    light = _light_source(when)
    if when.cloud_cover <= 0:
        return clear
    weight = directions[:, 2] * np.sqrt(1 - directions[:, 2] ** 2)
    around = (clear * weight[:, None]).sum(axis=0) / weight.sum()
    on_cloud = np.tile(direct, (len(directions), 1))
    if not direct.any():
        facing = (1 + directions[:, :2] @ light[:2] / np.linalg.norm(light[:2])) / 2
        # the sun has set: clouds are lit by the sky, and from below by the afterglow, most on its side and low down
        on_cloud += np.pi * around * (0.35 + AFTERGLOW * (facing**3 * (1 - directions[:, 2]))[:, None])
    gamma = np.degrees(np.arccos(np.clip(directions @ light, -1, 1)))[:, None]
    # droplets scatter forward: clouds near the sun have bright rims
    silver = 1 + 1.2 * np.exp(-gamma / 14)
    veils = lay_veils(directions, when.cloud_cover, pixel_rad, rng)[:, None]
    sky = clear + veils * (on_cloud * 0.16 * silver + around - clear)
    layer = march_clouds(directions, light, min(when.cloud_cover, 0.9), pixel_rad, rng)
    lit = on_cloud * (0.27 * silver * layer.sunlit[:, None]) + around * (0.95 * layer.skylit[:, None])
    # the air in front of a far cloud sends its own light, which is the clear sky's
    near = np.exp(-layer.distance_m / HAZE_M)[:, None]
    hidden = (1 - layer.passed)[:, None]
    return sky * (1 - hidden) + lit * near + clear * hidden * (1 - near)


def _overcast(directions: np.ndarray, when: TimeOfDay, pixel_rad: float, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) the CIE's overcast sky, a little uneven."""
    distance = reach_height(directions[:, 2], BASE_M)
    # texels of the pattern under one pixel, so that far clouds do not alias
    lod = np.log2(distance * pixel_rad * TILE_PX / TILE_M)
    u, v = (directions[:, :2] * (0.5 * distance / TILE_M)[:, None]).T
    uneven = sample_noise(paint_levels(rng, TILE_PX, 1.9, 4), u, v, lod - 1) - 0.5
    fade = np.exp(-distance / 15_000)
    # the CIE sky (1 + 2 sin h) / 3 of zenith luminance L brings 7 pi / 9 L of illuminance
    zenith = 9 / (7 * np.pi) * overcast_klx(when.sun_elevation_deg)
    grey = zenith * overcast_shape(directions[:, 2]) * (1 + 0.35 * uneven * fade)
    return grey[:, None] * np.array([0.98, 1.0, 1.03])


def _lay_ground(panorama: np.ndarray, directions: np.ndarray, irradiance: np.ndarray) -> None:
    """Fill the lower half: ground in the light that falls on it, hazy towards the horizon."""
    half = panorama.shape[0] // 2
    horizon = panorama[half - 1].mean(axis=0)
    far = 2.0 / np.maximum(-directions[half:, :, 2:], 1e-3)  # metres, for eyes 2 m up
    haze = 1 - np.exp(-far / 900)
    panorama[half:] = GROUND_ALBEDO * irradiance / np.pi * (1 - haze) + horizon * haze


LINEAR_SUFFIXES, ENCODED_SUFFIXES = (".hdr", ".exr"), (".png", ".jpg", ".jpeg")
MAX_HEIGHT_PX = 2048
"""A larger panorama is shrunk to it: 11 pixels a degree."""
SUN_REACH_DEG, AROUND_DEG = 4.0, 8.0
"""The sun and its bloom are looked for this far from the brightest place, and compared with the ring beyond."""
SUN_CONTRAST, LEAST_SUN = 10.0, 0.1
"""What is over ten rings' brightness is the sun, if it brings at least a tenth of the light."""


def load_sky(path: Path, azimuth_deg: float = 0.0) -> Sky:
    """The sky of a panorama file, equirectangular, 2:1, the zenith on top.

    The values of .hdr and .exr are linear light; .png and .jpg are sRGB-encoded and hold no sun brighter than white, so
    that what they light has no sharp shadow. A sun is taken out of the panorama and becomes `Sky.sun`.

    Args:
        path: of the file.
        azimuth_deg: of the world where the picture's middle comes to lie.

    Raises:
        ToolkitError: the file is no such picture: another shape, not a number in it, black, far too large, or damaged.
    """
    path = Path(path)
    panorama = _read_linear(path)
    height, width = panorama.shape[:2]
    if width != 2 * height or height < 16:
        raise ToolkitError(
            f"{path}: {width} × {height} pixels: expected an equirectangular panorama, twice as wide as high"
        )
    if not np.isfinite(panorama).all():
        raise ToolkitError(f"{path}: holds NaN or infinite values: save the panorama again without them")
    if panorama.min() < 0:
        panorama = np.maximum(panorama, 0)  # sharpening leaves a few below black
    if panorama[: height // 2].max() <= 0:
        raise ToolkitError(f"{path}: its upper half is black: expected a sky; is the zenith on top?")
    if height > MAX_HEIGHT_PX:
        panorama = cv2.resize(panorama, (2 * MAX_HEIGHT_PX, MAX_HEIGHT_PX), interpolation=cv2.INTER_AREA)
    # azimuth grows to the left: a turn is a shift of columns
    turned = np.roll(panorama, round(-azimuth_deg / 360 * panorama.shape[1]), axis=1)
    sky, sun = split_sun(np.ascontiguousarray(turned, np.float32))
    return Sky(path.stem, sky, sun, meter_exposure(sky, sun))


def _read_linear(path: Path) -> np.ndarray:
    suffix = path.suffix.lower()
    if suffix not in (*LINEAR_SUFFIXES, *ENCODED_SUFFIXES):
        known = ", ".join((*LINEAR_SUFFIXES, *ENCODED_SUFFIXES))
        raise ToolkitError(f"{path}: expected a panorama as {known}")
    if suffix in ENCODED_SUFFIXES:
        return LINEAR_OF_CODE[read_image(path)]
    return read_linear(path)


def split_sun(panorama: np.ndarray) -> tuple[np.ndarray, KeyLight]:
    """Part a panorama (h, w, 3) of linear light into sky and sun; together they light as before.

    The sun is what stands out around the brightest place of the upper half, much brighter than the ring around it. The
    sky gets the ring's mean there. Where nothing does, the sun's irradiance is 0.
    """
    height = panorama.shape[0]
    directions = find_directions(height)
    # the brightest place of the upper half is a candidate; a lamp or a window below the horizon is none
    luminance = panorama @ LUMINANCE.astype(np.float32)
    row, column = np.unravel_index(int(luminance[: height // 2].argmax()), (height // 2, panorama.shape[1]))
    gap = np.degrees(np.arccos(np.clip(directions @ directions[row, column], -1, 1)))
    ring = panorama[(gap > SUN_REACH_DEG) & (gap < AROUND_DEG)].mean(axis=0)
    # only what stands out against the sky around it, or bright haze would be taken along
    disc = (gap <= SUN_REACH_DEG) & (luminance > SUN_CONTRAST * (ring @ LUMINANCE))
    # of a pixel: its height times its width, which shrinks with the cosine of the elevation
    solid_angle = np.sqrt(1 - directions[..., 2] ** 2) * (np.pi / height) ** 2
    excess = (panorama[disc] - ring) * solid_angle[disc][:, None]
    irradiance = np.maximum(excess.sum(axis=0), 0)
    weight = solid_angle * np.maximum(directions[..., 2], 0)
    everything = (luminance * weight).sum()
    # a veiled sun casts no sharp shadow: the panorama keeps it
    if not disc.any() or (irradiance @ LUMINANCE) * directions[row, column, 2] < LEAST_SUN * everything:
        return panorama, KeyLight(elevation_deg=90.0, irradiance=(0.0, 0.0, 0.0))
    # the centre of its light, finer than a pixel
    middle = (directions[disc] * (excess @ LUMINANCE)[:, None]).sum(axis=0)
    middle /= np.linalg.norm(middle)
    sky = panorama.copy()
    sky[disc] = ring
    red, green, blue = irradiance.tolist()
    azimuth, elevation = np.degrees([np.arctan2(middle[1], middle[0]), np.arcsin(middle[2])])
    return sky, KeyLight(float(azimuth), float(elevation), SUN_RADIUS_DEG, (red, green, blue))
