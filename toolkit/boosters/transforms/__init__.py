"""Transforms of a booster between file and photograph, for training in expectation (Athalye et al. 2018).

Every transform has settings, a stage and draws, and may leave images as they are.
"""

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, ClassVar, Protocol, runtime_checkable

from pydantic import Field

from toolkit.core.config import Config
from toolkit.core.draws import Draws
from toolkit.core.lazy import np, torch

OF_NETWORKS = ("network", "features")
"""Stages that act for each network by itself."""
Probability = Annotated[float, Field(ge=0, le=1)]


class Transform(Config):
    """Something that a booster meets on its way into a photograph; its fields are the ranges that it draws from.

    A field of `PatchConfig` or `TextureConfig` that holds a transform makes it act.

    Attributes:
        stage: where it acts. In this order: `place` of the patch, `print`, `paper` in the scene, `view` (its depth),
            `light`, `photo`, `network` (its input), `features` of a network.
        drawn_as: names its draws: renamed, it would draw other numbers. By default the name of the class.
    """

    stage: ClassVar[str]
    drawn_as: ClassVar[str] = ""
    if TYPE_CHECKING:
        probability: float = 1.0

    def rng(self, draws: Draws, of: str = "") -> "np.random.Generator":
        """Return the transform's own generator of a step; `of` distinguishes several uses in a step."""
        # a generator for each transform: switching a transform on or off leaves the draws of the others unchanged
        return draws.of((self.drawn_as or type(self).__name__) + of)

    def draw_acting(self, rng: "np.random.Generator", count: int) -> "np.ndarray":
        """(count,) bool: which images it acts on."""
        return rng.random(count) < self.probability


class ImageTransform(Transform):
    """Something that happens to whole pictures: the print before it is placed, or the photograph after."""

    stage = "photo"

    def change(self, pixels: "torch.Tensor", rng: "np.random.Generator") -> "torch.Tensor":
        """Change some of (b, 3, h, w) sRGB-encoded pictures in [0, 1], or a single (3, h, w); differentiable.

        The others come back bit for bit, and cost nothing.
        """
        batch = pixels[None] if pixels.ndim == 3 else pixels
        acting = self.draw_acting(rng, len(batch))
        # drawn for all images, acting or not, so that another probability changes no other draw
        drawn = self.draw(rng, len(batch))
        which = np.flatnonzero(acting)
        if len(which) == 0:
            return pixels
        chosen = tuple(values[which] for values in drawn)
        # no gather and scatter where nothing is left out
        if len(which) == len(batch):
            return self.apply(batch, chosen).reshape(pixels.shape)
        index = torch.as_tensor(which, device=batch.device)
        return batch.index_copy(0, index, self.apply(batch[index], chosen))

    @abstractmethod
    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Draw for each of `count` images, whether the transform acts on it or not: arrays of that length."""

    @abstractmethod
    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Change all of (k, 3, h, w) by what was drawn for them."""


class PaperTransform(Transform):
    """Something that happens to the paper in the scene."""

    stage = "paper"

    @abstractmethod
    def light(self, paper: "torch.Tensor", mask: "torch.Tensor", rng: "np.random.Generator") -> "torch.Tensor":
        """Change drawn patches; differentiable in `paper`.

        Args:
            paper: (b, 3, m, m) sRGB-encoded, already multiplied by the mask.
            mask: (b, 1, m, m), the share of each pixel that the patch covers.
            rng: draws for each image.

        Returns:
            As `paper`; values may leave [0, 1].
        """


@runtime_checkable
class Placer(Protocol):
    """A placement of the patch, such as `toolkit.boosters.transforms.placement.AffineRanges`."""

    def place(self, rng: "np.random.Generator", count: int, patch_px: int, image_px: int) -> "np.ndarray":
        """(count, 3, 3) `T_image_patch`, affine or projective."""
        ...


def as_factors(values: "np.ndarray", like: "torch.Tensor") -> "torch.Tensor":
    """(k,) or (k, c) numbers to (k, 1 or c, 1, 1), of `like`'s type and device."""
    return torch.as_tensor(values.reshape(len(values), -1, 1, 1), dtype=like.dtype, device=like.device)
