"""The settings that patch and texture share: how pixels are moved, what their files are called, which images they see.

Nothing heavy is loaded for them.
"""

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, SerializeAsAny, model_validator

from toolkit.boosters.transforms import Transform
from toolkit.boosters.transforms.camera import CameraBlur, Jitter, JpegFile, SensorNoise
from toolkit.boosters.transforms.transfer import BlockShuffle, FeatureMixup
from toolkit.boosters.transforms.weather import Corrupted, ViewWeather, read_corruptions, read_weather
from toolkit.core.config import Config, Expect, Flag, Later, describe_changes
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.rooms import ask_room, find_offer
from toolkit.core.text import is_file_name

if TYPE_CHECKING:
    from toolkit.core.workspace import Workspace
    from toolkit.rig.views import OutdoorSetting
    from toolkit.training.loop import FitConfig


Backgrounds = Literal["auto", "all", "class"]
RIG = "rig"
HELD_OUT = 0.2


def _check_times(times: tuple[str, ...]) -> tuple[str, ...]:
    check = find_offer("times of day")  # without it there is no world either, which `open_world` says
    return times if check is None else check(times)


def count_held_out(count: int) -> int:
    """Number of held-out images or views: a fifth, and at least 1 of 2 or more."""
    return round(count * HELD_OUT) or int(count > 1)


def is_rig_source(source: str) -> bool:
    """Whether a source is renders: `rig`, or `rig:OBJECT`. The folder of that name is `./rig`."""
    return source == RIG or source.startswith(f"{RIG}:")


class DataConfig(Config):
    """Which images a booster is trained on."""

    sources: Annotated[
        tuple[str, ...],
        Expect("a folder of images, or 'rig' for renders of the object"),
        Field(min_length=1),
        Flag("--data", metavar="FOLDER|rig"),
    ] = Field(
        description="ImageFolder, any folder of images, or 'rig' (or rig:OBJECT) for renders; several may be given."
    )
    backgrounds: Annotated[Backgrounds, Flag()] = Field(
        "auto", description="class: images of the class only; all: every image; auto: of the class where there are any."
    )
    images: Annotated[int, Field(ge=2), Flag()] = Field(
        256, description="Images kept in memory at most, a fifth of them held out."
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Chooses them.")

    @model_validator(mode="after")
    def _check_count(self) -> "DataConfig":
        if self.images < 2 * len(self.sources):
            raise FieldError(f"expected at least 2 for each of {len(self.sources)} sources", {"images": self.images})
        return self

    @property
    def rig_source(self) -> str | None:
        """Return the first source that is renders of an object; None without such a source."""
        return next((source for source in self.sources if is_rig_source(source)), None)


STEPS, AUGMENTATION, WORLD = "Steps", "Augmentation", "In a world"
TRANSFER = "Transfer to other networks"
WORLD_ELEVATION_DEG, WORLD_FILL = (2.0, 75.0), (0.3, 1.0)
"""Default places of cameras in a world: from a person's height up, one to four lengths away."""
DEFAULT_ENSEMBLE: Literal["sum", "normalised", "turns"] = "turns"
SLOTS = ("affine", "pose", "weather")
"""Fields that are read by name; the transform of any other field acts at its stage."""
CameraParts = tuple[CameraBlur, SensorNoise, JpegFile]


MeetsCorruptions = Annotated[
    Corrupted | None,
    BeforeValidator(read_corruptions),
    Later,
    Flag("--corrupt", metavar="NAME[:SEVERITY]", group=AUGMENTATION, typed=tuple[str, ...]),
]
CORRUPTED_HELP = (
    "Corrupt half of the photographs as ImageNet-C does: noise:1-3, blur:5, common, all. Each view draws from several."
)


class PixelConfig(Config):
    """How the pixels of a booster are moved, and what it meets: every transform that a field holds acts."""

    stages: ClassVar[tuple[str, ...]] = ()
    about: str = Field("", exclude=True, description="Kind of the recipe.")
    recipe: str = "custom"
    changes: str = Field("", exclude=True, description="Settings in place of the recipe's, in words.")
    steps: Annotated[int | None, Field(ge=1), Flag(group=STEPS)] = Field(300, description="Gradient steps.")
    batch: Annotated[int, Field(ge=1), Flag(group=STEPS)] = Field(16, description="Images per step.")
    lr: Annotated[
        float, Field(gt=0, le=1), Expect("a number above 0 and at most 1, the full range"), Flag(group=STEPS)
    ] = Field(0.1, description="Change of every pixel in the first step, as a share of the full range.")
    schedule: Annotated[Literal["constant", "linear", "cosine"], Flag(group=STEPS)] = Field(
        "cosine", description="How the learning rate falls."
    )
    seed: Annotated[int, Field(ge=0)] = 0
    ensemble: Annotated[Literal["sum", "normalised", "turns"] | None, Later, Flag(group=TRANSFER)] = Field(
        None,
        description="Join several networks: sum adds their losses, normalised adds their gradients at equal length. "
        "turns uses a single network in each step. Default: turns.",
    )
    objective: Annotated[Literal["cross-entropy", "logit"], Later, Flag(group=TRANSFER)] = Field(
        "cross-entropy", description="Raise the probability of the class, or its logit."
    )
    lost_weight: Annotated[float, Later, Field(ge=1, le=10), Flag(metavar="X", group=TRANSFER)] = Field(
        1.0,
        description="Count a view X times if a network recognises it without the booster and not with it. 2 counts it "
        "double. Default: 1, as any other view.",
    )
    jitter: Annotated[Jitter | None, Later, Flag("--view-jitter", group=TRANSFER)] = Field(
        None, description="Show each network the photographs a little larger or smaller, and moved."
    )
    block_shuffle: Annotated[BlockShuffle | None, Later, Flag("--block-shuffle", group=TRANSFER)] = Field(
        None, description="Show each network half of the photographs in blocks that are shuffled and turned."
    )
    feature_mixup: Annotated[FeatureMixup | None, Later, Flag("--feature-mixup", group=TRANSFER)] = Field(
        None,
        description="Inside each network, mix features with those of other photographs without the booster; each step "
        "then runs the network once more.",
    )
    momentum: Annotated[float, Later, Field(ge=0, lt=1), Flag(group=TRANSFER)] = Field(
        0.0, description="How much of the earlier steps' direction each step keeps."
    )
    last_smoothing_px: Annotated[
        float, Later, Field(ge=0, le=16), Expect("0 to 16 texels"), Flag("--last-smoothing", group=TRANSFER)
    ] = Field(0.0, description="Gradient blur at the end (σ in texels).")
    smoothing_px: Annotated[float, Field(ge=0, le=16), Expect("0 to 16 texels"), Flag("--smoothing", group=STEPS)] = (
        # texels smaller than a pixel get gradients that are mostly noise, whose signs would step at random
        Field(2.0, description="Gradient blur at the start (σ in texels). It decreases linearly to --last-smoothing.")
    )
    start_contrast: Annotated[float, Field(ge=0, le=1), Flag(group=STEPS)] = Field(
        0.2, description="Contrast of the random first pixels; 1 is full."
    )
    weather: Annotated[
        SerializeAsAny[ViewWeather] | None,
        BeforeValidator(read_weather),
        Later,
        Flag(
            "--weather",
            metavar="NAME[:SEVERITY]",
            group=AUGMENTATION,
            typed=tuple[str, ...],
            make=lambda: read_weather({}),
        ),
    ] = Field(
        None,
        description="Add weather to half of the views, by distance at the object's real size: fog:1-5, dust:3, "
        "rain, snow. Each view draws from several.",
    )
    world: Annotated[str | None, Later, Flag(metavar="NAME|FILE", group=WORLD)] = Field(
        None,
        description="Train on views in this world, not in the studio: city, grass, apron, harbour, a mesh file "
        "of your own or "
        "the TOML of a kit.",
    )
    world_seed: Annotated[int, Field(ge=0), Later, Flag(group=WORLD)] = Field(
        1, description="Seed of the world. The default of world-eval is 0."
    )
    world_scale: Annotated[float, Field(gt=0), Later, Flag(group=WORLD)] = Field(
        1.0, description="Metres in a unit of your own mesh."
    )
    times: Annotated[
        tuple[str, ...], AfterValidator(_check_times), Field(min_length=1), Later,
        Flag("--time", metavar="NAME", group=WORLD),
    ] = Field(
        ("noon",), description="Time of day: noon, afternoon, golden, dusk, overcast; of several each place draws one."
    )  # fmt: skip

    @model_validator(mode="after")
    def _check_stages(self: "Settings") -> "Settings":
        for name, part in self.held_transforms():
            if name not in SLOTS and part.stage not in self.stages:
                words = f"{type(part).__name__} would never act: its stage is '{part.stage}'"
                raise ToolkitError(f"{name}: {words}, expected {', '.join(self.stages)}")
        return self

    def held_transforms(self) -> list[tuple[str, Transform]]:
        """(field, part) of each transform that a field holds, alone or in a tuple, in the order of the fields."""
        held = [(name, getattr(self, name)) for name in type(self).model_fields]
        flat = [
            (name, part)
            for name, transform in held
            for part in (transform if isinstance(transform, tuple) else (transform,))
        ]
        return [(name, part) for name, part in flat if isinstance(part, Transform)]

    def transforms(self, stage: str) -> tuple[Any, ...]:
        """The transforms of a stage, in the order in which they act: that of the fields."""
        return tuple(part for _, part in self.held_transforms() if part.stage == stage)

    @property
    def step_count(self) -> int:
        """How many steps, which must have been counted."""
        if self.steps is None:
            raise FieldError("expected {steps}, or {epochs} and the number of images", {})
        return self.steps

    def for_networks(self: "Settings", count: int) -> "Settings":
        """Return the config for so many networks: a single network has no ensemble, several need a way to combine."""
        # part of the settings that are hashed: with a single network every way gives the same pixels
        wanted = None if count == 1 else self.ensemble or DEFAULT_ENSEMBLE
        return self.model_copy(update={"ensemble": wanted})

    def fit_config(self, optimiser: str = "sign") -> "FitConfig":
        """For the training loop."""
        from toolkit.training.loop import FitConfig

        return FitConfig(self.step_count, self.lr, self.schedule, optimiser, self.seed)

    def open_world(self, workspace: "Workspace") -> "OutdoorSetting | None":
        """The world that is trained in; None: studios.

        Raises:
            ToolkitError: there is no such world or time, or the room of worlds is not installed.
        """
        if self.world is None:
            return None
        return ask_room("world")(workspace, self.world, self.times, seed=self.world_seed, scale=self.world_scale)


Recipe = TypeVar("Recipe", bound=PixelConfig)
Settings = TypeVar("Settings", bound=PixelConfig)
UNNAMED = ("spec.", "objects", "size_px", "seed", "steps", "batch")
"""Paths of hints, and of settings that a training names anyway."""


def find_recipe(recipes: dict[str, Recipe], name: str, overrides: Mapping[str, Any]) -> Recipe:
    """A recipe by name, which knows the overrides that differ from it.

    Raises:
        ToolkitError: there is none.
    """
    if name not in recipes:
        raise one_of("recipe", name, list(recipes))
    named = {path: value for path, value in overrides.items() if not path.startswith(UNNAMED)}
    return recipes[name].model_copy(update={"changes": describe_changes(recipes[name], named)})


def make_camera() -> CameraParts:
    """Blur, sensor noise and JPEG as a camera adds them."""
    return CameraBlur(), SensorNoise(), JpegFile()


def record_transforms(transforms: Sequence[Transform]) -> dict[str, Any] | None:
    """The settings of transforms under their names; None where there are none."""
    return {type(transform).__name__: transform.model_dump() for transform in transforms} or None


def name_files(name: str | None, label: str, index: int) -> str:
    """A booster's file name without suffix: the requested name, else a name from its class.

    Raises:
        FieldError: the name that was asked for cannot be a file's everywhere.
    """
    if name is not None:
        if not is_file_name(name):
            raise FieldError(f"{{name}} '{name}': expected letters, digits, '-' and '_', without a suffix", {})
        return name
    # a label may hold what no file's name can, such as a slash; a label of nothing else falls back to its index
    return re.sub(r"[^A-Za-z0-9]+", "_", label).strip("_") or f"class_{index}"
