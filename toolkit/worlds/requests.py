"""What is asked for of a world: an object that stands in it, and pictures.

Light to import: commands make their options from these.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError

Kind = Literal["ground", "roof", "water"]
DRY: tuple[Kind, ...] = ("ground", "roof")
"""What objects stand on that are no ships."""


class ObjectInWorld(Config):
    """Which object stands in a world, in which variant, where and how large."""

    object_name: Annotated[str | None, Flag("--object", metavar="NAME", typed=str)] = Field(
        None, description="Put this object into the world, at its real size."
    )
    variant: Annotated[str | None, Flag(metavar="NAME", typed=str)] = Field(
        None, description="What is on the object: unpatched, patched, textured, or a control."
    )
    place: Annotated[str | None, Flag(metavar="NAME", typed=str)] = Field(
        None, description="Place where it stands, by its name on the map. Default: drawn by the seed."
    )
    length_m: Annotated[float | None, Flag(metavar="X", typed=float)] = Field(
        None, description="Longest side of the object, metres. Default: as its spec says."
    )

    def check(self) -> None:
        """Raises a `FieldError` where something is said of an object that is not named, or that stands in no world."""
        if self.variant == "patch-alone":
            raise FieldError("lies on a table without its object: choose another in a world", {"variant": self.variant})
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
    resolution: Annotated[tuple[int, int], Flag(metavar="WIDTH HEIGHT")] = Field(
        (960, 540), description="Size of the pictures, pixels."
    )
    film_s: Annotated[float, Flag(metavar="X")] = Field(3.0, description="Length of the film, seconds; 0 makes none.")
