"""The racer's paint: bands, stripes, numbers and sponsors, projected on the bodywork from the side and from above."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw

from toolkit.content.modelling import Colour, Paint, Part, surface
from toolkit.imaging.fonts import read_font

RED, WHITE, NAVY, YELLOW = (206, 18, 28), (243, 243, 240), (18, 32, 92), (252, 192, 12)
MAIN, TAIL, SKIRT, TRIM = WHITE, RED, NAVY, YELLOW
BLACK, CARBON, RUBBER = (16, 16, 18), (34, 35, 38), (27, 27, 29)
NUMBER = "23"

Look = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(h, w, 3) points and (h, w, 3) unit normals on the car, millimetres -> (h, w, 3) sRGB, 0 to 255."""

DECAL_PX_PER_MM = 8
HALF_LENGTH_MM, HALF_WIDTH_MM, HEIGHT_MM = 140, 70, 90


def panel(net: np.ndarray, look: Look, material: str = "paint") -> Part:
    """A surface whose chart is painted by where each texel lies on the car."""
    return surface(net, project(net, look), material)


def project(net: np.ndarray, look: Look) -> Paint:
    """Paint for `surface(net)` that asks `look` for the colour of every texel's point."""
    columns = np.r_[0, np.cumsum(np.linalg.norm(np.diff(net, axis=1), axis=2).mean(axis=0))]
    rows = np.r_[0, np.cumsum(np.linalg.norm(np.diff(net, axis=0), axis=2).mean(axis=1))]
    normals = np.cross(np.gradient(net, axis=1), np.gradient(net, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        u = (np.arange(width) + 0.5) / width * columns[-1]
        v = (1 - (np.arange(height) + 0.5) / height) * rows[-1]
        column = np.interp(u, columns, np.arange(len(columns)))
        row = np.interp(v, rows, np.arange(len(rows)))
        grid_x, grid_y = np.meshgrid(column, row)
        colours = look(_sample(net, grid_x, grid_y), _sample(normals, grid_x, grid_y))
        return Image.fromarray(np.clip(np.round(colours), 0, 255).astype(np.uint8))

    return paint


def paint_body(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The livery: white, a red tail behind a chevron, a navy skirt, a yellow nose, and the decals of sides and top."""
    x, y, z = np.moveaxis(points, -1, 0)
    colours = np.broadcast_to(np.array(MAIN, float), points.shape).copy()
    top = np.clip((normals[..., 2] - 0.55) / 0.1, 0, 1)
    arrow = x + 0.55 * np.abs(y) + 0.35 * (z - 20)  # chevrons: constant along lines swept back from the spine
    _cover(colours, TRIM, -arrow - 16)
    _cover(colours, TAIL, -arrow - 21)
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
        facing = (normals[..., 1] > 0) == left
        across = HALF_LENGTH_MM + (-x if left else x)
        _overlay(colours, draw_side(left), across, HEIGHT_MM - z, (1 - top) * facing * (np.abs(normals[..., 1]) > 0.3))
    return colours


def paint_wing(base: Colour, text: str, span_mm: float, size_mm: float, at_x: float, from_behind: bool) -> Look:
    """The look of a wing with red tips and a sponsor on its upper side, read from the front or from behind."""

    def look(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        x, y, _ = np.moveaxis(points, -1, 0)
        colours = np.broadcast_to(np.array(base, float), points.shape).copy()
        _cover(colours, WHITE, np.abs(y) - span_mm / 2 + 13)
        _cover(colours, RED, np.abs(y) - span_mm / 2 + 11)
        decal = _premultiplied(Image.fromarray(_words(text, size_mm, WHITE)))
        sign = -1 if from_behind else 1
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
    sheet = _blank(2 * HALF_LENGTH_MM, 2 * HALF_WIDTH_MM)
    place = _placer(sheet, lambda x, y: (HALF_LENGTH_MM + x, HALF_WIDTH_MM - y))
    place(_roundel(24), 100, 0, 90)
    place(_roundel(56), -22, 0, 90)
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


def _sample(values: np.ndarray, column: np.ndarray, row: np.ndarray) -> np.ndarray:
    import cv2

    maps = column.astype(np.float32), row.astype(np.float32)
    return cv2.remap(values.astype(np.float32), *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _cover(colours: np.ndarray, colour: Colour, inside_mm: np.ndarray) -> None:
    """Lay a colour where `inside_mm`, a signed distance, is positive; the edge is a quarter millimetre soft."""
    alpha = np.clip(inside_mm / 0.25 + 0.5, 0, 1)[..., None]
    colours += alpha * (np.array(colour, float) - colours)


def _overlay(
    colours: np.ndarray, decals: np.ndarray, right_mm: np.ndarray, down_mm: np.ndarray, weight: np.ndarray
) -> None:
    """Lay premultiplied decals over colours at positions counted from the sheet's upper left corner."""
    import cv2

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
    """A white disc with a navy ring and the number."""
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
    """A sponsor's name on a block of its colour with rounded corners."""
    words = Image.fromarray(_words(text, size_mm, colour))
    margin = round(0.3 * size_mm * DECAL_PX_PER_MM)
    image = Image.new("RGBA", (words.width + 2 * margin, words.height + 2 * margin))
    ImageDraw.Draw(image).rounded_rectangle((0, 0, image.width - 1, image.height - 1), margin, fill=(*ground, 255))
    image.alpha_composite(words, (margin, margin))
    return np.asarray(image)


def _louvres(length_mm: float, width_mm: float) -> np.ndarray:
    """Cooling slots across the engine cover."""
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
