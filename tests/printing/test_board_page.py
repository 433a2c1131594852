"""Boards and rings on paper, rasterised at 600 dpi: every size to 0.2 mm, every corner where the spec says."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pypdfium2
import pytest
from printed_pages import longest_run, render
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.print_ import print_patches
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.printing.page import TilePage, parse_paper
from toolkit.printing.print_boards import (
    EDGE_MM,
    FRONT_EDGE_MM,
    build_board_pdf,
    choose_board,
    measure_board,
    plan_board_pages,
)
from toolkit.rig.board import DEFAULT_BOARD, CharucoBoard
from toolkit.rig.board_file import DEFAULT_RING, choose_ring, read_board
from toolkit.rig.markers import get_dictionary

TOLERANCE_MM = 0.1
PAGES_MM = {"a4": (210, 297), "letter": (215.9, 279.4)}
ONE_PAGE = CharucoBoard(7, 10, 20.0, 15.0)


def detect_board(grey, spec):
    """Ids and (k, 2) positions, counted from the picture's upper left corner, of a board's inner corners."""
    corners, ids, _, _ = cv2.aruco.CharucoDetector(spec.to_cv()).detectBoard(np.ascontiguousarray(grey))
    return ids.ravel(), corners.reshape(-1, 2) + 0.5


def detect_markers(grey, spec):
    """(k, 4, 2) corners of a ring's markers by number."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(get_dictionary(spec.dictionary), parameters)
    corners, ids, _ = detector.detectMarkers(np.ascontiguousarray(grey))
    return dict(zip(ids.ravel().tolist(), np.array(corners)[:, 0] + 0.5, strict=True))


def board_on_page(document):
    """Left and upper edge of the squares on the only page, millimetres from its upper left corner."""
    (cut,) = document.plan.pages[0].cuts
    return cut.x + EDGE_MM, document.plan.frame.paper.height_mm - cut.top + EDGE_MM


@pytest.fixture(scope="module", params=["a4", "letter"])
def one_page(request):
    document = build_board_pdf(ONE_PAGE, parse_paper(request.param))
    assert len(document.plan.pages) == 1
    return request.param, document, render(document.content)


@pytest.mark.slow
def test_page_and_check_bars_measure_right(one_page):
    paper, _, page = one_page
    height, width = (side / page.per_mm for side in page.pixels.shape[:2])
    assert (width, height) == pytest.approx(PAGES_MM[paper], abs=TOLERANCE_MM)
    for mask in (page.black, page.black.T):
        length, _, _ = longest_run(mask, least=1500)
        assert length / page.per_mm == pytest.approx(100, abs=TOLERANCE_MM)


def test_squares_and_markers_measure_right(one_page):
    _, document, page = one_page
    left, top = board_on_page(document)

    def edges(x0, y0, x1, y1, axis):
        strip = page.cut_out(x0, y0, x1, y1).max(2) < 128
        line = np.concatenate(
            [[False], strip[strip.shape[0] // 2] if axis == 0 else strip[:, strip.shape[1] // 2], [False]]
        )
        return np.flatnonzero(line[1:] != line[:-1]) / page.per_mm + (x0, y0)[axis]

    # One millimetre below the squares' upper edge no marker begins: black squares alone, in every second column.
    for row in range(ONE_PAGE.rows):
        y = top + 20 * row + 1
        found = edges(left - 2, y - 0.2, left + 142, y + 0.2, axis=0)
        black = range(row % 2, ONE_PAGE.columns, 2)
        assert found == pytest.approx([left + 20 * (at + end) for at in black for end in (0, 1)], abs=TOLERANCE_MM)
    for column in range(ONE_PAGE.columns):
        x = left + 20 * column + 1
        found = edges(x - 0.2, top - 0.8, x + 0.2, top + 200.8, axis=1)
        black = range(column % 2, ONE_PAGE.rows, 2)
        assert found == pytest.approx([top + 20 * (at + end) for at in black for end in (0, 1)], abs=TOLERANCE_MM)
    # The upper border of the first marker, in the second square.
    found = edges(left + 20.5, top + 3.5, left + 39.5, top + 3.7, axis=0)
    assert found == pytest.approx([left + 22.5, left + 37.5], abs=TOLERANCE_MM)


def test_crop_marks_stand_at_the_sheets_corners(one_page):
    _, document, page = one_page
    (cut,) = document.plan.pages[0].cuts
    top = document.plan.frame.paper.height_mm - cut.top
    marks = page.black_groups_mm(cut.x - 7, top - 3.5, cut.right + 7, top - 2.5, axis=0)
    assert marks == pytest.approx([cut.x, cut.right], abs=TOLERANCE_MM)
    marks = page.black_groups_mm(cut.right + 2.5, top - 7, cut.right + 3.5, top + cut.height + 7, axis=1)
    assert marks == pytest.approx([top, top + cut.height], abs=TOLERANCE_MM)
    assert (cut.width, cut.height) == pytest.approx((140 + 2 * EDGE_MM, 200 + EDGE_MM + FRONT_EDGE_MM))


@pytest.mark.slow
def test_opencv_finds_every_corner_in_its_place(one_page):
    _, document, page = one_page
    ids, corners = detect_board(page.pixels[..., 0], ONE_PAGE)
    assert len(ids) == ONE_PAGE.corner_count
    rows, columns = np.divmod(ids, ONE_PAGE.columns - 1)
    expected = np.stack([columns + 1, rows + 1], axis=1) * 20.0 + board_on_page(document)
    assert np.abs(corners / page.per_mm - expected).max() < TOLERANCE_MM


def test_page_says_what_it_is_and_where_the_front_is(one_page):
    _, document, _ = one_page
    page = pypdfium2.PdfDocument(document.content)[0]
    words = page.get_textpage()
    everything = words.get_text_bounded()
    for part in (
        "camera board",
        "7 × 10 squares of 20 mm",
        "markers 15 mm",
        "DICT_5X5_1000",
        "Stand the object",
        "100 mm",
    ):
        assert part in everything
    found = words.search("FRONT", match_case=True)
    boxes = []
    while (hit := found.get_next()) is not None:
        boxes.append(words.get_charbox(hit[0]))
    (cut,) = document.plan.pages[0].cuts
    lowest = min(bottom for _, bottom, _, _ in boxes) * 25.4 / 72
    assert cut.y < lowest < cut.y + FRONT_EDGE_MM  # on the sheet's lower edge, inside the cut


def join_tiles(document, dpi):
    """The sheet that comes of laying the tiles' windows over each other as the map says; grey, and pixels per mm."""
    plan, per_mm = document.plan, dpi / 25.4
    height = max(page.tile.area.top for page in plan.pages[1:])
    width = max(page.tile.area.right for page in plan.pages[1:])
    sheet = np.full((round(height * per_mm) + 2, round(width * per_mm) + 2), 255, np.uint8)
    for index, page in enumerate(plan.pages):
        if not isinstance(page, TilePage):
            continue
        raster = render(document.content, index, dpi)
        top = plan.frame.paper.height_mm - page.window.top
        part = raster.cut_out(page.window.x, top, page.window.right, top + page.window.height)[..., 0]
        x, y = round(page.tile.area.x * per_mm), round((height - page.tile.area.top) * per_mm)
        sheet[y : y + part.shape[0], x : x + part.shape[1]] = part
    return sheet, per_mm


@pytest.mark.slow
@pytest.mark.parametrize(("paper", "dpi"), [("a4", 200), ("letter", 150)])
def test_default_board_is_four_tiles_that_join(paper, dpi):
    document = build_board_pdf(DEFAULT_BOARD, parse_paper(paper))
    assert document.plan.tiles == (2, 2)
    sheet, per_mm = join_tiles(document, dpi)
    ids, corners = detect_board(sheet, DEFAULT_BOARD)
    assert len(ids) == DEFAULT_BOARD.corner_count
    rows, columns = np.divmod(ids, DEFAULT_BOARD.columns - 1)
    expected = np.stack([columns + 1, rows + 1], axis=1) * 26.0 + EDGE_MM
    assert np.abs(corners / per_mm - expected).max() < 2 * TOLERANCE_MM  # each raster is laid down on whole pixels


@pytest.mark.slow
@pytest.mark.parametrize(("paper", "dpi"), [("a4", 600), ("letter", 300)])
def test_ring_on_one_page(paper, dpi):
    ring = choose_ring(130)
    document = build_board_pdf(ring, parse_paper(paper))
    (cut,) = document.plan.pages[0].cuts
    page = render(document.content, dpi=dpi)
    markers = detect_markers(page.pixels[..., 0], ring)
    assert set(markers) == set(ring.marker_ids)
    corner = (cut.x, document.plan.frame.paper.height_mm - cut.top)
    for number, corners in markers.items():
        expected = ring.sheet_corners([number])[0] + corner
        assert np.abs(corners / page.per_mm - expected).max() < TOLERANCE_MM
    sides = [np.linalg.norm(corners[0] - corners[1]) / page.per_mm for corners in markers.values()]
    assert sides == pytest.approx([12.0] * ring.count, abs=TOLERANCE_MM)
    across = markers[ring.marker_ids[0]][:2].mean(0) - markers[ring.marker_ids[ring.count // 2]][:2].mean(0)
    assert np.linalg.norm(across) / page.per_mm == pytest.approx(130 + 2 * ring.quiet_mm, abs=TOLERANCE_MM)


def test_tiled_ring_joins():
    document = build_board_pdf(DEFAULT_RING, parse_paper("a3"))
    assert len(document.plan.pages) == 1 + document.plan.tiles[0] * document.plan.tiles[1]
    sheet, per_mm = join_tiles(document, dpi=150)
    markers = detect_markers(sheet, DEFAULT_RING)
    assert set(markers) == set(DEFAULT_RING.marker_ids)
    for number, corners in markers.items():
        assert np.abs(corners / per_mm - DEFAULT_RING.sheet_corners([number])[0]).max() < 2 * TOLERANCE_MM


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "paper"), [(DEFAULT_BOARD, "a4"), (DEFAULT_BOARD, "letter"), (DEFAULT_RING, "a4"), (ONE_PAGE, "135x300mm")]
)
def test_nothing_is_printed_in_the_outer_10_mm(spec, paper):
    document = build_board_pdf(spec, parse_paper(paper))
    sheet = document.plan.frame.paper
    for index in range(min(len(document.plan.pages), 3)):
        page = render(document.content, index, dpi=120)
        left, top, right, bottom = page.box_mm(page.pixels.min(2) < 250)
        assert min(left, top, sheet.width_mm - right, sheet.height_mm - bottom) >= 10 - 0.25


def test_same_spec_same_bytes():
    assert build_board_pdf(ONE_PAGE, parse_paper("a4")).content == build_board_pdf(ONE_PAGE, parse_paper("a4")).content


@pytest.mark.parametrize("paper", ["a4", "letter", "a3"])
def test_squares_are_chosen_to_fit_one_page(paper):
    board = choose_board(parse_paper(paper), squares=(7, 10))
    assert len(plan_board_pages(board, parse_paper(paper)).pages) == 1
    larger = CharucoBoard(7, 10, board.square_mm + 1, board.marker_mm)
    assert board.square_mm == 26 or len(plan_board_pages(larger, parse_paper(paper)).pages) > 1
    assert choose_board(parse_paper(paper), squares=(30, 40)).square_mm == 26  # no page holds these: they are tiled


def test_edges_of_the_sheet_hold_what_is_written_on_them():
    width, height = measure_board(ONE_PAGE)
    assert (width - 140, height - 200) == (2 * EDGE_MM, EDGE_MM + FRONT_EDGE_MM)
    assert measure_board(choose_ring(130)) == choose_ring(130).size_mm


@pytest.fixture
def space(tmp_path, monkeypatch):
    (tmp_path / "rig").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*arguments):
    return CliRunner().invoke(make_single(print_patches), [str(argument) for argument in arguments])


def test_command_prints_the_board_and_writes_its_spec(space):
    result = call("--board")
    assert result.exit_code == 0, result.output
    assert "312.0 × 390.0 mm, 5 pages of a4 portrait (a map and 2 × 2 tiles)" in result.output
    assert (space / "print" / "board.pdf").read_bytes().startswith(b"%PDF")
    assert read_board(Workspace(space)) == DEFAULT_BOARD
    assert "rig/board.json" in result.output

    again = json.loads(call("--ring", "--ring-mm", 130, "--out", "x.pdf", "--json").stdout)
    assert again["printed"][0]["pages"] == 1
    assert "before, it was a ChArUco board" in again["notes"][0]
    assert (space / "x.pdf").is_file()
    assert read_board(Workspace(space)) == replace(choose_ring(130), ink_percent=10)


def test_command_takes_squares_and_sizes(space):
    assert call("--board", "--board-squares", "5x7", "--square-mm", 30, "--marker-mm", 20).exit_code == 0
    assert read_board(Workspace(space)) == CharucoBoard(5, 7, 30.0, 20.0, ink_percent=10)
    assert call("--board", "--ink", 100).exit_code == 0
    assert read_board(Workspace(space)) == replace(DEFAULT_BOARD, ink_percent=100)


def test_command_prints_the_strip_alone(space):
    result = call("--colour-strip")
    assert result.exit_code == 0
    assert (space / "print" / "colour_strip.pdf").is_file()
    assert not (space / "rig" / "board.json").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--board", "--ring"], "--board --ring: cannot be combined"),
        (
            ["--board", "--class", "racer"],
            "--board: cannot be printed together with others: print it in a call of its own",
        ),
        (["--square-mm", "3"], "--square-mm 3: goes with --board"),
        (["--ring-mm", "200", "--board"], "goes with --ring"),
        (["--board", "--marker-mm", "26"], "expected at most 23.4 mm"),
        (["--board", "--board-squares", "7y10"], "such as 7x10"),
        (["--board", "--board-squares", "60x60"], "has 800"),
        (
            ["--board", "--board-squares", "30x40", "--square-mm", "50"],
            "101 pages of a4: expected at most 40; choose fewer or smaller squares or a larger --paper",
        ),
        (["--board", "--square-mm", "nan"], "--square-mm nan: expected a number"),
        (["--board", "--paper", "a44"], "did you mean a4?"),
        (["--board", "--orientation", "up"], "--orientation up: expected auto, portrait or landscape"),
        (["--ring", "--ring-mm", "20"], "at least 30 mm"),
        (["--ring", "--ring-mm", "4000"], "smaller ring"),
    ],
)
def test_what_cannot_be_printed_is_one_line(space, arguments, says):
    result = call(*arguments)
    assert isinstance(result.exception, ToolkitError), result.output
    assert says in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not (space / "print").exists()
    assert not (space / "rig" / "board.json").exists()


@pytest.mark.parametrize("ink_percent", [10, 40, 100])
def test_the_page_is_as_dark_as_asked(ink_percent):
    """The darkest square of the rasterised page has the grey of the ink, its writing stays black."""
    spec = CharucoBoard(7, 10, 20.0, 15.0, ink_percent=ink_percent)
    page = pypdfium2.PdfDocument(build_board_pdf(spec, parse_paper("a4")).content)[0]
    grey = page.render(scale=100 / 72).to_numpy()[..., 0].astype(int)
    wanted = round(255 * (1 - ink_percent / 100))
    counts = np.bincount(grey.ravel(), minlength=256)
    assert counts[max(0, wanted - 2) : wanted + 3].sum() > 0.2 * grey.size
    assert grey.min() < 40


@pytest.mark.parametrize("ink_percent", [0, 4, 101, float("nan")])
def test_ink_that_no_camera_finds_is_refused(ink_percent):
    with pytest.raises(ToolkitError, match="ink_percent"):
        replace(DEFAULT_BOARD, ink_percent=ink_percent)
