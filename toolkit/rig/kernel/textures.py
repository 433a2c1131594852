"""Look-ups in pyramids of texels, and in pictures of all directions."""

import math
from typing import NamedTuple

import numpy as np

from toolkit.rig.kernel.compiled import inlined, kernel
from toolkit.rig.kernel.lanes import weighted_sum

Colour = tuple[float, float, float]


class Texels(NamedTuple):
    """Pyramids of several textures in an array."""

    # (n + 1, 3) uint16 linear light, 65535 is 1; level by level, row by row; the last is none of theirs
    values: np.ndarray
    start: np.ndarray  # (l,) int64 where each level begins
    width: np.ndarray  # width, height: (l,) int32 of each level
    height: np.ndarray
    first: np.ndarray  # (t,) int32 level 0 of each texture
    levels: np.ndarray  # (t,) int32 how many each texture has


Corners = tuple[tuple[int, int, int, int], tuple[float, float, float, float]]
"""Starts of the four colours around a place in an array of numbers, and the weight of each."""


@inlined
def around_place(
    start: int, width: int, size: int, columns: tuple[int, int, float], rows: tuple[int, int, float]
) -> Corners:
    """Corners between two columns and two rows, (lower, upper, share of the upper) each.

    Args:
        start: of the picture in the array, numbers.
        size: of a pixel, numbers.
        columns, rows: between which the place lies.
    """
    left, right, fx = columns
    top, bottom, fy = rows
    upper, lower = start + top * width * size, start + bottom * width * size
    # bilinear: a corner counts the more, the nearer it is
    places = (upper + left * size, upper + right * size, lower + left * size, lower + right * size)
    return places, ((1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy)


@inlined
def _repeat(x: float, size: int) -> tuple[int, int, float]:
    low = math.floor(x)
    left = int(low)
    # the remainder is slow: most coordinates lie within the texture
    if left < 0 or left >= size:
        left %= size
    return left, left + 1 if left + 1 < size else 0, x - low


@inlined
def _clamp(x: float, size: int) -> tuple[int, int, float]:
    x = min(max(x, 0.0), size - 1.0)
    left = min(int(x), max(size - 2, 0))
    return left, min(left + 1, size - 1), x - left


@inlined
def _find_texels(texels: Texels, level: int, u: float, v: float, repeats: bool) -> Corners:
    """Those around u right, v up in [0, 1]; texel centres lie at half integers."""
    at = np.uint64(level)  # which says that it does not count from the end
    width, height = int(texels.width[at]), int(texels.height[at])
    # v runs up, rows run down
    x, y = u * width - 0.5, (1 - v) * height - 0.5
    start = 3 * texels.start[at]
    if repeats:
        return around_place(start, width, 3, _repeat(x, width), _repeat(y, height))
    return around_place(start, width, 3, _clamp(x, width), _clamp(y, height))


@inlined
def sample_texture(texels: Texels, texture: int, u: float, v: float, lod: float, repeats: bool) -> Colour:
    """Trilinear colour; `lod` is the base-2 logarithm of level-0 texels per pixel."""
    at = np.uint64(texture)
    # below 0 the texture is magnified: level 0 serves
    lod = min(max(lod, 0.0), texels.levels[at] - 1.0)
    below = int(lod)
    # between two levels of the pyramid; the finer alone where it is exact
    share, level, scale = lod - below, int(texels.first[at]) + below, 1 / 65535
    places, weights = _find_texels(texels, level, u, v, repeats)
    red, green, blue, _ = weighted_sum(texels.values, places, weights)
    if share > 0:
        places, weights = _find_texels(texels, level + 1, u, v, repeats)
        coarse = weighted_sum(texels.values, places, weights)
        red += (coarse[0] - red) * share
        green += (coarse[1] - green) * share
        blue += (coarse[2] - blue) * share
    return red * scale, green * scale, blue * scale


@inlined
def arctangent(y: float, x: float) -> float:
    """`atan2` to 1.2e-5 rad, without the library's branches; 0 at the origin."""
    ax, ay = abs(x), abs(y)
    if ax + ay == 0:
        return 0.0
    # folded into the first eighth of the circle, where the polynomial holds, and unfolded below
    a = min(ax, ay) / max(ax, ay)
    s = a * a
    # Abramowitz and Stegun 4.4.49
    r = a * (
        0.9998660
        + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351)))
    )  # fmt: skip
    if ay > ax:
        r = 0.5 * math.pi - r
    if x < 0:
        r = math.pi - r
    return -r if y < 0 else r


@inlined
def sample_direction(picture: np.ndarray, x: float, y: float, z: float) -> Colour:
    """Bilinear colour of a picture of all directions (h, w, 4) towards (x, y, z); see `Scene.environment`."""
    height, width = picture.shape[0], picture.shape[1]
    # equirectangular: the middle column looks along +x, azimuth grows to the left
    u = 0.5 - arctangent(y, x) * (0.5 / math.pi)
    # of any length, unlike the arcsine of z: rays need not be normalised first
    v = 0.5 + arctangent(z, math.sqrt(x * x + y * y)) / math.pi
    columns, rows = _repeat(u * width - 0.5, width), _clamp((1 - v) * height - 0.5, height)
    places, weights = around_place(0, width, 4, columns, rows)
    return weighted_sum(picture, places, weights)[:3]


@kernel
def fill_colours(texels: Texels, texture: np.ndarray, uv: np.ndarray, lod: np.ndarray, found: np.ndarray) -> None:
    """Fill `found` (n, 3) with `sample_texture` at texture (n,), uv (n, 2) and lod (n,); textures repeat."""
    for n in range(len(texture)):
        u, v = np.float64(uv[n, 0]), np.float64(uv[n, 1])  # as `shade` looks: another type would be compiled apart
        colour = sample_texture(texels, int(texture[n]), u, v, np.float64(lod[n]), True)
        found[n, 0], found[n, 1], found[n, 2] = colour
