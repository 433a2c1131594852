"""Open and round: mugs, vases, buckets, flowerpots, frying pans, toilet tissue."""

import numpy as np

from toolkit.objects.everyday.draws import chance, draw, pick, pick_colour, shade, vary
from toolkit.objects.everyday.paints import bands, blotches, checks, decorate, dots, stripes
from toolkit.objects.everyday.shapes import arc, ball, cylinder, finish, moved, net_part, rod, turned, vessel
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Colour, Paint, Part, revolve, smooth_curve


def make_coffee_mug(rng: np.random.Generator) -> Mesh:
    """A cylinder with a C-shaped handle, often with coffee in it."""
    radius, flare, high = draw(rng, 38, 48), draw(rng, 0.88, 1.12), draw(rng, 80, 112)
    colour = pick_colour(rng, "ceramic", "pale", "bright")
    outline = smooth_curve(
        [(radius * 0.9, 0), (radius, 6), (radius * (1 + flare) / 2, high * 0.5), (radius * flare, high)], 16
    )
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
    """A handful of stems with blossoms and leaves."""
    parts, petal = [], pick_colour(rng, "bright", "pale")
    count = int(rng.integers(4, 9))
    for k in range(count):
        bearing = 2 * np.pi * k / count + draw(rng, -0.4, 0.4)
        lean, rise = draw(rng, 0.15, 0.6) * reach, reach * draw(rng, 0.6, 1)
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
    base, top, high = draw(rng, 38, 50), draw(rng, 54, 68), draw(rng, 76, 108)
    collar = high * draw(rng, 0.7, 0.8)
    colour = pick_colour(rng, "terracotta") if chance(rng, 0.6) else pick_colour(rng, "ceramic", "bright")
    outline = np.array([(base, 0), (top - 4, collar), (top + 1, collar), (top + 4, high)])
    paint: Paint = colour if chance(rng, 0.6) else decorate(rng, colour, "ceramic", "pale")
    parts = vessel(outline, 5, paint, shade(colour, 0.9), "matte", content=(0.85, (62, 44, 32), "matte"))
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
    parts = vessel(outline, 3, colour, inside, material, 40, 4.0, content)
    reach, grip = draw(rng, 130, 190), pick_colour(rng, "dark", "wood") if chance(rng, 0.7) else colour
    rise = draw(rng, 4, 30)
    path = [
        (radius - 2, 0, high * 0.75),
        (radius + 0.3 * reach, 0, high + rise * 0.5),
        (radius + reach, 0, high + rise),
    ]
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
