"""Texture look-ups against averages, texel centres and the words that say where a direction lies."""

import numpy as np
import pytest
from kernel_samples import look_towards, sample, sample_by_numpy, texture_pyramid

from toolkit.imaging.colour import LINEAR_OF_CODE, srgb_to_linear
from toolkit.rig.kernel.textures import fill_colours
from toolkit.rig.studio import make_studio
from toolkit.rig.textures import (
    WHITE,
    build_pyramid,
    equirectangular,
    pack_textures,
    pad_channels,
    sample_directions,
)

RNG = np.random.default_rng(11)


def random_texture(height, width):
    return RNG.integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize("shape", [(64, 64, 3), (37, 53, 3), (4, 4, 3), (128, 16, 3), (1, 1, 3), (64, 32)])
def test_every_level_has_the_mean_of_the_first(shape):
    picture = RNG.uniform(0, 1, shape).astype(np.float32)
    levels = build_pyramid(picture)
    for level in levels:
        np.testing.assert_allclose(level.mean(axis=(0, 1)), picture.mean(axis=(0, 1)), atol=2e-5)
    assert min(levels[-1].shape[:2]) <= 4
    np.testing.assert_array_equal(levels[0], picture)


def test_averages_are_of_light_and_not_of_codes():
    stripes = np.zeros((16, 16, 3), np.uint8)
    stripes[::2] = 255
    assert texture_pyramid(stripes)[1].mean() / 65535 == pytest.approx(0.5, abs=1e-5)
    assert texture_pyramid(stripes)[0].max() == 65535
    grey = texture_pyramid(np.full((8, 8, 3), 119, np.uint8))[0] / 65535
    np.testing.assert_allclose(grey, srgb_to_linear(np.array(119 / 255)), atol=1e-5)


def test_texel_centres_are_exact_and_row_0_is_v_1():
    picture = random_texture(5, 9)
    row, column = (index.reshape(-1) for index in np.mgrid[:5, :9])
    found = sample(picture, (column + 0.5) / 9, 1 - (row + 0.5) / 5)
    np.testing.assert_allclose(found, srgb_to_linear(picture[row, column] / 255), atol=1e-5)


def test_between_texels_it_is_linear():
    steps = np.zeros((8, 32, 3), np.uint8)
    steps[:, 16:] = 255  # between the middles of columns 15 and 16 the light rises from 0 to 1
    x = RNG.uniform(15.5, 16.5, 3000)
    np.testing.assert_allclose(sample(steps, x / 32, np.full(3000, 0.5))[:, 0], x - 15.5, atol=1e-4)


def test_coordinates_outside_repeat():
    picture = random_texture(8, 8)
    u, v = RNG.uniform(0, 1, (2, 200))
    wanted = sample(picture, u, v)
    for du, dv in ((1, -2), (-3, 0), (40, 17)):
        np.testing.assert_allclose(sample(picture, u + du, v + dv), wanted, atol=1e-4)


def test_level_of_detail_picks_and_mixes_levels():
    picture = random_texture(64, 64)
    levels = texture_pyramid(picture)
    u, v = RNG.uniform(0, 1, (2, 200)).astype(np.float32)
    for lod in (0, 1, 1.7, 2, 3.3, len(levels) - 1):
        wanted = sample_by_numpy([level / 65535 for level in levels], u, v, np.full(200, lod))
        np.testing.assert_allclose(sample(picture, u, v, lod), wanted, atol=1e-5)
    at = {lod: sample(picture, u, v, lod) for lod in (0, 1, 1.25, 2, -3, 99, len(levels) - 1)}
    np.testing.assert_allclose(at[1.25], 0.75 * at[1] + 0.25 * at[2], atol=1e-5)
    np.testing.assert_array_equal(at[-3], at[0])
    np.testing.assert_array_equal(at[99], at[len(levels) - 1])


def test_textures_of_one_pack_are_told_apart():
    pictures = [random_texture(*shape) for shape in ((8, 8), (16, 4), (5, 7))]
    texels, found = pack_textures(pictures), np.empty((1, 3), np.float32)
    for index, picture in enumerate(pictures):
        h, w = picture.shape[:2]
        uv = np.array([[(w - 0.5) / w, 1 - 0.5 / h]], np.float32)
        fill_colours(texels, np.array([index], np.int32), uv, np.zeros(1, np.float32), found)
        np.testing.assert_allclose(found[0], srgb_to_linear(picture[0, w - 1] / 255), atol=1e-4)


@pytest.mark.parametrize("shape", [(1, 1), (4, 4), (5, 90), (64, 48), (33, 7)])
def test_a_pack_holds_the_pyramids_of_its_pictures(shape):
    turned = random_texture(*shape)[::-1, ::-1]  # not as it lies in memory
    packed = pack_textures([turned, random_texture(8, 8)])
    linear = np.round(LINEAR_OF_CODE * WHITE).astype(np.uint16)[turned]
    for number, level in enumerate(build_pyramid(linear)):
        begin, size = packed.start[number], level.shape[0] * level.shape[1]
        assert (packed.height[number], packed.width[number]) == level.shape[:2]
        np.testing.assert_array_equal(packed.values[begin : begin + size], level.reshape(-1, 3))
    assert packed.first.tolist() == [0, packed.levels[0]] and len(packed.values) == packed.start[-1] + 16 + 1


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


def test_the_kernel_looks_where_numpy_does():
    """Its own arc tangent and bilinear weights, against `arctan2`, `arcsin`; up to a hundredth of a pixel."""
    picture = RNG.uniform(0, 1, (32, 64, 3)).astype(np.float32)
    directions = RNG.normal(size=(5000, 3))
    directions[:6] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    found = look_towards(pad_channels(picture), directions)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(found, sample_directions(picture, unit), atol=1e-3)
