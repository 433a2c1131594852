"""A photograph's camera and its pose, from points of a plane, and how sure that is."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from toolkit.rig.camera import Camera


@dataclass(frozen=True)
class PosedCamera:
    """A photograph's camera and its pose.

    Attributes:
        T_world_camera: (4, 4), OpenCV axes, millimetres.
        camera: of the upright photograph.
        details: of the measurement, for the record: lens, reprojection error, corners found.
    """

    T_world_camera: np.ndarray
    camera: Camera
    details: Mapping[str, float | int | str] = field(default_factory=dict)

    @property
    def position_mm(self) -> np.ndarray:
        """(3,) position of the camera."""
        return self.T_world_camera[:3, 3]

    def project(self, points_mm: np.ndarray) -> np.ndarray:
        """(n, 2) pixels of world points (n, 3), see `Camera.project`."""
        return self.camera.project(self.T_world_camera, points_mm)

    def sees(self, points_mm: np.ndarray) -> np.ndarray:
        """(n,) which world points (n, 3) lie in the frame, whatever stands before them."""
        pixels = self.project(points_mm)
        return np.all((pixels >= 0) & (pixels < (self.camera.width, self.camera.height)), axis=1)

    def rays(self, directions: np.ndarray) -> np.ndarray:
        """(n, 3) unit vectors in the world of directions x/z, y/z (n, 2) in camera axes."""
        local = np.c_[directions, np.ones(len(directions))]
        turned = local @ self.T_world_camera[:3, :3].T
        return turned / np.linalg.norm(turned, axis=1, keepdims=True)


LEAST_POINTS = 6
LEAST_SPREAD_MM = 5.0
"""Least root mean square distance of the points from their best straight line; nearer to it they are a line."""
GROSS_SHARE = 0.004
"""A corner farther than this share of the picture's diagonal from the best homography is no corner of the board. It
allows for the distortion of an uncalibrated lens."""
OUTLIER_SIGMAS = 4.0
LEAST_OUTLIER_PX = 0.6
LEAST_NOISE_PX = 0.05
"""Corners are never taken to be surer than this, however well they agree."""
AMBIGUOUS_RATIO = 1.5
"""A distant plane fits two cameras. The pose is ambiguous if the second's error is below so many times the first's."""
MOST_SIGMA_DEG = 1.0
"""A direction less sure than this could be another pose of a dense plan."""
ROUNDS = 4


@dataclass(frozen=True)
class PhotoPose:
    """A photograph's camera.

    Attributes:
        T_world_camera: (4, 4), OpenCV axes, millimetres.
        reprojection_px: root mean square distance of the corners from where the pose puts them.
        n_corners: number of corners that were used.
        angle_sigma_deg: standard deviation of its direction by the corners' scatter, without errors of the lens.
        rival_px: `reprojection_px` of the other camera above the table that fits the plane; None without.
    """

    T_world_camera: np.ndarray
    reprojection_px: float
    n_corners: int
    angle_sigma_deg: float
    rival_px: float | None = None

    @property
    def ambiguous(self) -> bool:
        """Whether the other camera fits about as well, so that the pose is a guess."""
        return self.rival_px is not None and self.rival_px < AMBIGUOUS_RATIO * max(self.reprojection_px, LEAST_NOISE_PX)

    def doubt(self) -> str | None:
        """Why the pose should not be relied on, in words for a person; None where it may be."""
        if self.ambiguous:
            return "two cameras fit the board about as well: it is too small or too blurred in the picture"
        if self.angle_sigma_deg > MOST_SIGMA_DEG:
            return (
                f"the camera's direction is known to {self.angle_sigma_deg:.1f}° only: the board is blurred or hidden, "
                "or the photograph is through another lens"
            )
        return None


def fit_plane_pose(world_mm: np.ndarray, pixels: np.ndarray, lens: Camera) -> PhotoPose | None:
    """Fit a camera above the table to points of the plane z = 0.

    IPPE gives both cameras that a plane allows (Collins and Bartoli, 2014), SQPNP a third start; each is refined by
    Levenberg-Marquardt on the pixels, and the best is kept.

    Args:
        world_mm: (n, 3), z = 0.
        pixels: (n, 2), the first pixel's centre at (0.5, 0.5).
        lens: intrinsics and distortion.

    Returns:
        None with fewer than `LEAST_POINTS` points that agree, points on a line, or no camera above the table.
    """
    world_mm, pixels = np.ascontiguousarray(world_mm, float), np.ascontiguousarray(pixels, float)
    # gross errors first: a least-squares fit would follow them
    kept = _drop_gross(world_mm, pixels, lens)
    fits: list[_PlaneFit] = []
    # fit and leave out outliers in turn, until the points stay the same
    for _ in range(ROUNDS):
        if kept.sum() < LEAST_POINTS:
            return None
        # the second singular value measures the spread across the best line
        centred = world_mm[kept, :2] - world_mm[kept, :2].mean(axis=0)
        if np.linalg.svd(centred, compute_uv=False)[1] / np.sqrt(len(centred)) < LEAST_SPREAD_MM:
            return None
        fits = _fit_all(world_mm[kept], pixels[kept], lens)
        if not fits:
            return None
        error = _errors(fits[0], world_mm, pixels, lens)
        # the median of a two-dimensional normal error's length is 1.18 standard deviations
        limit = max(OUTLIER_SIGMAS * float(np.median(error[kept])) / 1.18, LEAST_OUTLIER_PX)
        again = kept & (error < limit)
        if again.sum() == kept.sum():
            break
        kept = again
    # the rival is the best of the other cameras; starts that end at the same camera do not count
    best, rival = fits[0], next((fit for fit in fits[1:] if not fit.like(fits[0])), None)
    angle = _angle_sigma_deg(best, world_mm[kept], lens)
    return PhotoPose(best.T_world_camera, best.rms_px, int(kept.sum()), angle, rival_px=rival.rms_px if rival else None)


@dataclass(frozen=True)
class _PlaneFit:
    """A candidate: OpenCV's rotation and translation of the world as the camera sees it, and its error."""

    rotation: np.ndarray
    translation: np.ndarray
    rms_px: float

    @property
    def T_world_camera(self) -> np.ndarray:
        T = np.eye(4)
        # OpenCV maps world to camera: the inverse is R^T and -R^T t
        T[:3, :3] = cv2.Rodrigues(self.rotation)[0].T
        T[:3, 3] = -T[:3, :3] @ self.translation.reshape(3)
        return T

    def like(self, other: "_PlaneFit") -> bool:
        """Whether both are the same camera, found twice."""
        turn = cv2.Rodrigues(self.rotation)[0] @ cv2.Rodrigues(other.rotation)[0].T
        return float(np.linalg.norm(cv2.Rodrigues(turn)[0])) < np.radians(0.2)


def _drop_gross(world_mm: np.ndarray, pixels: np.ndarray, lens: Camera) -> np.ndarray:
    """(n,) which points agree with a homography, without distortion."""
    if len(pixels) < LEAST_POINTS:
        return np.zeros(len(pixels), bool)
    # a homography holds only where straight lines are straight; in pixels again, so that the limit is in pixels
    flat = lens.undistort(pixels) * [lens.fx, lens.fy]
    limit = GROSS_SHARE * float(np.hypot(lens.width, lens.height))
    cv2.setRNGSeed(0)  # RANSAC draws: the same picture gives the same pose
    homography, agree = cv2.findHomography(world_mm[:, :2], flat, cv2.RANSAC, limit)
    return np.zeros(len(pixels), bool) if homography is None else agree.reshape(-1).astype(bool)


def _fit_all(world_mm: np.ndarray, pixels: np.ndarray, lens: Camera) -> list[_PlaneFit]:
    """Every camera above the table that a start leads to, the best first."""
    fits = []
    # every start of two solvers is refined: they may lead to different cameras
    for method in (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_SQPNP):
        _, rotations, translations, _ = cv2.solvePnPGeneric(
            world_mm, pixels, lens.matrix, lens.coefficients, flags=method
        )
        for start in zip(rotations, translations, strict=True):
            rotation, translation = cv2.solvePnPRefineLM(
                world_mm, pixels, lens.matrix, lens.coefficients, start[0].astype(float), start[1].astype(float)
            )
            fit = _PlaneFit(rotation, translation, 0.0)
            # in front of the camera: a plane has a mirror solution behind it that projects alike
            ahead = (world_mm @ cv2.Rodrigues(rotation)[0].T + translation.reshape(3))[:, 2].min() > 0
            # below the table a camera sees the sheet from behind
            if ahead and fit.T_world_camera[2, 3] > 0 and np.isfinite(translation).all():
                rms = float(np.sqrt((_errors(fit, world_mm, pixels, lens) ** 2).mean()))
                fits.append(_PlaneFit(rotation, translation, rms))
    return sorted(fits, key=lambda fit: fit.rms_px)


def _errors(fit: _PlaneFit, world_mm: np.ndarray, pixels: np.ndarray, lens: Camera) -> np.ndarray:
    """(n,) distances in pixels."""
    placed, _ = cv2.projectPoints(world_mm, fit.rotation, fit.translation, lens.matrix, lens.coefficients)
    return np.linalg.norm(placed.reshape(-1, 2) - pixels, axis=1)


def _angle_sigma_deg(fit: _PlaneFit, world_mm: np.ndarray, lens: Camera) -> float:
    """Standard deviation of the camera's direction: σ² (JᵀJ)⁻¹, carried to the world."""
    _, jacobian = cv2.projectPoints(world_mm, fit.rotation, fit.translation, lens.matrix, lens.coefficients)
    jacobian = jacobian[:, :6]  # by rotation vector and translation
    # two numbers a corner, less the pose's six
    freedom = max(2 * len(world_mm) - 6, 1)
    noise = max(fit.rms_px * np.sqrt(len(world_mm) / freedom), LEAST_NOISE_PX)
    covariance = noise**2 * np.linalg.pinv(jacobian.T @ jacobian)[:3, :3]
    base, changes, step = cv2.Rodrigues(fit.rotation)[0], np.zeros((3, 3)), 1e-3
    # by differences: how the direction in the world follows from the rotation vector
    for i in range(3):
        moved = cv2.Rodrigues(fit.rotation.reshape(3) + step * np.eye(3)[i])[0]
        changes[:, i] = cv2.Rodrigues(moved.T @ base)[0].reshape(3) / step
    return float(np.degrees(np.sqrt(np.trace(changes @ covariance @ changes.T))))
