"""A scene as the kernel reads it, and the colour of what a ray meets in it."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from toolkit.rig.kernel.compiled import inlined, kernel
from toolkit.rig.kernel.lanes import log2, weighted_sum
from toolkit.rig.kernel.light import LightMap, environment_brdf, find_samples, key_lobe, read_light_map
from toolkit.rig.kernel.textures import Colour, Texels, sample_direction, sample_texture

ROUGHNESS_LEVELS = (0.12, 0.3, 0.55, 0.9)
"""Roughnesses for which the surroundings are blurred beforehand."""


Rotation = tuple[Colour, Colour, Colour]
FACE = np.dtype(
    [
        ("a", np.uint32), ("b", np.uint32), ("c", np.uint32), ("material", np.uint32), ("density", np.float32),
        ("steps", np.int32), ("first", np.int64),
    ]
)  # fmt: skip
"""A triangle, all in the same place of memory: its corners, material, texels per unit of length, and where its stored
light begins and how fine it is."""


class LitMesh(NamedTuple):
    """Triangles and the light on them."""

    faces: np.ndarray  # (m,) of `FACE`
    corners: np.ndarray  # (n, 5) float32 of vertices: unit normal in the mesh's own frame, uv
    texture: np.ndarray  # texture, roughness, metallic: (k,) of each material; `texture` indexes `texels`
    roughness: np.ndarray
    metallic: np.ndarray
    finely: np.ndarray  # (k,) bool whether all its pixels need several samples
    left_out: np.ndarray  # (k,) bool whether the texture's colour is left out, for linear views
    texels: Texels
    glow: np.ndarray  # (k,) int32 index into `glow_texels` of what each material gives off; -1 where nothing is lit
    glow_lod: np.ndarray  # (k,) float32 to be added to the level of detail of its texture
    glow_texels: Texels  # what is given off
    stored: np.ndarray  # (s, 5) float32 irradiance RGB, share of the key light seen, share of the room seen
    turn: Rotation  # rows of the rotation from the mesh's frame to the world's
    place: Colour  # of the mesh's origin in the world


class Surround(NamedTuple):
    """The surroundings of the object, and the light."""

    backdrop: np.ndarray  # (h, w, 4) float32 radiance of all directions as a camera sees it, of which three count
    # four such pictures, blurred as surfaces of `ROUGHNESS_LEVELS` mirror it
    mirrored: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    key: Colour  # unit direction to the key light
    key_spread: float  # by how much the light's size widens its highlight's alpha
    key_irradiance: Colour  # RGB
    exposure: float  # factor of the picture
    lamps: float  # radiance of a surface whose emission is 1
    has_table: bool  # whether there is a table at z = 0
    table: Texels  # its texture
    table_size: tuple[float, float]  # along x and y
    table_roughness: float  # of the table
    ground_light: LightMap  # irradiance of the table; out of doors by how much the object dims the sky's on the ground
    ground_z: float  # out of doors, the height of that ground
    ground_reach: float  # and how far above or below it that still holds; 0 on a table


class CameraView(NamedTuple):
    """A camera in its place."""

    rotation: Rotation  # rows of the rotation from camera to world
    origin: Colour  # of the camera in the world
    fx: float  # fx, fy, cx, cy: pixels
    fy: float
    cx: float
    cy: float
    width: int  # width, height: pixels
    height: int


def as_triple(numbers: Iterable[float]) -> Colour:
    """Three numbers as kernels take them: by value, so that nothing that they write can change them."""
    x, y, z = map(float, numbers)
    return x, y, z


def as_rotation(matrix: np.ndarray) -> Rotation:
    """The rows of a matrix (3, 3), likewise."""
    a, b, c = map(as_triple, matrix)
    return a, b, c


@inlined
def ray_through(view: CameraView, x: float, y: float) -> Colour:
    """The direction through a pixel, in the world; its part along the camera's axis is 1."""
    # the pinhole model backwards: d = R K^-1 (x, y, 1); left without unit length, so that depth stays a simple factor
    a, b, r = (x - view.cx) * (1 / view.fx), (y - view.cy) * (1 / view.fy), view.rotation
    return (
        r[0][0] * a + (r[0][1] * b + r[0][2]),
        r[1][0] * a + (r[1][1] * b + r[1][2]),
        r[2][0] * a + (r[2][1] * b + r[2][2]),
    )


@inlined
def _rough_level(roughness: float) -> int:
    # the borders lie halfway between neighbours of ROUGHNESS_LEVELS
    return 0 if roughness <= 0.21 else 1 if roughness <= 0.42 else 2 if roughness <= 0.72 else 3


@inlined
def _table_radiance(around: Surround, x: float, y: float, lod: float) -> Colour:
    """Radiance of the lit table at (x, y)."""
    # the texture spans the table once, its middle at the world's origin
    u, v = x * (1 / around.table_size[0]) + 0.5, y * (1 / around.table_size[1]) + 0.5
    colour = sample_texture(around.table, 0, u, v, lod, False)
    light = read_light_map(around.ground_light, x, y)
    # a matt surface sends out its irradiance times albedo / pi
    scale = 1 / math.pi
    return colour[0] * light[0] * scale, colour[1] * light[1] * scale, colour[2] * light[2] * scale


TILE = 8
"""Pixels between the places at which what changes slowly over the table is worked out."""


@kernel
def fill_sheen(around: Surround, view: CameraView, sheen: np.ndarray) -> None:
    """Fill (h, w, 4) float32 every `TILE` pixels from the first.

    Light of the room that the table mirrors, and the base-2 logarithm of its texels per pixel.
    """
    roughness = around.table_roughness
    mirrored = around.mirrored[_rough_level(roughness)]
    # texels of level 0 under one pixel at distance 1: they grow with the distance from there
    finest = int(around.table.width[0]) / around.table_size[0] / view.fx
    for i in range(sheen.shape[0]):
        for j in range(sheen.shape[1]):
            # pixel centres lie at half integers
            dx, dy, dz = ray_through(view, j * TILE + 0.5, i * TILE + 0.5)
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            grazing = 1 - abs(dz) / length
            square = grazing * grazing
            # Schlick's Fresnel term for a dielectric, 0.04 at normal incidence, damped: rough wood is no mirror
            strength = (0.04 + (1 - roughness) * 0.5 * square * square * grazing) * (1 - 0.6 * roughness)
            # a level mirror turns the ray's fall into a rise
            red, green, blue = sample_direction(mirrored, dx, dy, abs(dz))
            sheen[i, j, 0], sheen[i, j, 1], sheen[i, j, 2] = red * strength, green * strength, blue * strength
            falling = max(-dz, 1e-4)
            # a pixel's length on the table, mean of along and across the line of sight; 0.05 bounds it at the horizon
            footprint = view.origin[2] / falling / math.sqrt(max(falling / length, 0.05))
            sheen[i, j, 3] = math.log2(max(footprint * finest, 1e-3))


@inlined
def background(
    around: Surround, view: CameraView, edges: np.ndarray, shine: tuple[float, float, float, float],
    pixel: tuple[int, int], inside: bool,
) -> Colour:  # fmt: skip
    """Radiance of table and room in a pixel (row, column).

    Args:
        edges: of `find_table_edges`; the table covers a part of the pixels on them.
        shine: of `fill_sheen`, there.
        pixel: (row, column).
        inside: whether the table is known to cover all of it.
    """
    x, y = pixel[1] + 0.5, pixel[0] + 0.5
    dx, dy, dz = ray_through(view, x, y)
    cover = 1.0
    if not inside:
        for k in range(4):
            # share of the pixel on the inner side of the nearest edge: a box filter of a pixel
            cover = min(cover, edges[k, 0] * x + edges[k, 1] * y + edges[k, 2] + 0.5)
        cover = max(cover, 0.0)
    red, green, blue = 0.0, 0.0, 0.0
    if cover > 0:
        # where the ray meets z = 0; a pixel on the horizon's edge would else divide by nothing
        reach = view.origin[2] / max(-dz, 1e-4)
        red, green, blue = _table_radiance(around, view.origin[0] + reach * dx, view.origin[1] + reach * dy, shine[3])
        # the table's gloss, worked out at the corners of tiles
        red, green, blue = red + shine[0], green + shine[1], blue + shine[2]
    # beyond the table's edge there is the room
    if cover < 1:
        room = sample_direction(around.backdrop, dx, dy, dz)
        red, green, blue = (
            red * cover + room[0] * (1 - cover),
            green * cover + room[1] * (1 - cover),
            blue * cover + room[2] * (1 - cover),
        )
    return red, green, blue


@kernel
def find_table_edges(around: Surround, view: CameraView, edges: np.ndarray) -> None:
    """Fill (4, 3): a pixel (x, y) lies a · x + b · y + c pixels on the inner side of each of the table's edges.

    Each edge is a straight line in the picture. A ray d from p meets the table inside of x = half if (half -
    p_x)·(-d_z) - p_z·d_x > 0; likewise for the others. None is inside where there is no table.
    """
    r = view.rotation
    for k in range(4):
        if not around.has_table:
            # a line that every pixel lies outside of
            edges[k, 0], edges[k, 1], edges[k, 2] = 0.0, 0.0, -1e9
            continue
        # the test of the docstring with d = R K^-1 (x, y, 1) put in: linear in x and y
        axis, sign = k // 2, 1.0 - 2.0 * (k % 2)
        along, down = -sign * view.origin[2], sign * view.origin[axis] - around.table_size[axis] / 2
        a = (along * r[axis][0] + down * r[2][0]) / view.fx
        b = (along * r[axis][1] + down * r[2][1]) / view.fy
        # divided by the gradient's length, the value is a distance in pixels
        slope = max(math.sqrt(a * a + b * b), 1e-9)
        c = along * r[axis][2] + down * r[2][2] - a * view.cx - b * view.cy
        edges[k, 0], edges[k, 1], edges[k, 2] = a / slope, b / slope, c / slope


@inlined
def all_inside(edges: np.ndarray, left: int, top: int, right: int, bottom: int) -> bool:
    """Whether the table covers all of a part of the picture, by `find_table_edges`."""
    for k in range(4):
        # the corner of the part that lies furthest outwards decides
        x = left + 0.5 if edges[k, 0] > 0 else right - 0.5
        y = top + 0.5 if edges[k, 1] > 0 else bottom - 0.5
        if edges[k, 0] * x + edges[k, 1] * y + edges[k, 2] < 0.5:
            return False
    return True


@inlined
def _mirrored(around: Surround, point: Colour, direction: Colour, roughness: float) -> Colour:
    """Radiance that arrives at a point from a unit direction, blurred by a surface's roughness."""
    level = _rough_level(roughness)
    x, y, z = direction
    # a level ray meets the table far beyond its rim, where the division says little
    if around.has_table and z < -0.02:
        reach = -point[2] / z
        u = (point[0] + reach * x) * (1 / around.table_size[0]) + 0.5
        v = (point[1] + reach * y) * (1 / around.table_size[1]) + 0.5
        if abs(u - 0.5) < 0.5 and abs(v - 0.5) < 0.5:
            # blurred as far as the surface is rough: coarser texels of the table
            return _table_radiance(around, point[0] + reach * x, point[1] + reach * y, 2.0 + level)
    return sample_direction(around.mirrored[level], x, y, z)


@inlined
def surface_normal(mesh: LitMesh, face: int, u: float, v: float) -> Colour:
    """Unit shading normal in the world."""
    return _blend_corners(mesh, face, u, v)[0]


@inlined
def _blend_corners(mesh: LitMesh, face: int, u: float, v: float) -> tuple[Colour, float, float]:
    """Unit shading normal in the world, texture u and v."""
    corner, t = mesh.faces[face], mesh.turn
    a, b, c, weights = 5 * int(corner.a), 5 * int(corner.b), 5 * int(corner.c), (1 - u - v, u, v)
    x, y, z, texture_u = weighted_sum(mesh.corners, (a, b, c), weights)
    # four lanes hold normal and u; v is the fifth number, read by starting a place later
    texture_v = weighted_sum(mesh.corners, (a + 1, b + 1, c + 1), weights)[3]
    # blended normals are shorter than 1; a rotation keeps their length, so one division serves
    scale = 1 / max(math.sqrt(x * x + y * y + z * z), 1e-9)
    normal = (
        (t[0][0] * x + t[0][1] * y + t[0][2] * z) * scale,
        (t[1][0] * x + t[1][1] * y + t[1][2] * z) * scale,
        (t[2][0] * x + t[2][1] * y + t[2][2] * z) * scale,
    )
    return normal, texture_u, texture_v


class Seen(NamedTuple):
    """Radiance of a sample; for a texture that is left out, its weight and where it is read."""

    colour: Colour
    gain: Colour
    u: float
    v: float
    lod: float


@inlined
def shade(
    around: Surround, mesh: LitMesh, view: CameraView, pixel: tuple[float, float],
    hit: tuple[int, float, float, float, float],
) -> Seen:  # fmt: skip
    """The light that a point of a mesh sends to the camera.

    Args:
        pixel: (x, y).
        hit: face, barycentric weights of corners 1 and 2, distance, share of the key light that is seen; where that is
            below 0 the mesh's stored light says it, and holds the key light's part.
    """
    face, u, v, distance, key_share = hit
    dx, dy, dz = ray_through(view, pixel[0], pixel[1])
    scale = 1 / math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx * scale, dy * scale, dz * scale
    # 1. the surface there, and the cosine between its normal and the way back to the camera
    (nx, ny, nz), tu, tv = _blend_corners(mesh, face, u, v)
    cosine = -(nx * dx + ny * dy + nz * dz)
    # both sides of a triangle are shaded: a mesh of the user's own may have faces turned inside out
    if cosine < 0:
        nx, ny, nz, cosine = -nx, -ny, -nz, -cosine
    # level of detail: texels per pixel, the mean of a footprint stretched by 1 / cosine; 0.1 bounds the stretch
    texels = distance * (1 / view.fx) * mesh.faces[face].density
    lod = 0.5 * log2(max(texels * texels / max(cosine, 0.1), 1e-12))
    # 2. paint: what a linear view trains counts as black here, and is reported as a gain instead
    material = mesh.faces[face].material
    left_out = mesh.left_out[material]
    albedo = (0.0, 0.0, 0.0)
    if not left_out:
        albedo = sample_texture(mesh.texels, int(mesh.texture[material]), float(tu), float(tv), lod, True)
    point = (view.origin[0] + distance * dx, view.origin[1] + distance * dy, view.origin[2] + distance * dz)
    # 3. light that arrives, and what becomes of it: a diffuse part (Lambert, albedo / pi) and a mirrored part
    red, green, blue, key_share, room_share = _arriving(around, mesh, (face, u, v, key_share), point, (nx, ny, nz))
    roughness, metallic = float(mesh.roughness[material]), float(mesh.metallic[material])
    # glTF's metallic-roughness model: a metal has no diffuse part, and mirrors in its own colour
    diffuse = (1 - metallic) / math.pi
    gain = (red * diffuse, green * diffuse, blue * diffuse)
    # reflectance at normal incidence: 4 % for whatever is no metal (glTF 2.0, appendix B)
    f0 = (
        0.04 * (1 - metallic) + albedo[0] * metallic,
        0.04 * (1 - metallic) + albedo[1] * metallic,
        0.04 * (1 - metallic) + albedo[2] * metallic,
    )
    normal, direction = (nx, ny, nz), (dx, dy, dz)
    shine = _gloss(around, point, normal, direction, cosine, f0, roughness, key_share, room_share)
    colour = (
        albedo[0] * gain[0] + shine[0], albedo[1] * gain[1] + shine[1], albedo[2] * gain[2] + shine[2],
    )  # fmt: skip
    # lamps and lit windows give off light, whatever falls on them
    glow = mesh.glow[material]
    if glow >= 0:
        given = sample_texture(mesh.glow_texels, int(glow), float(tu), float(tv), lod + mesh.glow_lod[material], True)
        colour = (
            colour[0] + given[0] * around.lamps, colour[1] + given[1] * around.lamps,
            colour[2] + given[2] * around.lamps,
        )  # fmt: skip
    if not left_out:
        gain = (0.0, 0.0, 0.0)
    return Seen(colour, gain, tu, tv, lod)


@inlined
def _arriving(
    around: Surround, mesh: LitMesh, hit: tuple[int, float, float, float], point: Colour, normal: Colour
) -> tuple[float, float, float, float, float]:
    """Irradiance RGB at a point, and the shares of the key light and of the room that it sees; `hit` as in `shade`."""
    face, u, v, key_share = hit
    red, green, blue, stored_share, room_share = _stored(mesh, face, u, v)
    # stored light holds the key light's part where the surface does not move; out of doors a ray has asked for it
    if key_share < 0:
        return red, green, blue, stored_share, room_share
    # ground beside the object loses what the object hides of the sky; roofs and cars above it do not
    if abs(point[2] - around.ground_z) < around.ground_reach:
        left = read_light_map(around.ground_light, point[0], point[1])
        red, green, blue = red * left[0], green * left[1], blue * left[2]
    # Lambert's cosine law
    facing = max(normal[0] * around.key[0] + normal[1] * around.key[1] + normal[2] * around.key[2], 0.0) * key_share
    red += around.key_irradiance[0] * facing
    green += around.key_irradiance[1] * facing
    blue += around.key_irradiance[2] * facing
    return red, green, blue, key_share, room_share


@inlined
def _stored(mesh: LitMesh, face: int, u: float, v: float) -> tuple[float, float, float, float, float]:
    """Stored light: irradiance RGB, share of the key light, share of the room."""
    a, b, c, wb, wc = find_samples(int(mesh.faces[face].steps), u, v)
    # five numbers for each sample: as with corners, the fifth is read by starting a place later
    start, wa, s = mesh.faces[face].first, 1 - wb - wc, mesh.stored
    a, b, c, weights = 5 * (start + a), 5 * (start + b), 5 * (start + c), (wa, wb, wc)
    red, green, blue, key_share = weighted_sum(s, (a, b, c), weights)
    return red, green, blue, key_share, weighted_sum(s, (a + 1, b + 1, c + 1), weights)[3]


@inlined
def _gloss(
    around: Surround, point: Colour, normal: Colour, direction: Colour, cosine: float, f0: Colour, roughness: float,
    key_share: float, room_share: float,
) -> Colour:  # fmt: skip
    """Mirrored radiance towards the camera, where shares of the key light and of the room are seen."""
    nx, ny, nz = normal
    dx, dy, dz = direction
    scale, bias = environment_brdf(roughness, cosine)
    # r = d - 2 (d . n) n, and d . n is -cosine
    mirror = (dx + 2 * cosine * nx, dy + 2 * cosine * ny, dz + 2 * cosine * nz)
    arriving = _mirrored(around, point, mirror, roughness)
    # specular occlusion from ambient occlusion: a mirror direction is blocked a little before half of the room is
    visible = min(max(1.4 * room_share - 0.1, 0.0), 1.0)
    red = (f0[0] * scale + bias) * arriving[0] * visible
    green = (f0[1] * scale + bias) * arriving[1] * visible
    blue = (f0[2] * scale + bias) * arriving[2] * visible
    lx, ly, lz = around.key[0], around.key[1], around.key[2]
    facing = nx * lx + ny * ly + nz * lz
    if facing > 0 and key_share > 0:
        # the half vector between the light and the way back to the camera
        hx, hy, hz = lx - dx, ly - dy, lz - dz
        scale = 1 / max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
        normal_half = (nx * hx + ny * hy + nz * hz) * scale
        view_half = max(-(dx * hx + dy * hy + dz * hz) * scale, 0.0)
        # a light of some size blurs its highlight like a rougher surface (Karis 2013); 0.02 keeps the peak finite
        alpha = min(max(roughness * roughness + around.key_spread, 0.02), 1.0)
        lobe, graze = key_lobe(facing, cosine, normal_half, view_half, alpha)
        lobe *= key_share
        red += (f0[0] + (1 - f0[0]) * graze) * lobe * around.key_irradiance[0]
        green += (f0[1] + (1 - f0[1]) * graze) * lobe * around.key_irradiance[1]
        blue += (f0[2] + (1 - f0[2]) * graze) * lobe * around.key_irradiance[2]
    return red, green, blue
