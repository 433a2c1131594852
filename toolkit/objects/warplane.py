"""Built-in warplane: a twin-engined, twin-finned jet fighter, 270 mm long, on its wheels, with missiles and tanks."""

import numpy as np

from toolkit.objects import warplane_stores as stores
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Part, assemble, fan, revolve, surface
from toolkit.objects.projection import Side
from toolkit.objects.warplane_body import TAIL_X, build_canopy, build_fuselage, build_intake, curve, one_side
from toolkit.objects.warplane_markings import draw_sides, petals, skin_paint

MATERIALS = {"paint": (0.42, 0.0), "glass": (0.06, 0.0), "metal": (0.36, 0.85), "rubber": (0.8, 0.0)}
FIN_CANT_DEG = 12.0


def build() -> Mesh:
    """The aeroplane: nose to +x, millimetres, its wheels' lowest points at one height."""
    sides = draw_sides()
    around = [sides[name] for name in ("top", "bottom", "left", "right")]
    parts = [*build_fuselage(around), *build_canopy(sides), *build_tail_end()]
    for side in (1, -1):
        parts += build_intake(side, around)
        parts += build_boom(side, around)
        parts += build_surfaces(side, sides)
    parts += stores.build_stores() + stores.build_gear() + stores.build_fittings()
    return assemble(parts, MATERIALS, atlas_px=2048)


def build_boom(side: int, around: list[Side]) -> list[Part]:
    """The beam outside an engine that carries the fin and the stabilator."""
    shape = curve(  # x, middle y, half width, half height, power
        (-44, 28.0, 3.0, 2.0, 3.0),
        (-58, 29.2, 4.4, 3.8, 3.2),
        (-72, 29.8, 5.0, 4.6, 3.4),
        (-112, 29.8, 4.4, 4.2, 3.2),
        (-124, 29.8, 3.0, 2.8, 2.6),
        (-128, 29.8, 0.8, 0.8, 2.0),
    )
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 41)
    rows = []
    for x in np.linspace(-128, -44, 26):
        middle, half, tall, power = shape(x)
        y = middle + np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** (2 / power) * half
        z = 6.6 + np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** (2 / power) * tall
        rows.append(np.stack([np.full_like(angle, x), y, z], axis=1))
    net = one_side(np.stack(rows), side)
    return [surface(net, skin_paint(net, around, (-72, -97, -112))), fan(net[0, :-1][::-1], (70, 76, 83))]


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
    span = np.unique(np.r_[np.linspace(table[0, 0], table[-1, 0], int(np.ptp(table[:, 0]) * per_mm)), table[:, 0]])
    rows = [[y, *(np.interp(y, table[:, 0], table[:, i]) for i in (1, 2, 3))] for y in span]
    y, lead, trail, thick = rows[-1]
    for angle in np.radians([30, 55, 75, 88]):  # the tip closes in a quarter round
        draw = (1 - np.cos(angle)) * 0.06 * (lead - trail)
        rows.append([y + np.sin(angle) * thick / 2, lead - 2 * draw, trail + draw, thick * np.cos(angle)])
    net = []
    for y, lead, trail, thick in rows:
        outline = foil(lead - trail, thick)
        net.append(np.stack([lead + outline[:, 0], np.full(len(outline), y), outline[:, 1]], axis=1))
    return np.stack(net)


def build_surfaces(side: int, sides: dict[str, Side]) -> list[Part]:
    """Wing, stabilator and fin of one side."""
    flat = [sides["top"], sides["bottom"]]
    wing = wing_net([(24, 4, -66, 5.2), (34.0, 22.4, -66, 5.0), (94, -48, -67, 2.2)])
    wing[..., 2] += 7.6 - 0.02 * (wing[..., 1] - 30)
    stabilator = wing_net([(28, -88, -128, 3.4), (40, -97, -131, 3.2), (70, -124, -136, 1.6)])
    stabilator[..., 2] += 5.6 - 0.03 * (stabilator[..., 1] - 28)
    fin = wing_net([(6, -75, -124, 3.6), (12, -78, -124, 3.4), (50, -110, -128, 1.8)])
    x, height, across = (fin[..., i] for i in range(3))
    cant = np.radians(FIN_CANT_DEG)
    rise = height - 6
    fin = np.stack(
        [x, 30.2 + np.sin(cant) * rise - np.cos(cant) * across, 8 + np.cos(cant) * rise + np.sin(cant) * across], -1
    )
    parts = []
    for net, drawings in ((wing, flat), (stabilator, flat), (fin, [sides["fin_left"], sides["fin_right"]])):
        net = one_side(net, side)
        parts += [surface(net, skin_paint(net, drawings)), fan(net[-1, :-1], (84, 92, 101))]
    return parts


def build_tail_end() -> list[Part]:
    """Two afterburner nozzles with leaves, and the flame holders inside them."""
    outside = [(12.2, -3.0), (12.3, 0), (12.0, 3), (11.4, 7), (10.5, 11.5), (9.5, 16), (8.9, 18.6)]
    inside = [(8.9, 18.6), (8.4, 18.6), (8.8, 14), (9.4, 8), (9.6, 0.5)]
    holder = [(9.6, 0.5), (7.0, 0.6), (6.6, 1.4), (5.4, 1.4), (5.0, 0.6), (2.6, 0.6), (2.0, 2.6), (0.0, 3.4)]
    burnt = petals(18, (34, 33, 34), (126, 122, 118))
    parts = []
    for y in (14.0, -14.0):
        pieces = [
            revolve(outside, 54, burnt, "metal"),
            revolve(inside, 54, petals(18, (20, 19, 19), (62, 58, 55)), "metal"),
            revolve(holder, 36, (46, 43, 41), "metal"),
        ]
        parts += [piece.rotated("y", -90).moved(TAIL_X + 0.6, y, -1.0) for piece in pieces]
    return parts
