"""Houses of several kinds on a rectangular lot, and what stands on their flat roofs.

Each house is in its own frame, its front along y = 0 and facing -y.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from toolkit.rooms.worlds.content import pieces as kit
from toolkit.rooms.worlds.content.drawing import Canvas, Rng, finish, fractal
from toolkit.rooms.worlds.content.facades import SHOP_FLOOR_M, Facade, bay_edges, cornice, shop_row, windowed_wall
from toolkit.rooms.worlds.content.modelling import revolve
from toolkit.rooms.worlds.content.pieces import Looks, Piece, Skin, painted
from toolkit.rooms.worlds.content.street_furniture import billboard_skin
from toolkit.rooms.worlds.content.surfaces import BRICKS, RENDERS, STONES, pane_sheet, pane_uv, wall
from toolkit.rooms.worlds.world import SceneClass

ROOF = SceneClass.ROOF
PARAPET_M = 0.9
VARIANTS = 3
"""Number of variants of each thing that stands on roofs."""
BUILDING = SceneClass.BUILDING
SIDES = ("front", "right", "back", "left")


@dataclass
class Roof:
    """A flat roof while it is furnished: its rectangle, and what is taken."""

    width: float  # width, depth: of the building, metres
    depth: float
    z: float  # height of its surface
    taken: list[tuple[float, float, float]] = field(default_factory=list)  # circles x, y, radius

    def find(self, radius: float, rng: Rng) -> tuple[float, float] | None:
        """A place for something of that radius, now taken; None if a few tries found none."""
        edge = radius + 0.6
        if self.width < 2 * edge or self.depth < 2 * edge:
            return None
        # rejection: roofs are mostly empty, and a few tries are cheap
        for _ in range(12):
            x, y = rng.uniform(edge, self.width - edge), rng.uniform(edge, self.depth - edge)
            if all(np.hypot(x - a, y - b) > radius + r for a, b, r in self.taken):
                self.taken.append((x, y, radius))
                return float(x), float(y)
        return None


def flat_roof(roof: Roof, wall_skin: Skin, trim: Skin, looks: Looks, rng: Rng, *, pad_radius: float = 0.0) -> Piece:
    """Roofing inside a parapet, furnished by chance; with a landing pad in its middle if a radius is given."""
    w, d, z = roof.width, roof.depth, roof.z
    felt = wall(looks, "roofing", ((92, 90, 88), (126, 120, 112), (70, 72, 76))[int(rng.integers(3))])
    thick = 0.3
    # the parapet's four walls, and a coping that overhangs them by 6 cm
    low = np.array([(0, 0, z), (0, d - thick, z), (0, thick, z), (w - thick, thick, z)])
    high = np.array([(w, thick, z), (w, d, z), (thick, d - thick, z), (w, d - thick, z)]) + [0, 0, PARAPET_M]
    cap_low, cap_high = low.copy(), high.copy()
    cap_low[:, 2], cap_high[:, 2] = z + PARAPET_M, z + PARAPET_M + 0.12
    pieces = [
        kit.floor_quads((thick, thick, w - thick, d - thick), z, felt, ROOF),
        kit.boxes(low, high, wall_skin, ROOF),
        kit.boxes(cap_low - [0.06, 0.06, 0], cap_high + [0.06, 0.06, 0], trim, ROOF, without=()),
    ]
    if pad_radius:
        # taken before anything else is placed: nothing may stand on the pad
        roof.taken.append((w / 2, d / 2, pad_radius + 0.6))
        pieces.append(landing_pad(pad_radius, looks).moved(w / 2, d / 2, z))
    plant = [
        (stair_house, 2.4, 0.9), (air_conditioner, 1.5, 0.9), (air_conditioner, 1.5, 0.7), (air_conditioner, 1.5, 0.5),
        (water_tank, 2.0, 0.6), (skylight, 1.7, 0.5), (vents, 0.9, 0.8), (vents, 0.9, 0.6), (aerial, 0.6, 0.8),
        (dish, 0.8, 0.4), (duct, 1.9, 0.4), (air_conditioner, 1.5, 0.4),
    ]  # fmt: skip
    # plant that finds no free place is left out
    for make, radius, chance in plant:
        if rng.random() < chance and (at := roof.find(radius, rng)):
            variant = f"{make.__name__}-{rng.integers(VARIANTS)}"
            made = looks.once(variant, partial(make, looks))
            pieces.append(kit.place(made, (*at, z), 90.0 * rng.integers(4)))
    return kit.merge(*pieces)


@painted("pad", 0.8)
def pad_marks(rng: Rng) -> np.ndarray:
    """The helicopter H in a ring, worn; fitted."""
    canvas = Canvas(2, 2, 256, (84, 98, 92), low=(-1, -1))
    # from the bottom to the top: edge, ground, ring, and the two posts of the H with its bar
    canvas.rect(-0.97, -0.97, 0.97, 0.97, (236, 236, 230))
    canvas.rect(-0.93, -0.93, 0.93, 0.93, (74, 92, 84))
    canvas.disc(0, 0, 0.8, (244, 206, 40), ring_m=0.07)
    for x in (-0.27, 0.27):
        canvas.rect(x - 0.07, -0.45, x + 0.07, 0.45, (242, 242, 238))
    canvas.rect(-0.27, -0.07, 0.27, 0.07, (242, 242, 238))
    worn = canvas.texture().astype(np.float32)
    shape = worn.shape[:2]
    worn *= (1 + 0.1 * fractal(rng, shape, 4, 6) - 0.12 * (fractal(rng, shape, 8, 4) > 0.75))[..., None]
    return finish(worn)


def landing_pad(r: float, looks: Looks) -> Piece:
    """A pad of radius r with the helicopter H on a raised square deck, its lamps along the edge."""
    marks = pad_marks(looks)
    # the raised square, with lamps along its edge
    # four lamps on each side, none in a corner
    top = np.array([[(-r, -r, 0.25), (r, -r, 0.25), (r, r, 0.25), (-r, r, 0.25)]])
    edge = looks.plain((150, 150, 146))
    side = np.linspace(-r, r, 5)[:-1] + r / 4
    at = np.array([
        (s * sign if k else r * sign, r * sign if k else s * sign, 0.25)
        for s in side
        for sign in (1, -1)
        for k in (0, 1)
    ])  # fmt: skip
    return kit.merge(
        kit.quads(top, marks, SceneClass.PAD, kit.UNIT),
        kit.boxes([-r, -r, 0.0], [r, r, 0.25], edge, SceneClass.PAD, without=("top", "bottom")),
        kit.boxes(at - [0.08, 0.08, 0], at + [0.08, 0.08, 0.1], looks.plain((250, 210, 90), "lamp"), SceneClass.PAD),
    )


@painted("louvres", 0.5)
def louvres(rng: Rng) -> np.ndarray:
    """Sheet metal with slots, 1 m square."""
    canvas = Canvas(1, 1, 96, (168, 170, 168))
    for k in range(10):
        canvas.rect(0.06, 0.05 + 0.095 * k, 0.94, 0.1 + 0.095 * k, (62, 64, 66))
    return canvas.texture(0.05, rng)


@painted("fan", 0.5)
def fan(rng: Rng) -> np.ndarray:
    """A fan from above: the opening, six blades, the guard's rings."""
    canvas = Canvas(1, 1, 96, (150, 152, 150))
    canvas.disc(0.5, 0.5, 0.44, (40, 42, 44))
    # six blades, each a triangle about the middle
    for k in range(6):
        a = 2 * np.pi * k / 6
        tips = [(0.5 + 0.4 * np.cos(b), 0.5 + 0.4 * np.sin(b)) for b in (a, a + 0.5)]
        canvas.fill([(0.5, 0.5), *tips], (96, 98, 98))
    for r in (0.15, 0.3, 0.43):
        canvas.disc(0.5, 0.5, r, (180, 180, 178), ring_m=0.015)
    return canvas.texture()


def air_conditioner(looks: Looks, rng: Rng) -> Piece:
    """A rooftop unit with fans on top, on a frame."""
    # the body stands on two beams, with two fans side by side on its top
    w, d, h = rng.uniform(1.3, 2.2), rng.uniform(0.9, 1.5), rng.uniform(0.9, 1.5)
    blades = fan(looks)
    low, high = np.array([[-w / 2, -d / 2, 0.3]]), np.array([[w / 2, d / 2, 0.3 + h]])
    fans = np.linspace(-w / 2, w / 2, 3)
    tops = np.array([(a + 0.03, -d / 2 + 0.05, b - 0.03, d / 2 - 0.05) for a, b in pairwise(fans)])
    feet = np.array([[-w / 2 + 0.1, -d / 2, 0.0], [w / 2 - 0.3, -d / 2, 0.0]])
    return kit.merge(
        kit.boxes(low, high, louvres(looks), ROOF, without=()),
        kit.floor_quads(tops, 0.305 + h, blades, ROOF, fit=True),
        kit.boxes(feet, feet + [0.2, d, 0.3], looks.plain((90, 92, 94)), ROOF),
    )


def stair_house(looks: Looks, rng: Rng) -> Piece:
    """The head of the stairs: a small rendered house with a door."""
    skin = wall(looks, "render", (206, 204, 196))
    pieces = [
        kit.boxes([-1.5, -1.4, 0], [1.5, 1.4, 2.7], skin, ROOF),
        kit.boxes([-1.65, -1.55, 2.7], [1.65, 1.55, 2.86], looks.plain((96, 96, 94)), ROOF, ()),
        kit.wall_quads((-0.45, 0.05, 0.45, 2.1), -1.41, looks.plain((104, 54, 46)), ROOF),
    ]
    return kit.merge(*pieces)


@painted("staves", 0.9, (1.2, 1.2))
def staves(rng: Rng) -> np.ndarray:
    """The wood of a tank with its hoops, 1.2 m square."""
    canvas = Canvas(1.2, 1.2, 128, (110, 78, 52))
    for k in range(10):
        tone = rng.uniform(0.75, 1.15)
        # ten staves, each in a shade of its own
        canvas.rect(0.12 * k, 0, 0.12 * k + 0.11, 1.2, tuple(int(c * tone) for c in (118, 84, 56)))
    for z in (0.2, 0.6, 1.0):
        canvas.rect(0, z, 1.2, z + 0.035, (54, 52, 50))
    return canvas.texture(0.06, rng)


def water_tank(looks: Looks, rng: Rng) -> Piece:
    """A wooden tank with hoops and a conical roof on steel legs."""
    # tank, conical lid and floor, on four legs with crossed braces
    tank = kit.revolved([(1.6, 2.6), (1.6, 5.4)], 20, staves(looks), ROOF)
    iron = looks.plain((58, 56, 54))
    lid = kit.revolved([(1.75, 5.35), (0.05, 6.5)], 20, looks.plain((70, 66, 62), "matte"), ROOF)
    floor = kit.solid([revolve([(0.02, 2.6), (1.6, 2.6)], 20).flipped()], iron, ROOF)
    foot = np.array([(1.1, 1.1, 0), (-1.1, 1.1, 0), (-1.1, -1.1, 0), (1.1, -1.1, 0)], float)
    head = foot + [0, 0, 2.6]
    legs = kit.bars(foot, head, 0.16, iron, ROOF)
    braces = kit.bars(
        np.concatenate([foot, foot]), np.concatenate([np.roll(head, 1, 0), np.roll(head, -1, 0)]), 0.06, iron, ROOF
    )
    return kit.merge(tank, lid, floor, legs, braces)


def skylight(looks: Looks, rng: Rng) -> Piece:
    """A glazed ridge on a kerb."""
    glass, kerb = looks.plain((128, 158, 172), "gloss"), looks.plain((180, 182, 180))
    pieces = [kit.boxes([-1.3, -0.9, 0], [1.3, 0.9, 0.4], kerb, ROOF)]
    # two slopes of glass and two triangular ends, with ribs over the slopes
    slopes = [
        [(-1.2, -0.8, 0.4), (1.2, -0.8, 0.4), (1.2, 0, 1.0), (-1.2, 0, 1.0)],
        [(1.2, 0.8, 0.4), (-1.2, 0.8, 0.4), (-1.2, 0, 1.0), (1.2, 0, 1.0)],
        [(1.2, -0.8, 0.4), (1.2, 0.8, 0.4), (1.2, 0, 1.0), (1.2, 0, 1.0)],
        [(-1.2, 0.8, 0.4), (-1.2, -0.8, 0.4), (-1.2, 0, 1.0), (-1.2, 0, 1.0)],
    ]
    ribs = np.linspace(-1.2, 1.2, 5)
    start = np.array([(x, y, 0.41) for x in ribs for y in (-0.8, 0.8)])
    pieces += [
        kit.quads(np.array(slopes), glass, ROOF),
        kit.bars(start, start * [1, 0, 1] + [0, 0, 0.6], 0.06, kerb, ROOF),
    ]
    return kit.merge(*pieces)


def vents(looks: Looks, rng: Rng) -> Piece:
    """Pipes with cowls."""
    profile = [(0.12, 0), (0.12, 0.9), (0.26, 0.9), (0.26, 1.15), (0.01, 1.3)]
    pipe = kit.revolved(profile, 10, looks.plain((176, 178, 178), "metal"), ROOF)
    count = int(rng.integers(2, 5))
    at = np.c_[rng.uniform(-0.8, 0.8, (count, 2)), np.zeros(count)]
    return kit.place(pipe, at, 0.0, rng.uniform(0.7, 1.2, count))


def aerial(looks: Looks, rng: Rng) -> Piece:
    """A mast with a television aerial's rods."""
    metal, h = looks.plain((150, 152, 154)), rng.uniform(2.5, 5.0)
    rods = np.linspace(-0.7, 0.7, 6)
    # the rods are longest in the middle
    start = np.array([(x, -0.35 + 0.1 * abs(x), h - 0.3) for x in rods])
    return kit.merge(
        kit.bars([0, 0, 0], [0, 0, h], 0.06, metal, ROOF),
        kit.bars([-0.8, 0, h - 0.3], [0.8, 0, h - 0.3], 0.03, metal, ROOF),
        kit.bars(start, start * [1, -1, 1], 0.02, metal, ROOF),
    )


def dish(looks: Looks, rng: Rng) -> Piece:
    """A satellite dish on a post, seen from both sides."""
    white = looks.plain((222, 222, 218))
    profile = [(0.02, 0.0), (0.3, 0.05), (0.55, 0.17)]
    bowl = revolve(profile, 16).rotated("y", 55).moved(z=1.0)
    return kit.merge(
        kit.solid([bowl, bowl.flipped().moved(0.01, 0, 0.008)], white, ROOF),
        kit.bars([0, 0, 0], [0, 0, 1.0], 0.07, looks.plain((110, 112, 114)), ROOF),
    )


def duct(looks: Looks, rng: Rng) -> Piece:
    """A bent run of sheet-metal duct on feet."""
    metal = looks.plain((186, 188, 188), "metal")
    return kit.merge(
        kit.box((-1.6, 1.2), (-0.3, 0.3), (0.35, 0.95), metal, ROOF),
        kit.box((0.6, 1.2), (0.3, 1.2), (0.35, 0.95), metal, ROOF),
        kit.bars([(-1.4, 0, 0), (0.9, 1.0, 0)], [(-1.4, 0, 0.35), (0.9, 1.0, 0.35)], 0.1, metal, ROOF),
    )


@dataclass(frozen=True)
class Lot:
    """A plot for a house."""

    width: float  # width, depth: metres
    depth: float
    floors: int  # above the ground floor
    streets: tuple[str, ...] = ("front",)  # its sides along a street; the others touch a neighbour or a yard
    pad: bool = False  # whether its roof bears a landing pad


@dataclass(frozen=True)
class House:
    """A built house: triangles, boxes (k, 6) of low and high corners that it fills, its pad (x, y, z, radius)."""

    piece: Piece
    solids: np.ndarray
    pad: tuple[float, float, float, float] | None = None


Builder = Callable[[Lot, Looks, Rng], House]


def _finish(lot: Lot, walls: Piece, height: float, skins: tuple[Skin, Skin], looks: Looks, rng: Rng) -> House:
    pad_radius = min(8.0, min(lot.width, lot.depth) / 2 - 1.2) if lot.pad else 0.0
    roof = flat_roof(Roof(lot.width, lot.depth, height), *skins, looks, rng, pad_radius=pad_radius)
    solid = np.array([[0, 0, 0, lot.width, lot.depth, height]], float)
    pad = (lot.width / 2, lot.depth / 2, height + 0.25, pad_radius) if lot.pad else None
    return House(kit.merge(walls, roof), solid, pad)


def _party_wall(width: float, height: float, skin: Skin, looks: Looks, rng: Rng) -> Piece:
    bare = kit.wall_quads((0, 0, width, height), 0.0, skin, BUILDING)
    # a blank wall between neighbours; some wide and high ones bear a painted advertisement
    if width < 11 or height < 11 or rng.random() > 0.45:
        return bare
    picture, middle = billboard_skin(int(rng.integers(6)), looks), width / 2
    return kit.merge(
        bare,
        kit.wall_quads(
            (middle - 4.6, height - 6.0, middle + 4.6, height - 1.2), -0.02, picture, SceneClass.SIGN, fit=True
        ),
    )


def _entrance(x: float, looks: Looks, trim: Skin, rng: Rng) -> Piece:
    """A front door with steps and a surround, standing out from the wall about x."""
    # each step begins 30 cm nearer to the wall than the step below it
    wood = looks.plain(rng.pick(((92, 30, 26), (28, 52, 40), (40, 34, 30), (24, 40, 76), (96, 62, 36))), "gloss")
    steps = np.array([(x - 0.9 - 0.1 * k, -1.2 + 0.3 * k - 0.12, 0.17 * k) for k in range(3)])
    tops = np.array([(x + 0.9 + 0.1 * k, 0.0, 0.17 * (k + 1)) for k in range(3)])
    # a post on either side of the door and a lintel over both
    low = [(x - 0.85, -0.2, 0.5), (x + 0.6, -0.2, 0.5), (x - 0.95, -0.3, 2.9)]
    high = [(x - 0.6, 0, 2.9), (x + 0.85, 0, 2.9), (x + 0.95, 0, 3.2)]
    # the door's panels: two columns, two rows
    across = ((x - 0.45, x - 0.08), (x + 0.08, x + 0.45))
    leaves = [(a, c, b, d) for c, d in ((0.65, 1.4), (1.55, 2.35)) for a, b in across]
    return kit.merge(
        kit.boxes(steps, tops, trim, BUILDING, without=("bottom", "back")),
        kit.boxes(low, high, trim, BUILDING, ("back",)),
        kit.wall_quads((x - 0.6, 0.5, x + 0.6, 2.5), -0.03, wood, BUILDING),
        kit.wall_quads((x - 0.6, 2.5, x + 0.6, 2.9), -0.03, looks.plain((150, 168, 176), "gloss"), BUILDING),
        kit.wall_quads(leaves, -0.04, looks.plain((60, 44, 34), "gloss"), BUILDING),
    )  # fmt: skip


def brick_apartments(lot: Lot, looks: Looks, rng: Rng) -> House:
    """Brick, sash windows, stone trim, a bracketed cornice, fire escapes; shops or a stoop below."""
    brick = wall(looks, "brick", rng.pick(BRICKS))
    trim = looks.plain(rng.pick(((206, 198, 182), (176, 166, 150), (112, 66, 50), (226, 222, 212))), "matte")
    shops = rng.random() < 0.6
    style = Facade(
        brick, trim,
        rng.pick(("sash-white", "sash-grid", "sash-green", "casement")),
        window_m=(rng.uniform(0.95, 1.25), rng.uniform(1.6, 1.9), 0.8),
        floor_m=rng.uniform(3.0, 3.4), bay_m=rng.uniform(2.0, 2.8), string_course=rng.random() < 0.4,
        fire_escape=rng.random() < 0.55, air_conditioners=rng.pick((0.0, 0.1, 0.2)),
    )  # fmt: skip
    return _apartments(lot, style, looks, rng, shops=shops)


def rendered_apartments(lot: Lot, looks: Looks, rng: Rng) -> House:
    """Painted stucco with balconies."""
    render = wall(looks, "render", rng.pick(RENDERS))
    trim = looks.plain(rng.pick(((232, 230, 222), (200, 194, 182), (150, 140, 128))), "matte")
    style = Facade(
        render, trim,
        rng.pick(("sash-grid", "casement", "modern", "tall")),
        window_m=(1.3, 2.25, 0.12), floor_m=3.1, bay_m=rng.uniform(2.8, 3.4), lintels=rng.random() < 0.5, sills=False,
        balconies=rng.uniform(0.3, 0.8), string_course=rng.random() < 0.5,
    )  # fmt: skip
    return _apartments(lot, style, looks, rng, shops=rng.random() < 0.7)


def stone_palazzo(lot: Lot, looks: Looks, rng: Rng) -> House:
    """Dressed stone with pilasters, tall windows and a heavy cornice."""
    stone = wall(looks, "ashlar", rng.pick(STONES))
    trim = wall(looks, "render", rng.pick(((206, 196, 176), (190, 182, 168))))
    style = Facade(
        stone, trim, rng.pick(("tall", "arched")), window_m=(1.25, 2.4, 0.7), floor_m=3.8, bay_m=3.0, recess_m=0.32,
        pilasters=True, string_course=True,
    )  # fmt: skip
    return _apartments(lot, style, looks, rng, shops=rng.random() < 0.5)


def concrete_slab(lot: Lot, looks: Looks, rng: Rng) -> House:
    """The sixties: bands of windows between concrete parapets."""
    concrete = wall(looks, "concrete", rng.pick(((168, 164, 156), (146, 144, 140), (186, 180, 168))))
    panel = looks.plain(rng.pick(((60, 92, 120), (150, 76, 52), (176, 150, 60), (84, 104, 92), (120, 120, 118))))
    style = Facade(
        concrete, panel, "band", window_m=(2.75, 1.6, 0.95), floor_m=3.3, bay_m=3.1, recess_m=0.16, lintels=False,
        air_conditioners=0.05,
    )  # fmt: skip
    return _apartments(lot, style, looks, rng, shops=rng.random() < 0.5, crown=False)


def warehouse(lot: Lot, looks: Looks, rng: Rng) -> House:
    """Brick piers round wide steel windows."""
    brick = wall(looks, "brick", rng.pick(BRICKS[:6]))
    trim = wall(looks, "brick", BRICKS[8])
    style = Facade(
        brick, trim, "factory", window_m=(2.6, 2.5, 0.8), floor_m=4.0, bay_m=3.4, recess_m=0.28, pilasters=True
    )
    return _apartments(lot, style, looks, rng, shops=rng.random() < 0.3)


def _apartments(lot: Lot, style: Facade, looks: Looks, rng: Rng, *, shops: bool, crown: bool = True) -> House:
    # shops take the ground floor; without them a plinth, and one floor more
    ground = SHOP_FLOOR_M if shops else 0.6
    floors = lot.floors + (0 if shops else 1)
    height = ground + floors * style.floor_m + 0.35
    back = wall(looks, "brick", BRICKS[7]) if rng.random() < 0.5 else style.wall
    plinth = wall(looks, "ashlar", STONES[3])
    out = float(rng.uniform(0.3, 0.7))

    def make(number: int, width: float) -> Piece:
        side = SIDES[number]
        if side not in lot.streets and side != "back":
            return _party_wall(width, height, back, looks, rng)
        plain = side not in lot.streets
        skin = style.wall
        # from the street up: shops or plinth and entrance, floors of windows, cornice
        pieces = [windowed_wall(style, width, looks, rng, z0=ground, floors=floors, plain=plain)]
        pieces.append(kit.wall_quads((0, height - 0.35, width, height), 0.0, skin, BUILDING))
        if shops and not plain:
            pieces.append(shop_row(width, looks, rng, style.wall))
        else:
            base = 0.0 if plain else ground
            pieces.append(kit.wall_quads((0, 0, width, ground), 0.0, plinth if base else skin, BUILDING))
        if not shops and not plain and width > 5:
            edges = bay_edges(width, style.bay_m)
            pieces.append(_entrance(float(edges[len(edges) // 2]), looks, style.trim, rng))
        if crown and not plain:
            pieces.append(cornice(width, height, style.trim, out, dentils=rng.random() < 0.7, ends=False))
        return kit.merge(*pieces)

    return _finish(lot, kit.set_round(lot.width, lot.depth, make), height, (style.wall, style.trim), looks, rng)


def glass_office(lot: Lot, looks: Looks, rng: Rng) -> House:
    """A curtain wall with mullions and spandrels over a lobby."""
    # materials and proportions of the whole house
    panes = pane_sheet(looks, rng.pick(("curtain-blue", "curtain-green", "curtain-bronze", "curtain-dark")))
    metal = looks.plain(rng.pick(((186, 190, 194), (70, 74, 80), (120, 104, 84), (232, 234, 234))), "metal")
    spandrel = looks.plain(rng.pick(((52, 66, 80), (36, 42, 46), (90, 96, 100), (196, 198, 198))), "gloss")
    stone = wall(looks, "ashlar", rng.pick(STONES))
    floor_m, bay_m, lobby = 3.6, float(rng.uniform(1.4, 2.0)), 4.6
    fin = float(rng.uniform(0.1, 0.32))
    height = lobby + (lot.floors + 1) * floor_m + 0.4

    def make(number: int, width: float) -> Piece:
        side = SIDES[number]
        open_side = side in lot.streets or lot.floors > 7
        count = max(2, round(width / bay_m))
        edges = np.linspace(0, width, count + 1)
        # panes between the spandrels
        base = lobby + floor_m * np.arange(lot.floors + 1)
        cells = np.array([(a, z + 0.9, b, z + floor_m) for z in base for a, b in pairwise(edges)])
        bands = np.array([(0, z, width, z + 0.9) for z in base] + [(0, height - 0.4, width, height)])
        pieces = [
            kit.quads(kit.upright(cells, 0.0), panes, BUILDING, pane_uv(rng, len(cells))),
            kit.wall_quads(bands, 0.0, spandrel, BUILDING),
        ]
        # fins run up the wall, rails along the floors
        low = kit.xyz(edges[1:-1] - 0.05, -fin, lobby)
        pieces.append(kit.boxes(low, low + [0.1, fin, height - lobby], metal, BUILDING, without=("back", "bottom")))
        z = np.r_[base, base + 0.9]
        low = kit.xyz(0.0, -0.06, z - 0.04)
        pieces.append(kit.boxes(low, low + [width, 0.06, 0.08], metal, BUILDING, without=("back", "left", "right")))
        # the ground floor: shop or lobby on streets, else stone
        if open_side and side in lot.streets:
            pieces.append(
                shop_row(width, looks, rng, stone)
                if rng.random() < 0.35
                else _lobby(width, lobby, panes, metal, stone, rng)
            )
            pieces.append(kit.wall_quads((0, SHOP_FLOOR_M, width, lobby), -0.02, metal, BUILDING))
        else:
            pieces.append(kit.wall_quads((0, 0, width, lobby), 0.0, stone, BUILDING))
        return kit.merge(*pieces)

    return _finish(lot, kit.set_round(lot.width, lot.depth, make), height, (spandrel, metal), looks, rng)


def _lobby(width: float, height: float, panes: Skin, metal: Skin, stone: Skin, rng: Rng) -> Piece:
    """Tall glass between stone piers, set back under the house, with a canopy over the doors."""
    # piers a bay apart, the glass between them set back by half a metre
    count = max(2, round(width / 3.2))
    edges = np.linspace(0, width, count + 1)
    back = 0.5
    rect = np.array([(a, 0.0, b, height) for a, b in pairwise(edges)])
    face = kit.upright(rect, back)
    low = kit.xyz(np.clip(edges - 0.3, 0, width - 0.6), 0.0, 0.0)
    ceiling = np.array([[(0, back, height), (0, 0, height), (width, 0, height), (width, back, height)]])[:, ::-1]
    middle = width / 2
    canopy = kit.boxes([middle - 2.2, -1.8, 3.0], [middle + 2.2, back, 3.25], metal, BUILDING, ())
    return kit.merge(
        kit.quads(face, panes, BUILDING, pane_uv(rng, count)),
        kit.boxes(low, low + [0.6, back, height], stone, BUILDING, without=("bottom", "top")),
        kit.quads(ceiling, metal, BUILDING), canopy,
    )  # fmt: skip


KINDS: dict[str, Builder] = {
    "brick": brick_apartments, "render": rendered_apartments, "stone": stone_palazzo, "slab": concrete_slab,
    "warehouse": warehouse, "glass": glass_office,
}  # fmt: skip
