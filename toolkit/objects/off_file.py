"""Object File Format as people have it: the header's letters, colours of vertices and faces, polygons of any kind."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import open_plain
from toolkit.objects.limits import check_corners, check_faces
from toolkit.objects.mtl_file import decode_text
from toolkit.objects.obj_file import say_left_out
from toolkit.objects.paint import PLAIN_COLOUR, MeshPart, plain_paint, to_codes
from toolkit.objects.polygons import triangulate

HEADER = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF\b")
BINARY = re.compile(rb"\s*\w*OFF +BINARY")


def read_off(path: Path) -> Iterator[MeshPart]:
    """Read the mesh of an OFF with its colours of faces, else of vertices, else plain grey.

    Raises:
        ToolkitError: it is binary, or of four dimensions or more.
        Exception: the text is no OFF.
    """
    with open_plain(path) as file:
        content = file.read()
    if BINARY.match(content):
        raise ToolkitError(f"{path}: binary OFF is not read: save it as ASCII OFF or PLY (MeshLab)")
    text = re.sub(r"#.*", "", decode_text(content))
    rows = [row for row in map(str.split, text.split("\n")) if row]
    # letters of the header state what follows a vertex: ST uv, C colour, N normal, 4 and n other dimensions
    letters = HEADER.match(" ".join(rows[0]))
    has_uv = has_normals = False
    if letters is not None:
        if letters[4] or letters[5]:
            raise ToolkitError(f"{path}: OFF of other than three dimensions is not read: save it as PLY (MeshLab)")
        has_uv, has_normals = bool(letters[1]), bool(letters[3])
        rows = [row for row in (rows[0][1:], *rows[1:]) if row]
    # counts are checked before arrays are made: a small file may announce billions
    vertex_count, face_count = int(rows[0][0]), int(rows[0][1])
    check_faces(path, face_count)
    points, polygons = rows[1 : 1 + vertex_count], rows[1 + vertex_count : 1 + vertex_count + face_count]
    if len(points) != vertex_count or len(polygons) != face_count:
        raise ValueError("rows are missing")
    say_left_out(path, ["texture coordinates (OFF names no picture)"] if has_uv else [])
    # positions and polygons; what follows them is read below
    vertices = np.array([row[:3] for row in points], np.float64).reshape(-1, 3)
    counts = np.array([int(row[0]) for row in polygons], np.int64)
    check_corners(path, int(counts.max(initial=0)))
    corners = [row[1 : 1 + count] for row, count in zip(polygons, counts, strict=True)]
    corner_vertex = np.array([corner for row in corners for corner in row], np.int64)
    if len(corner_vertex) != counts.sum() or not ((corner_vertex >= 0) & (corner_vertex < vertex_count)).all():
        raise ValueError("faces name vertices that are not there")
    triangles = triangulate(vertices, corner_vertex, counts)
    if not len(triangles):
        return
    # colours stand behind position and normal, and behind a face's corners; a lone number there is an index of a table
    first = 3 + 3 * has_normals
    of_vertices = _read_colours([row[first : len(row) - 2 * has_uv] for row in points])
    of_faces = _read_colours([row[1 + count :] for row, count in zip(polygons, counts, strict=True)])
    if of_faces is None and any(len(row) == 2 + count for row, count in zip(polygons, counts, strict=True)):
        say_left_out(path, ["colours of faces (numbers of a table)"])
    paint = plain_paint(None, len(vertices)) if of_vertices is None else of_vertices
    if of_faces is not None:
        say_left_out(path, ["colours of vertices below those of faces"] if of_vertices is not None else [])
        paint = of_faces[np.repeat(np.arange(face_count), counts)[triangles[:, 0]], None]
    yield MeshPart(vertices, corner_vertex[triangles], paint)


def _read_colours(rows: list[list[str]]) -> np.ndarray | None:
    """(n, 3) uint8 colours at the end of each row, which may have alpha; rows without are plain grey, all: None."""
    there = [number for number, row in enumerate(rows) if len(row) >= 3]
    if not there:
        return None
    values = np.array([rows[number][:3] for number in there], np.float64)
    is_whole = all(part.lstrip("+-").isdigit() for number in there for part in rows[number][:3])
    colours = np.tile(np.array(PLAIN_COLOUR, np.uint8), (len(rows), 1))
    colours[there] = to_codes(values.astype(np.int64) if is_whole else values)
    return colours
