"""Carriageways, crossings, junctions, kerbs and pavements of a plan, as geometry."""

import numpy as np

from toolkit.content.grounds import CROSSING_M, crossing, junction, kerb, pavement, road
from toolkit.content.pieces import Looks, Piece, Skin, floor_quads, merge, place, quads
from toolkit.content.plan import KERB_M, PAVEMENT_M, Block, Plan, Stretch
from toolkit.worlds.classes import SceneClass

ROAD, PAVED = SceneClass.ROAD, SceneClass.PAVEMENT
KERB_WIDTH_M = 0.3
CORNER_M = 2.5
CORNER_STEPS = 6


def build_streets(plan: Plan, looks: Looks) -> Piece:
    """All that lies between the blocks."""
    pieces = [_carriageway(stretch, looks) for stretch in plan.stretches()]
    cells = [(n.at - n.half, e.at - e.half, n.at + n.half, e.at + e.half) for n in plan.north for e in plan.east]
    pieces.append(floor_quads(np.array(cells), 0.0, junction(looks), ROAD))
    return merge(*pieces)


def _carriageway(stretch: Stretch, looks: Looks) -> Piece:
    """The road of a stretch with a zebra crossing at each end."""
    avenue, half = stretch.street.avenue, stretch.street.half
    skin = road(looks, avenue)
    a, b = CROSSING_M, stretch.length - CROSSING_M
    turns = (b - a) / skin.tile_m[1]
    uv = np.array([(0, 0), (1, 0), (1, turns), (0, turns)])
    fitted = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    ahead = _strip(stretch, b, stretch.length, half)
    back = _strip(stretch, a, 0.0, -half)
    zebra = crossing(looks, avenue)
    return merge(
        quads(_strip(stretch, a, b, half), skin, ROAD, uv),
        quads(ahead, zebra, ROAD, fitted),
        quads(back, zebra, ROAD, fitted),
    )


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
    strips = [
        (x0 + r, y0 + w, x1 - r, y0 + p), (x0 + r, y1 - p, x1 - r, y1 - w), (x0 + w, y0 + p, x0 + p, y1 - p),
        (x1 - p, y0 + p, x1 - w, y1 - p), (x0 + w, y0 + r, x0 + r, y0 + p), (x1 - r, y0 + r, x1 - w, y0 + p),
        (x0 + w, y1 - p, x0 + r, y1 - r), (x1 - r, y1 - p, x1 - w, y1 - r),
    ]  # fmt: skip
    pieces = [
        floor_quads(np.array(strips), z, slabs, PAVED),
        floor_quads((x0 + p, y0 + p, x1 - p, y1 - p), z, inside, label),
    ]
    for k, (x, y) in enumerate(((x0, y0), (x1, y0), (x1, y1), (x0, y1))):
        span = (x1 - x0, y1 - y0)[k % 2] - 2 * r
        edge = merge(_straight_kerb(span, stone).moved(r, 0, 0), _round_corner(slabs, stone, junction(looks)))
        pieces.append(place(edge, (x, y, 0.0), 90.0 * k))
    return merge(*pieces)


def _straight_kerb(length: float, stone: Skin) -> Piece:
    """Along x from 0, the road towards -y."""
    w, z = KERB_WIDTH_M, KERB_M
    face = [(0, 0, 0), (length, 0, 0), (length, 0, z), (0, 0, z)]
    top = [(0, 0, z), (length, 0, z), (length, w, z), (0, w, z)]
    return quads([face, top], stone, PAVED)


def _round_corner(slabs: Skin, stone: Skin, asphalt: Skin) -> Piece:
    """The lower left corner of a block: a quarter of a disc of slabs in a bent kerb, and the road outside it."""
    r, w, z = CORNER_M, KERB_WIDTH_M, KERB_M
    angle = np.linspace(np.pi, 1.5 * np.pi, CORNER_STEPS + 1)
    ring = np.round(np.column_stack([np.cos(angle), np.sin(angle)]), 9)
    outer, inner = r + ring * r, r + ring * (r - w)

    def at(points: np.ndarray, height: float) -> np.ndarray:
        return np.column_stack([points, np.full(len(points), height)])

    face = np.stack([at(outer[:-1], 0), at(outer[1:], 0), at(outer[1:], z), at(outer[:-1], z)], 1)
    top = np.stack([at(outer[:-1], z), at(outer[1:], z), at(inner[1:], z), at(inner[:-1], z)], 1)
    centre = np.full((CORNER_STEPS, 3), (r, r, z))
    disc = np.stack([at(inner[:-1], z), at(inner[1:], z), centre, centre], 1)
    gap = np.stack([at(outer[1:], 0), at(outer[:-1], 0), np.zeros((CORNER_STEPS, 3)), np.zeros((CORNER_STEPS, 3))], 1)
    return merge(quads(np.concatenate([face, top]), stone, PAVED), quads(disc, slabs, PAVED), quads(gap, asphalt, ROAD))
