"""Ships, boats and containers; a hull lies along x, its bow to +x, its waterline at z = 0."""

import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import Canvas
from toolkit.content.pieces import Looks, Piece, Skin, bars, box, boxes, merge, place, quads, revolved, wall_quads
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass

WATER_Z = -2.2
F, B, V = SceneClass.FURNITURE, SceneClass.BUILDING, SceneClass.VEHICLE
BOX_M = (12.19, 2.44, 2.6)
LINES: tuple[tuple[Colour, str], ...] = (
    ((160, 50, 36), "NORDLINE"), ((30, 78, 140), "BLUE STAR"), ((40, 110, 84), "EVERSEA"), ((206, 130, 30), "HAPAX"),
    ((186, 186, 182), "POLAR"), ((110, 40, 60), "MAGENTA"),
)  # fmt: skip


def container_skin(looks: Looks, line: int) -> Skin:
    """Corrugated steel with the line's name, a long side of a container."""
    colour, name = LINES[line]
    if found := looks.known(f"container-{name}"):
        return found
    canvas = Canvas(BOX_M[0], BOX_M[2], 40, colour)
    for k in range(44):
        canvas.rect(0.1 + 0.275 * k, 0.15, 0.22 + 0.275 * k, BOX_M[2] - 0.12, tuple(int(c * 0.78) for c in colour))
    canvas.text(BOX_M[0] / 2, 1.45, name, 1.3, (238, 238, 232), fit_m=8)
    canvas.text(11.2, 2.2, "22G1", 0.24, (238, 238, 232))
    return looks.add(Material(f"container-{name}", canvas.texture(0.08, looks.rng(name)), 0.6), BOX_M[:1] + BOX_M[2:])


def container(looks: Looks, line: int, label: int = F) -> Piece:
    """A 40-foot box about the middle of its base."""
    length, width, height = BOX_M
    colour = LINES[line][0]
    skin, frame = container_skin(looks, line), looks.plain(tuple(int(c * 0.85) for c in colour))
    side = wall_quads((-length / 2, 0.0, length / 2, height), 0.0, skin, label, fit=True)
    posts = np.array([(sx * (length / 2) - 0.08, sy * (width / 2) - 0.08, 0) for sx in (-1, 1) for sy in (-1, 1)])
    rods = np.array([(length / 2 + 0.03, y, 0.15) for y in (-0.7, -0.25, 0.25, 0.7)])
    return merge(
        boxes((-length / 2, -width / 2 + 0.02, 0.0), (length / 2, width / 2 - 0.02, height), frame, label),
        place(side, [(0, -width / 2, 0), (0, width / 2, 0)], [0.0, 180.0]),
        boxes(posts, posts + [0.16, 0.16, height + 0.02], frame, label),
        bars(rods, rods + [0, 0, 2.3], 0.05, looks.plain((170, 170, 166)), label),
    )


def hull(
    length: float, beam: float, looks: Looks, *, side: float, draught: float, colours: tuple[Colour, Colour],
    bow: float = 0.24,
) -> Piece:  # fmt: skip
    """A hull along x, bow to +x, its waterline at z = 0: topsides, boot top, deck."""
    share = np.linspace(0, 1, 15)
    x = -length / 2 + length * share
    half = beam / 2 * np.clip((1 - share) / bow, 0, 1) ** 0.6 * np.minimum(1, 0.82 + share * 1.5)
    sheer = side * (1 + 0.35 * np.clip((share - 0.65) / 0.35, 0, 1) ** 2)
    rake = length * 0.03 * np.clip((share - 0.7) / 0.3, 0, 1)
    low, waterline = (
        np.column_stack([x - rake, half * 0.86, np.full(15, -draught)]),
        np.column_stack([x, half * 0.96, np.full(15, 0.4)]),
    )
    rail = np.column_stack([x + rake, half, sheer])
    flip = np.array([1, -1, 1])
    pieces = []
    for a, b, colour in ((low, waterline, colours[1]), (waterline, rail, colours[0])):
        starboard = np.stack([a[:-1] * flip, a[1:] * flip, b[1:] * flip, b[:-1] * flip], 1)
        port = np.stack([a[1:], a[:-1], b[:-1], b[1:]], 1)
        stern = np.array([[a[0], a[0] * flip, b[0] * flip, b[0]]])
        pieces.append(quads(np.concatenate([starboard, port, stern]), looks.plain(colour, "gloss"), V))
    deck = rail - [0, 0, 0.5 if side > 2 else 0.12]
    pieces.append(quads(
        np.stack([deck[:-1] * flip, deck[1:] * flip, deck[1:], deck[:-1]], 1),
        looks.plain((150, 110, 76), "matte"), V,
    ))  # fmt: skip
    inner = np.stack([rail[1:] * flip, rail[:-1] * flip, deck[:-1] * flip, deck[1:] * flip], 1)
    pieces.append(quads(np.concatenate([inner, (inner * flip)[:, ::-1]]), looks.plain((214, 210, 200)), V))
    return merge(*pieces)


def _house(x: tuple[float, float], width: float, z: float, decks: int, looks: Looks) -> Piece:
    """A white deckhouse with rows of windows."""
    white, glass = looks.plain((236, 236, 230)), looks.plain((40, 58, 70), "gloss")
    pieces = []
    for k in range(decks):
        shrink = 0.5 * k
        a, b, w, z0 = x[0] + 0.2 * k, x[1] - shrink, width / 2 - 0.2 * k, z + 2.6 * k
        pieces.append(box((a, b), (-w, w), (z0, z0 + 2.6), white, V))
        cells = np.arange(-w + 0.4, w - 0.7, 1.1)
        pieces.append(boxes(
            np.column_stack([np.full(len(cells), b - 0.02), cells, np.full(len(cells), z0 + 1.3)]),
            np.column_stack([np.full(len(cells), b + 0.02), cells + 0.7, np.full(len(cells), z0 + 2.1)]),
            glass, V,
        ))  # fmt: skip
        cells = np.arange(a + 0.4, b - 0.8, 1.2)
        for y in (-w, w):
            pieces.append(boxes(
                np.column_stack([cells, np.full(len(cells), y - 0.02), np.full(len(cells), z0 + 1.3)]),
                np.column_stack([cells + 0.7, np.full(len(cells), y + 0.02), np.full(len(cells), z0 + 2.1)]),
                glass, V,
            ))  # fmt: skip
    return merge(*pieces)


def feeder_ship(looks: Looks, rng: np.random.Generator) -> Piece:
    """A feeder container ship 110 m long at the quay."""
    boxes_at, kinds = [], []
    for bay in range(5):
        for row in range(6):
            for level in range(int(rng.integers(1, 4))):
                boxes_at.append((-22 + bay * 13.2, -6.3 + row * 2.5, 6.6 + level * 2.62))
                kinds.append(int(rng.integers(len(LINES))))
    at, kind = np.array(boxes_at), np.array(kinds)
    cargo = [place(container(looks, k, V), at[kind == k]) for k in range(len(LINES))]
    funnel = revolved([(2.2, 0), (1.9, 7), (1.5, 7.2), (1.5, 7.0)], 14, looks.plain((24, 60, 130)), V)
    return merge(
        hull(112.0, 18.0, looks, side=7.0, draught=5.0, colours=((28, 44, 82), (140, 36, 32))),
        *cargo, _house((-50, -36), 16.0, 6.6, 5, looks), funnel.moved(-46, 0, 19.0),
        bars([(-40, 0, 19), (48, 0, 8)], [(-40, 0, 30), (48, 0, 18)], 0.4, looks.plain((210, 208, 200)), V),
    )  # fmt: skip


def boats(looks: Looks, rng: np.random.Generator) -> Piece:
    """Fishing boats, a tug, yachts at moorings."""
    spar, sail = looks.plain((222, 218, 206)), looks.plain((240, 236, 224), "matte")
    fisher = merge(
        hull(15.0, 4.6, looks, side=2.0, draught=1.4, colours=((36, 96, 150), (150, 44, 36))),
        _house((-5.5, -1.5), 3.2, 1.6, 2, looks),
        bars(
            [(1, 0, 1.5), (1, 0, 7), (-6.5, -1.5, 2), (-6.5, 1.5, 2)],
            [(1, 0, 8.5), (6, 0, 3.5), (-6.5, -0.8, 5.5), (-6.5, 0.8, 5.5)],
            0.14, spar, V,
        ),
        box((-6.6, -6.4), (-1.0, 1.0), (5.3, 5.6), spar, V),
    )  # fmt: skip
    tug = merge(
        hull(24.0, 8.5, looks, side=3.0, draught=3.0, colours=((30, 32, 36), (150, 40, 34))),
        _house((-5, 5), 5.6, 2.5, 2, looks),
        revolved([(1.0, 7.6), (0.9, 11.0), (0.6, 11.0)], 12, looks.plain((226, 150, 30)), V),
    )
    jib = np.array([
        [(4.6, 0, 1.4), (0.4, 0.02, 1.8), (0.3, 0.02, 11.0), (0.3, 0.02, 11.0)],
        [(0.0, 0, 1.9), (-4.4, 0.1, 1.9), (0.0, 0, 12.6), (0.0, 0, 12.6)],
    ])  # fmt: skip
    yacht = merge(
        hull(10.5, 3.2, looks, side=1.1, draught=0.8, colours=((238, 238, 234), (30, 52, 110)), bow=0.45),
        box((-2.0, 1.6), (-0.9, 0.9), (0.9, 1.5), looks.plain((236, 236, 232)), V),
        bars([(0.2, 0, 0.9), (0.2, 0, 1.8)], [(0.2, 0, 13.2), (-4.5, 0, 1.8)], 0.12, spar, V),
    )
    sailing = merge(yacht, quads(np.concatenate([jib, jib[:, [0, 2, 1, 1]] + [0, 0.01, 0]]), sail, V))
    moored = np.array([(108.0 + 6.5 * k, -36.0 - 9.0 * (k % 2), WATER_Z) for k in range(6)])
    return merge(
        place(fisher, [(18.0, -5.0, WATER_Z), (95.0, -6.0, WATER_Z)], [0.0, 180.0]),
        place(tug, (-90.0, -62.0, WATER_Z), 18.0),
        place(yacht, moored, np.array([88.0, 92.0] * 3)),
        place(
            sailing, [(10.0, -150.0, WATER_Z), (-130.0, -210.0, WATER_Z), (80.0, -240.0, WATER_Z)], [30.0, 150.0, 200.0]
        ),
    )
