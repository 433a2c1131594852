"""Which texels triangles touch, and where the other texels take their colour from."""

import numpy as np

ROUNDING_PX = 1e-4
"""Texture coordinates are float32: closer than this to a texel's border counts as on it."""

STRIPS = 4_000_000
"""Rows of texels that are worked on at once; bounds the memory."""


def cover_texels(corner_uv: np.ndarray, n: int) -> np.ndarray:
    """The texels of an n × n texture that triangles touch, however thin they are.

    A triangle's part in each row of texels is worked out exactly, so a sliver covers every texel that it crosses, and a
    triangle without area the texels that it lies in.

    Args:
        corner_uv: (m, 3, 2), u right and v up; outside [0, 1] the texture repeats.
        n: side of the texture.

    Returns:
        (n, n) bool, row 0 at v = 1.
    """
    x, y = _texel_coordinates(corner_uv, n)
    first, last = _touched(y)
    rows = last - first + 1
    change = np.zeros(n * (n + 1), np.int64)  # +1 where a run of texels starts, -1 behind its end
    done = 0
    ends = np.cumsum(rows)
    while done < len(rows):
        upto = max(int(np.searchsorted(ends, (ends[done - 1] if done else 0) + STRIPS, "right")), done + 1)
        part = slice(done, upto)
        triangle = np.repeat(np.arange(done, upto), rows[part])
        step = np.arange(len(triangle)) - np.repeat(np.cumsum(rows[part]) - rows[part], rows[part])
        row = first[triangle] + step
        left, right = _touched(np.stack(_row_extent(x[triangle], y[triangle], row), axis=1))
        change += _runs(row, left, right, n)
        done = upto
    return np.cumsum(change.reshape(n, n + 1), axis=1)[:, :n] > 0


def _texel_coordinates(corner_uv: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3) columns and rows in texels, each triangle moved by whole textures to where it starts in the first."""
    uv = np.asarray(corner_uv, np.float64)
    places = np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1) * n
    outside = (places.min(axis=1) < -ROUNDING_PX) | (places.max(axis=1) > n + ROUNDING_PX)
    tile = np.floor(places.min(axis=1) / n + 1e-9) * outside
    places -= tile[:, None] * n
    return places[..., 0], places[..., 1]


def _touched(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last texel between the least and the greatest of each row of (k, c) coordinates."""
    low, high = places.min(axis=1), places.max(axis=1)
    first = np.floor(low + ROUNDING_PX).astype(np.int64)
    last = np.ceil(high - ROUNDING_PX).astype(np.int64) - 1
    return first, np.maximum(first, last)


def _row_extent(x: np.ndarray, y: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest x of the parts of triangles (k, 3) between y = row and y = row + 1."""
    low, high = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    top, bottom = row - ROUNDING_PX, row + 1 + ROUNDING_PX
    for a in range(3):
        b = (a + 1) % 3
        rise = y[:, b] - y[:, a]
        flat = np.abs(rise) < 1e-12
        slope = 1 / np.where(flat, 1, rise)
        # the part of the edge within the row, as shares of the way from a to b
        enter, leave = (top - y[:, a]) * slope, (bottom - y[:, a]) * slope
        start = np.where(flat, 0, np.clip(np.minimum(enter, leave), 0, 1))
        stop = np.where(flat, 1, np.clip(np.maximum(enter, leave), 0, 1))
        within = (np.minimum(y[:, a], y[:, b]) <= bottom) & (np.maximum(y[:, a], y[:, b]) >= top)
        for share in (start, stop):
            at = x[:, a] + share * (x[:, b] - x[:, a])
            low = np.where(within, np.minimum(low, at), low)
            high = np.where(within, np.maximum(high, at), high)
    return low, high


def _runs(row: np.ndarray, left: np.ndarray, right: np.ndarray, n: int) -> np.ndarray:
    """(n · (n + 1),) starts and ends of the runs; what goes past the right border comes in again at the left."""
    row = np.where((row == n) | (row == -1), np.clip(row, 0, n - 1), row % n)
    whole = right - left + 1 >= n
    left, right = np.where(whole, 0, left), np.where(whole, n - 1, right)
    shift = np.where((left == n) & (right == n), 1, left // n * n)  # u = 1 is the last column
    left, right = left - shift, right - shift
    start = np.bincount(row * (n + 1) + left, minlength=n * (n + 1))
    stop = np.bincount(row * (n + 1) + np.minimum(right, n - 1) + 1, minlength=n * (n + 1))
    over = right >= n
    again = np.bincount(row[over] * (n + 1), minlength=n * (n + 1))
    again_stop = np.bincount(row[over] * (n + 1) + right[over] - n + 1, minlength=n * (n + 1))
    return start - stop + again - again_stop


def nearest_covered(covered: np.ndarray) -> np.ndarray:
    """The flat index of the texel that each texel takes its colour from: itself, or the nearest covered one.

    Filters reach over the texture's border to the opposite side, so nearness does too.

    Args:
        covered: (n, n) bool, at least one True.

    Returns:
        (n, n) int64.
    """
    from scipy.ndimage import distance_transform_edt

    n = len(covered)
    around = n // 2
    wrapped = np.pad(~covered, around, mode="wrap")
    row, column = distance_transform_edt(wrapped, return_distances=False, return_indices=True)
    inner = slice(around, around + n)
    return ((row[inner, inner] - around) % n).astype(np.int64) * n + (column[inner, inner] - around) % n
