"""The drawn patch against slow supersampling, OpenCV, and finite differences."""

import cv2
import numpy as np
import pytest
import torch
from part_checks import check_gradient

from toolkit.boosters.transforms.placement import AffineRanges, affine_matrices
from toolkit.boosters.transforms.show import plan_warp, warp_patch


def supersample(patch: np.ndarray, T_image_patch: np.ndarray, image_px: int, grid: int = 12) -> np.ndarray:
    """Colour times mask, and mask: the mean over grid² points per pixel of the texel squares below them."""
    n, at = patch.shape[-1], (np.arange(image_px * grid) + 0.5) / grid
    x, y = np.meshgrid(at, at)
    u, v, w = np.linalg.inv(T_image_patch) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    column, row = np.floor(u / w).astype(int), np.floor(v / w).astype(int)
    hit = (column >= 0) & (column < n) & (row >= 0) & (row < n)
    seen = np.zeros((4, x.size))
    seen[:3, hit], seen[3, hit] = patch[:, row[hit], column[hit]], 1
    return seen.reshape(4, image_px, grid, image_px, grid).mean(axis=(2, 4))


def draw(patch: np.ndarray, T_image_patch: np.ndarray, image_px: int) -> np.ndarray:
    paper, mask = warp_patch(torch.from_numpy(patch), T_image_patch, image_px)
    return torch.cat([paper, mask], 1).numpy()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "m", "share", "foreshortening"),
    [(100, 224, (0.2, 0.42), (0.35, 1.0)), (100, 96, (0.2, 0.3), (0.35, 1.0)), (30, 96, (0.5, 0.9), (0.35, 1.0))],
)
def test_black_and_white_noise_matches_slow_supersampling(n, m, share, foreshortening):
    rng = np.random.default_rng(0)
    patch = rng.integers(0, 2, (3, n, n)).astype(np.float32)  # the hardest pattern: all of it is at the texel scale
    T = AffineRanges(share=share, foreshortening=foreshortening).place(rng, 3, n, m)
    expected = np.stack([supersample(patch, t, m) for t in T])
    inside = np.broadcast_to(expected[:, 3:] > 0.999, expected[:, :3].shape)
    error = draw(patch, T, m) - expected
    contrast = expected[:, :3][inside].std()
    assert np.sqrt((error[:, :3][inside] ** 2).mean()) < 0.2 * contrast
    assert np.sqrt((error[:, 3] ** 2).mean()) < 0.01


def test_a_single_bilinear_lookup_would_fail_that_comparison():
    """What the filter is for: without it the error is as large as the pattern."""
    rng = np.random.default_rng(0)
    patch = rng.integers(0, 2, (3, 100, 100)).astype(np.float32)
    T = AffineRanges(share=(0.2, 0.25)).place(rng, 1, 100, 224)[0]
    expected = supersample(patch, T, 224)
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    plain = cv2.warpAffine(
        patch.transpose(1, 2, 0), (np.linalg.inv(shift) @ T @ shift)[:2], (224, 224), flags=cv2.INTER_LINEAR
    )
    inside = np.broadcast_to(expected[3] > 0.999, expected[:3].shape)
    error = (plain.transpose(2, 0, 1) - expected[:3])[inside]
    assert np.sqrt((error**2).mean()) > 0.6 * expected[:3][inside].std()


def test_a_smooth_patch_matches_opencv_in_the_stated_convention():
    n, m = 64, 96
    u, v = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    patch = np.stack([u, v, 0.5 + 0.3 * np.sin(4 * u) * np.cos(3 * v)]).astype(np.float32)
    T = AffineRanges(share=(0.6, 0.66), foreshortening=(0.9, 1.0)).place(np.random.default_rng(2), 4, n, m)
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # OpenCV has pixel centres at whole numbers
    for drawn, t in zip(draw(patch, T, m), T, strict=True):
        matrix = (np.linalg.inv(shift) @ t @ shift)[:2]
        expected = cv2.warpAffine(patch.transpose(1, 2, 0), matrix, (m, m), flags=cv2.INTER_LINEAR)
        inside = cv2.warpAffine(np.pad(np.ones((n - 8, n - 8), np.float32), 4), matrix, (m, m)) > 0.999
        assert inside.sum() > 1000
        assert np.abs(drawn[:3].transpose(1, 2, 0) - expected)[inside].max() < 0.02


def test_identity_reproduces_the_texels():
    patch = np.random.default_rng(1).random((3, 40, 40), np.float32)
    drawn = draw(patch, np.eye(3)[None], 40)[0]
    np.testing.assert_allclose(drawn[:3], patch, atol=2e-5)
    np.testing.assert_allclose(drawn[3], 1, atol=2e-5)


def test_a_black_patch_is_opaque():
    T = affine_matrices(np.eye(2)[None] * 0.5, np.array([[32.0, 32.0]]), 64)
    paper, mask = warp_patch(torch.zeros(3, 64, 64), T, 64)
    assert paper.abs().max() < 1e-6
    assert mask[0, 0, 20:44, 20:44].min() > 0.99
    assert mask[0, 0, :14].max() < 0.02
    assert mask.sum() == pytest.approx(32 * 32, rel=0.01)


def test_a_fine_checkerboard_becomes_grey_and_not_moire():
    checks = ((np.indices((96, 96)).sum(axis=0) % 2)[None].repeat(3, 0)).astype(np.float32)
    drawn = draw(checks, affine_matrices(np.eye(2)[None] * 0.37, np.array([[32.3, 31.8]]), 96), 64)[0]
    middle = drawn[:3, 20:44, 20:44]
    assert middle.mean() == pytest.approx(0.5, abs=0.01)
    assert middle.std() < 0.1


def test_texels_stay_sharp_when_magnified():
    patch = np.zeros((3, 8, 8), np.float32)
    patch[:, :, 4:] = 1
    T = affine_matrices(np.eye(2)[None] * 8, np.array([[32.0, 32.0]]), 8)
    assert plan_warp(T, 8).repeat == 8
    row = draw(patch, T, 64)[0, 0, 32]
    assert np.abs(row[2:31]).max() < 0.02
    assert np.abs(row[33:62] - 1).max() < 0.02


def test_a_homography_lands_its_corners():
    """The same function draws a tilted sheet: the coloured corner texels appear where the matrix sends them."""
    T = np.array([[[0.5, 0.05, 10], [0.02, 0.4, 20], [0.0008, -0.001, 1]]])
    patch = np.zeros((3, 80, 80), np.float32)
    for (v, u), channel in zip(((8, 8), (8, 72), (72, 40)), range(3), strict=True):
        patch[channel, v - 4 : v + 4, u - 4 : u + 4] = 1
        x, y, w = T[0] @ [u, v, 1]
        drawn = draw(patch, T, 80)[0, channel]
        rows, columns = np.indices(drawn.shape) + 0.5
        assert (drawn * columns).sum() / drawn.sum() == pytest.approx(x / w, abs=0.15)
        assert (drawn * rows).sum() / drawn.sum() == pytest.approx(y / w, abs=0.15)


def test_gradient_matches_finite_differences_in_double_precision():
    rng = np.random.default_rng(3)
    T = AffineRanges(share=(0.4, 0.8)).place(rng, 2, 6, 16)
    check_gradient(lambda theta: warp_patch(theta, T, 16)[0], torch.from_numpy(rng.random((3, 6, 6))))
