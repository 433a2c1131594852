"""The units of work of a sweep: one object at one value of the axis, or why it cannot be shot there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from toolkit.captures.variants import Print, dress, find_booster
from toolkit.errors import ToolkitError
from toolkit.objects.load import TableObject, load_object
from toolkit.rig.plan import check_poses
from toolkit.sweeps.axes import Axis, Setup, Value
from toolkit.workspace import Workspace


@dataclass(frozen=True)
class Unit:
    """One object at one value.

    Attributes:
        value, label: of the axis; the label is the name of its source's folder.
        object: which one.
        setup: how it is shot.
        patch_mm: printed side of its patch, None where no variant has one.
        longest_mm: the object's longest side.
        refused: why it cannot be shot in every variant; None when it can.
    """

    value: Value
    label: str
    object: str
    setup: Setup
    patch_mm: float | None
    longest_mm: float
    refused: str | None = None


def plan_units(
    workspace: Workspace, axis: Axis, values: Sequence[Value], base: Setup, objects: Sequence[str],
    variants: Sequence[str],
) -> list[Unit]:  # fmt: skip
    """Every unit of a sweep, value by value.

    An object that cannot be shot in one of the variants at a value (a patch too large for it, a camera inside it) is
    refused there as a whole: its rows would have nothing to be compared with.

    Raises:
        ToolkitError: an object, variant or patch is unknown, missing or broken, an object is not in the plan, or a
            value is none that a camera can have.
    """
    items = {name: load_object(workspace.object_spec(name)) for name in dict.fromkeys(objects)}
    for name in items:
        if name not in base.plan.objects:
            raise ToolkitError(f"object '{name}' is not in {workspace.plan_file}: run 'toolkit plan --object {name}'")
    setups = {value: axis.change(base, value) for value in values}
    return [
        _plan_unit(workspace, axis, value, setup, item, variants)
        for value, setup in setups.items()
        for item in items.values()
    ]  # fmt: skip


def _plan_unit(
    workspace: Workspace, axis: Axis, value: Value, setup: Setup, item: TableObject, variants: Sequence[str]
) -> Unit:
    longest_mm = float(item.mesh.size_mm.max())
    boosters = [find_booster(workspace, item, name) for name in variants]
    own_mm = [booster.size_mm for booster in boosters if isinstance(booster, Print)]
    patch_mm = (setup.patch_mm or own_mm[0]) if own_mm else None
    if not own_mm or setup.patch_mm == own_mm[0]:
        setup = replace(setup, patch_mm=None)  # the images of `capture-sim` are these
    sized = item if setup.patch_mm is None else replace(item, spec=item.spec.with_patch_size(setup.patch_mm))
    refused = None
    try:
        check_poses(item, setup.plan.camera.camera(), setup.plan.objects[item.name])
        for name in variants:
            booster = find_booster(workspace, sized, name)
            if isinstance(booster, Print):  # paint fits wherever the object itself can be shot
                dress(sized, booster)
    except ToolkitError as error:
        refused = str(error)
    return Unit(value, axis.label(value), item.name, setup, patch_mm, longest_mm, refused)
