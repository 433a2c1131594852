"""The city against rays cast at its own triangles (Embree), which know nothing of its plan."""

from collections.abc import Callable

import numpy as np
import open3d as o3d
import pytest

from toolkit.objects.mesh import make_ray_scene
from toolkit.rooms.worlds.content.city import build_city
from toolkit.rooms.worlds.world import SceneClass, Spot, World

KERB_M = 0.2
SMALL = (2, 2)


@pytest.fixture(scope="module")
def city() -> World:
    return build_city(3, SMALL)


@pytest.fixture(scope="module")
def cast(city: World) -> Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]:
    scene = make_ray_scene(city.mesh)

    def first_hits(origin: np.ndarray, direction: np.ndarray) -> dict[str, np.ndarray]:
        rays = np.concatenate(np.broadcast_arrays(origin, direction), axis=-1).astype(np.float32)
        found = scene.cast_rays(o3d.core.Tensor(rays))
        return {key: value.numpy() for key, value in found.items()}

    return first_hits


def corners_of(world: World) -> np.ndarray:
    return world.mesh.vertices[world.mesh.faces].astype(np.float64)


@pytest.mark.slow
def test_the_same_seed_is_the_same_city_and_another_is_another() -> None:
    one, same, other = build_city(1, (1, 1)), build_city(1, (1, 1)), build_city(2, (1, 1))
    assert one.sha256 == same.sha256
    assert one.spots == same.spots
    assert one.sha256 != other.sha256


def test_arrays_fit_together_and_hold_numbers(city: World) -> None:
    mesh = city.mesh
    for values in (mesh.vertices, mesh.normals, mesh.uv):
        assert np.isfinite(values).all()
    assert len(mesh.faces) == len(mesh.face_material) == len(city.face_class) > 100_000
    assert mesh.faces.min() == 0 and mesh.faces.max() < len(mesh.vertices)
    assert mesh.face_material.max() < len(mesh.materials)
    assert np.linalg.norm(mesh.normals[np.unique(mesh.faces)], axis=1) == pytest.approx(1, abs=0.01)


def test_no_face_is_without_area(city: World) -> None:
    corners = corners_of(city)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert area.min() > 0


def test_texels_are_neither_specks_nor_slabs(city: World) -> None:
    """Texels per metre of what has a texture of its own, from the areas on the mesh and on the texture."""
    corners, mesh = corners_of(city), city.mesh
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    uv = mesh.uv[mesh.faces].astype(np.float64)
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    sheet = np.array([m.texture.shape[0] * m.texture.shape[1] for m in mesh.materials])[mesh.face_material]
    density = np.sqrt(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) * sheet / area)
    for kind, least, most in (("ROAD", 30, 120), ("PAVEMENT", 60, 200), ("BUILDING", 20, 400), ("SKYLINE", 10, 120)):
        of_kind = density[(city.face_class == SceneClass[kind]) & (density > 0)]
        low, high = np.percentile(of_kind, [5, 95])
        assert least < low and high < most, kind
    assert sum(m.texture.shape[0] * m.texture.shape[1] for m in mesh.materials) < 64e6


def test_rays_from_the_street_meet_fronts_of_faces(city: World, cast: Callable) -> None:
    rng = np.random.default_rng(0)
    spots = np.array([spot.position for spot in city.spots if spot.kind == "ground"])
    origin = spots[rng.integers(0, len(spots), 4000)] + [0, 0, 1.7]
    direction = rng.normal(size=(4000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    found = cast(origin, direction)
    hit = np.isfinite(found["t_hit"])
    face = found["primitive_ids"][hit]
    solid = city.face_class[face] != SceneClass.TREE
    ahead = np.einsum("ij,ij->i", found["primitive_normals"][hit], direction[hit])[solid] < 0
    assert hit.sum() > 2000
    assert ahead.mean() > 0.995


def free_distance(spot: Spot, cast: Callable, height: float) -> float:
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ways = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(64)])
    return float(cast(np.array(spot.position) + [0, 0, height], ways)["t_hit"].min())


def test_spots_are_free_of_walls_poles_and_cars(city: World, cast: Callable) -> None:
    assert {"street", "crossing", "square"} <= {spot.place for spot in city.spots}
    assert len({spot.name for spot in city.spots}) == len(city.spots)
    for spot in city.spots:
        for height in (0.5, 1.0, 2.5, 4.0):
            assert free_distance(spot, cast, height) >= spot.free_radius_m - 0.01, (spot, height)


def test_nothing_hangs_over_a_spot_and_its_ground_is_flat(city: World, cast: Callable) -> None:
    rng = np.random.default_rng(1)
    for spot in city.spots:
        radius, turn = spot.free_radius_m * np.sqrt(rng.random(200)), rng.uniform(0, 2 * np.pi, 200)
        x, y, z = spot.position
        over = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn), np.full(200, 120.0)])
        ground = 120 - cast(over, np.array([0.0, 0.0, -1.0]))["t_hit"]
        assert np.abs(ground - z).max() <= KERB_M, spot


def test_a_house_is_inside_where_a_ray_leaves_through_its_roof(city: World, cast: Callable) -> None:
    """Under a roof and behind a facade on all four sides, seen by rays, is inside a building."""
    rng = np.random.default_rng(2)
    low, high = city.core
    points = np.column_stack([rng.uniform(low, high, (8000, 2)), rng.uniform(2, 9, 8000)])
    enclosed = np.ones(len(points), bool)
    for way in ((0, 0, 1), (1, 0.01, 0), (-1, 0.01, 0), (0.01, 1, 0), (0.01, -1, 0)):
        found = cast(points, np.array(way, float))
        behind = np.einsum("ij,j->i", found["primitive_normals"], np.array(way, float)) > 0
        hit = np.isfinite(found["t_hit"])
        kind = city.face_class[np.where(hit, found["primitive_ids"], 0)]
        room = found["t_hit"] > 0.4  # else it is within a sign or an awning
        enclosed &= hit & behind & room & np.isin(kind, [SceneClass.BUILDING, SceneClass.ROOF, SceneClass.SIGN])
    # a roof's quads face up: from below, their back is met first
    assert enclosed.sum() > 300
    assert city.inside_building(points)[enclosed].mean() > 0.995


def test_streets_are_outside(city: World) -> None:
    corners = corners_of(city)
    for kind in (SceneClass.ROAD, SceneClass.PAVEMENT):
        chosen = corners[city.face_class == kind]
        for weights in ((1 / 3, 1 / 3, 1 / 3), (0.8, 0.1, 0.1), (0.1, 0.45, 0.45)):
            points = np.einsum("k,nkx->nx", weights, chosen) + [0, 0, 1.0]
            assert not city.inside_building(points).any()
    assert not city.inside_building(np.array([spot.position for spot in city.spots]) + [0, 0, 1.0]).any()


def test_the_ground_is_road_or_pavement(city: World) -> None:
    rng = np.random.default_rng(3)
    height = city.ground_height(rng.uniform(*city.core, (500, 2)))
    assert np.isfinite(height).all()
    assert height.min() >= -1e-3 and height.max() <= KERB_M
    assert np.isnan(city.ground_height(np.array([[1e5, 0.0]]))).all()


def test_lamps_give_light_and_walls_none(city: World) -> None:
    lit = {
        material.name for material in city.mesh.materials if material.emission is not None and material.emission.any()
    }
    assert {"plain-lamp", "cab"} <= lit
    assert any(name.startswith("window-") for name in lit) and any(name.startswith("shop-") for name in lit)
    assert not any(name.startswith(("brick", "street", "pavement")) for name in lit)


@pytest.mark.slow
def test_the_city_is_large_enough() -> None:
    city = build_city(0)
    size = city.core[1] - city.core[0]
    assert 400 <= size.max() <= 600
    assert 200_000 < len(city.mesh.faces) < 3_000_000
    assert len(city.pads) >= 3
    assert sum(m.texture.shape[0] * m.texture.shape[1] for m in city.mesh.materials) < 64e6
    seen = {SceneClass(kind) for kind in np.unique(city.face_class)}
    assert seen >= set(SceneClass) - {SceneClass.OTHER, SceneClass.WATER}
