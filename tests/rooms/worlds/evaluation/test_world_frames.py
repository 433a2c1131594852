"""One render for all weathers: the same light and depth as when each is asked for alone."""

from dataclasses import replace

import numpy as np
import pytest
from walled_field import PX

from toolkit.rig.camera import Camera, look_at
from toolkit.rig.shading import tone_map
from toolkit.rooms.worlds.conditions import CLEAR
from toolkit.rooms.worlds.depth_weather import add_weather, make_weather, weather_rng
from toolkit.rooms.worlds.evaluation.frames import BOOSTER_ID, OBJECT_ID, WorldVariant
from toolkit.rooms.worlds.particles import DepthView
from toolkit.rooms.worlds.picture import find_depths, make_renderer, see_through
from toolkit.rooms.worlds.place import find_spot, place_object
from toolkit.rooms.worlds.sky import make_sky
from toolkit.rooms.worlds.world import SceneClass, World

VIEW = Camera.from_fov(PX, PX, 60), look_at(np.array([-14.0, 3.0, 4.0]), np.array([-4.0, 0.0, 0.8]))


@pytest.fixture(scope="module")
def renderer(field: World, make_box):
    mesh = make_box((4.0, 2.4, 1.6))
    return make_renderer(place_object(mesh, field, find_spot(field, "west"), make_sky("noon", 0, 32)))


def test_depth_comes_with_the_light(renderer) -> None:
    light, found = renderer.render_with_depth(*VIEW)
    exact = renderer.buffers(*VIEW)
    assert np.array_equal(light, renderer.render(*VIEW))
    for name, values in found.items():
        assert np.array_equal(values, exact[name]), name
    assert set(np.unique(found["mesh"])) == {0, 1, 255}


def test_each_weather_is_laid_over_the_same_light(renderer, field: World) -> None:
    sky, weathers = make_sky("noon", 0, 32), [CLEAR, ("fog", 2), ("dust", 4)]
    pictures = see_through(renderer, field, sky, VIEW, weathers, (7, 3))
    light, depth = renderer.render(*VIEW), renderer.buffers(*VIEW)["depth"]
    assert np.array_equal(pictures[0], tone_map(light, (7, 3)))
    for picture, weather in zip(pictures[1:], weathers[1:], strict=True):
        seen = add_weather(
            light, DepthView(depth, *VIEW), make_weather(*weather), sky.airlight, weather_rng(7, 3, *weather)
        )
        assert np.array_equal(picture, tone_map(seen, (7, 3)))


def test_ground_and_normals_are_found_only_where_they_are_needed(renderer, field: World) -> None:
    sky = make_sky("noon", 0, 32)
    found = renderer.render_with_depth(*VIEW)[1]
    fog, rain, snow = (find_depths(field, sky, VIEW, found, [(name, 1)]) for name in ("fog", "rain", "snow"))
    assert (fog.ground, fog.normals, rain.normals) == (None, None, None)
    assert np.array_equal(rain.ground, (found["mesh"] == 1) & (found["face"] < 2))  # the ground's two triangles
    assert snow.normals[rain.ground] == pytest.approx(np.tile([0, 0, 1], (int(rain.ground.sum()), 1)))
    assert (snow.normals[found["mesh"] != 1] == 0).all()
    lake = replace(
        field, face_class=np.where(field.face_class == SceneClass.GROUND, SceneClass.WATER, field.face_class)
    )
    wet = find_depths(lake, sky, VIEW, found, [("snow", 1)])
    assert not wet.ground.any() and (wet.normals[rain.ground] == 0).all()


def test_what_the_bare_mesh_lacks_is_the_booster(make_box) -> None:
    from toolkit.objects.mesh import merge_meshes

    bare, sheet = make_box(), make_box((20.0, 20.0, 1.0))
    variant = WorldVariant.of(merge_meshes([bare, sheet]), bare)
    assert variant.boosted.tolist() == [False] * len(bare.faces) + [True] * len(sheet.faces)
    assert not WorldVariant.of(bare, bare).boosted.any()
    assert OBJECT_ID != BOOSTER_ID
