"""The drawing kit: noise without a seam, drawings to scale, patterns, palettes, and what chance decides."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.imaging.plots import read_font

Colour = tuple[int, int, int]
Paint = Colour | Callable[[int, int, float], Image.Image]
"""A plain sRGB colour, or a function (width_px, height_px, px_per_mm) -> RGB image of the chart, u right, v up."""
Point = tuple[float, float]
Ink = tuple[int, ...]
"""A colour, sRGB; of three numbers."""
DRAW_PX_PER_MM = 12
KEEP_PX_PER_MM = 6

RGBA = tuple[int, int, int, int]
INK: RGBA = (52, 57, 63, 210)
T = TypeVar("T")

PALETTES: dict[str, tuple[Colour, ...]] = {
    "wood": ((186, 140, 92), (150, 104, 64), (104, 66, 40), (214, 178, 128), (128, 76, 44), (72, 48, 34)),
    "steel": ((190, 192, 196), (160, 163, 168), (206, 206, 204), (128, 132, 138)),
    "brass": ((188, 150, 78), (176, 112, 70), (206, 174, 104)),
    "ceramic": ((242, 240, 234), (230, 224, 208), (44, 74, 128), (120, 150, 140), (168, 68, 52), (222, 196, 132),
                (86, 110, 80), (60, 60, 64), (150, 190, 205), (206, 140, 130)),
    "bright": ((206, 32, 36), (22, 84, 176), (240, 196, 24), (28, 136, 62), (236, 118, 24), (118, 48, 142),
               (20, 158, 168), (228, 74, 138), (140, 196, 40)),
    "pale": ((244, 242, 238), (226, 220, 204), (206, 218, 226), (236, 216, 212), (214, 228, 206)),
    "dark": ((24, 24, 27), (42, 44, 50), (56, 40, 34), (26, 34, 54), (30, 48, 38)),
    "grey": ((92, 96, 102), (138, 142, 146), (176, 178, 180), (64, 66, 70)),
    "military": ((104, 116, 92), (92, 98, 104), (142, 150, 156), (168, 150, 112), (72, 82, 66), (60, 70, 84)),
    "car": ((176, 22, 30), (24, 56, 120), (198, 200, 204), (34, 36, 40), (238, 238, 236), (70, 96, 76),
            (150, 130, 100), (92, 28, 38), (110, 150, 186)),
    "terracotta": ((184, 96, 62), (164, 84, 58), (198, 120, 84)),
}  # fmt: skip
"""sRGB colours by what they are found on."""


def noise(rng: np.random.Generator, shape: tuple[int, int], cells: tuple[int, int]) -> np.ndarray:
    """(h, w) float32 smooth noise of mean 0 and about ±1 with `cells` bumps down and across; repeats without a seam."""
    # noise that repeats may be moved by any number of texels, and stays without a seam
    return _roll(_noise(shape, cells, int(rng.integers(POOL))), rng)


def fractal(
    rng: np.random.Generator, shape: tuple[int, int], coarsest: int = 4, octaves: int = 5, fall: float = 0.6
) -> np.ndarray:
    """(h, w) float32 noise of several scales, about ±1, which repeats without a seam."""
    return _roll(_fractal(shape, coarsest, octaves, fall, int(rng.integers(POOL))), rng)


def grain(rng: np.random.Generator, shape: tuple[int, int], amount: float) -> np.ndarray:
    """(h, w, 1) float32 speckle of each texel."""
    side = max(512, *shape)
    return (_roll(_speckle(side), rng)[: shape[0], : shape[1]] * np.float32(amount))[..., None]


POOL = 2
"""How many noises of a kind are made; a texture takes any, moved at random: painting is mostly noise."""


def _roll(field: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    down, across = rng.integers(field.shape[0]), rng.integers(field.shape[1])
    return np.roll(field, (int(down), int(across)), (0, 1))


@lru_cache(maxsize=8)
def _speckle(side: int) -> np.ndarray:
    return np.random.default_rng([side, 3]).standard_normal((side, side), dtype=np.float32)


@lru_cache(maxsize=96)
def _noise(shape: tuple[int, int], cells: tuple[int, int], variant: int) -> np.ndarray:
    rng = np.random.default_rng([*shape, *cells, variant, 1])
    lattice = rng.uniform(-1, 1, cells).astype(np.float32)
    pad = 2
    # wrapped round its edges before it is enlarged, so that it repeats without a seam
    wrapped = np.pad(lattice, pad, mode="wrap")
    scale_y, scale_x = shape[0] / cells[0], shape[1] / cells[1]
    size = round(wrapped.shape[1] * scale_x), round(wrapped.shape[0] * scale_y)
    big = cv2.resize(wrapped, size, interpolation=cv2.INTER_CUBIC)
    top, left = round(pad * scale_y), round(pad * scale_x)
    return big[top : top + shape[0], left : left + shape[1]]


@lru_cache(maxsize=48)
def _fractal(shape: tuple[int, int], coarsest: int, octaves: int, fall: float, variant: int) -> np.ndarray:
    total, weight = np.zeros(shape, np.float32), 0.0
    for k in range(octaves):
        cells = min(coarsest * 2**k, shape[0] // 2), min(coarsest * 2**k, shape[1] // 2)
        total += fall**k * _noise(shape, cells, variant)
        weight += (fall**k) ** 2
    return total / np.float32(np.sqrt(weight))


def flat(shape: tuple[int, int], colour: Ink) -> np.ndarray:
    """(h, w, 3) float32 of a single colour, 0 to 255."""
    return np.broadcast_to(np.array(colour, np.float32), (*shape, 3)).copy()


def finish(colours: np.ndarray) -> np.ndarray:
    """A texture, uint8, of colours 0 to 255."""
    return np.clip(np.round(colours), 0, 255).astype(np.uint8)


def stains(rng: np.random.Generator, shape: tuple[int, int], strength: float) -> np.ndarray:
    """(h, w, 1) factor below and about 1: soft blotches, and streaks that run down."""
    blotch = fractal(rng, shape, 3, 4)
    streak = noise(rng, shape, (3, max(8, shape[1] // 8))) * noise(rng, shape, (2, max(4, shape[1] // 32)))
    return (1 + strength * (0.5 * blotch + 0.6 * streak))[..., None]


def hex_name(colour: Ink) -> str:
    """A colour as six hex digits, for names."""
    return "".join(f"{c:02x}" for c in colour)


def _rgb(colour: Ink) -> tuple[int, int, int]:
    red, green, blue = (int(c) for c in colour)
    return red, green, blue


class Canvas:
    """A drawing in metres on a plain ground, y up, drawn twice as fine as it is kept.

    Args:
        px_per_m: of the kept picture.
        low: metres at its lower left corner.
    """

    FINER = 2

    def __init__(self, width_m: float, height_m: float, px_per_m: float, ground: Ink, low: Point = (0.0, 0.0)) -> None:
        # scales apart for x and y: rounding to whole pixels may stretch them differently
        self.size = max(1, round(width_m * px_per_m)), max(1, round(height_m * px_per_m))
        self.scale = self.FINER * self.size[0] / width_m, self.FINER * self.size[1] / height_m
        self.low, self.top = low, low[1] + height_m
        self.image = Image.new("RGB", (self.size[0] * self.FINER, self.size[1] * self.FINER), ground)
        self.draw = ImageDraw.Draw(self.image)

    def px(self, points: Sequence[Point]) -> list[Point]:
        """Pixels of points in metres."""
        return [((x - self.low[0]) * self.scale[0], (self.top - y) * self.scale[1]) for x, y in points]

    def rect(self, x0: float, y0: float, x1: float, y1: float, colour: Ink) -> None:
        """A filled rectangle."""
        (left, bottom), (right, top) = self.px([(x0, y0), (x1, y1)])
        self.draw.rectangle((left, top, max(right - 1, left), max(bottom - 1, top)), fill=_rgb(colour))

    def fill(self, points: Sequence[Point], colour: Ink) -> None:
        """A filled polygon."""
        self.draw.polygon(self.px(points), fill=_rgb(colour))

    def line(self, points: Sequence[Point], width_m: float, colour: Ink) -> None:
        """A line through points."""
        width = max(1, round(width_m * self.scale[0]))
        self.draw.line(self.px(points), _rgb(colour), width, joint="curve")

    def disc(self, x: float, y: float, radius_m: float, colour: Ink, ring_m: float = 0.0) -> None:
        """A filled circle, or a ring of that width."""
        (cx, cy), rx, ry = self.px([(x, y)])[0], radius_m * self.scale[0], radius_m * self.scale[1]
        edge = (cx - rx, cy - ry, cx + rx, cy + ry)
        if ring_m:
            self.draw.ellipse(edge, outline=_rgb(colour), width=max(1, round(ring_m * self.scale[0])))
        else:
            self.draw.ellipse(edge, fill=_rgb(colour))

    def text(
        self, x: float, y: float, words: str, height_m: float, colour: Ink, *, face: str = "sans", fit_m: float = 0.0
    ) -> None:
        """Lettering centred on a point; narrower than `fit_m` if that is given."""
        size = round(height_m * self.scale[1])
        font = read_font(face, max(5, size))
        # too wide for its room: as much smaller as it must be
        if fit_m and font.getlength(words) > fit_m * self.scale[0]:
            size = int(size * fit_m * self.scale[0] / font.getlength(words))
            font = read_font(face, max(5, size))
        self.draw.text(self.px([(x, y)])[0], words, _rgb(colour), font, anchor="mm")

    def texture(self, speckle: float = 0.0, rng: np.random.Generator | None = None) -> np.ndarray:
        """The kept picture, uint8, with a little grain if asked."""
        kept = np.asarray(self.image.reduce(self.FINER), np.float32)
        if rng is not None and speckle:
            # noise that repeats, cut to the picture
            h, w = kept.shape[:2]
            wide = (1024, 1024) if max(h, w) > 512 else (512, 512)
            cloud = fractal(rng, wide, 8, 3)[:h, :w, None]
            kept = kept * (1 + speckle * cloud) + grain(rng, (h, w), 60 * speckle)
        return finish(kept)


class Drawing:
    """A flat drawing in millimetres, seen along a world axis.

    Args:
        right, up: unit vectors of the world that point to the right and up on the drawing.
        low, high: its lower left and upper right corner, millimetres along `right` and `up`.
    """

    def __init__(self, right: Sequence[float], up: Sequence[float], low: Point, high: Point) -> None:
        self.axes = np.array([right, up], float)
        self.low, self.high = np.array(low), np.array(high)
        width, height = np.ceil((self.high - self.low) * DRAW_PX_PER_MM)
        self.image = Image.new("RGBA", (int(width), int(height)), (128, 128, 128, 0))
        self.draw = ImageDraw.Draw(self.image)

    def px(self, points: Sequence[Point]) -> list[Point]:
        """Pixels of points (right, up) in millimetres."""
        return [
            ((a - self.low[0]) * DRAW_PX_PER_MM, (self.high[1] - b) * DRAW_PX_PER_MM) for a, b in np.asarray(points)
        ]

    def line(self, points: Sequence[Point], width_mm: float = 0.35, colour: RGBA = INK, closed: bool = False) -> None:
        """A line through points."""
        points = [*points, points[0]] if closed else points
        self.draw.line(self.px(points), colour, max(1, round(width_mm * DRAW_PX_PER_MM)), joint="curve")

    def fill(self, points: Sequence[Point], colour: RGBA) -> None:
        """A filled polygon."""
        self.draw.polygon(self.px(points), colour)

    def disc(self, centre: Point, radius_mm: float, colour: RGBA) -> None:
        """A filled circle."""
        (x, y), r = self.px([centre])[0], radius_mm * DRAW_PX_PER_MM
        self.draw.ellipse((x - r, y - r, x + r, y + r), colour)

    def panel(self, centre: Point, width_mm: float, height_mm: float, fill: RGBA | None = None) -> None:
        """A hatch: its outline, and its fill if given."""
        (a, b), w, h = centre, width_mm / 2, height_mm / 2
        corners = [(a - w, b - h), (a + w, b - h), (a + w, b + h), (a - w, b + h)]
        if fill:
            self.fill(corners, fill)
        self.line(corners, 0.3, closed=True)

    def text(self, centre: Point, words: str, height_mm: float, colour: RGBA = INK, turn_deg: float = 0) -> None:
        """Lettering, `height_mm` from line to line, turned counter-clockwise about its middle."""
        font = ImageFont.load_default(size=height_mm * DRAW_PX_PER_MM)
        # with room for the rotation
        left, top, right, bottom = font.getbbox(words)
        patch = Image.new("RGBA", (int(right - left) + 8, int(bottom - top) + 8), (*colour[:3], 0))
        ImageDraw.Draw(patch).text((4 - left, 4 - top), words, colour, font, stroke_width=2)
        patch = patch.rotate(turn_deg, Image.Resampling.BICUBIC, expand=True)
        x, y = self.px([centre])[0]
        self.image.paste(patch, (round(x - patch.width / 2), round(y - patch.height / 2)), patch)

    def side(self) -> "Side":
        """The finished drawing, at the resolution that is sampled, premultiplied."""
        # premultiplied first: the mean of clear and inked texels must not take colour from clear ones
        pixels = np.asarray(self.image.convert("RGBa").reduce(DRAW_PX_PER_MM // KEEP_PX_PER_MM), np.float32)
        return Side(pixels, self.axes, self.low, self.high)


@dataclass(frozen=True)
class Side:
    """A finished drawing, the direction that it is seen from, and the part of the world that it is laid on."""

    pixels: np.ndarray
    axes: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def towards(self) -> np.ndarray:
        """Unit vector to the viewer."""
        return np.cross(self.axes[0], self.axes[1])

    def sample(self, points: np.ndarray) -> np.ndarray:
        """(h, w, 4) of the drawing at (h, w, 3) points; clear outside it."""
        flat = points @ self.axes.T.astype(np.float32)
        x = (flat[..., 0] - self.low[0]) * KEEP_PX_PER_MM - 0.5
        y = (self.high[1] - flat[..., 1]) * KEEP_PX_PER_MM - 0.5
        return cv2.remap(self.pixels, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)


def chart_points(net: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Place and normal of each texel of `surface(net)`'s chart: two (height, width, 3) float32."""
    u = np.r_[0, np.cumsum(np.linalg.norm(np.diff(net, axis=1), axis=2).mean(axis=0))]
    v = np.r_[0, np.cumsum(np.linalg.norm(np.diff(net, axis=0), axis=2).mean(axis=1))]
    column = np.interp((np.arange(width) + 0.5) / width * u[-1], u, np.arange(len(u)))
    row = np.interp((1 - (np.arange(height) + 0.5) / height) * v[-1], v, np.arange(len(v)))
    normals = np.cross(np.gradient(net, axis=1), np.gradient(net, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    # not OpenCV's remap, whose version 4 rounds places to a 32nd
    across = (_between(field.astype(np.float32), column, 1) for field in (net, normals))
    points, turned = (_between(field, row, 0) for field in across)
    return points, turned


def _between(table: np.ndarray, places: np.ndarray, axis: int) -> np.ndarray:
    places = places.astype(np.float32).astype(float)
    low = np.floor(places).astype(int)
    first, second = (table.take(np.minimum(low + k, table.shape[axis] - 1), axis) for k in (0, 1))
    share = np.expand_dims(places - low, [k for k in range(table.ndim) if k != axis])
    return (first + share * (second - first)).astype(np.float32)


class Rng(np.random.Generator):
    """NumPy's generator, and what objects are varied by."""

    def __init__(self, seed: int | Sequence[int]) -> None:
        """As `np.random.default_rng`."""
        super().__init__(np.random.PCG64(seed))

    def draw(self, low: float, high: float) -> float:
        """An even draw between two numbers."""
        return float(self.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True in that share of the draws."""
        return bool(self.random() < share)

    def pick(self, options: Sequence[T]) -> T:
        """One of the options, each as likely."""
        return options[int(self.integers(len(options)))]

    def colour(self, *palettes: str, spread: float = 12.0) -> Colour:
        """A colour of a random palette, each palette as likely, shifted a little."""
        return self.vary(self.pick(PALETTES[self.pick(palettes)]), spread)

    def vary(self, colour: Colour, spread: float = 12.0) -> Colour:
        """A colour near another: lighter or darker, and a little off in hue."""
        return rgb(np.array(colour) + self.normal(0, spread) + self.normal(0, spread / 3, 3))


def shade(colour: Colour, factor: float) -> Colour:
    """A colour times a factor."""
    return rgb(np.array(colour) * factor)


def rgb(values: np.ndarray | Sequence[float]) -> Colour:
    """Three numbers as a colour, clipped to 0-255."""
    red, green, blue = (int(value) for value in np.clip(np.asarray(values), 0, 255))
    return red, green, blue


Shader = Callable[[np.ndarray, np.ndarray, float], np.ndarray]
"""(u, v, width / height of the chart) -> index of the colour at each pixel, or (..., 3) colours."""


def pattern(colours: Sequence[Colour], shader: Shader) -> Paint:
    """Paint whose shader names a colour for each pixel."""
    table = np.array(colours, np.uint8)

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        # middles of pixels, v upwards
        u = (np.arange(width, dtype=np.float32) + 0.5)[None, :] / width
        v = 1 - (np.arange(height, dtype=np.float32) + 0.5)[:, None] / height
        index = np.broadcast_to(shader(u, v, width / height), (height, width))
        return Image.fromarray(table[index.astype(np.intp)])

    return paint


def bands(colours: Sequence[Colour], edges: Sequence[float] | np.ndarray) -> Paint:
    """Level bands from below, parted at the edges (v, 0-1)."""
    return pattern(colours, lambda u, v, aspect: np.searchsorted(np.asarray(edges), v) + 0 * u.astype(int))


def stripes(colours: Sequence[Colour], count: int, slant: float = 0.0) -> Paint:
    """Upright stripes, `count` of each colour round the chart; `slant` turns them into a spiral."""
    number = len(colours)
    return pattern(colours, lambda u, v, aspect: np.floor((u + slant * v) * count * number) % number)


def checks(colours: Sequence[Colour], count: int) -> Paint:
    """Squares in two colours."""

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        rows = max(1, round(count / aspect))
        return (np.floor(u * count) + np.floor(v * rows)) % 2

    return pattern(colours, shader)


def dots(ground: Colour, spots: Colour, count: int, size: float = 0.3) -> Paint:
    """A hexagonal pattern of dots, `count` to a row, `size` their radius as a share of their distance."""

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        y = v * count / aspect
        row = np.floor(y)
        # every other row is set off by half
        x = u * count + 0.5 * (row % 2)
        return np.hypot(x % 1 - 0.5, y % 1 - 0.5) < size

    return pattern([ground, spots], shader)


def scatter(rng: np.random.Generator, ground: Colour, spots: Sequence[Colour], count: int, size: float) -> Paint:
    """Round spots thrown at random, their radius about `size` of the chart's width."""
    # x, y and size
    places = rng.uniform((0, 0, 0.5), (1, 1, 1.4), (count, 3))
    which = rng.integers(1, len(spots) + 1, count)

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        index = np.zeros(np.broadcast_shapes(u.shape, v.shape), int)
        for (x, y, scale), colour in zip(places, which, strict=True):
            index[np.hypot(u - x, (v - y) / aspect) < size * scale] = colour
        return index

    return pattern([ground, *spots], shader)


def blotches(rng: np.random.Generator, colours: Sequence[Colour], cells: int = 5) -> Paint:
    """Irregular patches of each colour, as camouflage or glaze has them."""
    waves = rng.normal(0, cells, (len(colours), 6, 2))
    phases = rng.uniform(0, 2 * np.pi, (len(colours), 6))

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        # a sum of six waves for each colour; the highest sum owns the place
        turns = [[np.cos(2 * (a * u + b * v / aspect) + p) for (a, b), p in zip(waves[k], phases[k], strict=True)]
                 for k in range(len(colours))]  # fmt: skip
        return np.argmax([sum(terms) for terms in turns], axis=0)

    return pattern(colours, shader)


def wood_grain(rng: Rng, colour: Colour, along: str = "u") -> Paint:
    """Grain of two shades along the chart's width (`u`) or height (`v`)."""
    count, phase, wave = rng.draw(8, 20), rng.draw(0, 9), rng.draw(0.5, 2)
    tones = [shade(colour, factor) for factor in np.linspace(0.78, 1.06, 6)]

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        # rings of a tree: waves along the grain, bent by longer waves across
        near, far = (v, u) if along == "u" else (u, v)
        ring = np.sin(count * near + wave * np.sin(3 * far + phase) + 0.6 * np.sin(count * 3.1 * near + phase))
        return np.clip((ring + 1) * 3, 0, 5)

    return pattern(tones, shader)


def decorate(rng: Rng, ground: Colour, *accents: str) -> Paint:
    """The ground plain, or with a pattern that pots, cloths and toys have, in colours of the palettes."""
    accent, other = rng.colour(*accents), rng.colour(*accents)
    low, wide = rng.draw(0.15, 0.7), rng.draw(0.06, 0.25)
    kind = rng.pick(("plain", "plain", "band", "bands", "stripes", "dots", "checks", "scatter", "blotches", "dipped"))
    # makers, as most draw further numbers, which only the chosen kind may do
    makers: dict[str, Callable[[], Paint]] = {
        "plain": lambda: ground,
        "band": lambda: bands([ground, accent, ground], [low, low + wide]),
        "bands": lambda: bands([ground, accent, ground, other, ground], np.array([0, 0.3, 0.45, 0.8]) * wide * 2 + low),
        "stripes": lambda: stripes([ground, accent], int(rng.integers(6, 18)), rng.draw(-0.3, 0.3)),
        "dots": lambda: dots(ground, accent, int(rng.integers(8, 22)), rng.draw(0.18, 0.36)),
        "checks": lambda: checks([ground, accent], 2 * int(rng.integers(5, 12))),
        "scatter": lambda: scatter(rng, ground, [accent, other], 40, rng.draw(0.008, 0.02)),
        "blotches": lambda: blotches(rng, [ground, ground, accent], 7),
        "dipped": lambda: bands([accent, ground], [low]),
    }
    return makers[kind]()


def label(
    ground: Colour, paper: Colour, ink: Colour, text: str, centres: Sequence[float] = (0.5,), width: float = 0.34,
    height: tuple[float, float] = (0.1, 0.9),
) -> Paint:  # fmt: skip
    """Paper labels on a ground, at `centres` of the chart's width, with a word, a rule and small print."""

    def paint(wide: int, high: int, px_per_mm: float) -> Image.Image:
        image = Image.new("RGB", (wide, high), ground)
        canvas = ImageDraw.Draw(image)
        # pictures count downwards, heights upwards
        top, bottom = (1 - height[1]) * high, (1 - height[0]) * high
        tall, half = bottom - top, width * wide / 2
        for centre in centres:
            x = centre * wide
            canvas.rectangle((x - half, top, x + half, bottom), fill=paper)
            # without a word, or too low for words, the paper stays blank
            if not text or tall < 8:
                continue
            # as large as height and width of the paper allow
            size = min(0.4 * tall, 2.6 * half / len(text))
            canvas.text((x, top + 0.34 * tall), text, ink, read_font("sans", max(4, int(size))), anchor="mm")
            # three lines of small print: bars, as letters would be below a texel
            for at, share in ((0.62, 0.8), (0.74, 0.5), (0.86, 0.62)):
                y = top + at * tall
                canvas.rectangle((x - half * share, y, x + half * share, y + max(1, 0.03 * tall)), fill=ink)
        return image

    return paint


def lettered(ground: Colour, ink: Colour, text: str, share: float = 0.7) -> Paint:
    """A word or number in the middle of the chart, `share` of its height or width."""

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        image = Image.new("RGB", (width, height), ground)
        # as high as the chart or as wide as the letters need
        size = share * min(height, 1.5 * width / len(text))
        ImageDraw.Draw(image).text(
            (width / 2, height / 2), text, ink, read_font("sans", max(4, int(size))), anchor="mm"
        )
        return image

    return paint


def pick_word(rng: Rng) -> str:
    """A name that no brand has."""
    syllables = ("VE", "LO", "RI", "KA", "NO", "SU", "TE", "MO", "BA", "DI", "FA", "ZU")
    return "".join(rng.pick(syllables) for _ in range(2 + rng.chance(0.5)))
