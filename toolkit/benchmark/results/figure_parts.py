"""What the benchmark's figures share: where the corruptions stand, their colours, and the drawing of one bar."""

from collections.abc import Iterable, Sequence
from io import BytesIO
from typing import Any

from toolkit.benchmark.answers import READER
from toolkit.benchmark.results.say import say_corruption
from toolkit.corruptions.catalogue import CORRUPTIONS

# a palette that people who see fewer colours can tell apart (Okabe and Ito 2008)
FAMILY_COLOURS = {
    "noise": "#d55e00", "blur": "#0072b2", "weather": "#009e73", "digital": "#cc79a7", "extra": "#b08000",
}  # fmt: skip
MEAN_COLOUR, WITHOUT_COLOUR = "#4a4f57", "#111111"
RIGHT_COLOUR, WRONG_COLOUR, NOT_DECODED_COLOUR = "#0072b2", "#d55e00", "#d9dce1"
FAMILY_GAP, MEAN_GAP = 0.5, 1.0
FEW_PLACES, MIN_PLACES = 4, 6
DPI = 120
MEAN = "mean"


def place_corruptions(names: Iterable[str], has_mean: bool) -> dict[str, float]:
    """Where each corruption stands along the axis: a step each, a gap between families, and the mean last."""
    places: dict[str, float] = {}
    x, family = 0.0, None
    for name in names:
        if family not in (None, CORRUPTIONS[name].family):
            x += FAMILY_GAP
        places[name], family = x, CORRUPTIONS[name].family
        x += 1
    if has_mean:
        places[MEAN] = x + (MEAN_GAP if places else 0)
    return places


def label_places(panel: Any, places: dict[str, float], is_coloured: bool) -> None:
    """Names of the corruptions below a panel, tilted where they are many and in their family's colour if wanted."""
    names = [MEAN if name == MEAN else say_corruption(name) for name in places]
    tilt = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"} if len(places) > FEW_PLACES else {}
    panel.set_xticks(list(places.values()), names, **tilt)
    panel.tick_params(axis="x", length=0, labelsize=10)
    for tick, name in zip(panel.get_xticklabels(), places, strict=True):
        tick.set_color(colour_of(name) if is_coloured else MEAN_COLOUR)
        tick.set_fontweight("bold" if name == MEAN else "normal")
    centre = max(places.values()) / 2
    half = max(centre + 0.7, MIN_PLACES / 2)
    panel.set_xlim(centre - half, centre + half)


def colour_of(name: str) -> str:
    """Of a corruption's family, or of the mean."""
    return MEAN_COLOUR if name == MEAN else FAMILY_COLOURS[CORRUPTIONS[name].family]


def shade(colour: str, severity: int) -> tuple[float, float, float]:
    """Pale for severity 1 to full for 4, and a little darker for 5."""
    from matplotlib.colors import to_rgb

    white, black = (0.62, 0.45, 0.25, 0.0, 0.0)[severity - 1], 0.35 if severity == 5 else 0.0
    red, green, blue = ((part * (1 - white) + white) * (1 - black) for part in to_rgb(colour))
    return red, green, blue


def style_panel(panel: Any, ylabel: str) -> None:
    """Percent from 0 to 100 with room for a number above, a light grid, no frame."""
    panel.set_ylim(0, 108)
    panel.set_yticks(range(0, 101, 20))
    panel.set_ylabel(ylabel)
    panel.grid(axis="y", alpha=0.3)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.spines["left"].set_bounds(0, 100)


def stack_reader(panel: Any, x: Sequence[float], width: float, right: Sequence[float], wrong: Sequence[float]) -> None:
    """A reader's bars: right, then wrong, then not decoded, up to 100."""
    base = [0.0] * len(x)
    parts = (right, wrong, [1 - a - b for a, b in zip(right, wrong, strict=True)])
    for shares, colour in zip(parts, (RIGHT_COLOUR, WRONG_COLOUR, NOT_DECODED_COLOUR), strict=True):
        panel.bar(x, [100 * share for share in shares], bottom=base, width=width, color=colour, zorder=2)
        base = [low + 100 * share for low, share in zip(base, shares, strict=True)]


def list_reader_colours() -> list[Any]:
    """Legend entries of `stack_reader`."""
    from matplotlib.patches import Patch

    return [
        Patch(color=RIGHT_COLOUR, label="read right"),
        Patch(color=WRONG_COLOUR, label="read wrong"),
        Patch(color=NOT_DECODED_COLOUR, label="not decoded"),
    ]


def is_reader(row: Any) -> bool:
    """Whether a row is of a reader of codes."""
    return bool(row.kind == READER)


def make_figure(width_in: float, height_in: float) -> Any:
    """An empty figure with no window behind it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_png(figure: Any) -> bytes:
    """The figure as PNG, the same bytes for the same picture."""
    for panel in figure.axes:
        # inside the panel all the same; measuring hundreds of bars is most of the time of a layout
        for artist in (*panel.patches, *panel.collections, *panel.lines):
            artist.set_in_layout(False)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=DPI, format="png", metadata={"Software": None})
    return buffer.getvalue()
