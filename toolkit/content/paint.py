"""Brushes for painted textures: noise that repeats without a seam, stains, lettering, drawings in metres."""

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from PIL import Image, ImageDraw

from toolkit.imaging.fonts import read_font

Point = tuple[float, float]
Ink = tuple[int, ...]
"""A colour, sRGB; of three numbers."""


def noise(rng: np.random.Generator, shape: tuple[int, int], cells: tuple[int, int]) -> np.ndarray:
    """(h, w) float32 smooth noise of mean 0 and about ±1 with `cells` bumps down and across; repeats without a seam."""
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
"""How many noises of a kind are made; a texture takes one of them, moved at random: painting is mostly noise."""


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
    """(h, w, 3) float32 of one colour, 0 to 255."""
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
        width_m, height_m: its extent.
        px_per_m: of the kept picture.
        ground: its colour.
        low: metres at its lower left corner.
    """

    FINER = 2

    def __init__(self, width_m: float, height_m: float, px_per_m: float, ground: Ink, low: Point = (0.0, 0.0)) -> None:
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
        if fit_m and font.getlength(words) > fit_m * self.scale[0]:
            size = int(size * fit_m * self.scale[0] / font.getlength(words))
            font = read_font(face, max(5, size))
        self.draw.text(self.px([(x, y)])[0], words, _rgb(colour), font, anchor="mm")

    def texture(self, speckle: float = 0.0, rng: np.random.Generator | None = None) -> np.ndarray:
        """The kept picture, uint8, with a little grain if asked."""
        kept = np.asarray(self.image.reduce(self.FINER), np.float32)
        if rng is not None and speckle:
            h, w = kept.shape[:2]
            wide = (1024, 1024) if max(h, w) > 512 else (512, 512)
            cloud = fractal(rng, wide, 8, 3)[:h, :w, None]
            kept = kept * (1 + speckle * cloud) + grain(rng, (h, w), 60 * speckle)
        return finish(kept)
