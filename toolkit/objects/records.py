"""Files of patches and textures: a picture, and a record beside it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, TypeVar
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo
from zlib import error as ZlibError

import numpy as np
from pydantic import Field, field_validator, model_validator

from toolkit.core.config import FileRecord, Later
from toolkit.core.console import notice_once
from toolkit.core.errors import ToolkitError
from toolkit.core.files import inside, read_bytes, read_json, sha256_bytes, write_bytes, write_json
from toolkit.core.text import FileName, Label
from toolkit.imaging.read import UnreadableImage, encode_image, open_image
from toolkit.objects.spec import Margin, printed_size_mm

SHA256 = r"^[0-9a-f]{64}$"
MOST_RECORDED_BYTES = 1 << 30


class NetworkRecord(FileRecord):
    """A network, exactly.

    Attributes:
        arch: its architecture.
        weights, sha256: name and hash of its weights' file.
        tensors_sha256: of its numbers, which stay the same if they are saved again; None, and not written, of older
            records and of programs.
    """

    arch: str
    weights: str
    sha256: str
    tensors_sha256: Annotated[str | None, Later()] = None


class BoosterRecord(FileRecord):
    """The training of a picture.

    Attributes:
        name: file name without suffix.
        class_name, class_index: class of the training, in the networks' own labels.
        n_px: side in pixels.
        png_sha256: hash of the PNG file beside the record.
        networks: classifiers of the training.
        data: training data in words, with the number of images.
        seed: seed of every random draw.
        settings: all training settings.
        final: mean loss and accuracy of the last steps.
        toolkit_version: version of the program that trained it.
    """

    schema_version: int = 1
    name: str
    class_name: Label
    class_index: int = Field(ge=0)
    n_px: int = Field(gt=0)
    png_sha256: str = Field(pattern=SHA256)
    networks: list[NetworkRecord]
    data: dict[str, Any]
    seed: int
    settings: dict[str, Any]
    final: dict[str, float]
    toolkit_version: str


Record = TypeVar("Record", bound=BoosterRecord)
Read = TypeVar("Read")


def encode_png(pixels: np.ndarray) -> bytes:
    """PNG bytes of (h, w, 3) uint8 sRGB pixels, or of (h, w) uint8 grey ones."""
    return encode_image(pixels, "PNG", optimize=True)


def decode_png(content: bytes, file: Path, mode: str = "RGB") -> np.ndarray:
    """Decode a PNG, (h, w, 3) uint8, or (h, w) with mode `L`; errors name `file`."""
    try:
        with open_image(file, content) as image:
            return np.asarray(image.convert(mode))
    except UnreadableImage as error:
        raise ToolkitError(f"{file}: not a readable PNG: {error.reason}") from None


def read_recorded(file: Path, sha256: str, what: str = "picture") -> bytes:
    """Read a file whose hash is in a record.

    Raises:
        ToolkitError: it cannot be read, or its hash differs.
    """
    content = read_bytes(file, MOST_RECORDED_BYTES)
    found = sha256_bytes(content)
    if found != sha256:
        raise ToolkitError(
            f"{file}: its hash {found[:12]} does not match the record's {sha256[:12]}: the {what} was "
            "changed after training; restore the pair, or train again"
        )
    return content


def read_picture(png_file: Path, model: type[Record], command: str) -> tuple[np.ndarray, Record]:
    """Read a square picture and its record, checked against each other; `command` makes them.

    Returns:
        (n, n, 3) uint8 sRGB pixels, and the record.

    Raises:
        ToolkitError: either file is missing or broken, the PNG is not square, or the record is of other pixels.
    """
    record_file = png_file.with_suffix(".json")
    if not record_file.is_file():
        raise ToolkitError(f"{png_file} has no record {record_file.name} beside it: train it with '{command}'")
    record = read_json(record_file, model)
    pixels = decode_png(read_recorded(png_file, record.png_sha256), png_file)
    if pixels.shape != (record.n_px, record.n_px, 3):
        raise ToolkitError(
            f"{png_file}: expected {record.n_px}×{record.n_px} px as recorded, "
            f"found {pixels.shape[1]}×{pixels.shape[0]}"
        )
    return pixels, record


TAPE_MARGIN_MM = 5.0
"""Paper around a patch for the tape."""


def mirror(n_px: int, margin_px: int) -> np.ndarray:
    """(n + 2 margin) rows or columns of a picture that goes on over a margin, mirrored at its edges."""
    return np.pad(np.arange(n_px), margin_px, mode="symmetric")


class PatchRecord(BoosterRecord):
    """Record of a patch: the fields of `BoosterRecord` and its paper.

    Attributes:
        size_mm: side of the patch at the default scale.
        margin: what is on the paper around it; not written if it is white.
    """

    size_mm: float = Field(gt=0)
    margin: Annotated[Margin, Later()] = "white"


@dataclass(frozen=True)
class Patch:
    """Pixels (n, n, 3) uint8, sRGB-encoded, and their record."""

    pixels: np.ndarray
    record: PatchRecord

    @property
    def size_mm(self) -> float:
        """Side on paper at the default scale."""
        return self.record.size_mm


def write_patch(folder: Path, pixels: np.ndarray, record: dict[str, Any]) -> Patch:
    """Write PNG and record; `record` holds the fields of `PatchRecord` except n_px and png_sha256.

    `size_mm` may be left out: it is the default size on paper then.

    The PNG is renamed into place first: a crash between the two leaves a mismatch that `read_patch` reports.
    """
    png = encode_png(pixels)
    n_px = pixels.shape[0]
    sized = {"size_mm": round(printed_size_mm(n_px), 3), **record}
    full = PatchRecord(n_px=n_px, png_sha256=sha256_bytes(png), **sized)
    write_bytes(folder / f"{full.name}.png", png, folder)
    write_json(folder / f"{full.name}.json", full.model_dump(), folder)
    return Patch(pixels, full)


def read_patch(png_file: Path) -> Patch:
    """Read a patch and check it against its record.

    Raises:
        ToolkitError: either file is missing or broken, the PNG is not square, or the record is of other pixels.

    Example:
        >>> patch = tk.read_patch(tk.make_workspace(Path("space")).patches()["racer"])
        >>> patch.pixels.shape, patch.record.class_name, round(patch.size_mm)
        ((100, 100, 3), 'racer', 88)
    """
    return Patch(*read_picture(Path(png_file), PatchRecord, "toolkit train-patch"))


def read_usable(
    read: Callable[[Path], Read], known: Mapping[str, Path], own: str | None = None
) -> Iterator[tuple[str, Read]]:
    """Read the file of each name, in their order, `own` first; a notice, once in a process, names broken files.

    Raises:
        ToolkitError: `own` is broken.
    """
    for name in sorted(known, key=lambda name: name != own):
        try:
            made = read(known[name])
        except ToolkitError as error:
            if name == own:
                raise
            notice_once(f"left out: {error}")
        else:
            yield name, made


COMMAND = "toolkit train-texture"
UV_MEMBER = "corner_uv"
MAX_ARRAY_BYTES = 1 << 29
"""More than 20 million triangles."""
KEEP_LEVEL = 128


class TexturedObjectRecord(FileRecord):
    """An object that a texture was trained on.

    Attributes:
        name: name of the object.
        mesh_sha256: `hash_shape` of its mesh on the table.
        unwrapped: whether its texture coordinates were made for the texture, and are stored; else they are its own.
        keep: names of the materials that keep their paint.
        keep_image_sha256: hash of the PNG with other places that keep their paint, if any.
        uv_sha256: hash of the stored coordinates, if any.
        glb_sha256: hash of the exported object with the texture, if any. Not checked: other programs may save it again.
    """

    name: FileName
    mesh_sha256: str = Field(pattern=SHA256)
    unwrapped: bool = False
    keep: list[str] = Field([])
    keep_image_sha256: str | None = Field(None, pattern=SHA256)
    uv_sha256: str | None = Field(None, pattern=SHA256)
    glb_sha256: str | None = Field(None, pattern=SHA256)

    @model_validator(mode="after")
    def _has_coordinates(self) -> "TexturedObjectRecord":
        if self.unwrapped != (self.uv_sha256 is not None):
            raise ValueError("expected uv_sha256 where unwrapped is true, and there alone")
        return self


class TextureRecord(BoosterRecord):
    """The training of a texture, and its objects."""

    name: FileName
    objects: list[TexturedObjectRecord] = Field(min_length=1)

    @field_validator("objects")
    @classmethod
    def _once_each(cls, objects: list[TexturedObjectRecord]) -> list[TexturedObjectRecord]:
        if len({item.name for item in objects}) < len(objects):
            raise ValueError("expected each object once")
        return objects

    def entry(self, name: str) -> TexturedObjectRecord | None:
        """Return the record of an object; None if the texture is not for it."""
        return next((item for item in self.objects if item.name == name), None)


@dataclass(frozen=True)
class Texture:
    """A texture.

    Attributes:
        pixels: (n, n, 3) uint8, sRGB-encoded; row 0 is v = 1.
        record: its training.
        corner_uv: by object, (m, 3, 2) float32 texture coordinates of each triangle's corners, where they are stored.
        keep_images: by object, (h, w) bool in the mesh's own texture coordinates, true where its paint is kept.
    """

    pixels: np.ndarray
    record: TextureRecord
    corner_uv: Mapping[str, np.ndarray] = field(default_factory=dict)
    keep_images: Mapping[str, np.ndarray] = field(default_factory=dict)


def glb_name(texture: str, item: str) -> str:
    """File name of an object that wears a texture."""
    return f"{texture}.glb" if texture == item else f"{texture}-{item}.glb"


def uv_name(texture: str, item: str) -> str:
    """File name of an object's stored texture coordinates."""
    return f"{texture}-{item}.uv.npz"


def keep_name(texture: str, item: str) -> str:
    """File name of the mask of what keeps its paint."""
    return f"{texture}-{item}.keep.png"


def write_texture(
    folder: Path, pixels: np.ndarray, record: dict[str, Any], corner_uv: Mapping[str, np.ndarray] | None = None,
    keep_images: Mapping[str, np.ndarray] | None = None, glbs: Mapping[str, bytes] | None = None,
) -> Texture:  # fmt: skip
    """Write a texture, the files of its objects, and last its record: `read_texture` reports a crash before that.

    Args:
        folder: `rig/textures` of a workspace.
        pixels: (n, n, 3) uint8 sRGB.
        record: the fields of `TextureRecord` without n_px and png_sha256; `objects` lists dicts of
            `TexturedObjectRecord` without `unwrapped` and the hashes, which follow from the arguments below.
        corner_uv: by object, (m, 3, 2), for objects that were unwrapped.
        keep_images: by object, (h, w) bool, true keeps the paint.
        glbs: by object, the file to export.
    """
    corner_uv, keep_images, glbs = corner_uv or {}, keep_images or {}, glbs or {}
    uv = {name: np.asarray(array, np.float32) for name, array in corner_uv.items()}
    masks = {name: np.asarray(array, bool) for name, array in keep_images.items()}
    # everything is encoded first, since the record holds the hashes
    coordinates = {name: pack_arrays({UV_MEMBER: array}) for name, array in uv.items()}
    kept = {name: encode_png(np.where(mask, np.uint8(255), np.uint8(0))) for name, mask in masks.items()}
    png = encode_png(pixels)
    objects = [
        item | {
            "unwrapped": item["name"] in coordinates, "uv_sha256": _hash(coordinates, item["name"]),
            "keep_image_sha256": _hash(kept, item["name"]), "glb_sha256": _hash(glbs, item["name"]),
        }
        for item in record["objects"]
    ]  # fmt: skip
    fields = record | {"objects": objects, "n_px": pixels.shape[0], "png_sha256": sha256_bytes(png)}
    full = TextureRecord.model_validate(fields)
    folder = Path(folder)
    # the picture and then its record come last: until then the texture is not there, rather than broken
    for named, contents in ((uv_name, coordinates), (keep_name, kept), (glb_name, glbs)):
        for name, content in contents.items():
            write_bytes(folder / named(full.name, name), content)
    write_bytes(folder / f"{full.name}.png", png)
    write_json(folder / f"{full.name}.json", full.model_dump())
    return Texture(pixels, full, uv, masks)


def read_texture(png_file: Path) -> Texture:
    """Read a texture and the files of its objects, each checked against the record.

    Raises:
        ToolkitError: a file is missing, broken, outside the folder, or another than was recorded.

    Example:
        >>> texture = tk.read_texture(tk.make_workspace(Path("space")).textures()["racer"])
        >>> texture.pixels.shape, [item.name for item in texture.record.objects]
        ((200, 200, 3), ['racer'])
    """
    png_file = Path(png_file)
    pixels, record = read_picture(png_file, TextureRecord, COMMAND)
    corner_uv, keep_images = {}, {}
    for item in record.objects:
        if item.uv_sha256 is not None:
            file = inside(png_file.parent, uv_name(png_file.stem, item.name))
            corner_uv[item.name] = _unpack_uv(read_recorded(file, item.uv_sha256, "table"), file)
        if item.keep_image_sha256 is not None:
            file = inside(png_file.parent, keep_name(png_file.stem, item.name))
            mask = decode_png(read_recorded(file, item.keep_image_sha256), file, "L")
            keep_images[item.name] = mask >= KEEP_LEVEL
    return Texture(pixels, record, corner_uv, keep_images)


def _hash(contents: Mapping[str, bytes], name: str) -> str | None:
    return sha256_bytes(contents[name]) if name in contents else None


def pack_arrays(arrays: Mapping[str, np.ndarray]) -> bytes:
    """An .npz file of named arrays; `np.savez_compressed` would write the time of day into it."""
    packed = BytesIO()
    with ZipFile(packed, "w", ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            member = BytesIO()
            np.save(member, array, allow_pickle=False)
            archive.writestr(ZipInfo(f"{name}.npy"), member.getvalue(), ZIP_DEFLATED)
    return packed.getvalue()


def unpack_arrays(content: bytes, file: Path, names: Sequence[str], what: str) -> list[np.ndarray]:
    """Read the arrays of these names from an .npz file.

    Raises:
        ToolkitError: it is no such file, or unpacks to more than is meant; names `file` and `what` it should be.
    """
    try:
        with ZipFile(BytesIO(content)) as archive:
            # sizes are checked before anything is unpacked
            members = [archive.getinfo(f"{name}.npy") for name in names]
            for member in members:
                if member.file_size > MAX_ARRAY_BYTES or member.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
                    raise ValueError(f"unpacks to {member.file_size >> 20} MiB, or is packed in an unknown way")
            return [np.load(BytesIO(archive.read(member)), allow_pickle=False) for member in members]
    # what NumPy, zipfile and zlib raise on damaged or hostile bytes
    except (ValueError, KeyError, OSError, EOFError, MemoryError, BadZipFile, ZlibError, RuntimeError) as error:
        why = " ".join(str(error).split())[:100]
        raise ToolkitError(f"{file}: no readable {what} ({why}): train again") from None


def _unpack_uv(content: bytes, file: Path) -> np.ndarray:
    [corner_uv] = unpack_arrays(content, file, [UV_MEMBER], "table of texture coordinates")
    shape = getattr(corner_uv, "shape", ())
    if len(shape) != 3 or shape[1:] != (3, 2) or corner_uv.dtype.kind != "f":
        raise ToolkitError(
            f"{file}: expected floats (triangles, 3, 2), found {getattr(corner_uv, 'dtype', type(corner_uv).__name__)} "
            f"{shape}: train again"
        )
    # faces that keep their paint keep their own coordinates, which may lie anywhere
    if not np.isfinite(corner_uv).all():
        raise ToolkitError(f"{file}: expected finite texture coordinates, found NaN or infinity: train again")
    return corner_uv.astype(np.float32, copy=False)
