"""A patch over several pages: joined as the map says, the pages give the patch again."""

import itertools

import numpy as np
import pytest
from printed_pages import Raster, make_patch, render

from toolkit.printing import PrintSettings
from toolkit.printing.document import build_pdf
from toolkit.printing.page import MapPage, TilePage, parse_paper, split_length, tile_sheet

DPI = 300


@pytest.fixture(scope="module", params=[("a4", 250), ("letter", 400)])
def tiled(request, tmp_path_factory):
    paper, percent = request.param
    patch = make_patch(tmp_path_factory.mktemp("patch"), n_px=60)
    document = build_pdf(
        patch, PrintSettings(paper=parse_paper(paper), scale_percent=percent, dpi=60 / 300 * percent / 100 * 25.4)
    )
    pages = [render(document.content, index, DPI) for index in range(len(document.plan.pages))]
    return patch, document, pages


@pytest.mark.slow
def test_tiles_measure_right_and_overlap_by_10_mm(tiled):
    _, document, _ = tiled
    widths, heights = [], []
    for index, page in enumerate(document.plan.pages):
        if isinstance(page, TilePage) and 0 in (page.tile.row, page.tile.column):
            raster = render(document.content, index, dpi=600)
            left, top, right, bottom = raster.box_mm(raster.coloured)
            widths += [right - left] if page.tile.row == 0 else []
            heights += [bottom - top] if page.tile.column == 0 else []
    # n tiles share n - 1 overlaps; each may be measured a device pixel too large on either edge.
    for spans in (widths, heights):
        assert len(spans) > 1
        assert sum(spans) - 10 * (len(spans) - 1) == pytest.approx(300, abs=0.1 * len(spans))


def test_marks_show_where_the_neighbour_comes_to_lie(tiled):
    _, document, pages = tiled
    plan = document.plan
    _page, raster = next(
        (page, raster)
        for page, raster in zip(plan.pages, pages, strict=True)
        if isinstance(page, TilePage)
        and page.tile.joins == {"left": False, "right": True, "top": False, "bottom": True}
    )
    left, top, right, bottom = raster.box_mm(raster.coloured)
    # Above the tile: the sheet's corner mark, the neighbour's edge 10 mm inside, this tile's own edge.
    marks = raster.black_groups_mm(left - 7, top - 7.6, right + 2, top - 7.4, axis=0)
    assert marks[0] == pytest.approx(left - 5, abs=0.15)
    assert marks[1] == pytest.approx(right - 10, abs=0.15)
    assert marks[-1] == pytest.approx(right, abs=0.15)
    beside = raster.black_groups_mm(right + 2.4, top, right + 2.6, bottom + 2, axis=1)
    assert beside[0] == pytest.approx(bottom - 10, abs=0.15)
    assert beside[-1] == pytest.approx(bottom, abs=0.15)


def test_joined_tiles_are_the_patch(tiled):
    """Lay each tile's window over the others in the order of the pages, as the steps on the map say."""
    patch, document, pages = tiled
    plan = document.plan
    per_mm = DPI / 25.4
    side = round(plan.cut_mm * per_mm)
    sheet = np.full((side + 2, side + 2, 3), 255, np.uint8)
    for page, raster in zip(plan.pages, pages, strict=True):
        if not isinstance(page, TilePage):
            continue
        part, window = page.tile.area, page.window
        top = plan.frame.paper.height_mm - window.top
        cut_out = raster.cut_out(window.x, top, window.right, top + window.height)
        x, y = round(part.x * per_mm), round((plan.cut_mm - part.top) * per_mm)
        sheet[y : y + len(cut_out), x : x + cut_out.shape[1]] = cut_out
    n_px = len(patch.pixels)
    centres = ((plan.margin_mm + (np.arange(n_px) + 0.5) * plan.side_mm / n_px) * per_mm).astype(int)
    assert (sheet[np.ix_(centres, centres)] == patch.pixels).all()
    coloured = Raster(sheet, per_mm).coloured
    rows = np.flatnonzero(coloured.any(1))
    assert (rows[-1] + 1 - rows[0]) / per_mm == pytest.approx(plan.side_mm, abs=0.2)


def test_pages_that_overlap_show_the_same_pixels_there(tiled):
    _, document, pages = tiled
    plan = document.plan
    by_name = {p.tile.name: (p, r) for p, r in zip(plan.pages, pages, strict=True) if isinstance(p, TilePage)}
    (first, first_raster), (second, second_raster) = by_name["A1"], by_name["A2"]
    top = plan.frame.paper.height_mm - first.window.top
    a = first_raster.cut_out(first.window.right - 10, top + 20, first.window.right, top + 60)
    b = second_raster.cut_out(second.window.x, top + 20, second.window.x + 10, top + 60)
    width = min(a.shape[1], b.shape[1])
    same = (np.abs(a[:, :width].astype(int) - b[:, :width]) < 8).all(2)
    assert same.mean() > 0.9  # the pages' pixel grids differ by a fraction of a pixel: edges may move by one


def test_first_page_is_the_map(tiled):
    plan = tiled[1].plan
    assert isinstance(plan.pages[0], MapPage)
    assert all(isinstance(page, TilePage) for page in plan.pages[1:])


@pytest.mark.parametrize("length", [10.0, 100.0, 100.1, 190.0, 190.1, 600.0, 5000.0])
def test_spans_cover_the_length_with_the_stated_overlap(length):
    spans = split_length(length, 100)
    assert spans[0][0] == 0
    assert sum(spans[-1]) == pytest.approx(length)
    assert all(span <= 100 + 1e-9 for _, span in spans)
    for (start, span), (next_start, _) in itertools.pairwise(spans):
        assert start + span - next_start == pytest.approx(10)


def test_tiles_are_named_like_a_map():
    tiles = tile_sheet(2600, 2600, 210, 100)
    names = [tile.name for tile in tiles]
    assert names[0] == "A1"
    assert len(set(names)) == len(names)
    assert [tile.name for tile in tiles if tile.column == 0][24:29] == ["Y1", "Z1", "AA1", "AB1", "AC1"]
    assert max(tile.area.top for tile in tiles if tile.row == 0) == pytest.approx(2600)
