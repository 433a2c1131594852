"""Shapes that many things share: turned bodies, hollow vessels, bent rods, wheels, legs; and the way to a mesh."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from toolkit.content.everyday.paints import pattern, rgb
from toolkit.content.modelling import (
    Colour,
    Paint,
    Part,
    assemble,
    box,
    extrude,
    fan,
    loft,
    revolve,
    smooth_curve,
    superellipse,
    surface,
    tube,
)
from toolkit.objects.mesh import Mesh, place_on_table

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
PLAIN_MM = 1.0
"""Side of the chart that all parts of one plain colour share."""


def finish(parts: Iterable[Part], atlas_px: int = 256) -> Mesh:
    """One mesh from parts, `LENGTH_MM` long, on the table, centred.

    Parts of one plain colour share a speck of the atlas, which leaves it to those that are painted.
    """
    painted: list[Part] = []
    plain: dict[tuple[Paint, str], list[Part]] = {}
    for part in parts:
        if callable(part.paint):
            painted.append(part)
        elif len(part.faces):
            plain.setdefault((part.paint, part.material), []).append(part)
    merged = [_merge_foot_colour(group) for group in plain.values()]
    used = {part.material for part in painted + merged}
    materials = {name: MATERIALS[name] for name in MATERIALS if name in used}
    return place_on_table(assemble(painted + _scaled_charts(merged, painted), materials, atlas_px), LENGTH_MM)


def _merge_foot_colour(parts: list[Part]) -> Part:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    uv = np.concatenate([part.corner_uv / np.array(part.chart_mm) for part in parts])
    return Part(
        np.concatenate([part.vertices for part in parts]),
        faces, uv * PLAIN_MM, (PLAIN_MM, PLAIN_MM), parts[0].paint, parts[0].material,
    )  # fmt: skip


def _scaled_charts(plain: list[Part], painted: list[Part]) -> list[Part]:
    """The plain parts with charts of a few texels beside those of the painted ones."""
    side = 0.02 * max([sum(part.chart_mm) for part in painted], default=1.0)
    return [replace(part, corner_uv=part.corner_uv * side, chart_mm=(side, side)) for part in plain]


def lathe(
    points: Sequence[tuple[float, float]], paint: Paint, material: str = "ceramic", count: int = 20,
    segments: int = SEGMENTS,
) -> Part:  # fmt: skip
    """A turned surface through (radius, z) points, smoothed, from bottom to top."""
    return revolve(smooth_curve(points, count).tolist(), segments, paint, material)


def vessel(
    outline: np.ndarray, wall: float, outside: Paint, inside: Paint, material: str = "ceramic",
    segments: int = SEGMENTS, floor: float | None = None, content: tuple[float, Paint, str] | None = None,
) -> list[Part]:  # fmt: skip
    """A hollow vessel: its outline (n, 2) of (radius, z) from the foot to the rim, a round rim and the inside.

    Args:
        outline: outer wall.
        wall: thickness.
        outside: paint of the wall.
        inside: paint of the inside and the rim.
        material: of all.
        segments: around.
        floor: height of the inner bottom; None: the wall's thickness above the foot.
        content: (height as a share of the inside, paint, material) of what it is filled with.
    """
    bottom = outline[0, 1] + wall if floor is None else floor
    level = bottom if content is None else bottom + content[0] * (outline[-1, 1] - bottom)
    inner = np.maximum(outline - [wall, 0], [0.05, 0])
    at_level = np.interp(level, inner[:, 1], inner[:, 0])
    turn = np.linspace(0.25, 0.75, 3) * np.pi
    middle = outline[-1] - [wall / 2, 0]
    rim = middle + wall / 2 * np.stack([np.cos(turn), np.sin(turn)], 1)
    down = [outline[-1], *rim, *inner[inner[:, 1] > level][::-1], (at_level, level)]
    paint, top_material = (inside, material) if content is None else content[1:]
    return [
        revolve([(0, outline[0, 1]), tuple(outline[0])], segments, _foot_colour(outside), material),
        revolve(outline.tolist(), segments, outside, material),
        revolve(np.array(down).tolist(), segments, inside, material),
        disc(at_level, level, paint, top_material, segments),
    ]


def _foot_colour(paint: Paint) -> Colour:
    """The colour of a paint's foot."""
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
) -> list[Part]:  # fmt: skip
    """A closed cylinder or cone about z."""
    top = radius if top_radius is None else top_radius
    wall = [(radius, low), (top, high)]
    if bevel > 0:
        wall = [(radius - bevel, low), (radius, low + bevel), (top, high - bevel), (top - bevel, high)]
    ends = [disc(wall[-1][0], high, _foot_colour(paint), material, segments)]
    ends.append(disc(wall[0][0], -low, _foot_colour(paint), material, segments).rotated("x", 180))
    return [revolve(wall, segments, paint, material), *ends]


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
) -> list[Part]:  # fmt: skip
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


def outward(parts: list[Part]) -> list[Part]:
    """Turn a closed group of parts so that it encloses a positive volume."""
    corners = [part.vertices[part.faces] for part in parts]
    volume = sum(np.einsum("ij,ij->", c[:, 0], np.cross(c[:, 1], c[:, 2])) for c in corners)
    return parts if volume > 0 else [part.flipped() for part in parts]


def moved(parts: list[Part], x: float = 0, y: float = 0, z: float = 0) -> list[Part]:
    """All parts translated."""
    return [part.moved(x, y, z) for part in parts]


def turned(parts: list[Part], axis: str, degrees: float) -> list[Part]:
    """All parts rotated about an axis through the origin."""
    return [part.rotated(axis, degrees) for part in parts]


def mirrored(parts: list[Part]) -> list[Part]:
    """The parts and their mirror image across the x-z plane."""
    return [*parts, *(part.mirrored("y") for part in parts)]


def block(
    size: tuple[float, float, float], at: tuple[float, float, float], paint: Paint, material: str = "plastic",
    bevel: float = 0.0,
) -> list[Part]:  # fmt: skip
    """A box with its centre at a place."""
    return moved(box(size, bevel, paint, material), *at)


def slab(
    outline: Sequence[tuple[float, float]], thickness: float, paint: Paint, material: str = "plastic", y: float = 0.0
) -> list[Part]:
    """A plate from an (x, z) outline, counter-clockwise with x to the right and z up; `y` is its middle."""
    return moved(turned(extrude(outline, thickness, 0, paint, material), "x", 90), y=y + thickness / 2)


def hull(
    stations: Sequence[Sequence[float]], paint: Paint, material: str = "paint", count: int = 20, around: int = 24
) -> list[Part]:
    """A body along x from stations (x, width, height, middle z, power of the section), smoothed."""
    curve = smooth_curve(stations, count) if count > len(stations) else np.asarray(stations, float)
    sections = [superellipse(w, h, power, around, x, 0, z) for x, w, h, z, power in curve]
    return outward(loft(sections, paint, material))


def wing(
    root: tuple[float, float, float], tip: tuple[float, float, float], chords: tuple[float, float], thickness: float,
    paint: Paint, material: str = "paint", upright: bool = False,
) -> list[Part]:  # fmt: skip
    """A tapering wing between the leading edges `root` and `tip`; chords reach to -x. An upright one is a fin."""
    shape = np.array([(0, 0), (-0.12, 0.45), (-0.35, 0.5), (-1, 0.06), (-1, -0.06), (-0.35, -0.5), (-0.12, -0.45)])
    rows = []
    for edge, chord, scale in ((root, chords[0], 1.0), (tip, chords[1], 0.5)):
        across = shape[:, 1] * thickness * scale
        along = shape[:, 0] * chord
        level = np.zeros(len(shape))
        offset = np.stack([along, across, level] if upright else [along, level, across], 1)
        rows.append(np.array(edge) + offset)
    return outward(loft(rows, paint, material))


def wheel(
    radius: float, width: float, tyre: Colour, rim: Colour, rim_share: float = 0.6, segments: int = 24, spokes: int = 0
) -> list[Part]:
    """A wheel about the y axis, centred, with dished faces, and spokes if any."""
    half, inner = width / 2, radius * rim_share
    round_off = min(0.25 * width, 0.2 * radius)
    profile = [(inner, -half), (radius - round_off, -half), (radius, -half + round_off)]
    profile += [(r, -z) for r, z in profile[::-1]]
    dish = [(inner, half), (inner * 0.9, half - 0.12 * width), (inner * 0.3, half - 0.12 * width)]
    dish += [(inner * 0.24, half), (0, half)]
    face = revolve(dish, segments, _paint_rim(rim, spokes), "metal" if not spokes else "paint")
    parts = [revolve(profile, segments, tyre, "rubber"), face, face.rotated("x", 180)]
    return turned(parts, "x", -90)


def _paint_rim(rim: Colour, spokes: int) -> Paint:
    """A rim's paint: plain, or with spokes before the dark."""
    if not spokes:
        return rim

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        open_part = (v > 0.2) & (v < 0.62)
        return open_part & (np.abs((u * spokes) % 1 - 0.5) > 0.2)

    return pattern([rim, (28, 28, 30)], shader)


def net_part(rows: Sequence[np.ndarray], paint: Paint, material: str) -> Part:
    """A surface over rows of points (k, 3)."""
    return surface(np.stack(rows), paint, material)


def picture(width: float, height: float, paint: Paint, material: str = "paint") -> Part:
    """A flat picture about the origin that faces +x and stands upright."""
    y, z = width / 2, height / 2
    return surface(np.array([[(0, -y, -z), (0, y, -z)], [(0, -y, z), (0, y, z)]]), paint, material)


def push(part: Part, move: Callable[[np.ndarray], np.ndarray]) -> Part:
    """A part with its vertices (n, 3) replaced by what `move` makes of them."""
    return replace(part, vertices=move(part.vertices))
