"""A PDF to draw on in millimetres: embedded fonts, words that fit their room, shapes, arrows and dimensions."""

from bisect import bisect
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from io import BytesIO
from typing import Any

import numpy as np
from reportlab.lib.colors import CMYKColorSep
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase.pdfdoc import (
    PDFArray,
    PDFDictionary,
    PDFInfo,
    PDFName,
    PDFObjectReference,
    PDFStream,
    PDFString,
    PDFZCompress,
)
from reportlab.pdfbase.pdfmetrics import getFont, registerFont, stringWidth
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas as ReportLabCanvas
from reportlab.pdfgen.pathobject import PDFPathObject

from toolkit import __version__
from toolkit.imaging.plots import font_file
from toolkit.objects.spec import MM_PER_INCH
from toolkit.printing.page import Paper, Rect

Colour = tuple[float, float, float]
Point = tuple[float, float]
PLAIN, BOLD = "ToolkitSans", "ToolkitSansBold"
SMALLEST_MM = 1.2
POINTS_PER_MM = 72 / MM_PER_INCH
INK: Colour = (0.10, 0.12, 0.15)
SOFT: Colour = (0.42, 0.45, 0.49)
FAINT: Colour = (0.80, 0.82, 0.84)
WASH: Colour = (0.945, 0.95, 0.957)
WHITE: Colour = (1.0, 1.0, 1.0)
CAMERA: Colour = (0.05, 0.36, 0.62)
SHEET: Colour = (0.80, 0.25, 0.10)
OBJECT: Colour = (0.70, 0.72, 0.75)
"""Camera blue, sheet vermilion: apart in print without colour too, by their darkness."""
TICK_MM = 3.6
SRGB_IMAGES = "ImageRGB"
"""The document's name for the colour space of its pictures."""


@cache
def _register_fonts() -> None:
    # embedded, since print shops refuse PDFs whose fonts are not
    registerFont(TTFont(PLAIN, str(font_file("plain"))))
    registerFont(TTFont(BOLD, str(font_file("sans"))))


def measure_text_mm(text: str, font: str, size_mm: float) -> float:
    """Width of a line."""
    _register_fonts()
    return stringWidth(text, font, size_mm)


def _cut(text: str, font: str, size_mm: float, room_mm: float) -> str:
    """Cut a line to the room, with … at its end; by bisection, as a line may be very long."""

    def is_wide(line: str) -> bool:
        # a hair of room for rounding, or a line that just fits would be cut
        return measure_text_mm(line, font, size_mm) > room_mm * 1.0001

    if len(text) < 2 or not is_wide(text):
        return text
    # the line loses at least two letters, the last for the …
    kept = bisect(range(1, len(text) - 1), False, key=lambda length: is_wide(f"{text[:length]}…"))
    return f"{text[:kept]}…"


def _drawable(text: str, font: str) -> str:
    """`text` with a question mark for each character that the font lacks; a missing glyph would print as nothing."""
    known = getFont(font).face.charToGlyph
    return "".join(letter if ord(letter) in known else "?" for letter in text)


@cache
def _srgb_profile() -> bytes:
    """An ICC profile of sRGB, the same bytes every time (LittleCMS writes the time into it)."""
    from PIL import ImageCms

    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    profile[24:36] = bytes.fromhex("07d0 0001 0001 0000 0000 0000")  # dateTimeNumber, ICC.1:2010 table 17
    profile[84:100] = bytes(16)  # profile ID, optional: it is a hash over the rest
    return bytes(profile)


class _UndatedInfo(PDFInfo):
    """ReportLab's reproducible mode writes 1 January 2000, which is false; no date is better."""

    def format(self, document: Any) -> bytes:
        names = ("title", "author", "subject", "keywords", "creator", "producer")
        return PDFDictionary({name.title(): PDFString(getattr(self, name)) for name in names}).format(document)


class Pdf(ReportLabCanvas):
    """ReportLab's canvas in millimetres, y upwards; the same drawing gives the same bytes.

    Sizes, places and widths of its own methods are in millimetres; `room_mm` is the greatest width of a line of text.
    """

    def __init__(self, paper: Paper, title: str, subject: str, keywords: Mapping[str, object]) -> None:
        """Open a document of that paper and fill its information dictionary."""
        _register_fonts()
        self.buffer = BytesIO()
        super().__init__(
            self.buffer, pagesize=_page_size(paper), pageCompression=1, invariant=1, pdfVersion=(1, 7),
            initialFontName=PLAIN, lang="en",
        )  # fmt: skip
        # Print dialogs that honour these start at 100 %, one-sided, on the paper of this size.
        self.setViewerPreference("PrintScaling", "None")
        self.setViewerPreference("Duplex", "Simplex")
        # ReportLab has no call for this entry, so it goes into its dictionary
        preferences = self._doc.Catalog.ViewerPreferences
        preferences.dict["PickTrayByPDFSize"] = "true"  # PDF 1.7; ReportLab's own list ends at 1.6
        self.setViewerPreference("DisplayDocTitle", "true")
        # no time in the file: the same patch gives the same bytes
        info = self._doc.info = _UndatedInfo()
        info.title, info.subject, info.producer = title, subject, "ReportLab"
        info.author = info.creator = f"toolkit {__version__}"
        info.keywords = ", ".join(f"{name}={value}" for name, value in keywords.items())
        self._layers: dict[str, PDFObjectReference] = {}

    @contextmanager
    def page(self, paper: Paper | None = None) -> Iterator[None]:
        """Draw one page; of another paper than the page before if `paper` is given."""
        if paper is not None:
            self.setPageSize(_page_size(paper))
        self.scale(POINTS_PER_MM, POINTS_PER_MM)
        yield
        self.showPage()
        if self._layers:  # ReportLab has no layers: its page is finished early, and gets them
            page = self._doc.Pages.pages[-1]
            page.check_format(self._doc)
            page.Resources.Properties = dict(self._layers)

    @contextmanager
    def layer(self, name: str) -> Iterator[None]:
        """Draw on a layer, which viewers and cutting programs switch on and off (ISO 32000-1, 8.11)."""
        if name not in self._layers:
            group = PDFDictionary({"Type": PDFName("OCG"), "Name": PDFString(name)})
            self._layers[name] = self._doc.Reference(group)
            layers = list(self._layers.values())
            shown = PDFDictionary({"ON": PDFArray(layers), "Order": PDFArray(layers), "BaseState": PDFName("ON")})
            # ReportLab writes the entries of the catalogue that it knows: the new entry is added to its list
            catalog = self._doc.Catalog
            catalog.OCProperties = PDFDictionary({"OCGs": PDFArray(layers), "D": shown})
            catalog.__NoDefault__ = [*type(catalog).__NoDefault__, "OCProperties"]
        # what is drawn from here to the end mark belongs to the layer
        self._code.append(f"/OC /{name} BDC")
        yield
        self._code.append("EMC")

    def spot_ink(self, name: str, cmyk: tuple[float, float, float, float], line_mm: float) -> None:
        """Draw lines in a separate ink (a separation, ISO 32000-1, 8.6.6.4), shown as `cmyk` without it."""
        self.setStrokeColor(CMYKColorSep(*cmyk, spotName=name))
        self.setLineWidth(line_mm)

    def finish(self) -> bytes:
        """Return the bytes of the file."""
        self.save()
        return self.buffer.getvalue()

    def srgb(self) -> PDFArray:
        """Return the colour space sRGB."""
        icc = PDFStream(PDFDictionary({"N": 3, "Alternate": PDFName("DeviceRGB")}), _srgb_profile())
        return PDFArray([PDFName("ICCBased"), self._doc.Reference(icc)])

    @contextmanager
    def moved(self, x: float, y: float, turn_deg: float | None = None, scale: float | None = None) -> Iterator[None]:
        """Draw about (x, y), turned counter-clockwise, then scaled; then restore colours and lines."""
        self.saveState()
        self.translate(x, y)
        if turn_deg is not None:
            self.rotate(turn_deg)
        if scale is not None:
            self.scale(scale, scale)
        yield
        self.restoreState()

    def grey(self, value: float) -> None:
        """Fill and lines in a grey of the printer's own black, 0 is black."""
        self.setFillGray(value)
        self.setStrokeGray(value)

    def ink(self, colour: Colour, line_mm: float | None = None, fill: Colour | None = None) -> None:
        """Set the colour and width of lines, and the fill, which is the same colour by default."""
        self.setFillColorRGB(*(fill or colour))
        self.setStrokeColorRGB(*colour)
        if line_mm is not None:
            self.setLineWidth(line_mm)

    def text(
        self, text: str, x: float, y: float, size_mm: float, room_mm: float, font: str = PLAIN, align: str = "left"
    ) -> float:
        """Draw one line, made smaller until it fits `room_mm`, and cut with … below 1.2 mm; returns its width.

        Its baseline is y; x is its left end, middle or right end, as `align` (`left`, `centre`, `right`) says.
        """
        text = _drawable(text, font)
        width = measure_text_mm(text, font, size_mm)
        if width > room_mm:
            # text widths grow with the size, so that one division finds the size that fits
            size_mm = max(SMALLEST_MM, size_mm * room_mm / width)
            text = _cut(text, font, size_mm, room_mm)
            width = measure_text_mm(text, font, size_mm)
        self.setFont(font, size_mm)
        self.drawString(x - {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * width, y, text)
        return width

    def write(
        self, text: str, x: float, y: float, size_mm: float, room_mm: float, font: str = PLAIN, align: str = "left",
        colour: Colour = INK,
    ) -> float:  # fmt: skip
        """`text` in a colour."""
        self.ink(colour)
        return self.text(text, x, y, size_mm, room_mm=room_mm, font=font, align=align)

    def write_lines(self, text: str, x: float, y: float, size_mm: float, room_mm: float) -> float:
        """A paragraph broken at blanks, first baseline at y; returns the baseline that a next line would have."""
        line = ""
        words = _drawable(text, PLAIN).split(" ")
        for i, word in enumerate(words):
            line = f"{line} {word}".strip()
            following = f"{line} {words[i + 1]}" if i + 1 < len(words) else None
            if following is None or measure_text_mm(following, PLAIN, size_mm) > room_mm:
                self.write(line, x, y, size_mm, room_mm=room_mm)
                y -= 1.38 * size_mm
                line = ""
        return y

    def write_on_white(
        self, text: str, x: float, y: float, size_mm: float, font: str = PLAIN, colour: Colour = INK,
        plate: Colour = WHITE,
    ) -> None:  # fmt: skip
        """A line centred at (x, y) on a plate, so that lines below do not cross it."""
        width = measure_text_mm(text, font, size_mm)
        self.ink(plate)
        # the plate is centred on the capitals' middle, 0.36 of the size above the baseline
        self.rect(x - width / 2 - 0.4, y - 0.55 * size_mm, width + 0.8, 1.1 * size_mm, stroke=0, fill=1)
        self.write(text, x, y - 0.36 * size_mm, size_mm, room_mm=width + 1, font=font, align="centre", colour=colour)

    def badge(self, text: str, x: float, y: float, radius: float) -> None:
        """A short text in a white disc with a dark rim, which shows on any picture."""
        self.ink(INK, 0.25, fill=WHITE)
        self.circle(x, y, radius, stroke=1, fill=1)
        self.write(text, x, y - 0.45 * radius, 1.25 * radius, room_mm=1.8 * radius, font=BOLD, align="centre")

    def heading(self, area: Rect, words: str, colour: Colour = INK) -> float:
        """A part's title at the top of its area; returns the baseline of the line below."""
        self.write(words, area.x, area.top - 3.2, 3.7, room_mm=area.width, font=BOLD, colour=colour)
        return area.top - 9.2

    def shape(self, points: Iterable[Point], fill: bool = True) -> None:
        """A polygon, filled or outlined."""
        self.shapes([points], fill)

    def shapes(self, outlines: Iterable[Iterable[Sequence[float]]], fill: bool = True) -> None:
        """Polygons as one shape, filled by the even-odd rule, or outlined."""
        self.drawPath(self._path(outlines), stroke=int(not fill), fill=int(fill))

    @contextmanager
    def clipped(self, outlines: Iterable[Iterable[Sequence[float]]]) -> Iterator[None]:
        """Clip to polygons, together a shape by the even-odd rule."""
        self.saveState()
        self.clipPath(self._path(outlines), stroke=0, fill=0, fillMode=0)
        yield
        self.restoreState()

    def _path(self, outlines: Iterable[Iterable[Sequence[float]]]) -> PDFPathObject:
        path = self.beginPath()
        for outline in outlines:
            for i, (x, y) in enumerate(outline):
                (path.lineTo if i else path.moveTo)(float(x), float(y))
            path.close()
        return path

    def rects(self, rects: np.ndarray, top: float) -> None:
        """Fill (k, 4) rectangles left, upper, right, lower, counted downwards from `top`, without seams."""
        path = self.beginPath()
        for left, upper, right, lower in rects.tolist():
            path.rect(left, top - lower, right - left, lower - upper)
        self.drawPath(path, stroke=0, fill=1, fillMode=1)

    def head(self, tip: Point, angle_deg: float, length: float = 1.6) -> None:
        """An arrow's head whose tip is there, pointing along the angle (counter-clockwise from the right)."""
        with self.moved(*tip, angle_deg):
            self.shape([(0, 0), (-length, 0.36 * length), (-length, -0.36 * length)])

    def arrow(self, start: Point, end: Point, head: float = 1.6) -> None:
        """A line with a head at its end."""
        way = np.subtract(end, start)
        length = float(np.hypot(*way))
        if length < 1e-6:
            return
        # the line ends inside the head, so that its square end does not blunt the tip
        stop = np.asarray(end) - way / length * min(0.8 * head, length)
        self.line(*start, float(stop[0]), float(stop[1]))
        self.head(end, _angle_deg(way), head)

    def block_arrow(self, start: Point, end: Point, width: float, colour: Colour) -> None:
        """A broad arrow with a white rim, which shows on any picture."""
        way = np.subtract(end, start)
        length = float(np.hypot(*way))
        neck, half = length - min(1.9 * width, 0.6 * length), width / 2
        with self.moved(*start, _angle_deg(way)):
            path = self.beginPath()
            path.moveTo(0, half)
            for x, y in ((neck, half), (neck, 2.3 * half), (length, 0), (neck, -2.3 * half), (neck, -half), (0, -half)):
                path.lineTo(x, y)
            path.close()
            self.ink(WHITE, 0.5, fill=colour)
            self.drawPath(path, stroke=1, fill=1)

    def dimension(self, start: Point, end: Point, text: str, size_mm: float = 2.7) -> None:
        """A dimension line with heads at both ends and its number on a white plate in the middle, upright."""
        self.ink(INK, 0.18)
        way = np.subtract(end, start)
        angle = _angle_deg(way)
        self.line(*start, *end)
        # a dimension shorter than its two heads has none, as they would lie on each other
        if float(np.hypot(*way)) > 3.0:
            self.head(end, angle, 1.3)
            self.head(start, angle + 180, 1.3)
        self.write_on_white(text, (start[0] + end[0]) / 2, (start[1] + end[1]) / 2, size_mm)

    def tick_box(self, x: float, y: float) -> None:
        """An empty box whose lower left corner is (x, y)."""
        self.ink(INK, 0.3, fill=WHITE)
        self.roundRect(x, y, TICK_MM, TICK_MM, 0.5, stroke=1, fill=1)

    def panel(self, area: Rect, colour: Colour = WASH) -> None:
        """A rounded, tinted rectangle."""
        self.ink(colour)
        self.roundRect(area.x, area.y, area.width, area.height, 1.6, stroke=0, fill=1)

    def camera(self, at: Point, angle_deg: float) -> None:
        """A camera whose lens is at `at` and looks along the angle."""
        with self.moved(*at, angle_deg):
            self.ink(CAMERA)
            size = 3.4  # mm
            self.roundRect(-1.25 * size, -0.5 * size, 0.9 * size, size, 0.14 * size, stroke=0, fill=1)
            self.shape([(u * size, v * size) for u, v in ((-0.4, -0.18), (0, -0.34), (0, 0.34), (-0.4, 0.18))])

    def arc_about(self, centre: Point, radius: float, start_deg: float, extent_deg: float) -> None:
        """An arc, counter-clockwise from `start_deg`."""
        x, y = centre
        self.arc(x - radius, y - radius, x + radius, y + radius, start_deg, extent_deg)

    def raster(self, name: str, pixels: np.ndarray, area: Rect) -> None:
        """(h, w, 3) uint8 sRGB pixels as squares over an area, losslessly; stored once under their name."""
        key = self._doc.getXObjectName(name)
        # the profile and the pixels are objects of the file, written once however often they are drawn
        if key not in self._doc.idToObject:
            if SRGB_IMAGES not in self._doc.idToObject:
                self._doc.Reference(self.srgb(), SRGB_IMAGES)
            height, width, _ = pixels.shape
            entries = {
                "Type": PDFName("XObject"), "Subtype": PDFName("Image"), "Width": width, "Height": height,
                "BitsPerComponent": 8, "ColorSpace": PDFObjectReference(SRGB_IMAGES), "Interpolate": "false",
            }  # fmt: skip
            image = PDFStream(PDFDictionary(entries), np.ascontiguousarray(pixels).tobytes(), [PDFZCompress])
            self._doc.Reference(image, key)
        # ReportLab lists the pictures of a page here, for its resources
        self._formsinuse.append(name)
        with self.moved(area.x, area.y):
            self._code.append(f"{area.width:.6g} 0 0 {area.height:.6g} 0 0 cm /{key} Do")

    def picture(self, jpeg: bytes, area: Rect, frame: Colour | None = FAINT) -> None:
        """A JPEG stretched over an area, with a thin frame."""
        self.drawImage(ImageReader(BytesIO(jpeg)), area.x, area.y, area.width, area.height)
        if frame is not None:
            self.setStrokeColorRGB(*frame)
            self.setLineWidth(0.2)
            self.rect(area.x, area.y, area.width, area.height, stroke=1, fill=0)


def _page_size(paper: Paper) -> tuple[float, float]:
    return paper.width_mm * POINTS_PER_MM, paper.height_mm * POINTS_PER_MM


def _angle_deg(way: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(way[1], way[0])))
