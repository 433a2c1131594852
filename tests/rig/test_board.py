"""The sheet an object stands on: OpenCV's own pattern, in the world's frame, readable with its middle covered."""

import cv2
import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.rig import markers
from toolkit.rig.board import DEFAULT_BOARD, CharucoBoard
from toolkit.rig.board_file import (
    DEFAULT_RING,
    MarkerRing,
    board_file,
    choose_ring,
    count_that_fit,
    read_board,
    write_board,
)
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.markers import DICTIONARIES, RING_FIRST_ID, STRIP_FIRST_ID

SMALL = CharucoBoard(7, 10, 20.0, 15.0)
BORDER_MM = 10


def photograph(spec, azimuth_deg, elevation_deg, cover_mm=None):
    """A picture of the sheet from a known camera; page corners are placed in the world by the words of the contract."""
    picture = np.pad(spec.paint(2.5), int(2.5 * BORDER_MM), constant_values=255)
    half_width, half_height = (side / 2 + BORDER_MM for side in spec.size_mm)
    if cover_mm:
        middle = np.array(picture.shape) / 2
        (top, left), (bottom, right) = ((middle + sign * 1.25 * np.array(cover_mm)).astype(int) for sign in (-1, 1))
        picture[top:bottom, left:right] = 120
    camera = Camera.from_fov(1600, 1200, 40)
    T_world_camera = orbit_pose(np.zeros(3), azimuth_deg, elevation_deg, 3.2 * max(half_width, half_height))
    # Upper left, upper right, lower right, lower left of the page: down is +x, to the right is +y.
    world = np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)]) * (half_height, half_width)
    seen = np.linalg.inv(T_world_camera) @ np.stack([*world.T, np.zeros(4), np.ones(4)])
    pixels = (camera.matrix @ seen[:3]).T
    height, width = picture.shape
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float32) - 0.5
    homography = cv2.getPerspectiveTransform(corners, (pixels[:, :2] / pixels[:, 2:] - 0.5).astype(np.float32))
    return cv2.warpPerspective(picture, homography, (1600, 1200), borderValue=90), camera, T_world_camera


def measure_pose_error(points_mm, corners_px, camera, T_world_camera):
    """Degrees and millimetres between the camera that OpenCV finds and the true one."""
    found, turn, shift = cv2.solvePnP(points_mm, corners_px + 0.5, camera.matrix, None)
    assert found
    T_camera_world = np.eye(4)
    T_camera_world[:3, :3], T_camera_world[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
    off = np.linalg.inv(T_camera_world) @ np.linalg.inv(T_world_camera)
    angle = np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))
    return angle, np.linalg.norm(np.linalg.inv(T_camera_world)[:3, 3] - T_world_camera[:3, 3])


@pytest.mark.parametrize(
    "spec", [CharucoBoard(7, 10, 20.0, 14.0), CharucoBoard(6, 5, 20.0, 14.0), CharucoBoard(5, 8, 21.0, 14.0)]
)
def test_pattern_is_opencvs_current_one(spec):
    board = spec.to_cv()
    assert not board.getLegacyPattern()
    width, height = spec.size_mm
    # At 2 pixels a millimetre every edge of these boards is on a whole pixel, where OpenCV's painting snaps to.
    expected = board.generateImage((round(width * 2), round(height * 2)), marginSize=0)
    assert (spec.paint(2.0) == expected).all()
    ours = np.array(board.getObjPoints())[..., :2]
    world = np.stack([ours[..., 1] - height / 2, ours[..., 0] - width / 2], axis=-1)
    np.testing.assert_allclose(spec.marker_points()[..., :2], world, atol=1e-4)


def test_painted_share_of_black_is_the_true_one():
    """At a scale that no edge meets a whole pixel, the mean of linear light is the area of white."""
    from toolkit.imaging.colour import srgb_to_linear

    spec = CharucoBoard(5, 8, 21.0, 14.0)
    true = (spec.paint(2.0) < 128).mean()  # every edge is on a whole pixel
    assert 1 - srgb_to_linear(spec.paint(1.37) / 255).mean() == pytest.approx(true, abs=2e-3)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 40), (90, 30), (205, 60)])
def test_camera_is_found_in_the_worlds_frame_with_the_middle_covered(azimuth, elevation):
    image, camera, T_world_camera = photograph(DEFAULT_BOARD, azimuth, elevation, cover_mm=(270, 120))
    corners, ids, _, _ = cv2.aruco.CharucoDetector(DEFAULT_BOARD.to_cv()).detectBoard(image)
    assert len(ids) > 60
    points = DEFAULT_BOARD.object_points(ids)
    assert (np.abs(points) <= np.array([195 - 26, 156 - 26, 0])).all()
    angle, distance = measure_pose_error(points, corners.reshape(-1, 2), camera, T_world_camera)
    assert angle < 0.1
    assert distance < 2


def test_ring_tells_the_camera_and_its_first_marker_is_the_front():
    ring = DEFAULT_RING
    image, camera, T_world_camera = photograph(ring, 30, 45, cover_mm=(200, 200))
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found, ids, _ = cv2.aruco.ArucoDetector(markers.get_dictionary(ring.dictionary), parameters).detectMarkers(image)
    assert set(ids.ravel().tolist()) == set(ring.marker_ids)
    corners = np.array(found).reshape(-1, 2)
    angle, distance = measure_pose_error(ring.object_points(ids.ravel()), corners, camera, T_world_camera)
    assert angle < 0.15
    assert distance < 4
    front, second = ring.marker_points(ring.marker_ids[:2]).mean(axis=1)
    assert front[0] == pytest.approx(ring.middle_radius_mm)
    assert front[1] == pytest.approx(0, abs=1e-9)
    assert second[1] > 0  # counter-clockwise from above: towards +y
    matched = ring.to_cv().matchImagePoints(found, ids)[0].reshape(-1, 3)
    half = ring.outer_mm / 2
    np.testing.assert_allclose(matched[:, :2] - half, ring.object_points(ids.ravel())[:, [1, 0]], atol=1e-3)


@pytest.mark.parametrize("inner_mm", [60, 130, 300, 600])
def test_ring_markers_lie_apart_and_outside_the_free_disc(inner_mm):
    ring = choose_ring(inner_mm)
    corners = ring.marker_points()[..., :2]
    radii = np.linalg.norm(corners, axis=-1)
    nearest = np.linalg.norm((corners[:, 0] + corners[:, 1]) / 2, axis=-1)
    assert nearest - inner_mm / 2 == pytest.approx(ring.quiet_mm)
    assert radii.max() + ring.quiet_mm == pytest.approx(ring.outer_mm / 2)
    module = ring.marker_mm / 7
    apart = np.linalg.norm(corners[:, 1] - np.roll(corners[:, 0], -1, axis=0), axis=-1)
    assert (apart >= module).all()
    assert ring.count <= count_that_fit(inner_mm, ring.marker_mm)


def test_default_ring_is_the_one_chosen_for_its_size():
    assert choose_ring(300) == DEFAULT_RING


def test_dictionaries_are_opencvs():
    known = {name: len(markers.get_dictionary(name).bytesList) for name in DICTIONARIES}
    assert known == DICTIONARIES


def test_no_two_sheets_share_a_marker():
    assert max(DEFAULT_BOARD.marker_ids) < RING_FIRST_ID
    assert len(set(DEFAULT_BOARD.marker_ids)) == len(DEFAULT_BOARD.to_cv().getIds())
    largest = choose_ring(4000)
    assert RING_FIRST_ID <= min(largest.marker_ids) <= max(largest.marker_ids) < STRIP_FIRST_ID
    assert CharucoBoard(40, 40, 26, 19.5).marker_ids[-1] == RING_FIRST_ID - 1
    with pytest.raises(ToolkitError, match="has 800"):
        CharucoBoard(40, 41, 26, 19.5)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: CharucoBoard(7, 10, 20.0, 20.0), "marker of 20 mm in a square of 20 mm"),
        (lambda: CharucoBoard(7, 10, 20.0, 18.5), "15 mm is good"),
        (lambda: CharucoBoard(2, 10, 20.0, 15.0), "columns"),
        (lambda: CharucoBoard(7, 10, float("nan"), 15.0), "square_mm"),
        (lambda: CharucoBoard(7, 10, 20.0, -1.0), "marker_mm"),
        (lambda: CharucoBoard(7, 10, 20.0, 15.0, "DICT_5X5_999"), "did you mean"),
        (lambda: CharucoBoard(20, 20, 20.0, 15.0, "DICT_4X4_50"), "has 50"),
        (lambda: MarkerRing(300, 24, 40), "at most"),
        (lambda: MarkerRing(300, 24, 5), "at least 8"),
        (lambda: MarkerRing(300, 24, 28, "DICT_4X4_50"), "0 to 49"),
        (lambda: choose_ring(20), "at least 30 mm"),
        (lambda: choose_ring(-3), "inner_mm"),
    ],
)
def test_sheets_that_cannot_be(make, says):
    with pytest.raises(ToolkitError, match=says) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_the_least_ring_that_an_error_names_is_one():
    assert choose_ring(30).count >= 8


@pytest.mark.parametrize("spec", [SMALL, MarkerRing(130, 12, 20)])
def test_spec_file_round_trip(tmp_path, spec):
    space = make_workspace(tmp_path)
    assert read_board(space) == DEFAULT_BOARD
    write_board(space, spec)
    assert read_board(space) == spec


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"board": {"columns": 7, "rows": 10, "square_mm": 20, "marker_mm": 25}}', "marker of 25 mm"),
        ('{"board": {"columns": 7, "rows": 10, "square_mm": "big", "marker_mm": 15}}', "board.square_mm"),
        ('{"board": {"columns": 7, "rows": 10, "square_mm": 20, "marker_mm": 15, "colour": 1}}', "board.colour"),
        ('{"schema_version": 1}', "either"),
        ("[", "not JSON"),
    ],
)
def test_broken_spec_file_is_named(tmp_path, text, says):
    space = make_workspace(tmp_path)
    board_file(space).write_text(text)
    with pytest.raises(ToolkitError, match=says) as caught:
        read_board(space)
    assert "board.json" in str(caught.value)
