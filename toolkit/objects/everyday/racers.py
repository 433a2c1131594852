"""Racing cars of other builds than the shipped one: an open-wheeler, a cigar of the sixties, a Le Mans prototype."""

import numpy as np

from toolkit.objects.everyday.cars import GLASS, LAMP, RUBBER, wheels
from toolkit.objects.everyday.draws import chance, draw, pick, pick_colour
from toolkit.objects.everyday.paints import lettered, pattern
from toolkit.objects.everyday.shapes import (
    ball,
    block,
    cylinder,
    disc,
    finish,
    hull,
    mirrored,
    moved,
    picture,
    rod,
    slab,
    turned,
    wing,
)
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Colour, Paint, Part


def make_racer(rng: np.random.Generator) -> Mesh:
    """An open-wheeler with wings, a wingless cigar, or a low closed-wheel prototype with a tail wing; all numbered."""
    return finish(pick(rng, (_open_wheeler, _open_wheeler, _cigar, _prototype))(rng), 512)


def _livery(rng: np.random.Generator) -> tuple[Paint, Colour, Colour]:
    """Paint of a hull (u around from the left over the top, v forward), its main colour and the other."""
    main, other = pick_colour(rng, "bright", "car"), pick_colour(rng, "bright", "pale", "dark")
    kind, wide, at = (
        pick(rng, ("plain", "centre", "nose", "halves", "slash")),
        draw(rng, 0.04, 0.09),
        draw(rng, 0.6, 0.85),
    )

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        if kind == "centre":
            return (np.abs(np.abs(u - 0.25) - 0.5 * wide) < 0.4 * wide) & (v >= 0)
        if kind == "nose":
            return (v > at) & (u >= 0)
        if kind == "halves":
            return (np.sin(2 * np.pi * u) < 0) & (v >= 0)
        if kind == "slash":
            return np.abs(v - 0.5 - 0.3 * np.sin(2 * np.pi * u)) < wide
        return (u < 0) & (v < 0)

    return pattern([main, other], shader), main, other


def _number(rng: np.random.Generator) -> Paint:
    ground, ink = pick(
        rng, (((246, 246, 242), (20, 20, 22)), ((20, 20, 22), (250, 220, 50)), ((250, 220, 50), (20, 20, 22)))
    )
    return lettered(ground, ink, str(int(rng.integers(1, 99))), 0.85)


def _helmet(rng: np.random.Generator, x: float, z: float, radius: float = 10.0) -> list[Part]:
    shell = ball(radius, pick_colour(rng, "bright", "pale"), "paint", 18, 10).moved(x, 0, z)
    return [shell, ball(radius * 0.96, GLASS, "glass", 14, 8, (0.6, 0.9, 0.36)).moved(x + radius * 0.5, 0, z + 1)]


def _arms(joints: list[tuple[float, float, float, float]], z: float) -> list[Part]:
    """Wishbones from the hull out to each wheel: (x, inner y, outer y, spread)."""
    parts = []
    for x, inner, outer, spread in joints:
        for height in (z - 7, z + 7):
            for side in (-1, 1):
                parts += rod(
                    [(x + side * spread, inner, height), (x, outer, height)], 1.5, (34, 34, 38), "metal", segments=6
                )
    return mirrored(parts)


def _open_wheeler(rng: np.random.Generator) -> list[Part]:
    paint, main, other = _livery(rng)
    wide, front, rear = draw(rng, 34, 44), draw(rng, 74, 88), draw(rng, -96, -84)
    tyre = draw(rng, 22, 27)
    body = hull([(-112, 16, 14, 24, 2.6), (-70, wide, 30, 24, 3), (-20, wide * 1.1, 34, 23, 3.4),
                 (30, wide * 0.9, 30, 22, 3),
                 (80, wide * 0.6, 20, 18, 2.6), (126, 12, 10, 15, 2.2)], paint)  # fmt: skip
    pod = hull([(-74, 8, 16, 18, 3), (-40, 26, 26, 18, 4), (8, 28, 26, 18, 4), (24, 24, 22, 18, 4)], paint, count=10)
    mouth = block((1, 18, 15), (24.6, 0, 18), (16, 16, 18))
    airbox = hull([(-84, 4, 6, 38, 2), (-46, 14, 22, 44, 2.4), (-20, 16, 24, 50, 2.4)], main, count=8, around=16)
    parts = [*body, *mirrored(moved([*pod, *mouth], y=wide * 0.5 + 10)), *airbox]
    parts += [ball(1, (18, 18, 20), "plastic", 18, 6, (24, 13, 3)).moved(6, 0, 38), *_helmet(rng, -2, 47)]
    half = draw(rng, 58, 66)
    share = pick(rng, (0, 5, 6))
    parts += wheels(
        [(front, half - 8, tyre, 20), (rear, half - 12, tyre + 3, 28)], pick_colour(rng, "steel", "bright"), share
    )
    parts += _arms([(front, wide * 0.25, half - 14, 12), (rear, wide * 0.3, half - 20, 12)], tyre)
    parts += block((22, draw(rng, 100, 124), 3), (124, 0, 10), other, "paint", 1)
    parts += mirrored(slab([(108, 6), (136, 6), (136, 18), (108, 24)], 2, main, "paint", 58))
    high = draw(rng, 58, 76)
    for z, pitch in ((high, 8), (high + 9, 24))[: pick(rng, (1, 2))]:
        parts += moved(turned(block((28, 96, 3), (0, 0, 0), other, "paint", 1), "y", pitch), -120, 0, z)
    parts += mirrored(
        slab([(-136, high - 16), (-104, high - 14), (-104, high + 12), (-136, high + 14)], 2.4, main, "paint", 48)
    )
    parts += mirrored(slab([(-122, 24), (-114, 24), (-114, high), (-122, high)], 2, (40, 40, 44), "paint", 6))
    parts += moved(turned(block((20, 16, 0.8), (0, 0, 0), _number(rng)), "y", 12), 84, 0, 29)
    if chance(rng, 0.5):
        halo = [(-14, 16, 44), (10, 16, 56), (26, 0, 58), (10, -16, 56), (-14, -16, 44)]
        parts += [*rod(halo, 1.8, (30, 30, 32), "metal"), *rod([(26, 0, 58), (36, 0, 36)], 1.6, (30, 30, 32), "metal")]
    return parts


def _cigar(rng: np.random.Generator) -> list[Part]:
    """A slim rounded hull on thin spoked wheels, a driver in the open, exhausts behind."""
    paint, main, _ = _livery(rng)
    wide, tyre, half = draw(rng, 40, 50), draw(rng, 28, 33), draw(rng, 54, 64)
    body = hull([(-128, 8, 8, 34, 2), (-90, wide * 0.72, wide * 0.7, 32, 2), (-20, wide, wide * 0.95, 30, 2.2),
                 (60, wide * 0.85, wide * 0.72, 30, 2.2), (110, wide * 0.62, wide * 0.5, 29, 2),
                 (124, wide * 0.44, wide * 0.34, 29, 2)],
                paint)  # fmt: skip
    grille = turned(cylinder(wide * 0.18, 122, 125, (20, 20, 22), "metal", 20), "y", 90)
    parts = [
        *body,
        *moved(grille, z=29),
        ball(1, (26, 22, 20), "plastic", 18, 6, (26, 15, 4)).moved(-24, 0, 30 + wide * 0.46),
    ]
    parts += [*_helmet(rng, -34, 62), ball(1, (150, 170, 180), "glass", 16, 8, (6, 15, 12)).moved(2, 0, 52)]
    parts += hull([(-74, 5, 8, 54, 2), (-46, 16, 26, 52, 2.2)], main, count=4, around=14)
    parts += wheels(
        [(82, half, tyre - 2, 14), (-84, half, tyre, 18)], pick_colour(rng, "steel"), int(rng.integers(12, 20)), 0.76
    )
    parts += _arms([(82, wide * 0.3, half, 14), (-84, wide * 0.3, half, 14)], tyre)
    for y in (1, -1):
        pipe = [(-10, y * wide * 0.5, 30), (-60, y * (wide * 0.5 + 4), 28), (-132, y * (wide * 0.4), 28)]
        parts += rod(pipe, 3.4, (176, 172, 164), "metal")
    roundel = moved([disc(13, 0, _number(rng), "paint", 20)], 60, 0, 31 + wide * 0.36)
    number = _number(rng)
    sides = [picture(24, 20, number).rotated("z", side * 90).moved(-50, side * wide * 0.5, 34) for side in (1, -1)]
    return [*parts, *roundel, *sides]


def _prototype(rng: np.random.Generator) -> list[Part]:
    """A low wedge with covered wheels, a bubble of glass and a wing as wide as the car."""
    paint, main, other = _livery(rng)
    wide, tyre = draw(rng, 108, 122), draw(rng, 21, 25)
    body = hull([(-126, wide * 0.9, 22, 24, 5), (-80, wide, 32, 23, 5), (0, wide * 0.96, 26, 20, 5),
                 (70, wide, 26, 19, 5),
                 (110, wide * 0.96, 16, 14, 5), (134, wide * 0.7, 6, 9, 4)], paint, around=32)  # fmt: skip
    arches = mirrored(
        [ball(1, main, "paint", 20, 8, (36, 13, 21)).moved(x, wide * 0.5 - 13, tyre * 0.9) for x in (80, -82)]
    )
    cabin = ball(1, GLASS, "glass", 22, 10, (44, 24, 24)).moved(4, 0, 32)
    spine = hull([(-118, 6, 8, 36, 2), (-60, 26, 22, 38, 2.4), (-4, 34, 26, 42, 2.6)], main, count=10, around=20)
    parts = [*body, *arches, cabin, *spine]
    parts += wheels(
        [(80, wide * 0.5 - 7, tyre, 18), (-82, wide * 0.5 - 7, tyre, 20)], pick_colour(rng, "steel", "brass"), 5
    )
    high = draw(rng, 56, 70)
    parts += moved(turned(block((26, wide, 3), (0, 0, 0), other, "paint", 1), "y", 8), -122, 0, high)
    parts += mirrored(
        slab([(-138, high - 14), (-106, high - 14), (-106, high + 6), (-138, high + 8)], 2.4, main, "paint", wide / 2)
    )
    parts += mirrored(slab([(-126, 30), (-116, 30), (-116, high), (-126, high)], 2, RUBBER, "paint", 18))
    parts += mirrored(block((10, 18, 6), (112, wide * 0.34, 19), LAMP, "glass", 2))
    parts += moved(turned(block((34, 34, 0.8), (0, 0, 0), _number(rng)), "y", 9), 88, 0, 31.5)
    number = _number(rng)
    parts += [picture(32, 18, number).rotated("z", side * 90).moved(-6, side * wide * 0.495, 21) for side in (1, -1)]
    fin = wing((-40, 0, 46), (-96, 0, draw(rng, 66, 78)), (76, 26), 2.4, main, upright=True) if chance(rng, 0.5) else []
    return [*parts, *fin]
