"""What fills the blocks of a city: rows of houses round a yard, landmarks, a square, a park."""

from dataclasses import dataclass, field

import numpy as np

from toolkit.worlds.building_site import building_site
from toolkit.worlds.buildings import KINDS, House, Lot
from toolkit.worlds.church import church
from toolkit.worlds.classes import SceneClass
from toolkit.worlds.fleet import Fleet
from toolkit.worlds.grounds import grass, plaza
from toolkit.worlds.landmarks import cinema, filling_station, library, parking_house
from toolkit.worlds.monuments import flag, fountain, monument
from toolkit.worlds.pieces import Looks, Piece, Skin, floor_quads, place
from toolkit.worlds.plan import KERB_M, Block, Plan
from toolkit.worlds.signs import billboard
from toolkit.worlds.streets import build_pavement
from toolkit.worlds.traffic import Standing, build_standing
from toolkit.worlds.walls import wall
from toolkit.worlds.world import Spot

LANDMARKS = ("square", "church", "parking", "site", "library", "park", "cinema", "station")


@dataclass
class Filling:
    """What the blocks were filled with so far."""

    pieces: list[Piece] = field(default_factory=list)
    solids: list[np.ndarray] = field(default_factory=list)
    pads: list[tuple[float, float, float, float]] = field(default_factory=list)
    spots: list[Spot] = field(default_factory=list)

    def add(self, house: House, x: float, y: float, yaw: float = 0.0) -> None:
        """Put a house with its lower left corner, or turned by 180 its upper right one, at a point of the ground."""
        self.pieces.append(place(house.piece, np.array([(x, y, KERB_M)]), yaw))
        sign = -1 if yaw == 180 else 1
        boxes = house.solids * np.tile([sign, sign, 1], 2) + np.tile([x, y, KERB_M], 2)
        self.solids.append(
            np.concatenate([np.minimum(boxes[:, :3], boxes[:, 3:]), np.maximum(boxes[:, :3], boxes[:, 3:])], 1)
        )
        if house.pad:
            px, py, pz, radius = house.pad
            self.pads.append((x + sign * px, y + sign * py, pz + KERB_M, radius))


def choose_landmarks(blocks: list[Block], rng: np.random.Generator) -> dict[tuple[int, int], str]:
    """Which block bears which landmark; square and park lie towards the middle."""
    middle = np.mean([(b.column, b.row) for b in blocks], axis=0)
    order = sorted(
        blocks, key=lambda b: (np.hypot(b.column - middle[0], b.row - middle[1]) + rng.uniform(0, 1.6), b.row, b.column)
    )
    count = min(len(LANDMARKS), max(1, len(blocks) - 1))
    step = max(1, len(blocks) // count)
    chosen = [order[min(k * step // (2 if k < 2 else 1), len(order) - 1)] for k in range(count)]
    result: dict[tuple[int, int], str] = {}
    for block, name in zip(chosen, LANDMARKS, strict=False):
        result.setdefault((block.column, block.row), name)
    return result


def fill_block(
    block: Block,
    landmark: str | None,
    filling: Filling,
    plan: Plan,
    fleet: Fleet,
    looks: Looks,
    rng: np.random.Generator,
) -> None:
    """Build a block and everything on it."""
    width, depth = block.size
    x, y = block.corner
    yard: tuple[Skin, int] = (wall(looks, "roofing", (104, 104, 102)), SceneClass.GROUND)
    if landmark in ("square", "library"):
        yard = (plaza(looks), SceneClass.PAVEMENT)
    elif landmark in ("park", "church"):
        yard = (grass(looks), SceneClass.GRASS)
    filling.pieces.append(build_pavement(block, *yard, looks))
    density = _density(block, plan)
    if landmark == "square":
        _square(x, y, width, depth, filling, looks, rng)
    elif landmark == "park":
        _park(x, y, width, depth, filling, looks, rng)
    elif landmark == "church":
        filling.add(church(looks), x + width / 2 - 8, y + 1.0)
        _scatter_trees(filling, looks, rng, (x, y, width, depth), 14, keep=(x + width / 2, y + 20, 13.0), dense=22.0)
    elif landmark == "parking":
        cars = [vehicle.piece for vehicle in fleet.private]
        w = min(width, 48.0)
        filling.add(parking_house(w, min(depth, 34.0), looks, cars, rng), x, y)
        if width - w > 8:
            _row(x + w, y, width - w, min(16.0, depth), density, filling, looks, rng, 0.0)
    elif landmark == "site":
        filling.add(building_site(width, depth, looks, rng), x, y)
    elif landmark == "library":
        w = min(width - 8, 38.0)
        filling.add(library(w, min(depth - 16, 26.0), looks, rng), x + (width - w) / 2, y + 12.0)
        flags = np.array([(x + width / 2 + dx, y + 3.0, KERB_M) for dx in (-16, 16)])
        filling.pieces += [place(flag(looks, k), flags[k : k + 1]) for k in range(2)]
    elif landmark == "station":
        filling.add(filling_station(24.0, looks), x + 2, y + 1)
        _row(x + 28, y, width - 28, 15.0, density, filling, looks, rng, 0.0)
        _row(x, y, width, 15.0, density, filling, looks, rng, 180.0, depth)
    else:
        front, back = (float(v) for v in rng.uniform(13.5, 17.5, 2))
        if landmark == "cinema":
            filling.add(cinema(24.0, front, looks, rng), x, y)
            _row(x + 24, y, width - 24, front, density, filling, looks, rng, 0.0)
        else:
            _row(x, y, width, front, density, filling, looks, rng, 0.0)
        _row(x, y, width, back, density, filling, looks, rng, 180.0, depth)
        _yard((x, y + front, width, depth - front - back), filling, fleet, looks, rng)


def _yard(
    area: tuple[float, float, float, float], filling: Filling, fleet: Fleet, looks: Looks, rng: np.random.Generator
) -> None:
    """Parked cars, a few trees and dustbins between the backs of the houses."""
    x, y, width, depth = area
    standing: Standing = {}
    if depth < 8:
        return
    for px in np.arange(x + 6, x + width - 6, 5.5):
        kind, py = rng.random(), y + depth / 2 + rng.uniform(-0.5, 0.5) * (depth - 7)
        if kind < 0.3:
            vehicle = fleet.private[int(rng.integers(len(fleet.private)))]
            filling.pieces.append(place(vehicle.piece, np.array([(px, py, KERB_M)]), 90.0))
        elif kind < 0.6:
            standing.setdefault(f"tree:{rng.integers(4)}", []).append((px, py, KERB_M, rng.uniform(0, 360)))
        elif kind < 0.75:
            standing.setdefault("dustbins", []).append((px, py, KERB_M, rng.uniform(0, 360)))
    filling.pieces.append(build_standing(standing, looks))


def _density(block: Block, plan: Plan) -> float:
    """1 in the middle of the city, 0 at its edge."""
    centre = (np.array(block.low) + block.high) / 2
    reach = np.array([plan.north[-1].at, plan.east[-1].at])
    return float(np.clip(1.15 - np.abs(centre / reach).max() * 1.25, 0, 1))


def _row(
    x: float,
    y: float,
    width: float,
    depth: float,
    density: float,
    filling: Filling,
    looks: Looks,
    rng: np.random.Generator,
    yaw: float,
    block_depth: float = 0.0,
) -> None:
    """A row of houses side by side along a street, to the south (yaw 0) or to the north (yaw 180) of a block."""
    widths = []
    left = width
    while left > 0:
        w = float(np.round(rng.uniform(10.0, 21.0), 1))
        w = left if left - w < 9.0 else w
        widths.append(w)
        left = round(left - w, 3)
        if left < 0.5:
            break
    at = 0.0
    for k, w in enumerate(widths):
        streets = ["front"]
        first, last = k == 0, k == len(widths) - 1
        if first:
            streets.append("left")
        if last:
            streets.append("right")
        floors = int(np.clip(rng.normal(3.4 + 3.0 * density, 1.2), 2, 9))
        kind = _choose_kind(density, w, depth, rng)
        if kind == "glass":
            floors = int(np.clip(rng.normal(7 + 6 * density, 2.5), 5, 16))
        pad = kind in ("glass", "slab") and min(w, depth) >= 13 and rng.random() < 0.8
        house = KINDS[kind](Lot(w, depth, floors, tuple(streets), pad), looks, rng)
        if yaw == 0.0:
            filling.add(house, x + at, y)
        else:
            filling.add(house, x + width - at, y + block_depth, 180.0)
        if not pad and rng.random() < 0.1 and w > 10:
            top = float(house.solids[:, 5].max()) + KERB_M
            sign = 1 if yaw == 0.0 else -1
            bx = x + at + w / 2 if yaw == 0.0 else x + width - at - w / 2
            by = y + 1.2 if yaw == 0.0 else y + block_depth - 1.2
            filling.pieces.append(
                place(billboard(int(rng.integers(6)), looks), np.array([(bx, by, top)]), 0.0 if sign > 0 else 180.0)
            )
        at += w


def _choose_kind(density: float, width: float, depth: float, rng: np.random.Generator) -> str:
    shares = {
        "brick": 0.36,
        "render": 0.2,
        "stone": 0.16,
        "slab": 0.08,
        "warehouse": 0.12 * (1 - density),
        "glass": (0.06 + 0.3 * density) if width > 12 else 0.0,
    }
    total = np.array(list(shares.values()))
    return list(shares)[int(rng.choice(len(total), p=total / total.sum()))]


def _scatter_trees(
    filling: Filling,
    looks: Looks,
    rng: np.random.Generator,
    area: tuple[float, float, float, float],
    count: int,
    keep: tuple[float, float, float],
    dense: float = 0.0,
) -> None:
    """Trees over an area (x, y, width, depth) outside a circle; `dense` also keeps a column about it free."""
    x, y, width, depth = area
    standing: Standing = {}
    for _ in range(count):
        px, py = x + rng.uniform(2.5, width - 2.5), y + rng.uniform(2.5, depth - 2.5)
        if np.hypot(px - keep[0], py - keep[1]) > keep[2] + 4 and (not dense or abs(px - keep[0]) > 13.5):
            standing.setdefault(f"tree:{rng.integers(4)}", []).append((px, py, KERB_M, rng.uniform(0, 360)))
    filling.pieces.append(build_standing(standing, looks))


def _square(
    x: float, y: float, width: float, depth: float, filling: Filling, looks: Looks, rng: np.random.Generator
) -> None:
    """A paved square: a free middle, a fountain and a monument, benches, trees along its edge, flags, stalls."""
    cx, cy = x + width / 2, y + depth / 2
    radius = min(width, depth) / 2 - 8.5
    filling.spots.append(Spot("square", "square", (cx, cy, KERB_M), round(radius, 2), 0.0, "ground"))
    left, right = cx - radius - 6.5, cx + radius + 6.5
    if left - 4.5 > x:
        filling.pieces.append(place(fountain(looks), np.array([(left, cy, KERB_M)])))
        filling.pieces.append(place(monument(looks), np.array([(right, cy, KERB_M)])))
    standing: Standing = {}
    for k, px in enumerate(np.arange(x + 3, x + width - 2, 7.0)):
        for py, yaw in ((y + 2.6, 180.0), (y + depth - 2.6, 0.0)):
            standing.setdefault(f"tree:{k % 4}", []).append((px, py, KERB_M, 50.0 * k))
            standing.setdefault("bench" if k % 2 else "old-lamp", []).append((px + 3.5, py, KERB_M, yaw))
    for k, py in enumerate(np.arange(y + 8, y + depth - 8, 5.0)):
        for px in (x + 2.4, x + width - 2.4):
            standing.setdefault(("planter", "bin", "cafe", "newspapers")[k % 4], []).append((px, py, KERB_M, 90.0))
    filling.pieces.append(build_standing(standing, looks))


def _park(
    x: float, y: float, width: float, depth: float, filling: Filling, looks: Looks, rng: np.random.Generator
) -> None:
    """A lawn with trees, shrubs, benches and lamps about a clearing."""
    cx, cy = x + width / 2, y + depth / 2
    radius = min(width, depth) / 2 - 11.0
    filling.spots.append(Spot("park", "grass", (cx, cy, KERB_M), round(radius, 2), 90.0, "ground"))
    _scatter_trees(filling, looks, rng, (x, y, width, depth), 46, keep=(cx, cy, radius))
    gravel = wall(looks, "render", (196, 176, 140))
    paths = [(x, cy - radius - 3.2, x + width, cy - radius - 1.2), (x, cy + radius + 1.2, x + width, cy + radius + 3.2)]
    paths += [
        (cx - radius - 3.2, y, cx - radius - 1.2, y + depth),
        (cx + radius + 1.2, y, cx + radius + 3.2, y + depth),
    ]
    for k, rect in enumerate(paths):
        filling.pieces.append(floor_quads(np.array([rect]), KERB_M + 0.008 + 0.004 * k, gravel, SceneClass.PAVEMENT))
    standing: Standing = {}
    for k in range(10):
        angle = 2 * np.pi * k / 10
        px, py = cx + (radius + 1.8) * np.cos(angle), cy + (radius + 1.8) * np.sin(angle)
        standing.setdefault(("bench", "old-lamp", "shrub:1", "bin")[k % 4], []).append(
            (px, py, KERB_M, np.degrees(angle) - 90)
        )
    filling.pieces.append(build_standing(standing, looks))
