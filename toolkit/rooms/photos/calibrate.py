"""`toolkit calibrate`: from photographs of a board to a lens in `rig/lens.json`, and pictures of its errors."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.read import UnreadableImage
from toolkit.rig.board import Board
from toolkit.rooms.photos.board_pose import BoardSighting, explain_absence, find_board
from toolkit.rooms.photos.lens import LensRecord, turns_upright
from toolkit.rooms.photos.lens_fit import CELLS, Calibration, calibrate_lens
from toolkit.rooms.photos.photo import Photo, list_photos, load_pixels, read_photo
from toolkit.rooms.photos.video import pick_frames

VIDEO_EVERY_S = 1.0
MOST_FRAMES = 30
"""Largest number of frames taken from a video; more frames hardly improve the lens."""

LensKey = tuple[str | None, float | None, tuple[int, int]]


@dataclass(frozen=True)
class LensResult:
    """Result of the photographs of a camera at a focal length and size.

    Attributes:
        size: width and height as the sensor stores them.
        names: of the photographs with the board, in the order of `calibration`.
        calibration: None if they do not suffice, for the reason `why`.
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
    """Lenses by camera, focal length and size; (name, why) of photographs without a board and of unreadable files."""

    lenses: tuple[LensResult, ...]
    without_board: tuple[tuple[str, str], ...]
    unreadable: tuple[tuple[str, str], ...]


def calibrate_folder(folder: Path, board: Board) -> CalibrationRun:
    """Find the board in every photograph of a folder and calibrate each lens that took enough of them.

    Frames of a video are taken a second apart. The same photograph twice counts once.

    Raises:
        ToolkitError: the folder cannot be read, or holds no photograph.
    """
    found = list_photos(folder)
    if not found.photos:
        raise ToolkitError(f"{folder}: no photographs in it: expected JPEG, HEIC, PNG, DNG or video files of the board")
    # views of the board by camera, focal length and size
    views: dict[LensKey, list[tuple[str, BoardSighting]]] = {}
    without_board: list[tuple[str, str]] = []
    unreadable, seen = list(found.refused), set[tuple[str, int | None]]()
    with progress("finding the board", len(found.photos)) as bar:
        for path in found.photos:
            name = str(path.relative_to(folder))
            try:
                for photo in _photos_of(path):
                    if photo.identity in seen:
                        continue
                    seen.add(photo.identity)
                    shown = name if photo.frame is None else f"{name} frame {photo.frame}"
                    pixels = load_pixels(photo)
                    if (sighting := find_board(pixels, board)) is None:
                        without_board.append((shown, explain_absence(pixels, board)))
                        continue
                    # as the sensor stores the picture, so that all ways up count together
                    view = stored_sighting(sighting, turns_upright(photo.path))
                    key = (photo.camera, photo.focal_35mm_mm, (view.width, view.height))
                    views.setdefault(key, []).append((shown, view))
            except UnreadableImage as error:
                unreadable.append((name, error.reason))
            bar.advance(note=name)
    lenses = tuple(_calibrate(key, of_lens) for key, of_lens in views.items())
    return CalibrationRun(lenses, tuple(without_board), tuple(unreadable))


def stored_sighting(sighting: BoardSighting, turns: int) -> BoardSighting:
    """Move a sighting from the upright to the stored picture, which `turns` quarter turns clockwise set upright."""
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
    # a second apart
    frames = pick_frames(path, VIDEO_EVERY_S)
    # frames are spread over the whole video, since those that follow each other show nearly the same view
    chosen = np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int)
    for i in dict.fromkeys(chosen.tolist()):
        yield replace(photo, frame=frames[i])


def _calibrate(key: LensKey, views: list[tuple[str, BoardSighting]]) -> LensResult:
    names = tuple(name for name, _ in views)
    try:
        return LensResult(*key, names, calibrate_lens([view for _, view in views]))
    except ToolkitError as error:
        return LensResult(*key, names, None, str(error))


LONGEST_NAME = 100
ARROW_SHARE = 0.03
"""Length of the arrow of a usual error, as a share of the frame's width."""


@with_default_style
def draw_calibration(found: Calibration, title: str) -> bytes:
    """PNG of the frame: cells without a corner hatched, corners coloured by their error, mean errors as arrows."""
    # cells of the frame, and the cell of each corner
    lens, corners, residuals = found.lens, found.corners_px, found.residuals_px
    figure = make_figure(8, 8 * lens.height / lens.width + 0.8)
    axes = figure.add_subplot()
    cell = np.array([lens.width, lens.height]) / CELLS
    at = np.clip(np.floor(corners / cell).astype(int), 0, np.array(CELLS) - 1)
    # arrows are enlarged: real errors are a fraction of a pixel
    arrow = ARROW_SHARE * lens.width / max(found.reprojection_px, 1e-6)
    # empty cells are hatched, the others have their mean error as an arrow
    for column in range(CELLS[0]):
        for row in range(CELLS[1]):
            inside = (at == (column, row)).all(axis=1)
            low = cell * (column, row)
            if not inside.any():
                axes.fill_between(
                    [low[0], low[0] + cell[0]], low[1], low[1] + cell[1], facecolor="0.93", edgecolor="0.7",
                    hatch="//", linewidth=0,
                )  # fmt: skip
                continue
            middle, mean = low + cell / 2, residuals[inside].mean(axis=0) * arrow
            axes.quiver(*middle, *mean, angles="xy", scale_units="xy", scale=1, width=0.003, zorder=3)
    off = np.linalg.norm(residuals, axis=1)
    order = np.argsort(off)  # the worst errors are drawn last, on top of the others
    # a colour scale up to three times the usual error: a stray corner does not pale all others
    (x, y), most = corners[order].T, 3 * found.reprojection_px
    dots = axes.scatter(x, y, c=off[order], s=6, linewidths=0, cmap="viridis_r", vmin=0, vmax=most)
    figure.colorbar(dots, ax=axes, label="error of a corner, px", shrink=0.8)
    # the y axis points down, as in a picture
    axes.set(xlim=(0, lens.width), ylim=(lens.height, 0), aspect="equal", xlabel="px", ylabel="px")
    axes.set_title(
        f"{title}\n{len(found.used)} photos, {found.coverage:.0%} of the frame covered (hatched: no corner), "
        f"{found.reprojection_px:.2f} px; arrows: mean error of a cell × {arrow:.0f}",
        fontsize=9,
    )
    return encode_figure(figure)


def write_pictures(workspace: Workspace, run: CalibrationRun) -> list[Path]:
    """Write `rig/preview/lens-CAMERA-SIZE.png` for each lens of a run that was measured; returns the files."""
    files = []
    for result in run.lenses:
        if result.calibration is not None:
            focal = f" {result.focal_35mm_mm:g} mm" if result.focal_35mm_mm else ""
            title = f"{result.camera or 'camera'}{focal} {result.size[0]}x{result.size[1]}"
            name = "-".join(re.findall("[a-z0-9]+", title.lower()))[:LONGEST_NAME]
            file = workspace.root / "rig" / "preview" / f"lens-{name}.png"
            files.append(write_bytes(file, draw_calibration(result.calibration, title)))
    return files
