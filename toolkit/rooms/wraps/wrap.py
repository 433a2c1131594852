"""Wraps: flat pieces that are stuck on an object, their canvas and their folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from toolkit.core.config import FileRecord, Later
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import inside, read_json, sha256_bytes, write_bytes, write_json
from toolkit.core.lazy import shapely
from toolkit.core.text import FileName, Label
from toolkit.core.workspace import PACKAGE_DATA, WRAP_RECORD, Workspace
from toolkit.objects.atlas import split_vertices
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Material as SurfaceMaterial
from toolkit.objects.mesh import Mesh, flat_areas
from toolkit.objects.records import (
    SHA256,
    NetworkRecord,
    decode_png,
    encode_png,
    pack_arrays,
    read_recorded,
    read_usable,
    unpack_arrays,
)
from toolkit.rooms.wraps.config import MOST_PIECES, Material

if TYPE_CHECKING:
    from shapely import Polygon

RECORD_FILE, MAP_FILE = WRAP_RECORD, "pieces.npz"
BLEED_MM = 1.5
MOST_TEXELS = 1024
"""A canvas' side, as for textures."""
PLAIN = 128
"""Grey level of a canvas between its pieces."""
Point = tuple[float, float]


@dataclass(frozen=True)
class FlatPiece:
    """A part of an object's surface, laid flat.

    Attributes:
        faces: (k,) int32, rows of the object's mesh.
        flat_mm: (k, 3, 2) float64 places of the faces' corners on the piece: x right, y up, from (0, 0), seen from
            outside, so that triangles are counter-clockwise. Joined corners have equal coordinates.
        stretch: 95th percentile, weighted by area, of the relative change of edge length on flattening (0.03: 3 %).
    """

    faces: np.ndarray
    flat_mm: np.ndarray
    stretch: float

    @cached_property
    def width_mm(self) -> float:
        """Width of its box, mm."""
        return float(self.flat_mm[..., 0].max())

    @cached_property
    def height_mm(self) -> float:
        """Height of its box, mm."""
        return float(self.flat_mm[..., 1].max())

    @cached_property
    def area_mm2(self) -> float:
        """Area of the flat piece, mm²."""
        return float(flat_areas(self.flat_mm).sum())

    def outline(self) -> "Polygon":
        """Return the outline of the cut in mm, with its holes."""
        return self._outline

    @cached_property
    def _outline(self) -> "Polygon":
        # rounded to a millionth of a millimetre: the same corners have the same bits
        triangles = shapely.polygons(np.round(self.flat_mm[flat_areas(self.flat_mm) > 0], 6))
        whole = shapely.coverage_union_all(triangles)
        if not whole.is_valid or whole.geom_type != "Polygon":
            whole = shapely.unary_union(triangles)
        if whole.geom_type != "Polygon":  # parts that touch at a corner alone: the largest is the piece
            whole = max(shapely.get_parts(whole), key=lambda part: part.area)
        return whole


class SeamRecord(FileRecord):
    """A part of a piece's edge that meets another piece, or the piece itself.

    Attributes:
        piece: number of the other piece.
        letter: letter on both pieces.
        from_mm, to_mm: its ends on this piece, counter-clockwise.
        middle_mm: point of the edge halfway between.
    """

    piece: int = Field(ge=1, le=MOST_PIECES)
    letter: str = Field(max_length=3)
    from_mm: Point
    to_mm: Point
    middle_mm: Point


class TabRecord(FileRecord):
    """A glue tab of a net.

    Attributes:
        piece: number of the piece that it is glued under.
        letter: letter of the seam there; empty if the seam is too short.
        outline_mm: four points; it is folded back at the edge between the first two.
    """

    piece: int = Field(ge=1, le=MOST_PIECES)
    letter: str = Field(max_length=3)
    outline_mm: list[Point] = Field(min_length=4, max_length=4)


class PieceRecord(FileRecord):
    """A piece on the canvas.

    Attributes:
        number: from 1, best first.
        map_index: index in `pieces.npz` if other pieces of the plan were dropped; None: number - 1.
        origin_px: column and row of the canvas, from its lower left, at the corner of the piece's box.
        width_mm, height_mm, area_mm2, stretch: see `FlatPiece`.
        outline_mm: rings of points, the outer ring first.
        seams: seams with other pieces.
        folds_mm: edges that are bent sharply, from and to.
        valleys_mm: folds towards the viewer; the others are mountain folds.
        tabs: tabs of a net, outside the outline and the box.
        png_sha256: hash of its picture.
    """

    number: int = Field(ge=1, le=MOST_PIECES)
    map_index: int | None = Field(None, ge=0, lt=MOST_PIECES)
    origin_px: tuple[int, int]
    width_mm: float = Field(gt=0)
    height_mm: float = Field(gt=0)
    area_mm2: float = Field(gt=0)
    stretch: float = Field(ge=0)
    outline_mm: list[list[Point]] = Field(min_length=1)
    seams: list[SeamRecord] = Field([])
    folds_mm: list[tuple[Point, Point]] = Field([])
    valleys_mm: list[tuple[Point, Point]] = Field([])
    tabs: list[TabRecord] = Field([])
    png_sha256: str = Field(pattern=SHA256)

    @property
    def index(self) -> int:
        """Index in `pieces.npz`."""
        return self.number - 1 if self.map_index is None else self.map_index


class RankedPiece(FileRecord):
    """A piece of the plan, in the order of their gain.

    Attributes:
        number: number in the plan.
        recognised: share of correct views with it and the pieces before it.
        mean_log_prob: mean log-probability of the class in those views.
    """

    number: int = Field(ge=1, le=MOST_PIECES)
    recognised: float = Field(ge=0, le=1)
    mean_log_prob: float


class WrapTraining(FileRecord):
    """Training of the pieces' picture: as `BoosterRecord`, the misfit that was drawn, and the pieces' ranks."""

    class_index: int = Field(ge=0)
    networks: list[NetworkRecord]
    data: dict[str, Any]
    seed: int
    settings: dict[str, Any]
    final: dict[str, float]
    misfit: dict[str, Any]
    ranking: list[RankedPiece] = Field([])
    toolkit_version: str


class PictureRecord(FileRecord):
    """A picture that existed before the wrap.

    Attributes:
        name: name of its file, or of another wrap.
        sha256: hash of the file, or of the wrap's map.
        pattern_mm: length of its longer side if it repeats; None if it is in the object's texture coordinates.
    """

    name: Label
    sha256: str = Field(pattern=SHA256)
    pattern_mm: float | None = None


class WrapRecord(FileRecord):
    """A wrap's plan, and how it was trained.

    Attributes:
        name: name of its folder.
        object: name of the object.
        class_name: class of the training, None before.
        mesh_sha256: `hash_shape` of the object's mesh on the table.
        material: material of the pieces.
        stretch_allowed: largest stretch of each piece.
        covered: share of the surface that random cameras see.
        covered_surface: share of the whole surface.
        texel_mm, n_px: pitch of the canvas, and its side.
        pieces: best first.
        plan: all pieces as they were planned, if some were dropped.
        map_sha256: hash of `pieces.npz`.
        booster: the training, None before.
        picture: a picture that existed before; not written without any.
    """

    schema_version: Literal[1] = 1
    name: FileName
    object: FileName
    class_name: Label | None = None
    mesh_sha256: str = Field(pattern=SHA256)
    material: Material
    stretch_allowed: float = Field(gt=0, le=1)
    covered: float = Field(ge=0, le=1)
    covered_surface: float = Field(ge=0, le=1)
    texel_mm: float = Field(gt=0)
    n_px: int = Field(ge=8, le=MOST_TEXELS)
    pieces: list[PieceRecord] = Field(min_length=1, max_length=MOST_PIECES)
    plan: list[PieceRecord] = Field([], max_length=MOST_PIECES)
    map_sha256: str = Field(pattern=SHA256)
    booster: WrapTraining | None = None
    picture: Annotated[PictureRecord | None, Later()] = None

    @property
    def what_is_on_it(self) -> str | None:
        """Picture of an untrained wrap in words: its picture's name, or the object's own paint; else None."""
        if self.booster is not None:
            return None
        return "the object's own paint" if self.picture is None else self.picture.name

    @model_validator(mode="after")
    def _fits(self) -> "WrapRecord":
        if [piece.number for piece in self.pieces] != list(range(1, len(self.pieces) + 1)):
            raise ValueError("expected pieces numbered from 1 in order")
        for piece in self.pieces:
            left, low, right, high = self.box_px(piece)
            if left < 0 or low < 0 or right > self.n_px or high > self.n_px:
                raise ValueError(f"piece {piece.number} with its bleed leaves the canvas of {self.n_px} texels")
        return self

    @property
    def bleed_px(self) -> int:
        """Texels round each piece."""
        return bleed_texels(self.texel_mm)

    def box_px(self, piece: PieceRecord) -> tuple[int, int, int, int]:
        """First column and row from the lower left, and those behind the last, of a piece with its bleed."""
        (column, row), bleed = piece.origin_px, self.bleed_px
        wide, high = texel_box((piece.width_mm, piece.height_mm), self.texel_mm)
        return column - bleed, row - bleed, column - bleed + wide, row - bleed + high


@dataclass(frozen=True)
class Wrap:
    """A plan of pieces and their picture.

    Attributes:
        record: sizes, places on the canvas, training.
        pieces: best first.
        pixels: (n, n, 3) uint8 sRGB canvas of all pieces, not rotated, row 0 is v = 1; the object's own paint before
            training. None: nothing was drawn yet.
    """

    record: WrapRecord
    pieces: tuple[FlatPiece, ...]
    pixels: np.ndarray | None = None

    def corner_uv(self, faces_count: int) -> np.ndarray:
        """(m, 3, 2) float32 places of the corners of all faces of the mesh on the canvas, NaN off the pieces."""
        record = self.record
        uv = np.full((faces_count, 3, 2), np.nan, np.float32)
        for piece, at in zip(self.pieces, record.pieces, strict=True):
            uv[piece.faces] = (np.array(at.origin_px) + piece.flat_mm / record.texel_mm) / record.n_px
        return uv

    def picture(self, index: int) -> np.ndarray:
        """(h, w, 3) uint8 picture of piece `index`, from 0, with its bleed; a texel is `texel_mm`."""
        if self.pixels is None:
            raise ToolkitError(f"wrap '{self.record.name}' has no picture yet: train it with 'toolkit train-wrap'")
        return self.pixels[_rows_columns(self.record, self.record.pieces[index])]


def choose_pieces(wrap: Wrap, numbers: Sequence[int], covered: tuple[float, float]) -> Wrap:
    """Return a wrap of the pieces with these numbers, best first, without seams to the others.

    `covered` is the share of the surface that cameras see, and of the whole surface, that they cover.
    """
    new = {number: place for place, number in enumerate(numbers, 1)}
    records = []
    for number in numbers:
        piece = wrap.record.pieces[number - 1]
        seams = [seam.model_copy(update={"piece": new[seam.piece]}) for seam in piece.seams if seam.piece in new]
        changed = {"number": new[number], "seams": seams, "map_index": piece.index}
        records.append(piece.model_copy(update=changed))
    changes = {"pieces": records, "plan": wrap.record.pieces, "covered": covered[0], "covered_surface": covered[1]}
    return replace(
        wrap, record=wrap.record.model_copy(update=changes), pieces=tuple(wrap.pieces[number - 1] for number in numbers)
    )


def dress_mesh(mesh: Mesh, wrap: Wrap, canvas: np.ndarray) -> Mesh:
    """Put a canvas, (n, n, 3) uint8 sRGB of any size, row 0 is v = 1, on the pieces of the wrap of a mesh."""
    corner_uv = wrap.corner_uv(len(mesh.faces))
    on_pieces = np.isfinite(corner_uv).all(axis=(1, 2))
    corner_uv[~on_pieces] = mesh.uv[mesh.faces[~on_pieces]]
    split = split_vertices(mesh, corner_uv)
    material = np.where(on_pieces, len(mesh.materials), mesh.face_material).astype(np.int32)
    # without the object's gloss, as a printed sheet
    return replace(split, face_material=material, materials=(*mesh.materials, SurfaceMaterial("wrap", canvas)))


def bleed_texels(texel_mm: float) -> int:
    """Return the texels round a piece that are printed beyond its cut: `BLEED_MM`, and the reach of filters."""
    return max(2, int(np.ceil(BLEED_MM / texel_mm - 1e-9)))


def texel_box(size_mm: Point, texel_mm: float) -> tuple[int, int]:
    """Texels across and up of a piece with its bleed."""
    wide, high = (int(np.ceil(side / texel_mm - 1e-9)) + 2 * bleed_texels(texel_mm) for side in size_mm)
    return wide, high


def _rows_columns(record: WrapRecord, piece: PieceRecord) -> tuple[slice, slice]:
    left, low, right, high = record.box_px(piece)
    return slice(record.n_px - high, record.n_px - low), slice(left, right)


def lay_out(sizes_mm: Sequence[Point], texel_mm: float) -> tuple[int, list[tuple[int, int]]]:
    """Return the side of the smallest square canvas for pieces, not rotated, in texels, and the corner of each.

    Returns:
        The side, and column and row from the lower left for each.

    Raises:
        FieldError: they need more than `MOST_TEXELS`.
    """
    import rectpack

    boxes = [texel_box(size, texel_mm) for size in sizes_mm]
    # no square can be smaller than the widest piece, or than all areas together
    side = max(8, *(max(box) for box in boxes), int(np.sqrt(sum(wide * high for wide, high in boxes))))
    bleed = bleed_texels(texel_mm)
    while side <= MOST_TEXELS:
        packer = rectpack.newPacker(rotation=False)
        for number, (wide, high) in enumerate(boxes):
            packer.add_rect(wide, high, rid=number)
        packer.add_bin(side, side)
        packer.pack()
        placed = {number: (int(x) + bleed, int(y) + bleed) for _, x, y, _, _, number in packer.rect_list()}
        if len(placed) == len(boxes):
            return side, [placed[number] for number in range(len(boxes))]
        # 2 % more each time: the smallest canvas to 2 %
        side += max(1, side // 50)
    raise FieldError(
        f"pieces of {texel_mm:g} mm a texel need a canvas of more than {MOST_TEXELS} texels: "
        "take a larger {texel_mm}, or fewer {pieces}",
        {},
    )


def fits_canvas(sizes_mm: Sequence[Point], texel_mm: float) -> bool:
    """Whether pieces lie on a canvas at this size of texel; see `lay_out`."""
    try:
        lay_out(sizes_mm, texel_mm)
    except FieldError:
        return False
    return True


def write_wrap(folder: Path, wrap: Wrap) -> Wrap:
    """Write a wrap's folder, and last its record: `read_wrap` reports a crash before that.

    Args:
        folder: `print/wraps/NAME` of a workspace.
        wrap: a wrap with pixels; its hashes are replaced. The map of a wrap that had more pieces stays.

    Returns:
        The wrap, as from `read_wrap`.
    """
    folder, record = Path(folder), wrap.record
    is_part = any(piece.map_index is not None for piece in record.pieces)
    table = (folder / MAP_FILE).read_bytes() if is_part else pack_arrays({
        "faces": np.concatenate([piece.faces for piece in wrap.pieces]).astype(np.int32),
        "flat_mm": np.concatenate([piece.flat_mm for piece in wrap.pieces]).astype(np.float64),
        "piece": np.repeat(np.arange(len(wrap.pieces), dtype=np.int32), [len(piece.faces) for piece in wrap.pieces]),
    })  # fmt: skip
    pictures = [encode_png(wrap.picture(i)) for i in range(len(wrap.pieces))]
    hashes = [{"png_sha256": sha256_bytes(png)} for png in pictures]
    pieces = [piece.model_copy(update=new) for piece, new in zip(record.pieces, hashes, strict=True)]
    full = record.model_copy(update={"pieces": pieces, "map_sha256": sha256_bytes(table)})
    if not is_part:
        write_bytes(folder / MAP_FILE, table)
    for piece, png in zip(pieces, pictures, strict=True):
        write_bytes(folder / piece_name(piece.number), png)
    write_json(folder / RECORD_FILE, full.model_dump(mode="json"))
    return Wrap(full, wrap.pieces, _put_together(full, [wrap.picture(i) for i in range(len(wrap.pieces))]))


def read_wrap(folder: Path, *, with_pixels: bool = True, whole_plan: bool = False) -> Wrap:
    """Read a wrap, each file checked against its record.

    Args:
        folder: `print/wraps/NAME` of a workspace.
        with_pixels: read the pictures of the pieces.
        whole_plan: return all planned pieces, without pictures.

    Raises:
        ToolkitError: a file is missing, broken, outside the folder, or another than was recorded.
    """
    folder = Path(folder)
    if not (folder / RECORD_FILE).is_file():
        raise ToolkitError(f"{folder} is no wrap (it has no {RECORD_FILE}): make one with 'toolkit wrap --object NAME'")
    record = read_json(folder / RECORD_FILE, WrapRecord)
    if whole_plan and record.plan:
        record = record.model_copy(update={"pieces": record.plan, "plan": []})
    file = inside(folder, MAP_FILE)
    content = read_recorded(file, record.map_sha256, "map of pieces")
    # the map first: it assigns faces to pieces, and the record's measures must follow from it
    faces, flat_mm, piece = unpack_arrays(content, file, ["faces", "flat_mm", "piece"], "map of pieces")
    _check_map(file, record, faces, flat_mm=flat_mm, piece=piece)
    pieces = []
    for at in record.pieces:
        own = piece == at.index
        pieces.append(FlatPiece(faces[own].astype(np.int32), flat_mm[own].astype(np.float64), at.stretch))
        width, height = pieces[-1].width_mm, pieces[-1].height_mm
        if abs(width - at.width_mm) > 0.01 or abs(height - at.height_mm) > 0.01:
            raise ToolkitError(
                f"{file}: piece {at.number} is {width:.2f} × {height:.2f} mm, in its record {at.width_mm:.2f} × "
                f"{at.height_mm:.2f}: make the wrap again"
            )
    if not with_pixels or whole_plan:
        return Wrap(record, tuple(pieces))
    # each piece's picture by its hash and size, then joined to the canvas
    pictures = []
    for at in record.pieces:
        png = inside(folder, piece_name(at.number))
        picture = decode_png(read_recorded(png, at.png_sha256), png)
        wide, high = texel_box((at.width_mm, at.height_mm), record.texel_mm)
        if picture.shape != (high, wide, 3):
            raise ToolkitError(f"{png}: expected {wide}×{high} px, found {picture.shape[1]}×{picture.shape[0]}")
        pictures.append(picture)
    return Wrap(record, tuple(pieces), _put_together(record, pictures))


def find_wrap(workspace: Workspace, item: TableObject) -> Wrap:
    """Read the wrap of an object, see `wrap_folder`.

    Raises:
        ToolkitError: there is none, it is broken, or it is of another mesh.
    """
    folder = wrap_folder(workspace, item)
    if folder is None:
        raise ToolkitError(f"no wrap is for '{item.name}': make one with 'toolkit wrap --object {item.name}'")
    wrap = read_wrap(folder)
    check_wrap(wrap, item)
    return wrap


def wrap_folder(workspace: Workspace, item: TableObject) -> Path | None:
    """Return the folder of an object's wrap: that of its name, else the first whose record names it, if any.

    A shipped wrap must fit, as a user's object may have a shipped object's name. Broken wraps of other names are left
    out, see `read_usable`.
    """
    known = dict(sorted(workspace.wraps().items()))
    for name, record in read_usable(lambda folder: read_json(folder / RECORD_FILE, WrapRecord), known, item.name):
        is_own = not known[name].is_relative_to(PACKAGE_DATA)
        if record.object == item.name and (is_own or item.has_shape(record.mesh_sha256)):
            return known[name]
    return None


def hash_wrap(record: WrapRecord) -> str:
    """SHA-256 of the hashes of all pictures of a wrap."""
    return sha256_bytes("".join(piece.png_sha256 for piece in record.pieces).encode())


def check_wrap(wrap: Wrap, item: TableObject) -> None:
    """Raise a `ToolkitError` if a wrap is of another mesh than an object's."""
    faces = max(int(piece.faces.max()) for piece in wrap.pieces)
    if not item.has_shape(wrap.record.mesh_sha256) or faces >= len(item.mesh.faces):
        raise ToolkitError(
            f"wrap '{wrap.record.name}' was made for another mesh or size of '{item.name}': "
            f"make it again with 'toolkit wrap --object {item.name}'"
        )


def piece_name(number: int) -> str:
    """File name of a piece's picture."""
    return f"{number:02}.png"


def _put_together(record: WrapRecord, pictures: Sequence[np.ndarray]) -> np.ndarray:
    canvas = np.full((record.n_px, record.n_px, 3), PLAIN, np.uint8)
    for piece, picture in zip(record.pieces, pictures, strict=True):
        canvas[_rows_columns(record, piece)] = picture
    return canvas


def _check_map(file: Path, record: WrapRecord, faces: np.ndarray, flat_mm: np.ndarray, piece: np.ndarray) -> None:
    count = len(faces) if faces.ndim == 1 else -1
    shapes: Mapping[str, tuple[np.ndarray, tuple[int, ...], str]] = {
        "faces": (faces, (count,), "iu"), "flat_mm": (flat_mm, (count, 3, 2), "f"), "piece": (piece, (count,), "iu"),
    }  # fmt: skip
    for name, (array, shape, kind) in shapes.items():
        if array.shape != shape or array.dtype.kind not in kind:
            raise ToolkitError(f"{file}: '{name}' is {array.dtype} of shape {array.shape}: make the wrap again")
    numbers = [at.index for at in record.pieces]
    there = np.unique(piece)
    is_part = any(at.map_index is not None for at in record.pieces)
    fits = np.isin(numbers, there).all() if is_part else np.array_equal(there, numbers)
    if len(set(numbers)) < len(numbers) or not fits:
        raise ToolkitError(f"{file}: its pieces are not the {len(numbers)} of {RECORD_FILE}: make the wrap again")
    if faces.min() < 0 or len(np.unique(faces)) < count:
        raise ToolkitError(f"{file}: a face is negative, or on two pieces: make the wrap again")
    if not np.isfinite(flat_mm).all() or flat_mm.min() < -1e-6:
        raise ToolkitError(f"{file}: places on a piece that are negative, NaN or infinite: make the wrap again")
