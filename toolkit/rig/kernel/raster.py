"""First hits of a camera's rays by drawing one triangle after another: cheaper where there are not many of them."""

import math

import numpy as np

from toolkit.rig.kernel.compiled import inlined, kernel
from toolkit.rig.kernel.frame import Hits, Samples, sample_place
from toolkit.rig.kernel.scene import View, ray_through
from toolkit.rig.kernel.textures import Colour


@kernel
def project_corners(points: np.ndarray, T_pixel_mesh: np.ndarray, corners: np.ndarray, screen: np.ndarray) -> None:
    """Points (n, 3) as a camera sees them.

    Args:
        points: in the mesh's frame.
        T_pixel_mesh: (3, 4) from there to pixels times depth, and depth.
        corners: (n, 3) float64 is filled with these.
        screen: (n, 3) float32 with x and y in pixels, and depth.
    """
    t = T_pixel_mesh
    for n in range(len(points)):
        a, b, c = float(points[n, 0]), float(points[n, 1]), float(points[n, 2])
        x = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c + t[0, 3]
        y = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c + t[1, 3]
        z = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c + t[2, 3]
        corners[n, 0], corners[n, 1], corners[n, 2] = x, y, z
        scale = 1 / z
        screen[n, 0], screen[n, 1], screen[n, 2] = x * scale, y * scale, z


@inlined
def _edge(corners: np.ndarray, a: int, b: int) -> Colour:
    """What is 0 on the line from a to b, times x, y and 1 of a pixel; from b to a it is exactly its opposite."""
    ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
    bx, by, bz = corners[b, 0], corners[b, 1], corners[b, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def _range(a: float, b: float, c: float) -> tuple[float, float]:
    low, high = (a, b) if a < b else (b, a)
    return c if c < low else low, c if c > high else high


@inlined
def _narrow(low: float, high: float, slope: float, start: float) -> tuple[float, float]:
    """What is left of a range of columns where start + slope · column is not below 0."""
    if slope > 0:
        return max(low, -start / slope), high
    if slope < 0:
        return low, min(high, -start / slope)
    return low, high if start >= 0 else low - 1


@inlined
def _has_samples(slot: np.ndarray, width: int, first: int, last: int, upper: int, lower: int) -> bool:
    for row in range(upper, lower + 1):
        for column in range(first, last + 1):
            if slot[row * width + column] >= 0:
                return True
    return False


@kernel
def draw_triangles(
    faces: np.ndarray, corners: np.ndarray, screen: np.ndarray, view: View, samples: Samples, slot: np.ndarray,
    hits: Hits,
) -> None:  # fmt: skip
    """First hits of samples.

    A sample belongs to a triangle where the three edge functions have one sign; they are homogeneous, so that triangles
    which reach behind the camera need no cutting (Olano and Greer 1997).

    Args:
        faces: (m, 3) of the mesh.
        corners, screen: of `project_corners`.
        view: camera.
        samples: which.
        slot: (pixels of the part,) int32 to work with.
        hits: of nothing; they are filled.
    """
    left, top, right, bottom = samples.left, samples.top, samples.right, samples.bottom
    width, shots, offsets, reach = right - left, len(samples.offsets), samples.offsets, 0.0
    slot[:] = -1
    for i in range(len(samples.pixels)):
        slot[samples.pixels[i]] = i
    for k in range(shots):
        reach = max(reach, abs(offsets[k, 0]), abs(offsets[k, 1]))
    reach += 1e-3  # of a pixel, for rounding: what is in reach is looked at exactly
    before = np.float32(0.5 - reach)
    for face in range(len(faces)):
        a, b, c = np.uint32(faces[face, 0]), np.uint32(faces[face, 1]), np.uint32(faces[face, 2])
        nearest, furthest = _range(screen[a, 2], screen[b, 2], screen[c, 2])
        first, last, upper, lower = left, right - 1, top, bottom - 1
        if nearest > 0:
            low, high = _range(screen[a, 0], screen[b, 0], screen[c, 0])
            first, last = int(max(low + before, np.float32(left))), int(min(high - before, np.float32(last)))
            if first < left or first > last or high < left + before:
                continue
            low, high = _range(screen[a, 1], screen[b, 1], screen[c, 1])
            upper, lower = int(max(low + before, np.float32(top))), int(min(high - before, np.float32(lower)))
            if upper < top or high < top + before:
                continue
        elif furthest <= 0:
            continue
        if not _has_samples(slot, width, first - left, last - left, upper - top, lower - top):
            continue
        ax, ay, az = _edge(corners, b, c)
        bx, by, bz = _edge(corners, c, a)
        cx, cy, cz = _edge(corners, a, b)
        volume = ax * corners[a, 0] + ay * corners[a, 1] + az * corners[a, 2]
        if volume < 0:
            volume = -volume
            ax, ay, az, bx, by, bz, cx, cy, cz = -ax, -ay, -az, -bx, -by, -bz, -cx, -cy, -cz
        if not volume > 0:
            continue
        a_spare, b_spare, c_spare = abs(ax) + abs(ay), abs(bx) + abs(by), abs(cx) + abs(cy)
        for row in range(upper, lower + 1):
            y, low, high = row + 0.5, float(first), float(last)
            low, high = _narrow(low, high, ax, ax * 0.5 + ay * y + az + a_spare * reach)
            low, high = _narrow(low, high, bx, bx * 0.5 + by * y + bz + b_spare * reach)
            low, high = _narrow(low, high, cx, cx * 0.5 + cy * y + cz + c_spare * reach)
            for column in range(int(low + 0.99999), int(high) + 1):
                place = slot[(row - top) * width + column - left]
                if place < 0:
                    continue
                x = column + 0.5
                u, v, w = bx * x + by * y + bz, cx * x + cy * y + cz, ax * x + ay * y + az
                for k in range(shots):
                    dx, dy = offsets[k, 0], offsets[k, 1]
                    ku, kv, kw = u + (bx * dx + by * dy), v + (cx * dx + cy * dy), w + (ax * dx + ay * dy)
                    scale = 1 / (ku + kv + kw)
                    depth, n = volume * scale, place * shots + k
                    if (min(ku, kv, kw) >= 0) & (depth < hits.distance[n]):
                        hits.distance[n], hits.face[n] = depth, face
                        hits.uv[n, 0], hits.uv[n, 1] = ku * scale, kv * scale
    for n in range(len(hits.face)):  # along the ray
        x, y = sample_place(samples, n)
        dx, dy, dz = ray_through(view, x, y)
        hits.distance[n] *= math.sqrt(dx * dx + dy * dy + dz * dz)
