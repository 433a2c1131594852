"""Vessels: pots, jugs, mugs, vases, buckets, pans, bottles, cans, cartons, glasses; and a roll of tissue."""

import numpy as np

from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content.drawing import (
    Colour,
    Paint,
    bands,
    blotches,
    chance,
    checks,
    decorate,
    dots,
    draw,
    label,
    pick,
    pick_colour,
    pick_word,
    scatter,
    shade,
    stripes,
    vary,
    wood_grain,
)
from toolkit.rooms.worlds.content.modelling import (
    Part,
    arc,
    ball,
    block,
    cylinder,
    disc,
    finish,
    lathe,
    moved,
    net_part,
    outward,
    push,
    revolve,
    rod,
    slab,
    smooth_curve,
    turned,
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


def make_coffeepot(rng: np.random.Generator) -> Mesh:
    """An enamel pot, a moka pot, a percolator, or a silver pot with a swan's neck."""
    parts = pick(rng, (_enamel_pot, _moka_pot, _percolator, _silver_pot))(rng)
    return finish(turned(parts, "z", draw(rng, -100, -80)))


def _spout(
    root: tuple[float, float], tip: tuple[float, float], radius: tuple[float, float], colour: Paint, material: str,
    curl: float = 0.3,
) -> list[Part]:  # fmt: skip
    """A tapering spout to +x with a dark mouth; `curl` bends it into an S."""
    (x0, z0), (x1, z1) = root, tip
    points = [(x0, 0, z0), (x0 + (x1 - x0) * (0.3 + curl * 0.5), 0, z0 + (z1 - z0) * (0.3 - curl * 0.5)),
              (x0 + (x1 - x0) * 0.62, 0, z0 + (z1 - z0) * 0.6), (x1, 0, z1)]  # fmt: skip
    pipe = rod(points, [radius[0], radius[0] * 0.7 + radius[1] * 0.3, radius[1] * 1.1, radius[1]], colour, material)
    ahead = np.array([points[-1][0] - points[-2][0], 0, points[-1][2] - points[-2][2]])
    end = np.array([points[-1], points[-1] + 0.01 * ahead / np.linalg.norm(ahead) * 30])
    return [*pipe, *rod(end, radius[1] * 0.75, (20, 18, 18), material)]


def _knob(rng: np.random.Generator, z: float, radius: float, colour: Paint, material: str) -> list[Part]:
    return [
        *cylinder(radius * 0.5, z - radius * 0.4, z + radius * 0.6, colour, material, 12),
        ball(radius, colour, material, 16, 8, (1, 1, draw(rng, 0.6, 1.2))).moved(z=z + radius),
    ]


def _loop(
    top: tuple[float, float], low: tuple[float, float], reach: float, radius: float, colour: Paint, material: str
) -> list[Part]:
    """A handle to -x from a high to a low place."""
    (x0, z0), (x1, z1) = top, low
    points = [(x0, 0, z0), (x0 - reach * 0.8, 0, z0 + 0.05 * (z0 - z1)),
              (min(x0, x1) - reach, 0, z0 - 0.35 * (z0 - z1)),
              (min(x0, x1) - reach * 0.75, 0, z0 - 0.75 * (z0 - z1)), (x1, 0, z1)]  # fmt: skip
    return rod(points, radius, colour, material, 18, flatten=1.4)


def _enamel_pot(rng: np.random.Generator) -> list[Part]:
    base, top, high = draw(rng, 55, 75), draw(rng, 36, 52), draw(rng, 150, 220)
    colour, trim = pick_colour(rng, "ceramic", "bright", "pale"), pick_colour(rng, "dark")
    specks = pick_colour(rng, "pale", "dark")
    paint = scatter(rng, colour, [specks], 160, 0.004) if chance(rng, 0.5) else decorate(rng, colour, "pale", "bright")
    lid = [(top + 3, high), (top + 3, high + 4), (top * 0.6, high + draw(rng, 10, 26)), (top * 0.1, high + 28)]
    middle = (base + top) / 2
    return [
        *cylinder(base, 0, 4, trim, "paint", 32),
        lathe([(base, 4), (base, 10), (middle + 3, high * 0.5), (top, high)], paint, "paint"),
        lathe(lid, colour, "paint", 10),
        *_knob(rng, high + 28, draw(rng, 7, 11), trim, "plastic"),
        *_spout((middle - 2, high * draw(rng, 0.35, 0.5)), (base + draw(rng, 25, 50), high * draw(rng, 0.88, 1.02)),
                (draw(rng, 14, 19), draw(rng, 7, 9)), colour, "paint"),
        *_loop((-top, high * 0.93), (-middle, high * draw(rng, 0.3, 0.45)), draw(rng, 35, 50), draw(rng, 5, 7),
               pick(rng, (trim, colour)), "paint"),
    ]  # fmt: skip


def _moka_pot(rng: np.random.Generator) -> list[Part]:
    base, waist, top = draw(rng, 48, 56), draw(rng, 36, 42), draw(rng, 46, 58)
    low, high = draw(rng, 62, 80), draw(rng, 150, 185)
    metal = pick_colour(rng, "steel") if chance(rng, 0.7) else pick_colour(rng, "bright")
    black = pick_colour(rng, "dark") if chance(rng, 0.8) else pick_colour(rng, "bright", "wood")
    sides = pick(rng, (8, 8, 10))
    body = [(0, 0), (base, 0), (base, 4), (waist + 4, low), (waist + 4, low + 10), (waist, low + 10), (waist, low + 14)]
    cone = revolve([*body, (top, high)], sides, metal, "metal")
    lid = revolve([(top + 2, high), (top + 2, high + 3), (top * 0.3, high + 22), (0, high + 24)], sides, metal, "metal")
    lip = slab([(top - 12, high - 34), (top + 20, high - 2), (top - 12, high - 2)], 22, metal, "metal")
    reach = draw(rng, 42, 58)
    grip = [(-top + 4, high - 12), (-top + 4, high - 1), (-top - reach, high - 6), (-top - reach + 6, low + 4),
            (-top - reach + 16, low + 4), (-top - reach + 14, high - 20)]  # fmt: skip
    knob = cylinder(7, high + 23, high + 44, black, "plastic", 12, 10)
    return [cone, lid, *lip, *slab(grip, 13, black, "plastic"), *knob]


def _percolator(rng: np.random.Generator) -> list[Part]:
    base, top, high = draw(rng, 52, 62), draw(rng, 44, 54), draw(rng, 170, 220)
    metal, black = pick_colour(rng, "steel"), pick_colour(rng, "dark", "wood")
    wall = [(base, 16), (base, 24), (top + 2, high * 0.9), (top, high)]
    out = -top - draw(rng, 42, 58)
    handle = [(-top + 3, 0, high * 0.9), (out, 0, high * 0.92), (out - 4, 0, high * 0.55), (out + 12, 0, high * 0.35)]
    return [
        *cylinder(base + 4, 0, 16, black, "plastic", 32, base),
        lathe(wall, metal, "metal"),
        lathe([(top + 2, high), (top + 2, high + 5), (top * 0.5, high + 14), (14, high + 18)], metal, "metal", 10),
        *cylinder(12, high + 17, high + 36, (196, 206, 204), "glass", 16, 9, bevel=3),
        *_spout((top - 3, high * draw(rng, 0.6, 0.74)), (base + draw(rng, 20, 34), high * draw(rng, 0.9, 0.98)),
                (18, 9), metal, "metal", 0.0),
        *rod(handle, [6, 8, 9, 7], black, "plastic", flatten=1.5),
    ]  # fmt: skip


def _silver_pot(rng: np.random.Generator) -> list[Part]:
    belly, neck, high = draw(rng, 52, 64), draw(rng, 24, 32), draw(rng, 175, 215)
    metal = pick_colour(rng, "steel", "brass", "ceramic")
    material = "metal" if max(metal) - min(metal) < 130 else "ceramic"
    wall = [(belly * 0.6, 0), (belly * 0.62, 5), (belly * 0.42, 14), (belly * 0.9, 36), (belly, 62),
            (neck + 8, high * 0.66), (neck, high * 0.86), (neck + 5, high)]  # fmt: skip
    lid = [(neck + 5, high), (neck + 1, high + 8), (neck * 0.6, high + 20), (3, high + 24)]
    handle = pick_colour(rng, "wood", "dark") if chance(rng, 0.5) else metal
    return [
        lathe(wall, metal, material, 34), lathe(lid, metal, material, 12), *_knob(rng, high + 24, 7, metal, material),
        *_spout((belly - 6, high * 0.3), (belly + draw(rng, 38, 52), high * 0.92), (14, 6), metal, material, 0.5),
        *_loop((-neck - 2, high * 0.92), (-belly + 3, high * 0.4), draw(rng, 34, 46), 5, handle, "plastic"),
    ]  # fmt: skip


def make_teapot(rng: np.random.Generator) -> Mesh:
    """Round and squat, with a bowed spout, a loop (or a bail over the top) and a lid with a knob."""
    belly, high = draw(rng, 62, 82), draw(rng, 78, 112)
    colour = pick_colour(rng, "ceramic", "pale", "bright")
    trim = pick(rng, (colour, shade(colour, 0.6), pick_colour(rng, "ceramic", "dark")))
    foot, neck = belly * draw(rng, 0.5, 0.68), belly * draw(rng, 0.42, 0.56)
    full = draw(rng, 0.4, 0.55) * high
    # from the foot over the belly to the neck
    wall = [(foot, 0), (foot, 3), (belly * 0.9, full * 0.5), (belly, full), (belly * 0.88, full + (high - full) * 0.6),
            (neck, high)]  # fmt: skip
    lid = [(neck + 2, high), (neck + 1, high + 4), (neck * 0.6, high + 13), (4, high + 17)]
    body = lathe(wall, decorate(rng, colour, "ceramic", "bright"), "ceramic", 24)
    parts = [body, lathe(lid, trim, "ceramic", 10), *_knob(rng, high + 17, draw(rng, 6, 10), trim, "ceramic")]
    tip = belly + draw(rng, 40, 60), high * draw(rng, 0.85, 1.05)
    parts += _spout((belly * 0.86, full * 0.7), tip, (draw(rng, 13, 17), draw(rng, 6, 8)), colour, "ceramic", 0.25)
    # a bail over the top, or an ear behind
    if chance(rng, 0.25):
        over = arc((0, high * 0.8), (belly * 0.8, draw(rng, 75, 95)), 8, 172)
        parts += rod(over, 4.5, pick_colour(rng, "wood", "dark", "brass"), "wood")
    else:
        ear = (-belly * 0.86, high * 0.82), (-belly * 0.93, full * 0.6)
        parts += _loop(*ear, draw(rng, 32, 44), draw(rng, 5, 7), trim, "ceramic")
    return finish(turned(parts, "z", draw(rng, -100, -80)))


def make_pitcher(rng: np.random.Generator) -> Mesh:
    """A tall open jug, its rim drawn out into a lip, with a large handle."""
    belly, high = draw(rng, 52, 68), draw(rng, 170, 230)
    neck, mouth = belly * draw(rng, 0.55, 0.95), belly * draw(rng, 0.7, 1.02)
    outline = smooth_curve(
        [(belly * 0.72, 0), (belly * 0.95, high * 0.15), (belly, high * 0.35), (neck, high * 0.78), (mouth, high)], 26
    )
    colour = pick_colour(rng, "ceramic", "pale", "bright", "steel")
    inside = pick(rng, (colour, (238, 234, 226)))
    reach, lift = draw(rng, 24, 40), draw(rng, 4, 16)

    def draw_lip(points: np.ndarray) -> np.ndarray:
        angle = np.arctan2(points[:, 1], points[:, 0])
        # the rim is pushed out over the spout, less below and to the sides; the axis stays
        high_up = np.clip((points[:, 2] / high - 0.72) / 0.28, 0, 1) ** 2
        share = np.exp(-((angle / 0.42) ** 2)) * high_up * (np.hypot(points[:, 0], points[:, 1]) > mouth * 0.4)
        return points + share[:, None] * np.array([reach, 0, lift])

    paint = decorate(rng, colour, "ceramic", "bright")
    body = [push(part, draw_lip) for part in vessel(outline, 4, paint, inside, "ceramic")]
    ear = (-neck * 0.96, high * 0.86), (-belly + 2, high * draw(rng, 0.3, 0.42))
    handle = _loop(*ear, draw(rng, 36, 54), draw(rng, 6, 8), colour, "ceramic")
    return finish(turned([*body, *outward(handle)], "z", draw(rng, -100, -80)))


def make_coffee_mug(rng: np.random.Generator) -> Mesh:
    """A cylinder with a C-shaped handle, often with coffee in it."""
    radius, flare, high = draw(rng, 38, 48), draw(rng, 0.88, 1.12), draw(rng, 80, 112)
    colour = pick_colour(rng, "ceramic", "pale", "bright")
    points = [(radius * 0.9, 0), (radius, 6), (radius * (1 + flare) / 2, high * 0.5), (radius * flare, high)]
    outline = smooth_curve(points, 16)
    coffee: tuple[float, Paint, str] | None = None
    if chance(rng, 0.6):
        coffee = draw(rng, 0.7, 0.9), vary(rng, pick(rng, ((46, 26, 16), (150, 104, 66), (96, 56, 34)))), "glass"
    inside = pick(rng, (colour, (240, 236, 228)))
    paint = decorate(rng, colour, "bright", "ceramic")
    body = vessel(outline, 4, paint, inside, "ceramic", content=coffee)
    root, reach = radius * (1 + flare) / 2 - 3, draw(rng, 26, 36)
    loop = arc((root, high * 0.52), (reach, high * draw(rng, 0.28, 0.36)), 88, -88)
    parts = [*body, *rod(loop, draw(rng, 4.5, 6.5), colour, "ceramic", flatten=1.5)]
    return finish(turned(parts, "z", draw(rng, 60, 120)))


def make_vase(rng: np.random.Generator) -> Mesh:
    """A slender or bellied vase with a neck, a flared mouth and a pattern, with flowers or without."""
    belly, high = draw(rng, 40, 64), draw(rng, 170, 240)
    full, pinch = draw(rng, 0.35, 0.68), draw(rng, 0.3, 0.55)
    mouth = belly * draw(rng, pinch + 0.1, 0.85)
    foot = belly * draw(rng, 0.45, 0.7)
    # foot, belly, pinched neck, flared mouth
    outline = smooth_curve(
        [(foot, 0), (foot * 0.95, 6), (belly * 0.86, high * full * 0.55), (belly, high * full),
         (belly * pinch, high * 0.88), (mouth, high)], 30,
    )  # fmt: skip
    colour = pick_colour(rng, "ceramic", "bright", "pale", "dark")
    paint = decorate(rng, colour, "ceramic", "bright", "brass")
    parts = vessel(outline, 3.5, paint, shade(colour, 0.7), "ceramic")
    if chance(rng, 0.45):
        parts += _flowers(rng, high, belly * pinch * 0.6, draw(rng, 70, 120))
    elif chance(rng, 0.3):
        for turn in (0, 180):
            ear = [(belly * pinch, 0, high * 0.86), (belly * 1.05, 0, high * 0.8), (belly * 0.9, 0, high * full)]
            parts += turned(rod(ear, 4, colour, "ceramic"), "z", turn)
    return finish(parts)


def _flowers(rng: np.random.Generator, z: float, width: float, reach: float) -> list[Part]:
    parts, petal = [], pick_colour(rng, "bright", "pale")
    count = int(rng.integers(4, 9))
    for k in range(count):
        bearing = 2 * np.pi * k / count + draw(rng, -0.4, 0.4)
        lean, rise = draw(rng, 0.15, 0.6) * reach, reach * draw(rng, 0.6, 1)
        # stems lean out of the mouth, each on its own side
        base = np.array([np.cos(bearing), np.sin(bearing), 0]) * width * 0.6
        tip = np.array([np.cos(bearing) * lean, np.sin(bearing) * lean, rise])
        stem = [base + np.array([0, 0, z - 30]), base + tip * 0.5 + [0, 0, z], base + tip + [0, 0, z]]
        parts += rod(stem, 1.6, (52, 108, 48), "matte", 6, 6)
        flower, size = vary(rng, petal, 20), draw(rng, 10, 18)
        parts.append(ball(size, flower, "cloth", 10, 6, (1, 1, 0.7)).moved(*stem[2]))
        parts.append(ball(size * 0.45, (230, 190, 60), "cloth", 8, 4).moved(*(stem[2] + [0, 0, size * 0.5])))
        leaf = ball(size, vary(rng, (58, 120, 52)), "matte", 8, 4, (0.5, 0.12, 1.3))
        parts.append(leaf.rotated("x", draw(rng, -50, 50)).rotated("z", draw(rng, 0, 180)).moved(*stem[1]))
    return parts


def make_bucket(rng: np.random.Generator) -> Mesh:
    """A tapering pail, ribbed, with a wire bail up or down; empty or filled with water or sand."""
    base, top, high = draw(rng, 62, 78), draw(rng, 86, 104), draw(rng, 130, 180)
    colour = pick_colour(rng, "bright") if chance(rng, 0.6) else pick_colour(rng, "steel")
    material = "plastic" if max(colour) - min(colour) > 40 else "metal"
    outline = [(base, 0.0)]
    # two ribs round the pail
    for share in (draw(rng, 0.25, 0.35), draw(rng, 0.7, 0.85)):
        radius = base + (top - base) * share
        outline += [(radius, share * high - 3), (radius + 2.5, share * high), (radius + 1, share * high + 3)]
    outline += [(top, high - 8), (top + 4, high - 6), (top + 4, high)]
    content = None
    if chance(rng, 0.3):
        filling = pick(rng, (((120, 160, 170), "glass"), ((214, 186, 132), "matte"), ((60, 44, 34), "matte")))
        content = (draw(rng, 0.6, 0.85), vary(rng, filling[0]), filling[1])
    body = vessel(np.array(outline), 3, colour, shade(colour, 0.9), material, 36, content=content)
    rise = draw(rng, 0.7, 1.05) * top
    # the bail turns about the rim: upright, or down on one side
    bail = [(y, 0, z) for y, _, z in arc((0, high - 12), (top + 6, rise), 0, 180)]
    handle = turned(rod(bail, 2.6, pick_colour(rng, "steel", "dark"), "metal", 24), "z", 90)
    grip = moved(
        turned(cylinder(5, -24, 24, pick_colour(rng, "wood", "dark", "bright"), "wood", 12), "x", 90),
        z=high - 12 + rise,
    )
    tilt = 0.0 if chance(rng, 0.6) else pick(rng, (-1, 1)) * draw(rng, 50, 100)
    wire = [part.moved(z=12 - high).rotated("y", tilt).moved(z=high - 12) for part in [*handle, *grip]]
    return finish([*body, *wire])


def make_pot(rng: np.random.Generator) -> Mesh:
    """A flowerpot with a collar, and a cactus, a bush, a rosette of leaves or flowers in it."""
    # the pot
    base, top, high = draw(rng, 38, 50), draw(rng, 54, 68), draw(rng, 76, 108)
    collar = high * draw(rng, 0.7, 0.8)
    colour = pick_colour(rng, "terracotta") if chance(rng, 0.6) else pick_colour(rng, "ceramic", "bright")
    outline = np.array([(base, 0), (top - 4, collar), (top + 1, collar), (top + 4, high)])
    paint: Paint = colour if chance(rng, 0.6) else decorate(rng, colour, "ceramic", "pale")
    parts = vessel(outline, 5, paint, shade(colour, 0.9), "matte", content=(0.85, (62, 44, 32), "matte"))
    # the plant
    kind = pick(rng, ("cactus", "bush", "leaves", "flowers"))
    soil, green = high * 0.84, vary(rng, pick(rng, ((62, 118, 56), (88, 138, 70), (48, 96, 62))))
    if kind == "cactus":
        tall, wide = draw(rng, 70, 130), draw(rng, 20, 30)
        ribs = stripes([green, shade(green, 0.72)], int(rng.integers(10, 16)))
        parts.append(ball(wide, ribs, "matte", 24, 14, (1, 1, tall / wide / 2)).moved(z=soil + tall * 0.45))
        for side in (1, -1)[: int(rng.integers(0, 3))]:
            at = soil + tall * draw(rng, 0.3, 0.5)
            arm = [(0, 0, at), (side * wide * 1.7, 0, at + 4), (side * wide * 1.9, 0, at + tall * 0.35)]
            parts += rod(arm, [wide * 0.34, wide * 0.36, wide * 0.2], green, "matte")
    elif kind == "bush":
        size = draw(rng, 46, 64)
        parts += rod([(0, 0, soil - 5), (0, 0, soil + 30)], 5, (104, 74, 50), "matte")
        leaves = blotches(rng, [green, shade(green, 0.7), shade(green, 1.25)], 26)
        for _ in range(6):
            place = rng.normal(0, 0.42, 3) * size * [1, 1, 0.6] + [0, 0, soil + size * 0.9]
            parts.append(ball(size * draw(rng, 0.5, 0.7), leaves, "matte", 14, 8).moved(*place))
    elif kind == "leaves":
        for k in range(12):
            leaf = ball(draw(rng, 50, 76), vary(rng, green), "matte", 8, 8, (0.05, 0.16, 1)).moved(z=48)
            parts.append(leaf.rotated("y", draw(rng, 8, 60)).rotated("z", 137.5 * k).moved(z=soil - 6))
    else:
        parts += _flowers(rng, soil, top * 0.5, draw(rng, 70, 110))
    return finish(parts)


def make_frying_pan(rng: np.random.Generator) -> Mesh:
    """A shallow round pan with a long straight handle; sometimes with a fried egg."""
    radius, high = draw(rng, 92, 116), draw(rng, 24, 38)
    colour = pick_colour(rng, "dark", "steel", "brass", "bright")
    inside = pick(rng, (pick_colour(rng, "dark"), shade(colour, 0.85)))
    material = "metal" if chance(rng, 0.6) else "paint"
    outline = smooth_curve([(radius * 0.78, 0), (radius * 0.86, 4), (radius, high)], 10)
    content = (0.02, inside, material)
    parts = vessel(outline, 3, colour, inside, material, segments=40, floor=4.0, content=content)
    reach, grip = draw(rng, 130, 190), pick_colour(rng, "dark", "wood") if chance(rng, 0.7) else colour
    rise = draw(rng, 4, 30)
    # the handle rises from the rim, thicker towards its end
    path = [
        (radius - 2, 0, high * 0.75), (radius + 0.3 * reach, 0, high + rise * 0.5), (radius + reach, 0, high + rise),
    ]  # fmt: skip
    parts += rod(path, [5, 6, 7.5, 8], grip, "wood", flatten=1.7)
    if chance(rng, 0.35):
        for side in (-1, 1)[: int(rng.integers(1, 3))]:
            white = ball(34, (248, 246, 238), "ceramic", 18, 6, (1.1, 1, 0.1)).moved(0, side * 30, 7)
            parts += [white, ball(13, (240, 172, 30), "ceramic", 14, 6, (1, 1, 0.6)).moved(4, side * 32, 9)]
    return finish(turned(parts, "z", draw(rng, 0, 360)))


def make_toilet_tissue(rng: np.random.Generator) -> Mesh:
    """A white roll on a cardboard core, standing or lying, with a loose sheet."""
    radius, high, core = draw(rng, 52, 66), draw(rng, 88, 108), draw(rng, 18, 23)
    white: Colour = vary(rng, pick(rng, ((246, 245, 242), (240, 236, 228), (238, 224, 224), (222, 232, 240))), 4)
    card = (168, 134, 98)
    print_paint: Paint = white
    if chance(rng, 0.4):
        print_paint = (
            dots(white, shade(white, 0.88), 16, 0.25) if chance(rng, 0.5) else checks([white, shade(white, 0.95)], 20)
        )
    rings = bands([card, white, shade(white, 0.94)], [0.08, 0.9]) if chance(rng, 0.5) else white
    outer = revolve([(radius - 2, 0), (radius, 2), (radius, high - 2), (radius - 2, high)], 40, print_paint, "paper")
    top = revolve([(radius - 2, high), (core, high)], 40, rings, "paper")
    hole = revolve([(core, high), (core, 0)], 40, card, "paper")
    low = revolve([(core, 0), (radius - 2, 0)], 40, rings, "paper")
    # the loose sheet leaves the roll along its tangent, and hangs in a slight wave
    turn, loose = np.linspace(0, 0.5, 5), draw(rng, 30, 100)
    path = [((radius + 1) * np.cos(a), (radius + 1) * np.sin(a)) for a in -turn[::-1]]
    path += [(radius + 1 + 0.1 * d * np.sin(d / 25), d) for d in np.linspace(6, loose, 8)]
    sheet = []
    for offset in (0.0, 0.8):
        rows = [np.array([(x + offset, y, z) for x, y in path]) for z in (1.0, high - 1.0)]
        sheet.append(net_part(rows, print_paint, "paper"))
    sheet[0] = sheet[0].flipped()
    roll = [outer, top, hole, low, *sheet]
    if chance(rng, 0.45):
        roll = turned(turned(moved(roll, z=-high / 2), "x", 90), "y", -90)
        roll = turned(roll, "z", draw(rng, 0, 360))
    return finish(roll)


def make_wine_bottle(rng: np.random.Generator) -> Mesh:
    """A tall dark bottle with a long neck, a foil capsule and a label; straight or sloping shoulders."""
    radius, high = draw(rng, 34, 42), draw(rng, 270, 310)
    neck, sloping = draw(rng, 12.5, 15), chance(rng, 0.45)
    wall_top = high * (draw(rng, 0.42, 0.5) if sloping else draw(rng, 0.58, 0.65))
    shoulder = high * (draw(rng, 0.72, 0.8) if sloping else draw(rng, 0.7, 0.74))
    glass = vary(rng, pick(rng, ((24, 44, 28), (34, 26, 18), (52, 74, 36), (22, 24, 26), (84, 96, 52))), 6)
    paper, ink = pick_colour(rng, "pale"), pick_colour(rng, "dark", "bright")
    foil = pick_colour(rng, "bright", "dark", "brass")
    from_z, to_z = wall_top * draw(rng, 0.15, 0.3), wall_top * draw(rng, 0.75, 0.95)
    sign = label(glass, paper, ink, pick_word(rng), width=draw(rng, 0.35, 0.6), height=(0, 1))
    # from the wall over the shoulder to the neck
    curve = [
        (radius, to_z), (radius, wall_top),
        (radius * 0.86, wall_top + 0.45 * (shoulder - wall_top)),
        (neck, shoulder),
    ]  # fmt: skip
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


def make_pop_bottle(rng: np.random.Generator) -> Mesh:
    """A plastic bottle of coloured drink: lobed foot, waist, a bright label band and a screw cap."""
    # proportions and colours
    radius, high = draw(rng, 36, 44), draw(rng, 210, 270)
    waist = radius * draw(rng, 0.8, 1.0)
    drink = vary(rng, pick(rng, ((58, 26, 18), (236, 120, 24), (70, 160, 60), (206, 226, 226), (200, 40, 60),
                                 (240, 206, 60))), 8)  # fmt: skip
    band = pick_colour(rng, "bright")
    ink = pick(rng, ((250, 250, 246), (250, 220, 60), shade(band, 0.3)))
    low, top = high * draw(rng, 0.36, 0.44), high * draw(rng, 0.58, 0.66)
    sign = label(band, band, ink, pick_word(rng), (0.25, 0.75), 0.4, (0.02, 0.98))
    # the foot has five lobes
    foot = lathe([(radius * 0.6, 0), (radius * 0.95, 10), (radius, 28), (waist, low)], drink, "glass", 18)
    lobes = 5

    def dent(points: np.ndarray) -> np.ndarray:
        angle = np.arctan2(points[:, 1], points[:, 0])
        share = 1 - 0.16 * np.clip(1 - points[:, 2] / 30, 0, 1) * (1 + np.cos(lobes * angle)) / 2
        return points * np.stack([share, share, np.ones_like(share)], 1)

    # shoulder, neck and cap
    neck = draw(rng, 11, 13)
    shoulder = [(waist, top), (radius * 0.98, top + 0.08 * high), (radius * 0.7, high * 0.82), (neck, high * 0.91)]
    cap = pick(rng, (band, (246, 246, 244), pick_colour(rng, "bright")))
    return finish(
        [
            push(foot, dent),
            disc(radius * 0.5, -1.0, drink, "glass").rotated("x", 180),
            revolve([(waist, low), (waist + 0.6, low), (waist + 0.6, top), (waist, top)], 32, sign, "paper"),
            lathe(shoulder, drink, "glass", 16),
            revolve([(neck, high * 0.91), (neck + 4, high * 0.91), (neck + 4, high * 0.92), (neck, high * 0.92)], 24,
                    shade(drink, 1.1), "glass"),
            *cylinder(neck + 1.5, high * 0.92, high, stripes([cap, shade(cap, 0.8)], 30), "plastic", 32, bevel=1),
        ],
        512,
    )  # fmt: skip


def make_milk_can(rng: np.random.Generator) -> Mesh:
    """A dairy's churn: a metal cylinder with a sloping shoulder, a neck, a mushroom lid and two ears."""
    radius, high = draw(rng, 52, 66), draw(rng, 190, 240)
    wall_top, neck_low, neck = high * draw(rng, 0.56, 0.64), high * draw(rng, 0.74, 0.8), radius * draw(rng, 0.5, 0.62)
    metal = pick_colour(rng, "steel") if chance(rng, 0.65) else pick_colour(rng, "car", "bright", "pale")
    material = "metal" if max(metal) - min(metal) < 30 else "paint"
    dark = shade(metal, 0.75)
    body = [(0.0, 0.0), (radius + 2, 0.0), (radius + 2, 6.0), (radius, 7.0)]
    # two hoops round the wall
    for z in (wall_top * 0.3, wall_top * 0.7):
        body += [(radius, z - 3), (radius + 2, z), (radius, z + 3)]
    body += [(radius, wall_top), (neck, neck_low), (neck, high - 18)]
    lid = [(neck + 2, high - 18), (neck + 8, high - 10), (neck + 9, high - 4), (neck * 0.6, high), (0, high + 2)]
    ears = []
    # ears from neck to shoulder
    for side in (1, -1):
        loop = [
            (0, side * neck, neck_low + 6), (0, side * (neck + 26), neck_low + 2),
            (0, side * (radius + 4), wall_top + 18), (0, side * (radius - 6), wall_top + 6),
        ]  # fmt: skip
        ears += rod(loop, 4.5, dark, material)
    top = rod([(-14, 0, high), (-10, 0, high + 14), (10, 0, high + 14), (14, 0, high)], 3, dark, material)
    return finish([revolve(body, 36, metal, material), lathe(lid, metal, material, 12), *ears, *top])


def make_eggnog(rng: np.random.Generator) -> Mesh:
    """Eggnog in a glass bottle, a gable-top carton, a jug with a handle, or poured into a glass with cinnamon."""
    return finish(pick(rng, (_nog_bottle, _nog_carton, _nog_jug, _nog_glass, _nog_glass))(rng), 512)


def _name(rng: np.random.Generator, ground: Colour) -> Paint:
    """Two labels on a ground of cream."""
    paper, ink = pick(rng, [pair for pair in FESTIVE if pair[0][2] < 150])
    back = paper if chance(rng, 0.3) else ground
    return label(back, paper, ink, pick(rng, NAMES), (0.25, 0.75), draw(rng, 0.34, 0.44), (0.02, 0.98))


def _nog_bottle(rng: np.random.Generator) -> list[Part]:
    radius, high = draw(rng, 42, 56), draw(rng, 170, 220)
    neck, cream = radius * draw(rng, 0.45, 0.6), vary(rng, CREAM, 5)
    low, top = high * draw(rng, 0.1, 0.2), high * draw(rng, 0.42, 0.52)
    cap = pick_colour(rng, "bright", "brass")
    upper = [(radius, top), (radius, high * 0.56), (radius * 0.8, high * 0.68), (neck, high * 0.8), (neck, high * 0.9)]
    return [
        *cylinder(radius - 3, 0, low, cream, "glass", 32, radius),
        revolve([(radius, low), (radius, top)], 32, _name(rng, cream), "paper"),
        lathe(upper, cream, "glass"),
        revolve([(neck, high * 0.9), (neck + 3, high * 0.93), (neck, high * 0.96)], 32, (216, 226, 218), "glass"),
        *cylinder(neck + 2, high * 0.94, high, cap, "plastic", 32, bevel=2),
    ]


def _nog_carton(rng: np.random.Generator) -> list[Part]:
    side, high, gable = draw(rng, 70, 92), draw(rng, 120, 175), draw(rng, 28, 42)
    paper, ink = pick(rng, FESTIVE)
    half = side / 2
    ring = np.array([(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)])
    rows = [np.c_[ring, np.full(5, z)] for z in (0.0, high)]
    front = label(paper, vary(rng, CREAM if paper != FESTIVE[2][0] else FOAM, 6), ink if ink[0] < 200 else paper,
                  pick(rng, NAMES),
                  (0.125, 0.375, 0.625, 0.875), 0.2, (0.25, 0.75))  # fmt: skip
    # a gable roof: its ridge runs across, closed by the flap above it
    ridge = np.array([(-half, 0), (half, 0), (half, 0), (-half, 0), (-half, 0)]) * [1, 0]
    roof = [rows[1], np.c_[ridge * [0.999, 1] + ring * [0, 0.03], np.full(5, high + gable)]]
    cap = cylinder(12, 0, 12, pick_colour(rng, "bright"), "plastic", 16)
    slope = np.degrees(np.arctan2(gable, half))
    cap = moved(turned(cap, "x", -slope), 0, half * 0.5, high + gable * 0.5)
    return [
        net_part(rows, front, "paper"), net_part(roof, pick(rng, (paper, ink)), "paper"),
        *block((side, side, 1), (0, 0, 0), paper, "paper"),
        *block((side, 3, 18), (0, 0, high + gable + 7), paper, "paper"),
        *(cap if chance(rng, 0.5) else []),
    ]  # fmt: skip


def _nog_jug(rng: np.random.Generator) -> list[Part]:
    half, high, cream = draw(rng, 42, 54), draw(rng, 160, 200), vary(rng, CREAM, 5)
    rows = []
    for share, z in ((0.9, 0), (1, 0.05), (1, 0.14), (1, 0.5), (1, 0.56), (0.78, 0.72), (0.34, 0.88), (0.34, 0.95)):
        angle = np.linspace(np.pi, 3 * np.pi, 33)
        # a square with round corners
        round_off = np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle))) ** 0.75
        rows.append(np.stack([half * share / round_off * np.cos(angle), half * share / round_off * np.sin(angle),
                              np.full(33, z * high)], 1))  # fmt: skip
    handle = [(-half * 0.2, 0, high * 0.88), (-half * 0.95, 0, high * 0.86), (-half * 1.35, 0, high * 0.66),
              (-half * 0.98, 0, high * 0.42)]  # fmt: skip
    return [
        net_part(rows[:3], cream, "plastic"), net_part(rows[2:4], _name(rng, cream), "paper"),
        net_part(rows[3:], cream, "plastic"),
        *block((half * 1.2, half * 1.2, 1), (0, 0, 0.5), cream),
        *cylinder(half * 0.38, high * 0.94, high * 1.03, pick_colour(rng, "bright"), "plastic", 24, bevel=1.5),
        *rod(handle, half * 0.17, cream, "plastic"),
    ]  # fmt: skip


def _nog_glass(rng: np.random.Generator) -> list[Part]:
    stem = draw(rng, 35, 60) if chance(rng, 0.5) else 0.0
    radius, high = draw(rng, 34, 44), draw(rng, 80, 130)
    clear, cream = (214, 224, 220), vary(rng, CREAM, 5)
    outline = smooth_curve([(radius * (0.35 if stem else 0.8), 0), (radius * 0.85, high * 0.2), (radius, high * 0.6),
                            (radius * 1.02, high * 0.9)], 16)  # fmt: skip
    foam = scatter(rng, FOAM, [(134, 88, 46), (160, 112, 64)], 90, 0.012)
    cup = vessel(outline, 2.5, cream, clear, "glass", content=(0.94, foam, "matte"))
    top = high * 0.9
    # the rim stands above the drink
    lip = [
        (outline[-1, 0], top), (outline[-1, 0] + 0.5, top + 9), (outline[-1, 0] - 2, top + 9),
        (outline[-1, 0] - 2, top),
    ]  # fmt: skip
    bark = wood_grain(rng, (134, 78, 40), "v")
    lean = radius * draw(rng, 0.5, 0.8)
    stick = rod([(-lean * 0.2, 0, high * 0.5), (lean, 0, high + draw(rng, 34, 60))], draw(rng, 5, 7), bark, "wood")
    parts = moved([*cup, revolve(lip, 32, clear, "glass"), *turned(stick, "z", draw(rng, 0, 360))], z=stem)
    # a stem on a foot, or perhaps an ear
    if stem:
        parts += cylinder(radius * 0.8, 0, 4, clear, "glass", 32)
        parts.append(lathe([(radius * 0.8, 4), (6, 10), (5, stem * 0.6), (radius * 0.36, stem)], clear, "glass", 14))
    elif chance(rng, 0.4):
        ear = [(-radius * 0.9, 0, high * 0.72), (-radius * 1.6, 0, high * 0.66), (-radius * 1.55, 0, high * 0.36),
               (-radius * 0.88, 0, high * 0.28)]  # fmt: skip
        parts += rod(ear, 4, clear, "glass")
    if chance(rng, 0.3):
        parts.append(ball(9, (250, 246, 236), "matte", 12, 8).moved(0, 0, stem + top))
    return parts
