"""Which flat pieces cover most of what cameras see of an object."""

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.atlas import make_atlas, take_paint
from toolkit.objects.flatten import find_pieces
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh, cast_rays, cross_products, make_ray_scene
from toolkit.objects.spec import STRETCH
from toolkit.objects.wrap import PieceRecord, Wrap, WrapRecord, lay_out
from toolkit.rig.camera import Camera
from toolkit.rig.patch_places import draw_poses
from toolkit.rig.requests import WrapConfig

LIFT_MM = 0.05


def plan_wrap(item: TableObject, config: WrapConfig | None = None, seed: int = 0) -> Wrap:
    """Find the pieces that cover most of what random cameras see of an object, and lay them on a canvas.

    Args:
        item: the object.
        config: how many pieces, of what, and how finely they are drawn.
        seed: of the cameras.

    Returns:
        The wrap, in the object's own paint.

    Raises:
        ToolkitError: no piece lies flat anywhere.
    """
    config = config or WrapConfig()
    stretch = STRETCH[config.material] if config.stretch is None else config.stretch
    seen = see_faces(item, config.views, seed)
    pieces = find_pieces(item.mesh, seen, stretch, config.pieces)
    if not pieces:
        raise ToolkitError(
            f"{item.name}: no part of it at least 12 mm wide lies flat with {stretch:.2%} of stretch: "
            "allow more stretch, or take a softer material"
        )
    texel_mm = config.texel_mm or round(float(item.mesh.size_mm.max()) / 270, 2)
    n_px, origins = lay_out([(piece.width_mm, piece.height_mm) for piece in pieces], texel_mm)
    area = np.linalg.norm(cross_products(item.mesh.vertices[item.mesh.faces]), axis=1) / 2
    faces = np.concatenate([piece.faces for piece in pieces])
    records = []
    for number, (piece, origin) in enumerate(zip(pieces, origins, strict=True), 1):
        outline = piece.outline()
        rings = [outline.exterior, *outline.interiors]
        records.append(PieceRecord(
            number=number, origin_px=(int(origin[0]), int(origin[1])), width_mm=round(piece.width_mm, 4),
            height_mm=round(piece.height_mm, 4), area_mm2=round(piece.area_mm2, 3), stretch=round(piece.stretch, 6),
            outline_mm=[[(round(x, 4), round(y, 4)) for x, y in ring.coords] for ring in rings], png_sha256="0" * 64,
        ))  # fmt: skip
    record = WrapRecord(
        name=item.name, object=item.name, mesh_sha256=item.shape_sha256, material=config.material,
        stretch_allowed=stretch, covered=round(float(seen[faces].sum() / seen.sum()), 4),
        covered_surface=round(float(area[faces].sum() / area.sum()), 4), texel_mm=texel_mm, n_px=n_px, pieces=records,
        map_sha256="0" * 64,
    )  # fmt: skip
    wrap = Wrap(record, tuple(pieces))
    return Wrap(record, tuple(pieces), draw_paint(wrap, item.mesh))


def draw_paint(wrap: Wrap, mesh: Mesh) -> np.ndarray:
    """(n, n, 3) uint8 canvas with the object's own paint on the pieces."""
    on_pieces = np.concatenate([piece.faces for piece in wrap.pieces])
    part = Mesh(mesh.vertices, mesh.normals, mesh.uv, mesh.faces[on_pieces], mesh.face_material[on_pieces],
                mesh.materials)  # fmt: skip
    atlas = make_atlas(part, wrap.record.n_px, corner_uv=wrap.corner_uv(len(mesh.faces))[on_pieces])
    return take_paint(atlas, part)


def see_faces(item: TableObject, views: int, seed: int) -> np.ndarray:
    """(m,) square pixels that random cameras see of each face, mean over the views."""
    corners = item.mesh.vertices[item.mesh.faces].astype(np.float64)
    weighted = cross_products(corners) / 2
    area = np.linalg.norm(weighted, axis=1)
    normals = weighted / np.maximum(area, 1e-12)[:, None]
    middles = corners.mean(axis=1) + LIFT_MM * normals
    scene, camera = make_ray_scene(item.mesh), Camera.from_fov(224, 224, 45.0)
    seen = np.zeros(len(corners))
    for pose in draw_poses(item, camera, views, seed):
        towards = pose.matrix()[:3, 3] - middles
        distance = np.linalg.norm(towards, axis=1)
        cosine = (normals * towards).sum(axis=1) / distance
        rows = np.flatnonzero(cosine > 0)
        rays = np.concatenate([middles[rows], towards[rows] / distance[rows, None]], axis=1)
        free = cast_rays(scene, rays) >= distance[rows]
        seen[rows] += free * area[rows] * cosine[rows] * (camera.fx / distance[rows]) ** 2
    return seen / views
