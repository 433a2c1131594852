"""Where the camera stands: patterns of azimuth and elevation around an object."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from toolkit.errors import ToolkitError, one_of


@dataclass(frozen=True)
class Pattern:
    """How camera positions are spread.

    Attributes:
        name: grid, ring, hemisphere or fibonacci.
        count: number of poses.
        elevation_deg: lowest and highest elevation.
        fill: share of the frame's shorter side that the object reaches across.
        distance_mm: nearest and farthest distance, spread evenly over the poses; None: as `fill` says.
        jitter_deg: standard deviation added to azimuth and elevation.
        seed: of the jitter.
    """

    name: str = "grid"
    count: int = 18
    elevation_deg: tuple[float, float] = (25.0, 65.0)
    fill: float = 0.8
    distance_mm: tuple[float, float] | None = None
    jitter_deg: float = 0.0
    seed: int = 0


def spread_poses(pattern: Pattern) -> np.ndarray:
    """(count, 2) azimuth in [0, 360) and elevation in degrees.

    Raises:
        ToolkitError: an unknown pattern, no poses, elevations outside 0-90° or in the wrong order, or a fill, jitter
            or distance that no camera can have.
    """
    low, high = pattern.elevation_deg
    if pattern.name not in PATTERNS:
        raise one_of("pattern", pattern.name, list(PATTERNS))
    if pattern.count < 1:
        raise ToolkitError(f"--count {pattern.count}: expected at least one pose")
    if not 0 <= low <= high <= 90:
        raise ToolkitError(f"elevations {low:g} to {high:g}: expected 0 <= lowest <= highest <= 90 degrees")
    if not 0.05 <= pattern.fill <= 0.95:
        raise ToolkitError(f"--fill {pattern.fill:g}: expected 0.05 to 0.95 of the frame")
    if not 0 <= pattern.jitter_deg <= 45:
        raise ToolkitError(f"--jitter {pattern.jitter_deg:g}: expected 0 to 45 degrees")
    if pattern.distance_mm is not None and not all(0 < side < 1e6 for side in pattern.distance_mm):
        near, far = pattern.distance_mm
        raise ToolkitError(f"--distance {near:g} {far:g}: expected distances over 0 and under 1000000 mm")
    angles = PATTERNS[pattern.name](pattern.count, low, high)
    if pattern.jitter_deg:
        for i in range(len(angles)):  # pose i depends on (seed, i) alone
            angles[i] += np.random.default_rng([pattern.seed, i]).normal(0, pattern.jitter_deg, 2)
        angles[:, 1] = angles[:, 1].clip(max(low - 3 * pattern.jitter_deg, 0), 90)
    angles[:, 0] %= 360
    return angles


def _grid(count: int, low: float, high: float) -> np.ndarray:
    """Rows of equal azimuths: three elevations where the count allows (18 = 6 × 3), else two, else one."""
    rows = next(rows for rows in (3, 2, 1) if count % rows == 0) if low < high else 1
    columns = count // rows
    elevations = np.linspace(low, high, rows) if rows > 1 else [(low + high) / 2]
    return np.array([(360 * i / columns, elevation) for elevation in elevations for i in range(columns)], float)


def _ring(count: int, low: float, high: float) -> np.ndarray:
    """One circle at the middle elevation."""
    return np.stack([np.arange(count) * 360 / count, np.full(count, (low + high) / 2)], axis=1)


def _hemisphere(count: int, low: float, high: float) -> np.ndarray:
    """Rings whose share of the poses follows their circumference, so that directions are about evenly dense."""
    rows = max(1, round(np.sqrt(count * (high - low) / 150))) if low < high else 1
    edges = np.linspace(low, high, rows + 1)
    elevations = (edges[:-1] + edges[1:]) / 2
    shares = np.cos(np.radians(elevations)) + 1e-6
    ends = np.round(np.cumsum(shares) / shares.sum() * count).astype(int)
    rings = zip(elevations, np.diff(np.r_[0, ends]), strict=True)
    return np.array(
        [(360 * (i + 0.5 * (row % 2)) / n, e) for row, (e, n) in enumerate(rings) for i in range(n)], float
    )  # fmt: skip


def _fibonacci(count: int, low: float, high: float) -> np.ndarray:
    """A golden-angle spiral with equal area per pose between the two elevations."""
    i = np.arange(count)
    sines = np.sin(np.radians(low)) + (i + 0.5) / count * (np.sin(np.radians(high)) - np.sin(np.radians(low)))
    return np.stack([i * 180 * (3 - np.sqrt(5)), np.degrees(np.arcsin(sines))], axis=1)


PATTERNS: dict[str, Callable[[int, float, float], np.ndarray]] = {
    "grid": _grid, "ring": _ring, "hemisphere": _hemisphere, "fibonacci": _fibonacci,
}  # fmt: skip
