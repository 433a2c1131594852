"""The page, rasterised at 600 dpi by another library, measures right."""

import numpy as np
import pytest
from printed_pages import longest_run, make_patch, render

from toolkit.objects.records import Patch
from toolkit.printing import PrintSettings
from toolkit.printing import document as artwork
from toolkit.printing.document import build_pdf
from toolkit.printing.page import parse_paper

TOLERANCE_MM = 0.1
"""PDFium moves an edge by up to a device pixel outwards: at 600 dpi two edges make 0.085 mm, at 300 dpi twice that."""
PAGES_MM = {"a4": (210, 297), "letter": (215.9, 279.4)}


@pytest.fixture(scope="module")
def patch(tmp_path_factory):
    return make_patch(tmp_path_factory.mktemp("patch"))


@pytest.mark.slow
@pytest.mark.parametrize("paper", ["a4", "letter"])
@pytest.mark.parametrize("percent", [100, 250, 400])
def test_page_measures_right(patch, paper, percent):
    page = render(build_pdf(patch, PrintSettings(paper=parse_paper(paper), scale_percent=percent)).content)
    height, width = (side / page.per_mm for side in page.pixels.shape[:2])
    assert (width, height) == pytest.approx(PAGES_MM[paper], abs=TOLERANCE_MM)

    left, top, right, bottom = page.box_mm(page.coloured)
    expected_mm = 100 / 72 * 25.4 * percent / 100
    assert right - left == pytest.approx(expected_mm, abs=TOLERANCE_MM)
    assert bottom - top == pytest.approx(expected_mm, abs=TOLERANCE_MM)

    # Crop marks stand 1 to 5 mm outside the cut line, which is 5 mm outside the patch.
    for strip in (top - 8, bottom + 8):
        marks = page.black_groups_mm(left - 7, strip - 0.5, right + 7, strip + 0.5, axis=0)
        assert marks == pytest.approx([left - 5, right + 5], abs=TOLERANCE_MM)
    for strip in (left - 8, right + 8):
        marks = page.black_groups_mm(strip - 0.5, top - 7, strip + 0.5, bottom + 7, axis=1)
        assert marks == pytest.approx([top - 5, bottom + 5], abs=TOLERANCE_MM)

    for mask, upright in ((page.black, False), (page.black.T, True)):
        length, row, start = longest_run(mask, least=1500)
        assert length / page.per_mm == pytest.approx(100, abs=TOLERANCE_MM)
        bar, zero = row / page.per_mm, start / page.per_mm
        if upright:
            ticks = page.black_groups_mm(bar - 1.2, zero - 1, bar - 0.9, zero + 101, axis=1)
        else:
            ticks = page.black_groups_mm(zero - 1, bar + 1.2, zero + 101, bar + 1.5, axis=0)
        # End ticks lie inside the bar's 100 mm, so their middles are 0.15 mm further in.
        assert ticks == pytest.approx([zero + at for at in (0.15, *range(10, 100, 10), 99.85)], abs=TOLERANCE_MM)


def interiors(page, pixels, left, top, side_mm):
    """(expected colour, found pixels) inside every patch pixel, one device pixel away from its edges."""
    step = side_mm / len(pixels) * page.per_mm
    x0, y0 = left * page.per_mm, top * page.per_mm
    for row in range(len(pixels)):
        for column in range(len(pixels)):
            x, y = (np.ceil(start + index * step) + 1 for start, index in ((x0, column), (y0, row)))
            x1, y1 = (np.floor(start + (index + 1) * step) - 1 for start, index in ((x0, column), (y0, row)))
            yield pixels[row, column], page.pixels[int(y) : int(y1), int(x) : int(x1)]


@pytest.mark.slow
@pytest.mark.parametrize("percent", [250, 173.3])
def test_pixels_have_exactly_their_colour(tmp_path, percent):
    patch = make_patch(tmp_path, n_px=40)
    document = build_pdf(patch, PrintSettings(scale_percent=percent))
    page = render(document.content)
    cut = document.plan.pages[0].cuts[0]
    found = list(interiors(page, patch.pixels, cut.x + 5, 297 - cut.top + 5, document.plan.side_mm))
    assert min(block.size for _, block in found) > 3 * 8 * 8
    assert all((block == colour).all() for colour, block in found)


def paint_smoothly(operators, side, scale):
    """A rasteriser that smooths edges by area, as most do: each rectangle covers a share of every device pixel."""
    canvas = np.ones((round(side * scale) + 1, round(side * scale) + 1, 3))
    device = np.arange(len(canvas))
    for operator in operators:
        red, green, blue, _, x, y, width, height, *_ = operator.split()
        share = [
            np.clip(np.minimum(device + 1, end * scale) - np.maximum(device, start * scale), 0, 1)
            for start, end in (
                (side - float(y) - float(height), side - float(y)),
                (float(x), float(x) + float(width)),
            )
        ]
        cover = np.outer(*share)[..., None]
        canvas = canvas * (1 - cover) + np.array([float(red), float(green), float(blue)]) * cover
    return canvas


@pytest.mark.parametrize("scale", [2.0, 3.7, 20.83])
def test_no_paper_shines_through_between_pixels(scale, monkeypatch):
    dark = np.zeros((12, 12, 3), np.uint8)
    dark[::2, :, 0], dark[:, ::2, 1] = 1, 2
    inside = slice(2, int(12 * scale) - 2)
    assert paint_smoothly(artwork.pixel_operators(dark), 12, scale)[inside, inside].max() <= 2.01 / 255
    monkeypatch.setattr(artwork, "UNDERLAP_PX", 0)
    if scale != 2.0:  # rectangles that only touch would show it
        assert paint_smoothly(artwork.pixel_operators(dark), 12, scale)[inside, inside].max() > 20 / 255


@pytest.mark.parametrize("dpi", [72, 150])
def test_no_seams_in_pdfium(patch, dpi):
    document = build_pdf(Patch(np.zeros_like(patch.pixels), patch.record), PrintSettings(scale_percent=173.3))
    cut = document.plan.pages[0].cuts[0]
    page = render(document.content, dpi=dpi)
    assert page.cut_out(cut.x + 6, 297 - cut.top + 6, cut.right - 6, 297 - cut.y - 6).max() == 0


def test_patch_is_the_right_way_up_and_round(tmp_path):
    patch = make_patch(tmp_path, n_px=40)
    page = render(build_pdf(patch, PrintSettings()).content, dpi=150)
    left, top, right, bottom = page.box_mm(page.coloured)
    for row, column in ((0, 0), (0, 39), (39, 0), (39, 39)):
        x = left + (right - left) * (column + 0.5) / 40
        y = top + (bottom - top) * (row + 0.5) / 40
        assert (page.cut_out(x - 0.1, y - 0.1, x + 0.1, y + 0.1) == patch.pixels[row, column]).all()


@pytest.mark.slow
@pytest.mark.parametrize("side_mm", [10, 47.3])
def test_size_mm_is_the_side_of_the_patch_alone(patch, side_mm):
    page = render(build_pdf(patch, PrintSettings(size_mm=side_mm, scale_percent=33, dpi=300, margin_mm=12)).content)
    left, top, right, bottom = page.box_mm(page.coloured)
    assert (right - left, bottom - top) == pytest.approx((side_mm, side_mm), abs=TOLERANCE_MM)
    marks = page.black_groups_mm(left - 14, top - 15.5, right + 14, top - 14.5, axis=0)
    assert marks == pytest.approx([left - 12, right + 12], abs=TOLERANCE_MM)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("paper", "settings"),
    [("a4", {}), ("a5", {"copies": 9, "size_mm": 10}), ("135x135mm", {"size_mm": 300}), ("letter", {"size_mm": 600})],
)
def test_nothing_is_printed_in_the_outer_10_mm(patch, paper, settings):
    document = build_pdf(patch, PrintSettings(paper=parse_paper(paper), **settings))
    for index in range(min(len(document.plan.pages), 4)):
        page = render(document.content, index, dpi=150)
        left, top, right, bottom = page.box_mm(page.pixels.min(2) < 250)
        sheet = document.plan.frame.paper
        assert min(left, top, sheet.width_mm - right, sheet.height_mm - bottom) >= 10 - 0.2
