"""A lens from views of a board: the fit, which views were left out, how sure it is, and what speaks against it."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.photos.board_pose import BoardSighting
from toolkit.rig.camera import Camera

LEAST_VIEWS = 6
LEAST_CORNERS = 12
"""Of a view that is used."""
OUTLIER_SIGMAS = 4.0
LEAST_OUTLIER_PX = 0.5
BAD_VIEW = 3.0
"""A view whose corners lie so many times farther off than the median view's is left out: a blurred or moved board."""
CELLS = (8, 6)
"""The frame is divided into so many cells across and down to say how much of it was covered."""
GOOD_COVERAGE = 0.6
GOOD_FOCAL_SIGMA = 0.005
"""Relative standard deviation of the focal length; distances are as sure as it."""
MOST_FOCAL_SIGMA = 0.03
"""Less sure than that, what EXIF says is better."""
SLANT = 0.1
"""By this share the camera's distance must change over the board for a view to count as slanted. Seen straight on, a
long lens far away and a short one near by take the same picture."""
LEAST_SLANTED = 3
GOOD_TILT_DEG = 25.0
"""`LEAST_SLANTED` views should see the board under so much; below it a board that is not quite flat bends the focal
length, and the distance with it, whatever the scatter of the corners says."""
K3_VIEWS = 12
"""With fewer views, or a poorer coverage than `GOOD_COVERAGE`, the sixth-order term of distortion stays 0: a few
corners near the frame's edge would bend it at will."""
LARGE_RMS_PX = 1.5
UNEVEN_PIXELS, UNEVEN_SIGMAS = 0.01, 3.0
"""Sensors have square pixels: fx and fy that differ by more than 1 %, and by more than chance, are the print's."""
UNEVEN_PAPER = 2.5
"""Times by which the corners' mean places on the board may exceed what their scatter between views explains."""
LEAST_UNEVEN_SHARE = 2e-4
"""Of the board's diagonal, 0.1 mm of A4 and a half: less is no matter."""
ROUNDS = 6


@dataclass(frozen=True)
class Calibration:
    """A measured lens.

    Attributes:
        lens: of pictures of the views' size.
        reprojection_px: root mean square distance of the corners from where the lens and the views' poses put them.
        focal_sigma_px: standard deviation of fx, from how much it changes when a view is left out.
        aspect_sigma: the same of fy / fx.
        coverage: share of the frame's cells that held a corner in any view.
        used: index of each view that was used.
        refused: (index, why) of the others.
        view_px: root mean square distance of each view that was used.
        tilt_deg: angle between the board and the picture's plane, of each.
        uneven_mm: root mean square of the corners' mean places on the board, away from where they should be.
        is_uneven: whether that is more than chance and matters: paper that is not flat, or a print out of scale.
        corners_px: (n, 2) all corners that were used, in the pictures.
        residuals_px: (n, 2) where they were seen, less where the fit puts them.
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
    uneven_mm: float
    is_uneven: bool
    corners_px: np.ndarray
    residuals_px: np.ndarray

    def advice(self) -> list[str]:
        """What would make the calibration surer; empty where nothing is amiss."""
        lines = []
        lens = self.lens
        if self.focal_sigma_px / lens.fx > GOOD_FOCAL_SIGMA:
            lines.append(
                f"the focal length is known to {self.focal_sigma_px / lens.fx:.1%} only: add photos that see the "
                "board at a slant, from several sides"
            )
        slant = sorted(self.tilt_deg)[-LEAST_SLANTED]
        if slant < GOOD_TILT_DEG:
            lines.append(
                f"all but {LEAST_SLANTED - 1} photos see the board within {slant:.0f}° of straight on: a longer lens "
                "farther away would take the same pictures, so focal length and distances may be off together; add "
                "photos tilted by 30° to 60°"
            )
        if abs(lens.fy / lens.fx - 1) > max(UNEVEN_PIXELS, UNEVEN_SIGMAS * self.aspect_sigma):
            lines.append(
                f"fx and fy differ by {abs(lens.fy / lens.fx - 1):.1%}, where sensors have square pixels: measure the "
                "board's squares across and down, the printer may have stretched it"
            )
        if self.is_uneven:
            lines.append(
                f"the board's own corners lie {self.uneven_mm:.2g} mm off their places in all photos alike: the paper "
                "is not flat, or its print not to scale; tape it to glass"
            )
        if self.coverage < GOOD_COVERAGE:
            lines.append(
                f"corners were seen in {self.coverage:.0%} of the frame: add photos with the board in its corners"
            )
        if self.reprojection_px > LARGE_RMS_PX * max(lens.width, lens.height) / 1920:
            lines.append(
                f"the corners lie {self.reprojection_px:.2f} px off: was the board flat, the zoom fixed, and is it the "
                "board that was meant?"
            )
        return lines


def calibrate_lens(views: Sequence[BoardSighting]) -> Calibration:
    """Fit focal lengths, principal point and distortion to views of a board, all in pictures of one size.

    Views, and then single corners, that do not agree with the rest are left out.

    Raises:
        ToolkitError: fewer than `LEAST_VIEWS` views can be used, or they do not determine a lens.
    """
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
    flags = 0 if len(used) >= K3_VIEWS and coverage >= GOOD_COVERAGE else cv2.CALIB_FIX_K3
    for _ in range(ROUNDS):
        fit = _fit(list(used.values()), flags)
        dropped = _drop_views(used, fit) or _drop_corners(used, fit)
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
    ratio = np.array([-fit.lens.fy / fit.lens.fx, 1.0]) / fit.lens.fx
    uneven_mm, is_uneven = fit.measure_paper()
    return Calibration(
        fit.lens, fit.rms_px, focal_sigma_px, aspect_sigma=float(np.sqrt(ratio @ spread[:2, :2] @ ratio)),
        coverage=cover([view.corners_px for view in used.values()], size), used=tuple(used),
        refused=tuple(sorted(refused.items())), view_px=tuple(fit.view_px), tilt_deg=tuple(fit.tilts()),
        uneven_mm=uneven_mm, is_uneven=is_uneven,
        corners_px=np.concatenate([view.corners_px for view in used.values()]),
        residuals_px=np.concatenate(fit.residuals),
    )  # fmt: skip


def _drop_views(used: dict[int, BoardSighting], fit: "_Fit") -> dict[int, str] | None:
    """Take out of `used` the views that lie far off; (index, why) of them, None where there are none."""
    usual = float(np.median(fit.view_px))
    limit = max(BAD_VIEW * usual, LEAST_OUTLIER_PX)
    bad = {
        index: f"its corners lie {off:.1f} px off, those of the others {usual:.1f} px: blurred, or the board bent"
        for index, off in zip(used, fit.view_px, strict=True)
        if off > limit
    }
    for index in bad:
        del used[index]
    return bad or None


def _drop_corners(used: dict[int, BoardSighting], fit: "_Fit") -> dict[int, str] | None:
    """Take corners that lie far off out of the views, and views out of `used` that keep too few; as `_drop_views`."""
    limit = max(OUTLIER_SIGMAS * fit.rms_px / np.sqrt(2), LEAST_OUTLIER_PX)
    good = [np.linalg.norm(residuals, axis=1) < limit for residuals in fit.residuals]
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
    depth = place @ homography[2, :2] / homography[2, 2]  # relative to that of the middle
    return float(np.ptp(depth))


def cover(pixels: Sequence[np.ndarray], size: tuple[int, int]) -> float:
    """Share of the frame's cells that hold a corner: pixels (n, 2) per view, size (width, height)."""
    cells = np.floor(np.concatenate(pixels) / size * CELLS).astype(int)
    inside = ((cells >= 0) & (cells < CELLS)).all(axis=1)
    return len(np.unique(cells[inside], axis=0)) / (CELLS[0] * CELLS[1])


@dataclass(frozen=True)
class _Fit:
    """A lens and the poses of its views, as OpenCV fits them."""

    views: list[BoardSighting]
    lens: Camera
    free: list[int]
    rotations: Sequence[np.ndarray]
    translations: Sequence[np.ndarray]
    residuals: list[np.ndarray]
    jacobians: list[np.ndarray]

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((np.concatenate(self.residuals) ** 2).sum(axis=1).mean()))

    @property
    def view_px(self) -> list[float]:
        return [float(np.sqrt((one**2).sum(axis=1).mean())) for one in self.residuals]

    def tilts(self) -> list[float]:
        """Degrees between the board's normal and the optical axis."""
        normals = [cv2.Rodrigues(rotation)[0][2, 2] for rotation in self.rotations]
        return [float(np.degrees(np.arccos(min(abs(one), 1.0)))) for one in normals]

    def spread(self) -> np.ndarray:
        """(k, k) covariance of fx, fy, cx, cy and the distortion: the jackknife over views.

        Corners of one view err together (a bent sheet, motion, focus), so that the scatter of single corners, as
        OpenCV states it, is two to four times too sure. Leaving one view out moves the least-squares solution by
        -(H - H_v)⁻¹ g_v, where H_v and g_v are that view's normal equations with its own pose taken out; the sum of
        squares is the jackknife's variance (Efron and Tibshirani 1993, chapter 11). Few views make it
        unsure itself: two of its deviations then hold what two of a normal one do, by Student's t.
        """
        from scipy.stats import t as student

        normal, gradient = [], []
        for jacobian, residuals in zip(self.jacobians, self.residuals, strict=True):
            of_pose, _ = np.linalg.qr(jacobian[:, :6])
            # fx, fy, cx, cy and distortion follow the pose in OpenCV's Jacobian
            of_lens = jacobian[:, 6:][:, self.free]
            of_lens = of_lens - of_pose @ (of_pose.T @ of_lens)
            normal.append(of_lens.T @ of_lens)
            gradient.append(of_lens.T @ residuals.reshape(-1))
        whole, count = np.sum(normal, axis=0), len(normal)
        moved = np.array([np.linalg.lstsq(whole - a, -b, rcond=None)[0] for a, b in zip(normal, gradient, strict=True)])
        wider = student.ppf(0.97725, count - 1) / 2
        return wider**2 * (count - 1) / count * moved.T @ moved

    def measure_paper(self) -> tuple[float, bool]:
        """Mean places of the corners on the board, root mean square in mm; whether the paper or its print is uneven."""
        ids = np.concatenate([view.ids for view in self.views])
        off: list[np.ndarray] = []
        for rotation, residuals, jacobian in zip(self.rotations, self.residuals, self.jacobians, strict=True):
            # a step along the board moves a corner as that translation of the board does
            steps = jacobian[:, 3:6].reshape(-1, 2, 3) @ cv2.Rodrigues(rotation)[0][:, :2]
            off.append(np.linalg.solve(steps, residuals[..., None])[..., 0])
        places = np.concatenate(off)
        means, chance = [], []
        for number in np.unique(ids):
            mine = places[ids == number]
            if len(mine) >= LEAST_SLANTED:
                means.append((mine.mean(axis=0) ** 2).sum())
                chance.append((mine.var(axis=0, ddof=1) / len(mine)).sum())
        if not means:
            return 0.0, False
        uneven, expected = np.sqrt(np.mean(means)), np.sqrt(np.mean(chance))
        world = np.concatenate([view.world_mm for view in self.views])
        matters = LEAST_UNEVEN_SHARE * float(np.linalg.norm(np.ptp(world, axis=0)))
        return float(uneven), bool(uneven > UNEVEN_PAPER * expected and uneven > matters)


def _fit(views: list[BoardSighting], flags: int) -> _Fit:
    size = (views[0].width, views[0].height)
    world = [view.world_mm.astype(np.float32) for view in views]
    pixels = [view.corners_px.astype(np.float32) for view in views]
    try:
        # matrix and distortion are filled in, not started from
        _, matrix, distortion, rotations, translations = cv2.calibrateCamera(
            world, pixels, size, np.eye(3), np.zeros(5), flags=flags
        )
    except cv2.error as error:
        raise ToolkitError(
            f"the photos do not determine a lens ({str(error.err).strip()[:60]}): take them at a slant from all sides"
        ) from None
    k1, k2, p1, p2, k3 = map(float, distortion.reshape(-1)[:5])
    fx, fy, cx, cy = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    lens = Camera(size[0], size[1], fx=fx, fy=fy, cx=cx, cy=cy, distortion=(k1, k2, p1, p2, k3))
    residuals, jacobians = [], []
    for view, rotation, translation in zip(views, rotations, translations, strict=True):
        points = view.world_mm.astype(float)
        placed, jacobian = cv2.projectPoints(points, rotation, translation, lens.matrix, lens.coefficients)
        residuals.append(view.corners_px - placed.reshape(-1, 2))
        jacobians.append(jacobian)
    free = list(range(8 if flags & cv2.CALIB_FIX_K3 else 9))
    return _Fit(views, lens, free, rotations, translations, residuals, jacobians)


def _why_not(view: BoardSighting, first: BoardSighting) -> str | None:
    if (view.width, view.height) != (first.width, first.height):
        return f"{view.width}x{view.height} px, the others have {first.width}x{first.height}"
    if len(view.ids) < LEAST_CORNERS:
        return f"{len(view.ids)} corners of the board were found, at least {LEAST_CORNERS} are needed"
    spread = np.linalg.svd(view.world_mm[:, :2] - view.world_mm[:, :2].mean(axis=0), compute_uv=False)
    return "the corners that were found lie on one line" if spread[1] < 0.05 * spread[0] else None


def _too_few(given: int, usable: int, refused: dict[int, str]) -> str:
    why = f" (the first that is not: {refused[min(refused)]})" if refused else ""
    return (
        f"{usable} of {given} photos of the board can be used{why}: a lens needs at least {LEAST_VIEWS}, from several "
        "sides, at a slant, with the board in every part of the frame"
    )
