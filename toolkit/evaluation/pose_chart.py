"""Accuracy by direction: where the camera stood, and the share that was right from there."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, atan2, cos, degrees, pi, radians, sin, sqrt

from toolkit.captures.read import Capture
from toolkit.evaluation.metrics import rank_variant
from toolkit.evaluation.predict import Prediction

Seen = list[tuple[tuple[float, float], Prediction]]
"""(azimuth, elevation) in degrees of each image, and what was said of it."""
RADIUS = 100.0
LARGEST_DOT, SMALLEST_DOT, DOT_SHARE = 11.0, 2.5, 46.0


@dataclass(frozen=True)
class PoseDot:
    """One direction: `n_right` of `n` images right.

    Attributes:
        x, y: place on the chart, y down, the rim at distance 100.
        wedge: SVG path of the slice that is right, empty for none or all.
        azimuth_deg, elevation_deg: direction from the object to the camera.
    """

    x: float
    y: float
    wedge: str
    azimuth_deg: float
    elevation_deg: float
    n: int
    n_right: int


@dataclass(frozen=True)
class PoseChart:
    """One source and variant.

    Attributes:
        rings: (radius, label) of circles of equal elevation; the centre looks straight down.
        dot_radius: of every dot.
    """

    source: str
    variant: str
    rings: tuple[tuple[float, str], ...]
    dots: tuple[PoseDot, ...]
    dot_radius: float


def read_direction(capture: Capture) -> tuple[float, float] | None:
    """(azimuth, elevation) in degrees of the camera as seen from what it looks at; None where the pose is unknown.

    From the optical axis, so it needs no target: azimuth 0 looks at the front (+x), counter-clockwise from above.
    """
    T_world_camera = capture.T_world_camera
    if T_world_camera is None:
        return None
    x, y, z = (-T_world_camera[row][2] for row in range(3))
    length = sqrt(x * x + y * y + z * z)
    if not 0.5 < length < 2:
        return None
    azimuth = degrees(atan2(y, x)) % 360
    return (0.0 if azimuth > 359.95 else azimuth), degrees(asin(max(-1.0, min(1.0, z / length))))


def chart_poses(predictions: Sequence[Prediction]) -> list[PoseChart]:
    """A chart for each source and variant of which some image has a known pose; `unpatched` first."""
    found: dict[tuple[str, str], Seen] = defaultdict(list)
    for one in predictions:
        direction = read_direction(one.capture)
        if direction is not None and one.is_read:
            found[(one.capture.source, one.capture.variant)].append((direction, one))
    lowest: dict[str, float] = defaultdict(float)
    for (source, _), seen in found.items():
        lowest[source] = min(lowest[source], *(direction[1] for direction, _ in seen))
    keys = sorted(found, key=lambda key: (key[0], rank_variant(key[1])))
    return [_chart(*key, found[key], lowest[key[0]]) for key in keys]


def _chart(source: str, variant: str, seen: Seen, lowest: float) -> PoseChart:
    rim_deg = 30.0 * (lowest // 30)
    by_place: dict[tuple[int, int], Seen] = defaultdict(list)
    for direction, one in seen:
        by_place[(round(direction[0]) % 360, round(direction[1]))].append((direction, one))
    dot_radius = min(LARGEST_DOT, max(SMALLEST_DOT, DOT_SHARE / sqrt(len(by_place))))
    rings = []
    ring_deg = rim_deg
    while ring_deg < 90:
        rings.append((_radius(ring_deg, rim_deg), f"{ring_deg:.0f}°"))
        ring_deg += 30
    dots = tuple(_dot(by_place[place], rim_deg, dot_radius) for place in sorted(by_place))
    return PoseChart(source, variant, tuple(rings), dots, dot_radius)


def _dot(seen: Seen, rim_deg: float, dot_radius: float) -> PoseDot:
    azimuth, elevation = seen[0][0]
    n, n_right = len(seen), sum(one.correct_top1 for _, one in seen)
    r = _radius(elevation, rim_deg)
    # seen from above with the object's front towards the reader: azimuth 0 points down, 90 (its left) to the right
    x, y = r * sin(radians(azimuth)), r * cos(radians(azimuth))
    return PoseDot(x, y, _wedge(x, y, dot_radius, n_right / n), azimuth, elevation, n=n, n_right=n_right)


def _radius(elevation_deg: float, rim_deg: float) -> float:
    return RADIUS * (90 - elevation_deg) / (90 - rim_deg)


def _wedge(x: float, y: float, radius: float, share: float) -> str:
    if share in (0.0, 1.0):
        return ""
    end_x, end_y = x + radius * sin(2 * pi * share), y - radius * cos(2 * pi * share)
    large = int(share > 0.5)
    return f"M{x:.2f} {y:.2f}V{y - radius:.2f}A{radius:.2f} {radius:.2f} 0 {large} 1 {end_x:.2f} {end_y:.2f}Z"


def describe_place(one: Prediction) -> str:
    """`60° around, 40° up`, or nothing where the pose is unknown."""
    direction = read_direction(one.capture)
    return "" if direction is None else f"{direction[0]:.0f}° around, {direction[1]:.0f}° up"
