"""When in a video the camera was held still, and which frame of each such moment is the sharpest."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

LOOK_WIDTH_PX = 160
SHARP_WIDTH_PX = 960
BLUR_PX = 1.5
NOISE_PX = 1.0
"""Smoothing before sharpness is measured, or noise would pass for it."""
STILL_CHANGE = 0.04
"""Change between two looks, as a share of the picture's contrast, up to which it may be noise and a hand's tremor."""
STILL_SHARE = 0.3
"""In a video that moves, what changes less than this share of its fast parts is held still."""
LEAST_STILL_S = 0.4
BRIDGED_LOOKS = 3
"""So many unsteady looks do not end a still moment, if the picture after them is the one before them."""
LEAST_CONTRAST = 4.0


@dataclass(frozen=True)
class FrameLook:
    """What is kept of one frame: its number, a small blurred grey picture (float32), and how sharp the frame is."""

    frame: int
    small: np.ndarray
    sharpness: float


def look_at_frame(pixels: np.ndarray, frame: int) -> FrameLook:
    """Measure one frame, (h, w, 3) uint8; sharpness is the variance of the Laplacian, 960 px wide and smoothed."""
    grey = cv2.cvtColor(_shrink(pixels, SHARP_WIDTH_PX), cv2.COLOR_RGB2GRAY)
    small = cv2.GaussianBlur(_shrink(grey, LOOK_WIDTH_PX), (0, 0), BLUR_PX).astype(np.float32)
    calm = cv2.GaussianBlur(grey, (0, 0), NOISE_PX)
    return FrameLook(frame, small, float(cv2.Laplacian(calm, cv2.CV_32F).var()))


def choose_still_frames(looks: list[FrameLook], fps: float) -> list[int]:
    """The number of the sharpest frame of each moment of stillness of at least 0.4 s, in order."""
    if len(looks) < 2:
        return [look.frame for look in looks]
    changes = np.array([measure_change(one.small, other.small) for one, other in pairwise(looks)])
    limit = max(STILL_CHANGE, STILL_SHARE * float(np.quantile(changes, 0.9)))
    moments = _join(_find_runs(changes < limit), looks, limit)
    chosen = []
    for first, last in moments:  # changes first … last - 1 lie between looks first … last
        if (looks[last].frame - looks[first].frame) / fps >= LEAST_STILL_S:
            chosen.append(max(looks[first : last + 1], key=lambda look: look.sharpness).frame)
    return chosen


def measure_change(one: np.ndarray, other: np.ndarray) -> float:
    """Mean absolute difference of two small grey pictures, as a share of their contrast; 0 for equal ones."""
    contrast = max(float(one.std()), float(other.std()), LEAST_CONTRAST)
    return float(np.abs(one - other).mean()) / contrast


def _find_runs(still: np.ndarray) -> list[tuple[int, int]]:
    """(first, last + 1) of runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _join(runs: list[tuple[int, int]], looks: list[FrameLook], limit: float) -> list[tuple[int, int]]:
    """Runs with a short jolt between them become one; a cut, after which the picture is another, parts them."""
    joined: list[tuple[int, int]] = []
    for first, end in runs:
        before = joined[-1] if joined else None
        near = before is not None and first - before[1] <= BRIDGED_LOOKS
        if before is not None and near and measure_change(looks[before[1]].small, looks[first].small) < limit:
            joined[-1] = (before[0], end)
        else:
            joined.append((first, end))
    return joined


def _shrink(picture: np.ndarray, width_px: int) -> np.ndarray:
    scale = width_px / picture.shape[1]
    return picture if scale >= 1 else cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
