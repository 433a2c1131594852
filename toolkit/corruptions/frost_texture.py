"""Frost on a window pane, drawn: feathers of ice crystals over a misted ground, as textures that repeat.

ImageNet-C and CIFAR-10-C add pieces of five photographs of frost. Those are not ours to give away, so these five panes
take their place, and results with frost are the toolkit's own. The panes are made to have the photographs' mean colour
and their contrast in a piece of 224 px; the figures in `PANES` are measured on the photographs. The spectrum of
luminance falls with frequency to the power of -1.7 to -2.0 here and -1.2 to -1.9 there. What does not agree is what
makes each photograph itself: where its crystals are, their shapes, its gradients of light.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

SIDE_PX = 640
MARGIN_PX = 160
BRANCH_ANGLE = np.deg2rad(52)
BRANCH_STEP_PX = 3.5
LINE_SHIFT = 3
"""OpenCV takes line ends in units of 2⁻³ px."""


@dataclass(frozen=True)
class Pane:
    """What one pane looks like.

    Attributes:
        mean: sRGB-encoded mean colour of the photograph that it stands for.
        contrast: standard deviation of luminance within 224 px of it.
        feathers: how many crystals grow.
        length_px: how long their needles are, shortest and longest.
        mist: share of smooth clouds against crystals.
    """

    mean: tuple[float, float, float]
    contrast: float
    feathers: int
    length_px: tuple[float, float]
    mist: float


PANES = (
    Pane((0.305, 0.585, 0.650), 0.062, 60, (30, 150), 0.8),
    Pane((0.787, 0.805, 0.841), 0.073, 420, (15, 90), 0.4),
    Pane((0.787, 0.805, 0.841), 0.073, 300, (30, 110), 0.4),
    Pane((0.540, 0.599, 0.648), 0.106, 700, (6, 40), 0.15),
    Pane((0.441, 0.484, 0.529), 0.145, 480, (12, 60), 0.5),
)


def draw_panes(scale: float = 1.0) -> np.ndarray:
    """(5, side, side, 3) float32 sRGB-encoded in [0, 1]; each repeats without a seam. `scale` shrinks them."""
    panes = _draw_all()
    if scale == 1:
        return panes
    # linear without a prefilter, as the published code shrinks its photographs
    return np.stack([cv2.resize(pane, (0, 0), fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR) for pane in panes])


@lru_cache(maxsize=1)
def _draw_all() -> np.ndarray:
    return np.stack([draw_pane(pane, np.random.default_rng([20190327, index])) for index, pane in enumerate(PANES)])


def draw_pane(pane: Pane, rng: np.random.Generator) -> np.ndarray:
    """(side, side, 3) float32 sRGB-encoded in [0, 1]."""
    feathers = grow_feathers(pane, rng)
    glow = _blur(feathers, 3) + _blur(feathers, 12)
    # lit from the upper left: the sides of the needles that face it are bright, the others dark
    relief = np.roll(feathers, (1, 1), (0, 1)) - np.roll(feathers, (-1, -1), (0, 1))
    grain = _blur(rng.standard_normal((SIDE_PX, SIDE_PX)).astype(np.float32), 0.8)
    ice = 0.9 * _standard(feathers) + 0.45 * _standard(glow) - 1.1 * _standard(relief) + 0.7 * _standard(grain)
    light = _standard(_standard(ice) + pane.mist * draw_mist(rng))
    tint = 0.15 * pane.mist * draw_mist(rng)
    # bright ice is whiter than the ground, and the ground's hue wanders a little
    spread = np.array([1.15, 1.0, 0.95]) * light[..., None] + np.array([1.0, -0.2, -0.4]) * tint[..., None]
    return np.clip(np.array(pane.mean) + pane.contrast * spread, 0, 1).astype(np.float32)


def grow_feathers(pane: Pane, rng: np.random.Generator) -> np.ndarray:
    """(side, side) float32: bright needles on black, each crystal a few needles from one point, with side branches."""
    canvas = np.zeros((SIDE_PX + 2 * MARGIN_PX,) * 2, np.uint8)
    for _ in range(pane.feathers):
        root = rng.uniform(0, SIDE_PX, 2) + MARGIN_PX
        count = rng.integers(3, 8)
        angles = rng.uniform(0, 2 * np.pi) + rng.uniform(0.5, 2 * np.pi) * np.arange(count) / count
        lengths = rng.uniform(*pane.length_px) * rng.uniform(0.5, 1, count)
        draw_crystal(canvas, root, angles, lengths, brightness=rng.uniform(60, 255), rng=rng)
    return _fold(canvas).astype(np.float32)


def draw_crystal(
    canvas: np.ndarray, root: np.ndarray, angles: np.ndarray, lengths_px: np.ndarray, *, brightness: float,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Needles from one point, a little bent, and their branches, which grow shorter towards the tip."""
    along = np.linspace(0, 1, max(3, int(lengths_px.max() / BRANCH_STEP_PX)))
    steps = lengths_px[:, None] * along
    turned = angles[:, None] + rng.normal(0, 0.004, (len(angles), 1)) * steps
    spines = root + np.cumsum(_point(turned), 1) * steps[:, 1, None, None]
    _draw_lines(canvas, spines, brightness)
    reach = 0.38 * (lengths_px[:, None] - steps) * rng.uniform(0.6, 1.1, steps.shape) * np.minimum(1, along / 0.2)
    for side in (-1, 1):
        tips = spines + reach[..., None] * _point(turned + side * BRANCH_ANGLE)
        _draw_lines(canvas, np.stack([spines, tips], 2).reshape(-1, 2, 2), 0.7 * brightness)


def _point(angles: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angles), np.sin(angles)], -1)


def _draw_lines(canvas: np.ndarray, lines: np.ndarray, brightness: float) -> None:
    fixed = np.round(lines * 2**LINE_SHIFT).astype(np.int32)
    cv2.polylines(canvas, list(fixed), False, float(brightness), 1, cv2.LINE_AA, LINE_SHIFT)


def _fold(canvas: np.ndarray) -> np.ndarray:
    """What crosses an edge comes in at the opposite one."""
    for _ in range(2):
        middle = canvas[MARGIN_PX:-MARGIN_PX].copy()
        np.maximum(middle[-MARGIN_PX:], canvas[:MARGIN_PX], out=middle[-MARGIN_PX:])
        np.maximum(middle[:MARGIN_PX], canvas[-MARGIN_PX:], out=middle[:MARGIN_PX])
        canvas = middle.T
    return canvas


def draw_mist(rng: np.random.Generator) -> np.ndarray:
    """(side, side) float32 clouds of mean 0 and deviation 1: noise whose spectrum falls as that of photographs does."""
    frequency = np.hypot(np.fft.fftfreq(SIDE_PX)[:, None], np.fft.rfftfreq(SIDE_PX))
    frequency[0, 0] = np.inf
    # amplitude over frequency, cut off below a few periods per pane so that no pane is all dark on one side
    shape = 1 / (frequency + 3 / SIDE_PX) ** 1.6
    noise = np.fft.rfft2(rng.standard_normal((SIDE_PX, SIDE_PX)))
    return _standard(np.fft.irfft2(noise * shape, (SIDE_PX, SIDE_PX))).astype(np.float32)


def _blur(plane: np.ndarray, sigma_px: float) -> np.ndarray:
    rim = int(4 * sigma_px + 1)
    wrapped = np.pad(plane, rim, mode="wrap")
    return cv2.GaussianBlur(wrapped, (0, 0), sigma_px)[rim:-rim, rim:-rim]


def _standard(plane: np.ndarray) -> np.ndarray:
    return (plane - plane.mean()) / plane.std()
