"""The strip of known colours that is printed beside a patch: what each is, and where on the page it lies."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from toolkit.printing.page import Rect
from toolkit.rig.markers import DICTIONARY, STRIP_FIRST_ID, add_rects, black_rects

if TYPE_CHECKING:
    from toolkit.printing.canvas import Pdf

CELL_MM = 7.0
ROW_GAP_MM = 1.0
QUIET_MM = 2.0
"""White on either side of a marker: more than one of its modules."""
MARKER_MM = 10.5
FIDUCIALS = {
    STRIP_FIRST_ID: ("#######", "#....##", "#..#.##", "###.###", "#####.#", "#.###.#", "#######"),
    STRIP_FIRST_ID + 1: ("#######", "#....##", "#..####", "####..#", "#...###", "##.#.##", "#######"),
}
"""Modules of the two markers of `DICTIONARY`, left one first; written out, so that printing does not load OpenCV."""
COLOURS = {
    "red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255), "cyan": (0, 255, 255), "magenta": (255, 0, 255),
    "yellow": (255, 255, 0), "light skin": (194, 150, 130), "middle skin": (155, 110, 90), "dark skin": (115, 82, 68),
    "white": (255, 255, 255), "black": (0, 0, 0),
}  # fmt: skip
"""The corners of the cube of colours, which a printer's own corners answer to, and skin: light and dark are those of
the 24-patch ColorChecker in sRGB, the middle one lies halfway."""
GREY_STEPS = 11


@dataclass(frozen=True)
class Swatch:
    """One colour: its name, its upper left corner and side in millimetres, and its sRGB value of three bytes."""

    name: str
    x: float
    y: float
    side_mm: float
    srgb: tuple[int, int, int]


@dataclass(frozen=True)
class ColourStrip:
    """Geometry and colours of the strip.

    Attributes:
        swatches: the colours from left to right, then the greys from black to white.
        size_mm: width and height; paper round it stays white for `QUIET_MM`.
        marker_mm: side of a fiducial marker.
        marker_corners: upper left corner of each marker by its number.
        dictionary: of the markers, one of OpenCV's by name.
    """

    swatches: tuple[Swatch, ...]
    size_mm: tuple[float, float]
    marker_mm: float
    marker_corners: dict[int, tuple[float, float]] = field(hash=False)
    dictionary: str = DICTIONARY

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the swatches."""
        return tuple(swatch.name for swatch in self.swatches)

    @cached_property
    def srgb(self) -> np.ndarray:
        """(k, 3) uint8, the colours that the file states, swatch by swatch."""
        return np.array([swatch.srgb for swatch in self.swatches], np.uint8)

    @cached_property
    def centres_mm(self) -> np.ndarray:
        """(k, 2) middle of each swatch."""
        return np.array([(swatch.x + swatch.side_mm / 2, swatch.y + swatch.side_mm / 2) for swatch in self.swatches])

    def swatch_corners_mm(self, inset_mm: float = 0.0) -> np.ndarray:
        """(k, 4, 2) corners of the swatches (upper left, upper right, lower right, lower left), `inset_mm` inside."""
        half = CELL_MM / 2 - inset_mm
        square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        return self.centres_mm[:, None] + square

    def marker_corners_mm(self, marker_ids: list[int] | np.ndarray | None = None) -> np.ndarray:
        """(m, 4, 2) corners of markers (both by default) in OpenCV's order, as `cv2.findHomography` wants them."""
        wanted = list(self.marker_corners) if marker_ids is None else np.asarray(marker_ids).ravel().tolist()
        square = self.marker_mm * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        return np.array([np.array(self.marker_corners[marker_id]) + square for marker_id in wanted]).reshape(-1, 4, 2)

    def marker_rects_mm(self) -> np.ndarray:
        """(k, 4) left, top, right, bottom of everything that is black in the markers."""
        rects = []
        for marker_id, corner in self.marker_corners.items():
            modules = np.array([[letter == "#" for letter in row] for row in FIDUCIALS[marker_id]])
            rects.append(black_rects(modules) * self.marker_mm + np.tile(corner, 2))
        return np.concatenate(rects)

    def paint(self, px_per_mm: float, border_mm: float = QUIET_MM) -> np.ndarray:
        """(h, w, 3) uint8 sRGB picture of the strip as the file states it, with a white border all round."""
        width, height = (round((side + 2 * border_mm) * px_per_mm) for side in self.size_mm)
        picture = np.full((height, width, 3), 255.0)
        swatches = [
            (np.array([[one.x, one.y, one.x + one.side_mm, one.y + one.side_mm]]), one.srgb) for one in self.swatches
        ]
        for rects, colour in [*swatches, (self.marker_rects_mm(), (0, 0, 0))]:
            ink = np.zeros((height, width))
            add_rects(ink, (rects + border_mm) * px_per_mm)
            picture += ink[..., None] * (np.array(colour) - 255.0)
        return np.round(picture.clip(0, 255)).astype(np.uint8)


def lay_out_strip() -> ColourStrip:
    """The strip: marker, swatches, marker, each with white round it."""
    values = [round(255 * step / (GREY_STEPS - 1)) for step in range(GREY_STEPS)]
    greys = {f"grey {value}": (value, value, value) for value in values}
    left = MARKER_MM + QUIET_MM
    swatches = tuple(
        Swatch(name, left + column * CELL_MM, row * (CELL_MM + ROW_GAP_MM), CELL_MM, srgb)
        for row, colours in enumerate((COLOURS, greys))
        for column, (name, srgb) in enumerate(colours.items())
    )
    height = 2 * CELL_MM + ROW_GAP_MM
    width = 2 * left + CELL_MM * len(COLOURS)
    top = (height - MARKER_MM) / 2
    corners = dict(zip(FIDUCIALS, ((0.0, top), (width - MARKER_MM, top)), strict=True))
    return ColourStrip(swatches, (width, height), MARKER_MM, corners)


STRIP = lay_out_strip()
"""102 × 15 mm; it fits across the smallest paper that a patch is printed on."""
CAPTION = "Cut out with a white border; photograph it beside the object: the kit knows these colours."
CAPTION_HEIGHT_MM = 3.5
SPACE = "StripRGB"
UNDERLAP_MM = 0.5
LONG_MM, SHORT_MM = STRIP.size_mm[0] + 2 * QUIET_MM, STRIP.size_mm[1] + CAPTION_HEIGHT_MM + 2 * QUIET_MM
"""Of the strip with its caption and the white that its markers need."""


@dataclass(frozen=True)
class StripPlace:
    """The strip on a page: its lower left corner in millimetres, lying level or turned to read upwards."""

    x: float
    y: float
    upright: bool

    @property
    def area(self) -> Rect:
        """What it covers with its caption and the white that its markers need."""
        if self.upright:
            return Rect(self.x - STRIP.size_mm[1] - QUIET_MM, self.y - QUIET_MM, SHORT_MM, LONG_MM)
        return Rect(self.x - QUIET_MM, self.y - CAPTION_HEIGHT_MM - QUIET_MM, LONG_MM, SHORT_MM)


def reserve_strip(content: Rect) -> Iterator[tuple[StripPlace, Rect]]:
    """Places for the strip and what each leaves of the page's room: along the lower edge, then up the right one."""
    width, _ = STRIP.size_mm
    if content.width >= LONG_MM:
        x = content.x + (content.width - width) / 2
        place = StripPlace(x, content.y + CAPTION_HEIGHT_MM + QUIET_MM, upright=False)
        yield place, Rect(content.x, content.y + SHORT_MM, content.width, content.height - SHORT_MM)
    if content.height >= LONG_MM:
        y = content.y + (content.height - width) / 2
        place = StripPlace(content.right - CAPTION_HEIGHT_MM - QUIET_MM, y, upright=True)
        yield place, Rect(content.x, content.y, content.width - SHORT_MM, content.height)


def draw_strip(pdf: "Pdf", place: StripPlace) -> None:
    """Draw the strip and its caption; its colours are sRGB to every reader."""
    if SPACE not in pdf._doc.idToObject:
        pdf._doc.Reference(pdf.srgb(), SPACE)
    # ReportLab lists a page's separation colours here; the page's resources then name this space in the same way.
    pdf._colorsUsed[SPACE] = SPACE
    width, height = STRIP.size_mm
    last = max(swatch.x for swatch in STRIP.swatches)
    with pdf.moved(place.x, place.y, 90 if place.upright else None):
        for swatch in STRIP.swatches:
            red, green, blue = (f"{value / 255:.5g}" for value in swatch.srgb)
            # PDF counts upwards, the strip downwards
            bottom = height - swatch.y - swatch.side_mm
            # It reaches under its right neighbour, so that no hairline of paper shows between them.
            reach = swatch.side_mm + (UNDERLAP_MM if swatch.x < last else 0)
            box = f"{swatch.x:g} {bottom:g} {reach:g} {swatch.side_mm:g}"
            pdf._code.append(f"/{SPACE} cs {red} {green} {blue} sc {box} re f")
        pdf.setFillGray(0)
        pdf.rects(STRIP.marker_rects_mm(), height)
        pdf.text(CAPTION, 0, -CAPTION_HEIGHT_MM + 0.6, 2.2, room_mm=width)
