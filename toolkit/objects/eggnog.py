"""The eggnog: a wide-necked glass bottle, open and full to the neck, with foam, nutmeg and a quill of cinnamon.

The rig knows no clear glass: where eggnog stands behind the wall its surface is eggnog with the gloss of glass, and
above the fill line and at the heel it is the pale green of thick glass. The label says the same in front and behind.
"""

from dataclasses import replace

import numpy as np

from toolkit.objects import eggnog_label as label
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Part, assemble, extrude, revolve, smooth_curve

SEGMENTS = 128
BODY_MM = 62.0
"""Radius of the straight wall, which reaches up to the shoulder: room for a sheet of 98 mm."""
RIM_MM = 226.0
FILL_MM = 216.0
"""Where the eggnog ends on the wall."""
GLASS_MM = 3.0
"""Thickness of the wall at the mouth."""
LABEL_FROM_MM, LABEL_TO_MM = 35.0, 95.0
TOP_MM = 270.0
"""The tip of the cinnamon."""


def build() -> Mesh:
    """Build the bottle standing on z = 0, label to +x and -x, 270 mm to the tip of the cinnamon."""
    outline = _outline()
    parts = [*_bottle(outline), _label(), _drink(outline), *_cinnamon(outline)]
    materials = {"glass": (0.1, 0.0), "paper": (0.45, 0.0), "foam": (0.55, 0.0), "cinnamon": (0.6, 0.0)}
    return assemble(parts, materials, atlas_px=2048)


def _outline() -> np.ndarray:
    """(n, 2) radius and height of the glass from the heel to below the rim."""
    corners = [(BODY_MM - 2.5, 2), (BODY_MM, 9), (BODY_MM, 60), (BODY_MM, 125), (54, 165), (46, 190), (45, 205)]
    curve = smooth_curve([*corners, (51, RIM_MM)], 80)
    split = np.searchsorted(curve[:, 1], FILL_MM)
    return np.insert(curve, split, [np.interp(FILL_MM, curve[:, 1], curve[:, 0]), FILL_MM], axis=0)


def _bottle(outline: np.ndarray) -> list[Part]:
    """Foot, filled wall below and above the label, and clear glass from the fill line over the rim and down inside."""
    height = outline[:, 1]
    lower = [*outline[height < LABEL_FROM_MM], (BODY_MM, LABEL_FROM_MM)]
    upper = [(BODY_MM, LABEL_TO_MM), *outline[(height > LABEL_TO_MM) & (height <= FILL_MM)]]
    clear = outline[height >= FILL_MM]
    foot = [(0, 3), (BODY_MM - 14, 3), (BODY_MM - 10, 0), (BODY_MM - 5.5, 0), (BODY_MM - 3.3, 0.8), tuple(lower[0])]
    turn = np.linspace(-0.5 * np.pi, 1.2 * np.pi, 22)
    mouth = clear[-1, 0]
    bead = np.stack([mouth - 1 + 2.4 * np.cos(turn), RIM_MM + 2.2 + 2.4 * np.sin(turn)], axis=1)
    inner = (clear[::-1] - [GLASS_MM, 0])[1:]
    return [
        revolve(foot, SEGMENTS, label.GLASS, "glass"),
        revolve(lower, SEGMENTS, label.paint_heel, "glass"),
        revolve(upper, SEGMENTS, label.paint_neck, "glass"),
        revolve([*clear, *bead, *inner], SEGMENTS, label.GLASS, "glass"),
    ]


def _label() -> Part:
    """Printed paper around the straight wall, in the wall's place: hidden glass below it would only cast shade."""
    low, high, paper = LABEL_FROM_MM, LABEL_TO_MM, BODY_MM + 0.3
    profile = [(BODY_MM, low), *[(paper, z) for z in np.linspace(low + 0.2, high - 0.2, 12)], (BODY_MM, high)]
    return revolve(profile, SEGMENTS, label.paint_label, "paper")


def _drink(outline: np.ndarray) -> Part:
    """The foamy surface a little below the rim, its chart the view from above."""
    wall = _inside(outline)
    radius = np.linspace(wall, 0, 16)
    ripple = 0.5 * np.cos(radius / wall * 9)
    height = FILL_MM + 2.2 * (1 - (radius / wall) ** 4) + ripple * (1 - (radius / wall) ** 4)
    part = revolve(np.stack([radius, height], axis=1).tolist(), SEGMENTS, label.paint_foam, "foam")
    flat = part.vertices[:, :2] - part.vertices[:, :2].min(axis=0)
    width, depth = flat.max(axis=0)
    return replace(part, corner_uv=flat[part.faces], chart_mm=(float(width), float(depth)))


def _inside(outline: np.ndarray) -> float:
    """Radius of the mouth at the fill line."""
    return float(np.interp(FILL_MM, outline[:, 1], outline[:, 0])) - GLASS_MM


def _cinnamon(outline: np.ndarray) -> list[Part]:
    """A quill rolled from both sides, that leans on the rim behind."""
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    groove = 1 - 0.55 * np.exp(-((np.cos(turn) / 0.3) ** 2)) * (np.sin(turn) > 0)
    section = np.stack([6.4 * np.cos(turn), 4.6 * np.sin(turn) * groove], axis=1)
    lean_deg, length, bearing_deg = 22.0, 85.0, 145.0
    bark, tip, end = extrude(section.tolist(), length, 0, label.paint_bark, "cinnamon")
    stick = [bark, tip.painted(label.paint_quill), end.painted(label.BARK)]
    stick = [part.rotated("z", 90).rotated("y", lean_deg).rotated("z", bearing_deg) for part in stick]
    lift = TOP_MM - max(float(part.vertices[:, 2].max()) for part in stick)
    lean = np.radians(lean_deg)
    at_rim = outline[-1, 0] - GLASS_MM - 2 - 4.6 / np.cos(lean)
    reach = at_rim - (RIM_MM - lift) * np.tan(lean)
    x, y = reach * np.cos(np.radians(bearing_deg)), reach * np.sin(np.radians(bearing_deg))
    return [part.moved(x, y, lift) for part in stick]
