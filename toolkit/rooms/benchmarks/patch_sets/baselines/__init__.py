"""Baselines of patches: codes, words, photographs, fixed patterns (the paper, Appendix D.2).

Here are their settings, for the command line and for Python; nothing heavy is loaded for them.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from toolkit.core.config import Config, Expect, Flag
from toolkit.core.errors import FieldError
from toolkit.rooms.benchmarks.patch_sets import SetName

QR, APRILTAG, WORD = "qr", "apriltag", "word"
BEST_IMAGE, RANDOM_IMAGE, FIXED_PATTERN = "best-image", "random-image", "fixed-pattern"
NEED_DATA = (BEST_IMAGE, RANDOM_IMAGE)


class BaselineConfig(Config):
    """Patch sets of a kind to make."""

    kind: Annotated[
        Literal["qr", "apriltag", "word", "best-image", "random-image", "fixed-pattern"],
        Flag(positional=True, metavar="KIND"),
    ] = Field(description="qr, apriltag, word, best-image, random-image or fixed-pattern.")
    class_names: Annotated[tuple[str, ...], Flag("--class", metavar="NAME")] = Field(
        (), description="A label, index or WordNet id; may be repeated. Default: those of --data, else all."
    )
    sizes_px: Annotated[tuple[int, ...], Field(min_length=1), Flag("--size-px", metavar="N")] = Field(
        (100,), description="Side of the pictures; may be repeated."
    )
    data: Annotated[str | None, Flag(metavar="FOLDER")] = Field(
        None,
        description="Training images, a folder per class, or cifar10:FOLDER. best-image and random-image need them.",
    )
    set_name: Annotated[SetName | None, Flag("--set", metavar="SET")] = Field(
        None, description="The sets are print/patches/SET-SIZE. Default: the kind."
    )
    border: Annotated[
        int | None, Field(ge=1), Expect("1 or more white modules, without which no reader finds it"), Flag()
    ] = Field(
        None,
        description="Width of the white border around a code, in modules. Default: 1, as in the paper; the QR "
        "standard asks for 4.",
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Seed of every random draw.")

    @model_validator(mode="after")
    def _check_kind(self) -> "BaselineConfig":
        if self.kind in NEED_DATA and self.data is None:
            raise FieldError(f"{self.kind}: expected training images, a folder per class: name them with {{data}}", {})
        if self.border is not None and self.kind not in (QR, APRILTAG):
            raise FieldError(f"{self.kind} is no code and has none: leave it out", {"border": self.border})
        return self

    def name_set(self, size_px: int) -> str:
        """Return the folder of the pictures of a size."""
        return f"{self.set_name or self.kind}-{size_px}"
