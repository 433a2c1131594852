"""Cars: private ones, yellow cabs, police cars, each in its colours.

Frame: as in `toolkit.content.vehicle_body`.
"""

from dataclasses import dataclass

import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import Canvas
from toolkit.content.pieces import Looks, Piece, Skin, box, boxes, merge, place, wall_quads
from toolkit.content.vehicle_body import VEHICLE, Body, Livery, bodywork, wheels
from toolkit.objects.mesh import Material

GLASS: Colour = (38, 46, 54)
RUBBER: Colour = (24, 24, 26)
HEAD: Colour = (238, 240, 236)
TAIL: Colour = (176, 18, 20)
HEAD_GLOW: Colour = (255, 244, 214)
TAIL_GLOW: Colour = (190, 16, 12)

SEDAN = Body(
    4.75, 1.84,
    (
        (-2.375, 0.62), (-2.33, 0.96), (-1.75, 1.05), (-0.95, 1.4), (-0.1, 1.45), (0.4, 1.41), (1.2, 1.0), (2.05, 0.84),
        (2.32, 0.68), (2.375, 0.5),
    ),
    0.93, (-1.72, -0.95, 0.42, 1.2), (-1.38, 1.42),
)  # fmt: skip
HATCH = Body(
    4.0, 1.74,
    (
        (-2.0, 0.62), (-1.96, 0.98), (-1.82, 1.12), (-1.3, 1.46), (-0.3, 1.5), (0.3, 1.45), (1.0, 1.02), (1.7, 0.86),
        (1.95, 0.68), (2.0, 0.5),
    ),
    0.95, (-1.86, -1.3, 0.3, 1.0), (-1.22, 1.26), wheel_m=0.31,
)  # fmt: skip
WAGON = Body(
    4.8, 1.82,
    (
        (-2.4, 0.62), (-2.36, 1.0), (-2.2, 1.18), (-1.8, 1.46), (-0.2, 1.5), (0.4, 1.46), (1.2, 1.02), (2.05, 0.86),
        (2.35, 0.68), (2.4, 0.5),
    ),
    0.95, (-2.26, -1.8, 0.42, 1.2), (-1.4, 1.44),
)  # fmt: skip
SUV = Body(
    4.7, 1.92,
    (
        (-2.35, 0.7), (-2.31, 1.1), (-2.18, 1.3), (-1.8, 1.7), (-0.2, 1.76), (0.5, 1.71), (1.15, 1.24), (2.0, 1.12),
        (2.28, 0.95), (2.35, 0.66),
    ),
    1.12, (-2.24, -1.8, 0.5, 1.15), (-1.4, 1.42), wheel_m=0.38, sill=0.28, roof_share=0.8,
)  # fmt: skip
MINIVAN = Body(
    4.9, 1.95,
    (
        (-2.45, 0.66), (-2.42, 1.1), (-2.34, 1.3), (-2.1, 1.7), (-0.4, 1.76), (0.6, 1.7), (1.55, 1.12), (2.1, 0.96),
        (2.4, 0.76), (2.45, 0.55),
    ),
    1.02, (-2.36, -2.1, 0.62, 1.55), (-1.5, 1.52), wheel_m=0.34, roof_share=0.82,
)  # fmt: skip
CAR_COLOURS: tuple[Colour, ...] = (
    (216, 216, 214), (28, 29, 32), (120, 124, 128), (168, 172, 176), (150, 22, 26), (28, 52, 110), (70, 92, 74),
    (186, 172, 146), (48, 60, 66), (196, 84, 28), (92, 30, 40), (240, 238, 230),
)  # fmt: skip
CAB_YELLOW: Colour = (248, 182, 8)


@dataclass(frozen=True)
class Vehicle:
    """A vehicle ready to stand in a street: its triangles, and how long and wide it is, metres."""

    piece: Piece
    length: float
    width: float


def shade(colour: Colour, factor: float) -> Colour:
    """A darker or lighter colour."""
    r, g, b = (int(min(255, c * factor)) for c in colour)
    return r, g, b


def ground_coat(paint: Livery) -> None:
    """Flanks lighter above and darker below, as they mirror sky and street; dark arches and sills."""
    body, half = paint.body, paint.body.length / 2
    bands = ((0.0, 0.3, 0.45), (0.3, 0.52, 0.72), (0.52, 0.7, 0.88), (0.86, 1.0, 1.12))
    for low, high, factor in bands:
        paint.rect("left right", (-half, low * body.belt), (half, high * body.belt), shade(paint.colour, factor))
    paint.rect("front rear", (-body.width / 2, 0), (body.width / 2, 0.33), (34, 35, 37))
    paint.line("left right", [(-half, 0.72 * body.belt), (half, 0.76 * body.belt)], 0.02, shade(paint.colour, 0.6))
    for axle in body.axles:
        angle = np.linspace(0, 2 * np.pi, 33)
        r = body.wheel_m * 1.2
        paint.fill("left right", [(axle + r * np.cos(a), body.wheel_m + r * np.sin(a)) for a in angle], RUBBER)


def _car_glass(paint: Livery, pillars: tuple[float, ...]) -> None:
    """Side windows under the roof line, windscreen and rear window."""
    body = paint.body
    foot, head, head_front, foot_front = body.glass
    x = np.linspace(foot + 0.18, foot_front - 0.2, 40)
    upper = np.maximum(body.top(x) - 0.1, body.belt + 0.05)
    outline = [(float(a), float(z)) for a, z in zip(x, upper, strict=True)]
    glass = [(foot + 0.2, body.belt + 0.04), *outline, (foot_front - 0.18, body.belt + 0.04)]
    grown = [
        (foot + 0.1, body.belt + 0.01), *((a, z + 0.035) for a, z in outline), (foot_front - 0.08, body.belt + 0.01),
    ]  # fmt: skip
    paint.fill("left right", grown, (16, 17, 18))
    paint.fill("left right", glass, GLASS)
    shine = [(a, z) for a, z in glass if z > body.belt + 0.25]
    if len(shine) > 2:
        paint.fill(
            "left right", [(shine[0][0], body.belt + 0.3), *shine, (shine[-1][0], body.belt + 0.3)], (74, 88, 102)
        )
    for pillar in pillars:
        z = float(body.top(pillar))
        paint.fill(
            "left right",
            [(pillar - 0.05, body.belt), (pillar + 0.05, body.belt), (pillar + 0.02, z), (pillar - 0.06, z)],
            (18, 18, 20),
        )
    w = body.width / 2
    for a, b in ((head_front, foot_front), (head, foot)):
        at_foot, at_head = w * 0.86, w * body.roof_share * 0.9
        paint.fill("top", [(a, -at_head), (b, -at_foot), (b, at_foot), (a, at_head)], GLASS)
        paint.fill(
            "top", [(a, -at_head * 0.9), (b, -at_foot * 0.2), (b, at_foot * 0.3), (a, at_head * 0.1)], (66, 80, 94)
        )
        za, zb = float(body.top(a)) - 0.02, float(body.top(b)) + 0.01
        end = "front" if b > a else "rear"
        paint.fill(end, [(-at_head, za), (-at_foot, zb), (at_foot, zb), (at_head, za)], GLASS)
        paint.fill(
            end, [(-at_head * 0.8, za), (-at_foot * 0.2, zb), (at_foot * 0.4, zb), (at_head * 0.2, za)], (66, 80, 94)
        )


def car_ends(paint: Livery, rng: np.random.Generator) -> None:
    """Lamps, grille, bumpers, number plates, and what of them shows from the side."""
    body, w, half = paint.body, paint.body.width / 2, paint.body.length / 2
    nose = float(body.top(half - 0.12))
    z0, z1 = nose - 0.2, nose - 0.02
    paint.rect("front", (-w * 0.5, z0 - 0.02), (w * 0.5, z1 - 0.01), (20, 20, 22))
    for k in range(4):
        z = z0 + 0.045 * k
        paint.line("front", [(-w * 0.48, z), (w * 0.48, z)], 0.014, (150, 152, 154))
    paint.rect("front", (-w * 0.62, 0.3), (w * 0.62, 0.44), (24, 24, 26))
    tail = min(float(body.top(-half + 0.1)), body.belt) - 0.02
    for side in (1, -1):
        lamp = [
            (side * w * 0.52, z0 + 0.02), (side * w * 0.97, z0 + 0.05), (side * w * 0.95, z1),
            (side * w * 0.52, z1 - 0.01),
        ]  # fmt: skip
        paint.fill("front", lamp, HEAD, HEAD_GLOW)
        paint.line("front", [*lamp, lamp[0]], 0.02, (60, 62, 64))
        rear = [
            (side * w * 0.55, tail - 0.24), (side * w * 0.98, tail - 0.26), (side * w * 0.96, tail),
            (side * w * 0.62, tail),
        ]  # fmt: skip
        paint.fill("rear", rear, TAIL, TAIL_GLOW)
        paint.rect("rear", (side * w * 0.66, tail - 0.17), (side * w * 0.9, tail - 0.11), (236, 214, 204))
        paint.rect("front", (side * w * 0.72, 0.34), (side * w * 0.86, 0.42), (232, 170, 60))
    paint.rect("left right", (half - 0.36, z0 + 0.04), (half, z1), HEAD, shade(HEAD_GLOW, 0.6))
    paint.rect("left right", (-half, tail - 0.24), (-half + 0.26, tail - 0.02), TAIL, TAIL_GLOW)
    number = "".join(str(rng.choice(list("ABCDEFGHKLMNPRSTUVWXYZ"))) for _ in range(3)) + f" {rng.integers(100, 1000)}"
    for end, z in (("front", 0.38), ("rear", min(tail - 0.32, 0.72))):
        paint.rect(end, (-0.27, z - 0.065), (0.27, z + 0.065), (240, 238, 226))
        paint.text(end, (0, z), number, 0.12, (24, 40, 96))
    paint.rect("rear", (-w * 0.9, 0.36), (w * 0.9, 0.4), (28, 28, 30))


def _doors(paint: Livery, seams: tuple[float, ...]) -> None:
    body, low = paint.body, paint.body.sill + 0.06
    for seam in seams:
        paint.line("left right", [(seam, low), (seam, body.belt)], 0.018, shade(paint.colour, 0.42))
    for handle in seams[:-1]:
        paint.rect(
            "left right", (handle + 0.08, body.belt - 0.16), (handle + 0.26, body.belt - 0.115),
            shade(paint.colour, 0.35),
        )  # fmt: skip
        paint.rect("left right", (handle + 0.09, body.belt - 0.13), (handle + 0.25, body.belt - 0.115), (206, 208, 208))
    if seams:
        paint.line("left right", [(seams[0], low), (seams[-1], low)], 0.018, shade(paint.colour, 0.42))


def mirrors(body: Body, colour: Colour, looks: Looks) -> Piece:
    """Both door mirrors."""
    x, w = body.glass[3] - 0.32, body.width / 2
    low = np.array([(x - 0.06, w - 0.04, body.belt + 0.02), (x - 0.06, -w - 0.17, body.belt + 0.02)])
    return boxes(low, low + [0.14, 0.21, 0.15], looks.plain(colour, "gloss"), VEHICLE, without=())


SEAMS = {
    id(SEDAN): (-0.95, 0.06, 1.12), id(HATCH): (-0.55, 0.55, 0.95)[::2], id(WAGON): (-1.0, 0.06, 1.12),
    id(SUV): (-1.0, 0.08, 1.08), id(MINIVAN): (-1.0, 0.25, 1.35),
}  # fmt: skip


def car(body: Body, colour: Colour, looks: Looks, name: str, kind: str = "car") -> Vehicle:
    """A private car, a cab, or a police car."""
    rng = looks.rng(name)
    paint = Livery(body, colour)
    ground_coat(paint)
    seams = SEAMS[id(body)]
    if kind == "cab":
        for k in range(2 * int(body.length / 0.24)):
            x, z = -body.length / 2 + 0.12 * k, body.belt - 0.3 + 0.1 * (k % 2)
            paint.rect("left right", (x, z), (x + 0.12, z + 0.1), (22, 22, 24))
        paint.text("left right", (0.55, body.belt - 0.46), "TAXI", 0.34, (20, 20, 22))
        paint.text("left right", (-0.5, body.belt - 0.46), "CITY CAB", 0.2, (20, 20, 22))
        paint.text("top", (1.6, 0), "", 0.2, RUBBER)
    if kind == "police":
        paint.rect("left right", (-0.98, 0.25), (1.1, body.belt), (238, 238, 236))
        paint.text("left right", (0.06, body.belt - 0.3), "POLICE", 0.34, (20, 36, 96))
    _car_glass(paint, tuple(seams[:-1]) + ((seams[0] - 0.75,) if body is not SEDAN and body is not HATCH else ()))
    car_ends(paint, rng)
    _doors(paint, seams)
    for x in (body.glass[3] + 0.05, body.glass[0]):
        w = body.width * 0.43
        if abs(x) < body.length / 2 - 0.3:
            paint.line("top", [(x, -w), (x, w)], 0.02, shade(colour, 0.4))
    sheet = paint.sheet(name, looks)
    pieces = [
        bodywork(body, sheet, looks),
        wheels(body, looks, spokes=5 + int(rng.integers(4))),
        mirrors(body, colour, looks),
    ]
    roof = float(body.top(-0.2))
    if kind == "cab":
        lit = looks.plain((255, 236, 170), "lamp")
        pieces.append(box((-0.36, -0.12), (-0.42, 0.42), (roof + 0.02, roof + 0.24), lit, VEHICLE))
        words = word_skin("TAXI", (255, 226, 120), (24, 24, 24), looks)
        for x, yaw in ((-0.1, 90.0), (-0.38, 270.0)):
            board = wall_quads((-0.4, 0.03, 0.4, 0.22), 0.0, words, VEHICLE, fit=True)
            pieces.append(place(board, [x, 0, roof], yaw))
    if kind == "police":
        for y, tone in ((0.28, (220, 20, 24)), (-0.28, (24, 60, 220))):
            pieces.append(
                box((-0.4, -0.1), (y - 0.27, y + 0.27), (roof + 0.02, roof + 0.16), looks.plain(tone, "lamp"), VEHICLE)
            )
    return Vehicle(merge(*pieces), body.length, body.width)


def word_skin(words: str, ground: Colour, ink: Colour, looks: Looks) -> Skin:
    """A lit word on a small board."""
    name = f"word-{words}"
    if found := looks.known(name):
        return found
    canvas = Canvas(1.6, 0.4, 80, ground)
    canvas.text(0.8, 0.2, words, 0.36, ink, fit_m=1.4)
    sheet = canvas.texture()
    return looks.add(Material(name, sheet, 0.4, 0.0, sheet))
