"""Corrupt a batch of images."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import torch

from toolkit.core.draws import RandomStreams
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.threads import run_each
from toolkit.corruptions.catalogue import choose_parameters, find_corruption

MIN_SIDE_PX = 16
PART_PIXELS = 512**2
"""Most pixels at once on a thread: more would not stay in its cache."""


@torch.no_grad()
def corrupt(
    images: torch.Tensor, name: str, severity: int, seeds: Sequence[int], parameters: str | None = None
) -> torch.Tensor:
    """Corrupt a batch as ImageNet-C and CIFAR-10-C do.

    An image's result depends on its pixels, its seed, `name` and `severity` alone. CPU and GPU draw the same numbers
    and differ by float rounding only. Only pixelate and jpeg_compression round to 8 bits, while the published images
    are truncated to 8 bits, ImageNet-C's then saved as JPEG.

    Args:
        images: (b, 3, h, w) float, sRGB-encoded in [0, 1], on any device; not changed.
        name: key of `CORRUPTIONS`.
        severity: 1 (slight) to 5 (severe).
        seeds: a seed for each image, such as from `image_seed`.
        parameters: `imagenet` (for 224²) or `cifar` (for 32²); by default by size. Lengths are not scaled.

    Returns:
        (b, 3, h, w) float32, sRGB-encoded in [0, 1], on the same device, without gradient.

    Raises:
        ToolkitError: unknown name, severity or parameters, images of another shape or under 16 px, or missing seeds.
    """
    # check name, severity, shape and parameters before any work
    corruption = find_corruption(name, severity)
    _check_batch(images, seeds)
    if len(images) == 0:
        return images.float().clone()
    parameters = parameters or choose_parameters(*images.shape[-2:])
    if parameters not in corruption.parameters:
        raise one_of("parameter set", parameters, list(corruption.parameters))
    given = corruption.parameters[parameters][severity - 1]
    images = images.detach().float()

    def apply(part: slice) -> torch.Tensor:
        draws = RandomStreams([int(seed) for seed in seeds[part]], name, severity, images.device)
        return corruption.apply(images[part], given, draws)

    # a GPU takes the whole batch at once
    if images.device.type != "cpu":
        return apply(slice(None)).clamp_(0, 1)
    # a CPU takes it in parts, one per thread
    result = torch.empty(images.shape)
    parts = split_evenly(len(images), images.shape[-2] * images.shape[-1])
    mode = torch.is_inference_mode_enabled()  # threads do not inherit it

    def fill(index: int) -> None:
        with torch.inference_mode(mode):
            torch.clamp(apply(parts[index]), 0, 1, out=result[parts[index]])

    run_each(fill, len(parts))
    return result


def split_evenly(count: int, pixels: int) -> list[slice]:
    """Split a batch of `count` images of `pixels` each: a part or more per thread, none too large for the cache."""
    number = max(torch.get_num_threads(), math.ceil(count * pixels / PART_PIXELS))
    length = math.ceil(count / number)
    return [slice(start, start + length) for start in range(0, count, length)]


def _check_batch(images: torch.Tensor, seeds: Sequence[int]) -> None:
    if images.ndim != 4 or images.shape[1] != 3 or not images.is_floating_point():
        found = f"{tuple(images.shape)} {images.dtype}"
        raise ToolkitError(f"images to corrupt must be (b, 3, h, w) float in [0, 1], got {found}: convert them first")
    if min(images.shape[-2:]) < MIN_SIDE_PX:
        size = f"{images.shape[-1]}×{images.shape[-2]} px"
        raise ToolkitError(f"images to corrupt must be at least {MIN_SIDE_PX} px each way, got {size}: enlarge them")
    if len(seeds) != len(images):
        raise ToolkitError(f"{len(seeds)} seeds for {len(images)} images: give a seed for each image")


def draw_corrupted(
    rng: np.random.Generator, count: int, corruptions: Sequence[tuple[str, int]], share: float
) -> Iterator[tuple[np.ndarray, str, int, list[int]]]:
    """Draw the images of a batch that are corrupted, each by a corruption of a list.

    Args:
        rng: draws.
        count: number of images in the batch.
        corruptions: (name, severity), equally likely.
        share: probability that an image is corrupted.

    Yields:
        (numbers of some images, name, severity, a seed for each) of every corruption that was drawn.
    """
    # drawn for all images, acting or not: an image's draws do not depend on those before it
    acting = rng.random(count) < share
    drawn = rng.integers(len(corruptions), size=count)
    seeds = rng.integers(2**62, size=count)
    for kind in np.unique(drawn[acting]):
        which = np.flatnonzero(acting & (drawn == kind))
        yield which, *corruptions[kind], seeds[which].tolist()
