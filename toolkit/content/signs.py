"""Lettered and lit things of a street: traffic lights, street names, traffic signs, billboards."""

from dataclasses import replace

import numpy as np

from toolkit.content.drawing import Canvas, Colour
from toolkit.content.pieces import UNIT, Looks, Piece, Skin, bars, box, boxes, merge, place, polygon, quads, revolved
from toolkit.objects.mesh import Material
from toolkit.worlds.world import SceneClass

FURNITURE, SIGN = SceneClass.FURNITURE, SceneClass.SIGN
STREET_NAMES = (
    "MAIN ST", "PARK AVE", "MARKET ST", "CHURCH ST", "KING ST", "RIVER RD", "STATION RD", "OAK AVE", "MILL LANE",
    "QUEEN ST", "HARBOR ST", "BROADWAY", "COLLEGE ST", "BRIDGE ST", "HIGH ST", "CANAL ST",
)  # fmt: skip
BOARD_TEXTS = (
    ("DRINK KOLA", (196, 20, 28), (244, 240, 232)), ("FLY NORDAIR", (24, 88, 170), (244, 244, 244)),
    ("GRAND HOTEL", (30, 30, 34), (226, 186, 92)),
    ("NEW! FRESH MILK", (250, 250, 246), (20, 90, 170)),
    ("JAZZ FESTIVAL", (240, 160, 20), (60, 20, 80)), ("CITY BANK", (12, 92, 70), (240, 240, 232)),
)  # fmt: skip
WHITE: Colour = (242, 242, 238)


def sheet(name: str, looks: Looks, canvas: Canvas, glow: float = 0.0) -> Skin:
    """The skin of a drawn sign; `glow` is the share that it gives off in the evening."""
    if found := looks.known(name):
        return found
    picture = canvas.texture(0.03, looks.rng(name))
    emission = (picture[::2, ::2] * glow).astype(np.uint8) if glow else None
    return looks.add(Material(name, picture, 0.5, 0.0, emission))


def board(
    width: float, height: float, skin: Skin, label: int = SIGN, thick: float = 0.03, *, both: bool = True
) -> Piece:
    """An upright board centred on the origin, its picture to -y and, turned, to +y."""
    w, h = width / 2, height / 2
    front = [(-w, -thick / 2, -h), (w, -thick / 2, -h), (w, -thick / 2, h), (-w, -thick / 2, h)]
    back = [(w, thick / 2, -h), (-w, thick / 2, -h), (-w, thick / 2, h), (w, thick / 2, h)]
    return quads(np.array([front, back][: 2 if both else 1], float), skin, label, UNIT)


def traffic_head(looks: Looks, lit: int, housing: Colour = (232, 178, 20)) -> Piece:
    """Three lamps in a housing with visors, facing -y; `lit` counts from the top."""
    body, dark = looks.plain(housing), looks.plain((18, 18, 20), "matte")
    on = ((255, 40, 30), (255, 190, 30), (50, 255, 130))
    off = ((84, 16, 14), (88, 62, 12), (10, 66, 34))
    pieces = [
        box((-0.19, 0.19), (0.0, 0.2), (-0.58, 0.58), body, FURNITURE),
        box((-0.32, 0.32), (0.2, 0.23), (-0.72, 0.72), dark, FURNITURE),
    ]
    visor = revolved([(0.16, 0), (0.16, 0.2)], 10, dark, FURNITURE)
    for k in range(3):
        z = 0.38 - 0.38 * k
        lamp = looks.plain(on[k], "lamp") if k == lit else looks.plain(off[k], "gloss")
        disc = revolved([(0.15, 0.0), (0.08, 0.04), (0.005, 0.05)], 10, lamp, FURNITURE)
        pieces += [piece.tipped(1, -1, 1).moved(z=z) for piece in (disc, visor)]
    return merge(*pieces)


def traffic_light(looks: Looks, lit: int, street: str, arm_m: float = 5.0) -> Piece:
    """A mast at the kerb with an arm out over the road to -x, two heads facing -y, and the street's name."""
    steel = looks.plain((74, 78, 80))
    mast = revolved([(0.16, 0), (0.13, 0.9), (0.11, 0.92), (0.085, 5.9), (0.01, 5.95)], 8, steel, FURNITURE)
    head = traffic_head(looks, lit)
    at = np.array([(-arm_m + 0.4, -0.2, 5.35), (-arm_m / 2, -0.2, 5.45), (0.0, -0.32, 3.1)])
    name = street_name(street, looks)
    pieces = [
        mast,
        bars((0, 0, 5.6), (-arm_m, 0, 5.85), 0.12, steel, FURNITURE),
        place(head, at),
        bars(at[:2] + [0, 0.12, 0.5], at[:2] + [0, 0.2, 0.35], 0.06, steel, FURNITURE),
        name.moved(-1.3, -0.1, 5.3),
    ]
    walk = looks.plain((250, 250, 240), "lamp") if lit == 0 else looks.plain((255, 90, 30), "lamp")
    pieces += [
        box((-0.45, -0.12), (-0.15, 0.05), (2.3, 2.7), looks.plain((30, 30, 32)), FURNITURE),
        box((-0.38, -0.19), (-0.165, -0.15), (2.36, 2.64), walk, FURNITURE),
    ]
    return merge(*pieces)


def street_name(street: str, looks: Looks) -> Piece:
    """A green blade with a street's name, 1.5 m by 0.3 m, facing both ways."""
    canvas = Canvas(1.5, 0.32, 128, WHITE)
    canvas.rect(0.02, 0.02, 1.48, 0.3, (6, 102, 62))
    canvas.text(0.75, 0.155, street, 0.25, WHITE, fit_m=1.35)
    return board(1.5, 0.32, sheet(f"street-{street}", looks, canvas))


def name_post(streets: tuple[str, str], looks: Looks) -> Piece:
    """Two crossed street names on a post."""
    post = looks.plain((120, 124, 124))
    return merge(
        bars((0, 0, 0), (0, 0, 3.15), 0.07, post, FURNITURE),
        street_name(streets[0], looks).moved(0, 0, 2.98),
        street_name(streets[1], looks).turned(90).moved(0, 0, 2.64),
    )


def sign_post(kind: str, looks: Looks) -> Piece:
    """A traffic sign on a post, facing -y, grey behind."""
    post = looks.plain((132, 136, 136))
    width, height, skin = _traffic_sign(kind, looks)
    outline = _outline(kind)
    plate = _plate(outline * [width / 2, height / 2], skin, looks.plain((140, 142, 142)))
    return merge(bars((0, 0.03, 0), (0, 0.03, 2.4 + height / 2), 0.06, post, FURNITURE), plate.moved(0, -0.02, 2.4))


SIGN_KINDS = ("stop", "no-parking", "one-way", "speed", "crossing", "no-entry", "parking", "bus", "yield")


def _outline(kind: str) -> np.ndarray:
    count = {"stop": 8, "speed": 24, "no-entry": 24, "crossing": 4, "yield": 3}.get(kind, 0)
    if not count:
        return np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    start = {"stop": np.pi / 8, "crossing": 0.0, "yield": -np.pi / 2}.get(kind, 0.0)
    angle = start + np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], 1)


def _plate(outline: np.ndarray, skin: Skin, back: Skin) -> Piece:
    """A flat plate (k, 2) in x and z, its picture to -y over its bounding box, grey behind."""
    front = polygon(outline, 0.0, skin, SIGN, uv=(outline / np.abs(outline).max() + 1) / 2)
    behind = polygon(outline, 0.015, back, SIGN)
    return merge(front, replace(behind, normals=np.abs(behind.normals), faces=behind.faces[:, ::-1]))


def _traffic_sign(kind: str, looks: Looks) -> tuple[float, float, Skin]:
    size = {"one-way": (0.9, 0.9), "no-parking": (0.5, 0.5)}.get(kind, (0.78, 0.78))
    found = looks.known(f"sign-{kind}")
    if found:
        return *size, found
    c = Canvas(2, 2, 64, WHITE, low=(-1, -1))
    red, black, blue = (196, 22, 30), (20, 20, 22), (20, 82, 170)
    if kind == "stop":
        c.disc(0, 0, 1.4, red)
        c.text(0, 0, "STOP", 0.75, WHITE, fit_m=1.6)
    elif kind == "speed":
        c.disc(0, 0, 1.0, red)
        c.disc(0, 0, 0.76, WHITE)
        c.text(0, 0, "30", 1.0, black)
    elif kind == "no-entry":
        c.disc(0, 0, 1.4, red)
        c.rect(-0.72, -0.17, 0.72, 0.17, WHITE)
    elif kind == "crossing":
        c.rect(-1, -1, 1, 1, (250, 196, 20))
        c.disc(0.0, 0.42, 0.13, black)
        c.fill(
            [
                (-0.1, 0.25), (0.14, 0.25), (0.1, -0.1), (0.36, -0.55), (0.22, -0.6), (0, -0.2), (-0.24, -0.6),
                (-0.36, -0.54), (-0.08, 0),
            ],
            black,
        )  # fmt: skip
    elif kind == "yield":
        c.rect(-1, -1, 1, 1, red)
        c.fill([(-0.48, 0.3), (0.48, 0.3), (0, -0.55)], WHITE)
    elif kind == "one-way":
        c.rect(-1, -0.5, 1, 0.5, black)
        shape = [(-0.85, -0.32), (0.35, -0.32), (0.35, -0.45), (0.9, 0), (0.35, 0.45), (0.35, 0.32), (-0.85, 0.32)]
        c.fill(shape, WHITE)
        c.text(-0.2, 0, "ONE WAY", 0.36, black, fit_m=1.2)
        c.rect(-1, 0.5, 1, 1, (140, 142, 142))
        c.rect(-1, -1, 1, -0.5, (140, 142, 142))
    elif kind == "parking":
        c.rect(-1, -1, 1, 1, blue)
        c.text(0, 0, "P", 1.5, WHITE)
    elif kind == "bus":
        c.rect(-1, -1, 1, 1, blue)
        c.rect(-0.6, -0.5, 0.6, 0.55, WHITE)
        c.rect(-0.5, 0.0, 0.5, 0.42, blue)
        c.text(0, -0.25, "BUS", 0.36, blue)
    else:
        c.rect(-0.95, -0.95, 0.95, 0.95, WHITE)
        c.disc(0, 0.25, 0.6, red, ring_m=0.12)
        c.text(0, 0.25, "P", 0.8, black)
        c.line([(-0.42, 0.67), (0.42, -0.17)], 0.12, red)
        c.text(0, -0.65, "8AM - 6PM", 0.3, red, fit_m=1.7)
    return *size, sheet(f"sign-{kind}", looks, c)


def billboard_skin(index: int, looks: Looks) -> Skin:
    """An advertisement, twice as wide as high."""
    words, ground, ink = BOARD_TEXTS[index % len(BOARD_TEXTS)]
    name = f"billboard-{words}"
    if found := looks.known(name):
        return found
    canvas, rng = Canvas(8, 4, 64, ground), looks.rng(name)
    for _ in range(5):
        canvas.disc(
            rng.uniform(0, 8), rng.uniform(0, 4), rng.uniform(0.3, 1.2), tuple(int(c * 0.85 + 20) for c in ground)
        )
    canvas.disc(6.4, 2.5, 1.0, ink)
    canvas.disc(6.4, 2.5, 0.7, ground)
    canvas.text(3.4, 2.5, words, 1.3, ink, fit_m=5.4)
    canvas.text(3.4, 1.2, "THE TASTE OF THE CITY", 0.42, ink)
    canvas.rect(0, 0, 8, 0.12, (40, 40, 42))
    canvas.rect(0, 3.88, 8, 4, (40, 40, 42))
    return sheet(name, looks, canvas, 0.8)


def billboard(index: int, looks: Looks) -> Piece:
    """A lit hoarding 8 m by 4 m on a steel frame, facing -y, its foot at z = 0."""
    skin, steel = billboard_skin(index, looks), looks.plain((60, 62, 64))
    foot = np.array([(x, 0.6, 0) for x in (-3, -1, 1, 3)], float)
    return merge(
        board(8, 4, skin, thick=0.16, both=False).moved(0, 0, 3.4),
        box((-4.05, 4.05), (-0.06, 0.1), (1.35, 5.45), steel, FURNITURE),
        bars(foot, foot + [0, 0, 5.2], 0.14, steel, FURNITURE),
        bars(foot + [0, 1.6, 0], foot + [0, 0, 4.2], 0.1, steel, FURNITURE),
        boxes(foot * [1, 0, 0] + [-0.2, -1.3, 1.1], foot * [1, 0, 0] + [0.2, -1.0, 1.3], steel, FURNITURE),
    )
