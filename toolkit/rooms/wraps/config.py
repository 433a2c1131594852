"""The settings of a wrap's plan, and how it is stuck on; nothing heavy is loaded for them."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from toolkit.core.config import Config, Flag, Joined, Range
from toolkit.core.errors import FieldError

Material = Literal["paper", "film", "vinyl"]
STRETCH: dict[Material, float] = {"paper": 0.01, "film": 0.03, "vinyl": 0.08}
"""Largest stretch of a piece before it tears or wrinkles."""
MOST_PIECES = 99
"""Largest number of pieces of a wrap."""
PICTURE = "What is on it"
STUCK_ON = "How a wrap is stuck on"


def _check_sheet(sheet_mm: Range) -> Range:
    if not all(12 <= side < 1e5 for side in sheet_mm):
        raise ValueError("expected two sides of 12 to 100000 mm")
    return sheet_mm


class WrapConfig(Config):
    """Which flat pieces are looked for."""

    pieces: Annotated[int, Field(ge=1, le=MOST_PIECES), Flag()] = Field(12, description="Most pieces.")
    material: Annotated[Material, Flag()] = Field(
        "film", description="Material of the pieces; it stretches: paper 1 %, film 3 %, vinyl 8 %."
    )
    stretch: Annotated[float | None, Field(gt=0, le=0.5), Flag()] = Field(
        None, description="Most stretch of a piece, 0.03 is 3 %. Default: as {material} allows."
    )
    sheet_mm: Annotated[
        Annotated[Range, AfterValidator(_check_sheet)], Joined(" × "), Flag(metavar="WIDTH HEIGHT", typed=Range)
    ] = Field((177.0, 241.0), description="Largest piece, mm. Default: what a printed A4 page has room for.")
    net: Annotated[bool, Flag("--net")] = Field(
        False, description="Unfold the whole surface as a paper model with glue tabs; {pieces} does not count."
    )
    texel_mm: Annotated[float | None, Field(ge=0.05, le=100), Flag(metavar="MM")] = Field(
        None, description="Side of a texel. Default: the object's longest side / 270."
    )
    views: Annotated[int, Field(ge=8, le=10_000), Flag()] = Field(
        64, description="Random cameras that judge what is worth covering."
    )
    picture: Annotated[Path | None, Flag(metavar="FILE", group=PICTURE)] = Field(
        None,
        description="Put this on the pieces: a picture in the object's texture coordinates, a texture's PNG, or the "
        "folder of a wrap. Default: the object's own paint.",
    )
    pattern_mm: Annotated[float | None, Field(ge=1, le=100_000), Flag(metavar="MM", group=PICTURE)] = Field(
        None, description="Repeat {picture} on each piece; this is the length of its longer side, mm."
    )
    keep: Annotated[tuple[str, ...], Flag("--keep-material", metavar="MATERIAL", group=PICTURE)] = Field(
        (), description="Material that keeps its paint under {picture}, such as glass; repeat for more."
    )

    @model_validator(mode="after")
    def _check_picture(self) -> "WrapConfig":
        for name in ("pattern_mm", "keep"):
            if getattr(self, name) and self.picture is None:
                raise FieldError("goes with {picture}: add that, or leave it out", {name: getattr(self, name)})
        if self.keep and self.pattern_mm is not None:
            raise FieldError("cannot be used with {pattern_mm}, which is laid on whole pieces", {"keep": self.keep})
        return self


class Misfit(Config):
    """How far from its place a piece of a wrap is stuck: for each piece drawn evenly up to these, both ways."""

    shift_mm: Annotated[float, Field(ge=0, le=20), Flag("--misfit-mm", group=STUCK_ON)] = Field(
        1.0, description="Each piece lies beside its place by up to this, to the side and up, mm."
    )
    turn_deg: Annotated[float, Field(ge=0, le=45), Flag("--misfit-deg", group=STUCK_ON)] = Field(
        1.0, description="Each piece is turned by up to this, degrees."
    )
    scale: Annotated[float, Field(ge=0, le=0.1), Flag("--misfit-scale", group=STUCK_ON)] = Field(
        0.005, description="Each piece is larger or smaller by up to this share."
    )
