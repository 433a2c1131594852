"""Prepare an object for a trained texture: a common sheet for all its faces but those that keep their paint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import scipy
from toolkit.imaging.colour import LINEAR_OF_CODE, linear_to_srgb
from toolkit.objects.mesh import Material, Mesh, cross_products, flat_areas, group_rows
from toolkit.objects.paint import COLOURS
from toolkit.objects.unwrap import unwrap as make_corner_uv

ROUNDING_PX = 1e-4
"""Texture coordinates are float32: closer than this to a texel's border counts as on it."""
STRIPS = 4_000_000
"""Most rows of texels at once; bounds the memory."""


def cover_texels(corner_uv: np.ndarray, n: int) -> np.ndarray:
    """Find the texels of an n × n texture that triangles touch, exactly, also slivers and triangles without area.

    Args:
        corner_uv: (m, 3, 2), u right and v up; the texture repeats.
        n: side of the texture.

    Returns:
        (n, n) bool, row 0 at v = 1.
    """
    # in texels, each triangle moved by whole textures to where it starts in the first
    uv = np.asarray(corner_uv, np.float64)
    places = np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1) * n
    outside = (places.min(axis=1) < -ROUNDING_PX) | (places.max(axis=1) > n + ROUNDING_PX)
    tile = np.floor(places.min(axis=1) / n + 1e-9) * outside
    x, y = np.moveaxis(places - tile[:, None] * n, -1, 0)
    first, last = _touched(y)
    rows = last - first + 1
    # a scan by rows: the sum of starts and ends so far says how many triangles cover a texel
    change = np.zeros(n * (n + 1), np.int64)  # +1 where a run of texels starts, -1 behind its end
    done = 0
    ends = np.cumsum(rows)
    while done < len(rows):
        # some millions of strips at a time: memory stays small for large meshes
        upto = max(int(np.searchsorted(ends, (ends[done - 1] if done else 0) + STRIPS, "right")), done + 1)
        part = slice(done, upto)
        triangle = np.repeat(np.arange(done, upto), rows[part])
        step = np.arange(len(triangle)) - np.repeat(np.cumsum(rows[part]) - rows[part], rows[part])
        row = first[triangle] + step
        left, right = _touched(np.stack(_row_extent(x[triangle], y[triangle], row), axis=1))
        change += _runs(row, left, right, n)
        done = upto
    return np.cumsum(change.reshape(n, n + 1), axis=1)[:, :n] > 0


def _touched(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last texel between the least and the greatest of each row of (k, c) coordinates."""
    low, high = places.min(axis=1), places.max(axis=1)
    first = np.floor(low + ROUNDING_PX).astype(np.int64)
    last = np.ceil(high - ROUNDING_PX).astype(np.int64) - 1
    return first, np.maximum(first, last)


def _row_extent(x: np.ndarray, y: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest x of the parts of triangles (k, 3) between y = row and y = row + 1."""
    low, high = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    top, bottom = row - ROUNDING_PX, row + 1 + ROUNDING_PX
    # each edge of a triangle within the strip of texels gives its least and greatest x
    for a in range(3):
        b = (a + 1) % 3
        rise = y[:, b] - y[:, a]
        flat = np.abs(rise) < 1e-12
        slope = 1 / np.where(flat, 1, rise)
        # the part of the edge within the row, as shares of the way from a to b
        enter, leave = (top - y[:, a]) * slope, (bottom - y[:, a]) * slope
        start = np.where(flat, 0, np.clip(np.minimum(enter, leave), 0, 1))
        stop = np.where(flat, 1, np.clip(np.maximum(enter, leave), 0, 1))
        within = (np.minimum(y[:, a], y[:, b]) <= bottom) & (np.maximum(y[:, a], y[:, b]) >= top)
        for share in (start, stop):
            at = x[:, a] + share * (x[:, b] - x[:, a])
            low = np.where(within, np.minimum(low, at), low)
            high = np.where(within, np.maximum(high, at), high)
    return low, high


def _runs(row: np.ndarray, left: np.ndarray, right: np.ndarray, n: int) -> np.ndarray:
    """(n · (n + 1),) starts and ends of the runs, which wrap from the right border to the left."""
    # rows repeat with the texture, but v = 1 belongs to the border row
    row = np.where((row == n) | (row == -1), np.clip(row, 0, n - 1), row % n)
    whole = right - left + 1 >= n
    left, right = np.where(whole, 0, left), np.where(whole, n - 1, right)
    shift = np.where((left == n) & (right == n), 1, left // n * n)  # u = 1 is the last column
    left, right = left - shift, right - shift
    start = np.bincount(row * (n + 1) + left, minlength=n * (n + 1))
    stop = np.bincount(row * (n + 1) + np.minimum(right, n - 1) + 1, minlength=n * (n + 1))
    # what reaches over the right border goes on at the left
    over = right >= n
    again = np.bincount(row[over] * (n + 1), minlength=n * (n + 1))
    again_stop = np.bincount(row[over] * (n + 1) + right[over] - n + 1, minlength=n * (n + 1))
    return start - stop + again - again_stop


def nearest_covered(covered: np.ndarray) -> np.ndarray:
    """(n, n) int64 flat index of the nearest covered texel of each, across borders, as filters do; (n, n) bool."""
    n = len(covered)
    around = n // 2  # nothing is nearer across a border than half a texture
    wrapped = np.pad(~covered, around, mode="wrap")
    row, column = scipy.ndimage.distance_transform_edt(wrapped, return_distances=False, return_indices=True)
    inner = slice(around, around + n)
    return ((row[inner, inner] - around) % n).astype(np.int64) * n + (column[inner, inner] - around) % n


STEPS = 4
"""A face is sampled in the middle of each of STEPS² equal parts."""


def choose_kept(mesh: Mesh, keep: Sequence[str] = (), keep_image: np.ndarray | None = None) -> np.ndarray:
    """Return the faces that keep their paint: of some materials, or mostly under the marks of an image.

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
    # several materials may share a name: all of them are kept
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
    # a face is kept if more than half of its sample places lie under marks
    hits = np.zeros(len(corner_uv))
    for weights in _middles(STEPS):
        hits += marks[_texel_at(np.einsum("c,mci->mi", weights, corner_uv), height, width)]
    return hits > STEPS * STEPS / 2


def _texel_at(uv: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Row and column, (…) int64, at (…, 2) coordinates of a texture that repeats; its far edges are its own."""
    u, v = np.moveaxis(uv, -1, 0)
    column, row = np.floor(u * width).astype(np.int64), np.floor((1 - v) * height).astype(np.int64)
    return np.where(v == 0, height - 1, row % height), np.where(u == 1, width - 1, column % width)


def _middles(steps: int) -> np.ndarray:
    """(steps², 3) barycentric coordinates of the middles of equal parts of a triangle."""
    # a grid of parallelograms, each halved: the lower halves point up, the upper ones down
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(steps) for j in range(steps - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(steps) for j in range(steps - i - 1)]
    places = np.array(upright + turned) / steps
    return np.column_stack([places, 1 - places.sum(axis=1)])


PAINT_SAMPLES, MOST_PARTS, SAMPLES_AT_ONCE = 3, 1024, 2_000_000
"""Samples of the paint along a texel, most parts of a triangle's side, and most samples at once."""
SIDES_PX = (8, 1024)
GROUND = 128
"""Grey level of the sheet before training."""
WITHOUT_UV = 0.05
"""Largest share of the surface without an area on the texture for the mesh's own coordinates."""
UV_ROUNDING = 1e-3
"""Own coordinates may exceed [0, 1] by this: exporters round."""
MOST_REPEATS = 8
"""A texture that repeats more often over the object cannot be trained."""


@dataclass(frozen=True)
class Atlas:
    """A mesh whose trained faces share a square texture.

    Attributes:
        mesh: the given mesh's triangles in their order, with their normals. The materials of all trained faces share
            a texture array (roughness kept, metallic 0); kept faces have their own material and coordinates.
        trained: (m,) bool per face.
        covered: (n, n) bool, texels that a trained face touches: the free parameters; row 0 at v = 1.
        source: (n, n) int64, flat index of the nearest covered texel, whose colour each texel takes for the filters.
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
    mesh: Mesh, n: int, keep: Sequence[str] = (), keep_image: np.ndarray | None = None, unwrap: bool | None = None,
    corner_uv: np.ndarray | None = None,
) -> Atlas:  # fmt: skip
    """Make a mesh ready for an n × n texture.

    Args:
        mesh: the object.
        n: side of the texture in texels, 8 to 1024.
        keep: names of materials that keep their paint.
        keep_image: (h, w) bool in the mesh's own texture coordinates, row 0 at v = 1; a face mostly under True keeps
            its paint.
        unwrap: whether to make new texture coordinates; by default only if several pictures share the mesh's own, they
            leave the texture, or over 5 % of the surface has no area on it.
        corner_uv: (m, 3, 2) coordinates of an earlier call, used instead of making them again.

    Raises:
        ToolkitError: n is out of range; `keep`, `keep_image` or `corner_uv` do not fit the mesh, or keep all of it; the
            mesh has no coordinates though `unwrap` is False; or xatlas is missing.
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or not SIDES_PX[0] <= n <= SIDES_PX[1]:
        raise ToolkitError(f"a texture's side: expected {SIDES_PX[0]} to {SIDES_PX[1]} texels, found {n}")
    # coordinates: those of an earlier call, new ones of the trained faces, or the mesh's own
    trained = ~choose_kept(mesh, keep, keep_image)
    unwrapped = corner_uv is not None or (not _own_uv_serve(mesh, trained) if unwrap is None else unwrap)
    if corner_uv is not None:
        mesh = split_vertices(mesh, _check_corner_uv(mesh, corner_uv))
    elif unwrapped:
        fresh = mesh.uv[mesh.faces]
        fresh[trained] = make_corner_uv(mesh.vertices, mesh.faces[trained], n)
        mesh = split_vertices(mesh, fresh)
    else:
        _check_own_uv(mesh, trained)
    uv = mesh.uv[mesh.faces[trained]]
    # faces that a camera could see, by their area
    visible = _surface(mesh, trained) > 1e-12 * float(mesh.size_mm.max()) ** 2
    covered = cover_texels(uv[visible | (_uv_area(uv) > 0)], n)
    # grey until a texture is applied
    sheet = np.full((n, n, 3), GROUND, np.uint8)
    return Atlas(_share_sheet(mesh, trained, sheet), trained, covered, nearest_covered(covered), bool(unwrapped))


def apply_texture(atlas: Atlas, texture: np.ndarray) -> Mesh:
    """Return the mesh with a texture on its trained faces.

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
    # only materials of trained faces wear the texture
    worn = set(np.unique(atlas.mesh.face_material[atlas.trained]).tolist())
    materials = (replace(m, texture=sheet) if i in worn else m for i, m in enumerate(atlas.mesh.materials))
    return replace(atlas.mesh, materials=tuple(materials))


def lay_picture(mesh: Mesh, pixels: np.ndarray, keep: Sequence[str] = ()) -> Mesh:
    """Return the mesh with a picture in its own texture coordinates, in place of its paint.

    Args:
        mesh: the object.
        pixels: (h, w, 3) uint8, sRGB-encoded, row 0 at v = 1.
        keep: names of materials that keep their paint.

    Raises:
        ToolkitError: its coordinates carry no single picture, or as `choose_kept`.
    """
    # where the picture goes
    worn = ~choose_kept(mesh, keep)
    if not _own_uv_serve(mesh, worn):
        raise ToolkitError(
            "its texture coordinates are missing, leave the picture, or belong to several pictures: keep the paint of "
            "the other materials, or use the picture as a pattern on the pieces"
        )
    return _share_sheet(mesh, worn, pixels)


def take_paint(atlas: Atlas, mesh: Mesh) -> np.ndarray:
    """Return the object's own paint as a texture of an atlas: the mean light in each texel.

    Args:
        atlas: the object made ready.
        mesh: mesh for `make_atlas`, with the atlas' triangles in their order.

    Returns:
        (n, n, 3) uint8, sRGB-encoded, row 0 at v = 1; uncovered texels have the colour of the nearest covered texel.
    """
    n, material = atlas.n, mesh.face_material
    worn = [mesh.materials[k].texture.reshape(-1, 3) for k in np.unique(material[atlas.trained])]
    if worn and all((texels == worn[0][0]).all() for texels in worn):  # the same colour everywhere
        return np.tile(worn[0][0], (n, n, 1))
    light, hits = np.zeros((n * n, 3)), np.zeros(n * n)
    own_uv = mesh.uv[mesh.faces].astype(np.float64)
    sheet_uv = atlas.corner_uv.astype(np.float64)
    # the longest side of each triangle on the sheet decides how finely it is sampled
    sides = n * np.linalg.norm(sheet_uv - np.roll(sheet_uv, 1, axis=1), axis=2).max(axis=1)
    # a texel's colour is the mean of light, not of code values, weighted by the area that each triangle has in it
    area = np.maximum(_uv_area(n * sheet_uv), ROUNDING_PX)
    # rounded to powers of two, so that there are few groups to go through
    parts = np.clip(2 ** np.ceil(np.log2(PAINT_SAMPLES * np.maximum(sides, 1))), 1, MOST_PARTS).astype(np.int64)
    for steps in np.unique(parts[atlas.trained]):
        weights = _middles(int(steps))
        faces = np.flatnonzero(atlas.trained & (parts == steps))
        # some samples at a time, to bound memory
        for some in np.array_split(faces, -(-len(faces) * len(weights) // SAMPLES_AT_ONCE)):
            row, column = _texel_at(_weigh_corners(weights, sheet_uv[some]), n, n)
            texel = row * n + column
            seen = _weigh_corners(weights, own_uv[some])
            weight = np.repeat(area[some] / len(weights), len(weights))
            colour = _look_up(mesh, some, seen)
            for channel in range(3):
                light[:, channel] += np.bincount(texel.ravel(), weight * colour[..., channel].ravel(), n * n)
            hits += np.bincount(texel.ravel(), weight, n * n)
    found = hits.reshape(n, n) > 0
    mean = light / np.where(hits, hits, 1)[:, None]
    return np.round(linear_to_srgb(mean[nearest_covered(found)]) * 255).astype(np.uint8)


def look_up_paint(mesh: Mesh, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(k, 3) linear light of an object's own paint in (k,) faces, at (k, 3) weights of their corners."""
    return _look_up(mesh, faces, np.einsum("kc,kci->ki", weights, mesh.uv[mesh.faces[faces]].astype(np.float64)))


def _look_up(mesh: Mesh, faces: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(k, ..., 3) linear light at (k, ..., 2) texture coordinates in (k,) faces."""
    colour = np.empty((*uv.shape[:-1], 3))
    for k in np.unique(mesh.face_material[faces]):
        of_it, texture = mesh.face_material[faces] == k, mesh.materials[k].texture
        colour[of_it] = LINEAR_OF_CODE[texture[_texel_at(uv[of_it], *texture.shape[:2])]]
    return colour


def _weigh_corners(weights: np.ndarray, corner_uv: np.ndarray) -> np.ndarray:
    """(f, s, 2) places at barycentric weights (s, 3) of triangles (f, 3, 2)."""
    # corner by corner: several times as fast as einsum, and the same to the last bit
    a, b, c = (np.moveaxis(corner_uv[:, k], 1, 0)[..., None] * weights[:, k] for k in range(3))
    a += b
    a += c
    return np.moveaxis(a, 0, -1)


def dilate(texture: np.ndarray, atlas: Atlas) -> np.ndarray:
    """Fill the uncovered texels of a texture (n, n, …) with the colour of the nearest covered texel."""
    return texture.reshape(atlas.n * atlas.n, *texture.shape[2:])[atlas.source]


def _own_uv_serve(mesh: Mesh, trained: np.ndarray) -> bool:
    """Whether the mesh's own texture coordinates can carry a texture on the trained faces."""
    worn = [mesh.materials[i] for i in np.unique(mesh.face_material[trained])]
    if any(material.name == COLOURS for material in worn):
        return False
    sheets = {(material.texture.shape, material.texture.tobytes()) for material in worn}
    uv = mesh.uv[mesh.faces[trained]]
    if len(sheets) > 1 or not np.isfinite(uv).all() or uv.min() < -UV_ROUNDING or uv.max() > 1 + UV_ROUNDING:
        return False
    # a little of the surface without area on the texture may stay grey
    area = _surface(mesh, trained)
    return float(area[_uv_area(uv) <= 0].sum()) <= WITHOUT_UV * float(area.sum())


def _check_own_uv(mesh: Mesh, trained: np.ndarray) -> None:
    uv = mesh.uv[mesh.faces[trained]]
    if not np.isfinite(uv).all() or not (_uv_area(uv) > 0).any():
        raise ToolkitError("the mesh has no texture coordinates: let new coordinates be made")
    if np.ptp(uv.reshape(-1, 2), axis=0).max() > MOST_REPEATS:
        raise ToolkitError(
            f"the mesh's texture coordinates, from {uv.min():.3g} to {uv.max():.3g}, repeat the texture too often: "
            "let new coordinates be made"
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
    area = flat_areas(corner_uv)
    return np.where(area > 1e-13, area, 0)


def _surface(mesh: Mesh, chosen: np.ndarray) -> np.ndarray:
    """Area of each chosen face in mm²."""
    return np.linalg.norm(cross_products(mesh.vertices[mesh.faces[chosen]]), axis=1) / 2


def split_vertices(mesh: Mesh, corner_uv: np.ndarray) -> Mesh:
    """Return the mesh with other texture coordinates; vertices whose faces differ in them are doubled."""
    # a vertex and its coordinates, to the bit, name a new vertex
    index = mesh.faces.reshape(-1).astype(np.int64)
    bits = np.ascontiguousarray(corner_uv, np.float32).reshape(-1, 2).view(np.int32)
    first, inverse = group_rows([index, *bits.T])
    origin = index[first]
    return replace(
        mesh, vertices=mesh.vertices[origin], normals=mesh.normals[origin],
        uv=corner_uv.reshape(-1, 2)[first].astype(np.float32), faces=inverse.reshape(-1, 3).astype(np.int32),
    )  # fmt: skip


def _share_sheet(mesh: Mesh, trained: np.ndarray, sheet: np.ndarray) -> Mesh:
    """Give all trained faces the same texture array; a material of both sorts of faces becomes two."""
    materials: list[Material] = []
    face_material = np.zeros(len(mesh.faces), np.int32)
    for index, material in enumerate(mesh.materials):
        of_it = mesh.face_material == index
        # no metal: its gloss would have the texture's colour, which no linear view can hold
        looks = (material, replace(material, texture=sheet, metallic=0.0))
        for look, part in zip(looks, (of_it & ~trained, of_it & trained), strict=True):
            if part.any():
                face_material[part] = len(materials)
                materials.append(look)
    return replace(mesh, face_material=face_material, materials=tuple(materials))
