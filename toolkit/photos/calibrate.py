"""`toolkit calibrate`: from photographs of the printed board to a measured lens in `rig/lens.json`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.imaging.read import UnreadableImage
from toolkit.photos.board_pose import BoardSighting, find_board
from toolkit.photos.lens import LensRecord, turns_upright
from toolkit.photos.photo import Photo, list_photos, load_pixels, read_photo
from toolkit.photos.video import pick_frames
from toolkit.rig.board import Board
from toolkit.rig.camera import Camera

LEAST_VIEWS = 6
LEAST_CORNERS = 12
"""Of a view that is used."""
OUTLIER_SIGMAS = 4.0
LEAST_OUTLIER_PX = 0.5
CELLS = (8, 6)
"""The frame is divided into so many cells across and down to say how much of it was covered."""
GOOD_COVERAGE = 0.6
GOOD_FOCAL_SIGMA = 0.003
"""Relative standard deviation of the focal length; distances are as sure as it."""
MOST_FOCAL_SIGMA = 0.02
"""Less sure than that, what EXIF says is better."""
SLANT = 0.1
"""By this share the camera's distance must change over the board for a view to count as slanted. Seen straight on, a
long lens far away and a short one near by take the same picture."""
LEAST_SLANTED = 3
K3_VIEWS = 12
"""With fewer views, or a poorer coverage than `GOOD_COVERAGE`, the sixth-order term of distortion stays 0: a few
corners near the frame's edge would bend it at will."""
LARGE_RMS_PX = 1.5
ROUNDS = 4


@dataclass(frozen=True)
class Calibration:
    """A measured lens.

    Attributes:
        lens: of pictures of the views' size.
        reprojection_px: root mean square distance of the corners from where the lens and the views' poses put them.
        focal_sigma_px: standard deviation of fx.
        coverage: share of the frame's cells that held a corner in any view.
        used: index of each view that was used.
        refused: (index, why) of the others.
    """

    lens: Camera
    reprojection_px: float
    focal_sigma_px: float
    coverage: float
    used: tuple[int, ...]
    refused: tuple[tuple[int, str], ...]

    def advice(self) -> list[str]:
        """What would make the calibration surer; empty where nothing is amiss."""
        lines = []
        if self.focal_sigma_px / self.lens.fx > GOOD_FOCAL_SIGMA:
            lines.append(
                f"the focal length is known to {self.focal_sigma_px / self.lens.fx:.1%} only: add photos that see the "
                "board at a slant, from several sides"
            )
        if self.coverage < GOOD_COVERAGE:
            lines.append(
                f"corners were seen in {self.coverage:.0%} of the frame: add photos with the board in its corners"
            )
        if self.reprojection_px > LARGE_RMS_PX * max(self.lens.width, self.lens.height) / 1920:
            lines.append(
                f"the corners lie {self.reprojection_px:.2f} px off: was the board flat, the zoom fixed, and is "
                "rig/board.json the board that was printed?"
            )
        return lines


def calibrate_lens(views: Sequence[BoardSighting]) -> Calibration:
    """Fit focal lengths, principal point and distortion to views of a board, all in pictures of one size.

    Corners that do not agree with the rest are dropped.

    Raises:
        ToolkitError: fewer than `LEAST_VIEWS` views can be used, or they do not determine a lens.
    """
    refused = {index: why for index, view in enumerate(views) if (why := _why_not(view, views[0]))}
    used = [index for index in range(len(views)) if index not in refused]
    if len(used) < LEAST_VIEWS:
        raise ToolkitError(_too_few(len(views), len(used), refused))
    slanted = sum(measure_slant(views[index]) > SLANT for index in used)
    if slanted < LEAST_SLANTED:
        raise ToolkitError(
            f"{slanted} of {len(used)} photos see the board at a slant, at least {LEAST_SLANTED} must: tilt the camera "
            "by 30° to 60°, from several sides"
        )
    world = [views[index].world_mm.astype(np.float32) for index in used]
    pixels = [views[index].corners_px.astype(np.float32) for index in used]
    size = (views[0].width, views[0].height)
    coverage = cover(pixels, size)
    flags = 0 if len(used) >= K3_VIEWS and coverage >= GOOD_COVERAGE else cv2.CALIB_FIX_K3
    for _ in range(ROUNDS):
        fit = _fit(world, pixels, size, flags)
        limit = max(OUTLIER_SIGMAS * fit.rms_px / np.sqrt(2), LEAST_OUTLIER_PX)
        good = [error < limit for error in fit.errors]
        if all(mask.all() for mask in good):
            break
        kept = [i for i, mask in enumerate(good) if mask.sum() >= LEAST_CORNERS]
        for i in set(range(len(used))) - set(kept):
            refused[used[i]] = "its corners do not agree with those of the other photos"
        used = [used[i] for i in kept]
        if len(used) < LEAST_VIEWS:
            raise ToolkitError(_too_few(len(views), len(used), refused))
        world, pixels = ([points[i][good[i]] for i in kept] for points in (world, pixels))
    if not fit.focal_sigma_px < MOST_FOCAL_SIGMA * fit.lens.fx:
        raise ToolkitError(
            f"the photos tell the focal length to {fit.focal_sigma_px / fit.lens.fx:.0%} only: add photos that see the "
            "board at a slant, from several sides"
        )
    return Calibration(
        fit.lens,
        fit.rms_px,
        fit.focal_sigma_px,
        cover(pixels, size),
        used=tuple(used),
        refused=tuple(sorted(refused.items())),
    )


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
    lens: Camera
    rms_px: float
    focal_sigma_px: float
    errors: list[np.ndarray]


def _fit(world: list[np.ndarray], pixels: list[np.ndarray], size: tuple[int, int], flags: int) -> _Fit:
    try:
        _, matrix, distortion, rotations, translations, sigmas, *_ = cv2.calibrateCameraExtended(
            world,
            pixels,
            size,
            np.eye(3),
            np.zeros(5),
            flags=flags,  # both are filled in, not started from
        )
    except cv2.error as error:
        raise ToolkitError(
            f"the photos do not determine a lens ({str(error.err).strip()[:60]}): take them at a slant from all sides"
        ) from None
    k1, k2, p1, p2, k3 = map(float, distortion.reshape(-1)[:5])
    fx, fy, cx, cy = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    lens = Camera(size[0], size[1], fx=fx, fy=fy, cx=cx, cy=cy, distortion=(k1, k2, p1, p2, k3))
    errors = []
    for points, seen, rotation, translation in zip(world, pixels, rotations, translations, strict=True):
        placed, _ = cv2.projectPoints(points, rotation, translation, lens.matrix, lens.coefficients)
        errors.append(np.linalg.norm(placed.reshape(-1, 2) - seen, axis=1))
    rms = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    return _Fit(lens, rms, float(sigmas.reshape(-1)[0]), errors)


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


VIDEO_EVERY_S = 1.0
MOST_FRAMES = 30
"""Of one video: more teach a lens little."""

LensKey = tuple[str | None, float | None, tuple[int, int]]


@dataclass(frozen=True)
class LensResult:
    """What came of the photographs of one camera, focal length and size.

    Attributes:
        camera, focal_35mm_mm: as EXIF has them.
        size: width and height as the sensor stores them.
        names: of the photographs in which the board was found; `calibration` counts them in this order.
        calibration: None where they do not do, for the reason `why`.
    """

    camera: str | None
    focal_35mm_mm: float | None
    size: tuple[int, int]
    names: tuple[str, ...]
    calibration: Calibration | None
    why: str = ""

    def record(self) -> LensRecord | None:
        """What `rig/lens.json` keeps of it."""
        if self.calibration is None:
            return None
        found = self.calibration
        lens = found.lens
        return LensRecord(
            camera=self.camera, focal_35mm_mm=self.focal_35mm_mm, width=lens.width, height=lens.height,
            fx=round(lens.fx, 4), fy=round(lens.fy, 4), cx=round(lens.cx, 4), cy=round(lens.cy, 4),
            distortion=lens.distortion, reprojection_px=round(found.reprojection_px, 4),
            focal_sigma_px=round(found.focal_sigma_px, 4), views=len(found.used), coverage=round(found.coverage, 4),
        )  # fmt: skip


@dataclass(frozen=True)
class CalibrationRun:
    """Everything that came of a folder.

    Attributes:
        lenses: one per camera, focal length and size.
        without_board: names of photographs in which no board was found.
        unreadable: (name, reason) of files that do not decode.
    """

    lenses: tuple[LensResult, ...]
    without_board: tuple[str, ...]
    unreadable: tuple[tuple[str, str], ...]


@dataclass
class _Sorting:
    """What is gathered while the photographs are gone through."""

    views: dict[LensKey, list[tuple[str, BoardSighting]]] = field(default_factory=dict)
    without_board: list[str] = field(default_factory=list)
    unreadable: list[tuple[str, str]] = field(default_factory=list)


def calibrate_folder(folder: Path, board: Board) -> CalibrationRun:
    """Find the board in every photograph of a folder and calibrate each lens that took enough of them.

    Frames of a video are taken a second apart. The same photograph twice counts once.

    Args:
        folder: photographs of the board, with or without an object on it.
        board: the sheet that was printed.

    Raises:
        ToolkitError: the folder cannot be read, or holds no photograph.
    """
    found = list_photos(folder)
    if not found.photos:
        raise ToolkitError(f"{folder}: no photographs in it: expected JPEG, HEIC, PNG, DNG or video files of the board")
    sorting = _Sorting(unreadable=list(found.refused))
    seen: set[tuple[str, int | None]] = set()
    with progress("finding the board", len(found.photos)) as bar:
        for path in found.photos:
            name = str(path.relative_to(folder))
            try:
                for photo in _photos_of(path):
                    if photo.identity not in seen:
                        seen.add(photo.identity)
                        _sort_photo(photo, name, board, sorting)
            except UnreadableImage as error:
                sorting.unreadable.append((name, error.reason))
            bar.advance(note=name)
    lenses = [_calibrate(key, views) for key, views in sorting.views.items()]
    return CalibrationRun(tuple(lenses), tuple(sorting.without_board), tuple(sorting.unreadable))


def stored_sighting(sighting: BoardSighting, turns: int) -> BoardSighting:
    """A sighting in an upright picture, moved to the stored one: `turns` quarter turns clockwise bring it upright."""
    x, y = sighting.corners_px.T
    width, height = sighting.width, sighting.height
    places = {0: (x, y), 1: (y, width - x), 2: (width - x, height - y), 3: (height - y, x)}[turns % 4]
    size = (width, height) if turns % 2 == 0 else (height, width)
    return replace(sighting, corners_px=np.stack(places, axis=1), width=size[0], height=size[1])


def _photos_of(path: Path) -> Iterator[Photo]:
    photo = read_photo(path)
    if photo.kind != "video":
        yield photo
        return
    frames = pick_frames(path, VIDEO_EVERY_S)
    chosen = np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int)
    for i in dict.fromkeys(chosen.tolist()):
        yield replace(photo, frame=frames[i])


def _sort_photo(photo: Photo, name: str, board: Board, sorting: _Sorting) -> None:
    shown = name if photo.frame is None else f"{name} frame {photo.frame}"
    sighting = find_board(load_pixels(photo), board)
    if sighting is None:
        sorting.without_board.append(shown)
        return
    stored = stored_sighting(sighting, turns_upright(photo.path))
    key = (photo.camera, photo.focal_35mm_mm, (stored.width, stored.height))
    sorting.views.setdefault(key, []).append((shown, stored))


def _calibrate(key: LensKey, views: list[tuple[str, BoardSighting]]) -> LensResult:
    names = tuple(name for name, _ in views)
    try:
        return LensResult(*key, names, calibrate_lens([view for _, view in views]))
    except ToolkitError as error:
        return LensResult(*key, names, None, str(error))
