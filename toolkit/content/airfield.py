"""An airfield's apron with its hangars, tower and ground vehicles."""

from itertools import pairwise

import numpy as np

from toolkit.content.buildings import landing_pad
from toolkit.content.countryside import HORIZON_M, hills, shrub, surround, tree_line, windsock
from toolkit.content.drawing import Canvas, Colour, fractal, hex_name
from toolkit.content.large_vehicles import lorry, van
from toolkit.content.pieces import (
    Looks,
    Piece,
    Skin,
    bars,
    box,
    boxes,
    floor_quads,
    merge,
    mesh_of,
    place,
    polygon,
    quads,
    revolved,
    upright,
    xyz,
)
from toolkit.content.signs import board, sheet
from toolkit.content.street_furniture import barrier, flag, traffic_cone
from toolkit.content.surfaces import (
    MARK_M,
    WHITE_PAINT,
    YELLOW_PAINT,
    concrete_apron,
    grass,
    junction,
    pane_sheet,
    pane_uv,
    wall,
)
from toolkit.content.vehicles import CAR_COLOURS, SEDAN, car
from toolkit.objects.mesh import Material
from toolkit.worlds.world import SceneClass, Spot, World

F, B = SceneClass.FURNITURE, SceneClass.BUILDING


def build_apron(seed: int = 0) -> World:
    """An airfield's apron 260 m by 150 m: slabs, taxi lines, stands, hangars, a tower, vehicles, a runway."""
    looks, rng = Looks(seed), np.random.default_rng([seed, 31])
    concrete = concrete_apron(looks)
    core = np.array([(-130.0, -75.0), (130.0, 75.0)])
    stands = np.array([-84.0, -28.0, 28.0, 84.0])
    pieces = [
        floor_quads((-130, -75, 130, 75), 0.0, concrete, SceneClass.GROUND),
        surround(core, HORIZON_M, grass(looks), SceneClass.GRASS, (0.0, 60.0, 300.0)),
        floor_quads([(-600, -190, 600, -145), (-130, -145, -105, -75.0)], 0.01, junction(looks), SceneClass.ROAD),
        _marks(looks, stands), _runway_marks(looks), _stand_numbers(looks, stands),
    ]  # fmt: skip
    solids = []
    for k, x in enumerate((-92.0, -36.0, 30.0)):
        hangar = _hangar(looks, 46.0, 34.0, 13.0 + k, ((126, 142, 156), (188, 190, 186), (92, 116, 104))[k], k + 1)
        pieces.append(hangar.moved(x, 58.0, 0))
        solids.append([x - 23.0, 58.0, 0, x + 23.0, 92.0, 8.0])
    pieces.append(_control_tower(looks).moved(92, 70, 0))
    solids += [[89.0, 67.0, 0, 95.0, 73.0, 22.0], [80.0, 62.0, 0, 104.0, 78.0, 7.0]]
    pieces += [_apron_things(looks, rng, stands), tree_line(looks, rng, 330.0, 480.0, 120), hills(looks, rng)]
    spots = [Spot(f"stand-{k + 1}", "apron", (float(x), 8.0, 0.0), 15.0, 90.0, "ground") for k, x in enumerate(stands)]
    spots.append(Spot("taxiway", "apron", (14.0, -55.0, 0.0), 14.0, 0.0, "ground"))
    spots.append(Spot("verge", "grass", (0.0, -110.0, 0.0), 20.0, 0.0, "ground"))
    pad = Spot("pad", "apron", (112.0, 20.0, 0.25), 6.8, 0.0, "ground")
    pieces.append(landing_pad(7.0, looks).moved(112, 20, 0))
    mesh, face_class = mesh_of(merge(*pieces), looks)
    return World("apron", seed, mesh, face_class, spots=(*spots, pad), solids=np.array(solids), core=core, pads=(pad,))


def _stripe(looks: Looks, points: list[tuple[float, float]], width: float, colour: Colour) -> Piece:
    path = np.array(points, float)
    ahead = np.diff(path, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.column_stack([-ahead[:, 1], ahead[:, 0]]) * width / 2
    corners = np.stack([path[:-1] + side, path[:-1] - side, path[1:] - side, path[1:] + side], 1)
    flat = np.concatenate([corners, np.full((*corners.shape[:2], 1), MARK_M)], 2)
    return quads(flat, _worn_paint(looks, colour), SceneClass.GROUND)


def _worn_paint(looks: Looks, colour: Colour) -> Skin:
    name = f"paint-{hex_name(colour)}"
    if found := looks.known(name):
        return found
    rng, shape = looks.rng(name), (128, 128)
    worn = np.clip(0.85 + 0.3 * fractal(rng, shape, 8, 4), 0.15, 1)[..., None]
    tone = np.array(colour, np.float32) * worn + np.array((150, 148, 142)) * (1 - worn)
    return looks.add(Material(name, tone.clip(0, 255).astype(np.uint8), 0.8), (3.0, 3.0))


def _marks(looks: Looks, stands: np.ndarray) -> Piece:
    angle = np.linspace(-np.pi / 2, 0, 9)
    pieces = [_stripe(looks, [(-130, -55), (130, -55)], 0.3, YELLOW_PAINT)]
    for x in stands:
        bend = [(x - 18 + 18 * np.cos(a), -37 + 18 * np.sin(a)) for a in angle]
        pieces.append(_stripe(looks, [(x - 40, -55), *bend, (x, 26)], 0.3, YELLOW_PAINT))
        pieces += [_stripe(looks, [(x + s * 19, -22), (x + s * 19, 34)], 0.2, WHITE_PAINT) for s in (-1, 1)]
        pieces.append(_stripe(looks, [(x - 1.6, 24), (x + 1.6, 24)], 0.5, YELLOW_PAINT))
    for y in (36.0, -72.0):
        pieces.append(_stripe(looks, [(-128, y), (128, y)], 0.25, (188, 40, 36)))
    pieces.append(
        _stripe(looks, [(-128, -73.5), (128, -73.5), (128, 73.5), (-128, 73.5), (-128, -73.5)], 0.3, YELLOW_PAINT)
    )
    return merge(*pieces)


def _runway_marks(looks: Looks) -> Piece:
    x = np.arange(-580.0, 580.0, 50.0)
    rects = np.concatenate([
        np.column_stack([x, np.full(len(x), -168.0), x + 30, np.full(len(x), -167.0)]),
        np.array([(-560.0, y, -530.0, y + 1.8) for y in np.arange(-187.0, -149.0, 3.6)]),
    ])  # fmt: skip
    return floor_quads(rects, 0.016, _worn_paint(looks, WHITE_PAINT), SceneClass.ROAD)


def _stand_numbers(looks: Looks, stands: np.ndarray) -> Piece:
    pieces = []
    for k, x in enumerate(stands):
        canvas = Canvas(3, 3, 64, (30, 30, 32))
        canvas.text(1.5, 1.5, f"A{k + 1}", 2.3, YELLOW_PAINT, fit_m=2.6)
        skin = sheet(f"stand-{k}", looks, canvas)
        pieces.append(floor_quads((x + 1.2, -30.0, x + 4.2, -27.0), MARK_M, skin, SceneClass.GROUND, fit=True))
    return merge(*pieces)


def _hangar(looks: Looks, width: float, depth: float, height: float, colour: Colour, number: int) -> Piece:
    """A hall with a round roof, big sliding doors half open, and its number; its front along y = 0, about x = 0."""
    skin, roof = wall(looks, "cladding", colour), wall(looks, "cladding", (164, 166, 166))
    eaves, half = 8.0, width / 2
    angle = np.linspace(0, np.pi, 15)
    arch = np.column_stack([half * np.cos(angle), eaves + (height - eaves) * np.sin(angle)])
    front = np.concatenate([[(half, eaves)], arch[1:]])
    ridge = xyz(arch[:, 0], 0.0, arch[:, 1])
    bow = np.stack([ridge[:-1], ridge[:-1] + [0, depth, 0], ridge[1:] + [0, depth, 0], ridge[1:]], 1)
    canvas = Canvas(6, 3, 48, colour)
    canvas.text(3, 1.5, f"H{number}", 2.4, (244, 244, 240))
    name = sheet(f"hangar-{number}", looks, canvas)
    leaves = np.linspace(-half + 1.0, half - 1.0, 9)
    open_from, open_to = 3, 5
    panels = [(a, b) for k, (a, b) in enumerate(pairwise(leaves)) if not open_from <= k < open_to]
    low = np.array([(a + 0.05, -0.25 - 0.2 * (k % 2), 0) for k, (a, _) in enumerate(panels)])
    high = np.array([(b - 0.05, -0.05 - 0.2 * (k % 2), 7.2) for k, (_, b) in enumerate(panels)])
    glass = looks.plain((96, 116, 128), "gloss")
    dark = looks.plain((36, 38, 40), "matte")
    back = merge(boxes((-half, -0.02, 0), (half, 0, eaves), skin, B), polygon(front, 0.0, skin, B))
    pieces = [
        boxes(low, high, skin, B),
        boxes(low * [1, 1, 0] + [0.4, -0.03, 4.6], high * [1, 0, 0] + low * [0, 1, 0] + [-0.4, 0, 5.9], glass, B),
        box((-half, half), (-0.4, 0.0), (7.2, 8.0), looks.plain((210, 208, 200)), B),
        polygon(front, 0.0, skin, B), place(back, (0, depth, 0.0), 180.0),
        boxes([(-half, 0, 0), (half - 0.3, 0, 0)], [(-half + 0.3, depth, eaves), (half, depth, eaves)], skin, B),
        quads(bow, roof, SceneClass.ROOF),
        quads(bow[:, ::-1] - [0, 0, 0.1], dark, SceneClass.ROOF),
        floor_quads((-half, 0, half, depth), 0.02, dark, SceneClass.GROUND),
        box((-half + 1.0, half - 1.0), (0.5, 0.6), (0, 7.2), dark, B),
        board(6, 3, name, SceneClass.SIGN, 0.0, both=False).moved(0, -0.05, eaves + 2.2),
    ]  # fmt: skip
    return merge(*pieces)


def _control_tower(looks: Looks) -> Piece:
    white, green = wall(looks, "render", (226, 222, 210)), looks.plain((96, 140, 136), "gloss")
    frame, glass = looks.plain((60, 64, 66)), pane_sheet(looks, "curtain-green")
    angle = np.radians(22.5) + np.linspace(0, 2 * np.pi, 9)
    low, high = ([xyz(r * np.cos(angle), r * np.sin(angle), z)] for r, z in ((3.6, 20.0), (4.4, 23.4)))
    cab = np.stack([low[0][:-1], low[0][1:], high[0][1:], high[0][:-1]], 1)
    cells = [(-12 + 2 * k, 2.6, -12 + 2 * k + 1.9, 5.6) for k in range(12)]
    face = upright(cells, -8.02)
    canvas = Canvas(10, 1.4, 48, (30, 74, 120))
    canvas.text(5, 0.7, "CITY AIRFIELD", 1.1, (244, 244, 240), fit_m=9)
    words = sheet("airfield", looks, canvas, 0.8)
    rng = looks.rng("tower")
    pieces = [
        boxes((-3, -3, 0), (3, 3, 19.0), white, B),
        revolved([(3.0, 18.6), (4.2, 19.2), (4.2, 20.0), (3.6, 20.0)], 16, looks.plain((206, 204, 198)), B),
        quads(cab, glass, B, pane_uv(rng, 8)), bars(low[0], high[0], 0.16, frame, B),
        revolved([(4.4, 23.4), (4.9, 23.5), (4.9, 24.0), (0.01, 24.6)], 16, looks.plain((210, 60, 44)), B),
        bars([(0, 0, 24.4), (1, 1, 24.3)], [(0, 0, 30.0), (1, 1, 27.0)], 0.1, frame, F),
        boxes((-12, -8, 0), (12, 8, 7), white, B), quads(face, glass, B, pane_uv(rng, 12)),
        box((-12.3, 12.3), (-8.5, 8.3), (7.0, 7.4), green, B),
        board(10, 1.4, words, SceneClass.SIGN, 0.0, both=False).moved(0, -8.56, 6.5),
    ]  # fmt: skip
    return merge(*pieces)


def _apron_things(looks: Looks, rng: np.random.Generator, stands: np.ndarray) -> Piece:
    fuel = lorry(looks, "fuel", (226, 226, 222), (206, 206, 204), "JET A-1 FUEL")
    follow = car(SEDAN, (248, 200, 20), looks, "follow")
    crew, fire = (
        van((236, 236, 232), "GROUND CREW", looks, "crew"),
        lorry(looks, "fire", (196, 24, 26), (196, 24, 26), "FIRE RESCUE"),
    )
    parked = car(SEDAN, CAR_COLOURS[5], looks, "staff")
    placed = [
        (fuel.piece, (-56, 20), 80.0), (follow.piece, (-6, -42), 10.0), (crew.piece, (57, 22), 95.0),
        (fire.piece, (62, 46), 270.0), (fire.piece, (68, 46), 270.0), (crew.piece, (2, 40), 0.0),
        (parked.piece, (78, 52), 90.0), (parked.piece, (82, 52), 90.0), (fuel.piece, (118, -30), 0.0),
    ]  # fmt: skip
    pieces = [place(piece, (*at, 0.0), yaw) for piece, at, yaw in placed]
    cones = np.array([(x + dx, dy, 0.0) for x in stands for dx, dy in ((-17, -9), (17, -9), (-17, 25), (17, 25))])
    pieces += [place(traffic_cone(looks), cones), place(barrier(looks), [(x + 21.5, 30.0, 0.0) for x in stands])]
    steel, lamp = looks.plain((150, 154, 156)), looks.plain((255, 250, 230), "lamp")
    for x in (-112.0, -56.0, 0.0, 56.0, 112.0):
        heads = np.array([(x + dx, 44.0, 17.6) for dx in (-1.5, -0.5, 0.5, 1.5)])
        pieces += [
            bars((x, 44.6, 0), (x, 44.6, 18.0), 0.3, steel, F),
            boxes(heads - [0.35, 0.15, 0.3], heads + [0.35, 0.3, 0.3], steel, F, ()),
            boxes(heads - [0.3, 0.17, 0.25], heads + [0.3, -0.15, 0.25], lamp, F, ()),
        ]
    tread = np.array([(-60.0, 30.0 - 0.3 * k, 0.4 + 0.22 * k) for k in range(14)])
    pieces += [
        boxes(tread, tread + [1.6, 0.32, 0.06], steel, F, ()),
        bars(
            tread[[0, 0]] + [[0, 0, 0], [1.6, 0, 0]], tread[[-1, -1]] + [[0, 0, 1], [1.6, 0, 1]], 0.08,
            looks.plain((40, 90, 160)), F,
        ),
    ]  # fmt: skip
    carts = np.array([(40.0 + 3.2 * k, 28.0, 0.0) for k in range(4)])
    pieces += [
        boxes(carts + [0, 0, 0.4], carts + [2.6, 1.5, 0.5], steel, F, ()),
        boxes(carts + [0.2, 0.1, 0.5], carts + [2.4, 1.4, 1.5], looks.plain((70, 90, 130)), F),
        boxes(carts + [0.2, 0.1, 0.0], carts + [0.5, 1.4, 0.4], looks.plain((24, 24, 26)), F),
        boxes(carts + [2.0, 0.1, 0.0], carts + [2.3, 1.4, 0.4], looks.plain((24, 24, 26)), F),
    ]
    posts = np.array([(x, -76.0, 0) for x in np.arange(-100.0, 131.0, 5.0)])
    pieces.append(bars(posts, posts + [0, 0, 0.5], 0.25, looks.plain((226, 120, 30)), F))
    pieces += [place(flag(looks, k), (80.0 + 4 * k, 58.0, 0)) for k in range(3)]
    return merge(
        *pieces,
        place(shrub(looks, 0), [(84.0 + 3 * k, 60.5, 0) for k in range(7)]),
        windsock(looks).moved(-120, -90, 0),
    )
