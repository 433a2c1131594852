"""The board on the rig's table: photographs of it tell the camera that took them."""

import numpy as np
import pytest

from toolkit.objects.load import load_object
from toolkit.rig.board import DEFAULT_BOARD, CharucoBoard
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import add_board, make_studio
from toolkit.rooms.photos.board_pose import find_board, solve_pose


@pytest.mark.slow
@pytest.mark.parametrize("azimuth_deg", [0, 100, 250])
def test_a_picture_of_it_gives_the_camera_back(tmp_path, make_crate_space, azimuth_deg):
    """A board that was laid turned, mirrored, off the middle or at another scale would give another camera."""
    mesh = load_object(make_crate_space(tmp_path / "w").object_spec("crate")).mesh
    board = CharucoBoard(columns=9, rows=11, square_mm=26.0, marker_mm=19.5)
    studio = add_board(make_studio(1, 100.0, "oak"), board)
    camera, pose = Camera.from_fov(800, 600, 40.0), orbit_pose(np.array([0, 0, 20.0]), azimuth_deg, 45, 420)
    picture = tone_map(RaycastRenderer(mesh, studio).render(camera, pose), (1,))
    sighting = find_board(picture, board)
    assert sighting is not None
    found = solve_pose(sighting, camera).T_world_camera
    angle = np.degrees(np.arccos(np.clip(found[:3, 2] @ pose[:3, 2], -1, 1)))
    assert angle < 0.2
    assert np.linalg.norm(found[:3, 3] - pose[:3, 3]) < 0.01 * 420


def test_the_middle_stays_the_middle_and_the_rest_stays_the_table():
    plain = make_studio(1, 270.0, "oak")
    laid = add_board(plain, DEFAULT_BOARD, px_per_mm=1.0)
    assert np.abs(np.array(laid.table.size_mm) - plain.table.size_mm).max() < 2
    high, wide = laid.table.picture.shape[:2]
    assert (wide, high) == tuple(round(mm) for mm in laid.table.size_mm)
    board_h, board_w = (DEFAULT_BOARD.size_mm[0] + 18, DEFAULT_BOARD.size_mm[1] + 18)
    inside = laid.table.picture[round(high / 2 - board_h / 2) + 3 : round(high / 2 + board_h / 2) - 3,
                        round(wide / 2 - board_w / 2) + 3 : round(wide / 2 + board_w / 2) - 3]  # fmt: skip
    assert set(np.unique(inside[..., 0])) <= set(range(28, 237))
    assert (np.ptp(inside.astype(int), axis=2) == 0).all(), "paper and ink are grey"
    assert np.ptp(laid.table.picture[:50, :50].astype(int), axis=2).max() > 5, "oak is not"
