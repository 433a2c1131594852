"""What chance decides: numbers, choices and colours from palettes of real things, and patterns to paint on a part."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from PIL import Image, ImageDraw

from toolkit.content.modelling import Colour, Paint
from toolkit.imaging.fonts import read_font

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


def draw(rng: np.random.Generator, low: float, high: float) -> float:
    """An even draw between two numbers."""
    return float(rng.uniform(low, high))


def chance(rng: np.random.Generator, share: float) -> bool:
    """True in that share of the draws."""
    return bool(rng.random() < share)


def pick(rng: np.random.Generator, options: Sequence[T]) -> T:
    """One of the options, each as likely."""
    return options[int(rng.integers(len(options)))]


def pick_colour(rng: np.random.Generator, *palettes: str, spread: float = 12.0) -> Colour:
    """A colour of one of the palettes, each palette as likely, shifted a little."""
    return vary(rng, pick(rng, PALETTES[pick(rng, palettes)]), spread)


def vary(rng: np.random.Generator, colour: Colour, spread: float = 12.0) -> Colour:
    """A colour near another: lighter or darker, and a little off in hue."""
    shifted = np.array(colour) + rng.normal(0, spread) + rng.normal(0, spread / 3, 3)
    return rgb(shifted)


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
    """Paint whose shader names, for each pixel, one of the colours."""
    table = np.array(colours, np.uint8)

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
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
        x = u * count + 0.5 * (row % 2)
        return np.hypot(x % 1 - 0.5, y % 1 - 0.5) < size

    return pattern([ground, spots], shader)


def scatter(rng: np.random.Generator, ground: Colour, spots: Sequence[Colour], count: int, size: float) -> Paint:
    """Round spots thrown at random, their radius about `size` of the chart's width."""
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
        turns = [[np.cos(2 * (a * u + b * v / aspect) + p) for (a, b), p in zip(waves[k], phases[k], strict=True)]
                 for k in range(len(colours))]  # fmt: skip
        return np.argmax([sum(terms) for terms in turns], axis=0)

    return pattern(colours, shader)


def wood_grain(rng: np.random.Generator, colour: Colour, along: str = "u") -> Paint:
    """Grain of two shades along the chart's width (`u`) or height (`v`)."""
    count, phase, wave = draw(rng, 8, 20), draw(rng, 0, 9), draw(rng, 0.5, 2)
    tones = [shade(colour, factor) for factor in np.linspace(0.78, 1.06, 6)]

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        near, far = (v, u) if along == "u" else (u, v)
        ring = np.sin(count * near + wave * np.sin(3 * far + phase) + 0.6 * np.sin(count * 3.1 * near + phase))
        return np.clip((ring + 1) * 3, 0, 5)

    return pattern(tones, shader)


def decorate(rng: np.random.Generator, ground: Colour, *accents: str) -> Paint:
    """The ground plain, or with one of the patterns that pots, cloths and toys have, in colours of the palettes."""
    accent, other = pick_colour(rng, *accents), pick_colour(rng, *accents)
    low, wide = draw(rng, 0.15, 0.7), draw(rng, 0.06, 0.25)
    kind = pick(rng, ("plain", "plain", "band", "bands", "stripes", "dots", "checks", "scatter", "blotches", "dipped"))
    makers: dict[str, Callable[[], Paint]] = {
        "plain": lambda: ground,
        "band": lambda: bands([ground, accent, ground], [low, low + wide]),
        "bands": lambda: bands([ground, accent, ground, other, ground], np.array([0, 0.3, 0.45, 0.8]) * wide * 2 + low),
        "stripes": lambda: stripes([ground, accent], int(rng.integers(6, 18)), draw(rng, -0.3, 0.3)),
        "dots": lambda: dots(ground, accent, int(rng.integers(8, 22)), draw(rng, 0.18, 0.36)),
        "checks": lambda: checks([ground, accent], 2 * int(rng.integers(5, 12))),
        "scatter": lambda: scatter(rng, ground, [accent, other], 40, draw(rng, 0.008, 0.02)),
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
        top, bottom = (1 - height[1]) * high, (1 - height[0]) * high
        tall, half = bottom - top, width * wide / 2
        for centre in centres:
            x = centre * wide
            canvas.rectangle((x - half, top, x + half, bottom), fill=paper)
            if not text or tall < 8:
                continue
            size = min(0.4 * tall, 2.6 * half / len(text))
            canvas.text((x, top + 0.34 * tall), text, ink, read_font("sans", max(4, int(size))), anchor="mm")
            for at, share in ((0.62, 0.8), (0.74, 0.5), (0.86, 0.62)):
                y = top + at * tall
                canvas.rectangle((x - half * share, y, x + half * share, y + max(1, 0.03 * tall)), fill=ink)
        return image

    return paint


def lettered(ground: Colour, ink: Colour, text: str, share: float = 0.7) -> Paint:
    """A word or number in the middle of the chart, `share` of its height or width."""

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        image = Image.new("RGB", (width, height), ground)
        size = share * min(height, 1.5 * width / len(text))
        ImageDraw.Draw(image).text(
            (width / 2, height / 2), text, ink, read_font("sans", max(4, int(size))), anchor="mm"
        )
        return image

    return paint


def pick_word(rng: np.random.Generator) -> str:
    """A name that no brand has."""
    syllables = ("VE", "LO", "RI", "KA", "NO", "SU", "TE", "MO", "BA", "DI", "FA", "ZU")
    return "".join(pick(rng, syllables) for _ in range(2 + chance(rng, 0.5)))
