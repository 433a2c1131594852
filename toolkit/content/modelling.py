"""A small modelling kit: curves become parts, parts get paint, painted parts become one mesh with one texture atlas.

Frame: millimetres, x forward (the object's front), y left, z up. Each part carries a chart, a flat rectangle in
millimetres, so that paint is drawn at true scale and no two triangles share a texel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from toolkit.objects.mesh import Material, Mesh, mesh_from_corners

Colour = tuple[int, int, int]
Paint = Colour | Callable[[int, int, float], Image.Image]
"""A plain sRGB colour, or a function (width_px, height_px, px_per_mm) -> RGB image of the chart, u right, v up."""


@dataclass(frozen=True)
class Part:
    """A piece of surface with its chart.

    Attributes:
        vertices: (n, 3) millimetres.
        faces: (m, 3), counter-clockwise from outside.
        corner_uv: (m, 3, 2) position of each corner on the chart, millimetres.
        chart_mm: (width, height) of the chart.
        paint: what the chart shows.
        material: name of the part's material.
    """

    vertices: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray
    chart_mm: tuple[float, float]
    paint: Paint = (200, 200, 200)
    material: str = "paint"

    def painted(self, paint: Paint, material: str | None = None) -> "Part":
        """The same surface with other paint, and another material if named."""
        return replace(self, paint=paint, material=material or self.material)

    def moved(self, x: float = 0, y: float = 0, z: float = 0) -> "Part":
        """Translated by millimetres."""
        return replace(self, vertices=self.vertices + np.array([x, y, z]))

    def rotated(self, axis: str, degrees: float) -> "Part":
        """Turned about the x, y or z axis through the origin, counter-clockwise seen from the axis' tip."""
        i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        rotation = np.eye(3)
        rotation[[i, i, j, j], [i, j, i, j]] = cosine, -sine, sine, cosine
        return replace(self, vertices=self.vertices @ rotation.T)

    def scaled(self, x: float = 1, y: float = 1, z: float = 1) -> "Part":
        """Stretched along the axes by positive factors."""
        return replace(self, vertices=self.vertices * np.array([x, y, z]))

    def mirrored(self, axis: str = "y") -> "Part":
        """Reflected through the plane across an axis; the winding is turned so that outside stays outside."""
        flip = np.ones(3)
        flip["xyz".index(axis)] = -1
        return replace(
            self, vertices=self.vertices * flip, faces=self.faces[:, ::-1], corner_uv=self.corner_uv[:, ::-1]
        )

    def flipped(self) -> "Part":
        """With inside and outside exchanged."""
        return replace(self, faces=self.faces[:, ::-1], corner_uv=self.corner_uv[:, ::-1])


def surface(points: np.ndarray, paint: Paint = (200, 200, 200), material: str = "paint") -> Part:
    """A part from a (rows, columns, 3) net of points; the chart unrolls it by mean arc length.

    Outside is where (along columns) × (along rows) points. u runs along the columns, v along the rows. For a closed
    net repeat the first row or column at the end.
    """
    rows, columns = points.shape[:2]
    along_u = np.linalg.norm(np.diff(points, axis=1), axis=2).mean(axis=0)
    along_v = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)
    u, v = np.r_[0, np.cumsum(along_u)], np.r_[0, np.cumsum(along_v)]
    uv = np.stack(np.broadcast_arrays(u[None, :], v[:, None]), axis=-1).reshape(-1, 2)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    vertices = points.reshape(-1, 3).astype(np.float64)
    triangles = vertices[faces]
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    faces = faces[area > 1e-9]  # a pole of a revolved profile has no extent
    return Part(vertices, faces, uv[faces], (max(float(u[-1]), 1e-3), max(float(v[-1]), 1e-3)), paint, material)


def revolve(
    profile: Sequence[tuple[float, float]], segments: int = 64, paint: Paint = (200, 200, 200), material: str = "paint",
    start_deg: float = 180.0,
) -> Part:  # fmt: skip
    """Turn a profile of (radius, z), listed from bottom to top for an outside surface, about the z axis.

    The chart's u = 0 lies at azimuth `start_deg`, so that with the default the chart's middle faces the front (+x).
    """
    radius, height = np.asarray(profile, float).T
    angle = np.radians(start_deg) + np.linspace(0, 2 * np.pi, segments + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.concatenate(
        [radius[:, None, None] * ring, np.broadcast_to(height[:, None, None], (len(radius), segments + 1, 1))], axis=2
    )
    return surface(points, paint, material)


def loft(
    sections: Sequence[np.ndarray], paint: Paint = (200, 200, 200), material: str = "paint", cap: bool = True
) -> list[Part]:
    """Skin a row of closed sections, each (k, 3) with the first point not repeated, and cap both ends.

    Sections run counter-clockwise seen from beyond the last one (looking back along the loft).
    """
    net = np.stack([np.concatenate([section, section[:1]]) for section in sections])
    parts = [surface(net, paint, material)]
    if cap:
        parts += [fan(np.asarray(sections[-1]), paint, material), fan(np.asarray(sections[0])[::-1], paint, material)]
    return parts


def fan(outline: np.ndarray, paint: Paint = (200, 200, 200), material: str = "paint") -> Part:
    """Fill a flat outline (k, 3) that its centroid sees whole; counter-clockwise from outside."""
    outline = np.asarray(outline, float)
    centre = outline.mean(axis=0)
    normal = np.cross(outline - centre, np.roll(outline, -1, axis=0) - centre).sum(axis=0)
    if np.linalg.norm(normal) < 1e-9:  # a section drawn together to a point or a line needs no cap
        return Part(outline[:1], np.zeros((0, 3), int), np.zeros((0, 3, 2)), (1e-3, 1e-3), paint, material)
    return _flat_part(
        np.vstack([outline, centre]),
        np.array([[i, (i + 1) % len(outline), len(outline)] for i in range(len(outline))]),
        normal, paint, material,
    )  # fmt: skip


def plate(outline: np.ndarray, paint: Paint = (200, 200, 200), material: str = "paint") -> Part:
    """Fill any simple flat outline (k, 3), concave too, by ear clipping; counter-clockwise from outside."""
    outline = np.asarray(outline, float)
    normal = np.cross(outline, np.roll(outline, -1, axis=0)).sum(axis=0)
    e1, e2 = plane_axes(normal)
    flat = np.stack([outline @ e1, outline @ e2], axis=1)
    return _flat_part(outline, _clip_ears(flat), normal, paint, material)


def extrude(
    outline: Sequence[tuple[float, float]], height: float, bevel: float = 0.0, paint: Paint = (200, 200, 200),
    material: str = "paint",
) -> list[Part]:  # fmt: skip
    """Raise a flat (x, y) outline, counter-clockwise from above, from z = 0 to `height`, its edges cut by `bevel`."""
    outer = np.asarray(outline, float)
    inner = _inset(outer, bevel) if bevel > 0 else outer
    levels = [(inner, 0.0), (outer, bevel), (outer, height - bevel), (inner, height)]
    if bevel <= 0:
        levels = levels[1:3]
    rings = [np.c_[ring, np.full(len(ring), z)] for ring, z in levels]
    wall = surface(np.stack([np.concatenate([ring, ring[:1]]) for ring in rings]), paint, material)
    return [wall, plate(rings[-1], paint, material), plate(rings[0][::-1], paint, material)]


def box(
    size: tuple[float, float, float], bevel: float = 0.0, paint: Paint = (200, 200, 200), material: str = "paint"
) -> list[Part]:
    """A box centred on the origin with bevelled edges."""
    x, y, z = size
    outline = [(-x / 2, -y / 2), (x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2)]
    if bevel > 0:
        outline = [
            (-x / 2 + bevel, -y / 2), (x / 2 - bevel, -y / 2), (x / 2, -y / 2 + bevel), (x / 2, y / 2 - bevel),
            (x / 2 - bevel, y / 2), (-x / 2 + bevel, y / 2), (-x / 2, y / 2 - bevel), (-x / 2, -y / 2 + bevel),
        ]  # fmt: skip
    return [part.moved(z=-z / 2) for part in extrude(outline, z, bevel, paint, material)]


def tube(
    path: np.ndarray, radius: float | Sequence[float] | np.ndarray, segments: int = 24, paint: Paint = (200, 200, 200),
    material: str = "paint", flatten: float = 1.0, cap: bool = True,
) -> list[Part]:  # fmt: skip
    """A pipe along a path (k, 3) with a radius per point; `flatten` squeezes it across the path's plane."""
    path = np.asarray(path, float)
    radii = np.broadcast_to(np.asarray(radius, float), (len(path),))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = plane_axes(tangent[0])[0]
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    sections = []
    for point, forward, r in zip(path, tangent, radii, strict=True):  # a frame carried along without twist
        side = side - forward * (side @ forward)
        side /= np.linalg.norm(side)
        up = np.cross(forward, side)
        sections.append(point + r * (np.cos(angle)[:, None] * side * flatten + np.sin(angle)[:, None] * up))
    return loft(sections, paint, material, cap)


def superellipse(
    width: float, height: float, power: float = 2.0, count: int = 48, x: float = 0.0, y: float = 0.0, z: float = 0.0
) -> np.ndarray:
    """A closed section (count, 3) in the y-z plane at `x`: power 2 an ellipse, 4 a rounded box; for lofts along +x."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    cosine, sine = np.cos(angle), np.sin(angle)
    horizontal = np.sign(cosine) * np.abs(cosine) ** (2 / power) * width / 2
    vertical = np.sign(sine) * np.abs(sine) ** (2 / power) * height / 2
    return np.stack([np.full(count, float(x)), y + horizontal, z + vertical], axis=1)


def smooth_curve(points: Sequence[Sequence[float]], count: int) -> np.ndarray:
    """`count` points on a smooth curve (monotone cubic per axis over chord length) through the given ones."""
    from scipy.interpolate import PchipInterpolator

    given = np.asarray(points, float)
    chord = np.r_[0, np.cumsum(np.linalg.norm(np.diff(given, axis=0), axis=1))]
    return PchipInterpolator(chord, given)(np.linspace(0, chord[-1], count))


def plane_axes(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that span the plane across `normal`, right-handed with it, the second as far up as it can be."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    hint = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.95 else np.array([0.0, 1.0, 0.0])
    first = np.cross(hint, normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def assemble(parts: Sequence[Part], materials: dict[str, tuple[float, float]], atlas_px: int = 1024) -> Mesh:
    """Pack the charts of all parts into one square atlas, paint it, and merge the parts into one mesh.

    Args:
        parts: at least one.
        materials: name -> (roughness, metallic).
        atlas_px: side of the texture.

    Charts keep one common scale, so that a texel has the same size everywhere, and a gutter of painted margin keeps
    filtered look-ups from bleeding.
    """
    parts = [part for part in parts if len(part.faces)]
    px_per_mm, places = _pack([part.chart_mm for part in parts], atlas_px)
    atlas = Image.new("RGB", (atlas_px, atlas_px), (128, 128, 128))
    names = list(materials)
    vertices, faces, corner_uv, face_material, start = [], [], [], [], 0
    for part, (left, top) in zip(parts, places, strict=True):
        width, height = (max(1, round(side * px_per_mm)) for side in part.chart_mm)
        _paste_with_gutter(atlas, _render_paint(part.paint, width, height, px_per_mm), left, top)
        scaled = part.corner_uv / np.array(part.chart_mm) * [width, height]
        corner_uv.append(np.stack([left + scaled[..., 0], atlas_px - (top + height - scaled[..., 1])], -1) / atlas_px)
        vertices.append(part.vertices)
        faces.append(part.faces + start)
        face_material.append(np.full(len(part.faces), names.index(part.material)))
        start += len(part.vertices)
    texture = np.asarray(atlas)
    return mesh_from_corners(
        np.concatenate(vertices), np.concatenate(faces), np.concatenate(corner_uv), np.concatenate(face_material),
        tuple(Material(name, texture, *materials[name]) for name in names),
    )  # fmt: skip


GUTTER_PX = 3


def _flat_part(vertices: np.ndarray, faces: np.ndarray, normal: np.ndarray, paint: Paint, material: str) -> Part:
    e1, e2 = plane_axes(normal)
    flat = np.stack([vertices @ e1, vertices @ e2], axis=1)
    flat -= flat.min(axis=0)
    width, height = np.maximum(flat.max(axis=0), 1e-3)
    return Part(vertices, faces, flat[faces], (float(width), float(height)), paint, material)


def _clip_ears(polygon: np.ndarray) -> np.ndarray:
    def cross(o: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
        return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])

    left, triangles = list(range(len(polygon))), []
    while len(left) > 3:
        for i in range(len(left)):
            a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
            pa, pb, pc = polygon[a], polygon[b], polygon[c]
            if cross(pa, pb, pc) <= 0:
                continue
            others = polygon[[k for k in left if k not in (a, b, c)]].T
            if not np.any((cross(pa, pb, others) >= 0) & (cross(pb, pc, others) >= 0) & (cross(pc, pa, others) >= 0)):
                break
        triangles.append((left[i - 1], left[i], left[(i + 1) % len(left)]))
        del left[i]
    return np.array([*triangles, tuple(left)])


def _inset(outline: np.ndarray, distance: float) -> np.ndarray:
    before = outline - np.roll(outline, 1, axis=0)
    after = np.roll(outline, -1, axis=0) - outline
    normals = [
        np.stack([-edge[:, 1], edge[:, 0]], 1) / np.linalg.norm(edge, axis=1, keepdims=True) for edge in (before, after)
    ]
    middle = normals[0] + normals[1]
    return outline + distance * 2 * middle / np.maximum((middle**2).sum(axis=1, keepdims=True), 0.5)


def _render_paint(paint: Paint, width: int, height: int, px_per_mm: float) -> Image.Image:
    if not callable(paint):
        return Image.new("RGB", (width, height), paint)
    image = paint(width, height, px_per_mm).convert("RGB")
    return image if image.size == (width, height) else image.resize((width, height), Image.Resampling.LANCZOS)


def _paste_with_gutter(atlas: Image.Image, chart: Image.Image, left: int, top: int) -> None:
    padded = np.pad(np.asarray(chart), ((GUTTER_PX, GUTTER_PX), (GUTTER_PX, GUTTER_PX), (0, 0)), mode="edge")
    atlas.paste(Image.fromarray(padded), (left - GUTTER_PX, top - GUTTER_PX))


def _pack(charts_mm: list[tuple[float, float]], atlas_px: int) -> tuple[float, list[tuple[int, int]]]:
    """The largest common scale at which shelves of charts, tallest first, fill the atlas; and each chart's left top."""

    def shelves(scale: float) -> list[tuple[int, int]] | None:
        sizes = [
            (max(1, round(w * scale)) + 2 * GUTTER_PX, max(1, round(h * scale)) + 2 * GUTTER_PX) for w, h in charts_mm
        ]
        places: list[tuple[int, int]] = [(0, 0)] * len(sizes)
        x = y = shelf = 0
        for i in sorted(range(len(sizes)), key=lambda k: -sizes[k][1]):
            width, height = sizes[i]
            if x + width > atlas_px:
                x, y, shelf = 0, y + shelf, 0
            if width > atlas_px or y + height > atlas_px:
                return None
            places[i] = (x + GUTTER_PX, y + GUTTER_PX)
            x, shelf = x + width, max(shelf, height)
        return places

    low, high = 1e-4, atlas_px / max(max(chart) for chart in charts_mm)
    best = shelves(low)
    for _ in range(30):
        middle = (low + high) / 2
        if (found := shelves(middle)) is None:
            high = middle
        else:
            low, best = middle, found
    if best is None:
        raise ValueError(f"{len(charts_mm)} charts do not fit an atlas of {atlas_px} px")
    return low, best
