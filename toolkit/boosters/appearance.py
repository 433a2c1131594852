"""What happens to a patch on its way into a photograph, as a list of parts in the order in which they happen."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from toolkit.boosters.warp import warp_patch
from toolkit.boosters.windows import cut_windows, find_windows, move_origin, paste_windows
from toolkit.draws import Draws

if TYPE_CHECKING:
    import torch


class Placement(Protocol):
    """Where the patch lies: `toolkit.boosters.affine.AffineRanges` and its like."""

    def place(self, rng: np.random.Generator, count: int, patch_px: int, image_px: int) -> np.ndarray:
        """(count, 3, 3) `T_image_patch`, affine or projective."""
        ...


class PaperPart(Protocol):
    """Something that happens to the paper in the scene: `toolkit.boosters.light.LightRanges` and its like."""

    def light(self, paper: "torch.Tensor", mask: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Change (b, 3, m, m) premultiplied paper, given its (b, 1, m, m) mask; differentiable."""
        ...


class ImagePart(Protocol):
    """Something that happens to pixels: the print before it is placed, or the whole photograph after."""

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Change (b, 3, h, w) or (3, n, n) sRGB-encoded pixels in [0, 1]; differentiable."""
        ...


@dataclass(frozen=True)
class Appearance:
    """The parts, each with its own random draws.

    Attributes:
        placement: where the patch lies.
        on_print: what the printer does to the patch.
        on_paper: what the scene does to the paper.
        on_photo: what the camera does to the photograph.
    """

    placement: Placement
    on_print: tuple[ImagePart, ...] = ()
    on_paper: tuple[PaperPart, ...] = ()
    on_photo: tuple[ImagePart, ...] = ()


def show_patch(patch: "torch.Tensor", images: "torch.Tensor", appearance: Appearance, draws: Draws) -> "torch.Tensor":
    """Photographs with the printed patch in them: the three steps below, one after the other.

    Args:
        patch: θ, (3, n, n) sRGB-encoded in [0, 1].
        images: x, (b, 3, m, m) sRGB-encoded in [0, 1].
        appearance: the parts.
        draws: of this step.

    Returns:
        (b, 3, m, m) sRGB-encoded in [0, 1], differentiable in `patch`.
    """
    return take_photos(place_patch(print_patch(patch, appearance, draws), images, appearance, draws), appearance, draws)


def print_patch(patch: "torch.Tensor", appearance: Appearance, draws: Draws) -> "torch.Tensor":
    """θ, (3, n, n) sRGB-encoded in [0, 1], as it comes out of the printer."""
    for part in appearance.on_print:
        patch = part.change(patch, draws.of(type(part).__name__))
    return patch


def place_patch(patch: "torch.Tensor", images: "torch.Tensor", appearance: Appearance, draws: Draws) -> "torch.Tensor":
    """Scenes with the print in them: x (1 - T(mask)) + T(θ) T(mask), seed Algorithm 1.

    At the patch's edge T(θ) T(mask) is read as the average of θ·mask over the pixel: transforming the two apart and
    multiplying after would fade the rim twice. Shapes as in `show_patch`.
    """
    T_image_patch = appearance.placement.place(
        draws.of(type(appearance.placement).__name__), len(images), patch.shape[-1], images.shape[-1]
    )
    corners, side = find_windows(T_image_patch, patch.shape[-1], images.shape[-1])
    paper, mask = warp_patch(patch, move_origin(T_image_patch, corners), side)
    for part in appearance.on_paper:
        paper = part.light(paper, mask, draws.of(type(part).__name__))
    around = cut_windows(images, corners, side)
    return paste_windows(images, (around * (1 - mask) + paper).clamp(0, 1), corners)


def take_photos(scenes: "torch.Tensor", appearance: Appearance, draws: Draws) -> "torch.Tensor":
    """(b, 3, m, m) scenes as the camera gives them."""
    for part in appearance.on_photo:
        scenes = part.change(scenes, draws.of(type(part).__name__))
    return scenes
