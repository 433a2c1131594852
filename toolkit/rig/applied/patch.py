"""A printed patch on an object: a sheet of paper, or several."""

from pathlib import Path
from typing import Any

from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.find_patch import find_patch, find_patch_file, next_patch
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import encode_png
from toolkit.rig.applied.base import AppliedBooster, BoosterKind, draw_control
from toolkit.rig.mount import MountedSheet, make_flat_sheet, mount_sheets, wear_sheets


class PatchBooster(AppliedBooster):
    """A patch on the object's sheets of paper, or alone on the table."""

    def apply(self, item: TableObject) -> Mesh:
        """Return the object with its sheets on it, or a sheet without the object."""
        if self.alone:
            return make_flat_sheet(self.pixels, self.sizes_mm[0])
        return wear_sheets(item.mesh, self.sheets(item))[0]

    def sheets(self, item: TableObject) -> list[MountedSheet]:
        """Return each sheet where the object's spec places it; raises as `mount_sheets`."""
        return mount_sheets(item.mesh, self.pixels, item.spec.mounts, self.sizes_mm, item.name)

    def describe(self, item: TableObject) -> dict[str, Any]:
        """Return the patch's hash, with the sizes and places of its sheets."""
        return {"patch": self.sha256, **self._describe_sheets(item)}

    def describe_place(self, item: TableObject) -> dict[str, Any]:
        """Return size and place of its sheets; nothing of a sheet without the object."""
        return {} if self.alone else self._describe_sheets(item)

    def note(self) -> dict[str, Any]:
        """Return its name, and its side in mm; of several sheets their sides are a list."""
        return {"booster": self.name, "booster_mm": self.sizes_mm[0] if len(self.sizes_mm) == 1 else [*self.sizes_mm]}

    @property
    def texel_mm(self) -> float:
        """Side of a texel on the first sheet, in mm."""
        return self.sizes_mm[0] / len(self.pixels)

    def _describe_sheets(self, item: TableObject) -> dict[str, Any]:
        mounts = [mount.model_dump() for mount in item.spec.mounts]
        if len(mounts) == 1 or self.alone:
            return {"mm": self.sizes_mm[0], "mount": mounts[0]}
        return {"mm": [*self.sizes_mm], "mount": mounts}


def find_patch_booster(
    workspace: Workspace, item: TableObject, variant: str, perfect: bool = False, seed: int = 0
) -> PatchBooster:
    """Return an object's patch, or a control of it.

    - `patched`: its own patch, on each of its sheets; `patch-alone`: the first, flat on the table without the object.
    - `wrong-patch`: the next patch by name that was trained for another class.
    - `random-patch`, `grey-patch`: noise and middle grey, with as many texels as its own.

    Raises:
        ToolkitError: the patch is missing or broken.
    """
    own = find_patch(workspace, item)
    sizes_mm = item.spec.sizes_mm(own.size_mm)
    if variant in ("random-patch", "grey-patch"):
        pixels = draw_control(variant, item, own.record.n_px)
        return PatchBooster(pixels, sha256_bytes(encode_png(pixels)), variant, sizes_mm)
    shown = next_patch(workspace, own) if variant == "wrong-patch" else own
    alone = variant == "patch-alone"
    return PatchBooster(
        shown.pixels, shown.record.png_sha256, shown.record.name, sizes_mm[:1] if alone else sizes_mm, alone
    )


def list_patch_files(workspace: Workspace, item: TableObject) -> list[Path]:
    """Return record and picture of an object's patch."""
    png = find_patch_file(workspace, item.spec)
    return [] if png is None else [png.with_suffix(".json"), png]


PATCH = BoosterKind(
    "patched", "patch", find_patch_booster, ("wrong-patch", "random-patch", "grey-patch", "patch-alone"),
    is_on_paper=True, files=list_patch_files,
)  # fmt: skip
