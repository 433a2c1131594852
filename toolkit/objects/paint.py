"""The paint of a user's mesh as a texture: its picture, its colours per face or vertex, or a plain colour."""

from dataclasses import dataclass

import numpy as np

from toolkit.core.lazy import cv2
from toolkit.imaging.colour import LINEAR_OF_CODE, linear_to_srgb
from toolkit.objects.bake import unfold
from toolkit.objects.mesh import Material, cross_products

PLAIN_COLOUR = (168, 170, 173)
"""sRGB of a mesh that comes without texture or colours."""
COLOURS = "colours"
"""Name of the material whose texture was made from colours: its texture coordinates cannot be trained on."""
BLENDED = 40_000
"""Most faces over which colours of vertices are blended; in larger meshes each face has their mean."""
MOST_COLOURS = 2_000_000
"""With more, the last bit of each channel is left out."""
LIKE = 4
"""Texels a side for each colour of a palette, so that look-ups between texels stay inside."""
Paint = tuple[np.ndarray, Material]
"""Texture coordinates (n, 2) of vertices or (m, 3, 2) of the corners of faces, and the material."""


@dataclass(frozen=True)
class MeshPart:
    """A part of a file: vertices (n, 3) float64 in the scene's axes, faces (m, 3), and its paint.

    Instead of paint it may have colours, uint8 sRGB: (n, 3) of the vertices, or (m, 1, 3) of the faces.
    """

    vertices: np.ndarray
    faces: np.ndarray
    paint: Paint | np.ndarray


def to_codes(colours: np.ndarray) -> np.ndarray:
    """Convert colours in 0 to 255, in fractions up to 1, or of 16 bits to (n, 3) uint8."""
    values = colours.astype(np.float64)
    most = np.nan_to_num(values).max(initial=0)
    # fractions may overshoot: a file of 0 to 255 without any above 2 would be all black
    if colours.dtype.kind == "f" and most <= 2:
        values = values * 255
    elif colours.dtype.kind != "f" and most > 255:
        values = values / 257
    return np.round(np.nan_to_num(values).clip(0, 255)).astype(np.uint8)


def plain_paint(uv: np.ndarray | None, count: int) -> Paint:
    """Return plain grey for `count` vertices, on their own texture coordinates (n, 2) if they have some."""
    if uv is None:
        return np.zeros((count, 2), np.float32), plain_material()
    return uv, Material("material", solid_texture(PLAIN_COLOUR))


def paint_faces(part: MeshPart, vertices: np.ndarray) -> Paint:
    """Return (m, 3, 2) texture coordinates of the corners of a part's faces, and its material."""
    if isinstance(part.paint, tuple):
        uv, material = part.paint
        return (uv if uv.ndim == 3 else uv[part.faces]), material
    colours = np.repeat(part.paint, 3, axis=1) if part.paint.ndim == 3 else part.paint[part.faces]
    return paint_colours(colours, vertices, part.faces, (0.6, 0.0))


def paint_colours(
    colours: np.ndarray, vertices: np.ndarray, faces: np.ndarray, gloss: tuple[float, float]
) -> tuple[np.ndarray, Material]:
    """Make texture coordinates of the corners and the material of their colours, (m, 3, 3) uint8 sRGB.

    `gloss` is roughness and metalness.
    """
    if len(faces) > BLENDED:
        # the mean of light: a mean of codes would be too dark
        mean = sum(LINEAR_OF_CODE[colours[:, corner]] for corner in range(3)) / 3
        colours = np.round(linear_to_srgb(mean) * 255).astype(np.uint8)[:, None]
    even = bool((colours == colours[:, :1]).all())
    corner_uv, texture = _spread_palette(colours[:, 0]) if even else _blend_corners(colours, vertices, faces)
    return corner_uv, Material(COLOURS, texture, *gloss)


def plain_material() -> Material:
    """Return the material of a mesh without colours."""
    return Material("plain", solid_texture(PLAIN_COLOUR), roughness=0.45)


def tint_texture(texture: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Multiply colours (..., 3) uint8, sRGB-encoded, by (3,) linear factors."""
    if (factor == 1).all():
        return texture
    codes = np.round(linear_to_srgb(LINEAR_OF_CODE[:, None] * factor) * 255).astype(np.uint8)
    return np.asarray(cv2.LUT(texture.reshape(-1, 1, 3), codes[None])).reshape(texture.shape)


def solid_texture(colour: tuple[int, int, int]) -> np.ndarray:
    """Return a picture of a single sRGB colour."""
    return np.full((4, 4, 3), colour, np.uint8)


def _spread_palette(colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make a block of texels for each different colour of the faces (m, 3)."""
    # a number for each colour: unique rows would be compared as bytes, many times slower
    code = colours.astype(np.int64) @ [1 << 16, 1 << 8, 1]
    _, first, index = np.unique(code, return_index=True, return_inverse=True)
    if len(first) > MOST_COLOURS:
        return _spread_palette(colours & 0xFE)
    # a square of blocks, each of LIKE × LIKE texels, so that look-ups do not blend neighbours
    side = int(np.ceil(np.sqrt(len(first))))
    texture = np.zeros((side * side, 3), np.uint8)
    texture[: len(first)] = colours[first]
    row, column = np.divmod(index.reshape(-1), side)
    texture = texture.reshape(side, side, 3).repeat(LIKE, axis=0).repeat(LIKE, axis=1)
    uv = np.stack([(column + 0.5) / side, 1 - (row + 0.5) / side], axis=1)
    return np.repeat(uv[:, None], 3, axis=1).astype(np.float32), texture


def _blend_corners(colours: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make 2 × 2 texels for each face, between which look-ups blend the colours of its corners (m, 3, 3).

    The corners lie in the middles of three texels; the fourth makes the blend even. Neighbours that face the same way
    are near each other on the texture, so that it can be shrunk.
    """
    count = len(faces)
    # a place on a square of cells for each face, so that faces that follow each other lie near each other
    level = max(int(np.ceil(np.log2(count) / 2)), 1)
    column, row = unfold(np.arange(count), level)
    place = np.empty((count, 2), np.int64)
    place[_near_order(vertices, faces)] = 2 * np.stack([column, row], axis=1)
    width, height = 2 << level, 2 * (int(row.max()) + 1)
    texture = np.zeros((height, width, 3), np.uint8)
    x, y = place.T
    texture[y, x], texture[y, x + 1], texture[y + 1, x] = np.moveaxis(colours, 1, 0)
    a, b, c = (LINEAR_OF_CODE[corner] for corner in np.moveaxis(colours, 1, 0))
    # bilinear look-ups blend evenly where a + d = b + c
    texture[y + 1, x + 1] = np.round(linear_to_srgb(np.clip(b + c - a, 0, 1)) * 255)
    # texel centres of the three corners
    corners = place[:, None] + np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
    return (corners / [width, -height] + [0, 1]).astype(np.float32), texture


def _near_order(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(m,) faces along a Z-order curve in space, so that neighbours that face the same way come together."""
    corners = vertices[faces].astype(np.float64)
    # faces that look to the same side come together
    normal = cross_products(corners)
    axis = np.abs(normal).argmax(axis=1)
    side = 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0)
    middle = corners.mean(axis=1)
    low, extent = middle.min(axis=0), max(float(np.ptp(middle, axis=0).max()), 1e-30)
    cell = ((middle - low) / extent * 1023).astype(np.int64)
    # Morton code: the bits of the three axes in turn, ten of each, behind the side that the face looks to
    code = side << 30
    for bit in range(10):
        for dimension in range(3):
            code |= (cell[:, dimension] >> bit & 1) << (3 * bit + dimension)
    return np.argsort(code, kind="stable")
