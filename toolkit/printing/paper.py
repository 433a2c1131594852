"""Sheets of paper, in millimetres."""

import math
import re
from dataclasses import dataclass

from toolkit.errors import ToolkitError, one_of

PAPERS_MM = {
    "a0": (841.0, 1189.0),
    "a1": (594.0, 841.0),
    "a2": (420.0, 594.0),
    "a3": (297.0, 420.0),
    "a4": (210.0, 297.0),
    "a5": (148.0, 210.0),
    "b3": (353.0, 500.0),
    "b4": (250.0, 353.0),
    "b5": (176.0, 250.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
"""Portrait width and height: ISO 216, and ANSI/ASME Y14.1 for the American sizes."""
SMALLEST_MM = 135.0
"""Room for a 100 mm check bar, its numbers and the margins that no printer reaches."""
LARGEST_MM = 5000.0
"""A PDF page ends at 14400 points, 5080 mm (ISO 32000-1, Annex C)."""
CUSTOM = re.compile(r"^\s*(\d+(?:\.\d+)?)\s*[x×]\s*(\d+(?:\.\d+)?)\s*(?:mm)?\s*$", re.IGNORECASE)


@dataclass(frozen=True)
class Paper:
    """A sheet as it lies in the printer: its name and its width and height in millimetres."""

    name: str
    width_mm: float
    height_mm: float

    @property
    def orientation(self) -> str:
        """`portrait` or `landscape`; a square is portrait."""
        return "landscape" if self.width_mm > self.height_mm else "portrait"

    def turn(self, orientation: str) -> "Paper":
        """This sheet turned to `portrait` or `landscape`."""
        if orientation == self.orientation or self.width_mm == self.height_mm:
            return self
        return Paper(self.name, self.height_mm, self.width_mm)


def parse_paper(text: str) -> Paper:
    """A paper by name (`a4`, `letter`), or one's own as width × height (`200x300mm`).

    Raises:
        ToolkitError: the name is unknown, or the sheet is smaller than 135 mm or larger than 5 m on a side.
    """
    name = text.strip().lower()
    if name in PAPERS_MM:
        return Paper(name, *PAPERS_MM[name])
    custom = CUSTOM.match(name)
    if custom is None:
        raise one_of("paper", text, [*PAPERS_MM, "WIDTHxHEIGHTmm"])
    width_mm, height_mm = float(custom[1]), float(custom[2])
    if not all(math.isfinite(side) and SMALLEST_MM <= side <= LARGEST_MM for side in (width_mm, height_mm)):
        raise ToolkitError(
            f"paper '{text}': expected sides of {SMALLEST_MM:g} to {LARGEST_MM:g} mm (a 100 mm check bar must fit): "
            "choose another paper"
        )
    return Paper(f"{width_mm:g}x{height_mm:g}mm", width_mm, height_mm)
