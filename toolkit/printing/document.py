"""A patch to the bytes of a print-ready PDF, and which objects it is stuck on at which size."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from reportlab.pdfbase.pdfdoc import PDFResourceDictionary

from toolkit.core.errors import FieldError
from toolkit.core.text import join_words
from toolkit.objects.records import Patch, PatchRecord, mirror, printed_size_mm
from toolkit.objects.spec import BASE_DPI, MM_PER_INCH, SCALE, Margin, Side
from toolkit.printing import PrintSettings
from toolkit.printing.canvas import Pdf
from toolkit.printing.marks import (
    CUT_IT,
    JOIN_IT,
    PatchLabel,
    SheetDrawing,
    draw_margin_words,
    draw_pages,
    reserve_strip,
)
from toolkit.printing.page import CopiesPage, PagePlan, Rect, pack_copies, plan_sheet

SAME_MM = 0.05
STATED = re.compile(rb"size_mm=([0-9.+]+), n_px=\d+, patch_sha256=([0-9a-f]{64})")
"""In a PDF's keywords, see `toolkit.printing.document.build_pdf`."""


@dataclass(frozen=True)
class Wearer:
    """An object that a patch is stuck on.

    Attributes:
        object: name of the object.
        sides: side of the object for each sheet.
        sizes_mm: side of the patch on each sheet: `[patch] size_mm` of the spec, else the patch's record.
    """

    object: str
    sides: tuple[Side, ...]
    sizes_mm: tuple[float, ...]

    def name_sheet(self, index: int) -> str:
        """Return `mug`, or of several sheets `mug, sheet 2 of 2 (left)`, for the paper's margin."""
        count = len(self.sides)
        return self.object if count == 1 else f"{self.object}, sheet {index + 1} of {count} ({self.sides[index]})"


def say_sizes(sizes_mm: Sequence[float]) -> str:
    """Return sizes in words: `88.2 mm`, `90.0 and 60.0 mm`."""
    return f"{join_words(f'{size:.1f}' for size in sizes_mm)} mm"


def is_same_size(sizes_mm: Sequence[float], others_mm: Sequence[float]) -> bool:
    """Whether sheets have the sizes of others, in order."""
    return len(sizes_mm) == len(others_mm) and np.allclose(sizes_mm, others_mm, rtol=0, atol=SAME_MM)


def read_page(pdf_file: Path) -> tuple[tuple[float, ...], str] | None:
    """Return sides of the sheets in mm and hash of the patch from a PDF of `toolkit print`; None for another PDF."""
    try:
        found = STATED.search(pdf_file.read_bytes())
    except OSError:
        return None
    return (tuple(float(side) for side in found[1].split(b"+")), found[2].decode()) if found else None


SMALLEST_SIDE_MM = 1.0
LARGEST_SIDE_MM = 5000.0


def measure_side_mm(n_px: int, settings: PrintSettings) -> float:
    """Side of an n-pixel patch on paper, millimetres, without its white margin.

    Raises:
        ToolkitError: the side is under 1 mm or over 5 m.
    """
    # a stated size wins over resolution and scale
    scale = SCALE if settings.scale_percent is None else settings.scale_percent / 100
    side_mm = settings.size_mm or printed_size_mm(n_px, settings.dpi or BASE_DPI, scale)
    if not SMALLEST_SIDE_MM <= side_mm <= LARGEST_SIDE_MM:
        raise FieldError(
            f"the patch of {n_px} px would be {side_mm:.4g} mm wide: expected {SMALLEST_SIDE_MM:g} to "
            f"{LARGEST_SIDE_MM:g} mm; change {{scale_percent}}, {{dpi}} or {{size_mm}}",
            {},
        )
    return side_mm


def effective_percent(n_px: int, side_mm: float, dpi: float) -> float:
    """Return the scale, in percent, that gives this side; the label states it."""
    return 100 * side_mm / (n_px / dpi * MM_PER_INCH)


@dataclass(frozen=True)
class PrintPlan(PagePlan):
    """Every page of a patch's file: the patch's side, and the paper round it."""

    side_mm: float
    margin_mm: float
    margin: Margin

    @property
    def cut_mm(self) -> float:
        """Side of the sheet that is cut out: patch and margin."""
        return self.side_mm + 2 * self.margin_mm

    @property
    def has_strip(self) -> bool:
        """Whether the colour strip is on a page."""
        return any(isinstance(page, CopiesPage) and page.strip is not None for page in self.pages)


def plan_pages(side_mm: float, settings: PrintSettings, margin: Margin = "white") -> PrintPlan:
    """Lay out a patch of that side, with the colour strip beside it if that takes no further page.

    Raises:
        ToolkitError: it would take more than 3000 pages.
    """
    cut_mm = side_mm + 2 * settings.margin_mm
    # a sheet is square, its white margin or bleed counted on every side
    plan = plan_sheet(settings.paper, settings.orientation, cut_mm, cut_mm, settings.copies)
    pages = plan.pages
    # the strip may not cost a page: it is tried in each place, and left out otherwise
    for place, rest in reserve_strip(plan.frame.content) if isinstance(pages[0], CopiesPage) else ():
        packed = pack_copies(rest, cut_mm, cut_mm, settings.copies)
        if packed and len(packed) == len(pages):
            pages = tuple(replace(page, strip=place) for page in packed)
            break
    return PrintPlan(plan.frame, pages, side_mm, settings.margin_mm, settings.margin or margin)


HASH_DIGITS = 12


def compose_label(record: PatchRecord, side_mm: float, settings: PrintSettings) -> PatchLabel:
    """Return the label of a patch printed at that side."""
    n_px, dpi = record.n_px, settings.dpi or BASE_DPI
    percent = effective_percent(n_px, side_mm, dpi)
    title = record.class_name if record.name == record.class_name else f"{record.class_name} ({record.name})"
    trained_on = ", ".join(network.arch for network in record.networks) or "no network"
    return PatchLabel(
        title,
        f"{side_mm:.1f} × {side_mm:.1f} mm   ({percent:.4g} % of {n_px} × {n_px} px at {dpi:g} dpi)",
        f"patch sha256 {record.png_sha256[:HASH_DIGITS]}   ·   trained on {trained_on}   ·   "
        f"toolkit {record.toolkit_version}",
    )


FORM = "patch"
UNDERLAP_PX = 0.5


def pixel_operators(pixels: np.ndarray) -> list[str]:
    """Return operators that paint (n, n, 3) uint8 pixels over the square from (0, 0) to (n, n), first row on top."""
    # in the patch's own pixels; the page's scale makes millimetres of them
    side = len(pixels)
    operators = []
    # each pixel reaches half a pixel under its right and lower neighbour: viewers smooth edges, and paper would show
    for index, row in enumerate(pixels):
        top = side - index
        bottom = top - 1 - (UNDERLAP_PX if index < side - 1 else 0)
        edges = np.flatnonzero(np.any(row[1:] != row[:-1], axis=1)) + 1
        for first, end in pairwise([0, *edges.tolist(), side]):  # runs of one colour
            # PDF counts upwards, rows count downwards
            red, green, blue = (f"{value / 255:.5g}" for value in row[first].tolist())
            right = end + (UNDERLAP_PX if end < side else 0)
            operators.append(f"{red} {green} {blue} rg {first} {bottom:g} {right - first:g} {top - bottom:g} re f")
    return operators


def define_patch(pdf: Pdf, pixels: np.ndarray) -> None:
    """Store the patch once in the file, for `place_patch` to show; (n, n, 3) uint8, sRGB-encoded.

    `DefaultRGB` makes its colours sRGB to every reader, not the device's own RGB (ISO 32000-1, 8.6.5.6).
    """
    side, space = len(pixels), pdf.srgb()
    # One pixel of room: a box on the very edge would smooth that edge a second time.
    pdf.beginForm(FORM, -1, -1, side + 1, side + 1)
    pdf._code.extend(pixel_operators(pixels))
    pdf.endForm(Resources=PDFResourceDictionary(ColorSpace={"DefaultRGB": space}))


def place_patch(pdf: Pdf, x: float, y: float, side_mm: float, n_px: int) -> None:
    """Show the patch with its lower left corner at (x, y)."""
    with pdf.moved(x, y, scale=side_mm / n_px):
        pdf.doForm(FORM)


@dataclass(frozen=True)
class PrintedDocument:
    """A finished PDF, and a plan for each sheet of the object."""

    content: bytes
    plans: tuple[PrintPlan, ...]

    @property
    def plan(self) -> PrintPlan:
        """Plan of the first sheet."""
        return self.plans[0]


def build_pdf(patch: Patch, settings: PrintSettings, wearer: Wearer | None = None) -> PrintedDocument:
    """Lay out a patch on pages at true physical size, once for each sheet of its object.

    The same arguments and toolkit version give the same bytes: the file holds no time and no random id.

    Args:
        patch: the patch.
        settings: paper and size. Without a size, the wearer's counts, else the record's.
        wearer: object with the patch; the margin states its name, and the number among several sheets.

    Raises:
        ToolkitError: the patch would be under 1 mm or over 5 m wide.
    """
    record = patch.record
    # sizes: a record of the default size states none: `--scale` and `--dpi` defaults then hold
    trained_mm = record.size_mm if abs(record.size_mm - printed_size_mm(record.n_px)) > SAME_MM else None
    sizes = (trained_mm,) if wearer is None else wearer.sizes_mm
    states = settings.states_size
    settled = [settings if states or size is None else settings.with_overrides(size_mm=size) for size in sizes]
    sides_mm = [measure_side_mm(record.n_px, settings) for settings in settled]
    # layout and words of each sheet
    plans = [plan_pages(side_mm, each, record.margin) for side_mm, each in zip(sides_mm, settled, strict=True)]
    labels = [compose_label(record, side_mm, settings) for side_mm, settings in zip(sides_mm, settled, strict=True)]
    keywords = {
        "class": record.class_name, "size_mm": "+".join(f"{side_mm:.3f}" for side_mm in sides_mm), "n_px": record.n_px,
        "patch_sha256": record.png_sha256,
    }  # fmt: skip
    title = f"{record.class_name} patch, {say_sizes(sides_mm)}"
    subject = f"{labels[0].title}: {join_words(label.size for label in labels)}"
    pdf = Pdf(plans[0].frame.paper, title, subject, keywords)
    # a picture for all sheets, with as many mirrored texels as the widest margin shows
    bleed_px = max(math.ceil(plan.margin_mm / plan.side_mm * record.n_px) for plan in plans)
    shown = mirror(record.n_px, bleed_px if plans[0].margin == "bleed" else 0)
    define_patch(pdf, patch.pixels[shown][:, shown])
    number, total = 1, sum(len(plan.pages) for plan in plans)
    for index, (plan, label) in enumerate(zip(plans, labels, strict=True)):
        name = record.name if wearer is None else wearer.name_sheet(index)
        side: Side = "top" if wearer is None else wearer.sides[index]
        sheet = _describe_sheet(pdf, plan, record.n_px, len(shown), label, name, side)
        which = f"sheet {index + 1} of {len(plans)}, " if len(plans) > 1 else ""
        draw_pages(pdf, plan, sheet, number, total, which, plan.frame.paper if len(plans) > 1 else None)
        number += len(plan.pages)
    return PrintedDocument(pdf.finish(), tuple(plans))


def _describe_sheet(
    pdf: Pdf, plan: PrintPlan, n_px: int, shown_px: int, label: PatchLabel, name: str, at: Side
) -> SheetDrawing:
    """The patch with its margin and words; `shown_px` texels are stored, with those of the margin."""

    def draw(x: float, y: float) -> None:
        cut, shown_mm = Rect(x, y, plan.cut_mm, plan.cut_mm), plan.side_mm * shown_px / n_px
        if plan.margin == "bleed":
            # mirrored texels reach past the cut line, so that a cut that is slightly off shows no white
            with pdf.clipped([[(x, y), (cut.right, y), (cut.right, cut.top), (x, cut.top)]]):
                around = cut.centre(shown_mm, shown_mm)
                place_patch(pdf, around.x, around.y, shown_mm, shown_px)
        else:
            place_patch(pdf, x + plan.margin_mm, y + plan.margin_mm, shown_mm, shown_px)
        # a printed margin has no room for words: they stand below the cut line
        draw_margin_words(pdf, cut, 0 if plan.margin == "bleed" else plan.margin_mm, name, at)

    return SheetDrawing(label, CUT_IT if plan.tiles == (1, 1) else JOIN_IT, draw, at=at)
