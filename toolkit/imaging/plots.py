"""Figures without a window, as PNG whose bytes are the same for the same picture; matplotlib is reached here alone."""

from collections.abc import Callable
from functools import wraps
from io import BytesIO
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 120
P = ParamSpec("P")
R = TypeVar("R")


def with_default_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Let a function draw in matplotlib's own defaults, as each that calls `make_figure` must.

    A `matplotlibrc` of the current folder, which may come from anybody, could otherwise switch on LaTeX and so start a
    program. The user's own settings are as before afterwards.
    """

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        import matplotlib

        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            return draw(*args, **kwargs)

    return drawn


def make_figure(width_in: float, height_in: float, layout: str | None = "constrained") -> "Figure":
    """An empty figure; the caller is a function `with_default_style`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    return figure


def encode_figure(figure: "Figure", dpi: int = DPI) -> bytes:
    """The figure as PNG."""
    buffer = BytesIO()
    # matplotlib writes its version into the file: without it the bytes follow from the picture alone
    figure.savefig(buffer, dpi=dpi, format="png", metadata={"Software": None})
    return buffer.getvalue()
