"""Patch sets, folders `print/patches/SET` with a picture for each of many classes, and the settings to train them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field

from toolkit.boosters.patch_config import PatchConfig, make_config
from toolkit.boosters.pixel_config import Backgrounds, DataConfig, name_files
from toolkit.boosters.transforms.placement import Placement
from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.text import is_file_name, join_words
from toolkit.core.workspace import Workspace

if TYPE_CHECKING:
    import numpy as np

    from toolkit.objects.records import Patch

FLAT = {"pose": False, "light": False, "print_process": False, "glare": False, "camera": False, "mounted_share": 0.0}
"""Changes in training that patches on images in memory do not need."""
ASKED_OF_FLAT = (
    "steps", "epochs", "batch", "lr", "schedule", "smoothing_px", "last_smoothing_px", "start_contrast", "objective",
    "jitter", "momentum", "corrupted",
)  # fmt: skip
"""Other options of its recipe."""


def check_set_name(name: str) -> str:
    """A patch set's name is a folder's."""
    if not is_file_name(name):
        raise FieldError(f"{{set_name}} '{name}': expected letters, digits, '-' and '_'", {})
    return name


SetName = Annotated[str, AfterValidator(check_set_name)]


def name_class(labels: Sequence[str], index: int) -> str:
    """Return a file name without suffix: from the label, with the index if another class's would be the same."""
    names = [name_files(None, label, k) for k, label in enumerate(labels)]
    # file systems that know no case, and ImageNet's two 'crane'
    same = [k for k, name in enumerate(names) if name.lower() == names[index].lower()]
    return names[index] if len(same) == 1 else f"{names[index]}_{index}"


@dataclass(frozen=True)
class PatchSet:
    """A folder of pictures of `n_px`, a picture for each class index."""

    name: str
    n_px: int
    patches: "dict[int, Patch]"

    @property
    def method(self) -> str:
        """Method of the pictures in their records."""
        return str(next(iter(self.patches.values())).record.settings.get("method", "unknown"))

    @property
    def code_kind(self) -> str | None:
        """`qr` or `apriltag` if the pictures are codes."""
        code: dict[str, Any] = next(iter(self.patches.values())).record.settings.get("code") or {}
        return code.get("kind")

    def code_text(self, class_index: int) -> str:
        """Text of a class's code."""
        return str(self.patches[class_index].record.settings["code"]["text"])

    @property
    def sha256(self) -> str:
        """Hash of all pictures and their classes."""
        return sha256_bytes(repr([(k, self.patches[k].record.png_sha256) for k in sorted(self.patches)]).encode())

    def stack(self, classes: "np.ndarray") -> "np.ndarray":
        """(b, 3, n, n) float32 sRGB-encoded in [0, 1]: the pictures of (b,) class indices."""
        import numpy as np

        pixels = np.stack([self.patches[int(index)].pixels for index in classes])
        return np.ascontiguousarray(pixels.transpose(0, 3, 1, 2), np.float32) / 255


def read_patch_set(workspace: Workspace, name: str, labels: list[str] | None) -> PatchSet:
    """Read all pictures of a set and check them against labels, if any are given.

    Raises:
        ToolkitError: no such set, pictures of several sizes or two of a class, a damaged picture, or a class that is
            not the label at its index.
    """
    from toolkit.objects.records import read_patch

    # a set's file names do not matter: the record names the class
    patches: dict[int, Patch] = {}
    for file in workspace.with_patches(name).patches().values():
        patch = read_patch(file)
        record = patch.record
        # the same index is another class for another network
        if labels and (record.class_index >= len(labels) or labels[record.class_index] != record.class_name):
            other = f"'{labels[record.class_index]}'" if record.class_index < len(labels) else "no class"
            raise ToolkitError(
                f"{file}: made for class {record.class_index} '{record.class_name}', but index {record.class_index} of "
                f"this classifier is {other}: name the classifier that the set was made for (SET@MODEL)"
            )
        if record.class_index in patches:
            raise ToolkitError(f"set '{name}' has two pictures of class '{record.class_name}': remove {file}")
        patches[record.class_index] = patch
    # a set has a single size
    sizes = sorted({patch.record.n_px for patch in patches.values()})
    if len(sizes) > 1:
        shown = join_words(map(str, sizes))
        raise ToolkitError(f"set '{name}' has pictures of {shown} px: keep each size in a separate set")
    return PatchSet(name, sizes[0], patches)


class ClassPatchesConfig(Config):
    """Patches to train; other settings are those of every patch."""

    set_name: Annotated[SetName, Flag("--set", metavar="SET")] = Field(
        "patches", description="The sets are print/patches/SET-SIZE."
    )
    sizes_px: Annotated[tuple[int, ...], Field(min_length=1), Flag("--size-px", metavar="N")] = Field(
        (100,), description="Side in pixels, repeatable."
    )
    backgrounds: Annotated[Backgrounds, Flag()] = Field(
        "auto", description="class: images of the class only; all: every image; auto: of the class where there are 32."
    )
    images: Annotated[int, Field(ge=2), Flag()] = Field(
        256, description="Images kept in memory at most, a fifth of them held out."
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Seed of every random draw.")

    def data(self) -> DataConfig:
        """Name of the images in records."""
        return DataConfig(sources=(self.set_name,), backgrounds=self.backgrounds, images=self.images, seed=self.seed)


def make_flat_config(
    recipe: str, overrides: Mapping[str, Any], placement: Placement, config: ClassPatchesConfig
) -> PatchConfig:
    """Return a recipe with overrides for patches that are laid on images in memory."""
    fixed = {"affine": placement, "seed": config.seed}
    return make_config(recipe, {**FLAT, **overrides, **fixed}, config.data())
