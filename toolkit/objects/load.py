"""From a spec to a mesh on the table: built-in objects and the user's own files.

What a file announces is looked at before anything is built of it: a few bytes may ask for gigabytes or hours.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.cache import keep_arrays
from toolkit.core.child import is_memory_full, limit_memory
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import explain_read_error, inside, open_plain
from toolkit.imaging.read import open_textures
from toolkit.objects.mesh import (
    Material,
    Mesh,
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
from toolkit.objects.paint import Piece, paint_faces
from toolkit.objects.ply_file import read_ply
from toolkit.objects.spec import BUILTIN_PREFIX, ObjectSpec, read_spec

MAX_FACES = 4_000_000
"""More take over 2 GB to load, for detail that no picture shows."""
MAX_PARTS = 20_000
"""Each takes half a millisecond."""
MOST_LEVELS = 200
"""Of nodes within one another; each takes its place from all above it."""
MOST_TEXT_BYTES = 512 << 20
MOST_ZERO_BYTES = 64 << 20
"""Of numbers that a file only counts: glTF lets it leave out those that are zero."""
MOST_VIEWED_BYTES = 1 << 30
"""Parts of a buffer are copied, and may overlap."""
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
SIMPLER = "simplify it (Blender: Decimate; MeshLab: Quadric Edge Collapse Decimation)"


def check_announced(path: Path) -> None:
    """Refuse a glTF that asks for more than `read_mesh` builds; what is no glTF is left to its reader.

    Raises:
        ToolkitError: too many faces, parts, levels or bytes; the message says which and what to do.
    """
    suffix = path.suffix.lower()
    try:
        if suffix in (".glb", ".gltf"):
            tree = _read_tree(path, suffix)
            if isinstance(tree, dict):
                _check_bytes(path, tree)
                _check_nodes(path, tree)
    except OSError as error:
        raise explain_read_error(path, error) from None


def check_faces(path: Path, count: int) -> None:
    """A `ToolkitError` for more than `MAX_FACES`."""
    if count > MAX_FACES:
        raise ToolkitError(f"{path}: {count:,} faces, more than {MAX_FACES:,}: {SIMPLER}")


def check_parts(path: Path, count: int) -> None:
    """A `ToolkitError` for more than `MAX_PARTS`."""
    if count > MAX_PARTS:
        raise ToolkitError(f"{path}: {count:,} parts, more than {MAX_PARTS:,}: join them before the export")


def _read_tree(path: Path, suffix: str) -> Any:
    """The JSON of a glTF, None where there is none that can be read."""
    with open_plain(path) as file:
        head = file.read(20) if suffix == ".glb" else b""  # magic, version, length; length and kind of the JSON
        most = int.from_bytes(head[12:16], "little") if head else MOST_TEXT_BYTES + 1
        text = file.read(min(most, MOST_TEXT_BYTES + 1))
    if len(text) > MOST_TEXT_BYTES:
        raise ToolkitError(f"{path}: over {MOST_TEXT_BYTES >> 20} MB of text: export it as .glb")
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _rows(tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    found = tree.get(name)
    return [one if isinstance(one, dict) else {} for one in found] if isinstance(found, list) else []


def _count(found: Any) -> int:
    return found if isinstance(found, int) and found > 0 else 0


def _at(rows: list[dict[str, Any]], index: Any) -> dict[str, Any]:
    return rows[index] if isinstance(index, int) and -len(rows) <= index < len(rows) else {}


def _check_bytes(path: Path, tree: dict[str, Any]) -> None:
    viewed = sum(_count(view.get("byteLength")) for view in _rows(tree, "bufferViews"))
    zeros = sum(
        4 * _count(one.get("count")) * COMPONENTS.get(str(one.get("type")), 1)
        for one in _rows(tree, "accessors")
        if "bufferView" not in one
    )
    if zeros > MOST_ZERO_BYTES or viewed > MOST_VIEWED_BYTES:
        most, found = (MOST_ZERO_BYTES, zeros) if zeros > MOST_ZERO_BYTES else (MOST_VIEWED_BYTES, viewed)
        raise ToolkitError(f"{path}: asks for {found >> 20:,} MB of numbers, more than {most >> 20:,}: {SIMPLER}")


def _check_nodes(path: Path, tree: dict[str, Any]) -> None:
    """Count the parts and faces that nodes make of meshes, and the levels of nodes."""
    nodes, meshes, accessors = (_rows(tree, name) for name in ("nodes", "meshes", "accessors"))
    parts: list[int] = []
    faces: list[int] = []
    for mesh in meshes:
        drawn = _rows(mesh, "primitives")
        shapes = [_at(accessors, one.get("indices", _attribute(one, "POSITION"))) for one in drawn]
        parts.append(len(drawn))
        faces.append(sum(_count(shape.get("count")) for shape in shapes) // 3)
    check_parts(path, max(len(nodes), sum(parts)))
    check_faces(path, sum(faces))
    used = [node["mesh"] for node in nodes if isinstance(node.get("mesh"), int) and 0 <= node["mesh"] < len(meshes)]
    check_parts(path, sum(parts[index] for index in used))
    check_faces(path, sum(faces[index] for index in used))
    if (levels := _count_levels(nodes)) > MOST_LEVELS:
        raise ToolkitError(
            f"{path}: {levels:,} levels of nodes, more than {MOST_LEVELS}: apply their transforms before the export"
        )


def _attribute(primitive: dict[str, Any], name: str) -> Any:
    found = primitive.get("attributes")
    return found.get(name) if isinstance(found, dict) else None


def _count_levels(nodes: list[dict[str, Any]]) -> int:
    """Of nodes within one another, each taken where it is met first, as trimesh walks them."""
    children = [
        [child for child in found if isinstance(child, int) and 0 <= child < len(nodes)]
        if isinstance(found := node.get("children"), list)
        else []
        for node in nodes
    ]
    inner = {child for some in children for child in some}
    here = [index for index in range(len(nodes)) if index not in inner] or list(range(len(nodes)))[:1]
    seen, levels = set(here), 0
    while here:
        levels += 1
        here = list({child for index in here for child in children[index]} - seen)
        seen.update(here)
    return levels


BUILTIN = ("racer", "warplane", "coffeepot", "eggnog")
SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
MOST_BYTES = 7 << 28
"""What a mesh with its pictures may take while it is read; with what is loaded already, under 2 GB."""
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
        """The object's name."""
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
        """Whether a record is of this shape: by today's hash or, of an older record, by the exact one."""
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
            f"{spec_file}: '{spec.name}' has no mesh, so it is judged in photographs, but cannot be rendered: "
            "add 'mesh' and 'length_mm' to the file"
        )
    if spec.mesh.startswith(BUILTIN_PREFIX):
        mesh = build_mesh(spec.mesh.removeprefix(BUILTIN_PREFIX))
    else:
        mesh = read_mesh(inside(Path(spec_file).parent, spec.mesh))
    return stand_upright(spec, mesh)


def stand_upright(spec: ObjectSpec, mesh: Mesh) -> TableObject:
    """The object of a spec whose mesh is read already."""
    return TableObject(spec, place_on_table(turn_upright(mesh, spec.up, spec.front), spec.length_mm))


@lru_cache(maxsize=8)
def build_mesh(name: str) -> Mesh:
    """Build one of the procedural objects."""
    if name not in BUILTIN:
        raise one_of("built-in mesh", name, list(BUILTIN))
    # modelling takes a second or two, and gives the same each time
    return unpack_mesh(keep_arrays("mesh", [name], lambda: pack_mesh(import_module(f"toolkit.content.{name}").build())))


def read_mesh(path: Path) -> Mesh:
    """Read a user's mesh: geometry, texture coordinates and base colours; a file without them is plain grey.

    Raises:
        ToolkitError: no such file, an unknown kind, unreadable, without faces, with vertices that are not finite, or
            more than `toolkit.objects.load` or `MOST_BYTES` allow.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ToolkitError(
            f"{path}: cannot read a mesh from '{path.suffix}' files, expected one of {' '.join(SUFFIXES)}"
        )
    if not path.is_file():
        raise ToolkitError(f"{path}: no such mesh file: put it beside its spec, or correct 'mesh' in the spec")
    # what the file's head says of its size, before trimesh reads the rest
    check_announced(path)
    try:
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
    pieces = _read_pieces(path)
    if not pieces:
        raise ToolkitError(f"{path}: the mesh has no faces (a point cloud?): export it with triangles")
    pieces = _move_home(pieces, str(path))
    painted = [_paint(pieces.pop(0), str(path)) for _ in range(len(pieces))]  # each in place of what trimesh holds
    welded = [_weld(*painted.pop(0), str(path)) for _ in range(len(painted))]
    return check_mesh(merge_meshes(welded), str(path))


def _read_pieces(path: Path) -> list[Piece]:
    pieces: list[Piece] = []
    count = 0
    try:
        for piece in READERS.get(path.suffix.lower(), _read_scene)(path):
            count += len(piece.faces)
            check_faces(path, count)
            pieces.append(piece)
    except ToolkitError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their format makes them
        if is_memory_full(error):
            raise
        raise ToolkitError(
            f"{path}: not a readable {path.suffix} mesh: it is damaged, cut or of another kind: open it in Blender and "
            "export it again"
        ) from None
    return pieces


def _read_scene(path: Path) -> Iterator[Piece]:
    """The parts of a file that trimesh reads as it is."""
    import trimesh

    with open_textures(str(path)):  # trimesh opens them itself
        scene = trimesh.load_scene(path, process=False)
    check_parts(path, len(scene.graph.nodes_geometry))
    for node in scene.graph.nodes_geometry:
        T_scene_piece, name = scene.graph[node]
        piece = scene.geometry[name]
        if not isinstance(piece, trimesh.Trimesh) or not len(piece.faces):
            continue
        vertices, faces = np.asarray(piece.vertices, np.float64), np.asarray(piece.faces, np.int64)
        if not np.allclose(T_scene_piece, np.eye(4), rtol=0, atol=1e-8):
            vertices = trimesh.transform_points(vertices, T_scene_piece)
            # a mirror turns triangles inside out
            faces = faces[:, ::-1] if np.linalg.det(T_scene_piece[:3, :3]) < 0 else faces
        yield Piece(vertices, faces, piece.visual)


READERS: dict[str, Callable[[Path], Iterator[Piece]]] = {".obj": read_obj, ".ply": read_ply}
"""Formats with a reader of their own."""


def _move_home(pieces: list[Piece], source: str) -> list[Piece]:
    """Check coordinates and indices; a mesh far from the origin is moved there, for float32 would round it."""
    count, low, high = 0, np.full(3, np.inf), np.full(3, -np.inf)
    for piece in pieces:
        if piece.vertices.shape[1:] != (3,):
            raise ToolkitError(f"{source}: vertices of {piece.vertices[0].size} numbers, expected 3: repair the mesh")
        bad = int((~np.isfinite(piece.vertices)).any(axis=1).sum())
        if bad:
            raise ToolkitError(
                f"{source}: {bad} of {len(piece.vertices)} vertices are NaN or infinite: repair the mesh"
            )
        count = len(piece.vertices)
        if piece.faces.min() < 0 or piece.faces.max() >= count:
            worst = piece.faces.max() if piece.faces.max() >= count else piece.faces.min()
            raise ToolkitError(f"{source}: a face names vertex {worst}, the mesh has {count}: repair the mesh")
        low, high = np.minimum(low, piece.vertices.min(axis=0)), np.maximum(high, piece.vertices.max(axis=0))
    extent = float((high / 2 - low / 2).max()) * 2  # halved first: the difference of two huge numbers overflows
    if extent > 0 and not EXTENTS[0] <= extent <= EXTENTS[1]:
        raise ToolkitError(
            f"{source}: the mesh is {extent:.3g} long, expected {EXTENTS[0]:g} to {EXTENTS[1]:g} in its file's unit: "
            "scale it where it was made"
        )
    if max(np.abs(low).max(), np.abs(high).max()) <= OFF_CENTRE * extent:
        return pieces
    return [replace(piece, vertices=piece.vertices - (low + high) / 2) for piece in pieces]


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


def _paint(piece: Piece, source: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, Material]:
    """Vertices as float32, faces, texture coordinates of their corners and material."""
    vertices = piece.vertices.astype(np.float32)
    return vertices, piece.faces, *paint_faces(piece.visual, vertices, piece.faces, source)


def _weld(vertices: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray, material: Material, source: str) -> Mesh:
    # one position per place, so that smoothing crosses the seams that texture coordinates cut
    first, place = group_places(vertices)
    vertices, faces = vertices[first], place[faces]
    # welding leaves triangles with two corners in one place
    real = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
    if not real.any():
        raise ToolkitError(f"{source}: every face has zero area: expected an object with an extent")
    return mesh_from_corners(vertices, faces[real], corner_uv[real], np.zeros(int(real.sum()), np.int32), (material,))
