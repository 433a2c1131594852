"""Vessels: pots, jugs, mugs, vases, buckets, pans, bottles, cans, cartons, glasses; and a roll of tissue."""

import numpy as np

from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content.drawing import (
    Colour,
    Paint,
    Rng,
    bands,
    blotches,
    checks,
    decorate,
    dots,
    label,
    pick_word,
    scatter,
    shade,
    stripes,
    wood_grain,
)
from toolkit.rooms.worlds.content.modelling import (
    Parts,
    arc,
    ball,
    block,
    cylinder,
    disc,
    finish,
    lathe,
    revolve,
    rod,
    slab,
    smooth_curve,
    surface,
    vessel,
)

CREAM: Colour = (246, 230, 176)
FOAM: Colour = (252, 243, 214)
FESTIVE: tuple[tuple[Colour, Colour], ...] = (
    ((168, 24, 34), (255, 244, 214)), ((24, 92, 52), (255, 244, 214)), ((250, 240, 214), (168, 24, 34)),
    ((28, 58, 120), (255, 250, 236)), ((250, 240, 214), (24, 92, 52)), ((206, 160, 60), (98, 8, 18)),
)  # fmt: skip
"""Paper and ink of labels."""
NAMES = ("EGG NOG", "EGGNOG", "NOG")


def make_coffeepot(rng: Rng) -> Mesh:
    """An enamel pot, a moka pot, a percolator, or a silver pot with a swan's neck."""
    parts = rng.pick((_enamel_pot, _moka_pot, _percolator, _silver_pot))(rng)
    return finish(parts.rotated("z", rng.draw(-100, -80)))


def _spout(
    root: tuple[float, float], tip: tuple[float, float], radius: tuple[float, float], colour: Paint, material: str,
    curl: float = 0.3,
) -> Parts:  # fmt: skip
    """A tapering spout to +x with a dark mouth; `curl` bends it into an S."""
    (x0, z0), (x1, z1) = root, tip
    points = [(x0, 0, z0), (x0 + (x1 - x0) * (0.3 + curl * 0.5), 0, z0 + (z1 - z0) * (0.3 - curl * 0.5)),
              (x0 + (x1 - x0) * 0.62, 0, z0 + (z1 - z0) * 0.6), (x1, 0, z1)]  # fmt: skip
    pipe = rod(points, [radius[0], radius[0] * 0.7 + radius[1] * 0.3, radius[1] * 1.1, radius[1]], colour, material)
    # the mouth is a short dark pipe at the tip
    ahead = np.array([points[-1][0] - points[-2][0], 0, points[-1][2] - points[-2][2]])
    end = np.array([points[-1], points[-1] + 0.01 * ahead / np.linalg.norm(ahead) * 30])
    return Parts(pipe, rod(end, radius[1] * 0.75, (20, 18, 18), material))


def _knob(rng: Rng, z: float, radius: float, colour: Paint, material: str) -> Parts:
    return Parts(
        cylinder(radius * 0.5, z - radius * 0.4, z + radius * 0.6, colour, material, 12),
        ball(radius, colour, material, 16, 8, (1, 1, rng.draw(0.6, 1.2))).moved(z=z + radius),
    )


def _loop(
    top: tuple[float, float], low: tuple[float, float], reach: float, radius: float, colour: Paint, material: str
) -> Parts:
    """A handle to -x from a high to a low place."""
    (x0, z0), (x1, z1) = top, low
    # out, down and back to the wall
    points = [(x0, 0, z0), (x0 - reach * 0.8, 0, z0 + 0.05 * (z0 - z1)),
              (min(x0, x1) - reach, 0, z0 - 0.35 * (z0 - z1)),
              (min(x0, x1) - reach * 0.75, 0, z0 - 0.75 * (z0 - z1)), (x1, 0, z1)]  # fmt: skip
    return rod(points, radius, colour, material, 18, flatten=1.4)


def _enamel_pot(rng: Rng) -> Parts:
    # radii of foot and rim, then the height
    base, top, high = rng.draw(55, 75), rng.draw(36, 52), rng.draw(150, 220)
    colour, trim = rng.colour("ceramic", "bright", "pale"), rng.colour("dark")
    specks = rng.colour("pale", "dark")
    paint = scatter(rng, colour, [specks], 160, 0.004) if rng.chance(0.5) else decorate(rng, colour, "pale", "bright")
    # a lid that closes a little over the rim, with a knob
    lid = [(top + 3, high), (top + 3, high + 4), (top * 0.6, high + rng.draw(10, 26)), (top * 0.1, high + 28)]
    middle = (base + top) / 2
    return Parts(
        cylinder(base, 0, 4, trim, "paint", 32),
        lathe([(base, 4), (base, 10), (middle + 3, high * 0.5), (top, high)], paint, "paint"),
        lathe(lid, colour, "paint", 10),
        _knob(rng, high + 28, rng.draw(7, 11), trim, "plastic"),
        _spout((middle - 2, high * rng.draw(0.35, 0.5)), (base + rng.draw(25, 50), high * rng.draw(0.88, 1.02)),
                (rng.draw(14, 19), rng.draw(7, 9)), colour, "paint"),
        _loop((-top, high * 0.93), (-middle, high * rng.draw(0.3, 0.45)), rng.draw(35, 50), rng.draw(5, 7),
               rng.pick((trim, colour)), "paint"),
    )  # fmt: skip


def _moka_pot(rng: Rng) -> Parts:
    # a tank below and a jug above, narrow between them
    base, waist, top = rng.draw(48, 56), rng.draw(36, 42), rng.draw(46, 58)
    low, high = rng.draw(62, 80), rng.draw(150, 185)
    metal = rng.colour("steel") if rng.chance(0.7) else rng.colour("bright")
    black = rng.colour("dark") if rng.chance(0.8) else rng.colour("bright", "wood")
    # facets of the cast metal
    sides = rng.pick((8, 8, 10))
    body = [(0, 0), (base, 0), (base, 4), (waist + 4, low), (waist + 4, low + 10), (waist, low + 10), (waist, low + 14)]
    cone = revolve([*body, (top, high)], sides, metal, "metal")
    lid = revolve([(top + 2, high), (top + 2, high + 3), (top * 0.3, high + 22), (0, high + 24)], sides, metal, "metal")
    lip = slab([(top - 12, high - 34), (top + 20, high - 2), (top - 12, high - 2)], 22, metal, "metal")
    reach = rng.draw(42, 58)
    # a handle like a seven, away from the spout
    grip = [(-top + 4, high - 12), (-top + 4, high - 1), (-top - reach, high - 6), (-top - reach + 6, low + 4),
            (-top - reach + 16, low + 4), (-top - reach + 14, high - 20)]  # fmt: skip
    knob = cylinder(7, high + 23, high + 44, black, "plastic", 12, 10)
    return Parts(cone, lid, lip, slab(grip, 13, black, "plastic"), knob)


def _percolator(rng: Rng) -> Parts:
    # radii of foot and rim, then the height
    base, top, high = rng.draw(52, 62), rng.draw(44, 54), rng.draw(170, 220)
    metal, black = rng.colour("steel"), rng.colour("dark", "wood")
    wall = [(base, 16), (base, 24), (top + 2, high * 0.9), (top, high)]
    out = -top - rng.draw(42, 58)
    handle = [(-top + 3, 0, high * 0.9), (out, 0, high * 0.92), (out - 4, 0, high * 0.55), (out + 12, 0, high * 0.35)]
    return Parts(
        cylinder(base + 4, 0, 16, black, "plastic", 32, base),
        lathe(wall, metal, "metal"),
        lathe([(top + 2, high), (top + 2, high + 5), (top * 0.5, high + 14), (14, high + 18)], metal, "metal", 10),
        # the knob of glass, in which the coffee is seen
        cylinder(12, high + 17, high + 36, (196, 206, 204), "glass", 16, 9, bevel=3),
        _spout((top - 3, high * rng.draw(0.6, 0.74)), (base + rng.draw(20, 34), high * rng.draw(0.9, 0.98)),
                (18, 9), metal, "metal", 0.0),
        rod(handle, [6, 8, 9, 7], black, "plastic", flatten=1.5),
    )  # fmt: skip


def _silver_pot(rng: Rng) -> Parts:
    belly, neck, high = rng.draw(52, 64), rng.draw(24, 32), rng.draw(175, 215)
    metal = rng.colour("steel", "brass", "ceramic")
    material = "metal" if max(metal) - min(metal) < 130 else "ceramic"
    # a low foot, a wide belly, a slender neck
    wall = [(belly * 0.6, 0), (belly * 0.62, 5), (belly * 0.42, 14), (belly * 0.9, 36), (belly, 62),
            (neck + 8, high * 0.66), (neck, high * 0.86), (neck + 5, high)]  # fmt: skip
    lid = [(neck + 5, high), (neck + 1, high + 8), (neck * 0.6, high + 20), (3, high + 24)]
    handle = rng.colour("wood", "dark") if rng.chance(0.5) else metal
    return Parts(
        lathe(wall, metal, material, 34), lathe(lid, metal, material, 12), _knob(rng, high + 24, 7, metal, material),
        _spout((belly - 6, high * 0.3), (belly + rng.draw(38, 52), high * 0.92), (14, 6), metal, material, 0.5),
        _loop((-neck - 2, high * 0.92), (-belly + 3, high * 0.4), rng.draw(34, 46), 5, handle, "plastic"),
    )  # fmt: skip


def make_teapot(rng: Rng) -> Mesh:
    """Round and squat, with a bowed spout, a loop (or a bail over the top) and a lid with a knob."""
    belly, high = rng.draw(62, 82), rng.draw(78, 112)
    colour = rng.colour("ceramic", "pale", "bright")
    trim = rng.pick((colour, shade(colour, 0.6), rng.colour("ceramic", "dark")))
    foot, neck = belly * rng.draw(0.5, 0.68), belly * rng.draw(0.42, 0.56)
    full = rng.draw(0.4, 0.55) * high
    # from the foot over the belly to the neck
    wall = [(foot, 0), (foot, 3), (belly * 0.9, full * 0.5), (belly, full), (belly * 0.88, full + (high - full) * 0.6),
            (neck, high)]  # fmt: skip
    lid = [(neck + 2, high), (neck + 1, high + 4), (neck * 0.6, high + 13), (4, high + 17)]
    body = lathe(wall, decorate(rng, colour, "ceramic", "bright"), "ceramic", 24)
    parts = Parts(body, lathe(lid, trim, "ceramic", 10), _knob(rng, high + 17, rng.draw(6, 10), trim, "ceramic"))
    tip = belly + rng.draw(40, 60), high * rng.draw(0.85, 1.05)
    parts += _spout((belly * 0.86, full * 0.7), tip, (rng.draw(13, 17), rng.draw(6, 8)), colour, "ceramic", 0.25)
    # a bail over the top, or an ear behind
    if rng.chance(0.25):
        over = arc((0, high * 0.8), (belly * 0.8, rng.draw(75, 95)), 8, 172)
        parts += rod(over, 4.5, rng.colour("wood", "dark", "brass"), "wood")
    else:
        ear = (-belly * 0.86, high * 0.82), (-belly * 0.93, full * 0.6)
        parts += _loop(*ear, rng.draw(32, 44), rng.draw(5, 7), trim, "ceramic")
    # the spout to a side, as in most photographs
    return finish(parts.rotated("z", rng.draw(-100, -80)))


def make_pitcher(rng: Rng) -> Mesh:
    """A tall open jug, its rim drawn out into a lip, with a large handle."""
    # radii and height; the neck may be narrower than the mouth
    belly, high = rng.draw(52, 68), rng.draw(170, 230)
    neck, mouth = belly * rng.draw(0.55, 0.95), belly * rng.draw(0.7, 1.02)
    outline = smooth_curve(
        [(belly * 0.72, 0), (belly * 0.95, high * 0.15), (belly, high * 0.35), (neck, high * 0.78), (mouth, high)], 26
    )
    colour = rng.colour("ceramic", "pale", "bright", "steel")
    inside = rng.pick((colour, (238, 234, 226)))
    reach, lift = rng.draw(24, 40), rng.draw(4, 16)

    def draw_lip(points: np.ndarray) -> np.ndarray:
        angle = np.arctan2(points[:, 1], points[:, 0])
        # the rim is pushed out over the spout, less below and to the sides; the axis stays
        high_up = np.clip((points[:, 2] / high - 0.72) / 0.28, 0, 1) ** 2
        share = np.exp(-((angle / 0.42) ** 2)) * high_up * (np.hypot(points[:, 0], points[:, 1]) > mouth * 0.4)
        return points + share[:, None] * np.array([reach, 0, lift])

    paint = decorate(rng, colour, "ceramic", "bright")
    body = vessel(outline, 4, paint, inside, "ceramic").bent(draw_lip)
    ear = (-neck * 0.96, high * 0.86), (-belly + 2, high * rng.draw(0.3, 0.42))
    handle = _loop(*ear, rng.draw(36, 54), rng.draw(6, 8), colour, "ceramic")
    return finish(Parts(body, handle.outward()).rotated("z", rng.draw(-100, -80)))


def make_coffee_mug(rng: Rng) -> Mesh:
    """A cylinder with a C-shaped handle, often with coffee in it."""
    # radius, how the wall widens upwards, and height
    radius, flare, high = rng.draw(38, 48), rng.draw(0.88, 1.12), rng.draw(80, 112)
    colour = rng.colour("ceramic", "pale", "bright")
    points = [(radius * 0.9, 0), (radius, 6), (radius * (1 + flare) / 2, high * 0.5), (radius * flare, high)]
    outline = smooth_curve(points, 16)
    # how full, in which colour, with a gloss
    coffee: tuple[float, Paint, str] | None = None
    if rng.chance(0.6):
        coffee = rng.draw(0.7, 0.9), rng.vary(rng.pick(((46, 26, 16), (150, 104, 66), (96, 56, 34)))), "glass"
    inside = rng.pick((colour, (240, 236, 228)))
    paint = decorate(rng, colour, "bright", "ceramic")
    body = vessel(outline, 4, paint, inside, "ceramic", content=coffee)
    root, reach = radius * (1 + flare) / 2 - 3, rng.draw(26, 36)
    loop = arc((root, high * 0.52), (reach, high * rng.draw(0.28, 0.36)), 88, -88)
    parts = Parts(body, rod(loop, rng.draw(4.5, 6.5), colour, "ceramic", flatten=1.5))
    # the handle to a side, where it is seen
    return finish(parts.rotated("z", rng.draw(60, 120)))


def make_vase(rng: Rng) -> Mesh:
    """A slender or bellied vase with a neck, a flared mouth and a pattern, with flowers or without."""
    belly, high = rng.draw(40, 64), rng.draw(170, 240)
    full, pinch = rng.draw(0.35, 0.68), rng.draw(0.3, 0.55)
    mouth = belly * rng.draw(pinch + 0.1, 0.85)
    foot = belly * rng.draw(0.45, 0.7)
    # foot, belly, pinched neck, flared mouth
    outline = smooth_curve(
        [(foot, 0), (foot * 0.95, 6), (belly * 0.86, high * full * 0.55), (belly, high * full),
         (belly * pinch, high * 0.88), (mouth, high)], 30,
    )  # fmt: skip
    colour = rng.colour("ceramic", "bright", "pale", "dark")
    paint = decorate(rng, colour, "ceramic", "bright", "brass")
    parts = vessel(outline, 3.5, paint, shade(colour, 0.7), "ceramic")
    if rng.chance(0.45):
        parts += _flowers(rng, high, belly * pinch * 0.6, rng.draw(70, 120))
    elif rng.chance(0.3):
        # ears at both sides of the neck
        for turn in (0, 180):
            ear = [(belly * pinch, 0, high * 0.86), (belly * 1.05, 0, high * 0.8), (belly * 0.9, 0, high * full)]
            parts += rod(ear, 4, colour, "ceramic").rotated("z", turn)
    return finish(parts)


def _flowers(rng: Rng, z: float, width: float, reach: float) -> Parts:
    # flowers of a kind, their stems spread round the mouth
    parts, petal = Parts(), rng.colour("bright", "pale")
    count = int(rng.integers(4, 9))
    for k in range(count):
        bearing = 2 * np.pi * k / count + rng.draw(-0.4, 0.4)
        lean, rise = rng.draw(0.15, 0.6) * reach, reach * rng.draw(0.6, 1)
        # stems lean out of the mouth, each on its own side
        base = np.array([np.cos(bearing), np.sin(bearing), 0]) * width * 0.6
        tip = np.array([np.cos(bearing) * lean, np.sin(bearing) * lean, rise])
        stem = [base + np.array([0, 0, z - 30]), base + tip * 0.5 + [0, 0, z], base + tip + [0, 0, z]]
        parts += rod(stem, 1.6, (52, 108, 48), "matte", 6, 6)
        flower, size = rng.vary(petal, 20), rng.draw(10, 18)
        parts += ball(size, flower, "cloth", 10, 6, (1, 1, 0.7)).moved(*stem[2])
        parts += ball(size * 0.45, (230, 190, 60), "cloth", 8, 4).moved(*(stem[2] + [0, 0, size * 0.5]))
        # a leaf at half the stem
        leaf = ball(size, rng.vary((58, 120, 52)), "matte", 8, 4, (0.5, 0.12, 1.3))
        parts += leaf.rotated("x", rng.draw(-50, 50)).rotated("z", rng.draw(0, 180)).moved(*stem[1])
    return parts


def make_bucket(rng: Rng) -> Mesh:
    """A tapering pail, ribbed, with a wire bail up or down; empty or filled with water or sand."""
    base, top, high = rng.draw(62, 78), rng.draw(86, 104), rng.draw(130, 180)
    colour = rng.colour("bright") if rng.chance(0.6) else rng.colour("steel")
    # bright pails are plastic, grey ones metal
    material = "plastic" if max(colour) - min(colour) > 40 else "metal"
    outline = [(base, 0.0)]
    # two ribs round the pail
    for share in (rng.draw(0.25, 0.35), rng.draw(0.7, 0.85)):
        radius = base + (top - base) * share
        outline += [(radius, share * high - 3), (radius + 2.5, share * high), (radius + 1, share * high + 3)]
    outline += [(top, high - 8), (top + 4, high - 6), (top + 4, high)]
    # water, sand or earth
    content = None
    if rng.chance(0.3):
        filling = rng.pick((((120, 160, 170), "glass"), ((214, 186, 132), "matte"), ((60, 44, 34), "matte")))
        content = (rng.draw(0.6, 0.85), rng.vary(filling[0]), filling[1])
    body = vessel(np.array(outline), 3, colour, shade(colour, 0.9), material, 36, content=content)
    rise = rng.draw(0.7, 1.05) * top
    # the bail turns about the rim: upright, or down on one side
    bail = [(y, 0, z) for y, _, z in arc((0, high - 12), (top + 6, rise), 0, 180)]
    handle = rod(bail, 2.6, rng.colour("steel", "dark"), "metal", 24).rotated("z", 90)
    grip = (
        cylinder(5, -24, 24, rng.colour("wood", "dark", "bright"), "wood", 12)
        .rotated("x", 90)
        .moved(
            z=high - 12 + rise,
        )
    )
    tilt = 0.0 if rng.chance(0.6) else rng.pick((-1, 1)) * rng.draw(50, 100)
    wire = Parts(handle, grip).moved(z=12 - high).rotated("y", tilt).moved(z=high - 12)
    return finish([*body, *wire])


def make_pot(rng: Rng) -> Mesh:
    """A flowerpot with a collar, and a cactus, a bush, a rosette of leaves or flowers in it."""
    # the pot
    base, top, high = rng.draw(38, 50), rng.draw(54, 68), rng.draw(76, 108)
    collar = high * rng.draw(0.7, 0.8)
    colour = rng.colour("terracotta") if rng.chance(0.6) else rng.colour("ceramic", "bright")
    # a collar that is wider than the wall
    outline = np.array([(base, 0), (top - 4, collar), (top + 1, collar), (top + 4, high)])
    paint: Paint = colour if rng.chance(0.6) else decorate(rng, colour, "ceramic", "pale")
    parts = vessel(outline, 5, paint, shade(colour, 0.9), "matte", content=(0.85, (62, 44, 32), "matte"))
    # the plant
    kind = rng.pick(("cactus", "bush", "leaves", "flowers"))
    soil, green = high * 0.84, rng.vary(rng.pick(((62, 118, 56), (88, 138, 70), (48, 96, 62))))
    if kind == "cactus":
        tall, wide = rng.draw(70, 130), rng.draw(20, 30)
        ribs = stripes([green, shade(green, 0.72)], int(rng.integers(10, 16)))
        # a ribbed body with up to two arms
        parts += ball(wide, ribs, "matte", 24, 14, (1, 1, tall / wide / 2)).moved(z=soil + tall * 0.45)
        for side in (1, -1)[: int(rng.integers(0, 3))]:
            at = soil + tall * rng.draw(0.3, 0.5)
            arm = [(0, 0, at), (side * wide * 1.7, 0, at + 4), (side * wide * 1.9, 0, at + tall * 0.35)]
            parts += rod(arm, [wide * 0.34, wide * 0.36, wide * 0.2], green, "matte")
    elif kind == "bush":
        size = rng.draw(46, 64)
        parts += rod([(0, 0, soil - 5), (0, 0, soil + 30)], 5, (104, 74, 50), "matte")
        # six balls of leaves on a short stem
        leaves = blotches(rng, [green, shade(green, 0.7), shade(green, 1.25)], 26)
        for _ in range(6):
            place = rng.normal(0, 0.42, 3) * size * [1, 1, 0.6] + [0, 0, soil + size * 0.9]
            parts += ball(size * rng.draw(0.5, 0.7), leaves, "matte", 14, 8).moved(*place)
    elif kind == "leaves":
        # a rosette: each leaf a golden angle after the last
        for k in range(12):
            leaf = ball(rng.draw(50, 76), rng.vary(green), "matte", 8, 8, (0.05, 0.16, 1)).moved(z=48)
            parts += leaf.rotated("y", rng.draw(8, 60)).rotated("z", 137.5 * k).moved(z=soil - 6)
    else:
        parts += _flowers(rng, soil, top * 0.5, rng.draw(70, 110))
    return finish(parts)


def make_frying_pan(rng: Rng) -> Mesh:
    """A shallow round pan with a long straight handle; sometimes with a fried egg."""
    # half a pan's width, and a low wall
    radius, high = rng.draw(92, 116), rng.draw(24, 38)
    colour = rng.colour("dark", "steel", "brass", "bright")
    inside = rng.pick((rng.colour("dark"), shade(colour, 0.85)))
    material = "metal" if rng.chance(0.6) else "paint"
    outline = smooth_curve([(radius * 0.78, 0), (radius * 0.86, 4), (radius, high)], 10)
    # the bottom has a colour of its own
    content = (0.02, inside, material)
    parts = vessel(outline, 3, colour, inside, material, segments=40, floor=4.0, content=content)
    reach, grip = rng.draw(130, 190), rng.colour("dark", "wood") if rng.chance(0.7) else colour
    rise = rng.draw(4, 30)
    # the handle rises from the rim, thicker towards its end
    path = [
        (radius - 2, 0, high * 0.75), (radius + 0.3 * reach, 0, high + rise * 0.5), (radius + reach, 0, high + rise),
    ]  # fmt: skip
    parts += rod(path, [5, 6, 7.5, 8], grip, "wood", flatten=1.7)
    # a fried egg, or two
    if rng.chance(0.35):
        for side in (-1, 1)[: int(rng.integers(1, 3))]:
            white = ball(34, (248, 246, 238), "ceramic", 18, 6, (1.1, 1, 0.1)).moved(0, side * 30, 7)
            parts += Parts(white, ball(13, (240, 172, 30), "ceramic", 14, 6, (1, 1, 0.6)).moved(4, side * 32, 9))
    return finish(parts.rotated("z", rng.draw(0, 360)))


def make_toilet_tissue(rng: Rng) -> Mesh:
    """A white roll on a cardboard core, standing or lying, with a loose sheet."""
    # radii of roll and core, and the width of the paper
    radius, high, core = rng.draw(52, 66), rng.draw(88, 108), rng.draw(18, 23)
    white: Colour = rng.vary(rng.pick(((246, 245, 242), (240, 236, 228), (238, 224, 224), (222, 232, 240))), 4)
    card = (168, 134, 98)
    print_paint: Paint = white
    if rng.chance(0.4):
        print_paint = (
            dots(white, shade(white, 0.88), 16, 0.25) if rng.chance(0.5) else checks([white, shade(white, 0.95)], 20)
        )
    # the edges of the paper, as rings round the core
    rings = bands([card, white, shade(white, 0.94)], [0.08, 0.9]) if rng.chance(0.5) else white
    outer = revolve([(radius - 2, 0), (radius, 2), (radius, high - 2), (radius - 2, high)], 40, print_paint, "paper")
    top = revolve([(radius - 2, high), (core, high)], 40, rings, "paper")
    hole = revolve([(core, high), (core, 0)], 40, card, "paper")
    low = revolve([(core, 0), (radius - 2, 0)], 40, rings, "paper")
    # the loose sheet leaves the roll along its tangent, and hangs in a slight wave
    turn, loose = np.linspace(0, 0.5, 5), rng.draw(30, 100)
    path = [((radius + 1) * np.cos(a), (radius + 1) * np.sin(a)) for a in -turn[::-1]]
    path += [(radius + 1 + 0.1 * d * np.sin(d / 25), d) for d in np.linspace(6, loose, 8)]
    sheet = []
    # two faces, back to back
    for offset in (0.0, 0.8):
        rows = [np.array([(x + offset, y, z) for x, y in path]) for z in (1.0, high - 1.0)]
        sheet.append(surface(rows, print_paint, "paper"))
    sheet[0] = sheet[0].flipped()
    roll = Parts(outer, top, hole, low, sheet)
    # lying on its side
    if rng.chance(0.45):
        roll = roll.moved(z=-high / 2).rotated("x", 90).rotated("y", -90)
        roll = roll.rotated("z", rng.draw(0, 360))
    return finish(roll)


def make_wine_bottle(rng: Rng) -> Mesh:
    """A tall dark bottle with a long neck, a foil capsule and a label; straight or sloping shoulders."""
    # radius and height, then the neck
    radius, high = rng.draw(34, 42), rng.draw(270, 310)
    neck, sloping = rng.draw(12.5, 15), rng.chance(0.45)
    wall_top = high * (rng.draw(0.42, 0.5) if sloping else rng.draw(0.58, 0.65))
    shoulder = high * (rng.draw(0.72, 0.8) if sloping else rng.draw(0.7, 0.74))
    glass = rng.vary(rng.pick(((24, 44, 28), (34, 26, 18), (52, 74, 36), (22, 24, 26), (84, 96, 52))), 6)
    paper, ink = rng.colour("pale"), rng.colour("dark", "bright")
    foil = rng.colour("bright", "dark", "brass")
    # the label is on the straight wall
    from_z, to_z = wall_top * rng.draw(0.15, 0.3), wall_top * rng.draw(0.75, 0.95)
    sign = label(glass, paper, ink, pick_word(rng), width=rng.draw(0.35, 0.6), height=(0, 1))
    # from the wall over the shoulder to the neck
    curve = [
        (radius, to_z), (radius, wall_top),
        (radius * 0.86, wall_top + 0.45 * (shoulder - wall_top)),
        (neck, shoulder),
    ]  # fmt: skip
    # from below: foot, wall, label, shoulder, foil and rim
    return finish(
        [
            *cylinder(radius - 3, 0, 3, glass, "glass", 32, radius),
            revolve([(radius, 3), (radius, from_z)], 32, glass, "glass"),
            revolve([(radius, from_z), (radius, to_z)], 32, sign, "paper"),
            lathe([*curve, (neck, high * 0.82)], glass, "glass", 22),
            revolve([(neck, high * 0.82), (neck + 1, high * 0.82), (neck + 0.6, high - 12)], 32, foil, "metal"),
            *cylinder(neck + 2, high - 12, high, foil, "metal", 32, bevel=1.5),
        ],
        512,
    )


def make_pop_bottle(rng: Rng) -> Mesh:
    """A plastic bottle of coloured drink: lobed foot, waist, a bright label band and a screw cap."""
    # proportions and colours
    radius, high = rng.draw(36, 44), rng.draw(210, 270)
    waist = radius * rng.draw(0.8, 1.0)
    drink = rng.vary(rng.pick(((58, 26, 18), (236, 120, 24), (70, 160, 60), (206, 226, 226), (200, 40, 60),
                                 (240, 206, 60))), 8)  # fmt: skip
    band = rng.colour("bright")
    ink = rng.pick(((250, 250, 246), (250, 220, 60), shade(band, 0.3)))
    # the label goes round the waist
    low, top = high * rng.draw(0.36, 0.44), high * rng.draw(0.58, 0.66)
    sign = label(band, band, ink, pick_word(rng), (0.25, 0.75), 0.4, (0.02, 0.98))
    # the foot has five lobes
    foot = lathe([(radius * 0.6, 0), (radius * 0.95, 10), (radius, 28), (waist, low)], drink, "glass", 18)
    lobes = 5

    # pressed in between the lobes, less and less up to 30 mm
    def dent(points: np.ndarray) -> np.ndarray:
        angle = np.arctan2(points[:, 1], points[:, 0])
        share = 1 - 0.16 * np.clip(1 - points[:, 2] / 30, 0, 1) * (1 + np.cos(lobes * angle)) / 2
        return points * np.stack([share, share, np.ones_like(share)], 1)

    # shoulder, neck and cap
    neck = rng.draw(11, 13)
    shoulder = [(waist, top), (radius * 0.98, top + 0.08 * high), (radius * 0.7, high * 0.82), (neck, high * 0.91)]
    cap = rng.pick((band, (246, 246, 244), rng.colour("bright")))
    # from below: foot, label, shoulder, a ring for the cap, and the cap
    return finish(
        [
            foot.bent(dent),
            disc(radius * 0.5, -1.0, drink, "glass").rotated("x", 180),
            revolve([(waist, low), (waist + 0.6, low), (waist + 0.6, top), (waist, top)], 32, sign, "paper"),
            lathe(shoulder, drink, "glass", 16),
            revolve([(neck, high * 0.91), (neck + 4, high * 0.91), (neck + 4, high * 0.92), (neck, high * 0.92)], 24,
                    shade(drink, 1.1), "glass"),
            *cylinder(neck + 1.5, high * 0.92, high, stripes([cap, shade(cap, 0.8)], 30), "plastic", 32, bevel=1),
        ],
        512,
    )  # fmt: skip


def make_milk_can(rng: Rng) -> Mesh:
    """A dairy's churn: a metal cylinder with a sloping shoulder, a neck, a mushroom lid and two ears."""
    radius, high = rng.draw(52, 66), rng.draw(190, 240)
    # heights of wall and neck, and the neck's radius
    wall_top, neck_low, neck = high * rng.draw(0.56, 0.64), high * rng.draw(0.74, 0.8), radius * rng.draw(0.5, 0.62)
    metal = rng.colour("steel") if rng.chance(0.65) else rng.colour("car", "bright", "pale")
    material = "metal" if max(metal) - min(metal) < 30 else "paint"
    dark = shade(metal, 0.75)
    body = [(0.0, 0.0), (radius + 2, 0.0), (radius + 2, 6.0), (radius, 7.0)]
    # two hoops round the wall
    for z in (wall_top * 0.3, wall_top * 0.7):
        body += [(radius, z - 3), (radius + 2, z), (radius, z + 3)]
    body += [(radius, wall_top), (neck, neck_low), (neck, high - 18)]
    lid = [(neck + 2, high - 18), (neck + 8, high - 10), (neck + 9, high - 4), (neck * 0.6, high), (0, high + 2)]
    ears = Parts()
    # ears from neck to shoulder
    for side in (1, -1):
        loop = [
            (0, side * neck, neck_low + 6), (0, side * (neck + 26), neck_low + 2),
            (0, side * (radius + 4), wall_top + 18), (0, side * (radius - 6), wall_top + 6),
        ]  # fmt: skip
        ears += rod(loop, 4.5, dark, material)
    # a handle on the lid
    top = rod([(-14, 0, high), (-10, 0, high + 14), (10, 0, high + 14), (14, 0, high)], 3, dark, material)
    return finish([revolve(body, 36, metal, material), lathe(lid, metal, material, 12), *ears, *top])


def make_eggnog(rng: Rng) -> Mesh:
    """Eggnog in a glass bottle, a gable-top carton, a jug with a handle, or poured into a glass with cinnamon."""
    return finish(rng.pick((_nog_bottle, _nog_carton, _nog_jug, _nog_glass, _nog_glass))(rng), 512)


def _name(rng: Rng, ground: Colour) -> Paint:
    """Two labels on a ground of cream."""
    paper, ink = rng.pick([pair for pair in FESTIVE if pair[0][2] < 150])
    back = paper if rng.chance(0.3) else ground
    return label(back, paper, ink, rng.pick(NAMES), (0.25, 0.75), rng.draw(0.34, 0.44), (0.02, 0.98))


def _nog_bottle(rng: Rng) -> Parts:
    radius, high = rng.draw(42, 56), rng.draw(170, 220)
    neck, cream = radius * rng.draw(0.45, 0.6), rng.vary(CREAM, 5)
    low, top = high * rng.draw(0.1, 0.2), high * rng.draw(0.42, 0.52)
    cap = rng.colour("bright", "brass")
    # shoulder and neck above the label
    upper = [(radius, top), (radius, high * 0.56), (radius * 0.8, high * 0.68), (neck, high * 0.8), (neck, high * 0.9)]
    return Parts(
        cylinder(radius - 3, 0, low, cream, "glass", 32, radius),
        revolve([(radius, low), (radius, top)], 32, _name(rng, cream), "paper"),
        lathe(upper, cream, "glass"),
        revolve([(neck, high * 0.9), (neck + 3, high * 0.93), (neck, high * 0.96)], 32, (216, 226, 218), "glass"),
        cylinder(neck + 2, high * 0.94, high, cap, "plastic", 32, bevel=2),
    )


def _nog_carton(rng: Rng) -> Parts:
    side, high, gable = rng.draw(70, 92), rng.draw(120, 175), rng.draw(28, 42)
    paper, ink = rng.pick(FESTIVE)
    half = side / 2
    # a square ring, closed: round the carton
    ring = np.array([(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)])
    rows = [np.c_[ring, np.full(5, z)] for z in (0.0, high)]
    # a label on each of the four sides
    front = label(paper, rng.vary(CREAM if paper != FESTIVE[2][0] else FOAM, 6), ink if ink[0] < 200 else paper,
                  rng.pick(NAMES),
                  (0.125, 0.375, 0.625, 0.875), 0.2, (0.25, 0.75))  # fmt: skip
    # a gable roof: its ridge runs across, closed by the flap above it
    ridge = np.array([(-half, 0), (half, 0), (half, 0), (-half, 0), (-half, 0)]) * [1, 0]
    roof = [rows[1], np.c_[ridge * [0.999, 1] + ring * [0, 0.03], np.full(5, high + gable)]]
    cap = cylinder(12, 0, 12, rng.colour("bright"), "plastic", 16)
    # the cap sits on the slope of the roof
    slope = np.degrees(np.arctan2(gable, half))
    cap = cap.rotated("x", -slope).moved(0, half * 0.5, high + gable * 0.5)
    return Parts(
        surface(rows, front, "paper"), surface(roof, rng.pick((paper, ink)), "paper"),
        block((side, side, 1), (0, 0, 0), paper, "paper"),
        block((side, 3, 18), (0, 0, high + gable + 7), paper, "paper"),
        (cap if rng.chance(0.5) else []),
    )  # fmt: skip


def _nog_jug(rng: Rng) -> Parts:
    # half a side and the height
    half, high, cream = rng.draw(42, 54), rng.draw(160, 200), rng.vary(CREAM, 5)
    rows = []
    # share of the width, and height as a share: foot, label, shoulder, neck
    for share, z in ((0.9, 0), (1, 0.05), (1, 0.14), (1, 0.5), (1, 0.56), (0.78, 0.72), (0.34, 0.88), (0.34, 0.95)):
        angle = np.linspace(np.pi, 3 * np.pi, 33)
        # a square with round corners
        round_off = np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle))) ** 0.75
        rows.append(np.stack([half * share / round_off * np.cos(angle), half * share / round_off * np.sin(angle),
                              np.full(33, z * high)], 1))  # fmt: skip
    # from the shoulder down to the wall
    handle = [(-half * 0.2, 0, high * 0.88), (-half * 0.95, 0, high * 0.86), (-half * 1.35, 0, high * 0.66),
              (-half * 0.98, 0, high * 0.42)]  # fmt: skip
    return Parts(
        surface(rows[:3], cream, "plastic"), surface(rows[2:4], _name(rng, cream), "paper"),
        surface(rows[3:], cream, "plastic"),
        block((half * 1.2, half * 1.2, 1), (0, 0, 0.5), cream),
        cylinder(half * 0.38, high * 0.94, high * 1.03, rng.colour("bright"), "plastic", 24, bevel=1.5),
        rod(handle, half * 0.17, cream, "plastic"),
    )  # fmt: skip


def _nog_glass(rng: Rng) -> Parts:
    # on a stem, or a tumbler
    stem = rng.draw(35, 60) if rng.chance(0.5) else 0.0
    radius, high = rng.draw(34, 44), rng.draw(80, 130)
    clear, cream = (214, 224, 220), rng.vary(CREAM, 5)
    outline = smooth_curve([(radius * (0.35 if stem else 0.8), 0), (radius * 0.85, high * 0.2), (radius, high * 0.6),
                            (radius * 1.02, high * 0.9)], 16)  # fmt: skip
    # foam with grated nutmeg
    foam = scatter(rng, FOAM, [(134, 88, 46), (160, 112, 64)], 90, 0.012)
    cup = vessel(outline, 2.5, cream, clear, "glass", content=(0.94, foam, "matte"))
    top = high * 0.9
    # the rim stands above the drink
    lip = [
        (outline[-1, 0], top), (outline[-1, 0] + 0.5, top + 9), (outline[-1, 0] - 2, top + 9),
        (outline[-1, 0] - 2, top),
    ]  # fmt: skip
    bark = wood_grain(rng, (134, 78, 40), "v")
    lean = radius * rng.draw(0.5, 0.8)
    stick = rod([(-lean * 0.2, 0, high * 0.5), (lean, 0, high + rng.draw(34, 60))], rng.draw(5, 7), bark, "wood")
    parts = Parts(cup, revolve(lip, 32, clear, "glass"), stick.rotated("z", rng.draw(0, 360))).moved(z=stem)
    # a stem on a foot, or perhaps an ear
    if stem:
        parts += cylinder(radius * 0.8, 0, 4, clear, "glass", 32)
        parts += lathe([(radius * 0.8, 4), (6, 10), (5, stem * 0.6), (radius * 0.36, stem)], clear, "glass", 14)
    elif rng.chance(0.4):
        ear = [(-radius * 0.9, 0, high * 0.72), (-radius * 1.6, 0, high * 0.66), (-radius * 1.55, 0, high * 0.36),
               (-radius * 0.88, 0, high * 0.28)]  # fmt: skip
        parts += rod(ear, 4, clear, "glass")
    # a ball of cream
    if rng.chance(0.3):
        parts += ball(9, (250, 246, 236), "matte", 12, 8).moved(0, 0, stem + top)
    return parts
