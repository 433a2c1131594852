"""Has the patch moved between the photographs of one object? Where it was is triangulated from all of them.

Each photograph whose camera is known says along which lines the cells of its patch lie. Seen from several sides these
lines meet where the cells are, whatever the object's shape; a photograph whose lines pass beside the others' meeting
points was taken with the patch elsewhere, or with the object shifted on its board.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toolkit.captures.gates.patch import cell_middles
from toolkit.captures.gates.result import Gate
from toolkit.captures.gates.solid import View
from toolkit.captures.sheet.find_patch import CELL_SHOWS, PatchSighting
from toolkit.captures.sheet.patch_size import SIZE_TOLERANCE

MOVED = Gate("patch moved", 5.0, "mm", "put it where it is in the other photographs, and take this one again")
"""5 mm: a patch that stayed in its place is found within 0.2 mm in the rig's photographs, also by a lens that is 2 %
off; a page that is not quite flat and a lens that nobody calibrated add a millimetre or two. A patch that was taken
off and taped on again by eye lies 5 to 20 mm off."""
SIZE = Gate(
    "patch size",
    100 * SIZE_TOLERANCE,
    "% off",
    "print it again at 100 % ('actual size'), with a ruler on the page's bars",
)
"""2 %: the rig's photographs give the side within 0.3 %; "fit to page" makes it 3 to 6 % too small."""
LEAST_PHOTOS = 3
"""Of two that disagree, nobody knows which one is right."""
LEAST_CELLS = 4
LEAST_ANGLE_DEG = 8.0
"""Lines that are closer to parallel than this do not say where they meet."""
ROUNDS = 20
SOFT_MM = 0.5


@dataclass(frozen=True)
class PatchLines:
    """Lines of sight on which the cells of a patch lie.

    Attributes:
        origin_mm: (3,) the camera.
        directions: (25, 3) unit vectors in the world, rows of cells down.
        shows: (25,) bool: which cells were seen.
    """

    origin_mm: np.ndarray
    directions: np.ndarray
    shows: np.ndarray

    def to_json(self) -> dict[str, list]:
        """The same for a file; directions to a hundred-thousandth, which is 0.01 mm at a metre."""
        return {
            "origin_mm": np.round(self.origin_mm, 3).tolist(), "directions": np.round(self.directions, 6).tolist(),
            "shows": self.shows.tolist(),
        }  # fmt: skip


def lines_from_json(content: dict[str, list]) -> PatchLines:
    """Undo `PatchLines.to_json`."""
    return PatchLines(
        np.array(content["origin_mm"], float), np.array(content["directions"], float), np.array(content["shows"], bool)
    )


def trace_patch(sighting: PatchSighting, view: View) -> PatchLines:
    """The lines of a patch that was found; `view` is of the same picture at the same size."""
    pixels = sighting.place.to_pixels(cell_middles())
    rays = view.rays(view.lens.undistort(pixels))
    return PatchLines(view.position_mm, rays, sighting.agreement.ravel() >= CELL_SHOWS)


def measure_moves(photos: Sequence[PatchLines]) -> list[float | None]:
    """How far in mm each photograph's patch lies beside where the photographs together have it.

    Args:
        photos: of one object with one patch.

    Returns:
        The median over the cells that it shows; None where too few photographs show them, or all from one side.
    """
    if len(photos) < LEAST_PHOTOS:
        return [None] * len(photos)
    misses = np.full((len(photos), photos[0].shows.size), np.nan)
    for cell, point in enumerate(triangulate_cells(photos)):
        who = [i for i, photo in enumerate(photos) if photo.shows[cell]]
        if np.isfinite(point).all():
            origins = np.array([photos[i].origin_mm for i in who])
            misses[who, cell] = _miss(point, origins, np.array([photos[i].directions[cell] for i in who]))
    enough = np.isfinite(misses).sum(axis=1) >= LEAST_CELLS
    return [float(np.nanmedian(row)) if good else None for row, good in zip(misses, enough, strict=True)]


def triangulate_cells(photos: Sequence[PatchLines]) -> np.ndarray:
    """(25, 3) where the cells are in the world, mm; NaN where too few photographs show one, or all from one side."""
    points = np.full((photos[0].shows.size, 3), np.nan)
    for cell in range(len(points)):
        who = [photo for photo in photos if photo.shows[cell]]
        if len(who) >= LEAST_PHOTOS:
            directions = np.array([photo.directions[cell] for photo in who])
            if _spread_deg(directions) >= LEAST_ANGLE_DEG:
                points[cell] = meet(np.array([photo.origin_mm for photo in who]), directions)
    return points


def measure_side(photos: Sequence[PatchLines]) -> float | None:
    """The side of the patch, mm, from the distances of neighbouring cells; None where too few are known.

    Paper that is bent keeps its lengths, and over a fifth of a patch a bend shortens nothing that could be measured.
    """
    if len(photos) < LEAST_PHOTOS:
        return None
    points = triangulate_cells(photos)
    count = round(len(points) ** 0.5)
    grid = points.reshape(count, count, 3)
    steps = np.concatenate([np.diff(grid, axis=axis).reshape(-1, 3) for axis in (0, 1)])
    lengths = np.linalg.norm(steps, axis=1)
    known = lengths[np.isfinite(lengths)]
    return None if len(known) < LEAST_CELLS else float(np.median(known)) * count


def meet(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(3,) the point with the least sum of distances to lines (Weiszfeld's weights), so that few strays do not draw it.

    Args:
        origins: (n, 3) a point of each.
        directions: (n, 3) unit vectors, not all parallel.
    """
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weight = np.ones(len(origins))
    point = origins.mean(axis=0)
    for _ in range(ROUNDS):
        weighted = across * weight[:, None, None]
        point = np.linalg.solve(weighted.sum(axis=0), (weighted @ origins[:, :, None]).sum(axis=0))[:, 0]
        weight = 1 / np.maximum(_miss(point, origins, directions), SOFT_MM)
    return point


def _miss(point: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n,) distances of a point from lines."""
    return np.linalg.norm(np.cross(point - origins, directions), axis=1)


def _spread_deg(directions: np.ndarray) -> float:
    """The widest angle between two of them."""
    return float(np.degrees(np.arccos(np.clip((directions @ directions.T).min(), -1, 1))))
