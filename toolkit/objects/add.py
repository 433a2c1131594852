"""A mesh of the user's own becomes an object of the workspace: its files copied, its spec written."""

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.core.files import explain_read_error, inside, real_path, write_bytes, write_text
from toolkit.core.text import is_file_name
from toolkit.core.workspace import Workspace
from toolkit.objects.gltf.document import named_files
from toolkit.objects.gltf.materials import unseen_files
from toolkit.objects.load import TableObject, read_mesh, stand_upright, turn_upright
from toolkit.objects.obj_file import list_obj_names
from toolkit.objects.ply_file import list_ply_names
from toolkit.objects.records import printed_size_mm
from toolkit.objects.spec import Axis, ObjectRequest, axes_of_format, read_spec

MM_PER_M = 1000.0
GUESSED_LENGTH_MM = 200.0
USUAL_MM = (20.0, 3000.0)
"""Usual lengths of objects before a camera: for others, a question is printed."""
DEFAULT_PATCH_MM = printed_size_mm(100)
"""Side of the default patch of 100 px."""


@dataclass(frozen=True)
class AddedObject:
    """An object that was added.

    Attributes:
        item: the object on the table.
        spec_file: its spec.
        mesh_files: the mesh and the files that it names, in the workspace.
        length_is_guessed: whether the format states no unit and no length was given.
        file_length: longest side in the file's unit, metres for a glTF.
        unseen: those of `mesh_files` that the object does not show, such as normal maps.
    """

    item: TableObject
    spec_file: Path
    mesh_files: tuple[Path, ...]
    length_is_guessed: bool
    file_length: float
    unseen: tuple[Path, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return all of it for a script."""
        return {
            "name": self.item.name, "class": self.item.spec.class_name, "spec": str(self.spec_file),
            "files": [str(file) for file in self.mesh_files], "scale": self.ask_scale(),
            "size_mm": [round(float(side), 1) for side in self.item.mesh.size_mm],
            "length_is_guessed": self.length_is_guessed,
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        """Describe the object, a sentence a line."""
        item = self.item
        # the mesh stands upright already: length, width and height on the table
        size_mm = " × ".join(f"{side:.0f}" for side in item.mesh.size_mm)
        yield f"added {item.name}, {item.spec.class_name}: {size_mm} mm, {len(item.mesh.faces):,} triangles"
        named = ", ".join(file.name for file in self.mesh_files[1:] if file not in self.unseen)
        yield f"wrote {self.spec_file}; the mesh is {self.mesh_files[0]}{f' with {named}' if named else ''}"
        if self.unseen:
            yield f"copied, but not shown on the object: {', '.join(file.name for file in self.unseen)}"

    def ask_length(self) -> str | None:
        """`ask_scale`, and what to do about it."""
        asked = self.ask_scale()
        return asked and f"{asked}: measure the longest side and set length_mm in {self.spec_file.name}"

    def ask_scale(self) -> str | None:
        """Ask about the length if it is a guess, or unusual in the file; else None."""
        length_mm, raw = self.item.spec.length_mm, self.file_length
        is_gltf = self.mesh_files[0].suffix.lower() in (".glb", ".gltf")
        # a length that the user gave, or a usual length in the file, is not doubted
        if not self.length_is_guessed:
            if not is_gltf or USUAL_MM[0] <= length_mm <= USUAL_MM[1] or abs(length_mm / MM_PER_M / raw - 1) > 1e-6:
                return None
            return f"the glTF says {raw:.4g} m: is the real object {length_mm:.4g} mm long?"
        # units in which the object would have a usual size
        fitting = [
            f"{raw * factor:.4g} mm, if {unit}"
            for unit, factor in (("metres", MM_PER_M), ("centimetres", 10.0), ("millimetres", 1.0))
            if USUAL_MM[0] <= raw * factor <= USUAL_MM[1] and not (is_gltf and unit == "metres")
        ]
        meant = f" ({' or '.join(fitting)}?)" if fitting else ""
        stated = f"{raw:.4g} m long in the file" if is_gltf else f"{raw:.4g} long and states no unit"
        return f"the mesh is {stated}{meant}; {length_mm:.4g} mm are assumed"


def add_object(workspace: Workspace, mesh_file: Path, request: ObjectRequest) -> AddedObject:
    """Copy a mesh with the files it names into `rig/objects/NAME/` and write `rig/objects/NAME.toml`.

    A mesh in `rig/objects` stays where it is. The spec is written last, so that an interruption leaves no object with
    half of its files.

    Raises:
        ToolkitError: the mesh cannot be used, or names files that are missing or not in its folder; the name or a
            length is wrong, or the name is taken; or a folder to write to is a link.

    Example:
        >>> _ = trimesh.creation.box((0.1, 0.2, 0.3)).export("crate.glb")  # metres, y up
        >>> space = tk.make_workspace(Path("space"))
        >>> added = tk.add_object(space, Path("crate.glb"), tk.ObjectRequest(class_name="crate"))
        >>> added.item.name, added.item.mesh.size_mm.round().tolist()
        ('crate', [300.0, 100.0, 200.0])
    """
    mesh_file = Path(mesh_file)
    mesh_file = real_path(mesh_file.parent) / mesh_file.name
    # a name for files: letters, digits and dashes of the mesh's own
    name = request.name or re.sub(r"[^A-Za-z0-9_-]+", "-", mesh_file.stem).strip("-_")
    _check_name(workspace, name, request.replace)
    # named files are checked before anything is written
    named = find_named_files(mesh_file)
    mesh = read_mesh(mesh_file)
    is_gltf = mesh_file.suffix.lower() in (".glb", ".gltf")
    # glTF is in metres; other formats state no unit, and a length is guessed
    stated_mm = float(mesh.size_mm.max()) * MM_PER_M if is_gltf else 0.0
    length_mm = request.length_mm or (stated_mm if 1 <= stated_mm < 100_000 else GUESSED_LENGTH_MM)
    usual_up, usual_front = _usual_axes(mesh_file)
    up, front = request.up or usual_up, request.front or usual_front
    turn_upright(mesh, up, front)  # refuses two names of the same axis before anything is written

    place = Workspace(real_path(workspace.root)).objects_dir
    unseen = unseen_files(mesh_file) if is_gltf else set()
    # pictures that no material uses are copied, and reported as not shown
    files = [mesh_file, *named]
    is_unseen = [file.relative_to(mesh_file.parent).as_posix() in unseen for file in files]
    if not mesh_file.is_relative_to(place):
        target = place / name
        files = [write_bytes(target / file.relative_to(mesh_file.parent), file.read_bytes(), target) for file in files]
    text = _write_spec(request, files[0].relative_to(place).as_posix(), length_mm, (up, front))
    spec_file = write_text(place / f"{name}.toml", f"# {name}: every field may be changed.\n{text}", place)
    guessed = request.length_mm is None and length_mm != stated_mm
    item = stand_upright(read_spec(spec_file), mesh)  # reading a large mesh takes longer than all else here
    not_shown = tuple(file for file, hidden in zip(files, is_unseen, strict=True) if hidden)
    return AddedObject(item, spec_file, tuple(files), guessed, float(mesh.size_mm.max()), not_shown)


def _check_name(workspace: Workspace, name: str, replace: bool) -> None:
    if not is_file_name(name):
        raise ToolkitError(f"name: expected letters, digits, - and _, found '{name}': give the object another name")
    known = workspace.object_specs().get(name)
    if known is None or replace:
        return
    what = f"there is {known}" if known.parent == workspace.objects_dir else "it is built in"
    raise ToolkitError(f"the name '{name}' is taken ({what}): choose another name, or say that it is to be replaced")


def _usual_axes(mesh_file: Path) -> tuple[Axis, Axis]:
    """Return up and front: glTF's by its specification, for other formats as Blender and CAD programs write them."""
    suffix = mesh_file.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return axes_of_format(mesh_file.name)
    return ("y", "z") if suffix == ".obj" else ("z", "-y")


def _write_spec(request: ObjectRequest, mesh: str, length_mm: float, axes: tuple[Axis, Axis]) -> str:
    # a patch wider than a third of a small object finds no flat place
    size_mm = request.size_mm or min(DEFAULT_PATCH_MM, length_mm / 3)
    # a usual size stays a comment, so that the size in the patch's record counts
    size = f"size_mm = {size_mm:.3g}" if size_mm != DEFAULT_PATCH_MM else f"# size_mm = {DEFAULT_PATCH_MM:.0f}"
    fields = [
        ("class", _quote(request.class_name), "an ImageNet category, an index, or a label of your own classifier"),
        ("mesh", _quote(mesh), "beside this file or in a folder below"),
        ("length_mm", f"{length_mm:.6g}", "longest side of the real object, for printing and the camera's distance"),
        ("# world_length_m", f"{length_mm / MM_PER_M:.4g}", "of what it is a model of, for worlds outdoors"),
        ("up", _quote(axes[0]), "the mesh's axis that points up: x, y, z, -x, -y or -z"),
        ("front", _quote(axes[1]), "the mesh's axis that points to the front"),
        ("", "", ""),
        ("[patch]", "", "where the printed patch is taped"),
        ("at", _quote(request.print_side or "top"), "top, front, back, left or right"),
        (*size.rsplit(" = ", 1), "side of the printed patch; without it, the size in the patch's record"),
        ("offset_mm", "[0, 0]", "from the middle of that side: right and up; for the top, forward and left"),
        ("rotation_deg", "0", "turn of the patch, counter-clockwise, seen from outside"),
    ]
    # values in a column, reasons in another
    starts = [f"{key} = {value}" if value else key for key, value, _ in fields]
    width = max(map(len, starts)) + 2
    lines = (f"{start:{width}}# {why}" if why else "" for start, (_, _, why) in zip(starts, fields, strict=True))
    return "".join(f"{line}\n" for line in lines)


def _quote(value: str | int) -> str:
    return json.dumps(value, ensure_ascii=False)  # JSON's strings are TOML's


def find_named_files(mesh_file: Path) -> list[Path]:
    """List the files that a mesh names, in its folder or below: material libraries, textures, buffers.

    Raises:
        ToolkitError: a file is missing, or lies outside the mesh's folder.
    """
    if not mesh_file.is_file():
        return []  # reading reports it
    # a mesh in a single file, such as STL, names no other
    suffix = mesh_file.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return _check_files(mesh_file, named_files(mesh_file))
    if suffix not in (".obj", ".ply"):
        return []
    try:
        files, missing = (list_obj_names if suffix == ".obj" else list_ply_names)(mesh_file)
    except OSError as error:
        raise explain_read_error(mesh_file, error) from None
    except ToolkitError as error:
        raise ToolkitError(f"{mesh_file} names another file: {error}") from None
    _refuse_missing(mesh_file, missing)
    return files


def _refuse_missing(mesh_file: Path, missing: list[str]) -> None:
    if missing:
        named = ", ".join(missing)
        raise ToolkitError(f"{mesh_file} names files that are not there: {named}: put them into {mesh_file.parent}")


def _check_files(mesh_file: Path, names: Iterable[str]) -> list[Path]:
    folder = mesh_file.parent
    files: list[Path] = []
    # names decoded as the format has them, each once
    for name in dict.fromkeys(names):
        try:
            file = inside(folder, name)
        except ToolkitError as error:
            raise ToolkitError(f"{mesh_file} names another file: {error}") from None
        if Path(name).is_absolute():
            raise ToolkitError(f"{mesh_file} names {name}: expected a path in its own folder: edit the mesh's text")
        files.append(file if ".." in name else folder / name)  # a linked file keeps its place
    _refuse_missing(mesh_file, [str(file.relative_to(folder)) for file in files if not file.is_file()])
    return files
