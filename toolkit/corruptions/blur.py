"""Linear filters on batches of planes; and blur: defocus, glass, motion, zoom and Gaussian.

OpenCV blurs on the CPU, ten times as fast as torch's depthwise convolution. Matrix products give the same values on a
GPU, and with a gradient. Large kernels use the Fourier transform.
"""

import math
from functools import lru_cache

import cv2
import numpy as np
import torch
from scipy.fft import next_fast_len
from torch.nn import functional as F

from toolkit.core.draws import RandomStreams

TRUNCATE = 4.0
"""Standard deviations at which a Gaussian is cut off: scikit-image's default."""


def gaussian_weights(sigma_px: float, truncate: float = TRUNCATE) -> np.ndarray:
    """(2r + 1,) samples of a Gaussian that sum to 1, r = `truncate` × `sigma_px` rounded, as in SciPy."""
    radius = int(truncate * sigma_px + 0.5)
    offsets = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (offsets / sigma_px) ** 2)
    return weights / weights.sum()


@lru_cache(maxsize=64)
def gaussian_matrix(length: int, sigma_px: float, border: str, truncate: float = TRUNCATE) -> torch.Tensor:
    """(length, length) float32 matrix that blurs a row of `length` values.

    `border` is NumPy's name of the continuation, `edge` or `symmetric`; `sigma_px` may be larger than the row.
    """
    weights = gaussian_weights(sigma_px, truncate)
    radius = len(weights) // 2
    # the border's rule applied to the numbers of pixels
    source = np.pad(np.arange(length), radius, mode=border)  # type: ignore[call-overload]
    matrix = np.zeros((length, length))
    rows = np.arange(length)
    for tap, weight in enumerate(weights):
        # near an end several taps read the same pixel: their weights add up
        np.add.at(matrix, (rows, source[tap : tap + length]), weight)
    return torch.from_numpy(matrix.astype(np.float32))


def blur_by_matrix(planes: torch.Tensor, sigma_px: float, border: str, truncate: float = TRUNCATE) -> torch.Tensor:
    """Blur (..., h, w) float32 with a Gaussian as two matrix products: any width costs the same."""
    height, width = planes.shape[-2:]
    down = gaussian_matrix(height, sigma_px, border, truncate).to(planes.device)
    across = gaussian_matrix(width, sigma_px, border, truncate).to(planes.device)
    return down @ planes @ across.T


def blur_gaussian(planes: torch.Tensor, sigma_px: float) -> torch.Tensor:
    """Blur (b, c, h, w) float32 with a Gaussian cut off at four deviations, edge pixels repeated outwards."""
    if planes.device.type != "cpu" or planes.requires_grad:
        return blur_by_matrix(planes, sigma_px, "edge")
    weights = gaussian_weights(sigma_px)
    result = torch.empty(planes.shape)
    rows = planes.shape[-2:]
    # OpenCV on the CPU; elsewhere, and where a gradient is asked for, the matrix product
    for source, target in zip(planes.reshape(-1, *rows).numpy(), result.view(-1, *rows).numpy(), strict=True):
        cv2.sepFilter2D(source, -1, weights, weights, dst=target, borderType=cv2.BORDER_REPLICATE)
    return result


def filter_by_kernel(planes: torch.Tensor, kernel: np.ndarray) -> torch.Tensor:
    """Correlate (b, c, h, w) float32 with an odd, square `kernel`, mirrored about the edge pixels' centres.

    The Fourier transform takes the same time for any kernel: less than OpenCV from about 8×8 px upwards.
    """
    height, width = planes.shape[-2:]
    radius = len(kernel) // 2
    padded = F.pad(planes, (radius,) * 4, mode="reflect")
    # the transform is fast where lengths have small prime factors only
    size = tuple(next_fast_len(length, real=True) for length in padded.shape[-2:])
    weights = torch.fft.rfft2(torch.tensor(kernel).to(planes), s=size)
    # the conjugate correlates; values that wrap around stay on the padding
    product = torch.fft.rfft2(padded, s=size).mul_(weights.conj())
    return torch.fft.irfft2(product, s=size)[..., :height, :width]


def motion_taps(radius_px: float, sigma_px: float, angle_deg: float) -> list[tuple[int, int, float]]:
    """Return (dx, dy, weight) of every pixel that a pixel is averaged from; weights sum to 1.

    The line of 2 × ⌈radius⌉ + 1 pixels starts at the pixel and runs `angle_deg` clockwise from the right. Its steps are
    rounded to whole pixels, halves downwards. The weights are half a Gaussian.
    """
    count = 2 * math.ceil(radius_px) + 1
    weights = [math.exp(-0.5 * (step / sigma_px) ** 2) for step in range(count)]
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    # ImageMagick's rounding: halves go down
    places = [(math.ceil(step * cos - 0.5), math.ceil(step * sin - 0.5)) for step in range(count)]
    return [(dx, dy, weight / sum(weights)) for (dx, dy), weight in zip(places, weights, strict=True)]


def blur_along(planes: torch.Tensor, radius_px: float, sigma_px: float, angles_deg: torch.Tensor) -> torch.Tensor:
    """Blur (b, c, h, w) float32, each image along its own angle (b,), see `motion_taps`; edge pixels are repeated."""
    height, width = planes.shape[-2:]
    blurred = []
    # each image has an angle of its own
    for image, angle in zip(planes, angles_deg.tolist(), strict=True):
        taps = motion_taps(radius_px, sigma_px, angle)
        # as much border as the taps reach on each side
        left, right = max(-dx for dx, _, _ in taps), max(dx for dx, _, _ in taps)
        above, below = max(-dy for _, dy, _ in taps), max(dy for _, dy, _ in taps)
        padded = F.pad(image[None], (left, right, above, below), mode="replicate")[0]
        target = torch.zeros_like(image)
        # a tap is the image moved by whole pixels, with a weight
        for dx, dy, weight in taps:
            top, start = above + dy, left + dx
            target.add_(padded[:, top : top + height, start : start + width], alpha=weight)
        blurred.append(target)
    return torch.stack(blurred)


def shuffle_near(images: torch.Tensor, reach_px: int, rounds: int, draws: RandomStreams) -> torch.Tensor:
    """Take every pixel of (b, c, h, w) from a random place nearby, row by row from the bottom right.

    The published loop, from the bottom right to the top left, means to swap each pixel with a neighbour at most `reach`
    away. Its swap is of two views, so each pixel becomes a copy of the neighbour at that moment. Here all pixels are
    traced back at once to the pixel that they came from.
    """
    height, width = images.shape[-2:]
    flat = images.flatten(2)
    for _ in range(rounds):
        origin = trace_copies(draw_neighbours(height, width, reach_px, draws), height, width, reach_px)
        flat = flat.gather(2, origin[:, None].expand_as(flat))
    return flat.reshape(images.shape)


def draw_neighbours(height: int, width: int, reach_px: int, draws: RandomStreams) -> torch.Tensor:
    """(b, h × w) int64: the pixel that each pixel copies; those near the border copy themselves."""
    side = 2 * reach_px
    # one draw for both shifts, from -reach to reach - 1: the published `randint` leaves its end out
    pick = (draws.uniform(height * width) * side**2).long()
    down, across = pick // side - reach_px, pick % side - reach_px
    own = torch.arange(height * width, device=pick.device)
    return torch.where(_may_move(height, width, reach_px).to(pick.device), own + down * width + across, own)


def trace_copies(neighbours: torch.Tensor, height: int, width: int, reach_px: int) -> torch.Tensor:
    """(b, h × w) int64: place of each pixel's value before the round, given the pixel that it copies.

    A copy of a changed pixel, which the loop has passed, holds that pixel's copy, and so on. Every step of this search
    reaches twice as far.
    """
    own = torch.arange(height * width, device=neighbours.device)
    # `neighbours > own`: the loop goes from the bottom right, and has changed those by then
    passed = _may_move(height, width, reach_px).to(neighbours.device)[neighbours] & (neighbours > own)
    origin = neighbours
    # chains of copies are followed a link at a time, all pixels at once, instead of pixel by pixel
    while passed.any():
        further = origin.gather(1, origin)
        origin, passed = torch.where(passed, further, origin), passed & passed.gather(1, origin)
    return origin


def _may_move(height: int, width: int, reach_px: int) -> torch.Tensor:
    """(h × w,) bool: the pixels that the published loop visits."""
    inside = torch.zeros(height, width, dtype=torch.bool)
    inside[reach_px + 1 : height - reach_px + 1, reach_px + 1 : width - reach_px + 1] = True
    return inside.flatten()


MAX_MOTION_ANGLE_DEG = 45
SMALL_DISK_PX = 8
EMPTY = 1e-9


def blur_by_gaussian(images: torch.Tensor, sigma_px: float, draws: RandomStreams) -> torch.Tensor:
    """Blur with a Gaussian."""
    return blur_gaussian(images, sigma_px)


@lru_cache(maxsize=16)
def disk_kernel(radius_px: float, softness_px: float) -> np.ndarray:
    """Return a disk of whole pixels, its rim softened by a Gaussian of 3×3 px, or 5×5 for radii above 8 px.

    As published, the softening counts the rim twice at radii 8 and 10: the sum is over 1, and the image a little
    brighter. Empty rows around the disk are cut off.
    """
    # as in the published `disk`
    reach, taps = (SMALL_DISK_PX, 3) if radius_px <= SMALL_DISK_PX else (math.ceil(radius_px), 5)
    offsets = np.arange(-reach, reach + 1)
    disk = (offsets[:, None] ** 2 + offsets**2 <= radius_px**2).astype(np.float32)
    kernel = cv2.GaussianBlur(disk / disk.sum(), (taps, taps), softness_px)
    # rows of zeros around the disk would only cost time
    empty = int(np.argmax(kernel.max(0) > EMPTY))
    kernel = kernel[empty : len(kernel) - empty, empty : len(kernel) - empty].copy()
    kernel.flags.writeable = False
    return kernel


def blur_by_defocus(images: torch.Tensor, shape: tuple[float, float], draws: RandomStreams) -> torch.Tensor:
    """Blur with a disk; `shape` is its radius and the softness of its rim, px."""
    return filter_by_kernel(images, disk_kernel(*shape))


def blur_by_glass(images: torch.Tensor, shape: tuple[float, int, int], draws: RandomStreams) -> torch.Tensor:
    """Blur, move pixels about, blur; `shape` is the blurs' sigma, the greatest move in px, and the number of rounds.

    The original truncates to 8 bits after the first blur; here the values stay as they are.
    """
    sigma_px, reach_px, rounds = shape
    return blur_gaussian(shuffle_near(blur_gaussian(images, sigma_px), reach_px, rounds, draws), sigma_px)


def blur_by_motion(images: torch.Tensor, shape: tuple[float, float], draws: RandomStreams) -> torch.Tensor:
    """Blur along a line at up to 45° from the horizontal; `shape` is ImageMagick's radius and sigma, px."""
    angles = (draws.uniform() * 2 - 1) * MAX_MOTION_ANGLE_DEG
    return blur_along(images, *shape, angles)


def zoom_in(planes: torch.Tensor, factor: float) -> torch.Tensor:
    """Enlarge the middle of (b, c, h, w) `factor` times, linearly, corner pixel onto corner pixel."""
    height, width = planes.shape[-2:]
    # only what is seen after the enlargement is enlarged
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


def blur_by_zoom(images: torch.Tensor, zooms: tuple[float, float], draws: RandomStreams) -> torch.Tensor:
    """Average the image and its enlargements; `zooms` is the end and the step of `numpy.arange(1, end, step)`."""
    factors = np.arange(1, *zooms).tolist()
    total = images.clone()
    for factor in factors:
        total += zoom_in(images, factor)
    # the factors begin at 1, so the image counts twice, as published
    return total.div_(len(factors) + 1)
