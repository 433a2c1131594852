"""`rig/objects/NAME.toml`: an object's class and mesh, the places of its patch, and the patch's printed size."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from toolkit.core.config import Config, Expect, FileRecord, Flag
from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_bytes, read_toml, write_text
from toolkit.core.rooms import explain_missing
from toolkit.core.text import FileName, LabelOrIndex, is_file_name
from toolkit.core.workspace import Workspace

BASE_DPI = 72.0
SCALE = 2.5
"""The paper prints at 250 %; it names no resolution, 72 dpi is the PDF's own unit."""
MM_PER_INCH = 25.4


def printed_size_mm(n_px: int, dpi: float = BASE_DPI, scale: float = SCALE) -> float:
    """Side of an n-pixel patch on paper, millimetres."""
    return n_px / dpi * scale * MM_PER_INCH


Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Side = Literal["top", "front", "back", "left", "right"]
Margin = Literal["white", "bleed"]
"""What is on the paper around a patch: nothing, or the patch mirrored at its edges, for clear tape."""
Shift = Annotated[float, Field(ge=-100_000, le=100_000)]
BUILTIN_PREFIX = "builtin:"
MOST_SPEC_BYTES = 1 << 20
MOST_SHEETS = 12
UNKNOWN_MM = 1.0
"""Length of an object without a mesh, which is never used."""


def axes_of_format(mesh: str) -> tuple[Axis, Axis]:
    """Return the default axes up and to the front: y and z for glTF, as specified, else the rig's, z and x."""
    return ("y", "z") if Path(mesh).suffix.lower() in (".glb", ".gltf") else ("z", "x")


class PatchMount(FileRecord, allow_inf_nan=False):
    """Place of the printed sheet.

    Attributes:
        at: side of the object with the patch, in the world's axes (front +x, left +y, top +z).
        size_mm: side of the printed patch; by default the size in its record.
        offset_mm: shift (right, up) of the sheet's centre from the middle of that side, seen from outside. For the top:
            (forward, left).
        rotation_deg: rotation of the sheet, counter-clockwise, seen from outside.
    """

    at: Side = "top"
    size_mm: float | None = Field(None, ge=1, le=10_000)
    offset_mm: tuple[Shift, Shift] = (0.0, 0.0)
    rotation_deg: float = 0.0


class ObjectSpec(FileRecord, populate_by_name=True):
    """An object that can be photographed.

    Attributes:
        name: name of its folder in a capture. In a file it may be left out and is then the file's name.
        class_name: class that a network should predict: an ImageNet name, an index, or your own label.
        mesh: `builtin:NAME`, or a file beside the spec; empty for an object that only photographs show.
        length_mm: longest side; required with a mesh.
        world_length_m: longest side of the real thing, for outdoor worlds.
        up: axis of the mesh that points up; by default as in `axes_of_format`.
        front: axis of the mesh that points to the front; by default as in `axes_of_format`.
        mounts: places of the patch: a sheet for each table `[patch]` or `[[patch]]`.
    """

    name: FileName = ""
    class_name: LabelOrIndex = Field(alias="class")
    mesh: str = ""
    length_mm: float = Field(ge=1, lt=100_000)
    world_length_m: float | None = Field(None, ge=0.001, lt=10_000)
    up: Axis = "z"
    front: Axis = "x"
    mounts: tuple[PatchMount, ...] = Field((PatchMount(),), alias="patch", min_length=1, max_length=MOST_SHEETS)

    @field_validator("mounts", mode="wrap")
    @classmethod
    def _take_one_table(cls, value: Any, validate: ValidatorFunctionWrapHandler) -> tuple[PatchMount, ...]:
        mounts: tuple[PatchMount, ...] = (
            (PatchMount.model_validate(value),) if isinstance(value, dict) else validate(value)
        )
        return mounts

    @model_serializer(mode="wrap")
    def _give_one_table(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields: dict[str, Any] = serialize(self)
        mounts = fields.pop("mounts", None) or fields.pop("patch")  # by name, or by alias
        return fields | {"patch": mounts[0] if len(mounts) == 1 else mounts}

    @model_validator(mode="before")
    @classmethod
    def _stand_as_the_format_says(cls, fields: Any) -> Any:
        if isinstance(fields, dict) and "mesh" not in fields:
            return {"length_mm": UNKNOWN_MM} | fields
        if not isinstance(fields, dict) or not isinstance(fields.get("mesh"), str):
            return fields
        up, front = axes_of_format(fields["mesh"])
        return {"up": up, "front": front} | fields

    @property
    def real_length_m(self) -> float:
        """Longest side of the real thing; a `ToolkitError` without it in the spec."""
        if self.world_length_m is None:
            raise ToolkitError(
                f"object '{self.name}' has no real size, which weather and worlds need: add world_length_m, the length "
                "of the real thing in metres, to its spec"
            )
        return self.world_length_m

    @property
    def metres_per_mm(self) -> float:
        """Scale from the model to the real thing; raises as `real_length_m`."""
        return self.real_length_m / self.length_mm

    def sizes_mm(self, default_mm: float) -> tuple[float, ...]:
        """Side of the patch on each sheet, millimetres; `default_mm` where its mount states none."""
        return tuple(mount.size_mm or default_mm for mount in self.mounts)

    def with_patch_size(self, size_mm: float) -> "ObjectSpec":
        """Return the object with its patch printed at another size on every sheet, mm."""
        return self.with_mounts([mount.model_copy(update={"size_mm": size_mm}) for mount in self.mounts])

    def with_mounts(self, mounts: Sequence[PatchMount]) -> "ObjectSpec":
        """Return the object with its sheets in other places."""
        return self.model_copy(update={"mounts": tuple(mounts)})


AXES = "x, y, z, -x, -y or -z"


class ObjectRequest(Config):
    """Settings of a new object; None follows from the mesh and its format.

    Example:
        >>> tk.ObjectRequest(class_name="crate", length_mm=300.0).length_mm
        300.0
    """

    class_name: Annotated[LabelOrIndex, Flag("--class", metavar="NAME", typed=str)] = Field(
        description="Class to recognise: an ImageNet category, or a label of your classifier."
    )
    name: Annotated[str | None, Flag(metavar="NAME", typed=str)] = Field(
        None, description="Name of the object. Default: the file's."
    )
    length_mm: Annotated[
        Annotated[float, Field(gt=0, lt=100_000)] | None,
        Expect("millimetres over 0 and under 100000"),
        Flag(metavar="X", typed=float),
    ] = Field(None, description="Longest side of the real object. Default: a glTF's own size, else 200.")
    print_side: Annotated[Side | None, Flag(metavar="SIDE", typed=Side)] = Field(
        None,
        description="Side for its patch: top, front, back, left or right. Default: top if the patch fits flat there, "
        "else a side where it does.",
    )
    size_mm: Annotated[
        Annotated[float, Field(ge=1, lt=100_000)] | None,
        Expect("millimetres from 1 to under 100000"),
        Flag(metavar="MM", typed=float),
    ] = Field(
        None,
        description="Side of its printed patch. Default: 88, or a third of a small object; smaller if it does not fit "
        "flat.",
    )
    up: Annotated[Axis | None, Flag(metavar="AXIS", typed=Axis)] = Field(
        None, description=f"The mesh's axis that points up: {AXES}. Default: by format."
    )
    front: Annotated[Axis | None, Flag(metavar="AXIS", typed=Axis)] = Field(
        None, description="The mesh's axis that points to the front. Default: by format."
    )
    replace: Annotated[bool, Flag("--replace")] = Field(False, description="Replace the object of that name.")


def read_spec(path: Path) -> ObjectSpec:
    """Read an object spec, named as its file.

    Raises:
        ToolkitError: a field is wrong, or the name in the file or of the file cannot be used.
    """
    spec, name = read_toml(path, ObjectSpec), Path(path).stem
    if spec.name not in ("", name):
        raise ToolkitError(
            f"{path}: field 'name': expected '{name}' as the file's, found '{spec.name}': leave the field out, or "
            "rename the file"
        )
    if not is_file_name(name):
        raise ToolkitError(f"{path}: expected a file name of letters, digits, - and _, found '{name}': rename the file")
    return spec.model_copy(update={"name": name})


def names_with_mesh(workspace: Workspace) -> list[str]:
    """Return the names of all objects that can be rendered, sorted; a notice names the others.

    Raises:
        ToolkitError: a spec is broken, or no object can be rendered.
    """
    meshes = {name: read_spec(file).mesh for name, file in sorted(workspace.object_specs().items())}
    from toolkit.core.console import notice  # brings rich, which help does without

    # objects of photographs have no mesh; a room that is not installed takes its objects with it
    if bare := [name for name, mesh in meshes.items() if not mesh]:
        notice(f"note: left out, known from photographs alone: {', '.join(bare)} (no mesh in the spec)")
    if lost := [name for name, mesh in meshes.items() if is_lost(mesh)]:
        notice(f"note: left out, modelled by a room that is not installed: {', '.join(lost)}")
    names = [name for name, mesh in meshes.items() if mesh and name not in lost]
    if not names:
        raise ToolkitError("no object can be rendered: add your own with 'toolkit add MESH --class NAME'")
    return names


def is_lost(mesh: str) -> bool:
    """Whether a spec's mesh is modelled by a room that is not installed."""
    return mesh.startswith(BUILTIN_PREFIX) and explain_missing(mesh) is not None


def write_mounts(spec_file: Path, written: Path, mounts: Sequence[PatchMount]) -> Path:
    """Write a spec with other places for its sheets to the file `written`; all else stays, comments too.

    Raises:
        ToolkitError: the spec is broken, or the disk is full or read-only.
    """
    read_spec(spec_file)
    # tables of patches are left out, and written anew at the end
    lines, is_patch = [], False
    for line in read_bytes(spec_file, MOST_SPEC_BYTES).decode().splitlines():
        if line.strip().startswith("["):
            is_patch = line.strip().split("#")[0].strip() in ("[patch]", "[[patch]]")
        lines += [] if is_patch else [line]
    for mount in mounts:
        lines += [
            "", "[patch]" if len(mounts) == 1 else "[[patch]]", f'at = "{mount.at}"',
            *([] if mount.size_mm is None else [f"size_mm = {mount.size_mm:g}"]),
            f"offset_mm = [{mount.offset_mm[0]:g}, {mount.offset_mm[1]:g}]",
            *([f"rotation_deg = {mount.rotation_deg:g}"] if mount.rotation_deg else []),
        ]  # fmt: skip
    return write_text(written, "\n".join(lines).replace("\n\n\n", "\n\n") + "\n")
