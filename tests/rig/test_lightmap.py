"""Values on a surface: linear fields come back exactly, and neighbours agree on their common edge."""

import numpy as np
import pytest
from kernel_samples import read_samples

from toolkit.rig.lighting import MAX_STEPS, place_samples

RNG = np.random.default_rng(7)


def inside(count):
    weights = RNG.dirichlet(np.ones(3), size=count)
    corners = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5], [0.5, 0], [0, 0.5]])
    return np.concatenate([weights[:, 1:], corners]).astype(np.float32)


@pytest.mark.parametrize("spacing", [0.4, 1.7, 5.0, 100.0])
def test_a_linear_field_comes_back_exactly(spacing):
    corners = RNG.uniform(-20, 20, (30, 3, 3)).astype(np.float32)
    normals = np.broadcast_to(np.array([0, 0, 1], np.float32), corners.shape)
    grid = place_samples(corners, normals, spacing)
    slope = np.array([[0.3, -1.2], [0.7, 0.1], [-0.4, 0.9]])

    # sharing merges samples up to a fifth of the spacing apart: read what each sample itself would store
    uv = inside(40)
    for face in range(30):
        r = grid.steps[face]
        ij = np.array([(i, j) for j in range(r + 1) for i in range(r + 1 - j)]) / r
        own = np.zeros((len(grid.slot), 2), np.float32)
        points = corners[face, 0] * (1 - ij.sum(1))[:, None] + ij @ corners[face, 1:].astype(float)
        own[grid.first[face] : grid.first[face] + len(points)] = points @ slope
        found = read_samples(grid, own, np.full(len(uv), face), uv)
        expected = (corners[face, 0] * (1 - uv.sum(1))[:, None] + uv @ corners[face, 1:]) @ slope
        np.testing.assert_allclose(found, expected, atol=2e-4)


def test_positions_stored_are_positions_read():
    corners = RNG.uniform(-20, 20, (12, 3, 3)).astype(np.float32)
    grid = place_samples(corners, np.broadcast_to(np.array([1, 0, 0], np.float32), corners.shape), 2.0)
    uv, face = inside(200), RNG.integers(12, size=206)
    found = read_samples(grid, grid.positions[grid.slot], face, uv)
    expected = corners[face, 0] * (1 - uv.sum(1))[:, None] + np.einsum("nk,nkx->nx", uv, corners[face, 1:])
    np.testing.assert_allclose(found, expected, atol=0.2 * 2.0)  # as far as shared samples lie apart


def test_neighbours_share_the_samples_of_their_edge():
    a, b, c, d = np.array([[0, 0, 0], [30, 0, 0], [30, 30, 0], [0, 30, 0]], np.float32)
    corners = np.stack([np.stack([a, b, c]), np.stack([a, c, d])])
    grid = place_samples(corners, np.broadcast_to(np.array([0, 0, 1], np.float32), corners.shape), 3.0)
    r = grid.steps[0]
    assert grid.steps[1] == r
    assert len(grid.positions) == (r + 1) ** 2  # two triangles of (r + 1)(r + 2) / 2 less one edge of r + 1
    noise = RNG.normal(size=(len(grid.positions), 3)).astype(np.float32)[grid.slot]
    t = np.linspace(0, 1, 101, dtype=np.float32)
    first = read_samples(grid, noise, np.zeros(101, int), np.stack([0 * t, t], axis=1))  # along a-c of the first
    second = read_samples(grid, noise, np.ones(101, int), np.stack([t, 0 * t], axis=1))
    np.testing.assert_allclose(first, second, atol=1e-5)


def test_faces_that_look_elsewhere_do_not_share():
    flat = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0]], np.float32)
    corners = np.stack([flat, flat[[0, 2, 1]]])
    normals = np.zeros_like(corners)
    normals[0, :, 2], normals[1, :, 2] = 1, -1
    grid = place_samples(corners, normals, 3.0)
    assert not set(grid.slot[: grid.first[1]]) & set(grid.slot[grid.first[1] :])


def test_a_huge_triangle_does_not_ask_for_endless_samples():
    corners = np.array([[[0, 0, 0], [1e6, 0, 0], [0, 1e6, 0]]], np.float32)
    grid = place_samples(corners, np.broadcast_to(np.array([0, 0, 1], np.float32), corners.shape), 1.0)
    assert len(grid.positions) == (MAX_STEPS + 1) * (MAX_STEPS + 2) // 2
