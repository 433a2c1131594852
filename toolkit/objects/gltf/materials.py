"""Materials of a glTF, and a primitive's paint: base colour times colours of vertices, in linear light."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.imaging.colour import linear_to_srgb
from toolkit.objects.bake import bake_faces
from toolkit.objects.gltf.document import Document, extension, name_of_uri, read_document
from toolkit.objects.gltf.geometry import Primitive
from toolkit.objects.gltf.holes import cut_corners, cut_holes
from toolkit.objects.gltf.pictures import Picture, Pictures, lay_out, look_up, picture_sources, texture_coordinates
from toolkit.objects.mesh import Material, cross_products
from toolkit.objects.paint import BLENDED, COLOURS, PLAIN_COLOUR, paint_colours, plain_material, solid_texture

SPECULAR = "KHR_materials_pbrSpecularGlossiness"
ROUGHNESS, METALLIC = 0.6, 0.0
"""Where a file states neither a number nor a picture. The specification says rough metal, which they seldom mean."""

STEEP, STEEP_PX = 0.02, 16
"""How far a face's fourth texel may lie outside of what a texel holds, and how many texels a side such a face gets."""


@dataclass(frozen=True)
class Look:
    """What a material's JSON says.

    Attributes:
        name: for people.
        colour: (4,) linear base colour and alpha; None where the file gives none.
        picture: the JSON that names its picture; None where there is none.
        gloss: the JSON that names the picture of roughness and metalness, or of glossiness; None likewise.
        roughness: 0 mirror … 1 matte; times the picture's green.
        metallic: 0 dielectric … 1 metal; times the picture's blue.
        is_specular: whether `gloss` holds glossiness in its alpha.
        cutoff: least alpha that is solid; None where alpha does not count.
    """

    name: str
    colour: np.ndarray | None
    picture: dict[str, Any] | None
    gloss: dict[str, Any] | None
    roughness: float
    metallic: float
    is_specular: bool
    cutoff: float | None


def read_look(material: dict[str, Any]) -> Look:
    """What one entry of `materials` says."""
    specular = extension(material, SPECULAR)
    pbr = material.get("pbrMetallicRoughness", {}) if specular is None else specular
    names = ("diffuseFactor", "diffuseTexture", "specularGlossinessTexture")
    if specular is None:
        names = ("baseColorFactor", "baseColorTexture", "metallicRoughnessTexture")
    colour, picture, gloss = (pbr.get(name) for name in names)
    if specular is None:
        # a picture is multiplied by 1 where the file states no factor
        roughness = pbr.get("roughnessFactor", ROUGHNESS if gloss is None else 1.0)
        metallic = pbr.get("metallicFactor", METALLIC if gloss is None else 1.0)
    else:
        roughness, metallic = 1 - float(pbr.get("glossinessFactor", 1.0)), 0.0
    return Look(
        str(material.get("name") or "material"),
        None if colour is None else np.array(colour, np.float64).reshape(4),
        picture,
        gloss,
        float(roughness),
        float(metallic),
        specular is not None,
        float(material.get("alphaCutoff", 0.5)) if material.get("alphaMode") == "MASK" else None,
    )


def unseen_files(path: Path) -> set[str]:
    """The pictures that a readable file names and no material's colour or gloss is made of."""
    document = read_document(path)
    looks = [read_look(material) for material in document.rows("materials")]
    slots = [slot for look in looks for slot in (look.picture, look.gloss) if slot is not None]
    textures = [document.row("textures", slot.get("index")) for slot in slots]
    shown = {number for texture in textures for number in picture_sources(texture)}
    named = [(number, image.get("uri")) for number, image in enumerate(document.rows("images"))]
    files = [
        (number, name_of_uri(path.parent, uri))
        for number, uri in named
        if isinstance(uri, str) and not uri.startswith("data:")
    ]
    return {name for number, name in files} - {name for number, name in files if number in shown}


@dataclass(frozen=True)
class Part:
    """A painted part: vertices (n, 3) float64, faces (m, 3), (m, 3, 2) texture coordinates, v up, and material."""

    vertices: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray
    material: Material


def paint_primitive(document: Document, pictures: Pictures, primitive: Primitive) -> Part:
    """A primitive with its material; what is cut out of it by `alphaMode: MASK` is gone.

    Raises:
        ToolkitError: a picture cannot be read.
    """
    vertices, faces = primitive.vertices, primitive.faces
    colours = None if primitive.colours is None else primitive.colours[faces]
    if primitive.material is None:
        if colours is None:
            return Part(vertices, faces, np.zeros((len(faces), 3, 2), np.float32), plain_material())
        return Part(vertices, faces, *_paint_corners(colours, vertices, faces, (ROUGHNESS, METALLIC)))
    look = read_look(document.row("materials", primitive.material))
    gloss = _measure_gloss(pictures, look, primitive)
    uv = "" if look.picture is None else texture_coordinates(look.picture, primitive.uv)
    factor = np.ones(4) if look.colour is None else look.colour
    corner_alpha = np.ones(faces.shape) if primitive.alpha is None else primitive.alpha[faces].astype(np.float64)
    if look.picture is None or isinstance(uv, str):
        if uv:
            document.notes.append(f"the picture of '{look.name}' is left out: {uv}")
        if look.cutoff is not None and (corner_alpha * factor[3] < look.cutoff).any():
            left = cut_corners(corner_alpha * factor[3], look.cutoff)
            vertices, faces, _, colours = _cut(vertices, faces, np.zeros((*faces.shape, 2)), colours, *left)
        if colours is not None:
            colours = colours * factor[:3].astype(np.float32)
            return Part(vertices, faces, *_paint_corners(colours, vertices, faces, gloss))
        codes = _to_codes(factor[:3]).tolist() if look.colour is not None else PLAIN_COLOUR
        material = Material(look.name, solid_texture(tuple(codes)), *gloss)
        return Part(vertices, faces, np.zeros((len(faces), 3, 2), np.float32), material)

    picture = pictures.read(look.picture.get("index"), look.cutoff is not None)
    corner_uv = uv[faces]
    laid = lay_out(picture, corner_uv)
    if laid is not None:
        picture, corner_uv = laid
    elif look.cutoff is not None:
        document.notes.append(f"the holes of '{look.name}' are left out: its picture is clamped far beyond its edges")
    if look.cutoff is not None and laid is not None:
        alpha = np.ones((1, 1)) if picture.alpha is None else picture.alpha / 255
        owner, weights = cut_holes(corner_uv, alpha * factor[3], corner_alpha, look.cutoff)
        if len(owner) != len(faces) or (owner != np.arange(len(faces))).any():
            vertices, faces, corner_uv, colours = _cut(vertices, faces, corner_uv, colours, owner, weights)
    if colours is not None and len(colours) and (colours == colours[:1, :1]).all():
        factor, colours = factor * [*colours[0, 0], 1], None  # one colour on all of it is a factor
    if laid is None or colours is not None:
        corner_uv, texture = _bake(picture, corner_uv, colours, factor)
        return Part(vertices, faces, corner_uv, Material(COLOURS, texture, *gloss))
    flipped = corner_uv.copy()
    flipped[..., 1] = 1 - flipped[..., 1]
    material = Material(look.name, pictures.tint(picture.pixels, factor[:3]), *gloss)
    return Part(vertices, faces, flipped.astype(np.float32), material)


def _paint_corners(
    colours: np.ndarray, vertices: np.ndarray, faces: np.ndarray, gloss: tuple[float, float]
) -> tuple[np.ndarray, Material]:
    """Texture coordinates and material of colours (m, 3, 3) of the corners, linear light."""
    a, b, c = np.moveaxis(colours, 1, 0)
    fourth = b + c - a
    steep = (np.abs(fourth - fourth.clip(0, 1)) > STEEP).any(axis=1)
    if not steep.any() or len(faces) > BLENDED:
        return paint_colours(_to_codes(colours), vertices, faces, gloss)

    # four texels cannot blend such colours evenly
    def colour_at(face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.einsum("nk,nkd->nd", weights, colours[face])

    corner_uv, texture = bake_faces(np.where(steep, STEEP_PX, 2), colour_at)
    return corner_uv, Material(COLOURS, texture, *gloss)


def _to_codes(light: np.ndarray) -> np.ndarray:
    return np.round(linear_to_srgb(light) * 255).astype(np.uint8)


def _cut(
    vertices: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray, colours: np.ndarray | None,
    owner: np.ndarray, weights: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:  # fmt: skip
    """The same for pieces of faces, which share no corners."""
    corners = (weights @ vertices[faces[owner]]).reshape(-1, 3)
    index = np.arange(len(corners)).reshape(-1, 3)
    return corners, index, weights @ corner_uv[owner], None if colours is None else weights @ colours[owner]


def _bake(
    picture: Picture, corner_uv: np.ndarray, colours: np.ndarray | None, factor: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A picture for each face of what the old one, the colours of its corners and the factor give together."""
    edges = np.abs(corner_uv - np.roll(corner_uv, 1, axis=1)) * picture.size

    def colour_at(face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        light = look_up(picture, np.einsum("nk,nkd->nd", weights, corner_uv[face])) * factor[:3]
        if colours is not None:
            light *= np.einsum("nk,nkd->nd", weights, colours[face]).clip(0, 1)
        return light

    return bake_faces(edges.max(axis=(1, 2)) + 2, colour_at)


def _measure_gloss(pictures: Pictures, look: Look, primitive: Primitive) -> tuple[float, float]:
    """Roughness and metalness: factors times the mean of their picture over the faces, by area."""
    if look.gloss is None:
        return look.roughness, look.metallic
    picture = pictures.read(look.gloss.get("index"), look.is_specular)
    uv = texture_coordinates(look.gloss, primitive.uv)
    texels = picture.pixels if picture.alpha is None else np.dstack([picture.pixels, picture.alpha])
    if isinstance(uv, str) or not len(primitive.faces):
        mean = texels.mean(axis=(0, 1)) / 255
    else:
        area = np.linalg.norm(cross_products(primitive.vertices[primitive.faces]), axis=1) + 1e-30
        # four places on each face stand for it
        places = (uv[primitive.faces] @ np.eye(2)).transpose(1, 0, 2)
        middle = places.mean(axis=0)
        total = np.zeros(texels.shape[2])
        for place in (middle, *((places + middle) / 2)):
            x, y = (place % 1 * picture.size).astype(np.int64).clip(0, picture.size - 1).T
            total += area @ texels[y, x].astype(np.float64)
        mean = total / area.sum() / 4 / 255
    if look.is_specular:
        glossiness = mean[3] if len(mean) == 4 else 1.0
        return float(1 - (1 - look.roughness) * glossiness), 0.0
    return float((look.roughness * mean[1]).clip(0, 1)), float((look.metallic * mean[2]).clip(0, 1))
