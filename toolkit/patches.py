"""A patch and its record: `print/patches/NAME.png` and `NAME.json`, the two files that travel together."""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field

from toolkit.errors import ToolkitError
from toolkit.files import read_json, sha256_bytes, write_bytes, write_json

BASE_DPI = 72.0
SCALE = 2.5
"""The paper prints at 250 %; it names no resolution, 72 dpi is the PDF's own unit."""
MM_PER_INCH = 25.4
TAPE_MARGIN_MM = 5.0
"""White paper that is left around a patch for the tape."""


def printed_size_mm(n_px: int, dpi: float = BASE_DPI, scale: float = SCALE) -> float:
    """Side of an n-pixel patch on paper, millimetres."""
    return n_px / dpi * scale * MM_PER_INCH


class Network(BaseModel):
    """A classifier, exactly: its architecture and the SHA-256 of its weights' file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    arch: str
    weights: str
    sha256: str


class PatchRecord(BaseModel):
    """How a patch came to be.

    Attributes:
        name: file name without suffix.
        class_name, class_index: the category it was trained for, in the networks' own labels.
        n_px: side in pixels.
        size_mm: side on paper at the default scale, millimetres.
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
    size_mm: float = Field(gt=0)
    png_sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    networks: list[Network]
    data: dict[str, Any]
    seed: int
    settings: dict[str, Any]
    final: dict[str, float]
    toolkit_version: str


@dataclass(frozen=True)
class Patch:
    """Pixels (n, n, 3) uint8, sRGB-encoded, and their record."""

    pixels: np.ndarray
    record: PatchRecord

    @property
    def size_mm(self) -> float:
        """Side on paper at the default scale."""
        return self.record.size_mm


def encode_png(pixels: np.ndarray) -> bytes:
    """PNG bytes of (h, w, 3) uint8 sRGB pixels."""
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def write_patch(folder: Path, pixels: np.ndarray, record: dict[str, Any]) -> Patch:
    """Write PNG and record; `record` holds the fields of `PatchRecord` except n_px, size_mm and png_sha256.

    The PNG is renamed into place first: a crash between the two leaves a mismatch that `read_patch` reports.
    """
    png = encode_png(pixels)
    n_px = pixels.shape[0]
    full = PatchRecord(n_px=n_px, size_mm=round(printed_size_mm(n_px), 3), png_sha256=sha256_bytes(png), **record)
    write_bytes(folder / f"{full.name}.png", png)
    write_json(folder / f"{full.name}.json", full.model_dump())
    return Patch(pixels, full)


def read_patch(png_file: Path) -> Patch:
    """Read a patch and check it against its record.

    Raises:
        ToolkitError: either file is missing or broken, the PNG is not square, or the record is of other pixels.
    """
    png_file = Path(png_file)
    record_file = png_file.with_suffix(".json")
    if not record_file.is_file():
        raise ToolkitError(
            f"{png_file} has no record {record_file.name} beside it: train it with 'toolkit train-patch'"
        )
    record = read_json(record_file, PatchRecord)
    try:
        content = png_file.read_bytes()
    except OSError as error:
        raise ToolkitError(f"cannot read {png_file}: {error}") from None
    found = sha256_bytes(content)
    if found != record.png_sha256:
        raise ToolkitError(
            f"{png_file}: its hash {found[:12]} does not match the record's {record.png_sha256[:12]}: the picture was "
            "changed after training; restore the pair, or train again"
        )
    try:
        pixels = np.asarray(Image.open(BytesIO(content)).convert("RGB"))
    except (OSError, Image.DecompressionBombError) as error:
        raise ToolkitError(f"{png_file}: not a readable PNG: {error}") from None
    if pixels.shape != (record.n_px, record.n_px, 3):
        raise ToolkitError(
            f"{png_file}: expected {record.n_px}×{record.n_px} px as recorded, "
            f"found {pixels.shape[1]}×{pixels.shape[0]}"
        )
    return Patch(pixels, record)
