"""The map of a city: streets on a grid, the blocks between them, and what is kept free.

Frame: metres; x east, y north, the origin in the middle.
"""

from dataclasses import dataclass, field

import numpy as np

from toolkit.content.grounds import AVENUE_M, STREET_M

PAVEMENT_M = 4.0
KERB_M = 0.15
"""Height of a pavement over the road."""


@dataclass(frozen=True)
class Street:
    """A straight street.

    Attributes:
        at: x (of one that runs north) or y (of one that runs east) of its middle.
        avenue: whether it is wide and carries trams.
        name: on its signs.
        trees: whether it is lined with them.
    """

    at: float
    avenue: bool
    name: str
    trees: bool

    @property
    def half(self) -> float:
        """Half the width of its carriageway."""
        return (AVENUE_M if self.avenue else STREET_M) / 2


@dataclass(frozen=True)
class Stretch:
    """A street between two junctions, as somebody sees it who goes along it.

    Attributes:
        start, end: (2,) middle of the carriageway at both junctions' edges.
        street, across: the street, and the one at `end`.
    """

    start: np.ndarray
    end: np.ndarray
    street: Street
    across: Street

    @property
    def length(self) -> float:
        """Metres."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def ahead(self) -> np.ndarray:
        """(2,) unit."""
        return (self.end - self.start) / self.length

    @property
    def right(self) -> np.ndarray:
        """(2,) unit, to the right hand."""
        x, y = self.ahead
        return np.array([y, -x])

    @property
    def yaw_deg(self) -> float:
        """Of `ahead`, counter-clockwise from +x."""
        return float(np.degrees(np.arctan2(self.ahead[1], self.ahead[0])))

    def point(self, along: float, right: float) -> np.ndarray:
        """(2,) at metres along and to the right."""
        return self.start + self.ahead * along + self.right * right

    def reversed(self, across: Street) -> "Stretch":
        """As somebody sees it who comes the other way."""
        return Stretch(self.end, self.start, self.street, across)


@dataclass(frozen=True)
class Block:
    """A block with its pavements: low and high corners, its column and row."""

    low: tuple[float, float]
    high: tuple[float, float]
    column: int
    row: int

    @property
    def size(self) -> tuple[float, float]:
        """Width and depth inside the pavements."""
        return (self.high[0] - self.low[0] - 2 * PAVEMENT_M, self.high[1] - self.low[1] - 2 * PAVEMENT_M)

    @property
    def corner(self) -> tuple[float, float]:
        """Lower left corner inside the pavements."""
        return self.low[0] + PAVEMENT_M, self.low[1] + PAVEMENT_M


@dataclass
class Plan:
    """Streets that run north (at x) and east (at y), and circles (x, y, radius) where nothing may be put."""

    north: tuple[Street, ...]
    east: tuple[Street, ...]
    reserved: list[tuple[float, float, float]] = field(default_factory=list)

    def blocks(self) -> list[Block]:
        """All, row by row from the south west."""
        return [
            Block((a.at + a.half, c.at + c.half), (b.at - b.half, d.at - d.half), i, j)
            for j, (c, d) in enumerate(zip(self.east[:-1], self.east[1:], strict=True))
            for i, (a, b) in enumerate(zip(self.north[:-1], self.north[1:], strict=True))
        ]

    def stretches(self) -> list[Stretch]:
        """All, northwards and eastwards."""
        found = []
        for street in self.north:
            for a, b in zip(self.east[:-1], self.east[1:], strict=True):
                ends = np.array([(street.at, a.at + a.half), (street.at, b.at - b.half)])
                found.append(Stretch(ends[0], ends[1], street, b))
        for street in self.east:
            for a, b in zip(self.north[:-1], self.north[1:], strict=True):
                ends = np.array([(a.at + a.half, street.at), (b.at - b.half, street.at)])
                found.append(Stretch(ends[0], ends[1], street, b))
        return found

    def both_ways(self) -> list[Stretch]:
        """Every stretch from both sides."""
        result = []
        for stretch in self.stretches():
            runs_north = abs(stretch.ahead[1]) > 0.5
            line = self.east if runs_north else self.north
            at = float(stretch.start[1] if runs_north else stretch.start[0])
            before = max((s for s in line if s.at < at + 1e-6), key=lambda s: s.at)
            result += [stretch, stretch.reversed(before)]
        return result

    def is_free(self, point: np.ndarray, radius: float) -> bool:
        """Whether a circle stays clear of all that is reserved."""
        return all(np.hypot(point[0] - x, point[1] - y) > radius + r for x, y, r in self.reserved)


def plan_city(rng: np.random.Generator, columns: int, rows: int, names: tuple[str, ...]) -> Plan:
    """Lay out a grid of blocks of varying size; every third street is an avenue."""
    order = rng.permutation(len(names))

    def line(blocks: int, shortest: float, longest: float, first_name: int) -> tuple[Street, ...]:
        avenues = {blocks // 3, (2 * blocks + 2) // 3} if blocks > 2 else {blocks // 2}
        streets, at = [], 0.0
        for k in range(blocks + 1):
            avenue = k in avenues
            half = (AVENUE_M if avenue else STREET_M) / 2
            if k:
                at += half
            name = names[order[(first_name + k) % len(names)]]
            streets.append(Street(round(at, 2), avenue, name, bool(avenue or rng.random() < 0.5)))
            at += half + 2 * PAVEMENT_M + float(rng.uniform(shortest, longest))
        middle = (streets[0].at + streets[-1].at) / 2
        return tuple(Street(round(s.at - middle, 2), s.avenue, s.name, s.trees) for s in streets)

    return Plan(line(columns, 56, 76, 0), line(rows, 44, 56, columns + 1))
