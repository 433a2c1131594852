"""A field of grass with one pad (paper, Figure 10d), and the open country about it."""

from itertools import pairwise

import numpy as np

from toolkit.content.grounds import grass
from toolkit.content.paint import fractal
from toolkit.content.pieces import Looks, Piece, bars, box, floor_quads, merge, mesh_of, place, polygon, quads, revolved
from toolkit.content.roofs import landing_pad
from toolkit.content.skyline import surround
from toolkit.content.trees import GREENS, conifer, street_tree
from toolkit.content.walls import wall
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass
from toolkit.worlds.world import Spot, World

HORIZON_M = 900.0
F, B = SceneClass.FURNITURE, SceneClass.BUILDING


MEADOWS = ((0.0, -28.0, 14.0, 90.0), (-30.0, 16.0, 13.0, 0.0), (-32.0, -22.0, 13.0, 45.0), (24.0, -14.0, 11.0, 160.0))
"""Where an object may stand besides the pad: x, y, how far it is free, and how it is turned there."""


def build_grass(seed: int = 0) -> World:
    """A meadow with one landing pad in its middle, a fence, a track, and trees on the horizon."""
    looks, rng = Looks(seed), np.random.default_rng([seed, 30])
    meadow = grass(looks, meadow=True)
    inner = np.array([(-60.0, -60.0), (60.0, 60.0)])
    pad = landing_pad(6.0, looks).moved(0, 0, 0)
    pieces = [
        floor_quads((-60, -60, 60, 60), 0.0, meadow, SceneClass.GRASS),
        surround(inner, HORIZON_M, meadow, SceneClass.GRASS, (0.0, 60.0, 300.0)),
        pad,
        floor_quads((-300, -49.0, 300, -45.5), 0.01, wall(looks, "render", (176, 158, 124)), SceneClass.GROUND),
        _fence(looks), tree_line(looks, rng, 95.0, 260.0, 260), hills(looks, rng), windsock(looks).moved(16, 14, 0),
        place(_barn(looks), (-95.0, 70.0, 0.0), 20.0),
    ]  # fmt: skip
    at = rng.uniform(-58, 58, (420, 2))
    at = at[(np.hypot(*at.T) > 13) & (at[:, 1] > -43)]
    pieces.append(place(
        _tuft(looks), np.column_stack([at, np.zeros(len(at))]), rng.uniform(0, 360, len(at)),
        rng.uniform(0.5, 1.4, len(at)),
    ))  # fmt: skip
    spots = (
        Spot("pad", "grass", (0.0, 0.0, 0.25), 5.6, 0.0, "ground"),
        *(
            Spot(f"meadow-{k + 1}", "grass", (x, y, 0.0), radius, yaw, "ground")
            for k, (x, y, radius, yaw) in enumerate(MEADOWS)
        ),
    )
    for spot in spots[1:]:
        pieces = [_outside(piece, spot) for piece in pieces]
    mesh, face_class = mesh_of(merge(*pieces), looks)
    return World(
        "grass", seed, mesh, face_class, spots, np.array([[-107.0, 66.0, 0, -89.0, 80.0, 5.0]]), inner, spots[:1]
    )


def _outside(piece: Piece, spot: Spot) -> Piece:
    """A piece without its faces that stand up from the ground near a spot."""
    centre = piece.vertices[piece.faces].mean(axis=1)
    near = np.hypot(centre[:, 0] - spot.position[0], centre[:, 1] - spot.position[1]) < spot.free_radius_m + 0.5
    keep = ~(near & (centre[:, 2] > spot.position[2] + 0.03))
    return Piece(piece.vertices, piece.normals, piece.uv, piece.faces[keep], piece.material[keep], piece.label[keep])


def tree_line(looks: Looks, rng: np.random.Generator, near: float, far: float, count: int) -> Piece:
    """Broad-leaved trees and spruces in a ring, in clumps."""
    clump = rng.uniform(0, 2 * np.pi, max(1, count // 9))
    angle = clump[rng.integers(0, len(clump), count)] + rng.normal(0, 0.07, count)
    distance = rng.uniform(near, far, count)
    at = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), np.zeros(count)])
    kind, yaw = rng.integers(0, 5, count), rng.uniform(0, 360, count)
    made = [street_tree(looks, k, 10.0) for k in range(3)] + [conifer(looks, k, 13.0) for k in range(2)]
    scale = rng.uniform(0.7, 1.5, count)
    return merge(*[place(made[k], at[kind == k], yaw[kind == k], scale[kind == k]) for k in range(5)])


def hills(looks: Looks, rng: np.random.Generator) -> Piece:
    """A wooded rise all round, far off."""
    name = "woods"
    skin = looks.known(name)
    if skin is None:
        gen, shape = looks.rng(name), (256, 256)
        tone = np.array(GREENS[2], np.float32) * (0.8 + 0.35 * fractal(gen, shape, 24, 4))[..., None]
        skin = looks.add(Material(name, tone.clip(0, 255).astype(np.uint8), 1.0), (60.0, 60.0))
    count = 120
    angle = np.linspace(0, 2 * np.pi, count + 1)
    phase = rng.uniform(0, 6, 3)
    height = (
        16 + 9 * np.sin(3 * angle + phase[0]) + 6 * np.sin(7 * angle + phase[1]) + 3 * np.sin(17 * angle + phase[2])
    )
    height = np.round(np.maximum(height, 3), 3)

    def ring(radius: float, z: np.ndarray | float) -> np.ndarray:
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(z, angle.shape)])

    rows = [ring(520, 0.0), ring(600, height * 0.7), ring(700, height), ring(840, height * 1.5)]
    faces = [np.stack([b[1:], b[:-1], a[:-1], a[1:]], 1) for a, b in pairwise(rows)]
    faces = [np.stack([f[:, 0], f[:, 1], f[:, 2], f[:, 3]], 1)[:, ::-1] for f in faces]
    return quads(np.concatenate(faces), skin, SceneClass.SKYLINE)


def _fence(looks: Looks) -> Piece:
    """Posts and rails along two sides."""
    wood = looks.plain((150, 132, 108), "matte")
    x = np.arange(-58.0, 58.1, 2.9)
    post = np.column_stack([x, np.full(len(x), 40.0), np.zeros(len(x))])
    posts = np.concatenate([post, post[:, [1, 0, 2]]])
    rails = np.array(
        [((-58, 40, z), (58, 40, z)) for z in (0.45, 0.85, 1.2)]
        + [((40, -44, z), (40, 58, z)) for z in (0.45, 0.85, 1.2)]
    )
    posts = posts[(posts[:, 1] > -44.5)]
    return merge(bars(posts, posts + [0, 0, 1.4], 0.13, wood, F), bars(rails[:, 0], rails[:, 1], 0.09, wood, F))


def _tuft(looks: Looks) -> Piece:
    """Long grass: a sheaf of blades."""
    rng = looks.rng("tuft")
    n = 26
    foot = np.column_stack([rng.normal(0, 0.16, (n, 2)), np.zeros(n)])
    lean = np.column_stack([rng.normal(0, 0.14, (n, 2)), rng.uniform(0.25, 0.6, n)])
    side = np.column_stack([rng.normal(0, 1, (n, 2)), np.zeros(n)])
    side *= 0.012 / np.linalg.norm(side, axis=1, keepdims=True)
    return quads(
        np.stack([foot - side, foot + side, foot + lean, foot + lean], 1),
        looks.plain((122, 132, 62), "matte"),
        SceneClass.TREE,
    )


def _barn(looks: Looks) -> Piece:
    """A red barn 18 m by 14 m, its gable to -y."""
    red, tin, white = (
        wall(looks, "cladding", (142, 42, 36)), wall(looks, "cladding", (150, 152, 154)), looks.plain((232, 230, 222)),
    )  # fmt: skip
    gable = np.array([(-7, 0), (7, 0), (7, 5), (0, 9.5), (-7, 5)])
    slope = np.array([
        [(7.4, -0.4, 4.75), (7.4, 18.4, 4.75), (0, 18.4, 9.6), (0, -0.4, 9.6)],
        [(-7.4, 18.4, 4.75), (-7.4, -0.4, 4.75), (0, -0.4, 9.6), (0, 18.4, 9.6)],
    ])  # fmt: skip
    body = merge(
        polygon(gable, 0.0, red, B),
        place(polygon(gable, 0.0, red, B), (0, 18.0, 0), 180.0),
        quads(
            [[(7, 0, 0), (7, 18, 0), (7, 18, 5), (7, 0, 5)], [(-7, 18, 0), (-7, 0, 0), (-7, 0, 5), (-7, 18, 5)]], red, B
        ),
        quads(slope, tin, SceneClass.ROOF),
        quads(slope[:, ::-1] - [0, 0, 0.05], tin, SceneClass.ROOF),
        box((-2.2, 2.2), (-0.06, 0), (0, 3.8), white, B),
        box((-2.0, -0.05), (-0.1, -0.05), (0.1, 3.6), looks.plain((120, 34, 30)), B),
        box((0.05, 2.0), (-0.1, -0.05), (0.1, 3.6), looks.plain((120, 34, 30)), B),
    )
    return place(body, (0.0, 0.0, 0.0), 90.0)


def windsock(looks: Looks) -> Piece:
    """An orange and white sock on a mast."""
    mast = revolved([(0.09, 0), (0.05, 6.0), (0.004, 6.05)], 8, looks.plain((214, 214, 210)), F)
    angle = np.linspace(0, 2 * np.pi, 11)
    pieces = [mast]
    for k in range(5):
        rows = []
        for x in (0.1 + 0.6 * k, 0.1 + 0.6 * (k + 1)):
            r = 0.42 - 0.07 * x
            rows.append(np.column_stack([np.full(11, x), r * np.cos(angle), 5.6 - 0.09 * x * x + r * np.sin(angle)]))
        a, b = rows
        cloth = np.stack([a[:-1], b[:-1], b[1:], a[1:]], 1)
        skin = looks.plain(((240, 96, 20), (244, 244, 240))[k % 2], "matte")
        pieces += [quads(cloth[:, ::-1], skin, F), quads(cloth + (b - a).mean(0) * 0 + [0, 0, 0.004], skin, F)]
    return merge(*pieces)
