"""Weather: snow, frost, fog, brightness and spatter."""

import math
from functools import lru_cache

import cv2
import numpy as np
import torch

from toolkit.corruptions.blur import blur_along, fill_by_zoom
from toolkit.corruptions.draws import RandomStreams
from toolkit.corruptions.filters import blur_gaussian
from toolkit.corruptions.frost_texture import draw_panes

FIRST_WIBBLE = 100.0


def draw_clouds(side_px: int, decay: float, draws: RandomStreams) -> torch.Tensor:
    """(b, side, side) float32 in [0, 1], 0 and 1 both reached.

    Points half-way between known ones get their mean and a uniform random shift, whose bound falls with every halving.
    The published code multiplies its bound by itself, so that the shift falls with the square of `decay`; so it does
    here.

    Args:
        side_px: a power of two.
        decay: larger is smoother.
        draws: one stream per image.
    """
    shifts = draws.uniform(side_px**2 - 1).mul_(2).sub_(1)
    clouds = torch.zeros(len(shifts), side_px, side_px, device=shifts.device)
    step, bound, used = side_px, FIRST_WIBBLE**2, 0

    def settle(total: torch.Tensor) -> torch.Tensor:
        nonlocal used
        count = total.shape[1] ** 2
        shift = shifts[:, used : used + count].reshape(total.shape)
        used += count
        return total / 4 + bound * shift

    while step >= 2:
        half = step // 2
        corners = clouds[:, ::step, ::step]
        pairs = corners + corners.roll(-1, 1)
        middles = settle(pairs + pairs.roll(-1, 2))
        clouds[:, half::step, half::step] = middles
        clouds[:, ::step, half::step] = settle(middles + middles.roll(1, 1) + corners + corners.roll(-1, 2))
        clouds[:, half::step, ::step] = settle(middles + middles.roll(1, 2) + corners + corners.roll(-1, 1))
        step, bound = half, bound / decay**2
    low = clouds.amin((1, 2), keepdim=True)
    return (clouds - low) / (clouds.amax((1, 2), keepdim=True) - low)


@lru_cache(maxsize=4)
def _panes_on(device: torch.device, scale: float) -> torch.Tensor:
    """(panes, 3, side, side) float32."""
    return torch.from_numpy(draw_panes(scale)).permute(0, 3, 1, 2).contiguous().to(device)


def cut_frost(height: int, width: int, scale: float, draws: RandomStreams) -> list[torch.Tensor]:
    """One (3, height, width) float32 sRGB-encoded piece per image, not to be written into.

    Args:
        height: of the piece, px.
        width: of the piece, px.
        scale: of the texture: 1 for photographs, 0.2 for CIFAR's images, as published.
        draws: one stream per image: which pane, and where on it. A pane smaller than the piece repeats.
    """
    panes = _panes_on(draws.device, scale)
    pieces = []
    for which, *corner in draws.uniform(3).tolist():
        piece = panes[int(which * len(panes))]
        for axis, (start, length) in enumerate(zip(corner, (height, width), strict=True), 1):
            side = piece.shape[axis]
            if length <= side:
                piece = piece.narrow(axis, int(start * (side - length + 1)), length)
            else:
                places = torch.arange(length, device=piece.device) + int(start * side)
                piece = piece.index_select(axis, places % side)
        pieces.append(piece)
    return pieces


WATER = (175 / 255, 238 / 255, 238 / 255)
MUD = (63 / 255, 42 / 255, 20 / 255)
EMBOSS = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], np.float32)
MAX_DISTANCE_PX = 20
CANNY_THRESHOLDS = (50, 150)
LEAST_MUD = 0.8


def add_spatter(images: torch.Tensor, shape: tuple[float, ...], draws: RandomStreams) -> torch.Tensor:
    """Splash water, which adds light, or mud, which covers.

    Args:
        images: (b, 3, h, w).
        shape: mean and deviation of the noise that becomes drops, the sigma of its blur in px, the threshold of a drop,
            the strength of water or the sigma of the mud's blur in px, and 0 for water, 1 for mud.
        draws: one stream per image.
    """
    mean, deviation, sigma_px, threshold, strength, is_mud = shape
    noise = draws.normal(1, *images.shape[-2:]) * deviation + mean
    liquid = blur_gaussian(noise, sigma_px)
    colour = torch.tensor(MUD if is_mud else WATER, device=images.device)[:, None, None]
    if is_mud:
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
    distance = cv2.distanceTransform(255 - cv2.Canny(layer, *CANNY_THRESHOLDS), cv2.DIST_L2, 5)
    distance = cv2.blur(np.minimum(distance, MAX_DISTANCE_PX), (3, 3)).astype(np.uint8)
    relief = cv2.filter2D(cv2.equalizeHist(distance), cv2.CV_8U, EMBOSS)
    light = layer * cv2.blur(relief, (3, 3)).astype(np.float32)
    brightest = light.max()
    return light / brightest if brightest > 0 else light  # an image may have no drop at all


LUMA = (0.299, 0.587, 0.114)
SNOW_ANGLES_DEG = (-135.0, -45.0)


def add_snow(images: torch.Tensor, shape: tuple[float, ...], draws: RandomStreams) -> torch.Tensor:
    """Whiten the image and let flakes fall over it, once as they are and once turned by 180°.

    Args:
        images: (b, 3, h, w).
        shape: mean and deviation of the noise that becomes flakes, its enlargement, the threshold of a flake, radius
            and sigma of its motion blur in px, and the share of the image that is not whitened.
        draws: one stream per image. Only the noise that stays in view is drawn.
    """
    mean, deviation, zoom, threshold, radius_px, sigma_px, kept = shape
    height, width = images.shape[-2:]
    noise = draws.normal(1, math.ceil(height / zoom), math.ceil(width / zoom)) * deviation + mean
    flakes = fill_by_zoom(noise, zoom, height, width)
    flakes = torch.where(flakes < threshold, 0.0, flakes).clamp_(0, 1)
    low, high = SNOW_ANGLES_DEG
    flakes = blur_along(flakes, radius_px, sigma_px, draws.uniform() * (high - low) + low)
    whitened = torch.maximum(images, _grey(images).mul_(1.5).add_(0.5))
    return torch.lerp(whitened, images, kept).add_(flakes + flakes.flip(2, 3))


def _grey(images: torch.Tensor) -> torch.Tensor:
    red, green, blue = images.unbind(1)
    return (red * LUMA[0]).add_(green, alpha=LUMA[1]).add_(blue, alpha=LUMA[2])[:, None]


def add_frost(images: torch.Tensor, shares: tuple[float, float, float], draws: RandomStreams) -> torch.Tensor:
    """Add a random piece of a frosted pane; `shares` of the image and of the frost, and the texture's scale.

    The texture is the toolkit's own (see `frost`): the published images have photographs of frost there.
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
    side_px = 1 << (max(height, width) - 1).bit_length()
    clouds = draw_clouds(side_px, decay, draws)[:, None, :height, :width]
    brightest = images.amax((1, 2, 3), keepdim=True)
    return (images + strength * clouds).mul_(brightest / (brightest + strength))


def brighten(images: torch.Tensor, amount: float, draws: RandomStreams) -> torch.Tensor:
    """Add `amount` to the V of HSV, at most to 1. Hue and saturation stay: all three channels grow alike."""
    value = images.amax(1, keepdim=True)
    brighter = (value + amount).clamp_(max=1)
    return torch.where(value > 0, images * (brighter / value.clamp(min=1e-12)), brighter)
