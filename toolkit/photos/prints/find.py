"""The printed patch in a photograph: whether it is there, which one it is, where it lies, and how much of it shows."""

from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.photos.prints.align import (
    FLAT,
    UNIT_CORNERS,
    PatchWarp,
    agreement,
    align,
    fit_warp,
    is_plausible,
    patch_values,
    sample_image,
)
from toolkit.photos.prints.features import Features, describe_patch, find_features, guess_places

LEAST_CONFIDENCE, LEAST_OF_HALF = 0.65, 0.45
"""Below the first a patch of which less than half shows counts as not there; below the second any. Real prints of 50
pixels and more had 0.85 to 0.98 (69 of 69 found); in 855 looks at real photographs without the patch chance came to
0.55 and 0.56. Of 216 of the rig's photos at 640 × 480 (four objects, 18 poses; bare, with their patch, with another),
all 122 that show half of a patch at less than 78° from straight on had it at 0.81 or more; of 720 looks for a patch
that was not there none was over 0.38."""
CELL_SHOWS = 0.4
"""A cell of the patch shows where photo and file correlate this much."""
SEARCH_PX = 1600
"""Longest side of the photo that is searched; larger ones are shrunk."""
ALIGN_PX = 220.0
"""Side at which patch and photo are aligned: at 100 texels, two pixels each."""
GUESSES = 4
SURE = 0.8
"""Above it no other place is looked at."""
LEAST_START = 0.12
MATCHES_STIFFNESS = 0.3
LEAD = 0.15
"""By how much the best patch must lead the next, for it to be that one and no other."""


@dataclass(frozen=True)
class PatchSighting:
    """A patch that was found.

    Attributes:
        corners_px: (4, 2) where the file's upper left, upper right, lower right and lower left corners lie in the
            photo, in pixels whose first one's centre is (0.5, 0.5).
        homography: (3, 3) from (u, v, 1) on the patch, u right and v down in [0, 1], to pixels: the flat sheet that
            lies nearest.
        inliers: points on the patch that lie within a pixel of where they should.
        confidence: mean correlation of photo and file over the half of the patch that agrees best, at most 1.
        warp: the same with the paper's bend.
        agreement: (5, 5) correlation by cell of the patch, rows down.
    """

    corners_px: np.ndarray
    homography: np.ndarray
    inliers: int
    confidence: float
    warp: PatchWarp
    agreement: np.ndarray

    @property
    def shown(self) -> float:
        """Share of the patch that shows: 1 less what is hidden, cut off, in glare or too slanted to be seen."""
        return float((self.agreement >= CELL_SHOWS).mean())


@dataclass(frozen=True)
class SearchedPhoto:
    """A photo made ready to be searched for several patches; see `search_photo`.

    Attributes:
        image: (h, w, 3) uint8 sRGB, as large as it came.
        scale: from it to the size that was searched.
        features: of the searched one, in its own pixels.
    """

    image: np.ndarray
    scale: float
    features: Features


def search_photo(image: np.ndarray) -> SearchedPhoto:
    """Find the local features of (h, w, 3) uint8 sRGB once, so that looking for another patch costs little."""
    scale = min(1.0, SEARCH_PX / max(image.shape[:2]))
    return SearchedPhoto(image, scale, find_features(cv2.cvtColor(shrink_image(image, scale), cv2.COLOR_RGB2GRAY)))


def find_patch(
    image: np.ndarray | SearchedPhoto, patch_pixels: np.ndarray, expected_px: np.ndarray | None = None
) -> PatchSighting | None:
    """Find a printed patch in a photograph.

    Args:
        image: (h, w, 3) uint8 sRGB, or the same from `search_photo`.
        patch_pixels: (n, n, 3) uint8 sRGB, the file.
        expected_px: (4, 2) where its corners are thought to lie, when that is known from the camera's pose; it is
            looked for there as well.

    Returns:
        Where it lies, or None where it is not seen (`is_believed`).
    """
    photo = image if isinstance(image, SearchedPhoto) else search_photo(image)
    best: PatchSighting | None = None
    for starts in _starts(photo, patch_pixels, expected_px):
        sighting = _look(photo.image, patch_pixels, starts)
        if sighting is not None and (best is None or sighting.confidence > best.confidence):
            best = sighting
        if best is not None and best.confidence > SURE:
            break  # no other place can be as good
    return best if best is not None and is_believed(best) else None


def is_believed(sighting: PatchSighting) -> bool:
    """Whether a sighting is no chance likeness: plainly alike, or alike enough with half of the patch showing."""
    if sighting.confidence >= LEAST_CONFIDENCE:
        return True
    return sighting.confidence >= LEAST_OF_HALF and sighting.shown >= 0.5


def rectify_patch(image: np.ndarray, sighting: PatchSighting, n_px: int) -> np.ndarray:
    """(n_px, n_px, 3) uint8: the patch as the photo has it, straightened, the file's upper left corner first."""
    steps = (np.arange(n_px) + 0.5) / n_px
    uv = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    scale = min(1.0, n_px / max(sighting.warp.side_px, 1.0))
    at = sighting.warp.scaled(scale).to_pixels(uv).reshape(n_px, n_px, 2)
    return sample_image(shrink_image(image, scale), at)


def _starts(photo: SearchedPhoto, patch_pixels: np.ndarray, expected_px: np.ndarray | None) -> list[list[PatchWarp]]:
    """Where to look, in the whole photo's pixels, the likeliest place first; of each, bent and flat."""
    starts: list[list[PatchWarp]] = []
    for guess in guess_places(photo.features, describe_patch(patch_pixels), GUESSES):
        flat = PatchWarp(np.vstack([guess.affine, [0, 0, 1.0]]), FLAT)
        near_px = 0.02 * flat.side_px
        fitted = fit_warp(guess.uv, guess.px, flat, float("inf"), near_px)
        bent = fit_warp(guess.uv, guess.px, fitted, MATCHES_STIFFNESS, near_px)
        shape = tuple(round(side * photo.scale) for side in photo.image.shape[:2])
        good = [one.scaled(1 / photo.scale) for one in (bent, fitted, flat) if is_plausible(one, shape)]
        starts.append(good[:2])
    if expected_px is not None:
        corners = np.asarray(expected_px, np.float32)
        there = PatchWarp(cv2.getPerspectiveTransform(UNIT_CORNERS.astype(np.float32), corners), FLAT)
        if is_plausible(there, photo.image.shape):
            starts.append([there])
    return [start for start in starts if start]


def _look(image: np.ndarray, patch_pixels: np.ndarray, starts: list[PatchWarp]) -> PatchSighting | None:
    """Align the patch with one place of the photo and measure how well it fits; None where it plainly does not."""
    scale = min(1.0, ALIGN_PX / starts[0].side_px)
    small = shrink_image(image, scale).astype(np.float32) / 255
    colour, grey = patch_values(patch_pixels)
    ranked = [(_confidence(agreement(small, colour, one.scaled(scale))), one.scaled(scale)) for one in starts]
    likeness, start = max(ranked, key=lambda pair: pair[0])
    if likeness < LEAST_START:
        return None
    warp, inliers = align(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), grey, start)
    scores = agreement(small, colour, warp)
    warp = warp.scaled(1 / scale)
    return PatchSighting(warp.corners, warp.homography, inliers, _confidence(scores), warp, agreement=scores)


def _confidence(scores: np.ndarray) -> float:
    """Mean over the better half of the cells: the rest may be hidden."""
    return float(np.sort(scores, axis=None)[-(scores.size // 2) :].mean())


def shrink_image(image: np.ndarray, scale: float) -> np.ndarray:
    """A photo (h, w, 3) at `scale` of its size, at most 1: pixel places scale by that number exactly."""
    if scale >= 1:
        return image
    # exact in both directions, so that places can be scaled by the one number
    h, w = image.shape[:2]
    size = (max(1, round(w * scale)), max(1, round(h * scale)))
    if max(abs(size[0] - w * scale), abs(size[1] - h * scale)) < 1e-6:
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    blurred = cv2.GaussianBlur(image, (0, 0), 0.4 / scale)
    half = 0.5 / scale - 0.5
    T = np.array([[1 / scale, 0, half], [0, 1 / scale, half]])
    return np.asarray(cv2.warpAffine(
        blurred, T, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    ))  # fmt: skip
