"""Lay patches on batches of images: a patch at random, or each image's own by its seed; differentiable."""

from collections.abc import Sequence

import numpy as np

from toolkit.boosters.transforms import Placer
from toolkit.boosters.transforms.placement import AffineRanges, Placement
from toolkit.boosters.transforms.show import warp_patch
from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import torch

SMALLEST_PX = 2


def apply_patch(
    images: "torch.Tensor", patch: "torch.Tensor", seed: int | Sequence[int] = 0, *, placement: Placer | None = None,
    mask: "torch.Tensor | None" = None,
) -> "torch.Tensor":  # fmt: skip
    """Lay a patch on every image at a random place: x (1 - T(m)) + T(θ m), Algorithm 1 of the paper.

    Differentiable in `images` and in `patch`; keep the patch in [0, 1] yourself, for example with `clamp_` after a
    step. Texels are antialiased over the pixels that they cover, and keep crisp edges where they are larger than those.

    **Convention:** `T_image_patch` maps texels [0, n]² to pixels, x right and y down, pixel centres at half integers.
    It is drawn in the central square of an image that is none, and cut at the image's edge.

    Args:
        images: x, (b, 3, h, w) float, sRGB-encoded in [0, 1], not normalised, on any device.
        patch: θ, (3, n, n) float in [0, 1] for all images, or (b, 3, n, n) with a patch for each.
        seed: of the placements. Image i depends on (seed, i) alone: give the number of the step. With a sequence of b
            seeds image i depends on seeds[i] alone, whatever its place in the batch.
        placement: what is drawn; by default `AffineRanges()`: any turn, a side of 20 to 42 % of the image's shorter
            side, foreshortened as by an oblique view.
        mask: (n, n) float in [0, 1], how opaque each texel is; by default the whole square is. It gets no gradient.

    Returns:
        (b, 3, h, w) of the images' type, sRGB-encoded in [0, 1].

    Raises:
        ToolkitError: another shape, integers instead of floats, or seeds or patches that do not match the images.
    """
    _check_shapes(images, patch, seed, mask)
    if len(images) == 0:
        return images
    ranges = AffineRanges() if placement is None else placement
    (height, width), n = images.shape[-2:], patch.shape[-1]
    # placements are drawn in the central square, then moved with it
    T_image_patch = _draw_placements(ranges, seed, len(images), n, min(height, width))
    # moves x and y by a multiple of w: right for projective placements as well
    T_image_patch[:, 0] += (width - min(height, width)) / 2 * T_image_patch[:, 2]
    T_image_patch[:, 1] += (height - min(height, width)) / 2 * T_image_patch[:, 2]
    precise = torch.float64 if images.dtype == torch.float64 else torch.float32  # no FFT of half precision on a CPU
    texels = patch.to(images.device, precise)
    opaque = None if mask is None else mask.detach().to(texels)[None]
    scales = _find_scales(ranges, n, min(height, width))
    # drawn in the square around the image, and cut: the warp knows squares alone
    paper, covered = warp_patch(texels, T_image_patch, max(height, width), scales, opaque)
    paper, covered = paper[..., :height, :width], covered[..., :height, :width]
    return (images * (1 - covered) + paper).clamp(0, 1).to(images.dtype)


def _draw_placements(
    placement: Placer, seed: int | Sequence[int], count: int, patch_px: int, image_px: int
) -> np.ndarray:
    """(count, 3, 3) `T_image_patch`, each with a generator of its own."""
    # a generator for each image, so that it depends on neither order nor size of the batch
    streams = [(seed, i) for i in range(count)] if isinstance(seed, int | np.integer) else [(part,) for part in seed]
    return np.concatenate([placement.place(np.random.default_rng(s), 1, patch_px, image_px) for s in streams])


def _find_scales(placement: Placer, patch_px: int, image_px: int) -> tuple[float, float] | None:
    """Smallest and largest pixels per texel that may be drawn, so that no image depends on the others of its batch."""
    if not isinstance(placement, AffineRanges):
        return None
    low, high = (share * image_px / patch_px for share in placement.share)
    return low * placement.foreshortening[0], high * placement.foreshortening[1]


def _check_shapes(
    images: "torch.Tensor", patch: "torch.Tensor", seed: int | Sequence[int], mask: "torch.Tensor | None"
) -> None:
    # shapes are checked here, as anybody may call this with tensors of their own
    if images.ndim != 4 or images.shape[1] != 3 or not images.is_floating_point():
        found = f"{tuple(images.shape)} {images.dtype}"
        raise ToolkitError(f"images: expected (b, 3, h, w) float in [0, 1], got {found}: convert them first")
    n = patch.shape[-1] if patch.ndim else 0
    if tuple(patch.shape) not in ((3, n, n), (len(images), 3, n, n)) or n < SMALLEST_PX:
        raise ToolkitError(
            f"patch: expected (3, n, n), or (b, 3, n, n) with b = {len(images)} images, got {tuple(patch.shape)}"
        )
    if not patch.is_floating_point():
        raise ToolkitError(f"patch: expected float in [0, 1], got {patch.dtype}: divide 8-bit pixels by 255")
    if not isinstance(seed, int | np.integer) and len(seed) != len(images):
        raise ToolkitError(f"seed: expected one number, or {len(images)}, one for each image, got {len(seed)}")
    if mask is not None and tuple(mask.shape) != (n, n):
        raise ToolkitError(f"mask: expected ({n}, {n}), one number for each texel, got {tuple(mask.shape)}")


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
        seeds: b, a seed for each image.

    Returns:
        (b, 3, m, m) sRGB-encoded in [0, 1], differentiable in both.
    """
    # each image is placed by its own seed, whatever else is in the batch
    T_image_patch = placement.place_seeded(seeds, pictures.shape[-1], images.shape[-1])
    paper, mask = warp_patch(pictures, T_image_patch, images.shape[-1], placement.scale)
    return (images * (1 - mask) + paper).clamp(0, 1)
