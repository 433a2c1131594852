"""A short closed tour through points: nearest neighbours, then 2-opt and or-opt (see any text on the salesman)."""

import numpy as np

STARTS = 8
LONGEST_RUN = 3
MOST_POLISHED = 200
"""Above so many points or-opt is left out: 2-opt alone stays within seconds."""


def find_tour(points: np.ndarray) -> np.ndarray:
    """(n,) indices of points (n, 3) along a closed tour, mostly the shortest for a plan's size; no randomness.

    The best of a few starts is taken, and the tour starts at point 0 towards the lower of its neighbours' indices.
    """
    points = np.asarray(points, float)
    n = len(points)
    if n < 4:
        return np.arange(n)
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    starts = np.unique(np.linspace(0, n - 1, min(n, STARTS)).round().astype(int))
    tours = [_improve(_go_to_nearest(apart, int(start)), apart) for start in starts]
    best = min(tours, key=lambda tour: round(_length(tour, apart), 6))
    best = np.roll(best, -int(np.flatnonzero(best == 0)[0]))
    return best if best[1] < best[-1] else np.r_[best[:1], best[:0:-1]]


def _length(tour: np.ndarray, apart: np.ndarray) -> float:
    return float(apart[tour, np.roll(tour, -1)].sum())


def _go_to_nearest(apart: np.ndarray, start: int) -> np.ndarray:
    free = np.ones(len(apart), bool)
    tour = [start]
    free[start] = False
    while free.any():
        tour.append(int(np.where(free, apart[tour[-1]], np.inf).argmin()))
        free[tour[-1]] = False
    return np.array(tour)


def _improve(tour: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Reverse stretches and move short runs until neither helps; every step shortens the tour, so it ends."""
    slack = 1e-9 * float(apart.max())
    while True:
        better = _reverse_best(tour, apart, slack)
        if better is None and len(tour) <= MOST_POLISHED:
            better = _move_first(tour, apart, slack)
        if better is None:
            return tour
        tour = better


def _reverse_best(tour: np.ndarray, apart: np.ndarray, slack: float) -> np.ndarray | None:
    """2-opt: the reversal of one stretch that shortens the tour most, None where none does."""
    after = np.roll(tour, -1)
    kept = apart[tour, after]
    change = apart[np.ix_(tour, tour)] + apart[np.ix_(after, after)] - kept[:, None] - kept
    i, j = np.unravel_index(np.triu(change, 1).argmin(), change.shape)
    if change[i, j] >= -slack or i >= j:
        return None
    return np.r_[tour[: i + 1], tour[i + 1 : j + 1][::-1], tour[j + 1 :]]


def _move_first(tour: np.ndarray, apart: np.ndarray, slack: float) -> np.ndarray | None:
    """Or-opt: the first run of up to three points that is better off elsewhere, either way round; else None."""
    n = len(tour)
    for length in range(1, min(LONGEST_RUN, n - 3) + 1):
        for start in range(n):
            turned = np.roll(tour, -start)
            run, rest = turned[:length], turned[length:]
            gain = apart[rest[-1], run[0]] + apart[run[-1], rest[0]] - apart[rest[-1], rest[0]]
            before, behind = rest[:-1], rest[1:]
            for piece in (run, run[::-1]):
                cost = apart[before, piece[0]] + apart[piece[-1], behind] - apart[before, behind]
                place = int(cost.argmin())
                if cost[place] < gain - slack:
                    return np.r_[rest[: place + 1], piece, rest[place + 1 :]]
    return None
