"""Which settings act in a run, as an aligned table for the console."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from toolkit.boosters.parts.base import ImagePart, Range
from toolkit.boosters.parts.blur import CameraBlur
from toolkit.boosters.parts.fog import Fog
from toolkit.boosters.parts.jpeg import JpegFile
from toolkit.boosters.parts.light import Exposure
from toolkit.boosters.parts.sensor_noise import SensorNoise
from toolkit.boosters.patch_recipes import align_rows, describe_part
from toolkit.boosters.patch_steps import Descent
from toolkit.boosters.texture_config import TextureRequest
from toolkit.boosters.texture_objects import Wearers
from toolkit.core.errors import ToolkitError, one_of
from toolkit.rig.views import NEAR_VIEWS, WHOLE_SPHERE, ViewRanges, ViewSettings

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


def list_settings(request: TextureRequest, wearers: Wearers, label: str, networks: list[str]) -> list[str]:
    """One line per setting that acts, `name  value`, and one for what does not."""
    descent, views, ranges = request.descent, request.views, request.views.ranges
    about = f": {RECIPES[request.recipe].about}" if request.recipe in RECIPES else ""
    smoothing = f"Gaussian {descent.smoothing_px:g} px, falling to 0" if descent.smoothing_px else "none"
    evenly = ", evenly over the sphere" if ranges.evenly else ""
    place = f"elevation {ranges.elevation_deg[0]:g} to {ranges.elevation_deg[1]:g}°{evenly}"
    rendered = request.groups * views.studios * views.per_studio
    rows = [
        ("recipe", request.recipe + about),
        ("class", label),
        ("texture", f"{request.size_px} × {request.size_px} px, start contrast {descent.start_contrast:g}"),
        *(
            ("object", f"{item.name}, {_describe_atlas(atlas)}")
            for item, atlas in zip(wearers.items, wearers.atlases, strict=True)
        ),
        ("steps", f"{descent.steps} of {descent.batch} images, seed {descent.seed}"),
        ("step", f"{request.optimiser}, lr {descent.lr:g} ({descent.schedule}), smoothing {smoothing}"),
        ("gradient", request.gradient),
        (
            "views",
            f"{rendered}, each used {request.reuse} times, {request.held_out * views.per_studio} more held out; "
            f"{place}, roll {ranges.roll_deg[0]:g} to {ranges.roll_deg[1]:g}°, "
            f"filling {ranges.fill[0]:g} to {ranges.fill[1]:g} of the frame",
        ),
        ("networks", ", ".join(networks)),
    ]  # fmt: skip
    if request.background_share:
        rows.append(("backgrounds", f"photographs behind {request.background_share:.0%} of the views"))
    parts = {type(part).__name__: part for part in (request.exposure, *request.camera) if part is not None}
    rows += [(name, describe_part(part)) for name, part in parts.items()]
    return align_rows(rows)


def _describe_atlas(atlas) -> str:
    where = "new texture coordinates" if atlas.unwrapped else "its own texture coordinates"
    kept = 1 - atlas.trained.mean()
    paint = f", {kept:.0%} of its triangles keep their paint" if kept else ""
    return f"{len(atlas.mesh.faces)} triangles, {where}, {atlas.covered.mean():.0%} of the texture used{paint}"
