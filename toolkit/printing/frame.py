"""What every page has round its content: the printable area, a header on top, check bars on the left and below."""

from dataclasses import dataclass

from toolkit.printing.paper import Paper

UNPRINTABLE_MM = 10.0
"""Nearly every desktop printer reaches this far; many stop at 6 mm, a few at 12 mm on one end of the sheet only."""
HEADER_MM = 23.0
BAR_STRIP_MM = 5.5
INSET_MM = BAR_STRIP_MM + 2
"""The strip of a check bar and 2 mm of paper, so that neither words nor marks touch the bar."""
BAR_MM = 100.0
MARK_MM = 6.0
"""Width of the zone round a cut line that holds crop marks and registration marks."""
CAPTION_MM = 4.5
"""Height of the line below it that holds the front arrow and a tile's name."""


@dataclass(frozen=True)
class Rect:
    """A rectangle in millimetres, from its lower left corner, y upwards."""

    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Greatest x."""
        return self.x + self.width

    @property
    def top(self) -> float:
        """Greatest y."""
        return self.y + self.height

    def centre(self, width: float, height: float) -> "Rect":
        """A rectangle of that size about the same centre."""
        return Rect(self.x + (self.width - width) / 2, self.y + (self.height - height) / 2, width, height)


@dataclass(frozen=True)
class PageFrame:
    """Where things go on a page; the origin is the paper's lower left corner."""

    paper: Paper

    @property
    def printable(self) -> Rect:
        """The page without the margins that a printer does not reach."""
        sides = 2 * UNPRINTABLE_MM
        return Rect(UNPRINTABLE_MM, UNPRINTABLE_MM, self.paper.width_mm - sides, self.paper.height_mm - sides)

    @property
    def bars_corner(self) -> tuple[float, float]:
        """Zero of both check bars."""
        return UNPRINTABLE_MM + BAR_STRIP_MM, UNPRINTABLE_MM + BAR_STRIP_MM

    @property
    def header(self) -> Rect:
        """The label, clear of the upright check bar, which on a low page reaches as high."""
        area = self.printable
        return Rect(area.x + INSET_MM, area.top - HEADER_MM, area.width - INSET_MM, HEADER_MM)

    @property
    def content(self) -> Rect:
        """What is left for patches, their marks and captions."""
        area = self.printable
        return Rect(area.x + INSET_MM, area.y + INSET_MM, area.width - INSET_MM, area.height - INSET_MM - HEADER_MM)
