"""Where each place of a patch lies in a photograph: a homography, and a smooth bend beside it, as paper bends.

Convention: places on the patch are (u, v) in [0, 1], u right and v down as the file has them; pixel (0, 0) of a photo
has its centre at (0.5, 0.5).
"""

from dataclasses import dataclass

import numpy as np

BEND_TERMS = 7
FLAT = np.zeros((BEND_TERMS, 2))
UNIT_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
LEAST_SIDE_PX = 6.0
INVERSE_STEPS = 12
FIT_STEPS = 8


@dataclass(frozen=True)
class Placement:
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
        """(n, 2) places of pixels (n, 2); on the patch and a little round it, where the bend is mild."""
        back = np.linalg.inv(self.homography)
        uv = map_points(back, pixels)
        if self.bend.any():
            for _ in range(INVERSE_STEPS):
                uv = map_points(back, pixels - bend_terms(np.clip(uv, -0.3, 1.3)) @ self.bend)
        return uv

    def scaled(self, factor: float) -> "Placement":
        """In the same photo at another size."""
        return Placement(np.diag([factor, factor, 1.0]) @ self.homography, self.bend * factor)

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


def area(corners: np.ndarray) -> float:
    """Of a quadrilateral, pixels; positive where the corners run clockwise as one sees the picture."""
    x, y = corners.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def is_plausible(placement: Placement, shape: tuple[int, ...]) -> bool:
    """Whether the patch is a convex quadrilateral, not mirrored, of some size, with its middle in the photo."""
    H = placement.homography
    if not (np.isfinite(H).all() and np.isfinite(placement.bend).all()) or abs(np.linalg.det(H)) < 1e-12:
        return False
    depth = UNIT_CORNERS @ H[2, :2] + H[2, 2]
    if (depth <= 1e-3 * depth.max()).any():
        return False
    corners = placement.corners
    sides = np.roll(corners, -1, axis=0) - corners
    following = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]
    lengths = np.linalg.norm(sides, axis=1)
    if (turns <= 0).any() or lengths.min() < LEAST_SIDE_PX or turns.min() < LEAST_SIDE_PX / 2 * lengths.max():
        return False
    h, w = shape[:2]
    middle = corners.mean(axis=0)
    return bool((middle > 0).all() and middle[0] < w and middle[1] < h and lengths.max() < 1.5 * max(h, w))


def fit_placement(
    uv: np.ndarray, pixels: np.ndarray, start: Placement, stiffness: float, near_px: float = 1.0
) -> Placement:
    """The placement that fits pairs of places best, by robust least squares (Cauchy's weights).

    Args:
        uv, pixels: (n, 2) pairs; some may be wrong.
        start: to begin from.
        stiffness: how much a bend costs, per square pixel of it; infinity keeps the patch flat.
        near_px: pairs that miss by much more than this hardly count.

    Returns:
        The fit, or `start` where the pairs do not say enough.
    """
    flat = not np.isfinite(stiffness)
    if len(uv) < (8 if flat else 12):
        return start
    scale = start.homography[2, 2]
    h = (start.homography / scale).ravel()[:8]
    bend = FLAT if flat else start.bend
    terms = bend_terms(uv)
    for _ in range(FIT_STEPS):
        raised = np.c_[uv, np.ones(len(uv))] @ np.append(h, 1.0).reshape(3, 3).T
        miss = pixels - raised[:, :2] / raised[:, 2:] - terms @ bend
        weight = 1 / (1 + (miss**2).sum(axis=1) / near_px**2)
        step = _solve_step(uv, raised, terms, miss, weight, bend, None if flat else stiffness)
        if not np.isfinite(step).all():
            return start
        h = h + step[:8]
        bend = bend if flat else bend + step[8:].reshape(2, BEND_TERMS).T
    return Placement(np.append(h, 1.0).reshape(3, 3), bend)


def _solve_step(uv, raised, terms, miss, weight, bend, stiffness: float | None) -> np.ndarray:
    """One step of Gauss and Newton: change of the eight numbers of the homography and the fourteen of the bend."""
    n, count = len(uv), 8 if stiffness is None else 8 + 2 * BEND_TERMS
    depth = raised[:, 2]
    jacobian = np.zeros((2, n, count))
    for axis in (0, 1):
        jacobian[axis, :, 3 * axis : 3 * axis + 2] = uv / depth[:, None]
        jacobian[axis, :, 3 * axis + 2] = 1 / depth
        jacobian[axis, :, 6:8] = -uv * (raised[:, axis] / depth**2)[:, None]
        if stiffness is not None:
            jacobian[axis, :, 8 + BEND_TERMS * axis : 8 + BEND_TERMS * (axis + 1)] = terms
    rows = jacobian.reshape(2 * n, count)
    both = np.tile(weight, 2)
    normal = rows.T @ (rows * both[:, None])
    right = rows.T @ (miss.T.ravel() * both)
    if stiffness is not None:
        cost = stiffness * weight.sum() / 10
        normal[8:, 8:] += cost * np.eye(2 * BEND_TERMS)
        right[8:] -= cost * bend.T.ravel()
    size = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / size[:, None] / size[None] + 1e-9 * np.eye(count)
    return np.linalg.solve(scaled, right / size) / size
