"""How large a patch comes out of the printer."""

BASE_DPI = 72.0
SCALE = 2.5
"""The paper prints at 250 %; it names no resolution, 72 dpi is the PDF's own unit."""
MM_PER_INCH = 25.4


def printed_size_mm(n_px: int, dpi: float = BASE_DPI, scale: float = SCALE) -> float:
    """Side of an n-pixel patch on paper, millimetres."""
    return n_px / dpi * scale * MM_PER_INCH
