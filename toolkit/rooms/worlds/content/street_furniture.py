"""Street furniture: lamps, hydrants, bins, benches, bicycles, a fountain, flags, signs and traffic lights.

Each is built once at the origin, its front towards -y, and copied to where it stands.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from toolkit.rooms.worlds.content import pieces as kit
from toolkit.rooms.worlds.content.drawing import Canvas, Colour, Rng
from toolkit.rooms.worlds.content.modelling import box as bevelled_box
from toolkit.rooms.worlds.content.modelling import extrude, revolve, smooth_curve, tube
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin
from toolkit.rooms.worlds.content.surfaces import STONES, wall
from toolkit.rooms.worlds.world import SceneClass

F, SIGN = SceneClass.FURNITURE, SceneClass.SIGN
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


def street_lamp(looks: Looks) -> Piece:
    """A tapered mast with an arm out over the road to -y and a lit lantern, 8.4 m."""
    steel = looks.plain((86, 92, 92))
    arm = smooth_curve([(0, 0, 7.4), (0, -0.3, 8.1), (0, -1.2, 8.4), (0, -2.2, 8.4)], 5)
    return kit.merge(
        kit.revolved([(0.17, 0), (0.15, 1.0), (0.1, 1.05), (0.065, 7.5)], 7, steel, F),
        kit.solid(tube(arm, 0.05, 4), steel, F),
        kit.solid([p.moved(0, -2.4, 8.4) for p in bevelled_box((0.34, 0.8, 0.2), 0.05)], steel, F),
        kit.box((-0.13, 0.13), (-2.72, -2.1), (8.27, 8.305), looks.plain((255, 232, 180), "lamp"), F),
    )


def old_lamp(looks: Looks) -> Piece:
    """A cast-iron post with a glass globe, 3.9 m."""
    iron = looks.plain((28, 40, 36))
    profile = [
        (0.24, 0), (0.24, 0.25), (0.14, 0.35), (0.11, 1.0), (0.14, 1.05), (0.07, 1.15), (0.055, 3.2), (0.13, 3.3),
        (0.06, 3.38),
    ]  # fmt: skip
    globe = [(0.06, 3.38), (0.2, 3.48), (0.27, 3.66), (0.2, 3.86), (0.04, 3.95)]
    return kit.merge(kit.revolved(profile, 8, iron, F), kit.revolved(globe, 8, looks.plain((255, 240, 206), "lamp"), F))


def hydrant(looks: Looks) -> Piece:
    """A fire hydrant with its caps."""
    red = looks.plain((196, 36, 30))
    barrel = revolve(
        [
            (0.19, 0), (0.19, 0.06), (0.12, 0.08), (0.12, 0.5), (0.16, 0.52), (0.16, 0.56), (0.12, 0.6), (0.09, 0.7),
            (0.03, 0.76), (0.005, 0.78),
        ],
        9,
    )  # fmt: skip
    # two caps at the sides, and a larger cap in front
    cap = [
        revolve([(0.07, 0.0), (0.07, 0.2), (0.05, 0.21), (0.005, 0.23)], 8).rotated("x", a).moved(z=0.4)
        for a in (90, -90)
    ]
    front = revolve([(0.085, 0.0), (0.085, 0.19), (0.005, 0.2)], 8).rotated("y", 90).moved(z=0.34)
    return kit.solid([barrel, *cap, front], red, F).turned(-90)


def litter_bin(looks: Looks) -> Piece:
    """A ribbed waste bin with a domed lid."""
    green = looks.plain((36, 66, 50))
    ribs = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    foot = kit.xyz(0.3 * np.cos(ribs), 0.3 * np.sin(ribs), 0.08)
    return kit.merge(
        kit.revolved([(0.26, 0.02), (0.28, 0.9)], 10, looks.plain((30, 34, 32)), F),
        kit.bars(foot, foot * [1.08, 1.08, 1] + [0, 0, 0.82], 0.045, green, F),
        kit.revolved([(0.34, 0.9), (0.35, 0.97), (0.26, 1.1), (0.12, 1.14), (0.12, 1.1)], 10, green, F),
    )


def dustbins(looks: Looks) -> Piece:
    """Two galvanised dustbins and black bags."""
    zinc = looks.plain((140, 144, 146), "metal")
    profile = [(0.22, 0), (0.26, 0.68), (0.28, 0.7), (0.27, 0.74), (0.12, 0.82), (0.03, 0.84), (0.005, 0.86)]
    can = kit.revolved(profile, 9, zinc, F)
    bag = kit.revolved(
        [(0.2, 0), (0.34, 0.12), (0.3, 0.34), (0.1, 0.5), (0.06, 0.56), (0.12, 0.62)],
        7, looks.plain((22, 22, 26), "gloss"), F,
    )  # fmt: skip
    return kit.merge(
        kit.place(can, [(-0.35, 0, 0), (0.3, 0.05, 0)]),
        kit.place(bag, [(0.9, -0.1, 0), (1.3, 0.15, 0)], [0.0, 40.0], [1.0, 0.8]),
    )


def bench(looks: Looks) -> Piece:
    """A park bench: wooden slats on iron ends."""
    wood, iron = looks.plain((138, 88, 48)), looks.plain((32, 34, 34))
    # four slats to sit on, four to lean against
    seat = np.array([(-0.85, y, 0.44) for y in (-0.36, -0.22, -0.08, 0.06)])
    back = np.array([(-0.85, 0.14 + 0.05 * k, 0.56 + 0.13 * k) for k in range(4)])
    low = np.concatenate([seat, back])
    size = np.concatenate([np.tile([1.7, 0.11, 0.04], (4, 1)), np.tile([1.7, 0.035, 0.1], (4, 1))])
    # an iron end at each side: legs, seat, back and arm rest
    legs = []
    for x in (-0.72, 0.72):
        legs.append(kit.bars(
            [(x, -0.36, 0), (x, 0.12, 0), (x, -0.4, 0.44), (x, 0.1, 0.44), (x, -0.36, 0.66)],
            [(x, -0.36, 0.66), (x, 0.12, 0.44), (x, 0.14, 0.42), (x, 0.34, 1.06), (x, 0.16, 0.66)],
            0.06, iron, F,
        ))  # fmt: skip
    return kit.merge(kit.boxes(low, low + size, wood, F, ()), *legs)


def mailbox(looks: Looks) -> Piece:
    """A blue letter box with a round top on legs."""
    blue = looks.plain((24, 56, 132))
    # a box with a round top, lying along y after it is turned
    angle = np.linspace(0, np.pi, 13)
    arch = np.array([(0.28 * np.cos(a), 0.95 + 0.28 * np.sin(a)) for a in angle])
    outline = np.concatenate([[(0.28, 0.18)], arch, [(-0.28, 0.18)]])

    shell = [p.rotated("x", 90).moved(y=0.3) for p in extrude([tuple(p) for p in outline], 0.6)]
    # lettering and the slot, a sheet on the front
    c = Canvas(0.5, 0.3, 160, (24, 56, 132))
    c.rect(0.03, 0.16, 0.47, 0.27, (240, 240, 238))
    c.text(0.25, 0.21, "MAIL", 0.1, (24, 56, 132))
    c.rect(0.05, 0.02, 0.45, 0.12, (16, 36, 90))
    skin = sheet("mail-front", looks, c)
    feet = np.array([(x, y, 0) for x in (-0.24, 0.18) for y in (-0.26, 0.2)], float)
    return kit.merge(
        kit.solid(shell, blue, F, 30), kit.boxes(feet, feet + [0.06, 0.06, 0.2], blue, F),
        board(0.5, 0.3, skin, F, 0.0, both=False).moved(0, -0.305, 0.72),
        kit.box((-0.2, 0.2), (-0.32, -0.3), (1.0, 1.04), looks.plain((14, 30, 80)), F),
    )  # fmt: skip


def parking_meter(looks: Looks) -> Piece:
    """A twin-dial meter on a post."""
    grey, steel = looks.plain((96, 102, 106)), looks.plain((150, 154, 156), "metal")
    dome = revolve([(0.1, 1.12), (0.115, 1.2), (0.115, 1.34), (0.1, 1.44), (0.05, 1.5), (0.005, 1.515)], 9)
    solids = [revolve([(0.075, 0), (0.06, 0.012), (0.004, 0.014)], 8).rotated("x", 90).moved(0, -0.09, 1.39)]
    dial = kit.solid(solids, looks.plain((224, 226, 216), "gloss"), F)
    return kit.merge(
        kit.revolved([(0.045, 0), (0.035, 1.05), (0.07, 1.12), (0.1, 1.12)], 7, steel, F),
        kit.solid([dome.scaled(1, 0.75, 1)], grey, F), dial,
        kit.box((-0.035, 0.035), (-0.1, -0.07), (1.19, 1.28), looks.plain((30, 32, 34)), F),
        kit.box((-0.06, 0.06), (-0.095, -0.085), (1.385, 1.395), looks.plain((200, 30, 30)), F),
    )  # fmt: skip


def phone_booth(looks: Looks) -> Piece:
    """A pay-phone in a half booth with its lit sign."""
    steel, blue = looks.plain((170, 174, 176), "metal"), looks.plain((24, 64, 140))
    c = Canvas(0.8, 0.22, 128, (24, 64, 140))
    c.text(0.4, 0.11, "PHONE", 0.18, (240, 240, 240))
    skin = sheet("phone", looks, c, 0.9)
    # twelve keys in four rows
    keys = np.array([(-0.06 + 0.05 * (k % 3), 0.03, 1.14 + 0.05 * (k // 3)) for k in range(12)])
    pieces = [
        # post, three walls and roof with the sign
        kit.box((-0.05, 0.05), (0.0, 0.1), (0.0, 1.0), steel, F),
        kit.box((-0.42, 0.42), (0.1, 0.16), (0.9, 2.1), blue, F),
        kit.box((-0.42, -0.38), (-0.35, 0.1), (0.9, 2.1), blue, F),
        kit.box((0.38, 0.42), (-0.35, 0.1), (0.9, 2.1), blue, F),
        kit.box((-0.44, 0.44), (-0.38, 0.16), (2.1, 2.34), blue, F),
        board(0.8, 0.22, skin, F, 0.0, both=False).moved(0, -0.385, 2.22),
        # the telephone, its keys, and the receiver beside it
        kit.box((-0.17, 0.17), (0.04, 0.1), (1.05, 1.65), looks.plain((40, 42, 44), "metal"), F),
        kit.boxes(keys, keys + [0.035, 0.01, 0.035], looks.plain((220, 220, 216)), F, ()),
        kit.solid(
            tube(smooth_curve([(-0.26, 0.02, 1.3), (-0.25, -0.06, 1.45), (-0.26, 0.02, 1.6)], 6), 0.03, 8),
            looks.plain((20, 20, 22), "gloss"), F,
        ),
    ]  # fmt: skip
    return kit.merge(*pieces)


def bicycle(looks: Looks) -> Piece:
    """A bicycle leaning on its stand, along x."""
    paint = looks.plain((176, 28, 34), "gloss")
    dark, steel = looks.plain((22, 22, 24), "matte"), looks.plain((170, 172, 174), "metal")
    angle = np.linspace(0, 2 * np.pi, 12)
    pieces = []
    # tyre as a ring of rods, with spokes
    for x in (-0.52, 0.52):
        ring = kit.xyz(x + 0.33 * np.cos(angle), 0.0, 0.34 + 0.33 * np.sin(angle))
        pieces.append(kit.bars(ring[:-1], ring[1:], 0.04, dark, F))
        spoke = angle[:-1:2]
        rim = kit.xyz(x + 0.32 * np.cos(spoke), 0.0, 0.34 + 0.32 * np.sin(spoke))
        pieces.append(kit.bars((x, 0, 0.34), rim, 0.008, steel, F))
    # rear hub, bottom bracket, saddle, head and front hub
    a, b, c, d, e = (-0.52, 0, 0.34), (-0.1, 0, 0.3), (-0.24, 0, 0.82), (0.36, 0, 0.78), (0.52, 0, 0.34)
    tubes = [(a, b), (a, c), (b, c), (c, d), (b, d), (d, e)]
    pieces.append(kit.bars([p for p, _ in tubes], [q for _, q in tubes], 0.045, paint, F))
    # seat post and stem, handlebar, saddle
    pieces += [
        kit.bars([(-0.24, 0, 0.82), (0.36, 0, 0.78)], [(-0.27, 0, 0.94), (0.33, 0, 1.0)], 0.03, steel, F),
        kit.bars((0.33, -0.28, 1.02), (0.33, 0.28, 1.02), 0.03, dark, F),
        kit.box((-0.42, -0.15), (-0.08, 0.08), (0.93, 0.99), dark, F),
    ]
    return kit.merge(*pieces)


def newspaper_boxes(looks: Looks) -> Piece:
    """Three vending boxes in a row."""
    pieces = []
    for k, tone in enumerate(((206, 40, 34), (30, 90, 170), (240, 190, 30))):
        x = 0.55 * (k - 1)
        pieces += [
            kit.box((x - 0.23, x + 0.23), (-0.2, 0.2), (0.25, 1.1), looks.plain(tone, "gloss"), F),
            kit.box((x - 0.18, x + 0.18), (-0.21, -0.2), (0.62, 1.02), looks.plain((206, 206, 200)), F),
            kit.box((x - 0.04, x + 0.04), (-0.05, 0.05), (0, 0.25), looks.plain((40, 40, 42)), F),
        ]
    return kit.merge(*pieces)


def bus_shelter(looks: Looks) -> Piece:
    """A glazed shelter with a bench and a poster, open to -y."""
    frame, glass = looks.plain((58, 64, 68)), looks.plain((150, 178, 186), "gloss")
    # the poster
    c = Canvas(1.2, 1.75, 96, (236, 90, 40))
    c.disc(0.6, 1.0, 0.42, (250, 220, 60))
    c.text(0.6, 1.0, "SUN", 0.36, (200, 40, 30))
    c.text(0.6, 0.35, "CITY FAIR", 0.2, (255, 255, 255))
    c.text(0.6, 0.15, "1 - 12 JUNE", 0.13, (255, 255, 255))
    skin = sheet("shelter-poster", looks, c, 0.9)
    # four posts, a pane at the back, roof, bench, and the poster at one end
    posts = np.array([(x, y, 0) for x in (-2.0, 2.0) for y in (-0.6, 0.7)], float)
    pane = [[(2.0, 0.7, 0.3), (-2.0, 0.7, 0.3), (-2.0, 0.7, 2.2), (2.0, 0.7, 2.2)]]
    # seen from both sides
    both = np.array(pane + [pane[0][::-1]])
    return kit.merge(
        kit.boxes(posts - [0.04, 0.04, 0], posts + [0.04, 0.04, 2.45], frame, F),
        kit.quads(both, glass, F),
        kit.box((-2.2, 2.2), (-0.8, 0.85), (2.45, 2.56), frame, F),
        kit.box((-1.5, 1.0), (0.3, 0.62), (0.45, 0.5), looks.plain((138, 88, 48)), F),
        kit.bars([(-1.2, 0.46, 0), (0.7, 0.46, 0)], [(-1.2, 0.46, 0.45), (0.7, 0.46, 0.45)], 0.06, frame, F),
        board(1.2, 1.75, skin, F, 0.1).turned(90).moved(2.0, 0.05, 1.3),
    )


def cafe_table(looks: Looks) -> Piece:
    """A table under a parasol with two chairs."""
    cloth = [looks.plain((206, 44, 40), "matte"), looks.plain((240, 234, 220), "matte")]
    angle = np.linspace(0, 2 * np.pi, 9)
    # the parasol: eight triangles in two colours, each also from below
    rim = kit.xyz(1.35 * np.cos(angle), 1.35 * np.sin(angle), 2.15)
    top = np.broadcast_to([0, 0, 2.7], (8, 3))
    pieces = []
    for k in range(2):
        a, b, c = rim[:-1][k::2], rim[1:][k::2], top[k::2]
        corners = np.stack([a, b, c, c], 1)
        pieces += [kit.quads(corners, cloth[k], F), kit.quads(corners[:, [0, 2, 1, 1]] - [0, 0, 0.02], cloth[k], F)]
    wood = looks.plain((70, 48, 34))
    # pole, table top, two chairs with their legs and backs
    seat = np.array([(-0.95, -0.2, 0.43), (0.55, -0.2, 0.43)])
    legs = np.concatenate([seat + [dx, dy, -0.43] for dx in (0.03, 0.37) for dy in (0.03, 0.37)])
    return kit.merge(
        *pieces, kit.bars((0, 0, 0), (0, 0, 2.7), 0.05, wood, F),
        kit.revolved([(0.4, 0.7), (0.42, 0.72), (0.42, 0.75), (0.005, 0.75)], 16, looks.plain((230, 228, 222)), F),
        kit.boxes(seat, seat + [0.4, 0.4, 0.04], wood, F, ()),
        kit.bars(legs, legs + [0, 0, 0.43], 0.035, wood, F),
        kit.box((-0.97, -0.93), (-0.2, 0.2), (0.47, 0.9), wood, F),
        kit.box((0.93, 0.97), (-0.2, 0.2), (0.47, 0.9), wood, F),
    )  # fmt: skip


def planter(looks: Looks) -> Piece:
    """A concrete tub; a shrub is planted in it by `toolkit.rooms.worlds.content.countryside`."""
    profile = [(0.5, 0), (0.62, 0.55), (0.62, 0.62), (0.52, 0.62), (0.5, 0.5), (0.005, 0.5)]
    return kit.revolved(profile, 12, looks.plain((168, 164, 156), "matte"), F)


def traffic_cone(looks: Looks) -> Piece:
    """An orange cone with a white band."""
    orange = looks.plain((240, 92, 22))
    return kit.merge(
        kit.revolved([(0.15, 0.03), (0.115, 0.22)], 12, orange, F),
        kit.revolved([(0.115, 0.22), (0.075, 0.42)], 12, looks.plain((244, 244, 240)), F),
        kit.revolved([(0.075, 0.42), (0.03, 0.68), (0.005, 0.69)], 12, orange, F),
        kit.box((-0.2, 0.2), (-0.2, 0.2), (0, 0.03), looks.plain((30, 30, 32)), F),
    )


def barrier(looks: Looks) -> Piece:
    """A striped road-works barrier with a lamp."""
    c = Canvas(1.8, 0.3, 80, (244, 244, 240))
    # slanted stripes that run off both ends
    for k in range(-1, 7):
        c.fill([(0.3 * k, 0), (0.3 * k + 0.15, 0), (0.3 * k + 0.35, 0.3), (0.3 * k + 0.2, 0.3)], (224, 60, 24))
    skin = sheet("barrier", looks, c)
    leg = looks.plain((60, 62, 64))
    # two trestles
    at = np.array([(x, 0, 0) for x in (-0.75, 0.75)], float)
    return kit.merge(
        board(1.8, 0.3, skin, F, 0.05).moved(0, 0, 0.85), board(1.8, 0.2, skin, F, 0.05).moved(0, 0, 0.45),
        kit.bars(at + [0, -0.3, 0], at + [0, 0, 1.0], 0.05, leg, F),
        kit.bars(at + [0, 0.3, 0], at + [0, 0, 1.0], 0.05, leg, F),
        kit.box((-0.08, 0.08), (-0.06, 0.06), (1.0, 1.2), looks.plain((255, 170, 30), "lamp"), F),
    )  # fmt: skip


FURNITURE: dict[str, tuple[Callable[[Looks], Piece], float]] = {
    "hydrant": (hydrant, 0.4), "bin": (litter_bin, 0.4), "dustbins": (dustbins, 1.2), "bench": (bench, 1.0),
    "mailbox": (mailbox, 0.5), "meter": (parking_meter, 0.2), "phone": (phone_booth, 0.6), "bicycle": (bicycle, 0.9),
    "newspapers": (newspaper_boxes, 0.9), "shelter": (bus_shelter, 2.4), "cafe": (cafe_table, 1.4),
    "planter": (planter, 0.7), "cone": (traffic_cone, 0.25), "barrier": (barrier, 1.0),
}  # fmt: skip
"""Things on a pavement: how each is made, and the radius that it needs, metres."""


def fountain(looks: Looks) -> Piece:
    """A round basin 8 m across with two bowls and water."""
    stone = wall(looks, "ashlar", STONES[2])
    # the basin's wall, and its inside down below the water
    basin = [(4.0, 0), (4.0, 0.55), (4.15, 0.6), (4.15, 0.7), (3.7, 0.7), (3.7, 0.4)]
    bowls = [
        (0.5, 0.3), (0.45, 1.3), (1.7, 1.7), (1.85, 1.85), (1.6, 1.8), (0.3, 1.75), (0.28, 2.7), (0.9, 2.95),
        (0.95, 3.05), (0.7, 3.0), (0.12, 2.98), (0.1, 3.4), (0.005, 3.5),
    ]  # fmt: skip
    water = looks.plain((120, 160, 172), "gloss")
    # jets from the rim of the lower bowl into the basin
    turn = np.linspace(0, 2 * np.pi, 28, endpoint=False)
    jet = np.column_stack([np.cos(turn), np.sin(turn)])
    start, end = np.column_stack([jet * 1.7, np.full(28, 1.85)]), np.column_stack([jet * 2.6, np.full(28, 0.5)])
    return kit.merge(
        kit.revolved(basin, 32, stone, F), kit.revolved(bowls, 24, stone, F),
        kit.revolved([(3.75, 0.5), (0.005, 0.5)], 32, water, F),
        kit.bars(start, end, 0.05, looks.plain((214, 226, 232), "gloss"), F),
    )  # fmt: skip


def monument(looks: Looks) -> Piece:
    """An obelisk on a stepped pedestal, 11 m."""
    stone = wall(looks, "ashlar", STONES[3])
    steps = np.array([(-2.4 + 0.4 * k, -2.4 + 0.4 * k, 0.35 * k) for k in range(3)])
    shaft = kit.revolved([(0.95, 2.6), (0.62, 10.0), (0.02, 11.0)], 4, stone, F, 20, start_deg=45)
    return kit.merge(
        kit.boxes(steps, -steps * [1, 1, 0] + [0, 0, 0.35] + steps * [0, 0, 1], stone, F),
        kit.box((-1.1, 1.1), (-1.1, 1.1), (1.05, 2.6), stone, F),
        shaft,
    )


def flag(looks: Looks, tone: int) -> Piece:
    """A flag of three bands waving from a pole of 9 m."""
    bands = (
        ((20, 60, 140), (240, 240, 240), (200, 30, 40)), ((24, 110, 60), (246, 210, 60), (200, 30, 40)),
        ((30, 30, 34), (206, 30, 40), (246, 200, 40)),
    )[tone % 3]  # fmt: skip
    x = np.linspace(0.05, 2.2, 12)
    # the cloth waves more, the farther from the pole
    wave = 0.16 * np.sin(x * 4.0) * x / 2
    pieces = [kit.revolved([(0.08, 0), (0.045, 9.0), (0.09, 9.05), (0.005, 9.15)], 8, looks.plain((210, 210, 206)), F)]
    # three bands, each seen from both sides
    for k, colour in enumerate(bands):
        z0, z1 = 8.8 - 0.5 * (k + 1), 8.8 - 0.5 * k
        low, high = kit.xyz(x, wave, z0), kit.xyz(x, wave, z1)
        corners = np.stack([low[:-1], low[1:], high[1:], high[:-1]], 1)
        skin = looks.plain(colour, "matte")
        pieces += [kit.quads(corners, skin, F), kit.quads(corners[:, ::-1] + [0, 0.012, 0], skin, F)]
    return kit.merge(*pieces)


def sheet(name: str, looks: Looks, canvas: Canvas, glow: float = 0.0) -> Skin:
    """The skin of a drawn sign; `glow` is the share that it gives off in the evening."""

    def paint(rng: Rng) -> tuple[np.ndarray, np.ndarray | None]:
        picture = canvas.texture(0.03, rng)
        return picture, (picture[::2, ::2] * glow).astype(np.uint8) if glow else None

    return looks.paint(name, paint, 0.5)


def board(
    width: float, height: float, skin: Skin, label: int = SIGN, thick: float = 0.03, *, both: bool = True
) -> Piece:
    """An upright board centred on the origin, its picture to -y and, turned, to +y."""
    w, h = width / 2, height / 2
    front = [(-w, -thick / 2, -h), (w, -thick / 2, -h), (w, -thick / 2, h), (-w, -thick / 2, h)]
    back = [(w, thick / 2, -h), (-w, thick / 2, -h), (-w, thick / 2, h), (w, thick / 2, h)]
    return kit.quads(np.array([front, back][: 2 if both else 1], float), skin, label, kit.UNIT)


def traffic_head(looks: Looks, lit: int, housing: Colour = (232, 178, 20)) -> Piece:
    """Three lamps in a housing with visors, facing -y; `lit` counts from the top."""
    body, dark = looks.plain(housing), looks.plain((18, 18, 20), "matte")
    # colours of lamps that are lit, and of those that are not
    on = ((255, 40, 30), (255, 190, 30), (50, 255, 130))
    off = ((84, 16, 14), (88, 62, 12), (10, 66, 34))
    pieces = [
        # a housing before a dark plate
        kit.box((-0.19, 0.19), (0.0, 0.2), (-0.58, 0.58), body, F),
        kit.box((-0.32, 0.32), (0.2, 0.23), (-0.72, 0.72), dark, F),
    ]
    visor = kit.revolved([(0.16, 0), (0.16, 0.2)], 10, dark, F)
    # from the top down: red, amber, green
    for k in range(3):
        z = 0.38 - 0.38 * k
        lamp = looks.plain(on[k], "lamp") if k == lit else looks.plain(off[k], "gloss")
        disc = kit.revolved([(0.15, 0.0), (0.08, 0.04), (0.005, 0.05)], 10, lamp, F)
        pieces += [piece.tipped(1, -1, 1).moved(z=z) for piece in (disc, visor)]
    return kit.merge(*pieces)


def traffic_light(looks: Looks, lit: int, street: str, arm_m: float = 5.0) -> Piece:
    """A mast at the kerb with an arm out over the road to -x, two heads facing -y, and the street's name."""
    steel = looks.plain((74, 78, 80))
    mast = kit.revolved([(0.16, 0), (0.13, 0.9), (0.11, 0.92), (0.085, 5.9), (0.01, 5.95)], 8, steel, F)
    head = traffic_head(looks, lit)
    # two heads hang from the arm, a third is on the mast
    at = np.array([(-arm_m + 0.4, -0.2, 5.35), (-arm_m / 2, -0.2, 5.45), (0.0, -0.32, 3.1)])
    name = street_name(street, looks)
    pieces = [
        mast,
        kit.bars((0, 0, 5.6), (-arm_m, 0, 5.85), 0.12, steel, F),
        kit.place(head, at),
        kit.bars(at[:2] + [0, 0.12, 0.5], at[:2] + [0, 0.2, 0.35], 0.06, steel, F),
        name.moved(-1.3, -0.1, 5.3),
    ]
    # pedestrians walk while the road before them has red
    walk = looks.plain((250, 250, 240), "lamp") if lit == 0 else looks.plain((255, 90, 30), "lamp")
    pieces += [
        kit.box((-0.45, -0.12), (-0.15, 0.05), (2.3, 2.7), looks.plain((30, 30, 32)), F),
        kit.box((-0.38, -0.19), (-0.165, -0.15), (2.36, 2.64), walk, F),
    ]
    return kit.merge(*pieces)


def street_name(street: str, looks: Looks) -> Piece:
    """A green blade with a street's name, 1.5 m by 0.3 m, facing both ways."""
    canvas = Canvas(1.5, 0.32, 128, WHITE)
    canvas.rect(0.02, 0.02, 1.48, 0.3, (6, 102, 62))
    canvas.text(0.75, 0.155, street, 0.25, WHITE, fit_m=1.35)
    return board(1.5, 0.32, sheet(f"street-{street}", looks, canvas))


def name_post(streets: tuple[str, str], looks: Looks) -> Piece:
    """Two crossed street names on a post."""
    post = looks.plain((120, 124, 124))
    return kit.merge(
        kit.bars((0, 0, 0), (0, 0, 3.15), 0.07, post, F),
        street_name(streets[0], looks).moved(0, 0, 2.98),
        street_name(streets[1], looks).turned(90).moved(0, 0, 2.64),
    )


def sign_post(kind: str, looks: Looks) -> Piece:
    """A traffic sign on a post, facing -y, grey behind."""
    post = looks.plain((132, 136, 136))
    width, height, skin = _traffic_sign(kind, looks)
    outline = _outline(kind) * [width / 2, height / 2]
    # its picture to -y over its bounding box, grey behind
    front = kit.polygon(outline, 0.0, skin, SIGN, uv=(outline / np.abs(outline).max() + 1) / 2)
    behind = kit.polygon(outline, 0.015, looks.plain((140, 142, 142)), SIGN)
    plate = kit.merge(front, replace(behind, normals=np.abs(behind.normals), faces=behind.faces[:, ::-1]))
    return kit.merge(kit.bars((0, 0.03, 0), (0, 0.03, 2.4 + height / 2), 0.06, post, F), plate.moved(0, -0.02, 2.4))


SIGN_KINDS = ("stop", "no-parking", "one-way", "speed", "crossing", "no-entry", "parking", "bus", "yield")


def _outline(kind: str) -> np.ndarray:
    count = {"stop": 8, "speed": 24, "no-entry": 24, "crossing": 4, "yield": 3}.get(kind, 0)
    if not count:
        return np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    start = {"stop": np.pi / 8, "crossing": 0.0, "yield": -np.pi / 2}.get(kind, 0.0)
    angle = start + np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], 1)


def _traffic_sign(kind: str, looks: Looks) -> tuple[float, float, Skin]:
    size = {"one-way": (0.9, 0.9), "no-parking": (0.5, 0.5)}.get(kind, (0.78, 0.78))
    # the canvas reaches from -1 to 1 in both directions
    c = Canvas(2, 2, 64, WHITE, low=(-1, -1))
    red, black, blue = (196, 22, 30), (20, 20, 22), (20, 82, 170)
    if kind == "stop":
        c.disc(0, 0, 1.4, red)
        c.text(0, 0, "STOP", 0.75, WHITE, fit_m=1.6)
    elif kind == "speed":
        # a white disc in a red ring
        c.disc(0, 0, 1.0, red)
        c.disc(0, 0, 0.76, WHITE)
        c.text(0, 0, "30", 1.0, black)
    elif kind == "no-entry":
        c.disc(0, 0, 1.4, red)
        c.rect(-0.72, -0.17, 0.72, 0.17, WHITE)
    elif kind == "crossing":
        c.rect(-1, -1, 1, 1, (250, 196, 20))
        # a walking figure: head, then body and legs
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
        # an arrow to the right with the words on it
        shape = [(-0.85, -0.32), (0.35, -0.32), (0.35, -0.45), (0.9, 0), (0.35, 0.45), (0.35, 0.32), (-0.85, 0.32)]
        c.fill(shape, WHITE)
        c.text(-0.2, 0, "ONE WAY", 0.36, black, fit_m=1.2)
        # the sign is a wide strip: the rest of the square is grey
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
        # no parking: a crossed letter in a ring, and the hours below
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
    # blots behind the words
    canvas, rng = Canvas(8, 4, 64, ground), looks.rng(name)
    for _ in range(5):
        canvas.disc(
            rng.uniform(0, 8), rng.uniform(0, 4), rng.uniform(0.3, 1.2), tuple(int(c * 0.85 + 20) for c in ground)
        )
    # a ring as trade mark, the name and its slogan, in a dark frame
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
    return kit.merge(
        board(8, 4, skin, thick=0.16, both=False).moved(0, 0, 3.4),
        kit.box((-4.05, 4.05), (-0.06, 0.1), (1.35, 5.45), steel, F),
        kit.bars(foot, foot + [0, 0, 5.2], 0.14, steel, F),
        kit.bars(foot + [0, 1.6, 0], foot + [0, 0, 4.2], 0.1, steel, F),
        kit.boxes(foot * [1, 0, 0] + [-0.2, -1.3, 1.1], foot * [1, 0, 0] + [0.2, -1.0, 1.3], steel, F),
    )
