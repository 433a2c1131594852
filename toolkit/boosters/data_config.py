"""Which images a booster is trained on; nothing heavy is loaded for it."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from toolkit.core.config import Config, Expect, Flag
from toolkit.core.errors import FieldError

Backgrounds = Literal["auto", "all", "class"]
RIG = "rig"
HELD_OUT = 0.2


def count_held_out(count: int) -> int:
    """How many of so many images or views are held out: a fifth, at least one where another is left."""
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
        """The first source that is renders of an object, where there is one."""
        return next((source for source in self.sources if is_rig_source(source)), None)
