"""An object with its pieces on it, drawn from six sides to the scale, and where each piece is seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from toolkit.objects.mesh import Mesh, cross_products, load_open3d, make_ray_scene
from toolkit.objects.wrap import Wrap
from toolkit.printing.canvas import BOLD, Pdf
from toolkit.printing.page import Rect
from toolkit.rig.mount import SIDES

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
        size_mm: what the picture spans.
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
        wrap: of that mesh, with its picture.
    """
    px_per_mm = LONG_SIDE_PX / float(mesh.size_mm.max())
    seen = [_look(mesh, wrap, side, px_per_mm) for side in SIX]
    # a piece that no side shows well is numbered where it is seen best
    best = {number: max(counts.get(number, 0) for _, _, counts in seen) for _, marks, _ in seen for number in marks}
    return [
        SideView(
            view.side, view.pixels, view.size_mm,
            {number: mark for number, mark in marks.items() if _is_shown(counts[number], view, best[number])},
        )
        for view, marks, counts in seen
    ]  # fmt: skip


def _is_shown(count: int, view: SideView, best: int) -> bool:
    # counts are of the fine picture, `FINER` times as large each way
    return count >= min(best, LEAST_SEEN * FINER**2 * view.pixels.shape[0] * view.pixels.shape[1])


def _look(
    mesh: Mesh, wrap: Wrap, side: str, px_per_mm: float
) -> tuple[SideView, dict[int, tuple[float, float]], dict[int, int]]:
    """A side without its marks; the marks of all pieces that it shows, and of how many fine pixels."""
    o3d = load_open3d()
    from scipy.ndimage import distance_transform_edt

    # a ray for each pixel, parallel to the line of sight
    right, up = (np.array(axis, float) for axis in SIX[side])
    normal = np.cross(right, up)
    flat = mesh.vertices @ np.stack([right, up], axis=1)
    low, high = flat.min(axis=0) - 2 / px_per_mm, flat.max(axis=0) + 2 / px_per_mm
    width, height = (int(side) * FINER for side in np.ceil((high - low) * px_per_mm))
    x = low[0] + (np.arange(width) + 0.5) / px_per_mm / FINER
    y = low[1] + (height - np.arange(height) - 0.5) / px_per_mm / FINER
    away = float((mesh.vertices @ normal).max()) + 1.0
    start = x[None, :, None] * right + y[:, None, None] * up + away * normal
    rays = np.concatenate([start, np.broadcast_to(-normal, start.shape)], axis=-1).astype(np.float32)
    # the face that each ray meets, and where on it (barycentric)
    hits = make_ray_scene(mesh).cast_rays(o3d.core.Tensor(rays))
    face = hits["primitive_ids"].numpy().astype(np.int64)
    met = np.isfinite(hits["t_hit"].numpy())
    weights = hits["primitive_uvs"].numpy()[met]
    face[~met] = 0
    # number of the piece at each pixel: 0 bare, -1 beside the object
    number_of = np.zeros(len(mesh.faces), np.int64)
    for number, piece in enumerate(wrap.pieces, start=1):
        number_of[piece.faces] = number
    shown = np.where(met, number_of[face], -1)
    # colour of the wrap's picture at each pixel, a little paler
    colour = np.full((len(weights), 3), BARE)
    on = shown[met] > 0
    corner_uv = wrap.corner_uv(len(mesh.faces))[face[met][on]]
    u, v = weights[on].T
    uv = corner_uv[:, 0] * (1 - u - v)[:, None] + corner_uv[:, 1] * u[:, None] + corner_uv[:, 2] * v[:, None]
    if wrap.pixels is not None:
        n = len(wrap.pixels)
        column, row = np.clip((uv * [1, -1] + [0, 1]) * n, 0, n - 1).astype(np.int64).T
        colour[on] = (1 - PALER) * wrap.pixels[row, column] + PALER * 255
    # shade by the angle between surface and line of sight
    cross = cross_products(mesh.vertices[mesh.faces])
    facing = np.abs(cross @ normal) / np.maximum(np.linalg.norm(cross, axis=1), 1e-20)
    colour *= (0.6 + 0.4 * facing[face[met]])[:, None]
    picture = np.full((height, width, 3), 255.0)
    picture[met] = colour
    # dark lines wherever the number changes
    edge = np.zeros(met.shape, bool)
    for axis in (0, 1):
        step = np.diff(shown, axis=axis) != 0
        edge |= np.pad(step, [(0, 1), (0, 0)] if axis == 0 else [(0, 0), (0, 1)])
        edge |= np.pad(step, [(1, 0), (0, 0)] if axis == 0 else [(0, 0), (1, 0)])
    picture[edge] = 30
    # a piece's number goes to the pixel that lies deepest inside it
    marks, counts = {}, {}
    for shown_number in np.unique(shown[shown > 0]).tolist():
        part = np.pad(shown == shown_number, 1)
        depth = distance_transform_edt(part)[1:-1, 1:-1]
        deepest = divmod(int(depth.argmax()), width)
        marks[shown_number] = (float(x[deepest[1]] - low[0]), float(y[deepest[0]] - low[1]))
        counts[shown_number] = int(part.sum())
    # pixels are averaged last, which smooths edges and lines
    small = Image.fromarray(picture.astype(np.uint8)).resize((width // FINER, height // FINER), Image.Resampling.BOX)
    size_mm = (width / FINER / px_per_mm, height / FINER / px_per_mm)
    return SideView(side, np.asarray(small), size_mm, {}), marks, counts


TITLE_MM = 4.5


def place_sides(pdf: Pdf, room: Rect, views: Sequence[SideView]) -> None:
    """Draw six sides at the same scale, each with its name and the numbers of its pieces."""
    for view, cell in zip(views, _share_out(room, views), strict=True):
        _draw_view(pdf, view, cell)


def _share_out(room: Rect, views: Sequence[SideView]) -> list[Rect]:
    """Cells for six views, all of the same scale: three rows of two or two of three, whichever shows them larger."""
    best: tuple[float, list[Rect]] = (0.0, [])
    for columns in (2, 3):
        rows = len(views) // columns
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


def _draw_view(pdf: Pdf, view: SideView, area: Rect) -> None:
    pdf.raster(f"view-{view.side}", view.pixels, area)
    pdf.write(view.side, area.x + area.width / 2, area.top + 1.4, 2.9, room_mm=40, font=BOLD, align="centre")
    scale = area.width / view.size_mm[0]
    for number, (x, y) in view.marks_mm.items():
        pdf.badge(str(number), area.x + scale * x, area.y + scale * y, 1.9)
