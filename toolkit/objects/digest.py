"""Whether a mesh is still the one it was: hashes of all of it, or of its shape alone."""

import hashlib
from collections.abc import Iterable

import numpy as np

from toolkit.objects.mesh import Mesh


def hash_mesh(mesh: Mesh) -> str:
    """SHA-256 of all that a renderer makes of a mesh but its normals, 64 hex digits."""
    digest = _hash_arrays((mesh.vertices, mesh.faces, mesh.uv, mesh.face_material))
    for material in mesh.materials:
        digest.update(f"{material.name} {material.roughness} {material.metallic}".encode())
        digest.update(np.ascontiguousarray(material.texture).tobytes())
    return digest.hexdigest()


def hash_shape(mesh: Mesh) -> str:
    """SHA-256 of what a texture is trained for: triangles, texture coordinates and which part each belongs to.

    Another livery or gloss on the same triangles has the same hash, and so has a zero with another sign.
    """
    digest = _hash_arrays((mesh.vertices + 0.0, mesh.faces, mesh.uv + 0.0, mesh.face_material))
    for material in mesh.materials:
        digest.update(f"{material.name}\n".encode())
    return digest.hexdigest()


def _hash_arrays(arrays: Iterable[np.ndarray]):
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest
