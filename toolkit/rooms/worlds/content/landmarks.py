"""Buildings of which a town has a single copy: church, cinema, library, parking house, filling station, building site.

Each in its own frame, its front along y = 0 and facing -y, x from 0 to its width.
"""

from itertools import pairwise

import numpy as np

from toolkit.rooms.worlds.content import pieces as kit
from toolkit.rooms.worlds.content.buildings import House, Roof, flat_roof
from toolkit.rooms.worlds.content.drawing import Canvas, Rng
from toolkit.rooms.worlds.content.facades import SHOP_FLOOR_M, Facade, cornice, shop_row, windowed_wall
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin, painted
from toolkit.rooms.worlds.content.street_furniture import board, sheet
from toolkit.rooms.worlds.content.surfaces import BRICKS, STONES, wall
from toolkit.rooms.worlds.world import SceneClass

B, R, SIGN, F = SceneClass.BUILDING, SceneClass.ROOF, SceneClass.SIGN, SceneClass.FURNITURE
PODIUM_M, COLUMN_M, PORTICO_M = 1.6, 9.0, 18.0
"""Dimensions of the library, metres: height of its podium and columns, width of its portico."""
_TURN = np.linspace(0, 2 * np.pi, 25)[:-1]
CIRCLE = np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def building_site(width: float, depth: float, looks: Looks, rng: Rng) -> House:
    """A concrete frame under way behind a hoarding, with a tower crane."""
    concrete = wall(looks, "concrete", (186, 180, 168))
    steel, timber = looks.plain((150, 84, 52)), looks.plain((186, 146, 96))
    x0, x1, y0, y1 = 8.0, width - 5.0, 7.0, depth - 6.0
    floors, floor_m = 5, 3.6
    # floors; the top floor is half built
    z = floor_m * np.arange(1, floors + 1)
    low = kit.xyz(x0, y0, z - 0.3)
    high = kit.xyz(x1, y1, z)
    high[-1, 0] = (x0 + x1) / 2
    # columns with reinforcement that sticks out, and props between the floors
    xs, ys = np.linspace(x0 + 0.3, x1 - 0.8, 6), np.linspace(y0 + 0.3, y1 - 0.8, 4)
    posts = np.array([(x, y, 0) for x in xs for y in ys])
    tops = np.where(posts[:, 0] < (x0 + x1) / 2, z[-1] + 1.2, z[-2] + 2.0)
    rods = (posts[:, None] + np.array([(dx, dy, 0) for dx in (0.1, 0.4) for dy in (0.1, 0.4)])).reshape(-1, 3)
    rods[:, 2] = np.repeat(tops, 4)
    props = kit.xyz(rng.uniform(x0, x1, 60), rng.uniform(y0, y1, 60), np.tile(z[:-1], 15))
    pieces = [
        kit.boxes(low, high, concrete, B, ()),
        kit.boxes(posts, posts + np.column_stack([np.full((len(posts), 2), 0.5), tops]), concrete, B),
        kit.bars(rods, rods + [0, 0, 0.9], 0.03, steel, B),
        kit.bars(props, props + [0, 0, floor_m - 0.3], 0.07, steel, B),
        _fence(width, depth, looks), tower_crane(looks).moved(4.0, depth - 4.2, 0),
    ]  # fmt: skip
    # railings along the edges, and piles of timber
    edge = np.array([(x0, y, level) for level in z for y in (y0, y1)], float)
    for rail in (0.55, 1.05):
        pieces.append(kit.bars(edge + [0, 0, rail], edge + [x1 - x0, 0, rail], 0.06, looks.plain((236, 150, 30)), B))
    piles = np.array([(rng.uniform(x0, x1), 3.0, 0) for _ in range(5)])
    pieces.append(kit.boxes(piles, piles + [2.4, 1.2, 0.7], timber, F))
    # solids for collisions
    frame = np.array(
        [[x0, y0, level - 0.3, x1 if k < floors - 1 else (x0 + x1) / 2, y1, level] for k, level in enumerate(z)]
    )
    return House(kit.merge(*pieces), frame)


@painted("hoarding", 0.8, (9.6, 2.4))
def hoarding(rng: Rng) -> np.ndarray:
    """A fence of boards with posters, 9.6 m long."""
    c = Canvas(9.6, 2.4, 56, (28, 92, 74))
    # boards of 1.2 m, with posters
    for k in range(8):
        c.line([(1.2 * k, 0), (1.2 * k, 2.4)], 0.03, (18, 64, 52))
    for k in range(5):
        x, tone = 0.4 + 1.9 * k, rng.integers(60, 240, 3)
        c.rect(x, 0.7, x + 0.9, 1.95, tuple(int(v) for v in tone))
        c.text(
            x + 0.45, 1.6,
            str(rng.choice(["CIRCUS", "ROCK!", "VOTE", "EXPO", "SALE"])),
            0.24, (250, 250, 244), fit_m=0.8,
        )  # fmt: skip
        c.rect(x + 0.15, 0.85, x + 0.75, 1.35, tuple(int(255 - v) for v in tone))
    c.text(7.6, 2.2, "DANGER · KEEP OUT", 0.2, (250, 210, 40))
    return c.texture(0.06, rng)


def _fence(width: float, depth: float, looks: Looks) -> Piece:
    def make(number: int, span: float) -> Piece:
        back = kit.wall_quads((-span, 0.0, 0.0, 2.4), 0.0, looks.plain((150, 120, 84)), B).turned(180).moved(0, 0.06, 0)
        return kit.merge(kit.wall_quads((0.0, 0.0, span, 2.4), 0.0, hoarding(looks), B), back)

    return kit.set_round(width, depth, make)


def tower_crane(looks: Looks, height: float = 42.0, jib: float = 36.0) -> Piece:
    """A yellow lattice tower crane: mast, slewing cab, jib towards +x, counter-jib with its ballast, hook."""
    yellow, grey = looks.plain((244, 178, 22)), looks.plain((150, 150, 148), "matte")
    half, step = 0.85, 2.0
    # mast: legs, rungs and crossed rods
    foot = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    legs = np.column_stack([foot, np.zeros(4)])
    z = np.arange(0, height, step)
    # every 2 m a rung, and a rod that changes its direction at each
    rungs, rods = [], []
    for k in range(4):
        a, b = foot[k], foot[(k + 1) % 4]
        rungs += [((*a, level), (*b, level)) for level in z]
        rods += [((*(a if i % 2 else b), level), (*(b if i % 2 else a), level + step)) for i, level in enumerate(z)]
    lattice = np.array(rungs + rods)
    # jib: a triangular truss of three chords
    top = height + 0.6
    x = np.arange(0, jib + 0.1, 1.8)
    ridge, left, right = (kit.xyz(x, y, level) for y, level in ((0, top + 1.5), (-0.7, top), (0.7, top)))
    # each point of the ridge is tied to two points of each lower chord
    web = [(a[k], b[k + d]) for a, b in ((ridge, left), (ridge, right)) for k in range(len(x) - 1) for d in (0, 1)]
    web += [(left[k], right[k]) for k in range(len(x))]
    truss = np.array(web)
    # ties from the apex to jib and counter-jib, and the hook
    apex = np.array([0.0, 0.0, top + 7.0])
    ties = np.array([(apex, (jib * 0.62, 0, top + 1.5)), (apex, (-11.0, 0, top)), (apex, (jib * 0.3, 0, top + 1.5))])
    # the hook hangs at seven tenths of the jib
    hook = np.array([jib * 0.7, 0, top])
    # from the mast up, then jib, ties, ballast, cab and hook
    pieces = [
        kit.bars(legs, legs + [0, 0, height], 0.2, yellow, F),
        kit.bars(lattice[:, 0], lattice[:, 1], 0.09, yellow, F),
        kit.bars(
            np.stack([line[0] for line in (ridge, left, right)]),
            np.stack([line[-1] for line in (ridge, left, right)]),
            0.16, yellow, F,
        ),
        kit.bars(truss[:, 0], truss[:, 1], 0.08, yellow, F), kit.bars(ties[:, 0], ties[:, 1], 0.08, grey, F),
        kit.bars([(-half, 0, top), (half, 0, top)], [apex, apex], 0.22, yellow, F),
        kit.bars([(-12.0, -0.7, top), (-12.0, 0.7, top)], [(0, -0.7, top), (0, 0.7, top)], 0.22, yellow, F),
        kit.box((-12.0, -9.0), (-0.9, 0.9), (top - 1.6, top + 0.8), grey, F),
        kit.box((-1.1, 1.1), (-1.1, 1.1), (height - 0.2, top), grey, F),
        kit.box((0.9, 2.5), (0.9, 2.2), (top - 1.9, top + 0.3), looks.plain((236, 236, 232)), F),
        kit.box((2.5, 2.53), (1.0, 2.1), (top - 1.2, top + 0.1), looks.plain((60, 84, 100), "gloss"), F),
        kit.bars(hook[None], hook[None] - [0, 0, 14], 0.05, looks.plain((30, 30, 32)), F),
        kit.box((hook[0] - 0.3, hook[0] + 0.3), (-0.2, 0.2), (top - 15, top - 14), yellow, F),
        kit.box((-1.6, 1.6), (-1.6, 1.6), (0, 0.5), grey, F),
    ]  # fmt: skip
    return kit.merge(*pieces)


def pointed_arch(x: float, z0: float, z1: float, width: float) -> np.ndarray:
    """(k, 2) outline of a lancet window about x, counter-clockwise."""
    w = width / 2
    rise = 1.6 * w
    t = np.linspace(0, 1, 7)
    right = np.column_stack([x + w * np.cos(t * np.pi / 2) ** 0.9, z1 - rise + rise * np.sin(t * np.pi / 2)])
    left = right[::-1][1:] * [-1, 1] + [2 * x, 0]
    return np.concatenate([[(x - w, z0), (x + w, z0)], right, left])


@painted("stained", 0.2)
def stained_glass(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """Leaded panes of many colours."""
    canvas = Canvas(1, 3, 96, (20, 20, 24))
    tones = ((38, 60, 130), (130, 34, 40), (46, 104, 70), (176, 140, 50), (70, 50, 110), (50, 92, 130))
    for row in range(18):
        for column in range(6):
            tone = tones[int(rng.integers(len(tones)))]
            x, z = column / 6, row / 6
            canvas.rect(x + 0.012, z + 0.012, x + 0.155, z + 0.155, tuple(int(c * rng.uniform(0.5, 1.1)) for c in tone))
    picture = canvas.texture()
    return picture, picture[::2, ::2].copy()


def _lancets(at: np.ndarray, z: tuple[float, float], width: float, trim: Skin, looks: Looks) -> Piece:
    pieces = []
    for x in at:
        pieces.append(kit.polygon(pointed_arch(x, z[0] - 0.25, z[1] + 0.35, width + 0.5), -0.05, trim, B))
        pieces.append(kit.polygon(pointed_arch(x, *z, width), -0.07, stained_glass(looks), B, fit=True))
    return kit.merge(*pieces)


def church(looks: Looks) -> House:
    """A stone church 16 m wide and 40 m deep: west tower with a spire, nave with a tiled roof, buttresses."""
    stone, trim = wall(looks, "ashlar", STONES[1]), wall(looks, "ashlar", STONES[5])
    slate = wall(looks, "tiles", (84, 88, 98))
    # outline of the nave on the plan, its eaves and its ridge, metres
    x0, x1, y0, y1, eaves, ridge = 1.5, 14.5, 5.0, 38.0, 9.5, 17.5
    length = y1 - y0
    # long sides with lancets and buttresses
    foot, head = np.array([(-0.35, -0.9, 0), (-0.35, -0.5, eaves * 0.5)]), np.array([(0.35, 0, 0.5), (0.35, 0, 0.82)])
    side = kit.merge(
        kit.wall_quads((0, 0, length, eaves), 0.0, stone, B),
        _lancets(np.arange(3.0, length - 2, 5.2), (2.6, 7.2), 1.5, trim, looks),
        *(
            kit.boxes(foot + [x, 0, 0], head * [1, 1, eaves] + [x, 0, 0], trim, B, without=("back", "bottom"))
            for x in np.arange(0.5, length, 5.2)
        ),
    )
    # gables and the two slopes of the roof
    middle = (x0 + x1) / 2
    gable = np.array([(x0, 0), (x1, 0), (x1, eaves), (middle, ridge), (x0, eaves)])
    y, low, high = (y0 - 0.3, y1 + 0.3), eaves - 0.5, ridge + 0.15
    slopes = np.array([
        [(x, y[a], low), (middle, y[a], high), (middle, y[b], high), (x, y[b], low)]
        for x, a, b in ((x0 - 0.5, 0, 1), (x1 + 0.5, 1, 0))
    ])  # fmt: skip
    east = kit.merge(
        kit.polygon(gable[::1] - [middle, 0], 0.0, stone, B),
        _lancets(np.array([-3.4, 0, 3.4]), (3, 8.5), 1.8, trim, looks),
    )
    # the two long sides, west gable and east wall, the roof with its underside, the tower
    pieces = [
        kit.place(side, [(x0, y1, 0.0), (x1, y0, 0.0)], [270.0, 90.0]),
        kit.polygon(gable, y0, stone, B), kit.place(east, (middle, y1, 0.0), 180.0), kit.quads(slopes, slate, R),
        kit.quads(slopes[:, ::-1] - [0, 0, 0.06], trim, R), _tower(looks, stone, trim).moved(middle, 3.2, 0),
    ]  # fmt: skip
    # solids for collisions: nave, attic in steps, tower
    solids = [[x0, y0, 0, x1, y1, eaves]]
    for k in range(4):  # the attic in steps
        share = (k + 1) / 5
        inset = (x1 - x0) / 2 * share
        solids.append([x0 + inset, y0, eaves, x1 - inset, y1, eaves + (ridge - eaves) * share])
    solids.append([middle - 3.2, 0, 0, middle + 3.2, 6.4, 22.0])
    return House(kit.merge(*pieces), np.array(solids, float))


def _tower(looks: Looks, stone: Skin, trim: Skin) -> Piece:
    half, top = 3.2, 22.0
    circle = CIRCLE
    dark = looks.plain((34, 34, 36), "matte")
    # belfry windows: a dark arch behind louvres
    clock = _clock(looks)
    bell = [kit.polygon(pointed_arch(x, 17.6, 20.8, 1.1), -0.05, dark, B) for x in (-1.1, 1.1)]
    louvre = [
        kit.bars((x - 0.5, -0.06, z), (x + 0.5, -0.06, z), 0.09, trim, B)
        for x in (-1.1, 1.1)
        for z in np.arange(17.8, 20.2, 0.35)
    ]
    # a face with its clock, cornices and corner buttresses
    face = kit.merge(
        kit.wall_quads((-half, 0, half, top), 0.0, stone, B), *bell, *louvre,
        kit.polygon(circle * 1.15 + [0, 15.6], -0.06, trim, B),
        kit.polygon(circle * 0.98 + [0, 15.6], -0.08, clock, SIGN, fit=True),
        kit.boxes(
            [(-half, -0.2, z) for z in (6.6, 13.6, 16.8)], [(half, 0, z + 0.3) for z in (6.6, 13.6, 16.8)], trim, B,
            ("back",),
        ),
        kit.boxes(
            [(-half - 0.4, -0.4, 0), (half - 0.6, -0.4, 0)], [(-half + 0.6, 0, 15), (half + 0.4, 0, 15)], trim, B,
            ("back", "bottom"),
        ),
    )  # fmt: skip
    front = _west_front(looks, trim)
    # the same face on four sides
    ring = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    yaws = np.array([0.0, 90.0, 180.0, 270.0])
    at = np.array([(0, -half, 0), (half, 0, 0), (0, half, 0), (-half, 0, 0)], float)
    # spire with pinnacles and a cross
    slate = wall(looks, "tiles", (84, 88, 98))
    spire = kit.revolved([(half * 1.08, top), (0.06, top + 15.0)], 8, slate, R, 20, start_deg=22.5)
    pinnacle = kit.revolved([(0.5, top), (0.5, top + 1.4), (0.62, top + 1.5), (0.02, top + 3.8)], 8, trim, R, 20)
    start = [(0, 0, top + 14.8), (-0.7, 0, top + 16.4)]
    cross = kit.bars(start, [(0, 0, top + 17.2), (0.7, 0, top + 16.4)], 0.16, looks.plain((196, 160, 70), "metal"), R)
    corners = np.column_stack([ring * 0.92, np.zeros(4)])
    deck = kit.floor_quads((-half, -half, half, half), top, trim, R)
    return kit.merge(
        kit.place(face, at, yaws), kit.place(front, at[:1]), spire, kit.place(pinnacle, corners), cross, deck
    )


def _clock(looks: Looks) -> Skin:
    c = Canvas(2, 2, 96, (22, 26, 40), low=(-1, -1))
    c.disc(0, 0, 0.94, (240, 234, 214))
    for k in range(12):
        a = np.pi * k / 6
        c.line([(0.72 * np.sin(a), 0.72 * np.cos(a)), (0.88 * np.sin(a), 0.88 * np.cos(a))], 0.07, (22, 26, 40))
    c.line([(0, 0), (0.42, 0.3)], 0.08, (16, 16, 20))
    c.line([(0, 0), (-0.1, 0.74)], 0.055, (16, 16, 20))
    return sheet("clock", looks, c, 0.8)


def _west_front(looks: Looks, trim: Skin) -> Piece:
    circle, dark = CIRCLE, looks.plain((34, 34, 36), "matte")
    # the door in its arch, and the rose window above
    return kit.merge(
        kit.polygon(pointed_arch(0, 0.0, 5.4, 3.4), -0.06, trim, B),
        kit.polygon(pointed_arch(0, 0.0, 4.8, 2.5), -0.1, looks.plain((74, 44, 26)), B),
        kit.bars((0, -0.11, 0), (0, -0.11, 4.6), 0.06, dark, B),
        kit.polygon(circle * 1.9 + [0, 10.2], -0.06, trim, B),
        kit.polygon(circle * 1.6 + [0, 10.2], -0.09, stained_glass(looks), B, fit=True),
        # tracery: spokes of the rose window
        kit.bars(
            np.array([(0, -0.12, 10.2)] * 8),
            kit.xyz(circle[::3, 0] * 1.6, -0.12, circle[::3, 1] * 1.6 + 10.2),
            0.1, trim, B,
        ),
    )  # fmt: skip


def _cinema_sheets(looks: Looks) -> tuple[Skin, Skin, Skin]:
    # letters on a lit board
    c = Canvas(7, 1.5, 80, (250, 246, 232))
    c.text(3.5, 1.05, "NOW SHOWING: THE LAST TRAM", 0.42, (30, 30, 32), fit_m=6.6)
    c.text(3.5, 0.42, "7:15  9:30  LATE SHOW FRIDAY", 0.4, (176, 24, 30), fit_m=6.6)
    marquee = sheet("marquee", looks, c, 1.0)
    # the name reads downwards
    name = Canvas(1.4, 7.5, 72, (150, 18, 28))
    for k, letter in enumerate("CINEMA"):
        name.text(0.7, 6.75 - 1.2 * k, letter, 1.1, (255, 226, 120))
    upright = sheet("cinema-name", looks, name, 1.0)
    # four posters side by side
    posters = Canvas(6, 2, 80, (40, 16, 20))
    for k in range(4):
        tone = ((220, 60, 40), (40, 90, 160), (240, 190, 50), (60, 130, 90))[k]
        posters.rect(0.1 + 1.5 * k, 0.15, 1.4 + 1.5 * k, 1.85, (240, 236, 220))
        posters.rect(0.16 + 1.5 * k, 0.21, 1.34 + 1.5 * k, 1.79, tone)
        posters.disc(0.75 + 1.5 * k, 1.1, 0.4, tuple(min(255, v + 70) for v in tone))
        posters.text(0.75 + 1.5 * k, 0.42, ("STAR", "OCEAN", "GOLD", "FOREST")[k], 0.3, (250, 250, 244), fit_m=1.1)
    bills = sheet("posters", looks, posters, 0.7)
    return marquee, upright, bills


def cinema(width: float, depth: float, looks: Looks, rng: Rng) -> House:
    """A picture palace: rendered front with fins, a lit marquee over the doors, and an upright sign."""
    # materials and lettering
    render, brick = wall(looks, "render", (206, 150, 124)), wall(looks, "brick", BRICKS[1])
    trim = looks.plain((232, 224, 200), "matte")
    height, middle = 15.0, width / 2
    lit = looks.plain((255, 232, 170), "lamp")
    marquee, upright, bills = _cinema_sheets(looks)
    # fins, doors, bulbs and bills are laid out about the middle
    fins = np.linspace(middle - 4.5, middle + 4.5, 7)
    low = kit.xyz(fins - 0.22, -0.5, 5.6)
    doors = np.linspace(middle - 3, middle + 3, 5)
    bulbs = np.array([(middle - 4.4 + 0.4 * k, -3.06, z) for k in range(23) for z in (3.62, 5.38)])
    end = board(2.7, 1.3, marquee, SIGN, 0.0, both=False)
    beside = np.array([(middle - 9.5, 0.7, middle - 3.8, 2.6), (middle + 3.8, 0.7, middle + 9.5, 2.6)])
    door_cells = np.array([(a + 0.06, 0.1, b - 0.06, 2.6) for a, b in pairwise(doors)])
    pieces = [
        kit.wall_quads((0, 0, width, height), 0.0, render, B),
        kit.boxes(low, low + np.array([0.44, 0.5, height + 0.6 - 5.6]), trim, B, ("bottom", "back")),
        kit.box((middle - 4.5, middle + 4.5), (-3.0, 0.0), (3.55, 5.45), looks.plain((150, 18, 28)), B),
        board(7.0, 1.5, marquee, SIGN, 0.0, both=False).moved(middle, -3.02, 4.5),
        kit.place(end, [(middle + 4.52, -1.5, 4.5), (middle - 4.52, -1.5, 4.5)], [90.0, 270.0]),
        kit.boxes(bulbs - 0.06, bulbs + 0.06, lit, SIGN, ()),
        kit.wall_quads(door_cells, -0.05, looks.plain((60, 46, 36), "gloss"), B),
        kit.wall_quads(door_cells + [0.15, 0.9, -0.15, -0.3], -0.07, looks.plain((230, 200, 140), "lamp"), B),
        kit.wall_quads(beside.clip([0.3, 0, 0.3, 0], [width - 0.3, 9, width - 0.3, 9]), -0.06, bills, SIGN, fit=True),
        kit.place(board(1.4, 7.5, upright, SIGN, 0.3), (middle + 5.6, -1.0, 9.6), 90.0),
        kit.box((middle + 5.44, middle + 5.76), (-0.3, 0.0), (6.5, 12.8), trim, B),
        cornice(width, height, trim, 0.4, dentils=False, ends=False),
    ]  # fmt: skip
    # bands on either side of the sign
    for x0, x1 in ((0.6, middle - 5.2), (middle + 6.6, width - 0.6)):
        pieces.append(kit.wall_quads([(x0, 6.5 + 2.6 * k, x1, 8.2 + 2.6 * k) for k in range(3)], -0.04, trim, B))
    # plain brick on the other sides
    sides = kit.set_round(
        width, depth, lambda k, span: kit.wall_quads((0, 0, span, height), 0.0, brick, B) if k else kit.EMPTY
    )
    pieces += [sides, flat_roof(Roof(width, depth, height), brick, trim, looks, rng)]
    return House(kit.merge(*pieces), np.array([[0, 0, 0, width, depth, height]]))


def library(width: float, depth: float, looks: Looks, rng: Rng) -> House:
    """A classical front: steps, columns, a pediment with PUBLIC LIBRARY, stone wings."""
    stone, trim = wall(looks, "ashlar", STONES[5]), wall(looks, "render", (222, 208, 182))
    # two rows of arched windows between pilasters
    style = Facade(
        stone, trim, "arched", window_m=(1.4, 2.8, 0.9), floor_m=4.6, bay_m=3.4, recess_m=0.35, pilasters=True,
        string_course=True,
    )  # fmt: skip
    height, middle = PODIUM_M + COLUMN_M + 2.6, width / 2
    pieces = [_portico(looks, stone, trim).moved(middle)]

    # front, right and back carry the cornice
    def make(number: int, side: float) -> Piece:
        bare = kit.wall_quads([(0, 0, side, PODIUM_M), (0, PODIUM_M + 9.2, side, height)], 0.0, stone, B)
        crown = cornice(side, height, trim, 0.5, ends=False) if number < 3 else kit.EMPTY
        return kit.merge(bare, windowed_wall(style, side, looks, rng, z0=PODIUM_M, floors=2), crown)

    pieces += [kit.set_round(width, depth, make), flat_roof(Roof(width, depth, height), stone, trim, looks, rng)]
    # the portico stands out before the wall
    top = PODIUM_M + COLUMN_M
    porch = [middle - PORTICO_M / 2, -4, top, middle + PORTICO_M / 2, 0, top + 1.6]
    return House(kit.merge(*pieces), np.array([[0, 0, 0, width, depth, height], porch]))


def _portico(looks: Looks, stone: Skin, trim: Skin) -> Piece:
    """Steps, six columns, an architrave with the name, a pediment; about x = 0, before y = 0."""
    half, top = PORTICO_M / 2, PODIUM_M + COLUMN_M
    # columns with base and capital
    profile = [(0.75, 0), (0.75, 0.25), (0.6, 0.4), (0.52, 0.6), (0.5, 3.0)]
    profile += [(r, COLUMN_M - drop) for r, drop in ((0.43, 0.7), (0.55, 0.5), (0.7, 0.35), (0.7, 0.0))]
    column = kit.revolved(profile, 18, trim, B, 50)
    xs = np.linspace(-half + 1.1, half - 1.1, 6)
    # steps before the portico
    steps = np.array([(-half - 0.4 * (7 - k), -6.6 + 0.4 * k, 0.2 * k) for k in range(8)])
    tops = np.array([(half + 0.4 * (7 - k), 0.0, 0.2 * (k + 1)) for k in range(8)])
    # the name over the columns
    c = Canvas(12, 1.1, 64, (200, 188, 164))
    c.text(6, 0.55, "PUBLIC  LIBRARY", 0.85, (70, 62, 50), face="serif", fit_m=11)
    words = sheet("library-name", looks, c)
    # gable and roof
    eaves, ridge, edge = top + 1.6, top + 5.2, half + 0.5
    gable = np.array([(-edge, eaves), (edge, eaves), (0, ridge)])
    inner = np.array([(-half + 1.2, eaves + 0.3), (half - 1.2, eaves + 0.3), (0, eaves + 2.9)])
    slopes = [
        [(edge, -4.4, eaves), (edge, 2, eaves), (0, 2, ridge), (0, -4.4, ridge)],
        [(-edge, 2, eaves), (-edge, -4.4, eaves), (0, -4.4, ridge), (0, 2, ridge)],
        [(edge, 2, eaves), (-edge, 2, eaves), (0, 2, ridge), (0, 2, ridge)],
    ]
    # windows and door behind the columns
    windows = np.array([(-5.2, -0.1, PODIUM_M + 0.8), (3.4, -0.1, PODIUM_M + 0.8)])
    door = np.array([(-1.3, -0.12, PODIUM_M)])
    name = np.array([(-6, top + 0.25, 6, top + 1.35)])
    pieces = [
        kit.boxes(steps, tops, trim, B, ("bottom", "back")), kit.place(column, kit.xyz(xs, -3.2, PODIUM_M)),
        kit.boxes((-half, -4.0, top), (half, 0.0, eaves), trim, B, ()),
        kit.wall_quads(name, -4.02, words, SIGN, fit=True),
        kit.polygon(gable, -4.4, trim, B), kit.polygon(inner, -4.42, stone, B),
        kit.quads(np.array(slopes), wall(looks, "tiles", (96, 104, 100)), R),
        kit.boxes(door, door + [2.6, 0.12, 4.2], looks.plain((70, 44, 28)), B, ("back",)),
        kit.boxes(windows, windows + [1.8, 0.1, 3.6], looks.plain((60, 74, 84), "gloss"), B, ("back",)),
    ]  # fmt: skip
    return kit.merge(*pieces)


def parking_house(width: float, depth: float, looks: Looks, cars: list[Piece], rng: Rng) -> House:
    """Open decks with parapets, parked cars to be seen between them, a ramp sign and a big P; a pad on top."""
    concrete, dark = wall(looks, "concrete", (168, 164, 156)), wall(looks, "concrete", (120, 118, 114))
    decks, floor_m = 5, 3.1
    # decks with parapets
    z = floor_m * np.arange(1, decks + 1)
    full = np.array([(0.0, 0.0, width, depth)])
    low = kit.xyz(0.0, 0.0, z - 0.35)
    high = kit.xyz(width, depth, z)
    rim = []
    for level in z:
        for a, b in (
            ((0, 0), (width, 0.2)), ((0, depth - 0.2), (width, depth)), ((0, 0.2), (0.2, depth - 0.2)),
            ((width - 0.2, 0.2), (width, depth - 0.2)),
        ):  # fmt: skip
            rim.append([*a, level, *b, level + 1.0])
    edge = np.array(rim)
    # columns along the outer edge
    xs, ys = np.linspace(0.5, width - 1.0, 6), np.linspace(0.4, depth - 0.9, 5)
    posts = np.array([(x, y, 0) for x in xs for y in ys if x in (xs[0], xs[-1]) or y in (ys[0], ys[-1])])
    # signs
    c = Canvas(2.4, 2.4, 72, (20, 82, 170))
    c.text(1.2, 1.2, "P", 2.1, (244, 244, 244))
    big = sheet("big-p", looks, c, 0.9)
    n = Canvas(8, 1.0, 72, (20, 82, 170))
    n.text(4, 0.5, "CITY PARKING · 24 H", 0.75, (244, 244, 244), fit_m=7.4)
    words = sheet("parking-name", looks, n, 0.9)
    pieces = [
        kit.boxes(low, high, concrete, B, ()), kit.boxes(edge[:, :3], edge[:, 3:], dark, B),
        kit.boxes(posts, posts + [0.5, 0.5, z[-1]], concrete, B),
        kit.floor_quads(full, 0.02, dark, R),
        board(2.4, 2.4, big, SIGN, 0.3).moved(3.0, -0.35, z[-1] - 1.4),
        kit.box((1.8, 4.2), (-0.5, -0.2), (z[-1] - 2.6, z[-1] - 0.2), looks.plain((30, 30, 32)), SIGN),
        kit.wall_quads((width / 2 - 4, 2.72, width / 2 + 4, 3.72), -0.06, words, SIGN, fit=True),
        kit.boxes((width * 0.6, depth * 0.4, 0), (width * 0.75, depth * 0.6, z[-1] + 2.8), concrete, B),
    ]  # fmt: skip
    # parked cars on the ground, the first deck and the roof
    bays = np.arange(3.0, width - 3.0, 2.7)
    for level in (0.02, z[0], z[-1]):
        for y, yaw in ((3.2, 90.0), (depth - 3.2, 270.0)):
            for x in bays[rng.random(len(bays)) < 0.36]:
                pieces.append(kit.place(cars[int(rng.integers(len(cars)))], (x, y, level), yaw))
    return House(kit.merge(*pieces), np.array([[0, 0, 0, width, depth, z[-1]]]))


def filling_station(width: float, looks: Looks) -> House:
    """A canopy on posts over four pumps, and a kiosk behind."""
    red, white, dark = looks.plain((206, 26, 32)), looks.plain((240, 240, 238)), looks.plain((40, 42, 44))
    # lettering and the face of a pump
    c = Canvas(8, 0.9, 64, (206, 26, 32))
    c.text(4, 0.45, "PETRA · FUEL", 0.7, (250, 250, 246))
    words = sheet("fuel", looks, c, 0.9)
    p = Canvas(0.8, 1.7, 96, (236, 236, 234))
    p.rect(0, 1.2, 0.8, 1.7, (206, 26, 32))
    p.text(0.4, 1.45, "FUEL", 0.22, (250, 250, 246))
    p.rect(0.12, 0.72, 0.68, 1.12, (22, 30, 26))
    p.text(0.4, 0.98, "24.60", 0.17, (120, 240, 120))
    p.text(0.4, 0.82, "13.7 L", 0.12, (120, 240, 120))
    for k, tone in enumerate(((30, 140, 60), (30, 30, 30), (206, 160, 30))):
        p.rect(0.12 + 0.2 * k, 0.4, 0.28 + 0.2 * k, 0.62, tone)
    pump_face = sheet("pump", looks, p, 0.5)
    # a pump with its face on both sides, a hose and a kerb
    face = board(0.8, 1.7, pump_face, F, 0.5)
    hose = np.array([(0.42, 0, 1.3), (0.56, 0, 0.7), (0.5, 0, 0.35), (0.42, -0.1, 0.8)])
    pump = kit.merge(
        face.moved(0, 0, 1.0),
        kit.box((-0.4, 0.4), (-0.24, 0.24), (0.15, 1.88), red, F),
        kit.bars(hose[:-1], hose[1:], 0.05, dark, F),
        kit.box((-0.8, 0.8), (-0.6, 0.6), (0, 0.15), looks.plain((170, 168, 160)), F),
    )
    # pumps under a lit roof
    middle = width / 2
    at = np.array([(middle + dx, dy, 0.0) for dx in (-3.5, 3.5) for dy in (5.0, 9.0)])
    posts = np.array([(middle + dx, 7.0, 0.0) for dx in (-3.5, 3.5)])
    pieces = [
        kit.place(pump, at),
        kit.boxes(posts - [0.2, 0.2, 0], posts + [0.2, 0.2, 4.9], white, F),
        kit.boxes((middle - 8, 2.0, 4.9), (middle + 8, 12.0, 5.8), red, B, ()),
        board(8, 0.8, words, SIGN, 0.0, both=False).moved(middle, 1.98, 5.35),
        board(8, 0.8, words, SIGN, 0.0, both=False).turned(180).moved(middle, 12.02, 5.35),
        kit.boxes(
            [(middle + dx - 0.5, dy - 0.3, 4.87) for dx in (-5, 0, 5) for dy in (4, 7, 10)],
            [(middle + dx + 0.5, dy + 0.3, 4.9) for dx in (-5, 0, 5) for dy in (4, 7, 10)],
            looks.plain((255, 250, 230), "lamp"), F, ("top",),
        ),
    ]  # fmt: skip
    # the kiosk behind the pumps
    kiosk = kit.merge(
        shop_row(11.0, looks, looks.rng("kiosk"), white), kit.boxes((0, 0.5, 0), (11, 6, SHOP_FLOOR_M), white, B)
    )
    pieces.append(kiosk.moved(middle - 5.5, 15.0, 0))
    # kiosk and roof are solid, pumps are not
    return House(
        kit.merge(*pieces),
        np.array(
            [[middle - 5.5, 15.0, 0, middle + 5.5, 21.0, SHOP_FLOOR_M], [middle - 8, 2, 4.9, middle + 8, 12, 5.8]]
        ),
    )
