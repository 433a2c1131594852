"""Settings of a world: times of day and weathers by name, an object that stands in it, and pictures.

Light to import: commands make their options from these.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from toolkit.core.config import Config, Flag, Joined, Later
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.corruptions.catalogue import SEVERITIES, parse_severities
from toolkit.rig.renderers import IN_WORLDS, RAYCAST, check_world_renderer

BOUNDS = {"sun_elevation_deg": (-12.0, 90.0), "turbidity": (1.8, 10.0), "cloud_cover": (0.0, 1.0)}
CLEAR = ("clear", 0)
NAMES = ("fog", "dust", "rain", "snow")
"""Names of the weathers that have severities."""


@dataclass(frozen=True)
class TimeOfDay:
    """The sun's place, and the air and clouds before it."""

    sun_elevation_deg: float  # of the sun's middle; below -6 it is nearly night
    sun_azimuth_deg: float = 50.0  # counter-clockwise from +x, seen from above
    turbidity: float = 2.6  # of the air: 2 very clear, 3 clear, 6 hazy
    cloud_cover: float = 0.3  # share of the sky; from 0.85 up the sun is hidden little by little
    lamps_on: bool = False  # whether street lamps are lit

    def __post_init__(self) -> None:
        for name, (low, high) in BOUNDS.items():
            if not low <= getattr(self, name) <= high:
                raise FieldError(f"expected {low:g} to {high:g}", {name: getattr(self, name)})


TIMES: dict[str, TimeOfDay] = {
    "noon": TimeOfDay(60.0, cloud_cover=0.25),
    "afternoon": TimeOfDay(35.0, 120.0, cloud_cover=0.35),
    "golden": TimeOfDay(6.0, 160.0, turbidity=3.0, cloud_cover=0.35),
    "dusk": TimeOfDay(-4.0, 175.0, turbidity=3.0, cloud_cover=0.3, lamps_on=True),
    "overcast": TimeOfDay(40.0, 90.0, cloud_cover=1.0),
}


def check_time(time: str) -> str:
    """Return the name of a time of day; raise a `ToolkitError` for an unknown name."""
    if time not in TIMES:
        raise one_of("time of day", time, list(TIMES))
    return time


def check_times(times: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of times of day; raise a `ToolkitError` for an unknown name."""
    return tuple(check_time(time) for time in times)


def check_weather(name: str, severity: int) -> None:
    """Pass `clear` at 0, and the others at severities 1 (slight) to 5 (severe).

    Raises:
        ToolkitError: there is no weather of that name.
        FieldError: there is no such severity.
    """
    # clear air is severity 0, and has no other
    if name not in ("clear", *NAMES):
        raise one_of("weather", name, ["clear", *NAMES])
    if severity not in ((0,) if name == "clear" else SEVERITIES):
        words = "0, clear air has no other" if name == "clear" else "one of 1 (slight) to 5 (severe)"
        raise FieldError(f"{name}: expected {words}", {"severity": severity})


def parse_weathers(words: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """Names with severities from words such as `fog:3`, `dust:1-3`, `rain` (all five) and `clear`, each once, in order.

    Raises:
        ToolkitError: there is no such weather or severity.
    """
    pairs = []
    for word in words:
        name = word.partition(":")[0]
        if word == "clear":
            pairs.append(CLEAR)
            continue
        if name == "clear":
            raise ToolkitError(f"weather '{word}': clear air has no severity: expected clear")
        if name not in NAMES:
            raise one_of("weather", name, ["clear", *NAMES])
        pairs += [(name, severity) for severity in parse_severities("weather", word)]
    return tuple(dict.fromkeys(pairs))


def name_weather(name: str, severity: int) -> str:
    """The word that `parse_weathers` reads: `clear`, or `fog:3`."""
    return name if name == "clear" else f"{name}:{severity}"


def read_weathers(given: object) -> object:
    """(name, severity) of each from words such as `fog:1-5` and `dust`; pairs, and anything else, as they are.

    Raises:
        ToolkitError: there is no such weather or severity.
    """
    # words come from the command line, pairs from a record that is read again
    each = [given] if isinstance(given, str) else given
    if not (isinstance(each, list | tuple) and all(isinstance(item, str | list | tuple) for item in each)):
        return given
    read = [parse_weathers([item]) if isinstance(item, str) else (item,) for item in each]
    return tuple(dict.fromkeys(tuple(pair) for pairs in read for pair in pairs))


Time = Annotated[str, AfterValidator(check_time)]
Times = Annotated[tuple[str, ...], AfterValidator(check_times)]
Weathers = Annotated[tuple[tuple[str, int], ...], BeforeValidator(read_weathers)]
"""(name, severity) of each."""


Kind = Literal["ground", "roof", "water"]
DRY: tuple[Kind, ...] = ("ground", "roof")
"""Ground for all objects but ships."""


class ObjectInWorld(Config):
    """Which object stands in a world, in which variant, where and how large."""

    object_name: Annotated[str | None, Flag("--object", metavar="NAME", typed=str)] = Field(
        None, description="Put this object into the world, at its real size."
    )
    variant: Annotated[str | None, Flag(metavar="NAME", typed=str)] = Field(
        None, description="Variant of the object: unpatched, patched, wrapped, textured, or a control."
    )
    place: Annotated[str | None, Flag(metavar="NAME", typed=str)] = Field(
        None, description="Place where it stands, by its name on the map. Default: drawn by the seed."
    )
    length_m: Annotated[float | None, Flag(metavar="X", typed=float)] = Field(
        None, description="Longest side of the object, metres. Default: from its spec."
    )

    def check(self) -> None:
        """Raises a `FieldError` where something is said of an object that is not named, or that stands in no world."""
        if self.variant == "patch-alone":
            raise FieldError(
                "shows a patch on a table without its object: choose another in a world", {"variant": self.variant}
            )
        for field in ("variant", "place", "length_m"):
            if self.object_name is None and (value := getattr(self, field)) is not None:
                raise FieldError("needs an object: name it with {object_name}", {field: value})

    @property
    def title(self) -> str:
        """`racer-patched`."""
        return f"{self.object_name}-{self.variant or 'unpatched'}"


class PreviewRequest(Config):
    """Which pictures and which film are made of a world."""

    times: Annotated[tuple[str, ...], Flag("--time", metavar="NAME")] = Field(
        (), description="noon, afternoon, golden, dusk, overcast; repeat for more. Default: afternoon and dusk."
    )
    sky: Annotated[Path | None, Flag(metavar="FILE", typed=Path)] = Field(
        None, description="Your panorama, used before the {times} skies."
    )
    weathers: Annotated[tuple[str, ...], Flag("--weather", metavar="NAME[:SEVERITY]")] = Field(
        ("fog:1",),
        description="Weather of further pictures, under the first sky: fog:1, dust, rain:3-5, snow; repeat for more.",
    )
    resolution: Annotated[tuple[int, int], Joined(" × "), Flag(metavar="WIDTH HEIGHT")] = Field(
        (960, 540), description="Size of the pictures, pixels."
    )
    film_s: Annotated[float, Flag(metavar="X")] = Field(3.0, description="Length of the film, seconds; 0 makes none.")
    renderer: Annotated[str, AfterValidator(check_world_renderer), Later(), Flag(metavar="|".join(IN_WORLDS))] = Field(
        RAYCAST, description="Renderer of the pictures."
    )
