"""Fog, dust and the veils of rain and snow are their closed forms, at known depths."""

import numpy as np
import pytest

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.rig.camera import Camera, look_at, orbit_direction
from toolkit.rooms.worlds.daylight import LUMINANCE
from toolkit.rooms.worlds.depth_weather import (
    Rain,
    Snow,
    add_weather,
    find_rain_extinction,
    find_snow_extinction,
    make_weather,
    weather_rng,
)
from toolkit.rooms.worlds.fog import DENSEST, THINNEST, DepthFog, Dust, hang_veil, stretch_path, tan_airlight
from toolkit.rooms.worlds.particles import DepthView

AIRLIGHT = np.array([0.7, 0.8, 0.95])
CAMERA = Camera.from_fov(64, 48, 60)
POSE = look_at(np.array([30.0, 5.0, 8.0]), np.array([0.0, 0.0, 2.0]))


def view_at(depth_m: float, **masks: np.ndarray) -> DepthView:
    return DepthView(np.full((48, 64), depth_m, np.float32), CAMERA, POSE, **masks)


@pytest.mark.parametrize("severity", [1, 2, 3, 4, 5])
def test_a_black_target_at_the_visibility_keeps_five_percent_of_its_contrast(severity):
    fog = make_weather("fog", severity)
    black = np.zeros((48, 64, 3), np.float32)
    seen = add_weather(black, view_at(fog.visibility_m), fog, AIRLIGHT, weather_rng(0, 0, "fog", severity))
    np.testing.assert_allclose(1 - seen / AIRLIGHT, 0.05, atol=1e-4)  # -ln 0.05 is 2.9957
    assert fog.visibility_m == (100, 70, 40, 20, 10)[severity - 1]


@pytest.mark.parametrize("depth_m", [0.0, 5.0, 20.0, 60.0])
def test_mean_radiance_is_koschmieders(depth_m):
    light = np.random.default_rng(0).uniform(0, 1, (48, 64, 3)).astype(np.float32)
    seen = add_weather(light, view_at(depth_m), DepthFog(visibility_m=40), AIRLIGHT, np.random.default_rng(0))
    passed = np.exp(-2.996 / 40 * depth_m)
    np.testing.assert_allclose(seen, light * passed + AIRLIGHT * (1 - passed), atol=1e-6)


@pytest.mark.parametrize(
    ("weather", "layer_m", "beta"),
    [
        (DepthFog(visibility_m=10), 200, 0.2996),
        (DepthFog(visibility_m=1000, patchiness=1), 200, 0.002996),
        (Dust(visibility_m=500), 1000, Dust(visibility_m=500).extinction[0]),
        (Rain(rate_mm_h=5), 1500, find_rain_extinction(5)),
        (Snow(rate_mm_h=1), 1500, find_snow_extinction(1)),
        (Rain(rate_mm_h=0), 1500, 0.0),
    ],
)
def test_the_sky_is_seen_through_the_layer(weather, layer_m, beta):
    """Straight up it is the layer's height, at an elevation of 30° twice that; a black sky shows the airlight alone."""
    red = (tan_airlight(AIRLIGHT) if isinstance(weather, Dust) else AIRLIGHT)[0]
    for elevation_deg in (30.0, 89.9):
        up = look_at(np.zeros(3), orbit_direction(0, elevation_deg))
        view = DepthView(np.full((48, 64), np.inf, np.float32), CAMERA, up)
        seen = weather.change_light(view, AIRLIGHT, np.random.default_rng(0))
        assert np.isfinite(seen.factor).all() and np.isfinite(seen.offset).all()
        passed = np.exp(-beta * layer_m / view.directions[..., 2])
        bare = np.abs(seen.factor[..., 0] - passed) < 1e-4
        bare &= np.abs(seen.offset[..., 0] - (1 - passed) * red) < 1e-4
        assert bare.mean() > (0.3 if isinstance(weather, Snow) else 0.8)  # the rest is drops and flakes


@pytest.mark.parametrize(
    "extinction", [Dust().extinction, np.array([2.996 / 30]), np.array([find_rain_extinction(50)])]
)
def test_two_slabs_are_one(extinction):
    """Beer and Lambert: light through 8 m and then 13 m is light through 21 m."""
    one, other, both = (hang_veil(np.full((4, 4), depth), extinction, AIRLIGHT) for depth in (8.0, 13.0, 21.0))
    np.testing.assert_allclose(one.then(other).factor, both.factor, atol=1e-6)
    np.testing.assert_allclose(one.then(other).offset, both.offset, atol=1e-6)


def test_patchy_fog_is_its_own_integral_along_the_ray():
    """The closed form against 4000 steps of slices that are themselves so thin that their factor is local."""
    farthest, depth = 400.0, 47.0
    paths = np.stack([stretch_path(view_at(d), 1.0, farthest, np.random.default_rng(5)) for d in (depth, depth / 2)])
    steps = np.linspace(0, depth, 4001)
    sampled = np.stack([stretch_path(view_at(d), 1.0, farthest, np.random.default_rng(5)) for d in steps[::200]])
    local = np.diff(sampled, axis=0) / np.diff(steps[::200])[:, None, None]
    assert THINNEST <= local.min() < 0.95 and 1.15 < local.max() <= DENSEST
    assert np.ptp(paths[0]) > 1  # from ray to ray
    halves = view_at(depth / 2)
    behind = halves.T_world_camera.copy()
    ray = halves.directions[24, 32]
    behind[:3, 3] += ray * depth / 2  # the camera moved along one ray: what is left of it is the rest of the integral
    rest = stretch_path(DepthView(halves.depth_m, CAMERA, behind), 1.0, farthest, np.random.default_rng(5))
    assert rest[24, 32] + paths[1][24, 32] == pytest.approx(paths[0][24, 32], abs=1e-3)


def test_even_fog_is_patchy_fog_without_patches():
    path = stretch_path(view_at(20.0), 0.0, 400.0, np.random.default_rng(0))
    np.testing.assert_allclose(path, 20.0, rtol=1e-6)


def test_dust_takes_more_blue_than_red_and_sends_tan():
    dust = Dust(visibility_m=40)
    factor = dust.change_light(view_at(25.0), AIRLIGHT, np.random.default_rng(0)).factor
    beta = -np.log(factor.max(axis=(0, 1))) / 25
    np.testing.assert_allclose(beta, 2.996 / 40 * (np.array([610, 550, 465]) / 550) ** -0.5, rtol=1e-4)
    assert beta[0] < beta[1] < beta[2]
    tan = tan_airlight(AIRLIGHT)
    assert tan[0] > tan[1] > tan[2] and tan @ LUMINANCE == pytest.approx(0.65 * AIRLIGHT @ LUMINANCE)


@pytest.mark.parametrize(("rate", "per_km"), [(5, 0.917), (25, 2.698), (100, 6.826)])
def test_rains_extinction_is_the_published_one(rate, per_km):
    assert 1e3 * find_rain_extinction(rate) == pytest.approx(per_km, rel=2e-3)
    factor = Rain(rate_mm_h=rate).change_light(view_at(100.0), AIRLIGHT, np.random.default_rng(0)).factor
    assert factor.max() == pytest.approx(np.exp(-per_km / 10), rel=1e-3)


def test_snow_of_the_weather_services_classes_has_their_visibility():
    """Heavy snow is below 400 m, light above 1000 m (US National Weather Service)."""
    visibility = {rate: 2.996 / find_snow_extinction(rate) for rate in (1, 2, 4, 6, 10)}
    assert visibility[1] > 1000 > visibility[2] > 400 > visibility[4] > visibility[10]
    assert 4.343 * 1e3 * find_snow_extinction(4) == pytest.approx((5.42e-5 * 550 + 5.496) * 4**1.38, rel=1e-3)


def test_rain_darkens_the_ground_alone():
    ground = np.zeros((48, 64), bool)
    ground[24:] = True
    rain = Rain(rate_mm_h=25)
    wet = rain.change_light(view_at(10.0, ground=ground), AIRLIGHT, np.random.default_rng(0))
    dry = rain.change_light(view_at(10.0), AIRLIGHT, np.random.default_rng(0))
    np.testing.assert_array_equal(wet.offset, dry.offset)
    ratio = wet.factor / dry.factor
    np.testing.assert_allclose(ratio[:24], 1)
    np.testing.assert_allclose(ratio[24:], 1 - 0.4 * (1 - np.exp(-2.5)), rtol=1e-5)


def test_snow_lies_on_what_faces_up_and_stays_where_it_is():
    normals = np.zeros((48, 64, 3), np.float32)
    normals[:24, :, 0], normals[24:, :, 2] = 1, 1
    bare = Snow(rate_mm_h=0, cover=0.6).change_light(view_at(12.0), AIRLIGHT, np.random.default_rng(0))
    np.testing.assert_array_equal(bare.factor, 1)
    shares = []
    for cover in (0.0, 0.15, 0.6, 0.95, 1.0):
        lying = Snow(rate_mm_h=0, cover=cover).change_light(
            view_at(12.0, normals=normals), AIRLIGHT, np.random.default_rng(0)
        )
        np.testing.assert_array_equal(lying.factor[:24], 1)
        shares.append(1 - lying.factor[24:].mean())
    assert shares[0] == 0 and shares[4] == 1
    lit = Snow(rate_mm_h=0, cover=1).change_light(
        view_at(12.0, normals=normals, white=np.array([1.0, 0.9, 0.8])), AIRLIGHT, np.random.default_rng(0)
    )
    np.testing.assert_allclose(lit.offset[40, 30], 0.85 * np.array([1.0, 0.9, 0.8]), rtol=1e-5)
    many = []  # one picture sees a few patches: the share is that of many places
    for x in np.arange(12) * 7.0:
        pose = POSE.copy()
        pose[:3, 3] = x, 3 * x, 10
        view = DepthView(np.full((48, 64), 12, np.float32), CAMERA, pose, normals=normals)
        many.append(
            1 - Snow(rate_mm_h=0, cover=0.6).change_light(view, AIRLIGHT, np.random.default_rng(0)).factor[24:].mean()
        )
    assert np.mean(many) == pytest.approx(0.6, abs=0.08)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DepthFog(visibility_m=0), "visibility_m 0: expected above 0"),
        (lambda: DepthFog(patchiness=2), "patchiness 2: expected 0 to 1"),
        (lambda: Rain(rate_mm_h=-1), "rate_mm_h -1: expected 0 to 300"),
        (lambda: Snow(cover=1.5), "cover 1.5: expected 0 to 1"),
        (lambda: Rain(wetness=3), "wetness 3: expected"),
    ],
)
def test_settings_that_cannot_be_are_refused(make, message):
    with pytest.raises(FieldError, match=message):
        make()


def test_a_depth_of_another_size_is_refused():
    with pytest.raises(ToolkitError, match="depth_m of 30 × 20 pixels: expected the camera's 64 × 48"):
        DepthView(np.ones((20, 30), np.float32), CAMERA, POSE)
    with pytest.raises(ToolkitError, match="ground of 64 × 20 pixels"):
        view_at(3.0, ground=np.zeros((20, 64), bool))
