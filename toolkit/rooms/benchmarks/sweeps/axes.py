"""Axes of a sweep and its units of work: an object at a value, or why it cannot be shot there."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import printed_size_mm
from toolkit.rig.plan import CapturePlan, check_poses, scale_distance, scale_resolution
from toolkit.rig.studio import BACKDROPS, LIGHTS, TRAINED_LIGHTS
from toolkit.rig.variants import find_booster

if TYPE_CHECKING:
    from toolkit.captures.shoot import ShootSettings

Value = str | int | float
PAPER_MM = round(printed_size_mm(100), 3)
"""Side of the paper's patch on paper: 100 px at 250 %."""


@dataclass(frozen=True)
class ShootSetup:
    """Settings of the images of a value.

    Attributes:
        patch_mm: printed side of every patch; None: that of the object's spec or the patch's record.
        corruption: name and severity of ImageNet-C for every image when it is read.
    """

    plan: CapturePlan
    settings: "ShootSettings"
    patch_mm: float | None = None
    corruption: tuple[str, int] | None = None


@dataclass(frozen=True)
class Axis:
    """A quantity to vary.

    Attributes:
        title: below the figure, with its unit.
        unit: of the values, empty for names.
        parse: a value from the user's text; raises `ToolkitError`.
        change: the setup with another value.
        is_ordered: whether values lie on a scale, and can be joined by a line.
        is_log: whether that scale is drawn logarithmically.
        prefix: before a number in its label.
    """

    name: str
    title: str
    unit: str
    defaults: tuple[Value, ...]
    parse: Callable[[str], Value]
    change: Callable[[ShootSetup, Value], ShootSetup]
    is_ordered: bool = False
    is_log: bool = False
    prefix: str = ""

    def label(self, value: Value) -> str:
        """Name of a value's folder, such as `dim`, `44mm`, `seed3` or `fog-3`."""
        # ten digits, so that different values have different folders
        return self.prefix + (value if isinstance(value, str) else f"{value:.10g}{self.unit}")


def find_axis(name: str) -> Axis:
    """Return the axis of that name; an unknown name raises `ToolkitError`."""
    if name not in AXES:
        raise one_of("axis", name, list(AXES))
    return AXES[name]


def parse_values(axis: Axis, typed: Sequence[Value] = ()) -> list[Value]:
    """Parse texts of values, which commas may separate; each value once, in order, by default those of the axis.

    Raises:
        ToolkitError: a value that the axis cannot have.
    """
    texts = [text.strip() for each in typed for text in str(each).split(",")]
    values = dict.fromkeys(axis.parse(text) for text in texts) if texts else dict.fromkeys(axis.defaults)
    return sorted(values) if axis.is_ordered else list(values)  # type: ignore[type-var]


def _name(kind: str, known: Sequence[str]) -> Callable[[str], Value]:
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
            expected = f"expected {what}, {kind} from {low:g} to {high:g}, for example {example}"
            raise FieldError(expected, {"values": text})
        return value

    return parse


def _change_setting(name: str) -> Callable[[ShootSetup, Value], ShootSetup]:
    """Return the function that changes a setting of the shoot."""

    def change(setup: ShootSetup, value: Value) -> ShootSetup:
        settings: dict[str, Any] = {name: value}
        return replace(setup, settings=replace(setup.settings, **settings))

    return change


def _make_weather(name: str, corruption: str, title: str) -> Axis:
    """Images are corrupted when they are read; severity 0 leaves them as they are."""

    def change(setup: ShootSetup, value: Value) -> ShootSetup:
        return replace(setup, corruption=(corruption, int(value)) if value else None)

    return Axis(
        name, f"severity of {title}, 0 is none", "", (0, 1, 2, 3, 4, 5),
        parse=_number("a severity of ImageNet-C", "3", True, 0, 5), change=change, is_ordered=True, prefix=f"{name}-",
    )  # fmt: skip


_AXES = (
    Axis("light", "light", "", TRAINED_LIGHTS, parse=_name("light", tuple(LIGHTS)), change=_change_setting("light")),
    Axis("backdrop", "backdrop", "", BACKDROPS, parse=_name("backdrop", BACKDROPS), change=_change_setting("backdrop")),
    Axis(
        "distance", "distance, as a multiple of the plan's", "x", (0.9, 1.0, 1.5, 2.0, 3.0),
        parse=_number("a factor of the plan's distance", "1.5", False, 0.1, 20),
        change=lambda setup, value: replace(setup, plan=scale_distance(setup.plan, float(value))),
        is_ordered=True, is_log=True,
    ),
    Axis(
        "resolution", "width of the picture (px)", "px", (64, 96, 160, 320, 640),
        parse=_number("the picture's width in pixels", "320", True, 16, 16384),
        change=lambda setup, value: replace(setup, plan=scale_resolution(setup.plan, int(value))),
        is_ordered=True, is_log=True,
    ),
    Axis(
        "size", "printed side of the patch (mm, and its share of the object's longest side)", "mm",
        (22.0, 44.0, 60.0, PAPER_MM),
        parse=_number("the printed side of the patch in mm", "44", False, 1, 10000),
        change=lambda setup, value: replace(setup, patch_mm=float(value)),
        is_ordered=True,
    ),
    Axis(
        "coverage", "share (%) of what cameras see that the best pieces cover; below, what was reached if less", "pct",
        (5.0, 10.0, 20.0, 33.0, 50.0, 75.0, 100.0),
        parse=_number("a share of what cameras see, in per cent", "20", False, 0.1, 100),
        change=lambda setup, value: replace(setup, settings=replace(setup.settings, coverage=float(value) / 100)),
        is_ordered=True,
    ),
    Axis(
        "seed", "seed of backdrop, room and noise", "", (0, 1, 2, 3, 4),
        parse=_number("a seed", "3", True, 0, 2**32 - 1),
        change=_change_setting("seed"), prefix="seed",
    ),
    _make_weather("fog", "fog", "fog"),
    _make_weather("blur", "defocus_blur", "defocus blur"),
)  # fmt: skip
AXES: dict[str, Axis] = {axis.name: axis for axis in _AXES}


@dataclass(frozen=True)
class SweepPoint:
    """An object at a value.

    Attributes:
        label: of the value, the name of its source's folder.
        patch_mm: printed side of its patch, None if no variant has a patch.
        longest_mm: the object's longest side.
        refused: why it cannot be shot in every variant, if so.
        patch_set: of its patches; None: the workspace's.
        covered: share of the visible surface under its wrap, None if it is not varied.
    """

    value: Value
    label: str
    object: str
    setup: ShootSetup
    patch_mm: float | None
    longest_mm: float
    refused: str | None = None
    patch_set: str | None = None
    covered: float | None = None


def plan_units(
    workspace: Workspace, axis: Axis, values: Sequence[Value], base: ShootSetup, *, objects: Sequence[str],
    variants: Sequence[str], trained: bool = False,
) -> list[SweepPoint]:  # fmt: skip
    """List every unit of a sweep, value by value.

    An object that cannot be shot in a variant at a value, such as with too large a patch, is refused there in all
    variants, which could not be compared. With `trained`, each value uses the set of patches with its label, or is
    refused.

    Raises:
        ToolkitError: an unknown or broken object, variant or patch, an object that is not in the plan, an impossible
            value, or no variant with the patch whose size is varied.
    """
    # each object at each value
    items = {name: load_object(workspace.object_spec(name)) for name in dict.fromkeys(objects)}
    for name in items:
        if name not in base.plan.objects:
            raise ToolkitError(f"object '{name}' is not in {workspace.plan_file}: run 'toolkit plan --object {name}'")
    # an impossible value fails before anything is planned
    setups = {value: axis.change(base, value) for value in values}
    plan = _plan_trained if trained else _plan_unit
    units = [
        plan(workspace, item, setup, variants, value=value, label=axis.label(value))
        for value, setup in setups.items()
        for item in items.values()
    ]
    # an absent booster cannot be varied: all values would give the same picture
    if axis.name == "coverage" and all(unit.covered is None and unit.refused is None for unit in units):
        raise FieldError("the axis 'coverage' varies the wrap: name the variant 'wrapped'", {"variants": variants})
    if axis.name == "size" and all(unit.patch_mm is None for unit in units):
        raise FieldError("the axis 'size' varies the patch: name the variant 'patched'", {"variants": variants})
    return units


def _plan_trained(
    workspace: Workspace, item: TableObject, setup: ShootSetup, variants: Sequence[str], *, value: Value, label: str
) -> SweepPoint:
    """With the set of patches of that label."""
    try:
        space = workspace.with_patches(label)
        unit = _plan_unit(space, item, setup, variants, value=value, label=label)
    except ToolkitError as error:
        longest_mm = float(item.mesh.size_mm.max())
        return SweepPoint(value, label, item.name, setup, patch_mm=None, longest_mm=longest_mm, refused=str(error))
    return replace(unit, patch_set=space.patch_set)


def _plan_unit(
    workspace: Workspace, item: TableObject, setup: ShootSetup, variants: Sequence[str], *, value: Value, label: str
) -> SweepPoint:
    # the patch's size as it is shot: asked for, or the object's own
    longest_mm = float(item.mesh.size_mm.max())
    boosters = [setup.settings.find_booster(workspace, item, name) for name in variants]
    shown = [booster.covered for booster in boosters if booster is not None and booster.covered is not None]
    own_mm = [size_mm for booster in boosters if booster is not None for size_mm in booster.sizes_mm]
    patch_mm = (setup.patch_mm or own_mm[0]) if own_mm else None
    if not own_mm or all(size_mm == setup.patch_mm for size_mm in own_mm):
        setup = replace(setup, patch_mm=None)  # the images of `capture-sim` are these
    sized = item if setup.patch_mm is None else replace(item, spec=item.spec.with_patch_size(setup.patch_mm))
    # whether cameras and boosters fit the object
    refused = None
    try:
        check_poses(item, setup.plan.camera, setup.plan.objects[item.name])
        for name in variants:
            booster = find_booster(workspace, sized, name)
            if booster is not None and booster.sizes_mm:  # paint fits wherever the object itself can be shot
                booster.apply(sized)
    except ToolkitError as error:
        refused = str(error)
    covered = shown[0] if shown else None
    return SweepPoint(value, label, item.name, setup, patch_mm, longest_mm, refused=refused, covered=covered)
