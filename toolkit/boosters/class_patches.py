"""A patch for each of many classes, one after the other, into patch sets: what `toolkit train-patches` runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from toolkit.boosters.data import BACKGROUNDS, DataRequest, Loaded, TrainingData, divide_images
from toolkit.boosters.patch import train_patch
from toolkit.boosters.patch_config import PatchRequest, check_size
from toolkit.boosters.patch_recipes import Choices, make_request
from toolkit.boosters.patch_sets import name_class
from toolkit.boosters.place_patches import Placement
from toolkit.boosters.validation import Share
from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.workspace import PATCH_SET_NAME, Workspace
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage
from toolkit.training.image_set import ImageSet

FEW_IMAGES = 32
"""A class with fewer images is trained on those of all classes, where the user leaves it open."""
FLAT = Choices(pose=False, light=False, print_process=False, glare=False, camera=False, mounted_share=0.0)
"""What a patch that is laid on images in memory does not meet."""


@dataclass(frozen=True)
class ClassPatchesRequest:
    """Patches to train.

    Attributes:
        set_name: of the patch sets; the size is added.
        classes: class indices.
        sizes_px: n, sides of the patches; a set for each.
        recipe, choices: of the descent, see `toolkit.boosters.patch_recipes`.
        backgrounds: `class` trains on images of the class, `all` on images of all classes, whatever they show, `auto`
            on those of the class where there are enough.
        images: kept in memory at most, a fifth of them held out.
        placement: where the patches lie.
        seed: of every random draw.
    """

    set_name: str
    classes: tuple[int, ...]
    sizes_px: tuple[int, ...] = (100,)
    recipe: str = "default"
    choices: Choices = FLAT
    backgrounds: str = "auto"
    images: int = 256
    placement: Placement = field(default_factory=Placement)
    seed: int = 0

    def __post_init__(self) -> None:
        if not PATCH_SET_NAME.fullmatch(self.set_name):
            raise ToolkitError(f"--set '{self.set_name}': expected letters, digits, '-' and '_'")
        if self.backgrounds not in BACKGROUNDS:
            raise one_of("choice of --backgrounds", self.backgrounds, list(BACKGROUNDS))
        if self.images < 2:
            raise ToolkitError(f"--images {self.images}: expected at least 2")

    def make(self, labels: Sequence[str], class_index: int, size_px: int) -> PatchRequest:
        """The request of one patch."""
        data = DataRequest((self.set_name,), self.backgrounds, self.images, self.seed)
        name = name_class(labels, class_index)
        made = make_request(self.recipe, self.choices, str(class_index), data, size_px, self.seed, name)
        return replace(made, placement=self.placement)


@dataclass(frozen=True)
class ClassPatch:
    """One patch of a run: its set and class, the shares of held-out images, None where it was finished before."""

    set_name: str
    label: str
    patched: Share | None
    bare: Share | None


def train_class_patches(
    request: ClassPatchesRequest,
    images: ImageSet,
    classifier: Any,
    workspace: Workspace,
    restart: bool = False,
    quiet: bool = False,
    say: Callable[[str], None] = lambda line: None,
) -> tuple[list[ClassPatch], list[tuple[str, str]]]:
    """Train every patch that is not finished, class by class; an interrupted run goes on in the middle of a patch.

    In memory are the images of a class (or of all, once) and one patch, n × n, at a time.

    Returns:
        The patches, and (path, reason) of images that could not be used.

    Raises:
        ToolkitError: a size that does not fit the network, a class without images, or as `train_patch`.
    """
    for size_px in request.sizes_px:
        check_size(size_px, classifier.preprocessing.crop_px, "--size")
    source = _Source(images, request, classifier.preprocessing)
    units = [(size_px, index) for size_px in request.sizes_px for index in request.classes]
    done: list[ClassPatch] = []
    with progress(f"Training {len(units)} patches", len(units), quiet) as bar:
        for size_px, index in units:
            made = request.make(classifier.labels, index, size_px)
            set_name = f"{request.set_name}-{size_px}"
            label = classifier.labels[index]
            bar.advance(0, f"{label}, {size_px} px")
            out = workspace.root / "print" / "patches" / set_name
            trained = train_patch(made, [classifier], workspace, out, restart, quiet=True, data=source.load(index))
            answer = trained.validations[0] if trained.validations else None
            shares = (None, None) if answer is None else (answer.patched, answer.bare)
            one = ClassPatch(set_name, label, *shares)
            done.append(one)
            bar.advance()
            say(
                f"{set_name}/{made.name}: "
                + (
                    "finished before"
                    if answer is None
                    else f"{answer.patched} of held-out images with it, {answer.bare} without"
                )
            )
    return done, source.skipped


class _Source:
    """The training images of each class."""

    def __init__(self, images: ImageSet, request: ClassPatchesRequest, how: Preprocessing) -> None:
        self._images, self._request, self._how = images, request, how
        self.skipped = list(images.refused)
        self._load = lru_cache(maxsize=1)(self._decode)

    def load(self, class_index: int) -> TrainingData:
        """Those of the class, or of all classes."""
        count = sum(one.class_index == class_index for one in self._images.images)
        wanted = self._request.backgrounds
        own = wanted == "class" or (wanted == "auto" and count >= FEW_IMAGES)
        if own and not count:
            raise ToolkitError(f"--backgrounds class: class {class_index} has no images in {self._images.name}")
        return self._load(class_index if own else None)

    def _decode(self, class_index: int | None) -> TrainingData:
        found = [one for one in self._images.images if class_index in (None, one.class_index)]
        square = replace(self._how, crop_px=self._how.resize_px)
        pixels: list[np.ndarray] = []
        skipped: list[tuple[str, str]] = []
        for k in Draws(self._request.seed, 0, "data").of("files").permutation(len(found)):
            if len(pixels) == self._request.images:
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
        return divide_images([Loaded(np.stack(pixels), tuple(skipped), record)])
