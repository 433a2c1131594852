"""Which faces keep their paint when an object gets a trained texture."""

from collections.abc import Sequence

import numpy as np

from toolkit.errors import ToolkitError
from toolkit.objects.mesh import Mesh

STEPS = 4
"""A face is looked at in the middle of each of STEPS² equal parts."""


def choose_kept(mesh: Mesh, keep: Sequence[str] = (), keep_image: np.ndarray | None = None) -> np.ndarray:
    """The faces that keep their paint: those of some materials, and those mostly under the marks of an image.

    Args:
        mesh: the object.
        keep: names of materials.
        keep_image: (h, w) bool in the mesh's own texture coordinates, row 0 at v = 1; True keeps.

    Returns:
        (m,) bool per face.

    Raises:
        ToolkitError: no material of that name, an image of another shape or for a mesh without texture coordinates, or
            nothing left to train.
    """
    names = [material.name for material in mesh.materials]
    kept = np.zeros(len(mesh.faces), bool)
    for name in keep:
        if name not in names:
            known = ", ".join(dict.fromkeys(names))
            raise ToolkitError(f"cannot keep the paint of '{name}': the object has no such material, it has {known}")
        kept |= np.isin(mesh.face_material, [i for i, other in enumerate(names) if other == name])
    if keep_image is not None:
        kept |= _under_marks(mesh, np.asarray(keep_image))
    if kept.all():
        raise ToolkitError("every face keeps its paint: nothing is left to train; keep fewer materials, or mark less")
    return kept


def _under_marks(mesh: Mesh, marks: np.ndarray) -> np.ndarray:
    if marks.ndim != 2 or marks.dtype != bool or 0 in marks.shape:
        raise ToolkitError(
            f"the image of what keeps its paint: expected a (height, width) array of True and False, "
            f"found {marks.dtype} of shape {marks.shape}"
        )
    corner_uv = mesh.uv[mesh.faces].astype(np.float64)
    if not (np.ptp(corner_uv, axis=1) > 0).any():
        raise ToolkitError(
            "an image cannot say what keeps its paint: the mesh has no texture coordinates; name materials instead"
        )
    height, width = marks.shape
    hits = np.zeros(len(corner_uv))
    for weights in _middles(STEPS):
        u, v = np.moveaxis(np.einsum("c,mci->mi", weights, corner_uv), 1, 0)
        column = np.floor(u * width).astype(np.int64)
        row = np.floor((1 - v) * height).astype(np.int64)
        column, row = np.where(u == 1, width - 1, column % width), np.where(v == 0, height - 1, row % height)
        hits += marks[row, column]
    return hits > STEPS * STEPS / 2


def _middles(steps: int) -> np.ndarray:
    """(steps², 3) barycentric coordinates of the middles of equal parts of a triangle."""
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(steps) for j in range(steps - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(steps) for j in range(steps - i - 1)]
    places = np.array(upright + turned) / steps
    return np.column_stack([places, 1 - places.sum(axis=1)])
