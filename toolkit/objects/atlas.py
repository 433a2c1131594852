"""An object made ready for a texture that is trained: one sheet for all its faces but those that keep their paint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from toolkit.errors import ToolkitError
from toolkit.objects.kept_paint import choose_kept
from toolkit.objects.mesh import Material, Mesh
from toolkit.objects.texel_cover import cover_texels, nearest_covered
from toolkit.objects.unwrap import unwrap as make_corner_uv

SIDES_PX = (8, 1024)
GROUND = 128
"""Grey level of the sheet before anything is trained."""
WITHOUT_UV = 0.05
"""With more than this share of the surface without an area on the texture, the mesh's own coordinates do not do."""
UV_ROUNDING = 1e-3
"""So far beyond [0, 1] own coordinates may lie: exporters round."""
MOST_REPEATS = 8
"""A texture that repeats more often over the object is no sheet to train."""


@dataclass(frozen=True)
class Atlas:
    """A mesh whose trained faces share one square texture.

    Attributes:
        mesh: the given mesh's triangles in their order, with their normals. The materials of all trained faces refer
            to one texture array (roughness kept, metallic 0); kept faces have their own material and coordinates.
        trained: (m,) bool per face.
        covered: (n, n) bool, texels that a trained face touches: the free parameters; row 0 at v = 1.
        source: (n, n) int64, flat index of the texel that each texel takes its colour from: itself where covered, else
            the nearest covered one, so that filters do not mix in what is no part of the object.
        unwrapped: whether the coordinates of the trained faces were made here; else they are the mesh's own.
    """

    mesh: Mesh
    trained: np.ndarray
    covered: np.ndarray
    source: np.ndarray
    unwrapped: bool

    @property
    def n(self) -> int:
        """Side of the texture in texels."""
        return len(self.covered)

    @property
    def corner_uv(self) -> np.ndarray:
        """(m, 3, 2) float32 texture coordinates of each face's corners."""
        return self.mesh.uv[self.mesh.faces]


def make_atlas(
    mesh: Mesh,
    n: int,
    keep: Sequence[str] = (),
    keep_image: np.ndarray | None = None,
    unwrap: bool | None = None,
    corner_uv: np.ndarray | None = None,
) -> Atlas:
    """Make a mesh ready for an n × n texture.

    Args:
        mesh: the object.
        n: side of the texture in texels, 8 to 1024.
        keep: names of materials that keep their paint.
        keep_image: (h, w) bool in the mesh's own texture coordinates, row 0 at v = 1; a face mostly under True keeps
            its paint.
        unwrap: whether to make new texture coordinates; by default only where the mesh's own cannot carry a texture:
            several pictures share them, more than 5 % of the surface has no area on the texture, or they leave it.
        corner_uv: (m, 3, 2) coordinates that an earlier call made, used instead of making them again.

    Raises:
        ToolkitError: n is out of range, `keep` or `keep_image` do not fit the mesh or keep all of it, `corner_uv` is of
            another mesh, the mesh has no coordinates though `unwrap` is False, or xatlas is missing.
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not SIDES_PX[0] <= n <= SIDES_PX[1]:
        raise ToolkitError(f"a texture's side: expected {SIDES_PX[0]} to {SIDES_PX[1]} texels, found {n}")
    trained = ~choose_kept(mesh, keep, keep_image)
    unwrapped = corner_uv is not None or (not _own_uv_serve(mesh, trained) if unwrap is None else unwrap)
    if corner_uv is not None:
        mesh = _split_vertices(mesh, _check_corner_uv(mesh, corner_uv))
    elif unwrapped:
        fresh = mesh.uv[mesh.faces]
        fresh[trained] = make_corner_uv(mesh.vertices, mesh.faces[trained], n)
        mesh = _split_vertices(mesh, fresh)
    else:
        _check_own_uv(mesh, trained)
    uv = mesh.uv[mesh.faces[trained]]
    covered = cover_texels(uv[_visible(mesh, trained) | (_uv_area(uv) > 0)], n)
    sheet = np.full((n, n, 3), GROUND, np.uint8)
    return Atlas(_share_sheet(mesh, trained, sheet), trained, covered, nearest_covered(covered), bool(unwrapped))


def wear(atlas: Atlas, texture: np.ndarray) -> Mesh:
    """The mesh with a texture on its trained faces.

    Args:
        atlas: the object.
        texture: (n, n, 3) uint8, sRGB-encoded, row 0 at v = 1; what the object does not cover is filled from the
            nearest texel that it covers.

    Raises:
        ToolkitError: the texture has another size.
    """
    if texture.shape != (atlas.n, atlas.n, 3) or texture.dtype != np.uint8:
        raise ToolkitError(
            f"a texture for this object: expected {atlas.n}×{atlas.n} RGB pixels of 8 bits, "
            f"found {texture.dtype} of shape {texture.shape}"
        )
    sheet = np.ascontiguousarray(dilate(texture, atlas))
    worn = set(np.unique(atlas.mesh.face_material[atlas.trained]).tolist())
    materials = (replace(m, texture=sheet) if i in worn else m for i, m in enumerate(atlas.mesh.materials))
    return replace(atlas.mesh, materials=tuple(materials))


def dilate(texture: np.ndarray, atlas: Atlas) -> np.ndarray:
    """A texture (n, n, …) whose uncovered texels have the colour of the nearest covered one."""
    return texture.reshape(atlas.n * atlas.n, *texture.shape[2:])[atlas.source]


def _own_uv_serve(mesh: Mesh, trained: np.ndarray) -> bool:
    """Whether the mesh's own texture coordinates can carry one texture on the trained faces."""
    sheets = {
        (mesh.materials[i].texture.shape, mesh.materials[i].texture.tobytes())
        for i in np.unique(mesh.face_material[trained])
    }
    uv = mesh.uv[mesh.faces[trained]]
    if len(sheets) > 1 or not np.isfinite(uv).all() or uv.min() < -UV_ROUNDING or uv.max() > 1 + UV_ROUNDING:
        return False
    area = _surface(mesh, trained)
    return float(area[_uv_area(uv) <= 0].sum()) <= WITHOUT_UV * float(area.sum())


def _check_own_uv(mesh: Mesh, trained: np.ndarray) -> None:
    uv = mesh.uv[mesh.faces[trained]]
    if not np.isfinite(uv).all() or not (_uv_area(uv) > 0).any():
        raise ToolkitError("the mesh has no texture coordinates of its own: let new ones be made")
    if np.ptp(uv.reshape(-1, 2), axis=0).max() > MOST_REPEATS:
        raise ToolkitError(
            f"the mesh's texture coordinates, from {uv.min():.3g} to {uv.max():.3g}, repeat the texture too often: "
            "let new ones be made"
        )


def _check_corner_uv(mesh: Mesh, corner_uv: np.ndarray) -> np.ndarray:
    corner_uv = np.asarray(corner_uv)
    expected = (len(mesh.faces), 3, 2)
    if corner_uv.shape != expected or not np.issubdtype(corner_uv.dtype, np.floating):
        raise ToolkitError(
            f"stored texture coordinates: expected {expected[0]}×3×2 numbers for this mesh, found {corner_uv.dtype} of "
            f"shape {corner_uv.shape}: they are of another mesh; train the texture again"
        )
    if not np.isfinite(corner_uv).all():
        raise ToolkitError("stored texture coordinates are NaN or infinite: the file is damaged; train again")
    return corner_uv.astype(np.float32)


def _uv_area(corner_uv: np.ndarray) -> np.ndarray:
    """(m,) area of each face on the texture, as a share of it; 0 where it is a rounding."""
    a, b, c = np.moveaxis(corner_uv.astype(np.float64), 1, 0)
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    area = np.abs(doubled) / 2
    return np.where(area > 1e-13, area, 0)


def _surface(mesh: Mesh, chosen: np.ndarray) -> np.ndarray:
    """Area of each chosen face in mm²."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[chosen]].astype(np.float64), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _visible(mesh: Mesh, chosen: np.ndarray) -> np.ndarray:
    """Which of the chosen faces have an area that a camera could see."""
    return _surface(mesh, chosen) > 1e-12 * float(mesh.size_mm.max()) ** 2


def _split_vertices(mesh: Mesh, corner_uv: np.ndarray) -> Mesh:
    """The mesh with other texture coordinates; vertices are doubled where those of their faces differ."""
    index = mesh.faces.reshape(-1).astype(np.int64)
    bits = np.ascontiguousarray(corner_uv, np.float32).reshape(-1, 2).view(np.int32).astype(np.int64)
    _, first, inverse = np.unique(np.column_stack([index, bits]), axis=0, return_index=True, return_inverse=True)
    origin = index[first]
    return replace(
        mesh,
        vertices=mesh.vertices[origin],
        normals=mesh.normals[origin],
        uv=corner_uv.reshape(-1, 2)[first].astype(np.float32),
        faces=inverse.reshape(-1, 3).astype(np.int32),
    )


def _share_sheet(mesh: Mesh, trained: np.ndarray, sheet: np.ndarray) -> Mesh:
    """The mesh with one array as the texture of all trained faces; a material of both sorts of faces becomes two."""
    materials: list[Material] = []
    face_material = np.zeros(len(mesh.faces), np.int32)
    for index, material in enumerate(mesh.materials):
        of_it = mesh.face_material == index
        looks = (material, replace(material, texture=sheet, metallic=0.0))
        for look, part in zip(looks, (of_it & ~trained, of_it & trained), strict=True):
            if part.any():
                face_material[part] = len(materials)
                materials.append(look)
    return replace(mesh, face_material=face_material, materials=tuple(materials))
