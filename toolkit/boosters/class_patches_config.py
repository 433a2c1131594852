"""The settings of patches for many classes, declared once; nothing heavy is loaded for them."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from toolkit.boosters.data_config import Backgrounds, DataConfig
from toolkit.boosters.patch_config import PatchConfig, make_config
from toolkit.boosters.patch_sets import SetName
from toolkit.boosters.transforms.placement import Placement
from toolkit.core.config import Config, Flag

FLAT = {"pose": False, "light": False, "print_process": False, "glare": False, "camera": False, "mounted_share": 0.0}
"""What a patch that is laid on images in memory does not meet."""
ASKED_OF_FLAT = (
    "steps", "epochs", "batch", "lr", "schedule", "smoothing_px", "last_smoothing_px", "start_contrast", "objective",
    "jitter", "momentum", "corrupted",
)  # fmt: skip
"""What else may be asked of its recipe."""


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


def make_flat_config(
    recipe: str, overrides: Mapping[str, Any], placement: Placement, config: ClassPatchesConfig
) -> PatchConfig:
    """A recipe with overrides for patches that are laid on images in memory: they meet no world."""
    fixed = {"affine": placement, "seed": config.seed}
    return make_config(recipe, {**FLAT, **overrides, **fixed}, config.data())
