"""Guess places of a patch in a photograph: local features of the file from many sides, matched with the photo's.

A SIFT feature (Lowe 2004) has a place, a size and a direction, and the file is viewed at simulated slants (ASIFT: Morel
and Yu 2009). So each match of two features is a whole guess of the patch's place. Guesses that many matches agree on
come first; nothing here is random.

Convention: places on the patch are (u, v) from 0 to 1, u right and v down; pixel centres lie at halves.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

VIEW_PX = 144
"""Side of the upright view: patches are seen at 50 to 300 px, and features reach an octave or two down from there."""
SLANTS = (1.0, 1.5, 2.2, 3.2)
"""Compression across the line of sight, 1 / cos of the angle: up to 72°."""
TURN_STEP_DEG = 60.0
"""Between two slants' directions, divided by the slant, as ASIFT does."""
MIN_CONTRAST = 0.012
MAX_FEATURES = 3000
RATIO = 0.86
"""Lowe's ratio: the next best place on the patch must be at least this much worse."""
CELLS = 16
"""Cells each way of the patch; neighbouring cells are the same place."""
TOLERANCE = 0.07
"""Largest distance of a match from a guess's prediction, as a share of the patch, which is bent and tilted."""
DRIFT = 0.15
"""Growth of that distance per patch side between guess and match."""
MIN_SUPPORT = 3
MAX_SHEAR = 6.0


@dataclass(frozen=True)
class LocalFeatures:
    """Local features.

    Attributes:
        frames: (k, 2, 3) affine maps from the feature's own unit circle to pixels of the photo, or to (u, v).
        descriptors: (k, 128) float32, square root of SIFT's shares.
    """

    frames: np.ndarray
    descriptors: np.ndarray


@dataclass(frozen=True)
class Guess:
    """A place where the patch may lie.

    Attributes:
        affine: (2, 3) from (u, v) to pixels.
        support: number of matches that agree.
        uv, px: (support, 2) those matches' places.
    """

    affine: np.ndarray
    support: int
    uv: np.ndarray
    px: np.ndarray


def find_features(grey: np.ndarray) -> LocalFeatures:
    """SIFT features of (h, w) uint8, the strongest `MAX_FEATURES`."""
    sift = cv2.SIFT.create(nfeatures=MAX_FEATURES, contrastThreshold=MIN_CONTRAST, edgeThreshold=12)
    found, descriptors = sift.detectAndCompute(grey, None)
    if descriptors is None:
        return LocalFeatures(np.zeros((0, 2, 3)), np.zeros((0, 128), np.float32))
    # OpenCV's keypoints have pixel centres at integers
    place = np.array([point.pt for point in found]) + 0.5
    # a keypoint's size is its diameter
    radius = np.array([point.size for point in found]) / 2
    angle = np.radians([point.angle for point in found])
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    frames = np.stack([np.stack([x, -y, place[:, 0]], -1), np.stack([y, x, place[:, 1]], -1)], axis=1)
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
    # roots of shares have unit length, so that a dot product is a likeness from 0 to 1
    return LocalFeatures(frames, np.sqrt(shares).astype(np.float32))


def describe_patch(pixels: np.ndarray) -> LocalFeatures:
    """Features of a patch (n, n, 3) uint8 sRGB from all simulated sides; kept for the next photo."""
    return _describe_patch(np.ascontiguousarray(pixels).tobytes(), pixels.shape[0])


@lru_cache(maxsize=16)
def _describe_patch(content: bytes, n: int) -> LocalFeatures:
    pixels = np.frombuffer(content, np.uint8).reshape(n, n, 3)
    # at least twice the view's side, so that shrinking to it averages texels and does not alias
    repeat = max(1, -(-2 * VIEW_PX // n))
    grey = cv2.cvtColor(pixels.repeat(repeat, 0).repeat(repeat, 1), cv2.COLOR_RGB2GRAY)
    upright = cv2.resize(grey, (VIEW_PX, VIEW_PX), interpolation=cv2.INTER_AREA)
    frames, descriptors = [], []
    # the steeper the slant, the finer the turns
    for slant in SLANTS:
        for turn_deg in np.arange(0, 180, TURN_STEP_DEG / slant) if slant > 1 else (0.0,):
            view, T_view_patch = slant_view(upright, slant, float(turn_deg))
            features = find_features(view)
            to_patch = np.linalg.inv(T_view_patch)
            frames.append(_compose(to_patch[None, :2], features.frames))
            descriptors.append(features.descriptors)
    every = LocalFeatures(np.concatenate(frames), np.concatenate(descriptors))
    # features of the white margin belong to no patch
    inside = ((every.frames[:, :, 2] > 0) & (every.frames[:, :, 2] < 1)).all(axis=1)
    return LocalFeatures(every.frames[inside], every.descriptors[inside])


def slant_view(upright: np.ndarray, slant: float, turn_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Draw the square on white paper, turned and then compressed in x; also returns `T_view_patch` (3, 3)."""
    side = upright.shape[0]
    cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turned = np.array([[cosine, -sine], [sine, cosine]]) * side
    linear = np.diag([1 / slant, 1.0]) @ turned
    corners = linear @ np.array([[0, 1, 1, 0], [0, 0, 1, 1.0]])
    # the square, turned and then compressed along x, as seen at a slant
    margin = 16
    low, high = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    # the view holds the whole square with a margin
    T = np.eye(3)
    T[:2, :2], T[:2, 2] = linear, -low
    size = tuple(int(x) for x in np.ceil(high - low))
    blurred = upright
    if slant > 1:  # blurred along the direction that is compressed, against aliasing
        blurred = _blur_along(upright, turn_deg, 0.6 * np.sqrt(slant**2 - 1))
    # from the upright picture's pixels to the unit square
    pixel = np.diag([1 / side, 1 / side, 1.0])
    view = cv2.warpAffine(
        blurred, to_cv(T @ pixel)[:2], size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=235
    )
    return view, T


def _blur_along(image: np.ndarray, turn_deg: float, sigma: float) -> np.ndarray:
    """Blur along the direction in the image that a turn by `turn_deg` brings to x."""
    cosine, sine = np.cos(np.radians(turn_deg)), -np.sin(np.radians(turn_deg))
    reach = int(np.ceil(3 * sigma)) + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    along, across = x * cosine + y * sine, -x * sine + y * cosine
    kernel = np.exp(-(along**2) / (2 * sigma**2) - across**2 / (2 * 0.4**2))
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE))


def to_cv(T: np.ndarray) -> np.ndarray:
    """The same map between pixels whose centres are integers, as OpenCV's warps have it."""
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    return np.linalg.inv(half) @ T @ half


def _compose(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """(k, 2, 3) composition of affine maps, each k or a single map."""
    linear = outer[:, :, :2] @ inner[:, :, :2]
    shift = (outer[:, :, :2] @ inner[:, :, 2:]) + outer[:, :, 2:]
    return np.concatenate([linear, shift], axis=2)


def match_features(photo: LocalFeatures, patch: LocalFeatures) -> tuple[np.ndarray, np.ndarray]:
    """Match features that look alike, as nothing else on the patch does; returns numbers in photo and patch."""
    if min(len(photo.descriptors), len(patch.descriptors)) == 0:
        return np.zeros(0, int), np.zeros(0, int)
    # the cells of the patch that features lie in: likeness is compared cell by cell
    cell = (np.clip(patch.frames[:, :, 2], 0, 0.999) * CELLS).astype(int) @ [CELLS, 1]
    order = np.argsort(cell, kind="stable")
    cells, starts = np.unique(cell[order], return_index=True)
    likeness = photo.descriptors @ patch.descriptors[order].T
    # the best feature of each cell; its rival is the best outside of the cell and its neighbours
    by_cell = np.maximum.reduceat(likeness, starts, axis=1)
    best_cell = by_cell.argmax(axis=1)
    best = by_cell[np.arange(len(by_cell)), best_cell]
    place = np.stack([cells // CELLS, cells % CELLS], axis=1)
    is_near = np.abs(place[:, None] - place[None]).max(axis=2) <= 1
    elsewhere = np.where(is_near[best_cell], -1, by_cell).max(axis=1)
    # unit vectors: the squared distance is 2 - 2 likeness
    kept = np.flatnonzero(1 - best < RATIO**2 * (1 - elsewhere))
    return kept, order[likeness[kept].argmax(axis=1)]


def guess_places(photo: LocalFeatures, patch: LocalFeatures, most: int = 6) -> list[Guess]:
    """Return up to `most` different places, in the order of the matches that agree."""
    of_photo, of_patch = match_features(photo, patch)
    if len(of_photo) < MIN_SUPPORT:
        return []
    # each match alone is a whole guess: from the patch's feature to the photograph's
    px, uv = photo.frames[of_photo, :, 2], patch.frames[of_patch, :, 2]
    affine = _compose(photo.frames[of_photo], _invert(patch.frames[of_patch]))
    stretch = np.linalg.svd(affine[:, :, :2], compute_uv=False)
    # a positive determinant: a print is not seen mirrored
    sane = (stretch[:, 0] < MAX_SHEAR * stretch[:, 1]) & (np.linalg.det(affine[:, :, :2]) > 0)
    # measured on the patch itself, so that a slanted guess is not lenient along its short side
    back = _invert(np.where(sane[:, None, None], affine, np.eye(2, 3)))
    seen = np.einsum("kij,nj->kni", back[:, :, :2], px) + back[:, None, :, 2]
    # the tolerance grows with the distance from the feature, where a guess errs most
    far = np.linalg.norm(uv[None] - uv[:, None], axis=2)
    votes = (np.linalg.norm(seen - uv[None], axis=2) < TOLERANCE + DRIFT * far) & sane[:, None]
    # the guess with most votes first; its voters are then taken out
    guesses: list[Guess] = []
    left = votes.copy()
    while len(guesses) < most:
        best = int(_count_places(left, uv).argmax())
        voters = left[best]
        if voters.sum() < MIN_SUPPORT:
            break
        guesses.append(_refine(affine[best], uv, px, voters))
        left = left & ~voters[None] & ~voters[:, None]
    return guesses


def _count_places(votes: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(k,) number of places on the patch that vote for each guess: features on the same spot count once."""
    cells = (np.clip(uv, 0, 0.999) * 12).astype(int) @ [12, 1]
    is_in = np.zeros((len(uv), 144), np.float32)
    is_in[np.arange(len(uv)), cells] = 1
    # the number of votes only breaks ties between guesses with as many places
    return ((votes.astype(np.float32) @ is_in) > 0).sum(axis=1) + votes.sum(axis=1) * 1e-3


def _refine(affine: np.ndarray, uv: np.ndarray, px: np.ndarray, voters: np.ndarray) -> Guess:
    """Fit the affine map to its voters, if there are enough of them."""
    # with fewer points the fit would follow each of them
    if voters.sum() >= 5:
        a = np.c_[uv[voters], np.ones(voters.sum())]
        weight = np.ones(len(a))
        for _ in range(5):
            fit = np.linalg.lstsq(a * weight[:, None], px[voters] * weight[:, None], rcond=None)[0].T
            miss = np.linalg.norm(px[voters] - a @ fit.T, axis=1)
            # the root, as least squares squares it: these are Cauchy's weights
            weight = 1 / np.sqrt(1 + (miss / max(np.median(miss), 0.5)) ** 2)
        stretch = np.linalg.svd(fit[:, :2], compute_uv=False)
        if np.linalg.det(fit[:, :2]) > 0 and stretch[0] < MAX_SHEAR * stretch[1]:
            affine = fit
    return Guess(affine, int(voters.sum()), uv[voters], px[voters])


def _invert(frames: np.ndarray) -> np.ndarray:
    linear = np.linalg.inv(frames[:, :, :2])
    return np.concatenate([linear, -linear @ frames[:, :, 2:]], axis=2)
