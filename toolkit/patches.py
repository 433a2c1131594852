"""A patch and its record: `print/patches/NAME.png` and `NAME.json`, the two files that travel together."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from toolkit.files import sha256_bytes, write_bytes, write_json
from toolkit.recorded import BoosterRecord, encode_png, read_picture

BASE_DPI = 72.0
SCALE = 2.5
"""The paper prints at 250 %; it names no resolution, 72 dpi is the PDF's own unit."""
MM_PER_INCH = 25.4
TAPE_MARGIN_MM = 5.0
"""White paper that is left around a patch for the tape."""


def printed_size_mm(n_px: int, dpi: float = BASE_DPI, scale: float = SCALE) -> float:
    """Side of an n-pixel patch on paper, millimetres."""
    return n_px / dpi * scale * MM_PER_INCH


class PatchRecord(BoosterRecord):
    """How a patch came to be: the fields of `BoosterRecord` and its side on paper at the default scale, millimetres."""

    size_mm: float = Field(gt=0)


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
    return Patch(*read_picture(Path(png_file), PatchRecord, "toolkit train-patch"))
