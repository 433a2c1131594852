"""Photographs of an object, differentiable in the texture of a material: Algorithm 2, forward and backward.

The material may be the object's own, or the sheet that is stuck on it: both are `toolkit.rig.shading.LinearView`s.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import cv2
import numpy as np

from toolkit.boosters.transforms.printing import encode
from toolkit.core.lazy import F, torch
from toolkit.rig.shading import SHOULDER, LinearView

SMALLEST = 4
"""Side of the coarsest level."""


def build_levels(linear: "torch.Tensor") -> list["torch.Tensor"]:
    """Halve (3, n, n) by area average until a side is 4; level 0 is the input, as `build_pyramid` does."""
    levels = [linear]
    while levels[-1].shape[-1] > SMALLEST:
        levels.append(_halve(levels[-1]))
    return levels


def _halve(level: "torch.Tensor") -> "torch.Tensor":
    # even sides need no matrix: the mean of two by two is the area average
    if level.shape[-1] % 2 == 0:
        rows = 0.5 * level[:, 0::2] + 0.5 * level[:, 1::2]
        return 0.5 * rows[..., 0::2] + 0.5 * rows[..., 1::2]
    halve = torch.from_numpy(_halving(level.shape[-1])).to(level)
    return halve @ level @ halve.T


@lru_cache(maxsize=32)
def _halving(side: int) -> np.ndarray:
    """(side // 2, side) weights of OpenCV's area average, which also serve odd sides."""
    return cv2.resize(np.eye(side, dtype=np.float32), (side, side // 2), interpolation=cv2.INTER_AREA)


def look_up(levels: list["torch.Tensor"], uv: "torch.Tensor", lod: "torch.Tensor") -> "torch.Tensor":
    """Trilinear colours (k, 3) at (k, 2) places, u right and v up; the texture repeats outside [0, 1].

    Args:
        levels: of `build_levels`.
        uv: places.
        lod: (k,) base-2 logarithm of level-0 texels per pixel.
    """
    lod = lod.clamp(0, len(levels) - 1)
    found = levels[0].new_zeros((len(uv), 3))
    if not len(uv):
        return found
    # only the levels that samples use
    for number in range(int(lod.min()), int(lod.max().ceil()) + 1):
        # a hat over the level of detail: the two nearest levels share a sample, which is trilinear's third axis
        weight = (1 - (lod - number).abs()).clamp_min(0)
        chosen = weight.nonzero()[:, 0]
        if len(chosen):
            colour = _look_up_level(levels[number], uv[chosen])
            found = found.index_add(0, chosen, colour * weight[chosen, None])
    return found


def _look_up_level(level: "torch.Tensor", uv: "torch.Tensor") -> "torch.Tensor":
    side = level.shape[-1]
    # a ring of texels from the other side, as grid_sample cannot repeat a texture
    wrapped = F.pad(level[None], (1, 1, 1, 1), mode="circular")
    u, v = uv[:, 0] - uv[:, 0].floor(), uv[:, 1] - uv[:, 1].floor()
    inner = side / (side + 2)  # the ring of repeated texels makes the picture a little larger
    grid = uv.new_empty((1, 1, len(uv), 2))
    # v counts up, rows count down
    grid[0, 0, :, 0], grid[0, 0, :, 1] = (u * 2 - 1) * inner, (1 - v * 2) * inner
    return F.grid_sample(wrapped, grid, mode="bilinear", align_corners=False)[0, :, 0].T


def srgb_to_linear(encoded: "torch.Tensor") -> "torch.Tensor":
    """`toolkit.imaging.colour.srgb_to_linear`, differentiable."""
    return torch.where(encoded <= 0.04045, encoded / 12.92, ((encoded.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def tone_map(light: "torch.Tensor") -> "torch.Tensor":
    """`toolkit.rig.shading.tone_map` without falloff and noise, differentiable; sRGB-encoded in [0, 1]."""
    # straight up to the shoulder, then an exponential that begins with slope 1 and ends at white
    over = (light - SHOULDER).clamp_min(0)
    return encode(light.clamp_max(SHOULDER) + (1 - SHOULDER) * (1 - torch.exp(-over / (1 - SHOULDER))))


@dataclass(frozen=True)
class ViewBatch:
    """Views as tensors; see `LinearView` for their meaning.

    Attributes:
        still: (b, h, w, 3) linear light of all but the material.
        counts: (b,) samples of each view; those of a view lie side by side.
        pixel: (k,) int64 pixel of each sample among the h · w of its view.
        uv, lod, gain: (k, 2), (k,), (k, 3) of the samples.
        share: (k,) share of its pixel that a sample stands for.
        repaints: `LinearView.repaint` of each view, with its photograph behind; empty for views of the ray caster.
    """

    still: "torch.Tensor"
    counts: tuple[int, ...]
    pixel: "torch.Tensor"
    uv: "torch.Tensor"
    lod: "torch.Tensor"
    gain: "torch.Tensor"
    share: "torch.Tensor"
    repaints: tuple[Callable[[np.ndarray], np.ndarray], ...] = ()

    def __len__(self) -> int:
        return len(self.counts)

    def part(self, start: int, stop: int) -> "ViewBatch":
        """Views `start` to `stop`."""
        first, last = sum(self.counts[:start]), sum(self.counts[:stop])
        samples = {name: getattr(self, name)[first:last] for name in ("pixel", "uv", "lod", "gain", "share")}
        return ViewBatch(self.still[start:stop], self.counts[start:stop], **samples)

    def to(self, dtype: "torch.dtype") -> "ViewBatch":
        """The same views in another precision."""
        floats = {name: getattr(self, name).to(dtype) for name in ("still", "uv", "lod", "gain", "share")}
        return replace(self, **floats)

    def through(self, factor: "torch.Tensor", offset: "torch.Tensor") -> "ViewBatch":
        """The same views seen through weather, which makes `factor · light + offset` of light; both (b, h, w, 3)."""
        device = self.pixel.device
        factor, offset, counts = factor.to(device), offset.to(device), torch.tensor(self.counts, device=device)
        view = torch.arange(len(counts), device=device).repeat_interleave(counts)
        # light of the texture passes the same weather as all else in its pixel
        passed = factor.flatten(1, 2)[view, self.pixel].to(self.gain.dtype)
        still = (self.still * factor + offset).to(self.still.dtype)
        return replace(self, still=still, gain=self.gain * passed, share=self.share * passed.mean(1))

    def cut(self, which: np.ndarray, corners: np.ndarray, side: int, dtype: "torch.dtype") -> "ViewBatch":
        """Squares of some views.

        Args:
            which: (b,) numbers of views.
            corners: (b, 2) top and left of each square.
            side: of the squares, pixels.
            dtype: of what is returned.
        """
        # the samples of a view lie between two starts
        width, starts = self.still.shape[2], np.cumsum([0, *self.counts]).tolist()
        still, pixels = [], []
        chosen: list[slice | torch.Tensor] = []
        for view, (top, left) in zip(which.tolist(), corners.tolist(), strict=True):
            still.append(self.still[view, top : top + side, left : left + side])
            span = slice(starts[view], starts[view + 1])
            # pixels by their number in the picture; those outside the square have no place in it
            row, column = self.pixel[span] // width - top, self.pixel[span] % width - left
            inside = ((row >= 0) & (row < side) & (column >= 0) & (column < side)).nonzero()[:, 0]
            pixels.append((row * side + column)[inside])
            # a slice copies nothing where the whole view is inside
            chosen.append(span if len(inside) == len(row) else inside + span.start)
        samples: dict[str, Any] = {
            name: torch.cat([getattr(self, name)[some] for some in chosen]).to(dtype)
            for name in ("uv", "lod", "gain", "share")
        }
        counts = tuple(len(rows) for rows in pixels)
        return ViewBatch(torch.stack(still).to(dtype), counts, torch.cat(pixels), **samples)


def batch_views(
    views: list[LinearView], device: str, behind: "list[np.ndarray | None] | None" = None, half: bool = False
) -> ViewBatch:
    """Put views of the same size together.

    Args:
        views: at least one.
        device: where the tensors go.
        behind: per view, (h, w, 3) float32 linear light of a photograph in place of table and room, or None.
        half: keep light in half precision, for many views.
    """
    precision = np.float16 if half else np.float32
    # a photograph may stand behind, in place of table and room
    pairs = list(zip(views, behind or [None] * len(views), strict=True))
    still = np.stack(
        [
            # what lies behind shows through where the object covers a pixel in part
            (view.dark + (1 - view.coverage[..., None]) * (view.behind if back is None else back).astype(np.float32))
            .astype(precision)
            for view, back in pairs
        ]
    )  # fmt: skip

    # views differ in their number of pixels: the rows of all follow each other, `counts` has the number of each
    def gather(name: str, kind: type) -> torch.Tensor:
        rows: np.ndarray = np.concatenate([getattr(view, name) for view in views]).astype(kind)
        return torch.from_numpy(rows).to(device)

    return ViewBatch(
        still=torch.from_numpy(still).to(device), counts=tuple(len(view.pixel) for view in views),
        pixel=gather("pixel", np.int64), uv=gather("uv", np.float32), lod=gather("lod", precision),
        gain=gather("gain", precision), share=gather("share", precision),
        repaints=tuple(partial(_repaint_before, view, back) for view, back in pairs if view.repaint is not None),
    )  # fmt: skip


def _repaint_before(view: LinearView, back: np.ndarray | None, pixels: np.ndarray) -> np.ndarray:
    """(h, w, 3) float32 light of a view in its other renderer, with these texels and a photograph behind."""
    assert view.repaint is not None
    light = view.repaint(pixels)
    if back is None:
        return light
    share = view.coverage[..., None].astype(np.float32)
    # on the rim a pixel holds some of the table: about as much as the ray caster sees there
    rim = np.maximum(light + (1 - share) * (back - view.behind), 0)
    return np.where(share > 0, rim, back).astype(np.float32)


def batch_pictures(lights: list[np.ndarray], device: str) -> ViewBatch:
    """(h, w, 3) linear light of pictures as views in which nothing of the material is seen."""
    still = torch.from_numpy(np.stack(lights)).to(device)
    nothing = still.new_zeros(0)
    return ViewBatch(
        still, (0,) * len(lights), pixel=nothing.long(), uv=nothing.view(0, 2).float(), lod=nothing,
        gain=nothing.view(0, 3), share=nothing,
    )  # fmt: skip


def show_texture(
    texture: "torch.Tensor", batch: ViewBatch, gradient: str = "shaded", light: "torch.Tensor | float" = 1.0
) -> "torch.Tensor":
    """Photographs of the objects with a texture on them.

    Both gradients give the same picture: the rig's, or that of `batch.repaints`. `shaded` differentiates the rig's
    picture: texture × light, tone mapped. `linear` is the paper's `x_drend - detach(x_drend) + x_rend` (Salman et al.
    2021, Algorithm 2), where `x_drend` is the texture itself at the place that each pixel sees, without light.

    Args:
        texture: θ, (3, n, n) sRGB-encoded in [0, 1], dilated.
        batch: of the views.
        gradient: `shaded` or `linear`.
        light: factor on all light, broadcast to (b, 3, 1, 1).

    Returns:
        (b, 3, h, w) sRGB-encoded in [0, 1].
    """
    linear = srgb_to_linear(texture)
    if gradient == "shaded":
        shaded = show_linear(linear, batch, light)
        return _show_repainted(texture, batch, light) + (shaded - shaded.detach()) if batch.repaints else shaded
    with torch.no_grad():
        rendered = _show_repainted(texture, batch, light) if batch.repaints else show_linear(linear, batch, light)
    # the texture's own colour, where each pixel sees it
    slot, shown = _find_shown(batch)
    colour = look_up(build_levels(texture), batch.uv, batch.lod) * batch.share[:, None]
    # adds 0 forward: the picture stays as it is, and the gradient is that of the texture's own colour
    flat = colour.new_zeros((len(shown), 3)).index_add(0, slot, colour)
    count, _, height, width = rendered.shape
    photos = rendered.permute(0, 2, 3, 1).reshape(-1, 3).index_add(0, shown, flat - flat.detach())
    return photos.view(count, height, width, 3).permute(0, 3, 1, 2)


def _show_repainted(texture: "torch.Tensor", batch: ViewBatch, light: "torch.Tensor | float") -> "torch.Tensor":
    """`show_texture` by `batch.repaints`, without a gradient; the renderer gets the texture in 8 bits."""
    pixels = (texture.detach().permute(1, 2, 0) * 255).round().to(torch.uint8).cpu().numpy()
    lights = torch.from_numpy(np.stack([repaint(pixels) for repaint in batch.repaints])).to(texture)
    return tone_map(lights.permute(0, 3, 1, 2) * light)


def show_linear(linear: "torch.Tensor", batch: ViewBatch, light: "torch.Tensor | float" = 1.0) -> "torch.Tensor":
    """`show_texture` of linear colours, differentiable as it is."""
    count, height, width, _ = batch.still.shape
    # a factor for each colour of each view
    factor = torch.as_tensor(light, dtype=linear.dtype, device=linear.device).expand(count, 3, 1, 1).flatten(1)
    photos = torch.stack([tone_map(still * scale) for still, scale in zip(batch.still, factor, strict=True)]).view(
        -1, 3
    )
    # only pixels that show the material carry a gradient, and they may be few
    slot, shown = _find_shown(batch)
    colour = look_up(build_levels(linear), batch.uv, batch.lod) * batch.gain
    lit = batch.still.view(-1, 3)[shown].index_add(0, slot, colour) * factor[shown // (height * width)]
    whole = F.pad(lit, (0, 0, 0, -len(lit) % 256))  # an array's last odd values would be rounded otherwise
    return photos.index_put((shown,), tone_map(whole)[: len(lit)]).view(count, height, width, 3).permute(0, 3, 1, 2)


def _find_shown(batch: ViewBatch) -> tuple["torch.Tensor", "torch.Tensor"]:
    """(k,) which pixel of those that show the material a sample counts for, and (t,) these among all of the batch."""
    count, height, width, _ = batch.still.shape
    counts = torch.tensor(batch.counts, device=batch.pixel.device)
    start = torch.arange(count, device=batch.pixel.device) * (height * width)
    pixel = batch.pixel + start.repeat_interleave(counts)
    seen = torch.zeros(count * height * width, dtype=torch.bool, device=pixel.device)
    seen[pixel] = True
    # counting the seen pixels up to each gives its place among them
    return (seen.cumsum(0) - 1)[pixel], seen.nonzero()[:, 0]
