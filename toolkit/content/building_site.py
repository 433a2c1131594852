"""A building site behind a hoarding, and its tower crane."""

import numpy as np

from toolkit.content.buildings import House
from toolkit.content.paint import Canvas
from toolkit.content.pieces import Looks, Piece, bars, box, boxes, merge, place, wall_quads
from toolkit.content.walls import wall
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass

B, R, SIGN, F = SceneClass.BUILDING, SceneClass.ROOF, SceneClass.SIGN, SceneClass.FURNITURE


def building_site(width: float, depth: float, looks: Looks, rng: np.random.Generator) -> House:
    """A concrete frame under way behind a hoarding, with a tower crane."""
    concrete = wall(looks, "concrete", (186, 180, 168))
    steel, timber = looks.plain((150, 84, 52)), looks.plain((186, 146, 96))
    x0, x1, y0, y1 = 8.0, width - 5.0, 7.0, depth - 6.0
    floors, floor_m = 5, 3.6
    z = floor_m * np.arange(1, floors + 1)
    low = np.column_stack([np.full(floors, x0), np.full(floors, y0), z - 0.3])
    high = np.column_stack([np.full(floors, x1), np.full(floors, y1), z])
    high[-1, 0] = (x0 + x1) / 2
    xs, ys = np.linspace(x0 + 0.3, x1 - 0.8, 6), np.linspace(y0 + 0.3, y1 - 0.8, 4)
    posts = np.array([(x, y, 0) for x in xs for y in ys])
    tops = np.where(posts[:, 0] < (x0 + x1) / 2, z[-1] + 1.2, z[-2] + 2.0)
    rods = (posts[:, None] + np.array([(dx, dy, 0) for dx in (0.1, 0.4) for dy in (0.1, 0.4)])).reshape(-1, 3)
    rods[:, 2] = np.repeat(tops, 4)
    props = np.column_stack([rng.uniform(x0, x1, 60), rng.uniform(y0, y1, 60), np.tile(z[:-1], 15)])
    pieces = [
        boxes(low, high, concrete, B, ()),
        boxes(posts, posts + np.column_stack([np.full((len(posts), 2), 0.5), tops]), concrete, B),
        bars(rods, rods + [0, 0, 0.9], 0.03, steel, B),
        bars(props, props + [0, 0, floor_m - 0.3], 0.07, steel, B),
        _hoarding(width, depth, looks),
        tower_crane(looks).moved(4.0, depth - 4.2, 0),
    ]
    edge = np.array([(x0, y, level) for level in z for y in (y0, y1)], float)
    for rail in (0.55, 1.05):
        pieces.append(bars(edge + [0, 0, rail], edge + [x1 - x0, 0, rail], 0.06, looks.plain((236, 150, 30)), B))
    piles = np.array([(rng.uniform(x0, x1), 3.0, 0) for _ in range(5)])
    pieces.append(boxes(piles, piles + [2.4, 1.2, 0.7], timber, F))
    frame = np.array(
        [[x0, y0, level - 0.3, x1 if k < floors - 1 else (x0 + x1) / 2, y1, level] for k, level in enumerate(z)]
    )
    return House(merge(*pieces), frame)


def _hoarding(width: float, depth: float, looks: Looks) -> Piece:
    """A painted board fence with bills, all round."""
    c, rng = Canvas(9.6, 2.4, 56, (28, 92, 74)), looks.rng("hoarding")
    for k in range(8):
        c.line([(1.2 * k, 0), (1.2 * k, 2.4)], 0.03, (18, 64, 52))
    for k in range(5):
        x, tone = 0.4 + 1.9 * k, rng.integers(60, 240, 3)
        c.rect(x, 0.7, x + 0.9, 1.95, tuple(int(v) for v in tone))
        c.text(
            x + 0.45, 1.6,
            str(rng.choice(["CIRCUS", "ROCK!", "VOTE", "EXPO", "SALE"])),
            0.24, (250, 250, 244), fit_m=0.8,
        )  # fmt: skip
        c.rect(x + 0.15, 0.85, x + 0.75, 1.35, tuple(int(255 - v) for v in tone))
    c.text(7.6, 2.2, "DANGER · KEEP OUT", 0.2, (250, 210, 40))
    skin = looks.known("hoarding")
    if skin is None:
        skin = looks.add(Material("hoarding", c.texture(0.06, rng), 0.8), (9.6, 2.4))
    pieces = []
    for x, y, span, yaw in (
        (0, 0, width, 0.0), (width, 0, depth, 90.0), (width, depth, width, 180.0), (0, depth, depth, 270.0),
    ):  # fmt: skip
        face = wall_quads((0.0, 0.0, span, 2.4), 0.0, skin, B)
        back = wall_quads((-span, 0.0, 0.0, 2.4), 0.0, looks.plain((150, 120, 84)), B).turned(180).moved(0, 0.06, 0)
        pieces.append(place(merge(face, back), (x, y, 0.0), yaw))
    return merge(*pieces)


def tower_crane(looks: Looks, height: float = 42.0, jib: float = 36.0) -> Piece:
    """A yellow lattice tower crane: mast, slewing cab, jib towards +x, counter-jib with its ballast, hook."""
    yellow, grey = looks.plain((244, 178, 22)), looks.plain((150, 150, 148), "matte")
    half, step = 0.85, 2.0
    foot = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    legs = np.column_stack([foot, np.zeros(4)])
    z = np.arange(0, height, step)
    rungs, rods = [], []
    for k in range(4):
        a, b = foot[k], foot[(k + 1) % 4]
        rungs += [((*a, level), (*b, level)) for level in z]
        rods += [((*(a if i % 2 else b), level), (*(b if i % 2 else a), level + step)) for i, level in enumerate(z)]
    lattice = np.array(rungs + rods)
    top = height + 0.6
    x = np.arange(0, jib + 0.1, 1.8)
    ridge, left, right = (
        np.column_stack([x, np.full(len(x), y), np.full(len(x), level)])
        for y, level in ((0, top + 1.5), (-0.7, top), (0.7, top))
    )
    web = [(a[k], b[k + d]) for a, b in ((ridge, left), (ridge, right)) for k in range(len(x) - 1) for d in (0, 1)]
    web += [(left[k], right[k]) for k in range(len(x))]
    truss = np.array(web)
    apex = np.array([0.0, 0.0, top + 7.0])
    ties = np.array([(apex, (jib * 0.62, 0, top + 1.5)), (apex, (-11.0, 0, top)), (apex, (jib * 0.3, 0, top + 1.5))])
    hook = np.array([jib * 0.7, 0, top])
    return merge(
        bars(legs, legs + [0, 0, height], 0.2, yellow, F),
        bars(lattice[:, 0], lattice[:, 1], 0.09, yellow, F),
        bars(
            np.stack([line[0] for line in (ridge, left, right)]),
            np.stack([line[-1] for line in (ridge, left, right)]),
            0.16, yellow, F,
        ),
        bars(truss[:, 0], truss[:, 1], 0.08, yellow, F), bars(ties[:, 0], ties[:, 1], 0.08, grey, F),
        bars([(-half, 0, top), (half, 0, top)], [apex, apex], 0.22, yellow, F),
        bars([(-12.0, -0.7, top), (-12.0, 0.7, top)], [(0, -0.7, top), (0, 0.7, top)], 0.22, yellow, F),
        box((-12.0, -9.0), (-0.9, 0.9), (top - 1.6, top + 0.8), grey, F),
        box((-1.1, 1.1), (-1.1, 1.1), (height - 0.2, top), grey, F),
        box((0.9, 2.5), (0.9, 2.2), (top - 1.9, top + 0.3), looks.plain((236, 236, 232)), F),
        box((2.5, 2.53), (1.0, 2.1), (top - 1.2, top + 0.1), looks.plain((60, 84, 100), "gloss"), F),
        bars(hook[None], hook[None] - [0, 0, 14], 0.05, looks.plain((30, 30, 32)), F),
        box((hook[0] - 0.3, hook[0] + 0.3), (-0.2, 0.2), (top - 15, top - 14), yellow, F),
        box((-1.6, 1.6), (-1.6, 1.6), (0, 0.5), grey, F),
    )  # fmt: skip
