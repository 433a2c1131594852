"""The end of a picture: lens falloff, shoulder, grain and sRGB codes in one pass."""

import math

import numpy as np

from toolkit.rig.kernel.compiled import kernel


@kernel
def develop(
    light: np.ndarray, grain: np.ndarray, noise: float, falloff: float, shoulder: float, lower: np.ndarray,
    starts: np.ndarray, coded: np.ndarray,
) -> None:  # fmt: skip
    """Fill `coded` (h, w, 3) uint8 with the sRGB codes of linear light (h, w, 3) float32.

    Args:
        light: 1 is white.
        grain: (h, w, 3) float32 standard normal.
        noise: standard deviation at light 0.18.
        falloff: share of the light that the corners lose.
        shoulder: light above which highlights are compressed.
        lower: (b + 1,) uint8 code at the lower end of each of b bands of [0, 1]; no two codes begin in one of them.
        starts: (256,) float32 light at which the code after each begins.
        coded: the picture.
    """
    height, width, _ = light.shape
    bands = len(lower) - 1
    room, spread = 1 - shoulder, noise / math.sqrt(0.18)
    for row in range(height):
        y = 2 * row / (height - 1) - 1 if height > 1 else -1.0
        for column in range(width):
            x = 2 * column / (width - 1) - 1 if width > 1 else -1.0
            kept = 1 - falloff * (x * x + y * y) / 2
            for c in range(3):
                value = light[row, column, c] * kept
                if value > shoulder:
                    value = shoulder + room * (1 - math.exp((shoulder - value) / room))
                value += grain[row, column, c] * spread * math.sqrt(max(value, 0.01))
                value = min(value, 1.0) if value > 0 else 0.0  # NaN is black
                code = lower[int(value * bands)]
                coded[row, column, c] = code + (value >= starts[code])
