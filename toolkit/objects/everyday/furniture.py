"""Furniture at the size of a doll's house: chairs, tables, bookcases, table lamps, laptops."""

from itertools import pairwise

import numpy as np

from toolkit.objects.everyday.draws import PALETTES, chance, draw, pick, pick_colour, shade
from toolkit.objects.everyday.paints import decorate, pattern, stripes, wood_grain
from toolkit.objects.everyday.shapes import block, cylinder, finish, lathe, moved, rod, turned
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Colour, Paint, Part, extrude, revolve, surface


def _frame_colour(rng: np.random.Generator) -> Colour:
    return pick_colour(rng, "wood") if chance(rng, 0.65) else pick_colour(rng, "pale", "dark", "bright", "steel")


def _legs(
    rng: np.random.Generator, half: tuple[float, float], high: float, thick: float, colour: Colour, splay: float = 0.0
) -> list[Part]:
    """Four legs, square, round or turned, from the table's corners down."""
    kind, parts = pick(rng, ("square", "round", "tapered")), []
    for x in (-1, 1):
        for y in (-1, 1):
            top = np.array([x * half[0], y * half[1], high])
            foot = top * [1 + splay, 1 + splay, 0]
            if kind == "square" and splay == 0:
                parts += block((thick, thick, high), (top[0], top[1], high / 2), colour, "wood")
            else:
                radii = [thick * 0.3, thick * 0.6] if kind == "tapered" else [thick * 0.5, thick * 0.5]
                parts += rod([foot, top], radii, colour, "wood")
    return parts


def make_chair(rng: np.random.Generator) -> Mesh:
    """Four legs, a seat and a back of slats, spindles, rungs or one panel; some with arms or a cushion."""
    half, deep, seat, back = draw(rng, 46, 58), draw(rng, 44, 56), draw(rng, 88, 115), draw(rng, 90, 140)
    colour, thick = _frame_colour(rng), draw(rng, 8, 12)
    grain: Paint = wood_grain(rng, colour) if chance(rng, 0.4) else colour
    parts = _legs(rng, (deep - 6, half - 6), seat, thick, colour, pick(rng, (0.0, 0.0, 0.12)))
    parts += block((2 * deep, 2 * half, 9), (0, 0, seat + 4), grain, "wood", 2)
    if chance(rng, 0.4):
        cloth = pick_colour(rng, "bright", "ceramic")
        parts += block((2 * deep - 8, 2 * half - 8, 10), (2, 0, seat + 12), cloth, "cloth", 4)
    rest: list[Part] = []
    for side in (-1, 1):
        rest += block((thick, thick, back), (0, side * (half - thick / 2), back / 2), colour, "wood")
    kind = pick(rng, ("slats", "rungs", "panel"))
    rest += block((thick * 0.8, 2 * half, draw(rng, 12, 26)), (0, 0, back - 8), colour, "wood", 2)
    if kind == "slats":
        for share in np.linspace(-0.65, 0.65, int(rng.integers(3, 7))):
            rest += block((5, draw(rng, 5, 9), back), (0, share * half, back / 2), colour, "wood")
    elif kind == "rungs":
        for z in np.linspace(0.3, 0.75, int(rng.integers(2, 4))) * back:
            rest += block((5, 2 * half - thick, 12), (0, 0, z), colour, "wood")
    else:
        rest += block(
            (6, 2 * half - thick, back * 0.62), (0, 0, back * 0.6), pick(rng, (grain, shade(colour, 0.8))), "wood"
        )
    parts += moved(turned(rest, "y", -draw(rng, 2, 14)), -deep + thick / 2, 0, seat + 4)
    if chance(rng, 0.3):
        for y in (-half, half):
            parts += block((2 * deep - 4, 9, 6), (0, y, seat + 48), colour, "wood")
            parts += rod([(deep - 8, y, seat), (deep - 8, y, seat + 48)], 4, colour, "wood")
    return finish(parts)


def make_dining_table(rng: np.random.Generator) -> Mesh:
    """A rectangular, round or oval top on four legs, trestles or a pedestal; bare, or with a cloth or plates."""
    long, wide, high = draw(rng, 110, 135), draw(rng, 66, 95), draw(rng, 100, 130)
    colour = _frame_colour(rng)
    top: Paint = wood_grain(rng, colour) if chance(rng, 0.5) else colour
    kind = pick(rng, ("rectangle", "rectangle", "round", "oval"))
    if kind == "rectangle":
        parts = block((2 * long, 2 * wide, 9), (0, 0, high), top, "wood", 2)
    else:
        wide = long if kind == "round" else wide
        turn = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        outline = np.stack([long * np.cos(turn), wide * np.sin(turn)], 1).tolist()
        parts = moved(extrude(outline, 9, 2, top, "wood"), z=high - 4)
    stand = pick(rng, ("legs", "legs", "pedestal")) if kind != "rectangle" else pick(rng, ("legs", "legs", "trestle"))
    reach = 0.62 if kind != "rectangle" else 0.9
    if stand == "legs":
        parts += _legs(rng, (long * reach, wide * reach), high - 4, draw(rng, 10, 16), colour)
        parts += block((2 * long * reach, 2 * wide * reach, 14), (0, 0, high - 11), shade(colour, 0.85), "wood")
    elif stand == "pedestal":
        parts.append(lathe([(wide * 0.55, 0), (wide * 0.5, 8), (12, 20), (16, high * 0.5), (10, high * 0.7),
                            (30, high - 4)], colour, "wood"))  # fmt: skip
    else:
        for x in (-0.7, 0.7):
            parts += block((12, 2 * wide * 0.8, 8), (x * long, 0, 4), colour, "wood")
            parts += block((14, 34, high - 8), (x * long, 0, high / 2), colour, "wood")
        parts += block((1.4 * long, 6, 14), (0, 0, high * 0.4), colour, "wood")
    for x, y in ((0.55, 0), (-0.55, 0), (0, 0.6), (0, -0.6))[: pick(rng, (0, 0, 2, 4))]:
        plate = [*cylinder(13, 0, 3, (242, 240, 234), "ceramic", 20, 19)]
        parts += moved(plate, x * long, y * wide, high + 4.5)
    return finish(turned(parts, "z", draw(rng, 0, 180)))


def make_bookcase(rng: np.random.Generator) -> Mesh:
    """Upright sides and shelves with a back, filled with books of many colours."""
    half, deep, high = draw(rng, 60, 100), draw(rng, 30, 42), draw(rng, 200, 260)
    if chance(rng, 0.25):
        half, high = draw(rng, 100, 130), draw(rng, 120, 170)
    colour, rows = _frame_colour(rng), int(rng.integers(3, 6))
    rows = min(rows, max(2, int(high / 42)))
    grain: Paint = wood_grain(rng, colour, "v") if chance(rng, 0.5) else colour
    back = block((3, 2 * half, high), (-deep / 2, 0, high / 2), shade(colour, 0.6), "wood")
    parts = back if chance(rng, 0.35) else []
    for y in (-half, half):
        parts += block((deep, 7, high), (0, y, high / 2), grain, "wood")
    levels = np.linspace(draw(rng, 5, 18), high - 4, rows + 1)
    for z in levels:
        parts += block((deep, 2 * half, 6), (0, 0, z), colour, "wood")
    for low, top in pairwise(levels):
        parts += _books(rng, half - 5, deep, low + 3, top - low - 10)
    return finish(turned(parts, "z", draw(rng, -30, 30)))


def _books(rng: np.random.Generator, half: float, deep: float, z: float, room: float) -> list[Part]:
    """A row of books that fills most of a shelf."""
    y, end, parts = -half, half * draw(rng, 0.4, 1.0), []
    while y < end - 14:
        thick, tall = draw(rng, 6, 14), room * draw(rng, 0.7, 0.98)
        colour = pick(rng, PALETTES["bright"] + PALETTES["ceramic"] + PALETTES["dark"] + PALETTES["car"])
        parts += block(
            (deep * draw(rng, 0.7, 0.85), thick - 0.8, tall), (0, y + thick / 2, z + tall / 2), colour, "paper"
        )
        y += thick
    return parts


def make_table_lamp(rng: np.random.Generator) -> Mesh:
    """A turned or slim stand with a cloth shade: cone, drum or bell."""
    foot, stand, belly = draw(rng, 38, 56), draw(rng, 110, 170), draw(rng, 10, 46)
    low, high, wide = stand * draw(rng, 0.85, 0.95), draw(rng, 70, 110), draw(rng, 70, 96)
    top = wide * draw(rng, 0.4, 0.95)
    colour = pick_colour(rng, "ceramic", "brass", "wood", "bright", "dark", "steel")
    kind = pick(rng, ("slim", "gourd", "candlestick"))
    body = {
        "slim": [(foot, 0), (foot, 6), (foot * 0.3, 14), (5, 24), (5, stand)],
        "gourd": [(foot * 0.7, 0), (foot * 0.75, 6), (belly + 14, stand * 0.4), (9, stand * 0.8), (6, stand)],
        "candlestick": [(foot, 0), (foot * 0.9, 8), (9, 22), (18, stand * 0.4), (8, stand * 0.55), (14, stand * 0.8),
                        (6, stand)],
    }[kind]  # fmt: skip
    paint = decorate(rng, colour, "ceramic", "pale") if kind == "gourd" else colour
    cloth = pick_colour(rng, "pale") if chance(rng, 0.6) else pick_colour(rng, "ceramic", "bright")
    bell = 0.5 * (wide + top) - draw(rng, 0, 0.14) * wide
    shade_line = [(wide, low), (bell, low + high / 2), (top, low + high)]
    cloth_paint = stripes([cloth, shade(cloth, 0.88)], int(rng.integers(10, 24))) if chance(rng, 0.4) else cloth
    if chance(rng, 0.2):
        cloth_paint = decorate(rng, cloth, "bright", "pale")
    outer = lathe(shade_line, cloth_paint, "cloth", 10, 36)
    inner = lathe([(r - 2, z) for r, z in shade_line], (250, 240, 214), "cloth", 10, 36).flipped()
    rims = [revolve([(wide - 2, low), (wide, low)], 36, cloth, "cloth"),
            revolve([(top, low + high), (top - 2, low + high)], 36, cloth, "cloth")]  # fmt: skip
    bulb = cylinder(12, low, low + high * 0.7, (252, 246, 226), "glass", 16, 6)
    lower = revolve([(0, 0), (body[0][0], 0)], 32, colour, "paint")
    return finish([lathe(body, paint, "ceramic", 28), lower, outer, inner, *rims, *bulb])


def make_laptop(rng: np.random.Generator) -> Mesh:
    """A flat base with keys and a touchpad, and a lid with a bright screen, opened 95-135°."""
    half, deep, thick = draw(rng, 105, 130), draw(rng, 150, 185), draw(rng, 7, 13)
    case, keys = pick_colour(rng, "steel", "dark", "grey"), pick(rng, ((34, 34, 38), (220, 220, 222)))
    opened = draw(rng, 95, 135)

    def board(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        x, y = (u - 0.06) / 0.88 * 14, (v - 0.42) / 0.5 * 5
        key = (x > 0) & (x < 14) & (y > 0) & (y < 5) & (x % 1 < 0.84) & (y % 1 < 0.82)
        pad = (np.abs(u - 0.5) < 0.16) & (v > 0.06) & (v < 0.36)
        return np.where(pad, 2, key)

    hue, rows = pick_colour(rng, "bright", "ceramic", "pale"), int(rng.integers(2, 7))
    paper = pick(rng, ((244, 246, 248), (40, 44, 52)))

    def screen(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        frame = (u < 0.04) | (u > 0.96) | (v < 0.06) | (v > 0.95)
        window = (u > 0.18) & (u < 0.82) & (v > 0.2) & (v < 0.86)
        line = window & ((v * rows * 3) % 1 < 0.4) & (u > 0.24) & (u < 0.5 + 0.3 * np.sin(v * 40) ** 2)
        return np.where(frame, 0, np.where(line, 3, np.where(window, 2, 1)))

    base = block((deep, 2 * half, thick), (deep / 2, 0, thick / 2), case, "metal", 1.5)
    top = _sheet(deep, half, pattern([case, keys, shade(case, 0.85)], board)).moved(z=thick + 0.3)
    ink = (70, 76, 90) if paper[0] > 99 else (150, 220, 160)
    glass = _sheet(deep * 0.94, half, pattern([(16, 16, 18), hue, paper, ink], screen), "glass").moved(z=0.4)
    lid = [*block((deep * 0.94, 2 * half, 5), (deep * 0.47, 0, -2.5), case, "metal", 1.5), glass]
    flat = moved(lid, x=-deep * 0.94)  # opened by 180°: behind the hinge, its screen up
    raised = turned(flat, "y", 180 - opened)
    return finish([*base, top, *moved(raised, z=thick + 3)], 512)


def _sheet(deep: float, half: float, paint: Paint, material: str = "plastic") -> Part:
    """A level picture that a person at +x reads: its chart's right is +y, its top -x."""
    return surface(np.array([[(deep, -half, 0), (deep, half, 0)], [(0, -half, 0), (0, half, 0)]]), paint, material)
