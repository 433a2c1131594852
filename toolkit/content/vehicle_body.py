"""Bodywork: a skin lofted along a roof line, open wheel arches, wheels; painted from five sides.

Frame of a vehicle: metres, x forward, y left, z up, standing on z = 0 with its middle at the origin.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import Canvas, Point, hex_name
from toolkit.content.pieces import Looks, Piece, Skin, from_mesh, merge, place, revolved
from toolkit.objects.mesh import Material, mesh_from_corners
from toolkit.worlds.classes import SceneClass

VEHICLE = SceneClass.VEHICLE
VIEWS = ("left", "right", "top", "front", "rear")
GLOW_SHARE = 4
GUTTER_PX = 2


@dataclass(frozen=True)
class Body:
    """The shape of a vehicle.

    Attributes:
        length, width: metres.
        roof: knots (x, z) of its upper outline from the rear to the front.
        belt: height where the side windows begin.
        glass: x of the rear window's foot and head, and of the windscreen's head and foot.
        axles: x of each.
        wheel_m: radius of the wheels.
        sill: height of its lower edge.
        roof_share: half width of the roof over half width of the body.
        taper: half width of the ends over that of the middle.
        px_per_m: of its paint.
    """

    length: float
    width: float
    roof: tuple[Point, ...]
    belt: float
    glass: tuple[float, float, float, float]
    axles: tuple[float, ...]
    wheel_m: float = 0.33
    sill: float = 0.2
    roof_share: float = 0.74
    taper: float = 0.84
    px_per_m: float = 72

    @property
    def height(self) -> float:
        """Of the roof."""
        return max(z for _, z in self.roof) + 0.03

    def top(self, x: np.ndarray | float) -> np.ndarray:
        """Height of the upper outline at x."""
        return _outline(self.roof)(np.clip(x, self.roof[0][0], self.roof[-1][0]))


@lru_cache(maxsize=32)
def _outline(knots: tuple[Point, ...]) -> Callable[[np.ndarray | float], np.ndarray]:
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(*np.array(knots).T)


class Livery:
    """The paint of one vehicle: a drawing of each view, and of the light it gives off."""

    def __init__(self, body: Body, colour: Colour) -> None:
        self.body, self.colour = body, colour
        sides = {
            "left": (body.length, body.height), "top": (body.length, body.width), "front": (body.width, body.height),
        }  # fmt: skip
        sides |= {"right": sides["left"], "rear": sides["front"]}
        low = {
            "left": (-body.length / 2, 0.0),
            "top": (-body.length / 2, -body.width / 2),
            "front": (-body.width / 2, 0.0),
        }
        low |= {"right": low["left"], "rear": low["front"]}
        self.day = {view: Canvas(*sides[view], body.px_per_m, colour, low[view]) for view in VIEWS}
        self.glow = {view: Canvas(*sides[view], body.px_per_m / GLOW_SHARE, (0, 0, 0), low[view]) for view in VIEWS}

    def right_of(self, view: str, x: float) -> float:
        """Where x (of a side or the top) or y (of an end) lies to the right on a view."""
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

    def sheet(self, name: str, looks: Looks, roughness: float = 0.22) -> "Sheet":
        """All views on one texture."""
        rng = looks.rng(name)
        places, top, width = {}, 0, max(self.day["left"].size[0], 2 * self.day["front"].size[0]) + 4 * GUTTER_PX
        for view in ("left", "right", "top", "front"):
            places[view] = (GUTTER_PX, top + GUTTER_PX)
            top += self.day[view].size[1] + 2 * GUTTER_PX
        places["rear"] = (3 * GUTTER_PX + self.day["front"].size[0], places["front"][1])
        height = -(-top // GLOW_SHARE) * GLOW_SHARE
        width = -(-width // GLOW_SHARE) * GLOW_SHARE
        sheet = np.full((height, width, 3), 90, np.uint8)
        glow = np.zeros((height // GLOW_SHARE, width // GLOW_SHARE, 3), np.uint8)
        for view, (x, y) in places.items():
            _paste(sheet, self.day[view].texture(0.035, rng), x, y)
            light = self.glow[view].texture()
            gx, gy = round(x / GLOW_SHARE), round(y / GLOW_SHARE)
            h, w = min(light.shape[0], glow.shape[0] - gy), min(light.shape[1], glow.shape[1] - gx)
            glow[gy : gy + h, gx : gx + w] = light[:h, :w]
        skin = looks.add(Material(name, sheet, roughness, 0.0, glow if glow.any() else None))
        boxes = {view: (x, y, *self.day[view].size) for view, (x, y) in places.items()}
        return Sheet(skin, boxes, (width, height), {view: self.day[view].low for view in VIEWS}, self.body)


def _paste(sheet: np.ndarray, picture: np.ndarray, x: int, y: int) -> None:
    g = GUTTER_PX
    wide = np.pad(picture, ((g, g), (g, g), (0, 0)), mode="edge")
    part = sheet[y - g : y - g + wide.shape[0], x - g : x - g + wide.shape[1]]
    part[:] = wide[: part.shape[0], : part.shape[1]]


@dataclass(frozen=True)
class Sheet:
    """A vehicle's paint on a texture, and where each view lies on it (x, y, width, height in texels)."""

    skin: Skin
    views: dict[str, tuple[int, int, int, int]]
    size: tuple[int, int]
    low: dict[str, Point]
    body: Body

    def uv(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(m, 3, 2) of corners (m, 3, 3) by the view that each face (normal (m, 3)) is turned to."""
        share = np.abs(normals) * [1.0, 1.05, 1.0]
        axis = share.argmax(axis=1)
        result = np.empty((*points.shape[:2], 2))
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
            u = x + np.clip((a - self.low[view][0]) / extent, 0.001, 0.999) * w
            v = y + (1 - np.clip((b - self.low[view][1]) / rise, 0.001, 0.999)) * h
            result[chosen] = np.stack([u / self.size[0], 1 - v / self.size[1]], axis=-1)
        return result


def bodywork(body: Body, sheet: Sheet, looks: Looks, stations: int = 12) -> Piece:
    """The lofted skin with its open wheel arches, underside dark."""
    half = body.length / 2
    x = np.linspace(-half, half, stations)
    arch = body.wheel_m * 1.13
    for axle in body.axles:
        x = np.r_[x, axle + arch * np.array([-1.0, -0.96, -0.6, 0, 0.6, 0.96, 1.0])]
    x = np.unique(np.round(x[np.abs(x) <= half], 3))
    net = np.stack([_section(body, float(at), arch) for at in x])
    ring = net.shape[1]
    index = np.arange(net.shape[0] * ring).reshape(-1, ring)
    a, b = index[:-1], index[1:]
    ahead = np.roll(index, -1, axis=1)
    sides = np.stack([np.stack([a, ahead[:-1], b], -1), np.stack([ahead[:-1], ahead[1:], b], -1)], 2).reshape(-1, 3)
    caps = [np.stack([np.full(ring - 2, row[0]), row[1:-1], row[2:]], 1) for row in (index[0][::-1], index[-1])]
    faces = np.concatenate([sides, *caps])
    vertices = net.reshape(-1, 3)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.einsum("ij,ij->", corners[:, 0], normal) < 0:
        faces, corners, normal = faces[:, ::-1], corners[:, ::-1], -normal
    area = np.linalg.norm(normal, axis=1)
    real = area > 1e-7
    faces, corners, normal = faces[real], corners[real], normal[real] / area[real, None]
    below = normal[:, 2] < -0.35
    dark = looks.plain((22, 22, 24), "matte")
    uv = sheet.uv(corners, normal)
    uv[below] = dark.at
    mesh = mesh_from_corners(vertices, faces, uv, below.astype(int), (), 38.0)
    skin = from_mesh(mesh, sheet.skin.material, VEHICLE)
    return Piece(
        skin.vertices, skin.normals, skin.uv, skin.faces,
        np.where(mesh.face_material == 1, dark.material, sheet.skin.material).astype(np.int32),
        skin.label,
    )  # fmt: skip


def _section(body: Body, x: float, arch: float) -> np.ndarray:
    """A closed ring (k, 3) at x, from the lower left over the roof to the lower right."""
    top = float(body.top(x))
    end = np.clip((abs(x) / (body.length / 2) - 0.72) / 0.28, 0, 1)
    w = body.width / 2 * (1 - (1 - body.taper) * end**2.2)
    low = body.sill + 0.06 * end
    for axle in body.axles:
        reach = arch**2 - (x - axle) ** 2
        if reach > 0:
            low = max(low, body.wheel_m + np.sqrt(reach))
    belt = min(body.belt, top - 0.05)
    cabin = np.clip((top - body.belt) / (0.3 * (body.height - body.belt) + 0.05), 0, 1)
    roof_w = w * (body.roof_share * cabin + 0.93 * (1 - cabin))
    low = min(low, belt - 0.06)
    middle = low + (belt - low) * np.array([0.12, 0.6])
    edge = top - min(0.07, (top - belt) * 0.5)
    half = [
        (w * 0.94, low), (w * 0.985, middle[0]), (w, middle[1]), (w * 0.965, belt), (roof_w, edge),
        (roof_w * 0.9, top - 0.015), (roof_w * 0.55, top + 0.008),
    ]  # fmt: skip
    left = np.array(half)
    ring = np.concatenate([left, [(0.0, top + 0.015)], left[::-1] * [-1, 1]])
    return np.column_stack([np.full(len(ring), x), ring])


def wheels(body: Body, looks: Looks, hub: Colour = (176, 178, 180), spokes: int = 5) -> Piece:
    """All wheels: tyres on painted rims, their faces a little inside the flanks."""
    rim = _rim(looks, hub, spokes)
    r, wide = body.wheel_m, min(0.24, body.wheel_m * 0.62)
    tyre = revolved(
        [(r, -wide / 2), (r, wide / 2 - 0.03), (0.93 * r, wide / 2), (0.68 * r, wide / 2 - 0.01)],
        10, looks.plain((28, 28, 30), "matte"), VEHICLE, 50,
    )  # fmt: skip
    angle = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    disc = np.column_stack([ring * 0.7 * r, np.full(10, wide / 2 - 0.02)])
    faces = np.stack([np.zeros(8, int), np.arange(1, 9), np.arange(2, 10)], 1)
    face = Piece(
        disc.astype(np.float32),
        np.tile(np.array([0, 0, 1], np.float32), (10, 1)),
        (0.5 + 0.5 * ring).astype(np.float32), faces.astype(np.int32), np.full(8, rim.material, np.int32),
        np.full(8, VEHICLE, np.uint8),
    )  # fmt: skip
    one = merge(tyre, face)
    # its axis from z to y
    tipped = Piece(
        one.vertices[:, [0, 2, 1]] * np.array([1, 1, -1], np.float32),
        one.normals[:, [0, 2, 1]] * np.array([1, 1, -1], np.float32),
        one.uv, one.faces, one.material, one.label,
    )  # fmt: skip
    y = body.width / 2 - wide / 2 - 0.02
    at = [(axle, side * y, r) for axle in body.axles for side in (1, -1)]
    return place(tipped, np.array(at), np.array([0.0, 180.0] * len(body.axles)))


def _rim(looks: Looks, hub: Colour, spokes: int) -> Skin:
    name = f"rim-{hex_name(hub)}-{spokes}"
    if found := looks.known(name):
        return found
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
    return looks.add(Material(name, canvas.texture(), 0.35))
