"""The grid of cameras: where its points are, which can hold a camera, and what is seen of the object from there."""

import numpy as np
import pytest
from walled_field import PX

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, project
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rooms.worlds.evaluation.cameras import (
    BELOW,
    IN_WALL,
    OUTSIDE,
    TOO_NEAR,
    TOUCHING,
    count_cameras,
    find_reasons,
    lay_grid,
    plan_cameras,
)
from toolkit.rooms.worlds.place import Placed, find_spot, place_object
from toolkit.rooms.worlds.sky import make_sky
from toolkit.rooms.worlds.world import World

CAMERA = Camera.from_fov(PX, PX, 50)


@pytest.fixture(scope="module")
def placed(field: World, make_box) -> Placed:
    mesh = make_box((4.0, 2.4, 1.6))
    return place_object(mesh, field, find_spot(field, "west"), make_sky("noon", 0, 32))


def plan(field: World, placed: Placed, shape=(5, 5, 3), extent=2.0, sample=None, seed=0):
    return plan_cameras(field, placed, CAMERA, shape, extent, sample, np.random.default_rng(seed))


def test_a_grid_spans_its_extent_and_one_alone_stands_in_the_middle() -> None:
    points = lay_grid((3, 2, 2), 10.0, 1.0)
    assert points.shape == (12, 3)
    assert points.min(axis=0).tolist() == [-10, -10, 1]
    assert points.max(axis=0).tolist() == [10, 10, 10]
    assert sorted(set(points[:, 0])) == [-10, 0, 10]
    assert lay_grid((1, 1, 1), 10.0, 1.0).tolist() == [[0, 0, 1]]


def test_each_reason_is_found(field: World, placed: Placed) -> None:
    x, y, _ = placed.spot.position
    cases = {
        (6.5, 0.0, 2.0): IN_WALL, (0.0, 10.0, -1.0): BELOW, (60.0, 0.0, 3.0): OUTSIDE, (x, y, 1.0): TOO_NEAR,
        (x + 2.0, y, 0.8): TOO_NEAR, (5.8, 0.0, 2.0): TOUCHING, (0.0, 10.0, 0.1): TOUCHING, (x - 8.0, y, 2.0): "",
    }  # fmt: skip
    assert find_reasons(field, placed, np.array(list(cases)), nearest_m=3.0) == list(cases.values())


def test_points_are_counted_by_reason(field: World, placed: Placed) -> None:
    cameras = plan(field, placed, (9, 9, 3), extent=3.0)
    counts = count_cameras([cameras])
    assert counts["points"] == 243 == counts["standing"] + sum(cameras.left_out.values())
    assert counts["shot"] == counts["standing"] == len(cameras.cameras)
    assert counts[f"left out: {TOO_NEAR}"] == cameras.left_out[TOO_NEAR] > 0
    inside = np.all((cameras.points > (6, -8, 0)) & (cameras.points < (7, 8, 5)), axis=1)
    assert cameras.left_out.get(IN_WALL, 0) == inside.sum()


def test_azimuth_is_from_the_front_however_the_object_is_turned(field: World, placed: Placed) -> None:
    assert placed.stand.turn_deg == 90
    for camera in plan(field, placed).cameras:
        position = camera.T_world_camera[:3, 3]
        away = position - placed.centre
        front = np.degrees(np.arctan2(-away[0], away[1]))  # the front looks to +y here
        assert (camera.azimuth_deg - front + 180) % 360 - 180 == pytest.approx(0, abs=0.01)
        assert camera.distance_m == pytest.approx(np.linalg.norm(away), abs=1e-3)
        assert np.sin(np.radians(camera.elevation_deg)) == pytest.approx(away[2] / np.linalg.norm(away), abs=1e-3)
        pixel, depth = project(CAMERA, camera.T_world_camera, placed.centre[None])
        assert depth[0] > 0
        assert pixel[0] == pytest.approx([PX / 2, PX / 2], abs=1e-6)


def test_visible_share_is_what_exact_buffers_say(field: World, placed: Placed) -> None:
    camera = Camera.from_fov(256, 256, 50)
    alone = RaycastRenderer(placed.mesh, placed.scene, stand=placed.stand)
    cameras = plan(field, placed, (5, 5, 2), extent=4.0).cameras
    behind = [one for one in cameras if one.T_world_camera[0, 3] > 8 and one.T_world_camera[2, 3] < 3]
    before = [one for one in cameras if one.T_world_camera[0, 3] < -10]
    assert behind and before
    assert all(one.visible_share == 1 for one in before)
    assert min(one.visible_share for one in behind) < 0.05
    for one in cameras[::3]:
        found = alone.buffers(camera, one.T_world_camera)["mesh"]
        seen = (found == 0).mean()
        assert one.visible_share * one.picture_share == pytest.approx(seen, abs=0.004)


def test_a_sample_is_drawn_by_the_seed_and_grows(field: World, placed: Placed) -> None:
    whole, few, more = (plan(field, placed, sample=n) for n in (None, 6, 12))
    numbers = [{one.number for one in cameras.cameras} for cameras in (whole, few, more)]
    assert [len(one) for one in numbers[1:]] == [6, 12]
    assert numbers[1] < numbers[2] < numbers[0]
    assert numbers[1] == {one.number for one in plan(field, placed, sample=6).cameras}
    assert numbers[1] != {one.number for one in plan(field, placed, sample=6, seed=1).cameras}


def test_a_grid_inside_a_wall_says_how_many_and_why(field: World, placed: Placed) -> None:
    with pytest.raises(ToolkitError, match=r"no camera of the 1 around 'west' can stand: 1 inside the object or too"):
        plan(field, placed, (1, 1, 1))


def test_cameras_come_as_near_to_the_ground_as_a_small_object_is_low(field: World, make_box) -> None:
    mesh = make_box((0.27, 0.2, 0.09))
    pot = place_object(mesh, field, find_spot(field, "west"), make_sky("noon", 0, 32))
    cameras = plan(field, pot, (3, 3, 1))
    assert cameras.left_out == {TOO_NEAR: 1}
