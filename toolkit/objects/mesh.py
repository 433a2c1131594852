"""A textured triangle mesh, its normals and hashes, and its scene for rays."""

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import scipy

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene


WORD = 63
"""Bits of a number that is sorted: a key, and behind it the row's own number."""
PLACES = 1e6
"""Vertices closer than the mesh's extent over this are at the same place."""
UNUSED = {
    "open3d.ml": (),
    "open3d.visualization.draw_plotly": ("draw_plotly", "draw_plotly_server", "get_plotly_fig"),
}
"""Modules of Open3D that are not loaded, with names that others import from them.

They load scikit-learn, pandas and Dash: 1.5 of the 1.9 s that the import takes, and half of its memory.
"""
ORDINARY_FAN = 256
"""Most triangles at a vertex whose normals are compared in pairs; of more, cells of directions are compared."""
CELLS = 64
"""Cells of directions along each axis, each about 2 degrees wide."""
AT_ONCE = 1_000_000
"""Corners that are worked on at once; bounds the memory."""
GRAIN_MM, GRAIN_UV = 0.01, 1e-4
"""Coordinates that differ by less are the same shape: two machines' sines differ in the last bit."""


def group_rows(columns: Iterable[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Find equal rows of a table of integers, as `np.unique(axis=0)` does.

    Of 336,000 corners it takes 24 ms: `np.lexsort` 65, trimesh's `unique_rows` 43 and in no order, `np.unique` 245.

    Args:
        columns: (n,) integers each, the first column sorts first; a generator takes less memory.

    Returns:
        (k,) the first row of each group, the groups in rising order; and (n,) the group of each row.
    """
    # columns are packed into few keys, so that fewer sorts are needed
    keys = _pack(columns)
    first = keys.pop(0)
    order = rising_order(first)
    starts = np.diff(first[order], prepend=-1) != 0
    del first
    while keys:  # only rows that are equal so far, and differ now, are sorted again
        ranked, group = keys.pop(0)[order], np.cumsum(starts, dtype=np.int32) - 1
        differs = np.diff(ranked, prepend=ranked[:1]) != 0
        mixed = np.zeros(len(order), bool)
        mixed[group[differs & ~starts]] = True
        rows = np.flatnonzero(mixed[group])
        again = rising_order(ranked[rows])
        again = again[rising_order(group[rows][again])]
        order[rows] = order[rows][again]
        ranked[rows] = ranked[rows][again]
        starts |= np.diff(ranked, prepend=ranked[:1]) != 0
    # from sorted rows back to the rows as they were given
    inverse = np.empty(len(order), np.int64)
    inverse[order] = np.cumsum(starts) - 1
    return order[starts], inverse


def rising_order(key: np.ndarray) -> np.ndarray:
    """Return the stable order (n,) that sorts integers from 0 up."""
    shift = len(key).bit_length()
    if len(key) == 0 or int(key.max()).bit_length() + shift > WORD:
        return np.argsort(key, kind="stable")
    word = key.astype(np.int64) << shift  # NumPy sorts plain integers four times as fast as it finds their order
    word |= np.arange(len(key))
    word.sort()
    word &= (1 << shift) - 1
    return word


def _pack(columns: Iterable[np.ndarray]) -> list[np.ndarray]:
    """Pack columns into as few columns of integers from 0 up, short enough for `rising_order`, that sort alike."""
    keys: list[np.ndarray] = []
    free = 0
    for column in columns:
        room = WORD - len(column).bit_length()
        low, high = (int(column.min()), int(column.max())) if len(column) else (0, 0)
        bits = (high - low).bit_length()
        if bits > room:  # numbers far apart: their ranks sort alike
            column = np.unique(column, return_inverse=True)[1].reshape(-1)
            low, bits = 0, len(column).bit_length()
        # the column joins the key before it if their bits fit a word together
        if keys and bits <= free:
            keys[-1] = keys[-1].astype(np.int64) << bits
            keys[-1] |= column.astype(np.int64) - low
            free -= bits
        else:
            keys.append((column.astype(np.int64) - low).astype(np.int32 if bits < 32 else np.int64))
            free = room - bits
    return keys


def group_places(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Group vertices (n, 3) at the same place: within a millionth of the mesh's extent.

    Returns:
        (k,) the first vertex at each place, the places sorted by x, y, z; and (n,) the place of each vertex.
    """
    step = max(float(np.ptp(vertices, axis=0).max()), 1e-9) / PLACES
    # counted from the least, which fits into half the bytes
    return group_rows([(np.round(axis / step) - np.round(axis.min() / step)).astype(np.int32) for axis in vertices.T])


def connected_parts(count: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(count,) number of the connected part of each item, where items (k,) `first` and `second` are joined."""
    graph = scipy.sparse.coo_array((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1])


def load_open3d() -> Any:
    """Import Open3D without `UNUSED`; those can still be imported by their names."""
    stand_ins = {} if "open3d" in sys.modules else {name: ModuleType(name) for name in UNUSED}
    for name, module in stand_ins.items():
        vars(module).update(dict.fromkeys(UNUSED[name]))
    sys.modules.update(stand_ins)
    try:
        import open3d
    finally:
        for name in stand_ins:
            sys.modules.pop(name, None)
    return open3d


def cross_products(corners: np.ndarray) -> np.ndarray:
    """(m, 3) normals of triangles (m, 3, 3), as long as twice their areas; float64."""
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


def flat_areas(corners: np.ndarray) -> np.ndarray:
    """(m,) areas of flat triangles (m, 3, 2); float64."""
    return np.abs(signed_areas(corners.astype(np.float64)))


def signed_areas(flat: np.ndarray) -> np.ndarray:
    """(m,) areas of flat triangles (m, 3, 2), negative where they run clockwise."""
    a, b, c = np.moveaxis(flat, 1, 0)
    return ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / 2


def corner_normals(vertices: np.ndarray, faces: np.ndarray, crease_deg: float = 40.0) -> np.ndarray:
    """(m, 3, 3) unit normals per triangle corner: smooth across edges flatter than `crease_deg`, sharp across the rest.

    Each corner averages the area-weighted normals of the triangles at its position within the crease angle of its
    triangle. If more than `ORDINARY_FAN` meet, normals within about 2 degrees count together, which bounds the cost. A
    triangle without area takes the mean of all that meet there, or points up.
    """
    weighted = np.empty((len(faces), 3))
    for first in range(0, len(faces), AT_ONCE):
        weighted[first : first + AT_ONCE] = cross_products(vertices[faces[first : first + AT_ONCE]])
    place = group_places(vertices)[1][faces.reshape(-1)]
    order = rising_order(place)  # corners, place by place
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    counts = np.diff(starts, append=len(order))

    normals = np.empty((len(order), 3))
    # a fan is all corners at the same place; each corner sums those of its fan within the crease
    # runs of fans of about `AT_ONCE` corners each
    cuts = np.flatnonzero(np.diff(np.cumsum(counts) // AT_ONCE)) + 1
    for first, last in pairwise([0, *cuts.tolist(), len(counts)]):
        corners = order[starts[first] : starts[first] + int(counts[first:last].sum())]
        total = _sum_fans(weighted[corners // 3], counts[first:last], crease_deg)
        total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)
        # a triangle without area faces nowhere: any unit normal does, NaN does not
        total[~total.any(axis=1)] = (0, 0, 1)
        normals[corners] = total
    return normals.reshape(-1, 3, 3)


def _sum_fans(weighted: np.ndarray, counts: np.ndarray, crease_deg: float) -> np.ndarray:
    """(n, 3) sum for each corner of consecutive fans of `counts` corners each."""
    unit = weighted / np.maximum(np.linalg.norm(weighted, axis=1, keepdims=True), 1e-20)
    # corners of a fan follow each other
    starts = np.cumsum(counts) - counts
    fan = np.repeat(np.arange(len(counts)), counts)
    whole = np.add.reduceat(weighted, starts, axis=0)
    total = whole[fan]
    # where all lie within half the angle of their mean, any two lie within the whole angle
    mean = whole / np.maximum(np.linalg.norm(whole, axis=1, keepdims=True), 1e-20)
    # most fans pass this test, and need no comparison of pairs
    near = np.einsum("ij,ij->i", unit, mean[fan]) > np.cos(np.radians(crease_deg / 2)) + 1e-9
    flat = ~unit.any(axis=1)
    creased = np.flatnonzero(np.bincount(fan, ~near & ~flat, len(counts)))
    # fans with a crease are compared corner by corner; huge fans by cells of directions
    ordinary = creased[counts[creased] <= ORDINARY_FAN]
    cosine = np.cos(np.radians(crease_deg))
    if len(ordinary):
        rows, sums = _compare_all(unit, weighted, starts[ordinary], counts[ordinary], cosine)
        total[rows] = np.where(flat[rows, None], total[rows], sums)
    for huge in creased[counts[creased] > ORDINARY_FAN]:
        part = slice(starts[huge], starts[huge] + counts[huge])
        sums = _compare_cells(unit[part], weighted[part], cosine)
        total[part] = np.where(flat[part, None], total[part], sums)
    return total


def _compare_all(
    unit: np.ndarray, weighted: np.ndarray, starts: np.ndarray, counts: np.ndarray, cosine: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of some fans, and for each the sum of the corners of its fan within the angle."""
    # largest first, so that fans with a step-th corner always lead
    largest_first = np.argsort(-counts, kind="stable")
    starts, counts = starts[largest_first], counts[largest_first]
    ends = np.cumsum(counts)
    first = np.repeat(starts, counts)
    rows = first + np.arange(len(first)) - np.repeat(ends - counts, counts)
    total = np.zeros((len(rows), 3))
    for step in range(int(counts[0])):  # compare each corner with the step-th of its fan
        upto = ends[np.searchsorted(-counts, -step, "left") - 1]
        other = first[:upto] + step
        smooth = np.flatnonzero(np.einsum("ij,ij->i", unit[rows[:upto]], unit[other]) >= cosine)
        total[smooth] += weighted[other[smooth]]
    return rows, total


def _compare_cells(unit: np.ndarray, weighted: np.ndarray, cosine: float) -> np.ndarray:
    """(n, 3) sums as in `_compare_all` for a single fan, by cells of directions."""
    first, cell = group_rows(list(np.round((unit.T + 1) * (CELLS / 2)).astype(np.int64)))
    sums = np.stack([np.bincount(cell, axis, len(first)) for axis in weighted.T], axis=1)
    mean = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-20)
    parts = np.array_split(mean, -(-(len(mean) ** 2) // AT_ONCE))
    return np.concatenate([(part @ mean.T >= cosine) @ sums for part in parts])[cell]


@dataclass(frozen=True)
class Material:
    """Reflection of a surface (glTF's metallic-roughness model).

    Attributes:
        name: name for people, and for masking parts of an object.
        texture: base colour, HWC uint8, sRGB-encoded; row 0 is v = 1.
        roughness: 0 mirror … 1 matte.
        metallic: 0 dielectric … 1 metal.
        emission: light of lamps, on the same coordinates: HWC uint8, sRGB-encoded.
        sheet: how a printed sheet is fastened, `taped` or `glued`; empty: it is the object's own surface.
    """

    name: str
    texture: np.ndarray
    roughness: float = 0.6
    metallic: float = 0.0
    emission: np.ndarray | None = None
    sheet: Literal["", "glued", "taped"] = ""


@dataclass(frozen=True)
class Mesh:
    """Triangles with normals, texture coordinates and materials.

    Attributes:
        vertices: (n, 3) float32, millimetres, z up.
        normals: (n, 3) float32, unit length.
        uv: (n, 2) float32; u right, v up, (0, 0) the lower left corner of the texture.
        faces: (m, 3) int32, counter-clockwise seen from outside.
        face_material: (m,) int32, index into `materials`.
        materials: materials of the faces.
    """

    vertices: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    face_material: np.ndarray
    materials: tuple[Material, ...]

    def __repr__(self) -> str:
        """Its counts, as all its numbers would fill a notebook."""
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} faces, {len(self.materials)} materials)"

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest coordinates, millimetres."""
        return np.stack([self.vertices.min(0), self.vertices.max(0)])

    @property
    def size_mm(self) -> np.ndarray:
        """(3,) extents of the bounding box, millimetres."""
        return np.ptp(self.bounds, axis=0)


def place_on_table(mesh: Mesh, length_mm: float | None = None) -> Mesh:
    """Scale the longest side to `length_mm` and move the centre of the base to the origin."""
    scale = 1.0 if length_mm is None else length_mm / float(mesh.size_mm.max())
    low, high = mesh.bounds * scale
    # millimetres, the centre of the base at the origin: the rig's world
    base = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return replace(mesh, vertices=(mesh.vertices * scale - base).astype(np.float32))


def merge_meshes(meshes: list[Mesh]) -> Mesh:
    """Merge meshes into a single mesh, in order."""
    vertex_starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    material_starts = np.cumsum([0, *(len(mesh.materials) for mesh in meshes)])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        normals=np.concatenate([mesh.normals for mesh in meshes]),
        uv=np.concatenate([mesh.uv for mesh in meshes]),
        faces=_concatenate_shifted([mesh.faces for mesh in meshes], vertex_starts),
        face_material=_concatenate_shifted([mesh.face_material for mesh in meshes], material_starts),
        materials=tuple(material for mesh in meshes for material in mesh.materials),
    )


def _concatenate_shifted(arrays: list[np.ndarray], starts: np.ndarray) -> np.ndarray:
    return np.concatenate([array + start for array, start in zip(arrays, starts, strict=False)]).astype(np.int32)


def mesh_from_corners(
    vertices: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray, face_material: np.ndarray,
    materials: tuple[Material, ...], crease_deg: float = 40.0,
) -> Mesh:  # fmt: skip
    """Build a `Mesh` from shared positions and per-corner texture coordinates, splitting vertices at seams and creases.

    Args:
        vertices: (n, 3) positions.
        faces: (m, 3) indices into `vertices`.
        corner_uv: (m, 3, 2).
        face_material: (m,).
        materials: as in `Mesh`.
        crease_deg: edges sharper than this are shaded flat.
    """
    normals = corner_normals(vertices, faces, crease_deg).reshape(-1, 3).astype(np.float32)
    index, uv = faces.reshape(-1), corner_uv.reshape(-1, 2).astype(np.float32)
    # rounded: corners that differ by float noise alone stay a single vertex
    split = (
        np.round(axis * 1e5).astype(kind) for axes, kind in ((normals, np.int32), (uv, np.int64)) for axis in axes.T
    )
    first, inverse = group_rows(chain([index], split))
    return Mesh(
        vertices=vertices[index[first]].astype(np.float32), normals=normals[first], uv=uv[first],
        faces=inverse.reshape(-1, 3).astype(np.int32), face_material=face_material.astype(np.int32),
        materials=materials,
    )  # fmt: skip


def check_mesh(mesh: Mesh, source: str) -> Mesh:
    """Return `mesh` if the rig can photograph it.

    Raises:
        ToolkitError: no faces, coordinates that are not finite, no extent, or an index out of range; names `source`.
    """
    if len(mesh.faces) == 0:
        raise ToolkitError(f"{source}: the mesh has no faces (a point cloud?): export it with triangles")
    check_finite(mesh.vertices, source)
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ToolkitError(f"{source}: a face names vertex {mesh.faces.max()}, the mesh has {len(mesh.vertices)}")
    if not float(mesh.size_mm.max()) > 0:
        raise ToolkitError(f"{source}: all vertices are at the same point: expected an object with an extent")
    return mesh


def check_finite(vertices: np.ndarray, source: str) -> None:
    """Raise a `ToolkitError` that names `source` if vertices (n, 3) are NaN or infinite."""
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise ToolkitError(f"{source}: {bad} of {len(vertices)} vertices are NaN or infinite: repair the mesh")


def hash_mesh(mesh: Mesh) -> str:
    """SHA-256 of a mesh without its normals, 64 hex digits."""
    digest = _hash_arrays((mesh.vertices, mesh.faces, mesh.uv, mesh.face_material))
    _add_paint(digest, mesh.materials)
    return digest.hexdigest()


def hash_paint(materials: Iterable[Material]) -> str:
    """SHA-256 of the colours and gloss of materials, 64 hex digits."""
    digest = hashlib.sha256()
    _add_paint(digest, materials)
    return digest.hexdigest()


def _add_paint(digest: "hashlib._Hash", materials: Iterable[Material]) -> None:
    for material in materials:
        digest.update(f"{material.name} {material.roughness} {material.metallic}".encode())
        digest.update(np.ascontiguousarray(material.texture).tobytes())
        if material.emission is not None:
            digest.update(np.ascontiguousarray(material.emission).tobytes())


def hash_shape(mesh: Mesh, is_exact: bool = False) -> str:
    """SHA-256 of triangles, texture coordinates and names of materials: what a texture is trained for.

    Paint does not count. Coordinates are rounded, as machines differ; `is_exact`: to the last bit, for older records.
    """

    def round_off(values: np.ndarray, grain: float) -> np.ndarray:
        if is_exact:
            return values + 0.0  # turns -0.0 into 0.0
        # not to the nearest: half a grain is where modelled coordinates like to lie
        return np.floor(values / np.float64(grain) + 0.382).astype(np.int64)

    # the order of arrays is part of the hash
    digest = _hash_arrays(
        (round_off(mesh.vertices, GRAIN_MM), mesh.faces, round_off(mesh.uv, GRAIN_UV), mesh.face_material)
    )
    for material in mesh.materials:
        digest.update(f"{material.name}\n".encode())
    return digest.hexdigest()


GEOMETRY = ("vertices", "normals", "uv", "faces", "face_material")


def pack_mesh(mesh: Mesh) -> dict[str, np.ndarray]:
    """A mesh as plain arrays, for `unpack_mesh`; materials that share a picture do so again."""
    # by identity: a picture that is shared is stored once
    pictures = {id(image): image for m in mesh.materials for image in (m.texture, m.emission) if image is not None}
    number = {key: k for k, key in enumerate(pictures)}
    materials = [
        (m.name, m.roughness, m.metallic, number[id(m.texture)], None if m.emission is None else number[id(m.emission)])
        for m in mesh.materials
    ]
    return {
        **{name: getattr(mesh, name) for name in GEOMETRY},
        **{f"picture {k}": picture for k, picture in enumerate(pictures.values())},
        "materials": np.frombuffer(json.dumps(materials).encode(), np.uint8),
    }


def unpack_mesh(arrays: Mapping[str, np.ndarray]) -> Mesh:
    """Undo `pack_mesh`."""
    materials = [
        Material(name, arrays[f"picture {texture}"], roughness, metallic,
                 None if emission is None else arrays[f"picture {emission}"])
        for name, roughness, metallic, texture, emission in json.loads(arrays["materials"].tobytes())
    ]  # fmt: skip
    return Mesh(**{name: arrays[name] for name in GEOMETRY}, materials=tuple(materials))


def hash_triangles(mesh: Mesh) -> str:
    """SHA-256 of triangles and normals, without paint."""
    return _hash_arrays((mesh.vertices, mesh.normals, mesh.faces)).hexdigest()


def _hash_arrays(arrays: Iterable[np.ndarray]) -> "hashlib._Hash":
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest


def make_ray_scene(mesh: Mesh) -> "RaycastingScene":
    """Return Open3D's ray-casting scene (Embree) of a mesh."""
    return make_triangle_scene(mesh.vertices, mesh.faces)


def make_triangle_scene(vertices: np.ndarray, faces: np.ndarray) -> "RaycastingScene":
    """Return Open3D's ray-casting scene of triangles (m, 3) between vertices (n, 3)."""
    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.ascontiguousarray(vertices, np.float32)),
        o3d.core.Tensor(np.ascontiguousarray(faces.astype(np.uint32))),
    )
    return scene


def cast_rays(scene: "RaycastingScene", rays: np.ndarray) -> np.ndarray:
    """(...) float32 distance along rays (..., 6), origin and direction, to the first hit, in lengths of the direction.

    Rays without a hit have inf.
    """
    return find_hits(scene, rays)[0]


def find_hits(scene: "RaycastingScene", rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What rays meet first: `cast_rays`, (...) int64 faces, and (..., 3) weights of their corners there."""
    o3d = load_open3d()
    found = scene.cast_rays(o3d.core.Tensor(np.ascontiguousarray(rays, np.float32)))
    distance, face, at = (found[key].numpy() for key in ("t_hit", "primitive_ids", "primitive_uvs"))
    return distance, face.astype(np.int64), np.concatenate([1 - at.sum(axis=-1, keepdims=True), at], axis=-1)
