"""Fonts that every machine has, so that all draw the same letters."""

from functools import lru_cache
from pathlib import Path

from PIL import ImageFont

FACES = {
    "sans": "DejaVuSans-Bold.ttf",
    "serif": "DejaVuSerif-Bold.ttf",
    "italic": "DejaVuSerif-BoldItalic.ttf",
    "plain": "DejaVuSans.ttf",
    "mono": "DejaVuSansMono-Bold.ttf",
}


@lru_cache(maxsize=256)
def read_font(face: str, size_px: int) -> ImageFont.FreeTypeFont:
    """One of `FACES`, from matplotlib's data."""
    import matplotlib

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / FACES[face]), size_px)
