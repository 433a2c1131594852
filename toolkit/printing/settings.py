"""How a patch is to be printed, and how large that makes it."""

import math
from dataclasses import dataclass, field

from toolkit.errors import ToolkitError, one_of
from toolkit.patches import BASE_DPI, MM_PER_INCH, SCALE, printed_size_mm
from toolkit.printing.paper import Paper, parse_paper

ORIENTATIONS = ["auto", "portrait", "landscape"]
SMALLEST_SIDE_MM = 1.0
LARGEST_SIDE_MM = 5000.0
MOST_COPIES = 1000
WIDEST_MARGIN_MM = 100.0


@dataclass(frozen=True)
class PrintSettings:
    """What the user asked for; checked when it is made.

    Attributes:
        paper: the sheet in the printer.
        orientation: `auto` (the one that needs fewer pages), `portrait` or `landscape`.
        scale_percent: of the patch's base size; the paper prints at 250 %.
        dpi: patch pixels per inch at 100 %.
        size_mm: side of the patch on paper without its white margin; replaces `scale_percent` and `dpi`.
        copies: how many times the patch is printed.
        margin_mm: white paper between the patch and the cut line, to tape it by.

    Raises:
        ToolkitError: a number is out of its range.
    """

    paper: Paper = field(default_factory=lambda: parse_paper("a4"))
    orientation: str = "auto"
    scale_percent: float = 100 * SCALE
    dpi: float = BASE_DPI
    size_mm: float | None = None
    copies: int = 1
    margin_mm: float = 5.0

    def __post_init__(self) -> None:
        check_orientation(self.orientation)
        _require(
            math.isfinite(self.scale_percent) and self.scale_percent > 0, "--scale", "above 0 %", self.scale_percent
        )
        _require(math.isfinite(self.dpi) and self.dpi > 0, "--dpi", "above 0", self.dpi)
        _require(1 <= self.copies <= MOST_COPIES, "--copies", f"1 to {MOST_COPIES}", self.copies)
        _require(0 <= self.margin_mm <= WIDEST_MARGIN_MM, "--margin-mm", f"0 to {WIDEST_MARGIN_MM:g}", self.margin_mm)
        if self.size_mm is not None:
            _require(math.isfinite(self.size_mm) and self.size_mm > 0, "--size-mm", "above 0", self.size_mm)


def check_orientation(orientation: str) -> str:
    """`orientation`, if it is one.

    Raises:
        ToolkitError: it is not.
    """
    if orientation not in ORIENTATIONS:
        raise one_of("orientation", orientation, ORIENTATIONS)
    return orientation


def _require(good: bool, option: str, expected: str, found: float) -> None:
    if not good:
        raise ToolkitError(f"{option}: expected a number {expected}, found {found:g}")


def parse_percent(text: str) -> float:
    """`250` or `250%` to 250.0.

    Raises:
        ToolkitError: it is no number.
    """
    try:
        return float(text.strip().removesuffix("%").strip())
    except ValueError:
        raise ToolkitError(f"--scale: expected a percentage such as 250 or 250%, found '{text}'") from None


def measure_side_mm(n_px: int, settings: PrintSettings) -> float:
    """Side of an n-pixel patch on paper, millimetres, without its white margin.

    Raises:
        ToolkitError: the side is under 1 mm or over 5 m.
    """
    side_mm = settings.size_mm or printed_size_mm(n_px, settings.dpi, settings.scale_percent / 100)
    if not SMALLEST_SIDE_MM <= side_mm <= LARGEST_SIDE_MM:
        raise ToolkitError(
            f"the patch of {n_px} px would be {side_mm:.4g} mm wide: expected {SMALLEST_SIDE_MM:g} to "
            f"{LARGEST_SIDE_MM:g} mm; change --scale, --dpi or --size-mm"
        )
    return side_mm


def effective_percent(n_px: int, side_mm: float, dpi: float) -> float:
    """The scale that gives this side: what the label states, whichever option set the size."""
    return 100 * side_mm / (n_px / dpi * MM_PER_INCH)
