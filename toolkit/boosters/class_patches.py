"""A patch for each of many classes, one after the other, into patch sets: what `toolkit train-patches` runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from toolkit.boosters.data import Backgrounds, DataConfig, Loaded, TrainingData, divide_images
from toolkit.boosters.patch import train_patch
from toolkit.boosters.patch_config import PatchConfig, check_size, make_config
from toolkit.boosters.patch_sets import SetName, name_class
from toolkit.boosters.pixels import Network
from toolkit.boosters.place_patches import Placement
from toolkit.boosters.validation import Share
from toolkit.core.config import Config, Flag
from toolkit.core.console import notice, progress, quietly
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage
from toolkit.training.image_set import ImageSet

FEW_IMAGES = 32
"""A class with fewer images is trained on those of all classes, where the user leaves it open."""
FLAT = {"pose": False, "light": False, "print_process": False, "glare": False, "camera": False, "mounted_share": 0.0}
"""What a patch that is laid on images in memory does not meet."""


class ClassPatchesConfig(Config):
    """Patches to train, beside the settings that they share with every patch."""

    set_name: Annotated[SetName, Flag("--set", metavar="SET")] = Field(
        "patches", description="The sets are print/patches/SET-SIZE."
    )
    sizes_px: Annotated[tuple[int, ...], Field(min_length=1), Flag("--size-px", metavar="N")] = Field(
        (100,), description="Side in pixels, repeatable."
    )
    backgrounds: Annotated[Backgrounds, Flag()] = Field(
        "auto",
        description="class: images of the class only; all: every image; auto: of the class where there are 32.",
    )
    images: Annotated[int, Field(ge=2), Flag()] = Field(
        256, description="Images kept in memory at most, a fifth of them held out."
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Of every random draw.")

    def data(self) -> DataConfig:
        """As records name the images."""
        return DataConfig(sources=(self.set_name,), backgrounds=self.backgrounds, images=self.images, seed=self.seed)


@dataclass(frozen=True)
class ClassPatch:
    """One patch of a run: its set and class, the shares of held-out images, None where it was finished before."""

    set_name: str
    label: str
    patched: Share | None
    bare: Share | None


def train_class_patches(
    config: ClassPatchesConfig, patch: PatchConfig, images: ImageSet, classes: Sequence[int], network: Network,
    workspace: Workspace, *, restart: bool = False,
) -> tuple[list[ClassPatch], list[tuple[str, str]]]:  # fmt: skip
    """Train every patch that is not finished, class by class; an interrupted run goes on in the middle of a patch.

    In memory are the images of a class (or of all, once) and one patch, n × n, at a time.

    Args:
        config: sets, sizes and images.
        patch: settings of every patch but its size, see `make_flat_config`.
        images: of these classes, and of others.
        classes: indices of those that get patches.
        network: the classifier.
        workspace: where the sets go.
        restart: forget what an earlier run left.

    Returns:
        The patches, and (path, reason) of images that could not be used.

    Raises:
        ToolkitError: a size that does not fit the network, a class without images, or as `train_patch`.
    """
    for size_px in config.sizes_px:
        check_size(size_px, network.preprocessing.crop_px, "sizes_px")
    source = _Source(images, config, network.preprocessing)
    units = [(size_px, index) for size_px in dict.fromkeys(config.sizes_px) for index in classes]
    done: list[ClassPatch] = []
    with progress(f"Training {len(units)} patches", len(units)) as bar:
        for size_px, index in units:
            set_name, label = f"{config.set_name}-{size_px}", network.labels[index]
            bar.advance(0, f"{label}, {size_px} px")
            sized, name = patch.with_overrides(size_px=size_px), name_class(network.labels, index)
            out = workspace.root / "print" / "patches" / set_name
            data = source.load(index)
            with quietly():
                trained = train_patch(sized, index, [network], data, workspace, name=name, out=out, restart=restart)
            answer = trained.validations[0] if trained.validations else None
            shares = (None, None) if answer is None else (answer.patched, answer.bare)
            done.append(ClassPatch(set_name, label, *shares))
            bar.advance()
            told = f"{shares[0]} of held-out images with it, {shares[1]} without" if answer else "finished before"
            notice(f"{set_name}/{name}: {told}")
    return done, source.skipped


def make_flat_config(
    recipe: str, overrides: Mapping[str, Any], placement: Placement, config: ClassPatchesConfig
) -> PatchConfig:
    """A recipe with overrides for patches that are laid on images in memory: they meet no world."""
    fixed = {"affine": placement, "seed": config.seed}
    return make_config(recipe, {**FLAT, **overrides, **fixed}, config.data())


class _Source:
    """The training images of each class."""

    def __init__(self, images: ImageSet, config: ClassPatchesConfig, how: Preprocessing) -> None:
        self._images, self._config, self._how = images, config, how
        self.skipped = list(images.refused)
        self._load = lru_cache(maxsize=1)(self._decode)

    def load(self, class_index: int) -> TrainingData:
        """Those of the class, or of all classes."""
        count = sum(one.class_index == class_index for one in self._images.images)
        wanted = self._config.backgrounds
        own = wanted == "class" or (wanted == "auto" and count >= FEW_IMAGES)
        if own and not count:
            expected = f"class {class_index} has no images in {self._images.name}"
            raise FieldError(expected, {"backgrounds": wanted})
        return self._load(class_index if own else None)

    def _decode(self, class_index: int | None) -> TrainingData:
        found = [one for one in self._images.images if class_index in (None, one.class_index)]
        square = replace(self._how, crop_px=self._how.resize_px)
        pixels: list[np.ndarray] = []
        skipped: list[tuple[str, str]] = []
        for k in Draws(self._config.seed, 0, "data").of("files").permutation(len(found)):
            if len(pixels) == self._config.images:
                break
            try:
                pixels.append(self._images.load(found[k], square))
            except UnreadableImage as error:
                skipped.append((found[k].id, error.reason))
        self.skipped += [line for line in skipped if line not in self.skipped]
        if not pixels:
            path, reason = skipped[-1]
            raise ToolkitError(f"{self._images.name}: none of its {len(found)} images can be read; {path}: {reason}")
        use = "class" if class_index is not None else "backgrounds"
        record = {"source": self._images.name, "use": use, "found": len(found), "used": len(pixels)}
        return divide_images([Loaded(np.stack(pixels), tuple(skipped), record)], self._config.data())
