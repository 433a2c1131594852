"""What can be varied: light, backdrop, distance, resolution, size of the patch, seed."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from toolkit.captures.shoot import ShootSettings
from toolkit.errors import ToolkitError, one_of
from toolkit.patches import printed_size_mm
from toolkit.rig.change_plan import scale_distance, scale_resolution
from toolkit.rig.plan import CapturePlan
from toolkit.rig.studio import BACKDROPS, LIGHTS

Value = str | int | float
PAPER_MM = round(printed_size_mm(100), 3)
"""Side of the paper's patch on paper: 100 px at 250 %."""


@dataclass(frozen=True)
class Setup:
    """Everything that decides how the images of one value are shot.

    Attributes:
        plan: camera and poses.
        settings: light, backdrop, seed.
        patch_mm: printed side of every patch; None: as the object's spec or the patch's record says.
    """

    plan: CapturePlan
    settings: ShootSettings
    patch_mm: float | None = None


@dataclass(frozen=True)
class Axis:
    """One thing to vary.

    Attributes:
        name: as the user calls it.
        title: what the figure writes below it, with its unit.
        unit: of the values, empty for names.
        defaults: values that are tried unless others are asked for.
        parse: a value from what the user typed; raises `ToolkitError`.
        change: the setup with another value.
        is_ordered: whether values lie on a scale, so that a line through them means something.
        is_log: whether that scale is drawn logarithmically.
    """

    name: str
    title: str
    unit: str
    defaults: tuple[Value, ...]
    parse: Callable[[str], Value]
    change: Callable[[Setup, Value], Setup]
    is_ordered: bool = False
    is_log: bool = False

    def label(self, value: Value) -> str:
        """A value as a folder is called after it: `dim`, `1.5x`, `160px`, `44mm`, `seed3`."""
        if self.name == "seed":
            return f"seed{value}"
        return value if isinstance(value, str) else f"{value:.10g}{self.unit}"


def find_axis(name: str) -> Axis:
    """The axis of that name; an unknown one is a `ToolkitError`."""
    if name not in AXES:
        raise one_of("axis", name, list(AXES))
    return AXES[name]


def parse_values(axis: Axis, typed: Sequence[str] | None) -> list[Value]:
    """The values asked for, each once, in order (numbers ascending); the axis' own where none are named.

    Each text may hold several, separated by commas.

    Raises:
        ToolkitError: a value that the axis cannot have.
    """
    texts = [text.strip() for each in typed or () for text in each.split(",")]
    values = dict.fromkeys(axis.parse(text) for text in texts) if texts else dict.fromkeys(axis.defaults)
    return sorted(values) if axis.is_ordered else list(values)  # type: ignore[type-var]


def _one_name(kind: str, known: Sequence[str]) -> Callable[[str], Value]:
    def parse(text: str) -> Value:
        if text not in known:
            raise one_of(kind, text, list(known))
        return text

    return parse


def _number(what: str, example: str, whole: bool, low: float, high: float) -> Callable[[str], Value]:
    kind = "a whole number" if whole else "a number"

    def parse(text: str) -> Value:
        try:
            value = int(text) if whole else float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:  # nan is neither
            raise ToolkitError(
                f"--values {text}: expected {what}, {kind} from {low:g} to {high:g}, for example --values {example}"
            )
        return value

    return parse


def _change_light(setup: Setup, value: Value) -> Setup:
    return replace(setup, settings=replace(setup.settings, light=str(value)))


def _change_backdrop(setup: Setup, value: Value) -> Setup:
    return replace(setup, settings=replace(setup.settings, backdrop=str(value)))


def _change_seed(setup: Setup, value: Value) -> Setup:
    return replace(setup, settings=replace(setup.settings, seed=int(value)))


def _change_distance(setup: Setup, value: Value) -> Setup:
    return replace(setup, plan=scale_distance(setup.plan, float(value)))


def _change_resolution(setup: Setup, value: Value) -> Setup:
    return replace(setup, plan=scale_resolution(setup.plan, int(value)))


def _change_size(setup: Setup, value: Value) -> Setup:
    return replace(setup, patch_mm=float(value))


_AXES = (
    Axis("light", "light", "", tuple(LIGHTS), _one_name("light", tuple(LIGHTS)), _change_light),
    Axis("backdrop", "backdrop", "", BACKDROPS, _one_name("backdrop", BACKDROPS), _change_backdrop),
    Axis(
        "distance", "distance, as a multiple of the plan's", "x", (0.9, 1.0, 1.5, 2.0, 3.0),
        _number("a factor of the plan's distance", "1.5", False, 0.1, 20), _change_distance,
        is_ordered=True, is_log=True,
    ),
    Axis(
        "resolution", "width of the picture (px)", "px", (64, 96, 160, 320, 640),
        _number("the picture's width in pixels", "320", True, 16, 16384), _change_resolution,
        is_ordered=True, is_log=True,
    ),
    Axis(
        "size", "printed side of the patch (mm, and its share of the object's longest side)", "mm",
        (22.0, 44.0, 60.0, PAPER_MM),
        _number("the printed side of the patch in mm", "44", False, 1, 10000), _change_size, is_ordered=True,
    ),
    Axis(
        "seed", "seed of backdrop, room and noise", "", (0, 1, 2, 3, 4),
        _number("a seed", "3", True, 0, 2**32 - 1), _change_seed,
    ),
)  # fmt: skip
AXES: dict[str, Axis] = {axis.name: axis for axis in _AXES}
