"""STL as people have it: binary with colours or rubbish behind its end, and text."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import open_plain
from toolkit.objects.limits import check_faces
from toolkit.objects.mtl_file import decode_text
from toolkit.objects.paint import PLAIN_COLOUR, MeshPart, plain_paint

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER_BYTES = 80
OWN = 0x8000
"""Bit of a facet with its own colour: set in VisCAM's files, clear in Magics's."""


def read_stl(path: Path) -> Iterator[MeshPart]:
    """Read the solids of an STL, in the colours of VisCAM, SolidView or Magics, else plain grey.

    Raises:
        ToolkitError: a binary file ends too early.
        Exception: whatever trimesh makes of text that is no STL.
    """
    with open_plain(path) as file:
        content = file.read()
    if _is_text(content):
        yield from _read_text(content)
        return
    # binary: a header of 80 bytes, the number of triangles, and 50 bytes for each
    held = (len(content) - HEADER_BYTES - 4) // FACET.itemsize
    if held < 0:
        raise ValueError("shorter than its header")
    count = int.from_bytes(content[HEADER_BYTES : HEADER_BYTES + 4], "little")
    if held < count:
        raise ToolkitError(
            f"{path}: ends too early: it announces {count:,} triangles and holds {held:,}: copy it again"
        )
    check_faces(path, count)
    facets = np.frombuffer(content, FACET, count, HEADER_BYTES + 4)
    if not count:
        return
    # an STL has no shared vertices: three for each triangle
    vertices = facets["corners"].reshape(-1, 3).astype(np.float64)
    colours = _read_colours(content[:HEADER_BYTES], facets["attribute"])
    paint = plain_paint(None, len(vertices)) if colours is None else colours[:, None]
    yield MeshPart(vertices, np.arange(len(vertices)).reshape(-1, 3), paint)


def _is_text(content: bytes) -> bool:
    """Whether it is text; headers of binary files may begin with `solid` too."""
    count = int.from_bytes(content[HEADER_BYTES : HEADER_BYTES + 4], "little")
    is_exact = len(content) == HEADER_BYTES + 4 + count * FACET.itemsize
    return not is_exact and b"facet" in decode_text(content[: 1 << 12]).lower().encode()


def _read_text(content: bytes) -> Iterator[MeshPart]:
    from trimesh.exchange.stl import load_stl_ascii

    made = load_stl_ascii(io.StringIO(decode_text(content)))
    for solid in made["geometry"].values() if "geometry" in made else (made,):
        vertices, faces = np.asarray(solid["vertices"], np.float64), np.asarray(solid["faces"], np.int64)
        if len(faces):
            yield MeshPart(vertices, faces, plain_paint(None, len(vertices)))


def _read_colours(header: bytes, attribute: np.ndarray) -> np.ndarray | None:
    """(m, 3) uint8 colours of the facets, five bits a channel; None where the file states none."""
    channels = np.stack([attribute >> shift & 31 for shift in (0, 5, 10)], axis=1)
    codes = np.round(channels * (255 / 31)).astype(np.uint8)
    own = attribute & OWN > 0
    _, is_magics, rest = header.partition(b"COLOR=")
    if is_magics and len(rest) >= 3:
        # programs that give the whole solid a single colour write zeros
        solid = own | (attribute == 0)
        return np.where(solid[:, None], np.frombuffer(rest[:3], np.uint8), codes)
    if not own.any():
        return None
    return np.where(own[:, None], codes[:, ::-1], np.array(PLAIN_COLOUR, np.uint8))
