"""Which objects a patch is stuck on, and how large it is there: what a page is printed by."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.records import read_patch
from toolkit.objects.spec import ObjectSpec, Side, read_spec
from toolkit.rig.variants import find_patch_file

SAME_MM = 0.05
STATED = re.compile(rb"size_mm=([0-9.+]+), n_px=\d+, patch_sha256=([0-9a-f]{64})")
"""In a PDF's keywords, see `toolkit.printing.document.build_pdf`."""


@dataclass(frozen=True)
class Wearer:
    """An object that a patch is stuck on.

    Attributes:
        object: its name.
        sides: for each of its sheets, the side that it is taped to.
        sizes_mm: likewise, side of the patch there: `[patch] size_mm` of its spec, else the patch's record.
    """

    object: str
    sides: tuple[Side, ...]
    sizes_mm: tuple[float, ...]

    def name_sheet(self, index: int) -> str:
        """`mug`, or of several sheets `mug, sheet 2 of 2 (left)`, for the paper's margin."""
        count = len(self.sides)
        return self.object if count == 1 else f"{self.object}, sheet {index + 1} of {count} ({self.sides[index]})"


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
    sides = tuple(mount.at for mount in spec.mounts)
    return Wearer(spec.name, sides, spec.sizes_mm(read_patch(png_file).size_mm))


def say_sizes(sizes_mm: Sequence[float]) -> str:
    """`88.2 mm`, `90.0 and 60.0 mm`."""
    return f"{' and '.join(f'{size:.1f}' for size in sizes_mm)} mm"


def is_same_size(sizes_mm: Sequence[float], others_mm: Sequence[float]) -> bool:
    """Whether sheets have the sizes of others, in order."""
    return len(sizes_mm) == len(others_mm) and all(
        abs(one - other) < SAME_MM for one, other in zip(sizes_mm, others_mm, strict=True)
    )


def read_page(pdf_file: Path) -> tuple[tuple[float, ...], str] | None:
    """Sides of the sheets in mm and hash of the patch, as a PDF of `toolkit print` states them; None: it does not."""
    try:
        found = STATED.search(pdf_file.read_bytes())
    except OSError:
        return None
    return (tuple(float(side) for side in found[1].split(b"+")), found[2].decode()) if found else None


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
    if not all(is_same_size(one.sizes_mm, first.sizes_mm) for one in candidates):
        sizes = ", ".join(f"{one.object} {say_sizes(one.sizes_mm)}" for one in candidates)
        raise FieldError(
            f"the patch '{png_file.stem}' is worn in different sizes ({sizes}): name the object {{objects}}, or give "
            "{size_mm}",
            {},
        )
    return first
