"""A stone church with its tower; its front along y = 0 and facing -y, x from 0 to its width."""

import numpy as np

from toolkit.content.buildings import House
from toolkit.content.paint import Canvas
from toolkit.content.pieces import (
    Looks,
    Piece,
    Skin,
    bars,
    boxes,
    floor_quads,
    merge,
    place,
    polygon,
    quads,
    revolved,
    wall_quads,
)
from toolkit.content.signs import sheet
from toolkit.content.walls import STONES, wall
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass

B, R, SIGN, F = SceneClass.BUILDING, SceneClass.ROOF, SceneClass.SIGN, SceneClass.FURNITURE


def pointed_arch(x: float, z0: float, z1: float, width: float) -> np.ndarray:
    """(k, 2) outline of a lancet window about x, counter-clockwise."""
    w = width / 2
    rise = 1.6 * w
    t = np.linspace(0, 1, 7)
    right = np.column_stack([x + w * np.cos(t * np.pi / 2) ** 0.9, z1 - rise + rise * np.sin(t * np.pi / 2)])
    left = right[::-1][1:] * [-1, 1] + [2 * x, 0]
    return np.concatenate([[(x - w, z0), (x + w, z0)], right, left])


def stained_glass(looks: Looks) -> Skin:
    """Leaded panes of many colours."""
    if found := looks.known("stained"):
        return found
    rng = looks.rng("stained")
    canvas = Canvas(1, 3, 96, (20, 20, 24))
    tones = ((38, 60, 130), (130, 34, 40), (46, 104, 70), (176, 140, 50), (70, 50, 110), (50, 92, 130))
    for row in range(18):
        for column in range(6):
            tone = tones[int(rng.integers(len(tones)))]
            x, z = column / 6, row / 6
            canvas.rect(x + 0.012, z + 0.012, x + 0.155, z + 0.155, tuple(int(c * rng.uniform(0.5, 1.1)) for c in tone))
    picture = canvas.texture()
    return looks.add(Material("stained", picture, 0.2, 0.0, picture[::2, ::2].copy()))


def _lancets(at: np.ndarray, z: tuple[float, float], width: float, trim: Skin, looks: Looks) -> Piece:
    """Pointed windows in stone frames at positions along a wall."""
    pieces = []
    for x in at:
        pieces.append(polygon(pointed_arch(x, z[0] - 0.25, z[1] + 0.35, width + 0.5), -0.05, trim, B))
        pieces.append(polygon(pointed_arch(x, *z, width), -0.07, stained_glass(looks), B, fit=True))
    return merge(*pieces)


def church(looks: Looks) -> House:
    """A stone church 16 m wide and 40 m deep: west tower with a spire, nave with a tiled roof, buttresses."""
    stone, trim = wall(looks, "ashlar", STONES[1]), wall(looks, "ashlar", STONES[5])
    slate = wall(looks, "tiles", (84, 88, 98))
    x0, x1, y0, y1, eaves, ridge = 1.5, 14.5, 5.0, 38.0, 9.5, 17.5
    length = y1 - y0
    side = merge(
        wall_quads((0, 0, length, eaves), 0.0, stone, B),
        _lancets(np.arange(3.0, length - 2, 5.2), (2.6, 7.2), 1.5, trim, looks),
        *(_buttress(x, trim, eaves) for x in np.arange(0.5, length, 5.2)),
    )
    middle = (x0 + x1) / 2
    gable = np.array([(x0, 0), (x1, 0), (x1, eaves), (middle, ridge), (x0, eaves)])
    over = 0.5
    slopes = [
        [
            (x0 - over, y0 - 0.3, eaves - 0.5), (middle, y0 - 0.3, ridge + 0.15), (middle, y1 + 0.3, ridge + 0.15),
            (x0 - over, y1 + 0.3, eaves - 0.5),
        ][::-1],
        [
            (x1 + over, y0 - 0.3, eaves - 0.5), (middle, y0 - 0.3, ridge + 0.15), (middle, y1 + 0.3, ridge + 0.15),
            (x1 + over, y1 + 0.3, eaves - 0.5),
        ],
    ]  # fmt: skip
    slopes = [
        slope[::-1] if np.cross(np.subtract(slope[1], slope[0]), np.subtract(slope[2], slope[0]))[2] < 0 else slope
        for slope in slopes
    ]
    east = merge(
        polygon(gable[::1] - [middle, 0], 0.0, stone, B), _lancets(np.array([-3.4, 0, 3.4]), (3, 8.5), 1.8, trim, looks)
    )
    pieces = [
        place(side, [(x0, y1, 0.0), (x1, y0, 0.0)], [270.0, 90.0]),
        polygon(gable, y0, stone, B), place(east, (middle, y1, 0.0), 180.0), quads(np.array(slopes, float), slate, R),
        quads(np.array(slopes, float)[:, ::-1] - [0, 0, 0.06], trim, R),
        _tower(looks, stone, trim).moved(middle, 3.2, 0),
    ]  # fmt: skip
    solids = [[x0, y0, 0, x1, y1, eaves]]
    for k in range(4):  # the attic in steps
        share = (k + 1) / 5
        inset = (x1 - x0) / 2 * share
        solids.append([x0 + inset, y0, eaves, x1 - inset, y1, eaves + (ridge - eaves) * share])
    solids.append([middle - 3.2, 0, 0, middle + 3.2, 6.4, 22.0])
    return House(merge(*pieces), np.array(solids, float))


def _buttress(x: float, skin: Skin, eaves: float) -> Piece:
    low = np.array([(x - 0.35, -0.9, 0), (x - 0.35, -0.5, eaves * 0.5)])
    high = np.array([(x + 0.35, 0, eaves * 0.5), (x + 0.35, 0, eaves * 0.82)])
    return boxes(low, high, skin, B, without=("back", "bottom"))


def _tower(looks: Looks, stone: Skin, trim: Skin) -> Piece:
    """A square tower about the origin with a door, a rose window, a clock, louvres, and a spire with a cross."""
    half, top = 3.2, 22.0
    circle = _circle()
    dark = looks.plain((34, 34, 36), "matte")
    clock = _clock(looks)
    bell = [polygon(pointed_arch(x, 17.6, 20.8, 1.1), -0.05, dark, B) for x in (-1.1, 1.1)]
    louvre = [
        bars((x - 0.5, -0.06, z), (x + 0.5, -0.06, z), 0.09, trim, B)
        for x in (-1.1, 1.1)
        for z in np.arange(17.8, 20.2, 0.35)
    ]
    face = merge(
        wall_quads((-half, 0, half, top), 0.0, stone, B), *bell, *louvre,
        polygon(circle * 1.15 + [0, 15.6], -0.06, trim, B),
        polygon(circle * 0.98 + [0, 15.6], -0.08, clock, SIGN, fit=True),
        boxes(
            [(-half, -0.2, z) for z in (6.6, 13.6, 16.8)], [(half, 0, z + 0.3) for z in (6.6, 13.6, 16.8)], trim, B,
            ("back",),
        ),
        boxes(
            [(-half - 0.4, -0.4, 0), (half - 0.6, -0.4, 0)], [(-half + 0.6, 0, 15), (half + 0.4, 0, 15)], trim, B,
            ("back", "bottom"),
        ),
    )  # fmt: skip
    front = _west_front(looks, trim)
    ring = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    yaws = np.array([0.0, 90.0, 180.0, 270.0])
    at = np.array([(0, -half, 0), (half, 0, 0), (0, half, 0), (-half, 0, 0)], float)
    slate = wall(looks, "tiles", (84, 88, 98))
    spire = revolved([(half * 1.08, top), (0.06, top + 15.0)], 8, slate, R, 20, start_deg=22.5)
    pinnacle = revolved([(0.5, top), (0.5, top + 1.4), (0.62, top + 1.5), (0.02, top + 3.8)], 8, trim, R, 20)
    cross = bars(
        [(0, 0, top + 14.8), (-0.7, 0, top + 16.4)], [(0, 0, top + 17.2), (0.7, 0, top + 16.4)], 0.16,
        looks.plain((196, 160, 70), "metal"), R,
    )  # fmt: skip
    corners = np.column_stack([ring * 0.92, np.zeros(4)])
    deck = floor_quads((-half, -half, half, half), top, trim, R)
    return merge(place(face, at, yaws), place(front, at[:1]), spire, place(pinnacle, corners), cross, deck)


def _circle() -> np.ndarray:
    """(24, 2) points of the unit circle."""
    angle = np.linspace(0, 2 * np.pi, 25)[:-1]
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _clock(looks: Looks) -> Skin:
    """A white dial with gilt-edged night-blue rim, lit in the evening."""
    clock = looks.known("clock")
    if clock is None:
        c = Canvas(2, 2, 96, (22, 26, 40), low=(-1, -1))
        c.disc(0, 0, 0.94, (240, 234, 214))
        for k in range(12):
            a = np.pi * k / 6
            c.line([(0.72 * np.sin(a), 0.72 * np.cos(a)), (0.88 * np.sin(a), 0.88 * np.cos(a))], 0.07, (22, 26, 40))
        c.line([(0, 0), (0.42, 0.3)], 0.08, (16, 16, 20))
        c.line([(0, 0), (-0.1, 0.74)], 0.055, (16, 16, 20))
        clock = sheet("clock", looks, c, 0.8)
    return clock


def _west_front(looks: Looks, trim: Skin) -> Piece:
    """Door and rose window."""
    circle, dark = _circle(), looks.plain((34, 34, 36), "matte")
    return merge(
        polygon(pointed_arch(0, 0.0, 5.4, 3.4), -0.06, trim, B),
        polygon(pointed_arch(0, 0.0, 4.8, 2.5), -0.1, looks.plain((74, 44, 26)), B),
        bars((0, -0.11, 0), (0, -0.11, 4.6), 0.06, dark, B),
        polygon(circle * 1.9 + [0, 10.2], -0.06, trim, B),
        polygon(circle * 1.6 + [0, 10.2], -0.09, stained_glass(looks), B, fit=True),
        bars(
            np.array([(0, -0.12, 10.2)] * 8),
            np.column_stack([circle[::3, 0] * 1.6, np.full(8, -0.12), circle[::3, 1] * 1.6 + 10.2]),
            0.1, trim, B,
        ),
    )  # fmt: skip
