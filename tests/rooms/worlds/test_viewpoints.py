"""Where cameras stand and fly: clear of a wall whose distance is known in closed form, and the same every time."""

from dataclasses import replace

import numpy as np
import pytest
from walled_field import WALL, make_field

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import look_at
from toolkit.rooms.worlds.viewpoints import (
    HEADROOM_M,
    LEVELS,
    ROOM_M,
    choose_viewpoints,
    clearance,
    plan_flight,
    rate_views,
)


@pytest.fixture(scope="module")
def field():
    return make_field()


@pytest.fixture(scope="module")
def viewpoints(field):
    return choose_viewpoints(field, 0)


def room_around(points: np.ndarray) -> np.ndarray:
    """Distance from the ground or from the wall."""
    outside = np.maximum(np.maximum(WALL[0, :3] - points, points - WALL[0, 3:]), 0)
    return np.minimum(points[:, 2], np.linalg.norm(outside, axis=1))


def test_clearance_is_the_closed_form(field) -> None:
    points = np.random.default_rng(0).uniform((-30, -30, 0.5), (30, 30, 20), (200, 3))
    points = points[~field.inside_building(points)]
    assert clearance(field, points) == pytest.approx(room_around(points), abs=1e-3)


def test_cameras_stand_clear_at_the_heights_of_their_level(field, viewpoints) -> None:
    assert {one.name for one in viewpoints} == {"street", "roof", "air"}
    for one in viewpoints:
        low, high = LEVELS[one.name].within(field).height_m
        assert low <= one.position[2] <= high
        assert room_around(one.position[None])[0] >= HEADROOM_M


def test_the_same_seed_chooses_the_same_and_another_others(field, viewpoints) -> None:
    again, other = choose_viewpoints(field, 0), choose_viewpoints(field, 1)
    assert all(np.array_equal(a.T_world_camera, b.T_world_camera) for a, b in zip(viewpoints, again, strict=True))
    assert not np.array_equal(viewpoints[0].T_world_camera, other[0].T_world_camera)


def test_the_street_sees_the_wall(field, viewpoints) -> None:
    street = next(one for one in viewpoints if one.name == "street")
    towards = WALL.reshape(2, 3).mean(axis=0) - street.position
    assert street.T_world_camera[:3, 2] @ towards / np.linalg.norm(towards) > 0.7


def test_a_view_of_something_rates_above_one_of_nothing_and_one_of_a_wall_alone(field) -> None:
    place = np.array([-14.0, 0.0, 1.7])
    something, nothing = look_at(place, np.array([6.0, 0.0, 2.5])), look_at(place, np.array([-39.0, 0.0, 1.7]))
    wall_alone = look_at(np.array([4.5, 0.0, 1.7]), np.array([6.0, 0.0, 1.7]))
    rates = rate_views(field, [something, nothing, wall_alone], LEVELS["street"])
    assert rates[0] > max(rates[1], rates[2])


def test_a_world_without_room_is_a_line(field) -> None:
    closed = replace(field, solids=np.array([(-50.0, -50, -1, 50, 50, 200)]))
    with pytest.raises(ToolkitError, match="nowhere is there room for a camera"):
        choose_viewpoints(closed)


def test_the_flight_is_clear_of_everything_all_the_way(field, viewpoints) -> None:
    flight = plan_flight(field, viewpoints)
    assert room_around(flight.points).min() > 0.5 * ROOM_M[0]
    assert not field.inside_building(flight.points).any()
    assert np.linalg.norm(np.diff(flight.points, axis=0), axis=1).max() < 1.5
    assert flight.points[:, 2].min() < 4 < 15 < flight.points[:, 2].max()
    assert np.array_equal(flight.points, plan_flight(field, viewpoints).points)


def test_the_flights_cameras_move_without_a_jump(field, viewpoints) -> None:
    poses = np.array(plan_flight(field, viewpoints).poses(120))
    assert poses.shape == (120, 4, 4)
    turns = np.einsum("nij,nij->n", poses[1:, :3, 2:3], poses[:-1, :3, 2:3])
    assert turns.min() > np.cos(np.radians(12))
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.max() < 4 * np.median(steps)
    assert poses[:, 2, 1].max() < 0  # the picture's down is never up
