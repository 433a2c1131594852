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
from toolkit.objects.gltf.pictures import GltfPicture, Pictures, lay_out, look_up, picture_sources, texture_coordinates
from toolkit.objects.mesh import Material, cross_products
from toolkit.objects.paint import (
    BLENDED,
    COLOURS,
    PLAIN_COLOUR,
    MeshPart,
    Paint,
    paint_colours,
    plain_material,
    solid_texture,
)

SPECULAR = "KHR_materials_pbrSpecularGlossiness"
ROUGHNESS, METALLIC = 0.6, 0.0
"""Defaults without a number or a picture. The specification's default is rough metal, which files seldom mean."""
STEEP, STEEP_PX = 0.02, 16
"""Most light of a face's fourth texel outside of 0 to 1; beyond, the face gets so many texels a side."""


@dataclass(frozen=True)
class Look:
    """A material's JSON.

    Attributes:
        name: name for people.
        colour: (4,) linear base colour and alpha, if the file states it.
        picture: JSON that names its picture, if any.
        gloss: JSON that names the picture of roughness and metalness, or of glossiness, if any.
        roughness: 0 mirror … 1 matte; times the picture's green.
        metallic: 0 dielectric … 1 metal; times the picture's blue.
        is_specular: whether `gloss` holds glossiness in its alpha.
        cutoff: least alpha that is solid; None if alpha does not count.
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
    """Read an entry of `materials`."""
    # an older extension states gloss and specular colour in place of roughness and metalness
    specular = extension(material, SPECULAR)
    if specular is None:
        pbr = material.get("pbrMetallicRoughness", {})
        names = ("baseColorFactor", "baseColorTexture", "metallicRoughnessTexture")
        colour, picture, gloss = (pbr.get(name) for name in names)
        # without a factor, a picture is multiplied by 1
        roughness = pbr.get("roughnessFactor", ROUGHNESS if gloss is None else 1.0)
        metallic = pbr.get("metallicFactor", METALLIC if gloss is None else 1.0)
    else:
        names = ("diffuseFactor", "diffuseTexture", "specularGlossinessTexture")
        colour, picture, gloss = (specular.get(name) for name in names)
        roughness, metallic = 1 - float(specular.get("glossinessFactor", 1.0)), 0.0
    return Look(
        name=str(material.get("name") or "material"), picture=picture, gloss=gloss,
        colour=None if colour is None else np.array(colour, np.float64).reshape(4),
        roughness=float(roughness), metallic=float(metallic), is_specular=specular is not None,
        cutoff=float(material.get("alphaCutoff", 0.5)) if material.get("alphaMode") == "MASK" else None,
    )  # fmt: skip


def unseen_files(path: Path) -> set[str]:
    """Return the pictures that a readable file names, but no material's colour or gloss uses."""
    document = read_document(path)
    looks = [read_look(material) for material in document.rows("materials")]
    slots = [slot for look in looks for slot in (look.picture, look.gloss) if slot is not None]
    textures = [document.row("textures", slot.get("index")) for slot in slots]
    shown = {number for texture in textures for number in picture_sources(texture)}
    named = enumerate(image.get("uri") for image in document.rows("images"))
    is_file = {number: uri for number, uri in named if isinstance(uri, str) and not uri.startswith("data:")}
    files = {number: name_of_uri(path.parent, uri) for number, uri in is_file.items()}
    return set(files.values()) - {name for number, name in files.items() if number in shown}


def paint_primitive(document: Document, pictures: Pictures, primitive: Primitive) -> MeshPart:
    """Paint a primitive with its material, and cut out the holes of `alphaMode: MASK`.

    Raises:
        ToolkitError: a picture cannot be read.
    """
    vertices, faces = primitive.vertices, primitive.faces
    # colours of corners, not of vertices: faces are cut and painted singly
    colours = None if primitive.colours is None else primitive.colours[faces]
    if primitive.material is None:
        if colours is None:
            return MeshPart(vertices, faces, (np.zeros((len(faces), 3, 2), np.float32), plain_material()))
        return MeshPart(vertices, faces, _paint_corners(colours, vertices, faces, (ROUGHNESS, METALLIC)))
    look = read_look(document.row("materials", primitive.material))
    gloss = _measure_gloss(pictures, look, primitive)
    # the slot's own set of coordinates, moved by its transform; words say why there is none
    uv = "" if look.picture is None else texture_coordinates(look.picture, primitive.uv)
    factor = np.ones(4) if look.colour is None else look.colour
    corner_alpha = np.ones(faces.shape) if primitive.alpha is None else primitive.alpha[faces].astype(np.float64)
    # no picture, or none that can be laid out: a single colour, or colours of corners
    if look.picture is None or isinstance(uv, str):
        if uv:
            document.notes.append(f"the picture of '{look.name}' is left out: {uv}")
        if look.cutoff is not None and (corner_alpha * factor[3] < look.cutoff).any():
            left = cut_corners(corner_alpha * factor[3], look.cutoff)
            vertices, faces, _, colours = _cut(vertices, faces, np.zeros((*faces.shape, 2)), colours, *left)
        if colours is not None:
            colours = colours * factor[:3].astype(np.float32)
            return MeshPart(vertices, faces, _paint_corners(colours, vertices, faces, gloss))
        codes = _to_codes(factor[:3]).tolist() if look.colour is not None else PLAIN_COLOUR
        material = Material(look.name, solid_texture(tuple(codes)), *gloss)
        return MeshPart(vertices, faces, (np.zeros((len(faces), 3, 2), np.float32), material))

    # a picture: laid out to repeat, its holes cut, then tinted or baked
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
        factor, colours = factor * [*colours[0, 0], 1], None  # the same colour everywhere is a factor
    # a picture that does not repeat, or is tinted corner by corner, is baked into a block of texels for each face
    if laid is None or colours is not None:
        corner_uv, texture = _bake(picture, corner_uv, colours, factor)
        return MeshPart(vertices, faces, (corner_uv, Material(COLOURS, texture, *gloss)))
    # glTF counts v downwards, a mesh here upwards
    flipped = corner_uv.copy()
    flipped[..., 1] = 1 - flipped[..., 1]
    material = Material(look.name, pictures.tint(picture.pixels, factor[:3]), *gloss)
    return MeshPart(vertices, faces, (flipped.astype(np.float32), material))


def _paint_corners(colours: np.ndarray, vertices: np.ndarray, faces: np.ndarray, gloss: tuple[float, float]) -> Paint:
    """Return texture coordinates and material of colours (m, 3, 3) of the corners, linear light."""
    # a texel of 2 × 2 blends evenly only if its fourth corner is b + c - a, within the range of colours
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
    """Return vertices, faces, texture coordinates and colours of pieces of faces, which share no corners."""
    corners = (weights @ vertices[faces[owner]]).reshape(-1, 3)
    index = np.arange(len(corners)).reshape(-1, 3)
    return corners, index, weights @ corner_uv[owner], None if colours is None else weights @ colours[owner]


def _bake(
    picture: GltfPicture, corner_uv: np.ndarray, colours: np.ndarray | None, factor: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Multiply a picture, the colours of the corners and the factor into a new picture, face by face."""
    # a face is baked as finely as its longest edge has texels
    edges = np.abs(corner_uv - np.roll(corner_uv, 1, axis=1)) * picture.size

    def colour_at(face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        light = look_up(picture, np.einsum("nk,nkd->nd", weights, corner_uv[face])) * factor[:3]
        if colours is not None:
            light *= np.einsum("nk,nkd->nd", weights, colours[face]).clip(0, 1)
        return light

    return bake_faces(edges.max(axis=(1, 2)) + 2, colour_at)


def _measure_gloss(pictures: Pictures, look: Look, primitive: Primitive) -> tuple[float, float]:
    """Return roughness and metalness: factors times the mean of their picture over the faces, by area."""
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
        # the middle, and places halfway from it to the corners
        places = (uv[primitive.faces] @ np.eye(2)).transpose(1, 0, 2)
        middle = places.mean(axis=0)
        total = np.zeros(texels.shape[2])
        for place in (middle, *((places + middle) / 2)):
            x, y = (place % 1 * picture.size).astype(np.int64).clip(0, picture.size - 1).T
            total += area @ texels[y, x].astype(np.float64)
        mean = total / area.sum() / 4 / 255
    # roughness is 1 - glossiness, which is in alpha; the metal-roughness picture has it in green, metalness in blue
    if look.is_specular:
        glossiness = mean[3] if len(mean) == 4 else 1.0
        return float(1 - (1 - look.roughness) * glossiness), 0.0
    return float((look.roughness * mean[1]).clip(0, 1)), float((look.metallic * mean[2]).clip(0, 1))
