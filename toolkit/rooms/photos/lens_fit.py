"""A lens from views of a board: the fit, which views were left out, how sure it is, and what speaks against it."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera
from toolkit.rooms.photos.board_pose import BoardSighting

LEAST_VIEWS = 6
LEAST_CORNERS = 12
"""Smallest number of corners of a view that is used."""
OUTLIER_SIGMAS = 4.0
LEAST_OUTLIER_PX = 0.5
BAD_VIEW = 3.0
"""A view whose corners lie so many times farther off than the median view's is left out: a blurred or moved board."""
STRAY = 2.5
"""Times its view's median that a corner must lie off, and beyond `OUTLIER_SIGMAS`, to be left out alone."""
CELLS = (8, 6)
"""Cells across and down the frame, by which its coverage is measured."""
GOOD_COVERAGE = 0.6
GOOD_FOCAL_SIGMA = 0.005
"""Relative standard deviation of the focal length; distances are as sure as it."""
MOST_FOCAL_SIGMA = 0.05
"""Less sure than that, what EXIF says is better."""
SLANT = 0.1
"""Least change of the camera's distance over the board, as a share, for a view to count as slanted. Seen straight on,
a long lens far away and a short lens near by take the same picture."""
LEAST_SLANTED = 3
GOOD_TILT_DEG = 25.0
"""`LEAST_SLANTED` views should see the board tilted by so much. Below it a board that is not quite flat changes the
focal length and the distance, and no scatter of the corners shows it."""
K3_VIEWS = 12
"""With fewer views, or a poorer coverage than `GOOD_COVERAGE`, the sixth-order term of distortion stays 0: a few
corners near the frame's edge would bend it at will."""
LARGE_RMS_PX = 1.5
UNEVEN_PIXELS, UNEVEN_SIGMAS = 0.01, 3.0
"""Sensors have square pixels: fx and fy that differ by more than 1 %, and by more than chance, are the print's."""
BEND_SIGMAS = 3.0
LEAST_BEND_SHARE = 1e-3
"""Smallest bend that counts, as a share of the board's diagonal; 0.3 mm on A4."""
BEND_ROUNDS, BEND_STOP_MM = 5, 5e-3
ROUNDS = 4


@dataclass(frozen=True)
class Calibration:
    """A measured lens.

    Attributes:
        lens: of pictures of the views' size.
        reprojection_px: root mean square distance of the corners from where the fit puts them.
        focal_sigma_px: standard deviation of fx, by the jackknife over views.
        aspect_sigma: the same of fy / fx.
        coverage: share of the frame's cells that held a corner in any view.
        used: index of each view that was used.
        refused: (index, why) of the others.
        view_px: `reprojection_px` of each view that was used.
        tilt_deg: angle between the board and the picture's plane, of each.
        flat_px: `reprojection_px` with the board taken as flat, as OpenCV's own calibration does.
        bend_mm: from the lowest to the highest corner of the board; the lens is fitted to the bent board.
        is_bent: whether that is more than chance and matters.
        corners_px: (n, 2) all corners that were used, in the pictures.
        residuals_px: (n, 2) their places less those of the fit.
    """

    lens: Camera
    reprojection_px: float
    focal_sigma_px: float
    aspect_sigma: float
    coverage: float
    used: tuple[int, ...]
    refused: tuple[tuple[int, str], ...]
    view_px: tuple[float, ...]
    tilt_deg: tuple[float, ...]
    flat_px: float
    bend_mm: float
    is_bent: bool
    corners_px: np.ndarray
    residuals_px: np.ndarray

    def advice(self) -> list[str]:
        """Say how to improve the calibration; empty if nothing is amiss."""
        lines = []
        lens = self.lens
        # focal length: its uncertainty, and views at a slant that fix it
        if self.focal_sigma_px / lens.fx > GOOD_FOCAL_SIGMA:
            lines.append(
                f"the focal length is known to {self.focal_sigma_px / lens.fx:.1%} only: add photos that see the "
                "board at a slant, from several sides"
            )
        # of the most slanted views: several are needed to fix the focal length
        slant = sorted(self.tilt_deg)[-LEAST_SLANTED]
        if slant < GOOD_TILT_DEG:
            lines.append(
                f"all but {LEAST_SLANTED - 1} photos see the board within {slant:.0f}° of straight on, so focal length "
                "and distances may be off together: add photos tilted by 30° to 60°"
            )
        # the board: its squares, and whether it is flat
        if abs(lens.fy / lens.fx - 1) > max(UNEVEN_PIXELS, UNEVEN_SIGMAS * self.aspect_sigma):
            lines.append(
                f"fx and fy differ by {abs(lens.fy / lens.fx - 1):.1%}, but sensors have square pixels: measure the "
                "board's squares across and down, the printer may have stretched it"
            )
        if self.is_bent:
            lines.append(
                f"the board is not flat: its corners lie up to {self.bend_mm:.1f} mm out of a plane (as flat: "
                f"{self.flat_px:.2f} px off). The lens allows for that, poses do not: tape the board to glass"
            )
        # the frame: how much of it corners cover, and how well they fit
        if self.coverage < GOOD_COVERAGE:
            lines.append(
                f"corners were seen in {self.coverage:.0%} of the frame: add photos with the board in its corners"
            )
        if self.reprojection_px > LARGE_RMS_PX * max(lens.width, lens.height) / 1920:
            lines.append(
                f"the corners lie {self.reprojection_px:.2f} px off: was the board flat, the zoom fixed, and is this "
                "the printed board?"
            )
        return lines


def calibrate_lens(views: Sequence[BoardSighting]) -> Calibration:
    """Fit focal lengths, principal point, distortion and the board's bend to views of it, in pictures of the same size.

    Views, and then single corners, that do not agree with the rest are left out.

    Raises:
        ToolkitError: fewer than `LEAST_VIEWS` views can be used, or they do not determine a lens.
    """
    # enough views, and enough of them at a slant: views straight on leave focal length and distance alike
    refused = {index: why for index, view in enumerate(views) if (why := _why_not(view, views[0]))}
    used = {index: view for index, view in enumerate(views) if index not in refused}
    if len(used) < LEAST_VIEWS:
        raise ToolkitError(_too_few(len(views), len(used), refused))
    slanted = sum(measure_slant(view) > SLANT for view in used.values())
    if slanted < LEAST_SLANTED:
        raise ToolkitError(
            f"{slanted} of {len(used)} photos see the board at a slant, at least {LEAST_SLANTED} must: tilt the camera "
            "by 30° to 60°, from several sides"
        )
    size = (views[0].width, views[0].height)
    coverage = cover([view.corners_px for view in used.values()], size)
    # k3 bends only the outermost corners: without them it fits noise
    flags = 0 if len(used) >= K3_VIEWS and coverage >= GOOD_COVERAGE else cv2.CALIB_FIX_K3
    # bounded: a round takes out a view, or corners; several rounds may be needed
    for _ in range(ROUNDS + len(views)):
        fit = _fit(list(used.values()), flags)
        # corners before views: a stray corner must not cost a whole photograph
        dropped = _drop_corners(used, fit)
        if dropped is None:
            dropped = _drop_view(used, fit)
        if dropped is None:
            break
        refused |= dropped
        if len(used) < LEAST_VIEWS:
            raise ToolkitError(_too_few(len(views), len(used), refused))
    spread = fit.spread()
    focal_sigma_px = float(np.sqrt(spread[0, 0]))
    if not focal_sigma_px < MOST_FOCAL_SIGMA * fit.lens.fx:
        raise ToolkitError(
            f"the photos tell the focal length to {focal_sigma_px / fit.lens.fx:.0%} only: add photos that see the "
            "board at a slant, from several sides"
        )
    # the gradient of fy / fx, to carry the covariance to that ratio
    ratio = np.array([-fit.lens.fy / fit.lens.fx, 1.0]) / fit.lens.fx
    bend_mm, is_bent = fit.measure_bend(spread)
    return Calibration(
        fit.lens, fit.rms_px, focal_sigma_px, aspect_sigma=float(np.sqrt(ratio @ spread[:2, :2] @ ratio)),
        coverage=cover([view.corners_px for view in used.values()], size), used=tuple(used),
        refused=tuple(sorted(refused.items())), view_px=tuple(fit.view_px), tilt_deg=tuple(fit.tilts()),
        flat_px=fit.flat_px, bend_mm=bend_mm, is_bent=is_bent,
        corners_px=np.concatenate([view.corners_px for view in used.values()]),
        residuals_px=np.concatenate(fit.residuals),
    )  # fmt: skip


def _drop_view(used: dict[int, BoardSighting], fit: "_Fit") -> dict[int, str] | None:
    """Take the view that lies farthest off, and may have spoilt the others, out of `used`; (index, why), or None."""
    off_px = fit.median_px
    worst, usual = max(off_px), float(np.median(off_px))
    if worst <= max(BAD_VIEW * usual, LEAST_OUTLIER_PX):
        return None
    index = list(used)[off_px.index(worst)]
    del used[index]
    return {index: f"its corners lie {worst:.1f} px off, the others' {usual:.1f} px: blurred, or the board was bent"}


def _drop_corners(used: dict[int, BoardSighting], fit: "_Fit") -> dict[int, str] | None:
    """Take corners that lie far off, also for their own view, out of the views.

    Views that keep too few go out of `used`; as `_drop_view`, but empty if only corners went.
    """
    # the error of a corner has two parts: its root mean square length is √2 standard deviations
    limit = max(OUTLIER_SIGMAS * fit.rms_px / np.sqrt(2), LEAST_OUTLIER_PX)
    # against the view's median: an outlier does not raise its own limit
    good = [
        np.linalg.norm(residuals, axis=1) < max(limit, STRAY * usual)
        for residuals, usual in zip(fit.residuals, fit.median_px, strict=True)
    ]
    if all(mask.all() for mask in good):
        return None
    bad = {}
    for (index, view), mask in zip(list(used.items()), good, strict=True):
        used[index] = view.keep(mask)
        if mask.sum() < LEAST_CORNERS:
            bad[index] = "its corners do not agree with those of the other photos"
            del used[index]
    return bad


def measure_slant(view: BoardSighting) -> float:
    """Change of the distance from the camera over the corners of a view, as a share of the distance."""
    place = view.world_mm[:, :2] - view.world_mm[:, :2].mean(axis=0)
    homography, _ = cv2.findHomography(place, view.corners_px, cv2.LMEDS)
    if homography is None:
        return 0.0
    # the homography's last row is the depth over the plane, up to a factor: here as a share of the middle's
    depth = place @ homography[2, :2] / homography[2, 2]
    return float(np.ptp(depth))


def cover(pixels: Sequence[np.ndarray], size: tuple[int, int]) -> float:
    """Share of the frame's cells that hold a corner: pixels (n, 2) per view, size (width, height)."""
    cells = np.floor(np.concatenate(pixels) / size * CELLS).astype(int)
    inside = ((cells >= 0) & (cells < CELLS)).all(axis=1)
    return len(np.unique(cells[inside], axis=0)) / (CELLS[0] * CELLS[1])


@dataclass(frozen=True)
class _Fit:
    """A lens, the poses of its views and the bend of the board, by least squares on the corners.

    Attributes:
        rotations: of the board as each view's camera sees it.
        residuals: (n, 2) of each view, pixels.
        bend: (3,) mm, see `_bend_shapes`.
        flat_px: as in `Calibration`.
        normal, gradient: each view's normal equations for the lens and the bend, its own pose eliminated.
    """

    views: list[BoardSighting]
    lens: Camera
    rotations: Sequence[np.ndarray]
    residuals: list[np.ndarray]
    bend: np.ndarray
    flat_px: float
    normal: np.ndarray
    gradient: np.ndarray

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((np.concatenate(self.residuals) ** 2).sum(axis=1).mean()))

    @property
    def view_px(self) -> list[float]:
        return [float(np.sqrt((residual**2).sum(axis=1).mean())) for residual in self.residuals]

    @property
    def median_px(self) -> list[float]:
        return [float(np.median(np.linalg.norm(residual, axis=1))) for residual in self.residuals]

    def tilts(self) -> list[float]:
        """Degrees between the board's normal and the optical axis."""
        normals = [cv2.Rodrigues(rotation)[0][2, 2] for rotation in self.rotations]
        return [float(np.degrees(np.arccos(min(abs(normal), 1.0)))) for normal in normals]

    def spread(self) -> np.ndarray:
        """(k, k) covariance of fx, fy, cx, cy, the distortion and, last, the bend: the jackknife over views.

        Corners of a view err together (motion, focus), so OpenCV's scatter of single corners is two to four times too
        small. Without view v the solution moves by (H - H_v)⁻¹ (g - g_v); the sum of the squared moves is the
        jackknife's variance (Efron and Tibshirani 1993, chapter 11). It is widened by Student's t for few views.
        """
        from scipy.stats import t as student

        normal, gradient, count = self.normal.sum(axis=0), self.gradient.sum(axis=0), len(self.views)
        moved = np.array([
            _solve(normal - a, gradient - b) for a, b in zip(self.normal, self.gradient, strict=True)
        ]) - _solve(normal, gradient)  # fmt: skip
        # 0.97725 is two deviations of a normal: with few views Student's t is wider
        wider = student.ppf(0.97725, count - 1) / 2
        # the jackknife's variance (Tukey 1958): (n - 1) / n times the sum of squares
        return wider**2 * (count - 1) / count * moved.T @ moved

    def measure_bend(self, spread: np.ndarray) -> tuple[float, bool]:
        """Millimetres from the lowest to the highest corner of the board off its mean plane; whether that matters."""
        world = np.concatenate([view.world_mm for view in self.views])
        # rounded, so that a corner that several views saw counts once
        flat = np.unique(world[:, :2].round(6), axis=0)
        height = _bend_shapes(flat, _half_diagonal(self.views)) @ self.bend
        plane = np.c_[flat, np.ones(len(flat))]
        # a tilt of the whole board is no bend: the pose holds it
        height = height - plane @ np.linalg.lstsq(plane, height, rcond=None)[0]
        bend_mm = float(np.ptp(height))
        sure = (np.abs(self.bend) > BEND_SIGMAS * np.sqrt(np.diag(spread))[-3:]).any()
        return bend_mm, bool(sure and bend_mm > LEAST_BEND_SHARE * 2 * _half_diagonal(self.views))


def _solve(normal: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(normal, gradient, rcond=None)[0]


def _half_diagonal(views: Sequence[BoardSighting]) -> float:
    return float(max(np.linalg.norm(view.world_mm[:, :2], axis=1).max() for view in views))


def _bend_shapes(flat: np.ndarray, half_mm: float) -> np.ndarray:
    """(n, 3) heights of a sheet that is bent along, twisted, and bent across by 1 mm, at places (n, 2)."""
    u, v = (flat / half_mm).T
    return np.stack([u * u, u * v, v * v], axis=1)


def _fit(views: list[BoardSighting], flags: int) -> _Fit:
    """Fit a flat board as OpenCV does, then in turn its bend and the rest.

    A sheet bent by 0.3 % of its size in all views moves the focal length by 1 % and shows in no scatter.
    """
    size, half_mm = (views[0].width, views[0].height), _half_diagonal(views)
    pixels = [view.corners_px.astype(np.float32) for view in views]
    # heights of a sheet that is bent along, twisted, and bent across by 1 mm, at each corner
    shapes = [_bend_shapes(view.world_mm[:, :2], half_mm) for view in views]
    bend, flat_px = np.zeros(3), None
    matrix: cv2.typing.MatLike = np.eye(3)
    distortion: cv2.typing.MatLike = np.zeros(5)
    # free entries of the lens: fx, fy, cx, cy and the distortion
    free = 8 if flags & cv2.CALIB_FIX_K3 else 9
    # lens and poses for the bend so far, and then a Gauss-Newton step for the bend
    for _ in range(BEND_ROUNDS):
        world = [
            np.c_[view.world_mm[:, :2], shape @ bend].astype(np.float32)
            for view, shape in zip(views, shapes, strict=True)
        ]
        try:
            rms_px, matrix, distortion, rotations, translations = cv2.calibrateCamera(
                world, pixels, size, matrix, distortion, flags=flags | (cv2.CALIB_USE_INTRINSIC_GUESS if flat_px else 0)
            )
        except cv2.error as error:
            why = str(error.err).strip()[:60]
            raise ToolkitError(
                f"the photos do not determine a lens ({why}): take them at a slant from all sides"
            ) from None
        # the error as if the board were flat, for the report
        flat_px = flat_px or rms_px
        residuals, normal, gradient = [], [], []
        for points, seen, shape, rotation, translation in zip(
            world, pixels, shapes, rotations, translations, strict=True
        ):
            placed, jacobian = cv2.projectPoints(points.astype(float), rotation, translation, matrix, distortion)
            residuals.append(seen - placed.reshape(-1, 2))
            # a corner's height moves it as that translation of the board does
            lift = (jacobian[:, 3:6] @ cv2.Rodrigues(rotation)[0][:, 2]).reshape(-1, 2, 1) * shape[:, None]
            # fx, fy, cx, cy and the distortion follow the pose in OpenCV's Jacobian
            design = np.c_[jacobian[:, 6 : 6 + free], lift.reshape(-1, 3)]
            # projected off the view's own pose: lens and bend explain the rest
            of_pose, _ = np.linalg.qr(jacobian[:, :6])
            design = design - of_pose @ (of_pose.T @ design)
            normal.append(design.T @ design)
            gradient.append(design.T @ residuals[-1].reshape(-1))
        step = _solve(np.sum(normal, axis=0), np.sum(gradient, axis=0))[-3:]
        if np.abs(step).max() < BEND_STOP_MM:
            break
        bend = bend + step
    k1, k2, p1, p2, k3 = map(float, distortion.reshape(-1)[:5])
    fx, fy, cx, cy = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    lens = Camera(size[0], size[1], fx=fx, fy=fy, cx=cx, cy=cy, distortion=(k1, k2, p1, p2, k3))
    return _Fit(
        views, lens, rotations, residuals, bend=bend, flat_px=float(flat_px or 0),
        normal=np.array(normal), gradient=np.array(gradient),
    )  # fmt: skip


def _why_not(view: BoardSighting, first: BoardSighting) -> str | None:
    if (view.width, view.height) != (first.width, first.height):
        return f"{view.width}x{view.height} px, the others have {first.width}x{first.height}"
    if len(view.ids) < LEAST_CORNERS:
        return f"{len(view.ids)} corners of the board were found, at least {LEAST_CORNERS} are needed"
    # the smaller singular value is the spread across the line that fits best
    spread = np.linalg.svd(view.world_mm[:, :2] - view.world_mm[:, :2].mean(axis=0), compute_uv=False)
    return "the corners that were found lie on one line" if spread[1] < 0.05 * spread[0] else None


def _too_few(given: int, usable: int, refused: dict[int, str]) -> str:
    why = f" (the first that is not: {refused[min(refused)]})" if refused else ""
    return (
        f"{usable} of {given} photos of the board can be used{why}: a lens needs at least {LEAST_VIEWS}. Take more at "
        "a slant from several sides, with the board in every part of the frame"
    )
