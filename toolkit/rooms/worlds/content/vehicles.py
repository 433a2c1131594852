"""Bodywork lofted along a roof line and painted from five sides: cars, vans, buses, trams, lorries; a city's fleet.

Frame of a vehicle: metres, x forward, y left, z up, standing on z = 0 with its middle at the origin.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from toolkit.objects.mesh import Material, mesh_from_corners
from toolkit.rooms.worlds.content import pieces as kit
from toolkit.rooms.worlds.content.drawing import Canvas, Colour, Point, Rng, hex_name, shade
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin
from toolkit.rooms.worlds.world import SceneClass

VEHICLE = SceneClass.VEHICLE
VIEWS = ("left", "right", "top", "front", "rear")
GLOW_SHARE = 4
GUTTER_PX = 2


@dataclass(frozen=True)
class Body:
    """The shape of a vehicle."""

    length: float  # length, width: metres
    width: float
    roof: tuple[Point, ...]  # knots (x, z) of its upper outline from the rear to the front
    belt: float  # height where the side windows begin
    # x of the rear window's foot and head, and of the windscreen's head and foot
    glass: tuple[float, float, float, float]
    axles: tuple[float, ...]  # x of each
    wheel_m: float = 0.33  # radius of the wheels
    sill: float = 0.2  # height of its lower edge
    roof_share: float = 0.74  # half width of the roof over half width of the body
    taper: float = 0.84  # half width of the ends over that of the middle
    px_per_m: float = 72  # of its paint
    name: str = ""  # begins the name of its skin
    seams: tuple[float, ...] = ()  # x of the joints of its doors

    @property
    def height(self) -> float:
        """Height of the roof, metres."""
        return max(z for _, z in self.roof) + 0.03

    def top(self, x: np.ndarray | float) -> np.ndarray:
        """Height of the upper outline at x."""
        return _outline(self.roof)(np.clip(x, self.roof[0][0], self.roof[-1][0]))


@lru_cache(maxsize=32)
def _outline(knots: tuple[Point, ...]) -> Callable[[np.ndarray | float], np.ndarray]:
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(*np.array(knots).T)


class VehiclePaint:
    """The paint of a vehicle: a drawing of each view, and of the light it gives off."""

    def __init__(self, body: Body, colour: Colour) -> None:
        self.body, self.colour = body, colour
        sides = {
            "left": (body.length, body.height), "top": (body.length, body.width), "front": (body.width, body.height),
        }  # fmt: skip
        sides |= {"right": sides["left"], "rear": sides["front"]}
        low = {
            "left": (-body.length / 2, 0.0), "top": (-body.length / 2, -body.width / 2),
            "front": (-body.width / 2, 0.0),
        }  # fmt: skip
        low |= {"right": low["left"], "rear": low["front"]}
        self.day = {view: Canvas(*sides[view], body.px_per_m, colour, low[view]) for view in VIEWS}
        self.glow = {view: Canvas(*sides[view], body.px_per_m / GLOW_SHARE, (0, 0, 0), low[view]) for view in VIEWS}

    def right_of(self, view: str, x: float) -> float:
        """Position to the right on a view, of x (side or top) or y (end)."""
        return -x if view in ("left", "front") else x

    def fill(self, views: str, points: list[Point], colour: Colour, glow: Colour | None = None) -> None:
        """A polygon on views named in a string; ends take (y, z), sides (x, z), the top (x, y)."""
        for view in views.split():
            turned = [(self.right_of(view, a), b) for a, b in points]
            self.day[view].fill(turned, colour)
            if glow is not None:
                self.glow[view].fill(turned, glow)

    def rect(self, views: str, a: Point, b: Point, colour: Colour, glow: Colour | None = None) -> None:
        """A rectangle between two corners."""
        self.fill(views, [(a[0], a[1]), (b[0], a[1]), (b[0], b[1]), (a[0], b[1])], colour, glow)

    def line(self, views: str, points: list[Point], width_m: float, colour: Colour) -> None:
        """A line through points."""
        for view in views.split():
            self.day[view].line([(self.right_of(view, a), b) for a, b in points], width_m, colour)

    def text(
        self, views: str, at: Point, words: str, height_m: float, colour: Colour, *, fit_m: float = 0.0,
        lit: bool = False,
    ) -> None:  # fmt: skip
        """Lettering, readable on each view."""
        for view in views.split():
            x, y = self.right_of(view, at[0]), at[1]
            self.day[view].text(x, y, words, height_m, colour, fit_m=fit_m)
            if lit:
                self.glow[view].text(x, y, words, height_m, colour, fit_m=fit_m)

    def sheet(self, name: str, looks: Looks, roughness: float = 0.22) -> "PaintMap":
        """All views on the same texture."""
        rng = looks.rng(name)
        # views in a column, the rear beside the front
        places, top, width = {}, 0, max(self.day["left"].size[0], 2 * self.day["front"].size[0]) + 4 * GUTTER_PX
        for view in ("left", "right", "top", "front"):
            places[view] = (GUTTER_PX, top + GUTTER_PX)
            top += self.day[view].size[1] + 2 * GUTTER_PX
        places["rear"] = (3 * GUTTER_PX + self.day["front"].size[0], places["front"][1])
        # rounded up to whole texels of the coarser picture of lights
        height = -(-top // GLOW_SHARE) * GLOW_SHARE
        width = -(-width // GLOW_SHARE) * GLOW_SHARE
        sheet = np.full((height, width, 3), 90, np.uint8)
        glow = np.zeros((height // GLOW_SHARE, width // GLOW_SHARE, 3), np.uint8)
        # each view into its place, by day and what it gives off
        for view, (x, y) in places.items():
            # each view's rim is repeated around it, as far as there is room
            g = GUTTER_PX
            wide = np.pad(self.day[view].texture(0.035, rng), ((g, g), (g, g), (0, 0)), mode="edge")
            part = sheet[y - g : y - g + wide.shape[0], x - g : x - g + wide.shape[1]]
            part[:] = wide[: part.shape[0], : part.shape[1]]
            light = self.glow[view].texture()
            gx, gy = round(x / GLOW_SHARE), round(y / GLOW_SHARE)
            h, w = min(light.shape[0], glow.shape[0] - gy), min(light.shape[1], glow.shape[1] - gx)
            glow[gy : gy + h, gx : gx + w] = light[:h, :w]
        # without lamps there is nothing that gives off light
        skin = looks.add(Material(name, sheet, roughness, 0.0, glow if glow.any() else None))
        boxes = {view: (x, y, *self.day[view].size) for view, (x, y) in places.items()}
        return PaintMap(skin, boxes, (width, height), {view: self.day[view].low for view in VIEWS}, self.body)


@dataclass(frozen=True)
class PaintMap:
    """A vehicle's paint on a texture, and the place of each view on it (x, y, width, height in texels)."""

    skin: Skin
    views: dict[str, tuple[int, int, int, int]]
    size: tuple[int, int]
    low: dict[str, Point]
    body: Body

    def uv(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(m, 3, 2) of corners (m, 3, 3) by the view that each face (normal (m, 3)) is turned to."""
        # the flanks win by a little: bevels along them get the side's paint, not the roof's
        share = np.abs(normals) * [1.0, 1.05, 1.0]
        axis = share.argmax(axis=1)
        result = np.empty((*points.shape[:2], 2))
        # which end and which flank a face looks to
        ends, sides = normals[:, 0] > 0, normals[:, 1] > 0
        pick = {
            "front": (axis == 0) & ends, "rear": (axis == 0) & ~ends, "left": (axis == 1) & sides,
            "right": (axis == 1) & ~sides, "top": axis == 2,
        }  # fmt: skip
        for view, chosen in pick.items():
            p = points[chosen]
            a = {"left": -p[..., 0], "right": p[..., 0], "top": p[..., 0], "front": -p[..., 1], "rear": p[..., 1]}[view]
            b = p[..., 1] if view == "top" else p[..., 2]
            # the front is looked at from before it: the vehicle's left is to the right
            a = -a if view in ("front", "rear") else a
            x, y, w, h = self.views[view]
            extent = self.body.length if view in ("left", "right", "top") else self.body.width
            rise = self.body.width if view == "top" else self.body.height
            # a little inside the view, so that no texel beside it shows
            u = x + np.clip((a - self.low[view][0]) / extent, 0.001, 0.999) * w
            v = y + (1 - np.clip((b - self.low[view][1]) / rise, 0.001, 0.999)) * h
            result[chosen] = np.stack([u / self.size[0], 1 - v / self.size[1]], axis=-1)
        return result


def bodywork(body: Body, sheet: PaintMap, looks: Looks, stations: int = 12) -> Piece:
    """The lofted skin with its open wheel arches, underside dark."""
    half = body.length / 2
    x = np.linspace(-half, half, stations)
    # stations lie close where a wheel arch cuts the skin, or its round would be corners
    arch = body.wheel_m * 1.13
    for axle in body.axles:
        x = np.r_[x, axle + arch * np.array([-1.0, -0.96, -0.6, 0, 0.6, 0.96, 1.0])]
    x = np.unique(np.round(x[np.abs(x) <= half], 3))
    # a ring of points at each station
    net = np.stack([_section(body, float(at), arch) for at in x])
    ring = net.shape[1]
    index = np.arange(net.shape[0] * ring).reshape(-1, ring)
    a, b = index[:-1], index[1:]
    ahead = np.roll(index, -1, axis=1)
    # two triangles between neighbours of two rings, and a fan at both ends
    sides = np.stack([np.stack([a, ahead[:-1], b], -1), np.stack([ahead[:-1], ahead[1:], b], -1)], 2).reshape(-1, 3)
    caps = [np.stack([np.full(ring - 2, row[0]), row[1:-1], row[2:]], 1) for row in (index[0][::-1], index[-1])]
    faces = np.concatenate([sides, *caps])
    vertices = net.reshape(-1, 3)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # the signed volume, but for a factor: a negative volume is inside out
    if np.einsum("ij,ij->", corners[:, 0], normal) < 0:
        faces, corners, normal = faces[:, ::-1], corners[:, ::-1], -normal
    # where two stations fall together faces have no area
    area = np.linalg.norm(normal, axis=1)
    real = area > 1e-7
    faces, corners, normal = faces[real], corners[real], normal[real] / area[real, None]
    # the underside is no view: it has a plain dark colour
    below = normal[:, 2] < -0.35
    dark = looks.plain((22, 22, 24), "matte")
    uv = sheet.uv(corners, normal)
    uv[below] = dark.at
    mesh = mesh_from_corners(vertices, faces, uv, below.astype(int), (), 38.0)
    skin = kit.from_mesh(mesh, sheet.skin.material, VEHICLE)
    return Piece(
        skin.vertices, skin.normals, skin.uv, skin.faces,
        np.where(mesh.face_material == 1, dark.material, sheet.skin.material).astype(np.int32),
        skin.label,
    )  # fmt: skip


def _section(body: Body, x: float, arch: float) -> np.ndarray:
    """A closed ring (k, 3) at x, from the lower left over the roof to the lower right."""
    # round at both ends as seen from above: the last 28 % narrow
    top = float(body.top(x))
    end = np.clip((abs(x) / (body.length / 2) - 0.72) / 0.28, 0, 1)
    w = body.width / 2 * (1 - (1 - body.taper) * end**2.2)
    low = body.sill + 0.06 * end
    for axle in body.axles:
        # the arch is a circle about the axle: there the lower edge is lifted to it
        reach = arch**2 - (x - axle) ** 2
        if reach > 0:
            low = max(low, body.wheel_m + np.sqrt(reach))
    belt = min(body.belt, top - 0.05)
    # 0 over bonnet and boot, 1 under the roof: between them the section narrows
    cabin = np.clip((top - body.belt) / (0.3 * (body.height - body.belt) + 0.05), 0, 1)
    roof_w = w * (body.roof_share * cabin + 0.93 * (1 - cabin))
    low = min(low, belt - 0.06)
    middle = low + (belt - low) * np.array([0.12, 0.6])
    edge = top - min(0.07, (top - belt) * 0.5)
    # half of the section from the sill up: flank, belt, edge of the roof
    half = [
        (w * 0.94, low), (w * 0.985, middle[0]), (w, middle[1]), (w * 0.965, belt), (roof_w, edge),
        (roof_w * 0.9, top - 0.015), (roof_w * 0.55, top + 0.008),
    ]  # fmt: skip
    left = np.array(half)
    # mirrored to the other side, with the middle of the roof between
    ring = np.concatenate([left, [(0.0, top + 0.015)], left[::-1] * [-1, 1]])
    return np.column_stack([np.full(len(ring), x), ring])


def wheels(body: Body, looks: Looks, hub: Colour = (176, 178, 180), spokes: int = 5) -> Piece:
    """All wheels: tyres on painted rims, their faces a little inside the flanks."""
    rim = _rim(looks, hub, spokes)
    r, wide = body.wheel_m, min(0.24, body.wheel_m * 0.62)
    # tyres have their outer shoulder rounded
    profile = [(r, -wide / 2), (r, wide / 2 - 0.03), (0.93 * r, wide / 2), (0.68 * r, wide / 2 - 0.01)]
    tyre = kit.revolved(profile, 10, looks.plain((28, 28, 30), "matte"), VEHICLE, 50)
    angle = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    disc = np.column_stack([ring * 0.7 * r, np.full(10, wide / 2 - 0.02)])
    # the rim's picture, on a disc that fills the tyre
    face = Piece(
        disc.astype(np.float32),
        np.tile(np.array([0, 0, 1], np.float32), (10, 1)),
        (0.5 + 0.5 * ring).astype(np.float32), kit.fan_faces(10), np.full(8, rim.material, np.int32),
        np.full(8, VEHICLE, np.uint8),
    )  # fmt: skip
    # a little inside the flank
    y = body.width / 2 - wide / 2 - 0.02
    at = [(axle, side * y, r) for axle in body.axles for side in (1, -1)]
    return kit.place(kit.merge(tyre, face).tipped(1, 1, -1), np.array(at), np.array([0.0, 180.0] * len(body.axles)))


def _rim(looks: Looks, hub: Colour, spokes: int) -> Skin:
    canvas = Canvas(2, 2, 32, (26, 26, 28), low=(-1, -1))
    canvas.disc(0, 0, 0.92, hub)
    canvas.disc(0, 0, 0.8, (34, 34, 36))
    for k in range(spokes):
        a = 2 * np.pi * k / spokes
        across = np.array([-np.sin(a), np.cos(a)]) * 0.13
        out = np.array([np.cos(a), np.sin(a)]) * 0.84
        canvas.fill([tuple(across * 1.3), tuple(out + across), tuple(out - across), tuple(-across * 1.3)], hub)
    canvas.disc(0, 0, 0.26, hub)
    canvas.disc(0, 0, 0.12, (70, 72, 74))
    return looks.paint(f"rim-{hex_name(hub)}-{spokes}", lambda _: canvas.texture(), 0.35)


GLASS, RUBBER = (38, 46, 54), (24, 24, 26)
HEAD, TAIL, HEAD_GLOW, TAIL_GLOW = (238, 240, 236), (176, 18, 20), (255, 244, 214), (190, 16, 12)

SEDAN = Body(
    4.75, 1.84, (
        (-2.375, 0.62), (-2.33, 0.96), (-1.75, 1.05), (-0.95, 1.4), (-0.1, 1.45), (0.4, 1.41), (1.2, 1.0), (2.05, 0.84),
        (2.32, 0.68), (2.375, 0.5),
    ),
    0.93, (-1.72, -0.95, 0.42, 1.2), (-1.38, 1.42), name="sedan", seams=(-0.95, 0.06, 1.12),
)  # fmt: skip
HATCH = Body(
    4.0, 1.74, (
        (-2.0, 0.62), (-1.96, 0.98), (-1.82, 1.12), (-1.3, 1.46), (-0.3, 1.5), (0.3, 1.45), (1.0, 1.02), (1.7, 0.86),
        (1.95, 0.68), (2.0, 0.5),
    ),
    0.95, (-1.86, -1.3, 0.3, 1.0), (-1.22, 1.26), wheel_m=0.31, name="hatch", seams=(-0.55, 0.95),
)  # fmt: skip
WAGON = Body(
    4.8, 1.82, (
        (-2.4, 0.62), (-2.36, 1.0), (-2.2, 1.18), (-1.8, 1.46), (-0.2, 1.5), (0.4, 1.46), (1.2, 1.02), (2.05, 0.86),
        (2.35, 0.68), (2.4, 0.5),
    ),
    0.95, (-2.26, -1.8, 0.42, 1.2), (-1.4, 1.44), name="wagon", seams=(-1.0, 0.06, 1.12),
)  # fmt: skip
SUV = Body(
    4.7, 1.92, (
        (-2.35, 0.7), (-2.31, 1.1), (-2.18, 1.3), (-1.8, 1.7), (-0.2, 1.76), (0.5, 1.71), (1.15, 1.24), (2.0, 1.12),
        (2.28, 0.95), (2.35, 0.66),
    ),
    1.12, (-2.24, -1.8, 0.5, 1.15), (-1.4, 1.42), wheel_m=0.38, sill=0.28, roof_share=0.8, name="suv",
    seams=(-1.0, 0.08, 1.08),
)  # fmt: skip
MINIVAN = Body(
    4.9, 1.95, (
        (-2.45, 0.66), (-2.42, 1.1), (-2.34, 1.3), (-2.1, 1.7), (-0.4, 1.76), (0.6, 1.7), (1.55, 1.12), (2.1, 0.96),
        (2.4, 0.76), (2.45, 0.55),
    ),
    1.02, (-2.36, -2.1, 0.62, 1.55), (-1.5, 1.52), wheel_m=0.34, roof_share=0.82, name="minivan",
    seams=(-1.0, 0.25, 1.35),
)  # fmt: skip
VAN = Body(
    5.6, 2.02, (
        (-2.8, 0.6), (-2.79, 2.2), (-2.7, 2.42), (0.6, 2.46), (1.2, 2.3), (1.95, 1.34), (2.55, 1.12), (2.76, 0.86),
        (2.8, 0.55),
    ),
    1.28, (-2.79, -2.78, 1.2, 1.95), (-1.75, 1.8), wheel_m=0.36, sill=0.28, roof_share=0.9, taper=0.93,
)  # fmt: skip
BUS = Body(
    11.8, 2.55,
    ((-5.9, 0.5), (-5.89, 2.6), (-5.75, 3.0), (-5.2, 3.08), (5.4, 3.08), (5.78, 2.98), (5.88, 2.5), (5.9, 0.5)),
    1.1, (-5.9, -5.88, 5.8, 5.88), (-2.9, 3.1), wheel_m=0.48, sill=0.3, roof_share=0.94, taper=0.96, px_per_m=56,
)  # fmt: skip
TRAM = Body(
    15.0, 2.5, (
        (-7.5, 0.5), (-7.44, 1.3), (-7.1, 2.9), (-6.7, 3.2), (-6.0, 3.26), (6.0, 3.26), (6.7, 3.2), (7.1, 2.9),
        (7.44, 1.3), (7.5, 0.5),
    ),
    1.2, (-7.42, -7.0, 7.0, 7.42), (-4.2, 4.2), wheel_m=0.36, sill=0.26, roof_share=0.93, taper=0.86, px_per_m=48,
)  # fmt: skip
LORRY_CAB = Body(
    2.1, 2.4,
    ((-1.05, 0.6), (-1.04, 2.4), (-0.9, 2.7), (0.5, 2.74), (0.85, 2.5), (1.02, 1.5), (1.05, 0.55)),
    1.45, (-1.04, -1.03, 0.75, 1.0), (0.1,), wheel_m=0.5, sill=0.5, roof_share=0.92, taper=0.95,
)  # fmt: skip
RED, BLUE, GREEN, WHITE = (186, 28, 34), (30, 80, 160), (34, 104, 70), (236, 236, 232)
CAR_COLOURS: tuple[Colour, ...] = (
    (216, 216, 214), (28, 29, 32), (120, 124, 128), (168, 172, 176), (150, 22, 26), (28, 52, 110), (70, 92, 74),
    (186, 172, 146), (48, 60, 66), (196, 84, 28), (92, 30, 40), (240, 238, 230),
)  # fmt: skip
CAB_YELLOW: Colour = (248, 182, 8)


@dataclass(frozen=True)
class Vehicle:
    """A vehicle ready to stand in a street: its triangles, and how long and wide it is, metres."""

    piece: Piece
    length: float
    width: float


def ground_coat(paint: VehiclePaint) -> None:
    """Flanks lighter above and darker below, as they mirror sky and street; dark arches and sills."""
    body, half = paint.body, paint.body.length / 2
    bands = ((0.0, 0.3, 0.45), (0.3, 0.52, 0.72), (0.52, 0.7, 0.88), (0.86, 1.0, 1.12))
    for low, high, factor in bands:
        paint.rect("left right", (-half, low * body.belt), (half, high * body.belt), shade(paint.colour, factor))
    paint.rect("front rear", (-body.width / 2, 0), (body.width / 2, 0.33), (34, 35, 37))
    # a crease along the flank
    paint.line("left right", [(-half, 0.72 * body.belt), (half, 0.76 * body.belt)], 0.02, shade(paint.colour, 0.6))
    for axle in body.axles:
        angle = np.linspace(0, 2 * np.pi, 33)
        r = body.wheel_m * 1.2
        paint.fill("left right", [(axle + r * np.cos(a), body.wheel_m + r * np.sin(a)) for a in angle], RUBBER)


def _car_glass(paint: VehiclePaint, pillars: tuple[float, ...]) -> None:
    body = paint.body
    foot, head, head_front, foot_front = body.glass
    # the flank's glass follows the roof; its rubber seal is a little larger
    x = np.linspace(foot + 0.18, foot_front - 0.2, 40)
    upper = np.maximum(body.top(x) - 0.1, body.belt + 0.05)
    outline = [(float(a), float(z)) for a, z in zip(x, upper, strict=True)]
    glass = [(foot + 0.2, body.belt + 0.04), *outline, (foot_front - 0.18, body.belt + 0.04)]
    grown = [
        (foot + 0.1, body.belt + 0.01), *((a, z + 0.035) for a, z in outline), (foot_front - 0.08, body.belt + 0.01),
    ]  # fmt: skip
    paint.fill("left right", grown, (16, 17, 18))
    paint.fill("left right", glass, GLASS)
    # the sky's reflection covers the upper part
    shine = [(a, z) for a, z in glass if z > body.belt + 0.25]
    if len(shine) > 2:
        shape = [(shine[0][0], body.belt + 0.3), *shine, (shine[-1][0], body.belt + 0.3)]
        paint.fill("left right", shape, (74, 88, 102))
    # pillars between the panes
    for pillar in pillars:
        z = float(body.top(pillar))
        paint.fill(
            "left right",
            [(pillar - 0.05, body.belt), (pillar + 0.05, body.belt), (pillar + 0.02, z), (pillar - 0.06, z)],
            (18, 18, 20),
        )
    # windscreen and rear window, drawn from above and from their end
    w = body.width / 2
    for a, b in ((head_front, foot_front), (head, foot)):
        at_foot, at_head = w * 0.86, w * body.roof_share * 0.9
        paint.fill("top", [(a, -at_head), (b, -at_foot), (b, at_foot), (a, at_head)], GLASS)
        paint.fill(
            "top", [(a, -at_head * 0.9), (b, -at_foot * 0.2), (b, at_foot * 0.3), (a, at_head * 0.1)], (66, 80, 94)
        )
        za, zb = float(body.top(a)) - 0.02, float(body.top(b)) + 0.01
        end = "front" if b > a else "rear"
        paint.fill(end, [(-at_head, za), (-at_foot, zb), (at_foot, zb), (at_head, za)], GLASS)
        paint.fill(
            end, [(-at_head * 0.8, za), (-at_foot * 0.2, zb), (at_foot * 0.4, zb), (at_head * 0.2, za)], (66, 80, 94)
        )


def car_ends(paint: VehiclePaint, rng: Rng) -> None:
    """Lamps, grille, bumpers, number plates, and what of them shows from the side."""
    body, w, half = paint.body, paint.body.width / 2, paint.body.length / 2
    # grille with bars, and the air intake below it
    nose = float(body.top(half - 0.12))
    z0, z1 = nose - 0.2, nose - 0.02
    paint.rect("front", (-w * 0.5, z0 - 0.02), (w * 0.5, z1 - 0.01), (20, 20, 22))
    for k in range(4):
        z = z0 + 0.045 * k
        paint.line("front", [(-w * 0.48, z), (w * 0.48, z)], 0.014, (150, 152, 154))
    paint.rect("front", (-w * 0.62, 0.3), (w * 0.62, 0.44), (24, 24, 26))
    # lamps on both sides, front and rear
    tail = min(float(body.top(-half + 0.1)), body.belt) - 0.02
    for side in (1, -1):
        lamp = [
            (side * w * 0.52, z0 + 0.02), (side * w * 0.97, z0 + 0.05), (side * w * 0.95, z1),
            (side * w * 0.52, z1 - 0.01),
        ]  # fmt: skip
        paint.fill("front", lamp, HEAD, HEAD_GLOW)
        paint.line("front", [*lamp, lamp[0]], 0.02, (60, 62, 64))
        rear = [
            (side * w * 0.55, tail - 0.24), (side * w * 0.98, tail - 0.26), (side * w * 0.96, tail),
            (side * w * 0.62, tail),
        ]  # fmt: skip
        paint.fill("rear", rear, TAIL, TAIL_GLOW)
        paint.rect("rear", (side * w * 0.66, tail - 0.17), (side * w * 0.9, tail - 0.11), (236, 214, 204))
        paint.rect("front", (side * w * 0.72, 0.34), (side * w * 0.86, 0.42), (232, 170, 60))
    # what shows of the lamps from the side
    paint.rect("left right", (half - 0.36, z0 + 0.04), (half, z1), HEAD, shade(HEAD_GLOW, 0.6))
    paint.rect("left right", (-half, tail - 0.24), (-half + 0.26, tail - 0.02), TAIL, TAIL_GLOW)
    # three letters and three figures, the same at both ends
    number = "".join(str(rng.choice(list("ABCDEFGHKLMNPRSTUVWXYZ"))) for _ in range(3)) + f" {rng.integers(100, 1000)}"
    for end, z in (("front", 0.38), ("rear", min(tail - 0.32, 0.72))):
        paint.rect(end, (-0.27, z - 0.065), (0.27, z + 0.065), (240, 238, 226))
        paint.text(end, (0, z), number, 0.12, (24, 40, 96))
    paint.rect("rear", (-w * 0.9, 0.36), (w * 0.9, 0.4), (28, 28, 30))


def _doors(paint: VehiclePaint) -> None:
    body, low, seams = paint.body, paint.body.sill + 0.06, paint.body.seams
    for seam in seams:
        paint.line("left right", [(seam, low), (seam, body.belt)], 0.018, shade(paint.colour, 0.42))
    for handle in seams[:-1]:
        paint.rect(
            "left right", (handle + 0.08, body.belt - 0.16), (handle + 0.26, body.belt - 0.115),
            shade(paint.colour, 0.35),
        )  # fmt: skip
        paint.rect("left right", (handle + 0.09, body.belt - 0.13), (handle + 0.25, body.belt - 0.115), (206, 208, 208))
    paint.line("left right", [(seams[0], low), (seams[-1], low)], 0.018, shade(paint.colour, 0.42))


def mirrors(body: Body, colour: Colour, looks: Looks) -> Piece:
    """Both door mirrors."""
    x, w = body.glass[3] - 0.32, body.width / 2
    low = np.array([(x - 0.06, w - 0.04, body.belt + 0.02), (x - 0.06, -w - 0.17, body.belt + 0.02)])
    return kit.boxes(low, low + [0.14, 0.21, 0.15], looks.plain(colour, "gloss"), VEHICLE, without=())


def car(body: Body, colour: Colour, looks: Looks, name: str, kind: str = "car") -> Vehicle:
    """A private car, a cab, or a police car."""
    rng = looks.rng(name)
    paint = VehiclePaint(body, colour)
    ground_coat(paint)
    # a cab has a checkered band and lettering
    if kind == "cab":
        # two rows of checks along the belt
        for k in range(2 * int(body.length / 0.24)):
            x, z = -body.length / 2 + 0.12 * k, body.belt - 0.3 + 0.1 * (k % 2)
            paint.rect("left right", (x, z), (x + 0.12, z + 0.1), (22, 22, 24))
        paint.text("left right", (0.55, body.belt - 0.46), "TAXI", 0.34, (20, 20, 22))
        paint.text("left right", (-0.5, body.belt - 0.46), "CITY CAB", 0.2, (20, 20, 22))
        paint.text("top", (1.6, 0), "", 0.2, RUBBER)
    if kind == "police":
        paint.rect("left right", (-0.98, 0.25), (1.1, body.belt), (238, 238, 236))
        paint.text("left right", (0.06, body.belt - 0.3), "POLICE", 0.34, (20, 36, 96))
    # glass, lamps and doors are the same for all kinds; longer bodies have a pillar more
    rear_pillar = () if body in (SEDAN, HATCH) else (body.seams[0] - 0.75,)
    _car_glass(paint, body.seams[:-1] + rear_pillar)
    car_ends(paint, rng)
    _doors(paint)
    # seams between roof and bonnet, roof and boot
    for x in (body.glass[3] + 0.05, body.glass[0]):
        w = body.width * 0.43
        if abs(x) < body.length / 2 - 0.3:
            paint.line("top", [(x, -w), (x, w)], 0.02, shade(colour, 0.4))
    # painted before the body is built, which looks its paint up
    sheet = paint.sheet(name, looks)
    pieces = [
        bodywork(body, sheet, looks),
        wheels(body, looks, spokes=5 + int(rng.integers(4))),
        mirrors(body, colour, looks),
    ]
    # roof signs and lights glow at night
    roof = float(body.top(-0.2))
    if kind == "cab":
        lit = looks.plain((255, 236, 170), "lamp")
        pieces.append(kit.box((-0.36, -0.12), (-0.42, 0.42), (roof + 0.02, roof + 0.24), lit, VEHICLE))
        words = word_skin("TAXI", (255, 226, 120), (24, 24, 24), looks)
        for x, yaw in ((-0.1, 90.0), (-0.38, 270.0)):
            board = kit.wall_quads((-0.4, 0.03, 0.4, 0.22), 0.0, words, VEHICLE, fit=True)
            pieces.append(kit.place(board, [x, 0, roof], yaw))
    if kind == "police":
        for y, tone in ((0.28, (220, 20, 24)), (-0.28, (24, 60, 220))):
            pieces.append(
                kit.box(
                    (-0.4, -0.1), (y - 0.27, y + 0.27), (roof + 0.02, roof + 0.16), looks.plain(tone, "lamp"), VEHICLE
                )
            )
    return Vehicle(kit.merge(*pieces), body.length, body.width)


def word_skin(words: str, ground: Colour, ink: Colour, looks: Looks) -> Skin:
    """A lit word on a small board."""
    canvas = Canvas(1.6, 0.4, 80, ground)
    canvas.text(0.8, 0.2, words, 0.36, ink, fit_m=1.4)
    return looks.paint(f"word-{words}", lambda _: (canvas.texture(), canvas.texture()), 0.4)


def van(colour: Colour, words: str, looks: Looks, name: str) -> Vehicle:
    """A delivery van with a firm's name on its flanks."""
    body, paint = VAN, VehiclePaint(VAN, colour)
    ground_coat(paint)
    car_ends(paint, looks.rng(name))
    w = body.width / 2
    # flanks: the front door's window, seams of doors, handle, stripe and name
    paint.fill("left right", [(0.75, 1.32), (0.8, 2.1), (1.3, 2.1), (1.85, 1.36)], GLASS)
    paint.line("left right", [(0.7, 0.4), (0.7, 2.2)], 0.02, shade(colour, 0.5))
    paint.line("left right", [(-0.6, 0.4), (-0.6, 2.2)], 0.02, shade(colour, 0.5))
    paint.rect("left right", (0.78, 1.14), (0.98, 1.19), (30, 30, 32))
    # letters that stand out from the paint
    ink = (236, 236, 232) if sum(colour) < 380 else (30, 52, 120)
    paint.rect("left right", (-2.75, 1.02), (0.6, 1.1), ink)
    paint.text("left right", (-1.05, 1.65), words, 0.5, ink, fit_m=2.9)
    paint.text("left right", (-1.05, 1.25), "EXPRESS DELIVERY", 0.18, ink)
    # windscreen, on the roof and the front; rear doors with windows
    paint.fill("top", [(1.2, -w * 0.82), (1.95, -w * 0.88), (1.95, w * 0.88), (1.2, w * 0.82)], GLASS)
    paint.fill("front", [(-w * 0.82, 2.28), (-w * 0.9, 1.36), (w * 0.9, 1.36), (w * 0.82, 2.28)], GLASS)
    for y in (-0.48, 0.48):
        paint.rect("rear", (y - 0.4, 1.35), (y + 0.4, 2.1), GLASS)
    paint.line("rear", [(0, 0.4), (0, 2.3)], 0.03, shade(colour, 0.4))
    paint.text("rear", (0, 1.1), words, 0.22, ink, fit_m=1.7)
    sheet = paint.sheet(name, looks)
    return Vehicle(
        kit.merge(bodywork(body, sheet, looks), wheels(body, looks, (120, 122, 124), 6), mirrors(body, RUBBER, looks)),
        body.length, body.width,
    )  # fmt: skip


def _rows_of_windows(
    paint: VehiclePaint, x0: float, x1: float, count: int, z: tuple[float, float], doors: tuple[int, ...] = ()
) -> None:
    # windows of the same width, with a dark band behind them
    edges = np.linspace(x0, x1, count + 1)
    lit = (250, 226, 176)
    paint.rect("left right", (x0 - 0.1, z[0] - 0.06), (x1 + 0.1, z[1] + 0.06), (22, 23, 25))
    for k in range(count):
        a, b = float(edges[k]) + 0.04, float(edges[k + 1]) - 0.04
        paint.rect("left right", (a, z[0]), (b, z[1]), (50, 60, 68), lit)
        # a slanted reflection on each pane, and the seats behind it
        shape = [(a, z[1]), (a + 0.5 * (b - a), z[1]), (a + 0.2 * (b - a), z[0]), (a, z[0])]
        paint.fill("left right", shape, (92, 108, 120))
        for seat in np.arange(a + 0.15, b - 0.1, 0.42):
            paint.rect("left right", (seat, z[0]), (seat + 0.2, z[0] + 0.22), (44, 60, 108))
        # doors open to the right, the side of the kerb
        if k in doors:
            paint.rect("right", (a, 0.36), (b, z[1] + 0.1), (28, 30, 32), shade(lit, 0.8))
            for u, v in ((a + 0.06, (a + b) / 2 - 0.03), ((a + b) / 2 + 0.03, b - 0.06)):
                paint.rect("right", (u, 0.5), (v, z[1] + 0.02), (72, 86, 96))


def bus(looks: Looks, name: str, colour: Colour, route: str, trolley: bool = False) -> Vehicle:
    """A city bus with a lit destination; a trolleybus carries poles on its roof."""
    body, paint = BUS, VehiclePaint(BUS, colour)
    half, w = body.length / 2, body.width / 2
    white = (236, 236, 232)
    # skirt, roof band, waist line and roof
    paint.rect("left right", (-half, 0.0), (half, 0.45), (40, 42, 44))
    paint.rect("left right", (-half, 2.62), (half, 3.1), white if sum(colour) < 400 else shade(colour, 0.8))
    paint.rect("left right", (-half, 0.98), (half, 1.04), white)
    paint.rect("top", (-half, -w), (half, w), (222, 222, 218))
    # wheel arches, seen from the side
    for axle in body.axles:
        angle, r = np.linspace(0, 2 * np.pi, 33), body.wheel_m * 1.2
        paint.fill("left right", [(axle + r * np.cos(a), body.wheel_m + r * np.sin(a)) for a in angle], RUBBER)
    # windows, doors and lettering of the flanks
    _rows_of_windows(paint, -half + 0.35, half - 0.4, 8, (1.15, 2.5), doors=(4, 7))
    paint.text("left", (-1.0, 0.76), "METRO TRANSIT", 0.3, white)
    paint.text("right", (-3.6, 0.76), "METRO TRANSIT", 0.3, white)
    paint.rect("left", (-2.6, 0.5), (2.4, 0.97), (250, 210, 30))
    paint.text("left", (-0.1, 0.74), "CITY THEATRE · NOW OPEN", 0.34, (180, 20, 30), fit_m=4.6)
    # windscreen with a reflection, and its middle post
    paint.rect("front", (-w * 0.93, 1.05), (w * 0.93, 2.6), GLASS, (90, 80, 60))
    paint.fill("front", [(-w * 0.8, 2.55), (-w * 0.3, 2.55), (w * 0.2, 1.1), (-w * 0.5, 1.1)], (76, 90, 102))
    paint.rect("front", (-0.02, 1.05), (0.02, 2.6), (20, 20, 20))
    # destination displays, which glow at night
    paint.rect("front rear", (-w * 0.8, 2.64), (w * 0.8, 2.95), (14, 14, 15))
    paint.text("front", (0, 2.8), route, 0.26, (255, 170, 30), fit_m=1.9, lit=True)
    paint.rect("right", (half - 2.4, 2.64), (half - 0.6, 2.92), (14, 14, 15))
    paint.text("right", (half - 1.5, 2.78), route, 0.22, (255, 170, 30), fit_m=1.7, lit=True)
    # rear window and engine grille
    paint.rect("rear", (-w * 0.8, 1.5), (w * 0.8, 2.5), GLASS)
    paint.rect("rear", (-w * 0.7, 0.55), (w * 0.7, 1.3), shade(colour, 0.6))
    for k in range(6):
        paint.line("rear", [(-w * 0.66, 0.62 + 0.11 * k), (w * 0.66, 0.62 + 0.11 * k)], 0.03, (30, 30, 32))
    # lamps and number plate
    for side in (1, -1):
        paint.rect("front", (side * w * 0.55, 0.55), (side * w * 0.92, 0.75), HEAD, HEAD_GLOW)
        paint.rect("rear", (side * w * 0.78, 0.6), (side * w * 0.95, 1.4), TAIL, TAIL_GLOW)
    paint.rect("front", (-0.3, 0.42), (0.3, 0.54), (240, 238, 226))
    sheet = paint.sheet(name, looks)
    # units on the roof, and mirrors
    units = looks.plain((196, 198, 196))
    low = np.array([(-4.6, -0.9, 3.08), (1.6, -0.8, 3.08)])
    pieces = [
        bodywork(body, sheet, looks, 10), wheels(body, looks, (150, 152, 154), 8),
        kit.boxes(low, low + [2.2, 1.7, 0.22], units, VEHICLE),
        kit.box((half - 0.1, half + 0.3), (w, w + 0.22), (1.9, 2.4), looks.plain(RUBBER), VEHICLE),
        kit.box((half - 0.1, half + 0.3), (-w - 0.22, -w), (1.9, 2.4), looks.plain(RUBBER), VEHICLE),
    ]  # fmt: skip
    # a trolleybus has poles on its roof
    if trolley:
        foot = np.array([(-1.0, 0.3, 3.25), (-1.0, -0.3, 3.25)])
        pieces += [
            kit.boxes([-1.6, -0.5, 3.08], [-0.4, 0.5, 3.3], looks.plain((60, 62, 64)), VEHICLE),
            kit.bars(foot, foot + [-5.4, 0.0, 2.2], 0.07, looks.plain((40, 42, 44)), VEHICLE),
        ]
    return Vehicle(kit.merge(*pieces), body.length, body.width)


def tram(looks: Looks, name: str, colour: Colour, route: str) -> Vehicle:
    """A tramcar in two colours with its pantograph up."""
    body, paint = TRAM, VehiclePaint(TRAM, colour)
    half, w = body.length / 2, body.width / 2
    cream = (236, 226, 200)
    # bands of the body, and its roof
    paint.rect("left right front rear", (-half, 2.72), (half, 3.3), cream)
    paint.rect("left right front rear", (-half, 1.0), (half, 1.14), cream)
    paint.rect("left right front rear", (-half, 0.0), (half, 0.5), (44, 46, 48))
    paint.rect("top", (-half, -w), (half, w), (150, 152, 150))
    # windows, doors and lettering of the flanks
    _rows_of_windows(paint, -half + 1.0, half - 1.0, 9, (1.3, 2.6), doors=(0, 4, 8))
    paint.text("left right", (-1.6, 0.8), "CITY TRAMWAYS", 0.28, cream)
    # both ends: windscreen with a reflection, and the display above it
    for end in ("front", "rear"):
        paint.fill(end, [(-w * 0.78, 1.35), (w * 0.78, 1.35), (w * 0.72, 2.7), (-w * 0.72, 2.7)], GLASS, (80, 70, 52))
        paint.fill(end, [(-w * 0.6, 2.6), (-w * 0.1, 2.6), (w * 0.2, 1.4), (-w * 0.4, 1.4)], (80, 94, 106))
        paint.rect(end, (-w * 0.6, 2.78), (w * 0.6, 3.06), (14, 14, 15))
        paint.text(end, (0, 2.92), route, 0.24, (255, 200, 60), fit_m=1.3, lit=True)
    # lamps
    for side in (1, -1):
        paint.rect("front", (side * w * 0.45, 0.62), (side * w * 0.72, 0.86), HEAD, HEAD_GLOW)
        paint.rect("rear", (side * w * 0.45, 0.62), (side * w * 0.72, 0.86), TAIL, TAIL_GLOW)
    sheet = paint.sheet(name, looks)
    # the pantograph's joints, from the roof upwards
    iron = looks.plain((56, 58, 60))
    arm = np.array([(0.3, -0.5, 3.3), (0.3, 0.5, 3.3), (1.5, -0.5, 4.3), (1.5, 0.5, 4.3)])
    tip = np.array([(1.5, -0.5, 4.3), (1.5, 0.5, 4.3), (0.6, -0.3, 5.45), (0.6, 0.3, 5.45)])
    low = np.array([(-5.0, -0.8, 3.25), (2.6, -0.8, 3.25)])
    return Vehicle(
        kit.merge(
            bodywork(body, sheet, looks, 12), wheels(body, looks, (90, 92, 94), 8),
            kit.bars(arm, tip, 0.07, iron, VEHICLE),
            kit.bars([0.6, -0.8, 5.48], [0.6, 0.8, 5.48], 0.08, iron, VEHICLE),
            kit.boxes(low, low + [2.2, 1.6, 0.32], looks.plain((176, 178, 176)), VEHICLE),
        ),
        body.length, body.width,
    )  # fmt: skip


def lorry(looks: Looks, name: str, colour: Colour, box_colour: Colour, words: str) -> Vehicle:
    """A lorry with a box body and lettering."""
    paint = VehiclePaint(LORRY_CAB, colour)
    w = LORRY_CAB.width / 2
    # cab: bumper, glass, door seam, grille and lamps
    paint.rect("front left right", (-1.2, 0.0), (1.2, 0.75), (36, 37, 39))
    paint.rect("front", (-w * 0.9, 1.5), (w * 0.9, 2.4), GLASS)
    paint.fill("left right", [(-0.6, 1.5), (-0.6, 2.35), (0.5, 2.35), (0.85, 1.5)], GLASS)
    paint.line("left right", [(-0.65, 0.7), (-0.65, 2.4)], 0.02, shade(colour, 0.5))
    paint.rect("front", (-w * 0.6, 0.85), (w * 0.6, 1.35), (26, 26, 28))
    for k in range(5):
        paint.line("front", [(-w * 0.58, 0.9 + 0.1 * k), (w * 0.58, 0.9 + 0.1 * k)], 0.03, (140, 142, 144))
    for side in (1, -1):
        paint.rect("front", (side * w * 0.66, 0.55), (side * w * 0.95, 0.78), HEAD, HEAD_GLOW)
    sheet = paint.sheet(name, looks)
    cab = kit.merge(bodywork(LORRY_CAB, sheet, looks, 8)).moved(2.9)
    # lettered box on the flanks
    canvas = Canvas(5.6, 2.5, 56, box_colour)
    canvas.rect(0, 0, 5.6, 0.35, shade(colour, 0.9))
    ink = colour if sum(box_colour) > 400 else (240, 240, 236)
    canvas.text(2.8, 1.5, words, 0.85, ink, fit_m=5.0)
    canvas.text(2.8, 0.75, "REMOVALS · STORAGE · 24 HOURS", 0.24, ink, fit_m=4.8)
    boards = looks.add(Material(f"{name}-box", canvas.texture(0.05, looks.rng(name)), 0.5), (5.6, 2.5))
    plain, dark = looks.plain(box_colour), looks.plain((34, 35, 37), "matte")
    flanks = kit.wall_quads((-2.8, 1.0, 2.8, 3.5), 0.0, boards, VEHICLE, fit=True)
    # box, its boards, underride guard and rear lamps
    pieces = [
        cab,
        kit.box((-3.9, 1.7), (-1.22, 1.22), (1.0, 3.5), plain, VEHICLE),
        kit.place(flanks, [(-1.1, -1.225, 0), (-1.1, 1.225, 0)], [0.0, 180.0]),
        kit.box((-3.8, 3.2), (-0.5, 0.5), (0.5, 0.95), dark, VEHICLE),
        kit.boxes(
            [(-3.92, -1.1, 0.7), (-3.92, 0.8, 0.7)], [(-3.85, -0.8, 0.9), (-3.85, 1.1, 0.9)], looks.plain(TAIL, "lamp"),
            VEHICLE, (),
        ),
    ]  # fmt: skip
    # the wheels belong to the whole lorry, which is longer than its cab
    axles = replace(LORRY_CAB, length=8.0, axles=(-2.4, -1.3, 3.0))
    pieces.append(wheels(axles, looks, (150, 152, 154), 8))
    return Vehicle(kit.merge(*pieces), 7.9, 2.45)


@dataclass(frozen=True)
class Fleet:
    """Vehicles by what they do."""

    private: tuple[Vehicle, ...]  # private, cabs, vans, buses, trams, lorries: each at least one
    cabs: tuple[Vehicle, ...]
    vans: tuple[Vehicle, ...]
    buses: tuple[Vehicle, ...]
    trams: tuple[Vehicle, ...]
    lorries: tuple[Vehicle, ...]

    def parked(self) -> list[tuple[tuple[Vehicle, ...], float]]:
        """Vehicles along a kerb, with their shares."""
        return [(self.private, 0.72), (self.cabs, 0.16), (self.vans, 0.08), (self.lorries, 0.04)]

    def moving(self) -> list[tuple[tuple[Vehicle, ...], float]]:
        """Vehicles that drive, with their shares."""
        return [(self.private, 0.4), (self.cabs, 0.38), (self.vans, 0.07), (self.buses, 0.11), (self.lorries, 0.04)]


def build_fleet(looks: Looks) -> Fleet:
    """All makes in their colours."""
    makes = [
        (SEDAN, (0, 1, 3, 4, 5)), (HATCH, (4, 9, 11, 2)), (WAGON, (5, 7, 8)), (SUV, (1, 0, 6, 10)), (MINIVAN, (3, 5)),
    ]  # fmt: skip
    # private cars in several bodies and colours
    private = [car(body, CAR_COLOURS[k], looks, f"{body.name}-{k}") for body, colours in makes for k in colours]
    private.append(car(SEDAN, (28, 29, 32), looks, "police", "police"))
    # cabs, vans, buses, trams and lorries
    cabs = (car(SEDAN, CAB_YELLOW, looks, "cab", "cab"), car(MINIVAN, CAB_YELLOW, looks, "cab-van", "cab"))
    vans = (
        van(WHITE, "PARCELS", looks, "van-white"),
        van((120, 76, 34), "UNITED POST", looks, "van-brown"),
        van(WHITE, "AMBULANCE", looks, "ambulance"), van(BLUE, "PLUMBER", looks, "van-blue"),
    )  # fmt: skip
    buses = (
        bus(looks, "bus-blue", BLUE, "42 CENTRAL"),
        bus(looks, "trolley-red", RED, "7 HARBOUR", trolley=True),
        bus(looks, "trolley-green", GREEN, "12 MARKET", trolley=True),
        bus(looks, "school", (246, 178, 16), "SCHOOL BUS"),
    )
    trams = (tram(looks, "tram-red", RED, "9 MARKET"), tram(looks, "tram-green", GREEN, "3 RIVER"))
    lorries = (
        lorry(looks, "lorry-red", RED, (238, 236, 228), "MOVERS"),
        lorry(looks, "lorry-blue", BLUE, (40, 90, 160), "FRESH FISH"),
        lorry(looks, "lorry-green", GREEN, (34, 104, 70), "CITY REFUSE"),
    )
    return Fleet(tuple(private), cabs, vans, buses, trams, lorries)
