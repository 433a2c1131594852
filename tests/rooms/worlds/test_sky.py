"""The sky against published luminances and illuminances, its energy, and its conventions."""

import numpy as np
import pytest

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.imaging.colour import XYZ_OF_LINEAR_SRGB
from toolkit.rig.camera import orbit_direction
from toolkit.rig.scene import KeyLight, illuminate
from toolkit.rig.textures import sample_directions
from toolkit.rooms.worlds.conditions import TIMES, TimeOfDay
from toolkit.rooms.worlds.daylight import (
    LUMINANCE,
    clear_sky,
    diffuse_klx,
    find_air_mass,
    find_zenith,
    overcast_klx,
    sunlight,
    twilight_klx,
)
from toolkit.rooms.worlds.sky import Sky, find_directions, make_sky

HEIGHT = 96


def integrate(panorama: np.ndarray) -> float:
    """Illuminance of level ground by the upper half, pixel by pixel."""
    directions = find_directions(len(panorama))
    solid_angle = np.sqrt(1 - directions[..., 2] ** 2) * (np.pi / len(panorama)) ** 2
    return float((panorama @ LUMINANCE * solid_angle * np.maximum(directions[..., 2], 0)).sum())


def cie_clear(directions: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """The CIE's standard clear sky, type 12, up to a factor (CIE S 011:2003)."""
    zenith_angle, gamma = np.arccos(directions[:, 2]), np.arccos(np.clip(directions @ sun, -1, 1))
    gradation = 1 - np.exp(-0.32 / np.cos(zenith_angle))
    return gradation * (1 + 10 * (np.exp(-3 * gamma) - np.exp(-3 * np.pi / 2)) + 0.45 * np.cos(gamma) ** 2)


@pytest.mark.parametrize("elevation_deg", [60.0, 45.0, 30.0, 20.0])
def test_luminances_over_the_zeniths_are_the_cies_within_a_factor_of_two(elevation_deg):
    sun, zenith = orbit_direction(0, elevation_deg), np.array([[0.0, 0.0, 1.0]])
    places = np.array([orbit_direction(az, el) for az in (60, 90, 135, 180) for el in (5, 15, 30, 45, 60)])
    ours = clear_sky(places, sun, 2.45) @ LUMINANCE / (clear_sky(zenith, sun, 2.45) @ LUMINANCE)
    cies = cie_clear(places, sun) / cie_clear(zenith, sun)
    assert np.exp(np.abs(np.log(ours / cies)).max()) < 2
    assert np.corrcoef(ours, cies)[0, 1] > 0.75


def test_the_zenith_has_preetham_s_own_luminance_and_colour():
    """At the zenith Perez' function cancels: x, y, Y are the polynomials'; blue, and y near the daylight locus."""
    sky = clear_sky(np.array([[0.0, 0.0, 1.0]]), orbit_direction(10, 45), 3.0)[0]
    luminance, x, y = find_zenith(45, 3.0)
    xyz = sky @ XYZ_OF_LINEAR_SRGB.T
    np.testing.assert_allclose([xyz[1], xyz[0] / xyz.sum(), xyz[1] / xyz.sum()], [luminance, x, y], rtol=2e-3)
    assert y == pytest.approx(2.870 * x - 3.000 * x**2 - 0.275, abs=0.015)  # CIE's locus of daylight
    assert sky[2] > sky[1] > sky[0]


@pytest.mark.parametrize("elevation_deg", [60.0, 45.0, 30.0, 20.0, 10.0])
def test_sun_and_sky_light_the_ground_as_the_naval_observatory_says(elevation_deg):
    sky = make_sky(TimeOfDay(elevation_deg, cloud_cover=0.0), 0, HEIGHT)
    total = illuminate(sky.panorama, sky.sun) @ LUMINANCE
    assert total == pytest.approx(twilight_klx(elevation_deg), rel=0.15)
    assert integrate(sky.panorama) == pytest.approx(diffuse_klx(elevation_deg), rel=0.03)


@pytest.mark.parametrize("elevation_deg", [60.0, 45.0, 30.0, 20.0])
def test_the_sun_is_as_bright_as_the_ies_says(elevation_deg):
    published = 127.5 * np.exp(-0.21 * find_air_mass(elevation_deg))  # klx, clear (IES 1984)
    assert sunlight(elevation_deg, 2.5) @ LUMINANCE == pytest.approx(published, rel=0.15)


def test_the_sun_reddens_and_sets():
    ratios = [red / blue for red, _, blue in (sunlight(el, 2.6) for el in (60, 30, 10, 5, 1))]
    assert (np.diff(ratios) > 0).all() and 1 < ratios[0] < 1.6
    assert not sunlight(-1, 2.6).any()
    assert find_air_mass(90) == pytest.approx(1, abs=0.01) and find_air_mass(0) == pytest.approx(36.5, rel=0.1)


def test_twilight_is_the_published_one():
    """Civil twilight ends at 3.4 lx, the sun's middle on the horizon gives some 750 lx; no jump in between."""
    assert 1e3 * twilight_klx(-6) == pytest.approx(3.4, rel=0.1)
    assert 1e3 * twilight_klx(0) == pytest.approx(759, rel=0.05)
    steps = np.array([diffuse_klx(el) for el in np.arange(-8, 8, 0.1)])
    assert (np.diff(steps) > 0).all() and np.diff(np.log(steps)).max() < 0.2


def test_an_overcast_horizon_is_a_third_of_its_zenith():
    sky = make_sky("overcast", 0, HEIGHT)
    bands = sky.panorama.mean(axis=1) @ LUMINANCE
    assert bands[HEIGHT // 2 - 1] / bands[:8].mean() == pytest.approx(1 / 3, rel=0.2)
    assert integrate(sky.panorama) == pytest.approx(overcast_klx(40), rel=0.12)
    assert sky.sun.irradiance == (0, 0, 0)


@pytest.mark.parametrize("name", TIMES)
def test_every_time_of_day_is_a_sky_that_a_camera_can_show(name):
    sky = make_sky(name, 1, HEIGHT)
    assert sky.panorama.shape == (HEIGHT, 2 * HEIGHT, 3) and sky.panorama.dtype == np.float32
    assert np.isfinite(sky.panorama).all() and sky.panorama.min() >= 0
    assert sky.lamps_on == (name == "dusk") and (sum(sky.sun.irradiance) == 0) == (name in ("dusk", "overcast"))
    ground = 0.18 / np.pi * (illuminate(sky.panorama, sky.sun) @ LUMINANCE) * sky.exposure
    assert (0.005 if name == "dusk" else 0.06) < ground < 0.4
    assert 0.1 < sky.airlight @ LUMINANCE < 1
    assert sky.sun.radius_deg == 0.27


@pytest.mark.parametrize("azimuth_deg", [-120.0, 0.0, 50.0])
def test_the_glow_is_where_the_sun_is_and_its_disc_is_not_there(azimuth_deg):
    """The brightest place is the sun's, as the renderer reads the panorama, and sends little: the disc is `sun`'s."""
    sky = make_sky(TimeOfDay(35.0, azimuth_deg, cloud_cover=0.0), 0, HEIGHT)
    directions = find_directions(HEIGHT)
    np.testing.assert_allclose(
        sample_directions(sky.panorama, directions[10:40, ::7].reshape(-1, 3)),
        sky.panorama[10:40, ::7].reshape(-1, 3), rtol=0.02,
    )  # fmt: skip
    luminance = sky.panorama @ LUMINANCE
    brightest = directions.reshape(-1, 3)[luminance.argmax()]
    towards = orbit_direction(sky.sun.azimuth_deg, sky.sun.elevation_deg)
    assert np.degrees(np.arccos(brightest @ towards)) < 3
    disc = np.array(sky.sun.irradiance) @ LUMINANCE / (np.pi * np.radians(sky.sun.radius_deg) ** 2)
    assert luminance.max() < disc / 1e4
    glow = np.degrees(np.arccos(np.clip(directions @ towards, -1, 1))) < 5
    solid_angle = np.sqrt(1 - directions[..., 2] ** 2) * (np.pi / HEIGHT) ** 2
    assert (luminance * solid_angle)[glow].sum() < 0.02 * (np.array(sky.sun.irradiance) @ LUMINANCE)


def test_same_seed_same_bytes_another_seed_other_clouds():
    first = make_sky("noon", 3, HEIGHT).panorama
    make_sky.cache_clear()
    np.testing.assert_array_equal(make_sky("noon", 3, HEIGHT).panorama, first)
    assert (make_sky("noon", 4, HEIGHT).panorama != first).any()


def test_more_cover_less_blue():
    def blue_share(cover: float) -> float:
        upper = make_sky(TimeOfDay(45.0, cloud_cover=cover), 0, HEIGHT).panorama[: HEIGHT // 2]
        return float((upper[..., 2] > 1.35 * upper[..., 0]).mean())

    shares = [blue_share(cover) for cover in (0.0, 0.2, 0.5, 0.8, 1.0)]
    assert (np.diff(shares) <= 0.01).all() and shares[0] > 0.8 and shares[4] < 0.05


def test_air_scatters_the_mean_of_all_around_and_white_ground_the_irradiance():
    even = Sky("even", np.ones((HEIGHT, 2 * HEIGHT, 3), np.float32), KeyLight(irradiance=(0, 0, 0)), 0.5)
    np.testing.assert_allclose(even.airlight, 0.5, rtol=1e-5)
    np.testing.assert_allclose(even.white, 0.5, rtol=1e-3)
    sun = KeyLight(elevation_deg=30, irradiance=(4 * np.pi, 0, 0))
    lit = Sky("lit", even.panorama, sun, 0.5)
    np.testing.assert_allclose(lit.airlight, [1, 0.5, 0.5], rtol=1e-5)
    np.testing.assert_allclose(lit.white, [1.5, 0.5, 0.5], rtol=1e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TimeOfDay(95.0), "sun_elevation_deg 95: expected -12 to 90"),
        (lambda: TimeOfDay(40.0, cloud_cover=1.2), r"cloud_cover 1\.2: expected 0 to 1"),
        (lambda: TimeOfDay(40.0, turbidity=1.0), r"turbidity 1: expected 1\.8 to 10"),
        (lambda: make_sky("noon", 0, 33), "height_px 33: expected an even number"),
    ],
)
def test_settings_that_cannot_be_are_refused(make, message):
    with pytest.raises(FieldError, match=message):
        make()


def test_no_such_time_of_day():
    with pytest.raises(ToolkitError, match="no time of day called 'non': did you mean noon"):
        make_sky("non")
