"""From where and in what light: camera, poses, studio, renderers, patch mounting.

Settings of plans, places for patches and shot lists. Nothing heavy is loaded for them: commands make their options
from them.
"""

from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field, model_validator

from toolkit.core.config import Config, Expect, Flag, Joined, Range, Rising
from toolkit.core.errors import FieldError
from toolkit.objects.spec import MOST_PIECES, Material, Side

MOST_POSES = 10_000
"""Largest number of poses of an object. More are no day's work, and their file is too long for an editor."""
PAIR = ("unpatched", "patched")
Order = Literal["aba", "blocks", "alternate"]
MOST_PLACES = 6
"""Shown at once: each has its own colour."""
SHOT_LIST = "The shot list"
PICTURE = "What is on it"
STUCK_ON = "How a wrap is stuck on"
DISTANCES = "two distances over 0 and under 1000000 mm, the nearer first"


def _check_distances(distance_mm: Range) -> Range:
    if not 0 < distance_mm[0] <= distance_mm[1] < 1e6:
        raise ValueError(f"expected {DISTANCES}")
    return distance_mm


def _check_sheet(sheet_mm: Range) -> Range:
    if not all(12 <= side < 1e5 for side in sheet_mm):
        raise ValueError("expected two sides of 12 to 100000 mm")
    return sheet_mm


class Pattern(Config):
    """How camera positions are spread over an object."""

    name: Annotated[Literal["grid", "ring", "hemisphere", "fibonacci"], Flag("--pattern")] = Field(
        "grid", description="How the positions are spread."
    )
    count: Annotated[int, Field(ge=1, le=MOST_POSES), Flag()] = Field(18, description="Poses per object.")
    elevation_deg: Annotated[Range, Rising(0, 90), Flag("--elevation")] = Field(
        (25.0, 65.0), description="Lowest and highest elevation, degrees."
    )
    fill: Annotated[float, Field(ge=0.05, le=0.95), Flag()] = Field(
        0.8, description="Share of the frame's shorter side that the object fills."
    )
    distance_mm: Annotated[
        Annotated[Range, AfterValidator(_check_distances)] | None,
        Expect(DISTANCES),
        Flag("--distance", metavar="NEAR FAR", typed=Range),
    ] = Field(None, description="Nearest and farthest distance, mm, spread over the poses. Default: as {fill} says.")
    jitter_deg: Annotated[float, Field(ge=0, le=45), Flag("--jitter", metavar="DEGREES")] = Field(
        0.0, description="Standard deviation of a random change of azimuth and elevation."
    )
    seed: int = 0


class PlaceConfig(Config):
    """Which places are tried."""

    sizes_mm: Annotated[tuple[float, ...], Flag("--size-mm", metavar="MM")] = Field(
        (), description="Printed side to try; repeat for more. Default: as the patch is now, and two thirds of it."
    )
    sides: Annotated[tuple[Side, ...], Flag("--side", metavar="SIDE", typed=tuple[str, ...])] = Field(
        get_args(Side), description="top, front, back, left or right; repeat for more. Default: all."
    )
    steps: Annotated[int, Field(ge=2, le=100), Flag()] = Field(12, description="Places along the object's length.")
    best: Annotated[int, Field(ge=1, le=MOST_PLACES), Flag()] = Field(3, description="Places shown for each size.")
    sheets: Annotated[int, Field(ge=1, le=MOST_PLACES), Flag()] = Field(
        1, description="How many sheets are put on together; 2 or more are judged by random views, not by the plan's."
    )


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


class ShotListConfig(Config):
    """Objects and order of the shots, and the paper of the list."""

    paper: Annotated[str, Flag(metavar="SIZE", group=SHOT_LIST)] = Field("a4", description="a4, letter, or larger.")
    variants: Annotated[tuple[str, ...], Flag("--variant", metavar="NAME", group=SHOT_LIST)] = Field(
        PAIR, description="As in capture-sim; repeat for more."
    )
    order: Annotated[Order, Flag(group=SHOT_LIST)] = Field(
        "aba",
        description="aba: half of the unpatched shots before the patched ones, half after; blocks: one variant after "
        "the other; alternate: all variants at each pose.",
    )
