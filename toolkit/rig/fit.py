"""Do the printed sheets lie on the places that the object's spec names?

A sheet that is larger than its place becomes a tent: it floats over what is below, and hangs over the edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import PACKAGE_DATA, Workspace
from toolkit.objects.find_patch import find_patch_file
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import TAPE_MARGIN_MM, read_patch
from toolkit.objects.spec import PatchMount, Side, printed_size_mm
from toolkit.rig.mount import SAMPLES, LaidSheet, cast_heights, lay_sheet, mount_sheets

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

FLOATING_OFF = 0.1
"""A point of the sheet floats where the surface is further below it than this share of the patch's side."""
MOST_FLOATING = 0.25
"""Share of the sheet's area. On the shipped objects 0 to 21 % floats; over a moka pot's open lid 75 % and more."""
LOOSE_MM = 6.0
MOST_LOOSE = 0.3
"""Share of the white margin that may be further off the surface than `LOOSE_MM`, where no tape holds it."""
MOST_OVERHANG = 0.15
"""Share of the sheet with nothing below it; more is a tent, over an open lid for instance."""
MOST_BEND_DEG = 100.0
NEW_PATCH_MM = printed_size_mm(100)
"""Side of a patch of 100 px in mm, which training makes by default."""
ACROSS = 41
MOST_PLACES = 1_000_000
"""Places of the grid that are looked at together."""
MANY_FACES = 200_000
"""From here on rays find heights sooner than a look at every face does, once their tree is built."""


@dataclass(frozen=True)
class SheetFit:
    """How flat a sheet fits on an object."""

    at: Side  # the side of the object
    size_mm: float  # side of the patch
    floating: float  # share of the sheet that the surface is too far below, see `FLOATING_OFF`
    loose: float  # share of its white margin that no tape can hold, see `LOOSE_MM`
    overhang: float  # share of it with no surface below at all
    bend_deg: float  # greatest angle between two places of the sheet
    relief_mm: float  # how far the surface below rises and falls against the sheet, 5th to 95th percentile
    points_mm: np.ndarray  # (n, 3) all over the sheet, in the world

    @property
    def lies(self) -> bool:
        """Whether it is on the object, its margin holds, and it is no tent over an edge or an opening, nor a roll."""
        is_held = self.floating <= MOST_FLOATING and self.loose <= MOST_LOOSE
        return is_held and self.overhang <= MOST_OVERHANG and self.bend_deg <= MOST_BEND_DEG


def measure_fit(
    item: TableObject, size_mm: float, mount: PatchMount | None = None, scene: "RaycastingScene | None" = None
) -> SheetFit:
    """Measure how a patch of that side, with its white margin, lies where `mount` (by default the spec's first) says.

    The heights below it come from the mesh's triangles, or for more than `MANY_FACES` from rays into `scene`, if given.

    Raises:
        ToolkitError: it cannot be mounted there at all, as `lay_sheet` says.
    """
    mount = mount or item.spec.mounts[0]
    by_rays = scene is not None and len(item.mesh.faces) > MANY_FACES
    find_heights = partial(cast_heights, scene) if by_rays else partial(survey_heights, item.mesh)
    laid = lay_sheet(item.mesh, size_mm, mount, item.name, find_heights)
    points, slope = _spread(laid)
    # the nearest place of the grid of heights
    steps = (points[:, :2] / (size_mm + 2 * TAPE_MARGIN_MM) + 0.5) * (SAMPLES - 1)
    column, row = np.rint(steps).astype(int).clip(0, SAMPLES - 1).T
    # across the sheet, not straight down: tape bridges what is near along the normal
    below = (points[:, 2] - laid.heights[row, column]) * np.cos(slope)
    hit = np.isfinite(below)
    # without the outermost twentieths: a single groove or knob is no relief
    relief = float(np.ptp(np.percentile(below[hit], [5, 95]))) if hit.any() else 0.0
    rotation, place = laid.T_object_sheet[:3, :3], laid.T_object_sheet[:3, 3]
    return SheetFit(
        mount.at, size_mm, floating=float((below > FLOATING_OFF * size_mm).mean()),
        loose=float((below[_is_margin(size_mm)] > LOOSE_MM).mean()),
        overhang=1 - float(hit.mean()), bend_deg=float(np.degrees(np.ptp(slope))), relief_mm=relief,
        points_mm=points @ rotation.T + place,
    )  # fmt: skip


def survey_heights(mesh: Mesh, T_object_sheet: np.ndarray, side: float) -> np.ndarray:
    """(SAMPLES, SAMPLES) height of the surface over a sheet's plane, as `LaidSheet` has it, without casting rays.

    Every triangle is spread over the places of the grid within its bounds; of all that cover a place the highest
    counts.
    """
    local = (mesh.vertices - T_object_sheet[:3, 3]) @ T_object_sheet[:3, :3]
    # a bit for each side of the sheet that a vertex is beyond: a triangle with all three beyond a side is not below it
    beyond = np.zeros(len(local), np.uint8)
    for bit, (axis, sign) in enumerate(product((0, 1), (1, -1))):
        beyond |= (sign * local[:, axis] > 0.51 * side).astype(np.uint8) << bit
    a, b, c = mesh.faces.T
    corners = local[mesh.faces[(beyond[a] & beyond[b] & beyond[c]) == 0]].astype(float)  # (m, 3, 3)
    grid = (corners[..., :2] / side + 0.5) * (SAMPLES - 1)
    # places of the grid within the bounds of each triangle
    first, second, third = grid[:, 0], grid[:, 1], grid[:, 2]  # sooner than along an axis of three
    low = np.ceil(np.minimum(np.minimum(first, second), third) - 1e-6).clip(0, SAMPLES).astype(int)
    high = np.floor(np.maximum(np.maximum(first, second), third) + 1e-6).clip(-1, SAMPLES - 1).astype(int)
    size = (high - low + 1).clip(0)
    # corners b and c from a, once for each triangle
    (left, top), (b_right, b_down) = grid[:, 0].T.copy(), (grid[:, 1] - grid[:, 0]).T.copy()
    c_right, c_down = (grid[:, 2] - grid[:, 0]).T.copy()
    area = b_right * c_down - b_down * c_right
    heights = np.full(SAMPLES * SAMPLES, -np.inf)
    counts = size.prod(axis=1)
    for part in np.array_split(np.flatnonzero(counts), max(1, int(counts.sum() // MOST_PLACES))):
        # all places of all triangles in an array: a loop in Python would be slow on meshes of many faces. First the
        # triangle of each row of places and what the row's places share, then the row of each place.
        row, step = _count_up(size[part, 1])
        row = part[row]
        y = low[row, 1] + step
        v = y - top[row]
        at, step = _count_up(size[row, 0])
        x = low[row, 0][at] + step
        u = x - left[row][at]
        # barycentric weights; a triangle on edge has no area and covers nothing
        whole = area[row][at]
        with np.errstate(divide="ignore", invalid="ignore"):
            second = (u * c_down[row][at] - (v * c_right[row])[at]) / whole
            third = ((b_right[row] * v)[at] - b_down[row][at] * u) / whole
            covered = np.flatnonzero((second >= -1e-6) & (third >= -1e-6) & (second + third <= 1 + 1e-6))
        at = at[covered]
        a, b, c = corners[row, :, 2].T
        # linear over the triangle
        height = a[at] + second[covered] * (b - a)[at] + third[covered] * (c - a)[at]
        # the sheet comes down from above and meets what is highest
        np.maximum.at(heights, (y * SAMPLES)[at] + x[covered], height)
    return heights.reshape(SAMPLES, SAMPLES)


def _count_up(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of items, each as often as it counts, and 0, 1, 2, … within each item."""
    item = np.repeat(np.arange(len(counts)), counts)
    return item, np.arange(len(item)) - (np.cumsum(counts) - counts)[item]


def _spread(laid: LaidSheet) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) points all over the sheet in its own frame, and (n,) how steep it is there, radians."""
    share = np.linspace(0, 1, ACROSS)[None, :, None]
    points = laid.points[:, :1] * (1 - share) + laid.points[:, 1:] * share
    run, lift = laid.points[:, 0, 0 if laid.along_right else 1], laid.points[:, 0, 2]
    slope = np.arctan2(np.gradient(lift), np.gradient(run))
    return points.reshape(-1, 3), np.repeat(slope, ACROSS)


def _is_margin(size_mm: float) -> np.ndarray:
    """(n,) bool: which of the points of `_spread` are on the white paper round the patch."""
    inner = TAPE_MARGIN_MM / (size_mm + 2 * TAPE_MARGIN_MM)
    away = [np.abs(np.linspace(-0.5, 0.5, count)) > 0.5 - inner for count in (SAMPLES, ACROSS)]
    return (away[0][:, None] | away[1][None, :]).reshape(-1)


def describe_misfits(item: TableObject, sizes_mm: Sequence[float]) -> list[str]:
    """A line on each sheet that does not fit flat, as `describe_misfit`, or on two that overlap.

    Args:
        sizes_mm: side of the patch on each of its sheets.
    """
    lines = [line for number, size in enumerate(sizes_mm, 1) if (line := describe_misfit(item, size, number))]
    if len(sizes_mm) > 1:
        try:
            mount_sheets(item.mesh, np.zeros((1, 1, 3), np.uint8), item.spec.mounts, sizes_mm, item.name)
        except ToolkitError as error:
            lines += [] if lines else [str(error)]
    return lines


def describe_misfit(item: TableObject, size_mm: float, number: int = 1) -> str | None:
    """A line on a sheet that does not fit flat in its place; None if it does.

    Args:
        number: of the sheet, 1 for the first.
    """
    mount, is_only = item.spec.mounts[number - 1], len(item.spec.mounts) == 1
    try:
        fit = measure_fit(item, size_mm, mount)
    except ToolkitError as error:
        # the middle of "where: what is wrong: what to do", as another advice follows
        trouble = str(error).partition(": ")[2].partition(": ")[0]
    else:
        if fit.lies:
            return None
        # of several troubles the last here is told
        trouble = f"it bends by {fit.bend_deg:.0f}°"
        if fit.overhang > MOST_OVERHANG:
            trouble = f"{fit.overhang:.0%} of the sheet has nothing below"
        if fit.floating > MOST_FLOATING:
            trouble = f"{fit.floating:.0%} of the sheet is more than {FLOATING_OFF * size_mm:.0f} mm off the surface"
        if fit.loose > MOST_LOOSE:
            trouble = f"{fit.loose:.0%} of its margin cannot be taped"
    which = "a patch" if is_only else f"sheet {number}, a patch"
    said = f"{item.name}: {which} of {size_mm:.0f} mm does not fit flat on its {mount.at} ({trouble})"
    return f"{said}; 'toolkit place --object {item.name}' shows where one fits"


def mounted_sizes_mm(workspace: Workspace, item: TableObject) -> tuple[float, ...]:
    """Side of an object's patch on each sheet: from the spec, else its record, else as training makes patches."""
    if all(mount.size_mm is not None for mount in item.spec.mounts):
        return item.spec.sizes_mm(NEW_PATCH_MM)
    file = find_patch_file(workspace, item.spec)
    return item.spec.sizes_mm(NEW_PATCH_MM if file is None else read_patch(file).size_mm)


def is_own(workspace: Workspace, name: str) -> bool:
    """Whether an object is the user's; the built-in ones, as they are shipped, are framed without their sheets."""
    return not workspace.object_spec(name).is_relative_to(PACKAGE_DATA)


def sheet_points(workspace: Workspace, item: TableObject) -> np.ndarray | None:
    """(n, 3) points all over the sheets of a user's own object, mm; None if a sheet cannot be mounted."""
    if not is_own(workspace, item.name):
        return None
    try:
        placed = zip(mounted_sizes_mm(workspace, item), item.spec.mounts, strict=True)
        return np.concatenate([measure_fit(item, size_mm, mount).points_mm for size_mm, mount in placed])
    except ToolkitError:
        return None
