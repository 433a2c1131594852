"""Losses on the patch itself: total variation and the non-printability score, see `toolkit.print_scores`."""

from typing import TYPE_CHECKING

from toolkit.inks import nearest_printable

if TYPE_CHECKING:
    import torch


def total_variation(patch: "torch.Tensor") -> "torch.Tensor":
    """Mean absolute difference of neighbouring texels of (3, n, n), right and below; a scalar, differentiable."""
    down, right = patch.diff(dim=1).abs(), patch.diff(dim=2).abs()
    return (down.sum() + right.sum()) / (down.numel() + right.numel())


def non_printability(patch: "torch.Tensor") -> "torch.Tensor":
    """Mean distance of the texels of (3, n, n) in [0, 1] to the nearest printable colour; a scalar, differentiable.

    The gradient of the distance to a convex set points away from the nearest place in it, so that this place may be
    found apart from autograd.
    """
    import torch

    colours = patch.flatten(1).T
    nearest = nearest_printable(colours.detach().double().cpu().numpy())
    apart = colours - torch.as_tensor(nearest, dtype=patch.dtype, device=patch.device)
    squared = apart.square().mean(dim=1)
    # inside, the root's infinite slope at 0 must not meet the gradient
    return torch.where(squared > 1e-12, squared.clamp_min(1e-12).sqrt(), torch.zeros_like(squared)).mean()
