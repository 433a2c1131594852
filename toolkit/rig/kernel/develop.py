"""The end of a picture: lens falloff, shoulder, grain and sRGB codes, row by row."""

import math

import numpy as np

from toolkit.rig.kernel.compiled import kernel
from toolkit.rig.kernel.grain import draw_normals


@kernel
def develop(
    light: np.ndarray, grain: np.ndarray, state: np.ndarray, noise: float, falloff: float, shoulder: float,
    lower: np.ndarray, starts: np.ndarray, work: np.ndarray, coded: np.ndarray,
) -> None:  # fmt: skip
    """Fill `coded` (h, 3 w) uint8 with the sRGB codes of linear light (h, 3 w) float32.

    Args:
        light: 1 is white.
        grain: (h, 3 w) float32 standard normal; or (1, 3 w), in which each row's is drawn from `state`.
        state: of `draw_normals`; (0,) where all grain is given.
        noise: standard deviation at light 0.18.
        falloff: share of the light that the corners lose.
        shoulder: light above which highlights are compressed.
        lower: (b + 1,) uint8 code at the lower end of each of b bands of [0, 1]; no two codes begin in one of them.
        starts: (256,) float32 light at which the code after each begins.
        work: (2, 3 w) float64 to work with.
        coded: the picture.
    """
    height, count = light.shape
    width, bands, values, squares = count // 3, len(lower) - 1, work[0], work[1]
    room, spread = 1 - shoulder, noise / math.sqrt(0.18)
    for i in range(count):
        # from -1 to 1 across the picture; three numbers for each pixel
        x = 2 * (i // 3) / (width - 1) - 1 if width > 1 else -1.0
        squares[i] = x * x
    for row in range(height):
        if len(state):
            # a row at a time: a frame's grain is never held whole
            draw_normals(state, grain[0])
        y = 2 * row / (height - 1) - 1 if height > 1 else -1.0
        here, bright = grain[row % len(grain)], False
        for i in range(count):  # one short loop after another: each is done in vector instructions
            values[i] = light[row, i] * (1 - falloff * (squares[i] + y * y) / 2)
            bright |= values[i] > shoulder
        if bright:
            for i in range(count):
                if values[i] > shoulder:
                    # an exponential shoulder: it meets the straight line with the same slope, and 1 at infinity
                    values[i] = shoulder + room * (1 - math.exp((shoulder - values[i]) / room))
        for i in range(count):
            value = values[i]
            # photon noise grows with the root of the light; below 0.01 the sensor's own noise remains
            value += here[i] * spread * math.sqrt(max(value, 0.01))
            values[i] = min(value, 1.0) if value > 0 else 0.0  # NaN is black
        for i in range(count):
            # a table instead of sRGB's power: the band's lowest code, plus one where the next has begun
            code = lower[int(values[i] * bands)]
            coded[row, i] = code + (values[i] >= starts[code])
