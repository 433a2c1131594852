"""Scenes out of doors against closed forms: sun and shadow, the share of the sky, depth, what is nearer.

Walls and ground are matte and of one paint. What is asked of them is their colour's part: the picture of a world in
white paint less that in black, as gloss is no part of it (see test_gloss.py). Baked light has 48 directions.
"""

from dataclasses import replace

import numpy as np
import pytest
from kernel_samples import sample_by_numpy, texture_pyramid

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Material, Mesh, merge_meshes
from toolkit.rig.camera import Camera, look_at, orbit_direction, orbit_pose
from toolkit.rig.lighting import BOUNCE, BakeDetail
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import KeyLight, Scene, Stand, Table
from toolkit.rig.textures import build_pyramid

QUICK = BakeDetail(key_rays=6, room_rays=48, surface_spacing=0.06, table_spacing=0.05)
SPOT = Camera.from_fov(9, 9, 0.2)
NO_SUN = KeyLight(irradiance=(0, 0, 0))
GREY = 188
"""sRGB code of half the light."""
HALF = float(((GREY / 255 + 0.055) / 1.055) ** 2.4)


def paint(code: int, name: str = "paint") -> Material:
    return Material(name, np.full((4, 4, 3), code, np.uint8), 1.0, 0.0)


def slab(low, high, code: int = GREY, cells: int = 1) -> Mesh:
    """A box between two corners; each side is divided into `cells` × `cells` squares."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    parts = []
    for axis in range(3):
        for sign in (-1, 1):
            a, b = np.delete(np.arange(3), axis)
            normal = np.zeros(3)
            normal[axis] = sign
            s, t = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
            places = np.empty((*s.shape, 3))
            places[..., axis] = (low, high)[sign > 0][axis]
            places[..., a], places[..., b] = low[a] + s * (high - low)[a], low[b] + t * (high - low)[b]
            number = np.arange(s.size).reshape(s.shape)
            corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
            quads = np.stack([c.reshape(-1) for c in corners], axis=1)
            if np.cross(np.eye(3)[a], np.eye(3)[b])[axis] * sign < 0:
                quads = quads[:, ::-1]
            faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
            points = places.reshape(-1, 3).astype(np.float32)
            normals, uv = (
                np.tile(normal.astype(np.float32), (len(points), 1)),
                np.full((len(points), 2), 0.5, np.float32),
            )
            parts.append(Mesh(points, normals, uv, faces, np.zeros(len(faces), np.int32), (paint(code),)))
    return merge_meshes(parts)


def repaint(mesh: Mesh, code: int) -> Mesh:
    return replace(mesh, materials=tuple(paint(code) for _ in mesh.materials))


def make_world(surroundings: Mesh, sky: float = 0.0, key: KeyLight = NO_SUN) -> Scene:
    return Scene("world", key, np.full((32, 64, 3), sky, np.float32), 1.0, surroundings=surroundings)


CRUMB = slab((-0.01, -0.01, 0), (0.01, 0.01, 0.02))
"""An object too small to matter."""
FAR_OFF = Stand((90.0, 90.0, 0.0))


def see(renderer: RaycastRenderer, place, towards, reach: float = 20.0) -> np.ndarray:
    """(3,) radiance of one place in a direction."""
    towards = np.asarray(towards, float) / np.linalg.norm(towards)
    return renderer.render(SPOT, look_at(np.asarray(place, float) + reach * towards, np.asarray(place, float)))[4, 4]


def see_paint(scene: Scene, places, towards, item: Mesh = CRUMB, stand: Stand = FAR_OFF) -> np.ndarray:
    """(n, 3) what a perfectly white paint adds to black at places."""
    both = []
    for code in (255, 0):
        world = replace(scene, surroundings=repaint(scene.surroundings, code))
        renderer = RaycastRenderer(item, world, QUICK, stand)
        both.append([see(renderer, place, towards) for place in places])
    return np.subtract(*both)


GROUND = slab((-100, -100, -2), (100, 100, 0), cells=4)
SUN = KeyLight(azimuth_deg=0, elevation_deg=45, radius_deg=0.25, irradiance=(3.0, 2.0, 1.0))


@pytest.mark.parametrize("elevation_deg", [20, 60, 85])
def test_an_open_plain_shows_its_albedo_times_sky_and_sun(elevation_deg):
    """(π L + E sin e) / π. Directions to the sky are even in height: exact for level ground."""
    sun = replace(SUN, elevation_deg=elevation_deg)
    scene = make_world(GROUND, 0.7, sun)
    expected = 0.7 + np.array(sun.irradiance) * np.sin(np.radians(elevation_deg)) / np.pi
    seen = see_paint(scene, [(0, 0, 0), (-30, 17, 0)], (1, 2, 3))
    np.testing.assert_allclose(seen, [expected] * 2, rtol=2e-3)


def test_light_grows_with_albedo_and_exposure():
    """What stands on the plain is so little that nothing bounces."""
    scene = make_world(repaint(GROUND, GREY), 0.7, SUN)
    white = see_paint(scene, [(0, 0, 0)], (1, 2, 3))[0]
    grey, black = (
        see(RaycastRenderer(CRUMB, replace(scene, surroundings=world), QUICK, FAR_OFF), (0, 0, 0), (1, 2, 3))
        for world in (scene.surroundings, repaint(GROUND, 0))
    )
    np.testing.assert_allclose(grey - black, HALF * white, rtol=2e-3)
    brighter = see_paint(replace(scene, exposure=2.5), [(0, 0, 0)], (1, 2, 3))[0]
    np.testing.assert_allclose(brighter, 2.5 * white, rtol=1e-5)


BLOCK = slab((-5, -5, 0), (5, 5, 10), cells=2)
OVER = np.array([0.1, 0.2, 0.3])
"""A little beside the normal, so that the camera is in nobody's way."""


@pytest.mark.parametrize("azimuth_deg", [0, 40, 130])
def test_walls_in_the_sun_follow_lamberts_law(azimuth_deg):
    """Black sky. Half of what a wall sees is ground, which bounces as much as is said."""
    sun = replace(SUN, azimuth_deg=azimuth_deg, elevation_deg=35)
    for normal, seen_ground in ((0, 0, 1), 0), ((1, 0, 0), 1), ((-1, 0, 0), 1), ((0, 1, 0), 1), ((0, -1, 0), 1):
        cosine = max(float(orbit_direction(azimuth_deg, 35) @ normal), 0)
        bounce = seen_ground * 0.5 * BOUNCE * np.sin(np.radians(35))
        place = np.array([0, 0, 5.0]) + 5 * np.array(normal)
        seen = see_paint(make_world(merge_meshes([GROUND, BLOCK]), 0, sun), [place], normal + OVER)[0]
        np.testing.assert_allclose(seen, np.array(sun.irradiance) * (cosine + bounce) / np.pi, atol=0.02)


AWAY = (-0.1, 0.05, 1)
"""From the shade to a camera that nothing hides."""


def find_shadow_end(renderer: RaycastRenderer, start, step) -> float:
    """How many steps from a place in the shade the ground is in the sun, by halving."""
    start, step = np.asarray(start, float), np.asarray(step, float)
    sunlit = see(renderer, start + 40 * step, AWAY)[0] / 2
    low, high = 0.0, 40.0
    assert see(renderer, start, AWAY)[0] < sunlit
    while high - low > 0.01:
        middle = (low + high) / 2
        low, high = (low, middle) if see(renderer, start + middle * step, AWAY)[0] > sunlit else (middle, high)
    return low


@pytest.mark.parametrize("elevation_deg", [25, 45, 70])
def test_a_buildings_shadow_ends_where_the_ray_over_its_edge_lands(elevation_deg):
    sun = replace(SUN, elevation_deg=elevation_deg)
    renderer = RaycastRenderer(CRUMB, make_world(merge_meshes([GROUND, BLOCK]), 0.1, sun), QUICK, FAR_OFF)
    length = find_shadow_end(renderer, (-5.3, 0, 0), (-1, 0, 0)) + 0.3
    assert length == pytest.approx(10 / np.tan(np.radians(elevation_deg)), abs=0.05)


@pytest.mark.parametrize("elevation_deg", [25, 45, 70])
def test_an_objects_shadow_falls_on_the_ground(elevation_deg):
    """4 m wide, 6 m high, turned by 90° and moved: as far from its own side."""
    sun, item = replace(SUN, elevation_deg=elevation_deg), slab((-3, -2, 0), (3, 2, 6))
    renderer = RaycastRenderer(item, make_world(GROUND, 0.1, sun), QUICK, Stand((7, 4, 0), 90))
    length = find_shadow_end(renderer, (7 - 2.3, 4, 0), (-1, 0, 0)) + 0.3
    assert length == pytest.approx(6 / np.tan(np.radians(elevation_deg)), abs=0.05)


def test_an_object_in_a_buildings_shadow_has_no_key_light():
    """All is black but for gloss under a black sky: what shines there is the key light alone."""
    scene = make_world(repaint(merge_meshes([GROUND, BLOCK]), 0), 0, SUN)
    item = slab((-1, -1, 0), (1, 1, 2), 0)
    pictures = []
    for place in ((-8.0, 0, 0), (-30.0, 0, 0)):
        renderer = RaycastRenderer(item, scene, QUICK, Stand(place))
        pose = orbit_pose(np.add(place, (0, 0, 1)), 170, 30, 12)
        on_it = renderer.buffers(Camera.from_fov(48, 36, 30), pose)["mesh"] == 0
        assert on_it.sum() > 100
        pictures.append(renderer.render(Camera.from_fov(48, 36, 30), pose)[on_it])
    assert pictures[0].max() == 0 and pictures[1].max() > 0.01


def test_the_edge_of_a_shadow_climbs_an_object_to_where_its_ray_passes():
    """A wall 10 m high, 4 m away towards the sun at 45°: lit from 6 m up."""
    scene = make_world(repaint(merge_meshes([GROUND, slab((5, -20, 0), (6, 20, 10))]), 0), 0, SUN)
    renderer = RaycastRenderer(slab((-1, -1, 0), (1, 1, 8), 0), scene, replace(QUICK, surface_spacing=0.02))
    heights = [1, 3, 5, 5.7, 6.3, 7, 7.7]
    assert [see(renderer, (1, 0, z), (1, 0, 0.1), 3)[0] > 0 for z in heights] == [z > 6 for z in heights]


ONE_MORE = 4 / 48
"""Share of the sky that one of the 48 directions of baked light stands for, at the zenith."""


def share_of_sky(scene: Scene, places) -> np.ndarray:
    """(n,) from what white ground shows under a sky of radiance 1: what is blocked bounces `BOUNCE` of it."""
    return (see_paint(scene, places, (0.05, 0.02, 1))[:, 1] - BOUNCE) / (1 - BOUNCE)


@pytest.mark.parametrize(("width", "height"), [(24, 8), (16, 12), (12, 18)])
@pytest.mark.parametrize("turned", [False, True])
def test_a_street_between_walls_sees_its_share_of_the_sky(width, height, turned):
    """sin θ of the angle between the zenith and the roofs; known to one direction more or less."""
    near, far, end = width / 2, width / 2 + 3, 95
    walls = [slab((-far, -end, 0), (-near, end, height), cells=4), slab((near, -end, 0), (far, end, height), cells=4)]
    street = merge_meshes([GROUND, *walls])
    if turned:
        street = replace(street, vertices=street.vertices[:, [1, 0, 2]], normals=street.normals[:, [1, 0, 2]])
    seen = share_of_sky(make_world(street, 1.0), [(0, 0, 0)])
    assert seen[0] == pytest.approx(near / np.hypot(near, height), abs=ONE_MORE)


@pytest.mark.parametrize(("half", "height"), [(10, 5), (8, 8), (8, 16)])
def test_a_courtyard_sees_its_share_of_the_sky(half, height):
    """The view factor of a rectangle above a point (Howell, B-3), four quarters; as well known."""
    x = half / height
    expected = 4 / np.pi * x / np.sqrt(1 + x * x) * np.arctan(x / np.sqrt(1 + x * x))
    far = half + 3
    walls = [
        slab((-far, -far, 0), (-half, far, height), cells=2), slab((half, -far, 0), (far, far, height), cells=2),
        slab((-half, -far, 0), (half, -half, height), cells=2), slab((-half, half, 0), (half, far, height), cells=2),
    ]  # fmt: skip
    seen = share_of_sky(make_world(merge_meshes([GROUND, *walls]), 1.0), [(0, 0, 0)])
    assert seen[0] == pytest.approx(expected, abs=ONE_MORE)


def test_an_object_dims_the_sky_on_the_ground_beside_it_and_not_far_away():
    item = slab((-3, -3, 0), (3, 3, 6), 0)
    places = [(3.3, 0, 0), (5, 0, 0), (9, 0, 0), (25, 0, 0)]
    with_it = see_paint(make_world(GROUND, 1.0), places, (0.3, 0, 1), item, Stand())[:, 0]
    assert (np.diff(with_it[:3]) > 0).all()
    assert with_it[0] < 0.8 and with_it[-1] == pytest.approx(1, abs=5e-3)


def test_black_sky_over_walls_leaves_no_glare_near_the_object():
    """What the sky leaves to be dimmed is nothing: no share of it can be worked out."""
    scene = make_world(merge_meshes([GROUND, slab((3, -20, 0), (4, 20, 10), cells=4)]), 0, SUN)
    scene = replace(scene, surroundings=repaint(scene.surroundings, 255))
    renderer = RaycastRenderer(slab((-2, -2, 0), (2, 2, 3), 255), scene, QUICK)
    picture = renderer.render(Camera.from_fov(64, 48, 60), orbit_pose(np.array([0, 0, 1.0]), 120, 40, 18))
    assert np.isfinite(picture).all() and picture.max() < max(SUN.irradiance) / np.pi * 1.6
    dark = replace(scene, key=NO_SUN)
    assert (
        not RaycastRenderer(slab((-2, -2, 0), (2, 2, 3), 255), dark, QUICK)
        .render(Camera.from_fov(32, 24, 60), orbit_pose(np.array([0, 0, 1.0]), 120, 40, 18))
        .any()
    )


ITEM = slab((-2, -1.5, 0), (2, 1.5, 3))
TOWN = merge_meshes([GROUND, BLOCK, slab((12, -6, 0), (20, 4, 7))])
TOWN_SLABS = [((-100, -100, -2), (100, 100, 0)), ((-5, -5, 0), (5, 5, 10)), ((12, -6, 0), (20, 4, 7))]
PLACE = (-12.0, 3.0, 0.0)
VIEW = Camera.from_fov(80, 60, 50)


@pytest.fixture(scope="module")
def town() -> RaycastRenderer:
    return RaycastRenderer(ITEM, make_world(TOWN, 0.4, SUN), QUICK, Stand(PLACE))


def meet_slabs(origin: np.ndarray, d: np.ndarray, slabs) -> np.ndarray:
    """(k, n) distances at which rays from one origin meet the surface of each slab, inf where they do not."""
    found = []
    for low, high in slabs:
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (np.array(low) - origin) / d, (np.array(high) - origin) / d
        enter, leave = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
        met = (enter <= leave) & (leave > 0)
        found.append(np.where(met, np.where(enter > 0, enter, leave), np.inf))
    return np.array(found)


CAMERAS = {
    "over the roofs": look_at(np.array([-40.0, 20, 25]), np.array([0, 0, 2.0])),
    "in the street, the object before the block": look_at(np.array([-30.0, 4, 1.7]), np.array([0, 2, 2.0])),
    "the object behind the block": look_at(np.array([30.0, -9, 3]), np.array([-12, 3, 1.0])),
    "inside a building": look_at(np.array([14.0, 0, 3]), np.array([19, 2, 1.0])),
    "inside the object": look_at(np.array([-12.0, 3, 1]), np.array([0, 0, 2.0])),
    "in the ground": look_at(np.array([5.0, 5, -1]), np.array([0, 0, -0.9])),
    "below the ground, looking up": look_at(np.array([30.0, 5, -20]), np.array([0, 0, 0.0])),
    "below the ground, looking down": look_at(np.array([0.0, 5, -20]), np.array([9, 0, -90.0])),
    "at the sky": look_at(np.array([-30.0, 0, 2]), np.array([-60, 0, 90.0])),
}


@pytest.mark.parametrize("camera", CAMERAS)
def test_depth_mesh_and_face_are_those_of_the_slabs(town, camera):
    pose = CAMERAS[camera]
    buffers = town.buffers(VIEW, pose)
    origin, d = pose[:3, 3], pixel_directions(VIEW, pose)
    item = np.array([[-2, -1.5, 0], [2, 1.5, 3]]) + PLACE
    distances = meet_slabs(origin, d, [item, *TOWN_SLABS])
    depth, mesh = distances.min(axis=0), np.where(distances[0] < distances[1:].min(axis=0), 0, 1)
    mesh[np.isinf(depth)] = 255
    found = buffers["depth"].reshape(-1)
    with np.errstate(invalid="ignore"):
        same = np.isclose(found, depth, rtol=1e-4, atol=1e-3)
    assert same.mean() > 0.995  # rays that graze an edge go either way
    assert (buffers["mesh"].reshape(-1) == mesh)[same].all()
    for number, vertices, faces in (
        (0, ITEM.vertices + np.float32(PLACE), ITEM.faces), (1, TOWN.vertices, TOWN.faces),
    ):  # fmt: skip
        on_it = buffers["mesh"].reshape(-1) == number
        corners = vertices[faces[buffers["face"].reshape(-1)[on_it]]].astype(float)
        point = origin + found[on_it, None] * d[on_it]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        assert np.abs(((point - corners[:, 0]) * normal).sum(axis=1)).max(initial=0) < 5e-3
        assert (point >= corners.min(axis=1) - 5e-3).all() and (point <= corners.max(axis=1) + 5e-3).all()


def pixel_directions(camera: Camera, pose: np.ndarray) -> np.ndarray:
    """(n, 3) unit directions through the pixels' centres, row by row."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    local = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    directions = local.reshape(-1, 3) @ pose[:3, :3].T
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("camera", CAMERAS)
def test_wherever_the_camera_stands_there_is_a_finite_picture(town, camera):
    picture = town.render(VIEW, CAMERAS[camera])
    assert np.isfinite(picture).all() and picture.min() >= 0


def test_the_nearer_of_object_and_surroundings_is_seen():
    """A red object, green surroundings, a blue sky: the colour of each pixel away from edges is what stands nearest."""

    def dye(mesh: Mesh, colour) -> Mesh:
        material = Material("paint", np.broadcast_to(np.uint8(colour), (4, 4, 3)).copy(), 1.0, 0.0)
        return replace(mesh, materials=(material,) * len(mesh.materials))

    sky = np.zeros((32, 64, 3), np.float32) + np.float32([0, 0, 0.5])
    scene = replace(make_world(dye(TOWN, (0, 255, 0)), 0, SUN), environment=sky)
    renderer = RaycastRenderer(dye(ITEM, (255, 0, 0)), scene, QUICK, Stand(PLACE))
    counts = np.zeros(3, int)
    for name in ("over the roofs", "in the street, the object before the block", "the object behind the block"):
        pose = CAMERAS[name]
        picture, mesh = renderer.render(VIEW, pose), renderer.buffers(VIEW, pose)["mesh"]
        even = np.ones_like(mesh, bool)
        for axis in (0, 1):
            for step in (-1, 1):
                even &= np.roll(mesh, step, axis) == mesh
        even[[0, -1]] = even[:, [0, -1]] = False
        for number, (own, other) in enumerate(((0, 1), (1, 0))):
            there = picture[even & (mesh == number)]
            assert (there[:, own] >= there[:, other]).all()
            counts[number] += len(there)
        above = picture[even & (mesh == 255)]
        np.testing.assert_allclose(above, np.float32([[0, 0, 0.5]]).repeat(len(above), 0), atol=1e-6)
        counts[2] += len(above)
    assert counts.min() > 100


@pytest.mark.parametrize("turn_deg", [0.0, 65.0])
def test_an_object_that_is_moved_looks_as_one_whose_vertices_are(turn_deg):
    """Directions to the sky turn with the object: another sample of the same light."""
    stand, scene = Stand((-12.0, 3.0, 0.0), turn_deg), make_world(TOWN, 0.4, SUN)
    turn = stand.turn.astype(np.float32)
    moved = replace(ITEM, vertices=stand.to_world(ITEM.vertices).astype(np.float32), normals=ITEM.normals @ turn.T)
    by_stand, by_hand = RaycastRenderer(ITEM, scene, QUICK, stand), RaycastRenderer(moved, scene, QUICK)
    for name in ("over the roofs", "in the street, the object before the block"):
        pose = CAMERAS[name]
        one, other = by_stand.buffers(VIEW, pose), by_hand.buffers(VIEW, pose)
        assert (one["mesh"] == other["mesh"]).mean() > 0.998
        same = one["mesh"] == other["mesh"]
        np.testing.assert_allclose(one["depth"][same], other["depth"][same], rtol=1e-4)
        difference = np.abs(by_stand.render(VIEW, pose) - by_hand.render(VIEW, pose))
        # the map of the shade on the ground lies round the origin, where it is of no use to vertices that moved
        assert np.median(difference) < 1e-3 and difference.mean() < 0.01
        on_it = difference[(one["mesh"] == 0) & same]
        assert on_it.mean() < (0.004 if turn_deg == 0 else 0.02)


def test_moving_an_object_builds_no_rays_and_bakes_no_surroundings_again(monkeypatch):
    from toolkit.rig import bake_cache, lighting

    built, baked = [], []
    make, bake = lighting.make_ray_scene, bake_cache.bake_surroundings
    monkeypatch.setattr(lighting, "make_ray_scene", lambda mesh: built.append(mesh) or make(mesh))
    monkeypatch.setattr(bake_cache, "bake_surroundings", lambda *given: baked.append(given) or bake(*given))
    monkeypatch.setattr(bake_cache, "keep_arrays", lambda kind, inputs, make: make())  # none is read from disk
    item, town = slab((-2, -1, 0), (2, 1, 2.5)), merge_meshes([GROUND, slab((30, 30, 0), (41, 37, 5))])
    scene = make_world(town, 0.4, SUN)
    renderers = [RaycastRenderer(item, scene, QUICK, Stand((4.0 * i, 0, 0), 20 * i)) for i in range(3)]
    assert len(built) == 2 and len(baked) == 1
    assert len({id(renderer._object.shape) for renderer in renderers}) == 1
    assert len({id(renderer._others) for renderer in renderers}) == 1
    RaycastRenderer(item, replace(scene, exposure=2.0), QUICK)
    assert len(built) == 2 and len(baked) == 1
    RaycastRenderer(item, replace(scene, environment=scene.environment * 2), QUICK)  # another sky is other light
    assert len(built) == 2 and len(baked) == 2


def test_the_next_run_bakes_no_light_on_the_same_surroundings_and_draws_the_same_bytes(monkeypatch, tmp_path):
    from toolkit.core import cache
    from toolkit.rig import bake_cache

    monkeypatch.setattr(cache, "cache_root", lambda: tmp_path / "cache")
    bake = bake_cache.bake_surroundings
    item, town = slab((-2, -1, 0), (2, 1, 2.5)), merge_meshes([GROUND, slab((30, 30, 0), (41, 37, 5))])
    other_sun = replace(SUN, irradiance=(9.0, 8.0, 7.0))
    pose, pictures = look_at(np.array([-30.0, 4, 1.7]), np.array([0, 2, 2.0])), []
    for baked in ([], []):
        bake_cache._in_use.clear()
        monkeypatch.setattr(bake_cache, "bake_surroundings", lambda *given, b=baked: b.append(given) or bake(*given))
        scenes = [make_world(town, 0.4, SUN), make_world(town, 0.4, other_sun), make_world(GROUND, 0.4, SUN)]
        pictures.append([RaycastRenderer(item, one, QUICK).render(VIEW, pose).tobytes() for one in scenes])
        assert len(baked) == (0 if len(pictures) == 2 else 3)
    assert pictures[0] == pictures[1] and len(set(pictures[0])) == 3


def test_another_sun_over_the_same_sky_has_its_own_bounce():
    """Nothing of the light of the sun before stays on the walls."""
    sky = np.full((32, 64, 3), 0.1, np.float32)
    town = repaint(merge_meshes([GROUND, BLOCK]), 255)
    at = (-5.0, 0, 5), (-1, 0.1, 0.2)  # in the shade of either sun
    bright, dim = (
        replace(make_world(town, 0, replace(SUN, irradiance=(e, e, e))), environment=sky) for e in (9.0, 0.1)
    )
    first = see(RaycastRenderer(CRUMB, bright, QUICK, FAR_OFF), *at)
    after = see(RaycastRenderer(CRUMB, dim, QUICK, FAR_OFF), *at)
    fresh = see(RaycastRenderer(CRUMB, replace(dim, environment=sky.copy()), QUICK, FAR_OFF), *at)
    assert after.tobytes() == fresh.tobytes() and (first > 3 * after).all()


@pytest.mark.parametrize("camera", [*list(CAMERAS)[:3], "at the sky"])
def test_the_parts_of_a_linear_view_put_together_are_the_picture(camera):
    """dark + gain · texture + behind · (1 - coverage), by NumPy."""
    texture = np.random.default_rng(2).integers(0, 256, (32, 32, 3), dtype=np.uint8)
    uv = np.random.default_rng(3).random((len(ITEM.vertices), 2), np.float32)
    worn = replace(ITEM, uv=uv, materials=(Material("paint", texture, 0.5, 0.0),) * len(ITEM.materials))
    renderer = RaycastRenderer(worn, make_world(TOWN, 0.4, SUN), QUICK, Stand(PLACE, 20))
    picture, view = renderer.render(VIEW, CAMERAS[camera]), renderer.render_linear(VIEW, CAMERAS[camera], texture)
    levels = build_pyramid(texture_pyramid(texture)[0].astype(np.float32) / 65535)
    colours = sample_by_numpy(levels, *view.uv.T, view.lod)
    shown = view.dark + view.behind * (1 - view.coverage[..., None])
    np.add.at(shown.reshape(-1, 3), view.pixel, (view.gain * colours).astype(np.float32))
    np.testing.assert_allclose(shown, picture, atol=2e-4)
    on_it = np.isin(np.arange(picture.shape[0] * picture.shape[1]), view.pixel).reshape(picture.shape[:2])
    centre = renderer.buffers(VIEW, CAMERAS[camera])["mesh"] == 0
    assert (on_it | ~centre).all()  # no surroundings have a gain, all of the object has


def test_the_sky_is_as_sharp_as_it_was_given():
    """Bilinear between its pixels, unlike the room behind a table, which is out of focus."""
    sky = np.random.default_rng(4).random((64, 128, 3), np.float32)
    scene = replace(make_world(GROUND, 0), environment=sky)
    renderer = RaycastRenderer(CRUMB, scene, QUICK, FAR_OFF)
    for azimuth in (20, 179, 300):
        pose = look_at(np.array([0, 0, 2.0]), np.array([0, 0, 2]) + orbit_direction(azimuth, 40))
        d = pixel_directions(VIEW, pose)
        column = (0.5 - np.arctan2(d[:, 1], d[:, 0]) / (2 * np.pi)) * 128 - 0.5
        row = (0.5 - np.arcsin(d[:, 2]) / np.pi) * 64 - 0.5
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        fx, fy = (column - left)[:, None], (row - top)[:, None]
        expected = sum(
            sky[top + j, (left + i) % 128] * (fx if i else 1 - fx) * (fy if j else 1 - fy)
            for i in (0, 1)
            for j in (0, 1)
        )
        np.testing.assert_allclose(renderer.render(VIEW, pose).reshape(-1, 3), expected, atol=1e-3)


def test_a_scene_has_a_table_or_surroundings_and_not_both():
    with pytest.raises(ToolkitError, match="a table and surroundings"):
        replace(make_world(GROUND), table=Table(np.zeros((4, 4, 3), np.uint8), (50.0, 50.0), 0.5))
