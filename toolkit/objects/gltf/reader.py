"""Read a glTF 2.0 as painted parts, after a check of how much it asks for: the entrance to this folder."""

from pathlib import Path
from typing import Any

from toolkit.core.child import is_memory_full
from toolkit.core.console import notice_once
from toolkit.core.errors import ToolkitError
from toolkit.objects.gltf.accessors import COMPONENTS
from toolkit.objects.gltf.compressed import DRACO
from toolkit.objects.gltf.document import (
    MESHOPT,
    MOST_VIEWED_BYTES,
    DamagedGltf,
    Document,
    extension,
    read_document,
    refuse,
    rows,
)
from toolkit.objects.gltf.geometry import read_primitive
from toolkit.objects.gltf.leftovers import check_required, list_leftovers
from toolkit.objects.gltf.materials import paint_primitive
from toolkit.objects.gltf.nodes import place_meshes
from toolkit.objects.gltf.pictures import Pictures
from toolkit.objects.limits import SIMPLER, check_faces, check_parts
from toolkit.objects.paint import MeshPart

MOST_ZERO_BYTES = 64 << 20
"""Largest size of numbers that a file only counts: glTF may leave out zeros."""


def read_gltf(path: Path) -> list[MeshPart]:
    """Read the parts of a glTF's default scene, in metres; a note, once in a process, names each feature left out.

    Raises:
        ToolkitError: it breaks the specification, asks for too much, requires an extension that is not read, or names
            a file that is missing or damaged.
    """
    document = read_document(path)
    try:
        # before anything is built
        _check_bytes(document)
        _check_nodes(document)
        check_required(document)
        parts = _read_parts(document)
        leftovers = list_leftovers(document)
    except ToolkitError:
        raise
    except DamagedGltf as error:
        refuse(path, str(error))
    except Exception as error:  # what breaks the schema breaks in as many ways
        if is_memory_full(error):
            raise
        refuse(path)
    for line in dict.fromkeys(leftovers + document.notes):
        notice_once(f"note: {path}: {line}")
    return parts


def _count(found: Any) -> int:
    return found if isinstance(found, int) and found > 0 else 0


def _at(entries: list[dict[str, Any]], index: Any) -> dict[str, Any]:
    return entries[index] if isinstance(index, int) and 0 <= index < len(entries) else {}


def _named(primitive: dict[str, Any]) -> dict[str, Any]:
    found = primitive.get("attributes")
    return found if isinstance(found, dict) else {}


def _check_bytes(document: Document) -> None:
    """Refuse too many bytes of buffer views, and of accessors without a view."""
    accessors, views = document.rows("accessors"), document.rows("bufferViews")
    # small files may announce gigabytes: of views, of what meshopt unpacks, and of accessors that are all zeros
    viewed = sum(_count(view.get("byteLength")) for view in views)
    for packed in (extension(view, name) or {} for view in views for name in MESHOPT):
        viewed += _count(packed.get("count")) * _count(packed.get("byteStride"))
    # accessors of Draco meshes have no view, but are no zeros either
    compressed: set[int] = set()
    for primitive in (primitive for mesh in document.rows("meshes") for primitive in rows(mesh, "primitives")):
        if extension(primitive, DRACO) is not None:
            indices = [*_named(primitive).values(), primitive.get("indices")]
            compressed.update(id(_at(accessors, index)) for index in indices)
    zeros = sum(
        4 * _count(row.get("count")) * COMPONENTS.get(str(row.get("type")), 1)
        for row in accessors if "bufferView" not in row and id(row) not in compressed
    )  # fmt: skip
    for found, most in ((zeros, MOST_ZERO_BYTES), (viewed, MOST_VIEWED_BYTES)):
        if found > most:
            raise ToolkitError(
                f"{document.path}: asks for {found >> 20:,} MB of numbers, more than {most >> 20:,}: {SIMPLER}"
            )


def _check_nodes(document: Document) -> None:
    """Refuse too many parts and faces of meshes, and of nodes that repeat them."""
    nodes, meshes, accessors = (document.rows(name) for name in ("nodes", "meshes", "accessors"))
    parts, faces = [], []
    for mesh in meshes:
        drawn = rows(mesh, "primitives")
        # without indices, vertices themselves in threes
        shapes = [_at(accessors, drawing.get("indices", _named(drawing).get("POSITION"))) for drawing in drawn]
        parts.append(len(drawn))
        faces.append(sum(_count(shape.get("count")) for shape in shapes) // 3)
    used = [node["mesh"] for node in nodes if isinstance(node.get("mesh"), int) and 0 <= node["mesh"] < len(meshes)]
    check_parts(document.path, max(len(nodes), sum(parts), sum(parts[index] for index in used)))
    check_faces(document.path, max(sum(faces), sum(faces[index] for index in used)))


def _read_parts(document: Document) -> list[MeshPart]:
    pictures = Pictures(document)
    parts: list[MeshPart] = []
    count = face_count = 0
    for placed in place_meshes(document):
        for primitive in rows(placed.mesh, "primitives"):
            # counted while they are read: a small file may place a mesh many times
            count += 1
            check_parts(document.path, count)
            found = read_primitive(document, placed, primitive)
            if found is None or not len(found.faces):
                continue
            part = paint_primitive(document, pictures, found)
            face_count += len(part.faces)
            check_faces(document.path, face_count)
            parts += [part] if len(part.faces) else []
    return parts
