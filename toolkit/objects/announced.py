"""What a mesh file announces, looked at before anything is built of it: a few bytes may ask for gigabytes or hours."""

import json
from pathlib import Path
from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.core.files import explain_read_error, open_plain

MAX_FACES = 4_000_000
"""More take over 2 GB to load, for detail that no picture shows."""
MAX_PARTS = 20_000
"""Each takes half a millisecond."""
MOST_LEVELS = 200
"""Of nodes within one another; each takes its place from all above it."""
MOST_OBJ_MATERIALS = 4_000
"""trimesh looks for a name for each among all before it."""
MOST_TEXT_BYTES = 512 << 20
MOST_ZERO_BYTES = 64 << 20
"""Of numbers that a file only counts: glTF lets it leave out those that are zero."""
MOST_VIEWED_BYTES = 1 << 30
"""Parts of a buffer are copied, and may overlap."""
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
SIMPLER = "simplify it (Blender: Decimate; MeshLab: Quadric Edge Collapse Decimation)"


def check_announced(path: Path) -> None:
    """Refuse a glTF or an OBJ that asks for more than `read_mesh` builds; what is no glTF is left to its reader.

    Raises:
        ToolkitError: too many faces, parts, levels, materials or bytes; the message says which and what to do.
    """
    suffix = path.suffix.lower()
    try:
        if suffix == ".obj":
            _check_obj(path)
        elif suffix in (".glb", ".gltf"):
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


def _check_obj(path: Path) -> None:
    with open_plain(path) as file:
        names = {line.split(maxsplit=1)[-1] for line in file if line.startswith(b"usemtl")}
    if len(names) > MOST_OBJ_MATERIALS:
        raise ToolkitError(
            f"{path}: {len(names):,} materials, more than {MOST_OBJ_MATERIALS:,}: join them, or export it as .glb"
        )


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
