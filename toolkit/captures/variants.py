"""What is stuck on an object in each variant: nothing, its patch, or a control that says what the patch did."""

from dataclasses import dataclass

import numpy as np

from toolkit.errors import ToolkitError, one_of
from toolkit.files import sha256_bytes
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.patches import Patch, encode_png, read_patch
from toolkit.rig.mount import attach, lay_flat, mount_patch
from toolkit.workspace import Workspace

PAIR = ("unpatched", "patched")
CONTROLS = ("wrong-patch", "random-patch", "grey-patch", "patch-alone")
VARIANTS = PAIR + CONTROLS
GREY = 128


@dataclass(frozen=True)
class Booster:
    """A square of pixels to print and stick on.

    Attributes:
        pixels: (n, n, 3) uint8 sRGB.
        size_mm: side on paper.
        sha256: of its PNG.
        name: of the patch, or of the control.
        alone: lies flat on the table, and the object is not there.
    """

    pixels: np.ndarray
    size_mm: float
    sha256: str
    name: str
    alone: bool = False


def find_booster(workspace: Workspace, item: TableObject, variant: str) -> Booster | None:
    """What is stuck on `item` in a variant; None for `unpatched`.

    - `patched`: its own patch; `patch-alone`: the same, flat on the table without the object.
    - `wrong-patch`: the next patch by name that was trained for another class.
    - `random-patch`: noise with the colours of no patch, drawn for the object's name alone; `grey-patch`: middle grey.

    Raises:
        ToolkitError: an unknown variant, or the patch that it needs is missing or broken.
    """
    if variant not in VARIANTS:
        raise one_of("variant", variant, list(VARIANTS))
    if variant == "unpatched":
        return None
    own = find_patch(workspace, item)
    size_mm = item.spec.patch.size_mm or own.size_mm
    n = own.record.n_px
    if variant in ("patched", "patch-alone"):
        return Booster(own.pixels, size_mm, own.record.png_sha256, own.record.name, variant == "patch-alone")
    if variant == "wrong-patch":
        wrong = _next_patch(workspace, own)
        return Booster(wrong.pixels, size_mm, wrong.record.png_sha256, wrong.record.name)
    pixels = np.full((n, n, 3), GREY, np.uint8)
    if variant == "random-patch":
        pixels = np.random.default_rng(list(item.name.encode())).integers(0, 256, (n, n, 3), dtype=np.uint8)
    return Booster(pixels, size_mm, sha256_bytes(encode_png(pixels)), variant)


def dress(item: TableObject, booster: Booster | None) -> Mesh:
    """The mesh to photograph: the object, the object with a sheet on it, or the sheet alone."""
    if booster is None:
        return item.mesh
    if booster.alone:
        return lay_flat(booster.pixels, booster.size_mm)
    sheet = mount_patch(item.mesh, booster.pixels, booster.size_mm, item.spec.patch, item.name)
    return attach(item.mesh, sheet)


def find_patch(workspace: Workspace, item: TableObject) -> Patch:
    """The patch of an object: the one that bears its name, else one trained for its class.

    Raises:
        ToolkitError: there is none, or its files do not match.
    """
    patches = workspace.patches()
    for name in (item.name, str(item.spec.class_name).replace(" ", "_")):
        if name in patches:
            return read_patch(patches[name])
    for file in patches.values():
        patch = read_patch(file)
        if item.spec.class_name in (patch.record.class_name, patch.record.class_index):
            return patch
    chosen = workspace.patch_set
    where = f" --model {chosen} --out {workspace.patches_dir}" if chosen else ""
    raise ToolkitError(
        f"no patch for object '{item.name}' (class '{item.spec.class_name}'){f' in {chosen}' if chosen else ''}: train "
        f"one with 'toolkit train-patch --class \"{item.spec.class_name}\" --data rig:{item.name}{where}', or shoot "
        "--variant unpatched"
    )


def _next_patch(workspace: Workspace, own: Patch) -> Patch:
    patches = workspace.patches()
    names = sorted(patches)
    after = [name for name in names if name > own.record.name] + [name for name in names if name < own.record.name]
    for name in after:
        other = read_patch(patches[name])
        if other.record.class_index != own.record.class_index:
            return other
    raise ToolkitError("the variant wrong-patch needs a patch of another class: train one, or leave the variant out")
