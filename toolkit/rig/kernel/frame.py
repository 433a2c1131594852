"""A frame from first hits to colour: rays, edges that need more samples, and the picture."""

import math
from typing import NamedTuple

import numpy as np

from toolkit.rig.kernel.compiled import inlined, kernel
from toolkit.rig.kernel.lanes import prefetch, weighted_sum
from toolkit.rig.kernel.scene import (
    TILE,
    CameraView,
    LitMesh,
    Surround,
    all_inside,
    background,
    ray_through,
    shade,
    surface_normal,
)
from toolkit.rig.kernel.textures import Colour

SUBPIXELS = np.array([[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]])
"""Offsets of the four samples: a rotated grid, which resolves near-horizontal and near-vertical edges best."""
NOTHING = 0xFFFFFFFF
"""The face of a ray that meets nothing."""


class Hits(NamedTuple):
    """First hits of rays."""

    distance: np.ndarray  # (n,) float32; inf where nothing is met
    face: np.ndarray  # (n,) uint32
    uv: np.ndarray  # (n, 2) float32 barycentric weights of corners 1 and 2
    mesh: np.ndarray  # (n,) uint8: 0 the object, 1 its surroundings
    key_share: np.ndarray  # (n,) float32 of the key light that is seen there; -1 where stored light says it


@kernel
def take_nearer(hits: Hits, others: Hits, where: np.ndarray) -> None:
    """Put hits of other rays in place of those that lie further away; the i-th of them belongs to ray `where[i]`."""
    for i in range(len(where)):
        n = where[i]
        if others.distance[i] < hits.distance[n]:
            hits.distance[n], hits.face[n], hits.mesh[n] = others.distance[i], others.face[i], others.mesh[i]
            hits.uv[n, 0], hits.uv[n, 1] = others.uv[i, 0], others.uv[i, 1]
            hits.key_share[n] = others.key_share[i]


@kernel
def fill_key_rays(
    mesh: LitMesh, hits: Hits, seen: np.ndarray, key: Colour, lift: float, which: np.ndarray, rays: np.ndarray
) -> int:
    """Rays to the key light from all hits on the surroundings that face it; returns how many there are.

    Args:
        hits: their `key_share` becomes 0.
        seen: (n, 6) float32 the rays that hit.
        key: unit direction to the light.
        lift: the rays start so far above the surface, and 1e-4 of the distance.
        which, rays: (n,) int32 and (n, 6) float32, are filled from the front with hits and their rays.
    """
    count = 0
    for n in range(len(hits.face)):
        # the object's stored light holds its key light already
        if hits.face[n] == NOTHING or hits.mesh[n] == 0:
            continue
        hits.key_share[n] = 0
        x, y, z = surface_normal(mesh, int(hits.face[n]), float(hits.uv[n, 0]), float(hits.uv[n, 1]))
        # the side of the surface that the ray came from
        if x * seen[n, 3] + y * seen[n, 4] + z * seen[n, 5] > 0:
            x, y, z = -x, -y, -z
        if x * key[0] + y * key[1] + z * key[2] <= 0:
            continue
        distance = hits.distance[n]
        # float32 hits lie up to so far off the surface: without it the surface would shade itself
        up = lift + 1e-4 * distance
        which[count] = n
        rays[count, 0] = seen[n, 0] + distance * seen[n, 3] + up * x
        rays[count, 1] = seen[n, 1] + distance * seen[n, 4] + up * y
        rays[count, 2] = seen[n, 2] + distance * seen[n, 5] + up * z
        rays[count, 3], rays[count, 4], rays[count, 5] = key[0], key[1], key[2]
        count += 1
    return count


class Samples(NamedTuple):
    """Places in a part of a picture, as many in each of some pixels."""

    left: int  # left, top, right, bottom: pixels of the part
    top: int
    right: int
    bottom: int
    pixels: np.ndarray  # (n,) int32 those that have samples, counted in the part row by row
    offsets: np.ndarray  # (k, 2) the samples of a pixel, from its centre; sample k of pixel i is number i · k + k


@inlined
def sample_place(samples: Samples, n: int) -> tuple[float, float]:
    """Pixel coordinates (x, y) of a sample."""
    shots, width = len(samples.offsets), samples.right - samples.left
    # samples of a pixel lie side by side
    pixel, k = samples.pixels[n // shots], n % shots
    return (
        samples.left + pixel % width + 0.5 + samples.offsets[k, 0],
        samples.top + pixel // width + 0.5 + samples.offsets[k, 1],
    )


@kernel
def fill_rays(view: CameraView, samples: Samples, rays: np.ndarray) -> None:
    """Fill (n, 6) float32 with rays through samples: origin, unit direction."""
    for n in range(len(rays)):
        x, y = sample_place(samples, n)
        dx, dy, dz = ray_through(view, x, y)
        scale = 1 / math.sqrt(dx * dx + dy * dy + dz * dz)
        rays[n, 0], rays[n, 1], rays[n, 2] = view.origin[0], view.origin[1], view.origin[2]
        rays[n, 3], rays[n, 4], rays[n, 5] = dx * scale, dy * scale, dz * scale


@kernel
def move_rays(mesh: LitMesh, rays: np.ndarray, moved: np.ndarray) -> None:
    """Fill `moved` (n, 6) float32 with rays (n, 6) of the world in the mesh's own frame."""
    t, p = mesh.turn, mesh.place
    for n in range(len(rays)):
        # the inverse of a rotation is its transpose: columns where `turn` holds rows
        x, y, z = rays[n, 0] - p[0], rays[n, 1] - p[1], rays[n, 2] - p[2]
        dx, dy, dz = rays[n, 3], rays[n, 4], rays[n, 5]
        for c in range(3):
            moved[n, c] = t[0][c] * x + t[1][c] * y + t[2][c] * z
            moved[n, 3 + c] = t[0][c] * dx + t[1][c] * dy + t[2][c] * dz


@inlined
def _ask_ahead(mesh: LitMesh, hits: Hits, n: int) -> None:
    """Ask for what the hits soon after the n-th read of a mesh: each would wait for memory several times."""
    if n + 6 >= len(hits.face):
        return
    # faces are asked for six hits ahead, what they name three hits ahead, when the faces have come
    face = hits.face[n + 6]
    if face < len(mesh.faces):
        prefetch(mesh.faces, int(face))
    face = hits.face[n + 3]
    if face < len(mesh.faces):
        met = mesh.faces[face]
        prefetch(mesh.stored, 5 * met.first)
        prefetch(mesh.stored, 5 * met.first + 14)  # three samples, the fewest, mostly lie in two of its lines
        prefetch(mesh.corners, 5 * int(met.a))
        prefetch(mesh.corners, 5 * int(met.b))
        prefetch(mesh.corners, 5 * int(met.c))


@kernel
def describe_hits(
    mesh: LitMesh, number: int, view: CameraView, samples: Samples, hits: Hits, material: np.ndarray,
    normal: np.ndarray, needed: np.ndarray,
) -> None:  # fmt: skip
    """Fill in what is seen of a mesh, for `mark_edges`; pixels on materials that are seen finely are marked.

    Args:
        mesh, number: the mesh, and its number in `Hits.mesh`.
        samples: a single sample in each pixel of a part.
        material: (n,) int32, -1 where nothing is met.
        normal: (n, 3) float32 towards the camera.
        needed: (n,) bool, the marks.
    """
    n = -1
    for row in range(samples.top, samples.bottom):
        for column in range(samples.left, samples.right):
            n += 1
            _ask_ahead(mesh, hits, n)
            if hits.face[n] == NOTHING or hits.mesh[n] != number:
                continue
            face = int(hits.face[n])
            needed[n] = mesh.finely[mesh.faces[face].material]
            # a number for both: neighbours of different meshes never count as alike
            material[n] = 2 * mesh.faces[face].material + number
            x, y, z = surface_normal(mesh, face, float(hits.uv[n, 0]), float(hits.uv[n, 1]))
            dx, dy, dz = ray_through(view, column + 0.5, row + 0.5)
            # so that both sides of a sheet make no crease
            sign = -1.0 if x * dx + y * dy + z * dz > 0 else 1.0
            normal[n, 0], normal[n, 1], normal[n, 2] = sign * x, sign * y, sign * z


@kernel
def mark_edges(width: int, hits: Hits, material: np.ndarray, normal: np.ndarray, needed: np.ndarray) -> None:
    """Mark pixels whose neighbours show another material, a jump in depth, a crease or the edge of a shadow.

    Args:
        width: of the part, pixels.
        material, normal, needed: of `describe_hits`.
    """
    for n in range(len(hits.face)):
        # to the left and above: every pair of neighbours is met once
        if n % width:
            _compare(n, n - 1, material, normal, hits, needed)
        if n >= width:
            _compare(n, n - width, material, normal, hits, needed)


@inlined
def _compare(a: int, b: int, material: np.ndarray, normal: np.ndarray, hits: Hits, needed: np.ndarray) -> None:
    """Mark two neighbours where an edge lies between them."""
    if material[a] == material[b]:
        if material[a] < 0 or (needed[a] and needed[b]):
            return
        # of unit normals: the cosine of the angle between them
        same = normal[a, 0] * normal[b, 0] + normal[a, 1] * normal[b, 1] + normal[a, 2] * normal[b, 2]
        depth, other = hits.distance[a], hits.distance[b]
        # 2 % of the distance is a jump in depth; 0.75 is a crease of 41 degrees
        if abs(depth - other) <= 0.02 * depth and same >= 0.75 and hits.key_share[a] == hits.key_share[b]:
            return
    needed[a] = True
    needed[b] = True


class TracedRegion(NamedTuple):
    """The part of a picture that can show the object, and what its rays met."""

    left: int  # left, top, right, bottom: pixels
    top: int
    right: int
    bottom: int
    hits: Hits  # of the pixels' centres, row by row
    refine: np.ndarray  # (k,) int32 pixels of the part that have four samples
    fine: Hits  # hits of these


@kernel
def paint_background(
    around: Surround, view: CameraView, edges: np.ndarray, sheen: np.ndarray, coverage: np.ndarray, picture: np.ndarray,
    apart: bool,
) -> None:  # fmt: skip
    """Add table and room to a picture (h · w, 3) float32, in exposure units, where the object leaves some to be seen.

    Args:
        edges, sheen: of `find_table_edges` and `fill_sheen`.
        coverage: (h · w,) share of each pixel that the object covers.
        apart: what is seen of table and room is added as if no object covered a part of the pixel.
    """
    for top in range(0, view.height, TILE):
        bottom = min(top + TILE, view.height)
        for left in range(0, view.width, TILE):
            right = min(left + TILE, view.width)
            # most tiles show table alone: the test for its edge is then left out of the inner loop
            inside = all_inside(edges, left, top, right, bottom)
            corner = 4 * (top // TILE * sheen.shape[1] + left // TILE)
            below = corner + 4 * sheen.shape[1]
            for row in range(top, bottom):
                # what `fill_sheen` worked out at the tile's corners, bilinear between them
                down = (row - top) * (1 / TILE)
                a = weighted_sum(sheen, (corner, below), (1 - down, down))
                b = weighted_sum(sheen, (corner + 4, below + 4), (1 - down, down))
                b = (b[0] - a[0], b[1] - a[1], b[2] - a[2], b[3] - a[3])
                for column in range(left, right):
                    place = np.uint64(row * view.width + column)
                    if coverage[place] == 1:
                        continue
                    x = (column - left) * (1 / TILE)
                    shine = (a[0] + b[0] * x, a[1] + b[1] * x, a[2] + b[2] * x, a[3] + b[3] * x)
                    red, green, blue = background(around, view, edges, shine, (row, column), inside)
                    scale = around.exposure if apart else around.exposure * (1 - coverage[place])
                    picture[place, 0] += red * scale
                    picture[place, 1] += green * scale
                    picture[place, 2] += blue * scale


class Linear(NamedTuple):
    """Output of the object's part of a linear view; see `toolkit.rig.shading.LinearView`."""

    coverage: np.ndarray  # (h · w,) float32
    # pixel, uv, lod, gain: of samples, filled from the front: (k,) int32, (k, 2), (k,), (k, 3) float32; k is 0 where no
    # texture is left out
    pixel: np.ndarray
    uv: np.ndarray
    lod: np.ndarray
    gain: np.ndarray


@kernel
def paint_mesh(
    around: Surround, mesh: LitMesh, number: int, view: CameraView, part: TracedRegion, picture: np.ndarray, out: Linear
) -> int:
    """Add what rays met of a mesh to a picture (h · w, 3) float32, in exposure units, and to `out.coverage`.

    Args:
        mesh, number: the mesh, and its number in `Hits.mesh`.
        out: where the object's part of a linear view is written.

    Returns:
        How many samples `out` has.
    """
    n, next_fine, count = -1, 0, 0
    for row in range(part.top, part.bottom):
        for column in range(part.left, part.right):
            n += 1
            finely = next_fine < len(part.refine) and part.refine[next_fine] == n
            first = 4 * next_fine if finely else n
            shots, hits = (4, part.fine) if finely else (1, part.hits)
            # `refine` is in the order of pixels, so one counter walks through it
            next_fine += finely
            # a box filter: every sample of a pixel counts alike
            scale = around.exposure / shots
            red, green, blue, met = 0.0, 0.0, 0.0, 0
            for k in range(shots):
                _ask_ahead(mesh, hits, first + k)
                at = np.uint64(first + k)
                face = hits.face[at]
                if face == NOTHING or hits.mesh[at] != number:
                    continue
                met += 1
                x, y = column + 0.5, row + 0.5
                if finely:
                    x, y = x + SUBPIXELS[k, 0], y + SUBPIXELS[k, 1]
                u, v, distance = hits.uv[at, 0], hits.uv[at, 1], hits.distance[at]
                hit = (int(face), float(u), float(v), float(distance), float(hits.key_share[at]))
                seen = shade(around, mesh, view, (x, y), hit)
                red, green, blue = red + seen.colour[0], green + seen.colour[1], blue + seen.colour[2]
                # samples that no texture can change are not kept: most of a picture
                if len(out.pixel) and (seen.gain[0] > 0 or seen.gain[1] > 0 or seen.gain[2] > 0):
                    out.pixel[count] = row * view.width + column
                    out.uv[count, 0], out.uv[count, 1], out.lod[count] = seen.u, seen.v, seen.lod
                    for c in range(3):
                        out.gain[count, c] = seen.gain[c] * scale
                    count += 1
            if met:
                place = np.uint64(row * view.width + column)
                out.coverage[place] += met / shots
                picture[place, 0] += red * scale
                picture[place, 1] += green * scale
                picture[place, 2] += blue * scale
    return count
