"""Wavefront OBJ as people have it: text that is made plain for trimesh, and the materials of its libraries."""

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.console import notice_once
from toolkit.core.errors import ToolkitError
from toolkit.core.files import open_plain
from toolkit.core.text import list_some
from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.imaging.read import read_texture
from toolkit.objects.limits import check_corners
from toolkit.objects.mesh import Material
from toolkit.objects.mtl_file import ObjMaterial, decode_text, find_libraries, read_library
from toolkit.objects.named_files import find_named
from toolkit.objects.paint import MeshPart, Paint, plain_paint, solid_texture, tint_texture, to_codes
from toolkit.objects.polygons import is_fan, triangulate, triangulate_polygon

MOST_OBJ_MATERIALS = 4_000
"""trimesh looks for a name for each among all before it."""
CLAMPED_TILES = 4
"""A clamped picture is drawn out to so many times its size on each side; further out it has the same colour."""
MOST_NOTES = 8
NOT_READ = {
    "free-form curves and surfaces": re.compile(r"^ *(surf|curv2?|cstype|call|csh) ", re.MULTILINE),
    "points and lines": re.compile(r"^ *[pl] ", re.MULTILINE),
    "ZBrush's colours (#MRGB)": re.compile(r"^#MRGB ", re.MULTILINE),
}
MIXED_FACE = re.compile(r"^ *f [^\n]*(?: |/)-", re.MULTILINE)


def read_obj(path: Path) -> Iterator[MeshPart]:
    """Read the parts of an OBJ, a part for each material.

    Raises:
        ToolkitError: too many materials, or a picture that does not decode; names the file.
        Exception: whatever trimesh makes of text that is no OBJ.
    """
    from trimesh.exchange.obj import load_obj

    # materials are read here, so trimesh gets their names alone
    text, materials = _read_text(path)
    names = "".join(f"newmtl {name}\n" for name in materials)
    made = load_obj(io.StringIO(f"mtllib materials\n{text}"), resolver={"materials": names})
    del text
    painter = _Painter(path, materials)
    for part in made.get("geometry", {}).values() if "geometry" in made else ():
        vertices = np.asarray(part["vertices"], np.float64)
        corners = np.asarray(part["faces"], np.int64)  # all triangles, or all quadrilaterals
        if len(corners):
            counts = np.full(len(corners), corners.shape[1])
            faces = corners.reshape(-1)[triangulate(vertices, corners.reshape(-1), counts)]
            yield MeshPart(vertices, faces, painter.paint(part, vertices))
    say_left_out(path, painter.left_out)


def list_obj_names(path: Path) -> tuple[list[Path], list[str]]:
    """List the files that an OBJ and its libraries name, and the names of missing files.

    Raises:
        ToolkitError: a name leaves the folder.
    """
    with open_plain(path) as file:
        libraries, missing = find_libraries(path, decode_text(file.read()))
    files = dict.fromkeys(libraries)
    for library in libraries:
        for material in read_library(library).values():
            for name in [*([material.picture.name] if material.picture else []), *material.others]:
                found = find_named(path.parent, name, library.parent)
                if found is None:
                    missing.append(name)
                else:
                    files[found] = None
    return list(files), list(dict.fromkeys(missing))


def _read_text(path: Path) -> tuple[str, dict[str, ObjMaterial]]:
    """Return the file's text in the plain form that trimesh reads, and the materials of its libraries."""
    with open_plain(path) as file:
        text = decode_text(file.read())
    libraries, missing = find_libraries(path, text)
    materials: dict[str, ObjMaterial] = {}
    for library in libraries:
        materials |= read_library(library)
    left_out = [f"{name} (not there)" for name in missing]
    left_out += [name for name, pattern in NOT_READ.items() if pattern.search(text)]

    # libraries were read above, none from outside the folder; the rest is what its reader does not take
    text = re.sub(r"^ *mtllib .*$", "", text, flags=re.MULTILINE)
    if "#" in text:
        text = re.sub(r"^#.*$|^([vf][^#\n]*) #.*$", r"\1", text, flags=re.MULTILINE)
    text = re.sub(r"^ +", "", text, flags=re.MULTILINE) if "\n " in text or text[:1] == " " else text
    used = {*re.findall(r"^usemtl +(.*)$", text, re.MULTILINE)}
    if len(used) > MOST_OBJ_MATERIALS:
        raise ToolkitError(
            f"{path}: {len(used):,} materials, more than {MOST_OBJ_MATERIALS:,}: join them, or export it as .glb"
        )
    # names with doubled blanks mean the same material, as other programs read them
    if any("  " in name for name in used):
        text = re.sub(r"^usemtl .*$", lambda line: " ".join(line[0].split()), text, flags=re.MULTILINE)
    used = {" ".join(name.split()) for name in used}
    if not used and len(materials) == 1:
        text = f"usemtl {next(iter(materials))}\n{text}"  # as MeshLab and Blender take it
    elif not used and materials:
        left_out.append(f"{len(materials)} materials (no usemtl names them)")
    left_out += [f"usemtl {name} (no such material)" for name in _find_materials(materials, used)]
    say_left_out(path, left_out)
    return _split_faces(path, _plain_faces(text)), materials


def _find_materials(materials: dict[str, ObjMaterial], used: set[str]) -> list[str]:
    """Return names without a material; a name that differs from a material in letter case only is added."""
    missing = []
    for name in sorted(used - set(materials)):
        alike = [material for known, material in materials.items() if known.casefold() == name.casefold()]
        if len(alike) == 1:
            materials[name] = alike[0]
        else:
            missing.append(name)
    return missing


def say_left_out(path: Path, features: list[str]) -> None:
    """Print a note, once in a process, on the features of a file that are not used, if there are any."""
    features = list(dict.fromkeys(features))
    if features:
        notice_once(f"note: {path}: left out: {list_some(features, MOST_NOTES)}")


def _plain_faces(text: str) -> str:
    """Corners counted from the last vertex get absolute numbers; corners without texture coordinates get (0, 0).

    trimesh counts backwards from the end of the file, and drops all texture coordinates of a part if any is missing.
    """
    # the form of a corner, v, v/vt, v//vn or v/vt/vn, of the first corner of each face
    starts = re.findall(r"^f +(\S+)", text, re.MULTILINE)
    forms = {tuple(bool(part) for part in start.rstrip("/").split("/")) for start in starts}
    if len(forms) < 2 and not MIXED_FACE.search(text):
        return text
    counts = {"v": 0, "vt": 0, "vn": 0}
    lines = text.split("\n")
    # the added texture coordinate stands behind all others
    dummy = sum(line.startswith("vt ") for line in lines) + 1
    has_uv = dummy > 1
    # numbers count what stands above the face
    for number, line in enumerate(lines):
        key = line.partition(" ")[0]
        if key in counts:
            counts[key] += 1
        elif key == "f":
            corners = (_plain_corner(corner, counts, dummy if has_uv else 0) for corner in line.split()[1:])
            lines[number] = " ".join(("f", *corners))
    return "\n".join([*lines, "vt 0 0"] if has_uv else lines)


def _split_faces(path: Path, text: str) -> str:
    """Polygons that are no fan become triangles, unless all faces are triangles or all are quadrilaterals.

    trimesh makes fans of all others.
    """
    if not re.search(r"^f(?: +\S+){4}", text, re.MULTILINE):
        return text
    lines = text.split("\n")
    faces = {number: line.split()[1:] for number, line in enumerate(lines) if line.startswith("f ")}
    counts = {len(corners) for corners in faces.values()}
    check_corners(path, max(counts))
    if counts == {4}:
        return text
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], np.float64)
    for number, corners in faces.items():
        if len(corners) > 3:
            places = vertices[[int(corner.partition("/")[0]) - 1 for corner in corners]]
            if not is_fan(places[None])[0]:
                triangles = np.array(corners)[triangulate_polygon(places)]
                lines[number] = "\n".join(f"f {' '.join(triangle)}" for triangle in triangles)
    return "\n".join(lines)


def _plain_corner(corner: str, counts: dict[str, int], dummy: int) -> str:
    """Return a corner as vertex/uv, or as the vertex alone if the file has no texture coordinates."""
    numbers = [int(part or 0) for part in [*corner.split("/"), ""][:2]]
    # a negative number counts from the last
    vertex, uv = (number + (counts[key] + 1) * (number < 0) for number, key in zip(numbers, ("v", "vt"), strict=True))
    return f"{vertex}/{uv or dummy}" if dummy else str(vertex)


@dataclass
class _Painter:
    """The paint of the parts of an OBJ; each picture is decoded once."""

    path: Path
    materials: dict[str, ObjMaterial]

    def __post_init__(self) -> None:
        self.pictures: dict[Path, np.ndarray] = {}
        self.left_out: list[str] = []

    def paint(self, part: dict[str, Any], vertices: np.ndarray) -> Paint | np.ndarray:
        """Return a part's material, or its vertices' colours times the material's; else plain grey."""
        visual, colours = part.get("visual"), part.get("vertex_colors")
        material = None if visual is None else self.materials.get(visual.material.name)
        uv = None if visual is None or visual.uv is None else np.asarray(visual.uv, np.float32)
        if uv is not None and (uv.shape != (len(vertices), 2) or not np.isfinite(uv).all()):
            uv = None
        # a picture needs coordinates to lie on
        picture = self._read_picture(material) if material is not None and uv is not None else None
        if material is not None and material.picture is not None and uv is None:
            self.left_out.append(f"{material.picture.name} (a part has no texture coordinates)")
        if material is not None:
            self.left_out += material.left_out
        # colours of vertices count if no picture covers them
        if colours is not None and len(colours) == len(vertices):
            if picture is None:
                colours = to_codes(np.asarray(colours)[:, :3])
                tint = None if material is None else material.colour
                return colours if tint is None else tint_texture(colours, _light_of(tint))
            self.left_out.append("colours of vertices below a picture")
        if material is None:
            return plain_paint(uv, len(vertices))
        return self._paint(material, picture, np.zeros((len(vertices), 2), np.float32) if uv is None else uv)

    def _read_picture(self, material: ObjMaterial) -> np.ndarray | None:
        if material.picture is None:
            return None
        file = find_named(self.path.parent, material.picture.name, material.folder)
        if file is None:
            self.left_out.append(f"{material.picture.name} (not there)")
            return None
        if file not in self.pictures:
            self.pictures[file] = read_texture(file)
        return self.pictures[file]

    def _paint(self, material: ObjMaterial, picture: np.ndarray | None, uv: np.ndarray) -> Paint:
        roughness = material.roughness
        if roughness is None:  # of the exponent of Phong's highlight
            roughness = (2 / (material.shininess + 2)) ** 0.25
        colour = material.colour
        if picture is None or material.picture is None:
            uv, plain = plain_paint(uv, len(uv))
            if colour is not None:
                plain = replace(plain, texture=tint_texture(solid_texture((255, 255, 255)), _light_of(colour)))
            return uv, replace(plain, roughness=roughness, metallic=material.metallic)
        # the library's options scale and shift the picture
        uv = (uv * np.array(material.picture.scale) + np.array(material.picture.offset)).astype(np.float32)
        if material.picture.is_clamped and (uv.min() < 0 or uv.max() > 1):
            uv, picture = _clamp_picture(uv, picture)
        # black under a picture is a colour that was never set: it would blacken the picture
        if colour is not None and min(colour) < 1 and max(colour) > 0:
            picture = tint_texture(picture, _light_of(colour))
        return uv, Material("material", picture, roughness, material.metallic)


def _light_of(colour: tuple[float, float, float]) -> np.ndarray:
    return LINEAR_OF_CODE[np.round(np.multiply(colour, 255)).astype(np.uint8)]


def _clamp_picture(uv: np.ndarray, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Extend a picture's edge as far as the texture coordinates (n, 2) reach, and return both."""
    height, width = picture.shape[:2]
    uv = np.clip(uv, -CLAMPED_TILES, 1 + CLAMPED_TILES)
    low, high = np.minimum(uv.min(axis=0), 0), np.maximum(uv.max(axis=0), 1)
    # a texel more on each side, so that look-ups between texels stay inside
    left, bottom = (np.ceil(-low * [width, height]) + 1).astype(int)
    right, top = (np.ceil((high - 1) * [width, height]) + 1).astype(int)
    larger = np.pad(picture, ((top, bottom), (left, right), (0, 0)), mode="edge")
    texels = uv * [width, height] + [left, bottom]
    return (texels / [larger.shape[1], larger.shape[0]]).astype(np.float32), larger
