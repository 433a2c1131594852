"""A patch's place in a photograph, made exact: a homography, and a smooth bend beside it, as paper bends."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

BEND_TERMS = 7
FLAT = np.zeros((BEND_TERMS, 2))
UNIT_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
LEAST_SIDE_PX = 6.0
INVERSE_STEPS = 12
FIT_STEPS = 8


@dataclass(frozen=True)
class PatchWarp:
    """From the patch to pixels.

    Attributes:
        homography: (3, 3), of (u, v, 1).
        bend: (7, 2) pixels added per quadratic and cubic term of (u, v), see `bend_terms`.
    """

    homography: np.ndarray
    bend: np.ndarray

    def to_pixels(self, uv: np.ndarray) -> np.ndarray:
        """(n, 2) pixels of places (n, 2)."""
        return map_points(self.homography, uv) + bend_terms(uv) @ self.bend

    def to_patch(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 2) places of pixels (n, 2) on the patch and a little round it."""
        back = np.linalg.inv(self.homography)
        uv = map_points(back, pixels)
        if self.bend.any():
            # the bend is small beside the homography, so going back and forth converges
            for _ in range(INVERSE_STEPS):
                # clipped: far outside of the patch the cubic terms grow without bound
                uv = map_points(back, pixels - bend_terms(np.clip(uv, -0.3, 1.3)) @ self.bend)
        return uv

    def scaled(self, factor: float) -> "PatchWarp":
        """In the same photo at another size."""
        return PatchWarp(np.diag([factor, factor, 1.0]) @ self.homography, self.bend * factor)

    def moved(self, by_px: np.ndarray) -> "PatchWarp":
        """In a picture that begins elsewhere."""
        shift = np.eye(3)
        shift[:2, 2] = by_px
        return PatchWarp(shift @ self.homography, self.bend)

    @property
    def corners(self) -> np.ndarray:
        """(4, 2) pixels of the file's upper left, upper right, lower right and lower left corner."""
        return self.to_pixels(UNIT_CORNERS)

    @property
    def side_px(self) -> float:
        """Root of the area that it covers."""
        return float(np.sqrt(max(area(self.corners), 0.0)))


def map_points(H: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2) points through a homography."""
    raised = points @ H[:, :2].T + H[:, 2]
    return raised[:, :2] / raised[:, 2:]


def bend_terms(uv: np.ndarray) -> np.ndarray:
    """(n, 7) the monomials of degree two and three, of coordinates from -1 to 1."""
    x, y = 2 * uv[:, 0] - 1, 2 * uv[:, 1] - 1
    xx, xy, yy = x * x, x * y, y * y
    return np.stack([xx, xy, yy, xx * x, xx * y, yy * x, yy * y], axis=1)


def cell_centres(n: int) -> np.ndarray:
    """(n², 2) middles of n × n cells of a patch, (u, v) in [0, 1], rows down."""
    steps = (np.arange(n) + 0.5) / n
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


def area(corners: np.ndarray) -> float:
    """Return the signed area of a quadrilateral, pixels²; positive if its corners run clockwise in the picture."""
    x, y = corners.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def is_plausible(warp: PatchWarp, shape: tuple[int, ...]) -> bool:
    """Whether the patch is a convex quadrilateral of some size, not mirrored, with its middle in the photo."""
    H = warp.homography
    if not (np.isfinite(H).all() and np.isfinite(warp.bend).all()) or abs(np.linalg.det(H)) < 1e-12:
        return False
    # the depth of all corners has the same sign if the whole patch is in front of the camera
    depth = UNIT_CORNERS @ H[2, :2] + H[2, 2]
    if (depth <= 1e-3 * depth.max()).any():
        return False
    # convex and not mirrored: all turns have the same sign; and no side, nor the width across any, is too short
    corners = warp.corners
    sides = np.roll(corners, -1, axis=0) - corners
    following = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]
    lengths = np.linalg.norm(sides, axis=1)
    if (turns <= 0).any() or lengths.min() < LEAST_SIDE_PX or turns.min() < LEAST_SIDE_PX / 2 * lengths.max():
        return False
    h, w = shape[:2]
    middle = corners.mean(axis=0)
    return bool((middle > 0).all() and middle[0] < w and middle[1] < h and lengths.max() < 1.5 * max(h, w))


def fit_warp(uv: np.ndarray, pixels: np.ndarray, start: PatchWarp, stiffness: float, near_px: float = 1.0) -> PatchWarp:
    """Fit the warp to pairs of places by robust least squares (Cauchy's weights).

    Args:
        uv, pixels: (n, 2) pairs; some may be wrong.
        start: to begin from, and returned if there are too few pairs.
        stiffness: cost of a bend, per square pixel of it; infinity keeps the patch flat.
        near_px: pairs that miss by much more than this hardly count.
    """
    flat = not np.isfinite(stiffness)
    # a homography has 8 numbers and a pair gives two; the bend has 14 more
    if len(uv) < (8 if flat else 12):
        return start
    # a homography is known up to a factor: its last number is kept at 1
    scale = start.homography[2, 2]
    h = (start.homography / scale).ravel()[:8]
    bend = FLAT if flat else start.bend
    terms = bend_terms(uv)
    for _ in range(FIT_STEPS):
        raised = np.c_[uv, np.ones(len(uv))] @ np.append(h, 1.0).reshape(3, 3).T
        miss = pixels - raised[:, :2] / raised[:, 2:] - terms @ bend
        # Cauchy's weight: half at `near_px`, and a wrong pair hardly counts
        weight = 1 / (1 + (miss**2).sum(axis=1) / near_px**2)
        jacobian = _jacobian(uv, raised, None if flat else terms)
        step = _solve_step(jacobian, miss, weight, None if flat else (stiffness, bend))
        if not np.isfinite(step).all():
            return start
        h = h + step[:8]
        bend = bend if flat else bend + step[8:].reshape(2, BEND_TERMS).T
    return PatchWarp(np.append(h, 1.0).reshape(3, 3), bend)


def _jacobian(uv: np.ndarray, raised: np.ndarray, terms: np.ndarray | None) -> np.ndarray:
    """(2, n, 8 or 22) derivatives of each pixel by the homography's numbers, and by the bend's if there are terms."""
    jacobian = np.zeros((2, len(uv), 8 if terms is None else 8 + 2 * BEND_TERMS))
    depth = raised[:, 2]
    for axis in (0, 1):
        jacobian[axis, :, 3 * axis : 3 * axis + 2] = uv / depth[:, None]
        jacobian[axis, :, 3 * axis + 2] = 1 / depth
        # of u / w and v / w by the last row's numbers: the quotient rule
        jacobian[axis, :, 6:8] = -uv * (raised[:, axis] / depth**2)[:, None]
        if terms is not None:
            jacobian[axis, :, 8 + BEND_TERMS * axis : 8 + BEND_TERMS * (axis + 1)] = terms
    return jacobian


def _solve_step(
    jacobian: np.ndarray, miss: np.ndarray, weight: np.ndarray, bending: tuple[float, np.ndarray] | None
) -> np.ndarray:
    """A Gauss-Newton step: change of the eight numbers of the homography and the fourteen of the bend.

    `miss` is (n, 2) pixels, `weight` (n,) of the pairs, `bending` the stiffness and the (7, 2) bend so far.
    """
    count = jacobian.shape[2]
    rows = jacobian.reshape(-1, count)
    both = np.tile(weight, 2)
    normal = rows.T @ (rows * both[:, None])
    right = rows.T @ (miss.T.ravel() * both)
    if bending is not None:
        stiffness, bend = bending
        # a bend costs more with more pairs, so that stiffness means the same for few and many
        cost = stiffness * weight.sum() / 10
        normal[8:, 8:] += cost * np.eye(2 * BEND_TERMS)
        right[8:] -= cost * bend.T.ravel()
    # scaled to a unit diagonal: pixels and bends differ in size, and the system is badly conditioned
    size = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / size[:, None] / size[None] + 1e-9 * np.eye(count)
    return np.linalg.solve(scaled, right / size) / size


SAMPLES = 3
"""Samples of a pixel each way: texels are as small as pixels, or smaller."""
CELLS = 5
"""Cells each way in which the patch is judged, as a part of it may be hidden or in a shadow."""
LEAST_PIXELS = 12
LEAST_CONTRAST = 0.004
MARGIN_PX = 8
LOCAL_PX = 6.0
INVERSE_EVERY_PX = 4
MOST_CHANNELS = 4  # of OpenCV's sampling
GRID = 15
WINDOW_PX = 13
HOPELESS = 0.15
"""Least mean correlation of a flat patch that may be bent."""
CONVERGED = 0.002
STIFFNESS = (float("inf"), 0.3, 0.02, 0.005, 0.002, 0.001, 0.001)
"""Stiffness of the paper in each round of alignment: flat first, then more and more pliable."""


@dataclass(frozen=True)
class Drawn:
    """The patch as the camera would see it, over a cut of the photo at (left, top).

    Attributes:
        picture: (h, w, c) float32.
        inside: (h, w) bool, pixels wholly on the patch.
        uv: (h, w, 2) place on the patch of each pixel's centre.
    """

    picture: np.ndarray
    inside: np.ndarray
    left: int
    top: int
    uv: np.ndarray

    def cut(self, photo: np.ndarray) -> np.ndarray:
        """The same part of the photo."""
        h, w = self.inside.shape
        return photo[self.top : self.top + h, self.left : self.left + w]


def draw_patch(patch: np.ndarray, warp: PatchWarp, shape: tuple[int, ...]) -> Drawn | None:
    """Draw patch values (n, n, c) float32 as a camera averages them; None if the photo of `shape` shows none of it.

    Colours should be linear light, which is what a pixel averages.
    """
    placed = place_cut(warp, shape)
    if placed is None:
        return None
    left, top, uv = placed
    h, w = uv.shape[:2]
    # enlarged to the size in the photograph, so that texels keep their sharp edges
    source = _enlarge(patch, warp)
    m = source.shape[0]
    # several samples for each pixel, averaged as a sensor does
    fine = cv2.resize((uv * m).astype(np.float32), (w * SAMPLES, h * SAMPLES), interpolation=cv2.INTER_LINEAR)
    picture = cv2.resize(sample_image(source, fine), (w, h), interpolation=cv2.INTER_AREA).reshape(h, w, -1)
    # a pixel on the rim shows patch and table together
    reach = np.abs(np.stack(np.gradient(uv, axis=(0, 1)), -1)).sum(axis=-1) / 2
    inside = ((uv > reach) & (uv < 1 - reach)).all(axis=-1)
    return Drawn(picture, inside, left, top, uv)


def place_cut(warp: PatchWarp, shape: tuple[int, ...]) -> tuple[int, int, np.ndarray] | None:
    """Return the cut of the photo with the patch: left, top, and (h, w, 2) places on the patch; or None."""
    # the outline in the photograph, with a margin, bounds the cut
    rim = np.linspace(0, 1, 9)
    outline = np.concatenate([np.stack([rim, 0 * rim + k], 1) for k in (0, 1)])
    outline = warp.to_pixels(np.concatenate([outline, outline[:, ::-1]]))
    low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - MARGIN_PX, 0)
    high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + MARGIN_PX, (shape[1], shape[0]))
    if (high - low < 4).any():
        return None
    w, h = (int(x) for x in high - low)
    # exact places every few pixels, and linear between them
    columns, rows = -(-w // INVERSE_EVERY_PX) + 1, -(-h // INVERSE_EVERY_PX) + 1
    y, x = np.mgrid[:rows, :columns] * float(INVERSE_EVERY_PX)
    coarse = warp.to_patch(np.stack([x + low[0], y + low[1]], -1).reshape(-1, 2)).reshape(rows, columns, 2)
    # pixel centres, in the coarse grid's own coordinates
    y, x = (np.mgrid[:h, :w] + 0.5) / INVERSE_EVERY_PX + 0.5
    uv = sample_image(coarse.astype(np.float32), np.stack([x, y], -1)).astype(float)
    return int(low[0]), int(low[1]), uv


def sample_image(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(h, w, c) values at (h, w, 2) places in an image, by bilinear interpolation; pixel centres lie at halves."""
    x, y = cv2.split((np.asarray(pixels) - 0.5).astype(np.float32))
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels <= MOST_CHANNELS:
        return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    parts = [np.ascontiguousarray(image[..., k : k + MOST_CHANNELS]) for k in range(0, channels, MOST_CHANNELS)]
    found = [cv2.remap(part, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for part in parts]
    return np.concatenate([part.reshape(*x.shape, -1) for part in found], axis=-1)


def _enlarge(patch: np.ndarray, warp: PatchWarp) -> np.ndarray:
    """Enlarge texels to squares, blurred a little less than a sample's footprint, so that sampling does not alias."""
    corners = warp.corners
    samples = np.maximum(np.linalg.norm(np.diff(corners[:3], axis=0), axis=1) * SAMPLES, 1)  # across, down
    n = patch.shape[0]
    repeat = int(np.clip(np.ceil(samples.max() / n), 1, max(1, 1600 // n)))
    source = patch.repeat(repeat, axis=0).repeat(repeat, axis=1)
    # less than the footprint, as the samples of a pixel are averaged afterwards
    sigma = 0.4 * n * repeat / samples
    if sigma.max() < 0.5:
        return source
    return np.asarray(cv2.GaussianBlur(source, (0, 0), sigmaX=max(sigma[0], 0.01), sigmaY=max(sigma[1], 0.01)))


def align(grey: np.ndarray, patch_grey: np.ndarray, start: PatchWarp) -> PatchWarp:
    """Align the patch with the photo, flat at first and then bending with the paper; returns the best warp.

    Each round draws the patch at its estimated place and tracks its points into the photo (Lucas and Kanade 1981).
    Local mean and contrast are equalised before, so that light and inks do not matter. Then the warp is fitted again.

    Args:
        grey: (h, w) float32 photo in [0, 1].
        patch_grey: (n, n, 1) float32.
        start: some pixels off.
    """
    best = warp = start
    best_score = float(agreement(grey[..., None], patch_grey, start).mean())
    # from stiff to soft: the place first, then the bend
    for stiffness in STIFFNESS:
        drawn = draw_patch(patch_grey, warp, grey.shape)
        if drawn is None or drawn.inside.sum() < 4 * LEAST_PIXELS:
            break
        uv, pixels = follow(grey, drawn, warp)
        warp = fit_warp(uv, pixels, warp, stiffness)
        if not is_plausible(warp, grey.shape):
            break
        score = float(agreement(grey[..., None], patch_grey, warp).mean())
        if score < HOPELESS and best_score < HOPELESS:
            # neither the start nor this round shows the patch
            break
        # only once the sheet may bend: a flat round that gains little may be followed by a round that bends
        converged = stiffness < 0.02 and score < best_score + CONVERGED
        if score > best_score:
            best, best_score = warp, score
        if converged:
            break
    return best


def follow(grey: np.ndarray, drawn: Drawn, warp: PatchWarp) -> tuple[np.ndarray, np.ndarray]:
    """Track points of the patch into the photo; returns pairs (uv, pixels), both (k, 2)."""
    theirs = _equalise(drawn.cut(grey))
    # outside of the patch the photo itself, so that the rim does not look moved
    ours = np.where(drawn.inside, _equalise(drawn.picture[..., 0]), theirs)
    uv = cell_centres(GRID)
    corner = np.array([drawn.left, drawn.top])
    at = warp.to_pixels(uv) - corner
    h, w = drawn.inside.shape
    kept = (at > 3).all(axis=1) & (at[:, 0] < w - 3) & (at[:, 1] < h - 3)
    uv, at = uv[kept], at[kept]
    if len(at) == 0:
        return np.zeros((0, 2)), np.zeros((0, 2))
    # three deviations to each side as 8 bits, which OpenCV's tracker takes
    first, second = ((128 + 40 * np.clip(picture, -3, 3)).astype(np.uint8) for picture in (ours, theirs))
    points = (at - 0.5).astype(np.float32)[:, None]
    window = (WINDOW_PX, WINDOW_PX)
    there = points.copy()
    moved, found, _ = cv2.calcOpticalFlowPyrLK(first, second, points, there, winSize=window, maxLevel=2)
    # followed there and back: a point that does not return was lost on the way
    back, returned, _ = cv2.calcOpticalFlowPyrLK(second, first, moved, moved.copy(), winSize=window, maxLevel=2)
    close = np.linalg.norm((back - points)[:, 0], axis=1) < 0.7
    good = (found.ravel() > 0) & (returned.ravel() > 0) & close
    return uv[good], moved[good, 0].astype(float) + 0.5 + corner


def _equalise(picture: np.ndarray) -> np.ndarray:
    """Each pixel as its distance from the local mean, in local standard deviations."""
    mean = cv2.GaussianBlur(picture, (0, 0), LOCAL_PX)
    spread = np.sqrt(np.maximum(cv2.GaussianBlur((picture - mean) ** 2, (0, 0), LOCAL_PX), 0))
    # 0.01 keeps an even texel's noise from being raised to a pattern
    return (picture - mean) / (spread + 0.01)


def agreement(photo: np.ndarray, patch: np.ndarray, warp: PatchWarp) -> np.ndarray:
    """(CELLS, CELLS) correlation of photo (h, w, c) and patch (n, n, c) float32 in each cell; 0 if too little shows."""
    drawn = draw_patch(patch, warp, photo.shape)
    if drawn is None:
        return np.zeros((CELLS, CELLS))
    # the cell of each pixel that shows the patch
    cell = (np.clip(drawn.uv[drawn.inside], 0, 0.999) * CELLS).astype(int) @ [1, CELLS]
    ours, theirs = drawn.picture[drawn.inside], drawn.cut(photo)[drawn.inside]
    count = np.bincount(cell, minlength=CELLS**2)

    def mean(values: np.ndarray) -> np.ndarray:
        sums = [np.bincount(cell, values[:, c], CELLS**2) for c in range(values.shape[1])]
        return np.stack(sums, -1) / np.maximum(count, 1)[:, None]

    # the cell's own mean is taken out, so that a shadow over a cell does not make it unlike
    ours, theirs = ours - mean(ours)[cell], theirs - mean(theirs)[cell]
    # normalised correlation, over all channels together
    both, own_power, other = (mean(a * b).sum(axis=1) for a, b in ((ours, theirs), (ours, ours), (theirs, theirs)))
    size = np.sqrt(own_power * other)
    known = (count >= LEAST_PIXELS) & (size > LEAST_CONTRAST**2)
    return np.where(known, both / np.maximum(size, 1e-12), 0.0).reshape(CELLS, CELLS)


@lru_cache(maxsize=16)
def _as_float(content: bytes, n: int) -> tuple[np.ndarray, np.ndarray]:
    colour = np.frombuffer(content, np.uint8).reshape(n, n, 3).astype(np.float32) / 255
    return colour, cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)[..., None]


def patch_values(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, n, 3) and (n, n, 1) float32 from 0 to 1: the patch in colour and in grey, kept for the next photo."""
    return _as_float(np.ascontiguousarray(pixels).tobytes(), pixels.shape[0])
