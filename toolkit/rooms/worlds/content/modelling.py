"""The modelling kit: curves and solids become parts, parts get paint, painted parts become one mesh with one atlas.

Frame: millimetres, x forward (the object's front), y left, z up. Each part carries a chart, a flat rectangle in
millimetres, so that paint is drawn at true scale and no two triangles share a texel.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TypeVar

import numpy as np
from PIL import Image

from toolkit.objects.mesh import Material, Mesh, mesh_from_corners, place_on_table
from toolkit.rooms.worlds.content.drawing import Colour, Paint, pattern, rgb

Path = Sequence[Sequence[float] | np.ndarray] | np.ndarray
"""Points (x, y, z) along a line."""
LENGTH_MM = 270.0
"""Longest side of every thing."""
SEGMENTS = 32
MATERIALS = {
    "paint": (0.3, 0.0), "plastic": (0.4, 0.0), "ceramic": (0.15, 0.0), "glass": (0.08, 0.0), "metal": (0.32, 0.75),
    "wood": (0.55, 0.0), "rubber": (0.85, 0.0), "paper": (0.8, 0.0), "cloth": (0.9, 0.0), "matte": (0.7, 0.0),
}  # fmt: skip
"""Name -> (roughness, metallic)."""


Group = TypeVar("Group", bound="PartGroup")


class PartGroup(ABC, Iterable["Part"]):
    """Parts that are moved together; a part is a group of its own."""

    @abstractmethod
    def each(self: Group, change: Callable[["Part"], "Part"]) -> Group:
        """The same with every part changed."""

    def painted(self: Group, paint: Paint, material: str | None = None) -> Group:
        """The same surface with other paint, and another material if named."""
        return self.each(lambda part: replace(part, paint=paint, material=material or part.material))

    def bent(self: Group, move: Callable[[np.ndarray], np.ndarray]) -> Group:
        """With the vertices (n, 3) of each part replaced by what `move` makes of them."""
        return self.each(lambda part: replace(part, vertices=move(part.vertices)))

    def moved(self: Group, x: float = 0, y: float = 0, z: float = 0) -> Group:
        """Translated by millimetres."""
        return self.bent(lambda vertices: vertices + np.array([x, y, z]))

    def rotated(self: Group, axis: str, degrees: float) -> Group:
        """Turned about the x, y or z axis through the origin, counter-clockwise seen from the axis' tip."""
        i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        rotation = np.eye(3)
        rotation[[i, i, j, j], [i, j, i, j]] = cosine, -sine, sine, cosine
        return self.bent(lambda vertices: vertices @ rotation.T)

    def scaled(self: Group, x: float = 1, y: float = 1, z: float = 1) -> Group:
        """Stretched along the axes by positive factors."""
        return self.bent(lambda vertices: vertices * np.array([x, y, z]))

    def flipped(self: Group) -> Group:
        """With inside and outside exchanged."""
        return self.each(lambda part: replace(part, faces=part.faces[:, ::-1], corner_uv=part.corner_uv[:, ::-1]))

    def mirrored(self: Group, axis: str = "y") -> Group:
        """Reflected through the plane across an axis; the winding is turned so that outside stays outside."""
        flip = np.ones(3)
        flip["xyz".index(axis)] = -1
        return self.bent(lambda vertices: vertices * flip).flipped()

    def both_sides(self) -> "Parts":
        """The parts and their mirror image across the x-z plane."""
        return Parts(self, self.mirrored())

    def outward(self: Group) -> Group:
        """Turned as a closed group so that it encloses a positive volume."""
        corners = [part.vertices[part.faces] for part in self]
        # six times the signed volume: a sum of tetrahedra from the origin (divergence theorem)
        volume = sum(np.einsum("ij,ij->", c[:, 0], np.cross(c[:, 1], c[:, 2])) for c in corners)
        return self if volume > 0 else self.flipped()


@dataclass(frozen=True)
class Part(PartGroup):
    """A piece of surface with its chart."""

    vertices: np.ndarray  # (n, 3) millimetres
    faces: np.ndarray  # (m, 3), counter-clockwise from outside
    corner_uv: np.ndarray  # (m, 3, 2) position of each corner on the chart, millimetres
    chart_mm: tuple[float, float]  # (width, height) of the chart
    paint: Paint = (200, 200, 200)  # what the chart shows
    material: str = "paint"  # name of the part's material

    def each(self, change: Callable[["Part"], "Part"]) -> "Part":
        """The part changed."""
        return change(self)

    def __iter__(self) -> Iterator["Part"]:
        yield self


class Parts(list[Part], PartGroup):
    """Several parts, in order; made from parts and groups of parts."""

    def __init__(self, *groups: Iterable[Part]) -> None:
        super().__init__(chain.from_iterable(groups))

    def each(self, change: Callable[[Part], Part]) -> "Parts":
        """Every part changed."""
        return Parts(map(change, self))


def surface(net: np.ndarray | Sequence[np.ndarray], paint: Paint = (200, 200, 200), material: str = "paint") -> Part:
    """A part from a (rows, columns, 3) net of points; the chart unrolls it by mean arc length.

    Outside is where (along columns) × (along rows) points. u runs along the columns, v along the rows. For a closed
    net repeat the first row or column at the end.
    """
    points = np.asarray(net, float)
    rows, columns = points.shape[:2]
    # means over all rows and columns: paint is stretched where a row is longer than the mean, as on a globe
    along_u = np.linalg.norm(np.diff(points, axis=1), axis=2).mean(axis=0)
    along_v = np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)
    u, v = np.r_[0, np.cumsum(along_u)], np.r_[0, np.cumsum(along_v)]
    uv = np.stack(np.broadcast_arrays(u[None, :], v[:, None]), axis=-1).reshape(-1, 2)
    # two triangles for each cell of the net
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    vertices = points.reshape(-1, 3)
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
) -> Parts:
    """Skin a row of closed sections, each (k, 3) with the first point not repeated, and cap both ends.

    Sections run counter-clockwise seen from beyond the last section (looking back along the loft).
    """
    net = np.stack([np.concatenate([section, section[:1]]) for section in sections])
    parts = Parts(surface(net, paint, material))
    if cap:
        parts += fan(np.asarray(sections[-1]), paint, material)
        parts += fan(np.asarray(sections[0])[::-1], paint, material)
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
) -> Parts:  # fmt: skip
    """Raise a flat (x, y) outline, counter-clockwise from above, from z = 0 to `height`, its edges cut by `bevel`."""
    outer = np.asarray(outline, float)
    inner = _inset(outer, bevel) if bevel > 0 else outer
    levels = [(inner, 0.0), (outer, bevel), (outer, height - bevel), (inner, height)]
    if bevel <= 0:
        levels = levels[1:3]
    rings = [np.c_[ring, np.full(len(ring), z)] for ring, z in levels]
    wall = surface(np.stack([np.concatenate([ring, ring[:1]]) for ring in rings]), paint, material)
    return Parts(wall, plate(rings[-1], paint, material), plate(rings[0][::-1], paint, material))


def box(
    size: tuple[float, float, float], bevel: float = 0.0, paint: Paint = (200, 200, 200), material: str = "paint"
) -> Parts:
    """A box centred on the origin with bevelled edges."""
    x, y, z = size
    outline = [(-x / 2, -y / 2), (x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2)]
    if bevel > 0:
        outline = [
            (-x / 2 + bevel, -y / 2), (x / 2 - bevel, -y / 2), (x / 2, -y / 2 + bevel), (x / 2, y / 2 - bevel),
            (x / 2 - bevel, y / 2), (-x / 2 + bevel, y / 2), (-x / 2, y / 2 - bevel), (-x / 2, -y / 2 + bevel),
        ]  # fmt: skip
    return extrude(outline, z, bevel, paint, material).moved(z=-z / 2)


def tube(
    path: np.ndarray, radius: float | Sequence[float] | np.ndarray, segments: int = 24, paint: Paint = (200, 200, 200),
    material: str = "paint", flatten: float = 1.0, cap: bool = True,
) -> Parts:  # fmt: skip
    """A pipe along a path (k, 3) with a radius per point; `flatten` squeezes it across the path's plane."""
    path = np.asarray(path, float)
    radii = np.broadcast_to(np.asarray(radius, float), (len(path),))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # any direction across the path will do to start with
    side = plane_axes(tangent[0])[0]
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    sections = []
    for point, forward, r in zip(path, tangent, radii, strict=True):  # a frame carried along without twist
        # the old side, its part along the path taken out: the frame that turns least
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
    across, up = bend_circle(angle, power)
    return np.stack([np.full(count, float(x)), y + across * width / 2, z + up * height / 2], axis=1)


def bend_circle(angle: np.ndarray, power: float) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of angles, drawn out towards the corners of a superellipse."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.sign(cosine) * np.abs(cosine) ** (2 / power), np.sign(sine) * np.abs(sine) ** (2 / power)


def curve(knots: Sequence[tuple[float, ...]]) -> Callable[[float | np.ndarray], np.ndarray]:
    """A smooth function of x through knots (x, value, …): monotone cubics."""
    from scipy.interpolate import PchipInterpolator

    table = np.array(sorted(knots), float)
    return PchipInterpolator(table[:, 0], table[:, 1:])


def smooth_curve(points: Sequence[Sequence[float]], count: int, monotone: bool = True) -> np.ndarray:
    """`count` points on a smooth curve through the given ones: a cubic per axis over chord length, monotone or not."""
    from scipy.interpolate import CubicSpline, PchipInterpolator

    given = np.asarray(points, float)
    chord = np.r_[0, np.cumsum(np.linalg.norm(np.diff(given, axis=0), axis=1))]
    return (PchipInterpolator if monotone else CubicSpline)(chord, given)(np.linspace(0, chord[-1], count))


def plane_axes(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that span the plane across `normal`, right-handed with it, the second as far up as it can be."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    hint = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.95 else np.array([0.0, 1.0, 0.0])
    first = np.cross(hint, normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def assemble(parts: Sequence[Part], materials: dict[str, tuple[float, float]], atlas_px: int = 1024) -> Mesh:
    """Pack the charts of all parts into one square atlas, paint it, and merge the parts into one mesh.

    `materials` are name -> (roughness, metallic), `atlas_px` the side of the texture.
    Charts share a scale, so that a texel has the same size everywhere, and a gutter of painted margin keeps
    filtered look-ups from bleeding.
    """
    # a part without faces takes no room
    parts = [part for part in parts if len(part.faces)]
    px_per_mm, places = _pack([part.chart_mm for part in parts], atlas_px)
    atlas = Image.new("RGB", (atlas_px, atlas_px), (128, 128, 128))
    names = list(materials)
    vertices, faces, corner_uv, face_material, start = [], [], [], [], 0
    for part, (left, top) in zip(parts, places, strict=True):
        width, height = (max(1, round(side * px_per_mm)) for side in part.chart_mm)
        # a chart's rim is repeated around it: blurred look-ups at its edge mix in nothing foreign
        chart = np.asarray(_render_paint(part.paint, width, height, px_per_mm))
        padded = np.pad(chart, ((GUTTER_PX, GUTTER_PX), (GUTTER_PX, GUTTER_PX), (0, 0)), mode="edge")
        atlas.paste(Image.fromarray(padded), (left - GUTTER_PX, top - GUTTER_PX))
        # from millimetres on the chart to texels of the atlas, rows from the top
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
    # `toolkit.objects.polygons` cuts other ears of some outlines: the meshes' hashes would change
    def cross(o: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
        return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])

    left, triangles = list(range(len(polygon))), []
    while len(left) > 3:
        # an ear is a convex corner whose triangle holds no other corner; a simple polygon has at least two (Meisters)
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
    # along the bisector of both edges: 2 / |n1 + n2|² keeps the distance from each, 0.5 bounds it
    middle = normals[0] + normals[1]
    return outline + distance * 2 * middle / np.maximum((middle**2).sum(axis=1, keepdims=True), 0.5)


def _render_paint(paint: Paint, width: int, height: int, px_per_mm: float) -> Image.Image:
    if not callable(paint):
        return Image.new("RGB", (width, height), paint)
    image = paint(width, height, px_per_mm).convert("RGB")
    return image if image.size == (width, height) else image.resize((width, height), Image.Resampling.LANCZOS)


def _pack(charts_mm: list[tuple[float, float]], atlas_px: int) -> tuple[float, list[tuple[int, int]]]:
    """The largest common scale at which shelves of charts, tallest first, fill the atlas; and each chart's left top."""

    # shelves as in a library: charts side by side, the tallest first
    def shelves(scale: float) -> list[tuple[int, int]] | None:
        sizes = [
            (max(1, round(w * scale)) + 2 * GUTTER_PX, max(1, round(h * scale)) + 2 * GUTTER_PX) for w, h in charts_mm
        ]
        places: list[tuple[int, int]] = [(0, 0)] * len(sizes)
        x = y = shelf = 0
        # a chart that is too wide for the rest of the shelf begins a new shelf above the tallest
        for i in sorted(range(len(sizes)), key=lambda k: -sizes[k][1]):
            width, height = sizes[i]
            if x + width > atlas_px:
                x, y, shelf = 0, y + shelf, 0
            if width > atlas_px or y + height > atlas_px:
                return None
            places[i] = (x + GUTTER_PX, y + GUTTER_PX)
            x, shelf = x + width, max(shelf, height)
        return places

    # the scale is texels per millimetre
    low, high = 1e-4, atlas_px / max(max(chart) for chart in charts_mm)
    best = shelves(low)
    # bisection: packing has no formula, but a smaller scale never fits worse
    for _ in range(30):
        middle = (low + high) / 2
        if (found := shelves(middle)) is None:
            high = middle
        else:
            low, best = middle, found
    if best is None:
        raise ValueError(f"{len(charts_mm)} charts do not fit an atlas of {atlas_px} px")
    return low, best


def finish(parts: Iterable[Part], atlas_px: int = 256) -> Mesh:
    """A mesh from parts, `LENGTH_MM` long, on the table, centred.

    Parts of the same plain colour share a speck of the atlas, which leaves it to those that are painted.
    """
    painted: list[Part] = []
    plain: dict[tuple[Paint, str], list[Part]] = {}
    # painted parts keep their charts, plain ones are gathered by colour and material
    for part in parts:
        if callable(part.paint):
            painted.append(part)
        elif len(part.faces):
            plain.setdefault((part.paint, part.material), []).append(part)
    used = {part.material for part in painted} | {material for _, material in plain}
    materials = {name: MATERIALS[name] for name in MATERIALS if name in used}
    # a plain colour's chart is a speck beside the painted ones
    side = 0.02 * max([sum(part.chart_mm) for part in painted], default=1.0)
    merged = [_merge_plain(group, side) for group in plain.values()]
    return place_on_table(assemble(painted + merged, materials, atlas_px), LENGTH_MM)


def _merge_plain(parts: list[Part], side: float) -> Part:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    uv = np.concatenate([part.corner_uv / np.array(part.chart_mm) for part in parts])
    vertices = np.concatenate([part.vertices for part in parts])
    return Part(vertices, faces, uv * side, (side, side), parts[0].paint, parts[0].material)


def lathe(
    points: Sequence[tuple[float, float]], paint: Paint, material: str = "ceramic", count: int = 20,
    segments: int = SEGMENTS,
) -> Part:  # fmt: skip
    """A turned surface through (radius, z) points, smoothed, from bottom to top."""
    return revolve(smooth_curve(points, count).tolist(), segments, paint, material)


def vessel(
    outline: np.ndarray, wall: float, outside: Paint, inside: Paint, material: str = "ceramic",
    segments: int = SEGMENTS, floor: float | None = None, content: tuple[float, Paint, str] | None = None,
) -> Parts:  # fmt: skip
    """A hollow vessel: its outline (n, 2) of (radius, z) from the foot to the rim, a round rim and the inside.

    `floor` is the height of the inner bottom, by default the wall's thickness. `content` is its filling: (height as a
    share of the inside, paint, material).
    """
    # as heights above the table
    bottom = outline[0, 1] + wall if floor is None else floor
    level = bottom if content is None else bottom + content[0] * (outline[-1, 1] - bottom)
    inner = np.maximum(outline - [wall, 0], [0.05, 0])
    at_level = np.interp(level, inner[:, 1], inner[:, 0])
    # the rim is a half circle over the wall
    turn = np.linspace(0.25, 0.75, 3) * np.pi
    middle = outline[-1] - [wall / 2, 0]
    rim = middle + wall / 2 * np.stack([np.cos(turn), np.sin(turn)], 1)
    # from the outer edge of the rim over it and down to the filling
    down = [outline[-1], *rim, *inner[inner[:, 1] > level][::-1], (at_level, level)]
    paint, top_material = (inside, material) if content is None else content[1:]
    # underside, outside, rim with inside, and what fills it or its bottom
    return Parts(
        revolve([(0, outline[0, 1]), tuple(outline[0])], segments, _foot_colour(outside), material),
        revolve(outline.tolist(), segments, outside, material),
        revolve(np.array(down).tolist(), segments, inside, material),
        disc(at_level, level, paint, top_material, segments),
    )


def _foot_colour(paint: Paint) -> Colour:
    if not callable(paint):
        return paint
    return rgb(np.asarray(paint(8, 8, 1.0).convert("RGB"))[-1, 4])


def disc(radius: float, z: float, paint: Paint, material: str = "plastic", segments: int = SEGMENTS) -> Part:
    """A flat disc that faces up."""
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    return fan(np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(segments, z)], 1), paint, material)


def cylinder(
    radius: float, low: float, high: float, paint: Paint, material: str = "plastic", segments: int = 24,
    top_radius: float | None = None, bevel: float = 0.0,
) -> Parts:  # fmt: skip
    """A closed cylinder or cone about z."""
    top = radius if top_radius is None else top_radius
    wall = [(radius, low), (top, high)]
    if bevel > 0:
        wall = [(radius - bevel, low), (radius, low + bevel), (top, high - bevel), (top - bevel, high)]
    upper = disc(wall[-1][0], high, _foot_colour(paint), material, segments)
    lower = disc(wall[0][0], -low, _foot_colour(paint), material, segments).rotated("x", 180)
    return Parts(revolve(wall, segments, paint, material), upper, lower)


def ball(
    radius: float, paint: Paint, material: str = "plastic", segments: int = 24, rows: int = 12,
    size: tuple[float, float, float] = (1, 1, 1),
) -> Part:  # fmt: skip
    """A ball about the origin, or an ellipsoid by its `size` along the axes."""
    tilt = np.linspace(-np.pi / 2, np.pi / 2, rows + 1)
    profile = np.stack([radius * np.cos(tilt).clip(0), radius * np.sin(tilt)], 1).tolist()
    return revolve(profile, segments, paint, material).scaled(*size)


def rod(
    points: Path, radius: float | Sequence[float], paint: Paint, material: str = "plastic", count: int = 16,
    segments: int = 10, flatten: float = 1.0,
) -> Parts:  # fmt: skip
    """A bent rod through points; with several radii they are spread along it."""
    path = smooth_curve(np.asarray(points, float).tolist(), count) if len(points) > 2 else np.asarray(points, float)
    radii = np.interp(np.linspace(0, 1, len(path)), np.linspace(0, 1, np.size(radius)), np.atleast_1d(radius))
    return tube(path, radii, segments, paint, material, flatten)


def arc(
    centre: tuple[float, float], radius: tuple[float, float], from_deg: float, to_deg: float, count: int = 14
) -> list[tuple[float, float, float]]:
    """Points (x, 0, z) on an ellipse's arc in the x-z plane."""
    turn = np.radians(np.linspace(from_deg, to_deg, count))
    return [(centre[0] + radius[0] * np.cos(a), 0.0, centre[1] + radius[1] * np.sin(a)) for a in turn]


def seen_from_above(part: Part) -> Part:
    """With a chart that is the view from above, which leaves specks of a lid or a drink round."""
    flat = part.vertices[:, :2] - part.vertices[:, :2].min(axis=0)
    width, depth = flat.max(axis=0)
    return replace(part, corner_uv=flat[part.faces], chart_mm=(float(width), float(depth)))


def block(
    size: tuple[float, float, float], at: tuple[float, float, float], paint: Paint, material: str = "plastic",
    bevel: float = 0.0,
) -> Parts:  # fmt: skip
    """A box with its centre at a place."""
    return box(size, bevel, paint, material).moved(*at)


def slab(
    outline: Sequence[tuple[float, float]], thickness: float, paint: Paint, material: str = "plastic", y: float = 0.0,
    bevel: float = 0.0,
) -> Parts:  # fmt: skip
    """A plate from an (x, z) outline, counter-clockwise with x to the right and z up; `y` is its middle."""
    return extrude(outline, thickness, bevel, paint, material).rotated("x", 90).moved(y=y + thickness / 2)


def hull(
    stations: Sequence[Sequence[float]], paint: Paint, material: str = "paint", count: int = 20, around: int = 24
) -> Parts:
    """A body along x from stations (x, width, height, middle z, power of the section), smoothed."""
    # stations alone would show as creases
    curve = smooth_curve(stations, count) if count > len(stations) else np.asarray(stations, float)
    sections = [superellipse(w, h, power, around, x, 0, z) for x, w, h, z, power in curve]
    return loft(sections, paint, material).outward()


def wing(
    root: tuple[float, float, float], tip: tuple[float, float, float], chords: tuple[float, float], thickness: float,
    paint: Paint, material: str = "paint", upright: bool = False,
) -> Parts:  # fmt: skip
    """A tapering wing between the leading edges `root` and `tip`; chords reach to -x. An upright wing is a fin."""
    # an aerofoil of seven points: share of the chord behind the leading edge, share of the thickness
    shape = np.array([(0, 0), (-0.12, 0.45), (-0.35, 0.5), (-1, 0.06), (-1, -0.06), (-0.35, -0.5), (-0.12, -0.45)])
    rows = []
    for edge, chord, scale in ((root, chords[0], 1.0), (tip, chords[1], 0.5)):
        across = shape[:, 1] * thickness * scale
        along = shape[:, 0] * chord
        # an upright wing is thick along y, another along z
        level = np.zeros(len(shape))
        offset = np.stack([along, across, level] if upright else [along, level, across], 1)
        rows.append(np.array(edge) + offset)
    return loft(rows, paint, material).outward()


def wheel(
    radius: float, width: float, tyre: Colour, rim: Colour, rim_share: float = 0.6, segments: int = 24, spokes: int = 0
) -> Parts:
    """A wheel about the y axis, centred, with dished faces, and spokes if any."""
    half, inner = width / 2, radius * rim_share
    round_off = min(0.25 * width, 0.2 * radius)
    profile = [(inner, -half), (radius - round_off, -half), (radius, -half + round_off)]
    profile += [(r, -z) for r, z in profile[::-1]]
    dish = [(inner, half), (inner * 0.9, half - 0.12 * width), (inner * 0.3, half - 0.12 * width)]
    dish += [(inner * 0.24, half), (0, half)]
    face = revolve(dish, segments, _paint_rim(rim, spokes), "metal" if not spokes else "paint")
    return Parts(revolve(profile, segments, tyre, "rubber"), face, face.rotated("x", 180)).rotated("x", -90)


def _paint_rim(rim: Colour, spokes: int) -> Paint:
    if not spokes:
        return rim

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        open_part = (v > 0.2) & (v < 0.62)
        return open_part & (np.abs((u * spokes) % 1 - 0.5) > 0.2)

    return pattern([rim, (28, 28, 30)], shader)


def picture(width: float, height: float, paint: Paint, material: str = "paint") -> Part:
    """A flat picture about the origin that faces +x and stands upright."""
    y, z = width / 2, height / 2
    return surface(np.array([[(0, -y, -z), (0, y, -z)], [(0, -y, z), (0, y, z)]]), paint, material)
