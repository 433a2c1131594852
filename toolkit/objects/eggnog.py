"""The eggnog: a half-gallon gable-top carton, printed all round, with a crimped fin and a screw cap at the rear."""

import numpy as np

from toolkit.objects import eggnog_label as label
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Part, assemble, extrude, fan, plate, revolve, surface

HALF_MM = 49.0
"""Half the side of the square base."""
WALL_MM = 205.0
RISE_MM = 45.0
FIN_MM = 20.0
FIN_HALF_THICKNESS_MM = 1.5
RIDGE_MM = WALL_MM + RISE_MM
LINING_MM = 1.4
"""How far below the ridge the folded-in gable ends meet."""
CAP_RADIUS_MM = 17.0


def build() -> Mesh:
    """Build the carton: front panel to +x, ridge along y, standing on z = 0, 270 mm tall."""
    slope = _slope()
    parts = [
        *_walls(),
        slope.painted(label.paint_roof),
        slope.rotated("z", 180).painted(label.paint_rear_roof),
        *_gable_end(),
        *[part.rotated("z", 180) for part in _gable_end()],
        *_fin(),
        *_cap(),
    ]
    return assemble(parts, {"carton": (0.38, 0.0), "plastic": (0.3, 0.0)}, atlas_px=2048)


def _walls() -> list[Part]:
    """The four printed panels in one band, a little bellied as a full carton is, and the bottom."""
    heights = np.r_[0.0, 0.6, 1.6, np.linspace(5, WALL_MM - 3, 26), WALL_MM]
    rings = []
    for z in heights:
        inset = 1.6 * (1 - z / 1.6) if z < 1.6 else 0.0
        radius = 2.2 if z < WALL_MM - 10 else 0.2 + 2.0 * (WALL_MM - z) / 10  # the corners sharpen at the roof's folds
        belly = 1.5 * np.sin(np.pi * z / WALL_MM)
        rings.append(_ring(HALF_MM - inset, radius, belly, z))
    wall = surface(np.stack(rings), label.paint_walls, "carton")
    return [wall, fan(rings[0][:-1][::-1], label.BOARD, "carton")]


def _ring(half: float, radius: float, belly: float, z: float) -> np.ndarray:
    """A rounded square, counter-clockwise from above, from the front panel's right-hand (-y) end; closed."""
    along = np.linspace(-(half - radius), half - radius, 19)
    side = np.stack([half + belly * np.cos(along / half * np.pi / 2) ** 2, along], axis=1)
    arc = np.radians(np.linspace(0, 90, 7)[1:-1])
    corner = np.stack([half - radius + radius * np.cos(arc), half - radius + radius * np.sin(arc)], axis=1)
    quarter = np.concatenate([side, corner])
    turns = [np.array([[c, s], [-s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    ring = np.concatenate([quarter @ turn for turn in turns])
    ring = np.concatenate([ring, ring[:1]])
    return np.c_[ring, np.full(len(ring), z)]


def _slope() -> Part:
    """The front half of the roof, from the eave to the fin."""
    eave = np.array([HALF_MM, 0.0, WALL_MM])
    ridge = np.array([FIN_HALF_THICKNESS_MM, 0.0, RIDGE_MM])
    across = np.linspace(-HALF_MM, HALF_MM, 17)
    rows = []
    for t in np.linspace(0, 1, 13):
        dent = 0.9 * np.sin(np.pi * t) * np.cos(across / HALF_MM * np.pi / 2)  # board springs out between folds
        row = (1 - t) * eave + t * ridge + np.outer(dent, [0.68, 0, 0.73])
        row[:, 1] = across
        rows.append(row)
    return surface(np.stack(rows), label.RED, "carton")


def _gable_end() -> list[Part]:
    """The left end under the roof: the triangle folded inwards, its two flaps, and the roof board's cut edges."""
    inner, top = HALF_MM - 0.8, RIDGE_MM - LINING_MM
    apex = np.array([0.0, 3.0, top])
    peak = np.array([0.0, HALF_MM, top])
    front, rear = np.array([inner, HALF_MM, WALL_MM]), np.array([-inner, HALF_MM, WALL_MM])
    outer_front, outer_rear = np.array([HALF_MM, HALF_MM, WALL_MM]), np.array([-HALF_MM, HALF_MM, WALL_MM])
    ridge_front = np.array([FIN_HALF_THICKNESS_MM, HALF_MM, RIDGE_MM])
    ridge_rear = ridge_front * [-1, 1, 1]
    return [
        plate(np.stack([front, rear, apex]), label.paint_gable, "carton"),
        plate(np.stack([front, apex, peak]), label.RED, "carton"),
        plate(np.stack([rear, peak, apex]), label.RED, "carton"),
        plate(np.stack([outer_front, front, peak, ridge_front]), label.BOARD, "carton"),
        plate(np.stack([rear, outer_rear, ridge_rear, peak]), label.BOARD, "carton"),
    ]


def _fin() -> list[Part]:
    """The sealed top: four layers of board pressed together by a crimping jaw."""
    heights = np.r_[RIDGE_MM - LINING_MM, RIDGE_MM + 2, np.linspace(RIDGE_MM + 3, RIDGE_MM + FIN_MM - 3, 29)]
    crimp = np.where(heights > RIDGE_MM + 2.5, 0.4 * np.sin(np.pi * (heights - RIDGE_MM + 0.25)), 0.0)
    half = FIN_HALF_THICKNESS_MM + crimp
    top = RIDGE_MM + FIN_MM
    crest = [(FIN_HALF_THICKNESS_MM, top - 0.6), (FIN_HALF_THICKNESS_MM - 0.6, top)]
    face = np.array([*zip(half, heights, strict=True), *crest])
    ends = (-HALF_MM, HALF_MM)
    front = np.stack([[(x, y, z) for y in ends] for x, z in face])
    rear = front[:, ::-1] * [-1, 1, 1]
    outline = np.concatenate([face, face[::-1] * [-1, 1]])
    left = np.stack([outline[:, 0], np.full(len(outline), HALF_MM), outline[:, 1]], axis=1)
    crown = np.stack([front[-1], rear[-1][::-1]])
    return [
        surface(front, label.paint_fin, "carton"),
        surface(rear, label.paint_fin, "carton"),
        surface(crown, label.BOARD, "carton"),
        plate(left[::-1], label.BOARD, "carton"),
        plate(left * [1, -1, 1], label.BOARD, "carton"),
    ]


def _cap() -> list[Part]:
    """A ribbed screw cap on its flange, square to the rear slope."""
    turn = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    ribbed = CAP_RADIUS_MM + 0.45 * np.clip(2.2 * np.sin(40 * turn), -1, 1)
    outline = np.stack([ribbed * np.cos(turn), ribbed * np.sin(turn)], axis=1)
    side = extrude(outline.tolist(), 12, 0, label.CAP, "plastic")[0]
    crown = revolve([(CAP_RADIUS_MM + 0.5, 12), (CAP_RADIUS_MM - 0.6, 13.6), (CAP_RADIUS_MM - 2.5, 14), (0, 14)], 96)
    flange = revolve([(22, -0.5), (22, 1.2), (20.5, 2.2), (16, 2.4), (16, 3)], 72, label.CAP_FLANGE, "plastic")
    parts = [side.moved(z=2.4), crown.painted(label.CAP, "plastic").moved(z=2.4), flange]
    pitch = float(np.degrees(np.arctan2(RISE_MM, HALF_MM - FIN_HALF_THICKNESS_MM)))
    middle = -(HALF_MM + FIN_HALF_THICKNESS_MM) / 2
    return [part.rotated("y", -pitch).moved(x=middle - 0.3, z=WALL_MM + RISE_MM / 2 + 0.5) for part in parts]
