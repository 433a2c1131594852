"""Photographs corrupted by the operations of ImageNet-C, with a gradient."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

from toolkit.boosters.parts.base import check_probability
from toolkit.core.errors import ToolkitError

if TYPE_CHECKING:
    import torch

DIFFERENTIABLE = frozenset((
    "gaussian_noise", "impulse_noise", "speckle_noise", "defocus_blur", "glass_blur", "motion_blur", "zoom_blur",
    "gaussian_blur", "snow", "frost", "fog", "brightness", "contrast", "elastic_transform", "spatter", "saturate",
))  # fmt: skip
"""What autograd goes through: noise, clouds, flakes and shifts are drawn without looking at the image."""


@dataclass(frozen=True)
class Corrupted:
    """What is drawn for each photograph, after the camera: whether it is corrupted, by which, and the seed of that.

    Attributes:
        corruptions: (name, severity), at least one, of `toolkit.corruptions.CORRUPTIONS`; each is as likely.
        probability: that a photograph is corrupted.
        gradients: version of what `corrupt_straight` makes; raised when the same settings give another gradient.
    """

    stage: ClassVar = "photo"
    corruptions: tuple[tuple[str, int], ...]
    probability: float = 0.5
    gradients: int = 2

    def __post_init__(self) -> None:
        from toolkit.corruptions import find_corruption

        check_probability("corruption", self.probability)
        if not self.corruptions:
            raise ToolkitError("expected at least one corruption, such as fog:3")
        for corruption in self.corruptions:
            find_corruption(*corruption)

    def describe(self) -> str:
        """`fog:3, snow:1, probability 0.5`."""
        from toolkit.corruptions.request import name_corruptions

        return f"{name_corruptions(self.corruptions)}, probability {self.probability:g}"

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Corrupt some of (b, 3, h, w) sRGB-encoded photographs, within [0, 1]; see `corrupt_straight`."""
        import torch

        from toolkit.corruptions.request import draw_corrupted

        batch = pixels[None] if pixels.ndim == 3 else pixels
        for which, name, severity, seeds in draw_corrupted(rng, len(batch), self.corruptions, self.probability):
            index = torch.from_numpy(which).to(batch.device)
            batch = batch.index_copy(0, index, corrupt_straight(batch[index], name, severity, seeds))
        return batch.reshape(pixels.shape)


def corrupt_straight(images: "torch.Tensor", name: str, severity: int, seeds: Sequence[int]) -> "torch.Tensor":
    """`toolkit.corruptions.corrupt` with a gradient.

    Of what is in `DIFFERENTIABLE` the gradient is the true one. The others count photons or round to whole levels; they
    act forward, and backward count as what they are near ("straight through"; Bengio et al. 2013; BPDA, Athalye et al.
    2018): pixelate as its means, shot noise and JPEG as the identity.

    Args:
        images: (b, 3, h, w) float, sRGB-encoded in [0, 1].
        name: one of `CORRUPTIONS`.
        severity: 1 to 5.
        seeds: one per image.

    Returns:
        As `images`, what `corrupt` returns; differentiable.
    """
    from toolkit.corruptions import CORRUPTIONS, choose_parameters, corrupt
    from toolkit.corruptions.digital import pixelate_unrounded
    from toolkit.corruptions.draws import RandomStreams

    corruption = CORRUPTIONS[name]
    given = corruption.parameters[choose_parameters(*images.shape[-2:])][severity - 1]
    if name in DIFFERENTIABLE:
        return corruption.apply(images, given, RandomStreams(seeds, name, severity, images.device)).clamp(0, 1)
    near = pixelate_unrounded(images, cast(float, given)) if name == "pixelate" else images
    return corrupt(images, name, severity, seeds) + (near - near.detach())
