"""Fonts that every machine has, so that all draw the same letters."""

from functools import lru_cache
from importlib.util import find_spec
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
    """One of `FACES`, from matplotlib's data; matplotlib itself is not loaded."""
    spec = find_spec("matplotlib")
    assert spec is not None and spec.origin is not None
    fonts = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(str(fonts / FACES[face]), size_px)
