"""All sorts: traffic cones, candles, mushrooms, umbrellas, hourglasses."""

import numpy as np

from toolkit.objects.everyday.draws import chance, draw, pick, pick_colour, shade, vary
from toolkit.objects.everyday.paints import bands, scatter, stripes, wood_grain
from toolkit.objects.everyday.shapes import ball, block, cylinder, disc, finish, lathe, moved, net_part, rod, turned
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Colour, Paint, Part, revolve, smooth_curve


def make_traffic_cone(rng: np.random.Generator) -> Mesh:
    """An orange cone with white bands on a square foot; now and then another colour."""
    half, high, radius = draw(rng, 56, 80), draw(rng, 170, 240), draw(rng, 42, 54)
    colour = vary(rng, (236, 92, 26)) if chance(rng, 0.85) else pick_colour(rng, "bright")
    white: Colour = (240, 240, 236)
    low, wide = draw(rng, 0.25, 0.45), draw(rng, 0.12, 0.24)
    paint = bands([colour, white, colour], [low, low + wide])
    if chance(rng, 0.45):
        paint = bands([colour, white, colour, white, colour], [low, low + wide, low + wide + 0.12, low + 2 * wide])
    foot = pick(rng, (colour, (34, 34, 36)))
    tip = draw(rng, 8, 13)
    cone = revolve([(radius, 12), *np.linspace((radius - 4, 18), (tip, high), 8), (tip - 3, high),
                    (tip - 4, high - 12)], 36,
                   paint, "plastic")  # fmt: skip
    base = block((2 * half, 2 * half, 12), (0, 0, 6), foot, "rubber", 3)
    return finish([cone, *base, disc(tip - 4, high - 12, (30, 24, 20), "plastic")])


def make_candle(rng: np.random.Generator) -> Mesh:
    """A pillar on a saucer or a taper in a candlestick, with a wick, a flame and runs of wax."""
    wax = pick_colour(rng, "pale", "pale", "bright", "ceramic")
    holder = pick_colour(rng, "brass", "steel", "ceramic", "dark")
    taper = chance(rng, 0.5)
    radius, long = (draw(rng, 10, 14), draw(rng, 110, 170)) if taper else (draw(rng, 30, 44), draw(rng, 80, 150))
    foot = draw(rng, 36, 110) if taper else 5.0
    parts: list[Part] = []
    if taper:
        width = draw(rng, 32, 46)
        parts.append(lathe([(width, 0), (width * 0.9, 5), (8, 14), (12, foot * 0.5), (7, foot * 0.7),
                            (radius + 8, foot),
                            (radius + 9, foot + 3), (radius + 3, foot + 4)], holder, "metal", 26))  # fmt: skip
        parts += cylinder(radius + 3.5, foot - 2, foot + 14, holder, "metal", 20)
    elif chance(rng, 0.7):
        parts.append(
            revolve(
                [(0, 0), (radius, 0), (radius + 20, 8), (radius + 20, 10), (radius, 5), (0, 5)], 32, holder, "ceramic"
            )
        )
    top = foot + long
    parts.append(revolve([(radius, foot), (radius, top - 4), (radius - 2, top), (radius * 0.7, top - 2), (0, top - 4)],
                         28,
                         wax, "ceramic"))  # fmt: skip
    for _ in range(int(rng.integers(0, 6))):
        bearing, run = draw(rng, 0, 2 * np.pi), draw(rng, 0.1, 0.5) * long
        x, y = radius * np.cos(bearing), radius * np.sin(bearing)
        parts += rod(
            [(x * 0.8, y * 0.8, top - 1), (x, y, top - 6), (x, y, top - run)], [2, 2.4, 2, 3.2], wax, "ceramic", 8, 8
        )
    parts += rod([(0, 0, top - 5), (0, 0, top + 10)], 1.4, (24, 20, 18), "cloth", segments=6)
    if chance(rng, 0.8):
        flame = bands([(255, 150, 30), (255, 214, 80), (255, 246, 190), (255, 190, 50)], [0.2, 0.45, 0.8])
        size = draw(rng, 8, 11)
        parts.append(lathe([(1, top + 4), (size * 0.8, top + 10), (size, top + 16), (size * 0.55, top + 28),
                            (0.4, top + 44)],
                           flame, "matte", 14, 14))  # fmt: skip
    return finish(parts)


def make_mushroom(rng: np.random.Generator) -> Mesh:
    """One to three caps on pale stems: red with white warts, brown, or buff, domed or flat, with gills below."""
    parts: list[Part] = []
    cap = vary(
        rng, pick(rng, ((196, 36, 30), (150, 98, 58), (206, 176, 130), (120, 74, 46), (232, 224, 208), (216, 130, 50)))
    )
    spotted = chance(rng, 0.75 if cap[0] > 180 and cap[1] < 70 else 0.15)
    for k in range(pick(rng, (1, 1, 2, 3))):
        size = 1.0 if k == 0 else draw(rng, 0.4, 0.75)
        one = _one_mushroom(rng, cap, spotted)
        bearing = draw(rng, 0, 360)
        one = turned(
            [part.scaled(size, size, size) for part in one], "y", draw(rng, 0, 10) if k == 0 else draw(rng, 8, 25)
        )
        parts += turned(moved(one, x=0 if k == 0 else 46), "z", bearing)
    return finish(parts)


def _one_mushroom(rng: np.random.Generator, cap: Colour, spotted: bool) -> list[Part]:
    radius, rise, high, stem = draw(rng, 56, 84), draw(rng, 30, 66), draw(rng, 80, 140), draw(rng, 13, 24)
    cream, gill = vary(rng, (236, 226, 204), 8), vary(rng, (206, 184, 150), 10)
    paint: Paint = scatter(rng, cap, [(246, 242, 232)], 60, 0.016) if spotted else cap
    drop = draw(rng, 0, 22)
    over = [(radius - 4, high - drop - 2), (radius, high - drop), (radius * 0.94, high + rise * 0.4),
            (radius * 0.6, high + rise * 0.86),
            (0, high + rise)]  # fmt: skip
    gills = stripes([gill, shade(gill, 0.72)], 44)
    parts = [
        lathe(over, paint, "matte", 16, 36),
        revolve([(stem * 0.9, high + 4), (radius - 4, high - drop - 2)], 36, gills, "matte"),
        lathe([(stem * 1.4, 0), (stem * 1.25, 12), (stem, high * 0.5), (stem * 0.9, high + 6)], cream, "matte", 14, 24),
        disc(stem * 1.4, 0, cream, "matte").rotated("x", 180),
    ]
    if chance(rng, 0.4):
        z = high * 0.68
        parts.append(revolve([(stem * 1.9, z - 10), (stem * 1.92, z - 8), (stem, z + 3)], 28, cream, "matte"))
        parts.append(revolve([(stem, z - 1), (stem * 1.9, z - 10)], 28, shade(cream, 0.85), "matte"))
    return parts


def make_umbrella(rng: np.random.Generator) -> Mesh:
    """An open umbrella, gored in one or more colours, with ribs, a shaft and a crook; upright or tipped over."""
    radius, rise, gores = draw(rng, 120, 140), draw(rng, 48, 80), pick(rng, (6, 8, 8, 10))
    colour, other = pick_colour(rng, "bright", "dark", "ceramic"), pick_colour(rng, "pale", "bright")
    paint: Paint = pick(rng, (colour, stripes([colour, other], gores // 2)))
    if chance(rng, 0.2):
        paint = bands([other, colour, other, colour], [0.15, 0.5, 0.7])
    fold, reach = draw(rng, 0.06, 0.14), draw(rng, 150, 200)
    t = np.linspace(1, 0, 9)[:, None]
    angle = np.linspace(0, 2 * np.pi, gores * 4 + 1)
    bow = 1 - fold * np.abs(np.sin(gores * angle / 2)) * t  # cloth hangs in between the ribs
    net = np.stack([radius * t * bow * np.cos(angle), radius * t * bow * np.sin(angle),
                    rise * (1 - t**2) + 0 * angle - 14 * fold * t**4 * np.abs(np.sin(gores * angle / 2))],
                    2)  # fmt: skip
    top = net_part(list(net), paint, "cloth")
    under = net_part(list(net - [0, 0, 1.2]), shade(colour, 0.7), "cloth").flipped()
    steel, grip = pick_colour(rng, "steel", "dark"), pick_colour(rng, "wood", "dark")
    parts = [top, under, *rod([(0, 0, rise + 16), (0, 0, rise - reach)], 2.6, steel, "metal")]
    for k in range(gores):
        a = 2 * np.pi * k / gores
        tip = np.array([radius * np.cos(a), radius * np.sin(a), 0])
        parts += rod([tip * 0.5 + [0, 0, rise * 0.72 - 1], (0, 0, rise * 0.2)], 1.1, steel, "metal", segments=5)
        parts.append(ball(2.4, steel, "metal", 8, 4).moved(*tip))
    foot = rise - reach
    crook = [
        (0, 0, foot + 40),
        (0, 0, foot),
        (6, 0, foot - 12),
        (16, 0, foot - 16),
        (27, 0, foot - 10),
        (30, 0, foot + 4),
    ]
    parts += rod(crook, 5, grip, "wood", 18)
    if chance(rng, 0.5):
        parts = turned(parts, "y", draw(rng, 100, 125))
    return finish(turned(parts, "z", draw(rng, 0, 360)))


def make_hourglass(rng: np.random.Generator) -> Mesh:
    """Two bulbs of glass with sand, between two plates on three or four posts."""
    radius, high, neck = draw(rng, 40, 52), draw(rng, 170, 210), draw(rng, 5, 8)
    plate, posts = radius + draw(rng, 12, 22), pick(rng, (3, 4))
    colour, sand = pick_colour(rng, "wood", "brass", "dark"), vary(rng, pick(rng,
                                                                             ((222, 190, 130), (236, 226, 206),
                                                                              (90, 130, 180),
                                                                               (200, 90, 80))))  # fmt: skip
    clear, filled = vary(rng, (204, 218, 218), 6), draw(rng, 0.08, 0.34)
    middle, thick = high / 2, 9.0
    bulb = smooth_curve(
        [(radius * 0.5, thick), (radius, thick + 16), (radius * 0.94, middle * 0.6), (neck, middle)], 16
    )
    outline = np.vstack([bulb, (bulb[::-1] * [1, -1] + [0, high])[1:]])
    top = 0.5 + 0.42 * draw(rng, 0.1, 0.8)
    glass = bands([sand, clear, sand, clear], [filled, 0.5, top])
    rim = wood_grain(rng, colour) if chance(rng, 0.4) else colour
    parts = [revolve(outline.tolist(), 32, glass, "glass")]
    for z in (0.0, high - thick):
        parts += cylinder(plate, z, z + thick, rim, "wood", 6 if chance(rng, 0.2) else 36, bevel=2)
    for k in range(posts):
        post = [(5.5, thick), (3.5, thick + 20), (6.5, middle), (3.5, high - thick - 20), (5.5, high - thick)]
        line = lathe(post, colour, "wood", 16, 12)
        parts.append(line.moved(plate - 8).rotated("z", 360 / posts * k))
    return finish(parts)
