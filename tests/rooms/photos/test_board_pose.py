"""The camera that is found from the board, against the camera that took the picture."""

import board_photos
import cv2
import numpy as np
import pytest
from board_photos import photograph

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.rig.board import DEFAULT_BOARD, CharucoBoard
from toolkit.rig.board_file import MarkerRing, choose_ring
from toolkit.rig.camera import Camera, look_at, orbit_pose
from toolkit.rig.markers import get_dictionary
from toolkit.rooms.photos.board_pose import find_board, find_dictionary, measure_ink, shrink, solve_pose
from toolkit.rooms.photos.lens import lens_from_focal
from toolkit.rooms.photos.locate import locate_by_board

PAGE = CharucoBoard(7, 10, 26.0, 19.5)
SMALL = Camera.from_fov(960, 540, 40)
T_PAGE = orbit_pose(np.array([0.0, 0, 20]), 25, 45, 480)


def errors_of(pose, T_world_camera) -> tuple[float, float]:
    """Whole rotation in degrees, and camera position in shares of the distance from the world's origin."""
    turn = pose.T_world_camera[:3, :3].T @ T_world_camera[:3, :3]
    angle = np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0]))
    off = np.linalg.norm(pose.T_world_camera[:3, 3] - T_world_camera[:3, 3])
    return float(angle), float(off / np.linalg.norm(T_world_camera[:3, 3]))


def solve(pixels, board, camera):
    sighting = find_board(pixels, board)
    assert sighting is not None
    return solve_pose(sighting, camera)


@pytest.fixture(scope="module")
def crate(make_box):
    return make_box((110.0, 70.0, 60.0), paint=(170, 60, 40))


@pytest.fixture(scope="module")
def page_photo(crate):
    return photograph(crate, PAGE, SMALL, T_PAGE)


@pytest.mark.slow
def test_aim_at_full_hd_with_a_built_in_object_on_the_board():
    camera = Camera.from_fov(1920, 1080, 40)
    angles, shares = [], []
    for azimuth, elevation in ((0, 25), (140, 25), (75, 45), (250, 65)):
        T_world_camera = orbit_pose(np.array([0, 0, 45.0]), azimuth, elevation, 700)
        pixels = photograph("coffeepot", DEFAULT_BOARD, camera, T_world_camera)
        angle, share = errors_of(solve(pixels, DEFAULT_BOARD, camera), T_world_camera)
        angles.append(angle)
        shares.append(share)
    assert np.median(angles) < 0.5 and np.median(shares) < 0.01  # what the issue asks for
    assert max(angles) < 0.1 and max(shares) < 0.002  # what was measured, with room: 0.014 degrees, 0.03 %


def test_found_corners_lie_where_the_camera_projects_them(page_photo):
    sighting = find_board(page_photo, PAGE)
    off = sighting.corners_px - SMALL.project(T_PAGE, sighting.world_mm)
    assert len(sighting.ids) >= 20
    assert np.abs(np.median(off, axis=0)).max() < 0.05  # half a pixel, were the conventions mixed up
    np.testing.assert_allclose(sighting.world_mm, PAGE.object_points(sighting.ids))


def test_corners_beside_covered_markers_are_found_too(page_photo):
    """More than OpenCV's own search finds, which asks for both markers of a corner, and no less exact."""
    grey = cv2.cvtColor(page_photo, cv2.COLOR_RGB2GRAY)
    by_opencv = cv2.aruco.CharucoDetector(PAGE.to_cv()).detectBoard(grey)[1]
    sighting = find_board(page_photo, PAGE)
    off = np.linalg.norm(sighting.corners_px - SMALL.project(T_PAGE, sighting.world_mm), axis=1)
    assert len(sighting.ids) >= 1.5 * len(by_opencv)
    assert np.mean(off < 0.3) > 0.9 and off.max() < 2  # the crate's own edges may pass for one


SPOILS = {
    "jpeg": lambda pixels: board_photos.through_jpeg(pixels, 40),
    "blur": lambda pixels: board_photos.blur(pixels, 1.5),
    "shake": lambda pixels: board_photos.shake(pixels, 6),
    "over-exposed": lambda pixels: board_photos.expose(pixels, 1.5),
    "under-exposed": lambda pixels: board_photos.expose(pixels, -2.5),
    "webcam": board_photos.webcam,
}


@pytest.mark.slow
@pytest.mark.parametrize("spoil", SPOILS)
def test_a_poor_photograph_still_gives_the_pose(page_photo, spoil):
    angle, share = errors_of(solve(SPOILS[spoil](page_photo), PAGE, SMALL), T_PAGE)
    assert angle < 0.5 and share < 0.01


def test_the_same_pixels_give_the_same_pose(page_photo):
    one, other = (solve(page_photo, PAGE, SMALL) for _ in range(2))
    assert np.array_equal(one.T_world_camera, other.T_world_camera)


@pytest.mark.slow
def test_half_a_board_out_of_the_frame():
    T_world_camera = look_at(np.array([300.0, -150, 320]), np.array([110.0, -20, 0]), 12)
    pixels = photograph(None, PAGE, SMALL, T_world_camera)
    sighting = find_board(pixels, PAGE)
    assert len(sighting.ids) < 0.8 * PAGE.corner_count
    angle, share = errors_of(solve(pixels, PAGE, SMALL), T_world_camera)
    assert angle < 0.3 and share < 0.005


def test_a_large_photograph_is_searched_small_and_refined_in_full(page_photo):
    large = cv2.resize(page_photo, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    sighting = find_board(large, PAGE)
    off = sighting.corners_px / 4 - SMALL.project(T_PAGE, sighting.world_mm)
    assert (sighting.width, sighting.height) == (3840, 2160)
    assert np.abs(np.median(off, axis=0)).max() < 0.05
    # a lens of the smaller picture is scaled to it
    angle, share = errors_of(solve_pose(sighting, SMALL), T_PAGE)
    assert angle < 0.2 and share < 0.004


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0, 90, 180, -90])
def test_any_way_up(turn):
    T_world_camera = orbit_pose(np.array([0.0, 0, 0]), 200, 55, 520, turn)
    angle, share = errors_of(solve(photograph(None, PAGE, SMALL, T_world_camera), PAGE, SMALL), T_world_camera)
    assert angle < 0.3 and share < 0.005


def test_a_distorting_lens_is_allowed_for():
    lens = Camera(960, 540, fx=860, fy=866, cx=495, cy=262, distortion=(-0.2, 0.07, 0.001, -0.001, 0.0))
    pixels = photograph(None, PAGE, lens, T_PAGE)
    angle, share = errors_of(solve(pixels, PAGE, lens), T_PAGE)
    assert angle < 0.1 and share < 0.002
    plain = Camera(960, 540, fx=860, fy=866, cx=495, cy=262)
    assert errors_of(solve(pixels, PAGE, plain), T_PAGE)[1] > 2 * share  # the test can tell


def test_a_whole_millimetre_of_focal_length_costs_what_it_must(page_photo):
    true = board_photos.focal_35mm(SMALL)
    rounded = lens_from_focal(960, 540, round(true))
    angle, share = errors_of(solve(page_photo, PAGE, rounded), T_PAGE)
    assert share < 1.5 * abs(round(true) / true - 1) + 0.002 and angle < 0.5


def test_the_ring_of_a_turntable(crate):
    ring = choose_ring(170)
    assert isinstance(ring, MarkerRing)
    for azimuth, elevation in ((10, 30), (190, 60)):
        T_world_camera = orbit_pose(np.array([0.0, 0, 20]), azimuth, elevation, 480)
        pixels = photograph(crate, ring, SMALL, T_world_camera)
        angle, share = errors_of(solve(pixels, ring, SMALL), T_world_camera)
        assert angle < 0.5 and share < 0.01


def test_no_board_no_sighting(crate, page_photo):
    assert find_board(photograph(crate, None, SMALL, T_PAGE), PAGE) is None
    assert find_board(page_photo, choose_ring(170)) is None  # another sheet's markers are not taken for its own
    assert find_board(np.zeros((40, 60, 3), np.uint8), PAGE) is None


def test_corners_that_are_no_corners_are_dropped(page_photo):
    sighting = find_board(page_photo, PAGE)
    spoiled = sighting.corners_px.copy()
    spoiled[::5] += np.random.default_rng(0).uniform(3, 80, spoiled[::5].shape)
    pose = solve_pose(type(sighting)(sighting.ids, spoiled, sighting.world_mm, 960, 540), SMALL)
    angle, share = errors_of(pose, T_PAGE)
    assert angle < 0.1 and share < 0.002
    assert pose.n_corners <= len(spoiled) - len(spoiled[::5])


def made_sighting(lens, T_world_camera, noise_px, rng, ids=None):
    from toolkit.rooms.photos.board_pose import BoardSighting

    ids = np.arange(PAGE.corner_count) if ids is None else np.array(ids)
    world = PAGE.object_points(ids)
    pixels = lens.project(T_world_camera, world) + rng.normal(0, noise_px, (len(ids), 2))
    return BoardSighting(ids, pixels, world, lens.width, lens.height)


def test_the_stated_uncertainty_is_the_scatter():
    lens, rng = SMALL, np.random.default_rng(3)
    poses = [solve_pose(made_sighting(lens, T_PAGE, 0.4, rng), lens) for _ in range(120)]
    turns = [cv2.Rodrigues(pose.T_world_camera[:3, :3] @ T_PAGE[:3, :3].T)[0].ravel() for pose in poses]
    scatter_deg = np.degrees(np.sqrt((np.array(turns) ** 2).sum(axis=1).mean()))
    assert np.median([pose.angle_sigma_deg for pose in poses]) == pytest.approx(scatter_deg, rel=0.25)


def test_a_far_and_noisy_board_is_called_ambiguous_and_never_below_the_table():
    lens, rng = Camera.from_fov(640, 480, 20), np.random.default_rng(1)
    far = orbit_pose(np.zeros(3), 30, 75, 6000)
    poses = [solve_pose(made_sighting(lens, far, 0.5, rng), lens) for _ in range(8)]
    assert all(pose is None or pose.T_world_camera[2, 3] > 0 for pose in poses)
    assert sum(pose is None or pose.doubt() is not None for pose in poses) >= 6
    near = solve_pose(made_sighting(lens, orbit_pose(np.zeros(3), 30, 45, 900), 0.1, rng), lens)
    assert near.doubt() is None


def test_one_row_of_corners_is_no_pose():
    lens, rng = SMALL, np.random.default_rng(1)
    row = made_sighting(lens, T_PAGE, 0.1, rng, ids=range(PAGE.columns - 1))
    assert solve_pose(row, lens) is None


def test_a_lens_of_another_shape_is_refused(page_photo):
    with pytest.raises(ToolkitError, match="640x480 px says nothing of 960x540"):
        solve_pose(find_board(page_photo, PAGE), Camera.from_fov(640, 480, 40))


def test_a_pale_board_is_found_in_a_small_noisy_photograph():
    """640 × 480: modules of 2 px, ink 20 levels darker than paper, two levels of noise."""
    page = cv2.copyMakeBorder(DEFAULT_BOARD.paint(3.0), 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=255)
    h, w = page.shape
    seen = np.array([[170, 60], [470, 70], [600, 430], [40, 420]], np.float32)
    H = cv2.getPerspectiveTransform(np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32), seen)
    flat = cv2.warpPerspective(cv2.GaussianBlur(page, (0, 0), 2.0), H, (640, 480), borderValue=150)
    noisy = flat * 0.85 + np.random.default_rng(0).normal(0, 2.0, flat.shape)
    image = np.repeat(cv2.GaussianBlur(noisy, (0, 0), 0.7)[..., None].clip(0, 255).astype(np.uint8), 3, axis=2)
    sighting = find_board(image, DEFAULT_BOARD)
    assert sighting is not None and len(sighting.ids) > 100
    margin = np.linalg.inv(H) @ np.c_[sighting.corners_px, np.ones(len(sighting.ids))].T
    at_mm = (margin[:2] / margin[2]).T / 3.0 - 10.0  # of the page, whose margin is 10 mm
    row, column = np.divmod(sighting.ids, DEFAULT_BOARD.columns - 1)
    assert np.abs(at_mm - np.c_[column + 1, row + 1] * DEFAULT_BOARD.square_mm).max() < 1.5


def test_another_dictionary_is_named(tmp_path):
    """A board of 4 × 4 bits where the workspace has one of 5 × 5; a picture of nothing has none."""
    page = cv2.aruco.CharucoBoard((5, 7), 30.0, 22.0, get_dictionary("DICT_4X4_100")).generateImage(
        (1000, 1400), None, 60
    )
    grey = cv2.GaussianBlur(40 + page * 0.7, (0, 0), 1.0).astype(np.uint8)
    image = np.repeat(grey[..., None], 3, axis=2)
    assert find_dictionary(image) == "DICT_4X4_50", "the smallest that has all of its numbers"
    assert find_dictionary(np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)) is None
    words = locate_by_board(make_workspace(tmp_path))(None, image)
    assert words == "no board is seen, but markers of DICT_4X4_50: this board has DICT_5X5_1000"
    board = CharucoBoard(5, 7, 30.0, 22.0, "DICT_4X4_50")
    assert measure_ink(image, find_board(image, board)) < 0.2, "black ink on paper"


def test_a_dark_object_on_a_pale_board_is_not_its_ink():
    """A black pot covers a third of a board in 10 % ink, which was then called black."""
    page = DEFAULT_BOARD.paint(3.0)
    cv2.ellipse(
        page, (page.shape[1] // 2, page.shape[0] // 2), (page.shape[1] // 3, page.shape[0] // 3), 0, 0, 360, 5, -1
    )
    image = np.repeat(cv2.GaussianBlur(page, (0, 0), 1.5)[..., None], 3, axis=2)
    assert 0.7 < measure_ink(image, find_board(image, DEFAULT_BOARD)) < 0.9


@pytest.mark.slow
def test_dictionaries_of_real_boards_are_named(shared):
    for folder, name in (("charuco", "DICT_4X4_50"), ("aruco-sheet", "DICT_6X6_50")):
        files = sorted((shared / "photos" / folder).glob("*.jpg"))[::7]
        found = [find_dictionary(cv2.imread(str(file))) for file in files]
        assert found.count(name) >= 0.9 * len(found), (folder, found)


@pytest.mark.parametrize("shape", [(20_000, 1), (1, 20_000), (3, 9000)])
def test_a_picture_of_one_line_is_searched(shape):
    found = shrink(np.zeros(shape, np.uint8), 1000)
    assert max(found.shape) == 1000 and min(found.shape) == 1
