"""What patches and textures share: square pictures with a record beside them, each checked against the other."""

from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field

from toolkit.errors import ToolkitError
from toolkit.files import read_json, sha256_bytes

SHA256 = r"^[0-9a-f]{64}$"


class Network(BaseModel):
    """A classifier, exactly: its architecture and the SHA-256 of its weights' file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    arch: str
    weights: str
    sha256: str


class BoosterRecord(BaseModel):
    """How a trained picture came to be.

    Attributes:
        name: file name without suffix.
        class_name, class_index: the category it was trained for, in the networks' own labels.
        n_px: side in pixels.
        png_sha256: of the PNG file beside the record.
        networks: the classifiers it was trained on.
        data: what was trained on, in words, with the number of images.
        seed: of every random draw.
        settings: every hyper-parameter.
        final: the end of the loss history: last steps' mean loss and accuracy.
        toolkit_version: of the program that trained it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: int = 1
    name: str
    class_name: str
    class_index: int = Field(ge=0)
    n_px: int = Field(gt=0)
    png_sha256: str = Field(pattern=SHA256)
    networks: list[Network]
    data: dict[str, Any]
    seed: int
    settings: dict[str, Any]
    final: dict[str, float]
    toolkit_version: str


Record = TypeVar("Record", bound=BoosterRecord)


def encode_png(pixels: np.ndarray) -> bytes:
    """PNG bytes of (h, w, 3) uint8 sRGB pixels, or of (h, w) uint8 grey ones."""
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def decode_png(content: bytes, file: Path, mode: str = "RGB") -> np.ndarray:
    """Pixels of a PNG, (h, w, 3) uint8, or (h, w) with mode `L`; `file` is named where it cannot be decoded."""
    try:
        return np.asarray(Image.open(BytesIO(content)).convert(mode))
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:  # Pillow's word for a broken chunk is syntax
        raise ToolkitError(f"{file}: not a readable PNG: {error}") from None


def read_recorded(file: Path, sha256: str, what: str = "picture") -> bytes:
    """The bytes of a file whose hash is in a record.

    Raises:
        ToolkitError: it cannot be read, or is not the one that was recorded.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise ToolkitError(f"cannot read {file}: {error}") from None
    found = sha256_bytes(content)
    if found != sha256:
        raise ToolkitError(
            f"{file}: its hash {found[:12]} does not match the record's {sha256[:12]}: the {what} was "
            "changed after training; restore the pair, or train again"
        )
    return content


def read_picture(png_file: Path, model: type[Record], command: str) -> tuple[np.ndarray, Record]:
    """A square picture and its record, checked against each other; `command` makes them.

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
