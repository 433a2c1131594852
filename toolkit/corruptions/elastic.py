"""Elastic transform: a random affine change, then a smooth random displacement of every pixel."""

import torch
from torch.nn import functional as F

from toolkit.corruptions.draws import Draws
from toolkit.corruptions.filters import blur_by_matrix

FIELD_TRUNCATE = 3.0


def bend(images: torch.Tensor, shape: tuple[float, float, float], draws: Draws) -> torch.Tensor:
    """Change the image affinely, then displace its pixels; both are interpolated linearly.

    Args:
        images: (b, 3, h, w).
        shape: what the smoothed noise is multiplied by, px; the sigma that it is smoothed with, px; and how far each of
            three points moves at most in x and in y under the affine change, px.
        draws: one stream per image.
    """
    strength_px, sigma_px, shift_px = shape
    moved = _sample(images, *move_affinely(images, shift_px, draws), mirror_at_centres=True)
    noise = draws.uniform(2, *images.shape[-2:]).mul_(2).sub_(1)
    # a sigma of nought belongs to a strength of nought
    shift = strength_px * blur_by_matrix(noise, sigma_px, "symmetric", FIELD_TRUNCATE) if strength_px else 0 * noise
    x, y = _pixels(images)
    return _sample(moved, x + shift[:, 0], y + shift[:, 1], mirror_at_centres=False)


def _pixels(images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return x (w,) and y (h, 1) of every pixel's centre, the first at 0."""
    height, width = images.shape[-2:]
    return torch.arange(width, device=images.device), torch.arange(height, device=images.device)[:, None]


def move_affinely(images: torch.Tensor, shift_px: float, draws: Draws) -> tuple[torch.Tensor, torch.Tensor]:
    """Return x and y, (b, h, w), of where each pixel comes from when three points around the middle move at random.

    The points lie a third of the short side from the middle, to the lower right, upper right and upper left.
    """
    height, width = images.shape[-2:]
    middle = torch.tensor([width // 2, height // 2], dtype=torch.float64)
    reach = min(height, width) // 3
    before = middle + reach * torch.tensor([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]], dtype=torch.float64)
    after = before + (draws.uniform(3, 2).cpu().double() * 2 - 1) * shift_px
    ones = torch.ones(len(images), 3, 1, dtype=torch.float64)
    # pixel -> where it comes from; three points fix it, unless they fall on one line, which the draws never hit
    back = torch.linalg.solve(torch.cat([after, ones], 2), before.expand_as(after)).float().to(images.device)
    x, y = _pixels(images)
    weights = back[..., None, None]
    return tuple(weights[:, 0, axis] * x + weights[:, 1, axis] * y + weights[:, 2, axis] for axis in (0, 1))


def _sample(images: torch.Tensor, x: torch.Tensor, y: torch.Tensor, mirror_at_centres: bool) -> torch.Tensor:
    """Values at x, y (b, h, w) px; beyond the border mirrored about the edge pixels' centres or about their rims."""
    height, width = images.shape[-2:]
    if mirror_at_centres:
        grid = torch.stack([2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1], -1)
    else:
        grid = torch.stack([(2 * x + 1) / width - 1, (2 * y + 1) / height - 1], -1)
    return F.grid_sample(images, grid, padding_mode="reflection", align_corners=mirror_at_centres)
