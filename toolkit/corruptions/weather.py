"""Weather: snow, frost, fog, brightness and spatter."""

import math

import torch

from toolkit.corruptions.blur import fill_by_zoom
from toolkit.corruptions.draws import Draws
from toolkit.corruptions.frost import cut_frost
from toolkit.corruptions.motion import blur_along
from toolkit.corruptions.plasma import draw_clouds

LUMA = (0.299, 0.587, 0.114)
SNOW_ANGLES_DEG = (-135.0, -45.0)


def add_snow(images: torch.Tensor, shape: tuple[float, ...], draws: Draws) -> torch.Tensor:
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


def add_frost(images: torch.Tensor, shares: tuple[float, float, float], draws: Draws) -> torch.Tensor:
    """Add a random piece of a frosted pane; `shares` of the image and of the frost, and the texture's scale.

    The texture is the toolkit's own (see `frost`): the published images have photographs of frost there.
    """
    kept, added, scale = shares
    height, width = images.shape[-2:]
    frosted = images * kept
    for image, piece in zip(frosted, cut_frost(height, width, scale, draws), strict=True):
        image.add_(piece, alpha=added)
    return frosted


def add_fog(images: torch.Tensor, shape: tuple[float, float], draws: Draws) -> torch.Tensor:
    """Add clouds, and dim so that the brightest value stays; `shape` is the clouds' strength and smoothness."""
    strength, decay = shape
    height, width = images.shape[-2:]
    side_px = 1 << (max(height, width) - 1).bit_length()
    clouds = draw_clouds(side_px, decay, draws)[:, None, :height, :width]
    brightest = images.amax((1, 2, 3), keepdim=True)
    return (images + strength * clouds).mul_(brightest / (brightest + strength))


def brighten(images: torch.Tensor, amount: float, draws: Draws) -> torch.Tensor:
    """Add `amount` to the V of HSV, at most to 1. Hue and saturation stay: all three channels grow alike."""
    value = images.amax(1, keepdim=True)
    brighter = (value + amount).clamp_(max=1)
    return torch.where(value > 0, images * (brighter / value.clamp(min=1e-12)), brighter)
