"""Motion blur as ImageMagick does it, which made the published images: half a Gaussian along a line of whole pixels."""

import math

import torch
from torch.nn import functional as F


def motion_taps(radius_px: float, sigma_px: float, angle_deg: float) -> list[tuple[int, int, float]]:
    """(dx, dy, weight) of every pixel that a pixel is averaged from; weights sum to 1.

    The line starts at the pixel itself and runs `angle_deg` clockwise from the image's right (y points down); each
    step along it is rounded to a whole pixel, halves downwards. The weights are one half of a Gaussian.

    Args:
        radius_px: the line has 2 × ⌈radius⌉ + 1 pixels.
        sigma_px: standard deviation of the Gaussian.
        angle_deg: direction of the line.
    """
    count = 2 * math.ceil(radius_px) + 1
    weights = [math.exp(-0.5 * (step / sigma_px) ** 2) for step in range(count)]
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    places = [(math.ceil(step * cos - 0.5), math.ceil(step * sin - 0.5)) for step in range(count)]
    return [(dx, dy, weight / sum(weights)) for (dx, dy), weight in zip(places, weights, strict=True)]


def blur_along(planes: torch.Tensor, radius_px: float, sigma_px: float, angles_deg: torch.Tensor) -> torch.Tensor:
    """Blur (b, c, h, w) float32, each image along its own angle, edge pixels repeated outwards.

    Args:
        planes: the images.
        radius_px: the line has 2 × ⌈radius⌉ + 1 pixels.
        sigma_px: standard deviation of the Gaussian along it.
        angles_deg: (b,) directions.
    """
    height, width = planes.shape[-2:]
    blurred = torch.zeros_like(planes)
    for image, target, angle in zip(planes, blurred, angles_deg.tolist(), strict=True):
        taps = motion_taps(radius_px, sigma_px, angle)
        left, right = max(-dx for dx, _, _ in taps), max(dx for dx, _, _ in taps)
        above, below = max(-dy for _, dy, _ in taps), max(dy for _, dy, _ in taps)
        padded = F.pad(image[None], (left, right, above, below), mode="replicate")[0]
        for dx, dy, weight in taps:
            top, start = above + dy, left + dx
            target.add_(padded[:, top : top + height, start : start + width], alpha=weight)
    return blurred
