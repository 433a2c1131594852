"""Print your own pictures, and tags that a camera reads, at true size."""

import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from toolkit import __version__
from toolkit.core.errors import FieldError
from toolkit.core.text import count_of
from toolkit.imaging.read import UnreadableImage, read_opaque
from toolkit.printing import OwnSettings, PrintSettings
from toolkit.printing.canvas import Pdf
from toolkit.printing.document import measure_side_mm
from toolkit.printing.marks import JOIN_IT, PatchLabel, SheetDrawing, draw_pages
from toolkit.printing.page import CopiesPage, PagePlan, Rect, plan_sheet
from toolkit.printing.print_boards import PrintedBoard, write_print
from toolkit.rig.markers import black_rects, count_markers, find_family, marker_modules

WORDS_MM = 6.0
"""Room below a tag for its family, id and size; it lies inside the cut line."""
CUT_OUT = "Cut at the corner marks and keep the white border."
TAG_DEFAULT_MM = 80.0
Draw = Callable[[float, float], None]
IDS = re.compile(r"(\d{1,5})(?:-(\d{1,5}))?")


def read_tags(text: str) -> tuple[str, list[int]]:
    """Family, by OpenCV's name, and numbers of `36h11:0-19` or `4x4_50:3,7,20-29`, each once.

    Raises:
        ToolkitError: it is written otherwise, or the family lacks a number.
    """
    # each part is a number or a range of numbers
    name, colon, numbers = text.partition(":")
    parts = [IDS.fullmatch(part.strip()) for part in numbers.split(",")]
    if not colon or None in parts:
        raise FieldError("expected FAMILY:NUMBERS, such as 36h11:0-19 or 4x4_50:3,7", {"tag": text})
    dictionary = find_family(name)
    known, ids = count_markers(dictionary), list[int]()
    for found in parts:
        assert found is not None
        # a single number is a range, too
        first, last = int(found[1]), int(found[2] or found[1])
        if last >= known or first > last:
            expected = f"{name} has the tags 0 to {known - 1}" if last >= known else "expected the smaller number first"
            raise FieldError(f"no tags {found[0]}: {expected}", {"tag": text})
        ids += range(first, last + 1)
    return dictionary, list(dict.fromkeys(ids))


def print_tags(wanted: OwnSettings, page: PrintSettings, folder: Path) -> PrintedBoard:
    """Print tags of a family, each with a white border, its family, number and size in words.

    The size is that of the black square, from which readers compute distances. The border is 1 module wide.

    Args:
        wanted: `tag` names family and numbers.
        page: paper and size; 80 mm by default.
        folder: a folder, or the PDF.

    Raises:
        ToolkitError: the family lacks a tag, the size is out of range, or the file cannot be written.
    """
    text = str(wanted.tag)
    dictionary, ids = read_tags(text)
    name = text.partition(":")[0].strip()
    # a tag is drawn from its modules, so that resolution and scale say nothing
    page.refuse("tags have no pixels: give {size_mm} in its place", "scale_percent", "dpi")
    # sizes, and the marker of each copy
    side = measure_side_mm(1, page.with_overrides(size_mm=page.size_mm or TAG_DEFAULT_MM))
    white = side / len(marker_modules(dictionary, ids[0]))
    ids = [marker_id for marker_id in ids for _ in range(page.copies)]
    width, height = side + 2 * white, side + 2 * white + WORDS_MM
    # a single plan holds all tags, as if they were copies of a sheet
    plan = plan_sheet(page.paper, page.orientation, width, height, len(ids))
    origin = f"{dictionary}, white border {white:.2f} mm   ·   toolkit {__version__}"
    title, size = f"{name}, {count_of(len(ids), 'tag')}", f"{side:g} mm, the side of the black square"
    pdf = Pdf(plan.frame.paper, f"{title}, {side:g} mm", text, {"dictionary": dictionary, "size_mm": f"{side:.3f}"})

    def draw(marker_id: int, x: float, y: float) -> None:
        # the words stand below the tag, outside its white border
        left, bottom = x + white, y + white + WORDS_MM
        pdf.grey(0)
        with pdf.moved(left, bottom):
            pdf.rects(black_rects(marker_modules(dictionary, marker_id)) * side, side)
        pdf.text(f"{name} id {marker_id}, {side:g} mm", x + width / 2, y + 2.0, 2.6, room_mm=width, align="centre")

    # copies on a page are drawn in order, each with the next number
    waiting = iter(ids)
    sheets: list[tuple[PagePlan, Draw]] = [(plan, lambda x, y: draw(next(waiting), x, y))]
    if not isinstance(plan.pages[0], CopiesPage):  # larger than a page: tiled, and each tag has its own pages
        single = plan_sheet(page.paper, page.orientation, width, height)
        sheets = [(single, partial(draw, marker_id)) for marker_id in ids]
    _draw_sheets(pdf, sheets, PatchLabel(title, size, origin))
    # the file's name has no numbers, so the message says which they are
    numbers = f"id {ids[0]}" if len(set(ids)) == 1 else f"ids {min(ids)} to {max(ids)}"
    words = f"{count_of(len(ids), 'tag')} of {name}, {numbers}"
    plans = [plan for plan, _ in sheets]
    return write_print("tags", folder, f"tags_{name}.pdf", pdf.finish(), plans, (side, side), words)


def print_picture(wanted: OwnSettings, page: PrintSettings, folder: Path) -> PrintedBoard:
    """Print any picture, its longer side as large as stated, or each pixel by `dpi`.

    Args:
        wanted: `picture` is the file; the note is for its camera.
        page: paper and size.
        folder: a folder, or the PDF.

    Raises:
        ToolkitError: the picture cannot be read, its size is missing or out of range, or the PDF cannot be written.
    """
    picture = Path(str(wanted.picture))
    # any readable picture will do, as it needs no record
    try:
        pixels = read_opaque(picture)
    except UnreadableImage as error:
        raise FieldError(f"cannot be read: {error.reason}", {"picture": picture}) from None
    long = max(pixels.shape[:2])
    if page.size_mm is None and page.dpi is None:
        raise FieldError("has no record that states its size: give {size_mm}, or {dpi}", {"picture": picture})
    # without a size, the resolution alone decides
    asked = page if page.scale_percent is not None or page.size_mm else page.with_overrides(scale_percent=100.0)
    texel = measure_side_mm(long, asked) / long
    # texels are square, so that the longer side settles the shorter
    high, wide = (texel * count for count in pixels.shape[:2])
    width, height = wide + 2 * page.margin_mm, high + 2 * page.margin_mm
    plan = plan_sheet(page.paper, page.orientation, width, height, page.copies)
    size = f"{wide:.1f} × {high:.1f} mm   ({pixels.shape[1]} × {pixels.shape[0]} pixels of {texel:.3g} mm)"
    label = PatchLabel(picture.name, size, f"a picture without a record   ·   toolkit {__version__}")
    pdf = Pdf(plan.frame.paper, f"{picture.stem}, {wide:.1f} × {high:.1f} mm", size, {"size_mm": f"{long * texel:.3f}"})

    def draw(x: float, y: float) -> None:
        pdf.raster("picture", pixels, Rect(x + page.margin_mm, y + page.margin_mm, wide, high))

    _draw_sheets(pdf, [(plan, draw)], label)
    # how near a camera must come for its pixels to tell two texels apart
    reach = measure_reach_mm(texel, wanted.camera_px, wanted.camera_fov) / 1000
    note = (
        f"a camera of {wanted.camera_px} px across {wanted.camera_fov:g}° resolves its texels of {texel:.3g} mm up to "
        f"{reach:.2g} m away; farther away, several share a pixel"
    )
    name = f"picture_{picture.stem}.pdf"
    return write_print("picture", folder, name, pdf.finish(), [plan], (wide, high), picture.name, note=note)


def measure_reach_mm(texel_mm: float, width_px: int, fov_deg: float) -> float:
    """Return the distance at which a texel, at a right angle in the middle, covers 1 pixel of a camera (Nyquist)."""
    return texel_mm * width_px / (2 * math.tan(math.radians(fov_deg) / 2))


def _draw_sheets(pdf: Pdf, sheets: list[tuple[PagePlan, Draw]], label: PatchLabel) -> None:
    """Draw the pages of each plan; its function draws a copy with its lower left corner at (x, y)."""
    number, total = 1, sum(len(plan.pages) for plan, _ in sheets)
    for plan, draw in sheets:
        advice = CUT_OUT if plan.tiles == (1, 1) else JOIN_IT
        draw_pages(pdf, plan, SheetDrawing(label, advice, draw), number, total)
        number += len(plan.pages)
