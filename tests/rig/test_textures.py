"""Texture look-ups against averages, texel centres and the words that say where a direction lies."""

import numpy as np
import pytest

from toolkit.imaging.colour import srgb_to_linear
from toolkit.rig.studio import make_studio
from toolkit.rig.textures import (
    build_pyramid,
    equirectangular,
    sample,
    sample_directions,
    sample_pyramid,
    texture_pyramid,
)

RNG = np.random.default_rng(11)


@pytest.mark.parametrize("shape", [(64, 64), (37, 53), (4, 4), (128, 16), (1, 1)])
def test_every_level_has_the_mean_of_the_first(shape):
    picture = RNG.uniform(0, 1, (*shape, 3)).astype(np.float32)
    levels = build_pyramid(picture)
    for level in levels:
        np.testing.assert_allclose(level.mean(axis=(0, 1)), picture.mean(axis=(0, 1)), atol=2e-5)
    assert min(levels[-1].shape[:2]) <= 4
    np.testing.assert_array_equal(levels[0], picture)


def test_averages_are_of_light_and_not_of_codes():
    stripes = np.zeros((16, 16, 3), np.uint8)
    stripes[::2] = 255
    assert texture_pyramid(stripes)[1].mean() == pytest.approx(0.5, abs=1e-6)
    assert texture_pyramid(stripes)[0].max() == pytest.approx(1)
    grey = texture_pyramid(np.full((8, 8, 3), 119, np.uint8))[0]
    np.testing.assert_allclose(grey, srgb_to_linear(np.array(119 / 255)), atol=1e-6)


def test_texel_centres_are_exact_and_row_0_is_v_1():
    picture = RNG.uniform(0, 1, (5, 9, 3)).astype(np.float32)
    row, column = (index.reshape(-1) for index in np.mgrid[:5, :9])
    found = sample(picture, (column + 0.5) / 9, 1 - (row + 0.5) / 5)
    np.testing.assert_allclose(found, picture[row, column], atol=1e-6)


def test_between_texels_it_is_linear():
    """To 1/32 of a texel, which is OpenCV's fixed-point weight."""
    ramp = np.tile(np.arange(32, dtype=np.float32)[None, :, None], (8, 1, 3))
    x = RNG.uniform(0.5, 31.5, 3000)
    np.testing.assert_allclose(sample(ramp, x / 32, np.full(3000, 0.5))[:, 0], x - 0.5, atol=1 / 32)


def test_coordinates_outside_repeat():
    picture = RNG.uniform(0, 1, (8, 8, 3)).astype(np.float32)
    u, v = RNG.integers(0, 8, 50) / 8 + 1 / 16, RNG.integers(0, 8, 50) / 8 + 1 / 16
    np.testing.assert_allclose(sample(picture, u + 1, v - 2), sample(picture, u, v), atol=1e-5)


def test_level_of_detail_picks_and_mixes_levels():
    picture = RNG.uniform(0, 1, (64, 64, 3)).astype(np.float32)
    levels = build_pyramid(picture)
    u, v = RNG.uniform(0, 1, 200).astype(np.float32), RNG.uniform(0, 1, 200).astype(np.float32)

    def at(lod):
        return sample_pyramid(levels, u, v, np.full(200, lod, np.float32))

    for level in range(len(levels)):
        np.testing.assert_allclose(at(level), sample(levels[level], u, v), atol=1e-6)
    np.testing.assert_allclose(at(1.25), 0.75 * at(1) + 0.25 * at(2), atol=1e-5)
    np.testing.assert_allclose(at(-3), at(0), atol=1e-6)
    np.testing.assert_allclose(at(99), at(len(levels) - 1), atol=1e-6)


@pytest.mark.parametrize(
    ("direction", "u", "v"),
    [
        ((1, 0, 0), 0.5, 0.5),  # azimuth 0 in the middle
        ((0, 1, 0), 0.25, 0.5),  # azimuth grows to the left
        ((0, -1, 0), 0.75, 0.5),
        ((0, 0, 1), 0.5, 1.0),  # straight up is row 0
        ((0, 0, -1), 0.5, 0.0),
    ],
)
def test_directions_lie_where_the_studio_says(direction, u, v):
    found = equirectangular(np.array([direction], np.float32))
    assert (float(found[0][0]), float(found[1][0])) == pytest.approx((u, v), abs=1e-6)


def test_the_back_is_at_both_ends():
    u, _ = equirectangular(np.array([[-1, 1e-6, 0], [-1, -1e-6, 0]], np.float32))
    assert sorted(u.round(4).tolist()) == [0, 1]


def test_a_studios_ceiling_is_above_its_floor():
    environment = make_studio(3, 100, "white").environment
    up, down = sample_directions(environment, np.array([[0, 0, 1], [0, 0, -1]], np.float32))
    np.testing.assert_allclose(up, environment[0].mean(axis=0), rtol=0.05)  # and nothing of the floor beyond the pole
    assert up.mean() > down.mean()
