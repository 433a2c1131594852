"""Images with a patch of their class in them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from toolkit.benchmark.placement import Placement
from toolkit.boosters.warp import warp_patch

if TYPE_CHECKING:
    import torch


def boost_images(
    images: "torch.Tensor", pictures: "torch.Tensor", placement: Placement, seeds: Sequence[int]
) -> "torch.Tensor":
    """Lay pictures on images: x (1 - T(mask)) + T(θ) T(mask), seed Algorithm 1.

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
