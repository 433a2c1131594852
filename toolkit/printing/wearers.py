"""Which objects a patch is stuck on, and how large it is there: what a page is printed by."""

import re
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.records import read_patch
from toolkit.objects.spec import ObjectSpec, Side, read_spec
from toolkit.rig.variants import find_patch_file

SAME_MM = 0.05
STATED = re.compile(rb"size_mm=([0-9.]+), n_px=\d+, patch_sha256=([0-9a-f]{64})")
"""In a PDF's keywords, see `toolkit.printing.document.build_pdf`."""


@dataclass(frozen=True)
class Wearer:
    """An object that a patch is stuck on.

    Attributes:
        object: its name.
        at: the side that the sheet is taped to.
        size_mm: side of the patch there: `[patch] size_mm` of its spec, else the patch's record.
    """

    object: str
    at: Side
    size_mm: float


def find_wearers(workspace: Workspace, png_file: Path) -> tuple[list[Wearer], list[str]]:
    """Objects that wear a patch, and why specs could not be read; the one of the patch's name first, then one's own."""
    specs, broken = workspace.object_specs(), []
    wearers: list[Wearer] = []
    for name in sorted(specs, key=lambda name: (name != png_file.stem, specs[name].parent != workspace.objects_dir)):
        try:
            spec = read_spec(specs[name])
            found = png_file if name == png_file.stem else find_patch_file(workspace, spec)
            if found is not None and found.resolve() == png_file.resolve():
                wearers.append(as_wearer(spec, png_file))
        except ToolkitError as error:
            broken.append(f"not compared with the rig: {error}")
    return wearers, broken


def as_wearer(spec: ObjectSpec, png_file: Path) -> Wearer:
    """An object with a patch; raises as `read_patch`."""
    return Wearer(spec.name, spec.patch.at, spec.patch.size_mm or read_patch(png_file).size_mm)


def read_page(pdf_file: Path) -> tuple[float, str] | None:
    """Side in mm and hash of the patch on a page of `toolkit print`, as the PDF states them; None where it does not."""
    try:
        found = STATED.search(pdf_file.read_bytes())
    except OSError:
        return None
    return (float(found[1]), found[2].decode()) if found else None


def choose_wearer(workspace: Workspace, png_file: Path) -> Wearer | None:
    """The object that a patch is printed for where none is named; None where none wears it.

    The object of its name, else the user's own before the built-in ones, if they agree on the size.

    Raises:
        FieldError: several objects wear it in different sizes.
    """
    wearers, _ = find_wearers(workspace, png_file)
    specs = workspace.object_specs()
    own = [one for one in wearers if specs[one.object].parent == workspace.objects_dir]
    candidates = [one for one in wearers if one.object == png_file.stem and (one in own or not own)] or own or wearers
    if not candidates:
        return None
    first = candidates[0]
    if any(abs(one.size_mm - first.size_mm) > SAME_MM for one in candidates):
        sizes = ", ".join(f"{one.object} {one.size_mm:.1f} mm" for one in candidates)
        raise FieldError(
            f"the patch '{png_file.stem}' is worn in different sizes ({sizes}): name the object {{objects}}, or give "
            "{size_mm}",
            {},
        )
    return first
