"""Drawing for the eggnog's label: a canvas in millimetres, a glass mug with foam and spice, and holly."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw

from toolkit.imaging.fonts import read_font

Colour = tuple[int, int, int]


class Canvas:
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
        if height <= 0 or width <= 0:
            return mask
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


def draw_mug(canvas: Canvas, x: float, y: float, size: float, seed: int = 5) -> None:
    """A glass mug of eggnog with foam, grated nutmeg and a cinnamon stick; (x, y) its middle, `size` its height."""
    s = size
    rim, base = (x - 0.07 * s, y - 0.28 * s), (x - 0.07 * s, y + 0.40 * s)
    wide, narrow = 0.34 * s, 0.27 * s
    canvas.fill(
        canvas.soften(canvas.ellipse(x + 0.02 * s, y + 0.44 * s, 0.42 * s, 0.08 * s), 0.03 * s), (40, 8, 8), 0.75
    )
    _draw_handle(canvas, rim[0] + 0.30 * s, y + 0.04 * s, s)
    angle = np.linspace(0, np.pi, 60)

    def body(inset: float, top: float, bottom: float) -> np.ndarray:
        lower = np.stack([base[0] + (narrow - inset) * np.cos(angle), bottom + 0.075 * s * np.sin(angle)], 1)
        return np.vstack([[(rim[0] - wide + inset, top)], lower[::-1], [(rim[0] + wide - inset, top)]])

    glass = np.maximum(canvas.polygon(body(0, rim[1], base[1])), canvas.ellipse(rim[0], rim[1], wide, 0.095 * s))
    canvas.fill(glass, (226, 222, 208), 0.9)
    liquid = canvas.polygon(body(0.022 * s, rim[1] + 0.03 * s, base[1] - 0.06 * s))
    across = (canvas.x - rim[0]) / wide
    shade = np.clip(1.02 - 0.42 * np.abs(across + 0.12) ** 2.4 - 0.10 * (canvas.y - rim[1]) / s, 0, 1.1)[..., None]
    canvas.fill(liquid, np.array([255, 228, 158]) * shade)
    foot = canvas.ellipse(base[0], base[1] + 0.005 * s, narrow * 0.82, 0.045 * s)
    canvas.fill(canvas.soften(foot * glass, 0.008 * s), (255, 252, 244), 0.55)
    drop = rim[1] + s * (0.055 + 0.008 * np.sin(across * 17) + 0.092 * np.sqrt(np.clip(1 - across**2, 0, 1)))
    foam = np.clip((drop - canvas.y) * canvas.scale, 0, 1) * liquid
    canvas.fill(foam, np.array([255, 246, 216]) * np.clip(shade + 0.04, 0, 1))
    _draw_surface(canvas, rim, wide, s, seed)
    _draw_cinnamon(canvas, rim, s)
    _draw_shine(canvas, rim, base, wide, narrow, s)


def _draw_handle(canvas: Canvas, x: float, y: float, s: float) -> None:
    """A thick loop of glass."""
    outer, inner = canvas.ellipse(x, y, 0.25 * s, 0.25 * s), canvas.ellipse(x - 0.005 * s, y, 0.185 * s, 0.18 * s)
    canvas.fill(_cut(outer, inner), (228, 216, 190), 0.88)
    light = _cut(canvas.ellipse(x, y, 0.232 * s, 0.232 * s), canvas.ellipse(x - 0.004 * s, y, 0.214 * s, 0.212 * s))
    canvas.fill(canvas.soften(light, 0.004 * s), (255, 255, 250), 0.9)
    inside = canvas.ellipse(x - 0.006 * s, y - 0.004 * s, 0.244 * s, 0.242 * s)
    canvas.fill(_cut(outer, inside), (120, 92, 60), 0.55)


def _cut(mask: np.ndarray, hole: np.ndarray) -> np.ndarray:
    """The mask without the hole."""
    return np.clip(mask - hole, 0, 1)


def _draw_surface(canvas: Canvas, rim: tuple[float, float], wide: float, s: float, seed: int) -> None:
    """The drink's foamy top: creamy, a soft swirl, and grated nutmeg."""
    rng = np.random.default_rng(seed)
    canvas.fill(canvas.ellipse(rim[0], rim[1], wide, 0.098 * s), (236, 226, 202))
    top = canvas.ellipse(rim[0], rim[1] + 0.004 * s, wide - 0.018 * s, 0.084 * s)
    u, v = (canvas.x - rim[0]) / wide, (canvas.y - rim[1]) / (0.09 * s)
    swirl = 0.5 + 0.5 * np.sin(9 * np.hypot(u, v) + 1.5 * np.arctan2(v, u))
    cream = np.array([255, 243, 208]) + swirl[..., None] * [0, 7, 22] + np.clip(v, -1, 1)[..., None] * [2, 3, 6]
    canvas.fill(top, cream)
    for _ in range(230):
        radius, bearing = np.sqrt(rng.uniform(0, 1)) ** 1.4 * 0.86, rng.uniform(0, 2 * np.pi)
        spot_x = rim[0] + radius * wide * np.cos(bearing)
        spot_y = rim[1] + 0.004 * s + radius * 0.082 * s * np.sin(bearing)
        grain = rng.uniform(0.0025, 0.0075) * s
        canvas.spot(spot_x, spot_y, grain * 1.4, grain, (int(rng.integers(110, 170)), 78, 36))


def _draw_cinnamon(canvas: Canvas, rim: tuple[float, float], s: float) -> None:
    """A quill of cinnamon leaning out of the mug."""
    foot, tip = np.array([rim[0] + 0.04 * s, rim[1] + 0.03 * s]), np.array([rim[0] + 0.27 * s, rim[1] - 0.25 * s])
    along = (tip - foot) / np.linalg.norm(tip - foot)
    side = np.array([-along[1], along[0]]) * 0.038 * s
    stick = canvas.polygon([foot - side, tip - side, tip + side, foot + side])
    stick = np.maximum(stick, canvas.ellipse(foot[0], foot[1], 0.038 * s, 0.014 * s))
    offset = ((canvas.x - foot[0]) * -along[1] + (canvas.y - foot[1]) * along[0]) / (0.038 * s)
    ridges = 1 - 0.35 * offset**2 - 0.22 * np.exp(-(((offset - 0.1) / 0.1) ** 2)) + 0.05 * np.sin(offset * 19)
    canvas.fill(stick, np.array([176, 98, 48]) * ridges.clip(0.3, 1.2)[..., None])
    bearing = float(np.degrees(np.arctan2(side[1], side[0])))
    for curl in (tip - 0.5 * side, tip + 0.5 * side):
        canvas.fill(canvas.ellipse(curl[0], curl[1], 0.022 * s, 0.012 * s, bearing), (205, 132, 76))
        canvas.fill(canvas.ellipse(curl[0], curl[1], 0.012 * s, 0.006 * s, bearing), (92, 44, 20))


def _draw_shine(
    canvas: Canvas, rim: tuple[float, float], base: tuple[float, float], wide: float, narrow: float, s: float
) -> None:
    """Reflections down the glass and around its rim."""
    for start, end, alpha in ((-0.80, -0.66, 0.75), (-0.58, -0.54, 0.45), (0.76, 0.84, 0.5)):
        top, bottom = rim[1] + 0.10 * s, base[1] - 0.03 * s
        streak = [(rim[0] + start * wide, top), (rim[0] + end * wide, top + 0.02 * s),
                  (base[0] + end * narrow, bottom + 0.01 * s), (base[0] + start * narrow, bottom)]  # fmt: skip
        canvas.fill(canvas.soften(canvas.polygon(streak), 0.006 * s), (255, 255, 250), alpha)
    inside = canvas.ellipse(rim[0], rim[1] + 0.001 * s, wide - 0.012 * s, 0.089 * s)
    canvas.fill(_cut(canvas.ellipse(rim[0], rim[1], wide, 0.098 * s), inside), (255, 255, 252), 0.85)


def draw_holly(canvas: Canvas, x: float, y: float, size: float, turn_deg: float = 0.0) -> None:
    """Two prickly leaves and three berries; `size` is a leaf's length."""
    for bearing, shade in ((turn_deg + 205, 0.85), (turn_deg - 25, 1.0)):
        t = np.linspace(0, 2 * np.pi, 121)
        spiky = 0.62 + 0.38 * np.abs(np.cos(3.5 * t)) ** 0.6
        leaf = np.stack([0.5 + 0.5 * np.cos(t), 0.27 * np.sin(t) * spiky], axis=1) * size
        cosine, sine = np.cos(np.radians(bearing)), np.sin(np.radians(bearing))
        outline = leaf @ np.array([[cosine, sine], [-sine, cosine]]) + [x, y]
        mask = canvas.polygon(outline)
        offset = (canvas.y - y) * cosine - (canvas.x - x) * sine
        tone = np.where(offset < 0, 1.15, 0.85) * shade
        canvas.fill(mask, np.array([24, 104, 50]) * tone[..., None])
        canvas.fill(mask * np.clip(1 - np.abs(offset) * 8 / size * 2, 0, 1), (150, 200, 130), 0.6)
    for dx, dy in ((-0.10, 0.08), (0.12, 0.12), (0.02, -0.10)):
        centre, radius = (x + dx * size, y + dy * size), 0.125 * size
        canvas.fill(canvas.ellipse(*centre, radius, radius), (190, 16, 26))
        shine = canvas.ellipse(centre[0] - 0.35 * radius, centre[1] - 0.4 * radius, 0.3 * radius, 0.24 * radius)
        canvas.fill(canvas.soften(shine, 0.1 * radius), (255, 190, 180), 0.9)
