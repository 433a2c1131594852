"""A harbour: a quay with cranes and containers, sheds, ships and boats on the water.

A hull lies along x, its bow to +x, its waterline at z = 0.
"""

import numpy as np

from toolkit.rooms.worlds.content import pieces as kit
from toolkit.rooms.worlds.content.countryside import towers
from toolkit.rooms.worlds.content.drawing import Canvas, Colour, Rng
from toolkit.rooms.worlds.content.landmarks import tower_crane
from toolkit.rooms.worlds.content.modelling import revolve
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin, painted
from toolkit.rooms.worlds.content.street_furniture import board, sheet, street_lamp, traffic_cone
from toolkit.rooms.worlds.content.surfaces import (
    BRICKS,
    MARK_M,
    STONES,
    concrete_apron,
    pane_sheet,
    pane_uv,
    wall,
    water,
)
from toolkit.rooms.worlds.content.vehicles import BLUE, RED, lorry, van
from toolkit.rooms.worlds.world import SceneClass, Spot, World

WATER_Z = -2.2
F, B, V = SceneClass.FURNITURE, SceneClass.BUILDING, SceneClass.VEHICLE
BOX_M = (12.19, 2.44, 2.6)
LINES: tuple[tuple[Colour, str], ...] = (
    ((160, 50, 36), "NORDLINE"), ((30, 78, 140), "BLUE STAR"), ((40, 110, 84), "EVERSEA"), ((206, 130, 30), "HAPAX"),
    ((186, 186, 182), "POLAR"), ((110, 40, 60), "MAGENTA"),
)  # fmt: skip
HORIZON_M = 1000.0
QUAY_X, QUAY_BACK_Y = 160.0, 90.0


def container_skin(looks: Looks, line: int) -> Skin:
    """Corrugated steel with the line's name, a long side of a container."""
    colour, name = LINES[line]

    def paint(_: Rng) -> np.ndarray:
        canvas = Canvas(BOX_M[0], BOX_M[2], 40, colour)
        # corrugations, darker in their folds
        for k in range(44):
            canvas.rect(0.1 + 0.275 * k, 0.15, 0.22 + 0.275 * k, BOX_M[2] - 0.12, tuple(int(c * 0.78) for c in colour))
        canvas.text(BOX_M[0] / 2, 1.45, name, 1.3, (238, 238, 232), fit_m=8)
        canvas.text(11.2, 2.2, "22G1", 0.24, (238, 238, 232))
        return canvas.texture(0.08, looks.rng(name))

    return looks.paint(f"container-{name}", paint, 0.6, BOX_M[:1] + BOX_M[2:])


def container(looks: Looks, line: int, label: int = F) -> Piece:
    """A 40-foot box about the middle of its base."""
    length, width, height = BOX_M
    colour = LINES[line][0]
    # the frame is a little darker than the colour of the shipping line
    skin, frame = container_skin(looks, line), looks.plain(tuple(int(c * 0.85) for c in colour))
    side = kit.wall_quads((-length / 2, 0.0, length / 2, height), 0.0, skin, label, fit=True)
    # posts at the four corners, and four locking rods at the end
    posts = np.array([(sx * (length / 2) - 0.08, sy * (width / 2) - 0.08, 0) for sx in (-1, 1) for sy in (-1, 1)])
    rods = np.array([(length / 2 + 0.03, y, 0.15) for y in (-0.7, -0.25, 0.25, 0.7)])
    # corrugated sides on a plain box
    return kit.merge(
        kit.boxes((-length / 2, -width / 2 + 0.02, 0.0), (length / 2, width / 2 - 0.02, height), frame, label),
        kit.place(side, [(0, -width / 2, 0), (0, width / 2, 0)], [0.0, 180.0]),
        kit.boxes(posts, posts + [0.16, 0.16, height + 0.02], frame, label),
        kit.bars(rods, rods + [0, 0, 2.3], 0.05, looks.plain((170, 170, 166)), label),
    )


def hull(
    length: float, beam: float, looks: Looks, *, side: float, draught: float, colours: tuple[Colour, Colour],
    bow: float = 0.24,
) -> Piece:  # fmt: skip
    """A hull along x, bow to +x, its waterline at z = 0: topsides, boot top, deck."""
    share = np.linspace(0, 1, 15)
    x = -length / 2 + length * share
    # half the beam along the hull: fullest amidships, rounded to a point at the bow
    half = beam / 2 * np.clip((1 - share) / bow, 0, 1) ** 0.6 * np.minimum(1, 0.82 + share * 1.5)
    # the deck's edge rises towards the bow, and the stem leans forward
    sheer = side * (1 + 0.35 * np.clip((share - 0.65) / 0.35, 0, 1) ** 2)
    rake = length * 0.03 * np.clip((share - 0.7) / 0.3, 0, 1)
    low, waterline = (kit.xyz(x - rake, half * 0.86, -draught), kit.xyz(x, half * 0.96, 0.4))
    rail = kit.xyz(x + rake, half, sheer)
    flip = np.array([1, -1, 1])
    pieces = []
    # two bands: the boot top below the waterline's mark, the topsides above
    for a, b, colour in ((low, waterline, colours[1]), (waterline, rail, colours[0])):
        starboard = np.stack([a[:-1] * flip, a[1:] * flip, b[1:] * flip, b[:-1] * flip], 1)
        port = np.stack([a[1:], a[:-1], b[:-1], b[1:]], 1)
        stern = np.array([[a[0], a[0] * flip, b[0] * flip, b[0]]])
        pieces.append(kit.quads(np.concatenate([starboard, port, stern]), looks.plain(colour, "gloss"), V))
    deck = rail - [0, 0, 0.5 if side > 2 else 0.12]
    pieces.append(kit.quads(
        np.stack([deck[:-1] * flip, deck[1:] * flip, deck[1:], deck[:-1]], 1),
        looks.plain((150, 110, 76), "matte"), V,
    ))  # fmt: skip
    inner = np.stack([rail[1:] * flip, rail[:-1] * flip, deck[:-1] * flip, deck[1:] * flip], 1)
    pieces.append(kit.quads(np.concatenate([inner, (inner * flip)[:, ::-1]]), looks.plain((214, 210, 200)), V))
    return kit.merge(*pieces)


def _house(x: tuple[float, float], width: float, z: float, decks: int, looks: Looks) -> Piece:
    white, glass = looks.plain((236, 236, 230)), looks.plain((40, 58, 70), "gloss")
    pieces = []
    # a deck after the other, each a little smaller
    for k in range(decks):
        shrink = 0.5 * k
        a, b, w, z0 = x[0] + 0.2 * k, x[1] - shrink, width / 2 - 0.2 * k, z + 2.6 * k
        pieces.append(kit.box((a, b), (-w, w), (z0, z0 + 2.6), white, V))
        # windows forward, and along both sides
        cells = np.arange(-w + 0.4, w - 0.7, 1.1)
        pieces.append(kit.boxes(kit.xyz(b - 0.02, cells, z0 + 1.3), kit.xyz(b + 0.02, cells + 0.7, z0 + 2.1), glass, V))
        cells = np.arange(a + 0.4, b - 0.8, 1.2)
        for y in (-w, w):
            pieces.append(
                kit.boxes(kit.xyz(cells, y - 0.02, z0 + 1.3), kit.xyz(cells + 0.7, y + 0.02, z0 + 2.1), glass, V)
            )
    return kit.merge(*pieces)


def feeder_ship(looks: Looks, rng: Rng) -> Piece:
    """A feeder container ship 110 m long at the quay."""
    # bays along the ship, rows across, up to three containers high
    boxes_at, kinds = [], []
    for bay in range(5):
        for row in range(6):
            for level in range(int(rng.integers(1, 4))):
                boxes_at.append((-22 + bay * 13.2, -6.3 + row * 2.5, 6.6 + level * 2.62))
                kinds.append(int(rng.integers(len(LINES))))
    at, kind = np.array(boxes_at), np.array(kinds)
    # containers of a line are copies of each other
    cargo = [kit.place(container(looks, k, V), at[kind == k]) for k in range(len(LINES))]
    funnel = kit.revolved([(2.2, 0), (1.9, 7), (1.5, 7.2), (1.5, 7.0)], 14, looks.plain((24, 60, 130)), V)
    # hull, cargo, the house astern with its funnel, and masts
    return kit.merge(
        hull(112.0, 18.0, looks, side=7.0, draught=5.0, colours=((28, 44, 82), (140, 36, 32))),
        *cargo, _house((-50, -36), 16.0, 6.6, 5, looks), funnel.moved(-46, 0, 19.0),
        kit.bars([(-40, 0, 19), (48, 0, 8)], [(-40, 0, 30), (48, 0, 18)], 0.4, looks.plain((210, 208, 200)), V),
    )  # fmt: skip


def boats(looks: Looks, rng: Rng) -> Piece:
    """Fishing boats, a tug, yachts at moorings."""
    spar, sail = looks.plain((222, 218, 206)), looks.plain((240, 236, 224), "matte")
    # a fishing boat with house and mast
    fisher = kit.merge(
        hull(15.0, 4.6, looks, side=2.0, draught=1.4, colours=((36, 96, 150), (150, 44, 36))),
        _house((-5.5, -1.5), 3.2, 1.6, 2, looks),
        kit.bars(
            [(1, 0, 1.5), (1, 0, 7), (-6.5, -1.5, 2), (-6.5, 1.5, 2)],
            [(1, 0, 8.5), (6, 0, 3.5), (-6.5, -0.8, 5.5), (-6.5, 0.8, 5.5)],
            0.14, spar, V,
        ),
        kit.box((-6.6, -6.4), (-1.0, 1.0), (5.3, 5.6), spar, V),
    )  # fmt: skip
    # a tug with a funnel
    tug = kit.merge(
        hull(24.0, 8.5, looks, side=3.0, draught=3.0, colours=((30, 32, 36), (150, 40, 34))),
        _house((-5, 5), 5.6, 2.5, 2, looks),
        kit.revolved([(1.0, 7.6), (0.9, 11.0), (0.6, 11.0)], 12, looks.plain((226, 150, 30)), V),
    )
    # a yacht, moored without sails or sailing with two
    jib = np.array([
        [(4.6, 0, 1.4), (0.4, 0.02, 1.8), (0.3, 0.02, 11.0), (0.3, 0.02, 11.0)],
        [(0.0, 0, 1.9), (-4.4, 0.1, 1.9), (0.0, 0, 12.6), (0.0, 0, 12.6)],
    ])  # fmt: skip
    yacht = kit.merge(
        hull(10.5, 3.2, looks, side=1.1, draught=0.8, colours=((238, 238, 234), (30, 52, 110)), bow=0.45),
        kit.box((-2.0, 1.6), (-0.9, 0.9), (0.9, 1.5), looks.plain((236, 236, 232)), V),
        kit.bars([(0.2, 0, 0.9), (0.2, 0, 1.8)], [(0.2, 0, 13.2), (-4.5, 0, 1.8)], 0.12, spar, V),
    )
    sailing = kit.merge(yacht, kit.quads(np.concatenate([jib, jib[:, [0, 2, 1, 1]] + [0, 0.01, 0]]), sail, V))
    # in two rows off the quay
    moored = np.array([(108.0 + 6.5 * k, -36.0 - 9.0 * (k % 2), WATER_Z) for k in range(6)])
    return kit.merge(
        kit.place(fisher, [(18.0, -5.0, WATER_Z), (95.0, -6.0, WATER_Z)], [0.0, 180.0]),
        kit.place(tug, (-90.0, -62.0, WATER_Z), 18.0),
        kit.place(yacht, moored, np.array([88.0, 92.0] * 3)),
        kit.place(
            sailing, [(10.0, -150.0, WATER_Z), (-130.0, -210.0, WATER_Z), (80.0, -240.0, WATER_Z)], [30.0, 150.0, 200.0]
        ),
    )


def build_harbour(seed: int = 0) -> World:
    """A quay 320 m long with the water to its south."""
    looks, rng = Looks(seed), Rng([seed, 32])
    core = np.array([(-QUAY_X, -110.0), (QUAY_X, QUAY_BACK_Y)])
    # sheds in three colours of brick
    sheds = [_shed(looks, 44.0, 24.0, k) for k in range(3)]
    shed_x = (-120.0, -40.0, 70.0)
    solids = [[x, 62.0, 0, x + 44.0, 86.0, 9.0] for x in shed_x]
    stacks, stack_solids = _container_yard(looks, rng)
    # quay, sheds, cranes and ships
    pieces = [
        _quay(looks), _sea(looks), _quay_marks(looks),
        *(shed.moved(x, 62.0, 0) for shed, x in zip(sheds, shed_x, strict=True)),
        stacks,
        kit.place(_gantry(looks), [(-92.0, 12.0, 0.0), (-20.0, 12.0, 0.0)]),
        tower_crane(looks, 30.0, 28.0).moved(132, 30, 0),
        feeder_ship(looks, rng).moved(-58.0, -19.0, WATER_Z),
        boats(looks, rng), _pier(looks), lighthouse(looks).moved(150.0, -104.0, WATER_Z), _quay_things(looks),
        _town(looks, rng),
    ]  # fmt: skip
    # places for objects, on land and on water
    spots = (
        Spot("quay-1", "quay", (62.0, 22.0, 0.0), 13.0, 0.0, "ground"),
        Spot("quay-2", "quay", (100.0, 22.0, 0.0), 12.0, 90.0, "ground"),
        Spot("apron", "quay", (30.0, 48.0, 0.0), 9.5, 0.0, "ground"),
        Spot("basin-1", "water", (40.0, -45.0, WATER_Z), 16.0, 0.0, "water"),
        Spot("basin-2", "water", (-20.0, -80.0, WATER_Z), 18.0, 30.0, "water"),
    )
    mesh, face_class = kit.mesh_of(kit.merge(*pieces), looks)
    return World("harbour", seed, mesh, face_class, spots, np.array([*solids, *stack_solids]), core)


def _quay(looks: Looks) -> Piece:
    x, back = QUAY_X, QUAY_BACK_Y
    concrete, stone = concrete_apron(looks), wall(looks, "ashlar", STONES[3])
    # tyres along the wall as fenders every 10 m, ladders every 40 m, bollards every 20 m
    ring = revolve([(0.3, -0.15), (0.55, -0.15), (0.6, 0), (0.55, 0.15), (0.3, 0.15), (0.3, -0.15)], 14)
    tyre = kit.solid([ring.rotated("x", 90)], looks.plain((28, 28, 30), "matte"), F)
    tyres = np.array([(px, -0.2, -0.9) for px in np.arange(-x + 5, x, 10.0)])
    rungs = np.array([(px, -0.12, z) for px in np.arange(-x + 20, x, 40.0) for z in np.arange(-2.2, 0, 0.3)])
    profile = [(0.22, 0), (0.2, 0.35), (0.34, 0.42), (0.34, 0.52), (0.01, 0.6)]
    bollard = kit.revolved(profile, 12, looks.plain((226, 176, 30)), F)
    edge = looks.plain((226, 190, 40), "matte")
    land = [(-HORIZON_M, back, HORIZON_M, back + HORIZON_M), (-HORIZON_M, 0, -x, back), (x, 0, HORIZON_M, back)]
    return kit.merge(
        kit.floor_quads((-x, 0.5, x, back), 0.0, concrete, SceneClass.GROUND),
        kit.floor_quads(np.array(land), 0.0, wall(looks, "render", (186, 178, 160)), SceneClass.GROUND),
        kit.wall_quads((-HORIZON_M, -6.0, HORIZON_M, 0.0), 0.0, stone, SceneClass.GROUND),
        kit.boxes((-x, 0.0, 0.0), (x, 0.5, 0.18), edge, SceneClass.GROUND),
        kit.place(tyre, tyres),
        kit.bars(rungs - [0.25, 0, 0], rungs + [0.25, 0, 0], 0.05, looks.plain((90, 70, 60)), F),
        kit.place(bollard, [(px, 1.4, 0.0) for px in np.arange(-x + 10, x, 20.0)]),
    )


def _sea(looks: Looks) -> Piece:
    rings = [
        (-HORIZON_M, -HORIZON_M, HORIZON_M, -260.0), (-HORIZON_M, -260.0, -260.0, 0.0), (260.0, -260.0, HORIZON_M, 0.0),
        (-260.0, -260.0, 260.0, 0.0),
    ]  # fmt: skip
    return kit.floor_quads(np.array(rings), WATER_Z, water(looks), SceneClass.WATER)


def _quay_marks(looks: Looks) -> Piece:
    x, steel, yellow = QUAY_X, looks.plain((96, 92, 88)), looks.plain((214, 170, 50), "matte")
    rails = [(-x, y - 0.07, x, y + 0.07) for y in (4.0, 20.0)]
    lines = [(-x, y - 0.1, x, y + 0.1) for y in (2.6, 31.0, 58.0)]
    return kit.merge(
        kit.floor_quads(np.array(rails), 0.02, steel, SceneClass.GROUND),
        kit.floor_quads(np.array(lines), MARK_M, yellow, SceneClass.GROUND),
    )


def _container_yard(looks: Looks, rng: Rng) -> tuple[Piece, list[list[float]]]:
    # stacks of up to four, some places empty; the first is never empty
    length, width, height = BOX_M
    at, line, solids = [], [], []
    for column in range(5):
        for row in range(5):
            x, y = -152.0 + column * 14.5, 36.0 + row * 2.9
            count = int(rng.integers(0, 5)) if (column, row) != (0, 0) else 3
            for level in range(count):
                at.append((x + length / 2, y + width / 2, level * (height + 0.02)))
                line.append(int(rng.integers(len(LINES))))
            # a stack is solid up to its top
            if count:
                solids.append([x, y, 0, x + length, y + width, count * height])
    spots, kind = np.array(at), np.array(line)
    return kit.merge(*[kit.place(container(looks, k), spots[kind == k]) for k in range(len(LINES))]), solids


def _gantry(looks: Looks) -> Piece:
    red, grey = looks.plain((186, 44, 36)), looks.plain((170, 172, 172))
    # legs on bogies, braced across
    legs = np.array([(x, y, 0.9) for x in (-8, 8) for y in (-8, 8)], float)
    top = legs + [0, 0, 30]
    cross = [((x, -8, z), (x, 8, z)) for x in (-8, 8) for z in (12.0, 31.0)] + [
        ((-8, y, z), (8, y, z)) for y in (-8, 8) for z in (12.0, 31.0)
    ]
    cross += [((x, -8, 12), (x, 8, 31)) for x in (-8, 8)]
    braces = np.array(cross, float)
    # a boom over the water, held by ties from the mast
    beam = np.array([((x, -46, 32.5), (x, 22, 32.5)) for x in (-2, 2)], float)
    ties = np.array([((x, 0, 46), (x, y, 33)) for x in (-2, 2) for y in (-42, -22, 18)], float)
    mast = np.array([((x, y, 31), (x * 0.25, 0, 46)) for x in (-8, 8) for y in (-8, 8)], float)
    # trolley wires with a spreader
    rungs = np.array([((-2, y, 32.5), (2, y, 32.5)) for y in range(-46, 23, 4)], float)
    wires = np.array([((x, y, 32), (x, y, 16.4)) for x in (-2, 2) for y in (-24, -22)], float)
    bogies = np.array([(x, y, 0.0) for x in (-8, 8) for y in (-8, 8)], float)
    pieces = [
        kit.bars(legs, top, 1.1, red, F), kit.bars(braces[:, 0], braces[:, 1], 0.8, red, F),
        kit.bars(beam[:, 0], beam[:, 1], 1.2, red, F), kit.bars(ties[:, 0], ties[:, 1], 0.25, grey, F),
        kit.bars(mast[:, 0], mast[:, 1], 0.7, red, F), kit.bars(rungs[:, 0], rungs[:, 1], 0.3, red, F),
        kit.bars(wires[:, 0], wires[:, 1], 0.08, looks.plain((40, 40, 42)), F),
        kit.boxes(bogies - [1.6, 0.5, 0], bogies + [1.6, 0.5, 0.9], grey, F),
        kit.box((-3, 3), (10, 18), (33.1, 36.5), grey, F),
        kit.box((2.2, 4.2), (-25, -22), (29, 31.6), looks.plain((70, 96, 112), "gloss"), F),
        kit.box((-6.1, 6.1), (-24, -22), (16.0, 16.4), looks.plain((236, 176, 30)), F),
    ]  # fmt: skip
    return kit.merge(*pieces)


@painted("planks", 0.9, (3.0, 3.0))
def planks(rng: Rng) -> np.ndarray:
    """The boards of a pier, 3 m square."""
    canvas = Canvas(3, 3, 72, (60, 48, 38))
    for k in range(15):
        canvas.rect(0, 0.2 * k, 3, 0.2 * k + 0.185, tuple(int(c * rng.uniform(0.8, 1.15)) for c in (140, 118, 92)))
    return canvas.texture(0.06, rng)


def _pier(looks: Looks) -> Piece:
    # two rows of piles down to the bottom, and a railing on the water's side
    piles = np.array([(x, y, -7.0) for x in (101.0, 104.6) for y in np.arange(-58.0, 0.0, 6.0)])
    rail = np.array([((105.0, -60.0, z), (105.0, 0.0, z)) for z in (0.5, 1.0)])
    posts = np.array([(105.0, y, -0.3) for y in np.arange(-60.0, 0.1, 3.0)])
    return kit.merge(
        kit.boxes((100.6, -60.0, -0.45), (105.0, 0.0, -0.2), planks(looks), SceneClass.PAVEMENT),
        kit.bars(piles, piles + [0, 0, 6.7], 0.4, looks.plain((84, 70, 58)), F),
        kit.bars(rail[:, 0], rail[:, 1], 0.07, looks.plain((230, 228, 220)), F),
        kit.bars(posts, posts + [0, 0, 1.35], 0.09, looks.plain((230, 228, 220)), F),
    )


def lighthouse(looks: Looks) -> Piece:
    """A banded tower 22 m high on a mole of stone."""
    stone = wall(looks, "ashlar", STONES[3])
    # white and red bands, which narrow upwards
    tones = [looks.plain(tone) for tone in ((236, 236, 230), (190, 34, 34))]
    bands = [
        kit.revolved([(2.6 - 0.055 * z, 2.6 + z), (2.6 - 0.055 * (z + 4), 6.6 + z)], 20, tones[k % 2], B)
        for k, z in enumerate((0, 4, 8, 12))
    ]
    # mole, tower, gallery, lamp and roof
    return kit.merge(
        kit.revolved([(9.0, -4.0), (6.5, 2.6), (0.01, 2.6)], 20, stone, SceneClass.GROUND, 20),
        *bands,
        kit.revolved([(1.7, 18.6), (2.4, 18.8), (2.4, 19.1), (1.3, 19.1)], 20, looks.plain((40, 42, 44)), B),
        kit.revolved([(1.2, 19.1), (1.2, 21.2)], 14, looks.plain((255, 236, 170), "lamp"), B),
        kit.revolved([(1.5, 21.2), (0.9, 22.2), (0.01, 22.8)], 14, looks.plain((190, 34, 34)), B),
    )


def _shed(looks: Looks, width: float, depth: float, number: int) -> Piece:
    brick, tin = wall(looks, "brick", BRICKS[number]), wall(looks, "cladding", (140, 144, 146))
    door, panes = looks.plain(((40, 84, 110), (110, 48, 40), (60, 96, 70))[number]), pane_sheet(looks, "factory")
    # four bays side by side
    bays = np.linspace(0, width, 5)
    middle = (bays[1:] + bays[:-1]) / 2
    rng = looks.rng(f"shed-{number}")
    # windows above the doors, a door in each bay
    face = kit.upright([(x - 2.4, 5.0, x + 2.4, 7.2) for x in middle], -0.05)
    canvas = Canvas(9, 1.2, 48, (236, 232, 220))
    canvas.text(4.5, 0.6, f"SHED {number + 4} · CITY DOCKS", 0.9, (40, 44, 60), fit_m=8.4)
    words = sheet(f"shed-{number}", looks, canvas)
    low, high = (kit.xyz(middle - 2.0, -0.1, 0.0), kit.xyz(middle + 2.0, 0.0, 4.2))
    # a pitched roof over each bay: its two slopes, and the gables at both ends
    ridge = np.array([
        [(a, -0.3, 9), (m, -0.3, 11.6), (m, depth + 0.3, 11.6), (a, depth + 0.3, 9)]
        for a, m in zip(bays[:-1], middle, strict=True)
    ])  # fmt: skip
    fall = np.array([
        [(m, -0.3, 11.6), (b, -0.3, 9), (b, depth + 0.3, 9), (m, depth + 0.3, 11.6)]
        for m, b in zip(middle, bays[1:], strict=True)
    ])  # fmt: skip
    gables = np.array([
        [(a, 0, 9), (b, 0, 9), (m, 0, 11.5), (m, 0, 11.5)]
        for a, m, b in zip(bays[:-1], middle, bays[1:], strict=True)
    ])  # fmt: skip
    return kit.merge(
        kit.boxes((0, 0, 0), (width, depth, 9.0), brick, B, ("bottom", "top")),
        kit.quads(np.concatenate([ridge, fall]), tin, SceneClass.ROOF),
        kit.quads(gables, brick, B), kit.quads(gables[:, ::-1] + [0, depth, 0], brick, B),
        kit.boxes(low, high, door, B, ("back",)),
        kit.quads(face, panes, B, pane_uv(rng, 4)),
        board(9, 1.2, words, SceneClass.SIGN, 0.0, both=False).moved(width / 2, -0.06, 8.2),
    )  # fmt: skip


def _quay_things(looks: Looks) -> Piece:
    red, blue = (
        lorry(looks, "lorry-red", RED, (238, 236, 228), "MOVERS"),
        lorry(looks, "lorry-blue", BLUE, (40, 90, 160), "FRESH FISH"),
    )
    white, crate = van((236, 236, 232), "PORT AUTHORITY", looks, "van-port"), looks.plain((176, 134, 84), "matte")
    # lamps along a line, pallets with crates of several heights
    lamps = np.array([(x, 60.0, 0.0) for x in np.arange(-140.0, 150.0, 40.0)])
    pallets = np.array([(130.0 + 1.6 * (k % 4), 44.0 + 1.6 * (k // 4), 0.0) for k in range(12)])
    heights = np.array([[0.0, 0.0, 0.4 + 0.3 * (k % 4)] for k in range(12)])
    return kit.merge(
        kit.place(red.piece, [(-70.0, 26.0, 0), (10.0, 54.0, 0)], [0.0, 90.0]),
        kit.place(blue.piece, [(-10.0, 26.0, 0), (84.0, 55.0, 0)], [180.0, 90.0]),
        kit.place(white.piece, (118.0, 42.0, 0), 30.0), kit.place(street_lamp(looks), lamps),
        kit.boxes(pallets, pallets + [1.2, 1.2, 0.1] + heights, crate, F),
        kit.place(traffic_cone(looks), [(44.0 + 2 * k, 5.0, 0.0) for k in range(5)]),
    )  # fmt: skip


def _town(looks: Looks, rng: Rng) -> Piece:
    x = np.arange(-520.0, 520.0, 26.0)
    low, high = [], []
    for row, y in enumerate((112.0, 150.0, 205.0, 280.0)):
        keep = rng.random(len(x)) < 0.8
        for px in x[keep]:
            w, d, h = rng.uniform(12, 24), rng.uniform(12, 18), 3.3 * rng.integers(2, 5 + 3 * row)
            low.append((px, y, 0.0))
            high.append((px + w, y + d, h))
    return towers(np.array(low), np.array(high), looks, rng)
