"""`rig/objects/NAME.toml`: what an object is and where its patch goes."""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_toml

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class PatchMount(BaseModel):
    """Where the printed sheet is taped.

    Attributes:
        at: the side of the object that it is taped to, in the world's axes (front +x, left +y, top +z).
        size_mm: side of the printed patch; by default the size that its record states.
        offset_mm: (right, up) shift of the sheet's centre from the middle of that side, as one sees it there; for the
            top, (forward, left).
        rotation_deg: turn of the sheet, counter-clockwise as one sees it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    at: Literal["top", "front", "back", "left", "right"] = "top"
    size_mm: float | None = Field(None, gt=0)
    offset_mm: tuple[float, float] = (0.0, 0.0)
    rotation_deg: float = 0.0


class ObjectSpec(BaseModel):
    """An object that can be photographed.

    Attributes:
        name: the name of its folder in a capture.
        class_name: the category it should be recognised as: an ImageNet name, an index, or a label of one's own.
        mesh: `builtin:NAME`, or a file beside the spec.
        length_mm: longest side.
        up: the mesh's axis that points up.
        front: the mesh's axis that points to the front.
        patch: where the patch is stuck.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    class_name: str | int = Field(alias="class")
    mesh: str
    length_mm: float = Field(gt=0, lt=100_000)
    up: Axis = "z"
    front: Axis = "x"
    patch: PatchMount = PatchMount()

    def with_patch_size(self, size_mm: float) -> "ObjectSpec":
        """The same object with a patch printed at another size, millimetres."""
        return self.model_copy(update={"patch": self.patch.model_copy(update={"size_mm": size_mm})})


def read_spec(path: Path) -> ObjectSpec:
    """Read one object spec; a wrong field, or a name that is not the file's, is a `ToolkitError` that says so."""
    spec = read_toml(path, ObjectSpec)
    if spec.name != Path(path).stem:
        raise ToolkitError(f"{path}: field 'name': expected '{Path(path).stem}' as the file's, found '{spec.name}'")
    return spec
