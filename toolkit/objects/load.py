"""From a spec to a mesh on the table: built-in objects and the user's own files."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from toolkit.core.cache import keep_arrays
from toolkit.core.child import is_memory_full, limit_memory
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import explain_read_error, inside
from toolkit.core.rooms import ask_room, explain_missing, list_offers
from toolkit.objects.gltf.reader import read_gltf
from toolkit.objects.limits import check_faces
from toolkit.objects.mesh import (
    Mesh,
    check_finite,
    check_mesh,
    group_places,
    hash_mesh,
    hash_shape,
    merge_meshes,
    mesh_from_corners,
    pack_mesh,
    place_on_table,
    unpack_mesh,
)
from toolkit.objects.obj_file import read_obj
from toolkit.objects.off_file import read_off
from toolkit.objects.paint import MeshPart, paint_faces
from toolkit.objects.ply_file import read_ply
from toolkit.objects.spec import BUILTIN_PREFIX, ObjectSpec, read_spec
from toolkit.objects.stl_file import read_stl

BUILTIN = ("racer", "warplane", "coffeepot", "eggnog")
"""The objects that come with the kit, each with its spec and boosters."""
GLTF_SUFFIXES = (".glb", ".gltf")
SUFFIXES = (*GLTF_SUFFIXES, ".obj", ".ply", ".stl", ".off")
MOST_BYTES = 7 << 28
"""Memory for reading a mesh with its pictures; with the program itself, under 2 GB."""
EXTENTS = (1e-9, 1e12)
"""Longest side of a mesh in its file's unit, least and greatest."""
OFF_CENTRE = 8
"""Further from the origin than so many times its extent, a mesh is moved there before it is rounded to float32."""


@dataclass(frozen=True)
class TableObject:
    """An object as the rig sees it: on the table, front to +x, in millimetres."""

    spec: ObjectSpec
    mesh: Mesh

    @property
    def name(self) -> str:
        """Name of the object."""
        return self.spec.name

    @cached_property
    def mesh_sha256(self) -> str:
        """`hash_mesh` of its mesh."""
        return hash_mesh(self.mesh)

    @cached_property
    def shape_sha256(self) -> str:
        """`hash_shape` of its mesh."""
        return hash_shape(self.mesh)

    def has_shape(self, sha256: str) -> bool:
        """Whether a record is of this shape, by today's hash or an older record's exact hash."""
        return sha256 == self.shape_sha256 or sha256 == hash_shape(self.mesh, is_exact=True)


def load_object(spec_file: Path) -> TableObject:
    """Read a spec and its mesh, turned upright, scaled to its length and placed on the table.

    Raises:
        ToolkitError: the spec or the mesh cannot be used; the message says why.

    Example:
        >>> item = tk.load_object(tk.make_workspace(Path("space")).object_spec("coffeepot"))
        >>> item.spec.class_name, item.mesh.size_mm.round().tolist()
        ('coffeepot', [144.0, 270.0, 240.0])
    """
    spec = read_spec(spec_file)
    if not spec.mesh:
        raise ToolkitError(
            f"{spec_file}: '{spec.name}' has no mesh, so it cannot be rendered: add 'mesh' and 'length_mm' to the file"
        )
    # a built-in object is made, any other is read from beside its spec
    if spec.mesh.startswith(BUILTIN_PREFIX):
        mesh = build_mesh(spec.mesh.removeprefix(BUILTIN_PREFIX))
    else:
        mesh = read_mesh(inside(Path(spec_file).parent, spec.mesh))
    return stand_upright(spec, mesh)


def stand_upright(spec: ObjectSpec, mesh: Mesh) -> TableObject:
    """Return the object of a spec with its mesh."""
    return TableObject(spec, place_on_table(turn_upright(mesh, spec.up, spec.front), spec.length_mm))


def scale_to_world(mesh: Mesh, spec: ObjectSpec, length_m: float | None = None) -> Mesh:
    """Scale an object's mesh from millimetres of the model to metres of the original, with its booster.

    Args:
        mesh: the object, with a booster or without.
        spec: spec with the lengths of model and original.
        length_m: longest side of the original; by default the spec's, else that of the model.
    """
    if length_m is not None and not 0.001 <= length_m < 10_000:
        raise FieldError("expected 0.001 to 10000 m", {"length_m": length_m})
    scale = (length_m or spec.world_length_m or spec.length_mm / 1000) / spec.length_mm
    return replace(mesh, vertices=(mesh.vertices * scale).astype(np.float32))


@lru_cache(maxsize=8)
def build_mesh(name: str) -> Mesh:
    """Build an object that a room models by hand; a `ToolkitError` if it is unknown or its room is missing."""
    what = f"{BUILTIN_PREFIX}{name}"
    if what not in list_offers():
        raise explain_missing(what) or one_of("built-in mesh", name, list(BUILTIN))
    # modelling takes a second or two, and gives the same each time
    return unpack_mesh(keep_arrays("mesh", [name], lambda: pack_mesh(ask_room(what)())))


def read_mesh(path: Path) -> Mesh:
    """Read a user's mesh: geometry, texture coordinates and base colours; a file without them is plain grey.

    Raises:
        ToolkitError: no such file, an unknown kind, damaged, without faces, not finite, or larger
            than `toolkit.objects.limits` or `MOST_BYTES` allow.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ToolkitError(f"{path}: cannot read a mesh from '{path.suffix}' files, expected {' '.join(SUFFIXES)}")
    if not path.is_file():
        raise ToolkitError(f"{path}: no such mesh file: put it beside its spec, or correct 'mesh' in the spec")
    try:
        # a small file may unpack to any size
        with limit_memory(MOST_BYTES):
            return _build_mesh(path)
    except ToolkitError:
        raise
    except Exception as error:
        if not is_memory_full(error):
            raise
    raise ToolkitError(
        f"{path}: takes over {MOST_BYTES / 2**30:.3g} GB to read, or the memory is full: give it fewer triangles, or "
        "fewer and smaller textures"
    )


def _build_mesh(path: Path) -> Mesh:
    parts = _read_parts(path)
    if not parts:
        raise ToolkitError(f"{path}: the mesh has no faces (a point cloud?): export it with triangles")
    parts = _move_home(parts, str(path))
    # part by part, so that what the reader holds is freed
    welded = [_weld(parts.pop(0)) for _ in range(len(parts))]
    solid = [mesh for mesh in welded if mesh is not None]
    if not solid:
        raise ToolkitError(f"{path}: every face has zero area: expected an object with an extent")
    return check_mesh(merge_meshes(solid), str(path))


def _read_parts(path: Path) -> list[MeshPart]:
    parts: list[MeshPart] = []
    count = 0
    try:
        for part in READERS[path.suffix.lower()](path):
            # counted while they are read, before the whole is in memory
            count += len(part.faces)
            check_faces(path, count)
            parts.append(part)
    except ToolkitError:
        raise
    except OSError as error:
        raise explain_read_error(path, error) from None
    except Exception as error:  # trimesh's readers raise whatever their format makes them
        if is_memory_full(error):
            raise
        raise ToolkitError(
            f"{path}: not a readable {path.suffix} mesh: it is damaged, cut or of another kind: open it in Blender and "
            "export it again"
        ) from None
    return parts


READERS: dict[str, Callable[[Path], Iterable[MeshPart]]] = {
    ".obj": read_obj, ".ply": read_ply, ".stl": read_stl, ".off": read_off, **dict.fromkeys(GLTF_SUFFIXES, read_gltf),
}  # fmt: skip


def _move_home(parts: list[MeshPart], source: str) -> list[MeshPart]:
    """Check coordinates and indices; a mesh far from the origin is moved there, for float32 would round it."""
    count, low, high = 0, np.full(3, np.inf), np.full(3, -np.inf)
    for part in parts:
        if part.vertices.shape[1:] != (3,):
            raise ToolkitError(f"{source}: vertices of {part.vertices[0].size} numbers, expected 3: repair the mesh")
        check_finite(part.vertices, source)
        count = len(part.vertices)
        if part.faces.min() < 0 or part.faces.max() >= count:
            worst = part.faces.max() if part.faces.max() >= count else part.faces.min()
            raise ToolkitError(f"{source}: a face names vertex {worst}, the mesh has {count}: repair the mesh")
        low, high = np.minimum(low, part.vertices.min(axis=0)), np.maximum(high, part.vertices.max(axis=0))
    extent = float((high / 2 - low / 2).max()) * 2  # halved first: the difference of two huge numbers overflows
    if extent > 0 and not EXTENTS[0] <= extent <= EXTENTS[1]:
        raise ToolkitError(
            f"{source}: the mesh is {extent:.3g} long, expected {EXTENTS[0]:g} to {EXTENTS[1]:g} in its file's unit: "
            "scale it where it was made"
        )
    # float32 keeps 24 bits: far from the origin they are used up by the distance
    if max(np.abs(low).max(), np.abs(high).max()) <= OFF_CENTRE * extent:
        return parts
    return [replace(part, vertices=part.vertices - (low + high) / 2) for part in parts]


def turn_upright(mesh: Mesh, up: str, front: str) -> Mesh:
    """Turn a mesh whose axes `up` and `front` are named (as '-y') so that up is +z and front +x.

    Raises:
        ToolkitError: both name the same axis.
    """
    x, z = _axis(front), _axis(up)
    if abs(x @ z) > 0.5:
        raise ToolkitError(f"an object's 'up' ({up}) and 'front' ({front}) must be different axes")
    # its rows are the world's axes in the mesh's own; z × x makes it right-handed
    T_world_mesh = np.stack([x, np.cross(z, x), z]).astype(np.float32)
    return replace(mesh, vertices=mesh.vertices @ T_world_mesh.T, normals=mesh.normals @ T_world_mesh.T)


def _axis(name: str) -> np.ndarray:
    axis = np.zeros(3)
    axis["xyz".index(name[-1])] = -1 if name.startswith("-") else 1
    return axis


def _weld(part: MeshPart) -> Mesh | None:
    """Make a mesh of a part; None if no face has an area."""
    vertices = part.vertices.astype(np.float32)
    corner_uv, material = paint_faces(part, vertices)
    # vertices at the same place are joined, so that smoothing crosses the seams of texture coordinates
    first, place = group_places(vertices)
    vertices, faces = vertices[first], place[part.faces]
    # welding leaves triangles with two corners in the same place
    real = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
    if not real.any():
        return None
    return mesh_from_corners(vertices, faces[real], corner_uv[real], np.zeros(int(real.sum()), np.int32), (material,))
