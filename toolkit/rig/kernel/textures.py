"""Look-ups in pyramids of texels, and in pictures of all directions."""

import math
from typing import NamedTuple

import numpy as np

from toolkit.rig.kernel.compiled import inlined, kernel

Colour = tuple[float, float, float]


class Texels(NamedTuple):
    """Pyramids of several textures in one array.

    Attributes:
        values: (n, 3) uint16 linear light, 65535 is 1; level by level, row by row.
        start: (l,) int64 where each level begins.
        width, height: (l,) int32 of each level.
        first: (t,) int32 level 0 of each texture.
        levels: (t,) int32 how many each texture has.
    """

    values: np.ndarray
    start: np.ndarray
    width: np.ndarray
    height: np.ndarray
    first: np.ndarray
    levels: np.ndarray


@inlined
def _mix(texels: Texels, level: int, columns: tuple[int, int, float], rows: tuple[int, int, float]) -> Colour:
    """Bilinear colour between two columns and two rows, (lower, upper, share of the upper) each."""
    left, right, fx = columns
    top, bottom, fy = rows
    start, width = texels.start[level], int(texels.width[level])
    a, b = start + top * width + left, start + top * width + right
    c, d = start + bottom * width + left, start + bottom * width + right
    wa, wb, wc, wd = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    v, scale = texels.values, 1 / 65535
    return (
        (v[a, 0] * wa + v[b, 0] * wb + v[c, 0] * wc + v[d, 0] * wd) * scale,
        (v[a, 1] * wa + v[b, 1] * wb + v[c, 1] * wc + v[d, 1] * wd) * scale,
        (v[a, 2] * wa + v[b, 2] * wb + v[c, 2] * wc + v[d, 2] * wd) * scale,
    )


@inlined
def _repeat(x: float, size: int) -> tuple[int, int, float]:
    low = math.floor(x)
    left = int(low)
    if left < 0 or left >= size:
        left %= size
    return left, left + 1 if left + 1 < size else 0, x - low


@inlined
def _clamp(x: float, size: int) -> tuple[int, int, float]:
    x = min(max(x, 0.0), size - 1.0)
    left = min(int(x), max(size - 2, 0))
    return left, min(left + 1, size - 1), x - left


@inlined
def sample_level(texels: Texels, level: int, u: float, v: float, repeats: bool) -> Colour:
    """Bilinear colour at u right, v up in [0, 1]; texel centres lie at half integers."""
    width, height = int(texels.width[level]), int(texels.height[level])
    x, y = u * width - 0.5, (1 - v) * height - 0.5
    if repeats:
        return _mix(texels, level, _repeat(x, width), _repeat(y, height))
    return _mix(texels, level, _clamp(x, width), _clamp(y, height))


@inlined
def sample_texture(texels: Texels, texture: int, u: float, v: float, lod: float, repeats: bool) -> Colour:
    """Trilinear colour; `lod` is the base-2 logarithm of level-0 texels per pixel."""
    lod = min(max(lod, 0.0), texels.levels[texture] - 1.0)
    below = int(lod)
    share, level = lod - below, int(texels.first[texture]) + below
    fine = sample_level(texels, level, u, v, repeats)
    if share == 0:
        return fine
    coarse = sample_level(texels, level + 1, u, v, repeats)
    return (
        fine[0] + (coarse[0] - fine[0]) * share,
        fine[1] + (coarse[1] - fine[1]) * share,
        fine[2] + (coarse[2] - fine[2]) * share,
    )


@inlined
def arctangent(y: float, x: float) -> float:
    """`atan2` to 1.2e-5 rad, without the library's branches; 0 at the origin."""
    ax, ay = abs(x), abs(y)
    if ax + ay == 0:
        return 0.0
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
    """Bilinear colour of a picture of all directions (h, w, 3) towards (x, y, z); see `Scene.environment`."""
    height, width = picture.shape[0], picture.shape[1]
    u = 0.5 - arctangent(y, x) * (0.5 / math.pi)
    v = 0.5 + arctangent(z, math.sqrt(x * x + y * y)) / math.pi
    left, right, fx = _repeat(u * width - 0.5, width)
    top, bottom, fy = _clamp((1 - v) * height - 0.5, height)
    wa, wb, wc, wd = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    a, b, c, d = picture[top, left], picture[top, right], picture[bottom, left], picture[bottom, right]
    return (
        a[0] * wa + b[0] * wb + c[0] * wc + d[0] * wd,
        a[1] * wa + b[1] * wb + c[1] * wc + d[1] * wd,
        a[2] * wa + b[2] * wb + c[2] * wc + d[2] * wd,
    )


@kernel
def fill_colours(texels: Texels, texture: np.ndarray, uv: np.ndarray, lod: np.ndarray, found: np.ndarray) -> None:
    """Fill `found` (n, 3) with `sample_texture` at texture (n,), uv (n, 2) and lod (n,); textures repeat."""
    for n in range(len(texture)):
        colour = sample_texture(texels, int(texture[n]), float(uv[n, 0]), float(uv[n, 1]), float(lod[n]), True)
        found[n, 0], found[n, 1], found[n, 2] = colour


@kernel
def fill_radiance(picture: np.ndarray, directions: np.ndarray, found: np.ndarray) -> None:
    """Fill `found` (n, 3) with `sample_direction` towards (n, 3)."""
    for n in range(len(directions)):
        x, y, z = directions[n, 0], directions[n, 1], directions[n, 2]
        found[n, 0], found[n, 1], found[n, 2] = sample_direction(picture, float(x), float(y), float(z))
