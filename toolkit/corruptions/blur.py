"""Blur: defocus, glass, motion, zoom and Gaussian."""

import math
from functools import lru_cache

import cv2
import numpy as np
import torch
from torch.nn import functional as F

from toolkit.corruptions.draws import Draws
from toolkit.corruptions.filters import blur_gaussian, filter_by_kernel
from toolkit.corruptions.glass import shuffle_near
from toolkit.corruptions.motion import blur_along

MAX_MOTION_ANGLE_DEG = 45
SMALL_DISK_PX = 8
EMPTY = 1e-9


def blur_by_gaussian(images: torch.Tensor, sigma_px: float, draws: Draws) -> torch.Tensor:
    """Blur with a Gaussian."""
    return blur_gaussian(images, sigma_px)


@lru_cache(maxsize=16)
def disk_kernel(radius_px: float, softness_px: float) -> np.ndarray:
    """A disk of whole pixels, its rim softened by a Gaussian of 3×3 px, above 8 px of radius of 5×5.

    The published frame is 17×17 px, above 8 px of radius as narrow as the disk; empty rows around are cut off here.
    Where the disk fills its frame, at radii 8 and 10, the softening counts its rim twice: as published, the sum is
    1.013 and 1.011 there, so that the image grows a little brighter.
    """
    reach, taps = (SMALL_DISK_PX, 3) if radius_px <= SMALL_DISK_PX else (math.ceil(radius_px), 5)
    offsets = np.arange(-reach, reach + 1)
    disk = (offsets[:, None] ** 2 + offsets**2 <= radius_px**2).astype(np.float32)
    kernel = cv2.GaussianBlur(disk / disk.sum(), (taps, taps), softness_px)
    empty = int(np.argmax(kernel.max(0) > EMPTY))
    kernel = kernel[empty : len(kernel) - empty, empty : len(kernel) - empty].copy()
    kernel.flags.writeable = False
    return kernel


def blur_by_defocus(images: torch.Tensor, shape: tuple[float, float], draws: Draws) -> torch.Tensor:
    """Blur with a disk; `shape` is its radius and the softness of its rim, px."""
    return filter_by_kernel(images, disk_kernel(*shape))


def blur_by_glass(images: torch.Tensor, shape: tuple[float, int, int], draws: Draws) -> torch.Tensor:
    """Blur, move pixels about, blur; `shape` is the blurs' sigma, the greatest move in px, and the number of rounds.

    The original truncates to 8 bits after the first blur; here the values stay as they are.
    """
    sigma_px, reach_px, rounds = shape
    return blur_gaussian(shuffle_near(blur_gaussian(images, sigma_px), reach_px, rounds, draws), sigma_px)


def blur_by_motion(images: torch.Tensor, shape: tuple[float, float], draws: Draws) -> torch.Tensor:
    """Blur along a line at up to 45° from the horizontal; `shape` is ImageMagick's radius and sigma, px."""
    angles = (draws.uniform() * 2 - 1) * MAX_MOTION_ANGLE_DEG
    return blur_along(images, *shape, angles)


def zoom_in(planes: torch.Tensor, factor: float) -> torch.Tensor:
    """The middle of (b, c, h, w), enlarged `factor` times, linearly, corner pixel onto corner pixel."""
    height, width = planes.shape[-2:]
    cut_height, cut_width = math.ceil(height / factor), math.ceil(width / factor)
    top, left = (height - cut_height) // 2, (width - cut_width) // 2
    cut = planes[..., top : top + cut_height, left : left + cut_width]
    return fill_by_zoom(cut, factor, height, width)


def fill_by_zoom(cut: torch.Tensor, factor: float, height: int, width: int) -> torch.Tensor:
    """Enlarge `cut` `factor` times, and take the middle `height` × `width` px of the result."""
    size = (round(cut.shape[-2] * factor), round(cut.shape[-1] * factor))
    zoomed = F.interpolate(cut, size, mode="bilinear", align_corners=True)
    top, left = (size[0] - height) // 2, (size[1] - width) // 2
    return zoomed[..., top : top + height, left : left + width]


def blur_by_zoom(images: torch.Tensor, zooms: tuple[float, float], draws: Draws) -> torch.Tensor:
    """The mean of the image and its enlargements; `zooms` is the end and the step of `numpy.arange(1, end, step)`."""
    factors = np.arange(1, *zooms).tolist()
    total = images.clone()
    for factor in factors:
        total += zoom_in(images, factor)
    return total.div_(len(factors) + 1)
