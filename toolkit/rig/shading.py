"""How a camera develops light: tone curve, lens falloff, sensor noise."""

import numpy as np

from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear
from toolkit.rig.kernel.develop import develop

SHOULDER = 0.72
"""Linear value above which highlights are compressed."""
NOISE, FALLOFF = 0.006, 0.12
"""Of the camera, see `tone_map`."""


def tone_map(picture: np.ndarray, seed: tuple[int, ...], noise: float = NOISE, falloff: float = FALLOFF) -> np.ndarray:
    """(h, w, 3) uint8 sRGB of linear light in exposure units.

    Args:
        picture: (h, w, 3) float32 linear, 1 is white.
        seed: of the noise; pairs of images share it, as it has no part in what they compare.
        noise: standard deviation at middle grey, growing with the root of the light as photons' does.
        falloff: share of the light that the corners lose.
    """
    row = np.empty((1, picture.shape[1], 3), np.float32)
    return _develop(picture, row, stream_state(seed), noise, falloff)


def stream_state(seed: tuple[int, ...]) -> np.ndarray:
    """(6,) uint64 where `numpy.random.default_rng(seed)` begins, as kernels draw from it."""
    state = np.random.default_rng(seed).bit_generator.state["state"]
    # PCG64 holds two numbers of 128 bits; kernels know no type so wide
    halves = [part >> shift & 2**64 - 1 for part in (state["state"], state["inc"]) for shift in (64, 0)]
    return np.array([*halves, 0, 0], np.uint64)


def draw_grain(shape: tuple[int, ...], seed: tuple[int, ...]) -> np.ndarray:
    """(h, w, 3) float32 standard normal; pictures that share their grain need it drawn once."""
    return np.random.default_rng(seed).standard_normal(shape, dtype=np.float32)


def develop_light(picture: np.ndarray, grain: np.ndarray, noise: float = NOISE, falloff: float = FALLOFF) -> np.ndarray:
    """`tone_map` with a grain that was drawn before."""
    return _develop(picture, grain, np.zeros(0, np.uint64), noise, falloff)


def _develop(picture: np.ndarray, grain: np.ndarray, state: np.ndarray, noise: float, falloff: float) -> np.ndarray:
    coded, width = np.empty(picture.shape, np.uint8), 3 * picture.shape[1]
    light, given, codes = (
        array.reshape(len(array), width) for array in (np.ascontiguousarray(picture, np.float32), grain, coded)
    )
    work = np.empty((2, width))
    lower, starts = _CODES
    develop(
        light, given, state, noise=noise * 0.18 / 0.4, falloff=falloff, shoulder=SHOULDER,
        lower=lower, starts=starts, work=work, coded=codes,
    )  # fmt: skip
    return coded


def _make_codes(steps: int = 4096) -> tuple[np.ndarray, np.ndarray]:
    """The sRGB code of the lower end of each of `steps` bands of [0, 1], and the light at which the next one starts."""
    # rounding to the nearest code: the next begins halfway, in codes
    starts = srgb_to_linear((np.arange(1, 257) - 0.5) / 255).astype(np.float32)
    # nothing comes after 255
    starts[-1] = np.inf
    lower = np.round(linear_to_srgb(np.arange(steps + 1) / steps) * 255).astype(np.uint8)
    return lower, starts


_CODES = _make_codes()
