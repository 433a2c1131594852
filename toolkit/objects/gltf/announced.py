"""A refusal of a glTF that asks for more than is built, before anything is built of it."""

from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.objects.gltf.accessors import COMPONENTS
from toolkit.objects.gltf.compressed import DRACO
from toolkit.objects.gltf.document import MESHOPT, MOST_VIEWED_BYTES, Document, extension, rows
from toolkit.objects.limits import SIMPLER, check_faces, check_parts

MOST_ZERO_BYTES = 64 << 20
"""Largest size of the numbers that a file only counts: glTF lets it leave out those that are zero."""


def check_announced(document: Document) -> None:
    """Refuse too many faces, parts or bytes.

    Raises:
        ToolkitError: the message says which, and what to do.
    """
    _check_bytes(document)
    _check_nodes(document)


def _count(found: Any) -> int:
    return found if isinstance(found, int) and found > 0 else 0


def _at(entries: list[dict[str, Any]], index: Any) -> dict[str, Any]:
    return entries[index] if isinstance(index, int) and 0 <= index < len(entries) else {}


def _check_bytes(document: Document) -> None:
    views = document.rows("bufferViews")
    viewed = sum(_count(view.get("byteLength")) for view in views)
    for view in views:
        for name in MESHOPT:
            packed = extension(view, name) or {}
            viewed += _count(packed.get("count")) * _count(packed.get("byteStride"))
    compressed: set[int] = set()
    for mesh in document.rows("meshes"):
        for primitive in rows(mesh, "primitives"):
            if extension(primitive, DRACO) is not None:
                compressed.update(map(id, _accessors(document, primitive)))
    zeros = sum(
        4 * _count(row.get("count")) * COMPONENTS.get(str(row.get("type")), 1)
        for row in document.rows("accessors")
        if "bufferView" not in row and id(row) not in compressed
    )
    if zeros > MOST_ZERO_BYTES or viewed > MOST_VIEWED_BYTES:
        most, found = (MOST_ZERO_BYTES, zeros) if zeros > MOST_ZERO_BYTES else (MOST_VIEWED_BYTES, viewed)
        raise ToolkitError(
            f"{document.path}: asks for {found >> 20:,} MB of numbers, more than {most >> 20:,}: {SIMPLER}"
        )


def _accessors(document: Document, primitive: dict[str, Any]) -> list[dict[str, Any]]:
    named = primitive.get("attributes")
    indices = [*(named.values() if isinstance(named, dict) else ()), primitive.get("indices")]
    return [_at(document.rows("accessors"), index) for index in indices]


def _check_nodes(document: Document) -> None:
    """Count the parts and faces that nodes make of meshes."""
    path = document.path
    nodes, meshes, accessors = (document.rows(name) for name in ("nodes", "meshes", "accessors"))
    parts: list[int] = []
    faces: list[int] = []
    for mesh in meshes:
        drawn = rows(mesh, "primitives")
        shapes = [_at(accessors, drawing.get("indices", _position(drawing))) for drawing in drawn]
        parts.append(len(drawn))
        faces.append(sum(_count(shape.get("count")) for shape in shapes) // 3)
    check_parts(path, max(len(nodes), sum(parts)))
    check_faces(path, sum(faces))
    used = [node["mesh"] for node in nodes if isinstance(node.get("mesh"), int) and 0 <= node["mesh"] < len(meshes)]
    check_parts(path, sum(parts[index] for index in used))
    check_faces(path, sum(faces[index] for index in used))


def _position(primitive: dict[str, Any]) -> Any:
    found = primitive.get("attributes")
    return found.get("POSITION") if isinstance(found, dict) else None
