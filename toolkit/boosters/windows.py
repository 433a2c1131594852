"""The square part of each image that a patch touches: a third of its pixels, and the rest needs no work."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import torch

RIM_PX = 2
"""Around the patch's corners: what its filtered edge may reach."""


def find_windows(T_image_patch: np.ndarray, patch_px: int, image_px: int) -> tuple[np.ndarray, int]:
    """Squares of one size, inside the image, that each hold all that is seen of a placed patch.

    Returns:
        (b, 2) int, their (left, top) corners in pixels, and their side.
    """
    square = np.array([[0, patch_px, patch_px, 0], [0, 0, patch_px, patch_px], [1, 1, 1, 1]], float)
    x, y, w = np.moveaxis(T_image_patch @ square, 1, 0)
    points = np.stack([x / w, y / w], axis=1)
    low = np.clip(np.floor(points.min(axis=2)) - RIM_PX, 0, image_px)
    high = np.clip(np.ceil(points.max(axis=2)) + RIM_PX, 0, image_px)
    side = max(1, int((high - low).max()))
    return np.minimum(low, image_px - side).astype(int), side


def move_origin(T_image_patch: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """`T_window_patch` for windows at `corners`."""
    T_window_image = np.tile(np.eye(3), (len(corners), 1, 1))
    T_window_image[:, :2, 2] = -corners
    return T_window_image @ T_image_patch


def cut_windows(images: "torch.Tensor", corners: np.ndarray, side: int) -> "torch.Tensor":
    """(b, c, side, side) from (b, c, m, m)."""
    import torch

    return torch.stack([image[:, y : y + side, x : x + side] for image, (x, y) in zip(images, corners, strict=True)])


def paste_windows(images: "torch.Tensor", windows: "torch.Tensor", corners: np.ndarray) -> "torch.Tensor":
    """Images with their windows replaced, differentiable in both.

    Autograd would record sixteen assignments and copy the whole gradient for each; here it is cut once.
    """
    import torch

    class Paste(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, below: torch.Tensor, above: torch.Tensor) -> torch.Tensor:
            pasted = below.clone()
            for image, window, (x, y) in zip(pasted, above, corners, strict=True):
                image[:, y : y + window.shape[-2], x : x + window.shape[-1]] = window
            return pasted

        @staticmethod
        def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor | None, torch.Tensor]:
            (gradient,) = gradients
            side = windows.shape[-1]
            above = cut_windows(gradient, corners, side)
            if not ctx.needs_input_grad[0]:
                return None, above
            below = gradient.clone()
            for image, (x, y) in zip(below, corners, strict=True):
                image[:, y : y + side, x : x + side] = 0
            return below, above

    return Paste.apply(images, windows)
