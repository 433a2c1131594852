"""The map of a city, its carriageways and pavements, and what stands and drives on them.

Frame: metres; x east, y north, the origin in the middle.
"""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from toolkit.rooms.worlds.content.countryside import shrub, street_tree
from toolkit.rooms.worlds.content.drawing import Rng
from toolkit.rooms.worlds.content.pieces import UNIT, Looks, Piece, Skin, bars, floor_quads, merge, place, quads
from toolkit.rooms.worlds.content.street_furniture import (
    FURNITURE,
    SIGN_KINDS,
    name_post,
    old_lamp,
    sign_post,
    street_lamp,
    traffic_light,
)
from toolkit.rooms.worlds.content.surfaces import (
    AVENUE_M,
    CROSSING_M,
    PARKING_M,
    STREET_M,
    crossing,
    junction,
    kerb,
    pavement,
    road,
)
from toolkit.rooms.worlds.content.vehicles import Fleet, Vehicle
from toolkit.rooms.worlds.world import SceneClass

PAVEMENT_M = 4.0
KERB_M = 0.15
"""Height of a pavement over the road."""
ROAD, PAVED = SceneClass.ROAD, SceneClass.PAVEMENT
KERB_WIDTH_M = 0.3
CORNER_M = 2.5
CORNER_STEPS = 6
Standing = dict[str, list[tuple[float, float, float, float]]]
"""Positions x, y, z and yaw of things by name."""

PARKED_SHARE = 0.42
KERB_SIDE = {
    "meter": 0.3, "hydrant": 0.06, "mailbox": 0.07, "bin": 0.1, "newspapers": 0.07, "phone": 0.05, "bicycle": 0.08,
    "bench": 0.06,
}  # fmt: skip
WALL_SIDE = {
    "cafe": 0.1, "bench": 0.15, "planter": 0.2, "dustbins": 0.16, "bicycle": 0.08, "newspapers": 0.08, "bin": 0.07,
}  # fmt: skip
TREE_VARIANTS = 4


@dataclass(frozen=True)
class Street:
    """A straight street."""

    at: float  # x (of a street that runs north) or y (of a street that runs east) of its middle
    avenue: bool  # whether it is wide and carries trams
    name: str  # on its signs
    trees: bool  # whether it is lined with them

    @property
    def half(self) -> float:
        """Half the width of its carriageway."""
        return (AVENUE_M if self.avenue else STREET_M) / 2


@dataclass(frozen=True)
class Stretch:
    """A street between two junctions, as somebody sees it who goes along it."""

    start: np.ndarray  # start, end: (2,) middle of the carriageway at both junctions' edges
    end: np.ndarray
    street: Street  # street, across: the street, and the street at `end`
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
        """Bearing of `ahead`, degrees counter-clockwise from +x."""
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
            # the street that this stretch comes from
            before = max((s for s in line if s.at < at + 1e-6), key=lambda s: s.at)
            result += [stretch, stretch.reversed(before)]
        return result

    def is_free(self, point: np.ndarray, radius: float) -> bool:
        """Whether a circle stays clear of all that is reserved."""
        return all(np.hypot(point[0] - x, point[1] - y) > radius + r for x, y, r in self.reserved)


def plan_city(rng: Rng, columns: int, rows: int, names: tuple[str, ...]) -> Plan:
    """Lay out a grid of blocks of varying size; every third street is an avenue."""
    # names in an order of the city's own
    order = rng.permutation(len(names))

    def line(blocks: int, shortest: float, longest: float, first_name: int) -> tuple[Street, ...]:
        # two avenues, at a third and at two thirds of the way
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
        # about the middle of the outermost streets
        return tuple(Street(round(s.at - middle, 2), s.avenue, s.name, s.trees) for s in streets)

    return Plan(line(columns, 56, 76, 0), line(rows, 44, 56, columns + 1))


def build_streets(plan: Plan, looks: Looks) -> Piece:
    """All that lies between the blocks."""
    pieces = [_carriageway(stretch, looks) for stretch in plan.stretches()]
    cells = [(n.at - n.half, e.at - e.half, n.at + n.half, e.at + e.half) for n in plan.north for e in plan.east]
    pieces.append(floor_quads(np.array(cells), 0.0, junction(looks), ROAD))
    return merge(*pieces)


def _carriageway(stretch: Stretch, looks: Looks) -> Piece:
    # from crossing to crossing, the crossings apart
    avenue, half = stretch.street.avenue, stretch.street.half
    skin = road(looks, avenue)
    a, b = CROSSING_M, stretch.length - CROSSING_M
    # the road's picture repeats along it
    turns = (b - a) / skin.tile_m[1]
    uv = np.array([(0, 0), (1, 0), (1, turns), (0, turns)])
    ahead = _strip(stretch, b, stretch.length, half)
    back = _strip(stretch, a, 0.0, -half)
    zebra = crossing(looks, avenue)
    return merge(
        quads(_strip(stretch, a, b, half), skin, ROAD, uv),
        quads(ahead, zebra, ROAD, UNIT), quads(back, zebra, ROAD, UNIT),
    )  # fmt: skip


def carry_on(stretch: Stretch, looks: Looks) -> Piece:
    """A carriageway without crossings, a little above the ground that it is laid on."""
    skin = road(looks, stretch.street.avenue)
    turns = stretch.length / skin.tile_m[1]
    uv = np.array([(0, 0), (1, 0), (1, turns), (0, turns)])
    return quads(_strip(stretch, 0.0, stretch.length, stretch.street.half), skin, ROAD, uv).moved(0, 0, 0.006)


def _strip(stretch: Stretch, start: float, end: float, half: float) -> np.ndarray:
    """(1, 4, 3) corners of a piece of road: left and right of its start, right and left of its end."""
    corners = [(start, -half), (start, half), (end, half), (end, -half)]
    return np.array([[(*stretch.point(along, right), 0.0) for along, right in corners]])


def build_pavement(block: Block, inside: Skin, label: int, looks: Looks) -> Piece:
    """The raised ground of a block: rounded kerbs, the pavement's slabs, and within it the ground of its lots."""
    (x0, y0), (x1, y1) = block.low, block.high
    r, w, z, p = CORNER_M, KERB_WIDTH_M, KERB_M, PAVEMENT_M
    slabs, stone = pavement(looks), kerb(looks)
    # the pavement is a ring of eight strips that leaves out the round corners
    strips = [
        (x0 + r, y0 + w, x1 - r, y0 + p), (x0 + r, y1 - p, x1 - r, y1 - w), (x0 + w, y0 + p, x0 + p, y1 - p),
        (x1 - p, y0 + p, x1 - w, y1 - p), (x0 + w, y0 + r, x0 + r, y0 + p), (x1 - r, y0 + r, x1 - w, y0 + p),
        (x0 + w, y1 - p, x0 + r, y1 - r), (x1 - r, y1 - p, x1 - w, y1 - r),
    ]  # fmt: skip
    pieces = [
        floor_quads(np.array(strips), z, slabs, PAVED),
        floor_quads((x0 + p, y0 + p, x1 - p, y1 - p), z, inside, label),
    ]
    # each side's kerb and corner, turned by a quarter each
    for k, (x, y) in enumerate(((x0, y0), (x1, y0), (x1, y1), (x0, y1))):
        span = (x1 - x0, y1 - y0)[k % 2] - 2 * r
        # a kerb's face and top along x, the road towards -y
        face = [(0, 0, 0), (span, 0, 0), (span, 0, z), (0, 0, z)]
        top = [(0, 0, z), (span, 0, z), (span, w, z), (0, w, z)]
        straight = quads(np.array([face, top]), stone, PAVED)
        edge = merge(straight.moved(r, 0, 0), _round_corner(slabs, stone, junction(looks)))
        pieces.append(place(edge, (x, y, 0.0), 90.0 * k))
    return merge(*pieces)


def _round_corner(slabs: Skin, stone: Skin, asphalt: Skin) -> Piece:
    """The lower left corner of a block: a quarter of a disc of slabs in a bent kerb, and the road outside it."""
    r, w, z = CORNER_M, KERB_WIDTH_M, KERB_M
    # a quarter of a circle about the corner's middle
    angle = np.linspace(np.pi, 1.5 * np.pi, CORNER_STEPS + 1)
    ring = np.round(np.column_stack([np.cos(angle), np.sin(angle)]), 9)
    outer, inner = r + ring * r, r + ring * (r - w)

    def at(points: np.ndarray, height: float) -> np.ndarray:
        return np.column_stack([points, np.full(len(points), height)])

    # the kerb's face and top, the slabs inside, and the road in the corner outside
    face = np.stack([at(outer[:-1], 0), at(outer[1:], 0), at(outer[1:], z), at(outer[:-1], z)], 1)
    top = np.stack([at(outer[:-1], z), at(outer[1:], z), at(inner[1:], z), at(inner[:-1], z)], 1)
    centre = np.full((CORNER_STEPS, 3), (r, r, z))
    disc = np.stack([at(inner[:-1], z), at(inner[1:], z), centre, centre], 1)
    gap = np.stack([at(outer[1:], 0), at(outer[:-1], 0), np.zeros((CORNER_STEPS, 3)), np.zeros((CORNER_STEPS, 3))], 1)
    return merge(quads(np.concatenate([face, top]), stone, PAVED), quads(disc, slabs, PAVED), quads(gap, asphalt, ROAD))


def place_vehicles(plan: Plan, fleet: Fleet, rng: Rng) -> Piece:
    """Parked along the kerbs, queueing and driving on the right."""
    # by make: each vehicle's mesh is copied once for all its places
    at: dict[int, list[tuple[float, float, float]]] = defaultdict(list)
    makes: dict[int, Vehicle] = {}

    # nothing stands where room was reserved
    def put(vehicle: Vehicle, stretch: Stretch, along: float, right: float, turn: float = 0.0) -> None:
        point = stretch.point(along, right)
        if plan.is_free(point, vehicle.length / 2):
            at[id(vehicle)].append((*point, stretch.yaw_deg + turn))
            makes[id(vehicle)] = vehicle

    def pick(shares: list[tuple[tuple[Vehicle, ...], float]]) -> Vehicle:
        kinds = [kind for kind, _ in shares]
        kind = kinds[int(rng.choice(len(kinds), p=np.array([share for _, share in shares])))]
        return kind[int(rng.integers(len(kind)))]

    for stretch in plan.both_ways():
        half, end = stretch.street.half, stretch.length - CROSSING_M - 5.0
        # parked from crossing to crossing, a little askew; an empty place is 6 m
        along = CROSSING_M + 6.0
        while along < end:
            vehicle = pick(fleet.parked())
            if rng.random() < PARKED_SHARE and along + vehicle.length < end:
                put(
                    vehicle, stretch, along + vehicle.length / 2, half - PARKING_M / 2 - rng.uniform(-0.1, 0.15),
                    rng.normal(0, 0.8),
                )  # fmt: skip
                along += vehicle.length + rng.uniform(0.7, 1.6)
            else:
                along += 6.0
        lane = 5.0 if stretch.street.avenue else 2.1
        # from the crossing backwards: those in front stop at it, others queue or follow
        along = stretch.length - CROSSING_M - rng.uniform(0.3, 22.0)
        while along > CROSSING_M + 4:
            vehicle = pick(fleet.moving())
            if along - vehicle.length < CROSSING_M:
                break
            put(vehicle, stretch, along - vehicle.length / 2, lane + rng.uniform(-0.15, 0.15))
            along -= vehicle.length + rng.choice([1.8, 8.0, 18.0, 36.0])
        # trams run in the middle of avenues
        if stretch.street.avenue and rng.random() < 0.3 and stretch.length > 36:
            tram = fleet.trams[int(rng.integers(len(fleet.trams)))]
            put(tram, stretch, stretch.length / 2 + rng.uniform(-4, 4), 1.68)
    pieces = []
    for key, places in at.items():
        spots = np.array(places)
        pieces.append(place(makes[key].piece, np.column_stack([spots[:, :2], np.zeros(len(spots))]), spots[:, 2]))
    return merge(*pieces)


def furnish_streets(plan: Plan, looks: Looks, rng: Rng) -> Piece:
    """Everything on the pavements."""
    standing: Standing = defaultdict(list)
    for stretch in plan.both_ways():
        _line_kerb(plan, stretch, standing, rng)
        _line_wall(plan, stretch, standing, rng)
        _signal(plan, stretch, standing, rng)
    return build_standing(standing, looks)


def build_standing(standing: Standing, looks: Looks) -> Piece:
    """Copies of everything at its places."""
    pieces = []
    # each thing is built once and copied to all its places
    for name, places in standing.items():
        spots = np.array(places)
        kind, _, rest = name.partition(":")
        scale: float | np.ndarray = 1.0
        if kind == "lamp":
            made = street_lamp(looks)
        elif kind == "old-lamp":
            made = old_lamp(looks)
        elif kind == "tree":
            made = street_tree(looks, int(rest))
            # the height follows from the place, so that a tree keeps it whatever else is drawn
            scale = 0.75 + 0.5 * ((spots[:, 0] * 7.13 + spots[:, 1] * 3.7) % 1.0)
        elif kind == "shrub":
            made = shrub(looks, int(rest))
        elif kind == "sign":
            made = sign_post(rest, looks)
        elif kind == "names":
            made = name_post(tuple(rest.split("|")), looks)  # type: ignore[arg-type]
        elif kind == "signal":
            lit, street, arm = rest.split("|")
            made = traffic_light(looks, int(lit), street, float(arm))
        else:
            made = FURNITURE[kind][0](looks)
        pieces.append(place(made, spots[:, :3], spots[:, 3], scale))
    return merge(*pieces)


def _line_kerb(plan: Plan, stretch: Stretch, standing: Standing, rng: Rng) -> None:
    # lamps, trees and the like stand 0.75 m behind the kerb
    right = stretch.street.half + 0.75
    kinds, shares = list(KERB_SIDE), np.array(list(KERB_SIDE.values()))
    shares = shares / shares.sum()
    # in turns of four: a lamp, something, a tree, something
    along, k = CROSSING_M + 2.5, int(rng.integers(4))
    # at most a single thing at each place
    while along < stretch.length - 5.0:
        point = stretch.point(along, right)
        if k % 4 == 0 and plan.is_free(stretch.point(along, right - 2.4), 0.5) and plan.is_free(point, 0.3):
            name = "lamp" if stretch.street.avenue or rng.random() < 0.8 else "old-lamp"
            standing[name].append((*point, KERB_M, stretch.yaw_deg - 180))
        elif k % 4 == 2 and stretch.street.trees and plan.is_free(point, 3.2):
            standing[f"tree:{rng.integers(TREE_VARIANTS)}"].append((*point, KERB_M, rng.uniform(0, 360)))
        elif rng.random() < 0.75:
            kind = kinds[int(rng.choice(len(kinds), p=shares))]
            if plan.is_free(point, FURNITURE[kind][1]):
                turn = 90.0 if kind in ("bicycle",) else 0.0
                standing[kind].append((*point, KERB_M, stretch.yaw_deg + turn))
        # a traffic sign now and then, and a bus shelter in the middle of a long street
        if rng.random() < 0.12 and plan.is_free(point, 1.0):
            kind = SIGN_KINDS[1:][int(rng.integers(len(SIGN_KINDS) - 1))]
            standing[f"sign:{kind}"].append((*stretch.point(along + 1.6, right - 0.1), KERB_M, stretch.yaw_deg - 90))
        along += rng.uniform(3.8, 5.6)
        k += 1
    if rng.random() < 0.25 and stretch.length > 40:
        point = stretch.point(stretch.length * 0.5, stretch.street.half + 1.6)
        if plan.is_free(point, FURNITURE["shelter"][1]):
            standing["shelter"].append((*point, KERB_M, stretch.yaw_deg - 180))


def _line_wall(plan: Plan, stretch: Stretch, standing: Standing, rng: Rng) -> None:
    # 0.75 m before the walls
    right = stretch.street.half + PAVEMENT_M - 0.75
    kinds, shares = list(WALL_SIDE), np.array(list(WALL_SIDE.values()))
    along = CROSSING_M + rng.uniform(4, 10)
    while along < stretch.length - 6.0:
        kind = kinds[int(rng.choice(len(kinds), p=shares / shares.sum()))]
        # a table needs more room, so it stands farther out
        inward = 0.75 if kind == "cafe" else 0.0
        point = stretch.point(along, right - inward)
        if plan.is_free(point, FURNITURE[kind][1]):
            standing[kind].append((*point, KERB_M, stretch.yaw_deg - 180))
            if kind == "planter":
                standing[f"shrub:{rng.integers(3)}"].append((*point, KERB_M + 0.45, rng.uniform(0, 360)))
            if kind == "cafe" and plan.is_free(stretch.point(along + 2.6, right - inward), 1.4):
                standing[kind].append((*stretch.point(along + 2.6, right - inward), KERB_M, stretch.yaw_deg - 150))
        along += rng.uniform(5, 13)


def _signal(plan: Plan, stretch: Stretch, standing: Standing, rng: Rng) -> None:
    """At the far right corner of the junction ahead: a signal over the road, or a stop sign before it."""
    # the outermost streets have no junction behind them
    inner = (plan.north[0].at, plan.north[-1].at, plan.east[0].at, plan.east[-1].at)
    beyond = stretch.point(stretch.length + 2 * stretch.across.half + 1.0, stretch.street.half + 1.0)
    inside = inner[0] < beyond[0] < inner[1] and inner[2] < beyond[1] < inner[3]
    if inside and (stretch.street.avenue or stretch.across.avenue or rng.random() < 0.7):
        # red for a direction is green for the other
        runs_north = abs(stretch.ahead[1]) > 0.5
        arm = 6.5 if stretch.street.avenue else 4.6
        # green for one of the crossing directions, by the corner's place
        lit = (0 if runs_north else 2) if int(abs(beyond[0] // 7)) % 2 else (2 if runs_north else 0)
        if plan.is_free(beyond, 0.3):
            standing[f"signal:{lit}|{stretch.across.name}|{arm}"].append((*beyond, KERB_M, stretch.yaw_deg - 90))
    elif plan.is_free(stretch.point(stretch.length - 1, stretch.street.half + 0.8), 0.5):
        standing["sign:stop"].append(
            (*stretch.point(stretch.length - CROSSING_M - 1, stretch.street.half + 0.8), KERB_M, stretch.yaw_deg - 90)
        )
    # names of both streets at about half of the corners
    if rng.random() < 0.5:
        point = stretch.point(stretch.length - 0.9, stretch.street.half + 1.2)
        if plan.is_free(point, 0.8):
            standing[f"names:{stretch.across.name}|{stretch.street.name}"].append(
                (*point, KERB_M, stretch.yaw_deg - 90)
            )


def hang_wires(plan: Plan, looks: Looks) -> Piece:
    """Contact wires over the avenues on span wires between poles, left out over reserved circles."""
    black, steel = looks.plain((30, 30, 32), "matte"), looks.plain((70, 76, 76))
    pieces = []
    for stretch in plan.stretches():
        if not stretch.street.avenue or not plan.is_free((stretch.start + stretch.end) / 2, stretch.length / 2 + 8):
            continue
        # two contact wires 5.55 m high, each above a track
        ends = [np.array([(*stretch.point(along, y), 5.55)]) for y in (-1.68, 1.68) for along in (0.0, stretch.length)]
        pieces.append(bars(np.concatenate(ends[::2]), np.concatenate(ends[1::2]), 0.03, black, SceneClass.FURNITURE))
        reach = stretch.street.half + 0.6
        # poles in pairs, 18 m apart, with a wire across
        for along in np.arange(9.0, stretch.length - 5, 18.0):
            posts = np.array([(*stretch.point(along, side * reach), KERB_M) for side in (-1, 1)])
            tops = posts + [0, 0, 6.4]
            pieces.append(bars(posts, tops, 0.18, steel, SceneClass.FURNITURE))
            pieces.append(bars(tops[:1], tops[1:], 0.025, black, SceneClass.FURNITURE))
    return merge(*pieces)
