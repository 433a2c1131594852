"""A wrap stuck on its object by hand: thin sheets with a white cut edge, each a little beside its place."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.draws import Draws
from toolkit.objects.atlas import cover_texels, nearest_covered
from toolkit.objects.mesh import Material, Mesh, cross_products, group_rows, merge_meshes, signed_areas
from toolkit.rig.mount import PAPER
from toolkit.rooms.wraps.config import Misfit
from toolkit.rooms.wraps.wrap import FlatPiece, Wrap

if TYPE_CHECKING:
    from shapely import Geometry

SHEET_MM, LAYER_MM = 0.1, 0.02
"""Thickness of a sheet, and how much higher each next piece lies, so that of two that overlap the later is seen."""
EDGE_MM = 0.4
"""White at the cut: paper shows where a knife went through it."""
SHEET_MATERIAL, EDGE_MATERIAL, ROUGHNESS = "wrap", "wrap-edge", 0.75
SAME_MM = 1e-4
"""Corners of a flat piece closer than this are the same corner."""
SLIVER_MM2 = 1e-6
LIFT_LIMIT = 2.0
"""At a sharp fold a sheet stands off by so many thicknesses at most."""
IN_PLACE = np.eye(2, 3)


def draw_places(wrap: Wrap, misfit: Misfit | None, draws: Draws) -> list[np.ndarray]:
    """(2, 3) `T_flat_sheet` of each piece: where its points come to lie in its flat frame, mm.

    A piece's own depends on the draws and its number alone.
    """
    if misfit is None:
        return [IN_PLACE] * len(wrap.pieces)
    return [_draw_place(piece, misfit, draws.of(f"piece {number}")) for number, piece in enumerate(wrap.pieces, 1)]


def _draw_place(piece: FlatPiece, misfit: Misfit, rng: np.random.Generator) -> np.ndarray:
    shift = rng.uniform(-misfit.shift_mm, misfit.shift_mm, 2)
    turn = np.radians(rng.uniform(-misfit.turn_deg, misfit.turn_deg))
    factor = 1 + rng.uniform(-misfit.scale, misfit.scale)
    turned = factor * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    centre = np.array([piece.width_mm, piece.height_mm]) / 2
    return np.column_stack([turned, centre + shift - turned @ centre])


def find_canvas(wrap: Wrap, faces_count: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, n) bool texels that lie on pieces, row 0 is v = 1; and (n, n) which texel each takes its colour from.

    So filters do not mix in what lies between pieces; `toolkit.objects.atlas.Atlas` has both of a texture.
    """
    uv = wrap.corner_uv(faces_count)
    covered = cover_texels(uv[np.isfinite(uv).all(axis=(1, 2))], wrap.record.n_px)
    return covered, nearest_covered(covered)


def fill_canvas(wrap: Wrap, faces_count: int) -> np.ndarray:
    """(n, n, 3) uint8 sRGB canvas of a wrap, between its pieces the colour of the nearest."""
    assert wrap.pixels is not None, "a wrap that was read has them"
    return wrap.pixels.reshape(-1, 3)[find_canvas(wrap, faces_count)[1]]


def wear_wrap(mesh: Mesh, wrap: Wrap, pixels: np.ndarray, places: Sequence[np.ndarray]) -> Mesh:
    """The object with the pieces of a wrap on it, all of a material that comes next to last; its paint elsewhere.

    Args:
        mesh: the object that the wrap was planned for.
        pixels: (n, n, 3) uint8 sRGB canvas, row 0 is v = 1.
        places: (2, 3) `T_flat_sheet` of each piece, see `draw_places`.
    """
    printed, bare = [], []
    for number, (piece, T_flat_sheet) in enumerate(zip(wrap.pieces, places, strict=True)):
        height_mm = SHEET_MM + number * LAYER_MM
        inside, edge = lay_piece(mesh, piece, T_flat_sheet, height_mm)
        printed.append((inside, wrap.record.pieces[number].origin_px))
        bare.append(edge)
    # printed fronts share the canvas; cut edges show the white paper
    front = _join([part for part, _ in printed])
    uv = [(part.sheet_mm / wrap.record.texel_mm + origin_px) / wrap.record.n_px for part, origin_px in printed]
    white = np.full((4, 4, 3), PAPER, np.uint8)
    edges = _join(bare)
    return merge_meshes(
        [
            mesh,
            front.as_mesh(np.concatenate(uv), Material(SHEET_MATERIAL, pixels, ROUGHNESS, sheet="glued")),
            edges.as_mesh(np.zeros_like(edges.sheet_mm), Material(EDGE_MATERIAL, white, ROUGHNESS)),
        ]
    )


@dataclass(frozen=True)
class Laid:
    """Triangles of a sheet on the surface."""

    corners: np.ndarray  # (t, 3, 3) mm
    normals: np.ndarray  # (t, 3, 3) unit
    sheet_mm: np.ndarray  # (t, 3, 2) which point of the flat piece lies there, mm

    def as_mesh(self, uv: np.ndarray, material: Material) -> Mesh:
        """A mesh of a single material; `uv` (t, 3, 2) are the corners' places on it."""
        count = len(self.corners)
        # corners that agree in place, normal and canvas point become a single vertex
        columns = [
            np.round(axis * scale).astype(np.int64)
            for array, scale in ((self.corners, 1e4), (self.normals, 1e4), (uv, 1e6))
            for axis in array.reshape(-1, array.shape[-1]).T
        ]
        first, inverse = group_rows(columns) if count else (np.zeros(0, int), np.zeros(0, int))
        place, normals, on_it = (
            array.reshape(-1, array.shape[-1])[first].astype(np.float32) for array in (self.corners, self.normals, uv)
        )
        return Mesh(
            vertices=place, normals=normals, uv=on_it, faces=inverse.reshape(-1, 3).astype(np.int32),
            face_material=np.zeros(count, np.int32), materials=(material,),
        )  # fmt: skip


def _join(parts: Sequence[Laid]) -> Laid:
    names = ("corners", "normals", "sheet_mm")
    return Laid(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def lay_piece(mesh: Mesh, piece: FlatPiece, T_flat_sheet: np.ndarray, height_mm: float = SHEET_MM) -> tuple[Laid, Laid]:
    """Stick a piece on: what is printed of it, and its white edge.

    The surface is known flat, triangle by triangle; where the sheet reaches over the piece's border, the triangles
    there are continued in their planes.

    Args:
        T_flat_sheet: (2, 3) where the sheet's points come to lie in the piece's flat frame.
        height_mm: over the surface.
    """
    import shapely

    # the sheet as it lies, and its printed part without the white edge
    turned, shift = T_flat_sheet[:, :2], T_flat_sheet[:, 2]
    ground = _find_ground(mesh, piece, height_mm)
    outline = piece.outline()
    sheet = shapely.transform(outline, lambda points: points @ turned.T + shift)
    inner = sheet.buffer(-EDGE_MM, join_style="mitre")
    regions = [(ground, inner, sheet.difference(inner))]
    # a sheet stuck on askew reaches over the border
    rings = shapely.get_coordinates(outline)
    reach_mm = float(np.linalg.norm(rings @ turned.T + shift - rings, axis=1).max())
    if reach_mm > SAME_MM:
        over = sheet.difference(outline)
        regions.append((_continue_ground(ground, reach_mm), over.intersection(inner), over.difference(inner)))
    # from the surface back to points of the sheet: T_sheet_flat
    back = np.linalg.inv(turned)

    def lay(part: "_FlatSurface", region: "Geometry") -> Laid:
        cut, where = _cut(part.flat, region)
        return part.carry(cut, where, (where - shift) @ back.T)

    return (
        _join([lay(part, printed) for part, printed, _ in regions]),
        _join([lay(part, white) for part, _, white in regions]),
    )


@dataclass(frozen=True)
class _FlatSurface:
    """Triangles that a sheet may lie on: (k, 3, 2) flat, (k, 3, 3) where it lies over them, and its normals there."""

    flat: np.ndarray
    corners: np.ndarray
    normals: np.ndarray

    def carry(self, triangle: np.ndarray, flat: np.ndarray, sheet_mm: np.ndarray) -> Laid:
        """Points (t, 3, 2) of the flat frame, each in the triangle (t,), to the surface."""
        origin = self.flat[triangle, 0]
        sides = self.flat[triangle, 1:] - origin[:, None]
        # barycentric weights in the flat triangle are those on the surface
        b, c = np.moveaxis((flat - origin[:, None]) @ np.linalg.inv(sides), 2, 0)
        weights = np.stack([1 - b - c, b, c], axis=2)
        normals = weights @ self.normals[triangle]
        normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
        return Laid(weights @ self.corners[triangle], normals, sheet_mm)


def _find_ground(mesh: Mesh, piece: FlatPiece, height_mm: float) -> _FlatSurface:
    """The piece's own triangles, lifted."""
    faces = mesh.faces[piece.faces]
    corners, flat = mesh.vertices[faces].astype(np.float64), np.asarray(piece.flat_mm, np.float64)
    unit = cross_products(corners)
    unit /= np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-12)
    corner = _number_corners(flat)
    # a joined corner is lifted along the same normal for all its triangles, far enough to clear each: no crack at a
    # fold; weighted by the angles there, it does not depend on how faces are cut (Thürmer and Wüthrich 1998)
    pull = (_corner_angles(corners)[..., None] * unit[:, None]).reshape(-1, 3)
    lift: np.ndarray = np.stack([np.bincount(corner.ravel(), axis) for axis in pull.T], axis=1)
    lift /= np.maximum(np.linalg.norm(lift, axis=1, keepdims=True), 1e-12)
    cosine = np.ones(len(lift))
    solid = signed_areas(flat) > SLIVER_MM2
    np.minimum.at(cosine, corner[solid], np.einsum("kcx,kx->kc", lift[corner], unit)[solid])
    lift *= np.minimum(1 / np.maximum(cosine, 1e-6), LIFT_LIMIT)[:, None]
    return _FlatSurface(flat[solid], (corners + height_mm * lift[corner])[solid], mesh.normals[faces][solid])


def _corner_angles(corners: np.ndarray) -> np.ndarray:
    """(k, 3) radians, the angle at each corner of triangles (k, 3, 3)."""
    forth, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(forth, back), axis=2)
    return np.arctan2(across, (forth * back).sum(axis=2))


def _number_corners(flat: np.ndarray) -> np.ndarray:
    """(k, 3) the same number for corners in the same place."""
    columns = [np.round(axis / SAME_MM).astype(np.int64) for axis in flat.reshape(-1, 2).T]
    return group_rows(columns)[1].reshape(-1, 3)


def _continue_ground(ground: _FlatSurface, reach_mm: float) -> _FlatSurface:
    """A rim of `reach_mm` round the ground: a quad at each edge of its border, in the planes of the triangles there."""
    corner = _number_corners(ground.flat)
    triangle, start = np.repeat(np.arange(len(corner)), 3), np.tile(np.arange(3), len(corner))
    end = (start + 1) % 3
    first, last = corner[triangle, start].astype(np.int64), corner[triangle, end].astype(np.int64)
    count = int(corner.max()) + 1
    border = ~np.isin(first * count + last, last * count + first)  # no triangle on the other side of the edge
    triangle, start, end, first, last = (part[border] for part in (triangle, start, end, first, last))
    run = ground.flat[triangle, end] - ground.flat[triangle, start]
    outward = np.stack([run[:, 1], -run[:, 0]], axis=1) / np.linalg.norm(run, axis=1, keepdims=True)

    # each corner of the border moves out along the bisector of its edges: a mitre, cut where it is sharp
    ends = np.concatenate([first, last])
    bisector = np.zeros((count, 2))
    np.add.at(bisector, ends, np.tile(outward, (2, 1)))
    bisector /= np.maximum(np.linalg.norm(bisector, axis=1, keepdims=True), 1e-12)
    cosine = np.ones(count)
    np.minimum.at(cosine, ends, np.einsum("ex,ex->e", bisector[ends], np.tile(outward, (2, 1))))
    step = bisector * (1.5 * reach_mm / np.maximum(cosine, 0.5))[:, None]

    # on the surface it goes as far, the mean way of the planes that meet in it
    sides = ground.flat[triangle, 1:] - ground.flat[triangle, :1]
    spread = np.linalg.inv(sides) @ (ground.corners[triangle, 1:] - ground.corners[triangle, :1])
    left, _, right = np.linalg.svd(spread, full_matrices=False)
    spread = left @ right  # the nearest map that stretches nothing: thin triangles would throw the rim far out
    way, planes = np.zeros((count, 3)), np.bincount(ends, minlength=count)
    np.add.at(way, ends, np.einsum("ei,eix->ex", step[ends], np.tile(spread, (2, 1, 1))))
    way = np.divide(way, np.maximum(planes, 1)[:, None])

    def quads(at: np.ndarray, out: np.ndarray) -> np.ndarray:
        a, b = at[triangle, start], at[triangle, end]
        far_a, far_b = a + out[first], b + out[last]
        return np.concatenate([np.stack([far_a, far_b, b], 1), np.stack([far_a, b, a], 1)])

    flat = quads(ground.flat, step)
    whole = signed_areas(flat) > SLIVER_MM2  # in a narrow bay quads turn over; those beside them cover it
    still = np.zeros((count, 3))
    return _FlatSurface(flat[whole], quads(ground.corners, way)[whole], quads(ground.normals, still)[whole])


def _cut(flat: np.ndarray, region: "Geometry") -> tuple[np.ndarray, np.ndarray]:
    """The parts of flat triangles within a region: (t,) which triangle, and (t, 3, 2) counter-clockwise corners."""
    import shapely

    if not len(flat) or region.is_empty:
        return np.zeros(0, np.int64), np.zeros((0, 3, 2))
    shapely.prepare(region)
    triangles = shapely.polygons(flat)
    # triangles within the region stay whole; only those that cross its edge are clipped
    near = np.flatnonzero(shapely.intersects(region, triangles))
    within = shapely.covers(region, triangles[near])
    whole, crossing = near[within], near[~within]
    pieces = shapely.intersection(triangles[crossing], region)
    parts, of_piece = shapely.get_parts(pieces, return_index=True)
    # clipped polygons are triangulated again; points and lines that only touch the region have no area
    areal = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    small, of_part = shapely.get_parts(shapely.constrained_delaunay_triangles(parts[areal]), return_index=True)
    cut = shapely.get_coordinates(small).reshape(-1, 4, 2)[:, :3]
    # shapely gives no direction; slivers would only cost rays
    area = signed_areas(cut)
    cut = np.where((area < 0)[:, None, None], cut[:, ::-1], cut)
    solid = np.abs(area) > SLIVER_MM2
    of_triangle = crossing[of_piece[areal][of_part]]
    return np.concatenate([whole, of_triangle[solid]]), np.concatenate([flat[whole], cut[solid]])
