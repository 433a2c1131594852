"""What decides what is on a wrap: the settings of a texture's training, how it is printed and how it is stuck on."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from toolkit.boosters.pixel_config import AUGMENTATION
from toolkit.boosters.texture_config import RECIPES as TEXTURE_RECIPES
from toolkit.boosters.texture_config import WEARS, TextureConfig, fit_recipe
from toolkit.boosters.transforms.printing import PrintProcess, ProfiledPrint
from toolkit.core.config import Flag
from toolkit.core.errors import FieldError
from toolkit.rig.requests import STUCK_ON, Misfit

PRINTED = 0.5
"""Share of the steps in which the wrap is a print, and not shown as the files have it."""


def check_object(names: tuple[str, ...]) -> tuple[str, ...]:
    """One object."""
    if len(names) != 1:
        raise FieldError("expected one object to wear the wrap; 'toolkit objects' lists them", {"objects": names})
    return names


class WrapTrainConfig(TextureConfig):
    """Every setting of a wrap's training; its size, and what keeps its paint, are the plan's."""

    stages = ("print", *TextureConfig.stages)
    objects: Annotated[
        tuple[str, ...], AfterValidator(check_object), Flag("--object", metavar="NAME", group=WEARS)
    ] = Field((), validate_default=False, exclude=True, description="Object that the wrap is for.")  # fmt: skip
    size_px: int = Field(200, exclude=True)
    keep: tuple[()] = Field((), exclude=True)
    keep_image: None = Field(None, exclude=True)
    unwrap: None = Field(None, exclude=True)
    start: None = Field(None, exclude=True)
    print_process: Annotated[PrintProcess | ProfiledPrint | None, Flag(group=AUGMENTATION)] = Field(
        None, description="Show the patch in the inks of a desktop printer."
    )
    misfit: Annotated[Misfit | None, Flag(group=STUCK_ON)] = Field(
        None, description="Stick each piece a little beside its place, in each studio another way."
    )


_texture = TEXTURE_RECIPES["default"]
RECIPES: dict[str, WrapTrainConfig] = {
    "default": WrapTrainConfig(
        **{name: getattr(_texture, name) for name in TextureConfig.model_fields if name not in ("objects", "about")},
        about=f"{_texture.about}, printed and stuck on by hand",
        print_process=PrintProcess(probability=PRINTED), misfit=Misfit(),
    )
}  # fmt: skip


def make_config(recipe: str, overrides: Mapping[str, Any]) -> WrapTrainConfig:
    """A recipe of a wrap with overrides, see `toolkit.boosters.texture_config.fit_recipe`."""
    return fit_recipe(RECIPES, recipe, overrides)
