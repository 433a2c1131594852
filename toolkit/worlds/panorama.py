"""A user's panorama as the sky of a world: read, checked, its sun made a light of its own."""

from pathlib import Path

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.imaging.read import read_image, read_linear
from toolkit.rig.scene import KeyLight
from toolkit.worlds.daylight import LUMINANCE
from toolkit.worlds.sky import SUN_RADIUS_DEG, Sky, find_directions, meter_exposure

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
        raise ToolkitError(f"{path}: holds values that are no numbers or infinite: write the panorama anew, clipped")
    if panorama.min() < 0:
        panorama = np.maximum(panorama, 0)  # sharpening leaves a few below black
    if panorama[: height // 2].max() <= 0:
        raise ToolkitError(f"{path}: its upper half is black: expected a sky; is the zenith on top?")
    if height > MAX_HEIGHT_PX:
        panorama = cv2.resize(panorama, (2 * MAX_HEIGHT_PX, MAX_HEIGHT_PX), interpolation=cv2.INTER_AREA)
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
    luminance = panorama @ LUMINANCE.astype(np.float32)
    row, column = np.unravel_index(int(luminance[: height // 2].argmax()), (height // 2, panorama.shape[1]))
    gap = np.degrees(np.arccos(np.clip(directions @ directions[row, column], -1, 1)))
    ring = panorama[(gap > SUN_REACH_DEG) & (gap < AROUND_DEG)].mean(axis=0)
    disc = (gap <= SUN_REACH_DEG) & (luminance > SUN_CONTRAST * (ring @ LUMINANCE))
    solid_angle = np.sqrt(1 - directions[..., 2] ** 2) * (np.pi / height) ** 2
    excess = (panorama[disc] - ring) * solid_angle[disc][:, None]
    irradiance = np.maximum(excess.sum(axis=0), 0)
    weight = solid_angle * np.maximum(directions[..., 2], 0)
    everything = (luminance * weight).sum()
    if not disc.any() or (irradiance @ LUMINANCE) * directions[row, column, 2] < LEAST_SUN * everything:
        return panorama, KeyLight(elevation_deg=90.0, irradiance=(0.0, 0.0, 0.0))
    middle = (directions[disc] * (excess @ LUMINANCE)[:, None]).sum(axis=0)
    middle /= np.linalg.norm(middle)
    sky = panorama.copy()
    sky[disc] = ring
    red, green, blue = irradiance.tolist()
    azimuth, elevation = np.degrees([np.arctan2(middle[1], middle[0]), np.arcsin(middle[2])])
    return sky, KeyLight(float(azimuth), float(elevation), SUN_RADIUS_DEG, (red, green, blue))
