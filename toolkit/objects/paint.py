"""The paint of a user's mesh as one texture: its picture, its colours per face or vertex, or one plain colour."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.imaging.colour import LINEAR_OF_CODE, linear_to_srgb
from toolkit.imaging.read import decode_texture
from toolkit.objects.bake import unfold
from toolkit.objects.mesh import Material, cross_products

if TYPE_CHECKING:
    from trimesh.visual import ColorVisuals, TextureVisuals
    from trimesh.visual.material import PBRMaterial, SimpleMaterial

    Visuals = ColorVisuals | TextureVisuals

PLAIN_COLOUR = (168, 170, 173)
"""sRGB of a mesh that comes without texture or colours."""
COLOURS = "colours"
"""Name of the material whose texture was made from colours: its texture coordinates are no sheet to train."""
BLENDED = 40_000
"""Up to so many faces, colours of vertices are blended over each; smaller faces have one colour each, their mean."""
MOST_COLOURS = 2_000_000
"""With more, the last bit of each channel is left out."""
LIKE = 4
"""Texels a side for each colour of a palette, so that look-ups between texels stay inside."""


Paint = tuple[np.ndarray, Material]
"""Texture coordinates (n, 2) of vertices or (m, 3, 2) of the corners of faces, and the material."""


@dataclass(frozen=True)
class Piece:
    """A part of a file: vertices (n, 3) float64 in the scene's axes, faces (m, 3), its paint or trimesh's visuals."""

    vertices: np.ndarray
    faces: np.ndarray
    visual: "Visuals | Paint | None"


def to_codes(colours: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 of colours as programs write them: 0 to 255, fractions up to 1, or 16 bits."""
    values = colours.astype(np.float64)
    most = np.nan_to_num(values).max(initial=0)
    if colours.dtype.kind == "f" and most <= 1:
        values = values * 255
    elif colours.dtype.kind != "f" and most > 255:
        values = values / 257
    return np.round(np.nan_to_num(values).clip(0, 255)).astype(np.uint8)


def plain_paint(uv: np.ndarray | None, count: int) -> Paint:
    """Plain grey for `count` vertices, on their own texture coordinates (n, 2) if they have some."""
    if uv is None:
        return np.zeros((count, 2), np.float32), plain_material()
    return uv, Material("material", solid_texture(PLAIN_COLOUR))


def paint_faces(
    visual: "Visuals | Paint | None", vertices: np.ndarray, faces: np.ndarray, source: str
) -> tuple[np.ndarray, Material]:
    """(m, 3, 2) texture coordinates of the corners of faces (m, 3) of vertices (n, 3), and the material.

    A picture counts where the mesh has texture coordinates; else colours of vertices, blended over each face, or of
    faces, times the material's base colour; else that alone; else plain grey.

    Raises:
        ToolkitError: a picture that does not decode, or is far too large; names `source`.
    """
    from trimesh.visual import TextureVisuals

    if isinstance(visual, tuple):
        own, material = visual
        return (own if own.ndim == 3 else own[faces]), material
    pbr, uv = (_to_pbr(visual.material), visual.uv) if isinstance(visual, TextureVisuals) else (None, None)
    if pbr is not None and uv is not None and len(uv) == len(vertices) and np.isfinite(uv).all():
        image = pbr.baseColorTexture
        picture = None if image is None else decode_texture(image, source)
        return np.asarray(uv, np.float32)[faces], _material(pbr, picture)
    plain = plain_material() if pbr is None else _material(pbr, None)
    colours = _corner_colours(visual, vertices, faces)
    if colours is None:
        return np.zeros((len(faces), 3, 2), np.float32), plain
    if pbr is not None and (tint := _tint(pbr)) is not None:
        colours = (colours * tint).astype(np.uint8)
    return paint_colours(colours, vertices, faces, (0.6 if pbr is None else plain.roughness, plain.metallic))


def paint_colours(
    colours: np.ndarray, vertices: np.ndarray, faces: np.ndarray, gloss: tuple[float, float]
) -> tuple[np.ndarray, Material]:
    """(m, 3, 2) texture coordinates and the material of colours (m, 3, 3) uint8 of the corners, sRGB-encoded.

    `gloss` is roughness and metalness.
    """
    if len(faces) > BLENDED:
        colours = _mean_colours(colours)
    even = bool((colours == colours[:, :1]).all())
    corner_uv, texture = _spread_palette(colours[:, 0]) if even else _blend_corners(colours, vertices, faces)
    return corner_uv, Material(COLOURS, texture, *gloss)


def plain_material() -> Material:
    """What a mesh without colours is made of."""
    return Material("plain", solid_texture(PLAIN_COLOUR), roughness=0.45)


def tint_texture(texture: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """A picture (h, w, 3) uint8, sRGB-encoded, times (3,) linear factors; itself where they are 1."""
    import cv2

    if (factor == 1).all():
        return texture
    codes = np.round(linear_to_srgb(LINEAR_OF_CODE[:, None] * factor) * 255).astype(np.uint8)
    return np.asarray(cv2.LUT(texture, codes[None]))


def _corner_colours(visual: "Visuals | None", vertices: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """(m, 3, 3) uint8 colours of the corners, None where there are none."""
    from trimesh.visual import ColorVisuals
    from trimesh.visual.color import to_rgba

    if isinstance(visual, ColorVisuals):
        if visual.kind == "face":
            return np.repeat(np.asarray(visual.face_colors)[:, None, :3], 3, axis=1)
        found = visual.vertex_colors if visual.kind == "vertex" else None
    else:
        found = getattr(visual, "vertex_attributes", {}).get("color")
    if found is None or len(found) != len(vertices):
        return None
    return to_rgba(np.asarray(found))[:, :3][faces]


def _mean_colours(colours: np.ndarray) -> np.ndarray:
    """(m, 1, 3) uint8 mean light of the corners (m, 3, 3)."""
    # of light: a mean of codes would be too dark
    mean = sum(LINEAR_OF_CODE[colours[:, corner]] for corner in range(3)) / 3
    return np.round(linear_to_srgb(mean) * 255).astype(np.uint8)[:, None]


def solid_texture(colour: tuple[int, int, int]) -> np.ndarray:
    """A picture of one sRGB colour."""
    return np.full((4, 4, 3), colour, np.uint8)


def _spread_palette(colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours (m, 3) of the faces become one block of texels for each that differs."""
    # one number per colour: unique rows would be compared as bytes, many times slower
    code = colours.astype(np.int64) @ [1 << 16, 1 << 8, 1]
    _, first, index = np.unique(code, return_index=True, return_inverse=True)
    if len(first) > MOST_COLOURS:
        return _spread_palette(colours & 0xFE)
    side = int(np.ceil(np.sqrt(len(first))))
    texture = np.zeros((side * side, 3), np.uint8)
    texture[: len(first)] = colours[first]
    row, column = np.divmod(index.reshape(-1), side)
    texture = texture.reshape(side, side, 3).repeat(LIKE, axis=0).repeat(LIKE, axis=1)
    uv = np.stack([(column + 0.5) / side, 1 - (row + 0.5) / side], axis=1)
    return np.repeat(uv[:, None], 3, axis=1).astype(np.float32), texture


def _blend_corners(colours: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours (m, 3, 3) of the corners become 2 × 2 texels for each face, between which look-ups blend them.

    The corners lie in the middles of three texels; the fourth is such that the blend is even. Faces that are near each
    other and face one way lie near each other on the texture, so that it can be shrunk.
    """
    count = len(faces)
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
    corners = place[:, None] + np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
    return (corners / [width, -height] + [0, 1]).astype(np.float32), texture


def _near_order(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(m,) the faces in an order in which neighbours that face one way come together: a Z-order curve in space."""
    corners = vertices[faces].astype(np.float64)
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


def _material(pbr: "PBRMaterial", picture: np.ndarray | None) -> Material:
    """A picture, or else one colour, tinted by the base colour, with roughness and metalness."""
    import cv2

    tint = _tint(pbr)
    if picture is None:
        picture = solid_texture(PLAIN_COLOUR if tint is None else (255, 255, 255))
    if tint is not None:
        picture = np.asarray(cv2.LUT(picture, (np.arange(256)[:, None] * tint).clip(0, 255).astype(np.uint8)[None]))
    return Material(
        pbr.name or "material",
        picture,
        roughness=0.6 if pbr.roughnessFactor is None else float(pbr.roughnessFactor),
        metallic=0.0 if pbr.metallicFactor is None else float(pbr.metallicFactor),
    )


def _tint(pbr: "PBRMaterial") -> np.ndarray | None:
    """(3,) base colour, 1 is white; None where the file gives none."""
    factor = pbr.baseColorFactor
    return None if factor is None else np.asarray(factor, float)[:3] / (255 if np.max(factor) > 1 else 1)


def _to_pbr(material: "PBRMaterial | SimpleMaterial") -> "PBRMaterial":
    from trimesh.visual.material import SimpleMaterial

    pbr = material.to_pbr() if hasattr(material, "to_pbr") else material
    own = pbr.baseColorTexture is None and tuple(np.asarray(material.main_color)[:3]) != (102, 102, 102)
    if isinstance(material, SimpleMaterial) and not own:
        pbr.baseColorFactor = None  # trimesh's own default grey, not the file's
    return pbr
