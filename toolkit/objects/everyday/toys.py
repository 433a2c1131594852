"""What one plays with: drums, soccer balls, dice."""

import numpy as np

from toolkit.objects.everyday.draws import chance, draw, pick, pick_colour, shade, vary
from toolkit.objects.everyday.paints import decorate, pattern, wood_grain
from toolkit.objects.everyday.shapes import ball, disc, finish, moved, net_part, rod, turned
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Colour, Paint, Part, revolve


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
