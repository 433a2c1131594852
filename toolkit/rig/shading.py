"""How surfaces answer light, and how a camera develops it: gloss, tone curve, lens falloff, sensor noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from toolkit.imaging.colour import linear_to_srgb
from toolkit.rig.camera import orbit_direction
from toolkit.rig.studio import KeyLight

ROUGHNESS_LEVELS = (0.12, 0.3, 0.55, 0.9)
"""Roughnesses for which the room is blurred beforehand."""


def interpolate(corner_values: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(n, c) values at barycentric weights (n, 2) of corners 1 and 2, from corner values (n, 3, c)."""
    u, v = uv[:, :1], uv[:, 1:]
    return corner_values[:, 0] * (1 - u - v) + corner_values[:, 1] * u + corner_values[:, 2] * v


@dataclass(frozen=True)
class SurfacePoints:
    """Where rays meet a surface, a row for each; float32.

    Attributes:
        points: (n, 3) in the world, mm.
        direction: (n, 3) of the ray, unit length.
        normal: (n, 3) unit, on the ray's side.
        cosine: (n,) between the normal and the way back.
        albedo: (n, 3) linear base colour.
        roughness, metallic: (n,).
    """

    points: np.ndarray
    direction: np.ndarray
    normal: np.ndarray
    cosine: np.ndarray
    albedo: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray


Reflect = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(points, directions, roughness) -> (n, 3) radiance that arrives from there, blurred."""


def gloss(
    surface: SurfacePoints, key_share: np.ndarray, room_share: np.ndarray, key: KeyLight, reflect: Reflect
) -> np.ndarray:
    """(n, 3) specular radiance towards the camera, where (n,) shares of key light and room are seen.

    Key light: GGX with Smith's masking, widened by the light's disc. Room and table: the blurred reflection times
    Karis' fit of the split-sum integral (Physically Based Shading on Mobile, 2014).
    """
    f0 = np.float32(0.04) * (1 - surface.metallic)[:, None] + surface.albedo * surface.metallic[:, None]
    scale, bias = _environment_brdf(surface.roughness, surface.cosine)
    mirrored = surface.direction + 2 * surface.cosine[:, None] * surface.normal
    reflected = reflect(surface.points, mirrored, surface.roughness)
    visible = np.clip(1.4 * room_share - 0.1, 0, 1)[:, None]
    shine = (f0 * scale[:, None] + bias[:, None]) * reflected * visible
    return shine + _key_highlight(surface, f0, key_share, key)


def _key_highlight(surface: SurfacePoints, f0: np.ndarray, key_share: np.ndarray, key: KeyLight) -> np.ndarray:
    direction, normal, cosine = surface.direction, surface.normal, surface.cosine
    light = orbit_direction(key.azimuth_deg, key.elevation_deg).astype(np.float32)
    to_light = np.maximum(normal @ light, 0)
    half = light - direction
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-6)
    n_h = np.einsum("ij,ij->i", normal, half)
    v_h = np.maximum(-np.einsum("ij,ij->i", direction, half), 0)
    alpha = np.clip(surface.roughness**2 + np.tan(np.radians(key.radius_deg)) / 2, 0.02, 1).astype(np.float32)
    alpha2 = alpha**2
    distribution = alpha2 / (np.pi * (n_h**2 * (alpha2 - 1) + 1) ** 2)
    k = alpha / 2
    masking = 1 / ((cosine * (1 - k) + k) * (to_light * (1 - k) + k))
    fresnel = f0 + (1 - f0) * ((1 - v_h) ** 5)[:, None]
    strength = (distribution * masking / 4 * to_light * key_share)[:, None]
    return fresnel * strength * np.array(key.irradiance, np.float32)


def _environment_brdf(roughness: np.ndarray, cosine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a = roughness * -1.0 + 1.0
    b = roughness * -0.0275 + 0.0425
    c = roughness * -0.572 + 1.04
    d = roughness * 0.022 - 0.04
    a004 = np.minimum(a * a, np.exp2(-9.28 * cosine)) * a + b
    return -1.04 * a004 + c, 1.04 * a004 + d


SHOULDER = 0.72
"""Linear value above which highlights are compressed."""


def tone_map(picture: np.ndarray, seed: tuple[int, ...], noise: float = 0.006, falloff: float = 0.12) -> np.ndarray:
    """(h, w, 3) uint8 sRGB of linear light in exposure units.

    Args:
        picture: (h, w, 3) float32 linear, 1 is white.
        seed: of the noise; pairs of images share it, as it has no part in what they compare.
        noise: standard deviation at middle grey, growing with the root of the light as photons' does.
        falloff: share of the light that the corners lose.
    """
    h, w = picture.shape[:2]
    y, x = np.ogrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j]
    picture = picture * (1 - falloff * (x * x + y * y) / 2).astype(np.float32)[..., None]
    over = np.maximum(picture - SHOULDER, 0)
    picture = np.minimum(picture, SHOULDER) + (1 - SHOULDER) * (1 - np.exp(-over / (1 - SHOULDER)))
    grain = np.random.default_rng(seed).standard_normal(picture.shape, dtype=np.float32)
    picture += grain * (noise * np.sqrt(np.maximum(picture, 0.01) / 0.18) * 0.18 / 0.4)
    return np.round(linear_to_srgb(picture) * 255).astype(np.uint8)
