"""Digital: contrast, elastic transform, pixelation, JPEG compression and saturation."""

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
import torch
from torch.nn import functional as F

from toolkit.core.draws import RandomStreams
from toolkit.corruptions.blur import blur_by_matrix

FIELD_TRUNCATE = 3.0


def bend(images: torch.Tensor, shape: tuple[float, float, float], draws: RandomStreams) -> torch.Tensor:
    """Move the image affinely, then displace its pixels by smooth noise; both are interpolated linearly.

    `shape` is the noise's amplitude, its sigma, and the most that three points move in x and y, all in px.
    """
    strength_px, sigma_px, shift_px = shape
    moved = _sample(images, *move_affinely(images, shift_px, draws), mirror_at_centres=True)
    noise = draws.uniform(2, *images.shape[-2:]).mul_(2).sub_(1)
    # a sigma of 0 belongs to a strength of 0
    shift = strength_px * blur_by_matrix(noise, sigma_px, "symmetric", FIELD_TRUNCATE) if strength_px else 0 * noise
    x, y = _pixels(images)
    return _sample(moved, x + shift[:, 0], y + shift[:, 1], mirror_at_centres=False)


def _pixels(images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return x (w,) and y (h, 1) of every pixel's centre, the first at 0."""
    height, width = images.shape[-2:]
    return torch.arange(width, device=images.device), torch.arange(height, device=images.device)[:, None]


def move_affinely(images: torch.Tensor, shift_px: float, draws: RandomStreams) -> tuple[torch.Tensor, torch.Tensor]:
    """Return x and y, (b, h, w), of where each pixel comes from when three points around the middle move at random.

    The points lie a third of the short side from the middle, to the lower right, upper right and upper left.
    """
    height, width = images.shape[-2:]
    middle = torch.tensor([width // 2, height // 2], dtype=torch.float64)
    reach = min(height, width) // 3
    # the three points of the published script
    before = middle + reach * torch.tensor([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]], dtype=torch.float64)
    after = before + (draws.uniform(3, 2).cpu().double() * 2 - 1) * shift_px
    ones = torch.ones(len(images), 3, 1, dtype=torch.float64)
    # pixel -> where it comes from; three points fix it, unless they fall on one line, which the draws never hit
    back = torch.linalg.solve(torch.cat([after, ones], 2), before.expand_as(after)).float().to(images.device)
    x, y = _pixels(images)
    weights = back[..., None, None]
    # an affine map: x and y of the source are linear in x and y of the target
    return tuple(weights[:, 0, axis] * x + weights[:, 1, axis] * y + weights[:, 2, axis] for axis in (0, 1))


def _sample(images: torch.Tensor, x: torch.Tensor, y: torch.Tensor, mirror_at_centres: bool) -> torch.Tensor:
    """Sample at x, y (b, h, w) px, mirrored about the edge pixels' centres or about their rims."""
    height, width = images.shape[-2:]
    if mirror_at_centres:
        # grid_sample counts from -1 to 1: between the centres of the edge pixels, or between their rims
        grid = torch.stack([2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1], -1)
    else:
        grid = torch.stack([(2 * x + 1) / width - 1, (2 * y + 1) / height - 1], -1)
    return F.grid_sample(images, grid, padding_mode="reflection", align_corners=mirror_at_centres)


ROUNDING = 1e-4
"""Far above what float32 loses in a mean of 8-bit values, far below the least distance of such a mean from a half."""


def reduce_contrast(images: torch.Tensor, share: float, draws: RandomStreams) -> torch.Tensor:
    """Move every value towards its channel's mean over the image; `share` of the distance is left."""
    return torch.lerp(images.mean((2, 3), keepdim=True), images, share)


def saturate(images: torch.Tensor, change: tuple[float, float], draws: RandomStreams) -> torch.Tensor:
    """Multiply the S of HSV and add to it; `change` is the factor and the summand. Hue and V stay.

    A grey pixel has no hue; as in scikit-image it counts as red, which shows where something is added to its S.
    """
    factor, summand = change
    # a grey has no hue; HSV's 0 is red, which lacks green and blue
    red = torch.tensor([0.0, 1.0, 1.0], device=images.device)[:, None, None]
    value = images.amax(1, keepdim=True)
    depth = value - images  # what each channel lacks
    chroma = depth.amax(1, keepdim=True)
    saturation = chroma / value.clamp(min=1e-12)
    # the S that is wanted, times V: what the channels then lack
    wanted = (saturation * factor + summand).clamp_(0, 1) * value
    return value - torch.where(chroma > 0, depth * (wanted / chroma.clamp(min=1e-12)), red * wanted)


def to_bytes(images: torch.Tensor) -> np.ndarray:
    """Round (b, 3, h, w) in [0, 1] to (b, h, w, 3) uint8 on the CPU."""
    levels = images.clamp(0, 1).mul_(255).add_(0.5).to(torch.uint8)
    return levels.permute(0, 2, 3, 1).contiguous().cpu().numpy()


def from_bytes(pixels: np.ndarray, device: torch.device | str = "cpu") -> torch.Tensor:
    """Convert (b, h, w, 3) uint8 to (b, 3, h, w) float32 in [0, 1] on `device`."""
    levels = torch.from_numpy(pixels).to(device).permute(0, 3, 1, 2)
    return levels.to(torch.float32, memory_format=torch.contiguous_format).div_(255)


def compress_jpeg(images: torch.Tensor, quality: int, draws: RandomStreams) -> torch.Tensor:
    """Encode and decode as JPEG, 4:2:0, by OpenCV: the same bytes as the published Pillow, in less time."""

    def compress(levels: np.ndarray) -> np.ndarray:
        # OpenCV reads and writes blue first
        red, green, blue = levels
        stream = cv2.imencode(".jpg", cv2.merge((blue, green, red)), (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
        return np.stack(cv2.split(np.asarray(cv2.imdecode(stream, cv2.IMREAD_COLOR)))[::-1])

    return _change_levels(images, compress)


def pixelate(images: torch.Tensor, share: float, draws: RandomStreams) -> torch.Tensor:
    """Shrink to `share` of the size and enlarge again, with the box filter of Pillow and its rounding to 8 bits.

    Pillow's box takes the mean of the pixels whose centres it covers, along the rows, then down the columns, and rounds
    to 8 bits after each.
    """
    height, width = images.shape[-2:]
    low_height, low_width = int(height * share), int(width * share)
    rows, columns = box_windows(low_height, height)[0], box_windows(low_width, width)[0]

    def shrink_and_enlarge(levels: np.ndarray) -> np.ndarray:
        # whole rows are averaged, which is fast: columns are turned into rows for it, of all three planes at once
        narrow = _shrink_rows(cv2.transpose(levels.reshape(-1, width)), low_width)
        low = _shrink_rows(cv2.transpose(narrow).reshape(3, height, low_width), low_height)
        return low.take(columns, axis=2).take(rows, axis=1)

    return _change_levels(images, shrink_and_enlarge)


def pixelate_unrounded(images: torch.Tensor, share: float) -> torch.Tensor:
    """Pixelate without rounding, by products of matrices, which have a gradient."""
    height, width = images.shape[-2:]
    low_height, low_width = int(height * share), int(width * share)
    rows, columns = (torch.from_numpy(box_windows(*pair)[0]) for pair in ((low_height, height), (low_width, width)))
    down, across = (_box_means(*pair).to(images) for pair in ((height, low_height), (width, low_width)))
    low = down @ images @ across.T
    return low[..., rows.to(images.device), :][..., columns.to(images.device)]


@lru_cache(maxsize=64)
def _box_means(length: int, wanted: int) -> torch.Tensor:
    """(wanted, length) float32 that takes the mean of the pixels in each box."""
    first, counts = box_windows(length, wanted)
    offsets = np.arange(length) - first[:, None]
    covered = (offsets >= 0) & (offsets < counts[:, None])
    return torch.from_numpy((covered / counts[:, None]).astype(np.float32))


def _change_levels(images: torch.Tensor, change: Callable[[np.ndarray], np.ndarray]) -> torch.Tensor:
    """Apply `change`, (3, h, w) uint8 to the same, to each image rounded to 8 bits, on the CPU."""
    source = images.contiguous().cpu().numpy()
    result = np.empty_like(source)
    for image, target in zip(source, result, strict=True):
        levels = cv2.convertScaleAbs(image.reshape(-1, image.shape[2]), alpha=255)  # rounds to the nearest level
        np.multiply(change(levels.reshape(image.shape)), np.float32(1 / 255), out=target)
    return torch.from_numpy(result).to(images.device)


@lru_cache(maxsize=64)
def box_windows(length: int, wanted: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first of `length` pixels under the box of each of `wanted` pixels, and their number; (wanted,) int64.

    The steps are Pillow's, in double precision, as their rounding decides about centres on a box's rim.
    """
    # source pixels for each wanted pixel; a box is never narrower than a pixel
    step = length / wanted
    widened = max(step, 1.0)
    centres = (np.arange(wanted) + 0.5) * step
    near = np.maximum((centres - 0.5 * widened + 0.5).astype(np.int64), 0)
    pixels = near[:, None] + np.arange(int(widened) + 2)
    # Pillow's box filter is 1 over half a box width to both sides, without the left end
    offsets = (pixels - centres[:, None] + 0.5) * (1 / widened)
    covered = (offsets > -0.5) & (offsets <= 0.5) & (pixels < length)
    return near + covered.argmax(1), covered.sum(1)


def _shrink_rows(levels: np.ndarray, wanted: int) -> np.ndarray:
    """(..., h, w) uint8 to (..., wanted, w) uint8: the mean of the rows in each box, halves rounded up."""
    first, counts = box_windows(levels.shape[-2], wanted)
    total = levels.take(first, axis=-2).astype(np.float32)
    for tap in range(1, int(counts.max())):
        further = levels.take(np.minimum(first + tap, levels.shape[-2] - 1), axis=-2)
        total += further if counts.min() > tap else further * (counts > tap)[:, None]
    total *= (1 / counts)[:, None].astype(np.float32)
    total += np.float32(0.5 + ROUNDING)
    return total.astype(np.uint8)
