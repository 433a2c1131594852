"""The city: a grid of streets, houses and landmarks in relief, all that stands in them, and a skyline."""

import numpy as np

from toolkit.content.blocks import Filling, choose_landmarks, fill_block
from toolkit.content.fleet import build_fleet
from toolkit.content.grounds import junction, pavement
from toolkit.content.pieces import Looks, Piece, boxes, merge, mesh_of
from toolkit.content.plan import KERB_M, PAVEMENT_M, Plan, Stretch, plan_city
from toolkit.content.signs import STREET_NAMES
from toolkit.content.skyline import surround, towers
from toolkit.content.streets import build_streets, carry_on
from toolkit.content.traffic import furnish_streets, hang_wires, place_vehicles
from toolkit.worlds.classes import SceneClass
from toolkit.worlds.world import Spot, World

BLOCKS = (5, 6)
HORIZON_M, FAR_STREET_M = 900.0, 250.0
STREET_SPOTS, CROSSING_SPOTS = 6, 3
MIN_STRETCH_M = 40.0


def build_city(seed: int = 0, blocks: tuple[int, int] = BLOCKS) -> World:
    """City number `seed`, the same everywhere.

    Args:
        seed: of everything in it.
        blocks: how many from west to east and from south to north; 5 x 6 are about 450 m across.
    """
    rng = np.random.default_rng([seed, 20])
    looks = Looks(seed)
    plan = plan_city(rng, *blocks, STREET_NAMES)
    fleet = build_fleet(looks)
    filling = Filling(plan, fleet, looks)
    landmarks = choose_landmarks(plan.blocks(), rng)
    for block in plan.blocks():
        place_rng = np.random.default_rng([seed, 21, block.column, block.row])
        fill_block(block, landmarks.get((block.column, block.row)), filling, place_rng)
    spots = [*filling.spots, *_street_spots(plan, rng)]
    pads = [
        Spot(f"pad-{k + 1}", "roof", (round(x, 3), round(y, 3), round(z, 3)), round(r - 0.2, 2), 0.0, "roof")
        for k, (x, y, z, r) in enumerate(filling.pads)
    ]
    core = np.array([(plan.north[0].at, plan.east[0].at), (plan.north[-1].at, plan.east[-1].at)])
    pieces = [
        *filling.pieces,
        build_streets(plan, looks),
        place_vehicles(plan, fleet, np.random.default_rng([seed, 22])),
        furnish_streets(plan, looks, np.random.default_rng([seed, 23])),
        hang_wires(plan, looks),
        _outskirts(plan, looks, np.random.default_rng([seed, 24])),
    ]
    mesh, face_class = mesh_of(merge(*pieces), looks)
    return World(
        "city", seed, mesh, face_class, tuple(spots + pads),
        np.concatenate([np.zeros((0, 6)), *filling.solids]),
        core, tuple(pads),
    )  # fmt: skip


def _street_spots(plan: Plan, rng: np.random.Generator) -> list[Spot]:
    """Free stretches of street and free crossings; they are reserved in the plan."""
    spots = []
    stretches = [s for s in plan.stretches() if s.length > MIN_STRETCH_M]
    inner = [s for s in stretches if np.abs((s.start + s.end) / 2).max() < 0.8 * plan.east[-1].at]
    stretches = inner or stretches
    order = rng.permutation(len(stretches))
    for k, index in enumerate(order[:STREET_SPOTS]):
        stretch = stretches[index]
        x, y = (float(v) for v in np.round((stretch.start + stretch.end) / 2, 3))
        radius = stretch.street.half + PAVEMENT_M - 1.7
        spots.append(Spot(f"street-{k + 1}", "street", (x, y, 0.0), round(radius, 2), stretch.yaw_deg, "ground"))
    cells = [(n, e) for n in plan.north[1:-1] or plan.north for e in plan.east[1:-1] or plan.east]
    cells.sort(key=lambda cell: (-min(cell[0].half, cell[1].half), abs(cell[0].at) + abs(cell[1].at)))
    for k, (north, east) in enumerate(cells[:CROSSING_SPOTS]):
        radius = min(north.half, east.half) + 0.3
        spots.append(Spot(f"crossing-{k + 1}", "crossing", (north.at, east.at, 0.0), round(radius, 2), 90.0, "ground"))
    plan.reserved += [(spot.position[0], spot.position[1], spot.free_radius_m) for spot in spots]
    return spots


def _outskirts(plan: Plan, looks: Looks, rng: np.random.Generator) -> Piece:
    """Ground to the horizon, and blocks with painted facades on the grid carried on outwards."""
    low = np.array([plan.north[0].at - plan.north[0].half, plan.east[0].at - plan.east[0].half])
    high = np.array([plan.north[-1].at + plan.north[-1].half, plan.east[-1].at + plan.east[-1].half])
    pieces = [surround(np.stack([low, high]), HORIZON_M, junction(looks), SceneClass.ROAD)]
    columns = _carry_on(
        [(a.at + a.half, b.at - b.half) for a, b in zip(plan.north[:-1], plan.north[1:], strict=True)], low[0], high[0]
    )
    rows = _carry_on(
        [(a.at + a.half, b.at - b.half) for a, b in zip(plan.east[:-1], plan.east[1:], strict=True)], low[1], high[1]
    )
    for streets, k in ((plan.north, 1), (plan.east, 0)):
        for street in streets:
            for start, end in ((high[k], high[k] + FAR_STREET_M), (low[k], low[k] - FAR_STREET_M)):
                a, b = np.array([(street.at, start), (street.at, end)])[:, :: 1 if k else -1]
                pieces.append(carry_on(Stretch(a, b, street, street), looks))
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
    base = np.array(bases)
    flat_low, flat_high = (
        np.column_stack([base[:, :2], np.zeros(len(base))]),
        np.column_stack([base[:, 2:], np.full(len(base), KERB_M)]),
    )
    pieces.append(boxes(flat_low, flat_high, pavement(looks), SceneClass.PAVEMENT))
    pieces.append(towers(np.array(lows), np.array(highs), looks, rng))
    return merge(*pieces)


def _carry_on(inner: list[tuple[float, float]], low: float, high: float) -> list[tuple[float, float]]:
    """Block edges along one axis, carried on beyond both ends towards the horizon."""
    pitch, gap = 70.0, 14.0
    outer = int((HORIZON_M - 250) // (pitch + gap))
    west = [(low - (k + 1) * pitch - k * gap, low - k * (pitch + gap)) for k in range(outer)]
    east = [(high + k * (pitch + gap), high + (k + 1) * pitch + k * gap) for k in range(outer)]
    return [*west[::-1], *inner, *east]
