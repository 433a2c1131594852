"""Spatter: drops of water or blots of mud on the lens.

Edges, distances and the equalised histogram come from OpenCV: torch has none of them.
"""

import cv2
import numpy as np
import torch

from toolkit.corruptions.draws import Draws
from toolkit.corruptions.filters import blur_gaussian

WATER = (175 / 255, 238 / 255, 238 / 255)
MUD = (63 / 255, 42 / 255, 20 / 255)
EMBOSS = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], np.float32)
MAX_DISTANCE_PX = 20
CANNY_THRESHOLDS = (50, 150)
LEAST_MUD = 0.8


def add_spatter(images: torch.Tensor, shape: tuple[float, ...], draws: Draws) -> torch.Tensor:
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
