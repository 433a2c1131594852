"""A frame from first hits to colour: rays, edges that need more samples, and the picture."""

import math
from typing import NamedTuple

import numpy as np

from toolkit.rig.kernel.compiled import inlined, kernel
from toolkit.rig.kernel.scene import (
    LitMesh,
    Surround,
    View,
    background,
    ray_through,
    shade,
    surface_normal,
)

SUBPIXELS = np.array([[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]])
"""Offsets of the four samples: a rotated grid, which resolves near-horizontal and near-vertical edges best."""
NOTHING = 0xFFFFFFFF
"""The face of a ray that meets nothing."""


class Hits(NamedTuple):
    """First hits of rays.

    Attributes:
        distance: (n,) float32; inf where nothing is met.
        face: (n,) uint32.
        uv: (n, 2) float32 barycentric weights of corners 1 and 2.
    """

    distance: np.ndarray
    face: np.ndarray
    uv: np.ndarray


@inlined
def _set_ray(rays: np.ndarray, n: int, view: View, x: float, y: float) -> None:
    dx, dy, dz = ray_through(view, x, y)
    scale = 1 / math.sqrt(dx * dx + dy * dy + dz * dz)
    rays[n, 0], rays[n, 1], rays[n, 2] = view.origin[0], view.origin[1], view.origin[2]
    rays[n, 3], rays[n, 4], rays[n, 5] = dx * scale, dy * scale, dz * scale


@kernel
def fill_pixel_rays(view: View, left: int, top: int, right: int, bottom: int, rays: np.ndarray) -> None:
    """Fill (n, 6) float32 with rays through the pixels' centres of a part, row by row: origin, unit direction."""
    n = 0
    for row in range(top, bottom):
        for column in range(left, right):
            _set_ray(rays, n, view, column + 0.5, row + 0.5)
            n += 1


@kernel
def fill_sample_rays(view: View, left: int, top: int, width: int, refine: np.ndarray, rays: np.ndarray) -> None:
    """Fill (4 n, 6) float32 with rays through four samples of each of the pixels `refine` of a part of this width."""
    for i in range(len(refine)):
        row, column = refine[i] // width, refine[i] % width
        for k in range(4):
            _set_ray(rays, 4 * i + k, view, left + column + 0.5 + SUBPIXELS[k, 0], top + row + 0.5 + SUBPIXELS[k, 1])


@kernel
def mark_edges(
    mesh: LitMesh, hits: Hits, rays: np.ndarray, width: int, material: np.ndarray, normal: np.ndarray,
    needed: np.ndarray,
) -> None:  # fmt: skip
    """Mark pixels whose neighbours show another material, a jump in depth or a crease; and all on fine materials.

    Args:
        mesh: what is seen.
        hits, rays: of the pixels, row by row, `width` to a row.
        width: of the part, pixels.
        material, normal: (n,) int32 and (n, 3) float32 to work with.
        needed: (n,) bool, the marks.
    """
    count = len(hits.face)
    for n in range(count):
        material[n] = -1
        needed[n] = False
        if hits.face[n] == NOTHING:
            continue
        face = hits.face[n]
        material[n] = mesh.material[face]
        needed[n] = mesh.finely[material[n]]
        x, y, z = surface_normal(mesh, int(face), float(hits.uv[n, 0]), float(hits.uv[n, 1]))
        sign = -1.0 if x * rays[n, 3] + y * rays[n, 4] + z * rays[n, 5] > 0 else 1.0
        normal[n, 0], normal[n, 1], normal[n, 2] = sign * x, sign * y, sign * z
    for n in range(count):
        if n % width:
            _compare(n, n - 1, material, normal, hits.distance, needed)
        if n >= width:
            _compare(n, n - width, material, normal, hits.distance, needed)


@inlined
def _compare(a: int, b: int, material: np.ndarray, normal: np.ndarray, depth: np.ndarray, needed: np.ndarray) -> None:
    """Mark two neighbours where an edge lies between them."""
    if material[a] == material[b]:
        if material[a] < 0 or (needed[a] and needed[b]):
            return
        same = normal[a, 0] * normal[b, 0] + normal[a, 1] * normal[b, 1] + normal[a, 2] * normal[b, 2]
        if abs(depth[a] - depth[b]) <= 0.02 * depth[a] and same >= 0.75:
            return
    needed[a] = True
    needed[b] = True


class Part(NamedTuple):
    """The part of a picture that can show the object, and what its rays met.

    Attributes:
        left, top, right, bottom: pixels.
        hits: of the pixels' centres, row by row.
        refine: (k,) int32 pixels of the part that have four samples.
        fine: hits of these.
    """

    left: int
    top: int
    right: int
    bottom: int
    hits: Hits
    refine: np.ndarray
    fine: Hits


@kernel
def paint_background(around: Surround, view: View, edges: np.ndarray, picture: np.ndarray) -> None:
    """Fill a picture (h, w, 3) float32 with table and room, in exposure units; `edges` of `find_table_edges`."""
    for row in range(view.height):
        for column in range(view.width):
            red, green, blue = background(around, view, edges, column + 0.5, row + 0.5)
            picture[row, column, 0] = red * around.exposure
            picture[row, column, 1] = green * around.exposure
            picture[row, column, 2] = blue * around.exposure


class Linear(NamedTuple):
    """Where the object's part of a linear view is written; see `toolkit.rig.linear_view.LinearView`.

    Attributes:
        coverage: (h, w) float32.
        pixel, uv, lod, gain: of samples, filled from the front: (k,) int32, (k, 2), (k,), (k, 3) float32; k is 0 where
            no texture is left out.
    """

    coverage: np.ndarray
    pixel: np.ndarray
    uv: np.ndarray
    lod: np.ndarray
    gain: np.ndarray


@kernel
def paint_object(around: Surround, mesh: LitMesh, view: View, part: Part, picture: np.ndarray, out: Linear) -> int:
    """Put the object over a picture (h, w, 3) float32, in exposure units; returns how many samples `out` has."""
    width, next_fine, count = part.right - part.left, 0, 0
    for n in range(len(part.hits.face)):
        row, column = part.top + n // width, part.left + n % width
        finely = next_fine < len(part.refine) and part.refine[next_fine] == n
        first = 4 * next_fine if finely else n
        shots, hits = (4, part.fine) if finely else (1, part.hits)
        next_fine += finely
        scale = around.exposure / shots
        red, green, blue, missed = 0.0, 0.0, 0.0, 0
        for k in range(shots):
            face = hits.face[first + k]
            if face == NOTHING:
                missed += 1
                continue
            x, y = column + 0.5, row + 0.5
            if finely:
                x, y = x + SUBPIXELS[k, 0], y + SUBPIXELS[k, 1]
            u, v, distance = hits.uv[first + k, 0], hits.uv[first + k, 1], hits.distance[first + k]
            seen = shade(around, mesh, view, (x, y), (int(face), float(u), float(v), float(distance)))
            red, green, blue = red + seen.colour[0], green + seen.colour[1], blue + seen.colour[2]
            if len(out.pixel) and (seen.gain[0] > 0 or seen.gain[1] > 0 or seen.gain[2] > 0):
                out.pixel[count] = row * view.width + column
                out.uv[count, 0], out.uv[count, 1], out.lod[count] = seen.u, seen.v, seen.lod
                for c in range(3):
                    out.gain[count, c] = seen.gain[c] * scale
                count += 1
        if missed < shots:
            share = missed / shots
            out.coverage[row, column] = 1 - share
            picture[row, column, 0] = picture[row, column, 0] * share + red * scale
            picture[row, column, 1] = picture[row, column, 1] * share + green * scale
            picture[row, column, 2] = picture[row, column, 2] * share + blue * scale
    return count
