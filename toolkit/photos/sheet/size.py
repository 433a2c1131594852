"""How large the printed patch is and where it sticks, in millimetres; and at which scale its page was printed."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import TableObject
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.photos.sheet.align import UNIT_CORNERS, map_points, sample_image
from toolkit.photos.sheet.find import CELL_SHOWS, PatchSighting
from toolkit.printing.page import Paper
from toolkit.rig.camera import Camera
from toolkit.rig.mount import SAMPLES, mount_patch

SIZE_TOLERANCE = 0.02
"""Share by which the measured side may differ from the record's: 'fit to page' makes 97 % or less, and one photo of the
rig with the camera known measures within 0.4 %."""
BESIDE = 0.3
"""The surface goes on for this share of the sheet on each side, for a patch that is stuck beside its place."""
GRID = 21
EDGE = 0.02
LEAST_POINTS = 20
LEAST_PARALLAX_DEG = 8.0
LOOSE_MM = 0.5


@dataclass(frozen=True)
class View:
    """A photo in which the patch was found, and its camera."""

    sighting: PatchSighting
    lens: Camera
    T_world_camera: np.ndarray


@dataclass(frozen=True)
class Surface:
    """What the patch is stuck to, unrolled.

    Attributes:
        triangles_mm: (m, 3, 3) corners of triangles in the world.
        flat_mm: (m, 3, 2) the same on the unrolled surface, x right and y up from the middle of the patch's place.
    """

    triangles_mm: np.ndarray
    flat_mm: np.ndarray


@dataclass(frozen=True)
class PatchMeasure:
    """A patch, measured.

    Attributes:
        size_mm: side of the square of equal area.
        across_mm, down_mm: its sides, along the file's rows and columns.
        corners_mm: (4, 2) its corners (upper left, upper right, lower right, lower left of the file) on the unrolled
            surface, from the middle of the place where it should be; NaN where that place is not known.
        residual_mm: how far from a flat parallelogram its points are, root mean square.
    """

    size_mm: float
    across_mm: float
    down_mm: float
    corners_mm: np.ndarray
    residual_mm: float


@dataclass(frozen=True)
class SizeCheck:
    """Measured against printed size.

    Attributes:
        scale: measured side as a share of the expected one, median over the photos.
        spread: highest less lowest of the photos' own.
        tolerance: how far from 1 the scale may be.
        photos: how many were measured.
        passed: whether it is within.
        advice: what to do where it is not.
    """

    scale: float
    spread: float
    tolerance: float
    photos: int
    passed: bool
    advice: str


def mount_surface(item: TableObject, size_mm: float) -> Surface:
    """The surface that an object's patch is stuck to, as its spec says where, continued straight on around it.

    Args:
        item: the object on the table.
        size_mm: side of the patch as it should be printed, which decides how the sheet bends.

    Raises:
        ToolkitError: the patch cannot be mounted there.
    """
    sheet = mount_patch(item.mesh, np.zeros((8, 8, 3), np.uint8), size_mm, item.spec.patch, item.name).mesh
    # the printed face comes first: points along the bend, at both straight edges
    place = sheet.vertices[: 2 * SAMPLES].reshape(SAMPLES, 2, 3).astype(float)
    flat = ((sheet.uv[: 2 * SAMPLES] - 0.5) * (size_mm + 2 * TAPE_MARGIN_MM)).reshape(SAMPLES, 2, 2).astype(float)
    place, flat = (_continue(_continue(grid, 0), 1) for grid in (place, flat))
    cells = [(grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]) for grid in (place, flat)]
    triangles, unrolled = (
        np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]) for a, b, c, d in cells
    )
    return Surface(triangles.reshape(-1, 3, 3), unrolled.reshape(-1, 3, 2))


def _continue(grid: np.ndarray, axis: int) -> np.ndarray:
    """Add a row of points before the first and after the last along an axis, `BESIDE` of the sheet's length away."""
    grid = np.moveaxis(grid, axis, 0)
    steps = BESIDE * (len(grid) - 1)
    before, after = grid[0] + (grid[0] - grid[1]) * steps, grid[-1] + (grid[-1] - grid[-2]) * steps
    return np.moveaxis(np.concatenate([before[None], grid, after[None]]), 0, axis)


def flat_surface(T_world_plane: np.ndarray, reach_mm: float = 500.0) -> Surface:
    """A plane: x right, y up, z towards the camera; the identity is the table, for a page that lies on it."""
    flat = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * reach_mm
    place = np.c_[flat, np.zeros(4)] @ T_world_plane[:3, :3].T + T_world_plane[:3, 3]
    halves = [[0, 1, 2], [0, 2, 3]]
    return Surface(place[halves], flat[halves])


def measure_patch(view: View, surface: Surface) -> PatchMeasure | None:
    """Measure a patch on a known surface; None where too little of it is seen there."""
    uv = _seen_places(view.sighting)
    if len(uv) < LEAST_POINTS:
        return None
    flat, hit = _unroll(surface, *_sight_lines(view, view.sighting.place.to_pixels(uv)))
    if hit.sum() < LEAST_POINTS:
        return None
    return _measure_flat(uv[hit], flat[hit])


def triangulate_patch(views: Sequence[View]) -> PatchMeasure | None:
    """Measure a patch that did not move between photos, whatever it is stuck to; None where they see it too alike.

    Each point is where the lines of sight of at least two photos come nearest; lengths are then summed along the
    paper, from point to point.
    """
    uv = _grid()
    lines = [_sight_lines(view, view.sighting.place.to_pixels(uv)) for view in views]
    seen = np.stack([_shows(view.sighting, uv) for view in views]) if lines else np.zeros((0, len(uv)), bool)
    points = np.full((len(uv), 3), np.nan)
    for k in np.flatnonzero(seen.sum(axis=0) >= 2):
        origins = np.stack([line[0][k] for line, sees in zip(lines, seen[:, k], strict=True) if sees])
        along = np.stack([line[1][k] for line, sees in zip(lines, seen[:, k], strict=True) if sees])
        if np.degrees(np.arccos(np.clip((along @ along.T).min(), -1, 1))) < LEAST_PARALLAX_DEG:
            continue
        across = np.eye(3) - along[:, :, None] * along[:, None]
        points[k] = np.linalg.solve(across.sum(axis=0), (across @ origins[..., None]).sum(axis=0))[:, 0]
    net = points.reshape(GRID, GRID, 3)
    pitch = 1 / (GRID - 1) * (1 - 2 * EDGE)
    right = np.linalg.norm(np.diff(net, axis=1), axis=2) / pitch
    down = np.linalg.norm(np.diff(net, axis=0), axis=2) / pitch
    if min(np.isfinite(right).sum(), np.isfinite(down).sum()) < LEAST_POINTS:
        return None
    across_mm, down_mm = float(np.nanmedian(right)), float(np.nanmedian(down))
    spread = float(np.nanstd(np.r_[right.ravel() - across_mm, down.ravel() - down_mm]) * pitch)
    return PatchMeasure(float(np.sqrt(across_mm * down_mm)), across_mm, down_mm, np.full((4, 2), np.nan), spread)


def check_size(measures: Sequence[PatchMeasure], expected_mm: float, tolerance: float = SIZE_TOLERANCE) -> SizeCheck:
    """Compare measured sides with the one that should have been printed, by the median over photos.

    Raises:
        ToolkitError: there is no measure.
    """
    if not measures:
        raise ToolkitError("the patch was measured in no photo: expected at least one with a known camera")
    scales = np.array([measure.size_mm for measure in measures]) / expected_mm
    scale = float(np.median(scales))
    passed = abs(scale - 1) <= tolerance
    advice = "" if passed else (
        f"the patch measures {scale * expected_mm:.1f} mm where {expected_mm:.1f} mm was meant ({scale:.1%}): print it "
        "again at 100 % ('actual size', not 'fit to page') and lay a ruler on the page's 100 mm bars"
    )  # fmt: skip
    return SizeCheck(scale, float(np.ptp(scales)), tolerance, len(scales), passed, advice)


def _grid() -> np.ndarray:
    steps = np.linspace(EDGE, 1 - EDGE, GRID)
    return np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)


def _shows(sighting: PatchSighting, uv: np.ndarray) -> np.ndarray:
    """(n,) whether the cell of the patch that each place lies in is seen."""
    cells = len(sighting.agreement)
    column, row = (np.clip(uv, 0, 0.999) * cells).astype(int).T
    return sighting.agreement[row, column] >= CELL_SHOWS


def _seen_places(sighting: PatchSighting) -> np.ndarray:
    uv = _grid()
    return uv[_shows(sighting, uv)]


def _sight_lines(view: View, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (n, 3) in the world of the lines of sight through pixels."""
    local = np.c_[view.lens.undistort(pixels), np.ones(len(pixels))]
    along = local @ view.T_world_camera[:3, :3].T
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.broadcast_to(view.T_world_camera[:3, 3], along.shape), along


def _unroll(surface: Surface, origins: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) where lines of sight first meet the surface, unrolled, and (n,) whether they do.

    Every line with every triangle (Moeller and Trumbore 1997); there are some hundred of each.
    """
    a, b, c = (surface.triangles_mm[:, k] for k in range(3))
    right, up = b - a, c - a
    across = np.cross(along[:, None], up[None])
    size = (across * right).sum(axis=2)
    size = np.where(np.abs(size) < 1e-9, np.nan, size)
    offset = origins[:, None] - a[None]
    u = (offset * across).sum(axis=2) / size
    turned = np.cross(offset, right[None])
    v = (turned * along[:, None]).sum(axis=2) / size
    depth = (turned * up).sum(axis=2) / size
    with np.errstate(invalid="ignore"):
        met = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6) & (depth > 0)
    depth = np.where(met, depth, np.inf)
    nearest = depth.argmin(axis=1)
    line = np.arange(len(along))
    hit = np.isfinite(depth[line, nearest])
    weight = np.stack([1 - u - v, u, v], axis=-1)[line, nearest]
    flat = np.einsum("nk,nkc->nc", weight, surface.flat_mm[nearest])
    return np.where(hit[:, None], flat, np.nan), hit


def _measure_flat(uv: np.ndarray, flat_mm: np.ndarray) -> PatchMeasure:
    """The parallelogram that fits pairs of places on the patch and on the unrolled surface, outliers left out."""
    terms = np.c_[uv, np.ones(len(uv))]
    weight = np.ones(len(uv))
    for _ in range(8):
        fit = np.linalg.lstsq(terms * weight[:, None], flat_mm * weight[:, None], rcond=None)[0]
        miss = np.linalg.norm(flat_mm - terms @ fit, axis=1)
        weight = 1 / np.sqrt(1 + (miss / LOOSE_MM) ** 2)
    across_mm, down_mm = (float(np.linalg.norm(side)) for side in fit[:2])
    corners = np.c_[UNIT_CORNERS, np.ones(4)] @ fit
    kept = weight > np.sqrt(0.1)
    residual = float(np.sqrt((miss[kept] ** 2).mean())) if kept.any() else float("inf")
    return PatchMeasure(float(np.sqrt(abs(np.linalg.det(fit[:2])))), across_mm, down_mm, corners, residual)


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
