"""Built-in warplane: a twin-engined, twin-finned jet fighter, 270 mm long, on its wheels, with missiles and tanks."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content.drawing import Paint, Side
from toolkit.rooms.worlds.content.liveries import STATIONS_MM, bands, draw_sides, petals, skin_paint
from toolkit.rooms.worlds.content.modelling import (
    Parts,
    assemble,
    bend_circle,
    box,
    curve,
    extrude,
    fan,
    revolve,
    surface,
    tube,
)

GLASS, FRAME, DUCT = (26, 34, 40), (84, 92, 101), (24, 25, 27)
NOSE_X, TAIL_X = 126.0, -108.0
GREY, DARK_GREY, WHITE, STEEL = (150, 156, 162), (78, 85, 93), (222, 224, 226), (170, 172, 175)
YELLOW, BROWN, RED, TYRE = (222, 172, 40), (110, 72, 40), (176, 36, 34), (30, 30, 32)
GROUND_Z = -38.0

Outline = Sequence[tuple[float, float]]


def one_side(net: np.ndarray, side: int) -> np.ndarray:
    """A left net as it is, or (side -1) mirrored to the right with its outside kept outside."""
    return net if side > 0 else net[:, ::-1] * np.array([1.0, -1.0, 1.0])


CENTRE = curve([  # x, half width, top z, bottom z, power
    (126, 0.5, -4.2, -5.2, 2.0), (122, 2.5, -2.0, -7.2, 2.0), (114, 5.2, 0.8, -9.6, 2.0), (104, 7.8, 3.4, -11.6, 2.0),
    (90, 10.4, 6.2, -13.2, 2.1), (76, 12.0, 8.8, -13.8, 2.2), (60, 12.8, 11.0, -14.0, 2.3),
    (44, 13.4, 12.8, -14.0, 2.4), (20, 14.0, 13.8, -13.6, 2.4), (-20, 14.0, 13.4, -12.6, 2.5),
    (-60, 12.0, 12.2, -10.0, 2.5), (-90, 8.0, 8.6, -5.0, 2.4), (-108, 6.0, 4.6, -2.0, 2.2),
])  # fmt: skip
NACELLE = curve([  # x, middle y, half width, top z, bottom z, power
    (40, 25.6, 9.2, 11.4, -13.4, 6.0), (20, 25.0, 9.8, 11.6, -14.0, 5.0), (-5, 22.4, 11.8, 11.6, -14.4, 4.2),
    (-40, 19.0, 13.4, 11.6, -14.2, 3.4), (-80, 15.6, 13.2, 11.4, -13.4, 2.6), (-108, 14.0, 11.8, 10.4, -12.4, 2.1),
])  # fmt: skip
INTAKE_BACK_X, DUCT_BACK_X = -9.0, 15.0


def ellipse_field(
    y: np.ndarray, z: np.ndarray, middle: tuple[float, float], half: tuple[float, float], power: float
) -> np.ndarray:
    """About the distance (mm) of points to a superellipse, negative inside."""
    scaled = (np.abs((y - middle[0]) / half[0]) ** power + np.abs((z - middle[1]) / half[1]) ** power) ** (1 / power)
    return (scaled - 1) * min(half)


def body_field(x: float, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """About the distance (mm) of points (y, z) to the fuselage's section at x: its middle and nacelles, blended."""
    # the middle of the fuselage
    width, top, bottom, power = CENTRE(x)
    field = ellipse_field(y, z, (0, (top + bottom) / 2), (width, (top - bottom) / 2), power)
    # the engines lie beside it, farther back
    if x < 14:
        middle, half, top, bottom, power = NACELLE(min(x, 14))
        begin = np.clip((x + 4) / 18, 0, 1)  # it grows out of the middle, inside the intake, so that no step shows
        middle, inset = middle + (5.0 - middle) * begin, 6.0 * begin
        nacelle = ellipse_field(
            np.abs(y), z, (middle, (top + bottom) / 2), (half - inset, (top - bottom) / 2 - inset), power
        )
        blend = 5.0  # polynomial smooth minimum
        mix = np.maximum(blend - np.abs(field - nacelle), 0) / blend
        field = np.minimum(field, nacelle) - mix**2 * blend / 4
    return field


def body_section(x: float, count: int = 96) -> np.ndarray:
    """(count + 1, 3) closed outline at x from the keel over the left side, evenly spaced: where the field is zero."""
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 361)
    middle_z = CENTRE(x)[1:3].mean()
    # by bisection along each direction, at most 60 mm from the middle
    low, high = np.zeros_like(angle), np.full_like(angle, 60.0)
    for _ in range(26):
        reach = (low + high) / 2
        inside = body_field(x, reach * np.cos(angle), middle_z + reach * np.sin(angle)) < 0
        low, high = np.where(inside, reach, low), np.where(inside, high, reach)
    outline = np.stack([low * np.cos(angle), middle_z + low * np.sin(angle)], axis=1)
    # evenly along the outline, so that paint is not stretched
    arc = np.r_[0, np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))]
    even = np.linspace(0, arc[-1], count + 1)
    return np.stack(
        [np.full(count + 1, x), np.interp(even, arc, outline[:, 0]), np.interp(even, arc, outline[:, 1])], 1
    )


def build_fuselage(around: list[Side]) -> Parts:
    """A smooth skin from the radome to the engines."""
    stations = np.r_[
        np.linspace(TAIL_X, -20, 29)[:-1], np.linspace(-20, 20, 25)[:-1], np.linspace(20, 110, 24)[:-1],
        NOSE_X - 16 * np.linspace(1, 0, 13) ** 1.6,
    ]  # fmt: skip
    net = np.stack([body_section(x) for x in stations])
    cuts = [0, *np.searchsorted(stations, (-30, 50)), len(net) - 1]  # charts that waste less of the atlas
    pieces = [net[low : high + 1] for low, high in pairwise(cuts)]
    return Parts(
        *(surface(piece, skin_paint(piece, around, STATIONS_MM)) for piece in pieces),
        fan(net[0, :-1][::-1], DUCT, "metal"), fan(net[-1, :-1], (60, 64, 68)),
    )  # fmt: skip


def nacelle_section(x: float, grow: float, rake: float, count: int = 72) -> np.ndarray:
    """(count + 1, 3) closed outline of the left nacelle, leaning forward at its top by `rake` mm per mm."""
    middle, half, top, bottom, power = NACELLE(x)
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, count + 1)
    across, up = bend_circle(angle, power)
    y, z = across * (half + grow), up * ((top - bottom) / 2 + grow)
    return np.stack([x + rake * z, middle + y, (top + bottom) / 2 + z], axis=1)


def build_intake(side: int, around: list[Side]) -> Parts:
    """A raked box intake with a thin lip, and the dark duct in it."""
    # the inlet leans: its upper edge is farther ahead
    lean = 0.42
    # from behind the lip to the mouth, x in mm
    stations = np.linspace(INTAKE_BACK_X, 33.0, 22)
    outer = np.stack([nacelle_section(x, 0.15, lean * max(0.0, (x + 4) / 37)) for x in stations])
    lip_x = stations[-1]
    # the lip turns inwards, and the duct narrows behind it
    inner = np.stack([
        outer[-1], nacelle_section(lip_x + 0.35, -0.2, lean), nacelle_section(lip_x + 0.2, -0.75, lean),
        nacelle_section(lip_x - 1.5, -1.1, lean),
        *(nacelle_section(x, -1.4, lean * (x + 4) / 37) for x in np.linspace(lip_x - 6, DUCT_BACK_X, 5)),
    ])  # fmt: skip
    outer, inner = one_side(outer, side), one_side(inner, side)
    lip, duct = inner[:4], inner[3:]
    return Parts(
        surface(outer, skin_paint(outer, around, STATIONS_MM)),
        surface(lip, (70, 76, 83)), surface(duct, DUCT), fan(duct[-1, :-1], (12, 12, 13)),
    )  # fmt: skip


CANOPY = curve([  # x, half width, sill z, top z
    (86, 2.6, 7.0, 7.3), (82, 5.0, 7.2, 10.2), (74, 8.0, 7.6, 16.2), (66, 9.4, 8.4, 20.6), (57, 10.0, 9.4, 23.2),
    (48, 9.8, 10.4, 22.8), (40, 8.8, 11.2, 19.8), (33, 7.0, 11.8, 16.2), (25, 3.4, 12.0, 13.4),
])  # fmt: skip


def canopy_net(
    from_x: float, to_x: float, rows: int, grow: float = 0.0, span: tuple[float, float] = (0, 180)
) -> np.ndarray:
    """A piece of the bubble, `grow` mm outside it, between two stations and two angles (0 left, 90 up)."""
    angle = np.radians(np.linspace(*span, max(3, round((span[1] - span[0]) / 5) + 1)))
    net = []
    for x in np.linspace(from_x, to_x, rows):
        width, sill, top = CANOPY(x)
        across, up = bend_circle(angle, 2.25)
        y, z = across * (width + grow), sill - 2 + np.abs(up) * (top - sill + 2 + grow)
        net.append(np.stack([np.full_like(angle, x), y, z], axis=1))
    return np.stack(net)


def build_canopy(sides: dict[str, Side]) -> Parts:
    """A tinted bubble with a windscreen bow, a rear bow, a sill frame and a painted tail fairing."""
    fairing = canopy_net(25, 37, 8, 0.12)
    parts = Parts(
        surface(canopy_net(25, 86, 36), GLASS, "glass"),
        surface(fairing, skin_paint(fairing, [sides["top"], sides["left"], sides["right"]])),
    )
    bows = [((72.0, 74.2), (0, 180), 4), ((49.6, 50.8), (0, 180), 3), ((36.6, 38.0), (0, 180), 3)]
    bows += [((37.0, 82.0), (0, 21), 24), ((37.0, 82.0), (159, 180), 24)]
    for (low, high), span, rows in bows:
        parts += surface(raised(*(canopy_net(low, high, rows, grow, span) for grow in (0.45, -0.3))), FRAME)
    return parts


def raised(face: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """A net with walls from all its edges down to another net of its shape."""
    walled = np.concatenate([floor[:1], face, floor[-1:]])
    edge = np.concatenate([floor[:1], floor, floor[-1:]])
    return np.concatenate([edge[:, :1], walled, edge[:, -1:]], axis=1)


def blade(outline: Outline, thickness: float, paint: Paint = GREY) -> Parts:
    """An upright plate in the x-z plane, centred on y = 0, outline (x, z) counter-clockwise seen from the right."""
    plates = extrude(outline, thickness, thickness * 0.3, paint)
    return plates.moved(z=-thickness / 2).rotated("x", 90)


def cross_of_fins(outline: Outline, thickness: float, paint: Paint = GREY, turn_deg: float = 45.0) -> Parts:
    """Four blades around the x axis."""
    return Parts(*(blade(outline, thickness, paint).rotated("x", turn_deg + 90 * i) for i in range(4)))


def missile(length: float = 52.0, radius: float = 1.9) -> Parts:
    """A heat-seeking missile along x, its middle at the origin: glass-domed nose, canards, tail fins, warhead bands."""
    h, r = length / 2, radius
    profile = [
        (0, -h), (r * 0.8, -h), (r, -h + 0.6), (r, h * 0.35), (r, h - 4.5), (r * 0.85, h - 2.4), (r * 0.5, h - 0.7),
    ]  # fmt: skip
    profile += [(0.0, h)]
    stripes = ((0.2, 0.23, BROWN), (0.66, 0.69, YELLOW), (0.9, 1.0, (44, 46, 50)))
    parts = Parts(revolve(profile, 20, bands(WHITE, *stripes)).rotated("y", 90))
    parts += cross_of_fins([(-h + 0.6, r * 0.7), (-h + 7.6, r * 0.7), (-h + 3.4, r + 4), (-h + 0.6, r + 4)], 0.5)
    parts += cross_of_fins([(h - 11, r * 0.7), (h - 6.5, r * 0.7), (h - 10, r + 3), (h - 11, r + 3)], 0.5, DARK_GREY)
    return parts


def tank(length: float = 84.0, radius: float = 6.2) -> Parts:
    """A drop tank along x, its middle at the origin."""
    along = np.linspace(-1, 1, 33)
    shape = radius * np.sqrt(np.maximum(1 - np.abs(along) ** 2.6, 0)) ** 1.15
    parts = Parts(revolve(
        list(zip(shape, along * length / 2, strict=True)),
        32,
        bands(GREY, (0.36, 0.365, DARK_GREY), (0.64, 0.645, DARK_GREY), (0.82, 0.85, RED), (0.85, 1, DARK_GREY)),
    ).rotated("y", 90))  # fmt: skip
    h = length / 2
    return Parts(parts, cross_of_fins([(-h + 2, 1), (-h + 14, 3), (-h + 7, 8), (-h + 2, 8)], 0.7, GREY)[:9])


def build_stores() -> Parts:
    """Wing-tip missiles, drop tanks and missiles on pylons, the same on both sides."""
    left = missile().moved(-52, 96.6, 6.2)
    left += box((34, 1.8, 2.0), 0.4, DARK_GREY).moved(-56, 94.9, 6.2)
    pylon = [(-20, -4.4), (16, -4.4), (8, 4), (-24, 4)]
    left += blade(pylon, 2.2, DARK_GREY).moved(-16, 49, 3.6)
    left += tank().moved(-16, 49, -6.4)
    left += blade([(-12, -4), (12, -4), (6, 3.4), (-15, 3.4)], 1.8, DARK_GREY).moved(-34, 73, 3.6)
    left += missile().moved(-34, 73, -2.6)
    return left.both_sides()


def wheel(radius: float, width: float) -> Parts:
    """A tyre with a hub, its axle along y, centred on the origin."""
    w, r = width / 2, radius
    tyre = [(r * 0.58, -w * 0.92), (r * 0.86, -w), (r * 0.96, -w * 0.72), (r, -w * 0.3)]
    profile = tyre + [(radius_, -z) for radius_, z in reversed(tyre)]
    parts = Parts(revolve(profile, 40, TYRE, "rubber"))
    disc = [(r * 0.58, w * 0.92), (r * 0.54, w * 0.6), (r * 0.3, w * 0.66), (r * 0.26, w * 1.02), (0.0, w * 1.02)]
    hub = revolve(disc, 40, WHITE)
    parts += Parts(hub, hub.mirrored("z"))
    return parts.rotated("x", 90)


def rod(
    start: Sequence[float], end: Sequence[float], radius: float, paint: Paint = WHITE, material: str = "paint"
) -> Parts:
    """A round bar between two points."""
    return tube(np.linspace(start, end, 3), radius, 16, paint, material)


def main_gear() -> Parts:
    """The left main leg: oleo, drag brace, wheel and doors."""
    hub = np.array([-40.0, 27.0, GROUND_Z + 7.6])
    parts = wheel(7.6, 5.0).moved(*hub)
    parts += rod((-40, 22, -10), (-40, 22.6, -23), 1.7)
    parts += rod((-40, 22.6, -22), (-40, 22.9, hub[2] - 0.6), 1.15, STEEL, "metal")
    parts += rod((-40, 21.6, hub[2]), (-40, 26, hub[2]), 1.2, STEEL, "metal")
    parts += rod((-27, 21, -11), (-39.4, 22.4, -21), 0.9)
    parts += rod((-42, 22.5, -21), (-43.4, 22.7, -25), 0.6) + rod((-43.4, 22.7, -25), (-41, 22.8, -28.6), 0.6)
    door = blade([(-53, -24), (-27, -24), (-25, -12.6), (-53, -12.6)], 0.7, WHITE)
    parts += door.rotated("x", 8).moved(y=29.4)
    inner = blade([(-52, -21), (-28, -21), (-26, -12.6), (-52, -12.6)], 0.7, WHITE)
    return Parts(parts, inner.rotated("x", -6).moved(y=14.6))


def nose_gear() -> Parts:
    """The nose leg: oleo with a landing light, fork, wheel and doors on both sides."""
    # place of the leg, and height of the wheel's axle
    x, axle = 66.0, GROUND_Z + 5.6
    parts = wheel(5.6, 3.6).moved(x, 0, axle)
    parts += rod((x + 1.5, 0, -10), (x + 0.6, 0, -22), 1.5) + rod((x + 0.6, 0, -21), (x, 0, -26), 1.05, STEEL, "metal")
    parts += box((2.4, 6.4, 1.4), 0.3, WHITE).moved(x, 0, -25.8)
    # a fork at both sides of the wheel
    for y in (2.7, -2.7):
        parts += rod((x, y, -25.6), (x, y, axle - 0.8), 0.65)
    parts += Parts(
        rod((x, -3.0, axle), (x, 3.0, axle), 0.8, STEEL, "metal"), rod((x + 11, 0, -12), (x + 1, 0, -20), 0.8)
    )
    light = revolve([(0, -0.8), (1.2, -0.8), (1.6, 0.6), (0, 0.7)], 20, WHITE, "glass").rotated("y", 90)
    parts += light.moved(x + 2.8, 0, -17)
    # doors, each leaning a little outwards
    door = blade([(55, -21), (78, -21), (79, -12.4), (55, -12.4)], 0.6, WHITE)
    for side, lean in ((1, 10), (-1, -10)):
        parts += door.rotated("x", lean).moved(y=side * 1.9)
    return parts


def build_gear() -> Parts:
    """Three legs whose wheels stand at `GROUND_Z`."""
    left = main_gear()
    return Parts(left.both_sides(), nose_gear())


def build_fittings() -> Parts:
    """Pitot boom, air data probes, blade aerials, tail hook."""
    boom = np.array([(124.0, 0, -4.7), (128.0, 0, -4.7), (130.0, 0, -4.7), (135.0, 0, -4.7)])
    parts = tube(boom, [0.95, 0.8, 0.5, 0.32], 16, STEEL, "metal")
    for side in (1, -1):
        parts += rod((101, side * 8, -4.4), (101.6, side * 10.6, -5.0), 0.3, STEEL, "metal")
    aerial = [(0, -1.0), (5, -1.0), (1.6, 4.2), (0, 4.2)]
    parts += blade([(0, 4), (0, 0), (1.6, 0), (5, 4)], 0.7, DARK_GREY).moved(92, 0, -16)
    parts += blade([(0, 4), (0, 0), (1.6, 0), (5, 4)], 0.7, DARK_GREY).moved(38, 0, -17.4)
    parts += blade(aerial, 0.7, DARK_GREY).moved(-84, 0, 10.0)
    parts += rod((-70, 0, -9.5), (-104, 0, -7.5), 0.8, (40, 42, 44))
    return parts


MATERIALS = {"paint": (0.42, 0.0), "glass": (0.06, 0.0), "metal": (0.36, 0.85), "rubber": (0.8, 0.0)}
FIN_CANT_DEG = 12.0


def build() -> Mesh:
    """The aeroplane: nose to +x, millimetres, its wheels' lowest points at the same height."""
    sides = draw_sides()
    around = [sides[name] for name in ("top", "bottom", "left", "right")]
    parts = Parts(build_fuselage(around), build_canopy(sides), build_tail_end())
    for side in (1, -1):
        parts += Parts(build_intake(side, around), build_boom(side, around), build_surfaces(side, sides))
    parts += build_stores() + build_gear() + build_fittings()
    return assemble(parts, MATERIALS, atlas_px=2048)


def build_boom(side: int, around: list[Side]) -> Parts:
    """The beam outside an engine with the fin and the stabilator."""
    shape = curve([  # x, middle y, half width, half height, power
        (-44, 28.0, 3.0, 2.0, 3.0), (-58, 29.2, 4.4, 3.8, 3.2), (-72, 29.8, 5.0, 4.6, 3.4), (-112, 29.8, 4.4, 4.2, 3.2),
        (-124, 29.8, 3.0, 2.8, 2.6), (-128, 29.8, 0.8, 0.8, 2.0),
    ])  # fmt: skip
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 41)
    rows = []
    # from the tail end to where it leaves the fuselage
    for x in np.linspace(-128, -44, 26):
        middle, half, tall, power = shape(x)
        across, up = bend_circle(angle, power)
        rows.append(np.stack([np.full_like(angle, x), middle + across * half, 6.6 + up * tall], axis=1))
    net = one_side(np.stack(rows), side)
    return Parts(surface(net, skin_paint(net, around, (-72, -97, -112))), fan(net[0, :-1][::-1], (70, 76, 83)))


def foil(chord: float, thickness: float, count: int = 20) -> np.ndarray:
    """(2 count + 2, 2) closed symmetric aerofoil from its trailing edge over the top: x (0 at its nose) and z."""
    s = (1 - np.cos(np.linspace(0, np.pi, count + 1))) / 2
    half = 5 * thickness * (0.2969 * np.sqrt(s) - 0.1260 * s - 0.3516 * s**2 + 0.2843 * s**3 - 0.1015 * s**4)
    half += 0.2 * s  # an edge that a toy can have
    top = np.stack([-chord * s[::-1], half[::-1]], 1)
    return np.concatenate([top, (top * [1, -1])[::-1][1:], top[:1]])


def wing_net(knots: list[tuple[float, ...]], per_mm: float = 0.3) -> np.ndarray:
    """Net of a lifting surface through knots (span, leading x, trailing x, thickness) with a rounded tip; span to +y.

    Knots lie from root to tip, the columns from the trailing edge over the top and back underneath.
    """
    table = np.array(knots, float)
    # knots are rows too, so that kinks stay sharp
    span = np.unique(np.r_[np.linspace(table[0, 0], table[-1, 0], int(np.ptp(table[:, 0]) * per_mm)), table[:, 0]])
    rows = [[y, *(np.interp(y, table[:, 0], table[:, i]) for i in (1, 2, 3))] for y in span]
    y, lead, trail, thick = rows[-1]
    for angle in np.radians([30, 55, 75, 88]):  # the tip closes in a quarter round
        draw = (1 - np.cos(angle)) * 0.06 * (lead - trail)
        rows.append([y + np.sin(angle) * thick / 2, lead - 2 * draw, trail + draw, thick * np.cos(angle)])
    # a foil at each row
    net = []
    for y, lead, trail, thick in rows:
        outline = foil(lead - trail, thick)
        net.append(np.stack([lead + outline[:, 0], np.full(len(outline), y), outline[:, 1]], axis=1))
    return np.stack(net)


def build_surfaces(side: int, sides: dict[str, Side]) -> Parts:
    """Wing, stabilator and fin of a side."""
    flat = [sides["top"], sides["bottom"]]
    wing = wing_net([(24, 4, -66, 5.2), (34.0, 22.4, -66, 5.0), (94, -48, -67, 2.2)])
    # wing and stabilator droop towards their tips
    wing[..., 2] += 7.6 - 0.02 * (wing[..., 1] - 30)
    stabilator = wing_net([(28, -88, -128, 3.4), (40, -97, -131, 3.2), (70, -124, -136, 1.6)])
    stabilator[..., 2] += 5.6 - 0.03 * (stabilator[..., 1] - 28)
    fin = wing_net([(6, -75, -124, 3.6), (12, -78, -124, 3.4), (50, -110, -128, 1.8)])
    x, height, across = (fin[..., i] for i in range(3))
    # fins are modelled flat, then canted outwards about their roots
    cant = np.radians(FIN_CANT_DEG)
    rise = height - 6
    fin = np.stack(
        [x, 30.2 + np.sin(cant) * rise - np.cos(cant) * across, 8 + np.cos(cant) * rise + np.sin(cant) * across], -1
    )
    parts = Parts()
    for net, drawings in ((wing, flat), (stabilator, flat), (fin, [sides["fin_left"], sides["fin_right"]])):
        net = one_side(net, side)
        parts += Parts(surface(net, skin_paint(net, drawings)), fan(net[-1, :-1], (84, 92, 101)))
    return parts


def build_tail_end() -> Parts:
    """Two afterburner nozzles with leaves, and the flame holders inside them."""
    # outlines of radius and length: the nozzle's outside, its inside and the flame holder
    outside = [(12.2, -3.0), (12.3, 0), (12.0, 3), (11.4, 7), (10.5, 11.5), (9.5, 16), (8.9, 18.6)]
    inside = [(8.9, 18.6), (8.4, 18.6), (8.8, 14), (9.4, 8), (9.6, 0.5)]
    holder = [(9.6, 0.5), (7.0, 0.6), (6.6, 1.4), (5.4, 1.4), (5.0, 0.6), (2.6, 0.6), (2.0, 2.6), (0.0, 3.4)]
    burnt = petals(18, (34, 33, 34), (126, 122, 118))
    parts = Parts()
    # a nozzle for each engine, pointing backwards
    for y in (14.0, -14.0):
        pieces = Parts(
            revolve(outside, 54, burnt, "metal"),
            revolve(inside, 54, petals(18, (20, 19, 19), (62, 58, 55)), "metal"),
            revolve(holder, 36, (46, 43, 41), "metal"),
        )
        parts += [piece.rotated("y", -90).moved(TAIL_X + 0.6, y, -1.0) for piece in pieces]
    return parts
