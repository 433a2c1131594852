"""A printed patch on an object: a sheet of paper, or several."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import linear_to_srgb
from toolkit.objects.atlas import look_up_paint, nearest_covered
from toolkit.objects.find_patch import find_patch, find_patch_file, next_patch
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh, find_hits, make_ray_scene
from toolkit.objects.records import TAPE_MARGIN_MM, PatchRecord, encode_png, read_patch
from toolkit.rig.applied.base import (
    AppliedBooster,
    BoosterKind,
    StoredBooster,
    StoredTraining,
    draw_control,
    read_trainings,
)
from toolkit.rig.mount import MountedSheet, attach, make_flat_sheet, mount_sheets, wear_sheets

RAYS = 4
"""Rays along each side of a texel."""
ABOVE_MM = 0.6
"""Height above the sheet at which they start: above what pierces it."""


class PatchBooster(AppliedBooster):
    """A patch on the object's sheets of paper, or alone on the table."""

    def apply(self, item: TableObject) -> Mesh:
        """Return the object with its sheets on it, or a sheet without the object."""
        if self.alone:
            return make_flat_sheet(self.pixels, self.sizes_mm[0], self.margin)
        return wear_sheets(item.mesh, self.sheets(item))[0]

    def sheets(self, item: TableObject) -> list[MountedSheet]:
        """Return each sheet where the object's spec places it; raises as `mount_sheets`."""
        return mount_sheets(item.mesh, self.pixels, item.spec.mounts, self.sizes_mm, item.name, self.margin)

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
        # white margins are not stated: pictures from before there were others keep their hash
        margin = {} if self.margin == "white" else {"margin": self.margin}
        if len(mounts) == 1 or self.alone:
            return {"mm": self.sizes_mm[0], "mount": mounts[0], **margin}
        return {"mm": [*self.sizes_mm], "mount": mounts, **margin}


@dataclass(frozen=True)
class Camouflage(PatchBooster):
    """Sheets that show what they hide: what is left of their effect is that of the sheets themselves."""

    prints: tuple[np.ndarray, ...] = ()  # (n, n, 3) uint8 sRGB of each sheet

    def apply(self, item: TableObject) -> Mesh:
        """Return the object with its sheets on it, each of a print of its own."""
        return attach(item.mesh, *self.sheets(item))

    def printed(self, change: Callable[[np.ndarray], np.ndarray]) -> AppliedBooster:
        """Return it in the colours of a printer: the print of each sheet."""
        return PatchBooster.printed(replace(self, prints=tuple(map(change, self.prints))), change)

    def sheets(self, item: TableObject) -> list[MountedSheet]:
        """Return each sheet where the object's spec places it; raises as `mount_sheets`."""
        sheets = zip(super().sheets(item), self.prints, strict=True)
        return [sheet.show(pixels, self.margin) for sheet, pixels in sheets]


def draw_hidden(mesh: Mesh, sheet: MountedSheet, n: int) -> np.ndarray:
    """(n, n, 3) uint8 sRGB: what a sheet hides of an object, seen along the sheet's normal.

    A texel is the mean of the paint's linear light over 16 rays; without a hit it has the colour of the nearest texel
    that has one.
    """
    # shares of the sheet's sides at the rays, row by row from the upper left
    step = (np.arange(n * RAYS) + 0.5) / (n * RAYS)
    side_mm = sheet.size_mm + 2 * TAPE_MARGIN_MM
    x, y = np.meshgrid(*[(TAPE_MARGIN_MM + share * sheet.size_mm) / side_mm for share in (step, 1 - step)])
    points, normals = sheet.points(x.reshape(-1), y.reshape(-1))
    rays = np.concatenate([points + ABOVE_MM * normals, -normals], axis=1)
    distance, face, weights = find_hits(make_ray_scene(mesh), rays)
    met = np.isfinite(distance)
    light = np.zeros((len(rays), 3))
    light[met] = look_up_paint(mesh, face[met], weights[met])
    # the mean of each texel's rays
    texels = (n, RAYS, n, RAYS)
    hits = met.reshape(texels).sum(axis=(1, 3))
    mean = light.reshape(*texels, 3).sum(axis=(1, 3)) / np.maximum(hits, 1)[..., None]
    nearest = nearest_covered(hits > 0)
    return np.round(linear_to_srgb(mean.reshape(-1, 3)[nearest]) * 255).astype(np.uint8)


def find_patch_booster(
    workspace: Workspace, item: TableObject, variant: str, perfect: bool = False, seed: int = 0
) -> PatchBooster:
    """Return an object's patch, or a control of it.

    - `patched`: its own patch, on each of its sheets; `patch-alone`: the first, flat on the table without the object.
    - `wrong-patch`: the next patch by name that was trained for another class.
    - `random-patch`, `grey-patch`: noise and middle grey, with as many texels as its own.
    - `camouflage`: what each sheet hides of the object, with as many texels.

    Raises:
        ToolkitError: the patch is missing or broken.
    """
    # sizes are those of the object's own patch, so that every control covers what the patch covers
    own = find_patch(workspace, item)
    sizes_mm = item.spec.sizes_mm(own.size_mm)
    # noise or grey has no class: as many texels, the same margin and the same places
    if variant in ("random-patch", "grey-patch"):
        pixels = draw_control(variant, item, own.record.n_px)
        return PatchBooster(pixels, sha256_bytes(encode_png(pixels)), variant, sizes_mm, margin=own.record.margin)
    if variant == "camouflage":
        # what the sheets hide is drawn with the sheets in place, but without their picture
        bare = PatchBooster(own.pixels, "", variant, sizes_mm, margin=own.record.margin)
        hidden = tuple(draw_hidden(item.mesh, sheet, own.record.n_px) for sheet in bare.sheets(item))
        sha256 = sha256_bytes(b"".join(map(encode_png, hidden)))
        return Camouflage(hidden[0], sha256, variant, sizes_mm, margin=own.record.margin, prints=hidden)
    shown = next_patch(workspace, own) if variant == "wrong-patch" else own
    alone = variant == "patch-alone"
    # a patch alone lies on the table, and a single sheet of it is enough
    return PatchBooster(
        shown.pixels, shown.record.png_sha256, shown.record.name, sizes_mm[:1] if alone else sizes_mm, alone,
        margin=shown.record.margin,
    )  # fmt: skip


def list_patch_files(workspace: Workspace, item: TableObject) -> list[Path]:
    """Return record and picture of an object's patch."""
    png = find_patch_file(workspace, item.spec)
    return [] if png is None else [png.with_suffix(".json"), png]


def read_stored_patch(png: Path) -> StoredBooster:
    """Read a patch, which fits any object; raises as `read_patch`."""
    made = read_patch(png)
    record, files = made.record, (png.with_suffix(".json"), png)
    return StoredBooster(
        made.pixels, record.png_sha256, record.class_name, record.class_index, record.networks, files,
        check=lambda item: None, size_mm=made.size_mm,
    )  # fmt: skip


def list_patch_trainings(workspace: Workspace) -> Iterator[StoredTraining]:
    """Yield the training of every patch, those of patch sets too."""
    for patch_set in (None, *workspace.patch_sets()):
        yield from read_trainings(workspace.with_patches(patch_set).patches().values(), PatchRecord)


PATCH = BoosterKind(
    "patched", "patch", find_patch_booster, ("wrong-patch", "random-patch", "grey-patch", "camouflage", "patch-alone"),
    is_on_paper=True, files=list_patch_files, read=read_stored_patch, list_trainings=list_patch_trainings,
    folder="print/patches", print_options="--object {object}",
)  # fmt: skip
