"""Placements against closed forms."""

import numpy as np
import pytest

from toolkit.boosters.transforms.placement import AffineRanges, affine_matrices
from toolkit.core.errors import ToolkitError

N, M = 100, 224


def corners_of(T_image_patch: np.ndarray) -> np.ndarray:
    square = np.array([[0, 0, 1], [N, 0, 1], [N, N, 1], [0, N, 1]], float).T
    return (T_image_patch @ square)[:, :2].transpose(0, 2, 1)


def place(count: int = 200, **ranges) -> np.ndarray:
    return AffineRanges(**ranges).place(np.random.default_rng(5), count, N, M)


def test_a_fixed_rotation_puts_the_corners_where_trigonometry_says():
    T = place(8, rotation_deg=(30, 30), share=(0.25, 0.25), foreshortening=(1, 1))
    centred = corners_of(T) - corners_of(T).mean(axis=1, keepdims=True)
    half, angle = 0.25 * M / 2, np.radians(30)
    # x right, y down: a positive angle turns (right) towards (down), clockwise on the screen
    expected = [-half * np.cos(angle) + half * np.sin(angle), -half * np.sin(angle) - half * np.cos(angle)]
    np.testing.assert_allclose(centred[:, 0], np.tile(expected, (8, 1)), atol=1e-9)


def test_centre_goes_where_it_was_sent():
    T = affine_matrices(np.array([[[0.5, 0.1], [-0.2, 0.4]]]), np.array([[30.0, 90.0]]), N)
    np.testing.assert_allclose(T[0] @ [N / 2, N / 2, 1], [30, 90, 1])


def test_area_is_share_squared_times_foreshortening_and_both_span_their_ranges():
    T = place(4000)
    singular = np.linalg.svd(T[:, :2, :2], compute_uv=False)
    share, foreshortening = singular[:, 0] * N / M, singular[:, 1] / singular[:, 0]
    for values, low, high in ((share, 0.20, 0.42), (foreshortening, 0.35, 1.0)):
        assert low - 1e-9 <= values.min() < low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) < values.max() <= high + 1e-9
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.02)
    assert (np.linalg.det(T) > 0).all(), "a sheet of paper is never seen mirrored"


def test_overhang_bounds_what_leaves_the_frame():
    corners = corners_of(place(2000, overhang=0.1))
    width = np.ptp(corners, axis=1)
    assert (corners.min(axis=1) >= -0.1 * width - 1e-9).all()
    assert (corners.max(axis=1) <= M + 0.1 * width + 1e-9).all()
    assert (corners.min(axis=1) < 0).any(), "some do leave it"
    inside = corners_of(place(2000, overhang=0.0))
    assert inside.min() >= -1e-9
    assert inside.max() <= M + 1e-9


def test_a_square_larger_than_the_frame_is_centred():
    centres = corners_of(place(20, share=(1.6, 1.8), foreshortening=(1, 1), overhang=0)).mean(axis=1)
    np.testing.assert_allclose(centres, M / 2)


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"share": (0.5, 0.2)}, "share 0.5 0.2: expected two rising numbers from 0.02 to 2"),
        ({"foreshortening": (0.0, 1.0)}, "foreshortening 0 1: expected two rising numbers from 0.05 to 1"),
        ({"rotation_deg": (0, 900)}, "rotation_deg 0 900: expected two rising numbers from -360 to 360"),
        ({"overhang": 0.5}, "overhang 0.5: expected at least 0 and below 0.5"),
        ({"share": (float("nan"), 0.5)}, "share nan 0.5: expected"),
    ],
)
def test_impossible_ranges_are_refused(ranges, words):
    with pytest.raises(ToolkitError, match=words):
        AffineRanges(**ranges)
