"""Markers in a ring round a free disc, for an object on a turntable."""

import math
from dataclasses import dataclass

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.rig.board import MarkerBoard
from toolkit.rig.markers import (
    DICTIONARY,
    RING_FIRST_ID,
    STRIP_FIRST_ID,
    require_ids,
    require_ink,
    require_mm,
)

FEWEST_MARKERS = 8
"""At a low camera the object hides the half of the ring behind it; four markers are left."""


@dataclass(frozen=True)
class MarkerRing(MarkerBoard):
    """Markers in a ring round a free disc, upright towards the middle as seen from outside; checked when it is made.

    The first marker lies at the front (the lower edge of the page), the others follow counter-clockwise from above.
    Sheet positions are counted from the corner of the square round the ring.

    Attributes:
        inner_mm: diameter of the free disc that the object stands on.
        marker_mm: side of a marker, its black border included.
        count: of the markers.
        dictionary: one of OpenCV's, by name.
        first_id: number of the marker at the front.
        ink_percent: how dark the markers are, 100 is black.

    Raises:
        ToolkitError: the markers do not fit side by side, or the dictionary has too few.
    """

    inner_mm: float
    marker_mm: float
    count: int
    dictionary: str = DICTIONARY
    first_id: int = RING_FIRST_ID
    ink_percent: float = 100.0

    def __post_init__(self) -> None:
        require_ink("ring", self.ink_percent)
        require_mm("ring: inner_mm", self.inner_mm)
        require_mm("ring: marker_mm", self.marker_mm)
        if self.count < FEWEST_MARKERS:
            raise ToolkitError(f"ring: {self.count} markers: expected at least {FEWEST_MARKERS}")
        if self.count > (most := count_that_fit(self.inner_mm, self.marker_mm)):
            raise ToolkitError(
                f"ring: {self.count} markers of {self.marker_mm:g} mm round {self.inner_mm:g} mm: at most {most} fit; "
                "choose a larger ring or smaller markers"
            )
        require_ids("ring", self.dictionary, self.first_id, self.count)

    @property
    def quiet_mm(self) -> float:
        """White paper inside and outside the markers, one module."""
        return self.marker_mm / 7

    @property
    def middle_radius_mm(self) -> float:
        """From the ring's middle to a marker's."""
        return self.inner_mm / 2 + self.quiet_mm + self.marker_mm / 2

    @property
    def outer_mm(self) -> float:
        """Diameter of the sheet."""
        half = self.marker_mm / 2
        # a marker's outer corners reach furthest
        return 2 * (math.hypot(self.middle_radius_mm + half, half) + self.quiet_mm)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the square round the sheet."""
        return self.outer_mm, self.outer_mm

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """Numbers of the markers, the front one first."""
        return tuple(range(self.first_id, self.first_id + self.count))

    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """As `Board` has it; each is upright towards the middle."""
        turns = [2 * math.pi * index / self.count for index in range(self.count)]
        radius, middle = self.middle_radius_mm, self.outer_mm / 2
        return [
            (marker_id, middle + radius * np.array([math.sin(turn), math.cos(turn)]), turn)
            for marker_id, turn in zip(self.marker_ids, turns, strict=True)
        ]

    def describe(self) -> str:
        """One line: what it is made of."""
        last = self.first_id + self.count - 1
        return (
            f"ring of {self.count} ArUco markers, {self.marker_mm:g} mm, round {self.inner_mm:g} mm, "
            f"{self.dictionary} {self.first_id}-{last}, {self.ink_percent:g} % ink"
        )


def count_that_fit(inner_mm: float, marker_mm: float) -> int:
    """The most markers round a free disc that have a module of white paper between them."""
    apothem = inner_mm / 2 + marker_mm / 7  # of the polygon of the markers' inner sides
    # a polygon of n sides of length s has apothem s / (2 tan(pi / n)), solved for n; a side is a marker and one module
    return int(math.pi / math.atan(marker_mm * 8 / 7 / 2 / apothem))


def choose_ring(inner_mm: float, marker_mm: float | None = None) -> MarkerRing:
    """A ring of that free diameter, its markers evenly spread with room of a third of their side between them.

    Args:
        inner_mm: diameter of the free disc.
        marker_mm: side of the markers; None: about a twelfth of the disc, 12 to 40 mm.

    Raises:
        ToolkitError: too few markers fit.
    """
    require_mm("ring: inner_mm", inner_mm)
    side = float(min(max(round(inner_mm / 12.5), 12), 40)) if marker_mm is None else marker_mm
    require_mm("ring: marker_mm", side)
    most = count_that_fit(inner_mm, side)
    if most < FEWEST_MARKERS:
        # the same, solved for the free disc
        least = 2 * (side * 8 / 14 / math.tan(math.pi / FEWEST_MARKERS) - side / 7)
        raise ToolkitError(
            f"a ring of {inner_mm:g} mm takes {most} markers of {side:g} mm, expected at least {FEWEST_MARKERS}: "
            f"choose a ring of at least {math.ceil(least)} mm or smaller markers"
        )
    apothem = inner_mm / 2 + side / 7
    roomy = int(math.pi / math.atan(side * 4 / 3 / 2 / apothem))
    return MarkerRing(inner_mm, side, min(max(roomy, FEWEST_MARKERS), STRIP_FIRST_ID - RING_FIRST_ID))


DEFAULT_RING = MarkerRing(inner_mm=300.0, marker_mm=24.0, count=30)
