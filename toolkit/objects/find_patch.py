"""Find an object's patch in a workspace."""

from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject
from toolkit.objects.records import Patch, read_patch, read_usable
from toolkit.objects.spec import ObjectSpec


def find_patch(workspace: Workspace, item: TableObject) -> Patch:
    """Read the patch of an object: that of its name, else a patch trained for its class.

    Raises:
        ToolkitError: there is none, or its files do not match.
    """
    file = find_patch_file(workspace, item.spec)
    if file is not None:
        return read_patch(file)
    chosen = workspace.patch_set
    where = f" --model {chosen} --out {workspace.patches_dir}" if chosen else ""
    raise ToolkitError(
        f"no patch for object '{item.name}' (class '{item.spec.class_name}'){f' in {chosen}' if chosen else ''}: train "
        f"it with 'toolkit train-patch --object {item.name}{where}', or shoot --variant unpatched"
    )


def find_patch_file(workspace: Workspace, spec: ObjectSpec) -> Path | None:
    """Find the PNG of `find_patch`; None if the object has no patch. Broken patches of other names are left out."""
    patches = workspace.patches()
    # by the object's own name first, else by the name of its class
    for name in (spec.name, str(spec.class_name).replace(" ", "_")):
        if name in patches:
            return patches[name]
    # else the first patch by name that was trained for the class
    for name, patch in read_usable(read_patch, patches):
        if spec.class_name in (patch.record.class_name, patch.record.class_index):
            return patches[name]
    return None


def next_patch(workspace: Workspace, own: Patch) -> Patch:
    """Return the next patch by name that was trained for another class.

    Raises:
        ToolkitError: there is none.
    """
    patches = workspace.patches()
    names = sorted(patches)
    # in the order of names, from its own on round to the start
    after = [name for name in names if name > own.record.name] + [name for name in names if name < own.record.name]
    for _, other in read_usable(read_patch, {name: patches[name] for name in after}):
        if other.record.class_index != own.record.class_index:
            return other
    raise ToolkitError("the variant wrong-patch needs a patch of another class: train it, or leave the variant out")
