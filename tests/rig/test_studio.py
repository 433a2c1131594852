"""Studios: from one seed, all different, none too dark or too bright to be a photograph."""

from dataclasses import replace

import numpy as np
import pytest

from toolkit.core.cache import PLACE
from toolkit.core.errors import ToolkitError
from toolkit.rig import studio
from toolkit.rig.scene import illuminate
from toolkit.rig.studio import BACKDROPS, LIGHTS, TRAINED_LIGHTS, make_studio, name_studio


def test_equal_seeds_make_equal_studios_and_others_do_not():
    first, again, other = make_studio((1, 2), 40), make_studio((1, 2), 40), make_studio((1, 3), 40)
    assert first.name == again.name and first.exposure == again.exposure
    np.testing.assert_array_equal(first.table.picture, again.table.picture)
    np.testing.assert_array_equal(first.environment, again.environment)
    assert first.environment.shape == other.environment.shape
    assert (first.environment != other.environment).any()


def test_a_studio_that_is_kept_on_disk_is_painted_once(monkeypatch, tmp_path):
    monkeypatch.setenv(PLACE, str(tmp_path))
    plain = make_studio((5, 6), 40, light="warm")
    make_studio((5, 6), 40, light="warm", keep=True)
    make_studio.cache_clear()
    monkeypatch.setattr(studio, "paint_room", lambda *_: pytest.fail("it is on disk"))
    kept = make_studio((5, 6), 40, light="warm", keep=True)
    assert (kept.name, kept.key, kept.exposure) == (plain.name, plain.key, plain.exposure)
    np.testing.assert_array_equal(kept.environment, plain.environment)
    np.testing.assert_array_equal(kept.table.picture, plain.table.picture)


@pytest.mark.parametrize("backdrop", [None, "oak"])
def test_a_studios_name_is_known_before_it_is_painted(backdrop):
    assert name_studio((5, 6), backdrop, "dim") == make_studio((5, 6), 40, backdrop, "dim").name


@pytest.mark.slow
def test_seeds_reach_every_backdrop():
    drawn = {make_studio(seed, 10).name.split("/")[0] for seed in range(60)}
    assert drawn == set(BACKDROPS)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("backdrop", BACKDROPS)
def test_every_backdrop_in_every_light_is_well_exposed(backdrop, light):
    """The table's brightness: neither sunk into black nor washed out, with dark tables darker than bright ones."""
    from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear

    made = make_studio(4, 60, backdrop, light)
    assert made.name == f"{backdrop}/{light}/4"
    albedo = srgb_to_linear(made.table.picture / 255).reshape(-1, 3).mean(axis=0)
    elevation = np.pi / 2 - (np.arange(128) + 0.5) * np.pi / 256
    ring = made.environment[:128].mean(axis=1) * (np.sin(elevation) * np.cos(elevation))[:, None]
    room = 2 * np.pi * ring.sum(axis=0) * np.pi / 256  # the integral of L cos over the upper half
    irradiance = room + np.sin(np.radians(made.key.elevation_deg)) * np.array(made.key.irradiance)
    code = 255 * linear_to_srgb((albedo * irradiance / np.pi * made.exposure).mean())
    assert 45 < code < 225


def test_the_lights_for_tests_are_a_hard_lamp_in_the_dark_and_a_blue_sky_with_its_sun():
    """The share of the key light in what lies on level ground, its size, and the colour overhead."""
    lamp, sky = (make_studio(4, 60, "white", light) for light in ("lamp", "sky"))
    for made, least, most in ((lamp, 0.85, 1), (sky, 0.5, 0.85)):
        total, room = (
            illuminate(made.environment, key).sum() for key in (made.key, replace(made.key, irradiance=(0, 0, 0)))
        )
        assert least < 1 - room / total < most and made.key.radius_deg <= 0.5
    red, _, blue = sky.environment[0, 0]
    assert blue > 2 * red and sky.environment[120, 0].sum() > sky.environment[0, 0].sum()
    assert set(LIGHTS) - set(TRAINED_LIGHTS) == {"lamp", "sky"}


def test_unknown_names_are_refused_with_the_nearest():
    with pytest.raises(ToolkitError, match=r"no backdrop called 'oakk': did you mean oak\?"):
        make_studio(0, 50, "oakk")
    with pytest.raises(ToolkitError, match="no light called 'torch': known: studio, side, warm, dim, lamp, sky"):
        make_studio(0, 50, light="torch")
