"""Compare a printed colour chart in every renderer with its print profile: print_colours.py PROFILE.

Writes docs/results/print-colours.csv. A flat sheet with 64 colours lies on the table in studio light. Each renderer
shows the chart and a blank sheet, from the same four places: their ratio is the chart's colour against its paper.
"""

import sys
from itertools import product
from pathlib import Path

import numpy as np
from tables import TABLES, Row, write_table

from toolkit.boosters.transforms.printing import SHEEN, use_profile
from toolkit.captures.shoot import print_booster, print_pixels
from toolkit.imaging.colour import delta_e2000, lab_of_linear, srgb_to_linear
from toolkit.imaging.printer import read_print_profile
from toolkit.rig.applied.patch import PatchBooster
from toolkit.rig.camera import Camera, orbit_pose, project
from toolkit.rig.mount import PAPER, make_flat_sheet
from toolkit.rig.renderers import RENDERERS, make_renderer
from toolkit.rig.scene import Scene
from toolkit.rig.studio import make_studio

STEPS = 4
"""Values of each channel of the chart's colours."""
SIZE_MM = 160.0
ELEVATIONS = 35, 50, 65, 80
FILE = TABLES / "print-colours.csv"


def main(profile: str) -> None:
    """Write a row for each renderer."""
    values = np.linspace(0, 255, STEPS).round()
    side = round(STEPS**1.5)
    chart = np.array(list(product(values, repeat=3)), np.uint8).reshape(side, side, 3)
    found = read_print_profile(Path(profile))
    booster = print_booster(PatchBooster(chart, "", "chart", (SIZE_MM,)), use_profile(found, SHEEN), 0, "chart")
    printed = print_pixels(use_profile(found).with_overrides(texel_mm=SIZE_MM / side), chart, 0, "chart")
    # blank paper is the whole sheet, so that light, shade and gloss of each place are those of the chart
    blank = np.full_like(chart, PAPER)
    wanted = lab_of_linear(srgb_to_linear(printed.reshape(-1, 3) / np.float32(255)))
    studio, rows = make_studio(0, SIZE_MM, light="studio"), list[Row]()
    for name in RENDERERS:
        light = [_read_cells(name, pixels, side, studio) for pixels in (booster.pixels, blank)]
        seen = lab_of_linear(light[0] / light[1] * srgb_to_linear(PAPER / np.float32(255)))
        error = delta_e2000(seen, np.tile(wanted, (len(ELEVATIONS), 1)))
        dark = np.tile(wanted[:, 0] < np.quantile(wanted[:, 0], 0.25), len(ELEVATIONS))
        rows.append({
            "profile": found.name, "renderer": name, "n": len(error), "delta_e_median": float(np.median(error)),
            "delta_e_p95": float(np.quantile(error, 0.95)), "delta_e_dark": float(np.median(error[dark])),
            "lighter": float(np.median(seen[:, 0] - np.tile(wanted[:, 0], len(ELEVATIONS)))),
        })  # fmt: skip
    write_table(FILE, rows)


def _read_cells(renderer: str, pixels: np.ndarray, side: int, studio: Scene) -> np.ndarray:
    """(views · cells, 3) mean linear light of the middle of each cell of a sheet."""
    sheet, camera = make_flat_sheet(pixels, SIZE_MM), Camera.from_fov(640, 480, 40)
    shown, found = make_renderer(renderer, sheet, studio), []
    middle = (np.arange(side) + 0.5) / side - 0.5
    x, y = np.meshgrid(middle * SIZE_MM, -middle * SIZE_MM)
    places = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
    for elevation in ELEVATIONS:
        pose = orbit_pose(np.zeros(3), 20, elevation, 420)
        light = shown.render(camera, pose)
        for column, row in project(camera, pose, places)[0].astype(int):
            found.append(light[row - 3 : row + 4, column - 3 : column + 4].mean(axis=(0, 1)))
    return np.array(found)


if __name__ == "__main__":
    main(*sys.argv[1:])
