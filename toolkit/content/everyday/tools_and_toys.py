"""Tools and weights that lie on a table, and what one plays with."""

import numpy as np

from toolkit.content.everyday.paints import (
    bands,
    chance,
    decorate,
    draw,
    pattern,
    pick,
    pick_colour,
    shade,
    stripes,
    vary,
    wood_grain,
)
from toolkit.content.everyday.shapes import (
    ball,
    block,
    cylinder,
    disc,
    finish,
    lathe,
    mirrored,
    moved,
    net_part,
    outward,
    rod,
    turned,
)
from toolkit.content.modelling import Colour, Paint, Part, loft, revolve, superellipse
from toolkit.objects.mesh import Mesh


def make_hammer(rng: np.random.Generator) -> Mesh:
    """A claw hammer, a sledge or a mallet, lying on its side."""
    long, thick = draw(rng, 210, 260), draw(rng, 10, 14)
    wood = pick_colour(rng, "wood")
    kind = pick(rng, ("claw", "claw", "sledge", "mallet"))
    head = {"claw": _claw_head, "sledge": _sledge_head, "mallet": _mallet_head}[kind](rng)
    grip: Paint = wood_grain(rng, wood, "v")
    if kind != "mallet" and chance(rng, 0.5):
        rubber = pick_colour(rng, "bright", "dark")
        grip = bands([rubber, shade(rubber, 0.6), pick_colour(rng, "steel", "dark")], [draw(rng, 0.4, 0.5), 0.55])
    handle = lathe([(thick * 0.95, -long), (thick * 1.15, -long * 0.9), (thick * 0.85, -long * 0.6),
                    (thick * 0.7, -long * 0.2),
                    (thick * 0.75, 0)], grip, "wood", 16, 16).scaled(1, 0.75, 1)  # fmt: skip
    end = cylinder(thick * 0.95, -long - 2, -long + 1, shade(wood, 0.7), "wood", 16)
    standing = [handle, *(part.scaled(1, 0.75, 1) for part in end), *head]
    return finish(turned(turned(standing, "x", 90), "z", draw(rng, 0, 360)))


def _claw_head(rng: np.random.Generator) -> list[Part]:
    """Face to +x, a split claw that curves down to -x."""
    metal, scale = pick_colour(rng, "steel", "dark"), draw(rng, 0.9, 1.15)
    face = [*rod([(0, 0, 0), (26, 0, 0), (30, 0, 0), (46, 0, 0)], [14, 11, 10, 10], metal, "metal", 8, 14),
            *turned(cylinder(15, 40, 54, metal, "metal", 18, bevel=3), "y", 90)]  # fmt: skip
    claws = []
    for side in (1, -1):
        path = [(2, side * 5, 1), (-22, side * 7, 3), (-46, side * 9, -4), (-66, side * 11, -22)]
        claws += rod(path, [11, 8, 6, 2], metal, "metal", 12, 12, 0.8)
    eye = block((26, 26, 30), (0, 0, 0), metal, "metal", 4)
    return [part.scaled(scale, scale, scale) for part in [*face, *claws, *eye]]


def _sledge_head(rng: np.random.Generator) -> list[Part]:
    metal, half, size = pick_colour(rng, "dark", "steel", "bright"), draw(rng, 40, 54), draw(rng, 30, 40)
    square = 2 * half, size, size
    if chance(rng, 0.5):
        return block(square, (0, 0, 0), metal, "metal", size * 0.2)
    sections = [superellipse(s, s, 3, 20, x) for x, s in ((-half, size * 0.85), (-half * 0.6, size), (half * 0.6, size),
                                                         (half, size * 0.85))]  # fmt: skip
    return outward(loft(sections, metal, "metal"))


def _mallet_head(rng: np.random.Generator) -> list[Part]:
    colour, half, radius = pick_colour(rng, "wood", "dark", "bright"), draw(rng, 46, 62), draw(rng, 26, 36)
    rings = bands([shade(colour, 0.8), colour, shade(colour, 0.8)], [0.16, 0.84])
    return turned(cylinder(radius, -half, half, rings, "wood", 28, bevel=4), "y", 90)


def make_screwdriver(rng: np.random.Generator) -> Mesh:
    """A fluted bright handle, a steel shaft and a flat or crossed tip."""
    long, radius, shaft = draw(rng, 80, 110), draw(rng, 14, 20), draw(rng, 90, 170)
    colour, accent = pick_colour(rng, "bright", "bright", "wood"), pick_colour(rng, "dark", "bright")
    steel, thin = pick_colour(rng, "steel"), draw(rng, 3.5, 5)
    lobes, depth = int(rng.integers(5, 9)), draw(rng, 0.08, 0.2)
    paint = pick(rng, (colour, stripes([colour, accent], lobes), bands([accent, colour, accent], [0.12, 0.8])))
    curve = [(radius * 0.75, 0), (radius, long * 0.12), (radius * 0.98, long * 0.6), (radius * 0.6, long * 0.8),
             (radius * 0.8, long * 0.92), (radius * 0.5, long)]  # fmt: skip
    grip = lathe(curve, paint, "plastic", 24, 40)
    turn = np.arctan2(grip.vertices[:, 1], grip.vertices[:, 0])
    flute = 1 - depth * (1 + np.cos(lobes * turn)) / 2 * (grip.vertices[:, 2] < long * 0.7)
    grip = Part(grip.vertices * np.stack([flute, flute, np.ones_like(flute)], 1), grip.faces, grip.corner_uv,
                grip.chart_mm, grip.paint, grip.material)  # fmt: skip
    ends = [ball(radius * 0.74, accent, "plastic", 20, 6, (1, 1, 0.3)),
            ball(radius * 0.5, accent, "plastic", 16, 6, (1, 1, 0.3)).moved(z=long)]  # fmt: skip
    stem = cylinder(thin, long, long + shaft, steel, "metal", 14)
    if chance(rng, 0.6):
        tip = loft([np.array([(-w, -d, z), (w, -d, z), (w, d, z), (-w, d, z)]) for w, d, z in
                    ((thin, thin * 0.8, long + shaft - 4), (thin * 1.7, thin * 0.5, long + shaft + 8),
                     (thin * 1.5, thin * 0.2, long + shaft + 18))], steel, "metal")  # fmt: skip
    else:
        tip = cylinder(thin, long + shaft, long + shaft + 12, shade(steel, 0.6), "metal", 8, thin * 0.2)
    driver = turned([grip, *ends, *stem, *outward(tip)], "y", 90)
    return finish(turned(driver, "z", draw(rng, 0, 360)))


def make_dumbbell(rng: np.random.Generator) -> Mesh:
    """A short bar between two weights: hexagonal heads, stacks of plates, or balls."""
    reach, radius, bar = draw(rng, 70, 95), draw(rng, 38, 58), draw(rng, 10, 14)
    colour, steel = pick_colour(rng, "dark", "bright", "grey"), pick_colour(rng, "steel", "dark")
    kind = pick(rng, ("hexagon", "plates", "plates", "ball"))
    ends: list[Part] = []
    if kind == "hexagon":
        sides = pick(rng, (6, 8))
        deep = draw(rng, 50, 72)
        profile = [(0, 0), (radius * 0.8, 0), (radius, 9), (radius, deep - 9), (radius * 0.8, deep), (0, deep)]
        ends.append(revolve(profile, sides, colour, "rubber"))
        ends += cylinder(radius * 0.4, deep, deep + 1, shade(colour, 1.6), "metal", 24)
    elif kind == "ball":
        ends.append(ball(radius, colour, "rubber", 28, 14, (1, 1, 0.9)).moved(z=radius * 0.7))
    else:
        z = 0.0
        for k in range(int(rng.integers(2, 5))):
            thick, r = draw(rng, 11, 18), radius * (1 - 0.17 * k)
            ends += moved(
                cylinder(r, 0, thick, colour if k % 2 == 0 else shade(colour, 1.35), "rubber", 32, bevel=3), z=z
            )
            z += thick
        ends += cylinder(bar * 1.1, z, z + 14, steel, "metal", 6 if chance(rng, 0.5) else 16)
        ends += cylinder(bar * 0.8, z, z + 26, steel, "metal", 16)
    side = turned(moved(ends, z=reach * 0.62), "x", -90)
    knurl = stripes([steel, shade(steel, 0.75)], 24, 2)
    grip = turned([lathe([(bar, -reach), (bar * 1.15, 0), (bar, reach)], knurl, "metal", 10, 20)], "x", 90)
    return finish(turned([*mirrored(side), *grip], "z", draw(rng, 0, 180)))


def make_drum(rng: np.random.Generator) -> Mesh:
    """A snare, marching or hand drum: skins, hoops, cords or lugs, and a pair of sticks."""
    radius, high = draw(rng, 78, 110), draw(rng, 60, 150)
    colour, hoop = pick_colour(rng, "bright", "wood"), pick_colour(rng, "steel", "brass", "wood", "pale")
    skin, cord = (240, 232, 214), pick_colour(rng, "pale", "dark", "brass")
    shell = wood_grain(rng, colour) if chance(rng, 0.3) else decorate(rng, colour, "bright")
    parts = [revolve([(radius, 0), (radius, high)], 40, shell, "paint"), disc(radius + 1, high, skin, "matte", 40)]
    parts.append(disc(radius + 1, 0, skin, "matte", 40).rotated("x", 180))
    for z in (0.0, high - 12.0):
        profile = [(radius, z), (radius + 6, z), (radius + 6, z + 13), (radius + 1, z + 13)]
        parts.append(
            revolve([*profile, (radius - 4, z + 10)], 40, hoop, "metal" if max(hoop) - min(hoop) < 60 else "paint")
        )
    count, laced = int(rng.integers(6, 11)), chance(rng, 0.6)
    for k in range(2 * count if laced else count):
        turn = np.pi * k / count * (1 if laced else 2)
        far = turn + (np.pi / count * (1 if k % 2 else -1) if laced else 0)
        low, top = ((radius + 3) * np.array([np.cos(a), np.sin(a), 0]) for a in (turn, far))
        parts += rod([low + np.array([0, 0, 8]), top + np.array([0, 0, high - 8])], 2.2, cord, "cloth", segments=6)
    if chance(rng, 0.6):
        for side in (-1, 1):
            stick = [*rod([(-110, 0, 0), (70, 0, 0)], [5.5, 5.5, 3], (206, 166, 112), "wood"),
                     ball(6, (206, 166, 112), "wood", 10, 6).moved(73)]  # fmt: skip
            parts += moved(turned(stick, "z", side * draw(rng, 12, 40)), 0, side * 24, high + 8)
    return finish(parts)


def make_soccer_ball(rng: np.random.Generator) -> Mesh:
    """A truncated icosahedron blown up: dark pentagons, pale hexagons, seams; turned anyhow."""
    pale = vary(rng, (242, 242, 238), 6) if chance(rng, 0.8) else pick_colour(rng, "pale", "bright")
    dark = vary(rng, (24, 24, 28), 6) if chance(rng, 0.7) else pick_colour(rng, "bright", "dark")
    golden = (1 + 5**0.5) / 2
    corners = np.array([v for a in (-1, 1) for b in (-golden, golden) for v in ((0, a, b), (a, b, 0), (b, 0, a))])
    near = np.linalg.norm(corners[:, None] - corners[None], axis=2) < 2.1
    faces = np.array([corners[i] + corners[j] + corners[k] for i in range(12) for j in range(i) for k in range(j)
                      if near[i, j] and near[j, k] and near[i, k]])  # fmt: skip
    normals = np.concatenate([corners, faces])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.r_[np.full(12, 2.3274), np.full(20, 2.2673)][:, None]  # distances of the solid's faces
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        turn, tilt = 2 * np.pi * u, np.pi * (v - 0.5)
        x, y = np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn)
        directions = np.stack([x, y, np.broadcast_to(np.sin(tilt), x.shape)], -1).astype(np.float32)
        reach = directions @ (normals @ axes).T.astype(np.float32)
        first = np.partition(reach, -2, axis=-1)
        seam = first[..., -1] - first[..., -2] < 0.006
        return np.where(seam, 2, reach.argmax(axis=-1) < 12)

    paint = pattern([pale, dark, shade(pale, 0.55)], shader)
    return finish([ball(100, paint, "plastic", 40, 22)])


def make_dice(rng: np.random.Generator) -> Mesh:
    """One to three cubes with rounded edges and pips."""
    ground = pick_colour(rng, "pale", "bright", "dark")
    ink = (246, 244, 238) if sum(ground) < 440 else (22, 22, 24)
    if sum(ground) > 640 and chance(rng, 0.3):
        ink = pick_colour(rng, "bright")
    parts: list[Part] = []
    for k in range(pick(rng, (1, 2, 2, 3))):
        one = _one_die(rng, ground, ink)
        one = turned(one, "z", draw(rng, 0, 90))
        place = (0, 0, 0) if k == 0 else (draw(rng, -20, 20), (2 * k - 3) * draw(rng, 92, 110), 0)
        parts += moved(one, *place)
    return finish(parts, 512)


def _one_die(rng: np.random.Generator, ground: Colour, ink: Colour) -> list[Part]:
    half, power = 32.0, 7.0
    spots = {1: [(0, 0)], 2: [(-1, -1), (1, 1)], 3: [(-1, -1), (0, 0), (1, 1)], 4: [(-1, -1), (-1, 1), (1, -1), (1, 1)]}
    spots[5] = [*spots[4], (0, 0)]
    spots[6] = [*spots[4], (-1, 0), (1, 0)]

    def face(number: int) -> Paint:
        def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
            pips = [np.hypot(u - 0.5 - 0.25 * x, v - 0.5 - 0.25 * y) < 0.095 for x, y in spots[number]]
            return np.logical_or.reduce(pips)

        return pattern([ground, ink], shader)

    grid = np.linspace(-1, 1, 13)
    u, v = np.meshgrid(grid, grid)
    cube = np.stack([u, v, np.ones_like(u)], -1)
    rounded = half * cube / np.linalg.norm(cube, ord=power, axis=2, keepdims=True)
    first = int(rng.integers(1, 4))
    numbers = [first, 7 - first, *[n for n in range(1, 7) if n not in (first, 7 - first)]]
    turns = [("x", 0), ("x", 180), ("x", 90), ("y", 90), ("y", -90), ("x", -90)]
    return [net_part(list(rounded), face(n), "plastic").rotated(axis, angle).moved(z=half) for n, (axis, angle) in
            zip(numbers, turns, strict=True)]  # fmt: skip
