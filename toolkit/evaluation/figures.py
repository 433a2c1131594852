"""What all figures look alike in: their colours, and their frames."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from toolkit.captures.read import UNPATCHED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# a palette that people who see fewer colours can tell apart (Okabe and Ito 2008)
BLUE, ORANGE, GREEN, PINK, AMBER, SKY = COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
UNPATCHED_COLOUR, LEFT_OUT_COLOUR = "#6b6f76", "#d9dce1"
RIGHT, FIFTH, WRONG = GREEN, AMBER, ORANGE
"""Frames of pictures whose truth is the first guess, among five, and not among them."""
MARKERS = ("o", "s", "D", "^", "v", "P")


def colour_of(variants: Sequence[str], variant: str) -> str:
    """Grey for `unpatched`, the others in turn."""
    if variant == UNPATCHED:
        return UNPATCHED_COLOUR
    others = [name for name in dict.fromkeys(variants) if name != UNPATCHED]
    return COLOURS[others.index(variant) % len(COLOURS)]


def style_panel(panel: "Axes", low: float = 0, high: float = 104) -> None:
    """Per cent upwards in steps of 20, with a faint grid and no frame above and on the right."""
    panel.set_ylim(low, high)
    panel.set_yticks(range(0, 101, 20))
    panel.grid(axis="y", alpha=0.3)
    panel.spines[["top", "right"]].set_visible(False)
