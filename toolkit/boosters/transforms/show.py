"""A patch in photographs: printed, placed, seen by a camera, each step with the transforms that act there."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from toolkit.boosters.transforms import ImageTransform, PaperTransform, Placer
from toolkit.core.draws import Draws
from toolkit.core.lazy import F, np, scipy, torch

RIM_PX = 2
"""Around the patch's corners: what its filtered edge may reach."""


def find_windows(T_image_patch: "np.ndarray", patch_px: int, image_px: int) -> "tuple[np.ndarray, int]":
    """Squares of the same size, inside the image, that each hold all that is seen of a placed patch.

    Returns:
        (b, 2) int, their (left, top) corners in pixels, and their side.
    """
    square = np.array([[0, patch_px, patch_px, 0], [0, 0, patch_px, patch_px], [1, 1, 1, 1]], float)
    x, y, w = np.moveaxis(T_image_patch @ square, 1, 0)
    points = np.stack([x / w, y / w], axis=1)
    low = np.clip(np.floor(points.min(axis=2)) - RIM_PX, 0, image_px)
    high = np.clip(np.ceil(points.max(axis=2)) + RIM_PX, 0, image_px)
    # the largest box's side for the whole batch: windows of equal size stack into a tensor
    side = max(1, int((high - low).max()))
    # moved back into the image, where a window of the common side would leave it
    return np.minimum(low, image_px - side).astype(int), side


def move_origin(T_image_patch: "np.ndarray", corners: "np.ndarray") -> "np.ndarray":
    """`T_window_patch` for windows at `corners`."""
    T_window_image = np.tile(np.eye(3), (len(corners), 1, 1))
    T_window_image[:, :2, 2] = -corners
    return T_window_image @ T_image_patch


def cut_windows(images: "torch.Tensor", corners: "np.ndarray", side: int) -> "torch.Tensor":
    """(b, c, side, side) from (b, c, m, m)."""
    return torch.stack([image[:, y : y + side, x : x + side] for image, (x, y) in zip(images, corners, strict=True)])


def paste_windows(images: "torch.Tensor", windows: "torch.Tensor", corners: "np.ndarray") -> "torch.Tensor":
    """Images with their windows replaced, differentiable in both.

    Autograd would record sixteen assignments and copy the whole gradient for each; here it is cut once.
    """

    class Paste(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, below: torch.Tensor, above: torch.Tensor) -> torch.Tensor:
            # a copy: the images below are used again
            pasted = below.clone()
            for image, window, (x, y) in zip(pasted, above, corners, strict=True):
                image[:, y : y + window.shape[-2], x : x + window.shape[-1]] = window
            return pasted

        @staticmethod
        def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor | None, torch.Tensor]:
            (gradient,) = gradients
            side = windows.shape[-1]
            above = cut_windows(gradient, corners, side)
            # backgrounds are data: nobody asks for their gradient while a patch is trained
            if not ctx.needs_input_grad[0]:
                return None, above
            # below a window nothing of the image shows: no gradient reaches it
            below = gradient.clone()
            for image, (x, y) in zip(below, corners, strict=True):
                image[:, y : y + side, x : x + side] = 0
            return below, above

    return Paste.apply(images, windows)


@dataclass(frozen=True)
class WarpPlan:
    """Sizes that fit a batch of placements.

    Attributes:
        repeat: every texel becomes repeat × repeat, so that a magnified patch keeps its printed, sharp texel edges.
        side: of the zero-padded square that the filter runs on.
        start: where the patch begins in it, both axes.
        footprints: (b, 2, 2); columns are the pixel's edges a, b at the patch's centre, in repeated texels.
    """

    repeat: int
    side: int
    start: int
    footprints: "np.ndarray"


def plan_warp(T_image_patch: "np.ndarray", patch_px: int, scales: tuple[float, float] | None = None) -> WarpPlan:
    """Sizes for `warp_patch`; `T_image_patch` is (b, 3, 3), affine or projective."""
    jacobian = _jacobian(T_image_patch, patch_px)
    largest = np.linalg.norm(jacobian, 2, axis=(1, 2)).max() if scales is None else scales[1]
    # less a little, so that float noise above a whole number does not repeat once more
    repeat = max(1, int(np.ceil(largest - 1e-6)))
    # inverse Jacobian: a pixel's edges as seen from the patch, counted in repeated texels
    footprints = np.linalg.inv(jacobian) * repeat
    reach = np.abs(footprints).sum(axis=2).max() if scales is None else np.sqrt(2) * repeat / scales[0]
    margin = int(np.ceil(reach)) + 2
    side = scipy.fft.next_fast_len(-(-(patch_px * repeat + 2 * margin) // 16) * 16, real=True)
    return WarpPlan(repeat, side, (side - patch_px * repeat) // 2, footprints)


def _jacobian(T_image_patch: "np.ndarray", patch_px: int) -> "np.ndarray":
    """(b, 2, 2) image pixels per texel at the patch's centre; exact everywhere when affine."""
    centre = np.array([patch_px / 2, patch_px / 2, 1])
    x, y, w = np.moveaxis(T_image_patch @ centre, -1, 0)
    # quotient rule of (x / w, y / w): (∂x - x/w ∂w) / w
    rows, last = T_image_patch[:, :2, :2], T_image_patch[:, 2:, :2]
    return (rows - np.stack([x / w, y / w], -1)[:, :, None] * last) / w[:, None, None]


def warp_patch(
    patch: "torch.Tensor", T_image_patch: "np.ndarray", image_px: int, scales: tuple[float, float] | None = None,
    mask: "torch.Tensor | None" = None,
) -> tuple["torch.Tensor", "torch.Tensor"]:  # fmt: skip
    """Draw a patch and its mask into images.

    The mask is explicit: without a mask every texel of the square is opaque, black ones too.

    Args:
        patch: (3, n, n), or (b, 3, n, n) for a patch per image; any values, any encoding.
        T_image_patch: (b, 3, 3), see `toolkit.boosters.transforms.placement` for the convention.
        image_px: side m of the images.
        scales: smallest and largest pixels per texel that may come, of similarities; an image then does not depend on
            the others of its batch, from which the sizes are else taken.
        mask: (1, n, n), or (b, 1, n, n) with a patch for each image: how opaque each texel is, in [0, 1].

    Returns:
        The patch times its mask, (b, 3, m, m), and the mask, (b, 1, m, m): the share of each pixel that it covers.
    """
    plan = plan_warp(T_image_patch, patch.shape[-1], scales)
    # patch and mask go through the same filter, so that they fit at the rim
    opaque = torch.ones_like(patch[..., :1, :, :])
    texels = torch.cat([patch, opaque] if mask is None else [patch * mask, opaque * mask], dim=-3)
    # texels are enlarged before they are filtered, if the picture shows them large
    if plan.repeat > 1:
        texels = texels.repeat_interleave(plan.repeat, -1).repeat_interleave(plan.repeat, -2)
    # room around the patch, for the filter and for a size that the transform likes
    end = plan.side - plan.start - texels.shape[-1]
    padded = F.pad(texels, (plan.start, end, plan.start, end))
    # the filter in frequency space, of the size that each image needs
    window = torch.as_tensor(_filter_windows(plan), dtype=patch.dtype, device=patch.device)
    spectrum = torch.fft.rfft2(padded) * window[:, None]
    filtered = torch.fft.irfft2(spectrum, s=(plan.side, plan.side))
    grid = _sampling_grid(T_image_patch, plan, image_px, patch)
    # zeros outside: the patch has no neighbours, so that its rim fades by the share that is covered
    drawn = F.grid_sample(filtered, grid, mode="bilinear", padding_mode="zeros", align_corners=False)
    # the filter rings a little beyond [0, 1]; the mask is geometry, and has no gradient
    return drawn[:, :3], drawn[:, 3:].detach().clamp(0, 1)


def _filter_windows(plan: WarpPlan) -> "np.ndarray":
    """(b, side, side // 2 + 1) float32 transfer functions of the pixel footprints.

    Bilinear look-up filters by sinc² per axis where square texels need sinc once; the window divides one of them out.
    """
    down, right = np.fft.fftfreq(plan.side)[:, None], np.fft.rfftfreq(plan.side)[None]
    edges = np.moveaxis(plan.footprints, 0, -1)[..., None, None].astype(np.float32)
    down, right = down.astype(np.float32), right.astype(np.float32)
    window = np.sinc(right * edges[0, 0] + down * edges[1, 0]) * np.sinc(right * edges[0, 1] + down * edges[1, 1])
    return window / (np.sinc(right) * np.sinc(down))


def _sampling_grid(T_image_patch: "np.ndarray", plan: WarpPlan, image_px: int, like: "torch.Tensor") -> "torch.Tensor":
    """(b, m, m, 2) look-up positions of pixel centres, in `grid_sample`'s [-1, 1], of `like`'s type and device."""
    # texels to [-1, 1] of the padded square: 2 (repeat · t + start) / side - 1
    to_unit = np.array(
        [[2 * plan.repeat, 0, 2 * plan.start - plan.side], [0, 2 * plan.repeat, 2 * plan.start - plan.side]]
    )
    to_unit = np.vstack([to_unit / plan.side, [0, 0, 1]])
    T_unit_image = torch.as_tensor(to_unit @ np.linalg.inv(T_image_patch), dtype=like.dtype, device=like.device)
    centres = torch.arange(image_px, dtype=like.dtype, device=like.device) + 0.5
    x, y, w = (T_unit_image[:, :, k, None, None] for k in range(3))
    points = x * centres[None, None, None, :] + y * centres[None, None, :, None] + w
    # w is 1 everywhere for affine placements: the division is spared
    if np.allclose(T_image_patch[:, 2], [0, 0, 1]):
        return points[:, :2].permute(0, 2, 3, 1)
    return (points[:, :2] / points[:, 2:]).permute(0, 2, 3, 1)


Mounted = Callable[["torch.Tensor"], "torch.Tensor"]
"""Printed θ -> (b, 3, m, m) pictures of the object with the patch on it."""


@dataclass(frozen=True)
class Appearance:
    """The transforms, each with its own random draws.

    Attributes:
        placement: where the patch lies.
        on_print: what the printer does to the patch.
        on_paper: what the scene does to the paper.
        on_photo: what the camera does to the photograph.
    """

    placement: Placer
    on_print: tuple[ImageTransform, ...] = ()
    on_paper: tuple[PaperTransform, ...] = ()
    on_photo: tuple[ImageTransform, ...] = ()


def show_patch(
    patch: "torch.Tensor", images: "torch.Tensor", appearance: Appearance, draws: Draws, mounted: Mounted | None = None
) -> "torch.Tensor":
    """Photographs with the printed patch in them: the three steps below, in order.

    Args:
        patch: θ, (3, n, n) sRGB-encoded in [0, 1].
        images: x, (b, 3, m, m) sRGB-encoded in [0, 1]; may be none where there are others.
        appearance: the transforms.
        draws: of this step.
        mounted: pictures of the object that wait for the patch on it; they come last.

    Returns:
        (b, 3, m, m) sRGB-encoded in [0, 1], differentiable in `patch`.
    """
    printed = print_patch(patch, appearance, draws)
    # the same print for flat placements and views of the object alike
    scenes = [place_patch(printed, images, appearance, draws)] if len(images) else []
    if mounted is not None:
        scenes.append(mounted(printed))
    return take_photos(torch.cat(scenes), appearance, draws)


def print_patch(patch: "torch.Tensor", appearance: Appearance, draws: Draws) -> "torch.Tensor":
    """θ, (3, n, n) sRGB-encoded in [0, 1], as it comes out of the printer."""
    for transform in appearance.on_print:
        patch = transform.change(patch, transform.rng(draws))
    return patch


def place_patch(patch: "torch.Tensor", images: "torch.Tensor", appearance: Appearance, draws: Draws) -> "torch.Tensor":
    """Scenes with the print in them: x (1 - T(mask)) + T(θ) T(mask), the paper's Algorithm 1.

    At the patch's edge T(θ) T(mask) is read as the average of θ·mask over the pixel: transforming the two apart and
    multiplying after would fade the rim twice. Shapes as in `show_patch`.
    """
    T_image_patch = appearance.placement.place(
        draws.of(type(appearance.placement).__name__), len(images), patch.shape[-1], images.shape[-1]
    )
    # only a window around each patch is drawn: most of an image stays as it is
    corners, side = find_windows(T_image_patch, patch.shape[-1], images.shape[-1])
    paper, mask = warp_patch(patch, move_origin(T_image_patch, corners), side)
    # light falls on the paper, not on what lies around it
    for transform in appearance.on_paper:
        paper = transform.light(paper, mask, transform.rng(draws))
    around = cut_windows(images, corners, side)
    return paste_windows(images, (around * (1 - mask) + paper).clamp(0, 1), corners)


def take_photos(scenes: "torch.Tensor", appearance: Appearance, draws: Draws) -> "torch.Tensor":
    """(b, 3, m, m) scenes as the camera gives them."""
    for transform in appearance.on_photo:
        scenes = transform.change(scenes, transform.rng(draws))
    return scenes
