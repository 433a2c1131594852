"""Recipes: all settings of a texture's training under one name, each of which a flag may change."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from toolkit.boosters.appearance import ImagePart
from toolkit.boosters.blur import CameraBlur
from toolkit.boosters.fog import Fog
from toolkit.boosters.jpeg import JpegFile
from toolkit.boosters.ranges import Range
from toolkit.boosters.sensor_noise import SensorNoise
from toolkit.boosters.textures.exposure import Exposure
from toolkit.boosters.textures.request import TextureRequest
from toolkit.boosters.training import Descent
from toolkit.errors import ToolkitError, one_of
from toolkit.rig.training import NEAR_VIEWS, WHOLE_SPHERE, ViewRanges
from toolkit.rig.view_stream import ViewSettings

FOG_PROBABILITY = 0.5
"""Fog hides most of what a texture says, and is seen as often as a clear view."""


@dataclass(frozen=True)
class Choices:
    """What a user may set; None leaves it to the recipe. The names are those of `toolkit train-texture`'s flags."""

    steps: int | None = None
    batch: int | None = None
    lr: float | None = None
    schedule: str | None = None
    smoothing: float | None = None
    start_contrast: float | None = None
    optimiser: str | None = None
    gradient: str | None = None
    reuse: int | None = None
    elevation: Range | None = None
    roll: Range | None = None
    fill: Range | None = None
    background_share: float | None = None
    exposure: bool | None = None
    fog: bool | None = None
    camera: bool | None = None


@dataclass(frozen=True)
class Recipe:
    """A preset.

    Attributes:
        about: in a few words.
        ranges: where the camera stands.
        choices: a value for every flag but those of the camera's place.
        needs_backgrounds: photographs must be given.
    """

    about: str
    ranges: ViewRanges
    choices: Choices
    needs_backgrounds: bool = False


DEFAULT = Recipe(
    about="views above the table, light in the gradient, and what a camera meets",
    ranges=NEAR_VIEWS,
    choices=Choices(
        steps=300, batch=16, lr=0.05, schedule="cosine", smoothing=1.0, start_contrast=0.2, optimiser="sign",
        gradient="shaded", reuse=3, background_share=0.5, exposure=True, fog=True, camera=True,
    ),
)  # fmt: skip
PAPER = Recipe(
    about="Algorithm 2 as published: the whole sphere over photographs, plain sign steps, no light in the gradient",
    ranges=WHOLE_SPHERE,
    choices=Choices(
        steps=300, batch=16, lr=0.1, schedule="constant", smoothing=0.0, start_contrast=1.0, optimiser="sign",
        gradient="linear", reuse=1, background_share=1.0, exposure=False, fog=False, camera=False,
    ),
    needs_backgrounds=True,
)  # fmt: skip
"""The seed gives no distance range, number of steps or batch for textures: they are ours."""
RECIPES = {"default": DEFAULT, "paper": PAPER}


def make_request(
    recipe_name: str,
    choices: Choices,
    objects: tuple[str, ...],
    seed: int = 0,
    image_px: int = 224,
    backgrounds: Path | None = None,
    **others: Any,
) -> TextureRequest:
    """The user's choices, then the recipe's.

    Args:
        recipe_name: one of `RECIPES`.
        choices: the user's.
        objects: who wears the texture.
        seed: of every draw.
        image_px: side of what the networks see.
        backgrounds: folder of photographs.
        others: further fields of `TextureRequest`.

    Raises:
        ToolkitError: an unknown recipe, or a choice out of its range.
    """
    if recipe_name not in RECIPES:
        raise one_of("recipe", recipe_name, list(RECIPES))
    recipe = RECIPES[recipe_name]
    given: dict[str, Any] = {
        one.name: getattr(recipe.choices if getattr(choices, one.name) is None else choices, one.name)
        for one in fields(Choices)
    }
    if backgrounds is None and choices.background_share is None:
        if recipe.needs_backgrounds:
            raise ToolkitError(
                f"--recipe {recipe_name} shows the object over photographs: name a folder of them with --backgrounds, "
                "or stay in the studio with --background-share 0"
            )
        given["background_share"] = 0.0
    camera: tuple[ImagePart, ...] = (Fog(probability=FOG_PROBABILITY),) if given["fog"] else ()
    if given["camera"]:
        camera = (*camera, CameraBlur(), SensorNoise(), JpegFile())
    return TextureRequest(
        objects=objects,
        descent=Descent(
            given["steps"], given["batch"], given["lr"], given["schedule"], seed, given["smoothing"],
            given["start_contrast"],
        ),
        optimiser=given["optimiser"],
        gradient=given["gradient"],
        views=ViewSettings(_choose_ranges(recipe.ranges, choices), image_px),
        reuse=given["reuse"],
        exposure=Exposure() if given["exposure"] else None,
        camera=camera,
        backgrounds=backgrounds,
        background_share=given["background_share"],
        recipe=recipe_name,
        **others,
    )  # fmt: skip


def _choose_ranges(ranges: ViewRanges, choices: Choices) -> ViewRanges:
    limits = (("elevation", -90, 90, "°"), ("roll", -180, 180, "°"), ("fill", 0.05, 1.0, " of the frame"))
    for name, lowest, highest, unit in limits:
        chosen = getattr(choices, name)
        if chosen is not None and not lowest <= chosen[0] <= chosen[1] <= highest:
            expected = f"two rising numbers from {lowest:g} to {highest:g}{unit}"
            raise ToolkitError(f"--{name} {chosen[0]:g} {chosen[1]:g}: expected {expected}")
    return ViewRanges(
        choices.elevation or ranges.elevation_deg, choices.roll or ranges.roll_deg, choices.fill or ranges.fill,
        ranges.off_centre, ranges.evenly,
    )  # fmt: skip
