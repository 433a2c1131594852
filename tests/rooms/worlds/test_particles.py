"""Streaks and flakes: number, direction and light are those of the published distributions."""

import cv2
import numpy as np
import pytest

from toolkit.rig.camera import Camera, look_at
from toolkit.rooms.worlds.depth_weather import (
    DIAMETERS_MM,
    RAIN_BIN_MM,
    Rain,
    find_rain_extinction,
    find_snow_extinction,
    make_drops,
    make_flakes,
)
from toolkit.rooms.worlds.particles import NEAREST_M, DepthView, Population, draw_coverage

CAMERA = Camera.from_fov(224, 224, 60)
LEVEL = look_at(np.array([0.0, 0.0, 2.0]), np.array([10.0, 0.0, 2.0]))
CALM = np.zeros(3)


def view_at(depth_m: float, camera: Camera = CAMERA) -> DepthView:
    return DepthView(np.full((camera.height, camera.width), depth_m, np.float32), camera, LEVEL)


@pytest.mark.parametrize("rate", [5, 25, 100])
def test_the_drops_carry_the_rain(rate):
    """The water that Marshall and Palmer's drops bring down at their speeds is the rate itself, within their fit."""
    drops = make_drops(rate)
    mm_per_s = np.pi / 6 * (drops.per_m3 * drops.diameter_mm**3 * 1e-9 * drops.fall_m_s).sum() * 1e3
    assert 3600 * mm_per_s == pytest.approx(rate, rel=0.25)


@pytest.mark.parametrize("rate", [5, 25, 100])
def test_the_drops_shade_as_the_veil_says(rate):
    """Geometric optics: large drops take twice their cross-section. Atlas' law is the same within its scatter."""
    drops = make_drops(rate)
    beta = 2 * np.pi / 4 * (drops.per_m3 * drops.diameter_mm**2 * 1e-6).sum()
    assert 0.4 < beta / find_rain_extinction(rate) < 1.6


@pytest.mark.parametrize("rate", [1, 4, 10])
def test_the_flakes_shade_as_the_veil_says(rate):
    flakes = make_flakes(rate)
    beta = 2 * np.pi / 4 * (flakes.per_m3 * flakes.diameter_mm**2 * 1e-6).sum()
    assert 0.3 < beta / find_snow_extinction(rate) < 3  # two fits of what scatters by as much


@pytest.mark.parametrize(("diameter_mm", "metres_a_second"), [(1.0, 4.03), (2.0, 6.49), (3.0, 8.06), (5.0, 9.09)])
def test_drops_fall_as_gunn_and_kinzer_measured(diameter_mm, metres_a_second):
    drops = make_drops(25)
    assert np.interp(diameter_mm, drops.diameter_mm, drops.fall_m_s) == pytest.approx(metres_a_second, rel=0.04)


def test_as_many_as_the_pyramid_of_view_holds():
    """Points so small and bright that each is a pixel or two: counted in the picture, and by volume times density."""
    one = Population(np.array([6.0]), np.array([3.0]), np.array([0.0]))
    reach = one.reach_m(CAMERA.fx, 0, 1e-6)
    volume = (2 * np.tan(np.radians(30))) ** 2 / 3 * (reach[0] ** 3 - NEAREST_M**3)
    assert one.count_seen(CAMERA, reach)[0] == pytest.approx(3 * volume)
    areas = []
    for seed in range(30):
        covered = draw_coverage(view_at(np.inf), one, CALM, 1e-6, np.random.default_rng(seed))
        areas.append(covered.sum())
    # a particle at z shades π/4 (fD/z)² pixels; over the pyramid that is n π/4 (fD)² · opening · (Z - z)
    opening = (2 * np.tan(np.radians(30))) ** 2
    expected = 3 * opening * (reach[0] - NEAREST_M) * np.pi / 4 * (CAMERA.fx * 6e-3) ** 2
    assert np.mean(areas) == pytest.approx(expected, rel=0.1)


def measure_lean_deg(coverage: np.ndarray) -> float:
    """Lean of streaks from the vertical, clockwise, by the structure tensor."""
    smooth = cv2.GaussianBlur(coverage, (0, 0), 2)  # differences of pixels alone favour some directions
    down, right = np.gradient(smooth)
    along = np.arctan2(2 * (down * right).sum(), (right**2 - down**2).sum()) / 2  # of the gradient, across the streaks
    return float(np.degrees(along))


@pytest.mark.parametrize("wind_m_s", [0.0, 4.0, 9.0])
def test_streaks_lean_as_wind_and_fall_say(wind_m_s):
    """Looking along +x, the image's right is -y: wind from +y drives drops to the right as they fall."""
    kind = Population(np.array([3.0]), np.array([40.0]), np.array([8.0]))
    wind = Rain(wind_m_s=wind_m_s, wind_from_deg=90).wind
    np.testing.assert_allclose(wind, [0, -wind_m_s, 0], atol=1e-12)
    camera = Camera.from_fov(480, 480, 30)
    lean = [
        measure_lean_deg(draw_coverage(view_at(np.inf, camera), kind, wind, 1 / 60, np.random.default_rng(seed)))
        for seed in range(3)
    ]
    # a streak's tail is up: right below means that the line leans like a backslash
    assert np.mean(lean) == pytest.approx(-np.degrees(np.arctan(wind_m_s / 8)), abs=2.5)


def test_what_is_behind_a_surface_is_hidden():
    drops, rng = make_drops(100), np.random.default_rng
    free = draw_coverage(view_at(np.inf), drops, CALM, 1 / 500, rng(1))
    near = draw_coverage(view_at(1.0), drops, CALM, 1 / 500, rng(1))
    none = draw_coverage(view_at(0.2), drops, CALM, 1 / 500, rng(1))
    assert (near <= free + 1e-6).all() and 0 < near.sum() < 0.9 * free.sum() and not none.any()


def test_more_rain_more_streaks_and_never_more_than_all():
    sums = [
        draw_coverage(view_at(50.0), make_drops(rate), CALM, 1 / 500, np.random.default_rng(2)) for rate in (5, 100)
    ]
    assert 0 < sums[0].sum() < sums[1].sum() and sums[1].max() <= 1
    assert not draw_coverage(view_at(50.0), make_drops(0), CALM, 1 / 500, np.random.default_rng(2)).any()


def test_too_many_are_cut_off_from_the_far_end():
    crowd = Population(np.array([4.0]), np.array([1e6]), np.array([1.0]))
    covered = draw_coverage(view_at(np.inf), crowd, CALM, 1 / 500, np.random.default_rng(0))
    assert np.isfinite(covered).all() and covered.max() <= 1


def test_bins_are_even():
    np.testing.assert_allclose(np.diff(DIAMETERS_MM), RAIN_BIN_MM)
