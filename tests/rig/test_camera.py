"""The pinhole camera against OpenCV, its own inverse, and what the words of its convention say."""

import cv2
import numpy as np
import pytest

from toolkit.rig.camera import Camera, distance_to_fill, look_at, orbit_direction, orbit_pose, pixel_rays, project

CAMERA = Camera.from_fov(160, 120, 47.0)
VIEWS = [(0, 30, 0), (75, 5, 10), (200, 65, -35), (310, 89, 90), (123, 90, 20), (40, -20, 0)]


def view(azimuth, elevation, roll, distance=400.0):
    return orbit_pose(np.array([10.0, -5.0, 20.0]), azimuth, elevation, distance, roll)


@pytest.mark.parametrize("angles", VIEWS)
def test_projection_is_opencvs(angles):
    T_world_camera = view(*angles)
    points = np.random.default_rng(1).uniform(-60, 60, (50, 3))
    T_camera_world = np.linalg.inv(T_world_camera)
    rotation, _ = cv2.Rodrigues(T_camera_world[:3, :3])
    expected, _ = cv2.projectPoints(points, rotation, T_camera_world[:3, 3], CAMERA.matrix, None)
    pixels, depth = project(CAMERA, T_world_camera, points)
    np.testing.assert_allclose(pixels, expected.reshape(-1, 2), atol=1e-6)
    np.testing.assert_allclose(depth, (T_camera_world @ np.c_[points, np.ones(50)].T)[2], atol=1e-9)


@pytest.mark.parametrize("angles", VIEWS)
def test_rays_go_where_the_pixels_came_from(angles):
    T_world_camera = view(*angles)
    pixels = np.random.default_rng(2).uniform(0, 120, (40, 2)).astype(np.float32)
    rays = pixel_rays(CAMERA, T_world_camera, pixels)
    np.testing.assert_allclose(np.linalg.norm(rays[:, 3:], axis=1), 1, atol=1e-6)
    again, depth = project(CAMERA, T_world_camera, rays[:, :3] + 321.0 * rays[:, 3:])
    assert (depth > 0).all()
    np.testing.assert_allclose(again, pixels, atol=2e-3)


@pytest.mark.parametrize("angles", VIEWS)
def test_pose_is_a_rotation_at_the_distance_asked_for(angles):
    T_world_camera = view(*angles)
    rotation = T_world_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert np.linalg.norm(T_world_camera[:3, 3] - [10, -5, 20]) == pytest.approx(400)
    pixels, depth = project(CAMERA, T_world_camera, np.array([[10.0, -5.0, 20.0]]))
    np.testing.assert_allclose(pixels[0], [80, 60], atol=1e-6)
    assert depth[0] == pytest.approx(400)


def test_azimuth_starts_at_the_front_and_runs_counter_clockwise_from_above():
    for azimuth, place in {0: (1, 0), 90: (0, 1), 180: (-1, 0), 270: (0, -1)}.items():
        np.testing.assert_allclose(orbit_direction(azimuth, 0), [*place, 0], atol=1e-12)
    assert orbit_direction(30, 90)[2] == pytest.approx(1)
    # from the front, the object's left (+y) is at the viewer's right, and up is up
    pixels, _ = project(CAMERA, orbit_pose(np.zeros(3), 0, 10, 300), np.array([[0, 20.0, 0], [0, 0, 20.0]]))
    assert pixels[0, 0] > 90 and abs(pixels[0, 1] - 60) < 1e-6
    assert pixels[1, 1] < 50 and abs(pixels[1, 0] - 80) < 1e-6


def test_positive_roll_turns_the_scene_counter_clockwise():
    above = np.array([[0, 0, 20.0]])
    upright, _ = project(CAMERA, orbit_pose(np.zeros(3), 0, 0, 300, 0), above)
    rolled, _ = project(CAMERA, orbit_pose(np.zeros(3), 0, 0, 300, 90), above)
    assert upright[0, 1] < 60
    np.testing.assert_allclose(rolled[0], [80 - (60 - upright[0, 1]), 60], atol=1e-6)  # up has become left


@pytest.mark.parametrize("azimuth", [0, 60, 210])
def test_straight_above_is_the_limit_of_that_azimuth(azimuth):
    nearly = orbit_pose(np.zeros(3), azimuth, 89.99, 300)
    above = orbit_pose(np.zeros(3), azimuth, 90, 300)
    np.testing.assert_allclose(above[:3, :3], nearly[:3, :3], atol=1e-3)
    below = look_at(np.array([0, 0, -300.0]), np.zeros(3), azimuth_deg=azimuth)
    np.testing.assert_allclose(below[:3, :3], orbit_pose(np.zeros(3), azimuth, -89.99, 300)[:3, :3], atol=1e-3)


def test_field_of_view_ends_at_the_frames_edge():
    angle = np.radians(CAMERA.fov_deg / 2)
    edge = np.array([[np.sin(angle), 0, np.cos(angle)]])
    pixels, _ = project(CAMERA, np.eye(4), edge)
    np.testing.assert_allclose(pixels[0], [160, 60], atol=1e-9)
    assert CAMERA.intrinsics["fx"] == CAMERA.matrix[0, 0] == CAMERA.matrix[1, 1]


@pytest.mark.parametrize("angles", VIEWS)
@pytest.mark.parametrize("fill", [0.3, 0.8, 0.95])
def test_the_object_fills_exactly_the_share_asked_for(angles, fill):
    points = np.random.default_rng(3).normal(size=(300, 3)) * [40, 25, 10]
    target = np.array([3.0, -2.0, 4.0])
    distance = distance_to_fill(CAMERA, points, target, *angles[:2], fill, angles[2])
    pixels, depth = project(CAMERA, orbit_pose(target, *angles[:2], distance, angles[2]), points)
    assert (depth > 0).all()
    assert np.abs(pixels - [80, 60]).max() / 60 == pytest.approx(fill, abs=1e-9)


def test_a_field_of_view_comes_back_and_stands_for_its_focal_length():
    for fov_deg in (1.5, 30.5, 33.3, 40.0, 62.0, 169.0):
        camera = Camera.from_fov(640, 480, fov_deg)
        assert camera.fov_deg == fov_deg
        assert camera.fx == camera.fy == pytest.approx(320 / np.tan(np.radians(fov_deg / 2)))
    assert Camera.from_focal_mm(640, 480, 35.0, 36.0).fx == pytest.approx(640 * 35 / 36)


def test_scaled_and_cropped_pictures_show_points_where_the_pixels_went():
    lens = Camera(640, 480, fx=560, fy=563, cx=328, cy=234, distortion=(-0.16, 0.05, 0.001, -0.0015, 0.0))
    points = np.random.default_rng(0).uniform((-40, -40, 260), (40, 40, 340), (20, 3))
    pixels = lens.project(np.eye(4), points)
    small = lens.scaled(320, 160).cropped(100, 20, 64, 64)
    np.testing.assert_allclose(small.project(np.eye(4), points), pixels * [1 / 2, 1 / 3] - [100, 20], atol=1e-9)
    assert (small.width, small.height) == (64, 64)


def test_points_behind_the_camera_are_nowhere_in_the_picture():
    ahead, behind = CAMERA.project(np.eye(4), np.array([[10.0, 5, 100], [10, 5, -100]]))
    assert np.isfinite(ahead).all() and np.isnan(behind).all()


def test_intrinsics_round_trip_with_missing_coefficients():
    lens = Camera(640, 480, fx=560, fy=563, cx=328, cy=234, distortion=(-0.1, 0.05, 0.0, 0.0, 0.0))
    assert Camera.from_intrinsics(lens.intrinsics, (-0.1, 0.05)) == lens
    plain, _ = project(Camera.from_intrinsics(lens.intrinsics), np.eye(4), np.array([[10.0, 20, 300]]))
    np.testing.assert_allclose(plain, [[328 + 560 / 30, 234 + 563 / 15]])
