"""A patch drawn under many transforms at once, differentiably and without aliasing.

A patch of 100 texels is drawn some 60 pixels wide, and 15 when seen obliquely: each pixel must average the texels that
it covers. That average is a box filter whose shape is the pixel's footprint in the patch, a parallelogram with edges a
and b, and the Fourier transform of that box is sinc(f·a) sinc(f·b). So the patch is transformed once, multiplied by
one such window per image, transformed back, and sampled by one bilinear look-up. The cost does not grow with the
minification, and oblique views are not over-blurred as a mip-map would.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class WarpPlan:
    """Sizes that fit one batch of placements.

    Attributes:
        repeat: every texel becomes repeat × repeat, so that a magnified patch keeps its printed, sharp texel edges.
        side: of the zero-padded square that the filter runs on.
        start: where the patch begins in it, both axes.
        footprints: (b, 2, 2); columns are the pixel's edges a, b at the patch's centre, in repeated texels.
    """

    repeat: int
    side: int
    start: int
    footprints: np.ndarray


def plan_warp(T_image_patch: np.ndarray, patch_px: int, scales: tuple[float, float] | None = None) -> WarpPlan:
    """Sizes for `warp_patch`; `T_image_patch` is (b, 3, 3), affine or projective."""
    from scipy.fft import next_fast_len

    jacobian = _jacobian(T_image_patch, patch_px)
    largest = np.linalg.norm(jacobian, 2, axis=(1, 2)).max() if scales is None else scales[1]
    repeat = max(1, int(np.ceil(largest - 1e-6)))
    footprints = np.linalg.inv(jacobian) * repeat
    reach = np.abs(footprints).sum(axis=2).max() if scales is None else np.sqrt(2) * repeat / scales[0]
    margin = int(np.ceil(reach)) + 2
    side = next_fast_len(-(-(patch_px * repeat + 2 * margin) // 16) * 16, real=True)
    return WarpPlan(repeat, side, (side - patch_px * repeat) // 2, footprints)


def _jacobian(T_image_patch: np.ndarray, patch_px: int) -> np.ndarray:
    """(b, 2, 2) image pixels per texel at the patch's centre; exact everywhere when affine."""
    centre = np.array([patch_px / 2, patch_px / 2, 1])
    x, y, w = np.moveaxis(T_image_patch @ centre, -1, 0)
    rows, last = T_image_patch[:, :2, :2], T_image_patch[:, 2:, :2]
    return (rows - np.stack([x / w, y / w], -1)[:, :, None] * last) / w[:, None, None]


def warp_patch(
    patch: "torch.Tensor", T_image_patch: np.ndarray, image_px: int, scales: tuple[float, float] | None = None
) -> tuple["torch.Tensor", "torch.Tensor"]:
    """Draw a patch and its mask into images.

    The mask is explicit: every texel of the square is opaque, black ones too.

    Args:
        patch: (3, n, n), or (b, 3, n, n) for one per image; any values, any encoding.
        T_image_patch: (b, 3, 3), see `toolkit.boosters.affine` for the convention.
        image_px: side m of the images.
        scales: smallest and largest pixels per texel that may come, of similarities; an image then does not depend on
            the others of its batch, from which the sizes are else taken.

    Returns:
        The patch times its mask, (b, 3, m, m), and the mask, (b, 1, m, m): the share of each pixel that it covers.
    """
    import torch
    from torch.nn.functional import grid_sample, pad

    plan = plan_warp(T_image_patch, patch.shape[-1], scales)
    texels = torch.cat([patch, torch.ones_like(patch[..., :1, :, :])], dim=-3)
    if plan.repeat > 1:
        texels = texels.repeat_interleave(plan.repeat, -1).repeat_interleave(plan.repeat, -2)
    end = plan.side - plan.start - texels.shape[-1]
    padded = pad(texels, (plan.start, end, plan.start, end))
    window = torch.as_tensor(_filter_windows(plan), dtype=patch.dtype, device=patch.device)
    spectrum = torch.fft.rfft2(padded) * window[:, None]
    filtered = torch.fft.irfft2(spectrum, s=(plan.side, plan.side))
    grid = _sampling_grid(T_image_patch, plan, image_px, patch.dtype, patch.device)
    drawn = grid_sample(filtered, grid, mode="bilinear", padding_mode="zeros", align_corners=False)
    return drawn[:, :3], drawn[:, 3:].detach().clamp(0, 1)


def _filter_windows(plan: WarpPlan) -> np.ndarray:
    """(b, side, side // 2 + 1) float32 transfer functions of the pixel footprints.

    Bilinear look-up filters by sinc² per axis where square texels need sinc once; the window divides one of them out.
    """
    down, right = np.fft.fftfreq(plan.side)[:, None], np.fft.rfftfreq(plan.side)[None]
    edges = np.moveaxis(plan.footprints, 0, -1)[..., None, None].astype(np.float32)
    down, right = down.astype(np.float32), right.astype(np.float32)
    window = np.sinc(right * edges[0, 0] + down * edges[1, 0]) * np.sinc(right * edges[0, 1] + down * edges[1, 1])
    return window / (np.sinc(right) * np.sinc(down))


def _sampling_grid(T_image_patch: np.ndarray, plan: WarpPlan, image_px: int, dtype, device) -> "torch.Tensor":
    """(b, m, m, 2) look-up positions for every pixel centre, in `grid_sample`'s [-1, 1]."""
    import torch

    to_unit = np.array(
        [[2 * plan.repeat, 0, 2 * plan.start - plan.side], [0, 2 * plan.repeat, 2 * plan.start - plan.side]]
    )
    to_unit = np.vstack([to_unit / plan.side, [0, 0, 1]])
    T_unit_image = torch.as_tensor(to_unit @ np.linalg.inv(T_image_patch), dtype=dtype, device=device)
    centres = torch.arange(image_px, dtype=dtype, device=device) + 0.5
    x, y, one = (T_unit_image[:, :, k, None, None] for k in range(3))
    points = x * centres[None, None, None, :] + y * centres[None, None, :, None] + one
    if np.allclose(T_image_patch[:, 2], [0, 0, 1]):
        return points[:, :2].permute(0, 2, 3, 1)
    return (points[:, :2] / points[:, 2:]).permute(0, 2, 3, 1)
