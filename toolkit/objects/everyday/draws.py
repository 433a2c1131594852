"""What chance decides: numbers from ranges, one of several, and colours from palettes of real things."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from toolkit.objects.modelling import Colour

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
