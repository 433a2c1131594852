"""From where and in what light: camera, poses, studio, renderers, patch mounting.

Settings of plans, places for patches and shot lists. Nothing heavy is loaded for them: commands make their options
from them.
"""

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field

from toolkit.core.config import Config, Expect, Flag, Range, Rising
from toolkit.objects.spec import Side

MOST_POSES = 10_000
"""Largest number of poses of an object. More are no day's work, and their file is too long for an editor."""
PAIR = ("unpatched", "patched")
Order = Literal["aba", "blocks", "alternate"]
MOST_PLACES = 6
"""Shown at once: each has its own colour."""
SHOT_LIST = "The shot list"
DISTANCES = "two distances over 0 and under 1000000 mm, the nearer first"


def _check_distances(distance_mm: Range) -> Range:
    if not 0 < distance_mm[0] <= distance_mm[1] < 1e6:
        raise ValueError(f"expected {DISTANCES}")
    return distance_mm


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
