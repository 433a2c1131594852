"""What a camera varies, corruptions for a share of each batch, and attacks, on batches of tensors."""

from collections.abc import Callable

import numpy as np
import torch
from torch.nn.functional import affine_grid, grid_sample
from torchvision.transforms.functional import gaussian_blur

from toolkit.corruptions.batch import corrupt, draw_corrupted
from toolkit.training.classifier_config import Attack, Augmentation, Corrupting

# ITU-R BT.601's luma, of sRGB-encoded values
GREY_WEIGHTS = (0.299, 0.587, 0.114)


def augment_batch(
    images: torch.Tensor, rng: np.random.Generator, image_px: int, how: Augmentation,
    overlay: Callable[[torch.Tensor], torch.Tensor] = lambda batch: batch,
) -> torch.Tensor:  # fmt: skip
    """(b, 3, s, s) uint8 sRGB to (b, 3, image_px, image_px) float32, sRGB-encoded in [0, 1], varied at random.

    What `overlay` puts on the framed images is seen by the same camera: it has their colours, focus and noise.
    """
    batch = overlay(_cut(images.float().div_(255), rng, image_px, how))
    batch = _colour(batch, rng, how)
    batch = _blur(batch, rng, how)
    return _add_noise(batch, rng, how).clamp_(0, 1)


def _draw(rng: np.random.Generator, low_high: tuple[float, float], like: torch.Tensor) -> torch.Tensor:
    """(b, 1, 1, 1) uniform numbers, one for each image of a batch."""
    return torch.from_numpy(rng.uniform(*low_high, (len(like), 1, 1, 1)).astype(np.float32)).to(like.device)


def _cut(batch: torch.Tensor, rng: np.random.Generator, image_px: int, how: Augmentation) -> torch.Tensor:
    count = len(batch)
    side = rng.uniform(*how.crop, (count, 1)) * (1 + rng.uniform(-how.stretch, how.stretch, (count, 2)))
    side = side.clip(0, how.crop[1])
    # the crop stays within the image, but for `shift` at either side
    middle = rng.uniform(-1, 1, (count, 2)) * (1 - side + 2 * how.shift)
    mirror = np.where(rng.random((count, 1)) < 0.5, -1.0, 1.0)
    # in affine_grid's units the image reaches from -1 to 1
    theta = np.zeros((count, 2, 3), np.float32)
    theta[:, 0, 0], theta[:, 1, 1], theta[:, :, 2] = side[:, 0] * mirror[:, 0], side[:, 1], middle
    grid = affine_grid(torch.from_numpy(theta).to(batch.device), [count, 3, image_px, image_px], align_corners=False)
    return grid_sample(batch, grid, "bilinear", "reflection", align_corners=False)


def _colour(batch: torch.Tensor, rng: np.random.Generator, how: Augmentation) -> torch.Tensor:
    weights = torch.tensor(GREY_WEIGHTS, device=batch.device).view(1, 3, 1, 1)
    grey = (batch * weights).sum(1, keepdim=True)
    batch = grey + (batch - grey) * _draw(rng, how.saturation, batch)
    # saturation moves values about each pixel's grey, contrast about the image's
    mean = grey.mean((2, 3), keepdim=True)
    batch = mean + (batch - mean) * _draw(rng, how.contrast, batch)
    tint = 1 + rng.uniform(-how.tint, how.tint, (len(batch), 3, 1, 1)).astype(np.float32)
    return batch * (_draw(rng, how.brightness, batch) * torch.from_numpy(tint).to(batch.device))


def _blur(batch: torch.Tensor, rng: np.random.Generator, how: Augmentation) -> torch.Tensor:
    """One sigma for all that are blurred: a convolution each would cost more than the network's first layer."""
    chosen = np.flatnonzero(rng.random(len(batch)) < how.blur_share)
    sigma = float(rng.uniform(*how.blur_sigma)) * batch.shape[-1]
    if len(chosen):
        reach = min(int(np.ceil(3 * sigma)), batch.shape[-1] - 1)
        which = torch.from_numpy(chosen).to(batch.device)
        batch[which] = gaussian_blur(batch[which], [2 * reach + 1, 2 * reach + 1], [sigma, sigma])
    return batch


def _add_noise(batch: torch.Tensor, rng: np.random.Generator, how: Augmentation) -> torch.Tensor:
    # drawn on the CPU: a GPU's generator gives other numbers
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    noise = torch.randn(batch.shape, generator=generator).to(batch.device)
    return batch + noise * _draw(rng, how.noise_sigma, batch)


def corrupt_some(batch: torch.Tensor, rng: np.random.Generator, how: Corrupting) -> torch.Tensor:
    """(b, 3, s, s) float32 sRGB-encoded in [0, 1], a share of it corrupted; the batch is changed."""
    for chosen, name, severity, seeds in draw_corrupted(rng, len(batch), how.corruptions, how.share):
        which = torch.from_numpy(chosen).to(batch.device)
        batch[which] = corrupt(batch[which], name, severity, seeds)
    return batch


def find_worst_images(
    images: torch.Tensor, measure_losses: Callable[[torch.Tensor], torch.Tensor], attack: Attack
) -> torch.Tensor:
    """The images of the ball around each at which its loss was found to be largest, the image itself among them.

    Projected gradient descent (Madry et al. 2018); as in MadryLab's robustness library nothing is drawn at random.

    Args:
        images: (b, 3, h, w) float, sRGB-encoded in [0, 1].
        measure_losses: images to their losses (b,), differentiable; one image's loss may not depend on another image.
        attack: the ball and the steps.

    Returns:
        (b, 3, h, w) without gradient, in [0, 1].
    """
    images = moved = worst = images.detach()
    highest: torch.Tensor | None = None
    for _ in range(attack.steps):
        moved = moved.detach().requires_grad_()
        with torch.enable_grad():
            losses = measure_losses(moved)
            # the sum's gradient is each image's own, as no loss depends on another image
            (gradient,) = torch.autograd.grad(losses.sum(), moved)
        with torch.no_grad():
            worst, highest = _keep_higher(worst, highest, moved, losses)
            moved = attack.project(attack.climb(moved, gradient), images)
    with torch.no_grad():
        # the last place was reached and not yet asked
        worst, _ = _keep_higher(worst, highest, moved, measure_losses(moved))
    return worst.detach()


def _keep_higher(
    worst: torch.Tensor, highest: torch.Tensor | None, moved: torch.Tensor, losses: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    # the first asked is the image itself: what is found is never better for the network than that
    if highest is None:
        return moved, losses
    is_higher = losses > highest
    return torch.where(is_higher.view(-1, 1, 1, 1), moved, worst), torch.where(is_higher, losses, highest)
