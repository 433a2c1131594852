"""A board whose file has columns and rows the other way round."""

import cv2
import numpy as np
import pytest

from toolkit.core.workspace import make_workspace
from toolkit.rig.board import CharucoBoard, Chessboard, MarkerGrid
from toolkit.rig.board_file import swap_sides
from toolkit.rooms.photos.board_pose import find_board


@pytest.mark.parametrize("kind", [CharucoBoard, MarkerGrid])
def test_the_swapped_board_is_found_where_the_other_is_not(kind):
    printed = kind(columns=7, rows=5, square_mm=30, marker_mm=22, dictionary="DICT_4X4_50")
    described = kind(columns=5, rows=7, square_mm=30, marker_mm=22, dictionary="DICT_4X4_50")
    sheet = cv2.copyMakeBorder(printed.paint(4), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    picture = np.repeat(sheet[..., None], 3, axis=2)
    turned = swap_sides(described)
    assert turned == printed
    assert find_board(picture, turned) is not None


def test_a_square_board_has_nothing_to_swap():
    assert swap_sides(Chessboard(columns=6, rows=6, square_mm=30)) is None


def test_calibrate_tries_both_and_says_so(tmp_path, type_toolkit, monkeypatch):
    from toolkit.rig.board_file import BoardSpec, boards_dir, write_spec
    from toolkit.rooms.photos import calibrate

    space = make_workspace(tmp_path / "space")
    spec = BoardSpec(kind="charuco", columns=5, rows=7, square_mm=30, marker_mm=22, dictionary="DICT_4X4_50")
    write_spec(boards_dir(space) / "mine.toml", spec)
    asked = []

    def calibrate_folder(folder, board):
        asked.append((board.columns, board.rows))
        found = (calibrate.LensResult("phone", None, (640, 480), ("a.png",), None, "too few photographs"),)
        return calibrate.CalibrationRun(found if board.columns == 7 else (), (("a.png", "no board is seen"),), ())

    monkeypatch.setattr(calibrate, "calibrate_folder", calibrate_folder)
    code, _, err = type_toolkit("calibrate", tmp_path, "--board", "mine", "--workspace", space.root)
    assert asked == [(5, 7), (7, 5)] and code == 2
    assert "columns and rows the other way round" in err and "mine.toml" in err and "too few photographs" in err
