"""Household things: furniture, lamps, candles, umbrellas, tools, weights and toys."""

from itertools import pairwise

import numpy as np

from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content.drawing import (
    PALETTES,
    Colour,
    Paint,
    Rng,
    bands,
    decorate,
    pattern,
    scatter,
    shade,
    stripes,
    wood_grain,
)
from toolkit.rooms.worlds.content.modelling import (
    Part,
    Parts,
    ball,
    block,
    cylinder,
    disc,
    extrude,
    finish,
    lathe,
    loft,
    revolve,
    rod,
    smooth_curve,
    superellipse,
    surface,
)


def _frame_colour(rng: Rng) -> Colour:
    return rng.colour("wood") if rng.chance(0.65) else rng.colour("pale", "dark", "bright", "steel")


def _legs(rng: Rng, half: tuple[float, float], high: float, thick: float, colour: Colour, splay: float = 0.0) -> Parts:
    kind, parts = rng.pick(("square", "round", "tapered")), Parts()
    for x in (-1, 1):
        for y in (-1, 1):
            # legs under the corners, splayed outwards at the floor
            top = np.array([x * half[0], y * half[1], high])
            foot = top * [1 + splay, 1 + splay, 0]
            if kind == "square" and splay == 0:
                parts += block((thick, thick, high), (top[0], top[1], high / 2), colour, "wood")
            else:
                radii = [thick * 0.3, thick * 0.6] if kind == "tapered" else [thick * 0.5, thick * 0.5]
                parts += rod([foot, top], radii, colour, "wood")
    return parts


def make_chair(rng: Rng) -> Mesh:
    """Four legs, a seat and a back of slats, spindles, rungs or one panel; some with arms or a cushion."""
    # half width and half depth, heights of seat and back
    half, deep, seat, back = rng.draw(46, 58), rng.draw(44, 56), rng.draw(88, 115), rng.draw(90, 140)
    colour, thick = _frame_colour(rng), rng.draw(8, 12)
    grain: Paint = wood_grain(rng, colour) if rng.chance(0.4) else colour
    # legs and seat, some with a cushion
    parts = _legs(rng, (deep - 6, half - 6), seat, thick, colour, rng.pick((0.0, 0.0, 0.12)))
    parts += block((2 * deep, 2 * half, 9), (0, 0, seat + 4), grain, "wood", 2)
    if rng.chance(0.4):
        cloth = rng.colour("bright", "ceramic")
        parts += block((2 * deep - 8, 2 * half - 8, 10), (2, 0, seat + 12), cloth, "cloth", 4)
    # the back: two posts, a top rail, and a filling
    rest = Parts()
    for side in (-1, 1):
        rest += block((thick, thick, back), (0, side * (half - thick / 2), back / 2), colour, "wood")
    kind = rng.pick(("slats", "rungs", "panel"))
    rest += block((thick * 0.8, 2 * half, rng.draw(12, 26)), (0, 0, back - 8), colour, "wood", 2)
    if kind == "slats":
        for share in np.linspace(-0.65, 0.65, int(rng.integers(3, 7))):
            rest += block((5, rng.draw(5, 9), back), (0, share * half, back / 2), colour, "wood")
    elif kind == "rungs":
        for z in np.linspace(0.3, 0.75, int(rng.integers(2, 4))) * back:
            rest += block((5, 2 * half - thick, 12), (0, 0, z), colour, "wood")
    else:
        rest += block(
            (6, 2 * half - thick, back * 0.62), (0, 0, back * 0.6), rng.pick((grain, shade(colour, 0.8))), "wood"
        )
    # the back leans backwards from the rear edge of the seat
    parts += rest.rotated("y", -rng.draw(2, 14)).moved(-deep + thick / 2, 0, seat + 4)
    # arms
    if rng.chance(0.3):
        for y in (-half, half):
            parts += block((2 * deep - 4, 9, 6), (0, y, seat + 48), colour, "wood")
            parts += rod([(deep - 8, y, seat), (deep - 8, y, seat + 48)], 4, colour, "wood")
    return finish(parts)


def make_dining_table(rng: Rng) -> Mesh:
    """A rectangular, round or oval top on four legs, trestles or a pedestal; some with plates."""
    long, wide, high = rng.draw(110, 135), rng.draw(66, 95), rng.draw(100, 130)
    colour = _frame_colour(rng)
    top: Paint = wood_grain(rng, colour) if rng.chance(0.5) else colour
    # table top
    kind = rng.pick(("rectangle", "rectangle", "round", "oval"))
    if kind == "rectangle":
        parts = block((2 * long, 2 * wide, 9), (0, 0, high), top, "wood", 2)
    else:
        wide = long if kind == "round" else wide
        turn = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        outline = np.stack([long * np.cos(turn), wide * np.sin(turn)], 1).tolist()
        parts = extrude(outline, 9, 2, top, "wood").moved(z=high - 4)
    # what it stands on
    stand = rng.pick(("legs", "legs", "pedestal")) if kind != "rectangle" else rng.pick(("legs", "legs", "trestle"))
    reach = 0.62 if kind != "rectangle" else 0.9
    if stand == "legs":
        parts += _legs(rng, (long * reach, wide * reach), high - 4, rng.draw(10, 16), colour)
        parts += block((2 * long * reach, 2 * wide * reach, 14), (0, 0, high - 11), shade(colour, 0.85), "wood")
    elif stand == "pedestal":
        parts += lathe([(wide * 0.55, 0), (wide * 0.5, 8), (12, 20), (16, high * 0.5), (10, high * 0.7),
                            (30, high - 4)], colour, "wood")  # fmt: skip
    else:
        for x in (-0.7, 0.7):
            parts += block((12, 2 * wide * 0.8, 8), (x * long, 0, 4), colour, "wood")
            parts += block((14, 34, high - 8), (x * long, 0, high / 2), colour, "wood")
        parts += block((1.4 * long, 6, 14), (0, 0, high * 0.4), colour, "wood")
    # plates
    for x, y in ((0.55, 0), (-0.55, 0), (0, 0.6), (0, -0.6))[: rng.pick((0, 0, 2, 4))]:
        plate = cylinder(13, 0, 3, (242, 240, 234), "ceramic", 20, 19)
        parts += plate.moved(x * long, y * wide, high + 4.5)
    return finish(parts.rotated("z", rng.draw(0, 180)))


def make_bookcase(rng: Rng) -> Mesh:
    """Upright sides and shelves with a back, filled with books of many colours."""
    # half of the width; depth and height
    half, deep, high = rng.draw(60, 100), rng.draw(30, 42), rng.draw(200, 260)
    # now and then low and wide
    if rng.chance(0.25):
        half, high = rng.draw(100, 130), rng.draw(120, 170)
    colour, rows = _frame_colour(rng), int(rng.integers(3, 6))
    rows = min(rows, max(2, int(high / 42)))
    grain: Paint = wood_grain(rng, colour, "v") if rng.chance(0.5) else colour
    # some have a back, others are open
    back = block((3, 2 * half, high), (-deep / 2, 0, high / 2), shade(colour, 0.6), "wood")
    parts = back if rng.chance(0.35) else Parts()
    for y in (-half, half):
        parts += block((deep, 7, high), (0, y, high / 2), grain, "wood")
    # shelves from just above the floor to the top, evenly apart
    levels = np.linspace(rng.draw(5, 18), high - 4, rows + 1)
    for z in levels:
        parts += block((deep, 2 * half, 6), (0, 0, z), colour, "wood")
    for low, top in pairwise(levels):
        parts += _books(rng, half - 5, deep, low + 3, top - low - 10)
    return finish(parts.rotated("z", rng.draw(-30, 30)))


def _books(rng: Rng, half: float, deep: float, z: float, room: float) -> Parts:
    y, end, parts = -half, half * rng.draw(0.4, 1.0), Parts()
    # books of many sizes, until the shelf is full to its end
    while y < end - 14:
        thick, tall = rng.draw(6, 14), room * rng.draw(0.7, 0.98)
        colour = rng.pick(PALETTES["bright"] + PALETTES["ceramic"] + PALETTES["dark"] + PALETTES["car"])
        parts += block(
            (deep * rng.draw(0.7, 0.85), thick - 0.8, tall), (0, y + thick / 2, z + tall / 2), colour, "paper"
        )
        y += thick
    return parts


def make_table_lamp(rng: Rng) -> Mesh:
    """A turned or slim stand with a cloth shade: cone, drum or bell."""
    # radii of foot and belly, then heights
    foot, stand, belly = rng.draw(38, 56), rng.draw(110, 170), rng.draw(10, 46)
    low, high, wide = stand * rng.draw(0.85, 0.95), rng.draw(70, 110), rng.draw(70, 96)
    top = wide * rng.draw(0.4, 0.95)
    colour = rng.colour("ceramic", "brass", "wood", "bright", "dark", "steel")
    kind = rng.pick(("slim", "gourd", "candlestick"))
    # outlines of the stand: radius and height
    body = {
        "slim": [(foot, 0), (foot, 6), (foot * 0.3, 14), (5, 24), (5, stand)],
        "gourd": [(foot * 0.7, 0), (foot * 0.75, 6), (belly + 14, stand * 0.4), (9, stand * 0.8), (6, stand)],
        "candlestick": [
            (foot, 0), (foot * 0.9, 8), (9, 22), (18, stand * 0.4), (8, stand * 0.55), (14, stand * 0.8), (6, stand),
        ],
    }[kind]  # fmt: skip
    paint = decorate(rng, colour, "ceramic", "pale") if kind == "gourd" else colour
    cloth = rng.colour("pale") if rng.chance(0.6) else rng.colour("ceramic", "bright")
    # the shade narrows evenly, or a little more in the middle
    bell = 0.5 * (wide + top) - rng.draw(0, 0.14) * wide
    shade_line = [(wide, low), (bell, low + high / 2), (top, low + high)]
    cloth_paint = stripes([cloth, shade(cloth, 0.88)], int(rng.integers(10, 24))) if rng.chance(0.4) else cloth
    if rng.chance(0.2):
        cloth_paint = decorate(rng, cloth, "bright", "pale")
    # a shade of two layers, since its inside is seen too, with rims between them
    outer = lathe(shade_line, cloth_paint, "cloth", 10, 36)
    inner = lathe([(r - 2, z) for r, z in shade_line], (250, 240, 214), "cloth", 10, 36).flipped()
    rims = [revolve([(wide - 2, low), (wide, low)], 36, cloth, "cloth"),
            revolve([(top, low + high), (top - 2, low + high)], 36, cloth, "cloth")]  # fmt: skip
    # a bulb stands inside the shade
    bulb = cylinder(12, low, low + high * 0.7, (252, 246, 226), "glass", 16, 6)
    lower = revolve([(0, 0), (body[0][0], 0)], 32, colour, "paint")
    return finish([lathe(body, paint, "ceramic", 28), lower, outer, inner, *rims, *bulb])


def make_laptop(rng: Rng) -> Mesh:
    """A flat base with keys and a touchpad, and a lid with a bright screen, opened 95-135°."""
    # half the width, depth of the base, its thickness
    half, deep, thick = rng.draw(105, 130), rng.draw(150, 185), rng.draw(7, 13)
    case, keys = rng.colour("steel", "dark", "grey"), rng.pick(((34, 34, 38), (220, 220, 222)))
    opened = rng.draw(95, 135)

    # 14 by 5 keys with gaps between them, and a touchpad below
    def board(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        x, y = (u - 0.06) / 0.88 * 14, (v - 0.42) / 0.5 * 5
        key = (x > 0) & (x < 14) & (y > 0) & (y < 5) & (x % 1 < 0.84) & (y % 1 < 0.82)
        pad = (np.abs(u - 0.5) < 0.16) & (v > 0.06) & (v < 0.36)
        return np.where(pad, 2, key)

    hue, rows = rng.colour("bright", "ceramic", "pale"), int(rng.integers(2, 7))
    paper = rng.pick(((244, 246, 248), (40, 44, 52)))

    # a frame, a background, a window on it and lines of text
    def screen(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        frame = (u < 0.04) | (u > 0.96) | (v < 0.06) | (v > 0.95)
        window = (u > 0.18) & (u < 0.82) & (v > 0.2) & (v < 0.86)
        line = window & ((v * rows * 3) % 1 < 0.4) & (u > 0.24) & (u < 0.5 + 0.3 * np.sin(v * 40) ** 2)
        return np.where(frame, 0, np.where(line, 3, np.where(window, 2, 1)))

    # base with keys, and the lid with its screen
    base = block((deep, 2 * half, thick), (deep / 2, 0, thick / 2), case, "metal", 1.5)
    # keys as a sheet just above the base
    top = _sheet(deep, half, pattern([case, keys, shade(case, 0.85)], board)).moved(z=thick + 0.3)
    ink = (70, 76, 90) if paper[0] > 99 else (150, 220, 160)
    glass = _sheet(deep * 0.94, half, pattern([(16, 16, 18), hue, paper, ink], screen), "glass").moved(z=0.4)
    lid = Parts(block((deep * 0.94, 2 * half, 5), (deep * 0.47, 0, -2.5), case, "metal", 1.5), glass)
    flat = lid.moved(x=-deep * 0.94)  # opened by 180°: behind the hinge, its screen up
    # turned up about the hinge, along y
    raised = flat.rotated("y", 180 - opened)
    return finish([*base, top, *raised.moved(z=thick + 3)], 512)


def _sheet(deep: float, half: float, paint: Paint, material: str = "plastic") -> Part:
    """A level picture that a person at +x reads: its chart's right is +y, its top -x."""
    return surface(np.array([[(deep, -half, 0), (deep, half, 0)], [(0, -half, 0), (0, half, 0)]]), paint, material)


def make_traffic_cone(rng: Rng) -> Mesh:
    """An orange cone with white bands on a square foot; now and then another colour."""
    half, high, radius = rng.draw(56, 80), rng.draw(170, 240), rng.draw(42, 54)
    colour = rng.vary((236, 92, 26)) if rng.chance(0.85) else rng.colour("bright")
    white: Colour = (240, 240, 236)
    # a band, or two of the same width
    low, wide = rng.draw(0.25, 0.45), rng.draw(0.12, 0.24)
    paint = bands([colour, white, colour], [low, low + wide])
    if rng.chance(0.45):
        paint = bands([colour, white, colour, white, colour], [low, low + wide, low + wide + 0.12, low + 2 * wide])
    foot = rng.pick((colour, (34, 34, 36)))
    tip = rng.draw(8, 13)
    # the cone is open at its tip, dark inside
    profile = [(radius, 12), *np.linspace((radius - 4, 18), (tip, high), 8), (tip - 3, high), (tip - 4, high - 12)]
    cone = revolve(profile, 36, paint, "plastic")
    base = block((2 * half, 2 * half, 12), (0, 0, 6), foot, "rubber", 3)
    return finish([cone, *base, disc(tip - 4, high - 12, (30, 24, 20), "plastic")])


def make_candle(rng: Rng) -> Mesh:
    """A pillar on a saucer or a taper in a candlestick, with a wick, a flame and runs of wax."""
    wax = rng.colour("pale", "pale", "bright", "ceramic")
    holder = rng.colour("brass", "steel", "ceramic", "dark")
    taper = rng.chance(0.5)
    # a taper is thin and long, a pillar thick and short
    radius, long = (rng.draw(10, 14), rng.draw(110, 170)) if taper else (rng.draw(30, 44), rng.draw(80, 150))
    foot = rng.draw(36, 110) if taper else 5.0
    # the holder: a stick for a taper, a dish for some pillars
    parts = Parts()
    if taper:
        width = rng.draw(32, 46)
        parts += lathe([(width, 0), (width * 0.9, 5), (8, 14), (12, foot * 0.5), (7, foot * 0.7),
                            (radius + 8, foot),
                            (radius + 9, foot + 3), (radius + 3, foot + 4)], holder, "metal", 26)  # fmt: skip
        parts += cylinder(radius + 3.5, foot - 2, foot + 14, holder, "metal", 20)
    elif rng.chance(0.7):
        parts += revolve(
            [(0, 0), (radius, 0), (radius + 20, 8), (radius + 20, 10), (radius, 5), (0, 5)],
            32, holder, "ceramic",
        )  # fmt: skip
    # the candle, with runs of wax
    top = foot + long
    profile = [(radius, foot), (radius, top - 4), (radius - 2, top), (radius * 0.7, top - 2), (0, top - 4)]
    parts += revolve(profile, 28, wax, "ceramic")
    for _ in range(int(rng.integers(0, 6))):
        bearing, run = rng.draw(0, 2 * np.pi), rng.draw(0.1, 0.5) * long
        x, y = radius * np.cos(bearing), radius * np.sin(bearing)
        path = [(x * 0.8, y * 0.8, top - 1), (x, y, top - 6), (x, y, top - run)]
        parts += rod(path, [2, 2.4, 2, 3.2], wax, "ceramic", 8, 8)
    # wick and flame
    parts += rod([(0, 0, top - 5), (0, 0, top + 10)], 1.4, (24, 20, 18), "cloth", segments=6)
    if rng.chance(0.8):
        flame = bands([(255, 150, 30), (255, 214, 80), (255, 246, 190), (255, 190, 50)], [0.2, 0.45, 0.8])
        size = rng.draw(8, 11)
        parts += lathe(
            [(1, top + 4), (size * 0.8, top + 10), (size, top + 16), (size * 0.55, top + 28), (0.4, top + 44)],
            flame, "matte", 14, 14,
        )  # fmt: skip
    return finish(parts)


def make_mushroom(rng: Rng) -> Mesh:
    """One to three caps on pale stems: red with white warts, brown, or buff, domed or flat, with gills below."""
    parts = Parts()
    # the red ones are mostly those with warts
    cap = rng.vary(
        rng.pick(((196, 36, 30), (150, 98, 58), (206, 176, 130), (120, 74, 46), (232, 224, 208), (216, 130, 50)))
    )
    spotted = rng.chance(0.75 if cap[0] > 180 and cap[1] < 70 else 0.15)
    for k in range(rng.pick((1, 1, 2, 3))):
        # the first is the largest, others stand beside it and lean more
        size = 1.0 if k == 0 else rng.draw(0.4, 0.75)
        mushroom = _one_mushroom(rng, cap, spotted)
        bearing = rng.draw(0, 360)
        mushroom = mushroom.scaled(size, size, size).rotated("y", rng.draw(0, 10) if k == 0 else rng.draw(8, 25))
        parts += mushroom.moved(x=0 if k == 0 else 46).rotated("z", bearing)
    return finish(parts)


def _one_mushroom(rng: Rng, cap: Colour, spotted: bool) -> Parts:
    radius, rise, high, stem = rng.draw(56, 84), rng.draw(30, 66), rng.draw(80, 140), rng.draw(13, 24)
    cream, gill = rng.vary((236, 226, 204), 8), rng.vary((206, 184, 150), 10)
    # warts are flat: spots on the cap
    paint: Paint = scatter(rng, cap, [(246, 242, 232)], 60, 0.016) if spotted else cap
    drop = rng.draw(0, 22)
    # the cap, its rim lower than the middle of the gills
    over = [
        (radius - 4, high - drop - 2), (radius, high - drop), (radius * 0.94, high + rise * 0.4),
        (radius * 0.6, high + rise * 0.86), (0, high + rise),
    ]  # fmt: skip
    gills = stripes([gill, shade(gill, 0.72)], 44)
    parts = Parts(
        lathe(over, paint, "matte", 16, 36),
        revolve([(stem * 0.9, high + 4), (radius - 4, high - drop - 2)], 36, gills, "matte"),
        lathe([(stem * 1.4, 0), (stem * 1.25, 12), (stem, high * 0.5), (stem * 0.9, high + 6)], cream, "matte", 14, 24),
        disc(stem * 1.4, 0, cream, "matte").rotated("x", 180),
    )
    # a ring round the stem
    if rng.chance(0.4):
        z = high * 0.68
        parts += revolve([(stem * 1.9, z - 10), (stem * 1.92, z - 8), (stem, z + 3)], 28, cream, "matte")
        parts += revolve([(stem, z - 1), (stem * 1.9, z - 10)], 28, shade(cream, 0.85), "matte")
    return parts


def make_umbrella(rng: Rng) -> Mesh:
    """An open umbrella, gored in a colour or more, with ribs, a shaft and a crook; upright or tipped over."""
    # cloth: plain, gored or ringed
    radius, rise, gores = rng.draw(120, 140), rng.draw(48, 80), rng.pick((6, 8, 8, 10))
    colour, other = rng.colour("bright", "dark", "ceramic"), rng.colour("pale", "bright")
    paint: Paint = rng.pick((colour, stripes([colour, other], gores // 2)))
    if rng.chance(0.2):
        paint = bands([other, colour, other, colour], [0.15, 0.5, 0.7])
    fold, reach = rng.draw(0.06, 0.14), rng.draw(150, 200)
    t = np.linspace(1, 0, 9)[:, None]
    angle = np.linspace(0, 2 * np.pi, gores * 4 + 1)
    bow = 1 - fold * np.abs(np.sin(gores * angle / 2)) * t  # cloth hangs in between the ribs
    net = np.stack([radius * t * bow * np.cos(angle), radius * t * bow * np.sin(angle),
                    rise * (1 - t**2) + 0 * angle - 14 * fold * t**4 * np.abs(np.sin(gores * angle / 2))],
                    2)  # fmt: skip
    top = surface(net, paint, "cloth")
    under = surface(net - [0, 0, 1.2], shade(colour, 0.7), "cloth").flipped()
    # shaft and ribs
    steel, grip = rng.colour("steel", "dark"), rng.colour("wood", "dark")
    parts = Parts(top, under, rod([(0, 0, rise + 16), (0, 0, rise - reach)], 2.6, steel, "metal"))
    for k in range(gores):
        a = 2 * np.pi * k / gores
        tip = np.array([radius * np.cos(a), radius * np.sin(a), 0])
        parts += rod([tip * 0.5 + [0, 0, rise * 0.72 - 1], (0, 0, rise * 0.2)], 1.1, steel, "metal", segments=5)
        parts += ball(2.4, steel, "metal", 8, 4).moved(*tip)
    # crook
    foot = rise - reach
    crook = [
        (0, 0, foot + 40), (0, 0, foot), (6, 0, foot - 12), (16, 0, foot - 16), (27, 0, foot - 10), (30, 0, foot + 4),
    ]  # fmt: skip
    parts += rod(crook, 5, grip, "wood", 18)
    # some lie on their side
    if rng.chance(0.5):
        parts = parts.rotated("y", rng.draw(100, 125))
    return finish(parts.rotated("z", rng.draw(0, 360)))


def make_hourglass(rng: Rng) -> Mesh:
    """Two bulbs of glass with sand, between two plates on three or four posts."""
    radius, high, neck = rng.draw(40, 52), rng.draw(170, 210), rng.draw(5, 8)
    plate, posts = radius + rng.draw(12, 22), rng.pick((3, 4))
    colour = rng.colour("wood", "brass", "dark")
    sand = rng.vary(rng.pick(((222, 190, 130), (236, 226, 206), (90, 130, 180), (200, 90, 80))))
    # the sand's height is a share of the outline
    clear, filled = rng.vary((204, 218, 218), 6), rng.draw(0.08, 0.34)
    middle, thick = high / 2, 9.0
    # half of a bulb, from the plate to the neck
    points = [(radius * 0.5, thick), (radius, thick + 16), (radius * 0.94, middle * 0.6), (neck, middle)]
    # the upper bulb mirrors the lower one
    bulb = smooth_curve(points, 16)
    outline = np.vstack([bulb, (bulb[::-1] * [1, -1] + [0, high])[1:]])
    top = 0.5 + 0.42 * rng.draw(0.1, 0.8)
    # what is left of the sand above, and what has run down, as colours along the outline
    glass = bands([sand, clear, sand, clear], [filled, 0.5, top])
    rim = wood_grain(rng, colour) if rng.chance(0.4) else colour
    parts = Parts(revolve(outline.tolist(), 32, glass, "glass"))
    for z in (0.0, high - thick):
        # round plates, now and then six-sided
        parts += cylinder(plate, z, z + thick, rim, "wood", 6 if rng.chance(0.2) else 36, bevel=2)
    for k in range(posts):
        post = [(5.5, thick), (3.5, thick + 20), (6.5, middle), (3.5, high - thick - 20), (5.5, high - thick)]
        line = lathe(post, colour, "wood", 16, 12)
        parts += line.moved(plate - 8).rotated("z", 360 / posts * k)
    return finish(parts)


def make_hammer(rng: Rng) -> Mesh:
    """A claw hammer, a sledge or a mallet, lying on its side."""
    # z goes along the handle, its head at 0
    long, thick = rng.draw(210, 260), rng.draw(10, 14)
    wood = rng.colour("wood")
    kind = rng.pick(("claw", "claw", "sledge", "mallet"))
    head = {"claw": _claw_head, "sledge": _sledge_head, "mallet": _mallet_head}[kind](rng)
    grip: Paint = wood_grain(rng, wood, "v")
    if kind != "mallet" and rng.chance(0.5):
        # a rubber grip on a painted or steel handle
        rubber = rng.colour("bright", "dark")
        grip = bands([rubber, shade(rubber, 0.6), rng.colour("steel", "dark")], [rng.draw(0.4, 0.5), 0.55])
    handle = lathe([(thick * 0.95, -long), (thick * 1.15, -long * 0.9), (thick * 0.85, -long * 0.6),
                    (thick * 0.7, -long * 0.2),
                    (thick * 0.75, 0)], grip, "wood", 16, 16).scaled(1, 0.75, 1)  # fmt: skip
    end = cylinder(thick * 0.95, -long - 2, -long + 1, shade(wood, 0.7), "wood", 16)
    standing = Parts(handle, end.scaled(1, 0.75, 1), head)
    # laid on its side, turned anyhow
    return finish(standing.rotated("x", 90).rotated("z", rng.draw(0, 360)))


def _claw_head(rng: Rng) -> Parts:
    """Face to +x, a split claw that curves down to -x."""
    metal, scale = rng.colour("steel", "dark"), rng.draw(0.9, 1.15)
    # the face with its neck, the two halves of the claw, and the eye for the handle
    face = [*rod([(0, 0, 0), (26, 0, 0), (30, 0, 0), (46, 0, 0)], [14, 11, 10, 10], metal, "metal", 8, 14),
            *cylinder(15, 40, 54, metal, "metal", 18, bevel=3).rotated("y", 90)]  # fmt: skip
    claws = Parts()
    for side in (1, -1):
        path = [(2, side * 5, 1), (-22, side * 7, 3), (-46, side * 9, -4), (-66, side * 11, -22)]
        claws += rod(path, [11, 8, 6, 2], metal, "metal", 12, 12, 0.8)
    eye = block((26, 26, 30), (0, 0, 0), metal, "metal", 4)
    return Parts(face, claws, eye).scaled(scale, scale, scale)


def _sledge_head(rng: Rng) -> Parts:
    metal, half, size = rng.colour("dark", "steel", "bright"), rng.draw(40, 54), rng.draw(30, 40)
    square = 2 * half, size, size
    if rng.chance(0.5):
        return block(square, (0, 0, 0), metal, "metal", size * 0.2)
    sections = [superellipse(s, s, 3, 20, x) for x, s in ((-half, size * 0.85), (-half * 0.6, size), (half * 0.6, size),
                                                         (half, size * 0.85))]  # fmt: skip
    return loft(sections, metal, "metal").outward()


def _mallet_head(rng: Rng) -> Parts:
    colour, half, radius = rng.colour("wood", "dark", "bright"), rng.draw(46, 62), rng.draw(26, 36)
    rings = bands([shade(colour, 0.8), colour, shade(colour, 0.8)], [0.16, 0.84])
    return cylinder(radius, -half, half, rings, "wood", 28, bevel=4).rotated("y", 90)


def make_screwdriver(rng: Rng) -> Mesh:
    """A fluted bright handle, a steel shaft and a flat or crossed tip."""
    long, radius, shaft = rng.draw(80, 110), rng.draw(14, 20), rng.draw(90, 170)
    colour, accent = rng.colour("bright", "bright", "wood"), rng.colour("dark", "bright")
    steel, thin = rng.colour("steel"), rng.draw(3.5, 5)
    lobes, depth = int(rng.integers(5, 9)), rng.draw(0.08, 0.2)
    paint = rng.pick((colour, stripes([colour, accent], lobes), bands([accent, colour, accent], [0.12, 0.8])))
    curve = [(radius * 0.75, 0), (radius, long * 0.12), (radius * 0.98, long * 0.6), (radius * 0.6, long * 0.8),
             # the handle's outline, from its end to the shaft
             (radius * 0.8, long * 0.92), (radius * 0.5, long)]  # fmt: skip
    grip = lathe(curve, paint, "plastic", 24, 40)
    # flutes are pressed in round the handle, but not at its collar
    turn = np.arctan2(grip.vertices[:, 1], grip.vertices[:, 0])
    flute = 1 - depth * (1 + np.cos(lobes * turn)) / 2 * (grip.vertices[:, 2] < long * 0.7)
    grip = grip.bent(lambda vertices: vertices * np.stack([flute, flute, np.ones_like(flute)], 1))
    ends = Parts(ball(radius * 0.74, accent, "plastic", 20, 6, (1, 1, 0.3)),
            ball(radius * 0.5, accent, "plastic", 16, 6, (1, 1, 0.3)).moved(z=long))  # fmt: skip
    stem = cylinder(thin, long, long + shaft, steel, "metal", 14)
    # flat, or crossed
    if rng.chance(0.6):
        tip = loft([np.array([(-w, -d, z), (w, -d, z), (w, d, z), (-w, d, z)]) for w, d, z in
                    ((thin, thin * 0.8, long + shaft - 4), (thin * 1.7, thin * 0.5, long + shaft + 8),
                     (thin * 1.5, thin * 0.2, long + shaft + 18))], steel, "metal")  # fmt: skip
    else:
        tip = cylinder(thin, long + shaft, long + shaft + 12, shade(steel, 0.6), "metal", 8, thin * 0.2)
    driver = Parts(grip, ends, stem, tip.outward()).rotated("y", 90)
    return finish(driver.rotated("z", rng.draw(0, 360)))


def make_dumbbell(rng: Rng) -> Mesh:
    """A short bar between two weights: hexagonal heads, stacks of plates, or balls."""
    reach, radius, bar = rng.draw(70, 95), rng.draw(38, 58), rng.draw(10, 14)
    colour, steel = rng.colour("dark", "bright", "grey"), rng.colour("steel", "dark")
    kind = rng.pick(("hexagon", "plates", "plates", "ball"))
    # an end, its middle on the axis z
    ends = Parts()
    if kind == "hexagon":
        sides = rng.pick((6, 8))
        deep = rng.draw(50, 72)
        profile = [(0, 0), (radius * 0.8, 0), (radius, 9), (radius, deep - 9), (radius * 0.8, deep), (0, deep)]
        ends += revolve(profile, sides, colour, "rubber")
        ends += cylinder(radius * 0.4, deep, deep + 1, shade(colour, 1.6), "metal", 24)
    elif kind == "ball":
        ends += ball(radius, colour, "rubber", 28, 14, (1, 1, 0.9)).moved(z=radius * 0.7)
    else:
        z = 0.0
        for k in range(int(rng.integers(2, 5))):
            # the plates get smaller outwards
            thick, r = rng.draw(11, 18), radius * (1 - 0.17 * k)
            ends += cylinder(r, 0, thick, colour if k % 2 == 0 else shade(colour, 1.35), "rubber", 32, bevel=3).moved(
                z=z
            )
            z += thick
        # a nut and the bar's end
        ends += cylinder(bar * 1.1, z, z + 14, steel, "metal", 6 if rng.chance(0.5) else 16)
        ends += cylinder(bar * 0.8, z, z + 26, steel, "metal", 16)
    # one head, mirrored to the other end; the grip is thickest in the middle
    side = ends.moved(z=reach * 0.62).rotated("x", -90)
    knurl = stripes([steel, shade(steel, 0.75)], 24, 2)
    grip = lathe([(bar, -reach), (bar * 1.15, 0), (bar, reach)], knurl, "metal", 10, 20).rotated("x", 90)
    return finish(Parts(side.both_sides(), grip).rotated("z", rng.draw(0, 180)))


def make_drum(rng: Rng) -> Mesh:
    """A snare, marching or hand drum: skins, hoops, cords or lugs, and a pair of sticks."""
    radius, high = rng.draw(78, 110), rng.draw(60, 150)
    colour, hoop = rng.colour("bright", "wood"), rng.colour("steel", "brass", "wood", "pale")
    skin, cord = (240, 232, 214), rng.colour("pale", "dark", "brass")
    shell = wood_grain(rng, colour) if rng.chance(0.3) else decorate(rng, colour, "bright")
    parts = Parts(revolve([(radius, 0), (radius, high)], 40, shell, "paint"), disc(radius + 1, high, skin, "matte", 40))
    parts += disc(radius + 1, 0, skin, "matte", 40).rotated("x", 180)
    # hoops at both ends
    for z in (0.0, high - 12.0):
        profile = [(radius, z), (radius + 6, z), (radius + 6, z + 13), (radius + 1, z + 13)]
        parts += revolve([*profile, (radius - 4, z + 10)], 40, hoop, "metal" if max(hoop) - min(hoop) < 60 else "paint")
    # cords between the hoops, straight or in a zigzag
    count, laced = int(rng.integers(6, 11)), rng.chance(0.6)
    for k in range(2 * count if laced else count):
        turn = np.pi * k / count * (1 if laced else 2)
        far = turn + (np.pi / count * (1 if k % 2 else -1) if laced else 0)
        low, top = ((radius + 3) * np.array([np.cos(a), np.sin(a), 0]) for a in (turn, far))
        parts += rod([low + np.array([0, 0, 8]), top + np.array([0, 0, high - 8])], 2.2, cord, "cloth", segments=6)
    # two sticks lie crossed on the skin
    if rng.chance(0.6):
        for side in (-1, 1):
            stick = Parts(rod([(-110, 0, 0), (70, 0, 0)], [5.5, 5.5, 3], (206, 166, 112), "wood"),
                     ball(6, (206, 166, 112), "wood", 10, 6).moved(73))  # fmt: skip
            parts += stick.rotated("z", side * rng.draw(12, 40)).moved(0, side * 24, high + 8)
    return finish(parts)


def make_soccer_ball(rng: Rng) -> Mesh:
    """A truncated icosahedron blown up: dark pentagons, pale hexagons, seams; turned anyhow."""
    pale = rng.vary((242, 242, 238), 6) if rng.chance(0.8) else rng.colour("pale", "bright")
    dark = rng.vary((24, 24, 28), 6) if rng.chance(0.7) else rng.colour("bright", "dark")
    # corners of an icosahedron are the pentagons' middles, its faces the hexagons'
    golden = (1 + 5**0.5) / 2
    # twelve corners: a golden rectangle in each of three planes
    corners = np.array([v for a in (-1, 1) for b in (-golden, golden) for v in ((0, a, b), (a, b, 0), (b, 0, a))])
    near = np.linalg.norm(corners[:, None] - corners[None], axis=2) < 2.1
    faces = np.array([corners[i] + corners[j] + corners[k] for i in range(12) for j in range(i) for k in range(j)
                      if near[i, j] and near[j, k] and near[i, k]])  # fmt: skip
    normals = np.concatenate([corners, faces])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.r_[np.full(12, 2.3274), np.full(20, 2.2673)][:, None]  # distances of the solid's faces
    # turned by a random rotation
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        turn, tilt = 2 * np.pi * u, np.pi * (v - 0.5)
        x, y = np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn)
        directions = np.stack([x, y, np.broadcast_to(np.sin(tilt), x.shape)], -1).astype(np.float32)
        # a direction belongs to the face whose plane it meets first; near two of them runs a seam
        reach = directions @ (normals @ axes).T.astype(np.float32)
        first = np.partition(reach, -2, axis=-1)
        seam = first[..., -1] - first[..., -2] < 0.006
        return np.where(seam, 2, reach.argmax(axis=-1) < 12)

    paint = pattern([pale, dark, shade(pale, 0.55)], shader)
    return finish([ball(100, paint, "plastic", 40, 22)])


def make_dice(rng: Rng) -> Mesh:
    """One to three cubes with rounded edges and pips."""
    ground = rng.colour("pale", "bright", "dark")
    # pips light on a dark ground, dark on a light ground
    ink = (246, 244, 238) if sum(ground) < 440 else (22, 22, 24)
    if sum(ground) > 640 and rng.chance(0.3):
        ink = rng.colour("bright")
    parts = Parts()
    for k in range(rng.pick((1, 2, 2, 3))):
        die = _one_die(rng, ground, ink)
        die = die.rotated("z", rng.draw(0, 90))
        # further dice at both sides of the first
        place = (0, 0, 0) if k == 0 else (rng.draw(-20, 20), (2 * k - 3) * rng.draw(92, 110), 0)
        parts += die.moved(*place)
    return finish(parts, 512)


def _one_die(rng: Rng, ground: Colour, ink: Colour) -> Parts:
    half, power = 32.0, 7.0
    # places of the pips on a face, in steps of a quarter of its side
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
    # a superellipsoid of power 7: a cube with rounded edges
    cube = np.stack([u, v, np.ones_like(u)], -1)
    rounded = half * cube / np.linalg.norm(cube, ord=power, axis=2, keepdims=True)
    first = int(rng.integers(1, 4))
    # opposite faces add up to 7
    numbers = [first, 7 - first, *[n for n in range(1, 7) if n not in (first, 7 - first)]]
    turns = [("x", 0), ("x", 180), ("x", 90), ("y", 90), ("y", -90), ("x", -90)]
    sides = zip(numbers, turns, strict=True)
    return Parts(*(surface(rounded, face(n), "plastic").rotated(*turn).moved(z=half) for n, turn in sides))
