"""Geometry in bulk: many quads, boxes and copies at once, each with its look and its class.

Frame: metres, z up. A wall is built with its outside towards -y and x to the right of somebody who looks at it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike

from toolkit.objects.mesh import Material, Mesh, mesh_from_corners
from toolkit.rooms.worlds.content.drawing import Ink, Rng
from toolkit.rooms.worlds.content.modelling import Part, revolve

CELL_PX, CELLS = 8, 32
GRID_PER_M = 4096
"""Vertices lie on a grid of 1/4096 m: the last bits of a sine differ between machines, a world does not."""
FINISHES = {"matte": (0.85, 0.0), "paint": (0.45, 0.0), "gloss": (0.15, 0.0), "metal": (0.4, 1.0), "lamp": (0.5, 0.0)}
"""Roughness and metallic of plain colours; a lamp gives its colour off as light."""


@dataclass(frozen=True)
class Skin:
    """How a surface looks: a material, and how its texture lies."""

    material: int  # index among the world's materials
    tile_m: tuple[float, float] = (1.0, 1.0)  # width and height that the texture covers before it repeats
    at: tuple[float, float] | None = None  # a single place (u, v) of the texture for the whole surface: a plain colour


Painter = Callable[[Rng], np.ndarray | tuple[np.ndarray, np.ndarray | None]]
"""Paints a texture, uint8; or a texture and the light that it gives off."""


class Looks:
    """The materials of a world, each painted once, on its first use, from (seed, name)."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._materials: list[Material] = []
        self._skins: dict[str, Skin] = {}
        self._plain: dict[tuple[Ink, str], Skin] = {}
        self._sheets: dict[str, np.ndarray] = {}
        self._pieces: dict[str, Piece] = {}

    @property
    def materials(self) -> tuple[Material, ...]:
        """All that were used, in the order of their first use."""
        return tuple(self._materials)

    def rng(self, name: str) -> Rng:
        """The generator that paints `name`."""
        # by name: what is painted does not depend on what was painted before it (Python's own hash differs by run)
        return Rng([self.seed, crc32(name.encode())])

    def once(self, name: str, make: Callable[[Rng], "Piece"]) -> "Piece":
        """A piece that is modelled once, from (seed, name), and copied from then on."""
        if name not in self._pieces:
            self._pieces[name] = make(self.rng(name))
        return self._pieces[name]

    def paint(self, name: str, make: Painter, roughness: float, tile_m: tuple[float, float] = (1.0, 1.0)) -> Skin:
        """The skin of a texture that is painted on its first use, from (seed, name)."""
        if name not in self._skins:
            made = make(self.rng(name))
            picture, glow = made if isinstance(made, tuple) else (made, None)
            self.add(Material(name, picture, roughness, emission=glow), tile_m)
        return self._skins[name]

    def add(self, material: Material, tile_m: tuple[float, float] = (1.0, 1.0)) -> Skin:
        """A material with its own texture."""
        self._materials.append(material)
        self._skins[material.name] = Skin(len(self._materials) - 1, tile_m)
        return self._skins[material.name]

    def plain(self, colour: Ink, finish: str = "paint") -> Skin:
        """An sRGB colour; all plain colours of a finish share one texture."""
        key = tuple(int(c) for c in colour), finish
        if key not in self._plain:
            # a page of the finish holds CELLS² colours; further colours begin another
            used = sum(1 for _, other in self._plain if other == finish)
            page, used = divmod(used, CELLS * CELLS)
            name = f"plain-{finish}{page or ''}"
            if name not in self._sheets:
                sheet = np.full((CELLS * CELL_PX, CELLS * CELL_PX, 3), 128, np.uint8)
                roughness, metallic = FINISHES[finish]
                lit = sheet if finish == "lamp" else None
                self._sheets[name] = sheet
                self.add(Material(name, sheet, roughness, metallic, emission=lit))
            row, column = divmod(used, CELLS)
            cell = slice(row * CELL_PX, (row + 1) * CELL_PX), slice(column * CELL_PX, (column + 1) * CELL_PX)
            self._sheets[name][cell] = colour
            # the middle of its cell: a filtered look-up stays within it
            at = ((column + 0.5) / CELLS, 1 - (row + 0.5) / CELLS)
            self._plain[key] = Skin(self._skins[name].material, at=at)
        return self._plain[key]


def painted(
    name: str, roughness: float, tile_m: tuple[float, float] = (1.0, 1.0)
) -> Callable[[Painter], Callable[[Looks], Skin]]:
    """Make a painter the function that gives its skin in a world."""
    return lambda make: wraps(make)(lambda looks: looks.paint(name, make, roughness, tile_m))


@dataclass(frozen=True)
class Piece:
    """Triangles with a material and a class for each; the arrays of a `Mesh`, and `label` (m,) uint8."""

    vertices: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    material: np.ndarray
    label: np.ndarray

    def labelled(self, label: int) -> "Piece":
        """All of it of the same class."""
        return replace(self, label=np.full(len(self.faces), label, np.uint8))

    def moved(self, x: float = 0, y: float = 0, z: float = 0) -> "Piece":
        """Translated by metres."""
        return replace(self, vertices=self.vertices + np.array([x, y, z], np.float32))

    def tipped(self, x: int, y: int, z: int) -> "Piece":
        """With y and z exchanged, then each axis times its sign."""
        order, sign = [0, 2, 1], np.array([x, y, z], np.float32)
        return replace(self, vertices=self.vertices[:, order] * sign, normals=self.normals[:, order] * sign)

    def turned(self, yaw_deg: float) -> "Piece":
        """Turned about z, counter-clockwise from above."""
        return place(self, np.zeros((1, 3)), np.array([yaw_deg]))


UNIT = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
"""The corners of a whole texture."""
EMPTY = Piece(
    np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros((0, 2), np.float32),
    np.zeros((0, 3), np.int32), np.zeros(0, np.int32), np.zeros(0, np.uint8),
)  # fmt: skip


def merge(*parts: Piece) -> Piece:
    """A piece with the triangles of all, in order."""
    pieces = [piece for piece in parts if len(piece.faces)]
    if not pieces:
        return EMPTY
    # faces name vertices by number, so each piece's start after those before
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    return Piece(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.normals for piece in pieces]),
        np.concatenate([piece.uv for piece in pieces]),
        np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)]).astype(np.int32),
        np.concatenate([piece.material for piece in pieces]),
        np.concatenate([piece.label for piece in pieces]),
    )


def xyz(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> np.ndarray:
    """(n, 3) points from coordinates, each an array (n,) or one number for all."""
    return np.stack(np.broadcast_arrays(*(np.asarray(axis, np.float64) for axis in (x, y, z))), -1)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, 3) cross products of (n, 3); several times as fast as NumPy's on few vectors."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    result = np.empty((len(a), 3))
    result[:, 0], result[:, 1], result[:, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return result


def quads(corners: ArrayLike, skin: Skin, label: int, uv: ArrayLike | None = None) -> Piece:
    """Flat four-cornered faces (n, 4, 3), counter-clockwise from outside; empty ones are left out.

    Without `uv` (n, 4, 2) or (4, 2), in turns of the texture, it lies with u along the first edge, true to scale.
    """
    quad = np.asarray(corners, np.float64).reshape(-1, 4, 3)
    # of the diagonals: twice the area of a flat quad, and right for those with two corners in the same place
    normal = cross(quad[:, 2] - quad[:, 0], quad[:, 3] - quad[:, 1])
    size = np.sqrt((normal**2).sum(axis=1))
    real = size > 1e-7
    quad, normal = quad[real], normal[real] / size[real, None]
    n = len(quad)
    # a plain colour is a single place of its texture, whatever `uv` says
    if skin.at is not None:
        texture = np.broadcast_to(np.array(skin.at), (n, 4, 2))
    elif uv is not None:
        texture = np.broadcast_to(np.asarray(uv, np.float64).reshape(-1, 4, 2), (len(real), 4, 2))[real]
    else:
        along = quad[:, 1] - quad[:, 0]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        up = cross(normal, along)
        texture = np.stack([np.einsum("nkx,nx->nk", quad, along), np.einsum("nkx,nx->nk", quad, up)], 2)
        texture = texture / np.array(skin.tile_m)
        # moved by whole textures: float32 keeps the digits that count
        texture = texture - np.floor(texture[:, :1])
    # two triangles for each quad, which shares no corner with its neighbours
    index = np.arange(4 * n).reshape(n, 4)
    faces = np.stack([index[:, [0, 1, 2]], index[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    return Piece(
        quad.reshape(-1, 3).astype(np.float32), np.repeat(normal, 4, axis=0).astype(np.float32),
        texture.reshape(-1, 2).astype(np.float32), faces.astype(np.int32), np.full(2 * n, skin.material, np.int32),
        np.full(2 * n, label, np.uint8),
    )  # fmt: skip


def wall_quads(rect: ArrayLike, y: float | np.ndarray, skin: Skin, label: int, fit: bool = False) -> Piece:
    """Rectangles (n, 4) of x0, z0, x1, z1 that face -y; the texture is anchored at the wall's origin, or fitted."""
    rects = np.asarray(rect, np.float64).reshape(-1, 4)
    keep = (rects[:, 2:] - rects[:, :2] > 1e-4).all(axis=1)
    corners = upright(rects[keep], np.broadcast_to(y, len(rects))[keep])
    return quads(corners, skin, label, UNIT if fit else corners[..., [0, 2]] / np.array(skin.tile_m))


def upright(rect: ArrayLike, y: float | np.ndarray) -> np.ndarray:
    """(n, 4, 3) corners of rectangles (n, 4) of x0, z0, x1, z1 that face -y."""
    x0, z0, x1, z1 = np.asarray(rect, np.float64).reshape(-1, 4).T
    return np.stack([xyz(x, y, z) for x, z in ((x0, z0), (x1, z0), (x1, z1), (x0, z1))], 1)


def set_round(width: float, depth: float, make: Callable[[int, float], Piece]) -> Piece:
    """Four walls round a rectangle: front, right, back, left, each made for its number and its width."""
    corners = ((0, 0, 0), (width, 0, 0), (width, depth, 0), (0, depth, 0))
    return merge(*(place(make(k, depth if k % 2 else width), at, 90.0 * k) for k, at in enumerate(corners)))


def floor_quads(rect: ArrayLike, z: float | np.ndarray, skin: Skin, label: int, fit: bool = False) -> Piece:
    """Rectangles (n, 4) of x0, y0, x1, y1 that face up; the texture is anchored at the world's origin, or fitted."""
    corners = upright(rect, z)[..., [0, 2, 1]]
    return quads(corners, skin, label, UNIT if fit else corners[..., :2] / np.array(skin.tile_m))


SIDES = {
    "front": [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
    "right": [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)],
    "back": [(1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1)],
    "left": [(0, 1, 0), (0, 0, 0), (0, 0, 1), (0, 1, 1)],
    "top": [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    "bottom": [(0, 1, 0), (1, 1, 0), (1, 0, 0), (0, 0, 0)],
}


def boxes(low: ArrayLike, high: ArrayLike, skin: Skin, label: int, without: Sequence[str] = ("bottom",)) -> Piece:
    """Upright boxes between corners (n, 3); `without` names faces nobody sees."""
    lows, highs = (np.asarray(corner, np.float64).reshape(-1, 1, 3) for corner in (low, high))
    pick = [np.array(SIDES[name], float) for name in SIDES if name not in without]
    return quads(np.concatenate([lows + (highs - lows) * side for side in pick]), skin, label)


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], skin: Skin, label: int) -> Piece:
    """A box with all its faces."""
    low, high = zip(x, y, z, strict=True)
    return boxes(np.array([low]), np.array([high]), skin, label, without=())


def solid(parts: Sequence[Part], skin: Skin, label: int, crease_deg: float = 40.0) -> Piece:
    """Modelled parts in a single look, smooth across edges flatter than `crease_deg`."""
    parts = [part for part in parts if len(part.faces)]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    uv = np.concatenate([part.corner_uv for part in parts])
    uv = uv / np.array(skin.tile_m) if skin.at is None else np.broadcast_to(np.array(skin.at), uv.shape)
    mesh = mesh_from_corners(vertices, faces, uv, np.zeros(len(faces)), (), crease_deg)
    return from_mesh(mesh, skin.material, label)


def revolved(
    profile: Sequence[tuple[float, float]], segments: int, skin: Skin, label: int, crease_deg: float = 40.0,
    start_deg: float = 180.0,
) -> Piece:  # fmt: skip
    """`revolve` in a single look, see `solid`."""
    return solid([revolve(profile, segments, start_deg=start_deg)], skin, label, crease_deg)


def from_mesh(mesh: Mesh, material: int, label: int) -> Piece:
    """A mesh as a piece of a single material and class."""
    n = len(mesh.faces)
    return Piece(
        mesh.vertices, mesh.normals, mesh.uv, mesh.faces, np.full(n, material, np.int32), np.full(n, label, np.uint8)
    )


def place(piece: Piece, at: ArrayLike, yaw_deg: ArrayLike = 0.0, scale: ArrayLike = 1.0) -> Piece:
    """Copies at positions (k, 3), turned about z and scaled by (k,) or (k, 3), none of it negative."""
    at = np.asarray(at, np.float64).reshape(-1, 3)
    k, n = len(at), len(piece.vertices)
    if not k or not n:
        return EMPTY
    yaw = np.radians(np.broadcast_to(np.asarray(yaw_deg, np.float64), (k,)))
    # a factor for all axes, or three
    factor = np.asarray(scale, np.float64)
    factor = np.broadcast_to(factor.reshape(-1, 1) if factor.ndim < 2 else factor, (k, 3))
    # rounded: the last bits of a sine differ between machines
    cosine, sine = np.round(np.cos(yaw), 9)[:, None], np.round(np.sin(yaw), 9)[:, None]

    def turn(vectors: np.ndarray) -> np.ndarray:
        x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
        return np.stack([x * cosine - y * sine, x * sine + y * cosine, z], axis=2)

    vertices = turn(piece.vertices[None] * factor[:, None]) + at[:, None]
    # normals scale by the inverse: a surface that is stretched leans less
    normals = turn(piece.normals[None] / factor[:, None])
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    return Piece(
        vertices.reshape(-1, 3).astype(np.float32), normals.reshape(-1, 3).astype(np.float32),
        # copies share looks and classes with the piece
        np.tile(piece.uv, (k, 1)),
        (piece.faces[None] + n * np.arange(k)[:, None, None]).reshape(-1, 3).astype(np.int32),
        np.tile(piece.material, k), np.tile(piece.label, k),
    )  # fmt: skip


def bars(start: ArrayLike, end: ArrayLike, thick_m: float | np.ndarray, skin: Skin, label: int) -> Piece:
    """Square rods between points (n, 3) and (n, 3), open at their ends: rails, trusses, wires, masts."""
    start, end = np.asarray(start, np.float64).reshape(-1, 3), np.asarray(end, np.float64).reshape(-1, 3)
    start, end = np.broadcast_arrays(start, end)
    along = end - start
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    # any direction that is not the rod's own
    hint = np.where(np.abs(along[:, 2:]) > 0.9, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    side = cross(np.broadcast_to(hint, along.shape), along)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = cross(along, side)
    half = np.broadcast_to(np.asarray(thick_m, np.float64) / 2, (len(start),))[:, None]
    # four corners of the section, in turn round the rod
    ring = [(-side - up) * half, (side - up) * half, (side + up) * half, (up - side) * half]
    faces = [np.stack([start + ring[k], start + ring[k - 3], end + ring[k - 3], end + ring[k]], 1) for k in range(4)]
    return quads(np.concatenate(faces), skin, label)


def fan_faces(count: int) -> np.ndarray:
    """(n, 3) int32 triangles of a convex outline of `count` corners."""
    return np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], 1).astype(np.int32)


def polygon(
    outline: ArrayLike, y: float, skin: Skin, label: int, fit: bool = False, uv: np.ndarray | None = None
) -> Piece:
    """A convex outline (k, 2) of x and z, counter-clockwise, that faces -y; its texture anchored, fitted or given."""
    outline = np.asarray(outline, np.float64)
    k = len(outline)
    low, high = outline.min(0), outline.max(0)
    # in metres of the texture, or stretched over the outline
    if uv is None:
        uv = (outline - low) / (high - low) if fit else outline / np.array(skin.tile_m)
    if skin.at is not None:
        uv = np.broadcast_to(np.array(skin.at), (k, 2))
    return Piece(
        xyz(outline[:, 0], y, outline[:, 1]).astype(np.float32),
        np.tile(np.array([[0, -1, 0]], np.float32), (k, 1)),
        uv.astype(np.float32), fan_faces(k), np.full(k - 2, skin.material, np.int32), np.full(k - 2, label, np.uint8),
    )  # fmt: skip


def mesh_of(piece: Piece, looks: Looks) -> tuple[Mesh, np.ndarray]:
    """The mesh of a finished piece, its vertices on the grid, and (m,) the class of each face."""
    snapped = np.round(piece.vertices.astype(np.float64) * GRID_PER_M) / GRID_PER_M
    corners = snapped[piece.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    real = area > 1e-7
    mesh = Mesh(
        snapped.astype(np.float32), np.round(piece.normals, 5).astype(np.float32),
        np.round(piece.uv, 6).astype(np.float32), piece.faces[real], piece.material[real], looks.materials,
    )  # fmt: skip
    return mesh, piece.label[real]
