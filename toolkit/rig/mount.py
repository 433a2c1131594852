"""Taping a printed sheet to an object: a developable surface over what lies below, true to size."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Material, Mesh, cast_rays, make_ray_scene, merge_meshes
from toolkit.objects.records import TAPE_MARGIN_MM, mirror
from toolkit.objects.spec import Margin, PatchMount

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

MAX_SLOPE_DEG = 38.0
"""A taped sheet does not hang down steeper than this; it bridges what falls away faster."""
MAX_TILT_DEG = 50.0
CLEARANCE_MM = 0.4
ALIKE = 0.8
"""Cosine of the angle up to which two sheets face the same way."""
SAMPLES = 81
PAPER = (243, 243, 240)
PaperMargin = Margin | tuple[int, int, int]
"""What is on a sheet's paper around the patch; three sRGB codes are white paper of that colour."""
PAPER_MATERIAL, BACK_MATERIAL = "paper", "paper-back"

FindHeights = Callable[[np.ndarray, float], np.ndarray]
"""(T_object_sheet, side of the sheet) -> heights, as `LaidSheet` has them."""
SIDES = {
    "top": ((1, 0, 0), (0, 1, 0)),
    "front": ((0, 1, 0), (0, 0, 1)),
    "back": ((0, -1, 0), (0, 0, 1)),
    "left": ((-1, 0, 0), (0, 0, 1)),
    "right": ((1, 0, 0), (0, 0, 1)),
}
"""Right and up of each side as seen; for the top, right is the object's front."""


@dataclass(frozen=True)
class MountedSheet:
    """A mounted sheet."""

    mesh: Mesh  # the sheet's two faces; materials `paper` (printed) and `paper-back` (white)
    size_mm: float  # side of the patch, without the margin around it
    T_object_sheet: np.ndarray  # (4, 4), the sheet's own frame before bending: x right, y up, z off the surface

    def show(self, pixels: np.ndarray, margin: PaperMargin = "white") -> "MountedSheet":
        """The same sheet with other pixels (n, n, 3) uint8 sRGB printed on it."""
        paper, back = self.mesh.materials
        printed = replace(paper, texture=print_on_paper(pixels, self.size_mm, margin))
        return replace(self, mesh=replace(self.mesh, materials=(printed, back)))

    def points(self, across: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(k, 3) places on the printed face, and its normals there, at (k,) shares of the sheet's sides."""
        edges = [array[: 2 * SAMPLES].reshape(SAMPLES, 2, -1) for array in (self.mesh.vertices, self.mesh.normals)]
        # the first half of the vertices is the front: along the bend, and at both straight edges
        run, rule = (across, up) if self.mesh.uv[0, 0] == self.mesh.uv[1, 0] else (up, across)
        at = run * (SAMPLES - 1)
        first = np.clip(at.astype(np.int64), 0, SAMPLES - 2)
        blend, rule = (at - first)[:, None, None], rule[:, None]
        found = []
        for edge in edges:
            lines = edge[first] * (1 - blend) + edge[first + 1] * blend
            found.append(lines[:, 0] * (1 - rule) + lines[:, 1] * rule)
        return found[0], found[1] / np.linalg.norm(found[1], axis=1, keepdims=True)


def mount_patch(
    mesh: Mesh,
    pixels: np.ndarray,
    size_mm: float,
    mount: PatchMount,
    name: str = "object",
    margin: PaperMargin = "white",
) -> MountedSheet:
    """Stick a printed sheet on a side of an object.

    The sheet is first tilted with the surface below it. It is then bent about a single axis, as paper is, into the taut
    curve over the highest points below. Its lengths are kept: a millimetre on paper stays a millimetre on the object.

    Args:
        pixels: (n, n, 3) uint8 sRGB; row 0 is the sheet's upper edge.
        margin: what is on the paper around the patch.

    Raises:
        ToolkitError: the patch is over half of the object's longest side, or there is no surface below it.
    """
    scene = make_ray_scene(mesh)
    laid = lay_sheet(mesh, size_mm, mount, name, lambda T_object_sheet, side: cast_heights(scene, T_object_sheet, side))
    paper = print_on_paper(pixels, size_mm, margin)
    sheet = _sheet_mesh(laid.points, laid.along_right, laid.T_object_sheet, paper)
    return MountedSheet(sheet, size_mm, laid.T_object_sheet)


@dataclass(frozen=True)
class LaidSheet:
    """Place and shape of a sheet, in its own frame: x right, y up, z off the surface."""

    points: np.ndarray  # (SAMPLES, 2, 3) along the bend, and at both straight edges
    along_right: bool  # whether it is bent along right, and else along up
    T_object_sheet: np.ndarray  # (4, 4) of that frame
    heights: np.ndarray  # (SAMPLES, SAMPLES) of the surface below, rows along up; -inf where there is none


def lay_sheet(mesh: Mesh, size_mm: float, mount: PatchMount, name: str, find_heights: FindHeights) -> LaidSheet:
    """The shape that `mount_patch` gives a sheet, from the heights of the surface below its plane.

    Raises:
        ToolkitError: as `mount_patch`.
    """
    longest = float(mesh.size_mm.max())
    # a sheet over half of the object reaches round it, and is no patch
    if size_mm > longest / 2:
        raise ToolkitError(
            f"{name}: a patch of {size_mm:.0f} mm is over half of the object's longest side ({longest:.0f} mm): "
            f"print it smaller and say so in the spec, for example [patch] size_mm = {longest / 3:.0f}"
        )
    side = size_mm + 2 * TAPE_MARGIN_MM

    def look(T_object_sheet: np.ndarray) -> np.ndarray:
        heights = find_heights(T_object_sheet, side)
        # with under a twentieth of it over the object, the sheet has missed it
        if np.isfinite(heights).mean() < 0.05:
            raise ToolkitError(
                f"{name}: there is no surface below the patch at [patch] at = '{mount.at}', offset_mm = "
                f"{list(mount.offset_mm)}: move it onto the object"
            )
        return heights

    # heights are asked for twice: the tilted sheet looks along another normal, past what lies at its edge alone
    level = _start(mesh, mount)
    T_object_sheet = _tilt(look(level), level, side)
    heights = look(T_object_sheet)
    across, height, along_right = _bend(heights, side)
    return LaidSheet(_unroll(across, height, along_right, side), along_right, T_object_sheet, heights)


def mount_sheets(
    mesh: Mesh, pixels: np.ndarray, mounts: Sequence[PatchMount], sizes_mm: Sequence[float], name: str = "object",
    margin: PaperMargin = "white",
) -> list[MountedSheet]:  # fmt: skip
    """Stick the same patch on an object in several places, each as `mount_patch` does.

    Args:
        name: for messages, which say which sheet is meant where there are several.

    Raises:
        ToolkitError: a sheet cannot be mounted, or two overlap.
    """
    sheets = [
        mount_patch(mesh, pixels, size_mm, mount, name if len(mounts) == 1 else f"{name}, sheet {number}", margin)
        for number, (mount, size_mm) in enumerate(zip(mounts, sizes_mm, strict=True), 1)
    ]
    # every pair is tested: mounts are few
    for (first, sheet), (second, other) in combinations(enumerate(sheets), 2):
        if do_overlap(sheet, other):
            raise ToolkitError(
                f"{name}: sheet {first + 1} ({mounts[first].at}) and sheet {second + 1} ({mounts[second].at}) overlap: "
                "move either by its offset_mm, or print them smaller"
            )
    return sheets


def do_overlap(sheet: MountedSheet, other: MountedSheet) -> bool:
    """Whether two sheets overlap, or pierce each other; edges that only touch do not count.

    Two that face about the same way are compared as seen from there, as there may be air between them.
    """
    from scipy.spatial import cKDTree

    (points, normals), (other_points, other_normals) = _survey(sheet), _survey(other)
    outward, other_outward = sheet.T_object_sheet[:3, 2], other.T_object_sheet[:3, 2]
    if outward @ other_outward > ALIKE:
        middle = (outward + other_outward) / np.linalg.norm(outward + other_outward)
        points, other_points = (each - np.outer(each @ middle, middle) for each in (points, other_points))
    # as far as two samples of the larger sheet lie apart: what is nearer overlaps
    near = (max(sheet.size_mm, other.size_mm) + 2 * TAPE_MARGIN_MM) / (SAMPLES - 1)
    distance, which = cKDTree(other_points).query(points, distance_upper_bound=near)
    close = np.flatnonzero(np.isfinite(distance))
    which = which[close]
    # two rows of samples along each edge are left out: edges may touch
    inner = np.pad(np.ones((SAMPLES - 4, SAMPLES - 4), bool), 2).reshape(-1)
    is_same_side = (normals[close] * other_normals[which]).sum(axis=1) > -0.5  # else a thin plate is between them
    return bool((is_same_side & (inner[close] | inner[which])).any())


def _survey(sheet: MountedSheet) -> tuple[np.ndarray, np.ndarray]:
    """(SAMPLES², 3) points all over the printed face, and the normals there."""
    share = np.linspace(0, 1, SAMPLES)[None, :, None]
    edges = (array[: 2 * SAMPLES].reshape(SAMPLES, 2, 3) for array in (sheet.mesh.vertices, sheet.mesh.normals))
    points, normals = ((edge[:, :1] * (1 - share) + edge[:, 1:] * share).reshape(-1, 3) for edge in edges)
    return points, normals


def wear_sheets(mesh: Mesh, sheets: Sequence[MountedSheet]) -> tuple[Mesh, np.ndarray]:
    """The object with a patch's sheets on it, and the texture of their paper, which all of them share.

    Paper has a margin of the same millimetres round a patch of any size. The smallest sheet's paper, the widest in
    texels, serves the others too, texel on texel.
    """
    n_px = [len(sheet.mesh.materials[0].texture) for sheet in sheets]
    paper = sheets[int(np.argmax(n_px))].mesh.materials[0]
    shared = []
    for side, sheet in zip(n_px, sheets, strict=True):
        # about the middle, where the patch is: the texels of a smaller paper are the middle ones of the widest
        uv = (0.5 + (sheet.mesh.uv - 0.5) * (side / max(n_px))).astype(np.float32)
        worn = replace(sheet.mesh, uv=uv, materials=(paper, *sheet.mesh.materials[1:]))
        shared.append(sheet.mesh if side == max(n_px) and sheet.mesh.materials[0] is paper else worn)
    return merge_meshes([mesh, *shared]), paper.texture


def make_flat_sheet(pixels: np.ndarray, size_mm: float, margin: PaperMargin = "white") -> Mesh:
    """A printed sheet alone on the table, its middle at the origin, right towards +x."""
    side = size_mm + 2 * TAPE_MARGIN_MM
    steps = np.linspace(-side / 2, side / 2, SAMPLES)
    points = _unroll(steps, np.full(SAMPLES, CLEARANCE_MM), True, side)
    return _sheet_mesh(points, True, np.eye(4), print_on_paper(pixels, size_mm, margin))


def attach(mesh: Mesh, *sheets: MountedSheet) -> Mesh:
    """The object with sheets on it, each with its own paper."""
    return merge_meshes([mesh, *(sheet.mesh for sheet in sheets)])


def _frame(right: np.ndarray, up: np.ndarray, normal: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(4, 4) `T_object_sheet` of a plane with these axes."""
    T_object_sheet = np.eye(4)
    T_object_sheet[:3] = np.stack([right, up, normal, centre], axis=1)
    return T_object_sheet


def _start(mesh: Mesh, mount: PatchMount) -> np.ndarray:
    """(4, 4) the sheet on the plane that touches the bounding box on the mount's side."""
    right, up = (np.array(axis, float) for axis in SIDES[mount.at])
    cosine, sine = np.cos(np.radians(mount.rotation_deg)), np.sin(np.radians(mount.rotation_deg))
    turned_right, turned_up = cosine * right + sine * up, cosine * up - sine * right
    normal = np.cross(turned_right, turned_up)
    low, high = mesh.bounds
    middle = (low + high) / 2
    # half the box's extent along the normal: the plane that touches it
    reach = np.abs(normal) @ (high - low) / 2
    centre = middle + normal * reach + right * mount.offset_mm[0] + up * mount.offset_mm[1]
    return _frame(turned_right, turned_up, normal, centre)


def cast_heights(scene: "RaycastingScene", T_object_sheet: np.ndarray, side: float) -> np.ndarray:
    """(rows along up, columns along right) height of the surface over the sheet's plane, -inf where there is none."""
    right, up, normal, centre = T_object_sheet[:3].T
    steps = np.linspace(-side / 2, side / 2, SAMPLES)
    x, y = np.meshgrid(steps, steps)
    far = max(1000.0, 2 * side)  # outside the object, for the large ones too
    origins = centre + x[..., None] * right + y[..., None] * up + far * normal
    rays = np.concatenate([origins, np.broadcast_to(-normal, origins.shape)], axis=-1)
    hit = cast_rays(scene, rays)
    return np.where(np.isfinite(hit), far - hit, -np.inf)


def _tilt(heights: np.ndarray, T_object_sheet: np.ndarray, side: float) -> np.ndarray:
    """(4, 4) the sheet turned with the surface: on a plane through the upper half of the heights, by least squares.

    Its centre goes straight down to that plane, so that tilting does not carry the sheet sideways.
    """
    right, up, normal, centre = T_object_sheet[:3].T
    # where the heights were sampled in the sheet's plane, millimetres
    steps = np.linspace(-side / 2, side / 2, SAMPLES)
    x, y = np.meshgrid(steps, steps)
    known = np.isfinite(heights)
    # what lies far below the sheet, the table for instance, does not tilt it
    near = known & (heights >= np.median(heights[known]) - side / 4)
    slope_x, slope_y, _ = np.linalg.lstsq(
        np.stack([x[near], y[near], np.ones(near.sum())], axis=1), heights[near], rcond=None
    )[0]
    steepest = np.hypot(slope_x, slope_y)
    # the direction of the slope is kept, its steepness is not
    if steepest > (limit := np.tan(np.radians(MAX_TILT_DEG))):
        slope_x, slope_y = slope_x * limit / steepest, slope_y * limit / steepest
    # how far along its normal the plane lies from the sheet's centre
    level = (heights[near] - slope_x * x[near] - slope_y * y[near]).mean() * normal
    tilted_right = right + slope_x * normal
    tilted_right /= np.linalg.norm(tilted_right)
    tilted_normal = np.cross(tilted_right, up + slope_y * normal)
    tilted_normal /= np.linalg.norm(tilted_normal)
    # up follows from the other two, so that the frame stays orthonormal
    return _frame(tilted_right, np.cross(tilted_normal, tilted_right), tilted_normal, centre + level)


def _bend(heights: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """Bend along right or along up, whichever hugs better: the curve's positions and heights, and if it runs right."""
    choices = []
    for along_right, highest in ((True, heights.max(axis=0)), (False, heights.max(axis=1))):
        across, height = _taut_curve(highest, side)
        below = np.where(np.isfinite(heights), heights, np.nan)
        lifted = np.interp(np.linspace(-side / 2, side / 2, SAMPLES), across, height)
        # mean air under the sheet: paper takes the bend that leaves less
        gap = np.nanmean((lifted if along_right else lifted[:, None]) - below)
        choices.append((gap, across, height, along_right))
    _, across, height, along_right = min(choices, key=lambda choice: choice[0])
    return across, height, along_right


def _taut_curve(obstacle: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """A sheet of length `side` pulled taut over a profile: its upper hull, no steeper than the limit, rounded."""
    steps = np.linspace(-side / 2, side / 2, SAMPLES)
    known = np.isfinite(obstacle)
    slope = np.tan(np.radians(MAX_SLOPE_DEG))
    # from every point below, the sheet may fall away no steeper than the limit; the hull keeps that
    lifted = (obstacle[known] - slope * np.abs(steps[:, None] - steps[known])).max(axis=1)
    # upper hull by Andrew's monotone chain (1979): a taut sheet touches only what sticks out
    hull: list[int] = []
    for i in range(SAMPLES):
        while len(hull) >= 2 and _above(steps, lifted, hull[-2], i, hull[-1]):
            hull.pop()
        hull.append(i)
    taut = np.interp(steps, steps[hull], lifted[hull])
    width = 9  # paper has no kinks: a running mean over a tenth of the sheet
    padded = np.interp(np.arange(-width, SAMPLES + width), np.arange(SAMPLES), taut)
    # both ends keep their slope beyond the sheet, or the mean would pull them level
    padded[:width] = taut[0] + (taut[0] - taut[1]) * np.arange(width, 0, -1)
    padded[-width:] = taut[-1] + (taut[-1] - taut[-2]) * np.arange(1, width + 1)
    smooth = np.convolve(padded, np.ones(width) / width, "same")[width:-width]
    # smoothing cuts corners: lifted until nothing sticks through
    smooth += max(0.0, float((taut - smooth).max())) + CLEARANCE_MM
    # paper does not stretch: places on it go by arc length
    length = np.r_[0, np.cumsum(np.hypot(np.diff(steps), np.diff(smooth)))]
    middle = np.interp(0.0, steps, length)
    # the curve is longer than the sheet: centre the sheet over the mount's middle as far as the curve allows
    start = np.clip(middle - side / 2, 0, max(length[-1] - side, 0))
    wanted = np.linspace(start, start + side, SAMPLES)
    return np.interp(wanted, length, steps), np.interp(wanted, length, smooth)


def _above(x: np.ndarray, y: np.ndarray, first: int, last: int, middle: int) -> bool:
    """Whether the chord from first to last passes over the middle point."""
    return (y[last] - y[first]) * (x[middle] - x[first]) >= (y[middle] - y[first]) * (x[last] - x[first])


def _unroll(across: np.ndarray, height: np.ndarray, along_right: bool, side: float) -> np.ndarray:
    """(SAMPLES, 2, 3) points of the bent sheet in its own frame: along the curve, and at both straight edges."""
    edges = np.array([-side / 2, side / 2])
    curve = np.broadcast_to(across[:, None], (SAMPLES, 2))
    rule = np.broadcast_to(edges, (SAMPLES, 2))
    lift = np.broadcast_to(height[:, None], (SAMPLES, 2))
    return np.stack([curve, rule, lift] if along_right else [rule, curve, lift], axis=-1)


def _sheet_mesh(points: np.ndarray, along_right: bool, T_object_sheet: np.ndarray, paper: np.ndarray) -> Mesh:
    place = points @ T_object_sheet[:3, :3].T + T_object_sheet[:3, 3]
    # the paper bends in one direction alone: straight rulings run across it, and with the tangents give its normals
    tangent = np.gradient(place, axis=0)
    ruling = np.broadcast_to(place[:, 1:] - place[:, :1], place.shape)
    normals = np.cross(tangent, ruling) if along_right else np.cross(ruling, tangent)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    run, edge = np.meshgrid(np.linspace(0, 1, SAMPLES), [0.0, 1.0], indexing="ij")
    uv = np.stack([run, edge] if along_right else [edge, run], axis=-1)
    # two triangles between neighbouring rulings, seen from outside counter-clockwise
    index = np.arange(SAMPLES * 2).reshape(SAMPLES, 2)
    a, b, c, d = index[:-1, 0], index[1:, 0], index[1:, 1], index[:-1, 1]
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    faces = faces if along_right else faces[:, ::-1]
    place, normals, uv = (array.reshape(-1, array.shape[-1]).astype(np.float32) for array in (place, normals, uv))
    front = Mesh(
        vertices=place, normals=normals, uv=uv, faces=faces.astype(np.int32),
        face_material=np.zeros(len(faces), np.int32),
        materials=(Material(PAPER_MATERIAL, paper, roughness=0.75, sheet="taped"),),
    )  # fmt: skip
    # the unprinted back, 0.15 mm below the print
    back = replace(
        front, vertices=front.vertices - front.normals * np.float32(0.15), normals=-front.normals,
        faces=front.faces[:, ::-1].copy(),
        materials=(Material(BACK_MATERIAL, np.full((4, 4, 3), PAPER, np.uint8), roughness=0.9),),
    )  # fmt: skip
    return merge_meshes([front, back])


def size_on_paper(n_px: int, size_mm: float) -> tuple[int, int]:
    """Texels of the sheet's picture for each pixel of a patch, and for the margin."""
    repeat = max(1, round(512 / n_px))
    return repeat, round(TAPE_MARGIN_MM / size_mm * n_px * repeat)


def print_on_paper(pixels: np.ndarray, size_mm: float, margin: PaperMargin = "white") -> np.ndarray:
    """The sheet's picture: whole patch pixels with crisp edges on paper, (m, m, 3) uint8 sRGB."""
    repeat, margin_px = size_on_paper(len(pixels), size_mm)
    crisp = pixels.repeat(repeat, axis=0).repeat(repeat, axis=1)
    if margin == "bleed":
        which = mirror(len(crisp), margin_px)
        return crisp[which][:, which]
    paper = PAPER if margin == "white" else margin
    return np.stack([np.pad(crisp[..., c], margin_px, constant_values=paper[c]) for c in range(3)], axis=-1)
