"""Photographs spoiled by the corruptions of ImageNet-C, with a gradient."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.boosters.ranges import change_some, check_probability, count_images
from toolkit.errors import ToolkitError

if TYPE_CHECKING:
    import torch

DIFFERENTIABLE = frozenset((
    "gaussian_noise", "impulse_noise", "speckle_noise", "defocus_blur", "zoom_blur", "snow", "fog", "brightness",
    "contrast", "elastic_transform", "spatter", "saturate",
))  # fmt: skip
"""What autograd goes through: noise, clouds, flakes and shifts are drawn without looking at the image."""


@dataclass(frozen=True)
class Corrupted:
    """What is drawn for each photograph, after the camera: whether it is corrupted, by which, and the seed of that.

    Attributes:
        corruptions: (name, severity), at least one, of `toolkit.corruptions.CORRUPTIONS`; each is as likely.
        probability: that a photograph is corrupted.
    """

    corruptions: tuple[tuple[str, int], ...]
    probability: float = 0.5

    def __post_init__(self) -> None:
        from toolkit.corruptions import find_corruption

        check_probability("corruption", self.probability)
        if not self.corruptions:
            raise ToolkitError("--corrupt: expected at least one corruption, such as fog:3")
        for corruption in self.corruptions:
            find_corruption(*corruption)

    def describe(self) -> str:
        """`fog 3, snow 1, probability 0.5`."""
        named = ", ".join(f"{name} {severity}" for name, severity in self.corruptions)
        return f"{named}, probability {self.probability:g}"

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Corrupt some of (b, 3, h, w) sRGB-encoded photographs, within [0, 1]; see `corrupt_straight`."""
        import torch

        count = count_images(pixels)
        acting = rng.random(count) < self.probability
        drawn = rng.integers(len(self.corruptions), size=count)
        seeds = rng.integers(1 << 62, size=count)

        def spoil(some: torch.Tensor, which: np.ndarray) -> torch.Tensor:
            kinds = np.unique(drawn[which])
            groups = [np.flatnonzero(drawn[which] == kind) for kind in kinds]
            spoilt = []
            for kind, group in zip(kinds, groups, strict=True):
                name, severity = self.corruptions[kind]
                spoilt.append(corrupt_straight(some[group.tolist()], name, severity, seeds[which[group]].tolist()))
            return torch.cat(spoilt)[np.argsort(np.concatenate(groups)).tolist()]

        return change_some(pixels, acting, spoil)


def corrupt_straight(images: "torch.Tensor", name: str, severity: int, seeds: Sequence[int]) -> "torch.Tensor":
    """`toolkit.corruptions.corrupt` with a gradient.

    Of what is in `DIFFERENTIABLE` the gradient is the true one. The others count photons, shuffle pixels, round to
    whole levels or run in OpenCV; they act forward, and backward count as the identity ("straight through"; Bengio et
    al. 2013; BPDA, Athalye et al. 2018): right where the result stays near the image, and blind to what they take away.

    Args:
        images: (b, 3, h, w) float, sRGB-encoded in [0, 1].
        name: one of `CORRUPTIONS`.
        severity: 1 to 5.
        seeds: one per image.

    Returns:
        As `images`, what `corrupt` returns; differentiable.
    """
    from toolkit.corruptions import CORRUPTIONS, choose_parameters, corrupt
    from toolkit.corruptions.draws import Draws

    if name in DIFFERENTIABLE:
        corruption = CORRUPTIONS[name]
        given = corruption.parameters[choose_parameters(*images.shape[-2:])][severity - 1]
        return corruption.apply(images, given, Draws(seeds, name, severity, images.device)).clamp(0, 1)
    return corrupt(images, name, severity, seeds) + (images - images.detach())
