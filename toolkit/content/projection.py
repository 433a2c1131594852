"""Paint by projection: flat drawings in true millimetres, laid on a part from the side they are seen from.

A texel takes the colour of the drawing that it faces, so that a line runs on from one part to the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

DRAW_PX_PER_MM = 12
KEEP_PX_PER_MM = 6

Point = tuple[float, float]
RGBA = tuple[int, int, int, int]
INK: RGBA = (52, 57, 63, 210)


class Drawing:
    """A flat drawing in millimetres, seen along one world axis.

    Args:
        right, up: unit vectors of the world that point to the right and up on the drawing.
        low, high: its lower left and upper right corner, millimetres along `right` and `up`.
    """

    def __init__(self, right: Sequence[float], up: Sequence[float], low: Point, high: Point) -> None:
        self.axes = np.array([right, up], float)
        self.low, self.high = np.array(low), np.array(high)
        width, height = np.ceil((self.high - self.low) * DRAW_PX_PER_MM)
        self.image = Image.new("RGBA", (int(width), int(height)), (128, 128, 128, 0))
        self.draw = ImageDraw.Draw(self.image)

    def px(self, points: Sequence[Point]) -> list[Point]:
        """Pixels of points (right, up) in millimetres."""
        return [
            ((a - self.low[0]) * DRAW_PX_PER_MM, (self.high[1] - b) * DRAW_PX_PER_MM) for a, b in np.asarray(points)
        ]

    def line(self, points: Sequence[Point], width_mm: float = 0.35, colour: RGBA = INK, closed: bool = False) -> None:
        """A line through points."""
        points = [*points, points[0]] if closed else points
        self.draw.line(self.px(points), colour, max(1, round(width_mm * DRAW_PX_PER_MM)), joint="curve")

    def fill(self, points: Sequence[Point], colour: RGBA) -> None:
        """A filled polygon."""
        self.draw.polygon(self.px(points), colour)

    def disc(self, centre: Point, radius_mm: float, colour: RGBA) -> None:
        """A filled circle."""
        (x, y), r = self.px([centre])[0], radius_mm * DRAW_PX_PER_MM
        self.draw.ellipse((x - r, y - r, x + r, y + r), colour)

    def panel(self, centre: Point, width_mm: float, height_mm: float, fill: RGBA | None = None) -> None:
        """A hatch: its outline, and its fill if given."""
        (a, b), w, h = centre, width_mm / 2, height_mm / 2
        corners = [(a - w, b - h), (a + w, b - h), (a + w, b + h), (a - w, b + h)]
        if fill:
            self.fill(corners, fill)
        self.line(corners, 0.3, closed=True)

    def text(self, centre: Point, words: str, height_mm: float, colour: RGBA = INK, turn_deg: float = 0) -> None:
        """Lettering, `height_mm` from line to line, turned counter-clockwise about its middle."""
        font = ImageFont.load_default(size=height_mm * DRAW_PX_PER_MM)
        left, top, right, bottom = font.getbbox(words)
        patch = Image.new("RGBA", (int(right - left) + 8, int(bottom - top) + 8), (*colour[:3], 0))
        ImageDraw.Draw(patch).text((4 - left, 4 - top), words, colour, font, stroke_width=2)
        patch = patch.rotate(turn_deg, Image.Resampling.BICUBIC, expand=True)
        x, y = self.px([centre])[0]
        self.image.paste(patch, (round(x - patch.width / 2), round(y - patch.height / 2)), patch)

    def kept(self) -> np.ndarray:
        """(h, w, 4) float32 in 0…255, premultiplied, at the resolution that is sampled."""
        return np.asarray(self.image.convert("RGBa").reduce(DRAW_PX_PER_MM // KEEP_PX_PER_MM), np.float32)


@dataclass(frozen=True)
class Side:
    """A finished drawing, the direction that it is seen from, and the part of the world that it is laid on."""

    pixels: np.ndarray
    axes: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def towards(self) -> np.ndarray:
        """Unit vector to the viewer."""
        return np.cross(self.axes[0], self.axes[1])

    def sample(self, points: np.ndarray) -> np.ndarray:
        """(h, w, 4) of the drawing at (h, w, 3) points; clear outside it."""
        flat = points @ self.axes.T.astype(np.float32)
        x = (flat[..., 0] - self.low[0]) * KEEP_PX_PER_MM - 0.5
        y = (self.high[1] - flat[..., 1]) * KEEP_PX_PER_MM - 0.5
        return cv2.remap(self.pixels, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)


def finish(sheet: Drawing) -> Side:
    """Fix a drawing for sampling."""
    return Side(sheet.kept(), sheet.axes, sheet.low, sheet.high)


def chart_points(net: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each texel of `surface(net)`'s chart lies, and the normal there: two (height, width, 3) float32."""
    u = np.r_[0, np.cumsum(np.linalg.norm(np.diff(net, axis=1), axis=2).mean(axis=0))]
    v = np.r_[0, np.cumsum(np.linalg.norm(np.diff(net, axis=0), axis=2).mean(axis=1))]
    column = np.interp((np.arange(width) + 0.5) / width * u[-1], u, np.arange(len(u)))
    row = np.interp((1 - (np.arange(height) + 0.5) / height) * v[-1], v, np.arange(len(v)))
    normals = np.cross(np.gradient(net, axis=1), np.gradient(net, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    where = np.broadcast_arrays(column[None].astype(np.float32), row[:, None].astype(np.float32))
    maps = [np.ascontiguousarray(m) for m in where]
    edge = cv2.BORDER_REPLICATE
    points, turned = (
        cv2.remap(np.ascontiguousarray(field, np.float32), maps[0], maps[1], cv2.INTER_LINEAR, borderMode=edge)
        for field in (net, normals)
    )
    return points, turned
