"""The eggnog: a wide-necked glass bottle, open and full to the neck, with foam, nutmeg and a quill of cinnamon.

The rig knows no clear glass: where eggnog stands behind the wall its surface is eggnog with the gloss of glass, and
above the fill line and at the heel it is the pale green of thick glass. The label says the same in front and behind.
"""

from dataclasses import replace

import numpy as np
from PIL import Image

from toolkit.content.eggnog_art import Canvas, Colour, draw_holly, draw_mug
from toolkit.content.modelling import Part, assemble, extrude, revolve, smooth_curve
from toolkit.objects.mesh import Mesh

RED: Colour = (158, 20, 30)
DARK_RED: Colour = (98, 8, 18)
CREAM: Colour = (255, 244, 214)
GOLD: Colour = (222, 170, 72)
EGGNOG: Colour = (247, 231, 175)
FOAM: Colour = (252, 243, 212)
GLASS: Colour = (222, 230, 220)
BARK: Colour = (128, 72, 38)
NAME_AT = 0.3
"""Where on each half of the label the name stands, as a share of the half."""


def paint_label(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The label all round: the name in front and behind, a glass of eggnog on the right and left."""
    half = np.asarray(draw_half(width // 2, height, px_per_mm))
    band = np.concatenate([half, half], axis=1)
    # the names at the chart's middle, which faces the front, and at its ends
    return Image.fromarray(np.roll(band, -round(NAME_AT / 2 * band.shape[1]), axis=1))


def draw_half(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Half of the label: the name with holly, and a mug beside it."""
    canvas = Canvas(width, height, px_per_mm, RED)
    w, h = canvas.size_mm
    rng = np.random.default_rng(3)
    for x, y, radius in rng.uniform((0, 0, 0.25), (w, h, 0.8), (90, 3)):
        canvas.spot(x, y, radius, radius, (255, 250, 245), 0.8)
    for y, thick in ((0.0, 2.0), (3.4, 0.6), (h - 4.0, 0.6), (h - 2.0, 2.0)):
        canvas.fill(canvas.box(0, y, w, thick), GOLD)
    middle = NAME_AT * w
    _letter_name(canvas, middle, 0.42 * h, 23)
    canvas.text(middle, 0.73 * h, "RICH & CREAMY", 5.6, CREAM)
    for side, turn_deg in ((-1, -10), (1, 10)):
        draw_holly(canvas, middle + side * 37, 0.75 * h, 13, turn_deg)
    draw_mug(canvas, (NAME_AT + 0.5) * w, 0.54 * h, 0.72 * h)
    return canvas.image()


def _letter_name(canvas: Canvas, x: float, y: float, size: float) -> None:
    canvas.text(x + 0.05 * size, y + 0.05 * size, "Egg Nog", size, DARK_RED, "italic", DARK_RED, 0.09 * size)
    canvas.text(x, y, "Egg Nog", size, CREAM, "italic", DARK_RED, 0.05 * size)


def paint_heel(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Eggnog behind glass below the label, and the thick heel of bare glass."""
    canvas = Canvas(width, height, px_per_mm, EGGNOG)
    canvas.fill(np.clip((canvas.y - canvas.size_mm[1] + 7) / 2.5, 0, 1), GLASS, 0.85)
    return canvas.image()


def paint_neck(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Eggnog behind glass above the label: paler and full of bubbles where the foam floats."""
    canvas = Canvas(width, height, px_per_mm, EGGNOG)
    w = canvas.size_mm[0]
    edge = 15 + 1.2 * np.sin(canvas.x / w * 2 * np.pi * 5) + 0.7 * np.sin(canvas.x / w * 2 * np.pi * 13)
    canvas.fill(np.clip((edge - canvas.y) / 3, 0, 1), FOAM)
    rng = np.random.default_rng(4)
    for x, y, radius in rng.uniform((0, 1, 0.2), (w, 14, 0.7), (420, 3)):
        canvas.spot(x, y, radius, radius, (255, 252, 236) if radius > 0.4 else (236, 220, 172), 0.6)
    return canvas.image()


def paint_foam(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The drink from above: swirled foam, bubbles along the glass, and nutmeg grated over the middle."""
    canvas = Canvas(width, height, px_per_mm, FOAM)
    w, h = canvas.size_mm
    x, y = canvas.x - w / 2, canvas.y - h / 2
    distance = np.hypot(x, y) / (w / 2)
    swirl = 0.5 + 0.5 * np.sin(11 * distance + 2 * np.arctan2(y, x))
    canvas.fill(swirl, (248, 234, 190), 0.6)
    canvas.fill(np.clip((distance - 0.9) * 10, 0, 1), EGGNOG)
    rng = np.random.default_rng(6)
    for bearing, place, radius in rng.uniform((0, 0.86, 0.3), (2 * np.pi, 0.98, 1.0), (220, 3)):
        spot = w / 2 * (1 + place * np.cos(bearing)), h / 2 * (1 + place * np.sin(bearing))
        canvas.spot(*spot, radius, radius, (255, 251, 234), 0.7)
    for bearing, scatter, grain in zip(
        rng.uniform(0, 2 * np.pi, 900), np.abs(rng.normal(0, 0.42, 900)), rng.uniform(0.2, 0.75, 900), strict=True
    ):
        if scatter < 0.95:
            spot = w / 2 * (1 + scatter * np.cos(bearing)), h / 2 * (1 + scatter * np.sin(bearing))
            canvas.spot(*spot, grain * 1.3, grain, (int(rng.integers(115, 175)), 88, 44))
    return canvas.image()


def paint_bark(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Cinnamon bark, grained along the quill."""
    canvas = Canvas(width, height, px_per_mm, BARK)
    grain = np.sin(canvas.x * 2.9 + np.sin(canvas.y * 0.13) * 2) + 0.6 * np.sin(canvas.x * 7.7 + canvas.y * 0.21)
    canvas.fill(np.clip(0.5 + 0.35 * grain, 0, 1), (172, 104, 58), 0.7)
    return canvas.image()


def paint_quill(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The cut end of the quill: two curls of bark around their hollows."""
    canvas = Canvas(width, height, px_per_mm, (176, 112, 66))
    w, h = canvas.size_mm
    for x in (0.28 * w, 0.72 * w):
        for scale, colour in ((0.17, (84, 44, 22)), (0.1, (160, 98, 54)), (0.05, (70, 34, 16))):
            canvas.fill(canvas.ellipse(x, h / 2, scale * w, scale * w), colour)
    return canvas.image()


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
        revolve(foot, SEGMENTS, GLASS, "glass"),
        revolve(lower, SEGMENTS, paint_heel, "glass"),
        revolve(upper, SEGMENTS, paint_neck, "glass"),
        revolve([*clear, *bead, *inner], SEGMENTS, GLASS, "glass"),
    ]


def _label() -> Part:
    """Printed paper around the straight wall, in the wall's place: hidden glass below it would only cast shade."""
    low, high, paper = LABEL_FROM_MM, LABEL_TO_MM, BODY_MM + 0.3
    profile = [(BODY_MM, low), *[(paper, z) for z in np.linspace(low + 0.2, high - 0.2, 12)], (BODY_MM, high)]
    return revolve(profile, SEGMENTS, paint_label, "paper")


def _drink(outline: np.ndarray) -> Part:
    """The foamy surface a little below the rim, its chart the view from above."""
    wall = _inside(outline)
    radius = np.linspace(wall, 0, 16)
    ripple = 0.5 * np.cos(radius / wall * 9)
    height = FILL_MM + 2.2 * (1 - (radius / wall) ** 4) + ripple * (1 - (radius / wall) ** 4)
    part = revolve(np.stack([radius, height], axis=1).tolist(), SEGMENTS, paint_foam, "foam")
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
    bark, tip, end = extrude(section.tolist(), length, 0, paint_bark, "cinnamon")
    stick = [bark, tip.painted(paint_quill), end.painted(BARK)]
    stick = [part.rotated("z", 90).rotated("y", lean_deg).rotated("z", bearing_deg) for part in stick]
    lift = TOP_MM - max(float(part.vertices[:, 2].max()) for part in stick)
    lean = np.radians(lean_deg)
    at_rim = outline[-1, 0] - GLASS_MM - 2 - 4.6 / np.cos(lean)
    reach = at_rim - (RIM_MM - lift) * np.tan(lean)
    x, y = reach * np.cos(np.radians(bearing_deg)), reach * np.sin(np.radians(bearing_deg))
    return [part.moved(x, y, lift) for part in stick]
