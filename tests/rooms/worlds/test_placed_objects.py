"""An object in a world: its real size, on the ground, nothing in its box, and clear words where it has no place."""

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import PACKAGE_DATA
from toolkit.objects.load import load_object, scale_to_world
from toolkit.objects.mesh import Mesh, make_ray_scene
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.variants import apply_booster
from toolkit.rooms.worlds.content.city import build_city
from toolkit.rooms.worlds.own import build_world
from toolkit.rooms.worlds.place import choose_places, find_radius, find_spot, place_object
from toolkit.rooms.worlds.sky import make_sky
from toolkit.rooms.worlds.world import World

SKY = make_sky("noon", 0, 64)


@pytest.fixture(scope="module")
def city() -> World:
    return build_city(0, blocks=(2, 2))


def real(name: str, length_m: float | None = None) -> Mesh:
    item = load_object(PACKAGE_DATA / "objects" / f"{name}.toml")
    return scale_to_world(item.mesh, item.spec, length_m)


@pytest.mark.parametrize(("name", "length_m"), [("warplane", 16), ("racer", 4.8), ("coffeepot", 0.27)])
def test_objects_have_the_size_of_what_they_are_models_of(name: str, length_m: float) -> None:
    assert np.ptp(real(name).vertices, axis=0).max() == pytest.approx(length_m, rel=1e-5)
    assert np.ptp(real(name, 2.5).vertices, axis=0).max() == pytest.approx(2.5, rel=1e-5)
    with pytest.raises(ToolkitError, match="length_m -1"):
        real(name, -1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("world", "name"), [("city", "warplane"), ("city", "racer"), ("harbour", "racer")])
def test_it_touches_the_ground_and_nothing_is_in_its_box(world: str, name: str, city: World) -> None:
    place = city if world == "city" else build_world(world)
    mesh = real(name)
    spots = choose_places(place, find_radius(mesh), 4, 3, kinds=("ground", "roof", "water"))
    rays = make_ray_scene(place.mesh)
    for spot in spots:
        placed = place_object(mesh, place, spot, SKY)
        vertices = placed.stand.to_world(mesh.vertices.astype(np.float64))
        lowest = vertices[vertices[:, 2] < vertices[:, 2].min() + 0.01]
        if spot.kind != "roof":
            gap = lowest[:, 2] - place.ground_height(lowest)
            assert gap.min() == pytest.approx(0, abs=0.01), spot
        low, high = placed.box.min(axis=0), placed.box.max(axis=0)
        assert np.ptp(placed.mesh.bounds, axis=0) == pytest.approx(np.ptp(mesh.bounds, axis=0))
        inside = np.random.default_rng(0).uniform(low + [0, 0, 0.35], high, (4000, 3))
        inside = inside[np.hypot(*(inside[:, :2] - spot.position[:2]).T) < find_radius(mesh)]
        near = rays.compute_distance(o3d.core.Tensor(inside.astype(np.float32))).numpy()
        assert near.min() > 0.02, spot
        assert not place.inside_building(inside).any()


def test_it_is_not_sunk_nor_does_it_float(city: World) -> None:
    spot = find_spot(city, "pad-1")
    placed = place_object(real("racer"), city, spot, SKY)
    assert placed.stand.place[2] == pytest.approx(spot.position[2], abs=0.01)
    assert placed.centre[2] - placed.stand.place[2] == pytest.approx(real("racer").bounds[1, 2] / 2, abs=0.01)


def test_places_are_drawn_by_the_seed_and_of_several_kinds(city: World) -> None:
    four = choose_places(city, 2.5, 4, 1)
    assert four == choose_places(city, 2.5, 8, 1)[:4]
    assert len({spot.place for spot in four}) == 4
    assert {choose_places(city, 2.5, 4, seed) != four for seed in range(2, 6)} != {False}


def test_only_ships_stand_on_water() -> None:
    harbour = build_world("harbour")
    assert {spot.kind for spot in choose_places(harbour, 2.5, 3)} == {"ground"}
    assert {spot.kind for spot in choose_places(harbour, 2.5, 2, kinds=("water",))} == {"water"}
    with pytest.raises(ToolkitError, match="has 3 places for an object"):
        choose_places(harbour, 2.5, 4)


def test_what_has_no_place_is_refused_in_words(city: World) -> None:
    with pytest.raises(ToolkitError, match=r"no place for an object that reaches 30 m.*the widest, 'square'"):
        choose_places(city, 30.0, 1)
    with pytest.raises(ToolkitError, match=r"has 1 place for an object .* 2 are asked for"):
        choose_places(city, 15.0, 2)
    with pytest.raises(ToolkitError, match=r"'pad-1' of city is free for 6.17 m, the object reaches 9.01 m"):
        place_object(real("warplane"), city, find_spot(city, "pad-1"), SKY)
    with pytest.raises(ToolkitError, match="no place in the world city called 'strete-1': did you mean street-"):
        find_spot(city, "strete-1")
    with pytest.raises(ToolkitError, match="no free place"):
        choose_places(replace(city, spots=()), 1.0, 1)


def test_a_spot_that_is_not_free_is_not_believed(city: World) -> None:
    blocked = replace(find_spot(city, "street-1"), name="wall", position=(*_middle_of_a_wall(city), 0.0))
    world = replace(city, spots=(blocked,))
    with pytest.raises(ToolkitError, match="no place for"):
        choose_places(world, 2.0, 1)
    with pytest.raises(ToolkitError, match=r"something stands on 'wall'|nothing to stand on"):
        place_object(real("racer"), world, blocked, SKY)


def _middle_of_a_wall(city: World) -> tuple[float, float]:
    assert city.solids is not None
    box = city.solids[np.argmax((city.solids[:, 3:] - city.solids[:, :3]).prod(axis=1))]
    return float(box[0]), float((box[1] + box[4]) / 2)


@pytest.mark.slow
def test_every_variant_stands_in_the_same_place_and_is_seen_there() -> None:
    grass = build_world("grass")
    item = load_object(PACKAGE_DATA / "objects" / "racer.toml")
    placed = place_object(real("racer"), grass, find_spot(grass, "meadow-1"), SKY)
    worn = placed.with_mesh(scale_to_world(apply_booster(item, None), item.spec))
    assert (worn.stand, worn.spot) == (placed.stand, placed.spot)
    seen = RaycastRenderer(worn.mesh, worn.scene, stand=worn.stand).buffers(
        Camera.from_fov(32, 32), orbit_pose(placed.centre, 30, 20, 12)
    )
    assert seen["mesh"][16, 16] == 0
    assert 8 < seen["depth"][16, 16] < 12
    assert float(np.ptp(worn.mesh.bounds, axis=0).max()) == pytest.approx(4.8, rel=1e-5)
