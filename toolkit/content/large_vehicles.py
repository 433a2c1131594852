"""Vans, buses, trolleybuses, trams and lorries, lettered; and the fleet of a city.

Frame: as in `toolkit.content.vehicles`.
"""

from dataclasses import dataclass, replace

import numpy as np

from toolkit.content.drawing import Canvas, Colour
from toolkit.content.pieces import Looks, bars, box, boxes, merge, place, wall_quads
from toolkit.content.vehicles import (
    CAB_YELLOW,
    CAR_COLOURS,
    GLASS,
    HATCH,
    HEAD,
    HEAD_GLOW,
    MINIVAN,
    RUBBER,
    SEDAN,
    SUV,
    TAIL,
    TAIL_GLOW,
    VEHICLE,
    WAGON,
    Body,
    Livery,
    Vehicle,
    bodywork,
    car,
    car_ends,
    ground_coat,
    mirrors,
    shade,
    wheels,
)
from toolkit.objects.mesh import Material

VAN = Body(
    5.6, 2.02,
    (
        (-2.8, 0.6), (-2.79, 2.2), (-2.7, 2.42), (0.6, 2.46), (1.2, 2.3), (1.95, 1.34), (2.55, 1.12), (2.76, 0.86),
        (2.8, 0.55),
    ),
    1.28, (-2.79, -2.78, 1.2, 1.95), (-1.75, 1.8), wheel_m=0.36, sill=0.28, roof_share=0.9, taper=0.93,
)  # fmt: skip
BUS = Body(
    11.8, 2.55,
    ((-5.9, 0.5), (-5.89, 2.6), (-5.75, 3.0), (-5.2, 3.08), (5.4, 3.08), (5.78, 2.98), (5.88, 2.5), (5.9, 0.5)),
    1.1, (-5.9, -5.88, 5.8, 5.88), (-2.9, 3.1), wheel_m=0.48, sill=0.3, roof_share=0.94, taper=0.96, px_per_m=56,
)  # fmt: skip
TRAM = Body(
    15.0, 2.5,
    (
        (-7.5, 0.5), (-7.44, 1.3), (-7.1, 2.9), (-6.7, 3.2), (-6.0, 3.26), (6.0, 3.26), (6.7, 3.2), (7.1, 2.9),
        (7.44, 1.3), (7.5, 0.5),
    ),
    1.2, (-7.42, -7.0, 7.0, 7.42), (-4.2, 4.2), wheel_m=0.36, sill=0.26, roof_share=0.93, taper=0.86, px_per_m=48,
)  # fmt: skip
LORRY_CAB = Body(
    2.1, 2.4,
    ((-1.05, 0.6), (-1.04, 2.4), (-0.9, 2.7), (0.5, 2.74), (0.85, 2.5), (1.02, 1.5), (1.05, 0.55)),
    1.45, (-1.04, -1.03, 0.75, 1.0), (0.1,), wheel_m=0.5, sill=0.5, roof_share=0.92, taper=0.95,
)  # fmt: skip
RED, BLUE, GREEN, WHITE = (186, 28, 34), (30, 80, 160), (34, 104, 70), (236, 236, 232)


def van(colour: Colour, words: str, looks: Looks, name: str) -> Vehicle:
    """A delivery van with a firm's name on its flanks."""
    body, paint = VAN, Livery(VAN, colour)
    ground_coat(paint)
    car_ends(paint, looks.rng(name))
    w = body.width / 2
    paint.fill("left right", [(0.75, 1.32), (0.8, 2.1), (1.3, 2.1), (1.85, 1.36)], GLASS)
    paint.line("left right", [(0.7, 0.4), (0.7, 2.2)], 0.02, shade(colour, 0.5))
    paint.line("left right", [(-0.6, 0.4), (-0.6, 2.2)], 0.02, shade(colour, 0.5))
    paint.rect("left right", (0.78, 1.14), (0.98, 1.19), (30, 30, 32))
    ink = (236, 236, 232) if sum(colour) < 380 else (30, 52, 120)
    paint.rect("left right", (-2.75, 1.02), (0.6, 1.1), ink)
    paint.text("left right", (-1.05, 1.65), words, 0.5, ink, fit_m=2.9)
    paint.text("left right", (-1.05, 1.25), "EXPRESS DELIVERY", 0.18, ink)
    paint.fill("top", [(1.2, -w * 0.82), (1.95, -w * 0.88), (1.95, w * 0.88), (1.2, w * 0.82)], GLASS)
    paint.fill("front", [(-w * 0.82, 2.28), (-w * 0.9, 1.36), (w * 0.9, 1.36), (w * 0.82, 2.28)], GLASS)
    for y in (-0.48, 0.48):
        paint.rect("rear", (y - 0.4, 1.35), (y + 0.4, 2.1), GLASS)
    paint.line("rear", [(0, 0.4), (0, 2.3)], 0.03, shade(colour, 0.4))
    paint.text("rear", (0, 1.1), words, 0.22, ink, fit_m=1.7)
    sheet = paint.sheet(name, looks)
    return Vehicle(
        merge(bodywork(body, sheet, looks), wheels(body, looks, (120, 122, 124), 6), mirrors(body, RUBBER, looks)),
        body.length, body.width,
    )  # fmt: skip


def _rows_of_windows(
    paint: Livery, x0: float, x1: float, count: int, z: tuple[float, float], doors: tuple[int, ...] = ()
) -> None:
    edges = np.linspace(x0, x1, count + 1)
    lit = (250, 226, 176)
    paint.rect("left right", (x0 - 0.1, z[0] - 0.06), (x1 + 0.1, z[1] + 0.06), (22, 23, 25))
    for k in range(count):
        a, b = float(edges[k]) + 0.04, float(edges[k + 1]) - 0.04
        paint.rect("left right", (a, z[0]), (b, z[1]), (50, 60, 68), lit)
        shape = [(a, z[1]), (a + 0.5 * (b - a), z[1]), (a + 0.2 * (b - a), z[0]), (a, z[0])]
        paint.fill("left right", shape, (92, 108, 120))
        for seat in np.arange(a + 0.15, b - 0.1, 0.42):
            paint.rect("left right", (seat, z[0]), (seat + 0.2, z[0] + 0.22), (44, 60, 108))
        if k in doors:
            paint.rect("right", (a, 0.36), (b, z[1] + 0.1), (28, 30, 32), shade(lit, 0.8))
            for u, v in ((a + 0.06, (a + b) / 2 - 0.03), ((a + b) / 2 + 0.03, b - 0.06)):
                paint.rect("right", (u, 0.5), (v, z[1] + 0.02), (72, 86, 96))


def bus(looks: Looks, name: str, colour: Colour, route: str, trolley: bool = False) -> Vehicle:
    """A city bus with a lit destination; a trolleybus carries poles on its roof."""
    body, paint = BUS, Livery(BUS, colour)
    half, w = body.length / 2, body.width / 2
    white = (236, 236, 232)
    paint.rect("left right", (-half, 0.0), (half, 0.45), (40, 42, 44))
    paint.rect("left right", (-half, 2.62), (half, 3.1), white if sum(colour) < 400 else shade(colour, 0.8))
    paint.rect("left right", (-half, 0.98), (half, 1.04), white)
    paint.rect("top", (-half, -w), (half, w), (222, 222, 218))
    for axle in body.axles:
        angle, r = np.linspace(0, 2 * np.pi, 33), body.wheel_m * 1.2
        paint.fill("left right", [(axle + r * np.cos(a), body.wheel_m + r * np.sin(a)) for a in angle], RUBBER)
    _rows_of_windows(paint, -half + 0.35, half - 0.4, 8, (1.15, 2.5), doors=(4, 7))
    paint.text("left", (-1.0, 0.76), "METRO TRANSIT", 0.3, white)
    paint.text("right", (-3.6, 0.76), "METRO TRANSIT", 0.3, white)
    paint.rect("left", (-2.6, 0.5), (2.4, 0.97), (250, 210, 30))
    paint.text("left", (-0.1, 0.74), "CITY THEATRE · NOW OPEN", 0.34, (180, 20, 30), fit_m=4.6)
    paint.rect("front", (-w * 0.93, 1.05), (w * 0.93, 2.6), GLASS, (90, 80, 60))
    paint.fill("front", [(-w * 0.8, 2.55), (-w * 0.3, 2.55), (w * 0.2, 1.1), (-w * 0.5, 1.1)], (76, 90, 102))
    paint.rect("front", (-0.02, 1.05), (0.02, 2.6), (20, 20, 20))
    paint.rect("front rear", (-w * 0.8, 2.64), (w * 0.8, 2.95), (14, 14, 15))
    paint.text("front", (0, 2.8), route, 0.26, (255, 170, 30), fit_m=1.9, lit=True)
    paint.rect("right", (half - 2.4, 2.64), (half - 0.6, 2.92), (14, 14, 15))
    paint.text("right", (half - 1.5, 2.78), route, 0.22, (255, 170, 30), fit_m=1.7, lit=True)
    paint.rect("rear", (-w * 0.8, 1.5), (w * 0.8, 2.5), GLASS)
    paint.rect("rear", (-w * 0.7, 0.55), (w * 0.7, 1.3), shade(colour, 0.6))
    for k in range(6):
        paint.line("rear", [(-w * 0.66, 0.62 + 0.11 * k), (w * 0.66, 0.62 + 0.11 * k)], 0.03, (30, 30, 32))
    for side in (1, -1):
        paint.rect("front", (side * w * 0.55, 0.55), (side * w * 0.92, 0.75), HEAD, HEAD_GLOW)
        paint.rect("rear", (side * w * 0.78, 0.6), (side * w * 0.95, 1.4), TAIL, TAIL_GLOW)
    paint.rect("front", (-0.3, 0.42), (0.3, 0.54), (240, 238, 226))
    sheet = paint.sheet(name, looks)
    units = looks.plain((196, 198, 196))
    low = np.array([(-4.6, -0.9, 3.08), (1.6, -0.8, 3.08)])
    pieces = [
        bodywork(body, sheet, looks, 10), wheels(body, looks, (150, 152, 154), 8),
        boxes(low, low + [2.2, 1.7, 0.22], units, VEHICLE),
        box((half - 0.1, half + 0.3), (w, w + 0.22), (1.9, 2.4), looks.plain(RUBBER), VEHICLE),
        box((half - 0.1, half + 0.3), (-w - 0.22, -w), (1.9, 2.4), looks.plain(RUBBER), VEHICLE),
    ]  # fmt: skip
    if trolley:
        foot = np.array([(-1.0, 0.3, 3.25), (-1.0, -0.3, 3.25)])
        pieces += [
            boxes([-1.6, -0.5, 3.08], [-0.4, 0.5, 3.3], looks.plain((60, 62, 64)), VEHICLE),
            bars(foot, foot + [-5.4, 0.0, 2.2], 0.07, looks.plain((40, 42, 44)), VEHICLE),
        ]
    return Vehicle(merge(*pieces), body.length, body.width)


def tram(looks: Looks, name: str, colour: Colour, route: str) -> Vehicle:
    """A tramcar in two colours with its pantograph up."""
    body, paint = TRAM, Livery(TRAM, colour)
    half, w = body.length / 2, body.width / 2
    cream = (236, 226, 200)
    paint.rect("left right front rear", (-half, 2.72), (half, 3.3), cream)
    paint.rect("left right front rear", (-half, 1.0), (half, 1.14), cream)
    paint.rect("left right front rear", (-half, 0.0), (half, 0.5), (44, 46, 48))
    paint.rect("top", (-half, -w), (half, w), (150, 152, 150))
    _rows_of_windows(paint, -half + 1.0, half - 1.0, 9, (1.3, 2.6), doors=(0, 4, 8))
    paint.text("left right", (-1.6, 0.8), "CITY TRAMWAYS", 0.28, cream)
    for end in ("front", "rear"):
        paint.fill(end, [(-w * 0.78, 1.35), (w * 0.78, 1.35), (w * 0.72, 2.7), (-w * 0.72, 2.7)], GLASS, (80, 70, 52))
        paint.fill(end, [(-w * 0.6, 2.6), (-w * 0.1, 2.6), (w * 0.2, 1.4), (-w * 0.4, 1.4)], (80, 94, 106))
        paint.rect(end, (-w * 0.6, 2.78), (w * 0.6, 3.06), (14, 14, 15))
        paint.text(end, (0, 2.92), route, 0.24, (255, 200, 60), fit_m=1.3, lit=True)
    for side in (1, -1):
        paint.rect("front", (side * w * 0.45, 0.62), (side * w * 0.72, 0.86), HEAD, HEAD_GLOW)
        paint.rect("rear", (side * w * 0.45, 0.62), (side * w * 0.72, 0.86), TAIL, TAIL_GLOW)
    sheet = paint.sheet(name, looks)
    iron = looks.plain((56, 58, 60))
    arm = np.array([(0.3, -0.5, 3.3), (0.3, 0.5, 3.3), (1.5, -0.5, 4.3), (1.5, 0.5, 4.3)])
    tip = np.array([(1.5, -0.5, 4.3), (1.5, 0.5, 4.3), (0.6, -0.3, 5.45), (0.6, 0.3, 5.45)])
    low = np.array([(-5.0, -0.8, 3.25), (2.6, -0.8, 3.25)])
    return Vehicle(
        merge(
            bodywork(body, sheet, looks, 12), wheels(body, looks, (90, 92, 94), 8), bars(arm, tip, 0.07, iron, VEHICLE),
            bars([0.6, -0.8, 5.48], [0.6, 0.8, 5.48], 0.08, iron, VEHICLE),
            boxes(low, low + [2.2, 1.6, 0.32], looks.plain((176, 178, 176)), VEHICLE),
        ),
        body.length, body.width,
    )  # fmt: skip


def lorry(looks: Looks, name: str, colour: Colour, box_colour: Colour, words: str) -> Vehicle:
    """A lorry with a box body and lettering."""
    paint = Livery(LORRY_CAB, colour)
    w = LORRY_CAB.width / 2
    paint.rect("front left right", (-1.2, 0.0), (1.2, 0.75), (36, 37, 39))
    paint.rect("front", (-w * 0.9, 1.5), (w * 0.9, 2.4), GLASS)
    paint.fill("left right", [(-0.6, 1.5), (-0.6, 2.35), (0.5, 2.35), (0.85, 1.5)], GLASS)
    paint.line("left right", [(-0.65, 0.7), (-0.65, 2.4)], 0.02, shade(colour, 0.5))
    paint.rect("front", (-w * 0.6, 0.85), (w * 0.6, 1.35), (26, 26, 28))
    for k in range(5):
        paint.line("front", [(-w * 0.58, 0.9 + 0.1 * k), (w * 0.58, 0.9 + 0.1 * k)], 0.03, (140, 142, 144))
    for side in (1, -1):
        paint.rect("front", (side * w * 0.66, 0.55), (side * w * 0.95, 0.78), HEAD, HEAD_GLOW)
    sheet = paint.sheet(name, looks)
    cab = merge(bodywork(LORRY_CAB, sheet, looks, 8)).moved(2.9)
    canvas = Canvas(5.6, 2.5, 56, box_colour)
    canvas.rect(0, 0, 5.6, 0.35, shade(colour, 0.9))
    ink = colour if sum(box_colour) > 400 else (240, 240, 236)
    canvas.text(2.8, 1.5, words, 0.85, ink, fit_m=5.0)
    canvas.text(2.8, 0.75, "REMOVALS · STORAGE · 24 HOURS", 0.24, ink, fit_m=4.8)
    boards = looks.add(Material(f"{name}-box", canvas.texture(0.05, looks.rng(name)), 0.5), (5.6, 2.5))
    plain, dark = looks.plain(box_colour), looks.plain((34, 35, 37), "matte")
    flanks = wall_quads((-2.8, 1.0, 2.8, 3.5), 0.0, boards, VEHICLE, fit=True)
    pieces = [
        cab,
        box((-3.9, 1.7), (-1.22, 1.22), (1.0, 3.5), plain, VEHICLE),
        place(flanks, [(-1.1, -1.225, 0), (-1.1, 1.225, 0)], [0.0, 180.0]),
        box((-3.8, 3.2), (-0.5, 0.5), (0.5, 0.95), dark, VEHICLE),
        boxes(
            [(-3.92, -1.1, 0.7), (-3.92, 0.8, 0.7)], [(-3.85, -0.8, 0.9), (-3.85, 1.1, 0.9)], looks.plain(TAIL, "lamp"),
            VEHICLE, (),
        ),
    ]  # fmt: skip
    axles = replace(LORRY_CAB, length=8.0, axles=(-2.4, -1.3, 3.0))
    pieces.append(wheels(axles, looks, (150, 152, 154), 8))
    return Vehicle(merge(*pieces), 7.9, 2.45)


@dataclass(frozen=True)
class Fleet:
    """Vehicles by what they do."""

    private: tuple[Vehicle, ...]  # private, cabs, vans, buses, trams, lorries: each at least one
    cabs: tuple[Vehicle, ...]
    vans: tuple[Vehicle, ...]
    buses: tuple[Vehicle, ...]
    trams: tuple[Vehicle, ...]
    lorries: tuple[Vehicle, ...]

    def parked(self) -> list[tuple[tuple[Vehicle, ...], float]]:
        """What stands along a kerb, with its share."""
        return [(self.private, 0.72), (self.cabs, 0.16), (self.vans, 0.08), (self.lorries, 0.04)]

    def moving(self) -> list[tuple[tuple[Vehicle, ...], float]]:
        """What drives, with its share."""
        return [(self.private, 0.4), (self.cabs, 0.38), (self.vans, 0.07), (self.buses, 0.11), (self.lorries, 0.04)]


def build_fleet(looks: Looks) -> Fleet:
    """All makes in their colours."""
    makes = [
        (SEDAN, (0, 1, 3, 4, 5)), (HATCH, (4, 9, 11, 2)), (WAGON, (5, 7, 8)), (SUV, (1, 0, 6, 10)), (MINIVAN, (3, 5)),
    ]  # fmt: skip
    names = {id(SEDAN): "sedan", id(HATCH): "hatch", id(WAGON): "wagon", id(SUV): "suv", id(MINIVAN): "minivan"}
    private = [car(body, CAR_COLOURS[k], looks, f"{names[id(body)]}-{k}") for body, colours in makes for k in colours]
    private.append(car(SEDAN, (28, 29, 32), looks, "police", "police"))
    cabs = (car(SEDAN, CAB_YELLOW, looks, "cab", "cab"), car(MINIVAN, CAB_YELLOW, looks, "cab-van", "cab"))
    vans = (
        van(WHITE, "PARCELS", looks, "van-white"),
        van((120, 76, 34), "UNITED POST", looks, "van-brown"),
        van(WHITE, "AMBULANCE", looks, "ambulance"), van(BLUE, "PLUMBER", looks, "van-blue"),
    )  # fmt: skip
    buses = (
        bus(looks, "bus-blue", BLUE, "42 CENTRAL"),
        bus(looks, "trolley-red", RED, "7 HARBOUR", trolley=True),
        bus(looks, "trolley-green", GREEN, "12 MARKET", trolley=True),
        bus(looks, "school", (246, 178, 16), "SCHOOL BUS"),
    )
    trams = (tram(looks, "tram-red", RED, "9 MARKET"), tram(looks, "tram-green", GREEN, "3 RIVER"))
    lorries = (
        lorry(looks, "lorry-red", RED, (238, 236, 228), "MOVERS"),
        lorry(looks, "lorry-blue", BLUE, (40, 90, 160), "FRESH FISH"),
        lorry(looks, "lorry-green", GREEN, (34, 104, 70), "CITY REFUSE"),
    )
    return Fleet(tuple(private), cabs, vans, buses, trams, lorries)
