"""Images with a patch of their class in them, turned, scaled and moved at random by the image's own seed."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from toolkit.boosters.parts.affine import affine_matrices
from toolkit.boosters.parts.base import warp_patch
from toolkit.core.config import Config, Expect, Flag, Range, Rising

if TYPE_CHECKING:
    import torch


class Placement(Config):
    """Ranges of the random affine placement, drawn uniformly; the defaults are those of the paper's release.

    As for every part, the name of the class names its draws: renamed, it would draw other numbers.
    """

    stage: ClassVar = "place"
    rotation_deg: Annotated[
        float, Field(ge=0, le=180), Expect("0 to 180 degrees"), Flag("--max-rotation", metavar="DEGREES")
    ] = Field(45.0, description="Largest turn of a patch either way, degrees.")
    scale: Annotated[Range, Rising(0.1, 2), Flag("--patch-scale")] = Field(
        (0.9, 1.1), description="Smallest and largest side of the placed patch, of its own pixels."
    )
    translate: Annotated[float, Field(ge=0, le=0.5), Expect("0 to 0.5 of the image's side"), Flag()] = Field(
        0.3, description="Largest move from the middle along each axis, of the image's side; it may be cut off."
    )

    def place(self, rng: np.random.Generator, count: int, patch_px: int, image_px: int) -> np.ndarray:
        """Draw `count` placements; (count, 3, 3) float64 `T_image_patch`, see `toolkit.boosters.parts.affine`."""
        return self.place_seeded(rng.integers(2**63, size=count).tolist(), patch_px, image_px)

    def place_seeded(self, seeds: Sequence[int], patch_px: int, image_px: int) -> np.ndarray:
        """(b, 3, 3) `T_image_patch`, each by its seed alone, which turns and moves a patch of any size alike."""
        drawn = np.array([np.random.default_rng(seed).uniform(-1, 1, 4) for seed in seeds]).reshape(-1, 4)
        angle = np.radians(self.rotation_deg) * drawn[:, 0]
        low, high = self.scale
        scale = low + (high - low) * (drawn[:, 1] + 1) / 2
        cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
        linear = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
        return affine_matrices(linear, image_px * (0.5 + self.translate * drawn[:, 2:]), patch_px)


def is_whole(T_image_patch: np.ndarray, patch_px: int, image_px: int) -> np.ndarray:
    """(b,) bool: whether a placed patch lies within the frame with all its corners."""
    corners = np.array([[0, patch_px, patch_px, 0], [0, 0, patch_px, patch_px], [1, 1, 1, 1]], float)
    points = (T_image_patch @ corners)[:, :2]
    return ((points >= 0) & (points <= image_px)).all(axis=(1, 2))


def boost_images(
    images: "torch.Tensor", pictures: "torch.Tensor", placement: Placement, seeds: Sequence[int]
) -> "torch.Tensor":
    """Lay pictures on images: x (1 - T(mask)) + T(θ) T(mask), the paper's Algorithm 1.

    An image does not depend on the others of its batch.

    Args:
        images: x, (b, 3, m, m) sRGB-encoded in [0, 1].
        pictures: θ of each image's class, (b, 3, n, n) sRGB-encoded in [0, 1].
        placement: the ranges of T.
        seeds: b, one for each image.

    Returns:
        (b, 3, m, m) sRGB-encoded in [0, 1], differentiable in both.
    """
    T_image_patch = placement.place_seeded(seeds, pictures.shape[-1], images.shape[-1])
    paper, mask = warp_patch(pictures, T_image_patch, images.shape[-1], placement.scale)
    return (images * (1 - mask) + paper).clamp(0, 1)
