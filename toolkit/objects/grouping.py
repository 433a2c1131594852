"""Equal rows of large tables, found by sorting a few packed integers instead of whole rows."""

from collections.abc import Iterable

import numpy as np

WORD = 63
"""Bits of a number that is sorted: a key, and behind it the row's own number."""
PLACES = 1e6
"""Vertices closer than the mesh's extent over this are at one place."""


def group_rows(columns: Iterable[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Which rows of a table of integers are equal.

    As `np.unique(axis=0)` finds them, in the same order, many times as fast.

    Args:
        columns: (n,) integers each, the first one sorts first; taken one by one, so that a generator takes less memory.

    Returns:
        (k,) the first row of each group, the groups in rising order; and (n,) the group of each row.
    """
    keys = _pack(columns)
    first = keys.pop(0)
    order = rising_order(first)
    starts = np.diff(first[order], prepend=-1) != 0
    del first
    while keys:  # only rows that are equal so far, and differ now, are sorted again
        ranked, group = keys.pop(0)[order], np.cumsum(starts, dtype=np.int32) - 1
        differs = np.diff(ranked, prepend=ranked[:1]) != 0
        mixed = np.zeros(len(order), bool)
        mixed[group[differs & ~starts]] = True
        rows = np.flatnonzero(mixed[group])
        again = rising_order(ranked[rows])
        again = again[rising_order(group[rows][again])]
        order[rows] = order[rows][again]
        ranked[rows] = ranked[rows][again]
        starts |= np.diff(ranked, prepend=ranked[:1]) != 0
    inverse = np.empty(len(order), np.int64)
    inverse[order] = np.cumsum(starts) - 1
    return order[starts], inverse


def rising_order(key: np.ndarray) -> np.ndarray:
    """The order (n,) that sorts integers from 0 up, equal ones as they come."""
    shift = len(key).bit_length()
    if len(key) == 0 or int(key.max()).bit_length() + shift > WORD:
        return np.argsort(key, kind="stable")
    word = key.astype(np.int64) << shift  # NumPy sorts plain integers four times as fast as it finds their order
    word |= np.arange(len(key))
    word.sort()
    word &= (1 << shift) - 1
    return word


def _pack(columns: Iterable[np.ndarray]) -> list[np.ndarray]:
    """As few columns of integers from 0 up as sort like the given ones, short enough for `rising_order`."""
    keys: list[np.ndarray] = []
    free = 0
    for column in columns:
        room = WORD - len(column).bit_length()
        low, high = (int(column.min()), int(column.max())) if len(column) else (0, 0)
        bits = (high - low).bit_length()
        if bits > room:  # numbers far apart: their ranks sort alike
            column = np.unique(column, return_inverse=True)[1].reshape(-1)
            low, bits = 0, len(column).bit_length()
        if keys and bits <= free:
            keys[-1] = keys[-1].astype(np.int64) << bits
            keys[-1] |= column.astype(np.int64) - low
            free -= bits
        else:
            keys.append((column.astype(np.int64) - low).astype(np.int32 if bits < 32 else np.int64))
            free = room - bits
    return keys


def group_places(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which vertices (n, 3) are at one place: within a millionth of the mesh's extent.

    Returns:
        (k,) the first vertex at each place, the places sorted by x, y, z; and (n,) the place of each vertex.
    """
    extent = max(float(np.ptp(vertices, axis=0).max()), 1e-9)
    step, least = extent / PLACES, vertices.min(axis=0)
    # counted from the least, which fits into half the bytes
    return group_rows(
        [
            (np.round(axis / step) - np.round(low / step)).astype(np.int32)
            for axis, low in zip(vertices.T, least, strict=True)
        ]
    )
