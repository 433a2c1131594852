"""A wall with its openings, in relief, and the ground floor with its shops: windows, signs, awnings, goods.

Frame of a wall: x to the right seen from outside, z up, outside towards -y; see `toolkit.rooms.worlds.content.pieces`.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from toolkit.rooms.worlds.content import pieces as kit
from toolkit.rooms.worlds.content.drawing import Canvas, Colour, Point, Rng, finish, fractal, hex_name
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin
from toolkit.rooms.worlds.content.surfaces import pane_sheet, pane_uv
from toolkit.rooms.worlds.world import SceneClass

BUILDING = SceneClass.BUILDING
CORNER_M = 0.45
"""Least wall between a corner and the first bay."""
FRUIT = ((214, 40, 36), (240, 150, 30), (246, 214, 60), (96, 164, 50), (150, 60, 120), (236, 110, 60))
BRIGHT = (*FRUIT, (50, 110, 200), (240, 240, 240), (230, 90, 150), (40, 170, 160))


MEAT = ((186, 50, 46), (206, 90, 80), (168, 40, 44), (226, 170, 150))
FRONT_W, FRONT_H, PX_PER_M = 6.0, 3.0, 112
SIGN_W, SIGN_H = 6.0, 0.8
SHOP_FLOOR_M = 4.2


@dataclass(frozen=True)
class Facade:
    """How a wall with windows is made."""

    wall: Skin  # wall, trim: skins of the wall, and of what stands out from it
    trim: Skin
    panes: str  # name of the window style
    window_m: tuple[float, float, float] = (1.1, 1.7, 0.85)  # width, height and height above the floor of an opening
    floor_m: float = 3.2  # floor_m, bay_m: height of a floor, width wished for a bay
    bay_m: float = 2.6
    recess_m: float = 0.2  # depth of the window in its opening
    sills: bool = True  # sills, lintels: whether openings have them
    lintels: bool = True
    pilasters: bool = False  # whether flat piers stand between the bays
    string_course: bool = False  # whether a band runs round at each floor
    balconies: float = 0.0  # share of the bays with balconies
    fire_escape: bool = False  # whether a fire escape hangs on the street's side
    air_conditioners: float = 0.0  # share of the windows with a box in it


def bay_edges(width: float, bay_m: float) -> np.ndarray:
    """Left and right edges of the bays of a wall."""
    count = max(1, round((width - 2 * CORNER_M) / bay_m))
    return np.linspace(CORNER_M, width - CORNER_M, count + 1)


def windowed_wall(
    style: Facade, width: float, looks: Looks, rng: Rng, *, z0: float, floors: int, plain: bool = False
) -> Piece:
    """A wall from z0 up with `floors` rows of windows; `plain` leaves out all that decorates a street's side."""
    # bays across, floors up: a window in the middle of each bay
    edges = bay_edges(width, style.bay_m)
    middle = (edges[1:] + edges[:-1]) / 2
    w, h, sill = style.window_m
    # no wider than its bay, less a pier
    w = min(w, float(np.diff(edges)[0]) - 0.25)
    base = z0 + style.floor_m * np.arange(floors)
    x0, x1 = middle - w / 2, middle + w / 2
    low, high = base + sill, np.minimum(base + sill + h, base + style.floor_m - 0.12)
    top = z0 + floors * style.floor_m
    pieces = [_around_openings(style.wall, width, (z0, top), np.stack([x0, x1], 1), np.stack([low, high], 1))]
    # a cell is a window's opening: left, bottom, right, top
    cell = np.array([(a, c, b, d) for c, d in zip(low, high, strict=True) for a, b in zip(x0, x1, strict=True)])
    pieces.append(openings(cell, style, looks, rng))
    # what a window has beside its frame is a block before the wall
    if style.sills:
        pieces.append(_blocks(cell[:, [0, 2]] + [-0.08, 0.08], cell[:, 1] - 0.1, cell[:, 1], 0.09, style.trim))
    if style.lintels and not plain:
        pieces.append(_blocks(cell[:, [0, 2]] + [-0.14, 0.14], cell[:, 3], cell[:, 3] + 0.2, 0.04, style.trim))
    if style.air_conditioners:
        pieces.append(_air_conditioners(cell[rng.random(len(cell)) < style.air_conditioners], looks))
    # a wall to a court ends here
    if plain:
        return kit.merge(*pieces)
    if style.string_course:
        full = np.broadcast_to([0.0, width], (floors, 2))
        pieces.append(_blocks(full, base - 0.1, base + 0.14, 0.07, style.trim))
    if style.pilasters:
        at = edges[1:-1] if len(edges) > 2 else edges
        span = np.stack([at - 0.22, at + 0.22], 1)
        pieces.append(_blocks(span, np.full(len(at), z0), np.full(len(at), top), 0.12, style.trim))
    # only some of the windows have a balcony
    if style.balconies:
        pieces.append(_balconies(cell[rng.random(len(cell)) < style.balconies], base, style, looks))
    if style.fire_escape and width > 7 and floors > 1:
        pieces.append(fire_escape(float(middle[len(middle) // 2]), base, looks))
    return kit.merge(*pieces)


def _around_openings(skin: Skin, width: float, z: tuple[float, float], across: np.ndarray, up: np.ndarray) -> Piece:
    rows = np.concatenate([[z[0]], up.reshape(-1), [z[1]]])
    # a wall with holes as rectangles: whole strips between the rows of openings, piers between openings of a row
    strips = [(0.0, rows[2 * k], width, rows[2 * k + 1]) for k in range(len(up) + 1)]
    columns = np.concatenate([[0.0], across.reshape(-1), [width]])
    piers = [(columns[2 * i], low, columns[2 * i + 1], high) for low, high in up for i in range(len(across) + 1)]
    return kit.wall_quads(np.array(strips + piers), 0.0, skin, BUILDING)


def openings(cell: np.ndarray, style: Facade, looks: Looks, rng: Rng) -> Piece:
    """Reveals and panes of openings (n, 4) of x0, z0, x1, z1."""
    x0, z0, x1, z1 = cell.T
    depth = style.recess_m
    panes = pane_sheet(looks, style.panes)
    # four walls of the opening, from the face of the wall back to the pane
    front = np.stack([kit.xyz(x0, 0, z0), kit.xyz(x1, 0, z0), kit.xyz(x1, 0, z1), kit.xyz(x0, 0, z1)], 1)
    back = front + [0, depth, 0]
    sides = [np.stack([front[:, k], front[:, k - 3], back[:, k - 3], back[:, k]], 1) for k in range(4)]
    uv = pane_uv(rng, len(cell), mirror=True)
    return kit.merge(kit.quads(np.concatenate(sides), style.wall, BUILDING), kit.quads(back, panes, BUILDING, uv))


def _blocks(span: np.ndarray, z0: np.ndarray, z1: np.ndarray, out_m: float, skin: Skin) -> Piece:
    """Blocks on the wall that stand out by `out_m`, from spans (n, 2) along it."""
    return kit.boxes(kit.xyz(span[:, 0], -out_m, z0), kit.xyz(span[:, 1], 0.0, z1), skin, BUILDING, without=("back",))


def cornice(
    width: float, z: float, skin: Skin, out_m: float = 0.45, *, dentils: bool = True, ends: bool = True
) -> Piece:
    """Mouldings that step out below z; they run on round corners with `ends`."""
    # three mouldings, each further out than that below it
    steps = [(z - 0.75, z - 0.5, 0.25), (z - 0.5, z - 0.22, 0.6), (z - 0.22, z, 1.0)]
    reach = out_m if ends else 0.0
    pieces = []
    for low, high, share in steps:
        # they reach out beyond the wall's ends, where the next wall's mouldings meet them
        span = np.array([[-reach * share, width + reach * share]])
        block = kit.boxes(
            kit.xyz(span[:, 0], -out_m * share, np.array([low])), kit.xyz(span[:, 1], 0.1, np.array([high])), skin,
            BUILDING,
            without=("back",),
        )  # fmt: skip
        pieces.append(block)
    # small blocks in a row below the cornice
    if dentils:
        at = np.arange(0.3, width - 0.2, 0.55)
        span = np.stack([at, at + 0.26], 1)
        pieces.append(_blocks(span, np.full(len(at), z - 0.52), np.full(len(at), z - 0.24), out_m * 0.85, skin))
    return kit.merge(*pieces)


def _air_conditioners(cell: np.ndarray, looks: Looks) -> Piece:
    if not len(cell):
        return kit.EMPTY
    # in the middle of the sill, half outside
    x = (cell[:, 0] + cell[:, 2]) / 2
    low, high = kit.xyz(x - 0.32, -0.34, cell[:, 1] + 0.02), kit.xyz(x + 0.32, 0.15, cell[:, 1] + 0.44)
    grille = kit.xyz(x - 0.26, -0.345, cell[:, 1] + 0.07), kit.xyz(x + 0.26, -0.34, cell[:, 1] + 0.39)
    return kit.merge(
        kit.boxes(low, high, looks.plain((206, 204, 194)), BUILDING, without=("back",)),
        kit.boxes(*grille, looks.plain((96, 98, 98)), BUILDING, without=("back", "top", "bottom")),
    )


def _balconies(cell: np.ndarray, base: np.ndarray, style: Facade, looks: Looks) -> Piece:
    if not len(cell):
        return kit.EMPTY
    # the slab lies at the floor of the window's storey
    floor = base[np.searchsorted(base, cell[:, 1], side="right") - 1]
    x0, x1, out = cell[:, 0] - 0.55, cell[:, 2] + 0.55, 1.15
    iron = looks.plain((44, 46, 50), "paint")
    pieces = [
        kit.boxes(kit.xyz(x0, -out, floor - 0.16), kit.xyz(x1, 0, floor), style.trim, BUILDING, without=("back",))
    ]
    # two rails round it, and balusters between them
    for height in (0.12, 1.02):
        left, right = kit.xyz(x0 + 0.04, -out + 0.04, floor + height), kit.xyz(x1 - 0.04, -out + 0.04, floor + height)
        pieces.append(kit.bars(left, right, 0.05, iron, BUILDING))
        for end in (left, right):
            pieces.append(kit.bars(end, end * [1, 0, 1], 0.05, iron, BUILDING))
    count = 13
    share = np.linspace(0, 1, count)
    at = (x0[:, None] + 0.04 + (x1 - x0 - 0.08)[:, None] * share).reshape(-1)
    foot = kit.xyz(at, -out + 0.04, np.repeat(floor, count))
    pieces.append(kit.bars(foot, foot + [0, 0, 1.02], 0.022, iron, BUILDING))
    return kit.merge(*pieces)


def fire_escape(x: float, base: np.ndarray, looks: Looks) -> Piece:
    """Iron platforms at every floor with ladders between, hung on the wall about x."""
    iron = looks.plain((40, 40, 42), "paint")
    half, out, n = 1.9, 1.05, len(base)
    floor = np.asarray(base, float) + 0.45
    ones = np.ones(n)
    slats = np.linspace(-out, -0.08, 7)
    pieces = []
    # platforms of slats
    for y in slats:
        pieces.append(
            kit.bars(kit.xyz(ones * (x - half), y, floor), kit.xyz(ones * (x + half), y, floor), 0.07, iron, BUILDING)
        )
    # two rails round each platform, on posts
    for height in (0.5, 0.95):
        left, right = kit.xyz(ones * (x - half), -out, floor + height), kit.xyz(ones * (x + half), -out, floor + height)
        pieces += [kit.bars(left, right, 0.045, iron, BUILDING)]
        pieces += [kit.bars(end, end * [1, 0, 1], 0.045, iron, BUILDING) for end in (left, right)]
    for post in np.linspace(-half, half, 9):
        foot = kit.xyz(ones * (x + post), -out, floor)
        pieces.append(kit.bars(foot, foot + [0, 0, 0.95], 0.03, iron, BUILDING))
    # stairs to the next platform, that lean to the left and right in turns
    for k, (low, high) in enumerate(pairwise(floor)):
        ends = (x - half + 0.5, x + half - 0.5)[:: 1 if k % 2 else -1]
        for y in (-out + 0.15, -out + 0.7):
            pieces.append(kit.bars([ends[0], y, low], [ends[1], y, high], 0.07, iron, BUILDING))
        steps = np.linspace(0.06, 0.94, 11)
        tread = kit.xyz(ends[0] + (ends[1] - ends[0]) * steps, -out + 0.15, low + (high - low) * steps)
        pieces.append(kit.bars(tread, tread + [0, 0.55, 0], 0.06, iron, BUILDING))
    return kit.merge(*pieces)


def lay_out_goods(canvas: Canvas, kind: str, span: tuple[float, float], floor: float, rng: Rng) -> None:
    """Fill a window between two x and from its floor up with what a shop of that kind shows."""
    # goods by how they are shown: on shelves, in crates, on tables, on dummies
    if kind in ("books", "boxes", "papers", "bottles", "sweets", "bread"):
        _shelves(canvas, kind, span, floor, rng)
    elif kind in ("fruit", "meat"):
        _crates(canvas, FRUIT if kind == "fruit" else MEAT, span, floor, rng)
    elif kind == "dining":
        _tables(canvas, span, floor)
    elif kind in ("clothes", "barber", "shoes"):
        for x in np.arange(span[0] + 0.3, span[1] - 0.2, 0.62):
            tone = rng.pick(BRIGHT)
            if kind == "shoes":
                _shoes(canvas, float(x), floor, rng)
                continue
            # a dressed dummy
            outline = [(-0.2, 1.4), (0.2, 1.4), (0.13, 0.9), (0.24, 0.3), (-0.24, 0.3), (-0.13, 0.9)]
            canvas.disc(x, floor + 1.55, 0.1, (206, 170, 140))
            canvas.fill([(x + dx, floor + dz) for dx, dz in outline], tone)
    else:
        # any other trade: two rows of boxes
        for x in np.arange(span[0] + 0.05, span[1] - 0.5, 0.72):
            for z in (floor + 0.1, floor + 0.95):
                canvas.rect(x, z, x + 0.62, z + 0.78, rng.pick(BRIGHT))
                canvas.disc(x + 0.31, z + 0.48, 0.18, rng.pick(BRIGHT))
                canvas.line([(x + 0.08, z + 0.14), (x + 0.54, z + 0.14)], 0.05, (250, 250, 250))


def _shelves(canvas: Canvas, kind: str, span: tuple[float, float], floor: float, rng: Rng) -> None:
    board = (110, 78, 50) if kind != "boxes" else (206, 206, 204)
    # boards as far apart as the goods are high
    pitch = {"bread": 0.42, "bottles": 0.5, "sweets": 0.36}.get(kind, 0.46)
    z = floor
    while z < 2.2:
        canvas.rect(span[0], z, span[1], z + 0.04, board)
        x = span[0] + 0.02
        while x < span[1] - 0.05:
            x += _item(canvas, kind, (x, z + 0.04), pitch, rng)
        z += pitch


def _crates(canvas: Canvas, palette: tuple[Colour, ...], span: tuple[float, float], floor: float, rng: Rng) -> None:
    for z in (floor, floor + 0.45, floor + 0.9):
        for x in np.arange(span[0], span[1] - 0.3, 0.44):
            canvas.rect(x, z, x + 0.4, z + 0.16, (146, 106, 64))
            tone = rng.pick(palette)
            for fx, fz in rng.uniform((x + 0.05, z + 0.14), (x + 0.36, z + 0.32), (14, 2)):
                canvas.disc(fx, fz, 0.055, tuple(int(c * rng.uniform(0.75, 1.1)) for c in tone))


def _tables(canvas: Canvas, span: tuple[float, float], floor: float) -> None:
    for x in np.arange(span[0] + 0.35, span[1] - 0.2, 0.75):
        canvas.rect(x - 0.28, floor + 0.5, x + 0.28, floor + 0.56, (236, 230, 220))
        canvas.rect(x - 0.03, floor, x + 0.03, floor + 0.5, (60, 44, 34))
        canvas.disc(x, floor + 1.45, 0.16, (250, 214, 140))
        canvas.line([(x, floor + 1.6), (x, 2.75)], 0.015, (40, 40, 40))
        canvas.rect(x - 0.05, floor + 0.56, x + 0.03, floor + 0.76, (60, 110, 70))


def _shoes(canvas: Canvas, x: float, floor: float, rng: Rng) -> None:
    outline = [(-0.2, 0.03), (0.2, 0.03), (0.18, 0.1), (0.0, 0.13), (-0.08, 0.2), (-0.2, 0.2)]
    for z in np.arange(floor, 2.0, 0.36):
        canvas.rect(x - 0.28, z, x + 0.28, z + 0.03, (226, 222, 214))
        canvas.fill([(x + dx, z + dz) for dx, dz in outline], rng.pick((*BRIGHT[:4], (40, 34, 30), (96, 58, 34))))


def _item(canvas: Canvas, kind: str, at: Point, shelf_m: float, rng: Rng) -> float:
    """A thing on a shelf, its lower left corner at a point; returns the width it takes."""
    # each kind draws itself and returns its width and a gap
    x, z = at
    if kind in ("books", "boxes", "papers"):
        w = float(rng.uniform(0.03, 0.07) if kind == "books" else rng.uniform(0.1, 0.24))
        h = float(rng.uniform(0.6, 0.92)) * (shelf_m - 0.06)
        tone = tuple(int(c * rng.uniform(0.5, 1.0)) for c in rng.pick(BRIGHT))
        canvas.rect(x, z, x + w, z + h, tone)
        if kind != "books":
            canvas.rect(x + 0.02, z + h * 0.5, x + w - 0.02, z + h * 0.75, WHITE)
        return w + 0.012
    if kind == "bottles":
        tone = rng.pick(((30, 70, 40), (90, 50, 20), (150, 30, 30), (220, 200, 140), (40, 60, 90)))
        canvas.rect(x, z, x + 0.08, z + 0.24, tone)
        canvas.rect(x + 0.025, z + 0.24, x + 0.055, z + 0.36, tone)
        canvas.rect(x, z + 0.06, x + 0.08, z + 0.16, CREAM)
        return 0.105
    if kind == "bread":
        tone = tuple(int(c * rng.uniform(0.8, 1.15)) for c in (196, 138, 70))
        w = float(rng.uniform(0.14, 0.34))
        shape = [(x, z), (x + w, z), (x + w * 0.9, z + 0.13), (x + w * 0.5, z + 0.17), (x + w * 0.1, z + 0.13)]
        canvas.fill(shape, tone)
        return w + 0.03
    # a jar of sweets
    canvas.rect(x, z, x + 0.13, z + 0.2, (226, 232, 236))
    for fx, fz in rng.uniform((x + 0.02, z + 0.02), (x + 0.11, z + 0.16), (7, 2)):
        canvas.disc(fx, fz, 0.026, rng.pick(BRIGHT))
    canvas.rect(x + 0.01, z + 0.2, x + 0.12, z + 0.24, rng.pick(BRIGHT))
    return 0.16


@dataclass(frozen=True)
class Trade:
    """A kind of shop: what its sign says, its colours, what lies in its window."""

    name: str  # on the fascia
    board: Colour  # board, letters: colours of the fascia and its lettering
    letters: Colour
    frame: Colour  # colour of the joinery
    goods: str  # see `_goods`
    awning: tuple[Colour, Colour] | None = None  # its stripes, or None
    face: str = "sans"  # of the lettering


WHITE, CREAM, RED, GREEN, NAVY, BLACK, GOLD = (
    (240, 240, 236), (238, 226, 196), (182, 26, 30), (22, 82, 52), (24, 38, 92), (26, 26, 28), (222, 178, 74),
)  # fmt: skip
TRADES = (
    Trade("BAKERY", (112, 62, 34), CREAM, (96, 54, 32), "bread", ((196, 140, 80), CREAM), "serif"),
    Trade("RESTAURANT", (110, 20, 28), GOLD, (60, 24, 22), "dining", (RED, CREAM), "serif"),
    Trade("BOOKS", GREEN, GOLD, (24, 60, 42), "books", None, "serif"),
    Trade("GROCERY · FRUIT", (30, 122, 52), WHITE, (40, 96, 56), "fruit", (GREEN, WHITE)),
    Trade("PHARMACY", (236, 238, 236), (10, 130, 60), (200, 204, 204), "boxes"),
    Trade("BARBER SHOP", WHITE, RED, NAVY, "barber", ((206, 30, 36), WHITE)),
    Trade("PIZZA", (206, 40, 30), WHITE, (40, 96, 56), "dining", ((206, 40, 30), WHITE), "italic"),
    Trade("CAFÉ", (52, 38, 32), CREAM, (52, 38, 32), "dining", ((92, 58, 40), (92, 58, 40)), "italic"),
    Trade("SHOES", BLACK, WHITE, (54, 54, 58), "shoes"),
    Trade("TOYS", (250, 200, 20), (206, 32, 40), (36, 100, 190), "toys", ((36, 100, 190), (250, 200, 20))),
    Trade("TOBACCO · NEWS", (150, 24, 24), GOLD, (80, 30, 26), "papers", (RED, RED), "serif"),
    Trade("HARDWARE", (226, 120, 20), BLACK, (70, 70, 72), "boxes"),
    Trade("BUTCHER", (178, 26, 34), WHITE, (214, 210, 204), "meat", (RED, WHITE)),
    Trade("SWEETS", (232, 128, 168), WHITE, (236, 200, 214), "sweets", ((232, 128, 168), WHITE), "italic"),
    Trade("BANK", (24, 44, 96), WHITE, (140, 142, 146), "posters"),
    Trade("DELI · LIQUOR", (28, 30, 110), (250, 214, 40), (58, 60, 70), "bottles", ((28, 30, 110), (28, 30, 110))),
    Trade("FASHION", (18, 18, 20), (230, 230, 226), (28, 28, 30), "clothes", None, "plain"),
    Trade("ELECTRONICS", (214, 24, 40), WHITE, (48, 50, 54), "posters"),
    Trade("FLOWERS", (82, 42, 92), CREAM, (64, 88, 62), "fruit", ((82, 42, 92), CREAM), "italic"),
    Trade("LAUNDRY", (70, 160, 206), WHITE, (206, 210, 212), "posters"),
)


def shop_row(width: float, looks: Looks, rng: Rng, wall: Skin) -> Piece:
    """A ground floor of `SHOP_FLOOR_M` with as many shops as fit, piers between them, and a door to the stairs."""
    # a shop for about every 7 m
    count = max(1, round(width / 7.0))
    pier = 0.45
    span = (width - pier) / count
    # no trade twice in a row of shops, as long as there are enough
    trades = rng.choice(len(TRADES), count, replace=count > len(TRADES))
    pieces = []
    for k, trade in enumerate(trades):
        left = pier + k * span
        pieces.append(shop(TRADES[trade], left, left + span - pier, looks, rng))
    # piers between shops, and at both ends
    lefts = np.arange(count + 1) * span
    low = kit.xyz(lefts, -0.06, 0.0)
    high = kit.xyz(lefts + pier, 0.5, SHOP_FLOOR_M)
    pieces.append(kit.boxes(low, high, wall, BUILDING))
    return kit.merge(*pieces)


def shop(trade: Trade, x0: float, x1: float, looks: Looks, rng: Rng) -> Piece:
    """A shop: the front set back between the piers, fascia, awning, and a sign that sticks out."""
    front, sign = shop_skins(trade, looks)
    back, low = 0.45, 0.0
    z = 3.05
    # the box of the fascia, behind the sign
    board = kit.boxes([x0, -0.16, z + 0.02], [x1, 0.4, z + 0.98], looks.plain(trade.board), BUILDING, ("back",))
    # a narrow shop shows the middle of the sign, at its true size
    share = min(1.0, (x1 - x0) / SIGN_W)
    fascia = kit.wall_quads((x0 + 0.05, z + 0.1, x1 - 0.05, z + 0.9), -0.165, sign, SceneClass.SIGN, fit=True)
    crop = np.array([[(0.5 - share / 2, 0), (0.5 + share / 2, 0), (0.5 + share / 2, 1), (0.5 - share / 2, 1)]])
    fascia = kit.quads(fascia.vertices.reshape(-1, 4, 3), sign, SceneClass.SIGN, crop)
    # the front lies 0.45 m behind the wall, under a ceiling
    glass = kit.quads([(x0, back, low), (x1, back, low), (x1, back, z), (x0, back, z)], front, BUILDING, kit.UNIT)
    frame = looks.plain(trade.frame)
    ceiling = kit.quads(np.array([[(x0, 0, z), (x0, back, z), (x1, back, z), (x1, 0, z)]])[:, ::-1], frame, BUILDING)
    above = kit.wall_quads((x0, z + 0.98, x1, SHOP_FLOOR_M), 0.0, frame, BUILDING)
    pieces = [board, fascia, glass, ceiling, above]
    if trade.awning and rng.random() < 0.8:
        pieces.append(_awning(trade.awning, x0, x1, looks))
    if rng.random() < 0.6:
        pieces.append(_blade(trade, x1 - 0.3, looks))
    return kit.merge(*pieces)


def _awning(stripes: tuple[Colour, Colour], x0: float, x1: float, looks: Looks) -> Piece:
    def paint(rng: Rng) -> np.ndarray:
        # stripes of cloth, along the awning
        cloth = np.repeat(np.array(stripes, np.float32), 32, axis=0)[None].repeat(64, axis=0)
        return finish(cloth * (1 + 0.06 * fractal(rng, (64, 64), 2, 4)[..., None]))

    skin = looks.paint(f"awning-{hex_name(stripes[0])}-{hex_name(stripes[1])}", paint, 0.9, (0.6, 0.6))
    # heights of its upper and lower edge, and how far it reaches out, metres
    top, low, out = 3.08, 2.42, 1.45
    slope = [(x0, -out, low), (x1, -out, low), (x1, -0.17, top), (x0, -0.17, top)]
    valance = [(x0, -out, low - 0.25), (x1, -out, low - 0.25), (x1, -out, low), (x0, -out, low)]
    faces = np.array([slope, valance], float)
    # its underside: a face is seen from one side alone
    inner = faces[:, ::-1] + [0, 0.015, -0.015]
    # triangles close it at the sides
    ends = np.array(
        [[(x0, -out, low), (x0, -0.17, top), (x0, -0.17, low)], [(x1, -out, low), (x1, -0.17, low), (x1, -0.17, top)]]
    )
    ends = np.concatenate([ends, ends[:, 2:]], axis=1)
    return kit.quads(np.concatenate([faces, inner, ends, ends[:, [0, 2, 1, 1]]]), skin, BUILDING)


def _blade(trade: Trade, x: float, looks: Looks) -> Piece:
    """A small sign square to the wall, lettered downwards on both sides."""
    # the first word of the trade's name
    word = trade.name.split(" ")[0]
    height = 0.35 + 0.3 * len(word)

    def paint(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
        canvas = Canvas(0.8, height, 80, trade.board)
        canvas.rect(0.04, 0.04, 0.76, height - 0.04, trade.letters)
        canvas.rect(0.07, 0.07, 0.73, height - 0.07, trade.board)
        for k, letter in enumerate(word):
            canvas.text(0.4, height - 0.33 - 0.3 * k, letter, 0.3, trade.letters, face=trade.face)
        sheet = canvas.texture(0.03, rng)
        # by evening it is lit: the second picture is what it gives off, at half the resolution
        return sheet, sheet[::2, ::2].copy()

    skin = looks.paint(f"blade-{trade.name}", paint, 0.4, (0.8, height))
    # above the heads, and how far it reaches out, metres
    low, out, thick = 4.4, 0.95, 0.09
    y0, y1 = -out - 0.1, -0.1
    right = [(x + thick, y0, low), (x + thick, y1, low), (x + thick, y1, low + height), (x + thick, y0, low + height)]
    left = [(x, y1, low), (x, y0, low), (x, y0, low + height), (x, y1, low + height)]
    rim = looks.plain((60, 60, 62))
    return kit.merge(
        kit.quads([right, left], skin, SceneClass.SIGN, kit.UNIT),
        kit.boxes([x + 0.01, y0 - 0.02, low - 0.02], [x + thick - 0.01, 0, low + height + 0.02], rim, BUILDING),
    )


def shop_skins(trade: Trade, looks: Looks) -> tuple[Skin, Skin]:
    """Skins of a trade's front and of its fascia."""
    rng = looks.rng(f"shop-{trade.name}")

    def paint_sign(_: Rng) -> tuple[np.ndarray, np.ndarray]:
        canvas = Canvas(SIGN_W, SIGN_H, 96, trade.board)
        canvas.line([(0.5, 0.09), (SIGN_W - 0.5, 0.09)], 0.03, trade.letters)
        canvas.line([(0.5, SIGN_H - 0.09), (SIGN_W - 0.5, SIGN_H - 0.09)], 0.03, trade.letters)
        canvas.text(SIGN_W / 2, SIGN_H / 2, trade.name, 0.58, trade.letters, face=trade.face, fit_m=4.4)
        sign = canvas.texture(0.03, rng)  # its draws follow those of the front
        return sign, (sign[::2, ::2] * 0.8).astype(np.uint8)

    # the front first, as the draws of the sign follow its own
    front = looks.paint(f"shop-{trade.name}", lambda _: _paint_front(trade, rng), 0.25)
    return front, looks.paint(f"sign-{trade.name}", paint_sign, 0.45)


def _paint_front(trade: Trade, rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """Two display windows and a door between, goods behind the glass; and its light in the evening."""
    # by day, and its light at a quarter of the resolution
    canvas = Canvas(FRONT_W, FRONT_H, PX_PER_M, trade.frame)
    lamps = Canvas(FRONT_W, FRONT_H, PX_PER_M / 4, (0, 0, 0))
    room = tuple(int(c) for c in rng.integers((50, 44, 38), (92, 84, 72)))
    # two shop windows with goods, and the panels below them
    for x0, x1 in ((0.15, 2.35), (3.65, 5.85)):
        canvas.rect(x0, 0.55, x1, 2.75, room)
        canvas.rect(x0, 2.2, x1, 2.75, tuple(min(255, c + 26) for c in room))
        lay_out_goods(canvas, trade.goods, (x0 + 0.08, x1 - 0.08), 0.6, rng)
        lamps.rect(x0, 0.55, x1, 2.75, (255, 226, 170))
        panel = tuple(int(c * 0.7) for c in trade.frame)
        canvas.rect(x0 + 0.1, 0.12, x1 - 0.1, 0.45, panel)
        canvas.rect((x0 + x1) / 2 - 0.03, 0.5, (x0 + x1) / 2 + 0.03, 2.8, trade.frame)
        if rng.random() < 0.75:  # a poster on the glass
            px, py = x0 + rng.uniform(0.15, 1.4), rng.uniform(1.3, 1.9)
            paper = tuple(int(c) for c in rng.choice([(244, 236, 60), (240, 240, 240), (220, 40, 40), (60, 120, 200)]))
            canvas.rect(px, py, px + 0.55, py + 0.5, paper)
            canvas.text(
                px + 0.27, py + 0.32,
                str(rng.choice(["SALE", "NEW", "50%", "OPEN", "SPECIAL"])),
                0.16, BLACK if sum(paper) > 400 else WHITE, fit_m=0.5,
            )  # fmt: skip
            canvas.line([(px + 0.06, py + 0.12), (px + 0.49, py + 0.12)], 0.03, (90, 90, 90))
    # door with its glass, the sign on it and the handle
    canvas.rect(2.5, 0.0, 3.5, 2.75, (30, 28, 28))
    canvas.rect(2.62, 0.3, 3.38, 2.1, tuple(min(255, c + 10) for c in room))
    lamps.rect(2.62, 0.3, 3.38, 2.1, (230, 190, 130))
    canvas.rect(2.5, 2.15, 3.5, 2.25, trade.frame)
    canvas.rect(2.8, 1.3, 3.2, 1.55, WHITE)
    canvas.text(3.0, 1.425, "OPEN", 0.17, RED)
    canvas.disc(3.3, 1.05, 0.05, GOLD)
    # reflections of sky and street on the glass, in slanted bands
    day = canvas.texture(0.04, rng).astype(np.float32)
    h, w = day.shape[:2]
    x, y = np.meshgrid(np.linspace(0, FRONT_W, w), np.linspace(FRONT_H, 0, h))
    glass = (y > 0.55) & (y < 2.75) & (((x > 0.15) & (x < 2.35)) | ((x > 3.65) & (x < 5.85)))
    band = np.clip(np.sin((x + 0.7 * y) * 2.2 + rng.uniform(0, 6)) * 1.5 - 0.6, 0, 1) * 0.22 + 0.06
    mirrored = np.array((176, 190, 204)) * np.clip(0.5 + 0.4 * (y - 0.5), 0, 1)[..., None]
    share = (glass * band)[..., None]
    day += (mirrored - day) * share
    day[: round(0.06 * h)] *= 0.6
    # the light at night is tinted by what stands in the window
    light = lamps.texture().astype(np.float32)
    bright = np.asarray(day[::4, ::4][: light.shape[0], : light.shape[1]]) / 160
    return finish(day), finish(light[: bright.shape[0], : bright.shape[1]] * np.clip(bright, 0.25, 1.1))
