"""First hits of a camera's rays by drawing triangle after triangle: cheaper if there are not many."""

import math

import numpy as np

from toolkit.rig.kernel.compiled import exact, kernel
from toolkit.rig.kernel.frame import SUBPIXELS, Hits, Samples, sample_place
from toolkit.rig.kernel.scene import CameraView, ray_through
from toolkit.rig.kernel.textures import Colour


@kernel
def project_corners(points: np.ndarray, T_pixel_mesh: np.ndarray, corners: np.ndarray, screen: np.ndarray) -> None:
    """Points (n, 3) as a camera sees them.

    Args:
        T_pixel_mesh: (3, 4) from there to pixels times depth, and depth.
        corners: (n, 3) float64 is filled with these.
        screen: (n, 3) float32 with x and y in pixels, and depth.
    """
    # written out, as a kernel makes no arrays
    t = T_pixel_mesh
    for n in range(len(points)):
        a, b, c = float(points[n, 0]), float(points[n, 1]), float(points[n, 2])
        x = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c + t[0, 3]
        y = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c + t[1, 3]
        z = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c + t[2, 3]
        corners[n, 0], corners[n, 1], corners[n, 2] = x, y, z
        # pixels and depth in single precision: they only choose what is looked at; corners stay exact
        scale = 1 / z
        screen[n, 0], screen[n, 1], screen[n, 2] = x * scale, y * scale, z


@exact
def _edge(corners: np.ndarray, a: int, b: int) -> Colour:
    """Factors of x, y and 1 whose sum is 0 on the line from a to b; from b to a they are exactly the opposite."""
    # the cross product of two homogeneous points is the line through them; in `exact` code, so that triangles that
    # share an edge leave no gap between them
    ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
    bx, by, bz = corners[b, 0], corners[b, 1], corners[b, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@exact
def _range(a: float, b: float, c: float) -> tuple[float, float]:
    low, high = (a, b) if a < b else (b, a)
    return c if c < low else low, c if c > high else high


@exact
def _narrow(low: float, high: float, slope: float, start: float) -> tuple[float, float]:
    """The part of a range of columns where start + slope · column is not below 0."""
    # solved for the column: the half-plane cuts the range at -start / slope, on the side that the slope says
    if slope > 0:
        return max(low, -start / slope), high
    if slope < 0:
        return low, min(high, -start / slope)
    return low, high if start >= 0 else low - 1


@exact
def _is_hidden(furthest: np.ndarray, nearest: float, width: int, box: tuple[int, int, int, int]) -> bool:
    """Whether no sample of the pixels in a box (first and last column, first and last row) can see so far."""
    first, last, upper, lower = box
    for row in range(upper, lower + 1):
        for column in range(first, last + 1):
            if nearest < furthest[np.uint64(row * width + column)]:
                return False
    return True


@exact
def _see(n: int, face: int, volume: float, weights: Colour, hits: Hits) -> None:
    """Let sample n see a triangle, where it lies inside and nothing nearer is seen."""
    u, v, w = weights
    if min(u, v, w) >= 0:
        # the edge functions are barycentric weights over depth: their sum is 1 / depth, but for a factor
        scale, at = 1 / (u + v + w), np.uint64(n)
        # inside: the weights over their sum are the ray's barycentric coordinates
        depth = volume * scale
        if depth < hits.distance[at]:
            hits.distance[at], hits.face[at] = depth, face
            hits.uv[at, 0], hits.uv[at, 1] = u * scale, v * scale


@exact
def _see_finely(n: int, face: int, volume: float, edges: tuple[Colour, Colour, Colour], hits: Hits) -> bool:
    """The same with samples n to n + 3 of a pixel, of which the latter two lie opposite the former two.

    Args:
        edges: edge functions at the pixel's centre, and their slopes.
    """
    (u, ux, uy), (v, vx, vy), (w, wx, wy) = edges
    dx, dy, ex, ey = SUBPIXELS[0, 0], SUBPIXELS[0, 1], SUBPIXELS[1, 0], SUBPIXELS[1, 1]
    # edge functions are linear: a step of (dx, dy) pixels adds the same everywhere, and its opposite takes as much away
    du, dv, dw = ux * dx + uy * dy, vx * dx + vy * dy, wx * dx + wy * dy
    eu, ev, ew = ux * ex + uy * ey, vx * ex + vy * ey, wx * ex + wy * ey
    # the best of the four samples is outside of an edge: so are all
    nearest = max(
        max(min(u + du, v + dv, w + dw), min(u + eu, v + ev, w + ew)),
        max(min(u - du, v - dv, w - dw), min(u - eu, v - ev, w - ew)),
    )
    if nearest < 0:
        return False
    _see(n, face, volume, (u + du, v + dv, w + dw), hits)
    _see(n + 1, face, volume, (u + eu, v + ev, w + ew), hits)
    _see(n + 2, face, volume, (u - du, v - dv, w - dw), hits)
    _see(n + 3, face, volume, (u - eu, v - ev, w - ew), hits)
    return True


@exact
def _find_box(
    screen: np.ndarray, corners: tuple[np.uint32, np.uint32, np.uint32], samples: Samples, before: np.float32
) -> tuple[int, int, int, int]:
    """First and last column, first and last row of pixels whose samples a triangle before the camera may cover.

    Args:
        screen: of `project_corners`.
        samples: of a part; the box is empty where it lies outside.
        before: from a pixel's left to its first sample, pixels.
    """
    a, b, c = corners
    left, top = np.float32(samples.left), np.float32(samples.top)
    # columns first, then rows, within the part
    low, high = _range(screen[a, 0], screen[b, 0], screen[c, 0])
    first, last = int(max(low + before, left)), int(min(high - before, np.float32(samples.right - 1)))
    if first < samples.left or first > last or high < left + before:
        return 0, -1, 0, -1
    low, high = _range(screen[a, 1], screen[b, 1], screen[c, 1])
    upper, lower = int(max(low + before, top)), int(min(high - before, np.float32(samples.bottom - 1)))
    if upper < samples.top or high < top + before:
        return 0, -1, 0, -1
    return first, last, upper, lower


@exact
def _is_turned(screen: np.ndarray, a: np.uint32, b: np.uint32, c: np.uint32) -> bool:
    """Whether a triangle before the camera shows its back."""
    # the sign of twice the area on the screen, where y runs down
    ax, ay = screen[b, 0] - screen[a, 0], screen[b, 1] - screen[a, 1]
    return ax * (screen[c, 1] - screen[a, 1]) > ay * (screen[c, 0] - screen[a, 0])


@exact
def _opposite(edge: Colour) -> Colour:
    return -edge[0], -edge[1], -edge[2]


@exact
def _spare(edge: Colour, reach: float) -> float:
    # the most that an edge function changes within `reach` of a pixel's centre, along x and y
    return (abs(edge[0]) + abs(edge[1])) * reach


@exact
def _draw(
    edges: tuple[Colour, Colour, Colour], volume: float, triangle: tuple[int, float], box: tuple[int, int, int, int],
    samples: Samples, reach: float, slot: np.ndarray, furthest: np.ndarray, hits: Hits,
) -> None:  # fmt: skip
    """Let the samples of the pixels in a box see a triangle.

    Args:
        edges, volume: its edge functions and what they add up to times the depth.
        triangle: its number, and nothing of it is nearer than this.
        box: of `_find_box`.
        reach: samples lie so far from a pixel's centre at most.
    """
    (of_a, of_b, of_c), (face, nearest), (first, last, upper, lower) = edges, triangle, box
    a_spare, b_spare, c_spare = _spare(of_a, reach), _spare(of_b, reach), _spare(of_c, reach)
    width, shots = samples.right - samples.left, len(samples.offsets)
    for row in range(upper, lower + 1):
        y, start, end = row + 0.5, float(first), float(last)
        if last > first + 1:
            # cut the row to where all three edge functions can be positive, before any pixel is looked at
            start, end = _narrow(start, end, of_a[0], of_a[0] * 0.5 + of_a[1] * y + of_a[2] + a_spare)
            start, end = _narrow(start, end, of_b[0], of_b[0] * 0.5 + of_b[1] * y + of_b[2] + b_spare)
            start, end = _narrow(start, end, of_c[0], of_c[0] * 0.5 + of_c[1] * y + of_c[2] + c_spare)
        # rounded up by hand: `ceil` is a call
        for column in range(int(start + 0.99999), int(end) + 1):
            x, pixel = column + 0.5, np.uint64((row - samples.top) * width + column - samples.left)
            # all samples of the pixel see something nearer already
            if not nearest < furthest[pixel]:
                continue
            u, v = of_b[0] * x + of_b[1] * y + of_b[2], of_c[0] * x + of_c[1] * y + of_c[2]
            w, n = of_a[0] * x + of_a[1] * y + of_a[2], int(slot[pixel])
            if shots == 1:
                _see(n, face, volume, (u, v, w), hits)
                furthest[pixel] = hits.distance[n]
                continue
            # weight u belongs to corner b, whose opposite edge is `of_b`
            slopes = ((u, of_b[0], of_b[1]), (v, of_c[0], of_c[1]), (w, of_a[0], of_a[1]))
            if _see_finely(n, face, volume, slopes, hits):
                d = hits.distance
                furthest[pixel] = max(d[n], d[n + 1], d[n + 2], d[n + 3])


@exact
def _measure_along_rays(view: CameraView, samples: Samples, hits: Hits) -> None:
    """Turn depth along the camera's axis, which drawing finds, into distance along each sample's ray."""
    for n in range(len(hits.face)):
        x, y = sample_place(samples, n)
        dx, dy, dz = ray_through(view, x, y)
        hits.distance[n] *= math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def draw_triangles(
    faces: np.ndarray, corners: np.ndarray, screen: np.ndarray, view: CameraView, samples: Samples, slot: np.ndarray,
    furthest: np.ndarray, later: np.ndarray, hits: Hits,
) -> None:  # fmt: skip
    """First hits of samples.

    A sample belongs to a triangle if the three edge functions have the same sign. They are homogeneous: triangles that
    reach behind the camera need no cutting (Olano and Greer, 1997). Those that turn their back are drawn last, when
    most of them are hidden.

    Args:
        faces: (m, 3) of the mesh.
        corners, screen: of `project_corners`.
        slot: (pixels of the part,) int32 to work with: the first sample of each.
        furthest: (pixels of the part,) float32 to work with: the furthest that a sample sees; none are not reached.
        later: (m,) int32 to work with.
        hits: of nothing; they are filled.
    """
    left, top, shots = samples.left, samples.top, len(samples.offsets)
    # the furthest hit of each pixel's samples: a pixel without samples can never be seen further
    furthest[:] = -np.inf
    for i in range(len(samples.pixels)):
        slot[samples.pixels[i]] = shots * i
        furthest[samples.pixels[i]] = np.inf
    reach = 0.001 if shots == 1 else 0.376  # of a pixel; a little for rounding: what is in reach is looked at exactly
    before, waiting = np.float32(0.5 - reach), 0
    # fronts first: backs of a closed mesh are then hidden by them, and most are never drawn
    for turn in range(2):
        for i in range(waiting if turn else len(faces)):
            face = int(later[i]) if turn else i
            a, b, c = np.uint32(faces[face, 0]), np.uint32(faces[face, 1]), np.uint32(faces[face, 2])
            nearest, deepest = _range(screen[a, 2], screen[b, 2], screen[c, 2])
            # a triangle that reaches behind the camera has no bounds in the picture: the whole part is looked at
            box = (left, samples.right - 1, top, samples.bottom - 1)
            if nearest > 0:
                box = _find_box(screen, (a, b, c), samples, before)
            elif deepest <= 0:
                continue
            if box[0] > box[1] or box[2] > box[3]:
                continue
            # rounding must not hide a triangle behind itself
            nearest *= np.float32(0.999999)
            if _is_hidden(
                furthest, nearest, samples.right - left, (box[0] - left, box[1] - left, box[2] - top, box[3] - top)
            ):
                continue
            if turn == 0 and nearest > 0 and _is_turned(screen, a, b, c):
                later[waiting] = face
                waiting += 1
                continue
            of_a, of_b, of_c = _edge(corners, b, c), _edge(corners, c, a), _edge(corners, a, b)
            # the triple product of the corners: six times the volume of the tetrahedron with the camera, signed
            volume = of_a[0] * corners[a, 0] + of_a[1] * corners[a, 1] + of_a[2] * corners[a, 2]
            # the same sign for both sides, so that inside is always positive
            if volume < 0:
                volume, of_a, of_b, of_c = -volume, _opposite(of_a), _opposite(of_b), _opposite(of_c)
            if volume > 0:
                _draw((of_a, of_b, of_c), volume, (face, nearest), box, samples, reach, slot, furthest, hits)
    _measure_along_rays(view, samples, hits)
