"""Algorithm 2: a texture goes down the gradient of the loss over random views of the objects that wear it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from toolkit.boosters.linear_view import ViewBatch, batch_views, show_texture
from toolkit.boosters.patch_steps import Target, judge_photos, smooth_gradient
from toolkit.boosters.texture_config import Optimiser, TextureRequest
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import srgb_to_linear
from toolkit.rig.views import StreamedView, ViewStream

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class Step:
    """After one step.

    Attributes:
        done: how many steps have been made.
        texture: θ, (3, n, n) float32 in [0, 1], not dilated; a copy, as are the optimiser's arrays.
        optimiser: its state by name.
        loss: cross-entropy of the batch before the step, summed over the networks.
        accuracy: share of the batch recognised before the step, mean over the networks.
    """

    done: int
    texture: np.ndarray
    optimiser: dict[str, np.ndarray]
    loss: float
    accuracy: float


def dilate(texture: "torch.Tensor", source: "torch.Tensor") -> "torch.Tensor":
    """(3, n, n) with the colour of the nearest seen texel on all that are not seen; `source` as in `Atlas`."""
    return texture.flatten(1)[:, source.reshape(-1)].view(texture.shape)


def train_steps(
    texture: "torch.Tensor",
    source: "torch.Tensor",
    done: int,
    optimiser: Optimiser,
    targets: list[Target],
    stream: ViewStream,
    request: TextureRequest,
    backgrounds: np.ndarray,
) -> Iterator[Step]:
    """Make the steps from number `done` to the last, one per turn of the caller's loop.

    Step i depends on θ, the optimiser's state and (seed, i) alone, so a run that is taken up again ends where an
    uninterrupted one does.

    Args:
        texture: θ after `done` steps, (3, n, n) in [0, 1]; changed in place.
        source: (n, n) int64 flat index of the texel that gives each texel its colour.
        done: how many steps were made before.
        optimiser: of `texture`.
        targets: the networks, at least one.
        stream: of views.
        request: the rest.
        backgrounds: (k, s, s, 3) uint8 sRGB, s at least the views' side; may be empty.

    Raises:
        ToolkitError: the loss or its gradient is not a finite number.
    """
    import torch

    descent = request.descent
    for index in range(done, descent.steps):
        group, inside = divmod(index, request.steps_per_group)
        views = choose_views(stream.group(group), request, group, inside)
        draws = Draws(descent.seed, index)
        behind = choose_backgrounds(backgrounds, request, draws.of("backgrounds"), len(views))
        batch = batch_views([one.view for one in views], str(texture.device), behind)
        theta = texture.detach().clone().requires_grad_(True)
        photos = take_photos(dilate(theta, source), batch, request, draws)
        loss, accuracy = judge_photos(photos, targets)
        (gradient,) = torch.autograd.grad(loss, theta)
        if not isfinite(loss.item()) or not bool(torch.isfinite(gradient).all()):
            raise ToolkitError(
                f"the loss or its gradient at step {index + 1} is not a finite number (loss {loss.item()}): "
                "the network's weights do not fit its images; check --model and --weights"
            )
        optimiser.step(smooth_gradient(gradient, descent.smoothing_at(index)), descent.lr_at(index))
        yield Step(index + 1, texture.cpu().numpy().copy(), optimiser.arrays(), loss.item(), accuracy)


def take_photos(texture: "torch.Tensor", batch: ViewBatch, request: TextureRequest, draws: Draws) -> "torch.Tensor":
    """Photographs (b, 3, s, s) of a dilated texture as the camera of `request` gives them, sRGB-encoded in [0, 1]."""
    count = len(batch)
    light = 1.0 if request.exposure is None else request.exposure.draw(draws.of("exposure"), count, texture)
    photos = show_texture(texture, batch, request.gradient, light)
    for part in request.camera:
        photos = part.change(photos, draws.of(type(part).__name__))
    return photos


def choose_views(group: list[StreamedView], request: TextureRequest, number: int, inside: int) -> list[StreamedView]:
    """The views of the step `inside` a group: each comes `reuse` times before the group is left, in random order."""
    rng = np.random.default_rng([request.descent.seed, number, 0x0DE5])
    order = np.concatenate([rng.permutation(len(group)) for _ in range(request.reuse)])
    start = inside * request.descent.batch
    return [group[k] for k in np.resize(order, start + request.descent.batch)[start:]]


def choose_backgrounds(
    photographs: np.ndarray, request: TextureRequest, rng: np.random.Generator, count: int
) -> list[np.ndarray | None]:
    """For each of `count` views a random cut of a photograph in linear light, or None where the studio stays."""
    side = request.views.image_px
    chosen: list[np.ndarray | None] = []
    for acting in rng.random(count) < request.background_share:
        if not (acting and len(photographs)):
            chosen.append(None)
            continue
        photograph = photographs[rng.integers(len(photographs))]
        top, left = rng.integers(0, np.array(photograph.shape[:2]) - side + 1)
        cut = photograph[top : top + side, left : left + side]
        chosen.append(srgb_to_linear((cut[:, ::-1] if rng.random() < 0.5 else cut) / np.float32(255)))
    return chosen
