"""An open-wheel racing car in the manner of a die-cast toy: 270 mm long, nose to +x."""

from collections.abc import Sequence

import numpy as np

from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content import liveries as livery
from toolkit.rooms.worlds.content.liveries import BLACK, CARBON, NAVY, RED, RUBBER, WHITE, YELLOW, panel
from toolkit.rooms.worlds.content.modelling import (
    Parts,
    assemble,
    bend_circle,
    box,
    curve,
    extrude,
    fan,
    loft,
    revolve,
    slab,
    smooth_curve,
    superellipse,
    surface,
    tube,
)

MATERIALS = {
    "paint": (0.25, 0.0), "rubber": (0.85, 0.0), "metal": (0.35, 0.6), "glass": (0.08, 0.0), "carbon": (0.45, 0.0),
}  # fmt: skip
METAL, RIM, GLASS, INSIDE = (190, 192, 196), (204, 205, 210), (24, 27, 34), (20, 20, 22)
REAR_AXLE = -97.0
WHEELS = ((78.0, 56.0, 22.5, 20.0), (REAR_AXLE, 52.0, 27.0, 28.0))
"""Front and rear wheels, millimetres: x of the axle, y of the middle, radius and width of the tyre."""

TUB = curve([  # x, width, lowest z, highest z, superellipse power
    (135, 7, 9.5, 13.5, 2.2), (132, 15, 8.2, 16, 2.3), (122, 23, 7.5, 20, 2.6), (105, 31, 7, 25, 3.0),
    (88, 36, 6, 29, 3.2), (72, 42, 5, 33, 3.4), (56, 48, 5, 37.5, 3.6), (38, 54, 5, 41, 4.2), (24, 57, 5, 42, 5.0),
    (-25, 58, 5, 42, 5.0), (-64, 56, 5, 42, 5.0), (-76, 48, 6, 40, 4.2), (-92, 36, 8, 34, 3.6), (-106, 26, 11, 29, 3.2),
])  # fmt: skip
POD = [  # x, inner y, outer y, lowest z, highest z, superellipse power
    (-76, 18, 31, 7, 35, 3.2), (-71, 18, 36, 6, 38, 4), (-58, 18, 47, 5, 40.7, 5), (-44, 18, 50, 5, 41.2, 5.5),
    (0, 18, 50, 5, 41.2, 5.5), (22, 18, 48.5, 5, 39.8, 5), (31, 19, 47, 6, 38, 4.5), (34, 20, 46, 7, 37, 4.2),
]  # fmt: skip
COCKPIT_X, COCKPIT_LENGTH, COCKPIT_HALF_WIDTH = 60.0, 38.0, 14.5


def build() -> Mesh:
    """The car with its livery; z = 0 is the table under the tyres."""
    body = Parts(_tub(), _sidepods(), _floor(), _cockpit(), _driver(), _headrest(), _mirrors())
    parts = Parts(body, _gearbox(), _suspension(), _wheels(), _front_wing(), _rear_wing())
    return assemble(parts, MATERIALS, atlas_px=2048)


def _tub() -> Parts:
    ends = COCKPIT_X + COCKPIT_LENGTH / 2 * np.cos(np.linspace(0, np.pi, 25))
    stations = np.unique(np.r_[np.linspace(-106, 130, 66), np.linspace(130, 135, 7), ends])
    net = np.stack([_tub_section(x) for x in stations])
    return Parts(
        panel(net, livery.paint_body), fan(net[-1, :-1], livery.TRIM), fan(net[0, :-1][::-1], CARBON, "carbon")
    )


def _closed(sections: list[np.ndarray] | tuple[np.ndarray, ...]) -> np.ndarray:
    """A net of closed sections, their first points repeated."""
    return np.stack([np.concatenate([section, section[:1]]) for section in sections])


def _tub_section(x: float, count: int = 65) -> np.ndarray:
    """From the opening's right rim round below to its left rim; without an opening both meet on the centre line."""
    width, low, high, power = TUB(x)
    # half the width of the cockpit's opening at x
    along = abs(x - COCKPIT_X) / (COCKPIT_LENGTH / 2)
    opening = COCKPIT_HALF_WIDTH * float(np.sqrt(max(0.0, 1 - along**2.6)))
    rim = np.arccos(min(1.0, (2 * opening / width) ** (power / 2)))
    angle = np.linspace(np.pi - rim, 2 * np.pi + rim, count)
    across, up = bend_circle(angle, power)
    y, z = across * width / 2, (low + high) / 2 + up * (high - low) / 2
    return np.stack([np.full(count, x), y, z], axis=1)


def _cockpit() -> Parts:
    # the left rim of the opening from back to front
    stations = COCKPIT_X - COCKPIT_LENGTH / 2 * np.cos(np.linspace(0, np.pi, 40))
    # stations close together at both ends, where the opening is round
    left = np.array([_tub_section(x)[-1] for x in stations])
    right = left * [1, -1, 1]
    across = np.linspace(-1, 1, 17)
    # deepest in the middle, with steep walls
    depth = 20 * left[:, 1:2] / COCKPIT_HALF_WIDTH * (1 - across**4)
    well = np.stack([np.broadcast_to(left[:, :1], depth.shape), across * left[:, 1:2], left[:, 2:] - depth], axis=2)
    # the steering wheel
    steering = 6.2 * np.array([(np.cos(a), np.sin(a), 0) for a in np.linspace(0, 2 * np.pi, 25)])
    return Parts(
        surface(well, INSIDE, "carbon").flipped(),  # seen from above
        tube(np.concatenate([left, right[::-1][1:]]), 0.9, 8, BLACK, "carbon"),
        _windscreen(left[left[:, 0] >= COCKPIT_X - 2]),
        tube(steering, 0.9, 8, BLACK, "rubber").rotated("y", -62).moved(70, 0, 34),
    )


def _windscreen(left: np.ndarray) -> Parts:
    foot = np.concatenate([left, (left * [1, -1, 1])[::-1][1:]])
    rise = np.sin(np.linspace(0, np.pi, len(foot)))[:, None] ** 0.6
    top = foot + np.array([-6.0, 0, 8.5]) * rise
    outside, inside = np.array([0.3, 0, 0]), np.array([-0.5, 0, 0])
    skins = foot + outside, top + outside, top + inside, foot + inside
    return loft([np.stack(row) for row in zip(*skins, strict=True)], GLASS, "glass").outward()


def _driver() -> Parts:
    at = (54.5, 0, 49)
    shell = _bulb(np.linspace(-90, 90, 25), np.linspace(0, 360, 41))
    visor = _bulb(np.linspace(-16, 18, 7), np.linspace(-72, 72, 25)) * [1.05, 1.05, 1]
    shoulders = loft(
        [superellipse(w, h, 2.4, 24, x, 0, 34) for x, w, h in [(46, 14, 6), (50, 24, 12), (56, 25, 13), (63, 16, 6)]],
        RED, "carbon",
    )  # fmt: skip
    return Parts(panel(shell, livery.paint_helmet).moved(*at), surface(visor, GLASS, "glass").moved(*at), shoulders)


def _bulb(tilts_deg: np.ndarray, azimuths_deg: np.ndarray) -> np.ndarray:
    """A net on the helmet, which is a little longer to the front and the back than a ball."""
    tilt, angle = np.radians(tilts_deg)[:, None], np.radians(azimuths_deg)
    x = np.cos(tilt) * np.cos(angle) * 10.8 + 0.8 * np.cos(tilt) * np.cos(angle) ** 2
    return np.stack([x, np.cos(tilt) * np.sin(angle) * 9.2, np.broadcast_to(np.sin(tilt) * 10.2, x.shape)], axis=2)


def _headrest() -> Parts:
    table = [  # x, width, highest z, power
        (45, 25, 63, 3), (43.5, 27, 65, 3), (39, 24, 64.5, 2.8), (34, 17, 57, 2.5), (28, 8, 42.5, 2.2),
    ]  # fmt: skip
    stations = np.linspace(28, 45, 16)
    rows = zip(stations, curve(table)(stations), strict=True)
    sections = [superellipse(width, high - 37, power, 40, x, 0, (high + 37) / 2) for x, (width, high, power) in rows]
    arch = [(42, y, 39 + 28.5 * (1 - abs(y / 13) ** 3.2)) for y in np.linspace(-13, 13, 25)]
    return Parts(
        panel(_closed(sections), livery.paint_body), fan(sections[-1], BLACK, "carbon"), fan(sections[0][::-1], WHITE),
        tube(np.array(arch), 1.3, 10, METAL, "metal"),
    )  # fmt: skip


def _sidepods() -> Parts:
    # sections from the back to the inlet
    stations = np.linspace(POD[0][0], POD[-1][0], 40)
    parts = Parts()
    for side in (1, -1):
        sections = [
            superellipse(outer - inner, high - low, power, 48, x, side * (inner + outer) / 2, (low + high) / 2)
            for x, (inner, outer, low, high, power) in zip(stations, curve(POD)(stations), strict=True)
        ]
        # the inlet: a white lip round the mouth, and a dark throat behind it
        mouth, centre = sections[-1], sections[-1].mean(axis=0)
        lip, round_lip = (centre + (mouth - centre) * scale + [x, 0, 0] for scale, x in ((0.86, 0), (0.93, 1)))
        throat = centre + (mouth - centre) * 0.78 - [16, 0, 0]
        parts += Parts(
            panel(_closed(sections), livery.paint_body), surface(_closed([mouth, round_lip, lip]), WHITE),
            surface(_closed([lip, throat]), INSIDE, "carbon"),
            fan(throat, INSIDE, "carbon"), fan(sections[0][::-1], CARBON, "carbon"),
        )  # fmt: skip
        for y in (24, 29, 34, 39, 44):  # the radiator's grille
            parts += tube(np.array([(23, side * y, 8), (23, side * y, 37)]), 0.6, 6, METAL, "metal")
    return parts


def _floor() -> Parts:
    half = np.array([(-112, 30), (-74, 34), (-58, 50), (34, 50), (64, 22)])
    outline = np.concatenate([half * [1, -1], half[::-1]])
    return extrude(outline.tolist(), 3, 0.6, CARBON, "carbon").moved(z=3)


def _gearbox() -> Parts:
    rings = [(-122, 11, 12), (-119, 15, 16), (-108, 19, 19), (-100, 22, 20)]
    case = loft([superellipse(width, height, 3, 24, x, 0, 19) for x, width, height in rings], METAL, "metal")
    light = box((3, 7, 5), 0.8, (230, 30, 30), "glass").moved(-123, 0, 19)
    pipes = Parts()
    for side in (1, -1):
        bends = np.array([(-84, 14, 30), (-98, 14, 33), (-112, 11, 35), (-122, 11, 36)]) * [1, side, 1]
        pipes += tube(smooth_curve(bends.tolist(), 14), 2.6, 14, (150, 140, 132), "metal")
        pipes += tube(np.array([(-122.1, side * 11, 36), (-122.4, side * 11, 36)]), 2.0, 14, BLACK, "carbon")
    return Parts(case, light, pipes)


def _airfoil(chord: float, thickness: float, camber: float, count: int = 14) -> np.ndarray:
    """A wing section (2 count - 2, 2) of (x, z) from a leading edge at the origin to x = -chord, hollow above."""
    t = (1 - np.cos(np.linspace(0, np.pi, count))) / 2
    half = thickness * (2.6 * np.sqrt(t) * (1 - t) + 0.12) / 2
    middle = -camber * 4 * t * (1 - t)
    upper, lower = np.stack([-chord * t, middle + half], 1), np.stack([-chord * t, middle - half], 1)
    return np.concatenate([lower, upper[::-1][:-1]])


def _wing(section: np.ndarray, span: float, pitch_deg: float, at: tuple[float, float], look: livery.Look) -> Parts:
    """A wing of constant section, its trailing edge raised by the pitch, leading edge at (x, z)."""
    cosine, sine = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    z = -section[:, 0] * sine + section[:, 1] * cosine + at[1]
    x = section[:, 0] * cosine + section[:, 1] * sine + at[0]
    stations = np.linspace(-span / 2, span / 2, 13)
    sections = [np.stack([x, np.full(len(x), y), z], 1) for y in stations]
    caps = [fan(sections[-1], RED), fan(sections[0][::-1], RED)]
    return Parts(panel(_closed(sections), look), caps)


def _end_plate(outline: Sequence[tuple[float, float]], y: float, paint: livery.Paint) -> Parts:
    """A white-edged fin, see `slab`."""
    wall, *faces = slab(outline, 1.6, paint, "paint", y, 0.4)
    return Parts(wall.painted(WHITE), *faces)


def _front_wing() -> Parts:
    look = livery.paint_wing(NAVY, "VELOX          VELOX", 125, 8, 120, from_behind=False)
    main = _wing(_airfoil(22, 3.2, 1.4), 125, 6, (131, 9), look)
    flap = _wing(_airfoil(9, 1.8, 0.7), 125, 24, (112, 13), livery.paint_plain)
    plates = Parts()
    outline = [(103, 4), (133, 4), (134, 9), (128, 17), (115, 24), (103, 24)]
    for side in (1, -1):
        plates += _end_plate(outline, side * 63.2, RED)
    return Parts(main, flap, plates)


def _rear_wing() -> Parts:
    look = livery.paint_wing(NAVY, "VELOX", 92, 13, -117, from_behind=True)
    main = _wing(_airfoil(25, 4.2, 2.2), 92, 10, (-104, 68), look)
    flap = _wing(_airfoil(12, 2.4, 1.0), 92, 34, (-125.5, 75.5), livery.paint_plain)
    outline = [(-135, 56), (-112, 54.5), (-101, 62), (-100, 72), (-106, 80), (-118, 85), (-135, 86)]
    plates, posts = Parts(), Parts()
    for side in (1, -1):
        plates += _end_plate(outline, side * 46.5, livery.paint_lettering(RED, livery.NUMBER, WHITE, 17))
        posts += _end_plate([(-120, 24), (-107, 24), (-108, 68), (-119, 70)], side * 5, CARBON)
    return Parts(main, flap, plates, posts.painted(CARBON, "carbon"))


def _mirrors() -> Parts:
    parts = Parts()
    for side in (1, -1):
        rings = [(60, 9, 6), (62, 9, 6), (65, 6, 4), (66, 2, 1.5)]
        shell = loft([superellipse(width, height, 3, 20, x, side * 29, 45) for x, width, height in rings], RED)
        glass = fan(superellipse(8, 5, 3, 20, 59.9, side * 29, 45)[::-1], (150, 170, 190), "metal")
        stalk = tube(np.array([(63, side * 27, 44), (65, side * 20, 32)]), 0.8, 8, BLACK, "carbon")
        parts += Parts(shell, glass, stalk)
    return parts


def _suspension() -> Parts:
    bars = Parts()
    # both sides, mirrored
    for side in (1, -1):
        # front wishbones, push rods and track rods, from the tub to the wheel
        front = [
            ((91, 15, 25), (79, 46, 31)), ((66, 18, 28), (77, 46, 31)), ((92, 15, 11), (79, 46, 14)),
            ((64, 19, 10), (77, 46, 14)), ((82, 14, 27), (78, 46, 15)), ((71, 16, 19), (71, 46, 21)),
        ]  # fmt: skip
        rear = [
            ((-80, 20, 33), (-96, 40, 36)), ((-111, 8, 27), (-98, 40, 36)), ((-78, 22, 12), (-96, 40, 15)),
            ((-113, 7, 13), (-98, 40, 15)), ((-93, 14, 33), (-97, 40, 16)),
        ]  # fmt: skip
        # thin rods of carbon, and the drive shaft of metal
        for radius, rods in ((1.1, front), (1.3, rear), (2.2, [((REAR_AXLE, 8, 22), (REAR_AXLE, 40, 27))])):
            for ends in rods:
                bars += tube(np.array(ends, float) * [1, side, 1], radius, 10, CARBON if radius < 2 else METAL, "metal")
    return bars


def _wheels() -> Parts:
    parts = Parts()
    for x, y, radius, width in WHEELS:
        wheel = _wheel(radius, width).rotated("x", -90)  # its outer face, +z, to +y
        parts += wheel.moved(x, y, radius)
        parts += wheel.rotated("z", 180).moved(x, -y, radius)
    return parts


def _wheel(radius: float, width: float) -> Parts:
    """A slick on a spoked rim about the z axis, outer face up."""
    h, rim = width / 2, radius * 0.64
    # tyre: tread, shoulder and lettered side wall; the inner side mirrors the outer one
    shoulder = smooth_curve([(radius, h - 3.4), (radius - 0.5, h - 1.6), (radius - 2, h - 0.4), (radius - 3.2, h)], 8)
    side = [*shoulder, (radius - 4.5, h + 0.25), (rim + 1.2, h - 0.2), (rim, h - 1.0)]
    lettering = livery.paint_lettering(RUBBER, "SLICKS · GRIPON", YELLOW, 3.4, 3)
    tread = revolve([(radius, -h + 3.4), (radius, h - 3.4)], 72, RUBBER, "rubber")
    outer = revolve(side, 72, lettering, "rubber")
    inner = revolve([(r, -z) for r, z in side[::-1]], 72, RUBBER, "rubber")
    barrel = revolve([(rim, h - 1.0), (rim - 1.2, h - 1.2), (rim - 1.6, h - 7), (rim - 2.2, h - 7)], 72, RIM, "metal")
    disc = revolve([(rim - 2.2, h - 7), (0, h - 7)], 48, BLACK, "carbon")
    back = revolve([(0, -h + 4), (rim, -h + 1)], 48, CARBON, "carbon")
    # spokes and hub before a dark disc
    spokes = Parts()
    for k in range(6):
        outline = [(1.5, -2.2), (rim - 1.4, -1.3), (rim - 1.4, 1.3), (1.5, 2.2)]
        spokes += extrude(outline, 3.6, 0.5, RIM, "metal").moved(z=h - 6.5).rotated("z", 60 * k)
    profile = [(4.6, h - 6.5), (4.4, h - 2.6), (3.2, h - 2), (2, h - 2), (1.9, h - 0.4), (0, h - 0.2)]
    hub = revolve(profile, 24, METAL, "metal")
    return Parts(tread, outer, inner, barrel, disc, back, spokes, hub)
