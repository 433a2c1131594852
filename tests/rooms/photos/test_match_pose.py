"""Matching a camera, or a picture, with the poses of a plan."""

import numpy as np
import pytest
from board_photos import object_mesh, photograph

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, look_at, orbit_direction, orbit_pose
from toolkit.rig.plan import Pose
from toolkit.rooms.photos.locate import match_pose, view_of
from toolkit.rooms.photos.match_render import make_templates, match_by_render

TARGET = (0.0, 0.0, 40.0)


def make_pose(number, azimuth, elevation, distance=600.0, roll=0.0):
    return Pose(
        id=number, azimuth_deg=azimuth, elevation_deg=elevation, distance_mm=distance, roll_deg=roll, target_mm=TARGET
    )


GRID = [make_pose(1 + 6 * row + i, 60 * i, 25 + 20 * row) for row in range(3) for i in range(6)]


@pytest.mark.parametrize("pose", GRID, ids=lambda pose: f"pose{pose.id}")
def test_a_camera_near_a_pose_is_that_pose_with_its_differences(pose):
    moved = orbit_pose(np.array(TARGET), pose.azimuth_deg + 3, pose.elevation_deg - 2, pose.distance_mm + 25, 4)
    match = match_pose(moved, GRID)
    assert match.pose_id == pose.id and not (match.ambiguous or match.far)
    assert match.azimuth_deg == pytest.approx(3) and match.elevation_deg == pytest.approx(-2)
    assert match.roll_deg == pytest.approx(4) and match.distance_mm == pytest.approx(25)
    # spherical law of cosines, and the straight line between the two places
    one, other = np.radians([pose.elevation_deg, pose.elevation_deg - 2])
    cosine = np.sin(one) * np.sin(other) + np.cos(one) * np.cos(other) * np.cos(np.radians(3))
    assert match.error_deg == pytest.approx(np.degrees(np.arccos(cosine)), abs=1e-6)
    chord = np.sqrt(600**2 + 625**2 - 2 * 600 * 625 * cosine)
    assert match.error_mm == pytest.approx(chord)


def test_exactly_at_the_pose_nothing_is_off():
    match = match_pose(GRID[7].matrix(), GRID)
    assert match.pose_id == 8 and match.error_deg < 1e-6 and match.error_mm < 1e-6 and abs(match.roll_deg) < 1e-6


def test_between_two_poses_is_ambiguous_and_names_both():
    match = match_pose(orbit_pose(np.array(TARGET), 0, 35.6, 600), GRID)
    assert {match.pose_id, match.runner_up} == {1, 7} and match.ambiguous
    assert "ambiguous: pose" in match.describe()


def test_far_from_all_is_said():
    match = match_pose(orbit_pose(np.array(TARGET), 30, 5, 600), GRID)
    assert match.far and "far from every pose" in match.describe()


def test_a_picture_on_its_side_is_far_by_its_roll():
    match = match_pose(orbit_pose(np.array(TARGET), 60, 45, 600, 90), GRID)
    assert match.pose_id == 8 and match.roll_deg == pytest.approx(90) and match.error_deg < 1e-6 and match.far


def test_another_distance_for_all_still_finds_the_direction():
    for pose in GRID:
        nearer = orbit_pose(np.array(TARGET), pose.azimuth_deg, pose.elevation_deg + 3, 330)
        match = match_pose(nearer, GRID)
        assert (
            match.pose_id == pose.id and not (match.ambiguous or match.far) and match.distance_mm == pytest.approx(-270)
        )


def test_aiming_beside_the_object_is_no_other_place():
    place = np.array(TARGET) + 600 * orbit_direction(120, 45)
    match = match_pose(look_at(place, np.array([30.0, 40, 60])), GRID)
    assert match.pose_id == 9 and match.error_deg < 1e-6


def test_poses_of_one_direction_are_told_apart_by_distance_and_roll():
    near, far, rolled = make_pose(1, 0, 45, 400), make_pose(2, 0, 45, 900), make_pose(3, 0, 45, 400, roll=90)
    poses = [near, far, rolled]
    assert [match_pose(pose.matrix(), poses).pose_id for pose in poses] == [1, 2, 3]
    twin = [near, make_pose(2, 0, 45, 410)]
    assert match_pose(near.matrix(), twin).ambiguous


def test_straight_above_roll_is_measured_where_azimuth_means_nothing():
    above = make_pose(1, 0, 90)
    nearly = look_at(np.array(TARGET) + 600 * orbit_direction(130, 88.5), np.array(TARGET))
    turned = nearly.copy()
    turned[:3, :3] = above.matrix()[:3, :3]
    assert abs(match_pose(turned, [above]).roll_deg) < 2
    assert abs(abs(match_pose(nearly, [above]).roll_deg) - 130) < 3


def test_a_plan_of_one_has_no_runner_up():
    match = match_pose(GRID[0].matrix(), GRID[:1])
    assert match.runner_up is None and not match.ambiguous


def test_view_is_the_inverse_of_orbit():
    rng = np.random.default_rng(0)
    for _ in range(30):
        azimuth, elevation, distance, roll = rng.uniform(0, 360), rng.uniform(-80, 85), rng.uniform(50, 900), 170
        view = view_of(orbit_pose(np.array(TARGET), azimuth, elevation, distance, roll), np.array(TARGET))
        assert view.azimuth_deg == pytest.approx(azimuth) and view.elevation_deg == pytest.approx(elevation)
        assert view.distance_mm == pytest.approx(distance) and view.roll_deg == pytest.approx(roll)


def test_wrong_use_is_said():
    with pytest.raises(ToolkitError, match="toolkit plan"):
        match_pose(np.eye(4), [])
    inside = np.eye(4)
    inside[:3, 3] = TARGET
    with pytest.raises(ToolkitError, match="middle of the object"):
        match_pose(inside, GRID)
    with pytest.raises(ToolkitError, match="toolkit plan"):
        make_templates(object_mesh("racer"), Camera.from_fov(), [])


@pytest.fixture(scope="module")
def racer():
    mesh = object_mesh("racer")
    target = (0.0, 0.0, float(mesh.size_mm[2]) / 2)
    poses = [
        Pose(id=1 + i, azimuth_deg=60 * i, elevation_deg=elevation, distance_mm=560, target_mm=target)
        for i, elevation in enumerate((25, 45, 25, 65, 45, 25))
    ]
    return mesh, poses, make_templates(mesh, Camera.from_fov(640, 480, 40), poses)


@pytest.mark.slow
def test_without_a_board_the_likest_render_is_the_pose(racer):
    """Another light, table, lens and framing than the templates', and a camera that stands a little beside its pose."""
    mesh, poses, templates = racer
    camera = Camera.from_fov(320, 240, 55)
    right, sure_and_wrong = 0, 0
    for pose in poses:
        rng = np.random.default_rng(pose.id)
        target = np.array(pose.target_mm)
        angles = pose.azimuth_deg + rng.normal(0, 2.5), pose.elevation_deg + rng.normal(0, 2)
        place = target + 480 * orbit_direction(*angles)
        T_world_camera = look_at(place, target + rng.normal(0, 10, 3), rng.normal(0, 1.5))
        pixels = photograph(mesh, None, camera, T_world_camera, backdrop="oak", light="warm")
        match = match_by_render(pixels, templates)
        assert {number for number, _ in match.ranking} == {1, 2, 3, 4, 5, 6}
        right += match.pose_id == pose.id
        sure_and_wrong += match.pose_id != pose.id and not match.ambiguous
    assert right >= 5 and sure_and_wrong == 0


@pytest.mark.slow
def test_a_picture_without_the_object_is_ambiguous(racer):
    *_, templates = racer
    pose = orbit_pose(np.array([0.0, 0, 30]), 10, 40, 500)
    bare = photograph(None, None, Camera.from_fov(320, 240, 40), pose, backdrop="oak")
    assert match_by_render(bare, templates).ambiguous
    grey = np.full((60, 80, 3), 128, np.uint8)
    assert match_by_render(grey, templates).ambiguous
