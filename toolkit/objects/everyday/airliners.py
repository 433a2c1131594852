"""Airliners, and space shuttles with their tank and boosters."""

import numpy as np

from toolkit.objects.everyday.draws import chance, draw, pick, pick_colour, vary
from toolkit.objects.everyday.paints import pattern
from toolkit.objects.everyday.shapes import (
    block,
    cylinder,
    finish,
    hull,
    mirrored,
    moved,
    turned,
    wing,
)
from toolkit.objects.everyday.warplanes import build_gear
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Part, revolve


def make_airliner(rng: np.random.Generator) -> Mesh:
    """A white tube with rows of windows, swept low wings, engines under them or at the tail, and a coloured fin."""
    radius, span = draw(rng, 12.5, 17), draw(rng, 105, 140)
    white, accent = pick_colour(rng, "pale", "pale", "steel", spread=5), pick_colour(rng, "bright", "car")
    belly, line = (pick(rng, (white, (168, 172, 178), accent)), draw(rng, 0.49, 0.53))
    tail_from = draw(rng, 0.12, 0.3)

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        level = np.sin(2 * np.pi * u)  # u starts at the left side and goes over the top
        windows = (np.abs(level - 0.26) < 0.11) & (v > 0.16) & (v < 0.86) & ((v * 54) % 1 < 0.45)
        doors = (np.abs(level - 0.1) < 0.36) & ((np.abs(v - 0.88) < 0.008) | (np.abs(v - 0.2) < 0.008))
        cockpit = (v > 0.935) & (v < 0.965) & (level > 0.3)
        stripe = (np.abs(level + 0.1) < (line - 0.4)) | (v + 0.1 * level < tail_from)
        index = np.where(level < -0.5, 1, np.where(stripe, 2, 0))
        return np.where(windows | cockpit, 3, np.where(doors, 4, index))

    paint = pattern([white, belly, accent, (40, 46, 56), (140, 144, 150)], shader)
    d = 2 * radius
    body = hull([(-135, 3, 4, radius * 0.55, 2), (-95, d * 0.62, d * 0.66, radius * 0.3, 2), (-60, d, d, 0, 2),
                 (100, d, d, 0, 2), (120, d * 0.8, d * 0.82, -0.8, 2), (131, d * 0.45, d * 0.44, -2.4, 2),
                 (135, 1, 1, -3, 2)], paint, count=28)  # fmt: skip
    grey = (176, 180, 186)
    half = wing(
        (38, radius * 0.5, -radius * 0.5),
        (38 - span * draw(rng, 0.55, 0.75), span, draw(rng, 2, 12)),
        (56, 14),
        5,
        grey,
    )
    rear = chance(rng, 0.25)
    high_tail = rear and chance(rng, 0.6)
    fin_top = radius * 0.8 + draw(rng, 42, 54)
    fin = wing((-82, 0, radius * 0.7), (-122, 0, fin_top), (44, 20), 4, accent, upright=True)
    root = (-118, 0, fin_top - 3) if high_tail else (-98, 3, radius * 0.4)
    tail = wing(root, (root[0] - 26, 46, root[2] + 4), (28, 12), 3, grey)
    parts = [*body, *fin, *mirrored([*half, *tail])]
    engine = hull([(-14, 5, 5, 0, 2), (-4, 12, 12, 0, 2), (12, 14, 14, 0, 2), (16, 12, 12, 0, 2)],
                  pick(rng, (white, accent, grey)), count=8, around=16)  # fmt: skip
    engine += turned(cylinder(5, 15, 16.6, (24, 24, 28), "metal", 16), "y", 90)
    for share in (0.34, 0.62) if chance(rng, 0.3) else (0.36,):
        place = (
            (-62, radius + 8, radius * 0.3) if rear else (38 - span * 0.5 * share + 2, span * share, -radius * 0.5 - 8)
        )
        parts += mirrored(moved([*engine, *block((16, 2, 8), (-2, -6 if rear else 0, 0 if rear else 7), grey)], *place))
    if chance(rng, 0.6):
        parts += build_gear([(98, 0, -radius), (0, 18, -radius * 0.6), (0, -18, -radius * 0.6)], 18, 6)
    return finish(parts, 512)


def make_space_shuttle(rng: np.random.Generator) -> Mesh:
    """The orbiter: white above, black below, with a double delta; on its wheels, or upright on its tank."""
    orbiter = _orbiter(rng)
    if chance(rng, 0.5):
        gear = build_gear([(78, 0, -14), (-52, 24, -14), (-52, -24, -14)], 16, 6)
        return finish([*orbiter, *(gear if chance(rng, 0.7) else [])], 512)
    tank = vary(rng, (190, 104, 52)) if chance(rng, 0.8) else (236, 236, 232)
    white = (240, 240, 238)
    profile = [(0, -100), (22, -94), (26, -84), (26, 74), (22, 104), (12, 128), (2, 140), (0, 140)]
    body = revolve(profile, 28, tank, "matte")
    booster = [revolve([(0, -118), (13, -118), (9, -100), (11, -98), (11, 92), (3, 116), (0, 117)], 20, white, "paint"),
               *cylinder(11.4, 60, 66, (120, 120, 122), "paint", 20), *cylinder(11.4, -40, -36, (60, 60, 62), "paint",
                                                                                20)]  # fmt: skip
    upright = moved(turned(orbiter, "y", -90), -44, 0, -20)  # nose up, its belly to the tank
    return finish([body, *mirrored(moved(booster, 0, 38, 0)), *upright], 512)


def _orbiter(rng: np.random.Generator) -> list[Part]:
    """Nose to +x, belly down, about 200 mm long."""
    white, black = vary(rng, (240, 240, 236), 4), vary(rng, (34, 34, 38), 4)
    waist = draw(rng, -0.35, 0.0)

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        level = np.sin(2 * np.pi * u)
        cockpit = (v > 0.87) & (v < 0.92) & (level > 0.45) & (np.abs(np.cos(2 * np.pi * u)) > 0.04)
        doors = (np.abs(v - 0.3) < 0.004) | (np.abs(v - 0.76) < 0.004)
        return np.where((level < waist) | (v > 0.975) | cockpit, 1, np.where(doors & (level > 0.1), 2, 0))

    paint = pattern([white, black, (150, 150, 152)], shader)
    wide = draw(rng, 30, 36)
    body = hull([(-90, wide, wide, 2, 3), (-70, wide, wide, 0, 3.4), (58, wide, wide, 0, 3.4),
                 (80, wide * 0.84, wide * 0.8, -3, 2.6),
                 (98, wide * 0.4, wide * 0.4, -7, 2.2), (105, 1, 1, -8, 2)], paint, count=26)  # fmt: skip
    half, glove, span = [], draw(rng, 30, 46), draw(rng, 64, 80)
    for z, colour in ((-10, white), (-12.5, black)):
        half += wing((10, wide * 0.4, z), (-46, span, z), (96, 34), 3, colour)
        half += wing((10 + glove, wide * 0.36, z), (-10, wide * 0.95, z), (70, 60), 3, colour)
    fin = wing((-50, 0, wide * 0.4), (-92, 0, wide * 0.4 + draw(rng, 46, 58)), (46, 22), 5, white, upright=True)
    pods = hull([(-98, 8, 10, 0, 2), (-80, 14, 16, 0, 2.4), (-50, 3, 4, -3, 2)], white, count=8, around=12)
    bell = turned([revolve([(4, 0), (6, 6), (9, 16), (7.5, 16), (3, 2)], 16, (70, 66, 66), "metal")], "y", -90)
    engines = [part.moved(-90, y, z) for part in bell for y, z in ((0, 8), (9, -6), (-9, -6))]
    return [*body, *mirrored([*half, *moved(pods, 0, wide * 0.32, wide * 0.42)]), *fin, *engines]
