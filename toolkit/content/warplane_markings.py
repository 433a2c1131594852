"""Paint of the built-in warplane: camouflage, panel lines, insignia and stencils, projected onto its skin."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from PIL import Image

from toolkit.content.modelling import Paint
from toolkit.content.projection import INK, Drawing, Point, Side, chart_points, finish

LIGHT, DARK, BELLY, RADOME = (139, 147, 155), (88, 97, 107), (172, 177, 181), (112, 119, 127)
BLACK, WHITE = (34, 36, 39, 255), (236, 238, 240, 255)
BLUE, RED, YELLOW = (28, 44, 92, 255), (186, 38, 36, 255), (232, 180, 40, 255)
PRIMER = (60, 64, 66, 255)
STATIONS_MM = (104.0, 86.0, 52.0, 20.0, -4.0, -30.0, -54.0, -80.0, -97.0)
"""Where frames ring the fuselage."""


def skin_paint(net: np.ndarray, sides: Sequence[Side], stations_mm: Sequence[float] = ()) -> Paint:
    """Paint for `surface(net)`: camouflage, frames at `stations_mm` along x, and the markings of the sides it faces.

    Args:
        net: (rows, columns, 3) where the part ends up on the aeroplane, millimetres.
        sides: drawings; a texel takes the one that looks at it most squarely.
        stations_mm: x of lines across.
    """
    return partial(_paint_skin, net, tuple(sides), tuple(stations_mm))


def _paint_skin(
    net: np.ndarray, sides: tuple[Side, ...], stations: tuple[float, ...], width: int, height: int, px_per_mm: float
) -> Image.Image:
    points, normals = chart_points(net, width, height)
    colour = camouflage(points, normals)
    for station in stations:
        near: np.ndarray = np.clip(0.75 - np.abs(points[..., :1] - station) / 0.35, 0, 1) * 0.8
        colour += near * (np.array(INK[:3], np.float32) - colour)
    facing = np.argmax(np.stack([normals @ side.towards.astype(np.float32) for side in sides]), axis=0)
    for i, side in enumerate(sides):
        marks = side.sample(points)
        marks[facing != i] = 0
        colour = colour * (1 - marks[..., 3:] / 255) + marks[..., :3]
    return Image.fromarray(colour.clip(0, 255).astype(np.uint8))


def camouflage(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(h, w, 3) float32 sRGB: two greys in soft-edged fields above, a pale belly, a darker radome."""
    x, y, z = (points[..., i] for i in range(3))
    field = np.sin(x / 17 + 1.4 * np.sin(y / 21 + 0.4) + 0.6) + np.sin(y / 15 + 1.2 * np.sin(x / 24) + 1.1 + z / 30)
    light = _step(field / 0.1)[..., None]
    above = _step((normals[..., 2] + 0.45) / 0.12)[..., None]
    bright, dull, pale, radome = np.array([LIGHT, DARK, BELLY, RADOME], np.float32)
    colour = dull + light * (bright - dull)
    colour = pale + above * (colour - pale)
    nose = _step((x - 104) / 0.3)[..., None]
    colour += nose * (radome - colour)
    worn = 1 + 0.025 * np.sin(x / 2.3 + np.sin(y / 3.1) * 2) * np.sin(y / 2.9 + np.sin(x / 4.7) * 2)
    return colour * worn[..., None]


def _step(value: np.ndarray) -> np.ndarray:
    value = np.clip(value * 0.5 + 0.5, 0, 1)
    return value * value * (3 - 2 * value)


def bands(base: tuple[int, int, int], *stripes: tuple[float, float, tuple[int, int, int]]) -> Paint:
    """Paint with stripes across: (from, to, colour), as fractions of the chart's height from below."""

    def paint(width: int, height: int, _px_per_mm: float) -> Image.Image:
        image = Image.new("RGB", (width, height), base)
        for low, high, colour in stripes:
            image.paste(colour, (0, round((1 - high) * height), width, max(1, round((1 - low) * height))))
        return image

    return paint


def petals(count: int, dark: tuple[int, int, int], light: tuple[int, int, int]) -> Paint:
    """Paint of a nozzle: leaves side by side around it, burnt darker towards their seams and towards the end."""

    def paint(width: int, height: int, _px_per_mm: float) -> Image.Image:
        across = np.abs(np.sin(np.pi * count * (np.arange(width) + 0.5) / width)) ** 0.35
        along = np.linspace(1.0, 0.72, height)
        mix = (along[:, None] * across[None])[..., None]
        return Image.fromarray((np.array(dark) + mix * (np.array(light) - np.array(dark))).astype(np.uint8))

    return paint


def draw_sides() -> dict[str, Side]:
    """All drawings of the aeroplane: top, bottom, left, right, and fin_left, fin_right for the tail fins."""
    plan, elevation = ((-140.0, -106.0), (140.0, 106.0)), ((-140.0, -24.0), (140.0, 34.0))
    ahead, astern, fins = (1, 0, 0), (-1, 0, 0), ((-140.0, 5.0), (-60.0, 60.0))
    draw: dict[str, tuple[Drawing, Callable[[Drawing], None]]] = {
        "top": (Drawing(ahead, (0, 1, 0), *plan), draw_top),
        "bottom": (Drawing(ahead, (0, -1, 0), *plan), draw_bottom),
        "left": (Drawing(astern, (0, 0, 1), *elevation), partial(draw_flank, ahead=-1)),
        "right": (Drawing(ahead, (0, 0, 1), *elevation), partial(draw_flank, ahead=1)),
        "fin_left": (Drawing(astern, (0, 0, 1), (60.0, 5.0), (140.0, 60.0)), partial(draw_fin, ahead=-1)),
        "fin_right": (Drawing(ahead, (0, 0, 1), *fins), partial(draw_fin, ahead=1)),
    }
    for sheet, pencil in draw.values():
        pencil(sheet)
    return {name: finish(sheet) for name, (sheet, _) in draw.items()}


def draw_star(sheet: Drawing, centre: Point, radius_mm: float, turn_deg: float = 0.0) -> None:
    """The national insignia: a white star on a blue disc between white bars with a red stripe."""
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])

    def place(points: Sequence[Point]) -> list[Point]:
        return [tuple(p) for p in np.asarray(points, float) * radius_mm @ rotation + centre]

    def bar(x: float, y: float) -> list[Point]:
        return place([(-x, -y), (x, -y), (x, y), (-x, y)])

    sheet.fill(bar(2.12, 0.37), BLUE)
    sheet.fill(bar(2.0, 0.25), WHITE)
    sheet.fill(bar(2.0, 0.085), RED)
    sheet.disc(centre, 1.12 * radius_mm, BLUE)
    angle = np.radians(90 + 36 * np.arange(10))
    reach = np.where(np.arange(10) % 2 == 0, 1.0, 0.382)
    sheet.fill(place(np.stack([reach * np.cos(angle), reach * np.sin(angle)], 1).tolist()), WHITE)


def draw_wing_lines(sheet: Drawing, side: int) -> None:
    """Flaps, ailerons, spars and ribs of one wing and its stabilator; `side` +1 for the upper half of the drawing."""

    def at(*points: Point) -> list[Point]:
        return [(x, side * y) for x, y in points]

    sheet.line(at((-53, 36), (-53, 60), (-57, 92)), 0.5)  # hinge of flap and aileron
    sheet.line(at((-53, 60), (-67, 60)), 0.5)
    sheet.line(at((-53, 37), (-67, 37)), 0.5)
    sheet.line(at((12, 34), (-50.5, 92)), 0.4)  # leading edge
    sheet.line(at((-8, 34), (-52, 92)))
    sheet.line(at((-30, 34), (-54, 92)))
    for y in (44, 54, 64, 74, 84):
        sheet.line(at((26 - 1.21 * (y - 30), y), (-54, y)), 0.3)
    for x, y in ((-20, 49), (-31, 57), (-14, 39), (-44, 41)):
        sheet.panel((x, side * y), 5, 2.4)
    sheet.line(at((-97, 36), (-124, 64)), 0.35)
    sheet.line(at((-121, 36), (-129, 66)), 0.4)
    sheet.line(at((-100, 48), (-131, 48)), 0.3)


def draw_top(sheet: Drawing) -> None:
    """What is seen from above."""
    for side in (1, -1):
        draw_wing_lines(sheet, side)
        sheet.line([(30, 16 * side), (-60, 15 * side), (-104, 12 * side)])  # nacelle seams
        sheet.line([(36, 33 * side), (-66, 31 * side)], 0.3)
        for x in (4, -14, -42, -66, -88):
            sheet.panel((x, side * 23), 9, 7)
        sheet.panel((23, side * 25.5), 10, 10, (96, 104, 112, 255))  # intake bleed louvres
        for louvre in np.arange(19.5, 27, 1.5):
            sheet.line([(louvre, side * 21.5), (louvre, side * 29.5)], 0.5, BLACK)
        sheet.line([(27, 36 * side), (-44, 94.6 * side)], 0.8, (70, 76, 82, 255))  # worn leading edge
        sheet.text((-30, side * 29), "NO STEP", 2.0)
        sheet.fill([(-99, side * 4), (-105, side * 4), (-105, side * 24), (-99, side * 24)], (74, 74, 76, 190))  # heat
    sheet.disc((-51, 92.4), 1.2, RED)  # navigation lights
    sheet.disc((-51, -92.4), 1.2, (30, 140, 70, 255))
    sheet.panel((-18, 0), 40, 15)  # air brake
    sheet.line([(2, 0), (-38, 0)], 0.3)
    sheet.fill([(104, -7.5), (104, 7.5), (78, 10.5), (78, -10.5)], BLACK)  # anti-glare panel
    sheet.line([(-64, 4), (-64, -4), (-100, -4), (-100, 4)], closed=True)
    draw_star(sheet, (-43, 69), 6.8, turn_deg=-90)
    sheet.text((-44, -70), "AF 895", 8.5, turn_deg=-90)


def draw_bottom(sheet: Drawing) -> None:
    """What is seen from below."""
    for side in (1, -1):
        draw_wing_lines(sheet, side)
        sheet.line([(30, 14 * side), (-104, 12 * side)])
        sheet.panel((-38, 21 * side), 26, 9, PRIMER)  # main wheel wells
        for x in (8, -12, -64, -78, -92):
            sheet.panel((x, side * 21), 9, 7)
    sheet.panel((67, 0), 22, 7, PRIMER)
    sheet.panel((36, 0), 14, 8)
    draw_star(sheet, (-43, 62), 6.0, turn_deg=-90)
    sheet.text((-44, -70), "AF 895", 8.5, turn_deg=-90)


def draw_flank(sheet: Drawing, ahead: int) -> None:
    """What is seen from one side; `ahead` is +1 where the nose points right on the drawing, else -1."""

    def at(*points: Point) -> list[Point]:
        return [(ahead * x, z) for x, z in points]

    sheet.line(at((104, -4), (40, -3)), 0.3)
    sheet.line(at((104, 3), (84, 6), (26, 8)), 0.3)
    sheet.line(at((30, -4), (-100, -4)), 0.3)
    for x, z in ((98, -0.5), (57, 1), (46, 1), (8, -8), (-14, -9), (-40, 0), (-62, -8), (-84, -2)):
        sheet.panel((ahead * x, z), 7, 4)
    draw_star(sheet, (ahead * 66, -5.2), 3.4)
    sheet.text((ahead * 93, -6), "895", 4.6)
    sheet.fill(at((31, -1.5), (24, 0.8), (24, -3.8)), RED)  # intake warning
    sheet.text((ahead * 15, -0.2), "DANGER", 3.0, RED)
    sheet.text((ahead * 15, -3.6), "INTAKE", 3.0, RED)


def draw_fin(sheet: Drawing, ahead: int) -> None:
    """Both faces of a tail fin; `ahead` as for `draw_flank`."""

    def at(*points: Point) -> list[Point]:
        return [(ahead * x, z) for x, z in points]

    for z, colour in ((45.5, BLACK), (42.5, YELLOW), (39.5, BLACK), (36.5, YELLOW)):
        sheet.fill(at((-60, z), (-140, z), (-140, z - 3), (-60, z - 3)), colour)
    sheet.line(at((-115, 10), (-123, 50)), 0.5)
    sheet.line(at((-112, 16), (-130, 16)), 0.5)
    sheet.line(at((-84, 16), (-112, 16)), 0.3)
    sheet.line(at((-82, 10), (-113, 50)), 0.35)
    sheet.text((ahead * -105, 28.5), "895", 9, WHITE)
    sheet.text((ahead * -100, 19.5), "AF", 5.5, BLACK)
