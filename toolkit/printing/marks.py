"""Header, marks and colour strip of each page, and a sheet drawn whole or as tiles; in mm."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from toolkit.core.text import count_of
from toolkit.objects.spec import Side
from toolkit.printing.canvas import BOLD, PLAIN, Pdf, measure_text_mm
from toolkit.printing.page import (
    BAR_MM,
    BARS_MM,
    MARK_MM,
    OVERLAP_MM,
    MapPage,
    Page,
    PageFrame,
    PagePlan,
    Paper,
    Rect,
    SheetTile,
    StripPlace,
    TilePage,
)
from toolkit.rig.markers import DICTIONARY, STRIP_FIRST_ID, add_rects, black_rects

CELL_MM = 7.0
ROW_GAP_MM = 1.0
QUIET_MM = 2.0
"""White on either side of a marker: more than a module of it."""
MARKER_MM = 10.5
FIDUCIALS = {
    STRIP_FIRST_ID: ("#######", "#....##", "#..#.##", "###.###", "#####.#", "#.###.#", "#######"),
    STRIP_FIRST_ID + 1: ("#######", "#....##", "#..####", "####..#", "#...###", "##.#.##", "#######"),
}
"""Modules of the two markers of `DICTIONARY`, left first; written out, so that printing does not load OpenCV."""
COLOURS = {
    "red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255), "cyan": (0, 255, 255), "magenta": (255, 0, 255),
    "yellow": (255, 255, 0), "light skin": (194, 150, 130), "middle skin": (155, 110, 90), "dark skin": (115, 82, 68),
    "white": (255, 255, 255), "black": (0, 0, 0),
}  # fmt: skip
"""The corners of the colour cube, and skin: light and dark as in the 24-patch ColorChecker, the middle between them."""
GREY_STEPS = 11
CAPTION = "Cut out with a white border and photograph it beside the object: toolkit knows these colours."
CAPTION_HEIGHT_MM = 3.5
SPACE = "StripRGB"
UNDERLAP_MM = 0.5
PRINT_IT = "Print at 100 % (“actual size”), never “fit to page”. Both check bars must measure 100 mm."
CUT_IT = (
    "Cut at the corner marks, tape the white edge. On top of the object the arrow points to its front, "
    "on a side it points up."
)
JOIN_IT = (
    "Page 1 shows how the tiles are joined. The arrow points to the front of the object that the sheet is taped on."
)
LINE_MM = 0.15
MARK_GAP_MM = 1.0
"""Bare paper between cut line and mark, so that a cut a little off leaves no ink on the sheet."""
MARK_LENGTH_MM = 4.0
SHORT_MARK_MM = 2.0
RING_MM = 1.5
BAR_THICKNESS_MM = 0.8
SMALLEST_WORDS_MM = 1.3
STEPS = (
    "1  Print every page at 100 % and measure both check bars on each.",
    f"2  Rows: cut a tile's left edge, from long mark to long mark; lay it {OVERLAP_MM:g} mm over its left neighbour.",
    "    Its edge meets the short marks, the ringed crosses lie on each other (hold it against the light). Tape.",
    "3  Cut the upper edge of each finished row and lay it over the row above in the same way. Tape.",
    "4  Cut the whole sheet along its four sides: the long marks at its outer corners, the outline of this map.",
)
LINE_HEIGHT_MM = 4.0


@dataclass(frozen=True)
class Swatch:
    """A colour: name, upper left corner and side in mm, and 8-bit sRGB value."""

    name: str
    x: float
    y: float
    side_mm: float
    srgb: tuple[int, int, int]


@dataclass(frozen=True)
class ColourStrip:
    """Geometry and colours of the strip.

    Attributes:
        swatches: colours from left to right, then greys from black to white.
        size_mm: width and height, without the `QUIET_MM` of white paper around it.
        marker_mm: side of a fiducial marker.
        marker_corners: upper left corner of each marker by its number.
        dictionary: OpenCV's name of the markers' dictionary.
    """

    swatches: tuple[Swatch, ...]
    size_mm: tuple[float, float]
    marker_mm: float
    marker_corners: dict[int, tuple[float, float]] = field(hash=False)
    dictionary: str = DICTIONARY

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the swatches."""
        return tuple(swatch.name for swatch in self.swatches)

    @cached_property
    def srgb(self) -> np.ndarray:
        """(k, 3) uint8 sRGB colours of the swatches in the file."""
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
        """(k, 4) left, top, right, bottom of the black parts of the markers."""
        rects = []
        for marker_id, corner in self.marker_corners.items():
            modules = np.array([[letter == "#" for letter in row] for row in FIDUCIALS[marker_id]])
            rects.append(black_rects(modules) * self.marker_mm + np.tile(corner, 2))
        return np.concatenate(rects)

    def paint(self, px_per_mm: float, border_mm: float = QUIET_MM) -> np.ndarray:
        """(h, w, 3) uint8 sRGB picture of the strip with a white border."""
        width, height = (round((side + 2 * border_mm) * px_per_mm) for side in self.size_mm)
        picture = np.full((height, width, 3), 255.0)
        swatches = [
            (np.array([[swatch.x, swatch.y, swatch.x + swatch.side_mm, swatch.y + swatch.side_mm]]), swatch.srgb)
            for swatch in self.swatches
        ]
        for rects, colour in [*swatches, (self.marker_rects_mm(), (0, 0, 0))]:
            ink = np.zeros((height, width))
            add_rects(ink, (rects + border_mm) * px_per_mm)
            picture += ink[..., None] * (np.array(colour) - 255.0)
        return np.round(picture.clip(0, 255)).astype(np.uint8)


def lay_out_strip() -> ColourStrip:
    """Return the strip: marker, swatches, marker, each with white round it."""
    # the upper row holds the colours, the lower row greys from black to white
    values = [round(255 * step / (GREY_STEPS - 1)) for step in range(GREY_STEPS)]
    greys = {f"grey {value}": (value, value, value) for value in values}
    left = MARKER_MM + QUIET_MM
    swatches = tuple(
        Swatch(name, left + column * CELL_MM, row * (CELL_MM + ROW_GAP_MM), CELL_MM, srgb)
        for row, colours in enumerate((COLOURS, greys))
        for column, (name, srgb) in enumerate(colours.items())
    )
    # markers stand at both ends, half way up
    height = 2 * CELL_MM + ROW_GAP_MM
    width = 2 * left + CELL_MM * len(COLOURS)
    top = (height - MARKER_MM) / 2
    corners = dict(zip(FIDUCIALS, ((0.0, top), (width - MARKER_MM, top)), strict=True))
    return ColourStrip(swatches, (width, height), MARKER_MM, corners)


STRIP = lay_out_strip()
"""102 × 15 mm; it fits across the smallest paper that a patch is printed on."""
LONG_MM, SHORT_MM = STRIP.size_mm[0] + 2 * QUIET_MM, STRIP.size_mm[1] + CAPTION_HEIGHT_MM + 2 * QUIET_MM
"""Sides of the strip with its caption and the white that its markers need, mm."""


def strip_area(place: StripPlace) -> Rect:
    """Return the area of the strip with its caption and the white that its markers need."""
    if place.upright:
        return Rect(place.x - STRIP.size_mm[1] - QUIET_MM, place.y - QUIET_MM, SHORT_MM, LONG_MM)
    return Rect(place.x - QUIET_MM, place.y - CAPTION_HEIGHT_MM - QUIET_MM, LONG_MM, SHORT_MM)


def reserve_strip(content: Rect) -> Iterator[tuple[StripPlace, Rect]]:
    """Yield places for the strip and the room that each leaves: along the lower edge, then up the right edge."""
    width, _ = STRIP.size_mm
    if content.width >= LONG_MM:
        x = content.x + (content.width - width) / 2
        place = StripPlace(x, content.y + CAPTION_HEIGHT_MM + QUIET_MM, upright=False)
        yield place, Rect(content.x, content.y + SHORT_MM, content.width, content.height - SHORT_MM)
    if content.height >= LONG_MM:
        y = content.y + (content.height - width) / 2
        place = StripPlace(content.right - CAPTION_HEIGHT_MM - QUIET_MM, y, upright=True)
        yield place, Rect(content.x, content.y, content.width - SHORT_MM, content.height)


def draw_strip(pdf: Pdf, place: StripPlace) -> None:
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


@dataclass(frozen=True)
class PatchLabel:
    """The lines that name a patch, or another sheet.

    Attributes:
        title: class, and the file's name if that differs.
        size: size on paper, and how it follows.
        origin: hash, program and networks.
    """

    title: str
    size: str
    origin: str


def draw_frame(pdf: Pdf, frame: PageFrame, label: PatchLabel, page: str, advice: str) -> None:
    """Draw the header (title, size, what to do, origin; `page` on the right, `advice` below) and the check bars."""
    area = frame.header
    taken = pdf.text(page, area.right, area.top - 4.2, 3.0, room_mm=area.width * 0.45, align="right")
    pdf.text(label.title, area.x, area.top - 4.2, 5.0, room_mm=area.width - taken - 4, font=BOLD)
    pdf.text(label.size, area.x, area.top - 9.4, 3.2, room_mm=area.width)
    for line, words in enumerate((PRINT_IT, advice)):
        pdf.text(words, area.x, area.top - 13.4 - 3.5 * line, 2.6, room_mm=area.width)
    pdf.text(label.origin, area.x, area.top - 20.3, 2.2, room_mm=area.width)
    for upright in (False, True):
        _draw_check_bar(pdf, upright)


def _draw_check_bar(pdf: Pdf, upright: bool) -> None:
    """A ruler to the right or upwards whose outer edges are 100 mm apart, with ticks each 10 mm, away from content."""
    # the upright bar is drawn turned by 90°, so that its outer side is the other side
    outwards, baseline = (1, 3.0) if upright else (-1, -4.7)
    with pdf.moved(BARS_MM, BARS_MM, 90 if upright else None):
        pdf.rect(0, min(0, outwards * BAR_THICKNESS_MM), BAR_MM, BAR_THICKNESS_MM, stroke=0, fill=1)
        for tick in range(0, 101, 10):
            # The end ticks stay inside the bar's 100 mm, the others are centred on their place.
            left = min(max(tick - LINE_MM, 0), BAR_MM - 2 * LINE_MM)
            pdf.rect(left, min(0, outwards * 2.4), 2 * LINE_MM, 2.4, stroke=0, fill=1)
            label = "100 mm" if tick == 100 else str(tick)
            pdf.text(label, tick, baseline, 2.2, room_mm=10, align="centre")


def _tick(pdf: Pdf, x: float, y: float, dx: int, dy: int, length: float = MARK_LENGTH_MM) -> None:
    """A line that starts a gap away from (x, y) and leads away from it."""
    end = MARK_GAP_MM + length
    pdf.line(x + dx * MARK_GAP_MM, y + dy * MARK_GAP_MM, x + dx * end, y + dy * end)


def draw_crop_marks(pdf: Pdf, cut: Rect) -> None:
    """Two marks at each corner, outside the rectangle and in line with its sides."""
    pdf.setLineWidth(LINE_MM)
    for x, outwards_x in ((cut.x, -1), (cut.right, 1)):
        for y, outwards_y in ((cut.y, -1), (cut.top, 1)):
            _tick(pdf, x, y, outwards_x, 0)
            _tick(pdf, x, y, 0, outwards_y)


def _draw_ring(pdf: Pdf, x: float, y: float) -> None:
    """A registration mark: two that are aligned, held against the light, look like a single mark."""
    pdf.circle(x, y, RING_MM * 0.6, stroke=1, fill=0)
    pdf.line(x - RING_MM, y, x + RING_MM, y)
    pdf.line(x, y - RING_MM, x, y + RING_MM)


def draw_overlap_marks(pdf: Pdf, tile: SheetTile, window: Rect) -> None:
    """Mark both ends of every overlap, outside the tile: the neighbour's edge, and a registration mark."""
    pdf.setLineWidth(LINE_MM)
    half, away = OVERLAP_MM / 2, MARK_GAP_MM + RING_MM + 1
    joins = tile.joins
    # a tick where the neighbour ends, a ring in the middle of the overlap: both tiles print the same ring
    for side, edge, inwards in (("left", window.x, 1), ("right", window.right, -1)):
        if joins[side]:
            for y, outwards in ((window.y, -1), (window.top, 1)):
                _tick(pdf, edge + inwards * OVERLAP_MM, y, 0, outwards, length=SHORT_MARK_MM)
                _draw_ring(pdf, edge + inwards * half, y + outwards * away)
    for side, edge, inwards in (("bottom", window.y, 1), ("top", window.top, -1)):
        if joins[side]:
            for x, outwards in ((window.x, -1), (window.right, 1)):
                _tick(pdf, x, edge + inwards * OVERLAP_MM, outwards, 0, length=SHORT_MARK_MM)
                _draw_ring(pdf, x + outwards * away, edge + inwards * half)


def draw_front_arrow(pdf: Pdf, area: Rect, note: str = "", at: Side = "top") -> None:
    """Draw `note` below a cut line's marks, then which way the sheet goes, see `_draw_way`."""
    _draw_way(pdf, note, area.x + area.width / 2, area.y - MARK_MM - 2.6, 2.4, area.width + 2 * MARK_MM, at)


def draw_margin_words(pdf: Pdf, cut: Rect, margin_mm: float, name: str, at: Side) -> None:
    """Write the object's name and which way the sheet goes into the white margin below the patch.

    A margin under 3 mm has no room for them: then they stand below the cut line.
    """
    size = min(2.2, 0.44 * margin_mm)
    if size < SMALLEST_WORDS_MM:
        draw_front_arrow(pdf, cut, name, at)
        return
    pdf.grey(0.25)  # a camera sees what is taped on: no blacker than it must be
    y = cut.y + (margin_mm - 0.7 * size) / 2
    _draw_way(pdf, name, cut.x + cut.width / 2, y, size, cut.width - 2 * size, at)
    pdf.grey(0)


def _draw_way(
    pdf: Pdf, note: str, middle_x: float, y: float, size: float, room_mm: float, at: Side
) -> None:  # fmt: skip
    """Draw words and an arrow: `front` to the right for an object's top, `up` for its sides, as in the rig."""
    # words and arrow are centred together, so the arrow's length is taken from the room first
    shaft = 7.0 / 2.4 * size if at == "top" else 0.9 * size
    word = "   ".join(filter(None, [note, "front" if at == "top" else "up"]))
    width = min(measure_text_mm(word, PLAIN, size), room_mm - 1 - shaft) + 1 + shaft
    x = middle_x - width / 2
    end = x + pdf.text(word, x, y, size, room_mm=width - 1 - shaft) + 1
    start = (end, y + 0.35 * size) if at == "top" else (end + 0.4 * size, y - 0.1 * size)
    pdf.saveState()
    pdf.setLineWidth(2 * LINE_MM)
    pdf.translate(*start)
    if at != "top":
        pdf.rotate(90)
    pdf.line(0, 0, shaft - 0.6 * size, 0)
    pdf.shape([(shaft, 0), (shaft - 0.9 * size, 0.38 * size), (shaft - 0.9 * size, -0.38 * size)])
    pdf.restoreState()


@dataclass(frozen=True)
class SheetDrawing:
    """A sheet as all its pages show it.

    Attributes:
        label, advice: words of the header.
        draw: draws the whole sheet with its lower left corner at (x, y).
        name: name of the sheet below its map and tiles.
        at: side of the object that a patch is taped to: its arrow is drawn below the map and tiles.
    """

    label: PatchLabel
    advice: str
    draw: Callable[[float, float], None]
    name: str = ""
    at: Side | None = None

    def note(self, pdf: Pdf, area: Rect, tile: str = "") -> None:
        """Write below a map's picture, or below a tile with the tile's name."""
        if self.at is not None:
            draw_front_arrow(pdf, area, tile, self.at)
        elif words := f"{self.name} {tile}".strip():
            x, y = area.x + area.width / 2, area.y - MARK_MM - 2.6
            pdf.text(words, x, y, 2.4, room_mm=area.width, align="centre")


def draw_pages(
    pdf: Pdf, plan: PagePlan, sheet: SheetDrawing, first: int, total: int, which: str = "", paper: Paper | None = None
) -> None:
    """Draw all pages of a sheet, numbered from `first` of `total`, on another paper than before if `paper` is given."""
    for number, page in enumerate(plan.pages, first):
        with pdf.page(paper):
            draw_page(pdf, plan, page, sheet, f"{which}page {number} of {total}")


def draw_page(pdf: Pdf, plan: PagePlan, page: Page, sheet: SheetDrawing, which: str) -> None:
    """Draw a page of a sheet; `which` names it in the header."""
    frame = plan.frame
    which = f"{frame.paper.describe()}, {which}"
    # a map of the tiles, a tile, or whole sheets with crop marks
    if isinstance(page, MapPage):
        rows, columns = plan.tiles
        which = f"{count_of(rows, 'row')} × {count_of(columns, 'column')}, {which}"
        picture = _draw_map(pdf, frame.content, page, sheet)
        # a map has no crop marks, so its note stands 4 mm nearer
        sheet.note(pdf, Rect(picture.x, picture.y + 4, picture.width, picture.height))
    elif isinstance(page, TilePage):
        # the copy is named only where there are several to mix up
        copies = max(other.copy for other in plan.pages if isinstance(other, TilePage))
        which = f"tile {page.tile.name}" + (f" of copy {page.copy}" if copies > 1 else "") + f", {which}"
        _draw_tile(pdf, page, sheet)
        sheet.note(pdf, page.window, page.tile.name)
    else:
        for cut in page.cuts:
            sheet.draw(cut.x, cut.y)
            draw_crop_marks(pdf, cut)
        if page.strip is not None:
            draw_strip(pdf, page.strip)
    draw_frame(pdf, frame, sheet.label, which, sheet.advice)


def _draw_tile(pdf: Pdf, page: TilePage, sheet: SheetDrawing) -> None:
    """A tile's part of a sheet, clipped to its window, and the marks round it."""
    window, part = page.window, page.tile.area
    pdf.saveState()
    clip = pdf.beginPath()
    clip.rect(window.x, window.y, window.width, window.height)
    pdf.clipPath(clip, stroke=0, fill=0)
    pdf.translate(window.x - part.x, window.y - part.y)
    sheet.draw(0.0, 0.0)
    pdf.restoreState()
    draw_crop_marks(pdf, window)
    draw_overlap_marks(pdf, page.tile, window)


def _draw_map(pdf: Pdf, area: Rect, page: MapPage, sheet: SheetDrawing) -> Rect:
    """Draw the whole sheet small, each tile outlined and named, over the steps to join them; return its area."""
    # the furthest edges of all tiles are the sheet's own
    sheet_width, sheet_height = (max(getattr(tile.area, end) for tile in page.tiles) for end in ("right", "top"))
    steps_mm = LINE_HEIGHT_MM * len(STEPS) + 4
    # as large as the room above the steps lets it be
    small = min((area.width - 8) / sheet_width, (area.height - steps_mm - 14) / sheet_height)
    room = Rect(area.x, area.y + steps_mm + 10, area.width, area.height - steps_mm - 14)
    picture = room.centre(sheet_width * small, sheet_height * small)
    with pdf.moved(picture.x, picture.y, scale=small):
        sheet.draw(0.0, 0.0)
    # the tiles overlap, and so do their outlines
    for tile in page.tiles:
        here = tile.area
        box = Rect(picture.x + here.x * small, picture.y + here.y * small, here.width * small, here.height * small)
        _outline_tile(pdf, box, tile.name)
    # the steps stand under the map, the first on top
    for line, words in enumerate(STEPS):
        y = area.y + steps_mm - LINE_HEIGHT_MM * (line + 1)
        pdf.text(words, area.x + 4, y, 2.6, room_mm=area.width - 4)
    return picture


def _outline_tile(pdf: Pdf, box: Rect, name: str) -> None:
    # white under black, so that it shows on any colour
    for width, grey in ((0.7, 1), (0.25, 0)):
        pdf.setLineWidth(width)
        pdf.setStrokeGray(grey)
        pdf.rect(box.x, box.y, box.width, box.height, stroke=1, fill=0)
    size = min(5.0, box.width / 4, box.height / 3)
    plate = box.centre(size * 2.6, size * 1.5)
    pdf.setFillGray(1)
    pdf.roundRect(plate.x, plate.y, plate.width, plate.height, size * 0.3, stroke=0, fill=1)
    pdf.setFillGray(0)
    y = plate.y + size * 0.39
    pdf.text(name, plate.x + plate.width / 2, y, size, room_mm=plate.width * 0.9, font=BOLD, align="centre")
