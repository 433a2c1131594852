"""Look-ups in textures and baked light for arrays of places: the kernel's, and the same by NumPy."""

import numba
import numpy as np

from toolkit.rig.kernel.light import find_samples
from toolkit.rig.kernel.textures import fill_colours, sample_direction
from toolkit.rig.lighting import SampleIndex
from toolkit.rig.textures import pack_textures

jit = numba.njit(error_model="numpy")  # parts of kernels are called from compiled code alone


def read_samples(grid: SampleIndex, stored: np.ndarray, triangle: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Interpolate stored values (k, c) at points: triangle (n,), barycentric weights (n, 2) of corners 1 and 2."""
    found = np.empty((len(triangle), stored.shape[1]), np.float32)
    _read_samples(grid.steps, grid.first, stored, triangle, uv, found)
    return found


@jit
def _read_samples(steps, first, stored, triangle, uv, out):
    for n in range(len(triangle)):
        face = triangle[n]
        a, b, c, wb, wc = find_samples(int(steps[face]), float(uv[n, 0]), float(uv[n, 1]))
        start = first[face]
        out[n] = stored[start + a] * (1 - wb - wc) + stored[start + b] * wb + stored[start + c] * wc


@jit
def look_towards(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Colours (n, 3) of a picture of all directions (h, w, 4) towards (n, 3)."""
    found = np.empty((len(directions), 3), np.float32)
    for n in range(len(directions)):
        x, y, z = directions[n, 0], directions[n, 1], directions[n, 2]
        found[n, 0], found[n, 1], found[n, 2] = sample_direction(picture, float(x), float(y), float(z))
    return found


def sample(encoded: np.ndarray, u: np.ndarray, v: np.ndarray, lod: float = 0.0) -> np.ndarray:
    """Linear colours (n, 3) of a uint8 sRGB texture."""
    found = np.empty((len(u), 3), np.float32)
    uv = np.stack([u, v], axis=1).astype(np.float32)
    lods = np.full(len(u), lod, np.float32)
    fill_colours(pack_textures([encoded]), np.zeros(len(u), np.int32), uv, lods, found)
    return found


def texture_pyramid(encoded: np.ndarray) -> list[np.ndarray]:
    """The levels, uint16, that the kernel has of a texture."""
    packed = pack_textures([encoded])
    sizes = zip(packed.start, packed.height, packed.width, strict=True)
    return [packed.values[start : start + h * w].reshape(h, w, 3) for start, h, w in sizes]


def sample_by_numpy(levels: list[np.ndarray], u: np.ndarray, v: np.ndarray, lod: np.ndarray) -> np.ndarray:
    """Trilinear values (n, c) of a pyramid of any numbers, which repeats."""
    lod = np.clip(lod, 0, len(levels) - 1)
    total = np.zeros((len(u), levels[0].shape[2]))
    for number, level in enumerate(levels):
        h, w = level.shape[:2]
        x, y = np.asarray(u, float) * w - 0.5, (1 - np.asarray(v, float)) * h - 0.5
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = (x - left)[:, None], (y - top)[:, None]
        corner = {(i, j): level[(top + j) % h, (left + i) % w] for i in (0, 1) for j in (0, 1)}
        upper = corner[0, 0] * (1 - fx) + corner[1, 0] * fx
        lower = corner[0, 1] * (1 - fx) + corner[1, 1] * fx
        total += (upper * (1 - fy) + lower * fy) * np.maximum(1 - np.abs(lod - number), 0)[:, None]
    return total
