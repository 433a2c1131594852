"""Find a printed patch in a photograph: whether it is there, its place, and how much of it shows."""

from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.printing.page import Paper
from toolkit.rooms.photos.corners import refine_outline
from toolkit.rooms.photos.prints.align import (
    FLAT,
    UNIT_CORNERS,
    PatchWarp,
    agreement,
    align,
    cell_centres,
    fit_warp,
    is_plausible,
    map_points,
    patch_values,
    sample_image,
)
from toolkit.rooms.photos.prints.features import LocalFeatures, describe_patch, find_features, guess_places

LEAST_CONFIDENCE, LEAST_OF_HALF = 0.65, 0.45
"""Least confidence of a patch of which less than half shows, and of any. Real prints of 50 pixels and more have 0.85 to
0.98 (69 of 69 found). Real photographs without the patch reach 0.56 in 855 searches. In the rig's photographs patches
that show half have 0.81 or more, and absent patches at most 0.38 in 720 searches."""
CELL_SHOWS = 0.4
"""Least correlation of photo and file in a cell of the patch that shows."""
SEARCH_PX = 1600
"""Longest side of the photo that is searched; larger photos are shrunk."""
ALIGN_PX = 220.0
"""Side at which patch and photo are aligned: at 100 texels, two pixels each."""
GUESSES = 4
SURE = 0.8
"""Confidence above which no other place is tried."""
LEAST_START = 0.12
MATCHES_STIFFNESS = 0.3
LEAD = 0.15
"""Least lead of the best patch over the next."""


@dataclass(frozen=True)
class PatchSighting:
    """A patch that was found.

    Attributes:
        corners_px: (4, 2) pixels of the file's upper left, upper right, lower right and lower left corners.
        homography: (3, 3) from (u, v, 1) on the patch, u right and v down, to pixels, of the nearest flat sheet.
        confidence: mean correlation of photo and file over the better half of the patch, at most 1.
        warp: the homography with the paper's bend.
        agreement: (5, 5) correlation by cell of the patch, rows down.
    """

    corners_px: np.ndarray
    homography: np.ndarray
    confidence: float
    warp: PatchWarp
    agreement: np.ndarray

    @property
    def shown(self) -> float:
        """Share of the patch that is not hidden, cut off, in glare or too slanted."""
        return float((self.agreement >= CELL_SHOWS).mean())


@dataclass(frozen=True)
class SearchedPhoto:
    """A photo (h, w, 3) uint8 sRGB made ready for several searches; `features` are of the picture at `scale`."""

    image: np.ndarray
    scale: float
    features: LocalFeatures


def search_photo(image: np.ndarray) -> SearchedPhoto:
    """Find the local features of (h, w, 3) uint8 sRGB once, for searches of several patches."""
    scale = min(1.0, SEARCH_PX / max(image.shape[:2]))
    return SearchedPhoto(image, scale, find_features(cv2.cvtColor(shrink_image(image, scale), cv2.COLOR_RGB2GRAY)))


def find_patch(
    image: np.ndarray | SearchedPhoto, patch_pixels: np.ndarray, expected_px: np.ndarray | None = None
) -> PatchSighting | None:
    """Find a printed patch in a photograph.

    Args:
        image: (h, w, 3) uint8 sRGB, or the same from `search_photo`.
        patch_pixels: (n, n, 3) uint8 sRGB, the file.
        expected_px: (4, 2) its corners by the camera's pose; this place is tried as well.

    Returns:
        None if it is not seen (`is_believed`).
    """
    photo = image if isinstance(image, SearchedPhoto) else search_photo(image)
    # starts come in groups, the likeliest first
    best: PatchSighting | None = None
    for starts in _starts(photo, patch_pixels, expected_px):
        sighting = _look(photo.image, patch_pixels, starts)
        if sighting is not None and (best is None or sighting.confidence > best.confidence):
            best = sighting
        if best is not None and best.confidence > SURE:
            break  # no other place can be as good
    return best if best is not None and is_believed(best) else None


def find_there(image: np.ndarray, patch_pixels: np.ndarray, there: PatchWarp) -> PatchSighting | None:
    """Find a print, as `find_patch`, in its place by the camera's pose, give or take some pixels.

    Places in the result are of the part of the image round it.
    """
    corners, reach = there.corners, there.side_px / 2
    low, high = (np.maximum(side, 0).astype(int) for side in (corners.min(axis=0) - reach, corners.max(axis=0) + reach))
    part = np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]])
    there = there.moved(-low)
    if not is_plausible(there, part.shape):
        return None
    sighting = _look(part, patch_pixels, [there])
    return sighting if sighting is not None and is_believed(sighting) else None


def is_believed(sighting: PatchSighting) -> bool:
    """Whether a sighting is no chance likeness: plainly alike, or alike enough with half of the patch showing."""
    return sighting.confidence >= (LEAST_OF_HALF if sighting.shown >= 0.5 else LEAST_CONFIDENCE)


def rectify_patch(image: np.ndarray, sighting: PatchSighting, n_px: int) -> np.ndarray:
    """(n_px, n_px, 3) uint8: the patch as the photo has it, straightened, the file's upper left corner first."""
    scale = min(1.0, n_px / max(sighting.warp.side_px, 1.0))
    at = sighting.warp.scaled(scale).to_pixels(cell_centres(n_px)).reshape(n_px, n_px, 2)
    return sample_image(shrink_image(image, scale), at)


def _starts(photo: SearchedPhoto, patch_pixels: np.ndarray, expected_px: np.ndarray | None) -> list[list[PatchWarp]]:
    """List places to try, in the whole photo's pixels, the likeliest first; each bent and flat."""
    starts: list[list[PatchWarp]] = []
    # affine from the features, then a homography, then bent: each from the one before
    for guess in guess_places(photo.features, describe_patch(patch_pixels), GUESSES):
        flat = PatchWarp(np.vstack([guess.affine, [0, 0, 1.0]]), FLAT)
        near_px = 0.02 * flat.side_px
        fitted = fit_warp(guess.uv, guess.px, flat, float("inf"), near_px)
        bent = fit_warp(guess.uv, guess.px, fitted, MATCHES_STIFFNESS, near_px)
        shape = tuple(round(side * photo.scale) for side in photo.image.shape[:2])
        # a homography of few matches may be wild: the affine map is the last resort
        good = [warp.scaled(1 / photo.scale) for warp in (bent, fitted, flat) if is_plausible(warp, shape)]
        starts.append(good[:2])
    if expected_px is not None:
        corners = np.asarray(expected_px, np.float32)
        there = PatchWarp(cv2.getPerspectiveTransform(UNIT_CORNERS.astype(np.float32), corners), FLAT)
        if is_plausible(there, photo.image.shape):
            starts.append([there])
    return [start for start in starts if start]


def _look(image: np.ndarray, patch_pixels: np.ndarray, starts: list[PatchWarp]) -> PatchSighting | None:
    """Align the patch with a place of the photo and measure how well it fits; None if it plainly does not."""
    scale = min(1.0, ALIGN_PX / starts[0].side_px)
    small = shrink_image(image, scale).astype(np.float32) / 255
    colour, grey = patch_values(patch_pixels)
    ranked = [(_confidence(agreement(small, colour, start.scaled(scale))), start.scaled(scale)) for start in starts]
    likeness, start = max(ranked, key=lambda pair: pair[0])
    if likeness < LEAST_START:
        return None
    warp = align(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), grey, start)
    scores = agreement(small, colour, warp)
    warp = warp.scaled(1 / scale)
    return PatchSighting(warp.corners, warp.homography, _confidence(scores), warp, agreement=scores)


def _confidence(scores: np.ndarray) -> float:
    """Mean over the better half of the cells: the rest may be hidden."""
    return float(np.sort(scores, axis=None)[-(scores.size // 2) :].mean())


def shrink_image(image: np.ndarray, scale: float) -> np.ndarray:
    """Shrink a photo (h, w, 3) to `scale` of its size, in both directions exactly, so that places scale alike."""
    if scale >= 1:
        return image
    h, w = image.shape[:2]
    size = (max(1, round(w * scale)), max(1, round(h * scale)))
    if max(abs(size[0] - w * scale), abs(size[1] - h * scale)) < 1e-6:
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    # blurred before sampling, against aliasing
    blurred = cv2.GaussianBlur(image, (0, 0), 0.4 / scale)
    # pixel centres lie at halves: this offset keeps (0.5, 0.5) scaled where the other size has it
    half = 0.5 / scale - 0.5
    T = np.array([[1 / scale, 0, half], [0, 1 / scale, half]])
    return np.asarray(cv2.warpAffine(
        blurred, T, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    ))  # fmt: skip


SIZE_TOLERANCE = 0.02
"""Tolerance of the measured side, as a share: 'fit to page' makes 97 % or less, and photographs of the rig measure
within 0.4 %."""
LEAST_SHARE = 0.12
"""Smallest share of the photo that the sheet must cover."""
EDGE_SEARCH_PX = 1000
REACH_PX = 6
SQUARE = 0.02
"""Largest difference of a measured patch's sides, as a share; otherwise another sheet was found."""


def measure_on_page(image: np.ndarray, sighting: PatchSighting, paper: Paper) -> tuple[float, float] | None:
    """Measure a patch against the edges of the sheet that it is printed on.

    Args:
        image: (h, w, 3) uint8 sRGB of the whole uncut sheet, flat, on a darker ground.
        sighting: the patch in it.
        paper: the sheet.

    Returns:
        Mean sides in mm along the file's rows and columns, or None if the sheet's four edges are not seen, or do not
        make the patch a square.
    """
    # the patch must lie on the sheet
    page, middle = find_page(image), sighting.corners_px.mean(axis=0).tolist()
    if page is None or cv2.pointPolygonTest(page.astype(np.float32), middle, False) < 0:
        return None
    found: list[tuple[float, float]] = []
    # the sheet may lie either way round: the right turn makes the patch square
    for width, height in ((paper.width_mm, paper.height_mm), (paper.height_mm, paper.width_mm)):
        sheet = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
        T_mm_px = cv2.getPerspectiveTransform(page.astype(np.float32), sheet).astype(float)
        corners = map_points(T_mm_px, sighting.corners_px)
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        found.append((float(sides[[0, 2]].mean()), float(sides[[1, 3]].mean())))
    across, down = min(found, key=lambda pair: abs(np.log(pair[0] / pair[1])))
    return (across, down) if abs(np.log(across / down)) < SQUARE else None


def find_page(image: np.ndarray) -> np.ndarray | None:
    """(4, 2) corners of the largest bright quadrilateral, clockwise in the picture; None if there is none."""
    scale = min(1.0, EDGE_SEARCH_PX / max(image.shape[:2]))
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
    # the approximation's tolerance follows the sheet's size, so that creased corners stay single
    rough = cv2.approxPolyDP(largest, 0.03 * cv2.arcLength(largest, True), True).reshape(-1, 2)
    if len(rough) != 4 or (rough <= 1).any() or (rough >= np.array(size) - 2).any():
        return None
    factor = np.array([image.shape[1] / size[0], image.shape[0] / size[1]])
    # clockwise in the picture, beginning with the upper left corner
    rough = rough.astype(float) + 0.5
    about = rough - rough.mean(axis=0)
    turned = rough[np.argsort(np.arctan2(about[:, 1], about[:, 0]))]
    corners = np.roll(turned, -int(turned.sum(axis=1).argmin()), axis=0) * factor
    # inverted, as paper is lighter than its ground
    return refine_outline(255 - cv2.GaussianBlur(image.min(axis=2), (0, 0), 1.0), corners - 0.5, REACH_PX / scale) + 0.5
