"""Algorithm 1: a patch goes down the sign of the loss's gradient, step by step."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from math import cos, isfinite, pi
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit.boosters.data import draw_batch
from toolkit.boosters.parts.base import Appearance, place_patch, print_patch, take_photos
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError, one_of
from toolkit.models.precision import mixed_precision

if TYPE_CHECKING:
    import torch

SCHEDULES = ("constant", "linear", "cosine")
LAST_LR_SHARE = 0.05
"""The learning rate never falls below this share: a step under half an 8-bit level would change nothing."""


Mounted = Callable[["torch.Tensor"], "torch.Tensor"]
"""Printed θ -> (b, 3, m, m) pictures of the object with the patch on it."""
Penalty = Callable[["torch.Tensor"], "torch.Tensor"]
"""θ -> a loss of the patch itself, a scalar."""


@dataclass(frozen=True)
class Target:
    """A network and the class that it shall see.

    Attributes:
        classifier: a `toolkit.models` Classifier, or anything with its `logits`.
        class_index: in that network's own labels.
    """

    classifier: Any
    class_index: int


@dataclass(frozen=True)
class Descent:
    """How the patch is moved.

    Attributes:
        steps: K, how often.
        batch: images per step.
        lr: η, change of every texel in the first step, in units of the full range [0, 1].
        schedule: how η falls over the steps: `constant`, `linear` or `cosine`.
        seed: of every random draw.
        smoothing_px: standard deviation, in texels, of a Gaussian that the gradient is smoothed with before its sign is
            taken; it falls to 0 over the steps. Texels smaller than a pixel get gradients that are mostly noise, whose
            signs would step at random; 0 is the seed's plain algorithm.
        start_contrast: range of the random first patch about middle grey, 1 is all of [0, 1].
    """

    steps: int = 300
    batch: int = 16
    lr: float = 0.1
    schedule: str = "cosine"
    seed: int = 0
    smoothing_px: float = 2.0
    start_contrast: float = 0.2

    def __post_init__(self) -> None:
        if self.schedule not in SCHEDULES:
            raise one_of("schedule", self.schedule, list(SCHEDULES))
        if self.steps < 1 or self.batch < 1:
            raise ToolkitError(f"--steps {self.steps} --batch {self.batch}: expected at least 1 of each")
        if not 0 < self.lr <= 1:
            raise ToolkitError(f"--lr {self.lr:g}: expected a number above 0 and at most 1, the patch's full range")

        if not 0 <= self.smoothing_px <= 16:
            raise ToolkitError(f"--smoothing {self.smoothing_px:g}: expected 0 to 16 texels")
        if not 0 <= self.start_contrast <= 1:
            raise ToolkitError(f"--start-contrast {self.start_contrast:g}: expected 0 to 1")

    def smoothing_at(self, step: int) -> float:
        """Standard deviation of the gradient's smoothing in a step, counted from 0, in texels."""
        return self.smoothing_px * (1 - step / self.steps)

    def lr_at(self, step: int) -> float:
        """η of a step, counted from 0."""
        done = step / self.steps
        fall = {"constant": 1.0, "linear": 1 - done, "cosine": (1 + cos(pi * done)) / 2}[self.schedule]
        return self.lr * (LAST_LR_SHARE + (1 - LAST_LR_SHARE) * fall)


@dataclass(frozen=True)
class Step:
    """After one step.

    Attributes:
        done: how many steps have been made.
        patch: θ, (3, n, n) in [0, 1], on the training's device.
        loss: cross-entropy of the batch before the step, summed over the networks.
        accuracy: share of the batch recognised before the step, mean over the networks.
    """

    done: int
    patch: "torch.Tensor"
    loss: float
    accuracy: float


def draw_first_patch(size_px: int, seed: int, contrast: float = 1.0) -> "torch.Tensor":
    """θ before the first step: (3, n, n) float32, uniform over `contrast` of [0, 1] about its middle."""
    import torch

    rng = Draws(seed, 0).of("first patch")
    return torch.from_numpy(rng.random((3, size_px, size_px), np.float32) - 0.5) * contrast + 0.5


def smooth_gradient(gradient: "torch.Tensor", sigma_px: float) -> "torch.Tensor":
    """Convolve (3, n, n) with a Gaussian, mirrored at the edges; below a third of a texel it is left as it is."""
    if sigma_px < 1 / 3:
        return gradient
    from torchvision.transforms.functional import gaussian_blur

    reach = min(int(3 * sigma_px) + 1, gradient.shape[-1] - 1)
    return gaussian_blur(gradient, [2 * reach + 1, 2 * reach + 1], [sigma_px, sigma_px])


def patch_gradient(
    patch: "torch.Tensor",
    images: "torch.Tensor",
    targets: list[Target],
    appearance: Appearance,
    draws: Draws,
    mounted: "Mounted | None" = None,
    penalty: "Penalty | None" = None,
) -> tuple["torch.Tensor", float, float]:
    """Gradient of the loss by θ, made anew from nothing, with the loss and the share recognised.

    The loss is the cross-entropy towards the target class, mean over the batch, summed over the networks. `mounted`
    adds photographs of the object with the patch on it, `penalty` a loss of the patch itself.
    """
    import torch

    theta = patch.detach().clone().requires_grad_(True)
    printed = print_patch(theta, appearance, draws)
    scenes = [place_patch(printed, images, appearance, draws)] if len(images) else []
    if mounted is not None:
        scenes.append(mounted(printed))
    photos = take_photos(torch.cat(scenes), appearance, draws)
    loss, recognised = judge_photos(photos, targets)
    if penalty is not None:
        loss = loss + penalty(theta)
    (gradient,) = torch.autograd.grad(loss, theta)
    return gradient, loss.item(), recognised


def judge_photos(photos: "torch.Tensor", targets: list[Target]) -> tuple["torch.Tensor", float]:
    """What the networks say of (b, 3, m, m) sRGB-encoded photographs.

    Returns the cross-entropy towards the target class, mean over the batch and summed over the networks, and the share
    recognised, mean over the networks.
    """
    import torch
    from torch.nn.functional import cross_entropy

    loss, recognised = photos.new_zeros(()), 0.0
    for target in targets:
        with mixed_precision(photos.device.type) if photos.dtype == torch.float32 else nullcontext():
            logits = target.classifier.logits(photos)
        wanted = torch.full((len(photos),), target.class_index, device=logits.device)
        loss = loss + cross_entropy(logits.to(photos.dtype), wanted)
        recognised += float((logits.argmax(1) == wanted).double().mean())
    return loss, recognised / len(targets)


def train_steps(
    patch: "torch.Tensor",
    done: int,
    images: "torch.Tensor",
    targets: list[Target],
    appearance: Appearance,
    descent: Descent,
    image_px: int,
    draw_mounted: Callable[[Draws, int], "Mounted"] | None = None,
    mounted_share: float = 0.0,
    penalty: Penalty | None = None,
) -> Iterator[Step]:
    """Make the steps from number `done` to the last, one per turn of the caller's loop.

    Step i depends on θ and on (seed, i) alone, so a run that is taken up again ends where an uninterrupted one does.

    Args:
        patch: θ after `done` steps, (3, n, n) in [0, 1].
        done: how many were made before.
        images: (k, 3, s, s) uint8 sRGB, s ≥ `image_px`, on the networks' device.
        targets: the networks, at least one.
        appearance: what happens to the patch.
        descent: how it is moved.
        image_px: side of what the networks see.
        draw_mounted: (draws, count) -> photographs of the object that wait for the patch on it.
        mounted_share: of each batch, that shows the object with the patch on it.
        penalty: a loss of the patch itself, added to the networks'.

    Raises:
        ToolkitError: the loss or its gradient is not a finite number.
    """
    import torch

    patch = patch.to(images.device)
    for index in range(done, descent.steps):
        draws = Draws(descent.seed, index)
        count = round(descent.batch * mounted_share) if draw_mounted else 0
        batch = draw_batch(images, draws.of("images"), descent.batch - count, image_px)
        mounted = draw_mounted(draws, count) if draw_mounted and count else None
        gradient, loss, accuracy = patch_gradient(patch, batch, targets, appearance, draws, mounted, penalty)
        if not isfinite(loss) or not bool(torch.isfinite(gradient).all()):
            raise ToolkitError(
                f"the loss or its gradient at step {index + 1} is not a finite number (loss {loss}): "
                "the network's weights do not fit its images; check --model and --weights"
            )
        gradient = smooth_gradient(gradient, descent.smoothing_at(index))
        patch = (patch - descent.lr_at(index) * gradient.sign()).clamp(0, 1)
        yield Step(index + 1, patch, loss, accuracy)
