"""How large a patch on an uncut page was printed, from the edges of the sheet in the photograph."""

from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.photos.prints.align import map_points, sample_image
from toolkit.photos.prints.find import PatchSighting
from toolkit.printing.page import Paper

SIZE_TOLERANCE = 0.02
"""Share by which the measured side may differ from the record's: 'fit to page' makes 97 % or less, and photographs of
the rig with the camera known measure within 0.4 %."""
LEAST_SHARE = 0.12
"""Of the photo that the sheet must cover."""
SEARCH_PX = 1000
EDGE_POINTS = 60
REACH_PX = 6
SQUARE = 0.02
"""Sides of a measured patch that differ by more than this share say that what was found is not that sheet."""


@dataclass(frozen=True)
class PageMeasure:
    """A patch on its printed page.

    Attributes:
        size_mm: side of the square of equal area.
        across_mm, down_mm: mean sides along the file's rows and columns.
        page_px: (4, 2) corners of the sheet in the photo.
    """

    size_mm: float
    across_mm: float
    down_mm: float
    page_px: np.ndarray


def measure_on_page(image: np.ndarray, sighting: PatchSighting, paper: Paper) -> PageMeasure | None:
    """Measure a patch against the edges of the sheet that it is printed on.

    Args:
        image: (h, w, 3) uint8 sRGB of the whole uncut sheet, flat, on a darker ground.
        sighting: the patch in it.
        paper: the sheet.

    Returns:
        The patch's sides, or None where the sheet's four edges are not seen, or do not make the patch a square.
    """
    page = find_page(image)
    if (
        page is None
        or cv2.pointPolygonTest(page.astype(np.float32), sighting.corners_px.mean(axis=0).tolist(), False) < 0
    ):
        return None
    best: PageMeasure | None = None
    for width, height in ((paper.width_mm, paper.height_mm), (paper.height_mm, paper.width_mm)):
        sheet = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
        T_mm_px = cv2.getPerspectiveTransform(page.astype(np.float32), sheet).astype(float)
        corners = map_points(T_mm_px, sighting.corners_px)
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        across, down = float(sides[[0, 2]].mean()), float(sides[[1, 3]].mean())
        measure = PageMeasure(float(np.sqrt(across * down)), across, down, page)
        if best is None or abs(np.log(across / down)) < abs(np.log(best.across_mm / best.down_mm)):
            best = measure
    return best if best is not None and abs(np.log(best.across_mm / best.down_mm)) < SQUARE else None


def find_page(image: np.ndarray) -> np.ndarray | None:
    """(4, 2) corners of the largest bright quadrilateral, clockwise as one sees it; None where there is none."""
    scale = min(1.0, SEARCH_PX / max(image.shape[:2]))
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    # paper is bright in all channels; wood and skin are not in blue
    bright = cv2.GaussianBlur(small.min(axis=2), (0, 0), 1.5)
    _, mask = cv2.threshold(bright, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    largest = cv2.convexHull(max(outlines, key=cv2.contourArea))
    if cv2.contourArea(largest) < LEAST_SHARE * size[0] * size[1]:
        return None
    rough = cv2.approxPolyDP(largest, 0.03 * cv2.arcLength(largest, True), True).reshape(-1, 2)
    if len(rough) != 4 or _touches_edge(rough, size):
        return None
    factor = np.array([image.shape[1] / size[0], image.shape[0] / size[1]])
    corners = _order(rough.astype(float) + 0.5) * factor
    return _sharpen(cv2.GaussianBlur(image.min(axis=2), (0, 0), 1.0).astype(np.float32), corners, REACH_PX / scale)


def _touches_edge(corners: np.ndarray, size: tuple[int, int]) -> bool:
    return bool((corners <= 1).any() or (corners >= np.array(size) - 2).any())


def _order(corners: np.ndarray) -> np.ndarray:
    """Clockwise as one sees them, beginning with the one at the upper left."""
    about = corners - corners.mean(axis=0)
    turned = corners[np.argsort(np.arctan2(about[:, 1], about[:, 0]))]
    return np.roll(turned, -int(turned.sum(axis=1).argmin()), axis=0)


def _sharpen(grey: np.ndarray, corners: np.ndarray, reach_px: float) -> np.ndarray | None:
    """Corners as meeting points of lines that are fitted to where each edge is steepest, to a part of a pixel."""
    lines = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        inwards = np.array([-along[1], along[0]])
        steps = np.arange(-reach_px, reach_px + 0.25, 0.5)
        share = np.linspace(0.08, 0.92, EDGE_POINTS)
        points = start + share[:, None] * (end - start)
        profile = sample_image(grey, points[:, None] + steps[:, None] * inwards)
        rise = np.maximum(np.diff(profile, axis=1), 0)
        sharpest = rise.argmax(axis=1)
        near = np.abs(np.arange(rise.shape[1]) - sharpest[:, None]) <= 3
        weight = np.where(near, rise, 0)
        total = weight.sum(axis=1)
        middle = (steps[:-1] + steps[1:]) / 2
        offset = (weight * middle).sum(axis=1) / np.maximum(total, 1e-6)
        edge = points + offset[:, None] * inwards
        line = _fit_line(edge[total > 0.3 * np.median(total) + 1e-6])
        if line is None:
            return None
        lines.append(line)
    meets = [np.cross(lines[k - 1], lines[k]) for k in range(4)]
    return np.array([meet[:2] / meet[2] for meet in meets])


def _fit_line(points: np.ndarray) -> np.ndarray | None:
    """(3,) the line through most of (n, 2) points, homogeneous."""
    if len(points) < EDGE_POINTS // 3:
        return None
    vx, vy, x, y = cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01).ravel().astype(float)
    return np.cross([x, y, 1.0], [x + vx, y + vy, 1.0])
