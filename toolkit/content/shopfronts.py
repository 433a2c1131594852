"""Ground floors with shops: painted display windows, fascia signs with lettering, awnings, and front doors."""

from dataclasses import dataclass

import numpy as np

from toolkit.content.goods import lay_out_goods
from toolkit.content.modelling import Colour
from toolkit.content.paint import Canvas, finish, fractal, hex_name
from toolkit.content.pieces import Looks, Piece, Skin, boxes, merge, quads, wall_quads
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass

BUILDING = SceneClass.BUILDING
FRONT_W, FRONT_H, PX_PER_M = 6.0, 3.0, 112
SIGN_W, SIGN_H = 6.0, 0.8
SHOP_FLOOR_M = 4.2


@dataclass(frozen=True)
class Trade:
    """A kind of shop: what its sign says, its colours, what lies in its window.

    Attributes:
        name: on the fascia.
        board, letters: colours of the fascia and its lettering.
        frame: colour of the joinery.
        goods: see `_goods`.
        awning: its stripes, or None.
        face: of the lettering.
    """

    name: str
    board: Colour
    letters: Colour
    frame: Colour
    goods: str
    awning: tuple[Colour, Colour] | None = None
    face: str = "sans"


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


def shop_row(width: float, looks: Looks, rng: np.random.Generator, wall: Skin) -> Piece:
    """A ground floor of `SHOP_FLOOR_M` with as many shops as fit, piers between them, and a door to the stairs."""
    count = max(1, round(width / 7.0))
    pier = 0.45
    span = (width - pier) / count
    trades = rng.choice(len(TRADES), count, replace=count > len(TRADES))
    pieces = []
    for k, trade in enumerate(trades):
        left = pier + k * span
        pieces.append(shop(TRADES[trade], left, left + span - pier, looks, rng))
    lefts = np.arange(count + 1) * span
    low = np.stack([lefts, np.full(count + 1, -0.06), np.zeros(count + 1)], 1)
    high = np.stack([lefts + pier, np.full(count + 1, 0.5), np.full(count + 1, SHOP_FLOOR_M)], 1)
    pieces.append(boxes(low, high, wall, BUILDING))
    return merge(*pieces)


def shop(trade: Trade, x0: float, x1: float, looks: Looks, rng: np.random.Generator) -> Piece:
    """One shop: the front set back between the piers, fascia, awning, and a sign that sticks out."""
    front, sign = shop_skins(trade, looks)
    back, low = 0.45, 0.0
    uv = np.array([[(0, 0), (1, 0), (1, 1), (0, 1)]], float)
    z = 3.05
    board = boxes([x0, -0.16, z + 0.02], [x1, 0.4, z + 0.98], looks.plain(trade.board), BUILDING, ("back",))
    share = min(1.0, (x1 - x0) / SIGN_W)
    fascia = wall_quads((x0 + 0.05, z + 0.1, x1 - 0.05, z + 0.9), -0.165, sign, SceneClass.SIGN, fit=True)
    crop = np.array([[(0.5 - share / 2, 0), (0.5 + share / 2, 0), (0.5 + share / 2, 1), (0.5 - share / 2, 1)]])
    fascia = quads(fascia.vertices.reshape(-1, 4, 3), sign, SceneClass.SIGN, crop)
    glass = quads([(x0, back, low), (x1, back, low), (x1, back, z), (x0, back, z)], front, BUILDING, uv)
    frame = looks.plain(trade.frame)
    ceiling = quads(np.array([[(x0, 0, z), (x0, back, z), (x1, back, z), (x1, 0, z)]])[:, ::-1], frame, BUILDING)
    above = wall_quads((x0, z + 0.98, x1, SHOP_FLOOR_M), 0.0, frame, BUILDING)
    pieces = [board, fascia, glass, ceiling, above]
    if trade.awning and rng.random() < 0.8:
        pieces.append(_awning(trade.awning, x0, x1, looks))
    if rng.random() < 0.6:
        pieces.append(_blade(trade, x1 - 0.3, looks))
    return merge(*pieces)


def _awning(stripes: tuple[Colour, Colour], x0: float, x1: float, looks: Looks) -> Piece:
    """Cloth that slopes out over the pavement, with a valance; seen from both sides."""
    name = f"awning-{hex_name(stripes[0])}-{hex_name(stripes[1])}"
    skin = looks.known(name)
    if skin is None:
        rng = looks.rng(name)
        cloth = np.repeat(np.array(stripes, np.float32), 32, axis=0)[None].repeat(64, axis=0)
        worn = 1 + 0.06 * fractal(rng, (64, 64), 2, 4)[..., None]
        skin = looks.add(Material(name, finish(cloth * worn), 0.9), (0.6, 0.6))
    top, low, out = 3.08, 2.42, 1.45
    slope = [(x0, -out, low), (x1, -out, low), (x1, -0.17, top), (x0, -0.17, top)]
    valance = [(x0, -out, low - 0.25), (x1, -out, low - 0.25), (x1, -out, low), (x0, -out, low)]
    faces = np.array([slope, valance], float)
    inner = faces[:, ::-1] + [0, 0.015, -0.015]
    ends = np.array(
        [[(x0, -out, low), (x0, -0.17, top), (x0, -0.17, low)], [(x1, -out, low), (x1, -0.17, low), (x1, -0.17, top)]]
    )
    ends = np.concatenate([ends, ends[:, 2:]], axis=1)
    return quads(np.concatenate([faces, inner, ends, ends[:, [0, 2, 1, 1]]]), skin, BUILDING)


def _blade(trade: Trade, x: float, looks: Looks) -> Piece:
    """A small sign square to the wall, lettered downwards on both sides."""
    name = f"blade-{trade.name}"
    skin = looks.known(name)
    if skin is None:
        word = trade.name.split(" ")[0]
        canvas = Canvas(0.8, 0.35 + 0.3 * len(word), 80, trade.board)
        height = 0.35 + 0.3 * len(word)
        canvas.rect(0.04, 0.04, 0.76, height - 0.04, trade.letters)
        canvas.rect(0.07, 0.07, 0.73, height - 0.07, trade.board)
        for k, letter in enumerate(word):
            canvas.text(0.4, height - 0.33 - 0.3 * k, letter, 0.3, trade.letters, face=trade.face)
        sheet = canvas.texture(0.03, looks.rng(name))
        skin = looks.add(Material(name, sheet, 0.4, 0.0, sheet[::2, ::2].copy()), (0.8, height))
    height = skin.tile_m[1]
    low, out, thick = 4.4, 0.95, 0.09
    y0, y1 = -out - 0.1, -0.1
    right = [(x + thick, y0, low), (x + thick, y1, low), (x + thick, y1, low + height), (x + thick, y0, low + height)]
    left = [(x, y1, low), (x, y0, low), (x, y0, low + height), (x, y1, low + height)]
    uv = np.broadcast_to(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float), (2, 4, 2))
    rim = looks.plain((60, 60, 62))
    return merge(
        quads([right, left], skin, SceneClass.SIGN, uv),
        boxes([x + 0.01, y0 - 0.02, low - 0.02], [x + thick - 0.01, 0, low + height + 0.02], rim, BUILDING),
    )


def shop_skins(trade: Trade, looks: Looks) -> tuple[Skin, Skin]:
    """Skins of a trade's front and of its fascia."""
    name = f"shop-{trade.name}"
    front = looks.known(name)
    if front is None:
        rng = looks.rng(name)
        day, glow = _paint_front(trade, rng)
        front = looks.add(Material(name, day, 0.25, 0.0, glow))
        canvas = Canvas(SIGN_W, SIGN_H, 96, trade.board)
        canvas.line([(0.5, 0.09), (SIGN_W - 0.5, 0.09)], 0.03, trade.letters)
        canvas.line([(0.5, SIGN_H - 0.09), (SIGN_W - 0.5, SIGN_H - 0.09)], 0.03, trade.letters)
        canvas.text(SIGN_W / 2, SIGN_H / 2, trade.name, 0.58, trade.letters, face=trade.face, fit_m=4.4)
        sign = canvas.texture(0.03, rng)
        looks.add(Material(f"sign-{trade.name}", sign, 0.45, 0.0, (sign[::2, ::2] * 0.8).astype(np.uint8)))
    sign_skin = looks.known(f"sign-{trade.name}")
    assert sign_skin is not None
    return front, sign_skin


def _paint_front(trade: Trade, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two display windows and a door between, goods behind the glass; and its light in the evening."""
    canvas = Canvas(FRONT_W, FRONT_H, PX_PER_M, trade.frame)
    lamps = Canvas(FRONT_W, FRONT_H, PX_PER_M / 4, (0, 0, 0))
    room = tuple(int(c) for c in rng.integers((50, 44, 38), (92, 84, 72)))
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
    canvas.rect(2.5, 0.0, 3.5, 2.75, (30, 28, 28))
    canvas.rect(2.62, 0.3, 3.38, 2.1, tuple(min(255, c + 10) for c in room))
    lamps.rect(2.62, 0.3, 3.38, 2.1, (230, 190, 130))
    canvas.rect(2.5, 2.15, 3.5, 2.25, trade.frame)
    canvas.rect(2.8, 1.3, 3.2, 1.55, WHITE)
    canvas.text(3.0, 1.425, "OPEN", 0.17, RED)
    canvas.disc(3.3, 1.05, 0.05, GOLD)
    day = canvas.texture(0.04, rng).astype(np.float32)
    h, w = day.shape[:2]
    x, y = np.meshgrid(np.linspace(0, FRONT_W, w), np.linspace(FRONT_H, 0, h))
    glass = (y > 0.55) & (y < 2.75) & (((x > 0.15) & (x < 2.35)) | ((x > 3.65) & (x < 5.85)))
    band = np.clip(np.sin((x + 0.7 * y) * 2.2 + rng.uniform(0, 6)) * 1.5 - 0.6, 0, 1) * 0.22 + 0.06
    mirrored = np.array((176, 190, 204)) * np.clip(0.5 + 0.4 * (y - 0.5), 0, 1)[..., None]
    share = (glass * band)[..., None]
    day += (mirrored - day) * share
    day[: round(0.06 * h)] *= 0.6
    light = lamps.texture().astype(np.float32)
    bright = np.asarray(day[::4, ::4][: light.shape[0], : light.shape[1]]) / 160
    return finish(day), finish(light[: bright.shape[0], : bright.shape[1]] * np.clip(bright, 0.25, 1.1))
