"""An object with its pieces on it, drawn from six sides at the same scale, and where each piece is seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from toolkit.objects.mesh import Mesh, cross_products, load_open3d, make_ray_scene
from toolkit.printing.canvas import BOLD, Pdf
from toolkit.printing.page import Rect
from toolkit.rig.mount import SIDES
from toolkit.rooms.wraps.wrap import Wrap

SIX = {**{side: SIDES[side] for side in ("front", "left", "back", "right", "top")}, "bottom": ((1, 0, 0), (0, -1, 0))}
"""Right and up of each side, seen from outside."""
LONG_SIDE_PX = 420
FINER = 2
BARE = 228.0
"""Grey of what no piece covers."""
PALER = 0.2
"""Share of white in what is on the pieces, so that numbers stand out."""
LEAST_SEEN = 0.004
"""Smallest share of a picture in which a piece gets its number; smaller pieces have it on another side."""


@dataclass(frozen=True)
class SideView:
    """An object from one side, without perspective.

    Attributes:
        side: its name.
        pixels: (h, w, 3) uint8 sRGB, white round the object.
        size_mm: size of the picture on the object.
        marks_mm: by number of a piece, the point deepest inside the part of it that is seen, from the lower left.
    """

    side: str
    pixels: np.ndarray
    size_mm: tuple[float, float]
    marks_mm: dict[int, tuple[float, float]]


def draw_sides(mesh: Mesh, wrap: Wrap) -> list[SideView]:
    """Draw an object from six sides, each piece edged and numbered on every side that shows it, at least on one.

    Args:
        mesh: the object's.
        wrap: wrap of that mesh, with its picture.
    """
    px_per_mm = LONG_SIDE_PX / float(mesh.size_mm.max())
    seen = [_look(mesh, wrap, side, px_per_mm) for side in SIX]
    # a piece that no side shows well is numbered where it is seen best
    best = {number: max(counts.get(number, 0) for _, counts in seen) for view, _ in seen for number in view.marks_mm}
    shown = []
    for view, counts in seen:
        # counts are of the fine picture, `FINER` times as large each way
        least = LEAST_SEEN * FINER**2 * view.pixels.shape[0] * view.pixels.shape[1]
        marks = {number: at for number, at in view.marks_mm.items() if counts[number] >= min(best[number], least)}
        shown.append(replace(view, marks_mm=marks))
    return shown


def _look(mesh: Mesh, wrap: Wrap, side: str, px_per_mm: float) -> tuple[SideView, dict[int, int]]:
    """A side with the marks of all pieces that it shows, and how many fine pixels show each."""
    from scipy.ndimage import distance_transform_edt, generate_binary_structure, maximum_filter, minimum_filter

    (x, y), face, weights, normal = _cast_side(mesh, side, px_per_mm)
    height, width = face.shape
    # number of the piece at each pixel: 0 without a piece, -1 beside the object
    number_of = np.zeros(len(mesh.faces), np.int64)
    for number, piece in enumerate(wrap.pieces, start=1):
        number_of[piece.faces] = number
    met = face >= 0
    shown = np.where(met, number_of[face], -1)
    picture = np.full((height, width, 3), 255.0)
    picture[met] = _shade(mesh, wrap, face[met], weights[met], shown[met] > 0, normal)
    # dark lines wherever the number changes
    cross = generate_binary_structure(2, 1)
    picture[maximum_filter(shown, footprint=cross) != minimum_filter(shown, footprint=cross)] = 30
    # a piece's number goes to the pixel that lies deepest inside it
    marks, counts = {}, {}
    for number in np.unique(shown[shown > 0]).tolist():
        part = np.pad(shown == number, 1)
        row, column = divmod(int(distance_transform_edt(part)[1:-1, 1:-1].argmax()), width)
        marks[number], counts[number] = (float(x[column]), float(y[row])), int(part.sum())
    # pixels are averaged last, which smooths edges and lines
    small = Image.fromarray(picture.astype(np.uint8)).resize((width // FINER, height // FINER), Image.Resampling.BOX)
    size_mm = (width / FINER / px_per_mm, height / FINER / px_per_mm)
    return SideView(side, np.asarray(small), size_mm, marks), counts


def _cast_side(
    mesh: Mesh, side: str, px_per_mm: float
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Cast a ray for each fine pixel, parallel to the line of sight.

    Returns:
        (w,) and (h,) places of the pixels, mm from the lower left; (h, w) face met, -1 for none; (h, w, 2) barycentric
        place on it; and (3,) the direction towards the viewer.
    """
    o3d = load_open3d()
    right, up = (np.array(axis, float) for axis in SIX[side])
    normal = np.cross(right, up)
    flat = mesh.vertices @ np.stack([right, up], axis=1)
    low, high = flat.min(axis=0) - 2 / px_per_mm, flat.max(axis=0) + 2 / px_per_mm
    # pixels finer than the picture's, from a plane just in front of the object
    width, height = (int(side) * FINER for side in np.ceil((high - low) * px_per_mm))
    x = low[0] + (np.arange(width) + 0.5) / px_per_mm / FINER
    y = low[1] + (height - np.arange(height) - 0.5) / px_per_mm / FINER
    away = float((mesh.vertices @ normal).max()) + 1.0
    start = x[None, :, None] * right + y[:, None, None] * up + away * normal
    rays = np.concatenate([start, np.broadcast_to(-normal, start.shape)], axis=-1).astype(np.float32)
    hits = make_ray_scene(mesh).cast_rays(o3d.core.Tensor(rays))
    face = np.where(np.isfinite(hits["t_hit"].numpy()), hits["primitive_ids"].numpy().astype(np.int64), -1)
    return (x - low[0], y - low[1]), face, hits["primitive_uvs"].numpy(), normal


def _shade(
    mesh: Mesh, wrap: Wrap, face: np.ndarray, weights: np.ndarray, on: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """(k, 3) colours at barycentric places (k, 2) of faces (k,), with the wrap's picture `on` its pieces, 0 to 255."""
    colour = np.full((len(face), 3), BARE)
    if wrap.pixels is not None:
        corner_uv, (u, v), n = wrap.corner_uv(len(mesh.faces))[face[on]], weights[on].T, len(wrap.pixels)
        uv = corner_uv[:, 0] * (1 - u - v)[:, None] + corner_uv[:, 1] * u[:, None] + corner_uv[:, 2] * v[:, None]
        column, row = np.clip((uv * [1, -1] + [0, 1]) * n, 0, n - 1).astype(np.int64).T
        colour[on] = (1 - PALER) * wrap.pixels[row, column] + PALER * 255
    # darker with the angle between the surface's normal and the line of sight
    cross = cross_products(mesh.vertices[mesh.faces])
    facing = np.abs(cross @ normal) / np.maximum(np.linalg.norm(cross, axis=1), 1e-20)
    return colour * (0.6 + 0.4 * facing[face])[:, None]


TITLE_MM = 4.5


def place_sides(pdf: Pdf, room: Rect, views: Sequence[SideView]) -> None:
    """Draw six sides at the same scale, each with its name and the numbers of its pieces."""
    for view, area in zip(views, _share_out(room, views), strict=True):
        pdf.raster(f"view-{view.side}", view.pixels, area)
        pdf.write(view.side, area.x + area.width / 2, area.top + 1.4, 2.9, room_mm=40, font=BOLD, align="centre")
        scale = area.width / view.size_mm[0]
        for number, (x, y) in view.marks_mm.items():
            pdf.badge(str(number), area.x + scale * x, area.y + scale * y, 1.9)


def _share_out(room: Rect, views: Sequence[SideView]) -> list[Rect]:
    """Cells for six views at the same scale: three rows of two or two of three, whichever shows them larger."""
    best: tuple[float, list[Rect]] = (0.0, [])
    for columns in (2, 3):
        rows = len(views) // columns
        # a column is as wide as its widest view, a row as high as its highest: one scale for all
        widths = [max(view.size_mm[0] for view in views[i::columns]) for i in range(columns)]
        heights = [max(view.size_mm[1] for view in views[i * columns : (i + 1) * columns]) for i in range(rows)]
        scale = min((room.width - 4 * columns) / sum(widths), (room.height - (TITLE_MM + 2) * rows) / sum(heights))
        spare_x, spare_y = room.width - scale * sum(widths), room.height - scale * sum(heights)
        cells = []
        for i in range(len(views)):
            row, column = divmod(i, columns)
            x = room.x + scale * sum(widths[:column]) + spare_x / columns * (column + 0.5)
            top = room.top - scale * sum(heights[:row]) - spare_y / rows * row
            height = scale * heights[row] + spare_y / rows
            cells.append(Rect(x, top - height, scale * widths[column], height))
        best = max(best, (scale, cells), key=lambda option: option[0])
    scale, cells = best
    return [
        Rect(cell.x + (cell.width - scale * view.size_mm[0]) / 2,
             cell.top - TITLE_MM - (cell.height - TITLE_MM - 2 + scale * view.size_mm[1]) / 2,
             scale * view.size_mm[0], scale * view.size_mm[1])
        for view, cell in zip(views, cells, strict=True)
    ]  # fmt: skip
