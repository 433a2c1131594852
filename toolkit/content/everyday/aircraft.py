"""What flies: warplanes, airliners, and space shuttles with their tank and boosters."""

import numpy as np

from toolkit.content.everyday.paints import blotches, chance, draw, pattern, pick, pick_colour, vary
from toolkit.content.everyday.shapes import (
    ball,
    block,
    cylinder,
    disc,
    finish,
    hull,
    mirrored,
    moved,
    rod,
    turned,
    wheel,
    wing,
)
from toolkit.content.modelling import Colour, Paint, Part, revolve
from toolkit.objects.mesh import Mesh


def make_warplane(rng: np.random.Generator) -> Mesh:
    """A delta, a swept-wing twin-finned jet, or a propeller fighter, in camouflage or bare metal."""
    return finish(pick(rng, (_delta_jet, _swept_jet, _swept_jet, _propeller_fighter))(rng), 512)


def _skin(rng: np.random.Generator) -> tuple[Paint, Colour]:
    """Camouflage, grey or bare metal, and its main colour."""
    main = pick_colour(rng, "military") if chance(rng, 0.8) else pick_colour(rng, "steel", "car")
    if chance(rng, 0.45):
        return main, main
    others = [pick_colour(rng, "military") for _ in range(int(rng.integers(1, 3)))]
    return blotches(rng, [main, *others], pick(rng, (4, 7))), main


def _canopy(x: float, z: float, long: float, wide: float) -> Part:
    return ball(1, (26, 32, 40), "glass", 16, 8, (long, wide, wide * 1.1)).moved(x, 0, z)


def _roundels(rng: np.random.Generator, x: float, y: float, z: float, size: float) -> list[Part]:
    """Rings of colour on both wings."""
    colours = pick(rng, (((28, 54, 120), (244, 244, 240), (196, 32, 40)),
                         ((196, 32, 40), (244, 244, 240), (28, 54, 120)),
                         ((30, 40, 80), (230, 230, 230), (30, 40, 80))))  # fmt: skip
    rings = pattern(colours, lambda u, v, aspect: 2 - np.digitize(np.hypot(u - 0.5, v - 0.5), [0.2, 0.36]))
    roundel = disc(size / 2, 0.5, rings, "paint", 16)
    return [roundel.moved(x, side * y, z) for side in (1, -1)]


def build_gear(places: list[tuple[float, float, float]], down: float, radius: float) -> list[Part]:
    """Legs with wheels from places (x, y, z)."""
    parts = []
    for x, y, z in places:
        parts += rod([(x, y, z), (x, y, z - down)], 1.4, (150, 152, 156), "metal", segments=6)
        parts += moved(wheel(radius, radius * 0.8, (28, 28, 30), (170, 172, 176), segments=14), x, y, z - down)
    return parts


def _stores(rng: np.random.Generator, x: float, y: float, z: float, long: float) -> list[Part]:
    """A missile or a tank under each wing."""
    paint, thick = pick(rng, ((236, 236, 232), (120, 126, 120))), draw(rng, 2, 4)
    body = hull([(-long / 2, 1, 1, 0, 2), (-long * 0.3, thick * 2, thick * 2, 0, 2),
                 (long * 0.3, thick * 2, thick * 2, 0, 2),
                 (long / 2, 0.6, 0.6, 0, 2)], paint, count=8, around=10)  # fmt: skip
    fins = block((long * 0.16, thick * 5, 0.8), (-long * 0.36, 0, 0), paint)
    fins += block((long * 0.16, 0.8, thick * 5), (-long * 0.36, 0, 0), paint)
    return mirrored(moved([*body, *fins, *block((long * 0.3, 1.4, 8), (0, 0, 4), paint)], x, y, z))


def _delta_jet(rng: np.random.Generator) -> list[Part]:
    skin, main = _skin(rng)
    wide, span, root = draw(rng, 24, 30), draw(rng, 72, 92), draw(rng, 110, 140)
    body = hull([(-118, wide * 0.7, wide * 0.7, 0, 2), (-60, wide, wide, 0, 2.4), (10, wide * 1.2, wide, 0, 2.6),
                 (60, wide * 0.72, wide * 0.8, 1, 2), (100, wide * 0.5, wide * 0.5, 0, 2), (150, 0.6, 0.6, -2, 2)],
                skin)  # fmt: skip
    edge = root - 105
    half = wing((edge, 6, -3), (edge - root + draw(rng, 18, 34), span, -3), (root, draw(rng, 12, 26)), 5, skin)
    canards = wing((78, 6, 3), (58, draw(rng, 30, 40), 4), (24, 9), 3, main) if chance(rng, 0.6) else []
    fin = wing((-50, 0, 6), (-100, 0, draw(rng, 46, 62)), (66, 22), 4, skin, upright=True)
    intakes = hull([(-20, 10, 16, 0, 4), (20, 14, 18, 0, 4), (44, 13, 17, 0, 4)], main, count=4)
    mouth = block((1, 10, 13), (44.5, 0, 0), (16, 16, 18))
    parts = [*body, *mirrored([*half, *canards, *moved([*intakes, *mouth], y=wide * 0.52)]), *fin]
    parts.append(_canopy(66, wide * 0.36, 26, 8))
    parts += turned(cylinder(wide * 0.33, 117, 126, (60, 58, 58), "metal", 20, wide * 0.28), "y", -90)
    parts += _roundels(rng, -60, span * 0.5, 0.6, 22) if chance(rng, 0.6) else []
    if chance(rng, 0.7):
        parts += _stores(rng, -40, span * draw(rng, 0.45, 0.7), -11, draw(rng, 44, 64))
    parts += build_gear([(84, 0, -8), (-30, 26, -4), (-30, -26, -4)], 28, 8) if chance(rng, 0.6) else []
    return parts


def _swept_jet(rng: np.random.Generator) -> list[Part]:
    skin, main = _skin(rng)
    wide, tall, span = draw(rng, 30, 44), draw(rng, 20, 28), draw(rng, 74, 104)
    body = hull([(-112, wide * 0.9, tall * 0.7, 0, 3.4), (-40, wide * 1.05, tall, 0, 3.6), (30, wide, tall, 0, 3.4),
                 (70, wide * 0.5, tall * 0.95, 1, 2.4), (110, wide * 0.34, tall * 0.6, 0, 2), (152, 0.6, 0.6, -2, 2)],
                skin)  # fmt: skip
    root = draw(rng, 64, 90)
    half = wing(
        (root * 0.4, wide * 0.4, 0), (root * 0.4 - draw(rng, 40, 70), span, draw(rng, -4, 2)), (root, 24), 5, skin
    )
    tail = wing((-76, wide * 0.4, -1), (-104, draw(rng, 48, 60), -1), (38, 18), 3, skin)
    twin, lean = chance(rng, 0.65), draw(rng, 0, 16)
    at = wide * 0.36 if twin else 0.0
    fin = wing((-52, at, tall * 0.3), (-92, at + (lean if twin else 0), tall * 0.3 + draw(rng, 40, 58)), (48, 20), 3,
               skin,
               upright=True)  # fmt: skip
    pipe = turned(cylinder(tall * 0.4, 111, 124, (58, 56, 56), "metal", 20, tall * 0.33), "y", -90)
    intake = block((60, 9, tall * 0.8), (18, wide * 0.5 + 3, -1), main, bevel=2)
    mouth = block((1, 6, tall * 0.6), (48.4, wide * 0.5 + 3, -1), (16, 16, 18))
    parts = [*body, *mirrored([*half, *tail, *intake, *mouth, *moved(pipe, y=wide * 0.24)])]
    parts += mirrored(fin) if twin else fin
    parts.append(_canopy(74, tall * 0.4, 27, 8.5))
    parts += _roundels(rng, -20, span * 0.62, 1.6, 18) if chance(rng, 0.5) else []
    if chance(rng, 0.75):
        parts += _stores(rng, -16, span * draw(rng, 0.5, 0.75), -10, draw(rng, 44, 64))
    parts += build_gear([(84, 0, -8), (-30, 22, -6), (-30, -22, -6)], 28, 8) if chance(rng, 0.6) else []
    return parts


def _propeller_fighter(rng: np.random.Generator) -> list[Part]:
    skin, _ = _skin(rng)
    wide, span = draw(rng, 26, 32), draw(rng, 110, 134)
    body = hull([(-118, 3, 8, 6, 2), (-60, wide * 0.6, wide * 0.75, 3, 2), (10, wide, wide * 1.15, 0, 2.2),
                 (70, wide * 0.95, wide, 0, 2.4), (92, wide * 0.7, wide * 0.75, 0, 2)], skin)  # fmt: skip
    half = wing((46, 6, -8), (28, span, draw(rng, 0, 8)), (54, 24), 7, skin)
    tail = wing((-84, 3, 8), (-94, 48, 8), (30, 16), 3, skin)
    fin = wing((-82, 0, 8), (-102, 0, 50), (38, 20), 3, skin, upright=True)
    nose = pick_colour(rng, "bright", "dark")
    spinner = turned([revolve([(wide * 0.32, 92), (wide * 0.26, 102), (2, 114), (0, 115)], 20, nose, "paint")], "y", 90)
    blades, count = [], pick(rng, (2, 3, 4))
    for k in range(count):
        blade = ball(1, (36, 36, 38), "metal", 10, 8, (1.4, 4.4, 22)).moved(99, 0, 27)
        blades.append(blade.rotated("x", 360 / count * k + 20))
    parts = [*body, *mirrored([*half, *tail]), *fin, *spinner, *blades, _canopy(-2, wide * 0.52, 25, 8.5)]
    parts += _roundels(rng, 16, span * 0.6, 2.4, 26)
    parts += build_gear([(34, 34, -8), (34, -34, -8)], 26, 9) if chance(rng, 0.5) else []
    return parts


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
        (56, 14), 5, grey,
    )  # fmt: skip
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
