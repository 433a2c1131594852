"""Weather: snow, frost, fog, brightness and spatter."""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import torch

from toolkit.core.draws import RandomStreams
from toolkit.corruptions.blur import blur_along, blur_gaussian, fill_by_zoom

FIRST_WIBBLE = 100.0


def draw_clouds(side_px: int, decay: float, draws: RandomStreams) -> torch.Tensor:
    """(b, side, side) float32 clouds that fill [0, 1]; `side_px` is a power of two, a larger `decay` is smoother.

    Points halfway between known points get their mean and a uniform random shift, whose bound falls with every halving:
    by the square of `decay`, as published.
    """
    shifts = draws.uniform(side_px**2 - 1).mul_(2).sub_(1)
    clouds = torch.zeros(len(shifts), side_px, side_px, device=shifts.device)
    # the diamond-square algorithm: middles of squares from corners, then middles of edges from both
    step, bound, used = side_px, FIRST_WIBBLE**2, 0

    def settle(total: torch.Tensor) -> torch.Tensor:
        nonlocal used
        count = total.shape[1] ** 2
        shift = shifts[:, used : used + count].reshape(total.shape)
        used += count
        # the mean of four neighbours and a shift, whose bound falls by decay² with each finer step
        return total / 4 + bound * shift

    while step >= 2:
        half = step // 2
        corners = clouds[:, ::step, ::step]
        # the plane wraps round: the neighbour beyond an edge is the texel at the other
        pairs = corners + corners.roll(-1, 1)
        middles = settle(pairs + pairs.roll(-1, 2))
        clouds[:, half::step, half::step] = middles
        clouds[:, ::step, half::step] = settle(middles + middles.roll(1, 1) + corners + corners.roll(-1, 2))
        clouds[:, half::step, ::step] = settle(middles + middles.roll(1, 2) + corners + corners.roll(-1, 1))
        step, bound = half, bound / decay**2
    # the published script stretches the plane to [0, 1] as well
    low = clouds.amin((1, 2), keepdim=True)
    return (clouds - low) / (clouds.amax((1, 2), keepdim=True) - low)


SIDE_PX = 640
MARGIN_PX = 160
BRANCH_ANGLE = np.deg2rad(52)
BRANCH_STEP_PX = 3.5
LINE_SHIFT = 3
"""OpenCV takes line ends in units of 2⁻³ px."""


@dataclass(frozen=True)
class Pane:
    """Look of a pane of frost.

    Attributes:
        mean: sRGB-encoded mean colour of the published photograph.
        contrast: its standard deviation of luminance within 224 px.
        feathers: number of crystals.
        length_px: shortest and longest needle.
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
"""Feathers of ice crystals over mist, in place of the five photographs of frost of ImageNet-C, which are not free.

Mean colours and contrasts are measured on the photographs. The luminance's spectrum falls with frequency to the power
of about -1.8, there about -1.6. Places and shapes of crystals differ, so results with frost are the toolkit's own.
"""


@lru_cache(maxsize=4)
def draw_panes(scale: float = 1.0) -> np.ndarray:
    """(5, side, side, 3) float32 sRGB-encoded panes, which repeat without a seam; `scale` shrinks them."""
    if scale != 1:
        # linear without a prefilter, as the published code shrinks its photographs
        panes, how = draw_panes(), cv2.INTER_LINEAR
        return np.stack([cv2.resize(pane, (0, 0), fx=scale, fy=scale, interpolation=how) for pane in panes])
    return np.stack([draw_pane(pane, np.random.default_rng([20190327, index])) for index, pane in enumerate(PANES)])


def draw_pane(pane: Pane, rng: np.random.Generator) -> np.ndarray:
    """(side, side, 3) float32 sRGB-encoded in [0, 1]."""
    feathers = grow_feathers(pane, rng)
    glow = _blur_pane(feathers, 3) + _blur_pane(feathers, 12)
    # lit from the upper left: a difference along the diagonal is the slope towards the light
    relief = np.roll(feathers, (1, 1), (0, 1)) - np.roll(feathers, (-1, -1), (0, 1))
    grain = _blur_pane(rng.standard_normal((SIDE_PX, SIDE_PX)).astype(np.float32), 0.8)
    ice = 0.9 * _standard(feathers) + 0.45 * _standard(glow) - 1.1 * _standard(relief) + 0.7 * _standard(grain)
    light = _standard(_standard(ice) + pane.mist * draw_mist(rng))
    tint = 0.15 * pane.mist * draw_mist(rng)
    # bright ice is whiter than the ground, and the ground's hue wanders a little
    spread = np.array([1.15, 1.0, 0.95]) * light[..., None] + np.array([1.0, -0.2, -0.4]) * tint[..., None]
    return np.clip(np.array(pane.mean) + pane.contrast * spread, 0, 1).astype(np.float32)


def grow_feathers(pane: Pane, rng: np.random.Generator) -> np.ndarray:
    """(side, side) float32: bright needles on black, each crystal a few needles from a point, with side branches."""
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
    """Needles from a point, a little bent, and their branches, which grow shorter towards the tip."""
    along = np.linspace(0, 1, max(3, int(lengths_px.max() / BRANCH_STEP_PX)))
    steps = lengths_px[:, None] * along
    turned = angles[:, None] + rng.normal(0, 0.004, (len(angles), 1)) * steps
    # small steps of equal length, each in the direction reached so far
    spines = root + np.cumsum(_point(turned), 1) * steps[:, 1, None, None]
    _draw_lines(canvas, spines, brightness)
    # branches grow longest near the root, but for its first fifth, and not at all at the tip
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
    """Wrap the margins to the opposite edges."""
    for _ in range(2):
        middle = canvas[MARGIN_PX:-MARGIN_PX].copy()
        np.maximum(middle[-MARGIN_PX:], canvas[:MARGIN_PX], out=middle[-MARGIN_PX:])
        np.maximum(middle[:MARGIN_PX], canvas[-MARGIN_PX:], out=middle[:MARGIN_PX])
        # transposed: the second round folds the other axis, and turns the picture back
        canvas = middle.T
    return canvas


def draw_mist(rng: np.random.Generator) -> np.ndarray:
    """(side, side) float32 clouds of mean 0 and deviation 1: noise with the spectrum of photographs."""
    frequency = np.hypot(np.fft.fftfreq(SIDE_PX)[:, None], np.fft.rfftfreq(SIDE_PX))
    # the mean is left out
    frequency[0, 0] = np.inf
    # amplitude over frequency, cut off below a few periods per pane so that no side of a pane is dark
    shape = 1 / (frequency + 3 / SIDE_PX) ** 1.6
    noise = np.fft.rfft2(rng.standard_normal((SIDE_PX, SIDE_PX)))
    return _standard(np.fft.irfft2(noise * shape, (SIDE_PX, SIDE_PX))).astype(np.float32)


def _blur_pane(plane: np.ndarray, sigma_px: float) -> np.ndarray:
    rim = int(4 * sigma_px + 1)
    # the pane repeats without a seam, and so must its blur
    wrapped = np.pad(plane, rim, mode="wrap")
    return cv2.GaussianBlur(wrapped, (0, 0), sigma_px)[rim:-rim, rim:-rim]


def _standard(plane: np.ndarray) -> np.ndarray:
    return (plane - plane.mean()) / plane.std()


@lru_cache(maxsize=4)
def _panes_on(device: torch.device, scale: float) -> torch.Tensor:
    """(panes, 3, side, side) float32."""
    return torch.from_numpy(draw_panes(scale)).permute(0, 3, 1, 2).contiguous().to(device)


def cut_frost(height: int, width: int, scale: float, draws: RandomStreams) -> list[torch.Tensor]:
    """Return a (3, height, width) float32 sRGB-encoded piece for each image, not to be written into.

    A pane smaller than the piece repeats. The published `scale` is 1 for photographs, 0.2 for CIFAR's images.
    """
    panes = _panes_on(draws.device, scale)
    pieces = []
    # which pane, and where in it, as shares: panes may have any size
    for which, *corner in draws.uniform(3).tolist():
        piece = panes[int(which * len(panes))]
        for axis, (start, length) in enumerate(zip(corner, (height, width), strict=True), 1):
            side = piece.shape[axis]
            if length <= side:
                # a view, no copy
                piece = piece.narrow(axis, int(start * (side - length + 1)), length)
            else:
                places = torch.arange(length, device=piece.device) + int(start * side)
                piece = piece.index_select(axis, places % side)
        pieces.append(piece)
    return pieces


# pale turquoise, and the mud of the published script
WATER = (175 / 255, 238 / 255, 238 / 255)
MUD = (63 / 255, 42 / 255, 20 / 255)
# as in the published script, which takes OpenCV's Canny and distance transform too
EMBOSS = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], np.float32)
MAX_DISTANCE_PX = 20
CANNY_THRESHOLDS = (50, 150)
LEAST_MUD = 0.8


def add_spatter(images: torch.Tensor, shape: tuple[float, ...], draws: RandomStreams) -> torch.Tensor:
    """Splash water, which adds light, or mud, which covers.

    `shape` is mean and deviation of the noise, the sigma of its blur in px, and the threshold of a drop. Then follow
    water's strength, or the sigma of the mud's blur in px, and 0 for water or 1 for mud.
    """
    mean, deviation, sigma_px, threshold, strength, is_mud = shape
    # a layer of drops for all channels together
    noise = draws.normal(1, *images.shape[-2:]) * deviation + mean
    liquid = blur_gaussian(noise, sigma_px)
    colour = torch.tensor(MUD if is_mud else WATER, device=images.device)[:, None, None]
    if is_mud:
        # edges are softened, and cut off again where they are thin
        cover = blur_gaussian((liquid > threshold).float(), strength)
        cover = torch.where(cover < LEAST_MUD, 0.0, cover)
        return torch.lerp(images, colour, cover)
    wet = torch.where(liquid < threshold, 0.0, liquid)
    return shade_drops(wet).mul_(strength) * colour + images


def shade_drops(wet: torch.Tensor) -> torch.Tensor:
    """(b, 1, h, w) of liquid, 0 where there is none, to the light that it adds, the brightest 1; on the same device."""
    # the published cast: truncated, and from 256 upwards beginning again
    layers = (wet * 255).to(torch.int32).to(torch.uint8).cpu().numpy()
    return torch.from_numpy(np.stack([_shade_layer(layer) for layer in layers[:, 0]]))[:, None].to(wet.device)


def _shade_layer(layer: np.ndarray) -> np.ndarray:
    # step by step as published: edges, distance to them, equalised, embossed
    distance = cv2.distanceTransform(255 - cv2.Canny(layer, *CANNY_THRESHOLDS), cv2.DIST_L2, 5)
    distance = cv2.blur(np.minimum(distance, MAX_DISTANCE_PX), (3, 3)).astype(np.uint8)
    relief = cv2.filter2D(cv2.equalizeHist(distance), cv2.CV_8U, EMBOSS)
    light = layer * cv2.blur(relief, (3, 3)).astype(np.float32)
    brightest = light.max()
    return light / brightest if brightest > 0 else light  # an image may have no drop at all


# of ITU-R BT.601, as OpenCV's conversion to grey
LUMA = (0.299, 0.587, 0.114)
SNOW_ANGLES_DEG = (-135.0, -45.0)


def add_snow(images: torch.Tensor, shape: tuple[float, ...], draws: RandomStreams) -> torch.Tensor:
    """Whiten the image and add flakes, once as they are and once turned by 180°.

    `shape` is mean and deviation of the noise, its enlargement, and the threshold of a flake. Then follow radius and
    sigma of its motion blur in px, and the share of the image that is not whitened.
    """
    mean, deviation, zoom, threshold, radius_px, sigma_px, kept = shape
    height, width = images.shape[-2:]
    noise = draws.normal(1, math.ceil(height / zoom), math.ceil(width / zoom)) * deviation + mean
    flakes = fill_by_zoom(noise, zoom, height, width)
    # only the brightest of the enlarged noise are flakes
    flakes = torch.where(flakes < threshold, 0.0, flakes).clamp_(0, 1)
    low, high = SNOW_ANGLES_DEG
    flakes = blur_along(flakes, radius_px, sigma_px, draws.uniform() * (high - low) + low)
    # the published 1.5 × grey + 0.5: dark places become as grey as snow in shade
    red, green, blue = images.unbind(1)
    grey = (red * LUMA[0]).add_(green, alpha=LUMA[1]).add_(blue, alpha=LUMA[2])[:, None]
    whitened = torch.maximum(images, grey.mul_(1.5).add_(0.5))
    return torch.lerp(whitened, images, kept).add_(flakes + flakes.flip(2, 3))


def add_frost(images: torch.Tensor, shares: tuple[float, float, float], draws: RandomStreams) -> torch.Tensor:
    """Add a random piece of a frosted pane; `shares` of the image and of the frost, and the texture's scale.

    The texture is the toolkit's own (see `PANES`): the published images have photographs of frost there.
    """
    kept, added, scale = shares
    height, width = images.shape[-2:]
    frosted = images * kept
    for number, piece in enumerate(cut_frost(height, width, scale, draws)):
        frosted[number].add_(piece, alpha=added)
    return frosted


def add_fog(images: torch.Tensor, shape: tuple[float, float], draws: RandomStreams) -> torch.Tensor:
    """Add clouds, and dim so that the brightest value stays; `shape` is the clouds' strength and smoothness."""
    strength, decay = shape
    height, width = images.shape[-2:]
    # diamond-square makes squares whose side is a power of two; the image is a corner of that square
    side_px = 1 << (max(height, width) - 1).bit_length()
    clouds = draw_clouds(side_px, decay, draws)[:, None, :height, :width]
    brightest = images.amax((1, 2, 3), keepdim=True)
    # as published: with a cloud of 1 over it the brightest value keeps its place
    return (images + strength * clouds).mul_(brightest / (brightest + strength))


def brighten(images: torch.Tensor, amount: float, draws: RandomStreams) -> torch.Tensor:
    """Add `amount` to the V of HSV, at most to 1. Hue and saturation stay: all three channels grow alike."""
    value = images.amax(1, keepdim=True)
    # V of HSV is the largest channel; the ratio moves all three, so that H and S stay
    brighter = (value + amount).clamp_(max=1)
    return torch.where(value > 0, images * (brighter / value.clamp(min=1e-12)), brighter)
