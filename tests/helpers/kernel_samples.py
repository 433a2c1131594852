"""Look-ups in textures for arrays of places: the kernel's, and the same by NumPy."""

import numpy as np

from toolkit.rig.kernel.textures import fill_colours
from toolkit.rig.textures import pack_textures


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
