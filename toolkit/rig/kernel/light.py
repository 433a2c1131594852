"""Light that was worked out beforehand: values on a triangular grid over each face, and on a map of the table.

Surfaces mirror the key light by GGX, what is all around by the split-sum approximation.
"""

import math
from typing import NamedTuple

import numpy as np

from toolkit.rig.kernel.compiled import inlined, kernel
from toolkit.rig.kernel.lanes import exp2, weighted_sum
from toolkit.rig.kernel.textures import Colour, around_place


@inlined
def key_lobe(
    normal_light: float, normal_view: float, normal_half: float, view_half: float, alpha: float
) -> tuple[float, float]:
    """A key light's mirrored radiance per irradiance, but for Fresnel's term: that is f0 + (1 - f0) · the second value.

    GGX with Smith's masking (Walter et al. 2007; Schlick's form of the masking, k = alpha / 2), times the cosine
    towards the light.

    Args:
        normal_light, normal_view, normal_half, view_half: cosines between the normal, the light, the way back to the
            camera and the half vector.
        alpha: roughness squared, widened by the light's size.
    """
    alpha2 = alpha * alpha
    # D = alpha² / (pi d²), GGX's distribution; G / (4 n·l n·v) is folded into `masking`
    d = normal_half * normal_half * (alpha2 - 1) + 1
    k = alpha / 2
    masking = (normal_view * (1 - k) + k) * (normal_light * (1 - k) + k)
    grazing = 1 - view_half
    # Schlick's (1 - cosine)^5
    square = grazing * grazing
    return alpha2 * normal_light / (4 * math.pi * d * d * masking), square * square * grazing


@inlined
def environment_brdf(roughness: float, cosine: float) -> tuple[float, float]:
    """(scale, bias) of f0 for even light from all around: Karis' fit (Physically Based Shading on Mobile, 2014)."""
    a, b = 1 - roughness, 0.0425 - 0.0275 * roughness
    c, d = 1.04 - 0.572 * roughness, 0.022 * roughness - 0.04
    a004 = min(a * a, exp2(-9.28 * cosine)) * a + b
    return c - 1.04 * a004, d + 1.04 * a004


@inlined
def find_samples(steps: int, u: float, v: float) -> tuple[int, int, int, float, float]:
    """Which stored samples of a face of `steps` rows lie around a point: three of them, and the last two's weights.

    Args:
        steps: R; row j of the face holds R + 1 - j samples, counted from its first.
        u, v: barycentric weights of corners 1 and 2.
    """
    # the cell of the grid, held within the face: rounding may put u + v a little above 1
    x, y = u * steps, v * steps
    i = min(max(int(x), 0), steps - 1)
    j = min(max(int(y), 0), steps - 1 - i)
    # within its cell: also the weights of the lower triangle's corners
    fx, fy = x - i, y - j
    # rows are R + 1, R, R - 1 … samples long: the sum of the first j is j (R + 1) - j (j - 1) / 2
    row = j * (steps + 1) - j * (j - 1) // 2
    above = (j + 1) * (steps + 1) - (j + 1) * j // 2
    # the upper of the two small triangles of this cell; the last cell of a row has none
    if fx + fy > 1 and i + j < steps - 1:
        return above + i + 1, row + i + 1, above + i, 1 - fy, 1 - fx
    return row + i, row + i + 1, above + i, fx, fy


class LightMap(NamedTuple):
    """Irradiance of the ground over a square round the object, which may stand turned and moved."""

    values: np.ndarray  # (n, n, 4) float32, of which three count; row 0 is the object's +y, columns run along its +x
    side: float  # of the square
    x: float  # x, y: its centre in the world
    y: float
    cosine: float  # cosine, sine: of the object's turn about the vertical
    sine: float


@inlined
def read_light_map(light: LightMap, x: float, y: float) -> Colour:
    """Irradiance at a place of the world's ground; beyond the square that of its border."""
    # into the object's frame: the map turns and moves with it
    dx, dy = x - light.x, y - light.y
    along, across = light.cosine * dx + light.sine * dy, light.cosine * dy - light.sine * dx
    if max(abs(along), abs(across)) > light.side / 2:  # the map's border is the same all round
        border = light.values[0, 0]
        return border[0], border[1], border[2]
    return read_square(light.values, light.side, along, across)


@inlined
def read_square(values: np.ndarray, side: float, x: float, y: float) -> Colour:
    """Bilinear value of a square picture (n, n, 4) around the origin, x right and y up; its border beyond it."""
    size = values.shape[0]
    scale = 1 / side
    # values are those of the cells' centres
    column = min(max((0.5 + x * scale) * size - 0.5, 0.0), size - 1.0)
    row = min(max((0.5 - y * scale) * size - 0.5, 0.0), size - 1.0)
    left, top = min(int(column), size - 2), min(int(row), size - 2)
    places, weights = around_place(0, size, 4, (left, left + 1, column - left), (top, top + 1, row - top))
    return weighted_sum(values, places, weights)[:3]


@kernel
def make_shadow_rays(
    points: np.ndarray, normals: np.ndarray, direction: np.ndarray, box: np.ndarray, free: np.ndarray,
    which: np.ndarray, rays: np.ndarray,
) -> int:  # fmt: skip
    """Rays from points that face a direction and may meet what lies in a box; returns how many there are.

    Args:
        points, normals: (n, 3) float32.
        direction: (3,) float32.
        box: (2, 3) float32 lowest and highest coordinates.
        free: (n,) uint8 becomes 0 where a point looks away and 1 elsewhere.
        which, rays: (n,) int32 and (n, 6) float32, are filled from the front with points and their rays.
    """
    count = 0
    for n in range(len(points)):
        cosine = normals[n, 0] * direction[0] + normals[n, 1] * direction[1] + normals[n, 2] * direction[2]
        free[n] = 1 if cosine > 0 else 0
        if cosine <= 0:
            continue
        # where the ray enters and leaves the box (the slab method)
        near, far = np.float32(0), np.float32(np.inf)
        for axis in range(3):
            # a ray along a wall of the box would divide by zero
            step = direction[axis] if abs(direction[axis]) > 1e-12 else np.float32(1e-12)
            a, b = (box[0, axis] - points[n, axis]) / step, (box[1, axis] - points[n, axis]) / step
            near, far = max(near, min(a, b)), min(far, max(a, b))
        # it misses the box, so nothing can block it: no ray is spent
        if near > far:
            continue
        which[count] = n
        for axis in range(3):
            rays[count, axis], rays[count, 3 + axis] = points[n, axis], direction[axis]
        count += 1
    return count


@kernel
def gather_light(
    normals: np.ndarray, points: np.ndarray, free: np.ndarray, directions: np.ndarray, radiance: np.ndarray,
    bounce: np.ndarray, table: np.ndarray, side: float, albedo: np.ndarray, found: np.ndarray, total: np.ndarray,
) -> None:  # fmt: skip
    """Add up irradiance RGB and the share of the room seen at points, in `found` (n, 4) float32 zeros.

    Args:
        normals, points: (n, 3).
        free: (d, n) uint8: 1 where a point faces a direction and nothing stands in the way, 2 where something does.
        directions, radiance: (d, 3), each standing for an equal part of the sphere.
        bounce: (3,) radiance of what stands in the way.
        table: (t, t, 4) irradiance of the ground, which shines from below; not asked where `side` is 0.
        side: of that square.
        albedo: (3,) of the ground.
        total: (n,) float32 zeros, to work with.
    """
    # a Monte Carlo sum of radiance times cosine over the sphere: each direction stands for an equal part of it
    solid_angle = 4 * np.pi / len(directions)
    for d in range(len(directions)):
        x, y, z = directions[d]
        for n in range(len(points)):
            if free[d, n] == 0:
                continue
            weight = (normals[n, 0] * x + normals[n, 1] * y + normals[n, 2] * z) * solid_angle
            total[n] += weight
            # blocked: what blocks it is lit too, and sends back a mean of that (one bounce, not traced)
            if free[d, n] == 2:
                for c in range(3):
                    found[n, c] += bounce[c] * weight
                continue
            found[n, 3] += weight
            if z < -1e-3 and side > 0:
                # where the direction meets the ground, which sends back albedo / pi of its irradiance
                reach = points[n, 2] / -z
                light = read_square(table, side, points[n, 0] + reach * x, points[n, 1] + reach * y)
                found[n, 0] += light[0] * albedo[0] / np.pi * weight
                found[n, 1] += light[1] * albedo[1] / np.pi * weight
                found[n, 2] += light[2] * albedo[2] / np.pi * weight
            else:
                for c in range(3):
                    found[n, c] += radiance[d, c] * weight
    for n in range(len(points)):
        # cosine-weighted, as ambient occlusion is: what the surface sees of what it could see
        found[n, 3] /= max(total[n], np.float32(1e-6))


@kernel
def gather_key(
    normals: np.ndarray, free: np.ndarray, directions: np.ndarray, irradiance: np.ndarray, found: np.ndarray
) -> None:
    """Add up irradiance RGB and the share of a key light seen, in `found` (n, 4) float32 zeros.

    Args:
        normals: (n, 3) of the points.
        free: as for `gather_light`.
        directions: (d, 3) to parts of the light.
        irradiance: (3,) of one part on what faces it.
    """
    for d in range(len(directions)):
        x, y, z = directions[d]
        for n in range(len(normals)):
            if free[d, n] == 1:
                cosine = normals[n, 0] * x + normals[n, 1] * y + normals[n, 2] * z
                for c in range(3):
                    found[n, c] += cosine * irradiance[c]
                # the parts of the disc that are seen: a soft shadow's edge
                found[n, 3] += 1 / len(directions)
