"""A sky for a world: a panorama, the sun as a separate light, and the exposure of a camera below them.

Luminances are in kcd/m², illuminances in klx, both as linear sRGB; the exposure brings them to picture values.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.imaging.read import read_image, read_linear
from toolkit.rig.camera import orbit_direction
from toolkit.rig.scene import KeyLight, illuminate
from toolkit.rig.textures import sample_directions
from toolkit.rooms.worlds.clouds import (
    BASE_M,
    HAZE_M,
    TILE_M,
    TILE_PX,
    lay_veils,
    march_clouds,
    paint_levels,
    reach_height,
    sample_noise,
)
from toolkit.rooms.worlds.conditions import TIMES, TimeOfDay, check_time
from toolkit.rooms.worlds.daylight import (
    LOWEST_SUN_DEG,
    LUMINANCE,
    clear_sky,
    diffuse_klx,
    overcast_klx,
    overcast_shape,
    sunlight,
)

SUN_RADIUS_DEG = 0.27
GROUND_ALBEDO = np.array([0.19, 0.18, 0.16])
"""Albedo of the panorama's lower half, linear RGB: asphalt, concrete, earth and leaves at a distance."""


LAMPS = 0.06
"""Luminance of the brightest lit windows, kcd/m² (assumed); lamps, which are far brighter, are white anyway."""


@dataclass(frozen=True)
class Sky:
    """All light that comes from far away."""

    name: str  # for records
    # (h, w, 3) float32 linear radiance, kcd/m², as `Studio.environment`: row 0 is straight up, the middle column
    # azimuth 0, azimuth grows to the left. The sun's glow is in it, its disc is not.
    panorama: np.ndarray
    sun: KeyLight  # the sun; its irradiance in klx is (0, 0, 0) where it is hidden or has set
    exposure: float  # factor from radiance to the picture's linear values
    lamps_on: bool = False  # whether street lamps are lit

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
    # a diffuse card sends back albedo · irradiance / π
    metered = (METERED_ALBEDO * irradiance / np.pi + SKY_SHARE * float(low_sky)) / 2
    return METERED_VALUE / metered


@lru_cache(maxsize=4)
def make_sky(time: str | TimeOfDay = "noon", seed: int = 0, height_px: int = 512) -> Sky:
    """A sky of a time of day; equal arguments give equal bytes.

    Args:
        time: from `TIMES`, or your own.
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
    # clouds and sky are needed above the horizon only
    above = directions[: height_px // 2].reshape(-1, 3)
    direct = sunlight(when.sun_elevation_deg, when.turbidity)
    # cloud cover above 0.85 blends the sky into an overcast
    grey = np.clip((when.cloud_cover - 0.85) / 0.15, 0, 1)
    rng = np.random.default_rng([seed, 0x5C1])
    upper = np.zeros_like(above)
    if grey < 1:
        upper = _light_sky(above, when, direct, np.pi / height_px, rng) * (1 - grey)
    if grey > 0:
        upper = upper + _overcast(above, when, np.pi / height_px, rng) * grey
    # upper half, sun, and the ground that both light
    panorama = np.zeros_like(directions)
    panorama[: height_px // 2] = upper.reshape(height_px // 2, -1, 3)
    sun = _make_sun(when.sun_azimuth_deg, when.sun_elevation_deg, direct * (1 - grey))
    if when.sun_elevation_deg >= 0:  # twilight's blue is left as it is
        panorama, sun = _balance(panorama, sun)
    _lay_ground(panorama, directions, illuminate(panorama, sun))
    # dusk is exposed darker than a meter asks for
    dim = min(1.0, float(illuminate(panorama, sun) @ LUMINANCE) / DIM_KLX) ** DIM_POWER
    return Sky(f"{name}/{seed}", panorama, sun, meter_exposure(panorama, sun) * dim, when.lamps_on)


def _make_sun(azimuth_deg: float, elevation_deg: float, irradiance: np.ndarray) -> KeyLight:
    red, green, blue = irradiance.tolist()
    return KeyLight(azimuth_deg, elevation_deg, SUN_RADIUS_DEG, (red, green, blue))


def _balance(panorama: np.ndarray, sun: KeyLight) -> tuple[np.ndarray, KeyLight]:
    """Both as a camera's white balance leaves them: without half of the light's colour on open ground."""
    irradiance = illuminate(panorama, sun)
    # a gain for each channel, then a gain for all, so that open ground stays as bright as it was
    # the power leaves the rest of the colour
    gain = (irradiance / (irradiance @ LUMINANCE)) ** -BALANCE
    gain *= (irradiance @ LUMINANCE) / (irradiance * gain @ LUMINANCE)
    return panorama * gain.astype(np.float32), _make_sun(sun.azimuth_deg, sun.elevation_deg, sun.irradiance * gain)


def _light_source(when: TimeOfDay) -> np.ndarray:
    """(3,) where the sky's light comes from: the sun, or just above where it has set."""
    return orbit_direction(when.sun_azimuth_deg, max(when.sun_elevation_deg, LOWEST_SUN_DEG))


GLOW, NIGHT_BLUE, AFTERGLOW = np.array([1.4, 0.85, 0.6]), np.array([0.6, 0.75, 1.2]), np.array([3.2, 1.3, 0.7])
"""Assumed colours of twilight over those of the sky with the sun at 2°: in the west, above, and on clouds that the sun
reaches."""
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
"""Over ten times the ring's brightness is the sun, if it brings at least a tenth of the light."""


def load_sky(path: Path, azimuth_deg: float = 0.0) -> Sky:
    """The sky of a panorama file, equirectangular, 2:1, the zenith on top.

    The values of .hdr and .exr are linear light. .png and .jpg are sRGB-encoded: no sun in them is brighter than white,
    and no shadow is sharp. A sun is taken out of the panorama and becomes `Sky.sun`.

    Args:
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
    # damaged files first: a NaN would spread through the exposure to every image
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
    sky gets the ring's mean there. If nothing does, the sun's irradiance is 0.
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
