"""Objects in a world, seen by a network from a grid of cameras through weather: the paper's experiment in a city.

The settings are declared here once, for the command line and for Python; nothing heavy is loaded for them.
"""

import math
import re
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field

from toolkit.core.config import Config, Flag, Later
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.evaluation import RunName
from toolkit.rig.renderers import IN_WORLDS, RAYCAST, RENDERERS, check_world_renderer
from toolkit.rooms.worlds import conditions
from toolkit.rooms.worlds.conditions import CLEAR, DRY, Kind, Time

GridShape = tuple[int, int, int]
GRID_WORDS = re.compile(r"(\d{1,3})[x×](\d{1,3})[x×](\d{1,3})")
MOST_POINTS = 1_000_000
ON_THE_TABLE = "patch-alone"
ABSENT = "absent"
"""The variant without the object: how often its class is said of the place alone."""
WORLD, VIEW = "World", "Cameras"


def read_grid(given: object) -> object:
    """(along, across, up) from words such as `10x10x10`; anything else as it is.

    Raises:
        ToolkitError: they say no grid.
    """
    if not isinstance(given, str):
        return given
    found = GRID_WORDS.fullmatch(given.strip())
    # zero cameras in a direction would make an empty grid
    if not found or min(map(int, found.groups())) < 1:
        raise FieldError("expected cameras along, across and up, each 1 to 999, such as 10x10x10", {"grid": given})
    shape = tuple(map(int, found.groups()))
    if math.prod(shape) > MOST_POINTS:
        raise FieldError(f"expected at most {MOST_POINTS:,} cameras around a place", {"grid": given})
    return shape


def check_renderer(renderer: str) -> str:
    """Return a renderer that draws worlds, or a simulator's address; a `FieldError` if it is neither."""
    if renderer in RENDERERS:
        return check_world_renderer(renderer)
    from toolkit.rooms.worlds.airsim import Address

    Address.parse(renderer)
    return renderer


def check_variants(variants: tuple[str, ...]) -> tuple[str, ...]:
    """Variants that can stand in a world, each once.

    Raises:
        ToolkitError: there is no such variant, or it shows a patch without the object.
    """
    from toolkit.rig.variants import VARIANTS

    for variant in variants:
        if variant not in (*VARIANTS, ABSENT):
            raise one_of("variant", variant, [*VARIANTS, ABSENT])
        if variant == ON_THE_TABLE:
            raise ToolkitError(
                f"variant '{variant}' shows a patch on a table without its object: leave it out in a world"
            )
    return tuple(dict.fromkeys(variants))


def put_clear_first(weathers: tuple[tuple[str, int], ...]) -> tuple[tuple[str, int], ...]:
    """The same, clear air before them."""
    return tuple(dict.fromkeys((CLEAR, *weathers)))


Weathers = Annotated[conditions.Weathers, AfterValidator(put_clear_first)]
"""(name, severity) of each, clear air first."""


class WorldEvalConfig(Config):
    """An evaluation in a world; see `evaluate_world`."""

    object: Annotated[str, Flag(metavar="NAME")] = Field("warplane", description="Object in the world.")
    variants: Annotated[tuple[str, ...], AfterValidator(check_variants), Flag("--variant", metavar="NAME")] = Field(
        ("unpatched", "textured"),
        min_length=1,
        description="unpatched, patched, wrapped, textured, or a control such as grey-texture or absent; may be "
        "repeated.",
    )
    weathers: Annotated[Weathers, Flag("--weather", metavar="NAME[:SEVERITY]", typed=tuple[str, ...])] = Field(
        (CLEAR,),
        description="fog, dust, rain or snow: fog:3, fog:1-5; without a severity all five; may be repeated. Clear air "
        "is always among them.",
    )
    world: Annotated[str, Flag(metavar="NAME|FILE", group=WORLD)] = Field(
        "city", description="city, grass, apron, harbour, your own world by name, or its file."
    )
    world_seed: Annotated[int, Field(ge=0), Flag(group=WORLD)] = Field(0, description="Seed of the world.")
    scale: Annotated[float, Field(gt=0), Flag("--world-scale", group=WORLD)] = Field(
        1.0, description="Metres in a unit of your mesh."
    )
    time: Annotated[Time, Flag(metavar="NAME", group=WORLD)] = Field(
        "noon", description="Time of day: noon, afternoon, golden, dusk, overcast."
    )
    places: Annotated[int, Field(ge=1, le=1000), Flag(group=WORLD)] = Field(
        5, description="Places where the object stands, drawn by the seed, free of walls."
    )
    kinds: Annotated[tuple[Kind, ...], Flag("--on", metavar="KIND", group=WORLD, typed=tuple[str, ...])] = Field(
        DRY, min_length=1, description="ground, roof or water: what the object may stand on; may be repeated."
    )
    length_m: Annotated[float | None, Field(ge=0.001, lt=10_000), Flag(group=WORLD)] = Field(
        None, description="Longest side of the object in the world. Default: its spec's world_length_m, else its own."
    )
    grid: Annotated[GridShape, BeforeValidator(read_grid), Flag(metavar="AxBxC", group=VIEW, typed=str)] = Field(
        (10, 10, 10), description="Camera positions along the object, across it, and up."
    )
    extent: Annotated[float, Field(ge=0.8, le=100), Flag(metavar="LENGTHS", group=VIEW)] = Field(
        2.0,
        description="How far the grid reaches from the object's middle along and across, and above its ground, in "
        "object lengths.",
    )
    fov_deg: Annotated[float, Field(ge=5, le=120), Flag(group=VIEW)] = Field(
        50.0, description="Field of view of the camera; its picture is as large as the network's crop."
    )
    sample: Annotated[int | None, Field(ge=1), Flag(metavar="N", group=VIEW)] = Field(
        None, description="Cameras at each place, drawn by the seed from those of the grid. Default: all."
    )
    renderer: Annotated[
        str, AfterValidator(check_renderer), Later(), Flag(metavar="|".join((*IN_WORLDS, "airsim://HOST")), group=VIEW)
    ] = Field(RAYCAST, description="Renderer of the pictures, or AirSim, Colosseum or Cosys-AirSim.")
    seed: Annotated[int, Field(ge=0), Flag()] = Field(0, description="Same seed, same bytes on the same machine.")
    batch_size: Annotated[int | None, Field(ge=1), Flag("--batch")] = Field(
        None,
        exclude=True,
        description="Images read before the network is asked. Default: 128 on a GPU, 4 per thread on a CPU.",
    )
    keep: Annotated[bool, Flag("--keep")] = Field(
        False, exclude=True, description="Keep every picture with its depth, segmentation and truth."
    )
    run: Annotated[RunName | None, Flag(metavar="NAME")] = Field(
        None, exclude=True, description="Name of the folder under eval/. Default: world, object and network."
    )

    @property
    def is_simulated(self) -> bool:
        """Whether a simulator makes the pictures."""
        return self.renderer not in RENDERERS
