"""What stands on squares: a fountain, an obelisk, flags."""

import numpy as np

from toolkit.content.pieces import Looks, Piece, bars, box, boxes, merge, quads, revolved
from toolkit.content.walls import STONES, wall
from toolkit.worlds.classes import SceneClass

B, R, SIGN, F = SceneClass.BUILDING, SceneClass.ROOF, SceneClass.SIGN, SceneClass.FURNITURE


def fountain(looks: Looks) -> Piece:
    """A round basin 8 m across with two bowls and water."""
    stone = wall(looks, "ashlar", STONES[2])
    basin = [(4.0, 0), (4.0, 0.55), (4.15, 0.6), (4.15, 0.7), (3.7, 0.7), (3.7, 0.4)]
    bowls = [
        (0.5, 0.3), (0.45, 1.3), (1.7, 1.7), (1.85, 1.85), (1.6, 1.8), (0.3, 1.75), (0.28, 2.7), (0.9, 2.95),
        (0.95, 3.05), (0.7, 3.0), (0.12, 2.98), (0.1, 3.4), (0.005, 3.5),
    ]  # fmt: skip
    water = looks.plain((120, 160, 172), "gloss")
    turn = np.linspace(0, 2 * np.pi, 28, endpoint=False)
    jet = np.column_stack([np.cos(turn), np.sin(turn)])
    start, end = np.column_stack([jet * 1.7, np.full(28, 1.85)]), np.column_stack([jet * 2.6, np.full(28, 0.5)])
    return merge(
        revolved(basin, 32, stone, F),
        revolved(bowls, 24, stone, F),
        revolved([(3.75, 0.5), (0.005, 0.5)], 32, water, F),
        bars(start, end, 0.05, looks.plain((214, 226, 232), "gloss"), F),
    )


def monument(looks: Looks) -> Piece:
    """An obelisk on a stepped pedestal, 11 m."""
    stone = wall(looks, "ashlar", STONES[3])
    steps = np.array([(-2.4 + 0.4 * k, -2.4 + 0.4 * k, 0.35 * k) for k in range(3)])
    shaft = revolved([(0.95, 2.6), (0.62, 10.0), (0.02, 11.0)], 4, stone, F, 20, start_deg=45)
    return merge(
        boxes(steps, -steps * [1, 1, 0] + [0, 0, 0.35] + steps * [0, 0, 1], stone, F),
        box((-1.1, 1.1), (-1.1, 1.1), (1.05, 2.6), stone, F),
        shaft,
    )


def flag(looks: Looks, tone: int) -> Piece:
    """A flag of three bands waving from a pole of 9 m."""
    bands = (
        ((20, 60, 140), (240, 240, 240), (200, 30, 40)),
        ((24, 110, 60), (246, 210, 60), (200, 30, 40)),
        ((30, 30, 34), (206, 30, 40), (246, 200, 40)),
    )[tone % 3]
    x = np.linspace(0.05, 2.2, 12)
    wave = 0.16 * np.sin(x * 4.0) * x / 2
    pieces = [revolved([(0.08, 0), (0.045, 9.0), (0.09, 9.05), (0.005, 9.15)], 8, looks.plain((210, 210, 206)), F)]
    for k, colour in enumerate(bands):
        z0, z1 = 8.8 - 0.5 * (k + 1), 8.8 - 0.5 * k
        low, high = np.column_stack([x, wave, np.full(12, z0)]), np.column_stack([x, wave, np.full(12, z1)])
        corners = np.stack([low[:-1], low[1:], high[1:], high[:-1]], 1)
        skin = looks.plain(colour, "matte")
        pieces += [quads(corners, skin, F), quads(corners[:, ::-1] + [0, 0.012, 0], skin, F)]
    return merge(*pieces)
