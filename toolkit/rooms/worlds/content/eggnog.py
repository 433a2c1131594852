"""The eggnog: a wide-necked glass bottle, open and full to the neck, with foam, nutmeg and a quill of cinnamon.

The rig knows no clear glass. A wall with eggnog behind it has eggnog's colour and the gloss of glass. Above the fill
line and at the heel it is the pale green of thick glass. The label says the same in front and behind.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw

from toolkit.imaging.plots import read_font
from toolkit.objects.mesh import Mesh
from toolkit.rooms.worlds.content.drawing import Colour
from toolkit.rooms.worlds.content.modelling import (
    Part,
    Parts,
    assemble,
    extrude,
    revolve,
    seen_from_above,
    smooth_curve,
)

RED, DARK_RED, CREAM, GOLD = (158, 20, 30), (98, 8, 18), (255, 244, 214), (222, 170, 72)
EGGNOG, FOAM, GLASS, BARK = (247, 231, 175), (252, 243, 212), (222, 230, 220), (128, 72, 38)
NAME_AT = 0.3
"""Place of the name on each half of the label, as a share of the half."""


class LabelCanvas:
    """An RGB picture, lengths in millimetres from its upper left corner; masks are (height, width) in [0, 1]."""

    def __init__(self, width_px: int, height_px: int, px_per_mm: float, colour: Colour):
        """A plain canvas of the colour."""
        self.scale = px_per_mm
        self.pixels = np.empty((height_px, width_px, 3), np.float32)
        self.pixels[:] = colour
        self.y, self.x = np.mgrid[:height_px, :width_px].astype(np.float32)
        self.x, self.y = (self.x + 0.5) / px_per_mm, (self.y + 0.5) / px_per_mm

    @property
    def size_mm(self) -> tuple[float, float]:
        """(width, height)."""
        return self.pixels.shape[1] / self.scale, self.pixels.shape[0] / self.scale

    def image(self) -> Image.Image:
        """The picture."""
        return Image.fromarray(self.pixels.clip(0, 255).astype(np.uint8))

    def fill(self, mask: np.ndarray, colour: ArrayLike, alpha: float = 1.0) -> None:
        """Blend a colour, or an array of them, over the mask."""
        weight = (mask * alpha)[..., None]
        self.pixels += (np.asarray(colour, np.float32) - self.pixels) * weight

    def ellipse(self, x: float, y: float, rx: float, ry: float, turn_deg: float = 0.0) -> np.ndarray:
        """Mask of a filled ellipse with a smooth edge, turned clockwise."""
        cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        reach = max(rx, ry)
        # only the pixels round it are worked out
        window = self._window(x - reach, y - reach, x + reach, y + reach)
        dx, dy = self.x[window] - x, self.y[window] - y
        distance = np.hypot((cosine * dx + sine * dy) / rx, (cosine * dy - sine * dx) / ry)
        mask = np.zeros(self.x.shape, np.float32)
        mask[window] = np.clip((1 - distance) * min(rx, ry) * self.scale + 0.5, 0, 1)
        return mask

    def box(self, x: float, y: float, width: float, height: float) -> np.ndarray:
        """Mask of an upright rectangle, (x, y) its upper left corner."""
        across = np.clip((self.x - x) * self.scale + 0.5, 0, 1) * np.clip((x + width - self.x) * self.scale + 0.5, 0, 1)
        down = np.clip((self.y - y) * self.scale + 0.5, 0, 1) * np.clip((y + height - self.y) * self.scale + 0.5, 0, 1)
        return across * down

    def polygon(self, points: Sequence[Sequence[float] | np.ndarray] | np.ndarray) -> np.ndarray:
        """Mask of a filled polygon with a smooth edge."""
        outline = np.asarray(points, float)
        rows, columns = window = self._window(*outline.min(axis=0), *outline.max(axis=0))
        mask = np.zeros(self.x.shape, np.float32)
        height, width = rows.stop - rows.start, columns.stop - columns.start
        # a polygon beside the label
        if height <= 0 or width <= 0:
            return mask
        # drawn three times as large and averaged: Pillow draws no smooth edges
        fine = 3
        drawn = Image.new("L", (width * fine, height * fine))
        corners = (outline * self.scale - [columns.start, rows.start]) * fine
        ImageDraw.Draw(drawn).polygon([tuple(corner) for corner in corners], fill=255)
        mask[window] = np.asarray(drawn.resize((width, height), Image.Resampling.BOX), np.float32) / 255
        return mask

    def spot(self, x: float, y: float, rx: float, ry: float, colour: Colour, alpha: float = 1.0) -> None:
        """Fill a small upright ellipse; quick, for snow and spice."""
        reach = max(rx, ry)
        window = self._window(x - reach, y - reach, x + reach, y + reach)
        distance = np.hypot((self.x[window] - x) / rx, (self.y[window] - y) / ry)
        weight = np.clip((1 - distance) * min(rx, ry) * self.scale + 0.5, 0, 1)[..., None] * alpha
        self.pixels[window] += (np.asarray(colour, np.float32) - self.pixels[window]) * weight

    def _window(self, left: float, top: float, right: float, bottom: float) -> tuple[slice, slice]:
        """The pixels of a rectangle in millimetres and two around it, cut to the canvas."""
        height, width = self.pixels.shape[:2]
        x0, x1 = (int(np.clip(x * self.scale + edge, 0, width)) for x, edge in ((left, -2), (right, 3)))
        y0, y1 = (int(np.clip(y * self.scale + edge, 0, height)) for y, edge in ((top, -2), (bottom, 3)))
        return slice(y0, y1), slice(x0, x1)

    def soften(self, mask: np.ndarray, sigma_mm: float) -> np.ndarray:
        """The mask, blurred."""
        from scipy.ndimage import gaussian_filter

        return gaussian_filter(mask, sigma_mm * self.scale)

    def text(
        self, x: float, y: float, words: str, height_mm: float, colour: Colour, face: str = "sans",
        outline: Colour | None = None, outline_mm: float = 0.0, anchor: str = "mm",
    ) -> None:  # fmt: skip
        """Letters at (x, y); `height_mm` is the font's size, `anchor` Pillow's."""
        image, font = self.image(), read_font(face, max(4, round(height_mm * self.scale)))
        ImageDraw.Draw(image).text(
            (x * self.scale, y * self.scale), words, fill=colour, font=font, anchor=anchor,
            stroke_width=round(outline_mm * self.scale), stroke_fill=outline,
        )  # fmt: skip
        self.pixels = np.asarray(image).astype(np.float32)


def draw_mug(canvas: LabelCanvas, x: float, y: float, size: float, seed: int = 5) -> None:
    """A glass mug of eggnog with foam, grated nutmeg and a cinnamon stick; (x, y) its middle, `size` its height."""
    s = size
    # ellipses seen from a little above: the rim behind, the foot in front
    rim, base = (x - 0.07 * s, y - 0.28 * s), (x - 0.07 * s, y + 0.40 * s)
    wide, narrow = 0.34 * s, 0.27 * s
    # a soft shadow on the label, below the mug
    canvas.fill(
        canvas.soften(canvas.ellipse(x + 0.02 * s, y + 0.44 * s, 0.42 * s, 0.08 * s), 0.03 * s), (40, 8, 8), 0.75
    )
    _draw_handle(canvas, rim[0] + 0.30 * s, y + 0.04 * s, s)
    angle = np.linspace(0, np.pi, 60)

    def body(inset: float, top: float, bottom: float) -> np.ndarray:
        lower = np.stack([base[0] + (narrow - inset) * np.cos(angle), bottom + 0.075 * s * np.sin(angle)], 1)
        return np.vstack([[(rim[0] - wide + inset, top)], lower[::-1], [(rim[0] + wide - inset, top)]])

    # glass, then the drink within it, darker towards the sides
    glass = np.maximum(canvas.polygon(body(0, rim[1], base[1])), canvas.ellipse(rim[0], rim[1], wide, 0.095 * s))
    canvas.fill(glass, (226, 222, 208), 0.9)
    liquid = canvas.polygon(body(0.022 * s, rim[1] + 0.03 * s, base[1] - 0.06 * s))
    across = (canvas.x - rim[0]) / wide
    shade = np.clip(1.02 - 0.42 * np.abs(across + 0.12) ** 2.4 - 0.10 * (canvas.y - rim[1]) / s, 0, 1.1)[..., None]
    canvas.fill(liquid, np.array([255, 228, 158]) * shade)
    # light in the thick glass of the foot
    foot = canvas.ellipse(base[0], base[1] + 0.005 * s, narrow * 0.82, 0.045 * s)
    canvas.fill(canvas.soften(foot * glass, 0.008 * s), (255, 252, 244), 0.55)
    # foam that runs down the inside in waves
    drop = rim[1] + s * (0.055 + 0.008 * np.sin(across * 17) + 0.092 * np.sqrt(np.clip(1 - across**2, 0, 1)))
    foam = np.clip((drop - canvas.y) * canvas.scale, 0, 1) * liquid
    canvas.fill(foam, np.array([255, 246, 216]) * np.clip(shade + 0.04, 0, 1))
    _draw_surface(canvas, rim, wide, s, seed)
    _draw_cinnamon(canvas, rim, s)
    _draw_shine(canvas, rim, base, wide, narrow, s)


def _draw_handle(canvas: LabelCanvas, x: float, y: float, s: float) -> None:
    outer, inner = canvas.ellipse(x, y, 0.25 * s, 0.25 * s), canvas.ellipse(x - 0.005 * s, y, 0.185 * s, 0.18 * s)
    canvas.fill(_cut(outer, inner), (228, 216, 190), 0.88)
    light = _cut(canvas.ellipse(x, y, 0.232 * s, 0.232 * s), canvas.ellipse(x - 0.004 * s, y, 0.214 * s, 0.212 * s))
    canvas.fill(canvas.soften(light, 0.004 * s), (255, 255, 250), 0.9)
    inside = canvas.ellipse(x - 0.006 * s, y - 0.004 * s, 0.244 * s, 0.242 * s)
    canvas.fill(_cut(outer, inside), (120, 92, 60), 0.55)


def _cut(mask: np.ndarray, hole: np.ndarray) -> np.ndarray:
    return np.clip(mask - hole, 0, 1)


def _draw_surface(canvas: LabelCanvas, rim: tuple[float, float], wide: float, s: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # the wall's rim, then the surface in it
    canvas.fill(canvas.ellipse(rim[0], rim[1], wide, 0.098 * s), (236, 226, 202))
    top = canvas.ellipse(rim[0], rim[1] + 0.004 * s, wide - 0.018 * s, 0.084 * s)
    u, v = (canvas.x - rim[0]) / wide, (canvas.y - rim[1]) / (0.09 * s)
    # a swirl of cream, lighter towards the front
    swirl = 0.5 + 0.5 * np.sin(9 * np.hypot(u, v) + 1.5 * np.arctan2(v, u))
    cream = np.array([255, 243, 208]) + swirl[..., None] * [0, 7, 22] + np.clip(v, -1, 1)[..., None] * [2, 3, 6]
    canvas.fill(top, cream)
    # grated nutmeg, denser in the middle
    for _ in range(230):
        radius, bearing = np.sqrt(rng.uniform(0, 1)) ** 1.4 * 0.86, rng.uniform(0, 2 * np.pi)
        spot_x = rim[0] + radius * wide * np.cos(bearing)
        spot_y = rim[1] + 0.004 * s + radius * 0.082 * s * np.sin(bearing)
        grain = rng.uniform(0.0025, 0.0075) * s
        canvas.spot(spot_x, spot_y, grain * 1.4, grain, (int(rng.integers(110, 170)), 78, 36))


def _draw_cinnamon(canvas: LabelCanvas, rim: tuple[float, float], s: float) -> None:
    # from the surface of the drink to above the rim
    foot, tip = np.array([rim[0] + 0.04 * s, rim[1] + 0.03 * s]), np.array([rim[0] + 0.27 * s, rim[1] - 0.25 * s])
    along = (tip - foot) / np.linalg.norm(tip - foot)
    side = np.array([-along[1], along[0]]) * 0.038 * s
    stick = canvas.polygon([foot - side, tip - side, tip + side, foot + side])
    stick = np.maximum(stick, canvas.ellipse(foot[0], foot[1], 0.038 * s, 0.014 * s))
    # across the stick, from -1 to 1: a round shade with a groove
    offset = ((canvas.x - foot[0]) * -along[1] + (canvas.y - foot[1]) * along[0]) / (0.038 * s)
    ridges = 1 - 0.35 * offset**2 - 0.22 * np.exp(-(((offset - 0.1) / 0.1) ** 2)) + 0.05 * np.sin(offset * 19)
    canvas.fill(stick, np.array([176, 98, 48]) * ridges.clip(0.3, 1.2)[..., None])
    bearing = float(np.degrees(np.arctan2(side[1], side[0])))
    for curl in (tip - 0.5 * side, tip + 0.5 * side):
        canvas.fill(canvas.ellipse(curl[0], curl[1], 0.022 * s, 0.012 * s, bearing), (205, 132, 76))
        canvas.fill(canvas.ellipse(curl[0], curl[1], 0.012 * s, 0.006 * s, bearing), (92, 44, 20))


def _draw_shine(
    canvas: LabelCanvas, rim: tuple[float, float], base: tuple[float, float], wide: float, narrow: float, s: float
) -> None:
    # two streaks on the left, the third on the right
    for start, end, alpha in ((-0.80, -0.66, 0.75), (-0.58, -0.54, 0.45), (0.76, 0.84, 0.5)):
        top, bottom = rim[1] + 0.10 * s, base[1] - 0.03 * s
        streak = [(rim[0] + start * wide, top), (rim[0] + end * wide, top + 0.02 * s),
                  (base[0] + end * narrow, bottom + 0.01 * s), (base[0] + start * narrow, bottom)]  # fmt: skip
        canvas.fill(canvas.soften(canvas.polygon(streak), 0.006 * s), (255, 255, 250), alpha)
    inside = canvas.ellipse(rim[0], rim[1] + 0.001 * s, wide - 0.012 * s, 0.089 * s)
    canvas.fill(_cut(canvas.ellipse(rim[0], rim[1], wide, 0.098 * s), inside), (255, 255, 252), 0.85)


def draw_holly(canvas: LabelCanvas, x: float, y: float, size: float, turn_deg: float = 0.0) -> None:
    """Two prickly leaves and three berries; `size` is a leaf's length."""
    for bearing, shade in ((turn_deg + 205, 0.85), (turn_deg - 25, 1.0)):
        t = np.linspace(0, 2 * np.pi, 121)
        # seven prickles round an ellipse; one half is lighter, along the midrib
        spiky = 0.62 + 0.38 * np.abs(np.cos(3.5 * t)) ** 0.6
        leaf = np.stack([0.5 + 0.5 * np.cos(t), 0.27 * np.sin(t) * spiky], axis=1) * size
        cosine, sine = np.cos(np.radians(bearing)), np.sin(np.radians(bearing))
        outline = leaf @ np.array([[cosine, sine], [-sine, cosine]]) + [x, y]
        mask = canvas.polygon(outline)
        offset = (canvas.y - y) * cosine - (canvas.x - x) * sine
        tone = np.where(offset < 0, 1.15, 0.85) * shade
        canvas.fill(mask, np.array([24, 104, 50]) * tone[..., None])
        canvas.fill(mask * np.clip(1 - np.abs(offset) * 8 / size * 2, 0, 1), (150, 200, 130), 0.6)
    # berries with a soft highlight
    for dx, dy in ((-0.10, 0.08), (0.12, 0.12), (0.02, -0.10)):
        centre, radius = (x + dx * size, y + dy * size), 0.125 * size
        canvas.fill(canvas.ellipse(*centre, radius, radius), (190, 16, 26))
        shine = canvas.ellipse(centre[0] - 0.35 * radius, centre[1] - 0.4 * radius, 0.3 * radius, 0.24 * radius)
        canvas.fill(canvas.soften(shine, 0.1 * radius), (255, 190, 180), 0.9)


def paint_label(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The label all round: the name in front and behind, a glass of eggnog on the right and left."""
    half = np.asarray(draw_half(width // 2, height, px_per_mm))
    band = np.concatenate([half, half], axis=1)
    # the names at the chart's middle, which faces the front, and at its ends
    return Image.fromarray(np.roll(band, -round(NAME_AT / 2 * band.shape[1]), axis=1))


def draw_half(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Half of the label: the name with holly, and a mug beside it."""
    canvas = LabelCanvas(width, height, px_per_mm, RED)
    w, h = canvas.size_mm
    rng = np.random.default_rng(3)
    # snow on the red
    for x, y, radius in rng.uniform((0, 0, 0.25), (w, h, 0.8), (90, 3)):
        canvas.spot(x, y, radius, radius, (255, 250, 245), 0.8)
    # golden lines above and below
    for y, thick in ((0.0, 2.0), (3.4, 0.6), (h - 4.0, 0.6), (h - 2.0, 2.0)):
        canvas.fill(canvas.box(0, y, w, thick), GOLD)
    middle = NAME_AT * w
    # the name over its own shadow
    for off, colour, edge in ((0.05 * 23, DARK_RED, 0.09 * 23), (0.0, CREAM, 0.05 * 23)):
        canvas.text(middle + off, 0.42 * h + off, "Egg Nog", 23, colour, "italic", outline=DARK_RED, outline_mm=edge)
    canvas.text(middle, 0.73 * h, "RICH & CREAMY", 5.6, CREAM)
    for side, turn_deg in ((-1, -10), (1, 10)):
        draw_holly(canvas, middle + side * 37, 0.75 * h, 13, turn_deg)
    draw_mug(canvas, (NAME_AT + 0.5) * w, 0.54 * h, 0.72 * h)
    return canvas.image()


def paint_heel(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Eggnog behind glass below the label, and the thick heel of clear glass."""
    canvas = LabelCanvas(width, height, px_per_mm, EGGNOG)
    canvas.fill(np.clip((canvas.y - canvas.size_mm[1] + 7) / 2.5, 0, 1), GLASS, 0.85)
    return canvas.image()


def paint_neck(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Eggnog behind glass above the label: paler and full of bubbles where the foam floats."""
    canvas = LabelCanvas(width, height, px_per_mm, EGGNOG)
    w = canvas.size_mm[0]
    # the foam's lower edge, in waves that close round the bottle
    edge = 15 + 1.2 * np.sin(canvas.x / w * 2 * np.pi * 5) + 0.7 * np.sin(canvas.x / w * 2 * np.pi * 13)
    canvas.fill(np.clip((edge - canvas.y) / 3, 0, 1), FOAM)
    rng = np.random.default_rng(4)
    for x, y, radius in rng.uniform((0, 1, 0.2), (w, 14, 0.7), (420, 3)):
        canvas.spot(x, y, radius, radius, (255, 252, 236) if radius > 0.4 else (236, 220, 172), 0.6)
    return canvas.image()


def paint_foam(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The drink from above: swirled foam, bubbles along the glass, and nutmeg grated over the middle."""
    canvas = LabelCanvas(width, height, px_per_mm, FOAM)
    w, h = canvas.size_mm
    x, y = canvas.x - w / 2, canvas.y - h / 2
    distance = np.hypot(x, y) / (w / 2)
    swirl = 0.5 + 0.5 * np.sin(11 * distance + 2 * np.arctan2(y, x))
    canvas.fill(swirl, (248, 234, 190), 0.6)
    canvas.fill(np.clip((distance - 0.9) * 10, 0, 1), EGGNOG)
    rng = np.random.default_rng(6)
    # bubbles along the glass
    for bearing, place, radius in rng.uniform((0, 0.86, 0.3), (2 * np.pi, 0.98, 1.0), (220, 3)):
        spot = w / 2 * (1 + place * np.cos(bearing)), h / 2 * (1 + place * np.sin(bearing))
        canvas.spot(*spot, radius, radius, (255, 251, 234), 0.7)
    # nutmeg, denser towards the middle
    for bearing, scatter, grain in zip(
        rng.uniform(0, 2 * np.pi, 900), np.abs(rng.normal(0, 0.42, 900)), rng.uniform(0.2, 0.75, 900), strict=True
    ):
        if scatter < 0.95:
            spot = w / 2 * (1 + scatter * np.cos(bearing)), h / 2 * (1 + scatter * np.sin(bearing))
            canvas.spot(*spot, grain * 1.3, grain, (int(rng.integers(115, 175)), 88, 44))
    return canvas.image()


def paint_bark(width: int, height: int, px_per_mm: float) -> Image.Image:
    """Cinnamon bark, grained along the quill."""
    canvas = LabelCanvas(width, height, px_per_mm, BARK)
    grain = np.sin(canvas.x * 2.9 + np.sin(canvas.y * 0.13) * 2) + 0.6 * np.sin(canvas.x * 7.7 + canvas.y * 0.21)
    canvas.fill(np.clip(0.5 + 0.35 * grain, 0, 1), (172, 104, 58), 0.7)
    return canvas.image()


def paint_quill(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The cut end of the quill: two curls of bark around their hollows."""
    canvas = LabelCanvas(width, height, px_per_mm, (176, 112, 66))
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
"""Height of the eggnog on the wall."""
GLASS_MM = 3.0
"""Thickness of the wall at the mouth."""
LABEL_FROM_MM, LABEL_TO_MM = 35.0, 95.0
TOP_MM = 270.0
"""The tip of the cinnamon."""


def build() -> Mesh:
    """Build the bottle standing on z = 0, label to +x and -x, 270 mm to the tip of the cinnamon."""
    outline = _outline()
    parts = Parts(_bottle(outline), _label(), _drink(outline), _cinnamon(outline))
    materials = {"glass": (0.1, 0.0), "paper": (0.45, 0.0), "foam": (0.55, 0.0), "cinnamon": (0.6, 0.0)}
    return assemble(parts, materials, atlas_px=2048)


def _outline() -> np.ndarray:
    """(n, 2) radius and height of the glass from the heel to below the rim."""
    corners = [(BODY_MM - 2.5, 2), (BODY_MM, 9), (BODY_MM, 60), (BODY_MM, 125), (54, 165), (46, 190), (45, 205)]
    curve = smooth_curve([*corners, (51, RIM_MM)], 80)
    split = np.searchsorted(curve[:, 1], FILL_MM)
    return np.insert(curve, split, [np.interp(FILL_MM, curve[:, 1], curve[:, 0]), FILL_MM], axis=0)


def _bottle(outline: np.ndarray) -> Parts:
    """Foot, filled wall below and above the label, and clear glass from the fill line over the rim and down inside."""
    # the wall in three parts: below the label, above it, and clear above the fill line
    height = outline[:, 1]
    lower = [*outline[height < LABEL_FROM_MM], (BODY_MM, LABEL_FROM_MM)]
    upper = [(BODY_MM, LABEL_TO_MM), *outline[(height > LABEL_TO_MM) & (height <= FILL_MM)]]
    clear = outline[height >= FILL_MM]
    foot = [(0, 3), (BODY_MM - 14, 3), (BODY_MM - 10, 0), (BODY_MM - 5.5, 0), (BODY_MM - 3.3, 0.8), tuple(lower[0])]
    # the lip is a bead, round from outside over the top to inside
    turn = np.linspace(-0.5 * np.pi, 1.2 * np.pi, 22)
    mouth = clear[-1, 0]
    bead = np.stack([mouth - 1 + 2.4 * np.cos(turn), RIM_MM + 2.2 + 2.4 * np.sin(turn)], axis=1)
    # the inside of the clear part, a wall's thickness in
    inner = (clear[::-1] - [GLASS_MM, 0])[1:]
    return Parts(
        revolve(foot, SEGMENTS, GLASS, "glass"), revolve(lower, SEGMENTS, paint_heel, "glass"),
        revolve(upper, SEGMENTS, paint_neck, "glass"),
        revolve([*clear, *bead, *inner], SEGMENTS, GLASS, "glass"),
    )  # fmt: skip


def _label() -> Part:
    """Printed paper around the straight wall, in the wall's place: hidden glass below it would only cast shade."""
    low, high, paper = LABEL_FROM_MM, LABEL_TO_MM, BODY_MM + 0.3
    profile = [(BODY_MM, low), *[(paper, z) for z in np.linspace(low + 0.2, high - 0.2, 12)], (BODY_MM, high)]
    return revolve(profile, SEGMENTS, paint_label, "paper")


def _drink(outline: np.ndarray) -> Part:
    """The foamy surface a little below the rim, its chart the view from above."""
    # the radius of the mouth at the fill line
    wall = float(np.interp(FILL_MM, outline[:, 1], outline[:, 0])) - GLASS_MM
    radius = np.linspace(wall, 0, 16)
    ripple = 0.5 * np.cos(radius / wall * 9)
    height = FILL_MM + 2.2 * (1 - (radius / wall) ** 4) + ripple * (1 - (radius / wall) ** 4)
    part = revolve(np.stack([radius, height], axis=1).tolist(), SEGMENTS, paint_foam, "foam")
    return seen_from_above(part)


def _cinnamon(outline: np.ndarray) -> Parts:
    """A quill rolled from both sides, that leans on the rim behind."""
    # two rolls side by side, with a groove where they meet
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    groove = 1 - 0.55 * np.exp(-((np.cos(turn) / 0.3) ** 2)) * (np.sin(turn) > 0)
    section = np.stack([6.4 * np.cos(turn), 4.6 * np.sin(turn) * groove], axis=1)
    lean_deg, length, bearing_deg = 22.0, 85.0, 145.0
    bark, tip, end = extrude(section.tolist(), length, 0, paint_bark, "cinnamon")
    stick = Parts(bark, tip.painted(paint_quill), end.painted(BARK))
    stick = stick.rotated("z", 90).rotated("y", lean_deg).rotated("z", bearing_deg)
    # lifted until its tip is at `TOP_MM`
    lift = TOP_MM - max(float(part.vertices[:, 2].max()) for part in stick)
    lean = np.radians(lean_deg)
    # where its axis passes the height of the rim: it leans on the inside of the glass
    at_rim = outline[-1, 0] - GLASS_MM - 2 - 4.6 / np.cos(lean)
    reach = at_rim - (RIM_MM - lift) * np.tan(lean)
    x, y = reach * np.cos(np.radians(bearing_deg)), reach * np.sin(np.radians(bearing_deg))
    return stick.moved(x, y, lift)
