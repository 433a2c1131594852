"""The end of a picture: lens falloff, shoulder, grain and sRGB codes, row by row; grain is NumPy's, bit for bit."""

import math
from typing import NamedTuple

import numpy as np
from numba.np.random._constants import fi_float, ki_float, wi_float

from toolkit.rig.kernel.compiled import exact, kernel

# PCG64's 128-bit LCG multiplier, in two halves, as in NumPy's pcg64.h
MULTIPLIER_HIGH, MULTIPLIER_LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
DIGIT, LOW_DIGIT = np.uint64(32), np.uint64(0xFFFFFFFF)
LAST = 3.6541528853610088
"""Start of the normal distribution's tail."""


@exact
def advance(
    high: np.uint64, low: np.uint64, step_high: np.uint64, step_low: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64]:
    """Return the next state of PCG64, in two halves, and its 64 bits (O'Neill 2014, XSL RR 128/64)."""
    # numba has no 128-bit integers: the upper half of low times the multiplier's low half, by 32-bit digits
    a, b, c, d = low >> DIGIT, low & LOW_DIGIT, MULTIPLIER_LOW >> DIGIT, MULTIPLIER_LOW & LOW_DIGIT
    middle = (b * d >> DIGIT) + (a * d & LOW_DIGIT) + (b * c & LOW_DIGIT)
    carried = a * c + (a * d >> DIGIT) + (b * c >> DIGIT) + (middle >> DIGIT)
    product = low * MULTIPLIER_LOW
    lower = product + step_low
    upper = carried + high * MULTIPLIER_LOW + low * MULTIPLIER_HIGH + step_high + np.uint64(lower < product)
    # XSL RR: the halves of the state are xored, then rotated by its top six bits
    mixed, turn = upper ^ lower, upper >> np.uint64(58)
    return upper, lower, (mixed >> turn) | (mixed << (-turn & np.uint64(63)))


class Stream(NamedTuple):
    """Random bits, 32 at a time: PCG64's state and increment, and the half of its last 64 that is not yet used."""

    high: np.uint64
    low: np.uint64
    step_high: np.uint64
    step_low: np.uint64
    spare: np.uint64
    has_spare: bool


@exact
def _next_bits(stream: Stream) -> tuple[Stream, np.uint64]:
    if stream.has_spare:
        return Stream(stream.high, stream.low, stream.step_high, stream.step_low, stream.spare, False), stream.spare
    high, low, word = advance(stream.high, stream.low, stream.step_high, stream.step_low)
    # NumPy hands out the lower half first and keeps the upper for the next call
    left = word >> DIGIT
    return Stream(high, low, stream.step_high, stream.step_low, left, True), word & LOW_DIGIT


@exact
def _next_share(stream: Stream) -> tuple[Stream, np.float32]:
    """Uniform in [0, 1)."""
    stream, bits = _next_bits(stream)
    # the upper 24 bits, as many as a float32's fraction holds
    return stream, np.float32(np.int64(bits >> np.uint64(8))) * np.float32(1 / 16777216)


@exact
def _draw_tail(stream: Stream) -> tuple[Stream, np.float32]:
    """Beyond `LAST` (Marsaglia 1964)."""
    while True:
        stream, a = _next_share(stream)
        stream, b = _next_share(stream)
        # an exponential proposal, accepted where 2y > x^2: what is left is the normal's tail
        x, y = np.float32(-1 / LAST) * np.float32(math.log1p(-a)), -np.float32(math.log1p(-b))
        if y + y > x * x:
            return stream, np.float32(LAST) + x


@exact
def draw_normals(state: np.ndarray, out: np.ndarray) -> None:
    """Fill (n,) float32 with standard normal numbers: the ziggurat of Marsaglia and Tsang (2000), as NumPy draws them.

    With NumPy's own draw of the whole grain a frame takes 7 % longer at 224², and 14 % at 640 × 480.

    Args:
        state: (6,) uint64 the fields of a `Stream`; the draw starts there and leaves the next start.
    """
    stream = Stream(state[0], state[1], state[2], state[3], state[4], state[5] > 0)
    for i in range(len(out)):
        while True:
            stream, bits = _next_bits(stream)
            # a draw has 8 bits for the layer, 1 for the sign, 23 for the place within the layer
            layer, size = np.int64(bits & np.uint64(255)), np.int64(bits >> np.uint64(9))
            sign = np.float32(1 - 2 * np.int64((bits >> np.uint64(8)) & np.uint64(1)))
            x = np.float32(size) * wi_float[layer] * sign
            # 99 % of draws end here: the point lies in the rectangle below the curve
            if size < ki_float[layer]:
                break
            # the lowest layer reaches to infinity
            if layer == 0:
                stream, x = _draw_tail(stream)
                x = -x if (size >> 8) & 1 else x
                break
            stream, share = _next_share(stream)
            # in the sliver between rectangle and curve: accept below the density
            below = (fi_float[layer - 1] - fi_float[layer]) * share + fi_float[layer]
            if below < math.exp(-0.5 * float(x) * float(x)):
                break
        out[i] = x
    state[0], state[1], state[4], state[5] = stream.high, stream.low, stream.spare, np.uint64(stream.has_spare)


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
        lower: (b + 1,) uint8 code at the lower end of each of b bands of [0, 1]; no two codes begin in the same band.
        starts: (256,) float32 light at which the code after each begins.
        work: (2, 3 w) float64 to work with.
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
        for i in range(count):  # several short loops: each is done in vector instructions
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
            # a table instead of sRGB's power: the band's lowest code, plus 1 if the next has begun
            code = lower[int(values[i] * bands)]
            coded[row, i] = code + (values[i] >= starts[code])
