"""Fuselage, intakes and canopy of the built-in warplane."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from toolkit.content.modelling import Part, fan, surface
from toolkit.content.projection import Side
from toolkit.content.warplane_markings import STATIONS_MM, skin_paint

GLASS, FRAME, DUCT = (26, 34, 40), (84, 92, 101), (24, 25, 27)
NOSE_X, TAIL_X = 126.0, -108.0


def curve(*knots: tuple[float, ...]) -> Callable[[float], np.ndarray]:
    """A smooth function of x through knots (x, value, …), x descending."""
    table = np.array(knots, float)[::-1]
    return PchipInterpolator(table[:, 0], table[:, 1:])


def one_side(net: np.ndarray, side: int) -> np.ndarray:
    """A left net as it is, or (side -1) mirrored to the right with its outside kept outside."""
    return net if side > 0 else net[:, ::-1] * np.array([1.0, -1.0, 1.0])


CENTRE = curve(  # x, half width, top z, bottom z, power
    (126, 0.5, -4.2, -5.2, 2.0), (122, 2.5, -2.0, -7.2, 2.0), (114, 5.2, 0.8, -9.6, 2.0), (104, 7.8, 3.4, -11.6, 2.0),
    (90, 10.4, 6.2, -13.2, 2.1), (76, 12.0, 8.8, -13.8, 2.2), (60, 12.8, 11.0, -14.0, 2.3),
    (44, 13.4, 12.8, -14.0, 2.4), (20, 14.0, 13.8, -13.6, 2.4), (-20, 14.0, 13.4, -12.6, 2.5),
    (-60, 12.0, 12.2, -10.0, 2.5), (-90, 8.0, 8.6, -5.0, 2.4), (-108, 6.0, 4.6, -2.0, 2.2),
)  # fmt: skip
NACELLE = curve(  # x, middle y, half width, top z, bottom z, power
    (40, 25.6, 9.2, 11.4, -13.4, 6.0), (20, 25.0, 9.8, 11.6, -14.0, 5.0), (-5, 22.4, 11.8, 11.6, -14.4, 4.2),
    (-40, 19.0, 13.4, 11.6, -14.2, 3.4), (-80, 15.6, 13.2, 11.4, -13.4, 2.6), (-108, 14.0, 11.8, 10.4, -12.4, 2.1),
)  # fmt: skip
INTAKE_BACK_X, DUCT_BACK_X = -9.0, 15.0


def ellipse_field(
    y: np.ndarray, z: np.ndarray, middle: tuple[float, float], half: tuple[float, float], power: float
) -> np.ndarray:
    """About the distance (mm) of points to a superellipse, negative inside."""
    scaled = (np.abs((y - middle[0]) / half[0]) ** power + np.abs((z - middle[1]) / half[1]) ** power) ** (1 / power)
    return (scaled - 1) * min(half)


def body_field(x: float, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """About the distance (mm) of points (y, z) to the fuselage's section at x: its middle and nacelles, blended."""
    width, top, bottom, power = CENTRE(x)
    field = ellipse_field(y, z, (0, (top + bottom) / 2), (width, (top - bottom) / 2), power)
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
    low, high = np.zeros_like(angle), np.full_like(angle, 60.0)
    for _ in range(26):
        reach = (low + high) / 2
        inside = body_field(x, reach * np.cos(angle), middle_z + reach * np.sin(angle)) < 0
        low, high = np.where(inside, reach, low), np.where(inside, high, reach)
    outline = np.stack([low * np.cos(angle), middle_z + low * np.sin(angle)], axis=1)
    arc = np.r_[0, np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))]
    even = np.linspace(0, arc[-1], count + 1)
    return np.stack(
        [np.full(count + 1, x), np.interp(even, arc, outline[:, 0]), np.interp(even, arc, outline[:, 1])], 1
    )


def build_fuselage(around: list[Side]) -> list[Part]:
    """One smooth skin from the radome to the engines."""
    stations = np.r_[
        np.linspace(TAIL_X, -20, 29)[:-1], np.linspace(-20, 20, 25)[:-1], np.linspace(20, 110, 24)[:-1],
        NOSE_X - 16 * np.linspace(1, 0, 13) ** 1.6,
    ]  # fmt: skip
    net = np.stack([body_section(x) for x in stations])
    cuts = [0, *np.searchsorted(stations, (-30, 50)), len(net) - 1]  # charts that waste less of the atlas
    pieces = [net[low : high + 1] for low, high in pairwise(cuts)]
    return [
        *(surface(piece, skin_paint(piece, around, STATIONS_MM)) for piece in pieces),
        fan(net[0, :-1][::-1], DUCT, "metal"),
        fan(net[-1, :-1], (60, 64, 68)),
    ]


def nacelle_section(x: float, grow: float, rake: float, count: int = 72) -> np.ndarray:
    """(count + 1, 3) closed outline of the left nacelle, leaning forward at its top by `rake` mm per mm."""
    middle, half, top, bottom, power = NACELLE(x)
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, count + 1)
    y = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** (2 / power) * (half + grow)
    z = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** (2 / power) * ((top - bottom) / 2 + grow)
    return np.stack([x + rake * z, middle + y, (top + bottom) / 2 + z], axis=1)


def build_intake(side: int, around: list[Side]) -> list[Part]:
    """A raked box intake with a thin lip, and the dark duct in it."""
    lean = 0.42
    stations = np.linspace(INTAKE_BACK_X, 33.0, 22)
    outer = np.stack([nacelle_section(x, 0.15, lean * max(0.0, (x + 4) / 37)) for x in stations])
    lip_x = stations[-1]
    inner = np.stack([
        outer[-1], nacelle_section(lip_x + 0.35, -0.2, lean), nacelle_section(lip_x + 0.2, -0.75, lean),
        nacelle_section(lip_x - 1.5, -1.1, lean),
        *(nacelle_section(x, -1.4, lean * (x + 4) / 37) for x in np.linspace(lip_x - 6, DUCT_BACK_X, 5)),
    ])  # fmt: skip
    outer, inner = one_side(outer, side), one_side(inner, side)
    lip, duct = inner[:4], inner[3:]
    return [
        surface(outer, skin_paint(outer, around, STATIONS_MM)),
        surface(lip, (70, 76, 83)), surface(duct, DUCT), fan(duct[-1, :-1], (12, 12, 13)),
    ]  # fmt: skip


CANOPY = curve(  # x, half width, sill z, top z
    (86, 2.6, 7.0, 7.3), (82, 5.0, 7.2, 10.2), (74, 8.0, 7.6, 16.2), (66, 9.4, 8.4, 20.6), (57, 10.0, 9.4, 23.2),
    (48, 9.8, 10.4, 22.8), (40, 8.8, 11.2, 19.8), (33, 7.0, 11.8, 16.2), (25, 3.4, 12.0, 13.4),
)  # fmt: skip


def canopy_net(
    from_x: float, to_x: float, rows: int, grow: float = 0.0, span: tuple[float, float] = (0, 180)
) -> np.ndarray:
    """A piece of the bubble, `grow` mm outside it, between two stations and two angles (0 left, 90 up)."""
    angle = np.radians(np.linspace(*span, max(3, round((span[1] - span[0]) / 5) + 1)))
    net = []
    for x in np.linspace(from_x, to_x, rows):
        width, sill, top = CANOPY(x)
        power = 2.25
        y = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** (2 / power) * (width + grow)
        z = sill - 2 + np.abs(np.sin(angle)) ** (2 / power) * (top - sill + 2 + grow)
        net.append(np.stack([np.full_like(angle, x), y, z], axis=1))
    return np.stack(net)


def build_canopy(sides: dict[str, Side]) -> list[Part]:
    """A tinted bubble with a windscreen bow, a rear bow, a sill frame and a painted tail fairing."""
    fairing = canopy_net(25, 37, 8, 0.12)
    parts = [
        surface(canopy_net(25, 86, 36), GLASS, "glass"),
        surface(fairing, skin_paint(fairing, [sides["top"], sides["left"], sides["right"]])),
    ]
    bows = [((72.0, 74.2), (0, 180), 4), ((49.6, 50.8), (0, 180), 3), ((36.6, 38.0), (0, 180), 3)]
    bows += [((37.0, 82.0), (0, 21), 24), ((37.0, 82.0), (159, 180), 24)]
    for (low, high), span, rows in bows:
        parts.append(surface(raised(*(canopy_net(low, high, rows, grow, span) for grow in (0.45, -0.3))), FRAME))
    return parts


def raised(face: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """A net with walls from all its edges down to another net of its shape."""
    walled = np.concatenate([floor[:1], face, floor[-1:]])
    edge = np.concatenate([floor[:1], floor, floor[-1:]])
    return np.concatenate([edge[:, :1], walled, edge[:, -1:]], axis=1)
