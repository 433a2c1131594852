"""Print the pieces of a wrap at true size, with a page of instructions and outlines for a cutting machine."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from toolkit import __version__
from toolkit.core.console import notice
from toolkit.core.files import write_bytes
from toolkit.core.lazy import scipy, shapely
from toolkit.core.text import count_of, list_some
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.printing import PrintSettings, WrapSettings
from toolkit.printing.canvas import BOLD, INK, SOFT, WHITE, Pdf, Point, measure_text_mm
from toolkit.printing.document import HASH_DIGITS
from toolkit.printing.marks import (
    PatchLabel,
    SheetDrawing,
    draw_frame,
    draw_pages,
    draw_strip,
    reserve_strip,
    strip_area,
)
from toolkit.printing.page import (
    LARGEST_MM,
    SMALLEST_MM,
    PageFrame,
    PagePlan,
    Paper,
    Rect,
    StripPlace,
    plan_sheet,
    turn_frames,
)
from toolkit.printing.print_patches import name_pdf, shorten
from toolkit.rooms.wraps.cutting.net import TAB_MM
from toolkit.rooms.wraps.livery import find_way
from toolkit.rooms.wraps.printing.nesting import CutSheet, Nested, fits, nest, write_dxf, write_svg
from toolkit.rooms.wraps.printing.wrap_views import SideView, draw_sides, place_sides
from toolkit.rooms.wraps.printing.wrap_words import (
    NUMBER_HIGH_MM,
    PlaceFinder,
    box_about,
    place_numbers,
    smooth_outline,
)
from toolkit.rooms.wraps.wrap import BLEED_MM, PieceRecord, Wrap, check_wrap, hash_wrap, read_wrap

if TYPE_CHECKING:
    from shapely import Polygon

CUT = "CutContour"
"""The spot colour and the layer that print-and-cut machines (Roland, Mimaki, Graphtec, Summa) look for."""
CUT_CMYK = (0.0, 1.0, 0.0, 0.0)
CUT_LINE_MM = 0.25 / 72 * 25.4
"""A quarter of a point, as those machines' manuals ask."""
ROOM_MM = 7.0
"""Paper round a piece's box: bleed, and its number outside it."""
LEAST_ROOM_MM = 2.2
"""Paper round the box of a piece that nearly fills the page, mm."""
LETTER_MM, NUMBER_MM = 1.9, 5.6
HALO_MM, HAND_LINE_MM = 1.0, 0.35
"""Widths of the line for scissors, mm: white under black, so that it shows on any picture."""
FOLD_HALO_MM = 0.5
MOUNTAIN, VALLEY = (1.2, 0.9), (2.4, 0.8, 0.3, 0.8)
"""Dashes and gaps of folds, mm: dashed where paper is folded back, dash and dot where it is folded towards you."""
TICK_MM = 1.2
MOST_LISTED = 5
SAY_MARKS = "Page 1 lists the order. Equal letters meet, arrows show which way is up."
CUT_BY_HAND = f"Cut along the black line in the white one. {SAY_MARKS}"
CUT_BY_MACHINE = f"The fine magenta line is CutContour, the machine's path. {SAY_MARKS}"
FOLD_IT = "Dashed: fold back; dash and dot: fold towards you. Glue tab A under edge A."
ASSEMBLE = "Cut out and stick on a piece at a time, in this order, each to the letters of those that are there."


@dataclass(frozen=True)
class PlacedPiece:
    """The place of a piece.

    Attributes:
        number: number of the piece.
        page: page of the PDF, from 1; for a tiled piece, that with the map of its tiles.
        x_mm, y_mm: place of its box's lower left corner on the page; 0 for a tiled piece.
        quarters: turns by 90 degrees about that corner, counter-clockwise.
        tiles: rows and columns of pages, (1, 1) for a whole piece.
    """

    number: int
    page: int
    x_mm: float
    y_mm: float
    quarters: int = 0
    tiles: tuple[int, int] = (1, 1)

    def to_page(self, points_mm: np.ndarray) -> np.ndarray:
        """Return the places (..., 2) on the page of places on the piece."""
        # exact turns: cosine and sine of quarters have no rounding
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[self.quarters]
        x, y = np.moveaxis(np.asarray(points_mm, float), -1, 0)
        return np.stack([cosine * x - sine * y + self.x_mm, sine * x + cosine * y + self.y_mm], axis=-1)


@dataclass(frozen=True)
class PrintedWrap:
    """A PDF that was written.

    Attributes:
        file: the PDF.
        name, object: names of the wrap and of its object.
        pages: number of pages; the first shows how the pieces are stuck on.
        paper, orientation: paper of the pages with pieces.
        sizes_mm: width and height of each page.
        placed: place of each piece.
        order: the pieces' numbers as they are stuck on.
        roll_mm: width of the roll that pieces are on, None for sheets.
        cut_files: outlines for a machine.
        is_trained: whether the pieces show a trained picture.
        shows: picture of an untrained wrap: its name, or the object's own paint.
    """

    file: str
    name: str
    object: str
    pages: int
    paper: str
    orientation: str
    sizes_mm: tuple[tuple[float, float], ...]
    placed: tuple[PlacedPiece, ...]
    order: tuple[int, ...]
    roll_mm: float | None = None
    cut_files: tuple[str, ...] = ()
    is_trained: bool = True
    shows: str | None = None

    def describe(self) -> str:
        """Return the file, its pieces and the number of pages in a line."""
        tiled = [piece for piece in self.placed if piece.tiles != (1, 1)]
        tiles = "".join(f"; piece {piece.number} in {piece.tiles[0]} × {piece.tiles[1]} tiles" for piece in tiled)
        width, height = self.sizes_mm[-1]
        paper = f"{self.paper} {self.orientation}" if self.roll_mm is None else f"{width:g} × {height:.0f} mm of a roll"
        pages = f"{count_of(self.pages, 'page')}, the first how to stick them on"
        pieces = f"{count_of(len(self.placed), 'piece')} on {paper}"
        untrained = "" if self.is_trained else f"; not trained, it shows {self.shows}"
        return f"{shorten(self.file)} for {self.object}: {pieces}, {pages}{tiles}{untrained}"


@dataclass(frozen=True)
class _Label:
    """Words outside a piece: their place in its own millimetres, and the point that they label."""

    text: str
    at: Point
    about: Point


@dataclass(frozen=True)
class _Sheet:
    """A piece as pages show it.

    Attributes:
        record: its record in the wrap.
        outline: line of the cut, with glue tabs.
        room_mm: paper beside and above its box.
        letters: letters at its seams.
        way, way_deg: the word at its arrow, and the arrow's angle on the piece.
        solid: the piece with its bleed and its letters, on which nothing else may lie.
        footprint: `solid`, and room for its number.
    """

    record: PieceRecord
    outline: "Polygon"
    room_mm: tuple[float, float]
    letters: tuple[_Label, ...]
    way: str
    way_deg: float
    solid: "Polygon"
    footprint: "Polygon"

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of its box with the paper round it, mm."""
        (x, y), record = self.room_mm, self.record
        return record.width_mm + 2 * x, record.height_mm + 2 * y


def print_wrap(
    workspace: Workspace, name: str, settings: PrintSettings | None = None, wanted: WrapSettings | None = None,
    out: Path | None = None,
) -> PrintedWrap:  # fmt: skip
    """Print a wrap's pieces at true size, and write their outlines where a machine cuts them.

    The first page shows the object from six sides with its pieces numbered, their order, and the colour strip. Each
    piece has 1.5 mm of bleed. The cut line for scissors is black in white, without teeth that scissors cannot follow.
    For a machine it is the exact outline in the spot colour `CutContour`, on a layer of that name. The same wrap gives
    the same bytes.

    Args:
        workspace: folder with the wrap.
        name: name of the wrap.
        settings: paper and orientation; by default A4. The object decides the size, so no other field may be set.
        wanted: a roll in place of sheets, and the format of the outlines.
        out: a folder, or the PDF; by default `print/NAME-wrap.pdf`.

    Raises:
        ToolkitError: no such wrap, it is of another mesh, a size is asked for, or a file cannot be written.

    Example:
        >>> _ = trimesh.creation.cylinder(0.03, 0.09).export("can.glb")
        >>> space = tk.make_workspace(Path("space"))
        >>> added = tk.add_object(space, Path("can.glb"), tk.ObjectRequest(class_name="can"))
        >>> wrap = tk.plan_wrap(added.item, tk.WrapConfig(pieces=1, views=8))
        >>> _ = tk.write_wrap(space.wraps_dir / "can", wrap)
        >>> printed = tk.print_wrap(space, "can", wanted=tk.WrapSettings(cut="dxf"))
        >>> printed.pages, len(printed.placed), len(printed.cut_files)
        (2, 1, 1)
    """
    settings, wanted = settings or PrintSettings(), wanted or WrapSettings()
    why = "belongs to patches: a wrap has the size of its object"
    settings.refuse(why, "scale_percent", "dpi", "size_mm", "copies", "margin_mm", "margin")
    wrap = read_wrap(workspace.wrap(name))
    item = load_object(workspace.object_spec(wrap.record.object))
    check_wrap(wrap, item)
    pdf_file = name_pdf(out or workspace.print_dir, f"{name}-wrap.pdf")
    by_machine = wanted.cut is not None or wanted.roll_mm is not None
    printed, content, sheets = build_wrap_pdf(wrap, item, settings, wanted.roll_mm, by_machine)
    write_bytes(pdf_file, content)
    cut_files = []
    for page, sheet in _list_cuts(printed, sheets) if wanted.cut else ():
        file = pdf_file.with_name(f"{pdf_file.stem}-{page}.{wanted.cut}")
        write_bytes(file, write_dxf(sheet, CUT) if wanted.cut == "dxf" else write_svg(sheet, CUT))
        cut_files.append(str(file))
    # with other paper or pieces an earlier print had more pages: a machine must not cut them
    earlier = [file for file in _find_cut_files(pdf_file) if str(file) not in cut_files]
    if earlier:
        names = list_some([file.name for file in earlier], MOST_LISTED)
        notice(f"{names}: outlines of an earlier print, which may not fit the pieces of {pdf_file.name}: delete them")
    return replace(printed, file=str(pdf_file), cut_files=tuple(cut_files))


def build_wrap_pdf(
    wrap: Wrap, item: TableObject, settings: PrintSettings, roll_mm: float | None = None, by_machine: bool = False
) -> tuple[PrintedWrap, bytes, "dict[int, Polygon]"]:
    """Draw the pages of a wrap.

    Args:
        wrap: a wrap with its picture.
        item: its object.
        settings: paper and orientation.
        roll_mm: width of a roll for the pieces; the first page stays on `settings.paper`.
        by_machine: whether a machine cuts them, along the exact outline.

    Returns:
        What was printed (without files), the PDF, and the outlines by number.
    """
    layout = _lay_out(wrap, item, settings, roll_mm, by_machine)
    label, keywords = _describe_wrap(wrap, item)
    first = turn_frames(settings.paper, "portrait" if settings.orientation == "auto" else settings.orientation)[0]
    pdf = Pdf(first.paper, f"{wrap.record.object} wrap, {len(wrap.pieces)} pieces", label.size, keywords)
    order = order_pieces(wrap.record.pieces)
    strip, rest = next(reserve_strip(first.content), (None, first.content))
    with pdf.page():
        _draw_assembly(pdf, rest, draw_sides(item.mesh, wrap), order, wrap.record.pieces)
        # on a roll the strip is printed there, beside the pieces
        if strip is not None and roll_mm is None:
            draw_strip(pdf, strip)
        pdf.grey(0)
        draw_frame(pdf, first, label, f"{first.paper.describe()}, page 1 of {layout.total}", ASSEMBLE)
    placed = [*_draw_nested(pdf, wrap, layout, label), *_draw_tiled(pdf, wrap, layout, label)]
    papers = [first.paper, *(layout.frame.paper for _ in layout.pages)]
    papers += [plan.frame.paper for _, plan in layout.tiled for _ in plan.pages]
    printed = PrintedWrap(
        file="", name=wrap.record.name, object=wrap.record.object, pages=layout.total, paper=layout.frame.paper.name,
        orientation=layout.frame.paper.orientation,
        sizes_mm=tuple((paper.width_mm, paper.height_mm) for paper in papers),
        placed=tuple(sorted(placed, key=lambda piece: piece.number)), order=tuple(order), roll_mm=roll_mm,
        is_trained=wrap.record.booster is not None, shows=wrap.record.what_is_on_it,
    )  # fmt: skip
    return printed, pdf.finish(), {sheet.record.number: sheet.outline for sheet in layout.sheets}


def _describe_wrap(wrap: Wrap, item: TableObject) -> tuple[PatchLabel, dict[str, object]]:
    """Return the header of each page, and the keywords of the PDF."""
    record, pictures = wrap.record, hash_wrap(wrap.record)
    label = PatchLabel(
        f"{record.class_name or record.object} wrap"
        + ("" if record.name == record.object else f" ({record.name})")
        + ("" if record.booster else f", {record.picture.name if record.picture else 'NOT TRAINED'}"),
        f"{len(record.pieces)} pieces for {record.object}, {max(item.mesh.size_mm):.1f} mm long   (texels of "
        f"{record.texel_mm:g} mm, {record.material})",
        f"map sha256 {record.map_sha256[:HASH_DIGITS]}   ·   pictures {pictures[:HASH_DIGITS]}   ·   "
        f"toolkit {__version__}",
    )
    return label, {
        "wrap": record.name, "object": record.object, "pieces": len(record.pieces), "map_sha256": record.map_sha256,
        "pictures_sha256": pictures,
    }  # fmt: skip


def _draw_nested(pdf: Pdf, wrap: Wrap, layout: "_Layout", label: PatchLabel) -> Iterator[PlacedPiece]:
    """Draw the pages with several pieces each."""
    paper = layout.frame.paper
    for number, (nested, strip) in enumerate(layout.pages, start=2):
        sheets = [layout.sheets[place.index] for place in nested]
        places = [
            PlacedPiece(sheet.record.number, number, place.x_mm, place.y_mm, place.quarters)
            for place, sheet in zip(nested, sheets, strict=True)
        ]
        solids = [shapely.transform(sheet.solid, here.to_page) for sheet, here in zip(sheets, places, strict=True)]
        widths = [_number_width(sheet.record.number, sheet.way) for sheet in sheets]
        others = [] if strip is None else [_as_box(strip_area(strip))]
        numbers = place_numbers(_as_box(layout.frame.content), solids, widths, others)
        with pdf.page(paper):
            for spot, sheet, here, at in zip(nested, sheets, places, numbers, strict=True):
                _draw_piece(pdf, wrap, spot.index, sheet, here, at, layout.by_machine)
                yield here
            if strip is not None:
                draw_strip(pdf, strip)
            pdf.grey(0)
            draw_frame(pdf, layout.frame, label, f"{paper.describe()}, page {number} of {layout.total}", layout.advice)


def _draw_tiled(pdf: Pdf, wrap: Wrap, layout: "_Layout", label: PatchLabel) -> Iterator[PlacedPiece]:
    """Draw the pages of pieces that are joined from several."""
    number = 2 + len(layout.pages)
    for index, plan in layout.tiled:
        yield PlacedPiece(index + 1, number, 0.0, 0.0, tiles=plan.tiles)
        drawing = _describe_tiled(pdf, wrap, index, layout, label)
        draw_pages(pdf, plan, drawing, number, layout.total, f"piece {index + 1}, ", plan.frame.paper)
        number += len(plan.pages)


_Pages = list[tuple[list[Nested], StripPlace | None]]


@dataclass(frozen=True)
class _Layout:
    """Places of all pieces.

    Attributes:
        frame: frame of the pages with pieces.
        pages: pieces nested on each of them, and place of its colour strip.
        tiled: index of each piece that is larger than a page, and its pages.
        sheets: all pieces with their words.
        by_machine: whether a machine cuts them.
    """

    frame: PageFrame
    pages: _Pages
    tiled: list[tuple[int, PagePlan]]
    sheets: list[_Sheet]
    by_machine: bool

    @property
    def total(self) -> int:
        """Number of pages, with the first page."""
        return 1 + len(self.pages) + sum(len(plan.pages) for _, plan in self.tiled)

    @property
    def advice(self) -> str:
        """Advice on pages with pieces."""
        cut = CUT_BY_MACHINE if self.by_machine else CUT_BY_HAND
        return f"{cut} {FOLD_IT}" if any(sheet.record.tabs for sheet in self.sheets) else cut


def _lay_out(
    wrap: Wrap, item: TableObject, settings: PrintSettings, roll_mm: float | None, by_machine: bool
) -> _Layout:
    """Return the layout with fewer pages, upright or level."""
    if roll_mm is not None:
        # as long as a PDF page can be; what is not used is cut off below
        frames = [PageFrame(Paper(f"roll of {roll_mm:g} mm", roll_mm, LARGEST_MM))]
    else:
        frames = turn_frames(settings.paper, settings.orientation)
    found = []
    for frame in frames:
        sheets = [_describe_piece(wrap, item, index, frame.content, by_machine) for index in range(len(wrap.pieces))]
        # pieces that fit on a page are nested, larger ones are tiled
        whole = [index for index, sheet in enumerate(sheets) if fits(sheet.footprint, frame.content)]
        tiled = [
            (index, plan_sheet(frame.paper, frame.paper.orientation, *sheet.size_mm))
            for index, sheet in enumerate(sheets) if index not in whole
        ]  # fmt: skip
        shapes = [sheets[index].footprint for index in whole]
        if roll_mm is None:
            pages: _Pages = [(page, None) for page in nest(shapes, frame.content)] if shapes else []
        else:
            frame, pages = _cut_roll(frame, shapes)
        named = [([replace(place, index=whole[place.index]) for place in nested], strip) for nested, strip in pages]
        found.append(_Layout(frame, named, tiled, sheets, by_machine))
    return min(found, key=lambda layout: layout.total)


def _cut_roll(frame: PageFrame, shapes: "Sequence[Polygon]") -> tuple[PageFrame, _Pages]:
    """A roll cut off behind its pieces, with the colour strip below those of the first length."""
    from shapely import affinity

    strip, room = next(reserve_strip(frame.content))
    # two thirds of a page are easily filled; where that is too short, there is a second
    wanted = 1.5 * sum(shape.envelope.area for shape in shapes) / room.width
    tallest = max((max(np.subtract(shape.bounds[2:], shape.bounds[:2])) for shape in shapes), default=0.0)
    length = float(min(room.height, max(wanted, tallest + 1)))
    pages = nest(shapes, Rect(room.x, room.y, room.width, length)) if shapes else []
    # what is free below the lowest piece is cut off
    lowest = [
        affinity.translate(
            affinity.rotate(shapes[place.index], 90 * place.quarters, (0, 0)), place.x_mm, place.y_mm
        ).bounds[1]
        for nested in pages for place in nested
    ]  # fmt: skip
    spare = max(0.0, min(lowest, default=room.y) - room.y)
    height = max(frame.paper.height_mm - room.height + length - spare, SMALLEST_MM)
    down = [[replace(place, y_mm=place.y_mm - spare) for place in nested] for nested in pages]
    paper = Paper(frame.paper.name, frame.paper.width_mm, height)
    return PageFrame(paper), [(nested, None if number else strip) for number, nested in enumerate(down)]


def _describe_piece(wrap: Wrap, item: TableObject, index: int, room: Rect, by_machine: bool) -> _Sheet:
    """Return a piece with the most room for words with which it fits on a page; full room if it does not fit."""
    way, way_deg = find_way(wrap.pieces[index], item.mesh)
    outline = _join_tabs(wrap, index)
    outline = outline if by_machine else smooth_outline(outline)
    # tabs reach beyond the outline, and words have to stand off them
    tabs_mm = TAB_MM if wrap.record.pieces[index].tabs else 0.0
    most, least = ROOM_MM + tabs_mm, LEAST_ROOM_MM + tabs_mm
    rooms = ((most, most), (least, most), (most, least), (least, least))
    sheets = [_write_round(wrap.record.pieces[index], outline, room_mm, way, way_deg) for room_mm in rooms[:1]]
    if not fits(sheets[0].footprint, room):
        sheets += [_write_round(wrap.record.pieces[index], outline, room_mm, way, way_deg) for room_mm in rooms[1:]]
    return next((sheet for sheet in sheets if fits(sheet.footprint, room)), sheets[0])


def _write_round(
    record: PieceRecord, outline: "Polygon", room_mm: tuple[float, float], way: str, way_deg: float
) -> _Sheet:
    """Return a piece with the words that find paper within `room_mm` beside and above it."""
    finder = PlaceFinder((record.width_mm, record.height_mm), outline, room_mm)
    letters = []
    for seam in record.seams:
        text = seam.letter if seam.piece == record.number else f"{seam.letter}→{seam.piece}"
        at = finder.beside(seam.middle_mm, measure_text_mm(text, BOLD, LETTER_MM), LETTER_MM)
        if at is not None:
            letters.append(_Label(text, at, seam.middle_mm))
    solid = finder.footprint()
    # where on the page the number goes is decided when all pieces lie there: room for it is kept here
    finder.anywhere(_number_width(record.number, way), NUMBER_HIGH_MM)
    return _Sheet(
        record, outline, room_mm, tuple(letters), way=way, way_deg=way_deg, solid=solid, footprint=finder.footprint()
    )


def _as_box(area: Rect) -> "Polygon":
    return shapely.box(area.x, area.y, area.right, area.top)


def _join_tabs(wrap: Wrap, index: int) -> "Polygon":
    """Return the outline of a piece with its glue tabs."""
    outline, tabs = wrap.pieces[index].outline(), wrap.record.pieces[index].tabs
    if not tabs:
        return outline
    # rounding may separate a tab from its edge: it reaches a little into the piece
    return shapely.union_all(
        [outline, *(shapely.Polygon(tab.outline_mm).buffer(1e-3, join_style="mitre") for tab in tabs)]
    )


def _number_width(number: int, way: str) -> float:
    return measure_text_mm(str(number), BOLD, NUMBER_MM) + 5.6 + measure_text_mm(way, BOLD, LETTER_MM)


def order_pieces(pieces: Sequence[PieceRecord]) -> list[int]:
    """Return numbers in the order to stick on: the largest first, then the piece with most edges at those there."""
    left = {piece.number: piece for piece in pieces}
    order: list[int] = []
    while left:
        there = set(order)
        chosen = max(
            left.values(),
            key=lambda piece: (sum(seam.piece in there for seam in piece.seams), piece.area_mm2, -piece.number),
        )
        order.append(chosen.number)
        del left[chosen.number]
    return order


def _rings(outline: "Polygon") -> list[np.ndarray]:
    return [np.asarray(ring.coords) for ring in (outline.exterior, *outline.interiors)]


def _draw_piece(
    pdf: Pdf, wrap: Wrap, index: int, sheet: _Sheet, here: PlacedPiece, number_at: Point | None, by_machine: bool
) -> None:
    _draw_leaders(pdf, sheet, here, number_at)  # first: where a leader crosses the piece, the picture hides it
    with pdf.moved(here.x_mm, here.y_mm, 90 * here.quarters if here.quarters else None):
        _draw_flat(pdf, wrap, index, sheet, by_machine)
    _draw_words(pdf, sheet, here, number_at)


def _draw_flat(pdf: Pdf, wrap: Wrap, index: int, sheet: _Sheet, by_machine: bool) -> None:
    """Draw the picture with its bleed, ticks at the ends of seams, folds and the cut line, at the piece's corner."""
    record, texel_mm = sheet.record, wrap.record.texel_mm
    # the picture with its bleed, clipped to it
    picture, edge_px = _picture_to_bleed(wrap, index)
    height, width, _ = picture.shape
    area = Rect(-edge_px * texel_mm, -edge_px * texel_mm, width * texel_mm, height * texel_mm)
    bleed = sheet.outline.buffer(BLEED_MM)
    with pdf.clipped(_rings(bleed)):
        pdf.raster(f"piece{record.number}", picture, area)
    # seam ticks and folds
    pdf.ink(SOFT, 0.15)
    for seam in record.seams:
        for end in (seam.from_mm, seam.to_mm):
            _draw_tick(pdf, end, bleed)
    _draw_folds(pdf, record, by_machine)
    # cut lines: a layer for a machine, or a line for scissors
    rings = [ring[:-1].tolist() for ring in _rings(sheet.outline)]
    if by_machine:
        with pdf.layer(CUT):
            pdf.spot_ink(CUT, CUT_CMYK, CUT_LINE_MM)
            for ring in rings:
                pdf.shape(ring, fill=False)
        return
    for colour, width_mm in ((WHITE, HALO_MM), (INK, HAND_LINE_MM)):
        pdf.ink(colour, width_mm)
        for ring in rings:
            pdf.shape(ring, fill=False)


def _draw_folds(pdf: Pdf, record: PieceRecord, by_machine: bool) -> None:
    # folded back are its own folds, but for valleys, and the foot of each tab
    valleys = set(record.valleys_mm)
    mountains = [fold for fold in record.folds_mm if fold not in valleys]
    mountains += [(tab.outline_mm[0], tab.outline_mm[1]) for tab in record.tabs]
    kinds = ((mountains, MOUNTAIN), (record.valleys_mm, VALLEY))
    if not by_machine:
        pdf.ink(WHITE, FOLD_HALO_MM)
        for folds, _ in kinds:
            for start, end in folds:
                pdf.line(*start, *end)
    pdf.ink(INK, 0.12)
    for folds, dashes in kinds:
        pdf.setDash(dashes)
        for start, end in folds:
            pdf.line(*start, *end)
    pdf.setDash()


def _picture_to_bleed(wrap: Wrap, index: int) -> tuple[np.ndarray, int]:
    """(h, w, 3) uint8 what is printed of a piece, and its texels beyond the box on each side.

    Glue tabs and the bleed round them go on with the colour at the edge: a tab that shows in a gap is not white.
    """
    record, texel_mm, edge_px = wrap.record.pieces[index], wrap.record.texel_mm, wrap.record.bleed_px
    picture = wrap.picture(index)
    if not record.tabs:
        return picture, edge_px
    more = int(np.ceil(TAB_MM / texel_mm))
    edge_px += more
    picture = np.pad(picture, ((more, more), (more, more), (0, 0)))
    height, width, _ = picture.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, height - np.arange(height) - 0.5)
    outline = wrap.pieces[index].outline()
    off = ~shapely.contains_xy(outline, (x - edge_px) * texel_mm, (y - edge_px) * texel_mm)
    # nearest texel of the piece for each pixel outside of it: the colour at the edge goes on
    row, column = scipy.ndimage.distance_transform_edt(off, return_distances=False, return_indices=True)
    return picture[row, column], edge_px


def _draw_tick(pdf: Pdf, end: Point, bleed: "Polygon") -> None:
    """A short line that leads away from where a seam ends, beyond the bleed."""
    point = shapely.Point(end)
    near = bleed.boundary.interpolate(bleed.boundary.project(point))
    away = point.distance(near)
    if away > 1e-6:
        x, y = near.x + TICK_MM * (near.x - end[0]) / away, near.y + TICK_MM * (near.y - end[1]) / away
        pdf.line(near.x, near.y, x, y)


def _draw_leaders(pdf: Pdf, sheet: _Sheet, here: PlacedPiece, number_at: Point | None) -> None:
    """Fine lines from words that found no paper near what they are about."""
    pdf.ink(SOFT, 0.1)
    ends = [here.to_page(np.array([label.at, label.about])) for label in sheet.letters]
    if number_at is not None:
        row = box_about(number_at, _number_width(sheet.record.number, sheet.way))
        ends.append(shapely.get_coordinates(shapely.shortest_line(row, shapely.transform(sheet.outline, here.to_page))))
    for start, end in ends:
        if np.hypot(*(end - start)) > BLEED_MM + 3.5:
            pdf.line(*start.tolist(), *end.tolist())


def _draw_words(pdf: Pdf, sheet: _Sheet, here: PlacedPiece, number_at: Point | None) -> None:
    """Letters at seams, and the piece's number with the arrow up; on the piece itself if no paper is left for it."""
    for label in sheet.letters:
        x, y = here.to_page(np.array(label.at)).tolist()
        pdf.write(label.text, x, y - 0.36 * LETTER_MM, LETTER_MM, room_mm=12, font=BOLD, align="centre")
    angle_deg = sheet.way_deg + 90 * here.quarters
    if number_at is not None:
        _draw_number(pdf, *number_at, sheet, angle_deg)
        return
    inside = sheet.outline.representative_point()
    x, y = here.to_page(np.array([inside.x, inside.y])).tolist()
    width = _number_width(sheet.record.number, sheet.way)
    pdf.ink(WHITE)
    pdf.rect(x - width / 2 - 0.4, y - NUMBER_HIGH_MM / 2 - 0.4, width + 0.8, NUMBER_HIGH_MM + 0.8, stroke=0, fill=1)
    _draw_number(pdf, x, y, sheet, angle_deg)


def _draw_number(pdf: Pdf, x: float, y: float, sheet: _Sheet, angle_deg: float) -> None:
    """Number, arrow and word in a row about a point, upright on the page."""
    width = _number_width(sheet.record.number, sheet.way)
    left = x - width / 2
    number = str(sheet.record.number)
    taken = pdf.write(number, left, y - 0.36 * NUMBER_MM, NUMBER_MM, room_mm=width, font=BOLD, colour=INK)
    with pdf.moved(left + taken + 2.5, y, angle_deg):
        pdf.ink(INK, 0.3)
        pdf.arrow((-1.7, 0), (1.7, 0), 1.5)
    pdf.write(sheet.way, left + taken + 4.9, y - 0.36 * LETTER_MM, LETTER_MM, room_mm=width, font=BOLD)


def _describe_tiled(pdf: Pdf, wrap: Wrap, index: int, layout: _Layout, label: PatchLabel) -> SheetDrawing:
    """A piece that is larger than a page, for the tiles that it is joined from."""
    sheet = layout.sheets[index]
    (right, top), record = sheet.room_mm, sheet.record
    room = _as_box(Rect(-right, -top, record.width_mm + 2 * right, record.height_mm + 2 * top))
    (at,) = place_numbers(room, [sheet.solid], [_number_width(record.number, sheet.way)])

    def draw(x: float, y: float) -> None:
        here = PlacedPiece(record.number, 0, x + right, y + top)
        number_at = None if at is None else (at[0] + here.x_mm, at[1] + here.y_mm)
        _draw_piece(pdf, wrap, index, sheet, here, number_at, layout.by_machine)
        pdf.grey(0)

    return SheetDrawing(label, layout.advice, draw, name=f"piece {record.number}")


LINE_MM = 4.4


def _draw_assembly(
    pdf: Pdf, area: Rect, views: Sequence[SideView], order: Sequence[int], pieces: Sequence[PieceRecord]
) -> None:
    """Draw the object from six sides, its pieces numbered, over the list of pieces in order."""
    columns = 2 if len(order) > 6 else 1
    rows = -(-len(order) // columns)
    words = Rect(area.x, area.y, area.width, 8.0 + LINE_MM * rows)
    room = Rect(area.x, words.top + 2, area.width, area.height - words.height - 2)
    place_sides(pdf, room, views)
    pdf.write("Stick them on in this order", words.x, words.top - 4, 3.4, room_mm=words.width, font=BOLD)
    known = {piece.number: piece for piece in pieces}
    width = words.width / columns
    for step, number in enumerate(order):
        column, row = divmod(step, rows)
        x, y = words.x + column * width, words.top - 9 - LINE_MM * row
        pdf.write(f"{step + 1}.", x + 4.5, y, 2.6, room_mm=5, align="right", colour=SOFT)
        pdf.tick_box(x + 6, y - 0.8)
        pdf.write(f"piece {number}", x + 11, y, 2.6, room_mm=15, font=BOLD)
        pdf.write(_say_seams(known[number], order[:step]), x + 27, y, 2.4, room_mm=width - 30, colour=SOFT)


def _say_seams(piece: PieceRecord, there: Sequence[int]) -> str:
    meets: dict[int, list[str]] = {}
    for seam in piece.seams:
        if seam.piece in there:
            meets.setdefault(seam.piece, []).append(seam.letter)
    return ", ".join(f"meets {number} at {' '.join(letters)}" for number, letters in meets.items())


def _find_cut_files(pdf_file: Path) -> list[Path]:
    """Files beside a PDF that have the names of its outlines, by page."""
    name = re.compile(rf"{re.escape(pdf_file.stem)}-([1-9]\d*)\.(dxf|svg)")
    found = [(int(match[1]), file) for file in pdf_file.parent.iterdir() if (match := name.fullmatch(file.name))]
    return [file for _, file in sorted(found)]


def _list_cuts(printed: PrintedWrap, outlines: "dict[int, Polygon]") -> list[tuple[int, CutSheet]]:
    """By page, the outlines as they lie there; a piece that is tiled has a sheet of its own."""
    sheets = []
    for page, (width, height) in enumerate(printed.sizes_mm, start=1):
        rings = {
            piece.number: [piece.to_page(ring) for ring in _rings(outlines[piece.number])]
            for piece in printed.placed if piece.page == page
        }  # fmt: skip
        if not rings:
            continue
        # a tiled piece is larger than its page: the sheet grows to hold it
        ends = np.concatenate([ring for outline in rings.values() for ring in outline]).max(axis=0)
        sheets.append((page, CutSheet(max(width, float(ends[0])), max(height, float(ends[1])), rings)))
    return sheets
