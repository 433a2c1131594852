"""Make patches and measure printed pages; pages are rasterised by PDFium, which shares no code with ReportLab."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pypdfium2

from toolkit.objects.records import Patch, write_patch

MM_PER_INCH = 25.4


def make_pixels(n_px: int, seed: int = 0) -> np.ndarray:
    """Saturated colours without any grey, so that a patch is told from marks and paper; neighbours differ."""
    pixels = np.random.default_rng(seed).integers(0, 256, (n_px, n_px, 3), dtype=np.uint8)
    pixels[..., 0], pixels[..., 2] = 255, 0
    return pixels


def make_patch(folder: Path, name: str = "warplane", n_px: int = 100, class_name: str = "warplane", **more) -> Patch:
    record = {
        "name": name,
        "class_name": class_name,
        "class_index": 895,
        "networks": [{"arch": "resnet18", "weights": "resnet18-f37072fd.pth", "sha256": "0" * 64}],
        "data": {},
        "seed": 0,
        "settings": {},
        "final": {"loss": 0.1},
        "toolkit_version": "0.1.0",
    }
    return write_patch(folder, make_pixels(n_px), record | more)


@dataclass(frozen=True)
class Raster:
    """A page's pixels (h, w, 3) uint8 and how many of them a millimetre holds."""

    pixels: np.ndarray
    per_mm: float

    @property
    def coloured(self) -> np.ndarray:
        """Where the patch of `make_pixels` is: all red and no blue; words and marks are grey.

        Only the largest connected part: the colour strip has small cells of such colours too.
        """
        warm = (self.pixels[..., 0] >= 128) & (self.pixels[..., 2] < 128)
        _, _, boxes, _ = cv2.connectedComponentsWithStats(warm[::4, ::4].astype(np.uint8))
        x, y, width, height, _ = 4 * boxes[1 + boxes[1:, cv2.CC_STAT_AREA].argmax()]
        around = (slice(max(y - 4, 0), y + height + 4), slice(max(x - 4, 0), x + width + 4))
        patch = np.zeros_like(warm)
        patch[around] = warm[around]
        return patch

    @property
    def black(self) -> np.ndarray:
        """Words and marks; the patch is all red."""
        return self.pixels[..., 0] < 128

    def box_mm(self, mask: np.ndarray) -> tuple[float, float, float, float]:
        """Left, top, right, bottom of a mask's true pixels, millimetres from the page's upper left corner."""
        columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
        return tuple(float(v) / self.per_mm for v in (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))

    def cut_out(self, left: float, top: float, right: float, bottom: float) -> np.ndarray:
        """Pixels of a rectangle in millimetres."""
        x0, y0, x1, y1 = (round(v * self.per_mm) for v in (left, top, right, bottom))
        return self.pixels[y0:y1, x0:x1]

    def black_groups_mm(self, left: float, top: float, right: float, bottom: float, axis: int) -> list[float]:
        """Centres of the black groups in a strip, along x (axis 0) or y (axis 1), millimetres on the page."""
        strip = self.cut_out(left, top, right, bottom).max(2) < 128
        line = np.concatenate([[False], strip.any(axis), [False]])
        edges = np.flatnonzero(line[1:] != line[:-1])
        start = round((left, top)[axis] * self.per_mm)
        return [float(start + (a + b) / 2) / self.per_mm for a, b in zip(edges[::2], edges[1::2], strict=True)]


def render(content: bytes, page: int = 0, dpi: float = 600) -> Raster:
    with_page = pypdfium2.PdfDocument(content)[page]
    pixels = np.asarray(with_page.render(scale=dpi / 72).to_pil().convert("RGB"))
    return Raster(pixels, dpi / MM_PER_INCH)


def longest_run(mask: np.ndarray, least: int) -> tuple[int, int, int]:
    """(length, row, first column) of the longest run of true pixels in a row, among rows with at least so many."""
    best = (0, 0, 0)
    for row in np.flatnonzero(np.count_nonzero(mask, axis=1) >= least):
        line = np.concatenate([[False], mask[row], [False]])
        edges = np.flatnonzero(line[1:] != line[:-1])
        lengths = edges[1::2] - edges[::2]
        index = int(lengths.argmax())
        if lengths[index] > best[0]:
            best = (int(lengths[index]), int(row), int(edges[2 * index]))
    return best
