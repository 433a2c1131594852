"""Papers, settings and page plans: pure geometry."""

import itertools

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.printing import PrintSettings
from toolkit.printing.document import effective_percent, measure_side_mm, plan_pages
from toolkit.printing.page import BARS_MM, CAPTION_MM, MARK_MM, PAPERS_MM, CopiesPage, PageFrame, TilePage, parse_paper

PAPERS = ["135x135mm", "a5", "a4", "letter", "tabloid", "a3", "1000x140mm"]


def test_american_papers_are_whole_and_half_inches():
    inches = {"letter": (8.5, 11), "legal": (8.5, 14), "tabloid": (11, 17)}
    for name, sides in inches.items():
        assert PAPERS_MM[name] == pytest.approx([side * 25.4 for side in sides])


@pytest.mark.parametrize("series", ["a", "b"])
def test_iso_papers_halve(series):
    names = sorted(name for name in PAPERS_MM if name[0] == series and name[1:].isdigit())
    for larger, smaller in itertools.pairwise(names):
        assert PAPERS_MM[smaller][0] == PAPERS_MM[larger][1] // 2
        assert PAPERS_MM[smaller][1] == PAPERS_MM[larger][0]


@pytest.mark.parametrize("text", ["200x300mm", "200X300", " 200 × 300 mm ", "200.0x300"])
def test_own_paper(text):
    paper = parse_paper(text)
    assert (paper.width_mm, paper.height_mm, paper.name) == (200, 300, "200x300mm")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("lettr", "letter"),
        ("a6", "a5"),
        ("", "WIDTHxHEIGHTmm"),
        ("100x300mm", "135"),
        ("200x9000mm", "5000"),
        ("0x0", "135"),
    ],
)
def test_paper_that_cannot_be_used(text, says):
    with pytest.raises(ToolkitError, match=says):
        parse_paper(text)


def test_paper_size_of_the_seed():
    assert measure_side_mm(100, PrintSettings()) == pytest.approx(88.194, abs=1e-3)
    assert measure_side_mm(300, PrintSettings(scale_percent=100, dpi=300)) == pytest.approx(25.4)
    assert measure_side_mm(100, PrintSettings(size_mm=60, scale_percent=999, dpi=1)) == 60
    assert effective_percent(100, 88.19444, 72) == pytest.approx(250, abs=1e-3)


@pytest.mark.parametrize("text", ["250", "250%", " 250 % "])
def test_percent(text):
    assert PrintSettings(scale_percent=text).scale_percent == 250


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"scale_percent": 0}, "^scale_percent .*: expected"),
        ({"scale_percent": -250}, "^scale_percent .*: expected"),
        ({"scale_percent": float("nan")}, "^scale_percent .*: expected"),
        ({"dpi": 0}, "^dpi .*: expected"),
        ({"dpi": float("inf")}, "^dpi .*: expected"),
        ({"size_mm": 0}, "^size_mm .*: expected"),
        ({"size_mm": -3}, "^size_mm .*: expected"),
        ({"size_mm": 5001}, "5000 mm"),
        ({"scale_percent": 20000}, "5000 mm"),
        ({"dpi": 1e6}, "1 to 5000 mm"),
        ({"copies": 0}, "^copies 0: expected 1 to 1000"),
        ({"margin_mm": -1}, "^margin_mm -1: expected 0 to 100"),
        ({"orientation": "sideways"}, "orientation sideways: expected auto, portrait or landscape"),
        ({"size_mm": 4000, "copies": 100}, "pages"),
    ],
)
def test_settings_that_make_no_sense(settings, says):
    with pytest.raises(ToolkitError, match=says):
        wanted = PrintSettings(**settings)
        plan_pages(measure_side_mm(100, wanted), wanted)


def overlap(a, b):
    return min(a.right, b.right) - max(a.x, b.x) > 1e-6 and min(a.top, b.top) - max(a.y, b.y) > 1e-6


@pytest.mark.parametrize("paper", PAPERS)
@pytest.mark.parametrize("side_mm", [1, 10, 35.3, 88.2, 141, 300, 600])
def test_marks_and_captions_stay_in_the_content_and_apart(paper, side_mm):
    settings = PrintSettings(paper=parse_paper(paper), copies=7)
    plan = plan_pages(side_mm, settings)
    content = plan.frame.content
    copies = 0
    for page in plan.pages:
        areas = page.cuts if isinstance(page, CopiesPage) else [page.window] if isinstance(page, TilePage) else []
        copies += len(page.cuts) if isinstance(page, CopiesPage) else 0
        for area in areas:
            assert area.x - MARK_MM >= content.x - 1e-6
            assert area.right + MARK_MM <= content.right + 1e-6
            assert area.top + MARK_MM <= content.top + 1e-6
            assert area.y - MARK_MM - CAPTION_MM >= content.y - 1e-6
        padded = [type(area)(area.x - 6, area.y - 10.5, area.width + 12, area.height + 16.5) for area in areas]
        assert not any(overlap(a, b) for a, b in itertools.combinations(padded, 2))
    tile_pages = [page for page in plan.pages if isinstance(page, TilePage)]
    rows, columns = plan.tiles
    assert copies == 7 or len(tile_pages) == 7 * rows * columns


@pytest.mark.parametrize("paper", PAPERS)
def test_header_bars_and_content_are_apart(paper):
    frame = PageFrame(parse_paper(paper))
    assert not overlap(frame.header, frame.content)
    assert min(frame.content.x, frame.content.y, frame.header.x) > BARS_MM
    assert min(frame.printable.top, frame.printable.right) > BARS_MM + 105


def test_auto_orientation_saves_pages():
    paper = parse_paper("a3")
    auto = plan_pages(170, PrintSettings(paper=paper, copies=2))
    assert len(auto.pages) == 1
    tall = plan_pages(100, PrintSettings(paper=parse_paper("a4")))
    assert tall.frame.paper.orientation == "portrait"
    flat = plan_pages(100, PrintSettings(paper=parse_paper("400x200mm"), copies=2))
    assert (flat.frame.paper.orientation, len(flat.pages)) == ("landscape", 1)
    forced = plan_pages(100, PrintSettings(paper=parse_paper("a4"), orientation="landscape"))
    assert (forced.frame.paper.width_mm, forced.frame.paper.height_mm) == (297, 210)
