"""The settings of a texture's training, and their recipes."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import AfterValidator, Field, model_validator

from toolkit.boosters.pixel_config import (
    AUGMENTATION,
    CORRUPTED_HELP,
    STEPS,
    WORLD_ELEVATION_DEG,
    WORLD_FILL,
    CameraParts,
    MeetsCorruptions,
    PixelConfig,
    find_recipe,
    make_camera,
    record_transforms,
)
from toolkit.boosters.transforms import OF_NETWORKS
from toolkit.boosters.transforms.camera import Exposure
from toolkit.boosters.transforms.weather import Fog
from toolkit.core.config import Expect, Flag, Later, Range, Rising
from toolkit.core.errors import FieldError
from toolkit.rig.renderers import RAYCAST, RENDERERS, check_renderer, check_world_renderer

if TYPE_CHECKING:
    from toolkit.rig.views import ViewSettings

METHOD = "unadversarial texture, Algorithm 2"
MIN_PX, MAX_PX = 8, 1024
CLOUDS_PROBABILITY = 0.5
"""Clouds hide most of what a texture says, and are seen as often as a clear view."""
WEARS, SEEN = "Object", "Views"

MaxChange = Annotated[
    Annotated[float, Field(gt=0, le=1)] | Literal["auto"] | None, Expect("a number above 0 and at most 1, or auto")
]
"""How far a texture may leave the object's own paint."""
KNOWN, NEAR = 0.75, 0.2
"""If networks recognise the unmodified object in this share of views, `auto` allows this change of paint. The texture
then transfers best to unseen networks. Other objects are painted freely (docs/tasks/transfer.md, "Keep its looks")."""


def check_objects(names: tuple[str, ...]) -> tuple[str, ...]:
    """Some objects, each once."""
    if not names:
        raise FieldError(
            "{objects}: expected at least one object to wear the texture; 'toolkit objects' lists them", {}
        )
    if len(set(names)) < len(names):
        raise FieldError("expected each object once", {"objects": names})
    return names


def make_clouds() -> Fog:
    """ImageNet-C's fog over half of the views."""
    return Fog(probability=CLOUDS_PROBABILITY)


class TextureConfig(PixelConfig):
    """Every setting of a texture's training. Transforms that are None do not act."""

    stages: ClassVar[tuple[str, ...]] = ("light", "photo", *OF_NETWORKS)
    objects: Annotated[
        tuple[str, ...], AfterValidator(check_objects), Flag("--object", metavar="NAME", group=WEARS)
    ] = Field(
        (), validate_default=False, exclude=True,
        description="Object that the texture is for. Several objects of a class share a texture.",
    )  # fmt: skip
    size_px: Annotated[int, Field(ge=MIN_PX, le=MAX_PX), Flag(group=WEARS)] = Field(
        200, exclude=True, description="Side of the texture, pixels."
    )
    keep: Annotated[tuple[str, ...], Flag("--keep-material", metavar="MATERIAL", group=WEARS)] = Field(
        (), exclude=True, description="Material that keeps its paint, such as glass; repeat for more."
    )
    keep_image: Annotated[Path | None, Flag(metavar="FILE", group=WEARS)] = Field(
        None,
        exclude=True,
        description="Picture in the object's texture coordinates; where it is white the object keeps its paint.",
    )
    unwrap: Annotated[bool | None, Flag("--unwrap/--own-uv", group=WEARS)] = Field(
        None, exclude=True, description="Make new texture coordinates, or use the mesh's. Default: as needed."
    )
    optimiser: Annotated[Literal["sign", "sgd", "adam"], Flag(group=STEPS)] = Field(
        "sign", description="How each step changes the texture."
    )
    start: Annotated[Path | None, Flag(metavar="FILE", group=STEPS)] = Field(
        None, exclude=True, description="Begin with this texture's PNG, of the same objects, in place of noise."
    )
    max_change: Annotated[MaxChange, Later, Flag(metavar="X|auto", group=STEPS, typed=str)] = Field(
        None,
        description="Begin with the object's own paint, and change no channel by more than this share of its range. "
        "auto: 0.2 if the networks recognise the unmodified object in three of four views, else no limit.",
    )
    gradient: Annotated[Literal["shaded", "linear"], Flag(group=STEPS)] = Field(
        "shaded", description="shaded: light in the gradient; linear: the paper's approximation."
    )
    renderer: Annotated[
        str, AfterValidator(check_renderer), Later, Flag(metavar="|".join(RENDERERS), group=SEEN)
    ] = Field(
        RAYCAST,
        description="Renderer of the training images. The gradient is always that of raycast.",
    )  # fmt: skip
    elevation_deg: Annotated[Range, Rising(-90, 90), Flag("--elevation", group=SEEN)] = Field(
        (20.0, 70.0), exclude=True, description="Lowest and highest camera, degrees above the table."
    )
    roll_deg: Annotated[Range, Rising(-180, 180), Flag("--roll", group=SEEN)] = Field(
        (-8.0, 8.0), exclude=True, description="Roll of the camera, lowest and highest, degrees."
    )
    fill: Annotated[Range, Rising(0.05, 1), Flag(group=SEEN)] = Field(
        (0.6, 0.95), exclude=True, description="Smallest and largest share of the frame that the object fills."
    )
    off_centre: float = Field(0.0, exclude=True, description="Shift of the object's middle, share of the half frame.")
    evenly: bool = Field(False, exclude=True, description="Elevations are drawn evenly over the sphere's area.")
    studios: Annotated[int, Field(ge=1)] = Field(
        4, exclude=True, description="That are used together, see ViewSettings."
    )
    per_studio: Annotated[int, Field(ge=1)] = Field(24, exclude=True, description="Views of each studio.")
    reuse: Annotated[int, Field(ge=1), Flag(group=STEPS)] = Field(
        3, description="How many times each rendered view is used."
    )
    exposure: Annotated[Exposure | None, Flag(group=AUGMENTATION)] = Field(
        Exposure(), description="Vary strength and tint of the light."
    )
    clouds: Annotated[Fog | None, Flag(group=AUGMENTATION, make=make_clouds)] = Field(
        None,
        exclude=True,
        description="ImageNet-C's clouds over half of the views; they ignore distance, {weather} does not.",
    )
    camera: Annotated[CameraParts | None, Flag(group=AUGMENTATION, make=make_camera)] = Field(
        None, exclude=True, description="Add a camera's blur, sensor noise and JPEG."
    )
    corrupted: MeetsCorruptions = Field(None, exclude=True, description=CORRUPTED_HELP)
    backgrounds: Annotated[Path | None, Flag("--background-folder", metavar="FOLDER", group=SEEN)] = Field(
        None, exclude=True, description="Photographs to stand behind the object; the paper recipe needs them."
    )
    background_share: Annotated[float, Field(ge=0, le=1), Flag(group=SEEN)] = Field(
        0.0, description="Share of the views with a photograph behind the object; 0 without photographs."
    )
    held_out: Annotated[int, Field(ge=1)] = Field(
        3, exclude=True, description="Studios, of `per_studio` views each, that are not trained on."
    )

    @model_validator(mode="after")
    # settings that are right by themselves and contradict each other
    def _check_together(self) -> "TextureConfig":
        if self.keep_image is not None and len(self.objects) > 1:
            expected = "{keep_image} is of one object's texture coordinates: train one object, or use {keep}"
            raise FieldError(expected, {})
        if self.max_change is not None and len(self.objects) > 1:
            expected = "objects that share a texture have not the same paint: train one object, or leave it out"
            raise FieldError(expected, {"max_change": self.max_change})
        if self.renderer != RAYCAST and self.weather is not None:
            expected = f"draws no weather: leave {{weather}} out, or use the renderer {RAYCAST}"
            raise FieldError(expected, {"renderer": self.renderer})
        if self.world is not None:
            check_world_renderer(self.renderer)
        return self

    def check_backgrounds(self) -> None:
        """Photographs are named where they shall stand behind the object: a recipe alone names none.

        In a world there is no room for them.
        """
        if self.world is not None and (self.background_share or self.backgrounds is not None):
            raise FieldError("stands behind the object already: leave {backgrounds} out", {"world": self.world})
        if self.background_share and self.backgrounds is None:
            expected = "needs photographs: name a folder of them with {backgrounds}, or say 0"
            raise FieldError(expected, {"background_share": self.background_share})

    @property
    def steps_per_group(self) -> int:
        """How many steps a group of views serves."""
        # a batch larger than a group still makes a step of it
        return max(1, self.studios * self.per_studio * self.reuse // self.batch)

    @property
    def groups(self) -> int:
        """How many groups of views the run needs."""
        return -(-self.step_count // self.steps_per_group)

    def views(self, image_px: int) -> "ViewSettings":
        """How the rig draws views for a network that sees `image_px` a side."""
        from toolkit.rig.views import ViewRanges, ViewSettings

        ranges = ViewRanges(
            elevation_deg=self.elevation_deg, roll_deg=self.roll_deg, fill=self.fill, off_centre=self.off_centre,
            evenly=self.evenly,
        )  # fmt: skip
        return ViewSettings(ranges, image_px=image_px, studios=self.studios, per_studio=self.per_studio)

    def settings(self, image_px: int) -> dict[str, Any]:
        """Every hyper-parameter, as recorded beside the texture."""
        # transforms on the photograph are recorded together
        on_photo = {name for name, part in self.held_transforms() if part.stage == "photo"}  # they are "camera" below
        plain = {name: value for name, value in super().record().items() if name not in on_photo}
        rest = {name: plain.pop(name) for name in ("reuse", "exposure", "background_share")}
        if self.renderer != RAYCAST:
            kind = RENDERERS[self.renderer]
            plain["renderer"] = {"name": self.renderer, "version": kind.version, "library": kind.describe()[0]}
        return {
            "method": METHOD,
            **plain,
            "views": asdict(self.views(image_px)),
            "reuse": rest["reuse"],
            "exposure": rest["exposure"],
            "camera": record_transforms(self.transforms("photo")),
            "background_share": rest["background_share"],
            "held_out_views": self.held_out * self.per_studio,
        }


RECIPES: dict[str, TextureConfig] = {
    "default": TextureConfig(
        recipe="default", about="views above the table, light in the gradient, camera simulated",
        steps=300, batch=16, lr=0.05, schedule="cosine", smoothing_px=1.0, start_contrast=0.2,
        clouds=make_clouds(), camera=make_camera(), background_share=0.5,
    ),
    "paper": TextureConfig(
        recipe="paper",
        about="Algorithm 2 as published: the whole sphere over photographs, plain sign steps, no light in the gradient",
        steps=300, batch=16, lr=0.1, schedule="constant", smoothing_px=0.0, start_contrast=1.0, gradient="linear",
        reuse=1, exposure=None, background_share=1.0,
        elevation_deg=(-90.0, 90.0), roll_deg=(-180.0, 180.0), fill=(0.35, 0.95), off_centre=0.15, evenly=True,
    ),
}  # fmt: skip
"""The paper gives no distance range, number of steps or batch for textures: they are ours."""


Surface = TypeVar("Surface", bound=TextureConfig)


def make_config(recipe: str, overrides: Mapping[str, Any]) -> TextureConfig:
    """A recipe of a texture with overrides, see `fit_recipe`."""
    return fit_recipe(RECIPES, recipe, overrides)


def fit_recipe(recipes: dict[str, Surface], recipe: str, overrides: Mapping[str, Any]) -> Surface:
    """A recipe with overrides; without photographs, the default recipe stays in the studio, and a world has its ranges.

    Raises:
        ToolkitError: an unknown recipe, or a setting that is out of its range.
    """
    fitted = dict(overrides)
    if "fog" in fitted:  # what clouds were called
        fitted["clouds"] = fitted.pop("fog")
    base = find_recipe(recipes, recipe, fitted)
    # a world has ranges of its own, and needs no photographs behind the object
    if fitted.get("world") is not None:
        outdoors = {"background_share": 0.0, "elevation_deg": WORLD_ELEVATION_DEG, "fill": WORLD_FILL}
        base = base.model_copy(update=outdoors)
    # without photographs the studio stays behind the object
    if fitted.get("backgrounds") is None and fitted.get("background_share") is None:
        if base.background_share == 1:
            raise FieldError(
                f"{{recipe}} {recipe} shows the object over photographs: name a folder of them with {{backgrounds}}, "
                "or stay in the studio with {background_share} 0",
                {},
            )
        fitted["background_share"] = 0.0
    config = base.with_overrides(fitted)
    config.check_backgrounds()
    return config
