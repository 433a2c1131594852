"""The coffeepot: tall and tapering, in speckled blue enamel, with a swan-neck spout, a looped handle and a hinged lid.

Its front is its profile, as people photograph a pot: spout to the left, handle to the right. The lid is flat and its
thumb lift stands over the handle, so that a printed sheet can be taped on top.
"""

from collections.abc import Callable

import numpy as np
from PIL import Image

from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content.drawing import Colour
from toolkit.rooms.worlds.content.modelling import (
    Parts,
    assemble,
    extrude,
    revolve,
    seen_from_above,
    smooth_curve,
    surface,
    tube,
)

NAVY: Colour = (24, 40, 84)
CREAM_SPECKS: Colour = (226, 232, 240)
TRIM: Colour = (14, 15, 20)


def enamel_paint(ground: Colour, specks: Colour, seed: int) -> Callable[[int, int, float], Image.Image]:
    """Paint for a chart: the ground strewn with irregular specks of about a millimetre, the same for the same seed."""

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        from scipy.ndimage import gaussian_filter

        # white noise, blurred to the size of a speck and without a seam
        noise = gaussian_filter(
            np.random.default_rng(seed).standard_normal((height, width)), 0.45 * px_per_mm, mode="wrap"
        )
        # only the highest peaks become specks, with a soft edge
        weight = np.clip((noise / max(float(noise.std()), 1e-9) - 1.75) * 4, 0, 1)[..., None]
        colour = np.array(ground) * (1 - weight) + np.array(specks) * weight
        return Image.fromarray(colour.round().astype(np.uint8))

    return paint


BASE_RADIUS_MM = 72.5
TOP_RADIUS_MM = 46.5
HEIGHT_MM = 211.0
"""Height of the body without the lid, mm."""
LID_RADIUS_MM = TOP_RADIUS_MM + 1.5
LID_MM = HEIGHT_MM + 4.8
"""Height of the lid on the rolled rim."""
SEGMENTS = 96


def build() -> Mesh:
    """Build the coffeepot on z = 0, 270 mm from spout to handle: spout to -y, handle to +y."""
    parts = Parts(_body(), _lid(), _hinge(), _spout(), _handle())
    materials = {"enamel": (0.2, 0.0), "trim": (0.25, 0.0)}
    return assemble(parts.rotated("z", -90), materials, atlas_px=2048)


def _body() -> Parts:
    # wall of the pot, its narrow foot, and a rim that is rolled over
    wall = [(BASE_RADIUS_MM - 3, 1.2), (BASE_RADIUS_MM - 0.6, 3), (BASE_RADIUS_MM, 6)]
    wall += [(_wall_radius(z), z) for z in np.linspace(12, HEIGHT_MM, 40)]
    foot_out, foot_in = BASE_RADIUS_MM - 3, BASE_RADIUS_MM - 8
    foot = [(0, 3), (foot_in - 1, 3), (foot_in, 0), (foot_out, 0), (foot_out + 0.8, 0.5), (foot_out, 1.2)]
    turn = np.linspace(0, np.pi, 12)
    roll = np.stack([TOP_RADIUS_MM + 0.8 + 2.6 * np.sin(turn), HEIGHT_MM + 2.2 - 2.6 * np.cos(turn)], axis=1)
    rim = [(TOP_RADIUS_MM - 2, HEIGHT_MM - 1), *roll, (TOP_RADIUS_MM - 4, LID_MM)]
    return Parts(
        revolve(wall, SEGMENTS, enamel_paint(NAVY, CREAM_SPECKS, seed=1), "enamel"),
        revolve(foot, SEGMENTS, TRIM, "trim"), revolve(rim, SEGMENTS, TRIM, "trim"),
    )  # fmt: skip


def _wall_radius(z: float) -> float:
    return BASE_RADIUS_MM + (TOP_RADIUS_MM - BASE_RADIUS_MM) * (z - 6) / (HEIGHT_MM - 6)


def _lid() -> Parts:
    r = LID_RADIUS_MM
    # the lid lies on the rim: its edge, a crown that rises to the middle, and the curve between
    edge = np.array([(r - 4, -0.2), (r - 0.8, 0), (r + 1, 1.4), (r + 1, 2.6), (r - 0.6, 3.8), (r - 2.5, 4.2)])
    flat = np.linspace(r - 7, 0, 12)
    crown = np.stack([flat, 7.6 + 2.5 * (1 - (flat / (r - 7)) ** 2)], axis=1)
    top = np.concatenate([[(r - 2.5, 4.2), (r - 4, 6.2), (r - 6, 7.4)], crown])
    on_rim = np.array([0, LID_MM])
    cover = revolve((top + on_rim).tolist(), SEGMENTS, enamel_paint(NAVY, CREAM_SPECKS, seed=2), "enamel")
    return Parts(revolve((edge + on_rim).tolist(), SEGMENTS, TRIM, "trim"), seen_from_above(cover))


def _hinge() -> Parts:
    """The hinge's barrel over the handle and the leaf that a thumb presses to lift the lid."""
    x, z = -LID_RADIUS_MM - 3.5, LID_MM + 3.0
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    barrel = extrude(np.stack([4.0 * np.cos(turn), 4.0 * np.sin(turn)], axis=1).tolist(), 26, 0.8, TRIM, "trim")
    leaf = smooth_curve([(x + 7, 0, z + 2), (x - 1, 0, z + 4), (x - 4, 0, z + 12), (x - 12, 0, z + 20)], 24, False)
    # thicker and wider where the thumb presses
    thickness = np.interp(np.linspace(0, 1, 24), [0, 0.3, 0.85, 0.96, 1], [2.2, 2.2, 2.6, 2.2, 1.2])
    widen = np.interp(np.linspace(0, 1, 24), [0, 0.4, 0.8, 1], [3.0, 2.2, 4.2, 3.2])
    return Parts(barrel.rotated("x", 90).moved(x, 13, z), _strap(leaf, thickness, thickness * widen))


def _spout() -> Parts:
    """A swan-neck that leaves the wall low and wide and ends level with the rim, cut nearly flat, open and hollow."""
    root = _wall_radius(67)
    # middles of the pipe from inside the wall to the mouth, x outwards and z up, millimetres
    points = [(root - 16, 0, 67), (root + 12, 0, 80), (root + 32, 0, 114), (root + 43, 0, 155), (root + 69, 0, 204)]
    path = smooth_curve(points, 44, monotone=False)
    t = np.linspace(0, 1, len(path))
    stops = [0, 0.12, 0.3, 0.6, 0.9, 1]
    # half height and half width of the pipe along it: an oval that narrows
    tall, wide = np.interp(t, stops, [38, 31, 21, 14.5, 12, 13.4]), np.interp(t, stops, [25, 22, 17, 12.5, 10.5, 11])
    tangent = np.gradient(path, axis=0)
    turn = np.unwrap(np.arctan2(tangent[:, 2], tangent[:, 0])) + np.pi / 2
    # the sections stand across the pipe, but lie along the wall at the root and level at the mouth
    at_root, at_mouth = np.clip(1 - t / 0.25, 0, 1) ** 2, np.clip((t - 0.75) / 0.25, 0, 1) ** 2
    turn = turn * (1 - at_root - at_mouth) + np.radians(97) * at_root + np.radians(172) * at_mouth
    angle = np.linspace(0, 2 * np.pi, 37)

    def cut(i: int, shrink: float, forward: float = 0.0) -> np.ndarray:
        up = np.array([np.cos(turn[i]), 0, np.sin(turn[i])])
        ahead = np.array([up[2], 0, -up[0]])
        ring = np.outer((tall[i] - shrink) * np.sin(angle), up)
        ring[:, 1] += (wide[i] - shrink) * np.cos(angle)
        return path[i] + forward * ahead + ring

    last = len(path) - 1
    # a rounded lip that turns over the mouth, from outside to inside
    lip = [cut(last, 1.1 - 1.9 * np.cos(a), 1.9 * np.sin(a)) for a in np.linspace(-0.5, np.pi + 0.5, 12)]
    return Parts(
        surface(np.stack([cut(i, 0) for i in range(len(path))]), enamel_paint(NAVY, CREAM_SPECKS, seed=3), "enamel"),
        surface(np.stack(lip), TRIM, "trim"),
        # the inside, as far as it is seen through the mouth
        surface(np.stack([cut(i, 2.2) for i in range(last, last - 15, -1)]), TRIM, "trim"),
    )


def _handle() -> Parts:
    """A black loop as broad as a hand, flared where it is welded to the wall."""
    top, base = -TOP_RADIUS_MM, -BASE_RADIUS_MM
    path = smooth_curve(
        [(top + 5, 0, 198), (top - 23, 0, 207), (top - 55, 0, 194), (top - 70, 0, 152), (top - 59, 0, 105),
         (base - 1, 0, 66), (base + 20, 0, 52)],
        64, monotone=False,
    )  # fmt: skip
    t = np.linspace(0, 1, len(path))
    # wider at both ends, where it is welded on
    radius = 6.6 + 3.0 * np.exp(-((t / 0.07) ** 2)) + 4.0 * np.exp(-(((1 - t) / 0.12) ** 2))
    return _strap(path, radius, radius * 1.5)


def _strap(path: np.ndarray, thick: np.ndarray, wide: np.ndarray) -> Parts:
    """A pipe along a path in the x-z plane, `wide` along y."""

    def widen(points: np.ndarray) -> np.ndarray:
        # each vertex takes the factor of the place on the path that it lies next to
        away = np.linalg.norm(points[:, None, [0, 2]] - path[None, :, [0, 2]], axis=2)
        return points * np.insert(np.ones((len(points), 2)), 1, (wide / thick)[np.argmin(away, axis=1)], axis=1)

    return tube(path, thick, 24, TRIM, "trim").bent(widen)
