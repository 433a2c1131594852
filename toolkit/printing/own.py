"""What people have already, printed at true size: a picture without a record, and tags that a camera reads."""

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from toolkit import __version__
from toolkit.core.errors import FieldError
from toolkit.core.files import write_bytes
from toolkit.core.text import count_of
from toolkit.imaging.read import UnreadableImage, read_opaque
from toolkit.printing import OwnSettings, PrintSettings
from toolkit.printing.canvas import Pdf
from toolkit.printing.document import measure_side_mm
from toolkit.printing.marks import JOIN_IT, PatchLabel, SheetDrawing, draw_page
from toolkit.printing.page import CopiesPage, PagePlan, Rect, plan_sheet
from toolkit.printing.print_boards import PrintedBoard
from toolkit.rig.markers import black_rects, count_markers, find_family, marker_modules

WORDS_MM = 6.0
"""Room below a tag for its family, id and size; it lies inside the cut line."""
CUT_OUT = "Cut at the corner marks: the white border belongs to it."
TAG_DEFAULT_MM = 80.0
Draw = Callable[[float, float, int], None]
"""Draws one of a group with its lower left corner at (x, y)."""
IDS = re.compile(r"(\d{1,5})(?:-(\d{1,5}))?")


def read_tags(text: str) -> tuple[str, list[int]]:
    """Family, by OpenCV's name, and numbers of `36h11:0-19` or `4x4_50:3,7,20-29`, each once.

    Raises:
        ToolkitError: it is written otherwise, or the family lacks a number.
    """
    name, colon, numbers = text.partition(":")
    parts = [IDS.fullmatch(part.strip()) for part in numbers.split(",")]
    if not colon or None in parts:
        raise FieldError("expected FAMILY:NUMBERS, such as 36h11:0-19 or 4x4_50:3,7", {"tag": text})
    dictionary = find_family(name)
    known, ids = count_markers(dictionary), list[int]()
    for found in parts:
        assert found is not None
        first, last = int(found[1]), int(found[2] or found[1])
        if last >= known or first > last:
            expected = f"{name} has the tags 0 to {known - 1}" if last >= known else "expected the smaller number first"
            raise FieldError(f"no tags {found[0]}: {expected}", {"tag": text})
        ids += range(first, last + 1)
    return dictionary, list(dict.fromkeys(ids))


def print_tags(wanted: OwnSettings, page: PrintSettings, folder: Path) -> PrintedBoard:
    """Print tags of one family, each with a white border, its family, number and size in words.

    The size is that of the black square, from which readers compute distances. The border is one module wide, as the
    families define it.

    Args:
        wanted: whose `tag` names family and numbers.
        page: paper and size; 80 mm by default.
        folder: a folder, or the PDF.

    Raises:
        ToolkitError: the family lacks a tag, the size cannot be, or the file cannot be written.
    """
    text = str(wanted.tag)
    dictionary, ids = read_tags(text)
    name = text.partition(":")[0].strip()
    _refuse(page, "scale_percent", "dpi")
    side = measure_side_mm(1, page.with_overrides(size_mm=page.size_mm or TAG_DEFAULT_MM))
    white = side / len(marker_modules(dictionary, ids[0]))
    ids = [one for one in ids for _ in range(page.copies)]
    width, height = side + 2 * white, side + 2 * white + WORDS_MM
    plan = plan_sheet(page.paper, page.orientation, width, height, len(ids))
    # what is larger than a page is tiled, and each tag has pages of its own
    whole = isinstance(plan.pages[0], CopiesPage)
    plans = [plan] if whole else [plan_sheet(page.paper, page.orientation, width, height)] * len(ids)
    groups = [ids] if whole else [[one] for one in ids]
    origin = f"{dictionary}, white border {white:.2f} mm   ·   toolkit {__version__}"
    title, size = f"{name}, {count_of(len(ids), 'tag')}", f"{side:g} mm, the side of the black square"
    pdf = Pdf(plan.frame.paper, f"{title}, {side:g} mm", text, {"dictionary": dictionary, "size_mm": f"{side:.3f}"})

    def draw(x: float, y: float, marker_id: int) -> None:
        left, bottom = x + white, y + white + WORDS_MM
        pdf.grey(0)
        with pdf.moved(left, bottom):
            pdf.rects(black_rects(marker_modules(dictionary, marker_id)) * side, side)
        pdf.text(f"{name} id {marker_id}, {side:g} mm", x + width / 2, y + 2.0, 2.6, room_mm=width, align="centre")

    _draw_pages(pdf, plans, groups, PatchLabel(title, size, origin), draw)
    file = folder if folder.suffix.lower() == ".pdf" else folder / f"tags_{name}.pdf"
    write_bytes(file, pdf.finish())
    return _describe(
        "tags", file, plans, (side, side), f"{count_of(len(ids), 'tag')} of {name}, {_say_ids(ids)}", note=None
    )


def _say_ids(ids: list[int]) -> str:
    return f"id {ids[0]}" if len(set(ids)) == 1 else f"ids {min(ids)} to {max(ids)}"


def print_picture(wanted: OwnSettings, page: PrintSettings, folder: Path) -> PrintedBoard:
    """Print any picture, its longer side as large as stated, or each pixel by `dpi`.

    Args:
        wanted: whose `picture` is the file, and for which camera the note is.
        page: paper and size.
        folder: a folder, or the PDF.

    Raises:
        ToolkitError: the picture cannot be read, no size is stated or it cannot be, or the PDF cannot be written.
    """
    picture = Path(str(wanted.picture))
    try:
        pixels = read_opaque(picture)
    except UnreadableImage as error:
        raise FieldError(f"cannot be read: {error.reason}", {"picture": picture}) from None
    long = max(pixels.shape[:2])
    if page.size_mm is None and page.dpi is None:
        raise FieldError("has no record that states its size: give {size_mm}, or {dpi}", {"picture": picture})
    asked = page if page.scale_percent is not None or page.size_mm else page.with_overrides(scale_percent=100.0)
    texel = measure_side_mm(long, asked) / long
    high, wide = (texel * count for count in pixels.shape[:2])
    width, height = wide + 2 * page.margin_mm, high + 2 * page.margin_mm
    plan = plan_sheet(page.paper, page.orientation, width, height, page.copies)
    size = f"{wide:.1f} × {high:.1f} mm   ({pixels.shape[1]} × {pixels.shape[0]} pixels of {texel:.3g} mm)"
    label = PatchLabel(picture.name, size, f"a picture without a record   ·   toolkit {__version__}")
    pdf = Pdf(plan.frame.paper, f"{picture.stem}, {wide:.1f} × {high:.1f} mm", size, {"size_mm": f"{long * texel:.3f}"})

    def draw(x: float, y: float, _: int) -> None:
        pdf.raster("picture", pixels, Rect(x + page.margin_mm, y + page.margin_mm, wide, high))

    _draw_pages(pdf, [plan], [[0] * page.copies], label, draw)
    file = folder if folder.suffix.lower() == ".pdf" else folder / f"picture_{picture.stem}.pdf"
    write_bytes(file, pdf.finish())
    return _describe("picture", file, [plan], (wide, high), picture.name, note=_say_distance(texel, wanted))


def measure_reach_mm(texel_mm: float, width_px: int, fov_deg: float) -> float:
    """The distance at which a texel, seen at a right angle in the middle, covers one pixel of a camera.

    Farther away several texels share a pixel, so that the camera cannot tell them apart (Nyquist).
    """
    return texel_mm * width_px / (2 * math.tan(math.radians(fov_deg) / 2))


def _say_distance(texel_mm: float, camera: OwnSettings) -> str:
    reach = measure_reach_mm(texel_mm, camera.camera_px, camera.camera_fov) / 1000
    return (
        f"a camera of {camera.camera_px} px across {camera.camera_fov:g}° tells its texels of {texel_mm:.3g} mm apart "
        f"up to {reach:.2g} m away; farther off, several share a pixel"
    )


def _refuse(page: PrintSettings, *names: str) -> None:
    for name in names:
        if getattr(page, name) is not None:
            raise FieldError("tags have no pixels: give {size_mm} in its place", {name: getattr(page, name)})


def _draw_pages(pdf: Pdf, plans: list[PagePlan], groups: list[list[int]], label: PatchLabel, draw: Draw) -> None:
    """Every plan's pages, on which each whole copy is the next of its group, and tiles show the first."""
    number, total = 0, sum(len(plan.pages) for plan in plans)
    for plan, group in zip(plans, groups, strict=True):
        waiting = iter(group)
        for page in plan.pages:
            number += 1
            sheet = _make_sheet(pdf, plan, label, draw, waiting if isinstance(page, CopiesPage) else None, group[0])
            with pdf.page():
                draw_page(pdf, plan, page, sheet, f"page {number} of {total}")


def _make_sheet(
    pdf: Pdf, plan: PagePlan, label: PatchLabel, draw: Draw, waiting: Iterator[int] | None, first: int
) -> SheetDrawing:
    def show(x: float, y: float) -> None:
        draw(x, y, first if waiting is None else next(waiting))

    def note(area: Rect, tile: str) -> None:
        if tile:
            pdf.text(tile, area.x + area.width / 2, area.y - 8.6, 2.4, room_mm=area.width, align="centre")

    return SheetDrawing(label, CUT_OUT if plan.tiles == (1, 1) else JOIN_IT, show, note)


def _describe(
    kind: str, file: Path, plans: list[PagePlan], size_mm: tuple[float, float], description: str, note: str | None
) -> PrintedBoard:
    paper = plans[0].frame.paper
    return PrintedBoard(
        kind=kind, file=str(file), spec_file=None, description=description,
        size_mm=(round(size_mm[0], 3), round(size_mm[1], 3)), paper=paper.name, orientation=paper.orientation,
        pages=sum(len(plan.pages) for plan in plans), tiles=plans[0].tiles, note=note,
    )  # fmt: skip
