"""Figures without a window, as PNG with the same bytes for the same picture, and matplotlib's fonts."""

from collections.abc import Callable
from functools import lru_cache, wraps
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from PIL import ImageFont

from toolkit.imaging.style import RC

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FACES = {
    "sans": "DejaVuSans-Bold.ttf",
    "serif": "DejaVuSerif-Bold.ttf",
    "italic": "DejaVuSerif-BoldItalic.ttf",
    "plain": "DejaVuSans.ttf",
    "mono": "DejaVuSansMono-Bold.ttf",
}
DPI = 144
P = ParamSpec("P")
R = TypeVar("R")


def font_file(face: str) -> Path:
    """Return the file of a font of `FACES` in matplotlib's data; matplotlib itself is not loaded."""
    spec = find_spec("matplotlib")
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / FACES[face]


@lru_cache(maxsize=256)
def read_font(face: str, size_px: int) -> ImageFont.FreeTypeFont:
    """Return a font of `FACES`."""
    return ImageFont.truetype(str(font_file(face)), size_px)


def with_default_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Let a function draw in the toolkit's style over matplotlib's own defaults, as each that calls `make_figure` must.

    A `matplotlibrc` of the current folder, which may come from anybody, could otherwise switch on LaTeX and so start a
    program. The user's own settings are as before afterwards.
    """

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        import matplotlib

        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(RC)
            return draw(*args, **kwargs)

    return drawn


def make_figure(width_in: float, height_in: float, layout: str | None = "constrained") -> "Figure":
    """Make an empty figure; the caller is a function `with_default_style`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    return figure


def encode_figure(figure: "Figure", dpi: int = DPI) -> bytes:
    """Return the figure as PNG."""
    buffer = BytesIO()
    # matplotlib writes its version into the file: without it the bytes follow from the picture alone
    figure.savefig(buffer, dpi=dpi, format="png", metadata={"Software": None})
    return buffer.getvalue()
