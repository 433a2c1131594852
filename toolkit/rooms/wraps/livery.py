"""A picture that exists already, on an object or on the pieces of a wrap: a livery, a camouflage, a texture, a wrap."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import read_bytes, sha256_bytes
from toolkit.imaging.colour import LINEAR_OF_CODE, linear_to_srgb
from toolkit.imaging.read import UnreadableImage, read_opaque
from toolkit.objects.atlas import lay_picture
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.painted import paint_object
from toolkit.objects.records import MOST_RECORDED_BYTES, read_texture
from toolkit.rooms.wraps.wrap import (
    PLAIN,
    RECORD_FILE,
    FlatPiece,
    PictureRecord,
    Wrap,
    check_wrap,
    dress_mesh,
    read_wrap,
)
from toolkit.rooms.wraps.wrapped import fill_canvas

LEVEL = 0.35
"""A piece that rises less than this, millimetres per millimetre, lies level: its arrow points to the front."""
ASPECT = 0.02
"""Relative difference of two pictures' width / height from which their forms differ."""
SAMPLES = 3
"""A texel of a pattern is looked up in so many places across and up."""


@dataclass(frozen=True)
class Livery:
    """An object in a picture that exists."""

    mesh: Mesh  # the object, with the picture in place of its paint
    record: PictureRecord  # of the picture
    is_trained: bool  # whether the toolkit trained it; else people made it


def read_livery(item: TableObject, file: Path, keep: Sequence[str] = (), field: str = "picture") -> Livery:
    """Put a picture on an object.

    Args:
        file: a picture in the object's own texture coordinates, the PNG of a texture, or a wrap's folder or record.
        keep: names of materials that keep their paint; only of a picture.
        field: of the config that names the file, for errors.

    Raises:
        ToolkitError: it cannot be read, is transparent, has another form than the object's own texture, or was made
            for another object; the object's coordinates carry no single picture.
    """
    file = Path(file)
    # the file itself tells which of the three it is
    folder, beside = file.parent if file.name == RECORD_FILE else file, file.with_suffix(".json")
    if folder.is_dir():
        wrap = read_wrap(folder)
        check_wrap(wrap, item)
        mesh = dress_mesh(item.mesh, wrap, fill_canvas(wrap, len(item.mesh.faces)))
        record = PictureRecord(name=wrap.record.name, sha256=wrap.record.map_sha256)
        livery = Livery(mesh, record, wrap.record.booster is not None)
    # a texture's record lies beside it; other programs may write a .json there, too
    elif beside.is_file() and b'"uv_sha256"' in read_bytes(beside, MOST_RECORDED_BYTES):
        texture = read_texture(file)
        mesh = paint_object(item, texture, texture.pixels)
        livery = Livery(mesh, PictureRecord(name=file.name, sha256=texture.record.png_sha256), True)
    else:
        pixels, record = read_picture(file, field)
        _check_form(item, pixels, file, field)
        try:
            return Livery(lay_picture(item.mesh, pixels, keep), record, False)
        except ToolkitError as error:
            raise ToolkitError(f"{item.name}: {error}") from None
    if keep:
        raise FieldError("goes with a picture alone: textures and wraps know what they cover", {"keep": keep})
    return livery


def read_picture(file: Path, field: str) -> tuple[np.ndarray, PictureRecord]:
    """(h, w, 3) uint8 sRGB of a picture that people made, and its record; raises `FieldError` as `read_opaque`."""
    try:
        pixels = read_opaque(file)
    except UnreadableImage as error:
        raise FieldError(f"cannot be used: {error.reason}", {field: file}) from None
    return pixels, PictureRecord(name=file.name, sha256=sha256_bytes(read_bytes(file, MOST_RECORDED_BYTES)))


def _check_form(item: TableObject, pixels: np.ndarray, file: Path, field: str) -> None:
    """Refuse a picture that is wider or higher than the object's own texture: it was drawn for another object."""
    drawn = [material.texture for material in item.mesh.materials if (material.texture != material.texture[0, 0]).any()]
    height, width = max((texture.shape[:2] for texture in drawn), default=pixels.shape[:2])
    if abs(pixels.shape[1] * height / (pixels.shape[0] * width) - 1) > ASPECT:
        raise FieldError(
            f"is {pixels.shape[1]} × {pixels.shape[0]} px: expected the form of the texture of '{item.name}', "
            f"{width} × {height} px or a multiple",
            {field: file},
        )


def draw_pattern(wrap: Wrap, mesh: Mesh, pixels: np.ndarray, long_mm: float) -> np.ndarray:
    """(n, n, 3) uint8 sRGB canvas with a picture that repeats on each piece, undistorted and the right way up.

    Args:
        pixels: (h, w, 3) uint8 sRGB.
        long_mm: length of the picture's longer side, mm.
    """
    record = wrap.record
    canvas = np.full((record.n_px, record.n_px, 3), PLAIN, np.uint8)
    per_mm = max(pixels.shape[:2]) / long_mm
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES
    for piece, at in zip(wrap.pieces, record.pieces, strict=True):
        left, low, right, high = record.box_px(at)
        # places of the samples, from the lower left of the piece's box, mm
        x, y = (
            ((np.arange(first, last)[:, None] + inside).reshape(-1) - origin) * record.texel_mm
            for first, last, origin in ((left, right, at.origin_px[0]), (low, high, at.origin_px[1]))
        )
        # turned so that the picture's upright is the piece's
        angle = np.radians(find_way(piece, mesh)[1] - 90)
        across = np.cos(angle) * x + np.sin(angle) * y[:, None]
        up = np.cos(angle) * y[:, None] - np.sin(angle) * x
        rows, columns = (np.floor(way * per_mm).astype(np.int64) for way in (-up, across))
        light = LINEAR_OF_CODE[pixels[rows % pixels.shape[0], columns % pixels.shape[1]]]
        mean = light.reshape(high - low, SAMPLES, right - left, SAMPLES, 3).mean(axis=(1, 3))
        # the canvas' rows count from the top
        canvas[record.n_px - high : record.n_px - low, left:right] = np.round(linear_to_srgb(mean[::-1]) * 255)
    return canvas


def find_way(piece: FlatPiece, mesh: Mesh) -> tuple[str, float]:
    """`up` or, for a piece that lies level, `front`, and that way's angle on the flat piece, degrees."""
    flat = piece.flat_mm
    corners = mesh.vertices[mesh.faces[piece.faces]].astype(np.float64)
    sides = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=1)  # (k, 2 sides, 2)
    # twice the signed area of the flat triangle is the cross product of its sides
    area = (sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
    good = area > 1e-6
    rise = np.stack([corners[good, 1] - corners[good, 0], corners[good, 2] - corners[good, 0]], axis=1)
    # sides · gradient = rise, for height (z) and for the way to the front (x)
    slope = np.linalg.solve(sides[good], rise[:, :, [2, 0]])
    # weighted by area: many small triangles at a rim say no more than the surface that they cover
    mean = np.einsum("k,kij->ij", area[good], slope) / area[good].sum()
    up, front = mean[:, 0], mean[:, 1]
    # up, unless the piece lies nearly level and the way to the front is clearer on it
    word, way = ("up", up) if np.hypot(*up) >= LEVEL or np.hypot(*up) >= np.hypot(*front) else ("front", front)
    return word, float(np.degrees(np.arctan2(way[1], way[0])))
