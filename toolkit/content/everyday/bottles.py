"""Bottles and what milk comes in: wine, pop, milk cans, and eggnog in bottles, cartons, jugs and glasses."""

import numpy as np

from toolkit.content.everyday.paints import (
    chance,
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
from toolkit.content.everyday.shapes import (
    ball,
    block,
    cylinder,
    disc,
    finish,
    lathe,
    moved,
    net_part,
    push,
    rod,
    turned,
    vessel,
)
from toolkit.content.modelling import Colour, Paint, Part, revolve, smooth_curve
from toolkit.objects.mesh import Mesh

CREAM: Colour = (246, 230, 176)
FOAM: Colour = (252, 243, 214)
FESTIVE: tuple[tuple[Colour, Colour], ...] = (
    ((168, 24, 34), (255, 244, 214)), ((24, 92, 52), (255, 244, 214)), ((250, 240, 214), (168, 24, 34)),
    ((28, 58, 120), (255, 250, 236)), ((250, 240, 214), (24, 92, 52)), ((206, 160, 60), (98, 8, 18)),
)  # fmt: skip
"""Paper and ink of labels."""
NAMES = ("EGG NOG", "EGGNOG", "NOG")


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
    curve = [
        (radius, to_z),
        (radius, wall_top),
        (radius * 0.86, wall_top + 0.45 * (shoulder - wall_top)),
        (neck, shoulder),
    ]
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
    radius, high = draw(rng, 36, 44), draw(rng, 210, 270)
    waist = radius * draw(rng, 0.8, 1.0)
    drink = vary(rng, pick(rng, ((58, 26, 18), (236, 120, 24), (70, 160, 60), (206, 226, 226), (200, 40, 60),
                                 (240, 206, 60))), 8)  # fmt: skip
    band = pick_colour(rng, "bright")
    ink = pick(rng, ((250, 250, 246), (250, 220, 60), shade(band, 0.3)))
    low, top = high * draw(rng, 0.36, 0.44), high * draw(rng, 0.58, 0.66)
    sign = label(band, band, ink, pick_word(rng), (0.25, 0.75), 0.4, (0.02, 0.98))
    foot = lathe([(radius * 0.6, 0), (radius * 0.95, 10), (radius, 28), (waist, low)], drink, "glass", 18)
    lobes = 5

    def dent(points: np.ndarray) -> np.ndarray:
        angle = np.arctan2(points[:, 1], points[:, 0])
        share = 1 - 0.16 * np.clip(1 - points[:, 2] / 30, 0, 1) * (1 + np.cos(lobes * angle)) / 2
        return points * np.stack([share, share, np.ones_like(share)], 1)

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
    for z in (wall_top * 0.3, wall_top * 0.7):
        body += [(radius, z - 3), (radius + 2, z), (radius, z + 3)]
    body += [(radius, wall_top), (neck, neck_low), (neck, high - 18)]
    lid = [(neck + 2, high - 18), (neck + 8, high - 10), (neck + 9, high - 4), (neck * 0.6, high), (0, high + 2)]
    ears = []
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
    """A milk bottle: wide body, round shoulder, short neck, cap; cream shows through the glass."""
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
    """A milk carton with a gable, all printed."""
    side, high, gable = draw(rng, 70, 92), draw(rng, 120, 175), draw(rng, 28, 42)
    paper, ink = pick(rng, FESTIVE)
    half = side / 2
    ring = np.array([(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)])
    rows = [np.c_[ring, np.full(5, z)] for z in (0.0, high)]
    front = label(paper, vary(rng, CREAM if paper != FESTIVE[2][0] else FOAM, 6), ink if ink[0] < 200 else paper,
                  pick(rng, NAMES),
                  (0.125, 0.375, 0.625, 0.875), 0.2, (0.25, 0.75))  # fmt: skip
    ridge = np.array([(-half, 0), (half, 0), (half, 0), (-half, 0), (-half, 0)]) * [1, 0]
    roof = [rows[1], np.c_[ridge * [0.999, 1] + ring * [0, 0.03], np.full(5, high + gable)]]
    cap = cylinder(12, 0, 12, pick_colour(rng, "bright"), "plastic", 16)
    slope = np.degrees(np.arctan2(gable, half))
    cap = moved(turned(cap, "x", -slope), 0, half * 0.5, high + gable * 0.5)
    return [
        net_part(rows, front, "paper"),
        net_part(roof, pick(rng, (paper, ink)), "paper"),
        *block((side, side, 1), (0, 0, 0), paper, "paper"),
        *block((side, 3, 18), (0, 0, high + gable + 7), paper, "paper"),
        *(cap if chance(rng, 0.5) else []),
    ]


def _nog_jug(rng: np.random.Generator) -> list[Part]:
    """A squarish plastic jug full of cream, with a handle, a label and a cap."""
    half, high, cream = draw(rng, 42, 54), draw(rng, 160, 200), vary(rng, CREAM, 5)
    rows = []
    for share, z in ((0.9, 0), (1, 0.05), (1, 0.14), (1, 0.5), (1, 0.56), (0.78, 0.72), (0.34, 0.88), (0.34, 0.95)):
        angle = np.linspace(np.pi, 3 * np.pi, 33)
        round_off = np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle))) ** 0.75
        rows.append(np.stack([half * share / round_off * np.cos(angle), half * share / round_off * np.sin(angle),
                              np.full(33, z * high)], 1))  # fmt: skip
    handle = [(-half * 0.2, 0, high * 0.88), (-half * 0.95, 0, high * 0.86), (-half * 1.35, 0, high * 0.66),
              (-half * 0.98, 0, high * 0.42)]  # fmt: skip
    return [
        net_part(rows[:3], cream, "plastic"),
        net_part(rows[2:4], _name(rng, cream), "paper"),
        net_part(rows[3:], cream, "plastic"),
        *block((half * 1.2, half * 1.2, 1), (0, 0, 0.5), cream),
        *cylinder(half * 0.38, high * 0.94, high * 1.03, pick_colour(rng, "bright"), "plastic", 24, bevel=1.5),
        *rod(handle, half * 0.17, cream, "plastic"),
    ]


def _nog_glass(rng: np.random.Generator) -> list[Part]:
    """A tumbler or a stemmed glass of it: foam, nutmeg and a stick of cinnamon."""
    stem = draw(rng, 35, 60) if chance(rng, 0.5) else 0.0
    radius, high = draw(rng, 34, 44), draw(rng, 80, 130)
    clear, cream = (214, 224, 220), vary(rng, CREAM, 5)
    outline = smooth_curve([(radius * (0.35 if stem else 0.8), 0), (radius * 0.85, high * 0.2), (radius, high * 0.6),
                            (radius * 1.02, high * 0.9)], 16)  # fmt: skip
    foam = scatter(rng, FOAM, [(134, 88, 46), (160, 112, 64)], 90, 0.012)
    cup = vessel(outline, 2.5, cream, clear, "glass", content=(0.94, foam, "matte"))
    top = high * 0.9
    lip = [
        (outline[-1, 0], top), (outline[-1, 0] + 0.5, top + 9), (outline[-1, 0] - 2, top + 9),
        (outline[-1, 0] - 2, top),
    ]  # fmt: skip
    bark = wood_grain(rng, (134, 78, 40), "v")
    lean = radius * draw(rng, 0.5, 0.8)
    stick = rod([(-lean * 0.2, 0, high * 0.5), (lean, 0, high + draw(rng, 34, 60))], draw(rng, 5, 7), bark, "wood")
    parts = moved([*cup, revolve(lip, 32, clear, "glass"), *turned(stick, "z", draw(rng, 0, 360))], z=stem)
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
