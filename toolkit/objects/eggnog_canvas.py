"""A small canvas in millimetres, with smooth-edged masks and lettering, for labels drawn by code."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]


@lru_cache(maxsize=32)
def read_font(file: str, size_px: int) -> ImageFont.FreeTypeFont:
    """One of the fonts that come with matplotlib, so that every machine prints the same label."""
    import matplotlib

    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / file), max(4, size_px))


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

    def fill(self, mask: np.ndarray, colour, alpha: float = 1.0) -> None:
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
        self,
        x: float,
        y: float,
        words: str,
        height_mm: float,
        colour: Colour,
        font: str = "DejaVuSans-Bold.ttf",
        outline: Colour | None = None,
        outline_mm: float = 0.0,
        anchor: str = "mm",
    ) -> None:
        """Letters at (x, y); `height_mm` is the font's size, `anchor` Pillow's."""
        image = self.image()
        ImageDraw.Draw(image).text(
            (x * self.scale, y * self.scale), words, fill=colour, font=read_font(font, round(height_mm * self.scale)),
            anchor=anchor, stroke_width=round(outline_mm * self.scale), stroke_fill=outline,
        )  # fmt: skip
        self.pixels = np.asarray(image).astype(np.float32)
