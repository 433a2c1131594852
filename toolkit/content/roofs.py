"""What stands on flat roofs: parapets, air-conditioning, water tanks, aerials, skylights, landing pads."""

from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from toolkit.content.modelling import revolve
from toolkit.content.paint import Canvas, finish, fractal
from toolkit.content.pieces import (
    Looks,
    Piece,
    Skin,
    bars,
    box,
    boxes,
    floor_quads,
    merge,
    place,
    quads,
    revolved,
    solid,
    wall_quads,
)
from toolkit.content.walls import wall
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass

ROOF = SceneClass.ROOF
PARAPET_M = 0.9
VARIANTS = 3
"""Of each thing that stands on roofs."""


@dataclass
class Roof:
    """A flat roof while it is furnished: its rectangle, and what is taken.

    Attributes:
        width, depth: of the building, metres.
        z: height of its surface.
        taken: circles x, y, radius.
    """

    width: float
    depth: float
    z: float
    taken: list[tuple[float, float, float]] = field(default_factory=list)

    def find(self, radius: float, rng: np.random.Generator) -> tuple[float, float] | None:
        """A place for something of that radius, now taken; None if a few tries found none."""
        edge = radius + 0.6
        if self.width < 2 * edge or self.depth < 2 * edge:
            return None
        for _ in range(12):
            x, y = rng.uniform(edge, self.width - edge), rng.uniform(edge, self.depth - edge)
            if all(np.hypot(x - a, y - b) > radius + r for a, b, r in self.taken):
                self.taken.append((x, y, radius))
                return float(x), float(y)
        return None


def flat_roof(
    roof: Roof, wall_skin: Skin, trim: Skin, looks: Looks, rng: np.random.Generator, *, pad_radius: float = 0.0
) -> Piece:
    """Roofing inside a parapet, furnished by chance; with a landing pad in its middle if a radius is given."""
    w, d, z = roof.width, roof.depth, roof.z
    felt = wall(looks, "roofing", ((92, 90, 88), (126, 120, 112), (70, 72, 76))[int(rng.integers(3))])
    thick = 0.3
    low = np.array([(0, 0, z), (0, d - thick, z), (0, thick, z), (w - thick, thick, z)])
    high = np.array([(w, thick, z), (w, d, z), (thick, d - thick, z), (w, d - thick, z)]) + [0, 0, PARAPET_M]
    cap_low, cap_high = low.copy(), high.copy()
    cap_low[:, 2], cap_high[:, 2] = z + PARAPET_M, z + PARAPET_M + 0.12
    pieces = [
        floor_quads((thick, thick, w - thick, d - thick), z, felt, ROOF),
        boxes(low, high, wall_skin, ROOF),
        boxes(cap_low - [0.06, 0.06, 0], cap_high + [0.06, 0.06, 0], trim, ROOF, without=()),
    ]
    if pad_radius:
        roof.taken.append((w / 2, d / 2, pad_radius + 0.6))
        pieces.append(landing_pad(pad_radius, looks).moved(w / 2, d / 2, z))
    plant = [
        (stair_house, 2.4, 0.9), (air_conditioner, 1.5, 0.9), (air_conditioner, 1.5, 0.7), (air_conditioner, 1.5, 0.5),
        (water_tank, 2.0, 0.6), (skylight, 1.7, 0.5), (vents, 0.9, 0.8), (vents, 0.9, 0.6), (aerial, 0.6, 0.8),
        (dish, 0.8, 0.4), (duct, 1.9, 0.4), (air_conditioner, 1.5, 0.4),
    ]  # fmt: skip
    for make, radius, chance in plant:
        if rng.random() < chance and (at := roof.find(radius, rng)):
            variant = f"{make.__name__}-{rng.integers(VARIANTS)}"
            made = looks.once(variant, partial(make, looks))
            pieces.append(place(made, (*at, z), 90.0 * rng.integers(4)))
    return merge(*pieces)


def landing_pad(radius: float, looks: Looks) -> Piece:
    """A pad with the helicopter H in a ring on a raised square deck, its lamps along the edge."""
    name = "pad"
    skin = looks.known(name)
    if skin is None:
        rng = looks.rng(name)
        canvas = Canvas(2, 2, 256, (84, 98, 92), low=(-1, -1))
        canvas.rect(-0.97, -0.97, 0.97, 0.97, (236, 236, 230))
        canvas.rect(-0.93, -0.93, 0.93, 0.93, (74, 92, 84))
        canvas.disc(0, 0, 0.8, (244, 206, 40), ring_m=0.07)
        for x in (-0.27, 0.27):
            canvas.rect(x - 0.07, -0.45, x + 0.07, 0.45, (242, 242, 238))
        canvas.rect(-0.27, -0.07, 0.27, 0.07, (242, 242, 238))
        worn = canvas.texture().astype(np.float32)
        shape = worn.shape[:2]
        worn *= (1 + 0.1 * fractal(rng, shape, 4, 6) - 0.12 * (fractal(rng, shape, 8, 4) > 0.75))[..., None]
        skin = looks.add(Material(name, finish(worn), 0.8))
    r = radius
    top = np.array([[(-r, -r, 0.25), (r, -r, 0.25), (r, r, 0.25), (-r, r, 0.25)]])
    uv = np.array([[(0, 0), (1, 0), (1, 1), (0, 1)]], float)
    edge = looks.plain((150, 150, 146))
    side = np.linspace(-r, r, 5)[:-1] + r / 4
    at = np.array([
        (s * sign if k else r * sign, r * sign if k else s * sign, 0.25)
        for s in side
        for sign in (1, -1)
        for k in (0, 1)
    ])  # fmt: skip
    return merge(
        quads(top, skin, SceneClass.PAD, uv),
        boxes([-r, -r, 0.0], [r, r, 0.25], edge, SceneClass.PAD, without=("top", "bottom")),
        boxes(at - [0.08, 0.08, 0], at + [0.08, 0.08, 0.1], looks.plain((250, 210, 90), "lamp"), SceneClass.PAD),
    )


def louvres(looks: Looks) -> Skin:
    """Sheet metal with slots, 1 m square."""
    if found := looks.known("louvres"):
        return found
    canvas = Canvas(1, 1, 96, (168, 170, 168))
    for k in range(10):
        canvas.rect(0.06, 0.05 + 0.095 * k, 0.94, 0.1 + 0.095 * k, (62, 64, 66))
    return looks.add(Material("louvres", canvas.texture(0.05, looks.rng("louvres")), 0.5), (1.0, 1.0))


def air_conditioner(looks: Looks, rng: np.random.Generator) -> Piece:
    """A rooftop unit with fans on top, on a frame."""
    w, d, h = rng.uniform(1.3, 2.2), rng.uniform(0.9, 1.5), rng.uniform(0.9, 1.5)
    fan = looks.known("fan")
    if fan is None:
        canvas = Canvas(1, 1, 96, (150, 152, 150))
        canvas.disc(0.5, 0.5, 0.44, (40, 42, 44))
        for k in range(6):
            a = 2 * np.pi * k / 6
            canvas.fill(
                [
                    (0.5, 0.5),
                    (0.5 + 0.4 * np.cos(a), 0.5 + 0.4 * np.sin(a)),
                    (0.5 + 0.4 * np.cos(a + 0.5), 0.5 + 0.4 * np.sin(a + 0.5)),
                ],
                (96, 98, 98),
            )
        for r in (0.15, 0.3, 0.43):
            canvas.disc(0.5, 0.5, r, (180, 180, 178), ring_m=0.015)
        fan = looks.add(Material("fan", canvas.texture(), 0.5))
    low, high = np.array([[-w / 2, -d / 2, 0.3]]), np.array([[w / 2, d / 2, 0.3 + h]])
    fans = np.linspace(-w / 2, w / 2, 3)
    tops = np.array([(a + 0.03, -d / 2 + 0.05, b - 0.03, d / 2 - 0.05) for a, b in pairwise(fans)])
    feet = np.array([[-w / 2 + 0.1, -d / 2, 0.0], [w / 2 - 0.3, -d / 2, 0.0]])
    return merge(
        boxes(low, high, louvres(looks), ROOF, without=()),
        floor_quads(tops, 0.305 + h, fan, ROOF, fit=True),
        boxes(feet, feet + [0.2, d, 0.3], looks.plain((90, 92, 94)), ROOF),
    )


def stair_house(looks: Looks, rng: np.random.Generator) -> Piece:
    """The head of the stairs: a small brick house with a steel door."""
    skin = wall(looks, "render", (206, 204, 196))
    pieces = [
        boxes([-1.5, -1.4, 0], [1.5, 1.4, 2.7], skin, ROOF),
        boxes([-1.65, -1.55, 2.7], [1.65, 1.55, 2.86], looks.plain((96, 96, 94)), ROOF, ()),
        wall_quads((-0.45, 0.05, 0.45, 2.1), -1.41, looks.plain((104, 54, 46)), ROOF),
    ]
    return merge(*pieces)


def water_tank(looks: Looks, rng: np.random.Generator) -> Piece:
    """A wooden tank with hoops and a conical roof on steel legs."""
    name = "staves"
    staves = looks.known(name)
    if staves is None:
        canvas = Canvas(1.2, 1.2, 128, (110, 78, 52))
        gen = looks.rng(name)
        for k in range(10):
            tone = gen.uniform(0.75, 1.15)
            canvas.rect(0.12 * k, 0, 0.12 * k + 0.11, 1.2, tuple(int(c * tone) for c in (118, 84, 56)))
        for z in (0.2, 0.6, 1.0):
            canvas.rect(0, z, 1.2, z + 0.035, (54, 52, 50))
        staves = looks.add(Material(name, canvas.texture(0.06, gen), 0.9), (1.2, 1.2))
    iron = looks.plain((58, 56, 54))
    tank = revolved([(1.6, 2.6), (1.6, 5.4)], 20, staves, ROOF)
    lid = revolved([(1.75, 5.35), (0.05, 6.5)], 20, looks.plain((70, 66, 62), "matte"), ROOF)
    floor = solid([revolve([(0.02, 2.6), (1.6, 2.6)], 20).flipped()], iron, ROOF)
    foot = np.array([(1.1, 1.1, 0), (-1.1, 1.1, 0), (-1.1, -1.1, 0), (1.1, -1.1, 0)], float)
    head = foot + [0, 0, 2.6]
    legs = bars(foot, head, 0.16, iron, ROOF)
    braces = bars(
        np.concatenate([foot, foot]), np.concatenate([np.roll(head, 1, 0), np.roll(head, -1, 0)]), 0.06, iron, ROOF
    )
    return merge(tank, lid, floor, legs, braces)


def skylight(looks: Looks, rng: np.random.Generator) -> Piece:
    """A glazed ridge on a kerb."""
    glass, kerb = looks.plain((128, 158, 172), "gloss"), looks.plain((180, 182, 180))
    pieces = [boxes([-1.3, -0.9, 0], [1.3, 0.9, 0.4], kerb, ROOF)]
    slopes = [
        [(-1.2, -0.8, 0.4), (1.2, -0.8, 0.4), (1.2, 0, 1.0), (-1.2, 0, 1.0)],
        [(1.2, 0.8, 0.4), (-1.2, 0.8, 0.4), (-1.2, 0, 1.0), (1.2, 0, 1.0)],
        [(1.2, -0.8, 0.4), (1.2, 0.8, 0.4), (1.2, 0, 1.0), (1.2, 0, 1.0)],
        [(-1.2, 0.8, 0.4), (-1.2, -0.8, 0.4), (-1.2, 0, 1.0), (-1.2, 0, 1.0)],
    ]
    ribs = np.linspace(-1.2, 1.2, 5)
    start = np.array([(x, y, 0.41) for x in ribs for y in (-0.8, 0.8)])
    pieces += [quads(np.array(slopes), glass, ROOF), bars(start, start * [1, 0, 1] + [0, 0, 0.6], 0.06, kerb, ROOF)]
    return merge(*pieces)


def vents(looks: Looks, rng: np.random.Generator) -> Piece:
    """Pipes with cowls."""
    pipe = revolved(
        [(0.12, 0), (0.12, 0.9), (0.26, 0.9), (0.26, 1.15), (0.01, 1.3)],
        10, looks.plain((176, 178, 178), "metal"), ROOF,
    )  # fmt: skip
    count = int(rng.integers(2, 5))
    at = np.c_[rng.uniform(-0.8, 0.8, (count, 2)), np.zeros(count)]
    return place(pipe, at, 0.0, rng.uniform(0.7, 1.2, count))


def aerial(looks: Looks, rng: np.random.Generator) -> Piece:
    """A mast with a television aerial's rods."""
    metal, h = looks.plain((150, 152, 154)), rng.uniform(2.5, 5.0)
    rods = np.linspace(-0.7, 0.7, 6)
    start = np.array([(x, -0.35 + 0.1 * abs(x), h - 0.3) for x in rods])
    return merge(
        bars([0, 0, 0], [0, 0, h], 0.06, metal, ROOF),
        bars([-0.8, 0, h - 0.3], [0.8, 0, h - 0.3], 0.03, metal, ROOF),
        bars(start, start * [1, -1, 1], 0.02, metal, ROOF),
    )


def dish(looks: Looks, rng: np.random.Generator) -> Piece:
    """A satellite dish on a post, seen from both sides."""
    white = looks.plain((222, 222, 218))
    profile = [(0.02, 0.0), (0.3, 0.05), (0.55, 0.17)]
    bowl = revolve(profile, 16).rotated("y", 55).moved(z=1.0)
    return merge(
        solid([bowl, bowl.flipped().moved(0.01, 0, 0.008)], white, ROOF),
        bars([0, 0, 0], [0, 0, 1.0], 0.07, looks.plain((110, 112, 114)), ROOF),
    )


def duct(looks: Looks, rng: np.random.Generator) -> Piece:
    """A bent run of sheet-metal duct on feet."""
    metal = looks.plain((186, 188, 188), "metal")
    return merge(
        box((-1.6, 1.2), (-0.3, 0.3), (0.35, 0.95), metal, ROOF),
        box((0.6, 1.2), (0.3, 1.2), (0.35, 0.95), metal, ROOF),
        bars([(-1.4, 0, 0), (0.9, 1.0, 0)], [(-1.4, 0, 0.35), (0.9, 1.0, 0.35)], 0.1, metal, ROOF),
    )
