"""Training on the mounted sheet: the patch as the rig shows it on its object, bent, lit and partly hidden.

The rig takes each view apart into buffers in which the picture is linear in the patch's linear colours
(`toolkit.rig.mounted`), so that gradients reach the patch through exact geometry and light.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.boosters.pixels import Target
from toolkit.boosters.validation import Share, Validation
from toolkit.core.draws import Draws
from toolkit.core.files import sha256_bytes
from toolkit.rig.mounted import MountedView
from toolkit.rig.shading import SHOULDER

if TYPE_CHECKING:
    import torch

EXPOSURE, TINT, NOISE = (0.75, 1.3), 0.05, 0.012
"""Drawn for each training image: factor on the light, each channel's deviation from it, sensor noise (sRGB)."""
HELD_OUT = 0.2
PAPER_GREY = 0.5
BATCH = 24


@dataclass(frozen=True)
class MountedViews:
    """Views as tensors; see `toolkit.rig.mounted.MountedView` for their meaning.

    Attributes:
        dark, gain: (k, 3, s, s) float16 linear.
        uv: (k, 4, s, s, 2) float16, NaN off the patch.
        sha256: of all of it.
    """

    dark: "torch.Tensor"
    gain: "torch.Tensor"
    uv: "torch.Tensor"
    sha256: str

    def __len__(self) -> int:
        return len(self.dark)

    def part(self, start: int, stop: int) -> "MountedViews":
        """Views `start` to `stop`."""
        return MountedViews(self.dark[start:stop], self.gain[start:stop], self.uv[start:stop], self.sha256)


def stack_views(views: list[MountedView], device: str) -> MountedViews:
    """Tensors on `device`."""
    import torch

    dark = np.stack([view.dark for view in views]).transpose(0, 3, 1, 2).astype(np.float16)
    gain = np.stack([view.gain for view in views]).transpose(0, 3, 1, 2).astype(np.float16)
    uv = np.stack([view.uv for view in views]).astype(np.float16)
    digest = sha256_bytes(b"".join(sha256_bytes(array.tobytes()).encode() for array in (dark, gain, uv)))

    def place(array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device)

    return MountedViews(place(dark), place(gain), place(uv), digest)


def divide_views(views: MountedViews) -> tuple[MountedViews, MountedViews]:
    """Those to train on, and the last fifth, which is held out."""
    kept = len(views) - max(1, round(len(views) * HELD_OUT))
    return views.part(0, kept), views.part(kept, len(views))


def show_mounted(
    patch: "torch.Tensor",
    views: MountedViews,
    which: np.ndarray,
    corners: np.ndarray,
    image_px: int,
    rng: np.random.Generator | None = None,
) -> "torch.Tensor":
    """Photographs of the object with a patch on its sheet.

    Args:
        patch: θ, (3, n, n) sRGB-encoded in [0, 1].
        views: of the object.
        which: (b,) views to show.
        corners: (b, 2) top and left of the cut.
        image_px: side of the cut.
        rng: draws exposure, tint and noise; None shows the views as they are.

    Returns:
        (b, 3, image_px, image_px) sRGB-encoded in [0, 1], differentiable in `patch`.
    """
    import torch

    cuts = [
        (k, slice(top, top + image_px), slice(left, left + image_px))
        for k, (top, left) in zip(which, corners, strict=True)
    ]
    light = torch.stack([views.dark[k, :, y, x] for k, y, x in cuts]).to(patch.dtype)
    factor = torch.ones((), dtype=patch.dtype)
    if rng is not None:
        count = len(cuts)
        drawn = rng.uniform(*EXPOSURE, (count, 1, 1, 1)) * rng.uniform(1 - TINT, 1 + TINT, (count, 3, 1, 1))
        factor = torch.as_tensor(drawn, dtype=patch.dtype, device=patch.device)
    photos = develop(light * factor)
    # only the patch's own pixels carry a gradient, and they are few
    uv = torch.stack([views.uv[k, :, y, x] for k, y, x in cuts])
    k, y, x = (~uv[..., 0].isnan()).any(dim=1).nonzero(as_tuple=True)
    gain = torch.stack([views.gain[one, :, rows, columns] for one, rows, columns in cuts])
    on_patch = light[k, :, y, x] + gain[k, :, y, x].to(patch.dtype) * _look_up(patch, uv[k, :, y, x].to(patch.dtype))
    photos = photos.permute(0, 2, 3, 1).index_put(
        (k, y, x), develop(on_patch * factor.expand(len(cuts), 3, 1, 1)[k, :, 0, 0])
    )
    photos = photos.permute(0, 3, 1, 2)
    if rng is not None:
        grain = torch.as_tensor(rng.standard_normal(photos.shape, np.float32), dtype=patch.dtype, device=patch.device)
        photos = photos + NOISE * grain
    return photos.clamp(0, 1)


def _look_up(patch: "torch.Tensor", uv: "torch.Tensor") -> "torch.Tensor":
    """Linear colours (p, 3) of a patch (3, n, n) at (p, 4, 2) places, mean over those of the four that are on it."""
    import torch
    from torch.nn.functional import grid_sample

    seen = (~uv[..., 0].isnan()).to(patch.dtype)
    weight = seen / seen.sum(dim=1, keepdim=True).clamp_min(1)
    grid = torch.stack([uv[..., 0] * 2 - 1, 1 - uv[..., 1] * 2], -1).nan_to_num(0)
    linear = srgb_to_linear(patch)[None]
    texels = grid_sample(linear, grid[None], mode="bilinear", padding_mode="border", align_corners=False)[0]
    return (texels * weight).sum(dim=2).T


def draw_mounted(
    views: MountedViews, draws: Draws, count: int, image_px: int
) -> Callable[["torch.Tensor"], "torch.Tensor"]:
    """A batch of random views at random cuts, waiting for its patch."""
    rng = draws.of("mounted")
    which = rng.choice(len(views), count, replace=count > len(views))
    corners = rng.integers(0, views.dark.shape[-1] - image_px + 1, (count, 2))
    return lambda patch: show_mounted(patch, views, which, corners, image_px, rng)


def validate_mounted(
    patch: "torch.Tensor", views: MountedViews, targets: list[Target], image_px: int
) -> list[Validation]:
    """Recognise held-out views with the patch, and with plain grey paper in its place."""
    import torch

    grey = torch.full_like(patch, PAPER_GREY)
    start = (views.dark.shape[-1] - image_px) // 2
    hits = np.zeros((2, len(targets)), int)
    with torch.inference_mode():
        for first in range(0, len(views), BATCH):
            which = np.arange(first, min(first + BATCH, len(views)))
            corners = np.full((len(which), 2), start)
            for row, sheet in enumerate((grey, patch)):
                photos = show_mounted(sheet, views, which, corners, image_px)
                for k, target in enumerate(targets):
                    hits[row, k] += int((target.classifier.logits(photos).argmax(1) == target.class_index).sum())
    count = len(views)
    return [
        Validation(target.classifier.name, Share(int(hits[0, k]), count), Share(int(hits[1, k]), count))
        for k, target in enumerate(targets)
    ]


def srgb_to_linear(encoded: "torch.Tensor") -> "torch.Tensor":
    """`toolkit.imaging.colour.srgb_to_linear`, differentiable."""
    import torch

    return torch.where(encoded <= 0.04045, encoded / 12.92, ((encoded.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def develop(light: "torch.Tensor") -> "torch.Tensor":
    """`toolkit.rig.shading.develop` without falloff and noise, differentiable; sRGB-encoded in [0, 1]."""
    import torch

    over = (light - SHOULDER).clamp_min(0)
    light = light.clamp_max(SHOULDER) + (1 - SHOULDER) * (1 - torch.exp(-over / (1 - SHOULDER)))
    light = light.clamp(0, 1)
    return torch.where(light <= 0.0031308, light * 12.92, 1.055 * light.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)
