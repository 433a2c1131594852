"""Descriptions of boards that others printed: read, written, refused, and drawn as OpenCV draws them."""

import cv2
import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.rig.board import CharucoBoard, Chessboard, MarkerGrid
from toolkit.rig.board_file import BoardSpec, boards_dir, read_board, with_board, write_spec
from toolkit.rig.markers import get_dictionary

CHARUCO = 'kind = "charuco"\ncolumns = 5\nrows = 8\nsquare_mm = 30\n'


@pytest.fixture
def space(tmp_path):
    return make_workspace(tmp_path / "space")


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("rows", [7, 8])
def test_charuco_boards_are_drawn_as_opencv_draws_them(legacy, rows):
    board = CharucoBoard(5, rows, 24.0, 18.0, "DICT_4X4_50", first_id=3, legacy=legacy)
    drawn = board.to_cv().generateImage((5 * 24 * 2, rows * 24 * 2))
    assert (board.paint(2.0) == drawn).mean() > 0.999
    ours = board.marker_points()[..., [1, 0]] + np.array(board.size_mm) / 2
    np.testing.assert_allclose(ours, np.array(board.to_cv().getObjPoints())[..., :2], atol=1e-4)


def test_a_grid_is_opencvs():
    grid = MarkerGrid(4, 5, 42.5, 37.5, "DICT_6X6_50", first_id=2)
    theirs = cv2.aruco.GridBoard((4, 5), 37.5, 5.0, get_dictionary("DICT_6X6_50"), np.arange(2, 22))
    ours = np.array(grid.to_cv().getObjPoints())
    np.testing.assert_allclose(ours, np.array(theirs.getObjPoints()), atol=1e-4)
    assert grid.size_mm == (165.0, 207.5)
    whole = MarkerGrid(4, 5, 44, 40, "DICT_6X6_50", first_id=2)  # all edges on whole pixels
    theirs = cv2.aruco.GridBoard((4, 5), 40, 4, get_dictionary("DICT_6X6_50"), np.arange(2, 22))
    assert (whole.paint(2.0) == theirs.generateImage((2 * 172, 2 * 216))).mean() > 0.999


def test_boards_are_written_and_read_again(space):
    specs = {
        "a": BoardSpec(
            kind="charuco", columns=5, rows=8, square_mm=30, marker_mm=22.5, dictionary="DICT_4X4_50", legacy=True
        ),
        "b": BoardSpec(
            kind="apriltag-grid", columns=6, rows=4, square_mm=31.2, marker_mm=24, dictionary="DICT_APRILTAG_36h11"
        ),
        "c": BoardSpec(kind="chessboard", columns=10, rows=7, square_mm=25),
    }
    for name, spec in specs.items():
        write_spec(boards_dir(space) / f"{name}.toml", spec)
    made = [read_board(with_board(space, name)) for name in specs]
    assert [type(one) for one in made] == [CharucoBoard, MarkerGrid, Chessboard]
    assert made[0].legacy and made[1].square_mm == 31.2 and made[2].corner_count == 54
    assert read_board(with_board(space, boards_dir(space) / "c.toml")) == made[2]
    assert with_board(with_board(space, "c"), "printed") == space


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (CHARUCO, r"b.toml: field 'marker_mm': missing; a board of kind charuco needs it"),
        (CHARUCO + 'marker_mm = 29\ndictionary = "DICT_4X4_50"\n', "expected at most 27 mm"),
        (CHARUCO + 'marker_mm = 20\ndictionary = "DICT_4X4_51"\n', "did you mean"),
        (CHARUCO + 'marker_mm = 20\ndictionary = "DICT_4X4_50"\nfirst_id = 40\n', "it has 0 to 49"),
        (CHARUCO.replace("charuco", "chess"), "b.toml: field 'kind'"),
        (CHARUCO.replace("charuco", "chessboard") + "legacy = true\n", "legacy': a board of kind chessboard has"),
        (CHARUCO.replace("charuco", "chessboard").replace("30", "nan"), "field 'square_mm'"),
        (CHARUCO + "colour = 3\n", "field 'colour'"),
        (CHARUCO.replace("charuco", "aruco-grid") + 'marker_mm = 30\ndictionary = "DICT_4X4_50"\n', "touch"),
        (
            CHARUCO.replace("charuco", "aruco-grid") + 'marker_mm = 9\ndictionary = "DICT_APRILTAG_36h11"\n',
            "expected apriltag-grid",
        ),
        (CHARUCO.replace("charuco", "chessboard").replace("5", "0"), "columns: expected 3 to 200"),
        ("kind = ", "not TOML"),
    ],
)  # fmt: skip
def test_a_broken_description_is_one_line(space, text, complaint):
    boards_dir(space).mkdir()
    (boards_dir(space) / "b.toml").write_text(text)
    with pytest.raises(ToolkitError, match=complaint) as found:
        with_board(space, "b")
    assert "\n" not in str(found.value)


def test_an_unknown_board_says_where_boards_come_from(space):
    with pytest.raises(ToolkitError, match="--find-board"):
        with_board(space, "mine")
