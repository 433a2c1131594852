"""The strip of known colours: its markers are OpenCV's, and on paper every cell is where `STRIP` says."""

import cv2
import numpy as np
import pytest
from printed_pages import make_patch, render

from toolkit.printing import PrintSettings
from toolkit.printing.document import build_pdf
from toolkit.printing.marks import FIDUCIALS, STRIP, strip_area
from toolkit.printing.page import parse_paper
from toolkit.printing.print_boards import build_strip_pdf


@pytest.fixture(scope="module")
def patch(tmp_path_factory):
    return make_patch(tmp_path_factory.mktemp("patch"), n_px=20)


def find_strip(pixels):
    """Homography from the strip's millimetres to pixel edges, by OpenCV's detector."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_1000)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(np.ascontiguousarray(pixels))
    ids = [] if ids is None else ids.ravel().tolist()
    assert sorted(ids) == sorted(FIDUCIALS)
    points = STRIP.marker_corners_mm(ids).reshape(-1, 2)
    return cv2.findHomography(points, np.array(corners).reshape(-1, 2) + 0.5)[0]


def place(homography, points_mm):
    return cv2.perspectiveTransform(np.asarray(points_mm, float).reshape(-1, 1, 2), homography).reshape(-1, 2)


def read_cells(pixels, homography):
    """(k, 3) median colour in the middle half of each cell."""
    found = []
    for corners in STRIP.swatch_corners_mm(inset_mm=STRIP.swatches[0].side_mm / 4):
        spot = place(homography, corners)
        (x0, y0), (x1, y1) = np.ceil(spot.min(axis=0)).astype(int), np.floor(spot.max(axis=0)).astype(int)
        found.append(np.median(pixels[y0:y1, x0:x1].reshape(-1, 3), axis=0))
    return np.array(found)


def test_markers_are_those_of_the_dictionary():
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, STRIP.dictionary))
    for number, rows in FIDUCIALS.items():
        expected = cv2.aruco.generateImageMarker(dictionary, number, len(rows), borderBits=1) == 0
        assert (np.array([[letter == "#" for letter in row] for row in rows]) == expected).all()


def test_colours():
    by_name = dict(zip(STRIP.names, STRIP.srgb.tolist(), strict=True))
    assert len(by_name) == 22
    assert by_name["yellow"] == [255, 255, 0]
    ramp = STRIP.srgb[[name.startswith("grey") for name in STRIP.names]]
    assert len(ramp) == 11
    assert (ramp == ramp[:, :1]).all()
    assert set(np.diff(ramp[:, 0].astype(int))) <= {25, 26}
    assert (ramp[0, 0], ramp[-1, 0]) == (0, 255)


def test_painted_strip_is_read_where_it_says():
    picture = STRIP.paint(6.0)
    homography = find_strip(picture)
    assert (read_cells(picture, homography) == STRIP.srgb).all()
    assert place(homography, [(0, 0), STRIP.size_mm]) == pytest.approx(np.array([(12, 12), (624, 102)]), abs=1)


@pytest.mark.slow
@pytest.mark.parametrize("paper", ["a4", "letter", "a5", "135x135mm"])
@pytest.mark.parametrize("percent", [100, 250, 400])
def test_strip_on_the_patchs_page(patch, paper, percent):
    """The page is of the size that the test's patch of 20 px has; its strip measures right and shows its colours."""
    document = build_pdf(patch, PrintSettings(paper=parse_paper(paper), scale_percent=percent))
    assert document.plan.has_strip
    page = render(document.content, dpi=300)
    homography = find_strip(page.pixels)
    strip = document.plan.pages[0].strip
    top = page.pixels.shape[0] / page.per_mm - strip.y - STRIP.size_mm[1]
    corners = place(homography, STRIP.swatch_corners_mm().reshape(-1, 2)) / page.per_mm
    expected = STRIP.swatch_corners_mm().reshape(-1, 2) + np.array([strip.x, top])
    assert np.abs(corners - expected).max() < 0.1
    assert np.abs(read_cells(page.pixels, homography) - STRIP.srgb).max() <= 1


@pytest.mark.slow
def test_cells_measure_right_at_600_dpi(patch):
    document = build_pdf(patch, PrintSettings())
    page, strip = render(document.content), document.plan.pages[0].strip
    top = 297 - strip.y - STRIP.size_mm[1]
    (black,) = (cell for cell in STRIP.swatches if cell.name == "black")
    x, y = strip.x + black.x, top + black.y
    (across,) = page.black_groups_mm(x - 2, y + 3, x + 9, y + 4, axis=0)
    assert across == pytest.approx(x + 3.5, abs=0.1)
    dark = page.cut_out(x - 2, y + 3, x + 9, y + 4).max(2) < 128
    assert dark[3].sum() / page.per_mm == pytest.approx(7, abs=0.1)
    column = page.cut_out(x + 3, y - 2, x + 4, y + 7.9).max(2) < 128
    assert column[:, 3].sum() / page.per_mm == pytest.approx(7, abs=0.1)
    for number, (left, upper) in STRIP.marker_corners.items():
        row = page.cut_out(strip.x + left - 1, top + upper + 0.5, strip.x + left + 11.5, top + upper + 0.9).max(2) < 128
        assert row[2].sum() / page.per_mm == pytest.approx(STRIP.marker_mm, abs=0.1), number


@pytest.mark.slow
def test_strip_goes_up_the_side_where_two_copies_leave_no_room_below(patch):
    document = build_pdf(patch, PrintSettings(size_mm=88.2, copies=2))
    strip = document.plan.pages[0].strip
    assert strip.upright
    page = render(document.content, dpi=300)
    homography = find_strip(page.pixels)
    assert np.abs(read_cells(page.pixels, homography) - STRIP.srgb).max() <= 1
    start, end = place(homography, [(0, 15), (102, 15)]) / page.per_mm
    assert start[1] - end[1] == pytest.approx(102, abs=0.1)  # it reads upwards
    assert tuple(start) == pytest.approx((strip.x, 297 - strip.y), abs=0.1)


@pytest.mark.parametrize("paper", ["135x135mm", "a5", "a4", "letter", "a3"])
@pytest.mark.parametrize(("side_mm", "copies"), [(10, 7), (35.3, 1), (60, 3), (88.2, 2), (141, 1)])
def test_strip_never_touches_a_patch_or_its_marks(patch, paper, side_mm, copies):
    plan = build_pdf(patch, PrintSettings(paper=parse_paper(paper), size_mm=side_mm, copies=copies)).plan
    for page in plan.pages:
        strip = getattr(page, "strip", None)
        if strip is None:
            continue
        area, content = strip_area(strip), plan.frame.content
        assert area.x >= content.x - 1e-6
        assert area.y >= content.y - 1e-6
        assert area.right <= content.right + 1e-6
        for cut in page.cuts:
            beside = cut.right + 6 <= area.x + 1e-6 or area.top <= cut.y - 10.5 + 1e-6
            assert beside, (cut, area)


def test_no_page_is_added_for_the_strip(patch):
    tight = PrintSettings(paper=parse_paper("135x135mm"), size_mm=50)
    assert not build_pdf(patch, tight).plan.has_strip
    tiled = build_pdf(patch, PrintSettings(size_mm=300)).plan
    assert not tiled.has_strip
    assert len(tiled.pages) == 1 + 4


@pytest.mark.slow
@pytest.mark.parametrize("paper", ["a5", "a4", "letter", "tabloid", "135x135mm", "135x300mm"])
def test_strip_has_a_page_of_its_own_on_every_paper(paper):
    document = build_strip_pdf(parse_paper(paper))
    page = render(document.content, dpi=150)
    assert (np.abs(read_cells(page.pixels, find_strip(page.pixels)) - STRIP.srgb).max()) <= 1
    left, top, right, bottom = page.box_mm(page.pixels.min(2) < 250)
    sheet = document.plan.frame.paper
    assert min(left, top, sheet.width_mm - right, sheet.height_mm - bottom) >= 10 - 0.2
