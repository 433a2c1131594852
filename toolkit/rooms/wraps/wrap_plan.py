"""Which flat pieces cover most of what cameras see of an object."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from toolkit.core.console import notice
from toolkit.core.errors import ToolkitError
from toolkit.core.threads import map_ahead
from toolkit.objects.atlas import make_atlas, take_paint
from toolkit.objects.limits import SIMPLER
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh, cast_rays, cross_products, make_ray_scene
from toolkit.objects.unwrap import spread
from toolkit.rig.camera import Camera
from toolkit.rig.patch_places import draw_poses
from toolkit.rig.plan import Pose
from toolkit.rooms.wraps.config import STRETCH, WrapConfig
from toolkit.rooms.wraps.cutting.flatten import Surface, lay_triangles, weld_surface
from toolkit.rooms.wraps.cutting.grow import find_pieces
from toolkit.rooms.wraps.cutting.net import FOLD_DEG as NET_FOLD_DEG
from toolkit.rooms.wraps.cutting.net import TAB_MM, name_tabs, unfold
from toolkit.rooms.wraps.cutting.seams import FOLD_DEG, find_folds, find_seams
from toolkit.rooms.wraps.cutting.trim import Limits, turn_to_fit
from toolkit.rooms.wraps.livery import draw_pattern, read_livery, read_picture
from toolkit.rooms.wraps.wrap import FlatPiece, PictureRecord, PieceRecord, Wrap, WrapRecord, fits_canvas, lay_out

LIFT_MM = 0.05
FINEST_MM = 0.1
"""Side of a texel that a printer of 300 dpi still shows."""
MOST_TRIANGLES = 1_000_000
"""More take minutes, for detail that no sheet follows."""


def plan_wrap(item: TableObject, config: WrapConfig | None = None, seed: int = 0) -> Wrap:
    """Find the pieces that cover most of what random cameras see of an object, and lay them on a canvas.

    Args:
        config: how many pieces, of what, and how finely they are drawn.

    Returns:
        The wrap, in the object's own paint or the picture that is asked for.

    Raises:
        ToolkitError: no piece lies flat anywhere, the mesh has more than `MOST_TRIANGLES`, or as `read_livery`.

    Example:
        >>> item = tk.load_object(tk.make_workspace(Path("space")).object_spec("racer"))
        >>> wrap = tk.plan_wrap(item, tk.WrapConfig(pieces=1, views=8))
        >>> len(wrap.pieces), wrap.pieces[0].stretch <= 0.03, wrap.record.covered > 0.1
        (1, True, True)
    """
    config = config or WrapConfig()
    stretch = STRETCH[config.material] if config.stretch is None else config.stretch
    if (count := len(item.mesh.faces)) > MOST_TRIANGLES:
        raise ToolkitError(f"{item.name}: {count:,} triangles, more than a wrap's {MOST_TRIANGLES:,}: {SIMPLER}")
    draw, picture = choose_paint(item, config)
    # what cameras see, and which faces a hand can reach
    seen, reached = look_at_faces(item, config.views, seed)
    if not seen.any():
        raise ToolkitError(
            f"{item.name}: no camera sees the outside of a face: its triangles are inside out, turn their normals"
        )
    # a net goes round the whole object; loose pieces go where a hand reaches
    surface = weld_surface(item.mesh)
    worth = np.where(reached | config.net, seen, 0)
    sheet_mm = _fit_sheet(item, surface, worth, config.sheet_mm, TAB_MM if config.net else 0.0)
    if config.net:
        pieces = unfold(surface, sheet_mm)
    else:
        pieces = find_pieces(item.mesh, seen, reached, Limits(stretch, sheet_mm), config.pieces)
    if not pieces:
        raise ToolkitError(
            f"{item.name}: no part of it at least 12 mm wide lies flat with {stretch:.2%} of stretch: "
            "allow more stretch, or take a softer material"
        )
    wrap = Wrap(_record_plan(item, surface, pieces, seen, config, stretch), tuple(pieces))
    changes = {} if picture is None else {"picture": picture}
    return replace(wrap, pixels=draw(wrap), record=wrap.record.model_copy(update=changes))


def choose_paint(item: TableObject, config: WrapConfig) -> tuple[Callable[[Wrap], np.ndarray], PictureRecord | None]:
    """The painter of the canvas, and the record of the picture that is asked for; raises as `read_livery`."""
    if config.picture is None:
        return lambda wrap: draw_paint(wrap, item.mesh), None
    if (long_mm := config.pattern_mm) is None:
        livery = read_livery(item, config.picture, config.keep)
        return lambda wrap: draw_paint(wrap, livery.mesh), livery.record
    pixels, record = read_picture(config.picture, "picture")
    return (
        lambda wrap: draw_pattern(wrap, item.mesh, pixels, long_mm),
        record.model_copy(update={"pattern_mm": long_mm}),
    )


def _record_plan(
    item: TableObject, surface: Surface, pieces: list[FlatPiece], seen: np.ndarray, config: WrapConfig, stretch: float
) -> WrapRecord:
    """The pieces' places on the canvas, what of the object they cover, and where they meet."""
    sizes = [(piece.width_mm, piece.height_mm) for piece in pieces]
    texel_mm = config.texel_mm or round(float(item.mesh.size_mm.max()) / 270, 2)
    if config.net and config.texel_mm is None:  # all sides at once need more room than the pieces that are seen
        while not fits_canvas(sizes, texel_mm):
            texel_mm = round(1.1 * texel_mm + 0.01, 2)
    if config.picture is not None and config.texel_mm is None:  # people's pictures are finer than what is trained
        while texel_mm > FINEST_MM and fits_canvas(sizes, finer := max(round(0.9 * texel_mm, 2), FINEST_MM)):
            texel_mm = finer
    n_px, origins = lay_out(sizes, texel_mm)
    area = np.linalg.norm(cross_products(item.mesh.vertices[item.mesh.faces]), axis=1) / 2
    faces = np.concatenate([piece.faces for piece in pieces])
    seams = find_seams(surface, pieces)
    tabs = name_tabs(surface, pieces, seams) if config.net else [[] for _ in pieces]
    least_deg = NET_FOLD_DEG if config.net else FOLD_DEG
    records = [
        _describe(surface, piece, least_deg, number=i + 1, origin_px=origins[i], seams=seams[i], tabs=tabs[i])
        for i, piece in enumerate(pieces)
    ]
    return WrapRecord(
        name=item.name, object=item.name, mesh_sha256=item.shape_sha256, material=config.material,
        stretch_allowed=stretch, covered=round(float(seen[faces].sum() / seen.sum()), 4),
        covered_surface=round(float(area[faces].sum() / area.sum()), 4), texel_mm=texel_mm, n_px=n_px, pieces=records,
        map_sha256="0" * 64,
    )  # fmt: skip


def _describe(surface: Surface, piece: FlatPiece, least_fold_deg: float, **known: Any) -> PieceRecord:
    """A piece's record, of which its number, place, seams and tabs are known."""
    outline = piece.outline()
    rings = [outline.exterior, *outline.interiors]
    folds, valleys = find_folds(surface, piece, least_fold_deg)
    return PieceRecord(
        width_mm=round(piece.width_mm, 4), height_mm=round(piece.height_mm, 4), area_mm2=round(piece.area_mm2, 3),
        stretch=round(piece.stretch, 6), folds_mm=folds, valleys_mm=valleys,
        outline_mm=[[(round(x, 4), round(y, 4)) for x, y in ring.coords] for ring in rings], png_sha256="0" * 64,
        **known,
    )  # fmt: skip


def _fit_sheet(
    item: TableObject, surface: Surface, worth: np.ndarray, sheet_mm: tuple[float, float], spare_mm: float
) -> tuple[float, float]:
    """The sheet, or a larger area for the triangles that exceed it: they are printed in tiles."""
    # triangles that no turn brings onto the sheet
    large = np.flatnonzero((surface.length.max(axis=1) + 2 * spare_mm > min(sheet_mm)) & (worth > 0))
    room = sheet_mm[0] - 2 * spare_mm, sheet_mm[1] - 2 * spare_mm
    large = large[[not turn_to_fit(sheet[None], room)[1] for sheet in lay_triangles(surface.corners[large])]]
    if not len(large):
        return sheet_mm
    # all three boxes with a side along an edge have the same area: the box that is nearest to a square
    base = surface.length[large]
    boxes = np.stack([base, 2 * surface.area[large, None] / base], axis=2)
    boxes = np.sort(boxes, axis=2)
    best = boxes[np.arange(len(large)), boxes[..., 1].argmin(axis=1)].max(axis=0) + 2 * spare_mm + 1e-3
    short, long = np.maximum(np.sort(sheet_mm), best)
    notice(
        f"{item.name}: {len(large)} triangles, {worth[large].sum() / worth.sum():.0%} of what cameras see, are larger "
        f"than the sheet of {sheet_mm[0]:g} × {sheet_mm[1]:g} mm: pieces may be up to {short:.0f} × {long:.0f} mm and "
        "are printed in tiles; to have none, split these triangles in a modelling program"
    )
    return (short, long) if sheet_mm[0] <= sheet_mm[1] else (long, short)


def draw_paint(wrap: Wrap, mesh: Mesh) -> np.ndarray:
    """(n, n, 3) uint8 canvas with the object's own paint on the pieces."""
    on_pieces = np.concatenate([piece.faces for piece in wrap.pieces])
    part = Mesh(mesh.vertices, mesh.normals, mesh.uv, mesh.faces[on_pieces], mesh.face_material[on_pieces],
                mesh.materials)  # fmt: skip
    atlas = make_atlas(part, wrap.record.n_px, corner_uv=wrap.corner_uv(len(mesh.faces))[on_pieces])
    return take_paint(atlas, part)


SAMPLES = 20_000
"""Points on the surface that are looked at, beside the middles of faces."""
DIRECTIONS = 24
FINGER_MM = 25.0
"""Room that a finger with a piece of film needs above the surface."""
LEAST_ROOM, LEAST_WAY_OUT = 0.4, 0.1
"""Shares of the directions above a place in which there must be room for a finger, and that must lead outside."""


def look_at_faces(item: TableObject, views: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(m,) square pixels that random cameras see of each face, mean over the views; (m,) bool, if a hand gets there."""
    corners = item.mesh.vertices[item.mesh.faces].astype(np.float64)
    weighted = cross_products(corners) / 2
    area = np.linalg.norm(weighted, axis=1)
    normals = weighted / np.maximum(area, 1e-12)[:, None]
    # large faces may be half hidden: they are looked at in several places
    count = np.clip(np.ceil(area / max(float(area.sum()), 1e-12) * SAMPLES), 1, 256).astype(np.int64)
    face = np.repeat(np.arange(len(area)), count)
    weights = np.where((count == 1)[face, None], 1 / 3, spread(len(face)))
    points = np.einsum("kc,kci->ki", weights, corners[face]) + LIFT_MM * normals[face]
    share = (area / count)[face]
    scene, camera = make_ray_scene(item.mesh), Camera.from_fov(224, 224, 45.0)
    seen = np.zeros(len(points))

    def look(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        towards = pose.matrix()[:3, 3] - points
        distance = np.linalg.norm(towards, axis=1)
        cosine = (normals[face] * towards).sum(axis=1) / distance
        rows = np.flatnonzero(cosine > 0)
        rays = np.concatenate([points[rows], towards[rows] / distance[rows, None]], axis=1)
        free = cast_rays(scene, rays) >= distance[rows]
        # area on the picture: area · cosine · (focal length / distance)²
        return rows, free * share[rows] * cosine[rows] * (camera.fx / distance[rows]) ** 2

    for rows, pixels in map_ahead(look, draw_poses(item, camera, views, seed)):
        seen[rows] += pixels
    # a hand: enough directions with room for a finger, and some that lead out
    room, out = np.zeros(len(points)), np.zeros(len(points))
    for direction in _spread_directions(DIRECTIONS):
        # mirrored where it would lead into the surface: as many directions everywhere
        leans = normals[face] @ direction
        ray = direction - 2 * np.minimum(leans, 0)[:, None] * normals[face]
        way = cast_rays(scene, np.concatenate([points, ray], axis=1))
        room += way > FINGER_MM
        out += np.isinf(way)
    reached = (room >= LEAST_ROOM * DIRECTIONS) & (out >= LEAST_WAY_OUT * DIRECTIONS)
    return np.bincount(face, seen, len(area)) / views, 2 * np.bincount(face, reached, len(area)) >= count


def take_best(wrap: Wrap, item: TableObject, share: float) -> Wrap:
    """A wrap's first pieces, as many as cover a share of what random cameras see; of the last its middle alone.

    Args:
        share: between 0 and 1; more than the wrap covers is all of it.

    Returns:
        The pieces, on the same canvas; `covered` of its record is what they reach.
    """
    import shapely

    seen = _see_faces(item)
    left, pieces = share * float(seen.sum()), list[FlatPiece]()
    # whole pieces, the best first, while they fit into the share
    for piece in wrap.pieces:
        worth = seen[piece.faces]
        if float(worth.sum()) <= left:
            pieces.append(piece)
            left -= float(worth.sum())
            continue
        # from the place that is farthest from its edge, evenly in all directions, to the nearest triangle
        middle = np.array(shapely.maximum_inscribed_circle(piece.outline(), 0.5).coords[0])
        order = np.argsort(np.linalg.norm(piece.flat_mm.mean(axis=1) - middle, axis=1), kind="stable")
        count = int(np.abs(np.cumsum([0.0, *worth[order]]) - left).argmin())
        rows = np.sort(order[: count if pieces else max(count, 1)])
        if len(rows):
            pieces.append(replace(piece, faces=piece.faces[rows], flat_mm=piece.flat_mm[rows]))
        break
    covered = float(seen[np.concatenate([piece.faces for piece in pieces])].sum() / seen.sum())
    record = wrap.record.model_copy(update={"pieces": wrap.record.pieces[: len(pieces)], "covered": round(covered, 4)})
    return Wrap(record, tuple(pieces), wrap.pixels)


def measure_cover(wrap: Wrap, item: TableObject, numbers: Sequence[int]) -> tuple[float, float]:
    """Shares of what random cameras see, and of the whole surface, that some of a wrap's pieces cover."""
    seen = _see_faces(item)
    area = np.linalg.norm(cross_products(item.mesh.vertices[item.mesh.faces]), axis=1)
    faces = np.concatenate([wrap.pieces[number - 1].faces for number in numbers])
    return round(float(seen[faces].sum() / seen.sum()), 4), round(float(area[faces].sum() / area.sum()), 4)


_SEEN: dict[str, np.ndarray] = {}
"""By the hash of a mesh: a sweep asks for each of its values."""


def _see_faces(item: TableObject) -> np.ndarray:
    """(m,) what the default number of random cameras sees of each face."""
    if item.shape_sha256 not in _SEEN:
        _SEEN.clear()
        _SEEN[item.shape_sha256] = look_at_faces(item, WrapConfig().views, 0)[0]
    return _SEEN[item.shape_sha256]


def _spread_directions(count: int) -> np.ndarray:
    """(count, 3) unit vectors evenly over the sphere, on a Fibonacci spiral."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    return np.stack([np.cos(angle) * np.sqrt(1 - z**2), np.sin(angle) * np.sqrt(1 - z**2), z], axis=1)
