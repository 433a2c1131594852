"""Open country: trees, a distant skyline, a field of grass with a pad (paper, Figure 10d), an airfield's apron."""

from itertools import pairwise

import numpy as np

from toolkit.rooms.worlds.content import pieces as kit
from toolkit.rooms.worlds.content.buildings import landing_pad
from toolkit.rooms.worlds.content.drawing import Canvas, Colour, Rng, finish, flat, fractal, grain, hex_name, noise
from toolkit.rooms.worlds.content.modelling import tube
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin, painted
from toolkit.rooms.worlds.content.street_furniture import barrier, board, flag, sheet, traffic_cone
from toolkit.rooms.worlds.content.surfaces import (
    BRICKS,
    MARK_M,
    RENDERS,
    STONES,
    WHITE_PAINT,
    YELLOW_PAINT,
    concrete_apron,
    grass,
    junction,
    pane_sheet,
    pane_uv,
    wall,
)
from toolkit.rooms.worlds.content.vehicles import CAR_COLOURS, SEDAN, car, lorry, van
from toolkit.rooms.worlds.world import SceneClass, Spot, World

TREE = SceneClass.TREE
GREENS: tuple[Colour, ...] = ((74, 104, 42), (92, 118, 50), (58, 92, 46), (108, 120, 52))
CELLS = 4
FAR = SceneClass.SKYLINE
BAYS, FLOORS = 5, 4
BAY_M, FLOOR_M = 2.8, 3.3
STYLES: tuple[tuple[Colour, Colour, tuple[float, float]], ...] = (
    (BRICKS[0], (206, 198, 182), (0.42, 0.55)), (BRICKS[3], (176, 166, 150), (0.42, 0.52)),
    (STONES[0], (226, 222, 212), (0.46, 0.6)), (RENDERS[0], (232, 230, 222), (0.44, 0.56)),
    (BRICKS[5], (150, 140, 130), (0.4, 0.5)), ((110, 122, 136), (70, 78, 88), (0.94, 0.72)),
    ((74, 92, 104), (186, 190, 194), (0.94, 0.8)), (STONES[3], (120, 118, 114), (0.9, 0.5)),
)  # fmt: skip
HORIZON_M = 900.0
F, B = SceneClass.FURNITURE, SceneClass.BUILDING


MEADOWS = ((0.0, -28.0, 14.0, 90.0), (-30.0, 16.0, 13.0, 0.0), (-32.0, -22.0, 13.0, 45.0), (24.0, -14.0, 11.0, 160.0))
"""Places for objects besides the pad: x, y, free radius and yaw."""


@painted("bark", 0.95)
def bark(rng: Rng) -> np.ndarray:
    """Furrowed bark, 1 m square."""
    shape = (256, 256)
    # the fold of noise at 0 is a groove; many cells across and few down draw it out along the trunk
    furrow = np.abs(noise(rng, shape, (6, 34))) + 0.5 * np.abs(noise(rng, shape, (14, 60)))
    wood = flat(shape, (104, 90, 76)) * (0.62 + 0.6 * furrow)[..., None] + grain(rng, shape, 6)
    return finish(wood)


def leaf_sheet(looks: Looks, tone: int) -> Skin:
    """Leaves of many shades: one kite of foliage in each of `CELLS` x `CELLS` cells."""
    return looks.paint(f"leaves-{tone}", lambda rng: _paint_leaves(rng, GREENS[tone % len(GREENS)]), 0.8)


def _paint_leaves(rng: Rng, green: Colour) -> np.ndarray:
    side = 32
    shape = (CELLS * side, CELLS * side)
    # one shade for each cell, spread over its texels
    shade = np.kron(rng.uniform(0.62, 1.25, (CELLS, CELLS)), np.ones((side, side)))
    warm = np.kron(rng.normal(0, 8, (CELLS, CELLS)), np.ones((side, side)))
    speckle = 1 + 0.35 * fractal(rng, shape, 24, 3)
    leaves = flat(shape, green) * (shade * speckle)[..., None]
    leaves[..., 0] += warm
    return finish(leaves)


def leaves(at: np.ndarray, size_m: float, outward: np.ndarray, skin: Skin, rng: Rng) -> Piece:
    """Kites (n) round points, turned at random but rather outwards, seen from both sides by the renderer."""
    n = len(at)
    normal = outward * 1.2 + rng.normal(size=(n, 3)) * 0.8 + [0, 0, 0.4]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.cross(normal, rng.normal(size=(n, 3)))
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    across = np.cross(normal, along)
    size = size_m * rng.uniform(0.7, 1.35, (n, 1))
    corners = np.stack(
        [at - 0.6 * size * along, at + 0.4 * size * across, at + 0.7 * size * along, at - 0.4 * size * across], 1
    )
    cell = rng.integers(0, CELLS, (n, 2)) / CELLS
    # well inside of the cell: blurred look-ups mix in no neighbour
    uv = cell[:, None] + np.array([(0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8)]) / CELLS
    piece = kit.quads(corners, skin, TREE, uv)
    # foliage is lit as a soft whole: normals lean out of the crown
    soft = np.repeat(outward * 1.4 + normal, 4, axis=0)
    soft /= np.maximum(np.linalg.norm(soft, axis=1, keepdims=True), 1e-6)
    flipped = np.einsum("ij,ij->i", soft, piece.normals) < 0
    # a normal on the far side of its face would light the leaf from behind
    soft[flipped] = piece.normals[flipped]
    return Piece(piece.vertices, soft.astype(np.float32), piece.uv, piece.faces, piece.material, piece.label)


def street_tree(looks: Looks, variant: int, height: float = 8.0, count: int = 430) -> Piece:
    """A broad-leaved tree: trunk, limbs, and clumps of leaves about the limbs' ends."""
    rng = looks.rng(f"tree-{variant}")
    fork = height * 0.33
    lean = rng.normal(0, 0.15, 2)
    trunk = np.array([
        (0, 0, 0), (*(lean * 0.4), fork * 0.5), (*lean, fork), (*(lean * 1.5), height * 0.6),
        (*(lean * 1.6), height * 0.8),
    ])  # fmt: skip
    parts = tube(trunk, [0.2, 0.16, 0.14, 0.08, 0.03], 6)
    tips = [np.array([*(lean * 1.6), height * 0.84])]
    # limbs: shorter towards the top
    for k in range(8):
        # 2.4 rad is the golden angle: no limb grows straight above another
        turn = 2.4 * k + rng.uniform(-0.3, 0.3)
        start = np.array([*lean, fork + (0.05 + 0.045 * k) * height])
        reach = height * rng.uniform(0.2, 0.32) * (1 - 0.05 * k)
        way = np.array([np.cos(turn), np.sin(turn), 0])
        tip = start + way * reach + [0, 0, height * rng.uniform(0.12, 0.26)]
        parts += tube(
            np.array([start, start + way * reach * 0.5 + [0, 0, height * 0.06], tip]), [0.075, 0.05, 0.02], 4, cap=False
        )
        tips.append(tip)
    pieces = [kit.solid(parts, bark(looks), TREE, 60)]
    skin = leaf_sheet(looks, variant)
    centre = np.array([*lean, height * 0.62])
    each = count // len(tips)
    at, away = [], []
    # a clump about each tip, an ellipsoid a little flatter than a ball; leaves look out of the clump and of the crown
    for tip in tips:
        ball = rng.normal(size=(each, 3))
        ball /= np.linalg.norm(ball, axis=1, keepdims=True)
        radius = height * rng.uniform(0.14, 0.2)
        # towards the clump's surface: what is inside is hardly seen
        spread = radius * rng.uniform(0.45, 1.0, (each, 1)) ** 0.6
        at.append(tip + ball * spread * [1, 1, 0.8])
        out = at[-1] - centre
        away.append(0.6 * ball + 0.5 * out / np.linalg.norm(out, axis=1, keepdims=True))
    pieces.append(leaves(np.concatenate(at), 0.06 * height, np.concatenate(away), skin, rng))
    return kit.merge(*pieces)


def conifer(looks: Looks, variant: int, height: float = 10.0, count: int = 500) -> Piece:
    """A spruce: tiers of drooping boughs."""
    rng = looks.rng(f"conifer-{variant}")
    trunk = tube(np.array([(0, 0, 0), (0, 0, height * 0.5), (0, 0, height)]), [0.18, 0.1, 0.02], 7)
    # more boughs low down, where they are longer
    z = height * (0.12 + 0.88 * rng.random(count) ** 1.25)
    reach = (1 - z / height) * height * 0.24 + 0.1
    turn = rng.uniform(0, 2 * np.pi, count)
    way = kit.xyz(np.cos(turn), np.sin(turn), -0.25)
    at = np.column_stack([np.zeros((count, 2)), z]) + way * (reach * rng.uniform(0.35, 1.0, count))[:, None]
    skin = leaf_sheet(looks, 2)
    return kit.merge(kit.solid(trunk, bark(looks), TREE, 60), leaves(at, 0.07 * height, way, skin, rng))


def shrub(looks: Looks, variant: int, radius: float = 0.6, count: int = 90) -> Piece:
    """A round bush."""
    rng = looks.rng(f"shrub-{variant}")
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    ball[:, 2] = np.abs(ball[:, 2])
    at = ball * radius * rng.uniform(0.6, 1.0, (count, 1)) + [0, 0, 0.15 * radius]
    return leaves(at, 0.42 * radius, ball, leaf_sheet(looks, variant), rng)


def painted_facade(looks: Looks, style: int) -> Skin:
    """A facade of `BAYS` by `FLOORS` windows that repeats."""
    size = BAYS * BAY_M, FLOORS * FLOOR_M
    return looks.paint(f"facade-{style}", lambda rng: _paint_facade(rng, size, *STYLES[style]), 0.7, size)


def _paint_facade(
    rng: Rng, size: tuple[float, float], ground: Colour, trim: Colour, share: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    (width, height), (share_w, share_h) = size, share
    # light needs a quarter of the texels
    day, night = Canvas(width, height, 28, ground), Canvas(width, height, 7, (0, 0, 0))
    for row in range(FLOORS):
        z = row * FLOOR_M
        # a line for each floor, unless glass fills the whole front
        if share_w < 0.9:
            day.rect(0, z, width, z + 0.18, tuple(int(0.5 * a + 0.5 * b) for a, b in zip(ground, trim, strict=True)))
        for column in range(BAYS):
            # a window: frame, pane with the sky in its upper part, perhaps a blind, a mullion; by night some are lit
            w, h = BAY_M * share_w, FLOOR_M * share_h
            x0, z0 = (column + 0.5) * BAY_M - w / 2, z + 0.32 * FLOOR_M
            z0 = min(z0, z + FLOOR_M - h - 0.1)
            day.rect(x0 - 0.1, z0 - 0.14, x0 + w + 0.1, z0 + h + 0.1, trim)
            tone = rng.uniform(0.55, 1.3)
            day.rect(x0, z0, x0 + w, z0 + h, tuple(int(c * tone) for c in (62, 74, 86)))
            day.rect(x0, z0 + 0.55 * h, x0 + w, z0 + h, tuple(int(min(255, c * tone)) for c in (104, 122, 138)))
            if rng.random() < 0.35:
                day.rect(x0, z0 + h * rng.uniform(0.3, 0.8), x0 + w, z0 + h, (200, 194, 180))
            day.rect(x0 + w / 2 - 0.04, z0, x0 + w / 2 + 0.04, z0 + h, trim)
            # the same windows glow by night
            if rng.random() < 0.4:
                bright, _, cool = rng.uniform(0.5, 1, 3)
                lit = np.array((255, 206, 130)) * bright * (1, 1, 0.5 + cool)
                night.rect(x0, z0, x0 + w, z0 + h, tuple(int(c) for c in lit))
    return day.texture(0.06, rng), night.texture()


def towers(low: np.ndarray, high: np.ndarray, looks: Looks, rng: Rng) -> Piece:
    """Blocks (n, 3) low and high corners with painted facades and roofs, their windows whole."""
    style = rng.integers(0, len(STYLES), len(low))
    # flat roofs, of the same felt for all
    felt = wall(looks, "roofing", (104, 104, 102))
    pieces = []
    for k in range(len(STYLES)):
        a, b = low[style == k], high[style == k]
        if not len(a):
            continue
        skin = painted_facade(looks, k)
        size = b - a
        # whole floors and bays, whatever the size of the block: no window is cut
        floors = np.maximum(np.round(size[:, 2] / FLOOR_M), 1) / FLOORS
        for side in range(4):
            x0, x1 = (a[:, 0], b[:, 0]) if side % 2 == 0 else (a[:, 1], b[:, 1])
            bays = np.maximum(np.round((x1 - x0) / BAY_M), 1) / BAYS
            # facades begin at any bay, so that neighbours are not alike
            start = rng.integers(0, BAYS, len(a)) / BAYS
            # the lower left and right corner of a side, as who stands before it sees them
            corner = {0: ((0, 1), (1, 1)), 1: ((1, 1), (1, 0)), 2: ((1, 0), (0, 0)), 3: ((0, 0), (0, 1))}[side]
            left, right = ((np.where(px, b[:, 0], a[:, 0]), np.where(py, a[:, 1], b[:, 1])) for px, py in corner)
            rows = [
                kit.xyz(*left, a[:, 2]),
                kit.xyz(*right, a[:, 2]),
                kit.xyz(*right, b[:, 2]),
                kit.xyz(*left, b[:, 2]),
            ]
            up = np.stack([0 * floors, 0 * floors, floors, floors], 1)
            uv = np.stack([np.stack([start, start + bays, start + bays, start], 1), up], 2)
            pieces.append(kit.quads(np.stack(rows, 1), skin, FAR, uv))
        rect = np.column_stack([a[:, :2], b[:, :2]])
        pieces.append(kit.floor_quads(rect, b[:, 2], felt, FAR))
    return kit.merge(*pieces)


def surround(
    inner: np.ndarray, reach_m: float, ground: Skin, label: int, steps: tuple[float, ...] = (0.0, 200.0)
) -> Piece:
    """Flat ground at z = 0 round a rectangle (2, 2) out to `reach_m` from it, in rings so that quads stay small."""
    (x0, y0), (x1, y1) = inner
    edges = [*(step for step in steps if step < reach_m), reach_m]
    rects = []
    for near, far in pairwise(edges):
        # four strips round the ring before
        rects += [
            (x0 - far, y0 - far, x1 + far, y0 - near), (x0 - far, y1 + near, x1 + far, y1 + far),
            (x0 - far, y0 - near, x0 - near, y1 + near), (x1 + near, y0 - near, x1 + far, y1 + near),
        ]  # fmt: skip
    return kit.floor_quads(np.array(rects), 0.0, ground, label)


def build_grass(seed: int = 0) -> World:
    """A meadow with a landing pad in its middle, a fence, a track, and trees on the horizon."""
    # meadow and landing pad
    looks, rng = Looks(seed), Rng([seed, 30])
    meadow = grass(looks, meadow=True)
    inner = np.array([(-60.0, -60.0), (60.0, 60.0)])
    pieces = [
        kit.floor_quads((-60, -60, 60, 60), 0.0, meadow, SceneClass.GRASS),
        surround(inner, HORIZON_M, meadow, SceneClass.GRASS, (0.0, 60.0, 300.0)),
        landing_pad(6.0, looks),
        kit.floor_quads((-300, -49.0, 300, -45.5), 0.01, wall(looks, "render", (176, 158, 124)), SceneClass.GROUND),
        _fence(looks), tree_line(looks, rng, 95.0, 260.0, 260), hills(looks, rng), windsock(looks).moved(16, 14, 0),
        kit.place(_barn(looks), (-95.0, 70.0, 0.0), 20.0),
    ]  # fmt: skip
    # tufts of grass, away from pad and track
    at = rng.uniform(-58, 58, (420, 2))
    at = at[(np.hypot(*at.T) > 13) & (at[:, 1] > -43)]
    pieces.append(kit.place(
        _tuft(looks), np.column_stack([at, np.zeros(len(at))]), rng.uniform(0, 360, len(at)),
        rng.uniform(0.5, 1.4, len(at)),
    ))  # fmt: skip
    # places for objects, kept clear of tall grass
    spots = (
        Spot("pad", "grass", (0.0, 0.0, 0.25), 5.6, 0.0, "ground"),
        *(
            Spot(f"meadow-{k + 1}", "grass", (x, y, 0.0), radius, yaw, "ground")
            for k, (x, y, radius, yaw) in enumerate(MEADOWS)
        ),
    )
    for spot in spots[1:]:
        pieces = [_outside(piece, spot) for piece in pieces]
    mesh, face_class = kit.mesh_of(kit.merge(*pieces), looks)
    shed = np.array([[-107.0, 66.0, 0, -89.0, 80.0, 5.0]])
    return World("grass", seed, mesh, face_class, spots=spots, solids=shed, core=inner, pads=spots[:1])


def _outside(piece: Piece, spot: Spot) -> Piece:
    """A piece without its faces that stand up from the ground near a spot."""
    centre = piece.vertices[piece.faces].mean(axis=1)
    # by the middles of faces: what lies flat on the ground stays
    near = np.hypot(centre[:, 0] - spot.position[0], centre[:, 1] - spot.position[1]) < spot.free_radius_m + 0.5
    keep = ~(near & (centre[:, 2] > spot.position[2] + 0.03))
    return Piece(piece.vertices, piece.normals, piece.uv, piece.faces[keep], piece.material[keep], piece.label[keep])


def tree_line(looks: Looks, rng: Rng, near: float, far: float, count: int) -> Piece:
    """Broad-leaved trees and spruces in a ring, in clumps."""
    # angles are drawn about a few clumps
    clump = rng.uniform(0, 2 * np.pi, max(1, count // 9))
    angle = clump[rng.integers(0, len(clump), count)] + rng.normal(0, 0.07, count)
    distance = rng.uniform(near, far, count)
    at = kit.xyz(distance * np.cos(angle), distance * np.sin(angle), 0.0)
    kind, yaw = rng.integers(0, 5, count), rng.uniform(0, 360, count)
    made = [street_tree(looks, k, 10.0) for k in range(3)] + [conifer(looks, k, 13.0) for k in range(2)]
    scale = rng.uniform(0.7, 1.5, count)
    return kit.merge(*[kit.place(made[k], at[kind == k], yaw[kind == k], scale[kind == k]) for k in range(5)])


@painted("woods", 1.0, (60.0, 60.0))
def woods(rng: Rng) -> np.ndarray:
    """Tree tops from far away, 60 m square."""
    tone = np.array(GREENS[2], np.float32) * (0.8 + 0.35 * fractal(rng, (256, 256), 24, 4))[..., None]
    return tone.clip(0, 255).astype(np.uint8)


def hills(looks: Looks, rng: Rng) -> Piece:
    """A wooded rise all round, far off."""
    skin, count = woods(looks), 120
    angle = np.linspace(0, 2 * np.pi, count + 1)
    phase = rng.uniform(0, 6, 3)
    height = (
        16 + 9 * np.sin(3 * angle + phase[0]) + 6 * np.sin(7 * angle + phase[1]) + 3 * np.sin(17 * angle + phase[2])
    )
    # rounded: the last bits of a sine differ between machines
    height = np.round(np.maximum(height, 3), 3)

    def ring(radius: float, z: np.ndarray | float) -> np.ndarray:
        return kit.xyz(radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(z, angle.shape))

    # the rise comes in rings, each farther and higher, so that its woods overlap
    rows = [ring(520, 0.0), ring(600, height * 0.7), ring(700, height), ring(840, height * 1.5)]
    faces = [np.stack([a[1:], a[:-1], b[:-1], b[1:]], 1) for a, b in pairwise(rows)]
    return kit.quads(np.concatenate(faces), skin, SceneClass.SKYLINE)


def _fence(looks: Looks) -> Piece:
    wood = looks.plain((150, 132, 108), "matte")
    # a fence along two sides of the meadow
    x = np.arange(-58.0, 58.1, 2.9)
    post = kit.xyz(x, 40.0, 0.0)
    posts = np.concatenate([post, post[:, [1, 0, 2]]])
    rails = np.array(
        [((-58, 40, z), (58, 40, z)) for z in (0.45, 0.85, 1.2)]
        + [((40, -44, z), (40, 58, z)) for z in (0.45, 0.85, 1.2)]
    )
    posts = posts[(posts[:, 1] > -44.5)]
    return kit.merge(
        kit.bars(posts, posts + [0, 0, 1.4], 0.13, wood, F), kit.bars(rails[:, 0], rails[:, 1], 0.09, wood, F)
    )


def _tuft(looks: Looks) -> Piece:
    rng = looks.rng("tuft")
    # blades as thin triangles that lean outwards
    n = 26
    foot = np.column_stack([rng.normal(0, 0.16, (n, 2)), np.zeros(n)])
    lean = np.column_stack([rng.normal(0, 0.14, (n, 2)), rng.uniform(0.25, 0.6, n)])
    side = np.column_stack([rng.normal(0, 1, (n, 2)), np.zeros(n)])
    side *= 0.012 / np.linalg.norm(side, axis=1, keepdims=True)
    return kit.quads(
        np.stack([foot - side, foot + side, foot + lean, foot + lean], 1),
        looks.plain((122, 132, 62), "matte"), SceneClass.TREE,
    )  # fmt: skip


def _barn(looks: Looks) -> Piece:
    """A red barn 18 m by 14 m, its gable to -y."""
    red, tin, white = (
        wall(looks, "cladding", (142, 42, 36)), wall(looks, "cladding", (150, 152, 154)), looks.plain((232, 230, 222)),
    )  # fmt: skip
    gable = np.array([(-7, 0), (7, 0), (7, 5), (0, 9.5), (-7, 5)])
    # the roof overhangs by 0.4 m, and is seen from below as well
    slope = np.array([
        [(7.4, -0.4, 4.75), (7.4, 18.4, 4.75), (0, 18.4, 9.6), (0, -0.4, 9.6)],
        [(-7.4, 18.4, 4.75), (-7.4, -0.4, 4.75), (0, -0.4, 9.6), (0, 18.4, 9.6)],
    ])  # fmt: skip
    pieces = [
        kit.polygon(gable, 0.0, red, B),
        kit.place(kit.polygon(gable, 0.0, red, B), (0, 18.0, 0), 180.0),
        # the long walls; the gables stand at both ends
        kit.quads(
            [[(7, 0, 0), (7, 18, 0), (7, 18, 5), (7, 0, 5)], [(-7, 18, 0), (-7, 0, 0), (-7, 0, 5), (-7, 18, 5)]], red, B
        ),
        kit.quads(slope, tin, SceneClass.ROOF),
        kit.quads(slope[:, ::-1] - [0, 0, 0.05], tin, SceneClass.ROOF),
        # a white frame with two doors
        kit.box((-2.2, 2.2), (-0.06, 0), (0, 3.8), white, B),
        kit.box((-2.0, -0.05), (-0.1, -0.05), (0.1, 3.6), looks.plain((120, 34, 30)), B),
        kit.box((0.05, 2.0), (-0.1, -0.05), (0.1, 3.6), looks.plain((120, 34, 30)), B),
    ]
    return kit.merge(*pieces).turned(90.0)


def windsock(looks: Looks) -> Piece:
    """An orange and white sock on a mast."""
    # a mast that tapers to its tip
    mast = kit.revolved([(0.09, 0), (0.05, 6.0), (0.004, 6.05)], 8, looks.plain((214, 214, 210)), F)
    angle = np.linspace(0, 2 * np.pi, 11)
    pieces = [mast]
    for k in range(5):
        rows = []
        # five rings of cloth, orange and white in turn, that narrow and droop away from the mast
        for x in (0.1 + 0.6 * k, 0.1 + 0.6 * (k + 1)):
            r = 0.42 - 0.07 * x
            rows.append(kit.xyz(x, r * np.cos(angle), 5.6 - 0.09 * x * x + r * np.sin(angle)))
        a, b = rows
        cloth = np.stack([a[:-1], b[:-1], b[1:], a[1:]], 1)
        # seen from inside as well as from outside
        skin = looks.plain(((240, 96, 20), (244, 244, 240))[k % 2], "matte")
        pieces += [kit.quads(cloth[:, ::-1], skin, F), kit.quads(cloth + [0, 0, 0.004], skin, F)]
    return kit.merge(*pieces)


def build_apron(seed: int = 0) -> World:
    """An airfield's apron 260 m by 150 m: slabs, taxi lines, stands, hangars, a tower, vehicles, a runway."""
    looks, rng = Looks(seed), Rng([seed, 31])
    # concrete, stands and markings
    concrete = concrete_apron(looks)
    core = np.array([(-130.0, -75.0), (130.0, 75.0)])
    stands = np.array([-84.0, -28.0, 28.0, 84.0])
    pieces = [
        kit.floor_quads((-130, -75, 130, 75), 0.0, concrete, SceneClass.GROUND),
        surround(core, HORIZON_M, grass(looks), SceneClass.GRASS, (0.0, 60.0, 300.0)),
        kit.floor_quads([(-600, -190, 600, -145), (-130, -145, -105, -75.0)], 0.01, junction(looks), SceneClass.ROAD),
        _marks(looks, stands), _runway_marks(looks),
        *(_stand_number(looks, k, x) for k, x in enumerate(stands)),
    ]  # fmt: skip
    # buildings and their solids for collisions
    solids = []
    for k, x in enumerate((-92.0, -36.0, 30.0)):
        hangar = _hangar(looks, 46.0, 34.0, 13.0 + k, ((126, 142, 156), (188, 190, 186), (92, 116, 104))[k], k + 1)
        pieces.append(hangar.moved(x, 58.0, 0))
        solids.append([x - 23.0, 58.0, 0, x + 23.0, 92.0, 8.0])
    pieces.append(_control_tower(looks).moved(92, 70, 0))
    solids += [[89.0, 67.0, 0, 95.0, 73.0, 22.0], [80.0, 62.0, 0, 104.0, 78.0, 7.0]]
    pieces += [_apron_things(looks, rng, stands), tree_line(looks, rng, 330.0, 480.0, 120), hills(looks, rng)]
    # places for objects, and the landing pad
    spots = [Spot(f"stand-{k + 1}", "apron", (float(x), 8.0, 0.0), 15.0, 90.0, "ground") for k, x in enumerate(stands)]
    spots.append(Spot("taxiway", "apron", (14.0, -55.0, 0.0), 14.0, 0.0, "ground"))
    spots.append(Spot("verge", "grass", (0.0, -110.0, 0.0), 20.0, 0.0, "ground"))
    pad = Spot("pad", "apron", (112.0, 20.0, 0.25), 6.8, 0.0, "ground")
    pieces.append(landing_pad(7.0, looks).moved(112, 20, 0))
    mesh, face_class = kit.mesh_of(kit.merge(*pieces), looks)
    return World("apron", seed, mesh, face_class, spots=(*spots, pad), solids=np.array(solids), core=core, pads=(pad,))


def _stripe(looks: Looks, points: list[tuple[float, float]], width: float, colour: Colour) -> Piece:
    path = np.array(points, float)
    ahead = np.diff(path, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.column_stack([-ahead[:, 1], ahead[:, 0]]) * width / 2
    corners = np.stack([path[:-1] + side, path[:-1] - side, path[1:] - side, path[1:] + side], 1)
    flat = np.concatenate([corners, np.full((*corners.shape[:2], 1), MARK_M)], 2)
    return kit.quads(flat, _worn_paint(looks, colour), SceneClass.GROUND)


def _worn_paint(looks: Looks, colour: Colour) -> Skin:
    def paint(rng: Rng) -> np.ndarray:
        worn = np.clip(0.85 + 0.3 * fractal(rng, (128, 128), 8, 4), 0.15, 1)[..., None]
        tone = np.array(colour, np.float32) * worn + np.array((150, 148, 142)) * (1 - worn)
        return tone.clip(0, 255).astype(np.uint8)

    return looks.paint(f"paint-{hex_name(colour)}", paint, 0.8, (3.0, 3.0))


def _marks(looks: Looks, stands: np.ndarray) -> Piece:
    # a quarter of a circle: where a lead-in line leaves the taxiway
    angle = np.linspace(-np.pi / 2, 0, 9)
    pieces = [_stripe(looks, [(-130, -55), (130, -55)], 0.3, YELLOW_PAINT)]
    # each stand has a lead-in line, two lines at its sides, and a bar to stop at
    for x in stands:
        bend = [(x - 18 + 18 * np.cos(a), -37 + 18 * np.sin(a)) for a in angle]
        pieces.append(_stripe(looks, [(x - 40, -55), *bend, (x, 26)], 0.3, YELLOW_PAINT))
        pieces += [_stripe(looks, [(x + s * 19, -22), (x + s * 19, 34)], 0.2, WHITE_PAINT) for s in (-1, 1)]
        pieces.append(_stripe(looks, [(x - 1.6, 24), (x + 1.6, 24)], 0.5, YELLOW_PAINT))
    # red lines along both sides of the apron
    for y in (36.0, -72.0):
        pieces.append(_stripe(looks, [(-128, y), (128, y)], 0.25, (188, 40, 36)))
    pieces.append(
        _stripe(looks, [(-128, -73.5), (128, -73.5), (128, 73.5), (-128, 73.5), (-128, -73.5)], 0.3, YELLOW_PAINT)
    )
    return kit.merge(*pieces)


def _runway_marks(looks: Looks) -> Piece:
    x = np.arange(-580.0, 580.0, 50.0)
    rects = np.concatenate([
        np.column_stack([x, np.full(len(x), -168.0), x + 30, np.full(len(x), -167.0)]),
        np.array([(-560.0, y, -530.0, y + 1.8) for y in np.arange(-187.0, -149.0, 3.6)]),
    ])  # fmt: skip
    return kit.floor_quads(rects, 0.016, _worn_paint(looks, WHITE_PAINT), SceneClass.ROAD)


def _stand_number(looks: Looks, number: int, x: float) -> Piece:
    canvas = Canvas(3, 3, 64, (30, 30, 32))
    canvas.text(1.5, 1.5, f"A{number + 1}", 2.3, YELLOW_PAINT, fit_m=2.6)
    skin = sheet(f"stand-{number}", looks, canvas)
    return kit.floor_quads((x + 1.2, -30.0, x + 4.2, -27.0), MARK_M, skin, SceneClass.GROUND, fit=True)


def _hangar(looks: Looks, width: float, depth: float, height: float, colour: Colour, number: int) -> Piece:
    """A hall with a round roof, big sliding doors half open, and its number; its front along y = 0, about x = 0."""
    skin, roof = wall(looks, "cladding", colour), wall(looks, "cladding", (164, 166, 166))
    # an arched roof over upright walls
    eaves, half = 8.0, width / 2
    angle = np.linspace(0, np.pi, 15)
    arch = np.column_stack([half * np.cos(angle), eaves + (height - eaves) * np.sin(angle)])
    front = np.concatenate([[(half, eaves)], arch[1:]])
    ridge = kit.xyz(arch[:, 0], 0.0, arch[:, 1])
    bow = np.stack([ridge[:-1], ridge[:-1] + [0, depth, 0], ridge[1:] + [0, depth, 0], ridge[1:]], 1)
    # the number on the front
    canvas = Canvas(6, 3, 48, colour)
    canvas.text(3, 1.5, f"H{number}", 2.4, (244, 244, 240))
    name = sheet(f"hangar-{number}", looks, canvas)
    # sliding doors, of which two leaves stand open
    leaves = np.linspace(-half + 1.0, half - 1.0, 9)
    open_from, open_to = 3, 5
    panels = [(a, b) for k, (a, b) in enumerate(pairwise(leaves)) if not open_from <= k < open_to]
    low = np.array([(a + 0.05, -0.25 - 0.2 * (k % 2), 0) for k, (a, _) in enumerate(panels)])
    high = np.array([(b - 0.05, -0.05 - 0.2 * (k % 2), 7.2) for k, (_, b) in enumerate(panels)])
    glass = looks.plain((96, 116, 128), "gloss")
    dark = looks.plain((36, 38, 40), "matte")
    # a closed rear wall
    back = kit.merge(kit.boxes((-half, -0.02, 0), (half, 0, eaves), skin, B), kit.polygon(front, 0.0, skin, B))
    pieces = [
        kit.boxes(low, high, skin, B),
        kit.boxes(low * [1, 1, 0] + [0.4, -0.03, 4.6], high * [1, 0, 0] + low * [0, 1, 0] + [-0.4, 0, 5.9], glass, B),
        kit.box((-half, half), (-0.4, 0.0), (7.2, 8.0), looks.plain((210, 208, 200)), B),
        kit.polygon(front, 0.0, skin, B), kit.place(back, (0, depth, 0.0), 180.0),
        kit.boxes([(-half, 0, 0), (half - 0.3, 0, 0)], [(-half + 0.3, depth, eaves), (half, depth, eaves)], skin, B),
        kit.quads(bow, roof, SceneClass.ROOF),
        kit.quads(bow[:, ::-1] - [0, 0, 0.1], dark, SceneClass.ROOF),
        kit.floor_quads((-half, 0, half, depth), 0.02, dark, SceneClass.GROUND),
        kit.box((-half + 1.0, half - 1.0), (0.5, 0.6), (0, 7.2), dark, B),
        board(6, 3, name, SceneClass.SIGN, 0.0, both=False).moved(0, -0.05, eaves + 2.2),
    ]  # fmt: skip
    return kit.merge(*pieces)


def _control_tower(looks: Looks) -> Piece:
    white, green = wall(looks, "render", (226, 222, 210)), looks.plain((96, 140, 136), "gloss")
    frame, glass = looks.plain((60, 64, 66)), pane_sheet(looks, "curtain-green")
    # an octagon with a flat side to the front
    angle = np.radians(22.5) + np.linspace(0, 2 * np.pi, 9)
    # the cab: eight panes that lean outwards
    low, high = ([kit.xyz(r * np.cos(angle), r * np.sin(angle), z)] for r, z in ((3.6, 20.0), (4.4, 23.4)))
    cab = np.stack([low[0][:-1], low[0][1:], high[0][1:], high[0][:-1]], 1)
    # the low building at its foot, with a row of windows and the airfield's name
    cells = [(-12 + 2 * k, 2.6, -12 + 2 * k + 1.9, 5.6) for k in range(12)]
    face = kit.upright(cells, -8.02)
    canvas = Canvas(10, 1.4, 48, (30, 74, 120))
    canvas.text(5, 0.7, "CITY AIRFIELD", 1.1, (244, 244, 240), fit_m=9)
    words = sheet("airfield", looks, canvas, 0.8)
    rng = looks.rng("tower")
    pieces = [
        # shaft, cab with its roof and aerials, then the low building with its board
        kit.boxes((-3, -3, 0), (3, 3, 19.0), white, B),
        kit.revolved([(3.0, 18.6), (4.2, 19.2), (4.2, 20.0), (3.6, 20.0)], 16, looks.plain((206, 204, 198)), B),
        kit.quads(cab, glass, B, pane_uv(rng, 8)), kit.bars(low[0], high[0], 0.16, frame, B),
        kit.revolved([(4.4, 23.4), (4.9, 23.5), (4.9, 24.0), (0.01, 24.6)], 16, looks.plain((210, 60, 44)), B),
        kit.bars([(0, 0, 24.4), (1, 1, 24.3)], [(0, 0, 30.0), (1, 1, 27.0)], 0.1, frame, F),
        kit.boxes((-12, -8, 0), (12, 8, 7), white, B), kit.quads(face, glass, B, pane_uv(rng, 12)),
        kit.box((-12.3, 12.3), (-8.5, 8.3), (7.0, 7.4), green, B),
        board(10, 1.4, words, SceneClass.SIGN, 0.0, both=False).moved(0, -8.56, 6.5),
    ]  # fmt: skip
    return kit.merge(*pieces)


def _apron_things(looks: Looks, rng: Rng, stands: np.ndarray) -> Piece:
    # vehicles of the ground crew, of which some stand twice
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
    pieces = [kit.place(piece, (*at, 0.0), yaw) for piece, at, yaw in placed]
    # cones and barriers about the stands
    cones = np.array([(x + dx, dy, 0.0) for x in stands for dx, dy in ((-17, -9), (17, -9), (-17, 25), (17, 25))])
    pieces += [
        kit.place(traffic_cone(looks), cones),
        kit.place(barrier(looks), [(x + 21.5, 30.0, 0.0) for x in stands]),
    ]
    # floodlight masts
    steel, lamp = looks.plain((150, 154, 156)), looks.plain((255, 250, 230), "lamp")
    for x in (-112.0, -56.0, 0.0, 56.0, 112.0):
        heads = np.array([(x + dx, 44.0, 17.6) for dx in (-1.5, -0.5, 0.5, 1.5)])
        pieces += [
            kit.bars((x, 44.6, 0), (x, 44.6, 18.0), 0.3, steel, F),
            kit.boxes(heads - [0.35, 0.15, 0.3], heads + [0.35, 0.3, 0.3], steel, F, ()),
            kit.boxes(heads - [0.3, 0.17, 0.25], heads + [0.3, -0.15, 0.25], lamp, F, ()),
        ]
    # stairs for passengers
    tread = np.array([(-60.0, 30.0 - 0.3 * k, 0.4 + 0.22 * k) for k in range(14)])
    pieces += [
        kit.boxes(tread, tread + [1.6, 0.32, 0.06], steel, F, ()),
        kit.bars(
            tread[[0, 0]] + [[0, 0, 0], [1.6, 0, 0]], tread[[-1, -1]] + [[0, 0, 1], [1.6, 0, 1]], 0.08,
            looks.plain((40, 90, 160)), F,
        ),
    ]  # fmt: skip
    # a train of baggage carts
    carts = np.array([(40.0 + 3.2 * k, 28.0, 0.0) for k in range(4)])
    pieces += [
        kit.boxes(carts + [0, 0, 0.4], carts + [2.6, 1.5, 0.5], steel, F, ()),
        kit.boxes(carts + [0.2, 0.1, 0.5], carts + [2.4, 1.4, 1.5], looks.plain((70, 90, 130)), F),
        kit.boxes(carts + [0.2, 0.1, 0.0], carts + [0.5, 1.4, 0.4], looks.plain((24, 24, 26)), F),
        kit.boxes(carts + [2.0, 0.1, 0.0], carts + [2.3, 1.4, 0.4], looks.plain((24, 24, 26)), F),
    ]
    # edge markers and flags
    posts = np.array([(x, -76.0, 0) for x in np.arange(-100.0, 131.0, 5.0)])
    pieces.append(kit.bars(posts, posts + [0, 0, 0.5], 0.25, looks.plain((226, 120, 30)), F))
    pieces += [kit.place(flag(looks, k), (80.0 + 4 * k, 58.0, 0)) for k in range(3)]
    return kit.merge(
        *pieces,
        kit.place(shrub(looks, 0), [(84.0 + 3 * k, 60.5, 0) for k in range(7)]),
        windsock(looks).moved(-120, -90, 0),
    )
