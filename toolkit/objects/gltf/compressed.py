"""Draco's meshes and Basis Universal's pictures, unpacked by packages of the extra `gltf`."""

from typing import Any

import numpy as np

from toolkit.core.errors import ToolkitError, describe_failure, foreign_code
from toolkit.core.extras import import_package
from toolkit.imaging.read import MAX_MEGAPIXELS
from toolkit.objects.gltf.document import DamagedGltf, Document

DRACO, BASISU = "KHR_draco_mesh_compression", "KHR_texture_basisu"
KTX_START = b"\xabKTX 20\xbb\r\n\x1a\n"


def decode_draco(document: Document, draco: dict[str, Any]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return attributes by name, (n, k) each, and (m, 3) faces of a primitive that Draco compressed."""
    way_out = "export the mesh without Draco compression"
    library = import_package("DracoPy", "gltf", f"{document.path}: {DRACO}", way_out)
    content = document.view(draco.get("bufferView")).tobytes()
    with foreign_code(lambda error: DamagedGltf(f"{DRACO}: the compressed mesh is damaged ({type(error).__name__})")):
        mesh = library.decode(content)
        # Draco numbers its attributes, and the extension says which is which
        found = {attribute["unique_id"]: np.asarray(attribute["data"]) for attribute in mesh.attributes}
        attributes = {name: found[number] for name, number in draco["attributes"].items()}
        faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3)
    return {name: values.reshape(len(values), -1) for name, values in attributes.items()}, faces


def decode_ktx(document: Document, content: bytes, name: str) -> bytes:
    """A KTX2 picture of Basis Universal as PNG."""
    way_out = "save its textures as PNG (npx @gltf-transform/cli ktxdecompress)"
    library = import_package("alktx2", "gltf", f"{document.path}: {BASISU}", way_out)
    # width and height in KTX2's header, read before anything is unpacked
    width, height = (int.from_bytes(content[at : at + 4], "little") for at in (20, 24))
    if not content.startswith(KTX_START) or not 0 < width * height <= MAX_MEGAPIXELS * 1e6:
        raise ToolkitError(f"{document.path}: {name} is no {BASISU} picture, or far too large: save it as PNG")
    damaged = f"{document.path}: {name} cannot be read, save it as PNG: {BASISU}"
    with foreign_code(lambda error: ToolkitError(f"{damaged}: {describe_failure(error, 80)}")):
        png, _ = library.decode_ktx2_to_bytes(content, format="png")
    return bytes(png)
