"""Vehicles: racing cars, minivans, go-karts, tractors, warplanes, airliners, space shuttles."""

from collections.abc import Sequence

import numpy as np

from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content.drawing import (
    Colour,
    Paint,
    Rng,
    blotches,
    lettered,
    pattern,
    shade,
)
from toolkit.rooms.worlds.content.modelling import (
    Part,
    Parts,
    ball,
    block,
    cylinder,
    disc,
    extrude,
    finish,
    hull,
    picture,
    revolve,
    rod,
    slab,
    surface,
    wheel,
    wing,
)

RUBBER, GLASS, LAMP = (28, 28, 30), (30, 38, 46), (244, 240, 220)


def wheels(places: Sequence[tuple[float, ...]], rim: Colour, spokes: int = 0, rim_share: float = 0.6) -> Parts:
    """Wheels at (x, y, radius, width) and at -y, standing on z = 0."""
    parts = Parts()
    for x, y, radius, width in places:
        parts += wheel(radius, width, RUBBER, rim, rim_share, spokes=spokes).moved(x, y, radius).both_sides()
    return parts


def make_minivan(rng: Rng) -> Mesh:
    """A tall one-box car with a sloping bonnet, a long glass house, sliding doors and roof rails."""
    half, belt, roof = rng.draw(46, 52), rng.draw(52, 58), rng.draw(88, 104)
    colour, nose = rng.colour("car"), rng.draw(34, 44)
    d = 2 * half
    # sections along the car: x, width, height, middle's height, roundness
    body = hull([(-134, d * 0.9, belt - 18, (belt + 18) / 2, 5), (-128, d, belt - 10, (belt + 10) / 2, 6),
                 (40, d, belt - 10, (belt + 10) / 2, 6),
                 (90, d * 0.98, belt - 16, (belt + 6) / 2, 6), (122, d * 0.92, nose - 6, (nose + 16) / 2, 5),
                 (134, d * 0.72, nose - 16, (nose + 12) / 2, 4)], colour, count=18, around=28)  # fmt: skip
    # windscreen and rear window slope: the roof is shorter than the belt
    screen, back = rng.draw(40, 62), rng.draw(4, 16)
    foot = np.array([(-128, -half + 2), (96, -half + 4), (96, half - 4), (-128, half - 2)])
    top = np.array(
        [(-128 + back, -half + 9), (96 - screen, -half + 10), (96 - screen, half - 10), (-128 + back, half - 9)]
    )
    parts = Parts(body, _glass_house(foot, top, belt - 3, roof, colour))
    parts += wheels([(84, half - 5, 23, 16), (-84, half - 5, 23, 16)], rng.colour("steel"), rng.pick((0, 5, 7)))
    # dark wheel arches
    arch = cylinder(27, -3, 0.4, (20, 20, 22), "rubber", 24).rotated("x", -90)
    parts += Parts(*(part.moved(x, half, 26) for part in arch for x in (84, -84))).both_sides()
    # on each side: head lamp, tail lamp, mirror, perhaps a roof rail, and the seams of the doors
    for y in (1, -1):
        parts += block((8, 18, 9), (126, y * (half - 16), nose - 2), LAMP, "glass", 2)
        parts += block((3, 9, 20), (-133, y * (half - 9), belt - 10), (190, 24, 28), "glass", 1)
        parts += block((7, 8, 7), (74, y * (half + 4), belt + 4), colour, "paint", 2)
        if rng.chance(0.7):
            path = [(-100, y * (half - 14), roof + 4), (30, y * (half - 14), roof + 4)]
            parts += rod(path, 2, (40, 40, 42), "metal", segments=6)
        parts += block((150, 0.8, 1.2), (-35, y * (half + 0.3), belt - 12), shade(colour, 0.5))
        for x in (44, -18, -76):
            parts += block((0.9, 0.8, belt - 28), (x, y * (half + 0.3), belt / 2 + 8), shade(colour, 0.5))
    # grille, bumpers and number plate
    parts += block((4, 44, 8), (133, 0, 20), (26, 26, 28), "rubber")
    parts += block((6, d * 0.9, 12), (130, 0, 17), shade(colour, 0.85), "paint", 2)
    parts += block((6, d * 0.9, 12), (-132, 0, 19), shade(colour, 0.85), "paint", 2)
    parts += block((2, 30, 8), (-135, 0, 36), (236, 234, 220), "paint")
    return finish(parts, 512)


def _glass_house(foot: np.ndarray, top: np.ndarray, low: float, high: float, colour: Colour) -> Parts:
    """Windows with pillars between two outlines (4, 2), counter-clockwise from right behind, and the roof."""

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        # u runs round the car: right side, front, left side, back; posts stand alike on both sides
        side, front = foot[1, 0] - foot[0, 0], foot[2, 1] - foot[1, 1]
        s = u * (2 * side + 2 * front)
        posts = np.zeros_like(s, dtype=bool)
        for at in (0, side * 0.3, side * 0.6, side * 0.78, side, side + front):
            for place in (at, 2 * side + front - at if at <= side else at):
                posts |= np.abs(s - place) < 4.5
        posts |= s > 2 * side + 2 * front - 4.5
        return posts | (v < 0.1) | (v > 0.9)

    # walls lean in from the outline at their foot to the outline of the roof
    rows = [np.c_[np.vstack([ring, ring[:1]]), np.full(5, z)] for ring, z in ((foot, low), (top, high))]
    walls = surface(rows, pattern([GLASS, colour], shader), "glass")
    roof = extrude(top.tolist(), 5, 2, colour, "paint").moved(z=high - 1)
    return Parts(walls, roof)


def make_gokart(rng: Rng) -> Mesh:
    """A flat frame of tubes on small fat wheels, with a bucket seat, a wheel, side pods and an engine; some driven."""
    colour, frame = rng.colour("bright"), rng.colour("dark", "bright", "steel")
    half, long = rng.draw(52, 62), rng.draw(88, 102)
    radius = rng.draw(19, 24)
    # wheels on two axles
    places = [(long - 16, half + 12, radius, 24), (-long + 18, half + 12, radius + 2, 32)]
    parts = wheels(places, rng.colour("steel", "bright"))
    parts += rod([(-long + 18, -half, radius), (-long + 18, half, radius)], 4, frame, "metal")
    parts += rod([(long - 16, -half, radius), (long - 16, half, radius)], 3, frame, "metal")
    parts += block((1.7 * long, 46, 3), (0, 0, 12), (60, 62, 66), "metal")
    # floor, rails, and a bumper round the front; side pods
    rails = [(-long, 20, 14), (-20, 28, 14), (40, 26, 14), (long, 18, 14)]
    parts += rod(rails, 4, frame, "metal").both_sides()
    bumper = [(long - 4, -half + 6, 16), (long + 22, -26, 16), (long + 22, 26, 16), (long - 4, half - 6, 16)]
    parts += Parts(
        rod(bumper, 4, frame, "metal"), block((72, 22, 20), (2, half + 2, 18), colour, "plastic", 4).both_sides()
    )
    # nose and a board with the number
    nose = [(0, -34), (30, -26), (36, 0), (30, 26), (0, 34)]
    number = lettered((244, 244, 240), (20, 20, 22), str(int(rng.integers(1, 99))))
    parts += extrude(nose, 9, 3, colour, "plastic").moved(long - 14, 0, 17)
    board = Parts(block((3, 34, 24), (0, 0, 0), (244, 244, 240)), picture(34, 24, number).moved(1.7))
    parts += board.rotated("y", -35).moved(long - 22, 0, 38)
    # bucket seat
    seat = rng.colour("dark")
    parts += block((44, 42, 8), (-22, 0, 18), seat, "plastic", 3)
    parts += block((8, 42, 54), (0, 0, 25), seat, "plastic", 3).rotated("y", -18).moved(-44, 0, 18)
    parts += block((40, 5, 22), (-24, 21, 26), seat, "plastic", 2).both_sides()
    # steering wheel on its column
    turn = np.linspace(0, 2 * np.pi, 17)
    ring = rod(np.stack([0 * turn, 15 * np.cos(turn), 15 * np.sin(turn)], 1), 2.2, RUBBER, "rubber", 20, 8)
    parts += Parts(ring.rotated("y", -40).moved(26, 0, 50), rod([(26, 0, 50), (58, 0, 16)], 2.4, frame, "metal"))
    # the engine beside the seat
    parts += block((30, 28, 26), (-58, 46, 30), (70, 70, 74), "metal", 3)
    parts += cylinder(11, 42, 58, (150, 152, 156), "metal").moved(-58, 46)
    if rng.chance(0.35):
        parts += _driver(rng, (-24, 0, 24))
    return finish(parts)


def _driver(rng: Rng, at: tuple[float, float, float]) -> Parts:
    suit, helmet = rng.colour("bright", "dark"), rng.colour("bright", "pale")
    # body, helmet and visor; arms to the wheel, legs forward
    body = Parts(
        ball(1, suit, "cloth", 14, 8, (15, 19, 30)).moved(-6, 0, 26),
        ball(15, helmet, "paint", 18, 10).moved(-8, 0, 70),
    )
    body.append(ball(14, (20, 22, 28), "glass", 14, 8, (0.5, 0.92, 0.4)).moved(1, 0, 70))
    limbs = rod([(-6, 17, 44), (14, 22, 30), (46, 12, 30)], 5, suit, "cloth", 10)
    limbs += rod([(-2, 9, 6), (40, 13, 22), (78, 10, 2)], 7, suit, "cloth", 10)
    return Parts(body, limbs.both_sides()).moved(*at)


def make_tractor(rng: Rng) -> Mesh:
    """Huge lugged wheels behind and small ones in front, a long bonnet, and a cab, a roof or an open seat."""
    colour, rim = rng.colour("bright"), rng.colour("bright", "pale")
    big, small = rng.draw(58, 68), rng.draw(28, 38)
    floor, rear, front = big * 0.75, -58.0, rng.draw(78, 92)
    # wheels, the rear pair with lugs
    parts = wheels([(rear, 54, big, 34), (front, 44, small, 22)], rim, rim_share=0.55)
    for side in (1, -1):
        for k in range(16):
            lug = block((9, 17, 9), (0, 9 if k % 2 else -9, big), RUBBER, "rubber").rotated("y", 22.5 * k)
            parts += lug.moved(rear, side * 54, big)
    # chassis, hood and axles
    parts += block((150, 34, 26), (18, 0, floor - 8), (64, 66, 70), "metal", 3)
    stations = [(-2, 46, 48, floor + 22, 6), (front - 8, 42, 44, floor + 20, 6), (front + 16, 38, 38, floor + 18, 5)]
    hood = hull(stations, colour, count=6)
    grille = block((2, 28, 28), (front + 16.5, 0, floor + 18), (26, 26, 28), "metal")
    parts += Parts(hood, grille, rod([(front, 0, floor), (front, 0, small)], 8, (64, 66, 70), "metal"))
    parts += rod([(front, -44, small), (front, 44, small)], 5, (64, 66, 70), "metal")
    parts += rod([(rear, -54, big), (rear, 54, big)], 9, (64, 66, 70), "metal")
    parts += cylinder(6, 0, 4, LAMP, "glass", 14).rotated("y", 90).moved(front + 15, 14, floor + 32).both_sides()
    # mudguards over the rear wheels
    for y in (1, -1):
        guard = np.linspace(0.2, np.pi - 0.25, 10)
        rows = [
            np.stack([rear + (big + 6) * np.cos(guard), np.full(10, y * 54 + w), big + (big + 6) * np.sin(guard)], 1)
            for w in (-20, 20)
        ]  # fmt: skip
        skin = surface(rows, colour, "paint")
        parts += Parts(skin.flipped(), skin.moved(z=-0.8))
    # exhaust stack, seat and steering wheel
    path = [(front * 0.5, 12, floor + 40), (front * 0.5, 12, floor + 96)]
    stack = rod(path, [4, 6, 6, 3.5], (40, 40, 42), "metal", 8)
    parts += Parts(stack, block((36, 36, 10), (rear + 6, 0, floor + 20), (30, 30, 32), "rubber", 3))
    parts += block((8, 36, 34), (rear - 14, 0, floor + 40), (30, 30, 32), "rubber", 3)
    turn = np.linspace(0, 2 * np.pi, 15)
    ring = rod(np.stack([0 * turn, 13 * np.cos(turn), 13 * np.sin(turn)], 1), 2, RUBBER, "rubber", 16, 8)
    parts += Parts(
        ring.rotated("y", -30).moved(-8, 0, floor + 54),
        rod([(-8, 0, floor + 54), (2, 0, floor + 36)], 2, RUBBER),
    )
    parts += _cab(rng, colour, floor, rear)
    return finish(parts)


def _cab(rng: Rng, colour: Colour, floor: float, rear: float) -> Parts:
    kind, high = rng.pick(("cab", "roof", "open")), rng.draw(108, 124)
    if kind == "open":
        return Parts()
    low, top = floor + 14, floor + high
    parts = block((70, 64, 8), (rear + 18, 0, top + 3), rng.pick((colour, (240, 240, 236))), "paint", 3)
    # posts of the cab, a little closer together at the roof
    for x in (rear - 12, rear + 46):
        path = [(x, 28, low), (x * 0.96, 26, top)]
        parts += rod(path, 2.8, rng.pick((colour, RUBBER)), "paint", segments=8).both_sides()
    if kind == "cab":
        parts += block((56, 50, top - low), (rear + 17, 0, (top + low) / 2), GLASS, "glass")
    return parts


def make_racer(rng: Rng) -> Mesh:
    """An open-wheeler with wings, a wingless cigar, or a low closed-wheel prototype with a tail wing; all numbered."""
    return finish(rng.pick((_open_wheeler, _open_wheeler, _cigar, _prototype))(rng), 512)


def _livery(rng: Rng) -> tuple[Paint, Colour, Colour]:
    """Paint of a hull (u around from the left over the top, v forward), its main colour and the other."""
    main, other = rng.colour("bright", "car"), rng.colour("bright", "pale", "dark")
    kind, wide, at = (
        rng.pick(("plain", "centre", "nose", "halves", "slash")),
        rng.draw(0.04, 0.09), rng.draw(0.6, 0.85),
    )  # fmt: skip

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        if kind == "centre":
            return (np.abs(np.abs(u - 0.25) - 0.5 * wide) < 0.4 * wide) & (v >= 0)
        if kind == "nose":
            return (v > at) & (u >= 0)
        if kind == "halves":
            return (np.sin(2 * np.pi * u) < 0) & (v >= 0)
        if kind == "slash":
            return np.abs(v - 0.5 - 0.3 * np.sin(2 * np.pi * u)) < wide
        return (u < 0) & (v < 0)

    return pattern([main, other], shader), main, other


def _number(rng: Rng) -> Paint:
    ground, ink = rng.pick(
        (((246, 246, 242), (20, 20, 22)), ((20, 20, 22), (250, 220, 50)), ((250, 220, 50), (20, 20, 22)))
    )
    return lettered(ground, ink, str(int(rng.integers(1, 99))), 0.85)


def _helmet(rng: Rng, x: float, z: float, radius: float = 10.0) -> Parts:
    shell = ball(radius, rng.colour("bright", "pale"), "paint", 18, 10).moved(x, 0, z)
    return Parts(shell, ball(radius * 0.96, GLASS, "glass", 14, 8, (0.6, 0.9, 0.36)).moved(x + radius * 0.5, 0, z + 1))


def _arms(joints: list[tuple[float, float, float, float]], z: float) -> Parts:
    """Wishbones from the hull out to each wheel: (x, inner y, outer y, spread)."""
    parts = Parts()
    for x, inner, outer, spread in joints:
        for height in (z - 7, z + 7):
            for side in (-1, 1):
                path = [(x + side * spread, inner, height), (x, outer, height)]
                parts += rod(path, 1.5, (34, 34, 38), "metal", segments=6)
    return parts.both_sides()


def _open_wheeler(rng: Rng) -> Parts:
    paint, main, other = _livery(rng)
    wide, front, rear = rng.draw(34, 44), rng.draw(74, 88), rng.draw(-96, -84)
    tyre = rng.draw(22, 27)
    body = hull([(-112, 16, 14, 24, 2.6), (-70, wide, 30, 24, 3), (-20, wide * 1.1, 34, 23, 3.4),
                 (30, wide * 0.9, 30, 22, 3),
                 (80, wide * 0.6, 20, 18, 2.6), (126, 12, 10, 15, 2.2)], paint)  # fmt: skip
    # side pods with their inlets, and the airbox behind the driver
    pod = hull([(-74, 8, 16, 18, 3), (-40, 26, 26, 18, 4), (8, 28, 26, 18, 4), (24, 24, 22, 18, 4)], paint, count=10)
    mouth = block((1, 18, 15), (24.6, 0, 18), (16, 16, 18))
    airbox = hull([(-84, 4, 6, 38, 2), (-46, 14, 22, 44, 2.4), (-20, 16, 24, 50, 2.4)], main, count=8, around=16)
    parts = Parts(body, Parts(pod, mouth).moved(y=wide * 0.5 + 10).both_sides(), airbox)
    parts += Parts(ball(1, (18, 18, 20), "plastic", 18, 6, (24, 13, 3)).moved(6, 0, 38), _helmet(rng, -2, 47))
    # open wheels on wishbones
    half = rng.draw(58, 66)
    share = rng.pick((0, 5, 6))
    places = [(front, half - 8, tyre, 20), (rear, half - 12, tyre + 3, 28)]
    parts += wheels(places, rng.colour("steel", "bright"), share)
    parts += _arms([(front, wide * 0.25, half - 14, 12), (rear, wide * 0.3, half - 20, 12)], tyre)
    # front wing with end plates
    parts += block((22, rng.draw(100, 124), 3), (124, 0, 10), other, "paint", 1)
    parts += slab([(108, 6), (136, 6), (136, 18), (108, 24)], 2, main, "paint", 58).both_sides()
    # rear wing of one or two planes, between end plates on struts
    high = rng.draw(58, 76)
    for z, pitch in ((high, 8), (high + 9, 24))[: rng.pick((1, 2))]:
        parts += block((28, 96, 3), (0, 0, 0), other, "paint", 1).rotated("y", pitch).moved(-120, 0, z)
    outline = [(-136, high - 16), (-104, high - 14), (-104, high + 12), (-136, high + 14)]
    parts += slab(outline, 2.4, main, "paint", 48).both_sides()
    parts += slab([(-122, 24), (-114, 24), (-114, high), (-122, high)], 2, (40, 40, 44), "paint", 6).both_sides()
    parts += block((20, 16, 0.8), (0, 0, 0), _number(rng)).rotated("y", 12).moved(84, 0, 29)
    if rng.chance(0.5):
        halo = [(-14, 16, 44), (10, 16, 56), (26, 0, 58), (10, -16, 56), (-14, -16, 44)]
        parts += Parts(
            rod(halo, 1.8, (30, 30, 32), "metal"), rod([(26, 0, 58), (36, 0, 36)], 1.6, (30, 30, 32), "metal")
        )
    return parts


def _cigar(rng: Rng) -> Parts:
    paint, main, _ = _livery(rng)
    wide, tyre, half = rng.draw(40, 50), rng.draw(28, 33), rng.draw(54, 64)
    body = hull([(-128, 8, 8, 34, 2), (-90, wide * 0.72, wide * 0.7, 32, 2), (-20, wide, wide * 0.95, 30, 2.2),
                 (60, wide * 0.85, wide * 0.72, 30, 2.2), (110, wide * 0.62, wide * 0.5, 29, 2),
                 (124, wide * 0.44, wide * 0.34, 29, 2)],
                paint)  # fmt: skip
    # nose, cockpit, driver, screen and headrest
    grille = cylinder(wide * 0.18, 122, 125, (20, 20, 22), "metal", 20).rotated("y", 90)
    parts = Parts(
        body, grille.moved(z=29),
        ball(1, (26, 22, 20), "plastic", 18, 6, (26, 15, 4)).moved(-24, 0, 30 + wide * 0.46),
    )  # fmt: skip
    parts += Parts(_helmet(rng, -34, 62), ball(1, (150, 170, 180), "glass", 16, 8, (6, 15, 12)).moved(2, 0, 52))
    parts += hull([(-74, 5, 8, 54, 2), (-46, 16, 26, 52, 2.2)], main, count=4, around=14)
    # wire wheels on thin arms
    places = [(82, half, tyre - 2, 14), (-84, half, tyre, 18)]
    parts += wheels(places, rng.colour("steel"), int(rng.integers(12, 20)), 0.76)
    parts += _arms([(82, wide * 0.3, half, 14), (-84, wide * 0.3, half, 14)], tyre)
    # exhaust pipes along both flanks
    for y in (1, -1):
        pipe = [(-10, y * wide * 0.5, 30), (-60, y * (wide * 0.5 + 4), 28), (-132, y * (wide * 0.4), 28)]
        parts += rod(pipe, 3.4, (176, 172, 164), "metal")
    # numbers on the nose and the flanks
    roundel = disc(13, 0, _number(rng), "paint", 20).moved(60, 0, 31 + wide * 0.36)
    number = _number(rng)
    sides = [picture(24, 20, number).rotated("z", side * 90).moved(-50, side * wide * 0.5, 34) for side in (1, -1)]
    return Parts(parts, roundel, sides)


def _prototype(rng: Rng) -> Parts:
    paint, main, other = _livery(rng)
    wide, tyre = rng.draw(108, 122), rng.draw(21, 25)
    body = hull([(-126, wide * 0.9, 22, 24, 5), (-80, wide, 32, 23, 5), (0, wide * 0.96, 26, 20, 5),
                 (70, wide, 26, 19, 5),
                 (110, wide * 0.96, 16, 14, 5), (134, wide * 0.7, 6, 9, 4)], paint, around=32)  # fmt: skip
    # arches over the wheels, closed cockpit, and a spine behind it
    arches = Parts(
        *(ball(1, main, "paint", 20, 8, (36, 13, 21)).moved(x, wide * 0.5 - 13, tyre * 0.9) for x in (80, -82))
    ).both_sides()
    cabin = ball(1, GLASS, "glass", 22, 10, (44, 24, 24)).moved(4, 0, 32)
    spine = hull([(-118, 6, 8, 36, 2), (-60, 26, 22, 38, 2.4), (-4, 34, 26, 42, 2.6)], main, count=10, around=20)
    parts = Parts(body, arches, cabin, spine)
    places = [(80, wide * 0.5 - 7, tyre, 18), (-82, wide * 0.5 - 7, tyre, 20)]
    parts += wheels(places, rng.colour("steel", "brass"), 5)
    # rear wing, as wide as the car
    high = rng.draw(56, 70)
    parts += block((26, wide, 3), (0, 0, 0), other, "paint", 1).rotated("y", 8).moved(-122, 0, high)
    outline = [(-138, high - 14), (-106, high - 14), (-106, high + 6), (-138, high + 8)]
    parts += slab(outline, 2.4, main, "paint", wide / 2).both_sides()
    parts += slab([(-126, 30), (-116, 30), (-116, high), (-126, high)], 2, RUBBER, "paint", 18).both_sides()
    # lamps, numbers on nose and flanks, and perhaps a fin
    parts += block((10, 18, 6), (112, wide * 0.34, 19), LAMP, "glass", 2).both_sides()
    parts += block((34, 34, 0.8), (0, 0, 0), _number(rng)).rotated("y", 9).moved(88, 0, 31.5)
    number = _number(rng)
    parts += [picture(32, 18, number).rotated("z", side * 90).moved(-6, side * wide * 0.495, 21) for side in (1, -1)]
    fin = wing((-40, 0, 46), (-96, 0, rng.draw(66, 78)), (76, 26), 2.4, main, upright=True) if rng.chance(0.5) else []
    return Parts(parts, fin)


def make_warplane(rng: Rng) -> Mesh:
    """A delta, a swept-wing twin-finned jet, or a propeller fighter, in camouflage or metal."""
    return finish(rng.pick((_delta_jet, _swept_jet, _swept_jet, _propeller_fighter))(rng), 512)


def _skin(rng: Rng) -> tuple[Paint, Colour]:
    main = rng.colour("military") if rng.chance(0.8) else rng.colour("steel", "car")
    if rng.chance(0.45):
        return main, main
    others = [rng.colour("military") for _ in range(int(rng.integers(1, 3)))]
    return blotches(rng, [main, *others], rng.pick((4, 7))), main


def _canopy(x: float, z: float, long: float, wide: float) -> Part:
    return ball(1, (26, 32, 40), "glass", 16, 8, (long, wide, wide * 1.1)).moved(x, 0, z)


def _roundels(rng: Rng, x: float, y: float, z: float, size: float) -> Parts:
    colours = rng.pick((((28, 54, 120), (244, 244, 240), (196, 32, 40)),
                         ((196, 32, 40), (244, 244, 240), (28, 54, 120)),
                         ((30, 40, 80), (230, 230, 230), (30, 40, 80))))  # fmt: skip
    rings = pattern(colours, lambda u, v, aspect: 2 - np.digitize(np.hypot(u - 0.5, v - 0.5), [0.2, 0.36]))
    roundel = disc(size / 2, 0.5, rings, "paint", 16)
    return Parts(*(roundel.moved(x, side * y, z) for side in (1, -1)))


def build_gear(places: list[tuple[float, float, float]], down: float, radius: float) -> Parts:
    """Legs with wheels from places (x, y, z)."""
    parts = Parts()
    for x, y, z in places:
        parts += rod([(x, y, z), (x, y, z - down)], 1.4, (150, 152, 156), "metal", segments=6)
        parts += wheel(radius, radius * 0.8, (28, 28, 30), (170, 172, 176), segments=14).moved(x, y, z - down)
    return parts


def _stores(rng: Rng, x: float, y: float, z: float, long: float) -> Parts:
    paint, thick = rng.pick(((236, 236, 232), (120, 126, 120))), rng.draw(2, 4)
    body = hull([(-long / 2, 1, 1, 0, 2), (-long * 0.3, thick * 2, thick * 2, 0, 2),
                 (long * 0.3, thick * 2, thick * 2, 0, 2),
                 (long / 2, 0.6, 0.6, 0, 2)], paint, count=8, around=10)  # fmt: skip
    fins = block((long * 0.16, thick * 5, 0.8), (-long * 0.36, 0, 0), paint)
    fins += block((long * 0.16, 0.8, thick * 5), (-long * 0.36, 0, 0), paint)
    return Parts(body, fins, block((long * 0.3, 1.4, 8), (0, 0, 4), paint)).moved(x, y, z).both_sides()


def _delta_jet(rng: Rng) -> Parts:
    skin, main = _skin(rng)
    wide, span, root = rng.draw(24, 30), rng.draw(72, 92), rng.draw(110, 140)
    body = hull([(-118, wide * 0.7, wide * 0.7, 0, 2), (-60, wide, wide, 0, 2.4), (10, wide * 1.2, wide, 0, 2.6),
                 (60, wide * 0.72, wide * 0.8, 1, 2), (100, wide * 0.5, wide * 0.5, 0, 2), (150, 0.6, 0.6, -2, 2)],
                skin)  # fmt: skip
    # a delta wing, perhaps canards before it, and a single fin
    edge = root - 105
    half = wing((edge, 6, -3), (edge - root + rng.draw(18, 34), span, -3), (root, rng.draw(12, 26)), 5, skin)
    canards = wing((78, 6, 3), (58, rng.draw(30, 40), 4), (24, 9), 3, main) if rng.chance(0.6) else []
    fin = wing((-50, 0, 6), (-100, 0, rng.draw(46, 62)), (66, 22), 4, skin, upright=True)
    # intakes beside the fuselage, with dark mouths
    intakes = hull([(-20, 10, 16, 0, 4), (20, 14, 18, 0, 4), (44, 13, 17, 0, 4)], main, count=4)
    mouth = block((1, 10, 13), (44.5, 0, 0), (16, 16, 18))
    parts = Parts(body, Parts(half, canards, Parts(intakes, mouth).moved(y=wide * 0.52)).both_sides(), fin)
    # canopy, jet pipe, markings, stores, perhaps the gear
    parts += _canopy(66, wide * 0.36, 26, 8)
    parts += cylinder(wide * 0.33, 117, 126, (60, 58, 58), "metal", 20, wide * 0.28).rotated("y", -90)
    parts += _roundels(rng, -60, span * 0.5, 0.6, 22) if rng.chance(0.6) else []
    if rng.chance(0.7):
        parts += _stores(rng, -40, span * rng.draw(0.45, 0.7), -11, rng.draw(44, 64))
    parts += build_gear([(84, 0, -8), (-30, 26, -4), (-30, -26, -4)], 28, 8) if rng.chance(0.6) else []
    return parts


def _swept_jet(rng: Rng) -> Parts:
    skin, main = _skin(rng)
    wide, tall, span = rng.draw(30, 44), rng.draw(20, 28), rng.draw(74, 104)
    body = hull([(-112, wide * 0.9, tall * 0.7, 0, 3.4), (-40, wide * 1.05, tall, 0, 3.6), (30, wide, tall, 0, 3.4),
                 (70, wide * 0.5, tall * 0.95, 1, 2.4), (110, wide * 0.34, tall * 0.6, 0, 2), (152, 0.6, 0.6, -2, 2)],
                skin)  # fmt: skip
    # swept wings and tailplane, a half each
    root = rng.draw(64, 90)
    half = wing(
        (root * 0.4, wide * 0.4, 0), (root * 0.4 - rng.draw(40, 70), span, rng.draw(-4, 2)), (root, 24), 5, skin
    )
    tail = wing((-76, wide * 0.4, -1), (-104, rng.draw(48, 60), -1), (38, 18), 3, skin)
    # a single fin, or two that lean outwards
    twin, lean = rng.chance(0.65), rng.draw(0, 16)
    at = wide * 0.36 if twin else 0.0
    fin = wing((-52, at, tall * 0.3), (-92, at + (lean if twin else 0), tall * 0.3 + rng.draw(40, 58)), (48, 20), 3,
               skin,
               upright=True)  # fmt: skip
    # jet pipes behind and intakes beside the fuselage
    pipe = cylinder(tall * 0.4, 111, 124, (58, 56, 56), "metal", 20, tall * 0.33).rotated("y", -90)
    intake = block((60, 9, tall * 0.8), (18, wide * 0.5 + 3, -1), main, bevel=2)
    mouth = block((1, 6, tall * 0.6), (48.4, wide * 0.5 + 3, -1), (16, 16, 18))
    parts = Parts(body, Parts(half, tail, intake, mouth, pipe.moved(y=wide * 0.24)).both_sides())
    parts += fin.both_sides() if twin else fin
    # canopy, markings, stores under the wings, perhaps the gear
    parts += _canopy(74, tall * 0.4, 27, 8.5)
    parts += _roundels(rng, -20, span * 0.62, 1.6, 18) if rng.chance(0.5) else []
    if rng.chance(0.75):
        parts += _stores(rng, -16, span * rng.draw(0.5, 0.75), -10, rng.draw(44, 64))
    parts += build_gear([(84, 0, -8), (-30, 22, -6), (-30, -22, -6)], 28, 8) if rng.chance(0.6) else []
    return parts


def _propeller_fighter(rng: Rng) -> Parts:
    skin, _ = _skin(rng)
    wide, span = rng.draw(26, 32), rng.draw(110, 134)
    body = hull([(-118, 3, 8, 6, 2), (-60, wide * 0.6, wide * 0.75, 3, 2), (10, wide, wide * 1.15, 0, 2.2),
                 (70, wide * 0.95, wide, 0, 2.4), (92, wide * 0.7, wide * 0.75, 0, 2)], skin)  # fmt: skip
    # straight wings, tailplane and fin
    half = wing((46, 6, -8), (28, span, rng.draw(0, 8)), (54, 24), 7, skin)
    tail = wing((-84, 3, 8), (-94, 48, 8), (30, 16), 3, skin)
    fin = wing((-82, 0, 8), (-102, 0, 50), (38, 20), 3, skin, upright=True)
    nose = rng.colour("bright", "dark")
    # spinner and blades
    spinner = revolve([(wide * 0.32, 92), (wide * 0.26, 102), (2, 114), (0, 115)], 20, nose, "paint").rotated("y", 90)
    blades, count = Parts(), rng.pick((2, 3, 4))
    for k in range(count):
        blade = ball(1, (36, 36, 38), "metal", 10, 8, (1.4, 4.4, 22)).moved(99, 0, 27)
        blades += blade.rotated("x", 360 / count * k + 20)
    parts = Parts(body, Parts(half, tail).both_sides(), fin, spinner, blades, _canopy(-2, wide * 0.52, 25, 8.5))
    parts += _roundels(rng, 16, span * 0.6, 2.4, 26)
    parts += build_gear([(34, 34, -8), (34, -34, -8)], 26, 9) if rng.chance(0.5) else []
    return parts


def make_airliner(rng: Rng) -> Mesh:
    """A white tube with rows of windows, swept low wings, engines under them or at the tail, and a coloured fin."""
    radius, span = rng.draw(12.5, 17), rng.draw(105, 140)
    white, accent = rng.colour("pale", "pale", "steel", spread=5), rng.colour("bright", "car")
    belly, line = (rng.pick((white, (168, 172, 178), accent)), rng.draw(0.49, 0.53))
    tail_from = rng.draw(0.12, 0.3)

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        level = np.sin(2 * np.pi * u)  # u starts at the left side and goes over the top
        windows = (np.abs(level - 0.26) < 0.11) & (v > 0.16) & (v < 0.86) & ((v * 54) % 1 < 0.45)
        doors = (np.abs(level - 0.1) < 0.36) & ((np.abs(v - 0.88) < 0.008) | (np.abs(v - 0.2) < 0.008))
        cockpit = (v > 0.935) & (v < 0.965) & (level > 0.3)
        stripe = (np.abs(level + 0.1) < (line - 0.4)) | (v + 0.1 * level < tail_from)
        index = np.where(level < -0.5, 1, np.where(stripe, 2, 0))
        return np.where(windows | cockpit, 3, np.where(doors, 4, index))

    # fuselage
    paint = pattern([white, belly, accent, (40, 46, 56), (140, 144, 150)], shader)
    d = 2 * radius
    body = hull([(-135, 3, 4, radius * 0.55, 2), (-95, d * 0.62, d * 0.66, radius * 0.3, 2), (-60, d, d, 0, 2),
                 (100, d, d, 0, 2), (120, d * 0.8, d * 0.82, -0.8, 2), (131, d * 0.45, d * 0.44, -2.4, 2),
                 (135, 1, 1, -3, 2)], paint, count=28)  # fmt: skip
    grey = (176, 180, 186)
    # wing
    half = wing(
        (38, radius * 0.5, -radius * 0.5),
        (38 - span * rng.draw(0.55, 0.75), span, rng.draw(2, 12)),
        (56, 14), 5, grey,
    )  # fmt: skip
    # fin and tail; engines at the rear allow a high tail
    rear = rng.chance(0.25)
    high_tail = rear and rng.chance(0.6)
    fin_top = radius * 0.8 + rng.draw(42, 54)
    fin = wing((-82, 0, radius * 0.7), (-122, 0, fin_top), (44, 20), 4, accent, upright=True)
    root = (-118, 0, fin_top - 3) if high_tail else (-98, 3, radius * 0.4)
    tail = wing(root, (root[0] - 26, 46, root[2] + 4), (28, 12), 3, grey)
    parts = Parts(body, fin, Parts(half, tail).both_sides())
    # engines, below the wing or at the rear
    engine = hull([(-14, 5, 5, 0, 2), (-4, 12, 12, 0, 2), (12, 14, 14, 0, 2), (16, 12, 12, 0, 2)],
                  rng.pick((white, accent, grey)), count=8, around=16)  # fmt: skip
    engine += cylinder(5, 15, 16.6, (24, 24, 28), "metal", 16).rotated("y", 90)
    for share in (0.34, 0.62) if rng.chance(0.3) else (0.36,):
        place = (
            (-62, radius + 8, radius * 0.3) if rear else (38 - span * 0.5 * share + 2, span * share, -radius * 0.5 - 8)
        )
        parts += (
            Parts(engine, block((16, 2, 8), (-2, -6 if rear else 0, 0 if rear else 7), grey)).moved(*place).both_sides()
        )
    # landing gear
    if rng.chance(0.6):
        parts += build_gear([(98, 0, -radius), (0, 18, -radius * 0.6), (0, -18, -radius * 0.6)], 18, 6)
    return finish(parts, 512)


def make_space_shuttle(rng: Rng) -> Mesh:
    """The orbiter: white above, black below, with a double delta; on its wheels, or upright on its tank."""
    # on its wheels, or upright with tank and boosters
    orbiter = _orbiter(rng)
    if rng.chance(0.5):
        gear = build_gear([(78, 0, -14), (-52, 24, -14), (-52, -24, -14)], 16, 6)
        return finish([*orbiter, *(gear if rng.chance(0.7) else [])], 512)
    tank = rng.vary((190, 104, 52)) if rng.chance(0.8) else (236, 236, 232)
    white = (240, 240, 238)
    # the tank is round, its nose up; the boosters stand at both sides
    profile = [(0, -100), (22, -94), (26, -84), (26, 74), (22, 104), (12, 128), (2, 140), (0, 140)]
    body = revolve(profile, 28, tank, "matte")
    shell = revolve([(0, -118), (13, -118), (9, -100), (11, -98), (11, 92), (3, 116), (0, 117)], 20, white, "paint")
    hoops = [
        cylinder(11.4, 60, 66, (120, 120, 122), "paint", 20),
        cylinder(11.4, -40, -36, (60, 60, 62), "paint", 20),
    ]
    upright = orbiter.rotated("y", -90).moved(-44, 0, -20)  # nose up, its belly to the tank
    return finish([body, *Parts(shell, *hoops).moved(0, 38, 0).both_sides(), *upright], 512)


def _orbiter(rng: Rng) -> Parts:
    """Nose to +x, belly down, about 200 mm long."""
    white, black = rng.vary((240, 240, 236), 4), rng.vary((34, 34, 38), 4)
    waist = rng.draw(-0.35, 0.0)

    def shader(u: np.ndarray, v: np.ndarray, aspect: float) -> np.ndarray:
        # 1 at the top of the hull, -1 at its bottom
        level = np.sin(2 * np.pi * u)
        cockpit = (v > 0.87) & (v < 0.92) & (level > 0.45) & (np.abs(np.cos(2 * np.pi * u)) > 0.04)
        doors = (np.abs(v - 0.3) < 0.004) | (np.abs(v - 0.76) < 0.004)
        return np.where((level < waist) | (v > 0.975) | cockpit, 1, np.where(doors & (level > 0.1), 2, 0))

    paint = pattern([white, black, (150, 150, 152)], shader)
    wide = rng.draw(30, 36)
    # sections from the tail to the nose: place, width, height, height of the middle, squareness
    body = hull([(-90, wide, wide, 2, 3), (-70, wide, wide, 0, 3.4), (58, wide, wide, 0, 3.4),
                 (80, wide * 0.84, wide * 0.8, -3, 2.6),
                 (98, wide * 0.4, wide * 0.4, -7, 2.2), (105, 1, 1, -8, 2)], paint, count=26)  # fmt: skip
    half, glove, span = Parts(), rng.draw(30, 46), rng.draw(64, 80)
    # wings with a glove before them, white above and black below
    for z, colour in ((-10, white), (-12.5, black)):
        half += wing((10, wide * 0.4, z), (-46, span, z), (96, 34), 3, colour)
        half += wing((10 + glove, wide * 0.36, z), (-10, wide * 0.95, z), (70, 60), 3, colour)
    fin = wing((-50, 0, wide * 0.4), (-92, 0, wide * 0.4 + rng.draw(46, 58)), (46, 22), 5, white, upright=True)
    # manoeuvring pods beside the fin, and three main engines
    pods = hull([(-98, 8, 10, 0, 2), (-80, 14, 16, 0, 2.4), (-50, 3, 4, -3, 2)], white, count=8, around=12)
    bell = revolve([(4, 0), (6, 6), (9, 16), (7.5, 16), (3, 2)], 16, (70, 66, 66), "metal").rotated("y", -90)
    engines = [bell.moved(-90, y, z) for y, z in ((0, 8), (9, -6), (-9, -6))]
    return Parts(body, Parts(half, pods.moved(0, wide * 0.32, wide * 0.42)).both_sides(), fin, engines)
