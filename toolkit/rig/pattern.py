"""How the camera positions of a plan are spread, as it is asked for."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from toolkit.core.config import Config, Expect, Flag, Range, Rising

MOST_POSES = 10_000
"""Of one object: beyond, a plan is no day's work for a camera, and its file none that an editor opens."""
DISTANCES = "distances over 0 and under 1000000 mm"


def _check_distances(distance_mm: Range) -> Range:
    if not all(0 < side < 1e6 for side in distance_mm):
        raise ValueError(f"expected {DISTANCES}")
    return distance_mm


class Pattern(Config):
    """How camera positions are spread over one object."""

    name: Annotated[Literal["grid", "ring", "hemisphere", "fibonacci"], Flag("--pattern")] = Field(
        "grid", description="How the positions are spread."
    )
    count: Annotated[int, Field(ge=1, le=MOST_POSES), Flag()] = Field(18, description="Poses per object.")
    elevation_deg: Annotated[Range, Rising(0, 90), Flag("--elevation")] = Field(
        (25.0, 65.0), description="Lowest and highest elevation, degrees."
    )
    fill: Annotated[float, Field(ge=0.05, le=0.95), Flag()] = Field(
        0.8, description="Share of the frame's shorter side that the object reaches across."
    )
    distance_mm: Annotated[
        Annotated[Range, AfterValidator(_check_distances)] | None,
        Expect(DISTANCES),
        Flag("--distance", metavar="NEAR FAR", typed=Range),
    ] = Field(None, description="Nearest and farthest distance, mm, spread over the poses. Default: as {fill} says.")
    jitter_deg: Annotated[float, Field(ge=0, le=45), Flag("--jitter", metavar="DEGREES")] = Field(
        0.0, description="Random change of azimuth and elevation, its standard deviation."
    )
    seed: int = 0
