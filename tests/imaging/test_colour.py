"""sRGB against published values and its own inverse."""

import numpy as np
import pytest

from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear


@pytest.mark.parametrize(
    ("code", "light"),
    # IEC 61966-2-1, as tabulated in many places: 8-bit code and linear light
    [
        (0, 0.0),
        (10, 0.003035),
        (11, 0.003347),
        (55, 0.038204),
        (119, 0.184475),
        (128, 0.215861),
        (188, 0.502886),
        (255, 1),
    ],
)
def test_published_pairs(code, light):
    assert float(srgb_to_linear(np.array(code / 255))) == pytest.approx(light, abs=2e-6)
    assert float(linear_to_srgb(np.array(light))) * 255 == pytest.approx(code, abs=2e-3)


def test_every_code_survives_the_way_there_and_back():
    codes = np.arange(256)
    np.testing.assert_array_equal(np.round(linear_to_srgb(srgb_to_linear(codes / 255)) * 255), codes)


def test_both_ways_rise_without_a_step():
    for function in (srgb_to_linear, linear_to_srgb):
        values = function(np.linspace(0, 1, 100_001))
        assert (np.diff(values) >= 0).all() and np.diff(values).max() < 3e-4
        assert values.dtype == np.float32


def test_light_beyond_the_range_is_clipped():
    np.testing.assert_allclose(linear_to_srgb(np.array([-1.0, 2.0, 1e9])), [0, 1, 1], atol=1e-6)
