"""Paint by projection: the racer's livery and the warplane's markings, drawn flat, laid on from the side."""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial

import cv2
import numpy as np
from PIL import Image, ImageDraw

from toolkit.imaging.plots import read_font
from toolkit.rooms.worlds.content.drawing import INK, Colour, Drawing, Paint, Point, Side, chart_points
from toolkit.rooms.worlds.content.modelling import Part, surface

RED, WHITE, NAVY, YELLOW = (206, 18, 28), (243, 243, 240), (18, 32, 92), (252, 192, 12)
MAIN, TAIL, SKIRT, TRIM = WHITE, RED, NAVY, YELLOW
BLACK, CARBON, RUBBER = (16, 16, 18), (34, 35, 38), (27, 27, 29)
NUMBER = "23"

Look = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(h, w, 3) points and (h, w, 3) unit normals on the car, millimetres -> (h, w, 3) sRGB, 0 to 255."""

DECAL_PX_PER_MM = 8
HALF_LENGTH_MM, HALF_WIDTH_MM, HEIGHT_MM = 140, 70, 90
LIGHT, DARK, BELLY, RADOME = (139, 147, 155), (88, 97, 107), (172, 177, 181), (112, 119, 127)
MATT_BLACK, SIGN_WHITE = (34, 36, 39, 255), (236, 238, 240, 255)
BLUE, SIGNAL_RED, WARNING_YELLOW = (28, 44, 92, 255), (186, 38, 36, 255), (232, 180, 40, 255)
PRIMER = (60, 64, 66, 255)
STATIONS_MM = (104.0, 86.0, 52.0, 20.0, -4.0, -30.0, -54.0, -80.0, -97.0)
"""Frames round the fuselage."""


def panel(net: np.ndarray, look: Look, material: str = "paint") -> Part:
    """A surface whose chart is painted by the places of its texels on the car."""
    return surface(net, project(net, look), material)


def project(net: np.ndarray, look: Look) -> Paint:
    """Paint for `surface(net)` that asks `look` for the colour of every texel's point."""

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        colours = look(*chart_points(net, width, height))
        return Image.fromarray(np.clip(np.round(colours), 0, 255).astype(np.uint8))

    return paint


def paint_body(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The livery: white, a red tail behind a chevron, a navy skirt, a yellow nose, and the decals of sides and top."""
    x, y, z = np.moveaxis(points, -1, 0)
    colours = np.broadcast_to(np.array(MAIN, float), points.shape).copy()
    top = np.clip((normals[..., 2] - 0.55) / 0.1, 0, 1)
    # colours are laid by signed distances in millimetres: in layers, as paint is
    arrow = x + 0.55 * np.abs(y) + 0.35 * (z - 20)  # chevrons: constant along lines swept back from the spine
    _cover(colours, TRIM, -arrow - 16)
    _cover(colours, TAIL, -arrow - 21)
    # the skirt rises towards the tail
    belt = 13.0 + 6.0 * np.clip((40 - x) / 110, 0, 1)
    _cover(colours, TRIM, belt + 2.6 - z)
    _cover(colours, SKIRT, belt - z)
    nose = x - 118 + 0.8 * np.abs(y)
    _cover(colours, SKIRT, nose + 5)
    _cover(colours, TRIM, nose + 2)
    for seam in (-66, 22):
        _cover(colours, BLACK, np.where(top > 0.5, 0.3 - np.abs(x - seam), -1))
    _overlay(colours, draw_top(), HALF_LENGTH_MM + x, HALF_WIDTH_MM - y, top)
    for left in (True, False):
        # from each side only what faces it: a decal must not come through on the other
        facing = (normals[..., 1] > 0) == left
        across = HALF_LENGTH_MM + (-x if left else x)
        _overlay(colours, draw_side(left), across, HEIGHT_MM - z, (1 - top) * facing * (np.abs(normals[..., 1]) > 0.3))
    return colours


def paint_wing(base: Colour, text: str, span_mm: float, size_mm: float, at_x: float, from_behind: bool) -> Look:
    """The look of a wing with red tips and a sponsor on its upper side, read from the front or from behind."""

    def look(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        x, y, _ = np.moveaxis(points, -1, 0)
        # colour by place across the wing: white edges, red tips
        colours = np.broadcast_to(np.array(base, float), points.shape).copy()
        _cover(colours, WHITE, np.abs(y) - span_mm / 2 + 13)
        _cover(colours, RED, np.abs(y) - span_mm / 2 + 11)
        decal = _premultiplied(Image.fromarray(_words(text, size_mm, WHITE)))
        sign = -1 if from_behind else 1
        # the sponsor's words, in millimetres, on the upper face alone
        height, width = (side / DECAL_PX_PER_MM for side in decal.shape[:2])
        _overlay(
            colours, decal, width / 2 + sign * y, height / 2 + sign * (x - at_x), (normals[..., 2] > 0.3).astype(float)
        )
        return colours

    return look


def paint_plain(points: np.ndarray, _: np.ndarray) -> np.ndarray:
    """The flaps' red."""
    return np.broadcast_to(np.array(RED, float), points.shape)


def paint_lettering(base: Colour, text: str, colour: Colour, size_mm: float, repeats: int = 1) -> Paint:
    """Words centred on a chart, or repeated along it."""

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        image = Image.new("RGB", (width, height), base)
        font = read_font("sans", max(4, round(size_mm * px_per_mm)))
        for k in range(repeats):
            # letters are drawn on a plate of their own size, then pasted in the middle
            box = font.getbbox(text)
            words = Image.new("L", (int(box[2] - box[0]) + 2, int(box[3] - box[1]) + 2), 0)
            ImageDraw.Draw(words).text((1 - box[0], 1 - box[1]), text, font=font, fill=255)
            left = round(width * (k + 0.5) / repeats - words.width / 2)
            image.paste(Image.new("RGB", words.size, colour), (left, (height - words.height) // 2), words)
        return image

    return paint


def paint_helmet(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """A white crown with a yellow band and a red crest; points are centred on the helmet."""
    _, y, z = np.moveaxis(points, -1, 0)
    colours = np.broadcast_to(np.array(WHITE, float), points.shape).copy()
    _cover(colours, YELLOW, -4.5 - z)
    _cover(colours, RED, np.where(z > 4.5, 2.6 - np.abs(y), -1))
    _cover(colours, NAVY, np.minimum(z - 5.0, 6.6 - z))
    return colours


@lru_cache(maxsize=1)
def draw_top() -> np.ndarray:
    """Decals seen from above, nose to the right, the car's left side up; RGBA, float32."""
    # flat on the car's plan; `place` takes the car's own millimetres
    sheet = _blank(2 * HALF_LENGTH_MM, 2 * HALF_WIDTH_MM)
    place = _placer(sheet, lambda x, y: (HALF_LENGTH_MM + x, HALF_WIDTH_MM - y))
    place(_roundel(24), 100, 0, 90)
    place(_roundel(56), -22, 0, 90)
    # words are turned so that they read from their own side
    for side in (1, -1):
        turn = 0 if side < 0 else 180
        place(_block("VELOX", 9, WHITE, NAVY), -12, side * 38.5, turn)
        place(_block("NORDA", 7, NAVY, WHITE), -53, side * 36, turn)
        place(_louvres(12, 14), 12, side * 16, 0)
        place(_louvres(12, 14), -58, side * 14, 0)
        place(_block("APEX", 4.5, WHITE, RED), 78, side * 12.5, turn)
    return _premultiplied(sheet)


@lru_cache(maxsize=2)
def draw_side(left: bool) -> np.ndarray:
    """Decals seen from the car's left or right, the ground at the bottom; RGBA, float32."""
    sheet = _blank(2 * HALF_LENGTH_MM, HEIGHT_MM)
    place = _placer(sheet, lambda x, z: (HALF_LENGTH_MM + (-x if left else x), HEIGHT_MM - z))
    place(_roundel(29), 8, 24.5, 0)
    place(_block("VELOX", 9, WHITE, NAVY), -30, 28, 0)
    place(_words("NORDA OIL", 5.5, WHITE), -32, 10, 0)
    place(_block("APEX", 6, WHITE, RED), 82, 21, 0)
    place(_words("KITE", 5, NAVY), 121, 14, 0)
    return _premultiplied(sheet)


def _cover(colours: np.ndarray, colour: Colour, inside_mm: np.ndarray) -> None:
    """Lay a colour where `inside_mm`, a signed distance, is positive; the edge is a quarter millimetre soft."""
    alpha = np.clip(inside_mm / 0.25 + 0.5, 0, 1)[..., None]
    colours += alpha * (np.array(colour, float) - colours)


def _overlay(
    colours: np.ndarray, decals: np.ndarray, right_mm: np.ndarray, down_mm: np.ndarray, weight: np.ndarray
) -> None:
    """Lay premultiplied decals over colours at positions counted from the sheet's upper left corner."""
    column, row = ((mm * DECAL_PX_PER_MM - 0.5).astype(np.float32) for mm in (right_mm, down_mm))
    found = cv2.remap(decals, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0, 0))
    found = found * weight[..., None]
    colours *= 1 - found[..., 3:]
    colours += found[..., :3]


def _blank(width_mm: float, height_mm: float) -> Image.Image:
    return Image.new("RGBA", (round(width_mm * DECAL_PX_PER_MM), round(height_mm * DECAL_PX_PER_MM)))


def _placer(sheet: Image.Image, locate: Callable[[float, float], tuple[float, float]]) -> Callable[..., None]:
    def place(decal: np.ndarray, a: float, b: float, turn_deg: float) -> None:
        image = Image.fromarray(decal).rotate(turn_deg, Image.Resampling.BICUBIC, expand=True)
        right, down = (mm * DECAL_PX_PER_MM for mm in locate(a, b))
        sheet.alpha_composite(image, (round(right - image.width / 2), round(down - image.height / 2)))

    return place


def _roundel(diameter_mm: float) -> np.ndarray:
    side = round(diameter_mm * DECAL_PX_PER_MM)
    image = Image.new("RGBA", (side * 2, side * 2))
    draw = ImageDraw.Draw(image)
    draw.ellipse((1, 1, 2 * side - 2, 2 * side - 2), fill=(*NAVY, 255))
    rim = round(0.09 * side)
    draw.ellipse((rim, rim, 2 * side - 1 - rim, 2 * side - 1 - rim), fill=(*WHITE, 255))
    draw.text((side, side), NUMBER, font=read_font("sans", round(1.12 * side)), fill=(*BLACK, 255), anchor="mm")
    return np.asarray(image.resize((side, side), Image.Resampling.LANCZOS))


def _words(text: str, size_mm: float, colour: Colour) -> np.ndarray:
    font = read_font("sans", round(size_mm * DECAL_PX_PER_MM))
    left, top, right, bottom = (round(edge) for edge in font.getbbox(text))
    image = Image.new("RGBA", (right - left + 4, bottom - top + 4), (*colour, 0))
    ImageDraw.Draw(image).text((2 - left, 2 - top), text, font=font, fill=(*colour, 255))
    return np.asarray(image)


def _block(text: str, size_mm: float, colour: Colour, ground: Colour) -> np.ndarray:
    words = Image.fromarray(_words(text, size_mm, colour))
    margin = round(0.3 * size_mm * DECAL_PX_PER_MM)
    image = Image.new("RGBA", (words.width + 2 * margin, words.height + 2 * margin))
    ImageDraw.Draw(image).rounded_rectangle((0, 0, image.width - 1, image.height - 1), margin, fill=(*ground, 255))
    image.alpha_composite(words, (margin, margin))
    return np.asarray(image)


def _louvres(length_mm: float, width_mm: float) -> np.ndarray:
    size = round(length_mm * DECAL_PX_PER_MM), round(width_mm * DECAL_PX_PER_MM)
    image = Image.new("RGBA", size)
    draw = ImageDraw.Draw(image)
    for k in range(5):
        left = round((k + 0.2) / 5 * size[0])
        draw.rounded_rectangle((left, 0, left + round(0.09 * size[0]), size[1] - 1), 4, fill=(*BLACK, 255))
    return np.asarray(image)


def _premultiplied(sheet: Image.Image) -> np.ndarray:
    decals = np.asarray(sheet).astype(np.float32)
    decals[..., 3] /= 255
    decals[..., :3] *= decals[..., 3:]
    return decals


def skin_paint(net: np.ndarray, sides: Sequence[Side], stations_mm: Sequence[float] = ()) -> Paint:
    """Paint for `surface(net)`: camouflage, frames at `stations_mm` along x, and the markings of the sides it faces.

    Args:
        net: (rows, columns, 3) where the part ends up on the aeroplane, millimetres.
        sides: drawings; a texel takes the drawing that looks at it most squarely.
        stations_mm: x of lines across.
    """
    return partial(_paint_skin, net, tuple(sides), tuple(stations_mm))


def _paint_skin(
    net: np.ndarray, sides: tuple[Side, ...], stations: tuple[float, ...], width: int, height: int, px_per_mm: float
) -> Image.Image:
    points, normals = chart_points(net, width, height)
    # camouflage below, then lines at the stations, then markings
    colour = camouflage(points, normals)
    for station in stations:
        near: np.ndarray = np.clip(0.75 - np.abs(points[..., :1] - station) / 0.35, 0, 1) * 0.8
        colour += near * (np.array(INK[:3], np.float32) - colour)
    # each point belongs to the drawing that it faces most
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
    # corners of the drawings, millimetres: from above, from a side, and of the fins
    plan, elevation = ((-140.0, -106.0), (140.0, 106.0)), ((-140.0, -24.0), (140.0, 34.0))
    ahead, astern, fins = (1, 0, 0), (-1, 0, 0), ((-140.0, 5.0), (-60.0, 60.0))
    draw: dict[str, tuple[Drawing, Callable[[Drawing], None]]] = {
        "top": (Drawing(ahead, (0, 1, 0), *plan), draw_above),
        "bottom": (Drawing(ahead, (0, -1, 0), *plan), draw_below),
        "left": (Drawing(astern, (0, 0, 1), *elevation), partial(draw_flank, ahead=-1)),
        "right": (Drawing(ahead, (0, 0, 1), *elevation), partial(draw_flank, ahead=1)),
        "fin_left": (Drawing(astern, (0, 0, 1), (60.0, 5.0), (140.0, 60.0)), partial(draw_fin, ahead=-1)),
        "fin_right": (Drawing(ahead, (0, 0, 1), *fins), partial(draw_fin, ahead=1)),
    }
    # drawn first, then sampled
    for sheet, pencil in draw.values():
        pencil(sheet)
    return {name: sheet.side() for name, (sheet, _) in draw.items()}


def draw_star(sheet: Drawing, centre: Point, radius_mm: float, turn_deg: float = 0.0) -> None:
    """The national insignia: a white star on a blue disc between white bars with a red stripe."""
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])

    def place(points: Sequence[Point]) -> list[Point]:
        return [tuple(p) for p in np.asarray(points, float) * radius_mm @ rotation + centre]

    def bar(x: float, y: float) -> list[Point]:
        return place([(-x, -y), (x, -y), (x, y), (-x, y)])

    # bars, stripe and disc from below to the top
    sheet.fill(bar(2.12, 0.37), BLUE)
    sheet.fill(bar(2.0, 0.25), SIGN_WHITE)
    sheet.fill(bar(2.0, 0.085), SIGNAL_RED)
    sheet.disc(centre, 1.12 * radius_mm, BLUE)
    # a pentagram: its inner corners lie at 0.382 of the outer radius
    angle = np.radians(90 + 36 * np.arange(10))
    reach = np.where(np.arange(10) % 2 == 0, 1.0, 0.382)
    sheet.fill(place(np.stack([reach * np.cos(angle), reach * np.sin(angle)], 1).tolist()), SIGN_WHITE)


def draw_wing_lines(sheet: Drawing, side: int) -> None:
    """Flaps, ailerons, spars and ribs of a wing and its stabilator; `side` +1 for the upper half of the drawing."""

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


def draw_above(sheet: Drawing) -> None:
    """The view from above."""
    for side in (1, -1):
        draw_wing_lines(sheet, side)
        sheet.line([(30, 16 * side), (-60, 15 * side), (-104, 12 * side)])  # nacelle seams
        sheet.line([(36, 33 * side), (-66, 31 * side)], 0.3)
        for x in (4, -14, -42, -66, -88):
            sheet.panel((x, side * 23), 9, 7)
        sheet.panel((23, side * 25.5), 10, 10, (96, 104, 112, 255))  # intake bleed louvres
        for louvre in np.arange(19.5, 27, 1.5):
            sheet.line([(louvre, side * 21.5), (louvre, side * 29.5)], 0.5, MATT_BLACK)
        sheet.line([(27, 36 * side), (-44, 94.6 * side)], 0.8, (70, 76, 82, 255))  # worn leading edge
        sheet.text((-30, side * 29), "NO STEP", 2.0)
        sheet.fill([(-99, side * 4), (-105, side * 4), (-105, side * 24), (-99, side * 24)], (74, 74, 76, 190))  # heat
    sheet.disc((-51, 92.4), 1.2, SIGNAL_RED)  # navigation lights
    sheet.disc((-51, -92.4), 1.2, (30, 140, 70, 255))
    sheet.panel((-18, 0), 40, 15)  # air brake
    sheet.line([(2, 0), (-38, 0)], 0.3)
    sheet.fill([(104, -7.5), (104, 7.5), (78, 10.5), (78, -10.5)], MATT_BLACK)  # anti-glare panel
    sheet.line([(-64, 4), (-64, -4), (-100, -4), (-100, 4)], closed=True)
    draw_star(sheet, (-43, 69), 6.8, turn_deg=-90)
    sheet.text((-44, -70), "AF 895", 8.5, turn_deg=-90)


def draw_below(sheet: Drawing) -> None:
    """The view from below."""
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
    """The view from a side; `ahead` is +1 if the nose points right on the drawing, else -1."""

    def at(*points: Point) -> list[Point]:
        return [(ahead * x, z) for x, z in points]

    sheet.line(at((104, -4), (40, -3)), 0.3)
    sheet.line(at((104, 3), (84, 6), (26, 8)), 0.3)
    sheet.line(at((30, -4), (-100, -4)), 0.3)
    for x, z in ((98, -0.5), (57, 1), (46, 1), (8, -8), (-14, -9), (-40, 0), (-62, -8), (-84, -2)):
        sheet.panel((ahead * x, z), 7, 4)
    draw_star(sheet, (ahead * 66, -5.2), 3.4)
    sheet.text((ahead * 93, -6), "895", 4.6)
    sheet.fill(at((31, -1.5), (24, 0.8), (24, -3.8)), SIGNAL_RED)  # intake warning
    sheet.text((ahead * 15, -0.2), "DANGER", 3.0, SIGNAL_RED)
    sheet.text((ahead * 15, -3.6), "INTAKE", 3.0, SIGNAL_RED)


def draw_fin(sheet: Drawing, ahead: int) -> None:
    """Both faces of a tail fin; `ahead` as for `draw_flank`."""

    def at(*points: Point) -> list[Point]:
        return [(ahead * x, z) for x, z in points]

    for z, colour in ((45.5, MATT_BLACK), (42.5, WARNING_YELLOW), (39.5, MATT_BLACK), (36.5, WARNING_YELLOW)):
        sheet.fill(at((-60, z), (-140, z), (-140, z - 3), (-60, z - 3)), colour)
    sheet.line(at((-115, 10), (-123, 50)), 0.5)
    sheet.line(at((-112, 16), (-130, 16)), 0.5)
    sheet.line(at((-84, 16), (-112, 16)), 0.3)
    sheet.line(at((-82, 10), (-113, 50)), 0.35)
    sheet.text((ahead * -105, 28.5), "895", 9, SIGN_WHITE)
    sheet.text((ahead * -100, 19.5), "AF", 5.5, MATT_BLACK)
