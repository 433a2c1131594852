"""Which texels triangles touch, against a separating-axis test and against dense samples."""

import numpy as np
import pytest

from toolkit.objects.atlas import cover_texels, nearest_covered


def touches(corners: np.ndarray, n: int) -> np.ndarray:
    """(n, n) bool by separating axes, triangle (3, 2) in uv against the open square of each texel."""
    p = np.stack([corners[:, 0], 1 - corners[:, 1]], axis=1).astype(float) * n
    edges = np.roll(p, -1, axis=0) - p
    axes = np.concatenate([np.eye(2), np.stack([-edges[:, 1], edges[:, 0]], axis=1)])
    row, column = np.mgrid[:n, :n]
    middle = np.stack([column + 0.5, row + 0.5], axis=-1)
    found = np.ones((n, n), bool)
    for axis in axes:
        at, reach = middle @ axis, np.abs(axis).sum() / 2
        found &= (at + reach > (p @ axis).min()) & (at - reach < (p @ axis).max())
    return found


def test_random_triangles_cover_what_separating_axes_say():
    rng = np.random.default_rng(3)
    n = 24
    for size in (0.02, 0.3, 1.0):
        triangles = np.clip(rng.random((40, 1, 2)) + size * rng.uniform(-1, 1, (40, 3, 2)), 0, 1)
        expected = np.any([touches(t, n) for t in triangles], axis=0)
        np.testing.assert_array_equal(cover_texels(triangles, n), expected)


def test_a_sliver_covers_every_texel_it_crosses():
    sliver = np.array([[[0.013, 0.021], [0.987, 0.942], [0.987, 0.9421]]])
    t = np.linspace(0, 1, 20001)[:, None]
    on_it = sliver[0, 0] + t * (sliver[0, 1] - sliver[0, 0])
    covered = cover_texels(sliver, 100)
    assert covered[np.floor((1 - on_it[:, 1]) * 100).astype(int), np.floor(on_it[:, 0] * 100).astype(int)].all()
    assert covered.sum() < 250  # a line through 100 columns and 93 rows


def test_a_triangle_without_area_covers_its_texel():
    covered = cover_texels(np.full((1, 3, 2), [0.55, 0.15]), 10)
    assert covered.sum() == 1 and covered[8, 5]


@pytest.mark.parametrize(("corner", "texel"), [((0, 0), (7, 0)), ((1, 0), (7, 7)), ((0, 1), (0, 0)), ((1, 1), (0, 7))])
def test_the_corners_of_the_texture_are_its_corner_texels(corner, texel):
    covered = cover_texels(np.full((1, 3, 2), corner, float), 8)
    assert covered.sum() == 1 and covered[texel]


def test_the_whole_square_is_covered_and_nothing_runs_past_one():
    square = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)
    assert cover_texels(square, 8).all()
    right = np.array([[[0.75, 0], [1, 0], [1, 1]], [[0.75, 0], [1, 1], [0.75, 1]]], float)
    expected = np.zeros((8, 8), bool)
    expected[:, 6:] = True
    np.testing.assert_array_equal(cover_texels(right, 8), expected)


def test_outside_the_texture_repeats():
    quad = np.array([[[0.5, 0], [1.25, 0], [1.25, 0.5]], [[0.5, 0], [1.25, 0.5], [0.5, 0.5]]], float)
    expected = np.zeros((8, 8), bool)
    expected[4:, 4:] = expected[4:, :2] = True
    np.testing.assert_array_equal(cover_texels(quad, 8), expected)
    np.testing.assert_array_equal(cover_texels(quad + np.array([3, -2]), 8), expected)


def test_the_nearest_covered_texel_is_nearest_around_the_border_too():
    rng = np.random.default_rng(1)
    n = 16
    covered = rng.random((n, n)) < 0.04
    source = nearest_covered(covered)
    assert covered.reshape(-1)[source].all()
    row, column = np.mgrid[:n, :n]
    np.testing.assert_array_equal(source[covered], (row * n + column)[covered])
    places = np.argwhere(covered)

    def distance(a, b):
        apart = np.abs(a - b)
        return np.linalg.norm(np.minimum(apart, n - apart), axis=-1)

    here = np.stack([row, column], axis=-1)
    least = distance(here[:, :, None], places).min(axis=2)
    np.testing.assert_allclose(distance(here, np.stack(np.divmod(source, n), axis=-1)), least)
