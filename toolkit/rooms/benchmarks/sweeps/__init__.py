"""Sweeps vary a quantity and keep the rest, to see where a patch still works.

Here are their settings, for the command line and for Python; nothing heavy is loaded for them.
"""

from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field, model_validator

from toolkit.core.config import Config, Flag, Later
from toolkit.core.errors import FieldError
from toolkit.evaluation import RunName
from toolkit.rig import PAIR
from toolkit.rig.renderers import RAYCAST, RENDERERS, check_renderer

if TYPE_CHECKING:
    from toolkit.rooms.benchmarks.sweeps.axes import Axis, Value


class SweepConfig(Config):
    """A sweep; see `run_sweep`."""

    axis: Annotated[str, Flag(metavar="AXIS", positional=True)] = Field(
        description="light, backdrop, distance, resolution, size, coverage, seed, fog or blur."
    )
    values: Annotated[tuple[str | int | float, ...], Flag(metavar="VALUES", typed=tuple[str, ...])] = Field(
        (),
        description="Values to try; repeat, or separate by commas. light, backdrop: names. distance: factors of the "
        "plan's. resolution: widths in px. size: mm of the printed patch. coverage: per cent of the visible surface "
        "under the best pieces of a wrap. fog, blur: severities 0 to 5 of ImageNet-C. seed: whole numbers.",
    )
    cross: Annotated[tuple[str, ...], Flag("--cross", metavar="AXIS=VALUES")] = Field(
        (), description="Run the sweep at each of these values of another axis, and write a table; repeat for more."
    )
    objects: Annotated[tuple[str, ...], Flag("--object", metavar="NAME")] = Field(
        (), description="Object to shoot; repeat for more. Default: all in the plan."
    )
    variants: Annotated[tuple[str, ...], Flag("--variant", metavar="NAME")] = Field(
        PAIR,
        description="As in capture-sim, or tag:FAMILY:NUMBER such as tag:36h11:0 for a tag in the patch's place, which "
        "OpenCV reads; repeat for more.",
    )
    run: Annotated[RunName | None, Flag(metavar="NAME")] = Field(
        None, description="Name in the results' file names; default: the network's, and that of the set of patches."
    )
    trained: Annotated[bool, Flag("--trained")] = Field(
        False,
        description="For the axis size: use the set of patches trained for each size, such as print/patches/60mm "
        "('train-patch --size-mm 60 --out print/patches/60mm').",
    )
    renderer: Annotated[str, AfterValidator(check_renderer), Later(), Flag(metavar="|".join(RENDERERS))] = Field(
        RAYCAST, description="Renderer of the images."
    )
    seed: Annotated[int, Field(ge=0), Flag()] = Field(0, description="Same seed, same bytes on the same machine.")

    @model_validator(mode="after")
    def _check_values(self) -> "SweepConfig":
        # parsed here, so that an impossible value is refused before anything is shot
        axis, _ = self.parse()
        names = [axis.name, *(other.name for other, _ in self.parse_cross())]
        if len(set(names)) < len(names):
            raise FieldError("expected each axis once, with the swept axis", {"cross": self.cross})
        self.shown()
        if self.trained and axis.name != "size":
            raise FieldError("expected the axis size: patches are trained for a printed size", {"axis": axis.name})
        return self

    def shown(self) -> tuple[str, ...]:
        """Each variant once; if the wrap is varied, it takes the patch's place by default."""
        varied = ("unpatched", "wrapped") if self.axis == "coverage" and self.variants == PAIR else self.variants
        from toolkit.rig.applied.tag import name_variant  # brings the renderer's parts

        return tuple(dict.fromkeys(map(name_variant, varied)))

    def parse(self) -> "tuple[Axis, list[Value]]":
        """Return the axis and its values in order; unknown axes and impossible values are a `ToolkitError`."""
        from toolkit.rooms.benchmarks.sweeps.axes import find_axis, parse_values

        axis = find_axis(self.axis)
        return axis, parse_values(axis, self.values)

    def parse_cross(self) -> "list[tuple[Axis, list[Value]]]":
        """The other axes with their values, as `parse`."""
        from toolkit.rooms.benchmarks.sweeps.axes import find_axis, parse_values

        found = []
        for text in self.cross:
            name, equals, values = text.partition("=")
            if not equals or not values:
                raise FieldError("expected AXIS=VALUES, such as fog=0,3", {"cross": text})
            axis = find_axis(name.strip())
            found.append((axis, parse_values(axis, [values])))
        return found
