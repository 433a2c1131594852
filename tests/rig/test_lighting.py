"""Baked light against what geometry says: an open table, the edge of a shadow, the side it falls to."""

from dataclasses import replace

import numpy as np
import pytest
from kernel_samples import read_samples

from toolkit.core.cache import PLACE
from toolkit.rig import lighting
from toolkit.rig.lighting import BakeDetail, Shape, bake_lighting, bake_studio_light
from toolkit.rig.scene import KeyLight
from toolkit.rig.studio import make_studio

DARK = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def bake(make_box):
    """A function (size, room's radiance, key) -> mesh corners and baked light over a black table."""
    studio = make_studio(0, 100, "white")

    def run(size=(60.0, 60.0, 40.0), room=0.0, key=KeyLight(irradiance=DARK), albedo=0.0):
        mesh = make_box(size)
        black = replace(studio.table, picture=np.zeros_like(studio.table.picture))
        plain = replace(studio, key=key, environment=np.full_like(studio.environment, room), table=black)
        light = bake_lighting(Shape(mesh), np.full(3, albedo, np.float32), plain)
        return mesh.vertices[mesh.faces], light

    return run


def table_at(light, x, y):
    """Irradiance of the table at places in mm."""
    count = light.table.shape[0]
    column = np.floor((np.asarray(x) / light.table_side_mm + 0.5) * count).astype(int)
    row = np.floor((0.5 - np.asarray(y) / light.table_side_mm) * count).astype(int)
    return light.table[row, column]


def face_light(corners, light, axis, sign):
    """Mean irradiance on one side of the box, away from its edges."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = np.flatnonzero(normal[:, axis] * sign > 0.9 * np.linalg.norm(normal, axis=1))
    uv = np.tile(np.array([[0.3, 0.3], [0.4, 0.3], [0.3, 0.4]], np.float32), (len(faces), 1))
    return read_samples(light.grid, light.stored, faces.repeat(3), uv).mean(axis=0)


@pytest.mark.slow
def test_an_open_table_in_an_even_room_receives_pi_times_its_radiance(bake):
    """96 directions: exact for surfaces that look up (their heights are evenly spaced), 4 % for upright ones."""
    corners, light = bake(room=0.7)
    np.testing.assert_allclose(light.open_irradiance, np.pi * 0.7, rtol=1e-3)
    edge = light.table_side_mm / 2 - 2
    np.testing.assert_allclose(table_at(light, [edge, -edge], [edge, 0]), np.pi * 0.7, rtol=0.02)
    top = face_light(corners, light, 2, 1)
    np.testing.assert_allclose(top[:3], np.pi * 0.7, rtol=1e-3)
    assert top[4] == pytest.approx(1)  # sees the whole room
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):  # half sky, half black table
        np.testing.assert_allclose(face_light(corners, light, axis, sign)[:3], np.pi / 2 * 0.7, rtol=0.04)


@pytest.mark.slow
def test_the_key_light_follows_lamberts_law(bake):
    key = KeyLight(azimuth_deg=30, elevation_deg=50, radius_deg=3, irradiance=(2.0, 1.0, 0.5))
    corners, light = bake(key=key)
    e, a = np.radians(50), np.radians(30)
    expected = {(2, 1): np.sin(e), (0, 1): np.cos(e) * np.cos(a), (1, 1): np.cos(e) * np.sin(a), (0, -1): 0, (1, -1): 0}
    for (axis, sign), cosine in expected.items():
        found = face_light(corners, light, axis, sign)
        np.testing.assert_allclose(found[:3], cosine * np.array([2.0, 1.0, 0.5]), atol=0.02)
    np.testing.assert_allclose(light.open_irradiance, np.sin(e) * np.array([2.0, 1.0, 0.5]), rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("azimuth", [0, 40, 130, 250])
def test_the_shadow_falls_away_from_the_key_light(bake, azimuth):
    _, light = bake(key=KeyLight(azimuth_deg=azimuth, elevation_deg=40, radius_deg=5, irradiance=(1, 1, 1)))
    lost = (light.open_irradiance - light.table)[..., 0].clip(0)
    count, half = lost.shape[0], light.table_side_mm / 2
    x = (np.arange(count) + 0.5) / count * 2 * half - half
    under = (np.abs(x[None]) < 31) & (np.abs(x[:, None]) < 31)
    lost[under] = 0
    centre = np.array([(lost * x[None]).sum(), -(lost * x[:, None]).sum()]) / lost.sum()
    direction = np.degrees(np.arctan2(centre[1], centre[0])) % 360
    assert abs((direction - azimuth - 180 + 180) % 360 - 180) < 6


@pytest.mark.slow
def test_the_shadow_ends_where_the_ray_over_the_edge_lands(bake):
    """A box 20 mm high, light from +x at 45°: the shadow reaches 20 mm beyond its far side at x = -30."""
    _, light = bake((60, 60, 20), key=KeyLight(azimuth_deg=0, elevation_deg=45, radius_deg=0.5, irradiance=(1, 1, 1)))
    open_light = np.sin(np.radians(45))
    inner, outer = table_at(light, [-34, -46], [0, 0]), table_at(light, [-54, 40], [0, 0])
    assert inner.max() < 0.02 * open_light
    np.testing.assert_allclose(outer, open_light, rtol=0.05)
    profile = table_at(light, np.linspace(-60, -40, 61), np.zeros(61))[:, 0]
    edge = np.linspace(-60, -40, 61)[np.abs(profile - open_light / 2).argmin()]
    assert edge == pytest.approx(-50, abs=1.0)  # a sample of the table is 0.9 mm


@pytest.mark.slow
def test_a_larger_light_makes_a_softer_shadow(bake):
    def width(radius):
        key = KeyLight(azimuth_deg=0, elevation_deg=45, radius_deg=radius, irradiance=(1, 1, 1))
        profile = table_at(bake((60, 60, 14), key=key)[1], np.linspace(-58, -31, 200), np.zeros(200))[:, 0] / np.sin(
            np.pi / 4
        )
        return ((profile > 0.1) & (profile < 0.9)).sum()

    assert width(9) > 2 * width(3) > 0


@pytest.mark.slow
def test_the_table_is_darker_the_nearer_to_the_object(bake):
    _, light = bake(room=1.0)
    near_to_far = table_at(light, [32, 36, 42, 52, 76], [0] * 5)[:, 0]
    assert (np.diff(near_to_far) > 0).all()
    assert near_to_far[0] < 0.75 * np.pi < 0.95 * np.pi < near_to_far[-1]
    assert table_at(light, [0], [0]).max() < 0.1  # underneath


@pytest.mark.slow
def test_what_blocks_the_room_throws_its_own_colour_back(bake):
    black, white = bake(room=1.0)[1], bake(room=1.0, albedo=0.8)[1]
    near = [32], [0]
    assert table_at(white, *near)[0, 0] > table_at(black, *near)[0, 0] + 0.05
    assert table_at(white, *near)[0, 0] < np.pi  # never more than the open room


@pytest.mark.slow
def test_a_symmetric_scene_has_symmetric_light(bake):
    """Up to the set of directions, which is not symmetric itself."""
    _, light = bake(room=1.0, key=KeyLight(azimuth_deg=0, elevation_deg=50, irradiance=(2, 2, 2)))
    mirrored = light.table[::-1]
    assert np.abs(light.table - mirrored).mean() < 0.015 * light.open_irradiance.mean()
    assert np.abs(light.table - light.table[:, ::-1]).mean() > 0.05  # and the key light is seen to be on one side


def test_light_that_is_kept_is_the_same_and_of_another_light_it_is_another(make_box, monkeypatch, tmp_path):
    monkeypatch.setenv(PLACE, str(tmp_path))
    studio, mesh, albedo = make_studio(0, 100, "white"), make_box((60.0, 60.0, 40.0)), np.full(3, 0.4, np.float32)
    detail = BakeDetail(4, 16, 0.1, 0.1)
    made = bake_lighting(Shape(mesh), albedo, studio, detail)
    kept = [bake_studio_light(Shape(mesh), albedo, studio, detail) for _ in range(2)]
    other = bake_studio_light(Shape(mesh), albedo, replace(studio, key=KeyLight(azimuth_deg=90.0)), detail)
    for name in ("bake_lighting", "place_samples"):
        monkeypatch.setattr(lighting, name, lambda *_: pytest.fail("it is on disk"))
    kept.append(bake_studio_light(Shape(mesh), albedo, studio, detail))
    for one in kept:
        assert one.table_side_mm == made.table_side_mm
        for name in ("steps", "first"):
            np.testing.assert_array_equal(getattr(one.grid, name), getattr(made.grid, name))
        for name in ("stored", "table", "open_irradiance"):
            np.testing.assert_array_equal(getattr(one, name), getattr(made, name))
    assert not np.array_equal(other.stored, made.stored)
