"""What is worked out of a shape is kept: for another paint, light or place, by several threads, and not for ever."""

import gc
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from toolkit.objects.mesh import Material, Mesh
from toolkit.rig import bake_cache, lighting
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.lighting import BakeDetail, Shape
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import Stand
from toolkit.rig.studio import make_studio

QUICK = BakeDetail(key_rays=4, room_rays=16, surface_spacing=0.08, table_spacing=0.08)
CAMERA, POSE = Camera.from_fov(48, 36, 40), orbit_pose(np.array([0, 0, 20.0]), 30, 40, 220)


@pytest.fixture(autouse=True)
def fresh(monkeypatch):
    """Nothing is known at first, and what was known before comes back."""
    monkeypatch.setattr(Shape, "_known", type(Shape._known)())
    monkeypatch.setattr(bake_cache, "_in_use", type(bake_cache._in_use)())


@pytest.fixture
def calls(monkeypatch):
    """Names of the functions that built something, in order."""
    made: list[str] = []
    for name in ("make_ray_scene", "place_samples", "find_free"):

        def count(*given, name=name, real=getattr(lighting, name)):
            made.append(name)
            return real(*given)

        monkeypatch.setattr(lighting, name, count)
    return made


@pytest.fixture(scope="module")
def studio():
    return make_studio(3, 100, "white")


def dye(mesh: Mesh, code: int) -> Mesh:
    return replace(mesh, materials=(Material("other", np.full((8, 8, 3), code, np.uint8), 0.3, 0.5),))


def test_the_pictures_of_a_studio_that_nobody_uses_are_not_kept(make_box):
    mesh = make_box()
    studio = make_studio.__wrapped__(3, 100, "oak")  # without the memory of the last studios
    table = weakref.ref(studio.need_table().picture)
    RaycastRenderer(mesh, studio, QUICK)
    assert {"_prepare_paint", "pack_one", "_blur_environment"} <= {name for name, *_ in bake_cache._in_use}
    del studio
    gc.collect()
    assert table() is None
    # of the mesh, and of the picture of no glow
    assert [name for name, *_ in bake_cache._in_use] == ["_prepare_paint", "pack_one"]


def test_another_paint_on_the_same_shape_casts_no_rays_for_its_light(make_box, studio, calls):
    RaycastRenderer(make_box(), studio, QUICK)
    assert sorted(set(calls)) == ["find_free", "make_ray_scene", "place_samples"]
    calls.clear()
    painted = RaycastRenderer(dye(make_box(), 20), studio, QUICK)
    assert calls == []
    kept = painted.render(CAMERA, POSE)
    Shape._known.clear()
    assert kept.tobytes() == RaycastRenderer(dye(make_box(), 20), studio, QUICK).render(CAMERA, POSE).tobytes()


def test_another_room_casts_none_and_another_lamp_only_its_own(make_box, studio, calls):
    RaycastRenderer(make_box(), studio, QUICK)
    calls.clear()
    RaycastRenderer(make_box(), replace(studio, environment=studio.environment * 2, exposure=2.0), QUICK)
    assert calls == []
    RaycastRenderer(make_box(), replace(studio, key=replace(studio.key, azimuth_deg=200)), QUICK)
    assert calls == ["find_free", "find_free"]  # for the table and the object


def test_an_object_that_is_only_moved_along_the_table_is_lit_as_before(make_box, studio, calls):
    RaycastRenderer(make_box(), studio, QUICK)
    calls.clear()
    RaycastRenderer(make_box(), studio, QUICK, Stand((50.0, -20.0, 0.0)))
    assert calls == []


@pytest.mark.parametrize("part", ["vertices", "normals", "faces"])
def test_other_triangles_are_another_shape(make_box, part):
    mesh = make_box()
    other = replace(mesh, **{part: getattr(mesh, part)[:, [1, 2, 0]].copy()})
    assert Shape.of(mesh) is Shape.of(make_box()) is Shape.of(dye(mesh, 9))
    assert Shape.of(other) is not Shape.of(mesh)


def test_the_last_few_shapes_are_kept_and_no_more(make_box):
    first = make_box((50.0, 40.0, 30.0))
    shape = Shape.of(first)
    for i in range(3 * Shape.MOST_KEPT):
        Shape.of(make_box((60.0 + i, 40.0, 30.0)))
        assert len(Shape._known) <= Shape.MOST_KEPT
        if i < 2 * Shape.MOST_KEPT:
            assert Shape.of(first) is shape  # in use: not the one that goes
    assert Shape.of(first) is not shape


def test_what_is_kept_of_a_shape_and_of_pictures_is_bounded(make_box, studio):
    mesh = make_box()
    for azimuth in range(0, 360, 30):
        lit = replace(studio, key=replace(studio.key, azimuth_deg=azimuth), environment=studio.environment.copy())
        RaycastRenderer(dye(mesh, azimuth // 2), lit, QUICK)
        assert len(Shape.of(mesh)._free) <= 4
        assert len(bake_cache._in_use) <= bake_cache.MOST_KEPT
    for spacing in (5.0, 6.0, 7.0):
        Shape.of(mesh).grid(spacing)
    assert len(Shape.of(mesh)._grids) == 1


def test_threads_that_ask_at_once_share_one_shape_and_its_light(make_box, studio, calls):
    start, mesh = threading.Barrier(4, timeout=10), make_box()

    def build(code: int) -> tuple[RaycastRenderer, bytes]:
        start.wait()
        renderer = RaycastRenderer(dye(mesh, code), studio, QUICK)
        return renderer, renderer.render(CAMERA, POSE).tobytes()

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(build, [10, 60, 110, 160]))
    assert len({id(renderer._object.shape) for renderer, _ in found}) == 1
    assert calls.count("make_ray_scene") == calls.count("place_samples") == 1
    assert calls.count("find_free") == 4  # room and key, for the table and the object
    for code, (_, picture) in zip([10, 60, 110, 160], found, strict=True):
        assert picture == RaycastRenderer(dye(mesh, code), studio, QUICK).render(CAMERA, POSE).tobytes()
