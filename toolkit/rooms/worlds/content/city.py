"""The city: blocks filled with houses and landmarks on a grid of streets, and a skyline."""

from dataclasses import dataclass, field

import numpy as np

from toolkit.rooms.worlds.content.buildings import KINDS, House, Lot
from toolkit.rooms.worlds.content.countryside import surround, towers
from toolkit.rooms.worlds.content.drawing import Rng
from toolkit.rooms.worlds.content.landmarks import (
    building_site,
    church,
    cinema,
    filling_station,
    library,
    parking_house,
)
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin, boxes, floor_quads, merge, mesh_of, place
from toolkit.rooms.worlds.content.street_furniture import STREET_NAMES, billboard, flag, fountain, monument
from toolkit.rooms.worlds.content.streets import (
    KERB_M,
    PAVEMENT_M,
    Block,
    Plan,
    Standing,
    Stretch,
    build_pavement,
    build_standing,
    build_streets,
    carry_on,
    furnish_streets,
    hang_wires,
    place_vehicles,
    plan_city,
)
from toolkit.rooms.worlds.content.surfaces import grass, junction, pavement, plaza, wall
from toolkit.rooms.worlds.content.vehicles import Fleet, build_fleet
from toolkit.rooms.worlds.world import SceneClass, Spot, World

LANDMARKS = ("square", "church", "parking", "site", "library", "park", "cinema", "station")
BLOCKS = (5, 6)
HORIZON_M, FAR_STREET_M = 900.0, 250.0
STREET_SPOTS, CROSSING_SPOTS = 6, 3
MIN_STRETCH_M = 40.0


@dataclass
class Filling:
    """A city's blocks while they are filled."""

    plan: Plan  # plan, fleet, looks: of the city
    fleet: Fleet
    looks: Looks
    # pieces, solids, pads, spots: what was built so far; pads are x, y, z, radius
    pieces: list[Piece] = field(default_factory=list)
    solids: list[np.ndarray] = field(default_factory=list)
    pads: list[tuple[float, float, float, float]] = field(default_factory=list)
    spots: list[Spot] = field(default_factory=list)

    def add(self, house: House, x: float, y: float, yaw: float = 0.0) -> None:
        """Put a house with its lower left corner, or turned by 180 its upper right corner, at a point of the ground."""
        self.pieces.append(place(house.piece, (x, y, KERB_M), yaw))
        sign = -1 if yaw == 180 else 1
        # half a turn about z changes the sign of x and y: low and high corners change places
        boxes = house.solids * np.tile([sign, sign, 1], 2) + np.tile([x, y, KERB_M], 2)
        self.solids.append(
            np.concatenate([np.minimum(boxes[:, :3], boxes[:, 3:]), np.maximum(boxes[:, :3], boxes[:, 3:])], 1)
        )
        if house.pad:
            px, py, pz, radius = house.pad
            self.pads.append((x + sign * px, y + sign * py, pz + KERB_M, radius))


def choose_landmarks(blocks: list[Block], rng: Rng) -> dict[tuple[int, int], str]:
    """Which block bears which landmark; square and park lie towards the middle."""
    # blocks by their distance from the middle, with some chance in it
    middle = np.mean([(b.column, b.row) for b in blocks], axis=0)
    order = sorted(
        blocks, key=lambda b: (np.hypot(b.column - middle[0], b.row - middle[1]) + rng.uniform(0, 1.6), b.row, b.column)
    )
    # at least a block keeps ordinary houses
    count = min(len(LANDMARKS), max(1, len(blocks) - 1))
    step = max(1, len(blocks) // count)
    # the first two, square and park, take places in the inner half of that order
    chosen = [order[min(k * step // (2 if k < 2 else 1), len(order) - 1)] for k in range(count)]
    result: dict[tuple[int, int], str] = {}
    for block, name in zip(chosen, LANDMARKS, strict=False):
        result.setdefault((block.column, block.row), name)
    return result


@dataclass(frozen=True)
class Row:
    """A row of houses: its lower left corner, its extent, and whether it looks south (yaw 0) or north (180)."""

    x: float
    y: float
    width: float
    depth: float
    density: float
    yaw: float = 0.0


Area = tuple[float, float, float, float]
"""Lower left corner, width, depth."""


def fill_block(block: Block, landmark: str | None, filling: Filling, rng: Rng) -> None:
    """Build a block and everything on it."""
    looks, (width, depth), (x, y) = filling.looks, block.size, block.corner
    area, plan = (x, y, width, depth), filling.plan
    # 1 in the middle of the city, 0 at its edge
    centre, reach = (np.array(block.low) + block.high) / 2, np.array([plan.north[-1].at, plan.east[-1].at])
    density = float(np.clip(1.15 - np.abs(centre / reach).max() * 1.25, 0, 1))
    # the ground of the block
    yard: tuple[Skin, int] = (wall(looks, "roofing", (104, 104, 102)), SceneClass.GROUND)
    if landmark in ("square", "library"):
        yard = (plaza(looks), SceneClass.PAVEMENT)
    elif landmark in ("park", "church"):
        yard = (grass(looks), SceneClass.GRASS)
    filling.pieces.append(build_pavement(block, *yard, looks))
    # what stands on it
    if landmark == "square":
        _square(area, filling)
    elif landmark == "park":
        _park(area, filling, rng)
    elif landmark == "church":
        filling.add(church(looks), x + width / 2 - 8, y + 1.0)
        _scatter_trees(filling, area, 14, rng, keep=(x + width / 2, y + 20, 13.0), beside_m=13.5)
    elif landmark == "parking":
        cars = [vehicle.piece for vehicle in filling.fleet.private]
        w = min(width, 48.0)
        filling.add(parking_house(w, min(depth, 34.0), looks, cars, rng), x, y)
        if width - w > 8:
            _build_row(Row(x + w, y, width - w, min(16.0, depth), density), filling, rng)
    elif landmark == "site":
        filling.add(building_site(width, depth, looks, rng), x, y)
    elif landmark == "library":
        w = min(width - 8, 38.0)
        filling.add(library(w, min(depth - 16, 26.0), looks, rng), x + (width - w) / 2, y + 12.0)
        flags = np.array([(x + width / 2 + dx, y + 3.0, KERB_M) for dx in (-16, 16)])
        filling.pieces += [place(flag(looks, k), flags[k : k + 1]) for k in range(2)]
    else:
        _build_rows(area, landmark, density, filling, rng)


def _build_rows(area: Area, landmark: str | None, density: float, filling: Filling, rng: Rng) -> None:
    x, y, width, depth = area
    # pumps take the corner, and rows of houses fill the rest
    if landmark == "station":
        filling.add(filling_station(24.0, filling.looks), x + 2, y + 1)
        _build_row(Row(x + 28, y, width - 28, 15.0, density), filling, rng)
        _build_row(Row(x, y + depth, width, 15.0, density, 180.0), filling, rng)
        return
    # front and back row leave a yard between them; a cinema takes the left end of the front row
    front, back = (float(v) for v in rng.uniform(13.5, 17.5, 2))
    taken = 24.0 if landmark == "cinema" else 0.0
    if taken:
        filling.add(cinema(taken, front, filling.looks, rng), x, y)
    _build_row(Row(x + taken, y, width - taken, front, density), filling, rng)
    _build_row(Row(x, y + depth, width, back, density, 180.0), filling, rng)
    _fill_yard((x, y + front, width, depth - front - back), filling, rng)


def _fill_yard(area: Area, filling: Filling, rng: Rng) -> None:
    """Parked cars, a few trees and dustbins between the backs of the houses."""
    x, y, width, depth = area
    standing: Standing = {}
    if depth < 8:
        return
    # a row of bays along each side, or a single row in a narrow yard
    rows = (y + 3.6, y + depth - 3.6) if depth > 13 else (y + depth / 2,)
    for px, py in ((px, py) for px in np.arange(x + 4.5, x + width - 4.5, 3.4) for py in rows):
        # half of the places stay empty; three in ten hold a car
        kind = rng.random()
        if kind < 0.3:
            vehicle = filling.fleet.private[int(rng.integers(len(filling.fleet.private)))]
            filling.pieces.append(place(vehicle.piece, (px, py, KERB_M), 90.0))
        elif kind < 0.42:
            standing.setdefault(f"tree:{rng.integers(4)}", []).append((px, py, KERB_M, rng.uniform(0, 360)))
        elif kind < 0.5:
            standing.setdefault("dustbins", []).append((px, py, KERB_M, rng.uniform(0, 360)))
    filling.pieces.append(build_standing(standing, filling.looks))


def _build_row(row: Row, filling: Filling, rng: Rng) -> None:
    widths = []
    left = row.width
    while left >= 0.5:
        w = float(np.round(rng.uniform(10.0, 21.0), 1))
        # no gap narrower than a house is left at the row's end
        w = left if left - w < 9.0 else w
        widths.append(w)
        left = round(left - w, 3)
    at = 0.0
    for k, w in enumerate(widths):
        # the first and last house of a row also have a side street
        ends = [side for side, here in (("left", k == 0), ("right", k == len(widths) - 1)) if here]
        # houses are higher towards the middle of the city
        floors = int(np.clip(rng.normal(3.4 + 3.0 * row.density, 1.2), 2, 9))
        kind = _choose_kind(row.density, w, rng)
        if kind == "glass":
            floors = int(np.clip(rng.normal(7 + 6 * row.density, 2.5), 5, 16))
        # pads fit only large flat roofs
        pad = kind in ("glass", "slab") and min(w, row.depth) >= 13 and rng.random() < 0.8
        house = KINDS[kind](Lot(w, row.depth, floors, ("front", *ends), pad), filling.looks, rng)
        # rows that face the other way are filled from their other end
        sign, start = (1, row.x) if row.yaw == 0.0 else (-1, row.x + row.width)
        filling.add(house, start + sign * at, row.y, row.yaw)
        # a billboard on a roof in ten
        if not pad and rng.random() < 0.1 and w > 10:
            top = float(house.solids[:, 5].max()) + KERB_M
            middle = np.array([(start + sign * (at + w / 2), row.y + sign * 1.2, top)])
            filling.pieces.append(place(billboard(int(rng.integers(6)), filling.looks), middle, row.yaw))
        at += w


def _choose_kind(density: float, width: float, rng: Rng) -> str:
    shares = {
        "brick": 0.36, "render": 0.2, "stone": 0.16, "slab": 0.08, "warehouse": 0.12 * (1 - density),
        "glass": (0.06 + 0.3 * density) if width > 12 else 0.0,
    }  # fmt: skip
    total = np.array(list(shares.values()))
    return list(shares)[int(rng.choice(len(total), p=total / total.sum()))]


def _scatter_trees(
    filling: Filling, area: Area, count: int, rng: Rng, *, keep: tuple[float, float, float],
    beside_m: float = 0.0,
) -> None:  # fmt: skip
    """Trees over an area outside a circle (x, y, radius), and further than `beside_m` to its sides."""
    x, y, width, depth = area
    standing: Standing = {}
    # places are drawn for all, and those near the clearing are left out
    for _ in range(count):
        px, py = x + rng.uniform(2.5, width - 2.5), y + rng.uniform(2.5, depth - 2.5)
        if np.hypot(px - keep[0], py - keep[1]) > keep[2] + 4 and abs(px - keep[0]) > beside_m:
            standing.setdefault(f"tree:{rng.integers(4)}", []).append((px, py, KERB_M, rng.uniform(0, 360)))
    filling.pieces.append(build_standing(standing, filling.looks))


def _square(area: Area, filling: Filling) -> None:
    """A paved square: a free middle, a fountain and a monument, benches, trees along its edge, flags, stalls."""
    (x, y, width, depth), looks = area, filling.looks
    # the free middle is a place for objects; its radius leaves the edges to what stands there
    cx, cy = x + width / 2, y + depth / 2
    radius = min(width, depth) / 2 - 8.5
    filling.spots.append(Spot("square", "square", (cx, cy, KERB_M), round(radius, 2), 0.0, "ground"))
    # fountain and monument stand beside the free middle, if the square is wide enough
    left, right = cx - radius - 6.5, cx + radius + 6.5
    if left - 4.5 > x:
        filling.pieces.append(place(fountain(looks), (left, cy, KERB_M)))
        filling.pieces.append(place(monument(looks), (right, cy, KERB_M)))
    standing: Standing = {}
    # trees, lamps and benches along the long sides, small things along the others
    for k, px in enumerate(np.arange(x + 3, x + width - 2, 7.0)):
        for py, yaw in ((y + 2.6, 180.0), (y + depth - 2.6, 0.0)):
            standing.setdefault(f"tree:{k % 4}", []).append((px, py, KERB_M, 50.0 * k))
            standing.setdefault("bench" if k % 2 else "old-lamp", []).append((px + 3.5, py, KERB_M, yaw))
    for k, py in enumerate(np.arange(y + 8, y + depth - 8, 5.0)):
        for px in (x + 2.4, x + width - 2.4):
            standing.setdefault(("planter", "bin", "cafe", "newspapers")[k % 4], []).append((px, py, KERB_M, 90.0))
    filling.pieces.append(build_standing(standing, filling.looks))


def _park(area: Area, filling: Filling, rng: Rng) -> None:
    """A lawn with trees, shrubs, benches and lamps about a clearing."""
    (x, y, width, depth), looks = area, filling.looks
    cx, cy = x + width / 2, y + depth / 2
    radius = min(width, depth) / 2 - 11.0
    filling.spots.append(Spot("park", "grass", (cx, cy, KERB_M), round(radius, 2), 90.0, "ground"))
    _scatter_trees(filling, area, 46, rng, keep=(cx, cy, radius))
    # a path along each side of the clearing; each lies a little higher, so that crossings do not flicker
    gravel = wall(looks, "render", (196, 176, 140))
    paths = [(x, cy - radius - 3.2, x + width, cy - radius - 1.2), (x, cy + radius + 1.2, x + width, cy + radius + 3.2)]
    paths += [
        (cx - radius - 3.2, y, cx - radius - 1.2, y + depth),
        (cx + radius + 1.2, y, cx + radius + 3.2, y + depth),
    ]
    for k, rect in enumerate(paths):
        filling.pieces.append(floor_quads([rect], KERB_M + 0.008 + 0.004 * k, gravel, SceneClass.PAVEMENT))
    standing: Standing = {}
    # benches, lamps, shrubs and bins in turn about the clearing
    for k in range(10):
        angle = 2 * np.pi * k / 10
        px, py = cx + (radius + 1.8) * np.cos(angle), cy + (radius + 1.8) * np.sin(angle)
        standing.setdefault(("bench", "old-lamp", "shrub:1", "bin")[k % 4], []).append(
            (px, py, KERB_M, np.degrees(angle) - 90)
        )
    filling.pieces.append(build_standing(standing, filling.looks))


def build_city(seed: int = 0, blocks: tuple[int, int] = BLOCKS) -> World:
    """City number `seed`, the same everywhere.

    Args:
        blocks: how many from west to east and from south to north; 5 x 6 are about 450 m across.
    """
    rng = Rng([seed, 20])
    looks = Looks(seed)
    plan = plan_city(rng, *blocks, STREET_NAMES)
    fleet = build_fleet(looks)
    filling = Filling(plan, fleet, looks)
    landmarks = choose_landmarks(plan.blocks(), rng)
    # each block has its own draws: a change in a block moves nothing in others
    for block in plan.blocks():
        place_rng = Rng([seed, 21, block.column, block.row])
        fill_block(block, landmarks.get((block.column, block.row)), filling, place_rng)
    # places for objects and landing pads
    spots = [*filling.spots, *_street_spots(plan, rng)]
    pads = [
        Spot(f"pad-{k + 1}", "roof", (round(x, 3), round(y, 3), round(z, 3)), round(r - 0.2, 2), 0.0, "roof")
        for k, (x, y, z, r) in enumerate(filling.pads)
    ]
    # the core lies between the outermost streets
    core = np.array([(plan.north[0].at, plan.east[0].at), (plan.north[-1].at, plan.east[-1].at)])
    pieces = [
        *filling.pieces, build_streets(plan, looks),
        place_vehicles(plan, fleet, Rng([seed, 22])),
        furnish_streets(plan, looks, Rng([seed, 23])),
        hang_wires(plan, looks),
        _outskirts(plan, looks, Rng([seed, 24])),
    ]  # fmt: skip
    mesh, face_class = mesh_of(merge(*pieces), looks)
    return World(
        "city", seed, mesh, face_class, spots=tuple(spots + pads),
        solids=np.concatenate([np.zeros((0, 6)), *filling.solids]), core=core, pads=tuple(pads),
    )  # fmt: skip


def _street_spots(plan: Plan, rng: Rng) -> list[Spot]:
    """Free stretches of street and free crossings; they are reserved in the plan."""
    spots = []
    stretches = [s for s in plan.stretches() if s.length > MIN_STRETCH_M]
    # streets inside the city, not at its edge, if there are any
    inner = [s for s in stretches if np.abs((s.start + s.end) / 2).max() < 0.8 * plan.east[-1].at]
    stretches = inner or stretches
    order = rng.permutation(len(stretches))
    for k, index in enumerate(order[:STREET_SPOTS]):
        stretch = stretches[index]
        x, y = (float(v) for v in np.round((stretch.start + stretch.end) / 2, 3))
        radius = stretch.street.half + PAVEMENT_M - 1.7
        spots.append(Spot(f"street-{k + 1}", "street", (x, y, 0.0), round(radius, 2), stretch.yaw_deg, "ground"))
    cells = [(n, e) for n in plan.north[1:-1] or plan.north for e in plan.east[1:-1] or plan.east]
    # the widest crossings, and of equal widths the nearest to the middle
    cells.sort(key=lambda cell: (-min(cell[0].half, cell[1].half), abs(cell[0].at) + abs(cell[1].at)))
    for k, (north, east) in enumerate(cells[:CROSSING_SPOTS]):
        radius = min(north.half, east.half) + 0.3
        spots.append(Spot(f"crossing-{k + 1}", "crossing", (north.at, east.at, 0.0), round(radius, 2), 90.0, "ground"))
    plan.reserved += [(spot.position[0], spot.position[1], spot.free_radius_m) for spot in spots]
    return spots


def _outskirts(plan: Plan, looks: Looks, rng: Rng) -> Piece:
    # the ground beyond the modelled blocks
    low = np.array([plan.north[0].at - plan.north[0].half, plan.east[0].at - plan.east[0].half])
    high = np.array([plan.north[-1].at + plan.north[-1].half, plan.east[-1].at + plan.east[-1].half])
    pieces = [surround(np.stack([low, high]), HORIZON_M, junction(looks), SceneClass.ROAD)]
    # block edges, carried on to the horizon
    columns = _carry_on(
        [(a.at + a.half, b.at - b.half) for a, b in zip(plan.north[:-1], plan.north[1:], strict=True)], low[0], high[0]
    )
    rows = _carry_on(
        [(a.at + a.half, b.at - b.half) for a, b in zip(plan.east[:-1], plan.east[1:], strict=True)], low[1], high[1]
    )
    # streets run on beyond the last crossing
    for streets, k in ((plan.north, 1), (plan.east, 0)):
        for street in streets:
            for start, end in ((high[k], high[k] + FAR_STREET_M), (low[k], low[k] - FAR_STREET_M)):
                a, b = np.array([(street.at, start), (street.at, end)])[:, :: 1 if k else -1]
                pieces.append(carry_on(Stretch(a, b, street, street), looks))
    # rows of plain towers on both sides of each outer block
    bases, lows, highs = [], [], []
    for x0, x1 in columns:
        for y0, y1 in rows:
            if x0 > low[0] and x1 < high[0] and y0 > low[1] and y1 < high[1]:
                continue
            far = max(low[0] - x1, x0 - high[0], low[1] - y1, y0 - high[1])
            bases.append((x0, y0, x1, y1))
            x = x0 + PAVEMENT_M
            while x < x1 - PAVEMENT_M - 8:
                w = min(rng.uniform(12, 24), x1 - PAVEMENT_M - x)
                for y, d in ((y0 + PAVEMENT_M, rng.uniform(13, 17)), (y1 - PAVEMENT_M, -rng.uniform(13, 17))):
                    tall = rng.random() < 0.12 and far > 60
                    height = 3.3 * (rng.integers(9, 26) if tall else rng.integers(3, 8)) + 0.5
                    lows.append((x, min(y, y + d), 0.0))
                    highs.append((x + w, max(y, y + d), height))
                x += w
    # pavements under the towers
    base = np.array(bases)
    flat_low, flat_high = (
        np.column_stack([base[:, :2], np.zeros(len(base))]),
        np.column_stack([base[:, 2:], np.full(len(base), KERB_M)]),
    )
    pieces.append(boxes(flat_low, flat_high, pavement(looks), SceneClass.PAVEMENT))
    pieces.append(towers(np.array(lows), np.array(highs), looks, rng))
    return merge(*pieces)


def _carry_on(inner: list[tuple[float, float]], low: float, high: float) -> list[tuple[float, float]]:
    """Block edges along an axis, carried on beyond both ends towards the horizon."""
    pitch, gap = 70.0, 14.0
    outer = int((HORIZON_M - 250) // (pitch + gap))
    west = [(low - (k + 1) * pitch - k * gap, low - k * (pitch + gap)) for k in range(outer)]
    east = [(high + k * (pitch + gap), high + (k + 1) * pitch + k * gap) for k in range(outer)]
    return [*west[::-1], *inner, *east]
