"""From light to photograph: a camera's tone curve, lens falloff and sensor noise."""

import numpy as np

from toolkit.colour import linear_to_srgb

SHOULDER = 0.72
"""Linear value above which highlights are compressed."""


def develop(picture: np.ndarray, seed: tuple[int, ...], noise: float = 0.006, falloff: float = 0.12) -> np.ndarray:
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
