"""Class patches on the images that a classifier is trained on: the fixed-pattern baseline (the paper, D.2.4)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit.boosters.apply import boost_images
from toolkit.boosters.transforms.placement import Placement
from toolkit.core.errors import FieldError, one_of
from toolkit.core.workspace import Workspace
from toolkit.objects.records import Patch
from toolkit.rooms.benchmarks.patch_sets import PatchSet, read_patch_set
from toolkit.training.classifier_config import Overlay

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class TrainingBoost:
    """A patch set for every training image, as `ClassPictures`, placed by each image's seed."""

    pictures: PatchSet
    placement: Placement

    @property
    def record(self) -> dict[str, Any]:
        """Set, hash of its pictures, and placement."""
        pictures = self.pictures
        return {
            "set": pictures.name, "sha256": pictures.sha256, "n_px": pictures.n_px, "method": pictures.method,
            "placement": self.placement.model_dump(),
        }  # fmt: skip

    @property
    def words(self) -> str:
        """Words for the patch on an image."""
        return f"its class's patch of the set {self.pictures.name}"

    def fit(self, labels: Sequence[str], used: Sequence[int], image_px: int) -> Overlay:
        """Return a function that lays the patches of the classes `used` on images of `image_px`.

        Patches are found by label: the set may have its classes in another order.

        Raises:
            ToolkitError: a class has no patch, or the patches are larger than the images.
        """
        import torch

        name, n_px = self.pictures.name, self.pictures.n_px
        if n_px > image_px:
            larger = f"its patches are {n_px} px a side, and the network sees images of {image_px} px"
            raise FieldError(f"{larger}: make smaller patches, or raise {{image_px}}", {"patches": name})
        # pictures of the used classes alone
        chosen = [self._find(labels[index], index) for index in used]
        pixels = torch.from_numpy(np.stack([patch.pixels for patch in chosen]).transpose(0, 3, 1, 2).copy())
        # number of a class's picture, by its index among all labels
        slots = np.full(len(labels), -1)
        slots[list(used)] = np.arange(len(chosen))

        def overlay(images: "torch.Tensor", classes: np.ndarray, seeds: Sequence[int]) -> "torch.Tensor":
            pictures = pixels[torch.from_numpy(slots[classes])].to(images.device).float() / 255
            return boost_images(images, pictures, self.placement, seeds)

        return overlay

    def _find(self, label: str, index: int) -> Patch:
        patches = self.pictures.patches
        same = [own for own, patch in patches.items() if patch.record.class_name == label]
        if same:
            # several classes may share a label: the class of the same index has precedence
            return patches[index if index in same else same[0]]
        known = [patch.record.class_name for patch in patches.values()]
        hint = str(one_of("class", label, known)).partition(": ")[2]
        expected = f"the set has no patch of class '{label}' of the data: {hint}"
        raise FieldError(expected, {"patches": self.pictures.name})


def read_training_boost(workspace: Workspace, name: str) -> TrainingBoost:
    """The patches of a set, placed as in the benchmark.

    Raises:
        ToolkitError: as `read_patch_set`.
    """
    return TrainingBoost(read_patch_set(workspace, name, None), Placement())
