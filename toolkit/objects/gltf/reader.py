"""A glTF 2.0 as painted parts: the one entrance to this folder."""

from pathlib import Path

from toolkit.core.child import is_memory_full
from toolkit.core.console import notice_once
from toolkit.core.errors import ToolkitError
from toolkit.objects.gltf.announced import check_announced
from toolkit.objects.gltf.document import DamagedGltf, Document, read_document, refuse, rows
from toolkit.objects.gltf.geometry import read_primitive
from toolkit.objects.gltf.leftovers import check_required, list_leftovers
from toolkit.objects.gltf.materials import Part, paint_primitive
from toolkit.objects.gltf.nodes import place_meshes
from toolkit.objects.gltf.pictures import Pictures
from toolkit.objects.limits import check_faces, check_parts


def read_gltf(path: Path) -> list[Part]:
    """The parts of a glTF's default scene, in metres; each feature that is left out gives a note, once in a process.

    Raises:
        ToolkitError: it breaks the specification, asks for too much, requires an extension that is not read, or names
            a file that is missing or damaged.
    """
    document = read_document(path)
    try:
        check_announced(document)
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


def _read_parts(document: Document) -> list[Part]:
    pictures = Pictures(document)
    parts: list[Part] = []
    count = face_count = 0
    for placed in place_meshes(document):
        for primitive in rows(placed.mesh, "primitives"):
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
