"""The settings of a wrap's training, and their recipes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from toolkit.boosters.patch_config import use_printer
from toolkit.boosters.pixel_config import AUGMENTATION, STEPS
from toolkit.boosters.texture_config import RECIPES, WEARS, TextureConfig, fit_recipe
from toolkit.boosters.transforms.printing import SHEEN, PrintProcess, ProfiledPrint
from toolkit.core.config import Expect, Flag, Later
from toolkit.core.errors import FieldError
from toolkit.rooms.wraps.config import MOST_PIECES, STUCK_ON, Misfit

PRINTED = 0.5
"""Share of the steps in which the wrap is a print, and not shown as the files have it."""


def check_object(names: tuple[str, ...]) -> tuple[str, ...]:
    """One object."""
    if len(names) != 1:
        raise FieldError("expected one object to wear the wrap; 'toolkit objects' lists them", {"objects": names})
    return names


def read_counts(given: Any) -> Any:
    """`1..12`, or a single number, as the fewest and the most."""
    if not isinstance(given, str):
        return given
    low, _, high = given.partition("..")
    return (low, high or low)


def check_counts(counts: tuple[int, int]) -> tuple[int, int]:
    """Positive, and rising."""
    if not 1 <= counts[0] <= counts[1] <= MOST_PIECES:
        raise ValueError(f"expected numbers of pieces such as 1..12, at most {MOST_PIECES}")
    return counts


class WrapTrainConfig(TextureConfig):
    """Every setting of a wrap's training; its size, and what keeps its paint, are the plan's."""

    stages = ("print", *TextureConfig.stages)
    objects: Annotated[
        tuple[str, ...], AfterValidator(check_object), Flag("--object", metavar="NAME", group=WEARS)
    ] = Field((), validate_default=False, exclude=True, description="Object that the wrap is for.")  # fmt: skip
    size_px: int = Field(200, exclude=True)
    keep: tuple[()] = Field((), exclude=True)
    keep_image: None = Field(None, exclude=True)
    renderer: Literal["raycast"] = Field("raycast", exclude=True)
    unwrap: None = Field(None, exclude=True)
    start: Annotated[Path | None, Flag(metavar="FILE", group=STEPS)] = Field(
        None,
        exclude=True,
        description="Go on from this, in place of noise: the folder of a wrap, a texture's PNG, or a picture in the "
        "object's texture coordinates. From a picture, {max_change} is counted from it.",
    )
    pieces: Annotated[
        Annotated[tuple[int, int], AfterValidator(check_counts)] | None,
        BeforeValidator(read_counts), Expect("numbers of pieces such as 1..12"), Later,
        Flag("--pieces", metavar="LOW..HIGH", group=WEARS, typed=str),
    ] = Field(
        None,
        description="Rank the pieces by what the networks say, and keep the fewest of so many that do as well as more. "
        "Default: all are kept.",
    )  # fmt: skip
    print_process: Annotated[PrintProcess | ProfiledPrint | None, Flag(group=AUGMENTATION)] = Field(
        None, description="Show the patch in the inks of a desktop printer."
    )
    misfit: Annotated[Misfit | None, Flag(group=STUCK_ON)] = Field(
        None, description="Stick each piece a little beside its place, in each studio another way."
    )


_texture = RECIPES["default"]
WRAP_RECIPES: dict[str, WrapTrainConfig] = {
    "default": WrapTrainConfig(
        **{name: getattr(_texture, name) for name in TextureConfig.model_fields if name not in ("objects", "about")},
        about=f"{_texture.about}, printed and stuck on by hand",
        print_process=PrintProcess(probability=PRINTED), misfit=Misfit(),
    )
}  # fmt: skip


def make_wrap_config(recipe: str, overrides: Mapping[str, Any], print_profile: Path | None = None) -> WrapTrainConfig:
    """A recipe of a wrap with overrides, see `fit_recipe`, and the printer of a profile's file, see `use_printer`."""
    if print_profile is not None:
        # a renderer shows the pieces, and adds the gloss that the profile holds
        overrides = use_printer(overrides, print_profile, SHEEN)
    return fit_recipe(WRAP_RECIPES, recipe, overrides)
