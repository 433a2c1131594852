"""Stanford PLY as people have it: pictures in comments, texture coordinates of corners, colours by other names."""

import codecs
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.files import open_plain
from toolkit.imaging.read import read_texture
from toolkit.objects.limits import check_corners
from toolkit.objects.mesh import Material
from toolkit.objects.named_files import find_named
from toolkit.objects.obj_file import say_left_out
from toolkit.objects.paint import MeshPart, Paint, plain_paint, to_codes
from toolkit.objects.polygons import triangulate

END = b"end_header"
MOST_HEADER_BYTES = 1 << 20
VERTEX_UV = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
KNOWN_ELEMENTS = ("vertex", "polygon", "line")
ELEMENTS = {"face": "polygon", "edge": "line"}
"""By other names, trimesh leaves them as they are: it reads no texture coordinates of faces with mixed corners."""
ALIASES = {
    **{f"diffuse_{name}": name for name in ("red", "green", "blue", "alpha")},
    "r": "red", "g": "green", "b": "blue", "texture_s": "s", "texture_t": "t",
}  # fmt: skip
"""Properties by the names that some programs give them, and as trimesh knows them."""


def read_ply(path: Path) -> Iterator[MeshPart]:
    """Read the parts of a PLY, a part for each picture.

    A `TextureFile` comment names a picture; the faces' `texnumber` counts these comments from 0.

    Raises:
        ToolkitError: a picture does not decode; names the file.
        Exception: whatever trimesh makes of bytes that are no PLY.
    """
    from trimesh.exchange.ply import load_ply

    with open_plain(path) as file:
        content = file.read()
    header, names = _read_header(content)
    pictures = [find_named(path.parent, name) for name in names]
    missing = [name for name, file in zip(names, pictures, strict=True) if file is None]
    say_left_out(path, [f"{name} (not there)" for name in missing])
    if header:
        head, _, body = content.partition(END)
        # the header's lines may end in \r
        body = b"\n" + body[1:] if head[:4] == b"ply\r" and head[4:5] != b"\n" else body
        content = header + END + body
    made = load_ply(io.BytesIO(content), fix_texture=False, skip_materials=True)
    del content
    # trimesh keeps all elements of the file, also those that it does not use
    raw = made["metadata"]["_ply_raw"]
    say_left_out(path, [f"element {name}" for name in raw if name not in KNOWN_ELEMENTS])
    if "data" not in raw.get("vertex", {}) or "data" not in raw.get("polygon", {}):
        return
    surface = _read_surface(path, raw)
    if surface.uv is not None and any(pictures):
        if _read_colours(raw, "vertex") is not None or _read_colours(raw, "polygon") is not None:
            say_left_out(path, ["colours below a picture"])
        yield from _split_by_picture(path, surface, surface.uv, pictures)
        return
    if any(pictures):
        say_left_out(path, [f"{picture.name} (the file has no texture coordinates)" for picture in pictures if picture])
    yield MeshPart(surface.vertices, surface.corner_vertex[surface.triangles], _paint_plain(raw, surface))


@dataclass(frozen=True)
class _Surface:
    """The faces of a PLY by their corners, which are numbered through all faces.

    Attributes:
        vertices: (n, 3) float64.
        triangles: (m, 3) numbers of corners.
        corner_vertex: (c,) the vertex of each corner.
        corner_face: (c,) the face of each corner.
        uv: (c, 2) texture coordinates of the corners; None if the file has none.
        picture: (faces,) number of the picture of each face; None if the file has none.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    corner_vertex: np.ndarray
    corner_face: np.ndarray
    uv: np.ndarray | None
    picture: np.ndarray | None


def list_ply_names(path: Path) -> tuple[list[Path], list[str]]:
    """List the pictures that a PLY names, and the names of missing pictures.

    Raises:
        ToolkitError: a name leaves the folder.
    """
    with open_plain(path) as file:
        names = _read_header(file.read(MOST_HEADER_BYTES))[1]
    found = {name: find_named(path.parent, name) for name in names}
    files = [file for file in found.values() if file is not None]
    return list(dict.fromkeys(files)), [name for name, file in found.items() if file is None]


def _read_header(content: bytes) -> tuple[bytes, list[str]]:
    """Return the header as trimesh knows it, and the pictures that it names; empty without a header."""
    if END not in content[:MOST_HEADER_BYTES]:
        return b"", []
    text = content.partition(END)[0].removeprefix(codecs.BOM_UTF8).decode("utf-8", "replace")
    lines, names = [], []
    for line in text.splitlines():
        words = line.split()
        # comments name the pictures; other comments are dropped
        if match := re.match(r" *comment +texturefile +(.*?) *$", line, re.IGNORECASE):
            names.append(match[1].strip('"'))
        # other programs' names of properties become those that trimesh knows
        elif words[:1] == ["property"]:
            lines.append(" ".join([*words[:-1], ALIASES.get(words[-1], words[-1])]))
        elif words[:1] == ["element"] and len(words) == 3:
            lines.append(f"element {ELEMENTS.get(words[1], words[1])} {words[2]}")
        elif words and words[0] not in ("comment", "obj_info"):
            lines.append(line)
    return "".join(f"{line}\n" for line in lines).encode(), names


def _column(data: Any, *names: str) -> np.ndarray | None:
    """Return the first of these properties that an element has; a binary file's lists lie in the second field."""
    known = (data if isinstance(data, dict) else getattr(data, "dtype", np.dtype(float)).names) or ()
    for name in names:
        if name in known:
            found = np.asarray(data[name])
            return found["f1"] if found.dtype.names else found
    return None


def _read_surface(path: Path, raw: dict[str, Any]) -> _Surface:
    face, vertex, count = raw["polygon"]["data"], raw["vertex"]["data"], raw["polygon"]["length"]
    polygons = _column(face, "vertex_indices", "vertex_index")
    if polygons is None:
        raise ValueError("faces without vertices")
    corner_vertex = _flatten(polygons).astype(np.int64)
    # polygons of different sizes come as an array of arrays
    is_mixed = polygons.dtype == object
    each = len(corner_vertex) // max(count, 1)
    counts = np.array([len(polygon) for polygon in polygons]) if is_mixed else np.full(count, each)
    check_corners(path, int(counts.max(initial=0)))
    picture = _column(face, "texnumber")
    vertices = np.column_stack([np.ravel(vertex[axis]) for axis in "xyz"]).astype(np.float64)
    return _Surface(
        vertices, triangulate(vertices, corner_vertex, counts), corner_vertex, np.repeat(np.arange(count), counts),
        _read_uv(face, vertex, corner_vertex), None if picture is None else np.ravel(picture).astype(np.int64),
    )  # fmt: skip


def _flatten(lists: np.ndarray) -> np.ndarray:
    """Concatenate the numbers of all lists."""
    return np.concatenate(lists) if lists.dtype == object else np.ravel(lists)


def _read_uv(face: Any, vertex: Any, corner_vertex: np.ndarray) -> np.ndarray | None:
    """(c, 2) float32 texture coordinates of the corners: the faces' own, or their vertices'."""
    own = _column(face, "texcoord")
    if own is not None:
        uv = _flatten(own).astype(np.float32)
        if uv.size == 2 * len(corner_vertex) and np.isfinite(uv).all():
            return uv.reshape(-1, 2)
    for names in VERTEX_UV:
        columns = [_column(vertex, name) for name in names]
        if columns[0] is not None and columns[1] is not None:
            uv = np.column_stack([np.ravel(columns[0]), np.ravel(columns[1])]).astype(np.float32)
            return uv[corner_vertex] if np.isfinite(uv).all() else None
    return None


def _split_by_picture(path: Path, surface: _Surface, uv: np.ndarray, pictures: list[Path | None]) -> Iterator[MeshPart]:
    """Yield a part for each picture; faces with the number of no picture are plain grey."""
    numbers = np.zeros(len(surface.triangles), np.int64)
    # without numbers, all faces have the first picture
    if surface.picture is not None and len(pictures) > 1:
        numbers = surface.picture[surface.corner_face[surface.triangles[:, 0]]]
    elif len(pictures) > 1:
        say_left_out(path, [f"{file.name} (no face has a texnumber)" for file in pictures[1:] if file])
    # a picture that is not there leaves its faces grey
    there = [number for number, picture in enumerate(pictures) if picture is not None]
    numbers = np.where(np.isin(numbers, there), numbers, -1)
    for number in np.unique(numbers):
        corners = surface.triangles[numbers == number].reshape(-1)
        paint = plain_paint(uv[corners], len(corners))
        picture = pictures[number] if number >= 0 else None
        if picture is not None:
            roughness = (2 / 3) ** 0.25  # as of an OBJ whose material says nothing of it
            paint = uv[corners], Material("material", read_texture(picture), roughness)
        yield MeshPart(surface.vertices[surface.corner_vertex[corners]], np.arange(len(corners)).reshape(-1, 3), paint)


def _paint_plain(raw: dict[str, Any], surface: _Surface) -> Paint | np.ndarray:
    """Return colours of the vertices, or of the faces; else plain grey."""
    colours = _read_colours(raw, "vertex")
    if colours is not None:
        return colours
    colours = _read_colours(raw, "polygon")
    if colours is not None:
        return colours[surface.corner_face[surface.triangles[:, 0]], None]
    uv = None
    if surface.uv is not None:
        uv = np.zeros((len(surface.vertices), 2), np.float32)
        uv[surface.corner_vertex] = surface.uv
    return plain_paint(uv, len(surface.vertices))


def _read_colours(raw: dict[str, Any], element: str) -> np.ndarray | None:
    """(n, 3) uint8 colours of an element; None if it has none."""
    columns = [_column(raw[element]["data"], name) for name in ("red", "green", "blue")]
    found = [np.ravel(column) for column in columns if column is not None]
    return to_codes(np.column_stack(found)) if len(found) == 3 else None
