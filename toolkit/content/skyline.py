"""What is seen of a town from afar: ground, and blocks with painted facades round what is built in relief."""

from itertools import pairwise

import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import Canvas
from toolkit.content.pieces import Looks, Piece, Skin, floor_quads, merge, quads
from toolkit.content.walls import BRICKS, RENDERS, STONES, wall
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass

FAR = SceneClass.SKYLINE
BAYS, FLOORS = 5, 4
BAY_M, FLOOR_M = 2.8, 3.3
STYLES: tuple[tuple[Colour, Colour, tuple[float, float]], ...] = (
    (BRICKS[0], (206, 198, 182), (0.42, 0.55)), (BRICKS[3], (176, 166, 150), (0.42, 0.52)),
    (STONES[0], (226, 222, 212), (0.46, 0.6)), (RENDERS[0], (232, 230, 222), (0.44, 0.56)),
    (BRICKS[5], (150, 140, 130), (0.4, 0.5)), ((110, 122, 136), (70, 78, 88), (0.94, 0.72)),
    ((74, 92, 104), (186, 190, 194), (0.94, 0.8)), (STONES[3], (120, 118, 114), (0.9, 0.5)),
)  # fmt: skip


def painted_facade(looks: Looks, style: int) -> Skin:
    """A facade of `BAYS` by `FLOORS` windows that repeats."""
    name = f"facade-{style}"
    if found := looks.known(name):
        return found
    ground, trim, (share_w, share_h) = STYLES[style]
    rng, width, height = looks.rng(name), BAYS * BAY_M, FLOORS * FLOOR_M
    day, night = Canvas(width, height, 28, ground), Canvas(width, height, 7, (0, 0, 0))
    for row in range(FLOORS):
        z = row * FLOOR_M
        if share_w < 0.9:
            day.rect(0, z, width, z + 0.18, tuple(int(0.5 * a + 0.5 * b) for a, b in zip(ground, trim, strict=True)))
        for column in range(BAYS):
            w, h = BAY_M * share_w, FLOOR_M * share_h
            x0, z0 = (column + 0.5) * BAY_M - w / 2, z + 0.32 * FLOOR_M
            z0 = min(z0, z + FLOOR_M - h - 0.1)
            day.rect(x0 - 0.1, z0 - 0.14, x0 + w + 0.1, z0 + h + 0.1, trim)
            tone = rng.uniform(0.55, 1.3)
            day.rect(x0, z0, x0 + w, z0 + h, tuple(int(c * tone) for c in (62, 74, 86)))
            day.rect(x0, z0 + 0.55 * h, x0 + w, z0 + h, tuple(int(min(255, c * tone)) for c in (104, 122, 138)))
            if rng.random() < 0.35:
                day.rect(x0, z0 + h * rng.uniform(0.3, 0.8), x0 + w, z0 + h, (200, 194, 180))
            day.rect(x0 + w / 2 - 0.04, z0, x0 + w / 2 + 0.04, z0 + h, trim)
            if rng.random() < 0.4:
                bright, _, cool = rng.uniform(0.5, 1, 3)
                lit = np.array((255, 206, 130)) * bright * (1, 1, 0.5 + cool)
                night.rect(x0, z0, x0 + w, z0 + h, tuple(int(c) for c in lit))
    return looks.add(Material(name, day.texture(0.06, rng), 0.7, 0.0, night.texture()), (width, height))


def towers(low: np.ndarray, high: np.ndarray, looks: Looks, rng: np.random.Generator) -> Piece:
    """Blocks (n, 3) low and high corners with painted facades and roofs, their windows whole."""
    style = rng.integers(0, len(STYLES), len(low))
    felt = wall(looks, "roofing", (104, 104, 102))
    pieces = []
    for k in range(len(STYLES)):
        a, b = low[style == k], high[style == k]
        if not len(a):
            continue
        skin = painted_facade(looks, k)
        size = b - a
        floors = np.maximum(np.round(size[:, 2] / FLOOR_M), 1) / FLOORS
        for side in range(4):
            x0, x1 = (a[:, 0], b[:, 0]) if side % 2 == 0 else (a[:, 1], b[:, 1])
            bays = np.maximum(np.round((x1 - x0) / BAY_M), 1) / BAYS
            start = rng.integers(0, BAYS, len(a)) / BAYS
            corner = {0: ((0, 1), (1, 1)), 1: ((1, 1), (1, 0)), 2: ((1, 0), (0, 0)), 3: ((0, 0), (0, 1))}[side]
            points = [
                np.column_stack([np.where(px, b[:, 0], a[:, 0]), np.where(py, a[:, 1], b[:, 1])]) for px, py in corner
            ]
            rows = [
                np.column_stack([points[0], a[:, 2]]), np.column_stack([points[1], a[:, 2]]),
                np.column_stack([points[1], b[:, 2]]), np.column_stack([points[0], b[:, 2]]),
            ]  # fmt: skip
            zero = np.zeros(len(a))
            uv = np.stack(
                [
                    np.column_stack([start, zero]), np.column_stack([start + bays, zero]),
                    np.column_stack([start + bays, floors]), np.column_stack([start, floors]),
                ],
                1,
            )  # fmt: skip
            pieces.append(quads(np.stack(rows, 1), skin, FAR, uv))
        rect = np.column_stack([a[:, :2], b[:, :2]])
        pieces.append(floor_quads(rect, b[:, 2], felt, FAR))
    return merge(*pieces)


def surround(
    inner: np.ndarray, reach_m: float, ground: Skin, label: int, steps: tuple[float, ...] = (0.0, 200.0)
) -> Piece:
    """Flat ground at z = 0 round a rectangle (2, 2) out to `reach_m` from it, in rings so that quads stay small."""
    (x0, y0), (x1, y1) = inner
    edges = [*(step for step in steps if step < reach_m), reach_m]
    rects = []
    for near, far in pairwise(edges):
        rects += [
            (x0 - far, y0 - far, x1 + far, y0 - near), (x0 - far, y1 + near, x1 + far, y1 + far),
            (x0 - far, y0 - near, x0 - near, y1 + near), (x1 + near, y0 - near, x1 + far, y1 + near),
        ]  # fmt: skip
    return floor_quads(np.array(rects), 0.0, ground, label)
