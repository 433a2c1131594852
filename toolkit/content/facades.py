"""A wall with its openings, in relief: reveals, sills, lintels, cornices, pilasters, balconies, fire escapes.

Frame of a wall: x to the right seen from outside, z up, outside towards -y; see `toolkit.content.pieces`.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from toolkit.content.pieces import EMPTY, Looks, Piece, Skin, bars, boxes, merge, quads, wall_quads
from toolkit.content.windows import pane_sheet, pane_uv
from toolkit.worlds.classes import SceneClass

BUILDING = SceneClass.BUILDING
CORNER_M = 0.45
"""Least wall between a corner and the first bay."""


@dataclass(frozen=True)
class Facade:
    """How a wall with windows is made.

    Attributes:
        wall, trim: skins of the wall, and of what stands out from it.
        panes: name of the window style.
        window_m: width, height and height above the floor of an opening.
        floor_m, bay_m: height of a floor, width wished for a bay.
        recess_m: depth of the window in its opening.
        sills, lintels: whether openings have them.
        pilasters: whether flat piers stand between the bays.
        string_course: whether a band runs round at each floor.
        balconies: share of the bays with balconies.
        fire_escape: whether one hangs on the street's side.
        air_conditioners: share of the windows with a box in it.
    """

    wall: Skin
    trim: Skin
    panes: str
    window_m: tuple[float, float, float] = (1.1, 1.7, 0.85)
    floor_m: float = 3.2
    bay_m: float = 2.6
    recess_m: float = 0.2
    sills: bool = True
    lintels: bool = True
    pilasters: bool = False
    string_course: bool = False
    balconies: float = 0.0
    fire_escape: bool = False
    air_conditioners: float = 0.0


def bay_edges(width: float, bay_m: float) -> np.ndarray:
    """Left and right edges of the bays of a wall."""
    count = max(1, round((width - 2 * CORNER_M) / bay_m))
    return np.linspace(CORNER_M, width - CORNER_M, count + 1)


def windowed_wall(
    style: Facade, width: float, looks: Looks, rng: np.random.Generator, *, z0: float, floors: int, plain: bool = False
) -> Piece:
    """A wall from z0 up with `floors` rows of windows; `plain` leaves out all that decorates a street's side."""
    edges = bay_edges(width, style.bay_m)
    middle = (edges[1:] + edges[:-1]) / 2
    w, h, sill = style.window_m
    w = min(w, float(np.diff(edges)[0]) - 0.25)
    base = z0 + style.floor_m * np.arange(floors)
    x0, x1 = middle - w / 2, middle + w / 2
    low, high = base + sill, np.minimum(base + sill + h, base + style.floor_m - 0.12)
    top = z0 + floors * style.floor_m
    pieces = [_around_openings(style.wall, width, (z0, top), np.stack([x0, x1], 1), np.stack([low, high], 1))]
    cell = np.array([(a, c, b, d) for c, d in zip(low, high, strict=True) for a, b in zip(x0, x1, strict=True)])
    pieces.append(openings(cell, style, looks, rng))
    if style.sills:
        pieces.append(_blocks(cell[:, [0, 2]] + [-0.08, 0.08], cell[:, 1] - 0.1, cell[:, 1], 0.09, style.trim))
    if style.lintels and not plain:
        pieces.append(_blocks(cell[:, [0, 2]] + [-0.14, 0.14], cell[:, 3], cell[:, 3] + 0.2, 0.04, style.trim))
    if style.air_conditioners:
        pieces.append(_air_conditioners(cell[rng.random(len(cell)) < style.air_conditioners], looks))
    if plain:
        return merge(*pieces)
    if style.string_course:
        full = np.broadcast_to([0.0, width], (floors, 2))
        pieces.append(_blocks(full, base - 0.1, base + 0.14, 0.07, style.trim))
    if style.pilasters:
        at = edges[1:-1] if len(edges) > 2 else edges
        span = np.stack([at - 0.22, at + 0.22], 1)
        pieces.append(_blocks(span, np.full(len(at), z0), np.full(len(at), top), 0.12, style.trim))
    if style.balconies:
        pieces.append(_balconies(cell[rng.random(len(cell)) < style.balconies], base, style, looks))
    if style.fire_escape and width > 7 and floors > 1:
        pieces.append(fire_escape(float(middle[len(middle) // 2]), base, looks))
    return merge(*pieces)


def _around_openings(skin: Skin, width: float, z: tuple[float, float], across: np.ndarray, up: np.ndarray) -> Piece:
    """The wall with a grid of holes: strips below and above each row, and piers between."""
    rows = np.concatenate([[z[0]], up.reshape(-1), [z[1]]])
    strips = [(0.0, rows[2 * k], width, rows[2 * k + 1]) for k in range(len(up) + 1)]
    columns = np.concatenate([[0.0], across.reshape(-1), [width]])
    piers = [(columns[2 * i], low, columns[2 * i + 1], high) for low, high in up for i in range(len(across) + 1)]
    return wall_quads(np.array(strips + piers), 0.0, skin, BUILDING)


def openings(cell: np.ndarray, style: Facade, looks: Looks, rng: np.random.Generator) -> Piece:
    """Reveals and panes of openings (n, 4) of x0, z0, x1, z1."""
    x0, z0, x1, z1 = cell.T
    depth = style.recess_m
    panes = pane_sheet(looks, style.panes)
    front = np.stack([_at(x0, 0, z0), _at(x1, 0, z0), _at(x1, 0, z1), _at(x0, 0, z1)], 1)
    back = front + [0, depth, 0]
    sides = [np.stack([front[:, k], front[:, k - 3], back[:, k - 3], back[:, k]], 1) for k in range(4)]
    uv = pane_uv(rng, len(cell), mirror=True)
    return merge(quads(np.concatenate(sides), style.wall, BUILDING), quads(back, panes, BUILDING, uv))


def _at(x: np.ndarray, y: float, z: np.ndarray) -> np.ndarray:
    return np.stack([x, np.full(len(x), float(y)), z], 1)


def _blocks(span: np.ndarray, z0: np.ndarray, z1: np.ndarray, out_m: float, skin: Skin) -> Piece:
    """Blocks on the wall that stand out by `out_m`, from spans (n, 2) along it."""
    return boxes(_at(span[:, 0], -out_m, z0), _at(span[:, 1], 0.0, z1), skin, BUILDING, without=("back",))


def cornice(
    width: float, z: float, skin: Skin, out_m: float = 0.45, *, dentils: bool = True, ends: bool = True
) -> Piece:
    """Mouldings that step out below z; they run on round corners with `ends`."""
    steps = [(z - 0.75, z - 0.5, 0.25), (z - 0.5, z - 0.22, 0.6), (z - 0.22, z, 1.0)]
    reach = out_m if ends else 0.0
    pieces = []
    for low, high, share in steps:
        span = np.array([[-reach * share, width + reach * share]])
        block = boxes(
            _at(span[:, 0], -out_m * share, np.array([low])), _at(span[:, 1], 0.1, np.array([high])), skin, BUILDING,
            without=("back",),
        )  # fmt: skip
        pieces.append(block)
    if dentils:
        at = np.arange(0.3, width - 0.2, 0.55)
        span = np.stack([at, at + 0.26], 1)
        pieces.append(_blocks(span, np.full(len(at), z - 0.52), np.full(len(at), z - 0.24), out_m * 0.85, skin))
    return merge(*pieces)


def _air_conditioners(cell: np.ndarray, looks: Looks) -> Piece:
    if not len(cell):
        return EMPTY
    x = (cell[:, 0] + cell[:, 2]) / 2
    low, high = _at(x - 0.32, -0.34, cell[:, 1] + 0.02), _at(x + 0.32, 0.15, cell[:, 1] + 0.44)
    grille = _at(x - 0.26, -0.345, cell[:, 1] + 0.07), _at(x + 0.26, -0.34, cell[:, 1] + 0.39)
    return merge(
        boxes(low, high, looks.plain((206, 204, 194)), BUILDING, without=("back",)),
        boxes(*grille, looks.plain((96, 98, 98)), BUILDING, without=("back", "top", "bottom")),
    )


def _balconies(cell: np.ndarray, base: np.ndarray, style: Facade, looks: Looks) -> Piece:
    """Slabs with railings in front of openings."""
    if not len(cell):
        return EMPTY
    floor = base[np.searchsorted(base, cell[:, 1], side="right") - 1]
    x0, x1, out = cell[:, 0] - 0.55, cell[:, 2] + 0.55, 1.15
    iron = looks.plain((44, 46, 50), "paint")
    pieces = [boxes(_at(x0, -out, floor - 0.16), _at(x1, 0, floor), style.trim, BUILDING, without=("back",))]
    for height in (0.12, 1.02):
        left, right = _at(x0 + 0.04, -out + 0.04, floor + height), _at(x1 - 0.04, -out + 0.04, floor + height)
        pieces.append(bars(left, right, 0.05, iron, BUILDING))
        for end in (left, right):
            pieces.append(bars(end, end * [1, 0, 1], 0.05, iron, BUILDING))
    count = 13
    share = np.linspace(0, 1, count)
    at = (x0[:, None] + 0.04 + (x1 - x0 - 0.08)[:, None] * share).reshape(-1)
    foot = _at(at, -out + 0.04, np.repeat(floor, count))
    pieces.append(bars(foot, foot + [0, 0, 1.02], 0.022, iron, BUILDING))
    return merge(*pieces)


def fire_escape(x: float, base: np.ndarray, looks: Looks) -> Piece:
    """Iron platforms at every floor with ladders between, hung on the wall about x."""
    iron = looks.plain((40, 40, 42), "paint")
    half, out, n = 1.9, 1.05, len(base)
    floor = np.asarray(base, float) + 0.45
    one = np.ones(n)
    slats = np.linspace(-out, -0.08, 7)
    pieces = []
    for y in slats:
        pieces.append(bars(_at(one * (x - half), y, floor), _at(one * (x + half), y, floor), 0.07, iron, BUILDING))
    for height in (0.5, 0.95):
        left, right = _at(one * (x - half), -out, floor + height), _at(one * (x + half), -out, floor + height)
        pieces += [bars(left, right, 0.045, iron, BUILDING)]
        pieces += [bars(end, end * [1, 0, 1], 0.045, iron, BUILDING) for end in (left, right)]
    for post in np.linspace(-half, half, 9):
        foot = _at(one * (x + post), -out, floor)
        pieces.append(bars(foot, foot + [0, 0, 0.95], 0.03, iron, BUILDING))
    for k, (low, high) in enumerate(pairwise(floor)):
        ends = (x - half + 0.5, x + half - 0.5)[:: 1 if k % 2 else -1]
        for y in (-out + 0.15, -out + 0.7):
            pieces.append(bars([ends[0], y, low], [ends[1], y, high], 0.07, iron, BUILDING))
        steps = np.linspace(0.06, 0.94, 11)
        tread = np.stack(
            [ends[0] + (ends[1] - ends[0]) * steps, np.full(11, -out + 0.15), low + (high - low) * steps], 1
        )
        pieces.append(bars(tread, tread + [0, 0.55, 0], 0.06, iron, BUILDING))
    return merge(*pieces)
