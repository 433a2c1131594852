"""Pictures of a calibration: where in the frame corners were seen, and what was left of their errors."""

import re
from pathlib import Path

import numpy as np

from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.photos.calibrate import CalibrationRun
from toolkit.photos.lens_fit import CELLS, Calibration

LONGEST_NAME = 100
ARROW_SHARE = 0.03
"""Of the frame's width, how long the arrow of a usual error is drawn."""


@with_default_style
def draw_calibration(found: Calibration, title: str) -> bytes:
    """PNG of the frame: cells without a corner hatched, corners coloured by their error, mean errors as arrows."""
    lens, corners, residuals = found.lens, found.corners_px, found.residuals_px
    figure = make_figure(8, 8 * lens.height / lens.width + 0.8)
    axes = figure.add_subplot()
    cell = np.array([lens.width, lens.height]) / CELLS
    at = np.clip(np.floor(corners / cell).astype(int), 0, np.array(CELLS) - 1)
    arrow = ARROW_SHARE * lens.width / max(found.reprojection_px, 1e-6)
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
    order = np.argsort(off)
    dots = axes.scatter(
        corners[order, 0],
        corners[order, 1],
        c=off[order],
        s=6,
        cmap="viridis_r",
        vmin=0,
        vmax=3 * found.reprojection_px,
        linewidths=0,
    )
    figure.colorbar(dots, ax=axes, label="error of a corner, px", shrink=0.8)
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
