"""Grass, apron and harbour: the same every time, free where they say so, flat where one stands."""

import numpy as np
import open3d as o3d
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import make_ray_scene
from toolkit.rooms.worlds.own import build_world
from toolkit.rooms.worlds.world import SceneClass, World

PLACES = ("grass", "apron", "harbour")


@pytest.fixture(scope="module", params=PLACES)
def place(request: pytest.FixtureRequest) -> World:
    return build_world(request.param)


def test_a_place_is_the_same_every_time(place: World) -> None:
    build = build_world.__wrapped__
    assert build(place.name, 0).sha256 == place.sha256
    assert build(place.name, 1).sha256 != place.sha256


def test_arrays_hold_numbers(place: World) -> None:
    mesh = place.mesh
    assert all(np.isfinite(values).all() for values in (mesh.vertices, mesh.normals, mesh.uv))
    assert len(mesh.faces) == len(place.face_class)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert area.min() > 0


def test_spots_are_free_and_on_the_ground(place: World) -> None:
    scene = make_ray_scene(place.mesh)
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    for spot in place.spots:
        rays = np.zeros((2, 48, 6), np.float32)
        rays[..., :3] = spot.position
        rays[0, :, 2] += 0.5
        rays[1, :, 2] += 2.0
        rays[..., 3], rays[..., 4] = np.cos(angle), np.sin(angle)
        assert scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy().min() >= spot.free_radius_m - 0.01, spot
        down = np.array([[*spot.position[:2], spot.position[2] + 50, 0, 0, -1]], np.float32)
        assert 50 - scene.cast_rays(o3d.core.Tensor(down))["t_hit"].numpy()[0] == pytest.approx(0, abs=0.02), spot
        assert not place.inside_building(np.array([spot.position]) + [0, 0, 1.0]).any()


def test_the_basin_is_water_below_the_quay() -> None:
    harbour = build_world("harbour")
    water = [spot for spot in harbour.spots if spot.kind == "water"]
    assert len(water) >= 2
    height = harbour.ground_height(np.array([spot.position for spot in water]))
    assert (height < -1).all()
    assert (harbour.face_class == SceneClass.WATER).any()


def test_points_in_a_hangar_are_inside() -> None:
    apron = build_world("apron")
    points = np.array([(-92.0, 70.0, 4.0), (-92.0, 40.0, 4.0), (92.0, 70.0, 15.0), (92.0, 70.0, 40.0)])
    assert apron.inside_building(points).tolist() == [True, False, True, False]


def test_an_unknown_world_is_one_clear_line() -> None:
    with pytest.raises(ToolkitError, match="city"):
        build_world("citty")
